"""Records of logs: as good as the logs, in files, in pieces, and safe with strangers."""

import json
import pickle
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
import sgpr
from conftest import DATA, outside
from sgpr import fleet

EXACT = 1e-9


@pytest.fixture(scope="module")
def robot() -> sgpr.Robot:
    return sgpr.Robot.from_urdf(DATA / "demo/robot.urdf")


@pytest.fixture(scope="module")
def logs() -> list[sgpr.Recording]:
    return [sgpr.read(DATA / f"demo/train_{k}.csv.gz") for k in (1, 2, 3)]


@pytest.fixture(scope="module")
def records(robot: sgpr.Robot, logs: list[sgpr.Recording]) -> list[sgpr.Record]:
    processing = sgpr.choose_processing(robot, logs)
    return [sgpr.record(robot, log, processing=processing, labels={"robot": "arm 1"}) for log in logs]


def bare(robot: sgpr.Robot, logs: list[sgpr.Recording], **options: Any) -> sgpr.Model:
    """The estimate of least squares alone, from the logs."""
    return sgpr.identify(robot, logs, prior=None, **options)


def identified(robot: sgpr.Robot, records: list[sgpr.Record], **options: Any) -> sgpr.Model:
    """The estimate of least squares alone."""
    return quiet(sgpr.identify_records, robot, records, prior=None, **options)


def quiet(identify: Callable[..., sgpr.Model], *given: Any, **options: Any) -> sgpr.Model:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return identify(*given, **options)


def relative(found: Any, expected: Any) -> float:
    found, expected = np.asarray(found), np.asarray(expected)
    return float(np.max(np.abs(found - expected) / np.maximum(np.abs(expected), 1e-3)))


@pytest.mark.parametrize("options", [{}, {"method": "ols"}, {"noise": [1.0, 1.0, 1.0, 0.3, 0.2, 0.1]}])
def test_records_give_the_model_of_the_logs(
    robot: sgpr.Robot, logs: list[sgpr.Recording], records: list[sgpr.Record], options: dict[str, Any]
) -> None:
    from_logs, from_records = bare(robot, logs, **options), identified(robot, records, **options)
    assert relative(from_records.parameters.values, from_logs.parameters.values) < EXACT
    assert relative(from_records.all_parameters, from_logs.all_parameters) < EXACT
    deviations = from_logs.parameters.standard_deviations
    assert relative(from_records.parameters.standard_deviations, deviations) < EXACT
    for figure in ("noise", "condition", "scaled_condition", "correlation"):
        assert relative(from_records.fit[figure], from_logs.fit[figure]) < EXACT
    assert np.array_equal(from_records.fit["rows"], from_logs.fit["rows"])


WAYS: list[dict[str, Any]] = [
    {},
    {"prior_deviation": 0.3},
    {"method": "ols", "prior": None},
    {"method": "ridge:0.5", "prior": None},
    {"method": "tls:0.01", "prior": None},
    {"essential": True, "prior": None},
    {"essential": True},
    {"consistent": True},
    {"consistent": True, "prior": "euclidean", "prior_deviation": 3.0},
    {"consistent": True, "prior_deviation": "auto", "bounds": {"joint_3": {"mass": [0.5, 4.0]}}},
]


def same_model(found: sgpr.Model, expected: sgpr.Model) -> None:
    """All that an identification says, but what it asks single rows for."""
    off = np.abs(found.parameters.values - expected.parameters.values)
    deviations = expected.parameters.standard_deviations
    assert relative(found.parameters.standard_deviations, deviations) < EXACT
    for figure in ("noise", "condition", "correlation", "dispersion", "half_interval_95"):
        assert relative(found.fit[figure], expected.fit[figure]) < EXACT
    assert found.fit["undetermined"] == expected.fit["undetermined"]
    assert found.history == expected.history
    if expected.certificate is None:
        assert np.all(off <= EXACT * np.maximum(np.abs(expected.parameters.values), deviations))
    else:
        # The solver ends within its tolerance: the same logs in another order differ by as much.
        assert np.all(off <= 1e-3 * deviations)
        assert found.certificate["active"] == expected.certificate["active"]
        assert found.certificate["prior_deviation"] == expected.certificate["prior_deviation"]


