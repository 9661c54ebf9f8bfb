"""Fleets: the same records whoever makes them, logs that are set aside, and changes that are found."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sgpr
from conftest import DATA, outside
from sgpr import fleet
from sgpr.fleet import changes, engine, simulated
from sgpr.fleet.evidence import Track, find_jumps
from sgpr.fleet.logs import find

distributed = pytest.importorskip("distributed", reason="Dask is not installed (pip install sgpr[fleet])")
pytestmark = pytest.mark.filterwarnings("ignore")

TYPES = {"two": sgpr.robots.two_link()}


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fleet")
    return fleet.simulate_fleet(folder, arms=3, days=4, sessions_per_day=1, faulty=0.0, seed=3, workers=1)


@pytest.fixture(scope="module")
def robots() -> dict[str, sgpr.Robot | sgpr.Model]:
    return {"puma560": sgpr.robots.puma560(), "two_link": sgpr.robots.two_link()}


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as made:
        yield made


def run(table: Path | str, robots: dict[str, Any], out: Path, **options: Any) -> tuple[engine.Outcome, list[Any]]:
    out.mkdir(exist_ok=True)
    logs = options.pop("logs", None) or find(str(table))
    kinds = engine.kinds_of(robots, logs, out)
    outcome = engine.make_records(logs, kinds, out, **options)
    parts = [record.to_parts() for record in fleet.load_records(out / "records")]
    return outcome, sorted((head, numbers.tobytes()) for head, numbers in parts)


def test_workers_and_order_change_no_bit_and_broken_logs_stop_nothing(
    table: Path, robots: dict[str, Any], cluster: Any, tmp_path: Path
) -> None:
    address = cluster.scheduler_address
    outcome, of_two = run(table, robots, tmp_path / "two", scheduler=address)
    broken = json.loads(table.with_name("truth.json").read_text())["broken"]
    aside = {str(Path(path).relative_to(table.parent)) for path in outcome.aside}
    # The log of another robot has joints of the same names, and is seen later.
    assert aside == {path for path, what in broken.items() if what.startswith(("cut", "a clock"))}
    assert len(outcome.copies) == 1 and outcome.made == len(of_two) == 11
    reasons = " ".join(outcome.aside.values())
    assert "damaged" in reasons and "the time runs backwards" in reasons
    # Two workers, the other way round; then nothing is left to do.
    logs = find(str(table))[::-1]
    kinds = engine.kinds_of(robots, logs[::-1], tmp_path / "two")
    (tmp_path / "back").mkdir()
    engine.make_records(logs, kinds, tmp_path / "back", scheduler=address)
    back = [record.to_parts() for record in fleet.load_records(tmp_path / "back" / "records")]
    assert sorted((head, numbers.tobytes()) for head, numbers in back) == of_two
    again, _ = run(table, robots, tmp_path / "two", scheduler=address)
    assert again.made == 0 and again.kept == outcome.made
    one = [record for record in fleet.load_records(tmp_path / "two") if record.labels["robot"] == "arm 000"]
    models = [sgpr.identify_records(robots["puma560"], order).all_parameters.tobytes() for order in (one, one[::-1])]
    assert models[0] == models[1]


def test_one_worker_makes_the_same_and_a_worker_that_dies_loses_nothing(
    table: Path, robots: dict[str, Any], cluster: Any, tmp_path: Path
) -> None:
    _, of_one = run(table, robots, tmp_path / "one", workers=1)
    killed = []

    def kill_one(stage: str, done: int, total: int) -> None:
        if done == 3 and not killed:
            with distributed.Client(cluster, set_as_default=False) as client:
                killed.append(next(iter(client.run(os.getpid).values())))
            os.kill(killed[0], signal.SIGKILL)

    outcome, of_survivors = run(
        table, robots, tmp_path / "dead", scheduler=cluster.scheduler_address, progress=kill_one
    )
    assert killed and of_survivors == of_one
    assert not any("worker" in reason for reason in outcome.aside.values())


def test_workers_that_do_not_start_are_told_with_a_remedy(
    table: Path, robots: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def busy(**options: Any) -> None:
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr(distributed, "LocalCluster", busy)
    with pytest.raises(sgpr.SgprError, match=r"Nanny failed to start.*busy.*--workers 1"):
        run(table, robots, tmp_path / "busy", workers=2)


def test_a_run_that_is_killed_goes_on(table: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "sgpr", "fleet", "run", str(table), "--robot", "puma560=puma560"]
    command += ["two_link=two_link", "--out", str(tmp_path), "--workers", "1", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    limit = time.monotonic() + 300
    while not list(tmp_path.glob("records/*/*.parquet")) and time.monotonic() < limit:
        time.sleep(0.01)
    process.kill()
    process.wait()
    there = {path: path.stat().st_mtime_ns for path in tmp_path.glob("records/*/*.parquet")}
    assert there
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["kept"] == len(there) and told["made"] + told["kept"] == 11
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in there.items())
    assert len(fleet.load_records(tmp_path / "records")) == 11


def test_a_scheduler_that_dies_is_told_and_the_run_goes_on_with_another(
    table: Path, robots: dict[str, Any], tmp_path: Path
) -> None:
    _, expected = run(table, robots, tmp_path / "whole", workers=1)

    def started(folder: Path) -> tuple[list[Any], str]:
        """A scheduler and a worker, each a process of its own."""
        folder.mkdir()
        dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
        dask += ["--no-dashboard", "--scheduler-file", str(folder / "scheduler.json")]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        processes = [subprocess.Popen(dask, **quiet)]
        limit = time.monotonic() + 300
        while not (folder / "scheduler.json").exists() and time.monotonic() < limit:
            time.sleep(0.1)
        address = json.loads((folder / "scheduler.json").read_text())["address"]
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"]
        worker += ["--local-directory", str(folder), "--death-timeout", "60"]
        processes.append(subprocess.Popen(worker, **quiet))
        return processes, address

    processes, address = started(tmp_path / "first")

    def kill_scheduler(stage: str, done: int, total: int) -> None:
        if done == 3:
            processes[0].kill()

    try:
        with pytest.raises(sgpr.SgprError, match="the scheduler is gone"):
            run(table, robots, tmp_path / "records", scheduler=address, progress=kill_scheduler)
        there = {path: path.stat().st_mtime_ns for path in tmp_path.glob("records/records/*/*.parquet")}
        assert 0 < len(there) < len(expected)
        others, address = started(tmp_path / "second")
        processes += others
        outcome, found = run(table, robots, tmp_path / "records", scheduler=address)
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait()
    assert outcome.kept == len(there) and found == expected
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in there.items())


def test_logs_in_an_object_store(table: Path, robots: dict[str, Any], cluster: Any, tmp_path: Path) -> None:
    server = pytest.importorskip("moto.server", reason="moto is not installed: no object store to test with")
    boto3 = pytest.importorskip("boto3")
    pytest.importorskip("s3fs")
    store = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    store.start()
    host, port = store.get_host_and_port()
    names = {"aws_access_key_id": "test", "aws_secret_access_key": "test", "region_name": "us-east-1"}
    try:
        client = boto3.client("s3", endpoint_url=f"http://{host}:{port}", **names)
        broken = json.loads(table.with_name("truth.json").read_text())["broken"]
        whole = sorted(path for path in table.parent.glob("logs/arm_000/*.parquet"))
        healthy = [path for path in whole if path.relative_to(table.parent).as_posix() not in broken][:2]
        client.create_bucket(Bucket="logs")
        for path in healthy:
            client.upload_file(str(path), "logs", f"arm_000/{path.name}")
        storage = {"key": "test", "secret": "test", "client_kwargs": {"endpoint_url": f"http://{host}:{port}"}}
        logs = find("s3://logs/*/*.parquet", storage)
        assert [(log.robot, log.labels["session"]) for log in logs] == [("arm_000", path.stem) for path in healthy]
        given = {"": robots["puma560"]}
        kinds = engine.kinds_of(given, logs, tmp_path, storage=storage)
        outcome = engine.make_records(logs, kinds, tmp_path, scheduler=cluster.scheduler_address, storage=storage)
    finally:
        store.stop()
    assert outcome.made == 2 and not outcome.aside


def test_tables_and_robots_that_cannot_be(table: Path, robots: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "no.csv").write_text("path,robot\n,arm\n")
    with pytest.raises(sgpr.SgprError, match=re.escape("no.csv, line 2: `path` and `robot` are needed")):
        find(str(tmp_path / "no.csv"))
    with pytest.raises(sgpr.SgprError, match="no log is there"):
        find(str(tmp_path / "*.mcap"))
    with pytest.raises(sgpr.SgprError, match="no scheduler of Dask answers"):
        run(table, robots, tmp_path / "x", scheduler="tcp://127.0.0.1:1")
    logs = find(str(table))
    kinds = engine.kinds_of({"two_link": robots["two_link"]}, logs, tmp_path / "y")
    outcome = engine.make_records(logs[:1], kinds, tmp_path / "y")
    assert outcome.made == 0 and "no robot of the type `puma560`" in next(iter(outcome.aside.values()))


def made(
    robot: sgpr.Robot,
    faults: tuple[Any, ...],
    arms: int = 4,
    sessions: int = 16,
    tools: bool = False,
    seed: int = 1000,
) -> list[sgpr.Record]:
    """Records of a fleet of one type, the first arm with faults."""
    from sgpr.fleet.simulated import Arm, session_log

    records, processing = [], None
    for k in range(arms):
        arm = Arm(f"arm {k}", "two", seed + k, faults if k == 0 else (), tools)
        for session in range(sessions):
            log = session_log(arm, robot, session, 2, tracked=False)
            channels = {"temperature": log["temperature"]}
            recording = sgpr.Recording(
                log["t"], log["q"], tau=log["tau"], joint_names=robot.joint_names, channels=channels
            )
            processing = processing or sgpr.choose_processing(robot, [recording])
            labels = {"robot": arm.name, "type": "two", "session": f"{session:04d}", "tool": arm.tool(session / 2)[0]}
            records.append(sgpr.record(robot, recording, processing=processing, labels=labels, blocks=1))
    return records


@pytest.fixture(scope="module")
def changed() -> list[changes.ArmHistory]:
    fault = fleet.simulated.Fault("friction", 1, 9, 0.08)
    return changes.histories(made(TYPES["two"], (fault,)), TYPES)


def test_a_rise_of_friction_is_found_named_and_dated(changed: list[changes.ArmHistory]) -> None:
    alarms = [alarm for history in changed for alarm in history.alarms]
    assert len(alarms) == 1, [alarm.text for alarm in alarms]
    alarm = alarms[0]
    assert (alarm.robot, alarm.joint, alarm.cause) == ("arm 0", "joint_2", "Coulomb friction")
    # Two sessions a day: within a day of logs.
    assert (
        alarm.session == 9
        and alarm.told <= 10
        and alarm.until is None
        and alarm.change == pytest.approx(0.08, abs=0.03)
    )
    assert "Coulomb friction +" in alarm.text and "since 5 March 2026" in alarm.text


@pytest.mark.parametrize(("kind", "size", "cause"), [("tool", 1.0, "tool"), ("torque_gain", 0.06, "torque gain")])
def test_a_tool_and_a_gain_are_named(kind: str, size: float, cause: str) -> None:
    robot = sgpr.robots.puma560()
    fault = fleet.simulated.Fault(kind, 1, 8, size)
    found = changes.histories(made(robot, (fault,), arms=1, sessions=12), {"two": robot})
    # One arm of twelve sessions says too little of chance to ask that no other joint is named.
    alarms = [alarm for history in found for alarm in history.alarms if alarm.joint in ("", "joint_2")]
    assert [alarm.cause for alarm in alarms] == [cause], [alarm.text for alarm in alarms]
    assert alarms[0].session == 8 and alarms[0].change == pytest.approx(size, rel=0.2)


def test_an_undeclared_tool_is_one_alarm_and_what_comes_later_is_found() -> None:
    """Measured by the body without it, its joints would seem to change whenever the motion does."""
    robot = sgpr.robots.puma560()
    faults = (fleet.simulated.Fault("tool", 4, 12, 1.0), fleet.simulated.Fault("friction", 1, 26, 0.22))
    found = changes.histories(made(robot, faults, arms=2, sessions=32, seed=16), {"two": robot})
    alarms = [(alarm.robot, alarm.joint, alarm.cause, alarm.session) for history in found for alarm in history.alarms]
    assert alarms == [("arm 0", "", "tool", 12), ("arm 0", "joint_2", "Coulomb friction", 26)]
    mass = found[0].find("", "tool")
    assert np.nanmedian(mass.change[12:]) == pytest.approx(1.0, abs=0.02)


def test_an_offset_that_a_mass_could_make_is_an_offset() -> None:
    fault = fleet.simulated.Fault("torque_offset", 0, 22, 0.5)
    found = changes.histories(made(TYPES["two"], (fault,), arms=1, sessions=40, tools=True, seed=12), TYPES)
    alarms = [alarm for history in found for alarm in history.alarms]
    assert [(alarm.joint, alarm.cause, alarm.session) for alarm in alarms] == [("joint_1", "torque offset", 22)]


def test_evidence_beyond_the_range_of_numbers_stays_a_number() -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(size=(4, 90))
    values[0, 30:] += 2500.0
    with np.errstate(all="raise", under="ignore"):
        found = find_jumps(tracks(values, 1e3))
    assert [one.jumps for one in found] == [[30], [], [], []]
    assert all(np.isfinite(one.ratio).all() for one in found)


def test_a_session_of_gentle_motion_is_no_event() -> None:
    """Its error is a larger share of its torque, and no larger."""
    history = changes.histories(made(TYPES["two"], (), arms=1, sessions=20), TYPES)[0]
    history.events = []
    history.error[10, 0] *= 20.0
    changes.find_events(history)
    assert history.events == []
    history.residual[10, 0] *= 20.0
    changes.find_events(history)
    assert [(event["joint"], event["session"]) for event in history.events] == [("joint_1", "0010")]


def test_declared_tools_are_no_change_and_undeclared_ones_are() -> None:
    records = made(TYPES["two"], (), arms=2, sessions=60, tools=True)
    histories = changes.histories(records, TYPES)
    assert all(len(set(history.tools)) == 2 for history in histories)
    assert not [alarm.text for history in histories for alarm in history.alarms]
    undeclared = []
    for record in records:
        head, numbers = record.to_parts()
        undeclared.append(sgpr.Record.from_parts(re.sub('"tool":"[a-z]*"', '"tool":""', head), numbers))
    assert all(record.labels["tool"] == "" for record in undeclared)
    found = changes.histories(undeclared, TYPES)
    for history, declared in zip(found, histories, strict=True):
        tools = np.array(declared.tools)
        changed = (np.flatnonzero(tools[1:] != tools[:-1]) + 1).tolist()
        assert [(alarm.cause, alarm.session) for alarm in history.alarms] == [("tool", session) for session in changed]
        masses = [alarm.change for alarm in history.alarms]
        assert masses == pytest.approx([0.8, -0.8], abs=0.02), [alarm.text for alarm in history.alarms]


def test_references_of_two_tools_differ_and_nothing_changed() -> None:
    """The offset of a joint under gravity is another one in the reference of the second tool: the fit cannot tell it
    from the moments of the links."""
    records = made(TYPES["two"], (), arms=1, sessions=100, tools=True, seed=1_000_008)
    (history,) = changes.histories(records, TYPES)
    tools = np.array(history.tools)
    offset = history.find("joint_2", "tau0")
    levels = [history.without_temperature(offset)[tools == tool].mean() for tool in dict.fromkeys(history.tools)]
    assert abs(levels[1] - levels[0]) > 4.0 * np.median(offset.deviation) and np.median(offset.unsure) > 0.0
    assert not [alarm.text for alarm in history.alarms]


def test_a_tool_of_a_few_sessions_is_not_measured_by_a_sister() -> None:
    """Its reference would differ by as much as arms do."""
    records = made(TYPES["two"], (), arms=3, sessions=16)
    for k, record in enumerate(records):
        head, numbers = record.to_parts()
        data = json.loads(head)
        session = int(data["labels"]["session"])
        # The first arm has the second tool in the last three sessions, the others for long.
        data["labels"]["tool"] = "b" if session >= (13 if data["labels"]["robot"] == "arm 0" else 8) else "a"
        records[k] = sgpr.Record.from_parts(json.dumps(data), numbers)
    histories = changes.histories(records, TYPES)
    assert not [alarm.text for history in histories for alarm in history.alarms]
    friction = histories[0].find("joint_2", "Fc")
    assert np.isfinite(friction.change).tolist() == [True] * 13 + [False] * 3
    assert all(np.isfinite(history.find("joint_2", "Fc").change).all() for history in histories[1:])


def test_a_level_may_wander_as_far_as_it_is_said_to() -> None:
    """A step as large as what was foreseen is none."""
    rng = np.random.default_rng(5)
    values = rng.normal(size=(8, 60))
    values[:, 30:] += 12.0
    wander = np.zeros(60)
    wander[30] = 12.0**2
    foreseen = [Track(row, np.ones(60), wander, "one", 1e3) for row in values]
    assert all(one.jumps == [30] for one in find_jumps(tracks(values, 1e3)))
    assert not any(one.jumps for one in find_jumps(foreseen))


def tracks(values: Any, limit: float, wander: float = 0.0) -> list[Track]:
    """Tracks of unit deviation, one per row."""
    ones = np.ones(values.shape[1])
    return [Track(row, ones, wander**2 * ones, "one", limit) for row in values]


@pytest.mark.parametrize("tails", ["normal", "heavy"])
def test_chance_makes_no_more_jumps_than_the_limit_says(tails: str) -> None:
    rng = np.random.default_rng(0)
    arms, sessions, limit = 150, 60, 120.0
    values = rng.normal(size=(arms, sessions)) if tails == "normal" else rng.standard_t(5, size=(arms, sessions))
    # Scatter that was thought smaller than it is, and levels that wander.
    values = 1.3 * values + np.cumsum(rng.normal(0.0, 0.1, size=values.shape), axis=1)
    count = sum(len(found.jumps) for found in find_jumps(tracks(values, limit, 0.1)))
    allowed = arms * sessions / limit
    # Far fewer would be a statistic that finds nothing.
    assert 0.05 * allowed < count < allowed + 3.0 * allowed**0.5, count


def test_jumps_are_found_where_they_are_and_single_sessions_are_none() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(6, 80))
    values[0, 50:] += 6.0
    values[1, 20:] -= 6.0
    values[1, 60:] += 9.0
    values[2, 40] += 500.0
    found = find_jumps(tracks(values, 1e5))
    assert [one.jumps for one in found] == [[50], [20, 60], [], [], [], []]
    assert found[0].told[0] <= 52 and found[1].told[0] <= 23


def test_what_is_said_to_be_seen_is_seen_and_little_less_is_not() -> None:
    rng = np.random.default_rng(2)
    values = rng.normal(size=(6, 40))
    shows = np.array([one.shows for one in find_jumps(tracks(values, 1e3))])
    assert (shows > 3.0).all() and (shows < 12.0).all(), shows
    for share, seen in ((1.2, True), (0.5, False)):
        level = values.mean(axis=1, keepdims=True)
        later = np.concatenate([values, np.repeat(level + share * shows[:, None], 2, axis=1)], axis=1)
        found = find_jumps(tracks(later, 1e3))
        assert all((one.jumps == [40]) == seen for one in found), (share, [one.jumps for one in found])


@pytest.mark.parametrize("first", [False, True])
def test_a_log_of_another_robot_is_named_wherever_it_is(
    first: bool, table: Path, robots: dict[str, Any], cluster: Any, tmp_path: Path
) -> None:
    run(table, robots, tmp_path, scheduler=cluster.scheduler_address)
    records = fleet.load_records(tmp_path / "records")
    broken = json.loads(table.with_name("truth.json").read_text())["broken"]
    (path,) = [path for path, what in broken.items() if what.startswith("of another robot")]
    for k, record in enumerate(records):
        if record.labels["path"].endswith(path):
            head, numbers = record.to_parts()
            data = json.loads(head)
            # Among the first sessions, of which the reference is made, or after all others.
            data["labels"].update(session="foreign", start="2020-01-01" if first else "2030-01-01")
            records[k] = sgpr.Record.from_parts(json.dumps(data), numbers)
    histories = changes.histories(records, robots)
    assert [session for history in histories for session in history.foreign] == ["foreign"]
    assert all(np.nanmax(history.error) < 0.5 for history in histories)


@pytest.mark.parametrize("arms", [("baxter", "kuka_lwr")])
def test_real_arms_as_a_fleet(arms: tuple[str, str], tmp_path: Path) -> None:
    """Seven logs each of two arms, and one of the other arm in the folder of the second."""
    folders = [outside(f"real/{arm}") for arm in arms]
    rows = ["path,robot,type,session,start"]
    for arm, folder in zip(arms, folders, strict=True):
        logs = sorted(folder.glob("traj*.csv"))
        rows += [f"{log},{arm},{arm},{log.stem},2026-03-{k + 1:02d}T08:00:00" for k, log in enumerate(logs)]
    stranger = folders[0] / "traj01.csv"
    rows.append(f"{stranger},{arms[1]},{arms[1]},stranger,2026-03-09T08:00:00")
    (tmp_path / "fleet.csv").write_text("\n".join(rows))
    robots = [f"{arm}={next(folder.glob('*.urdf'))}" for arm, folder in zip(arms, folders, strict=True)]
    base = [sys.executable, "-m", "sgpr", "fleet"]
    command = [*base, "run", str(tmp_path / "fleet.csv"), "--robot", *robots, "--out", str(tmp_path / "records")]
    ran = subprocess.run([*command, "--accept", "joints_by_order", "--json"], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout)["made"] == 15 and not json.loads(ran.stdout)["aside"]
    command = [*base, "report", str(tmp_path / "records"), "--robot", *robots, "--out", str(tmp_path / "report")]
    told = subprocess.run([*command, "--json"], capture_output=True, text=True)
    assert told.returncode == 0, told.stderr
    for arm in json.loads(told.stdout)["arms"]:
        assert arm["sessions"] == 7 and not arm["alarms"]
        assert arm["foreign"] == (["stranger"] if arm["robot"] == arms[1] else [])
        # Logs of 20 s know most parameters of these arms too roughly, and the others to a third at best.
        assert 0 < len(arm["watched"]) < len(arm["not_watched"])
        assert all(one["shows"] > 0.1 for one in arm["watched"])


def test_a_load_that_a_real_arm_took_is_told(tmp_path: Path) -> None:
    """A UR10e with 2.805 kg at the flange from its session 19 on, and a Panda to which nothing happened."""
    outside("real/ur10e"), outside("real/panda")
    example = DATA.parent / "examples" / "real_fleet.py"
    ran = subprocess.run([sys.executable, example, "--out", tmp_path], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    panda, ur10e = json.loads((tmp_path / "report" / "alarms.json").read_text())["arms"]
    assert (panda["sessions"], panda["alarms"]) == (8, []) and len(panda["watched"]) > 5
    (alarm,) = ur10e["alarms"]
    assert (alarm["cause"], alarm["session"], alarm["told"]) == ("tool", 19, 20)
    # The body is held but for mass and first moments of the last link; the drive gains are known to a few percent.
    assert alarm["change"] == pytest.approx(2.805, rel=0.2)


def test_the_report_of_the_command(table: Path, tmp_path: Path) -> None:
    base = [sys.executable, "-m", "sgpr", "fleet"]
    robots = ["--robot", "puma560=puma560", "two_link=two_link"]
    ran = subprocess.run(
        [*base, "run", str(table), *robots, "--out", str(tmp_path / "out"), "--workers", "1"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ran.returncode == 0 and "set aside" in ran.stderr, ran.stderr
    told = subprocess.run(
        [*base, "report", str(tmp_path / "out"), *robots, "--out", str(tmp_path / "report"), "--json"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert told.returncode == 0, told.stderr
    data = json.loads(told.stdout)
    assert data == json.loads((tmp_path / "report" / "alarms.json").read_text())
    assert [arm["robot"] for arm in data["arms"]] == ["arm 000", "arm 002", "arm 001"] and len(data["aside"]) == 2
    page = (tmp_path / "report" / "report.html").read_text()
    assert "Fleet of 3 arms" in page and "://" not in re.sub(r"<script>.*?</script>", "", page, flags=re.S)
    shutil.rmtree(tmp_path / "out" / "records" / "arm 000")
    wrong = subprocess.run(
        [*base, "report", str(tmp_path / "out"), "--robot", "two_link", "--out", str(tmp_path / "report")],
        capture_output=True,
        text=True,
    )
    assert wrong.returncode == 1 and "there is no robot for the type" in wrong.stderr


@pytest.mark.parametrize("name", ["puma560", "two_link", "ur5e_like", "panda_like"])
def test_simulated_motions_stay_within_the_limits_of_the_robot_file(name: str) -> None:
    own = {"puma560": sgpr.robots.puma560, "two_link": sgpr.robots.two_link}
    robot = own[name]() if name in own else sgpr.Robot.from_urdf(DATA / f"reference/urdf/{name}.urdf")
    limits = robot.limits
    for k in range(6):
        tool = simulated.Fault("tool", robot.dof - 1, 0, 1.0)
        log = simulated.session_log(simulated.Arm("arm", name, k, (tool,)), robot, k, 1, seconds=10.0)
        speed = np.abs(np.gradient(log["q"], 1.0 / simulated.RATE_HZ, axis=0))
        assert (log["q"] > limits["lower"]).all() and (log["q"] < limits["upper"]).all()
        assert (speed < limits["velocity"]).all() and (np.abs(log["tau"]) < limits["effort"]).all()
        # They still move.
        assert (np.ptp(log["q"], axis=0) > 0.3).all()
