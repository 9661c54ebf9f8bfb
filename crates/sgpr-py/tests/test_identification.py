"""From recordings to a model."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import sgpr
from conftest import DATA


def test_effects_are_listed() -> None:
    effects = {effect["name"]: effect for effect in sgpr.effects()}
    assert {"viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"} <= set(effects)
    assert effects["viscous_friction"]["parameters"] == [("Fv", "N·m·s/rad", "N·s/m")]
    assert all(effect["summary"].endswith(".") for effect in effects.values())
    # What a controller makes of each, and why.
    kinds = {effect["origin"] for effect in effects.values()}
    assert kinds == {"the arm", "the measurement", "a time of the logs"}
    assert all(effect["fed_forward"] == (effect["origin"] == "the arm") for effect in effects.values())
    assert all(len(effect["origin_reason"]) > 10 for effect in effects.values())
    assert effects["torque_delay"]["origin"] == "the measurement" and effects["coulomb_friction"]["fed_forward"]


def test_parameters_that_made_the_log_are_found() -> None:
    """A smooth motion of two links, torque by inverse dynamics and friction: no noise, so the estimate is exact."""
    robot = sgpr.robots.two_link()
    t = np.arange(4000) / 200
    waves = [(0.2, 0.9, 0.1), (0.5, 0.6, 1.3), (0.9, 0.3, 2.2)]
    q, dq, ddq = np.zeros((3, len(t), 2))
    for frequency, amplitude, phase in waves:
        for joint, scale in enumerate((1.0, 1.3)):
            w = 2 * np.pi * frequency * scale
            q[:, joint] += amplitude * np.sin(w * t + phase + joint)
            dq[:, joint] += amplitude * w * np.cos(w * t + phase + joint)
            ddq[:, joint] -= amplitude * w**2 * np.sin(w * t + phase + joint)
    true = robot.with_standard_parameters(1.3 * robot.standard_parameters)
    tau = true.inverse_dynamics(q, dq, ddq) + [0.7, 0.4] * dq
    log = sgpr.Recording(t, q, tau=tau)
    model = sgpr.identify(robot, [log], effects=["viscous_friction"], cutoff_hz=20.0, torque_band="full")
    expected = true.base_parameters().matrix @ true.standard_parameters
    assert np.allclose(model.parameters.values[:6], expected, atol=1e-5)
    assert model.parameters["joint_1.Fv"].value == pytest.approx(0.7, abs=1e-5)
    assert model.parameters["joint_2.Fv"].value == pytest.approx(0.4, abs=1e-5)


def test_what_the_model_says_of_its_identification(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], demo_model: sgpr.Model
) -> None:
    fit, report, processing = demo_model.fit, demo_model.report, demo_model.processing
    assert fit is not None
    assert fit["method"] == "wls"
    assert fit["noise"].shape == fit["rows"].shape == fit["correlation"].shape == (6,)
    assert fit["condition"] > fit["scaled_condition"] > 1
    assert fit["undetermined"] == []
    assert report is not None
    assert report.samples == sum(map(len, demo_logs))
    assert report.singular_values.shape == (len(demo_model.parameters),)
    assert np.all(np.diff(report.singular_values) <= 0)
    assert len(report.cutoff_choices) == 3
    choice = report.cutoff_choices[0]
    assert choice.joint_hz.shape == choice.noise.shape == (6,)
    assert choice.density.shape == (6, len(choice.frequency_hz))
    assert processing is not None
    assert processing.cutoff_hz == processing.torque_cutoff_hz
    assert (processing.order, processing.differentiation) == (4, "central:6")
    assert processing.standstill_speed.shape == (6,)
    assert demo_model.logs == [log.source for log in demo_logs]
    assert "weighted least squares" in demo_model.history[0]
    assert demo_model.library_version == sgpr.__version__
    for text in (report, choice, processing, demo_model, demo_model.parameters):
        assert repr(text)


def test_options_do_what_they_say(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    def identify(**options: object) -> sgpr.Model:
        return sgpr.identify(demo_robot, demo_logs[:1], **options)  # type: ignore[arg-type]

    model = identify(
        effects=["rotor_inertia", "viscous_friction"],
        method="ols",
        cutoff_hz=15.0,
        filter_order=3,
        differentiation="savitzky_golay:11:3",
        torque_band=12.0,
        decimation=4,
        standstill_speed=0.05,
    )
    processing = model.processing
    assert processing is not None
    assert model.fit is not None
    assert model.fit["method"] == "ols"
    assert model.effects == ["viscous_friction", "rotor_inertia"]
    assert (processing.cutoff_hz, processing.torque_cutoff_hz, processing.order) == (15.0, 12.0, 3)
    assert (processing.differentiation, processing.decimation) == ("savitzky_golay:11:3", 4)
    assert np.array_equal(processing.standstill_speed, np.full(6, 0.05))
    full = identify(torque_band="full", differentiation="central:4").processing
    assert full is not None
    assert full.torque_cutoff_hz is None
    assert full.differentiation == "central:4"
    known = identify(noise=np.ones(6)).fit
    assert known is not None
    assert known["method"] == "wls_known_noise"
    assert identify(effects=[]).effects == []
    # What is None is not said.
    assert identify(cutoff_hz=None, noise=None, decimation=None, progress=None).processing is not None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "lasso"}, "method = 'lasso': expected 'ols', 'wls'"),
        ({"method": 3}, "method = 3: expected a word"),
        ({"start": "one"}, "start = 'one': expected 'robot_file' or 'zero'"),
        ({"cutoff_hz": 0.0}, "cutoff_hz = 0: expected a number greater than zero"),
        ({"cutoff_hz": "fast"}, "cutoff_hz = 'fast': expected a number"),
        ({"cutoff_hz": 1e6}, "a cut-off of 1000000 Hz lies outside"),
        ({"filter_order": 11}, "filter_order = 11: expected a whole number, 1 to 10"),
        ({"filter_order": 2.5}, r"filter_order = 2\.5: expected a whole number"),
        ({"decimation": 0}, "decimation = 0: expected a whole number, 1 or more"),
        ({"decimation": -(10**40)}, "expected a whole number, 1 or more"),
        ({"decimation": 10**9}, "rows|usable"),
        ({"standstill_speed": -1.0}, "standstill_speed = -1"),
        ({"standstill_speed": 1e9}, "no joint of the logs is faster than"),
        ({"turn_margin": -1.0}, "turn_margin = -1"),
        ({"torque_band": "narrow"}, "torque_band = 'narrow': expected 'position', 'full' or a cut-off in Hz"),
        ({"torque_band": np.nan}, "torque_band = NaN"),
        ({"noise": np.ones(5)}, r"noise: got \(5,\), expected \(6,\)"),
        ({"noise": -np.ones(6)}, "a standard deviation is positive"),
        ({"noise": np.ones(6), "method": "ols"}, "weights of method 'wls'"),
        (
            {"effects": ["stribeck"]},
            r"effect `stribeck` \(did you mean `stribeck_friction`\?\); `sgpr effects` lists",
        ),
        ({"effects": ["time_base_error"]}, "cannot show `time_base_error`: checks of the log find it"),
        ({"differentiation": "central:3"}, "differentiation = 'central:3': expected 'central', 'central:ACCURACY'"),
        ({"differentiation": "central:"}, "expected 'central'"),
        ({"differentiation": "savitzky_golay"}, "'savitzky_golay:WINDOW:DEGREE'"),
        ({"differentiation": "savitzky_golay:10:3"}, "odd window"),
        ({"differentiation": "savitzky_golay:1:2"}, "less than the window"),
        ({"differentiation": "savitzky_golay:99999999999999999999:3"}, "at most 9999 samples"),
        ({"differentiation": "savitzky_golay:9999:3"}, "too short"),
        ({"differentiation": "spline"}, "expected 'central'"),
    ],
)
def test_options_that_cannot_be(
    options: dict[str, object], message: str, demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]
) -> None:
    with pytest.raises(sgpr.SgprError, match=message):
        sgpr.identify(demo_robot, demo_logs[:1], **options)  # type: ignore[arg-type]


def test_windows_at_their_limits(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    for text in ("savitzky_golay:3:2", "savitzky_golay:11:10", "savitzky_golay:999:10", "central:8"):
        sgpr.identify(demo_robot, demo_logs[:1], differentiation=text)


def test_mechanics_that_scale_with_time_have_the_same_errors(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], demo_test: sgpr.Recording
) -> None:
    errors = []
    for slower in (1.0, 10.0):
        heavier = slower**2
        arm = demo_robot.with_standard_parameters(heavier * demo_robot.standard_parameters)
        arm = arm.with_gravity([0.0, 0.0, -9.81 / heavier])
        train, test = (
            [sgpr.Recording(slower * log.t, log.q, tau=log.tau) for log in logs]
            for logs in (demo_logs[:1], [demo_test])
        )
        # The prior knows of speeds that the arm is made for, which do not scale here.
        model = sgpr.identify(arm, train, cutoff_hz=27.0 / slower, standstill_speed=1e-3 / slower, prior=None)
        errors.append(sgpr.compare(model, test).relative_error_percent)
    np.testing.assert_allclose(errors[1], errors[0], rtol=1e-9)


def test_arguments_of_the_wrong_type(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    with pytest.raises(TypeError, match="recordings: got Recording, expected a list of Recording"):
        sgpr.identify(demo_robot, demo_logs[0])  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="recordings: got ndarray, expected a list of Recording"):
        sgpr.identify(demo_robot, [demo_logs[0].q])  # type: ignore[list-item]
    with pytest.raises(TypeError, match=r"recordings: got PosixPath, .* a LogSet \(`sgpr.read` reads a file\)"):
        sgpr.identify(demo_robot, [Path("log.csv")])  # type: ignore[list-item]
    with pytest.raises(TypeError, match="unexpected keyword argument 'cutof_hz'; options are effects, method"):
        sgpr.identify(demo_robot, demo_logs, cutof_hz=3.0)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="effects: got a str"):
        sgpr.identify(demo_robot, demo_logs, effects="viscous_friction")
    with pytest.raises(TypeError):
        sgpr.identify("robot", demo_logs)  # type: ignore[arg-type]


def test_recordings_that_teach_nothing(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    log = demo_logs[0]
    with pytest.raises(sgpr.IdentificationError, match="no recording was given"):
        sgpr.identify(demo_robot, [])
    with pytest.raises(sgpr.RecordingError, match="there is no joint `joint_6`"):
        sgpr.identify(demo_robot, [log.select(log.joint_names[:5])])
    with pytest.raises(sgpr.RecordingError, match="there is no torque in this log"):
        sgpr.identify(demo_robot, [sgpr.Recording(log.time_ns, log.q)])
    with pytest.raises(sgpr.RecordingError, match="too short"):
        sgpr.identify(demo_robot, [log.slice(0, 20)])
    q = log.q.copy()
    q[100, 3] = np.nan
    with pytest.raises(sgpr.RecordingError, match="`joint_4_position` is missing or not finite in 1 sample"):
        sgpr.identify(demo_robot, [sgpr.Recording(log.time_ns, q, tau=log.tau)])
    for samples in (0, 1, 2, 3):
        with pytest.raises(sgpr.SgprError):
            sgpr.identify(demo_robot, [log.slice(0, samples)])
    with pytest.raises(sgpr.SgprError):
        sgpr.identify(demo_robot, [sgpr.Recording(np.full(500, 7), log.q[:500], tau=log.tau[:500])])


def test_joints_are_found_by_name(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    shuffled = [log.select(log.joint_names[::-1]) for log in demo_logs]
    model = sgpr.identify(demo_robot, demo_logs)
    assert np.array_equal(sgpr.identify(demo_robot, shuffled).all_parameters, model.all_parameters)


def test_error_of_an_internal_model(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], demo_test: sgpr.Recording, demo_model: sgpr.Model
) -> None:
    log = demo_logs[0]
    error = sgpr.identify(demo_robot, [log], start="zero")
    assert "error of an internal model" in error.history[0]
    whole = sgpr.Model.nominal(demo_robot) + error
    assert len(whole.history) == 2


def test_other_cutoffs_change_little(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], demo_model: sgpr.Model
) -> None:
    steps: list[tuple[str, int, int]] = []
    influences = sgpr.cutoff_influence(
        demo_robot, demo_logs, demo_model, progress=lambda *step: steps.append(step), method="wls"
    )
    assert demo_model.processing is not None
    ratios = [influence.cutoff_hz / demo_model.processing.cutoff_hz for influence in influences]
    assert ratios == pytest.approx([0.5, 2**-0.5, 2**0.5, 2.0])
    assert all(0 < influence.typical_change <= influence.largest_change for influence in influences)
    assert influences[0].model.fit is not None
    assert influences[0].model.report is None
    assert steps[0] == ("other cut-offs", 0, 4)
    assert "Hz" in repr(influences[0])
    assert sgpr.cutoff_influence(demo_robot, demo_logs, sgpr.Model.nominal(demo_robot), effects=[]) == []
    with pytest.raises(sgpr.SgprError, match="it has other parameters"):
        sgpr.cutoff_influence(demo_robot, demo_logs, demo_model, effects=[])
    with pytest.raises(TypeError, match="unexpected keyword argument"):
        sgpr.cutoff_influence(demo_robot, demo_logs, demo_model, methods="wls")


def many(logs: list[sgpr.Recording], count: int) -> list[sgpr.Recording]:
    """Each log `count` times with a torque that differs by a millionth, so that none is a copy."""
    changed = [(log, log.tau * (1.0 + 1e-6 * k)) for log in logs for k in range(count)]
    return [sgpr.Recording(log.time_ns, log.q, log.dq, tau, joint_names=log.joint_names) for log, tau in changed]


def test_a_copy_of_a_log_counts_once(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    once = sgpr.identify(demo_robot, demo_logs)
    with pytest.warns(UserWarning, match="is a copy of .* and is left out"):
        twice = sgpr.identify(demo_robot, [*demo_logs, demo_logs[1]])
    assert once.to_bytes() == twice.to_bytes()


def test_progress_is_told_from_start_to_end(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    steps: list[tuple[str, int, int]] = []
    sgpr.identify(demo_robot, many(demo_logs, 20), progress=lambda *step: steps.append(step))
    stages = {stage for stage, _, _ in steps}
    for stage in stages:
        own = [(done, total) for name, done, total in steps if name == stage]
        assert own[0][0] == 0
        assert own[-1][0] == own[-1][1]
        assert [done for done, _ in own] == sorted(done for done, _ in own)


def test_what_the_listener_raises_stops_the_work(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    class Enough(Exception):
        pass

    calls = []

    def listener(stage: str, done: int, total: int) -> None:
        calls.append(done)
        raise Enough(stage)

    with pytest.raises(Enough, match="observe"):
        sgpr.identify(demo_robot, demo_logs, progress=listener)
    assert len(calls) == 1
    with pytest.raises(TypeError):
        sgpr.identify(demo_robot, demo_logs, progress=3)  # type: ignore[arg-type]


@pytest.mark.parametrize("with_listener", [False, True])
def test_an_interrupt_stops_the_work(with_listener: bool) -> None:
    """In a process of its own, with the signal that Ctrl-C sends."""
    code = f"""
        import sgpr
        robot = sgpr.Robot.from_urdf({str(DATA / "demo" / "robot.urdf")!r})
        log = sgpr.read({str(DATA / "demo" / "train_1.csv.gz")!r})
        # Logs that differ: copies count once.
        logs = [
            sgpr.Recording(log.time_ns, log.q, log.dq, log.tau + 1e-6 * k, joint_names=log.joint_names)
            for k in range(400)
        ]
        listener = {"lambda *step: None" if with_listener else "None"}
        print("ready", flush=True)
        try:
            sgpr.identify(robot, logs, progress=listener)
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        else:
            print("finished", flush=True)
    """
    process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(code)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(1.0)
    start = time.perf_counter()
    os.kill(process.pid, signal.SIGINT)
    out, _ = process.communicate(timeout=120)
    assert out == "interrupted\n"
    assert time.perf_counter() - start < 60


def test_python_goes_on_while_a_model_is_identified(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    steps = 0
    stop = threading.Event()

    def count() -> None:
        nonlocal steps
        while not stop.wait(1e-3):
            steps += 1

    thread = threading.Thread(target=count)
    thread.start()
    sgpr.identify(demo_robot, many(demo_logs, 5))
    stop.set()
    thread.join()
    # With the interpreter held this would be two at most.
    assert steps >= 10


def test_slow_pieces_of_a_log_do_not_run_off(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording], demo_test: sgpr.Recording
) -> None:
    # At a sixth of the speed of the other logs the most probable prior is a wide one, and the model lacks effects.
    for start, end in ((8.0, 16.0), (8.5, 15.6), (11.4, 17.5)):
        piece = sgpr.read(demo_logs[2].source, seconds=(start, end))
        effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"]
        model = sgpr.identify(demo_robot, [piece], effects=effects)
        found, file = (
            sgpr.compare(each, [demo_test], processing=model).relative_error_percent
            for each in (model, sgpr.Model.nominal(demo_robot))
        )
        assert found < 0.3 * file, (start, end, found, file)


def test_a_joint_that_only_trembles_is_held() -> None:
    # One joint moves. Dry friction of the other holds it against seven tenths of its gravity, and it trembles.
    robot = sgpr.robots.two_link()
    rng = np.random.default_rng(5)
    t = np.arange(1600) / 200.0
    swing = np.array([0.8, -1.1]) * np.column_stack([np.ones_like(t), np.sin(1.3 * t)])
    speed = np.column_stack([np.zeros_like(t), -1.43 * np.cos(1.3 * t)])
    acceleration = np.column_stack([np.zeros_like(t), 1.859 * np.sin(1.3 * t)])
    tau = robot.inverse_dynamics(swing, speed, acceleration)
    tau[:, 0] *= 0.3
    tau[:, 1] += 0.3 * speed[:, 1] + 0.4 * np.sign(speed[:, 1])
    q = swing + rng.normal(0, 1e-9, swing.shape)
    q[:, 0] += 2e-5 * np.sin(2 * np.pi * 9 * t)
    time_ns = np.round(t * 1e9).astype(np.int64)
    noisy = tau + rng.normal(0, 0.02, tau.shape)
    log = sgpr.Recording(time_ns, q, None, noisy, joint_names=robot.joint_names, source="one joint")

    model = sgpr.identify(robot, [log], effects=["viscous_friction", "coulomb_friction", "torque_offset"])

    held, moved = model.fit["rows"]
    assert held == 0 and moved > 100
    # Where it goes, the file is right.
    there = rng.uniform(-2, 2, (50, 2))
    zero = np.zeros_like(there)
    of_file = robot.inverse_dynamics(there, zero, zero)[:, 0]
    error = model.predict(there, zero, zero)[:, 0] - of_file
    assert np.sqrt(np.mean(error**2)) < 0.1 * np.sqrt(np.mean(of_file**2))


def test_the_prior_can_be_left_out(demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]) -> None:
    # Rich logs outweigh it.
    held, bare = sgpr.identify(demo_robot, demo_logs), sgpr.identify(demo_robot, demo_logs, prior=None)
    moved = np.abs(held.parameters.values - bare.parameters.values) / bare.parameters.standard_deviations
    assert 0.0 < moved.max() < 0.5, moved.max()
    np.testing.assert_allclose(held.parameters.standard_deviations, bare.parameters.standard_deviations, rtol=1e-9)
    assert "held weakly by the robot file" in held.history[0]
    # The first five seconds of one do not: the parameters stay nearer to the file.
    log = demo_logs[0]
    count = int(((log.time_ns - log.time_ns[0]) * 1e-9 <= 5.0).sum())
    short = [sgpr.Recording(log.time_ns[:count], log.q[:count], None, log.tau[:count], joint_names=log.joint_names)]
    held, bare = sgpr.identify(demo_robot, short), sgpr.identify(demo_robot, short, prior=None)
    assert "held by the robot file" in held.history[0] and "held by the robot file" not in bare.history[0]
    errors = [sgpr.compare(model, demo_logs[1:]).relative_error_percent for model in (held, bare)]
    assert errors[0] < errors[1], errors
    with pytest.raises(ValueError, match="prior_deviation"):
        sgpr.identify(demo_robot, demo_logs, prior=None, prior_deviation=1.0)


def test_a_forecast_is_the_scatter_of_what_is_identified() -> None:
    """The same motion with other noise, and four times as long: the torques of the models scatter as was said."""
    robot, rate, noise = sgpr.robots.two_link(), 200.0, 0.2
    waves = np.array([(0.21, 0.5, 0.3), (0.37, 0.4, 1.1), (0.83, 0.2, 2.0)])

    def motion(seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        t = np.arange(0.0, seconds, 1.0 / rate)[:, None, None]
        rates = 2.0 * np.pi * waves[:, 0] * np.array([[1.0], [1.31]])
        angles = rates * t + waves[:, 2]
        sizes = waves[:, 1]
        q, dq, ddq = sizes * np.sin(angles), sizes * rates * np.cos(angles), -sizes * rates**2 * np.sin(angles)
        return q.sum(-1), dq.sum(-1), ddq.sum(-1)

    def models(seconds: float, count: int) -> list[sgpr.Model]:
        q, dq, ddq = motion(seconds)
        exact = robot.inverse_dynamics(q, dq, ddq) + 0.5 * dq
        t = np.arange(len(q)) / rate
        found = []
        for seed in range(count):
            tau = exact + noise * np.random.default_rng(seed).standard_normal(exact.shape)
            log = sgpr.Recording(t, q, tau=tau)
            found.append(sgpr.identify(robot, [log], effects=["viscous_friction"], cutoff_hz=20.0, forecast=True))
        return found

    # States of which each joint is at another time, or on the way back.
    random = np.random.default_rng(7)
    rows = random.integers(0, int(8.0 * rate), (400, 2))
    q, dq, ddq = (np.column_stack([part[rows[:, 0], 0], part[rows[:, 1], 1]]) for part in motion(8.0))
    dq = dq * random.choice([-1.0, 1.0], dq.shape)
    short, long = models(8.0, 40), models(32.0, 40)
    for known, several in ((0, short), (2, long)):
        torques = np.array([model.predict(q, dq, ddq) for model in several])
        scatter = np.sqrt(torques.var(axis=0, ddof=1).mean(axis=0))
        reports = [model.report for model in short]
        said = np.mean(
            [report.forecast["standard_deviation"][known] for report in reports if report and report.forecast], axis=0
        )
        np.testing.assert_allclose(said, scatter, rtol=0.35)
    report = short[0].report
    assert report is not None and report.forecast is not None
    np.testing.assert_allclose(report.forecast["seconds"], 8.0 * np.array([1, 2, 4, 8, 16]), rtol=0.02)


def test_a_slow_log_is_told_in_one_sentence_for_each_joint(
    demo_robot: sgpr.Robot, demo_logs: list[sgpr.Recording]
) -> None:
    effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"]
    log, samples = demo_logs[0], np.arange(600)
    path = np.column_stack([np.interp(samples / 4, np.arange(len(log)), q) for q in log.q.T])
    slow = sgpr.Recording(log.time_ns[:600], path, joint_names=log.joint_names)
    torque = np.asarray(sgpr.identify(demo_robot, [log], effects=effects).predict(slow))
    noise = np.random.default_rng(1)
    slow = sgpr.Recording(
        slow.time_ns,
        path + 1e-6 * noise.standard_normal(path.shape),
        tau=torque + 0.3 * noise.standard_normal(torque.shape),
        joint_names=log.joint_names,
    )
    told = sgpr.identify(demo_robot, [slow], effects=effects).report.warnings
    wishes = next(warning.split("To free them: ")[1].split("; ") for warning in told if "To free them" in warning)
    assert len(wishes) == demo_robot.dof
    assert all(wish.count(" must ") == 1 and "and and" not in wish for wish in wishes)
    assert any("and the joints before it must" in wish and "` itself move slowly and fast" in wish for wish in wishes)


def test_speed_limits_that_stand_for_none_say_nothing() -> None:
    """A second of a log is held by the robot file, by how fast the arm may move; no arm turns at 100 rad/s."""
    log = sgpr.read(DATA / "hidden" / "train_1.csv.gz")
    second = np.asarray(log.time_ns) < log.time_ns[0] + 10**9
    log = sgpr.Recording(
        log.time_ns[second], log.q[second], log.dq[second], log.tau[second], joint_names=log.joint_names
    )
    text = (DATA / "hidden" / "robot.urdf").read_text()
    robots = [sgpr.Robot.from_urdf_text(text.replace('velocity="10"', f'velocity="{v}"')) for v in (20, 100, 1000, 4)]
    effects = ["viscous_friction", "coulomb_friction"]
    models = [sgpr.identify(robot, [log], effects=effects) for robot in robots]
    values = [model.parameters.values for model in models]
    assert models[0].fit["prior_standard_deviation"] is not None
    np.testing.assert_array_equal(values[1], values[0])
    np.testing.assert_array_equal(values[2], values[0])
    assert not np.array_equal(values[3], values[0])