@pytest.mark.parametrize("options", WAYS)
@pytest.mark.parametrize("seconds", [None, (4.0, 7.31, 5.02)])
def test_records_give_the_model_of_the_logs_under_priors_and_physics(
    robot: sgpr.Robot,
    logs: list[sgpr.Recording],
    records: list[sgpr.Record],
    options: dict[str, Any],
    seconds: tuple[float, ...] | None,
) -> None:
    if seconds is not None:
        # Short logs of different lengths: the robot file holds what they do not tell.
        logs = [
            sgpr.read(DATA / f"demo/train_{k}.csv.gz", seconds=(0.0, end))
            for k, end in zip((1, 2, 3), seconds, strict=True)
        ]
        processing = sgpr.choose_processing(robot, logs)
        records = [sgpr.record(robot, log, processing=processing) for log in logs]
    found = quiet(sgpr.identify_records, robot, records[::-1], **options)
    same_model(found, quiet(sgpr.identify, robot, logs, **options))


def test_one_log_has_its_standard_deviations_without_products_of_lags_too(
    robot: sgpr.Robot, logs: list[sgpr.Recording]
) -> None:
    from_log, whole = bare(robot, logs[:1]), sgpr.record(robot, logs[0])
    small = sgpr.record(robot, logs[0], lags=False)
    assert small.to_parts()[1].size < whole.to_parts()[1].size / 3
    for record in (whole, small):
        own = identified(robot, [record])
        assert relative(own.parameters.standard_deviations, from_log.parameters.standard_deviations) < EXACT
        assert relative(own.fit["correlation"], from_log.fit["correlation"]) < EXACT


def test_parts_can_be_left_out(robot: sgpr.Robot, logs: list[sgpr.Recording], records: list[sgpr.Record]) -> None:
    # Without the second log: the model of the others, whatever was summed before.
    p = records[0].processing
    options = {"cutoff_hz": p.cutoff_hz, "decimation": p.decimation}
    other_processing = sgpr.choose_processing(robot, [logs[0], logs[2]], **options)
    with pytest.raises(TypeError, match="argument 'method'; options are effects, cutoff_hz"):
        sgpr.choose_processing(robot, logs, method="ols")
    two = [sgpr.record(robot, log, processing=other_processing) for log in (logs[0], logs[2])]
    left = identified(robot, two)
    expected = bare(robot, [logs[0], logs[2]], **options)
    assert relative(left.parameters.values, expected.parameters.values) < EXACT
    assert relative(left.parameters.standard_deviations, expected.parameters.standard_deviations) < EXACT


@pytest.mark.parametrize("arm", ["baxter", "kuka_lwr"])
def test_records_of_real_logs_that_contradict_each_other(arm: str) -> None:
    folder = outside(f"real/{arm}")
    robot = sgpr.Robot.from_urdf(next(folder.glob("*.urdf")))
    logs = [sgpr.read(log, robot.joint_names, accept=["joints_by_order"]) for log in sorted(folder.glob("t*.csv"))]
    processing = sgpr.choose_processing(robot, logs)
    from_logs = bare(robot, logs)
    apart, joined = (
        identified(robot, [sgpr.record(robot, log, processing=processing, lags=lags) for log in logs])
        for lags in (False, True)
    )
    expected = from_logs.parameters.standard_deviations
    assert relative(joined.parameters.values, from_logs.parameters.values) < EXACT
    assert relative(joined.parameters.standard_deviations, expected) < EXACT
    for options in ({}, {"consistent": True}, {"essential": True, "prior": None}):
        records = [sgpr.record(robot, log, processing=processing) for log in logs]
        found = quiet(sgpr.identify_records, robot, records, **options)
        same_model(found, quiet(sgpr.identify, robot, logs, **options))
    # What each log alone says of the memory is another thing.
    assert relative(apart.parameters.standard_deviations, expected) > 0.3


def test_order_does_not_change_a_bit_and_copies_count_once(
    robot: sgpr.Robot, records: list[sgpr.Record], tmp_path: Path
) -> None:
    forward, backward = identified(robot, records), identified(robot, records[::-1])
    assert forward.all_parameters.tobytes() == backward.all_parameters.tobytes()
    with pytest.warns(UserWarning, match="copy of another record"):
        twice = sgpr.identify_records(robot, [*records, records[1]], prior=None)
    assert twice.report is not None and twice.report.samples == 15_000
    assert twice.all_parameters.tobytes() == forward.all_parameters.tobytes()


def test_files_keep_every_bit(robot: sgpr.Robot, records: list[sgpr.Record], tmp_path: Path) -> None:
    file = tmp_path / "folder" / "records.parquet"
    fleet.save_records(file, records)
    for read in (
        fleet.load_records(file),
        fleet.load_records(tmp_path / "folder"),
        pickle.loads(pickle.dumps(records)),
    ):
        assert [record.to_parts()[0] for record in read] == [record.to_parts()[0] for record in records]
        same = zip(read, records, strict=True)
        assert all(np.array_equal(a.to_parts()[1], b.to_parts()[1]) for a, b in same)
    assert sorted(tmp_path.joinpath("folder").iterdir()) == [file]
    table = parquet.read_table(file, columns=["source", "labels", "samples"]).to_pylist()
    assert [row["samples"] for row in table] == [5000] * 3
    assert json.loads(table[0]["labels"]) == {"robot": "arm 1"}


def test_the_error_of_any_model_is_that_on_the_rows_of_the_logs(
    robot: sgpr.Robot, logs: list[sgpr.Recording], records: list[sgpr.Record]
) -> None:
    model = sgpr.Model.nominal(robot)
    processing = records[0].processing
    compared = sgpr.compare(model, logs, processing=processing)
    found = sgpr.compare_records(model, records)
    for joint in range(robot.dof):
        squares, torques, rows = 0.0, 0.0, 0
        for log in compared.logs:
            counted = log.counted[:: processing.decimation, joint]
            measured = log.measured_in_band[:: processing.decimation, joint][counted]
            predicted = log.predicted_in_band[:: processing.decimation, joint][counted]
            squares += float(((measured - predicted) ** 2).sum())
            torques += float((measured**2).sum())
            rows += len(measured)
        assert found[joint]["rows"] == rows
        assert found[joint]["rmse"] == pytest.approx(np.sqrt(squares / rows), rel=1e-9)
        assert found[joint]["torque"] == pytest.approx(np.sqrt(torques / rows), rel=1e-9)


@pytest.mark.parametrize("size", [700, 2111, 10**6])
def test_pieces_of_a_long_log_are_the_whole_log(robot: sgpr.Robot, logs: list[sgpr.Recording], size: int) -> None:
    # Three logs, one after the other with gaps between, cut without regard to them.
    def shifted(log: sgpr.Recording, start: int) -> dict[str, Any]:
        return {"t": log.time_ns - log.time_ns[0] + start, "q": log.q, "tau": log.tau}

    parts = [shifted(log, k * 40_000_000_000) for k, log in enumerate(logs)]
    arrays = {name: np.concatenate([part[name] for part in parts]) for name in ("t", "q", "tau")}

    def piece(start: int, end: int | None) -> sgpr.Recording:
        part = slice(start, end)
        t, q, tau = (arrays[name][part] for name in ("t", "q", "tau"))
        return sgpr.Recording(t, q, tau=tau, joint_names=robot.joint_names)

    whole = piece(0, None)
    processing = sgpr.choose_processing(robot, [whole])
    expected = identified(robot, [sgpr.record(robot, whole, processing=processing)])
    pieces = (piece(start, start + size) for start in range(0, len(whole), size))
    records = list(fleet.record_pieces(robot, pieces, processing=processing))
    assert sum(record.samples for record in records) == len(whole)
    found = identified(robot, records)
    assert np.array_equal(found.fit["rows"], expected.fit["rows"])
    assert relative(found.parameters.values, expected.parameters.values) < EXACT
    # Products across the borders of pieces are missing; of one piece none are.
    off = relative(found.parameters.standard_deviations, expected.parameters.standard_deviations)
    assert off < (EXACT if size > len(whole) else 0.5)


def test_what_a_record_cannot_serve_is_refused(
    robot: sgpr.Robot, logs: list[sgpr.Recording], records: list[sgpr.Record]
) -> None:
    with pytest.raises(sgpr.IdentificationError, match="single rows of the logs"):
        sgpr.identify_records(robot, records, method="irls")
    with pytest.raises(TypeError, match="'uncertainty'; options are method, noise, start"):
        sgpr.identify_records(robot, records, uncertainty="hac")  # type: ignore[call-arg]
    head, numbers = records[0].to_parts()
    earlier = {key: value for key, value in json.loads(head).items() if key not in ("extents", "key")}
    old = sgpr.Record.from_parts(json.dumps({**earlier, "version": 1}), numbers)
    old = sgpr.Record.from_parts(*old.to_parts())
    assert identified(robot, [old]).all_parameters.tobytes() == identified(robot, records[:1]).all_parameters.tobytes()
    with pytest.raises(sgpr.IdentificationError, match="make it again from its log, or identify without a prior"):
        sgpr.identify_records(robot, [old])
    with pytest.raises(sgpr.IdentificationError, match="`cable_hysteresis` follows the whole trajectory"):
        sgpr.record(robot, logs[0], effects=["cable_hysteresis@joint_2"])
    with pytest.raises(sgpr.IdentificationError, match="another robot"):
        sgpr.identify_records(sgpr.robots.puma560(), records)
    with pytest.raises(sgpr.IdentificationError, match="differ in their processing"):
        sgpr.identify_records(
            robot,
            [records[0], sgpr.record(robot, logs[1], processing=sgpr.choose_processing(robot, logs, cutoff_hz=5))],
        )
    with pytest.raises(sgpr.IdentificationError, match="no record was given"):
        sgpr.identify_records(robot, [])
    with pytest.raises(TypeError, match="expected a list of Record"):
        sgpr.identify_records(robot, logs)
    with pytest.raises(sgpr.SgprError, match="blocks: got 0"):
        sgpr.record(robot, logs[0], blocks=0)
    with pytest.raises(sgpr.IdentificationError, match="no sample of"):
        sgpr.record(robot, logs[0], counted=(0, 0))


def test_damaged_records_are_named_with_their_fault(records: list[sgpr.Record]) -> None:
    head, numbers = records[0].to_parts()
    broken = json.loads(head)
    with pytest.raises(sgpr.SgprError, match="numbers of a factor are missing"):
        sgpr.Record.from_parts(head, numbers[:-1])
    with pytest.raises(sgpr.SgprError, match="1 numbers are left over"):
        sgpr.Record.from_parts(head, np.append(numbers, 0.0))
    with pytest.raises(sgpr.SgprError, match="not finite"):
        sgpr.Record.from_parts(head, np.where(np.arange(len(numbers)) == 7, np.nan, numbers))
    for key, value, fault in [
        ("format", "else", "its head says `else`"),
        ("version", 99, "update it"),
        ("blocks", [], "no block"),
        ("samples", 2**60, "more rows than any log"),
        ("processing", {**broken["processing"], "order": 99}, "order"),
        ("surprise", 1, "unknown field"),
        ("extents", broken["extents"][1:], "what each of its joints did"),
        ("memory", [{**broken["memory"][0], "counts": [1]}], "each group of lags"),
        ("memory", [{**broken["memory"][0], "width": 20_000}], "a factor of 20000 columns"),
    ]:
        with pytest.raises(sgpr.SgprError, match=fault):
            sgpr.Record.from_parts(json.dumps({**broken, key: value}), numbers)
    robot = sgpr.Robot.from_urdf(DATA / "demo/robot.urdf")
    with pytest.raises(sgpr.SgprError, match="its memory is not that"):
        centre = json.dumps({**broken, "center": broken["center"][1:]})
        sgpr.identify_records(robot, [sgpr.Record.from_parts(centre, numbers)])
    broken["blocks"][0]["factors"][0]["joint"] = 77
    strange = sgpr.Record.from_parts(json.dumps(broken), numbers)
    with pytest.raises(sgpr.SgprError, match="columns that the equations"):
        sgpr.identify_records(robot, [strange])


def test_damaged_files_are_errors_and_no_half_is_written(records: list[sgpr.Record], tmp_path: Path) -> None:
    file = tmp_path / "records.parquet"
    fleet.save_records(file, records)
    whole = file.read_bytes()
    rng = np.random.default_rng(0)
    for cut in rng.integers(0, len(whole), 20):
        (tmp_path / "cut.parquet").write_bytes(whole[:cut])
        with pytest.raises(sgpr.SgprError, match="damaged"):
            fleet.load_records(tmp_path / "cut.parquet")
    for _ in range(30):
        changed = bytearray(whole)
        for place in rng.integers(0, len(whole), 20):
            changed[place] ^= 1 << int(rng.integers(8))
        (tmp_path / "changed.parquet").write_bytes(changed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                fleet.load_records(tmp_path / "changed.parquet")
            except sgpr.SgprError as error:
                assert "changed.parquet" in str(error)
    parquet.write_table(arrow.table({"x": [1]}), tmp_path / "other.parquet")
    with pytest.raises(sgpr.SgprError, match="holds no records"):
        fleet.load_records(tmp_path / "other.parquet")
    with pytest.raises(sgpr.SgprError, match="raise `limit_bytes`"):
        fleet.load_records(file, limit_bytes=1000)
    with pytest.raises(FileNotFoundError):
        fleet.load_records(tmp_path / "nowhere.parquet")

    def breaking() -> Any:
        yield records[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fleet.save_records(file, breaking())
    assert file.read_bytes() == whole
    assert len(list(tmp_path.glob(".records*"))) == 0


def test_deviations_find_what_was_put_in(robot: sgpr.Robot, logs: list[sgpr.Recording]) -> None:
    model = sgpr.identify(robot, logs[:1])
    log = logs[0]
    moved = log.tau.copy()
    moved[:, 1] += 2.0 * np.sign(log.dq[:, 1])
    moved[:, 2] *= 1.1
    changed = sgpr.Recording(log.time_ns, log.q, tau=moved, joint_names=log.joint_names)
    found = sgpr.deviations(model, sgpr.record(robot, changed, processing=model, blocks=1))[0]
    second, third = found["joints"][1], found["joints"][2]
    friction = next(one for one in second["parameters"] if one["name"] == "joint_2.Fc")
    assert friction["change"] == pytest.approx(2.0, abs=5 * friction["standard_deviation"] + 0.05)
    assert min(second["parameters"], key=lambda one: one["error_alone"]) is friction
    gain = third["parameters"][-1]
    assert gain["name"] == "joint_3.gain" and gain["change"] == pytest.approx(0.1, abs=0.005)
    assert min(third["parameters"], key=lambda one: one["error_alone"]) is gain
    # A tool of 1.5 kg at the last link, by the dynamics of the library.
    heavy = model.all_parameters.copy()
    names = model.all_parameter_names
    heavy[names.index("joint_6.m")] += 1.5
    loaded = sgpr.Model.from_parameters(robot, heavy, effects=model.effects)
    motion = (log.q, log.dq, np.gradient(log.dq, 1.0 / log.sample_rate_hz, axis=0))
    extra = loaded.predict(*motion) - model.predict(*motion)
    carrying = sgpr.Recording(log.time_ns, log.q, tau=log.tau + extra, joint_names=log.joint_names)
    found = sgpr.deviations(model, sgpr.record(robot, carrying, processing=model, blocks=1))[0]
    assert found["tool_mass"] == pytest.approx(1.5, abs=0.15)
    assert found["tool_share"] > 0.5
    # What the tool leaves is less than any parameter of the joint's own does, at the joint that carries most of it.
    loaded_joint = found["joints"][1]
    alone = min(one["error_alone"] for one in loaded_joint["parameters"])
    assert loaded_joint["error_with_tool"] < 0.5 * alone < 0.5 * loaded_joint["error"]


@pytest.fixture(scope="module")
def with_a_spring() -> list[sgpr.Recording]:
    """Logs of an arm with a cable at its second joint, of which the model knows nothing."""
    robot = sgpr.Robot.from_urdf(DATA / "demo/robot.urdf")
    rng = np.random.default_rng(3)
    w = 2.0 * np.pi * 0.11 * np.arange(1, 6)
    logs = []
    for _ in range(2):
        phase = rng.uniform(0.0, 2.0 * np.pi, (5, robot.dof))
        angle = (np.arange(3000) / 100.0)[:, None, None] * w[:, None] + phase
        q = 0.25 * np.sin(angle).sum(axis=1)
        dq = 0.25 * np.einsum("kij,i->kj", np.cos(angle), w)
        ddq = -0.25 * np.einsum("kij,i->kj", np.sin(angle), w**2)
        tau = robot.inverse_dynamics(q, dq, ddq) + 2.0 * np.sign(dq) + 3.0 * dq
        tau[:, 2] += 6.0 * q[:, 2]
        tau += 0.1 * rng.standard_normal(tau.shape)
        time = np.arange(len(q)) * 10_000_000
        logs.append(sgpr.Recording(time, q, tau=tau, joint_names=robot.joint_names, source=f"log {len(logs)}"))
    return logs


SUSPECTS = ["cable_stiffness", "quadratic_viscous_friction", "stribeck_friction"]


def test_an_effect_that_the_model_lacks_is_found_in_records(
    robot: sgpr.Robot, with_a_spring: list[sgpr.Recording], tmp_path: Path
) -> None:
    processing = sgpr.choose_processing(robot, with_a_spring)
    records = [sgpr.record(robot, log, processing=processing, suspects=SUSPECTS) for log in with_a_spring]
    fleet.save_records(tmp_path / "records.parquet", records)
    kept = fleet.load_records(tmp_path / "records.parquet")
    assert kept[0].suspects == records[0].suspects
    found = sgpr.diagnose_records(robot, kept[::-1])
    joint = robot.joint_names[2]
    assert [(test["effect"], test["joint"]) for test in found["tests"] if test["found"]] == [("cable_stiffness", joint)]
    spring = found["tests"][0]
    # The same column in the equations of the logs: another way to the same least squares.
    effects = ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset", f"cable_stiffness@{joint}"]
    options = {"cutoff_hz": processing.cutoff_hz, "decimation": processing.decimation, "turn_margin": 1.0}
    from_logs = bare(robot, with_a_spring, effects=effects, **options)
    stiffness = next(iter(from_logs.terms[0]["parameters"].values()))[0]
    assert spring["parameters"][0]["value"] == pytest.approx(stiffness, rel=1e-8)
    assert abs(spring["parameters"][0]["value"] - 6.0) < 5 * spring["parameters"][0]["standard_deviation"]
    before, after = (found["left_out_errors"][2][key] for key in ("without", "with"))
    assert after < 0.5 * before
    # What goes on from row to row was the spring.
    assert not spring["mostly_unexplained"] and found["left_out_errors"][2]["unexplained"] < 0.1
    # Whatever has columns beside them, the equations are the same.
    plain = sgpr.record(robot, with_a_spring[0], processing=processing)
    assert (
        identified(robot, [records[0]]).all_parameters.tobytes() == identified(robot, [plain]).all_parameters.tobytes()
    )


def named(log: sgpr.Recording) -> dict[str, Any]:
    return {"joint_names": log.joint_names, "source": log.source}


def test_nothing_is_found_in_records_of_an_arm_that_lacks_nothing(
    robot: sgpr.Robot, with_a_spring: list[sgpr.Recording]
) -> None:
    healthy = [
        sgpr.Recording(
            log.time_ns,
            log.q,
            tau=log.tau - 6.0 * log.q * (np.arange(robot.dof) == 2),  # type: ignore[operator]
            **named(log),
        )
        for log in with_a_spring
    ]
    processing = sgpr.choose_processing(robot, healthy)
    records = [sgpr.record(robot, log, processing=processing, suspects=SUSPECTS) for log in healthy]
    found = sgpr.diagnose_records(robot, records)
    assert [test for test in found["tests"] if test["found"]] == []
    assert 0 < len(found["tests"]) <= len(SUSPECTS) * robot.dof
    # A cable that pushed would be none.
    pushed = [
        sgpr.Recording(log.time_ns, log.q, tau=log.tau - 12.0 * log.q * (np.arange(robot.dof) == 2), **named(log))  # type: ignore[operator]
        for log in with_a_spring
    ]
    records = [sgpr.record(robot, log, processing=processing, suspects=["cable_stiffness"]) for log in pushed]
    assert not any(test["found"] for test in sgpr.diagnose_records(robot, records)["tests"])


def test_turns_of_joints_that_stick_are_no_stribeck_friction() -> None:
    """A sample stands on either side of a jump of the friction: no effect, however well one explains it."""
    robot = sgpr.Robot.from_urdf(DATA / "reference/urdf/ur5e_like.urdf")
    arm = fleet.simulated.Arm("arm", "ur5e", 501)
    logs = []
    for session in range(6):
        log = fleet.simulated.session_log(arm, robot, session, 1, seconds=10.0)
        logs.append(sgpr.Recording(log["t"], log["q"], tau=log["tau"], joint_names=robot.joint_names))
    processing = sgpr.choose_processing(robot, logs)
    records = [sgpr.record(robot, log, processing=processing, suspects=["stribeck_friction"]) for log in logs]
    assert [test for test in sgpr.diagnose_records(robot, records)["tests"] if test["found"]] == []


def test_a_finding_beside_a_larger_effect_that_is_no_suspect_says_so(
    robot: sgpr.Robot, with_a_spring: list[sgpr.Recording]
) -> None:
    """A ripple over the position that nobody suspects, and half as much of a spring."""

    def rippling(log: sgpr.Recording) -> sgpr.Recording:
        tau = np.array(log.tau)
        tau[:, 2] += 4.0 * np.sin(9.0 * log.q[:, 2])
        return sgpr.Recording(log.time_ns, log.q, tau=tau, **named(log))

    logs = [rippling(log) for log in with_a_spring]
    processing = sgpr.choose_processing(robot, logs)
    records = [sgpr.record(robot, log, processing=processing, suspects=["cable_stiffness"]) for log in logs]
    found = sgpr.diagnose_records(robot, records)
    tests = [test for test in found["tests"] if test["found"]]
    assert [test["joint"] for test in tests] == [robot.joint_names[2]] and tests[0]["mostly_unexplained"]
    assert found["left_out_errors"][2]["unexplained"] > 0.5


def test_what_cannot_be_a_suspect_is_refused(
    robot: sgpr.Robot, logs: list[sgpr.Recording], records: list[sgpr.Record]
) -> None:
    for name, reason in [
        ("payload", "no torque of one joint"),
        ("external_contact", "differ from log to log|no torque of one joint"),
        ("viscous_friction", "have it already"),
        ("cable_stiffness@elbow", "no such joint"),
    ]:
        with pytest.raises(sgpr.IdentificationError, match=reason):
            sgpr.record(robot, logs[0], suspects=[name])
    with pytest.raises(sgpr.IdentificationError, match="make records with suspects"):
        sgpr.diagnose_records(robot, records)


def late(log: sgpr.Recording, samples: int, joints: list[int]) -> sgpr.Recording:
    """The log with torques of some joints that come some samples after their motion."""
    assert log.tau is not None
    tau = log.tau.copy()
    tau[samples:, joints] = log.tau[: len(log) - samples, joints]
    return sgpr.Recording(log.time_ns, log.q, tau=tau, joint_names=log.joint_names)


def test_torques_that_are_late_are_in_the_findings_of_a_record(robot: sgpr.Robot, logs: list[sgpr.Recording]) -> None:
    def found(log: sgpr.Recording) -> list[dict[str, Any]]:
        processing = sgpr.choose_processing(robot, [log])
        screening = sgpr.record(robot, log, processing=processing, lags=False).screening
        return [finding for finding in screening if finding["kind"] in ("late", "all_late")]

    def milliseconds(message: str) -> float:
        return float(re.findall(r"([\d.]+) ms after", message)[0])

    def of_all_rows(log: sgpr.Recording) -> list[str]:
        model = quiet(sgpr.identify, robot, [log])
        return [message for message in map(str, sgpr.screen(model, [log])) if " ms after" in message]

    assert [found(log) for log in logs] == [[], [], []]
    # Shifts by whole rows of the equations tell the time to one of them; these are three and four samples apart.
    row = 4e3 / logs[0].sample_rate_hz
    for samples in (5, 12, 25):
        moved = late(logs[0], samples, list(range(robot.dof)))
        (whole,), (slow, *_) = found(moved), of_all_rows(moved)
        assert whole["kind"] == "all_late" and whole["rank"] == "look" and whole["subject"] is None
        assert abs(milliseconds(whole["message"]) - milliseconds(slow)) < row
    for samples in (12, 20):
        moved = late(logs[1], samples, [2])
        (alone,), (slow,) = found(moved), of_all_rows(moved)
        assert alone["kind"] == "late" and alone["rank"] == "know" and alone["subject"] == robot.joint_names[2]
        assert abs(milliseconds(alone["message"]) - milliseconds(slow)) < row


def test_a_parquet_log_in_pieces_is_the_log(robot: sgpr.Robot, logs: list[sgpr.Recording], tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    log = logs[0]
    columns = {f"{name}_position": log.q[:, k] for k, name in enumerate(robot.joint_names)}
    columns |= {f"{name}_torque": log.tau[:, k] for k, name in enumerate(robot.joint_names)}
    parquet.write_table(arrow.table({"time_ns": log.time_ns, **columns}), path, row_group_size=700)
    whole = sgpr.read(path, robot.joint_names)
    pieces = list(fleet.read_pieces(path, robot.joint_names, samples=1500))
    assert len(pieces) > 2 and all(piece.notes == whole.notes for piece in pieces)
    for name in ("time_ns", "q", "tau"):
        assert np.array_equal(np.concatenate([getattr(piece, name) for piece in pieces]), getattr(whole, name))
    processing = sgpr.choose_processing(robot, [whole])
    streamed = list(
        fleet.record_pieces(robot, fleet.read_pieces(path, robot.joint_names, samples=1500), processing=processing)
    )
    together = identified(robot, streamed)
    expected = identified(robot, [sgpr.record(robot, whole, processing=processing)])
    assert relative(together.parameters.values, expected.parameters.values) < EXACT
    with pytest.raises(TypeError, match="has no option `rows`"):
        fleet.read_pieces(path, rows=(1, 2))
    with pytest.raises(sgpr.SgprError, match="at least 1 in a piece"):
        fleet.read_pieces(path, samples=0)
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(sgpr.RecordingError, match="not a Parquet file, or damaged"):
        list(fleet.read_pieces(path))
