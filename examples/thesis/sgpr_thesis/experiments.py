"""The experiments: excitation, case 1, the excitation study, case 2. Section numbers are those of the thesis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sgpr import (
    Drive,
    Excitation,
    Model,
    Recording,
    Robot,
    SemiParametricModel,
    Simulation,
    Trajectory,
    excite,
    identify,
    simulate,
)
from sgpr import robots as ready_made

from . import published
from .models import ALL_EFFECTS, FRICTION, Process, mean_period, parametric, semi_parametric

CRITERIA = ("condition", "frobenius_condition", "sum_of_conditions", "d_optimality")

# Held with 10 N·m/rad, joint 2 of the PUMA 560 (gravity 37 N·m) falls over wherever the arm points up, whatever the
# model: a perfect one leaves errors of radians. Test motions keep it hanging.
HANGING = {1: (-2.6, -0.5)}

# Section 5-1-1 has stiction and the Stribeck effect without numbers. More stiction, and joint 1 of the PUMA 560 sticks
# wherever feed-forward and 10 N·m/rad together stay below it: an event that says little of a model.
STICTION, STRIBECK_VELOCITY = 1.05, 0.05

# Position is read by encoders and differentiated numerically, rad.
RESOLUTION = 1e-5

# "A high acceleration Fourier wave" (section 5-3-3), without a number, rad/s². Under the 6 rad/s² of the other motions
# a series up to 5 Hz leaves joints 1 to 3 sticking all the time.
HFS_ACCELERATION = 30.0

# At the 20 Hz of the thesis, dry friction that turns within a sample leaves errors of a few percent.
CASE_2_HZ = 100.0

# The rotors that the parameters of the thesis lack speak through a joint's own acceleration. A process that sees all 18
# inputs explains the training motion by other joints, too, and is wrong on any other motion.
GP_ON_FRICTION: dict[str, Any] = {"inputs": "own_motion", "mean": "joint"}

GRAVITY_ALONG_AXES = (0.0, 0.0, -9.81)

# Names of the models in tables and figures. The first three are those of the thesis.
INTERNAL = "internal"
IDENTIFIED = "identified"
SEMI_PARAMETRIC = "semi-parametric"
NON_PARAMETRIC = "non-parametric"
IDENTIFIED_ALL = "identified, all effects"
SEMI_PARAMETRIC_ALL = "semi-parametric, all effects"

Array = NDArray[np.float64]
Tell = Callable[[str], object]
Known = Model | Robot | SemiParametricModel


@dataclass(frozen=True)
class Settings:
    """How much is done: the whole, or a short version of a minute."""

    starts: int = 4
    evaluations: int = 1000
    record_seconds: float = 100.0
    test_seconds: float = 10.0
    tests: int = 3
    points: int = 300
    process_evaluations: int = 40
    # High-frequency series beside the first, by their seeds: what of its influence is chance.
    other_series: tuple[int, ...] = (2, 3)
    n_jobs: int | None = None

    @classmethod
    def short(cls) -> "Settings":
        """One search, two periods, small processes."""
        return cls(starts=1, evaluations=400, record_seconds=20.0, points=120, process_evaluations=15, other_series=())

    @property
    def process(self) -> Process:
        """Size of the processes."""
        return Process(self.points, self.process_evaluations, self.n_jobs or 2)


@dataclass(frozen=True)
class Arm:
    """A robot of the thesis as a simulated machine."""

    name: str
    robot: Robot
    drives: list[Drive]
    terms: int
    record_hz: float
    published: Trajectory
    # Ranges of single joints in test motions, rad.
    test_range: dict[int, tuple[float, float]] = field(default_factory=dict)

    @property
    def max_acceleration(self) -> list[float]:
        """rad/s²."""
        return [published.MAX_ACCELERATION[self.name]] * self.robot.dof

    @property
    def control_period(self) -> float:
        """s."""
        return 1.0 / (20.0 * self.record_hz) if self.record_hz > 30.0 else 1.0 / (50.0 * self.record_hz)

    def log(self, run: Simulation, name: str) -> Recording:
        """One period of an experiment, the mean of all after the first."""
        return mean_period(run, 1.0 / published.FUNDAMENTAL_HZ, name)

    def follow(
        self,
        motion: Trajectory,
        gains: tuple[float, float],
        models: Sequence[Known],
        seconds: float,
        controller: Any = "feed_forward",
        feed_forward: Array | None = None,
    ) -> Simulation:
        """The arm under feed-forward of the sum of the models and feedback at the joints (eq. 5-1).

        Control at 20 (or 50) times the recording rate, four steps of the simulation per call.
        """
        period = self.control_period
        return simulate(
            self.robot,
            motion,
            duration=seconds,
            controller=controller,
            model=list(models),
            feed_forward=feed_forward,
            kp=gains[0],
            kd=gains[1],
            drives=self.drives,
            control_period=period,
            step=0.25 * period,
            record_period=1.0 / self.record_hz,
            position_resolution=[RESOLUTION] * self.robot.dof,
        )

    def wanted(self, motion: Trajectory, seconds: float) -> tuple[Array, Array, Array]:
        """What the motion asks for at each call of the controller: q, dq, ddq, `[calls, n]`."""
        calls = round(seconds / self.control_period)
        return motion.at(np.arange(calls) * self.control_period)

    def needed_torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torque of the drives that a motion needs: rigid body, rotors and friction, N·m, `[N, n]`."""
        tau = self.robot.inverse_dynamics(q, dq, ddq)
        for joint, drive in enumerate(self.drives):
            speed = dq[:, joint]
            coulomb, static = (
                np.where(speed > 0.0, *sizes) for sizes in (drive.coulomb_friction, drive.static_friction)
            )
            extra = (static - coulomb) * np.exp(-((speed / drive.stribeck_velocity) ** 2))
            tau[:, joint] += drive.rotor_inertia * ddq[:, joint] + drive.viscous_friction * speed
            tau[:, joint] += np.sign(speed) * (coulomb + extra)
        return tau

    def torque_error(self, motion: Trajectory, known: Model | SemiParametricModel, seconds: float) -> Array:
        """Root mean square error of a model's feed-forward along a motion, nothing followed, N·m, `[n]`."""
        wanted = self.wanted(motion, seconds)
        error: Array = np.sqrt(np.mean((known.predict(*wanted) - self.needed_torque(*wanted)) ** 2, axis=0))
        return error

    def test_motions(self, settings: Settings) -> list[Trajectory]:
        """Motions that no model was fitted to, within `test_range`."""
        limits = self.robot.limits
        wide = np.column_stack([limits["lower"], limits["upper"]])
        ranges = np.array([self.test_range.get(k, tuple(own)) for k, own in enumerate(wide)])
        start = np.where(ranges[:, 0] * ranges[:, 1] < 0.0, 0.0, ranges.mean(axis=1))
        options: dict[str, Any] = {
            "terms": self.terms,
            "max_acceleration": self.max_acceleration,
            "position_range": ranges,
            "start": start,
        }
        return [Trajectory.random(self.robot, random_state=100 + k, **options) for k in range(settings.tests)]


def puma560() -> Arm:
    """PUMA 560; 6000 samples in 100 s."""
    robot = ready_made.puma560()
    motion = Trajectory.fourier(robot, published.FUNDAMENTAL_HZ, published.PUMA_A, published.PUMA_B)
    return Arm("puma560", robot, _with_stiction(ready_made.puma560_drives()), 4, 60.0, motion, HANGING)


def two_link() -> Arm:
    """Two-link arm; four base parameters mean that gravity does no work. 2000 samples in 100 s."""
    robot = ready_made.two_link().with_gravity(GRAVITY_ALONG_AXES)
    motion = Trajectory.fourier(robot, published.FUNDAMENTAL_HZ, published.TWO_LINK_A, published.TWO_LINK_B)
    return Arm("two_link", robot, _with_stiction(ready_made.two_link_drives()), 3, 20.0, motion)


def _with_stiction(drives: Sequence[Drive]) -> list[Drive]:
    return [
        Drive(
            rotor_inertia=drive.rotor_inertia,
            viscous_friction=drive.viscous_friction,
            coulomb_friction=drive.coulomb_friction,
            static_friction=(STICTION * drive.coulomb_friction[0], STICTION * drive.coulomb_friction[1]),
            stribeck_velocity=STRIBECK_VELOCITY,
        )
        for drive in drives
    ]


@dataclass
class Thesis:
    """What came out; plain numbers in `data`, runs for the figures in `runs`."""

    settings: Settings
    arms: dict[str, Arm] = field(default_factory=dict)
    motions: dict[str, Excitation] = field(default_factory=dict)
    high_frequency: Trajectory | None = None
    runs: dict[str, Simulation] = field(default_factory=dict)
    data: dict[str, Any] = field(default_factory=dict)
    models: dict[str, dict[str, Known]] = field(default_factory=dict)
    # Time, s, and values.
    curves: dict[str, tuple[Array, Array]] = field(default_factory=dict)


def excitation(thesis: Thesis, arm: Arm, tell: Tell) -> None:
    """Chapter 3 and section 5-2: the published amplitudes, and motions found under the same limits and terms."""
    settings = thesis.settings
    rows: list[dict[str, Any]] = []
    for effects, friction in ((FRICTION, "fe"), ((), "nfe")):
        printed = arm.published.excitation(effects)
        for criterion in CRITERIA:
            tell(f"{arm.name}: {criterion} {'with' if effects else 'without'} friction columns")
            start = perf_counter()
            found = excite(
                arm.robot,
                effects,
                criterion=criterion,
                fundamental_hz=published.FUNDAMENTAL_HZ,
                terms=arm.terms,
                max_acceleration=arm.max_acceleration,
                starts=settings.starts,
                max_evaluations=settings.evaluations,
                n_jobs=settings.n_jobs,
            )
            thesis.motions[f"{arm.name} {criterion} {friction}"] = found
            rows.append(
                {
                    "criterion": criterion,
                    "friction_columns": bool(effects),
                    "published": value_of(criterion, printed),
                    "found": value_of(criterion, found.report),
                    "utilisation": found.utilisation,
                    "seconds": perf_counter() - start,
                }
            )
    thesis.data.setdefault("excitation", {})[arm.name] = {
        "rows": rows,
        "published_peaks": arm.published.peaks(),
        "published_at_rest": [float(np.abs(values).max()) for values in arm.published.at([0.0])],
    }


def value_of(criterion: str, report: dict[str, Any]) -> float:
    """The criterion in a report; smaller is better."""
    return float(-report["log_determinant"] if criterion == "d_optimality" else report[criterion])


def all_models(arm: Arm, logs: Sequence[Recording], settings: Settings) -> dict[str, Known]:
    """The models of case 1: the internal one, those of the thesis, and those with rotors and offsets."""
    robot, process = arm.robot, settings.process
    return {
        INTERNAL: robot,
        IDENTIFIED: parametric(robot, logs, FRICTION),
        SEMI_PARAMETRIC: semi_parametric(robot, logs, FRICTION, process, **GP_ON_FRICTION),
        NON_PARAMETRIC: semi_parametric(robot, logs, FRICTION, process, mean="zero", inputs="all", ard=True),
        IDENTIFIED_ALL: parametric(robot, logs, ALL_EFFECTS),
        SEMI_PARAMETRIC_ALL: semi_parametric(robot, logs, ALL_EFFECTS, process, **GP_ON_FRICTION),
    }


def case_1(thesis: Thesis, arm: Arm, tell: Tell) -> None:
    """Section 5-3-1: the internal model replaced by the identified one, both at test gains."""
    tell(f"{arm.name}: case 1")
    settings = thesis.settings
    motion = thesis.motions[f"{arm.name} condition fe"].trajectory
    experiment = arm.follow(motion, published.IDENTIFICATION_GAINS, [arm.robot], settings.record_seconds)
    models = all_models(arm, [arm.log(experiment, "experiment")], settings)
    model, rest = models[IDENTIFIED], models[SEMI_PARAMETRIC]
    assert isinstance(model, Model) and isinstance(rest, SemiParametricModel), "as made"
    thesis.models[arm.name] = models
    motions = {"train": motion, **{f"test {k + 1}": m for k, m in enumerate(arm.test_motions(settings))}}
    tracking = []
    for motion_name, each in motions.items():
        for model_name, known in models.items():
            run = arm.follow(each, published.TEST_GAINS, [known], settings.test_seconds)
            thesis.runs[f"{arm.name} case 1 {motion_name} {model_name}"] = run
            tracking.append({"motion": motion_name, "model": model_name, "rmse": run.tracking_rmse})
    thesis.runs[f"{arm.name} experiment"] = experiment
    free = arm.follow(motion, (0.0, 0.0), [model], settings.test_seconds)
    thesis.runs[f"{arm.name} no feedback"] = free
    fit = model.fit
    assert fit is not None, "just identified"
    thesis.data.setdefault("case_1", {})[arm.name] = {
        "samples": len(experiment),
        "condition": fit["condition"],
        "published_condition": published.MEASURED_CONDITION[arm.name],
        "base_parameters": len(model.parameters),
        "processes": [report["inputs"] for report in rest.reports_],
        "tracking": tracking,
        "tracking_without_feedback": free.tracking_rmse,
        "tracking_at_identification_gains": experiment.tracking_rmse,
        "gain_sides": _gain_sides(arm, motion, settings),
    }


def _gain_sides(arm: Arm, motion: Trajectory, settings: Settings) -> dict[str, Array]:
    """Tracking error under the internal model at test gains, gains taken as at the joint and as at the motor."""
    ratios = GEAR_RATIOS[arm.name]
    joint = arm.follow(motion, published.TEST_GAINS, [arm.robot], settings.test_seconds)
    period = 1.0 / 4000.0
    motor = simulate(
        arm.robot,
        motion,
        duration=settings.test_seconds,
        kp=published.TEST_GAINS[0] * ratios**2,
        kd=published.TEST_GAINS[1] * ratios**2,
        drives=arm.drives,
        control_period=period,
        step=0.5 * period,
    )
    return {"joint": joint.tracking_rmse, "motor": motor.tracking_rmse}


# Tables 5-1 and 5-2.
GEAR_RATIOS = {
    "puma560": np.array([62.61, 107.8, 53.79, 76.04, 71.92, 76.69]),
    "two_link": np.array([20.61, 20.82]),
}


def kernel_study(thesis: Thesis, tell: Tell) -> None:
    """Section 5-3-1, figures 5-10 and 5-11: one length scale or one per input, on the two-link arm."""
    tell("two_link: one length scale or one per input")
    arm, settings = thesis.arms["two_link"], thesis.settings
    # "Trained with the excitation trajectory different from figure 5-5".
    motion = thesis.motions["two_link d_optimality fe"].trajectory
    experiment = arm.follow(motion, published.IDENTIFICATION_GAINS, [arm.robot], settings.record_seconds)
    logs = [arm.log(experiment, "experiment")]
    models: dict[str, Known] = {IDENTIFIED: parametric(arm.robot, logs, FRICTION)}
    for label, choices in KERNELS.items():
        models[label] = semi_parametric(arm.robot, logs, FRICTION, settings.process, **choices)
    rows = []
    for motion_name, each in {"train": motion, "test": arm.test_motions(settings)[0]}.items():
        for label, known in models.items():
            run = arm.follow(each, published.TEST_GAINS, [known], settings.test_seconds)
            rows.append({"motion": motion_name, "model": label, "rmse": run.tracking_rmse})
    thesis.data["kernels"] = rows


KERNELS: dict[str, dict[str, Any]] = {
    "SE, all inputs": {"inputs": "all", "ard": False},
    "ARD-SE, all inputs": {"inputs": "all", "ard": True},
    "SE, own motion": {**GP_ON_FRICTION, "ard": False},
    "ARD-SE, own motion": {**GP_ON_FRICTION, "ard": True},
}


def excitation_study(thesis: Thesis, tell: Tell) -> None:
    """Sections 5-3-2 and 5-3-3: eight sets of training motions, three test motions, PUMA 560 (table 5-8)."""
    arm, settings = thesis.arms["puma560"], thesis.settings
    series = high_frequency(arm, 1)
    thesis.high_frequency = series
    experiments: dict[str, Simulation] = {}
    for name, motion in {
        "HFS": series,
        **{
            f"{label}(W_{friction})": thesis.motions[f"puma560 {criterion} {friction}"].trajectory
            for label, criterion in (("cond", "condition"), ("sum cond", "sum_of_conditions"))
            for friction in ("fe", "nfe")
        },
    }.items():
        tell(f"excitation study: {name}")
        experiments[name] = arm.follow(motion, published.IDENTIFICATION_GAINS, [arm.robot], settings.record_seconds)
    tests = arm.test_motions(settings)
    logs = {name: arm.log(run, name) for name, run in experiments.items()}
    rows = []
    for name, printed in published.TABLE_5_8.items():
        tell(f"table 5-8: {name}")
        training = [logs[part] for part in name.split(" + ")]
        model = parametric(arm.robot, training, FRICTION)
        known: dict[str, Model | SemiParametricModel] = {
            IDENTIFIED: model,
            SEMI_PARAMETRIC: semi_parametric(arm.robot, training, FRICTION, settings.process, **GP_ON_FRICTION),
            IDENTIFIED_ALL: parametric(arm.robot, training, ALL_EFFECTS),
            SEMI_PARAMETRIC_ALL: semi_parametric(arm.robot, training, ALL_EFFECTS, settings.process, **GP_ON_FRICTION),
        }
        errors: dict[str, list[Array]] = {}
        torque_errors: dict[str, list[Array]] = {}
        with_term: dict[str, float] = {}
        for effect in ALL_EFFECTS[len(FRICTION) :]:
            one_more = parametric(arm.robot, training, (*FRICTION, effect))
            with_term[effect] = sum_of_errors(arm, one_more, tests, settings)
        for label, each in known.items():
            for k, motion in enumerate(tests):
                run = arm.follow(motion, published.TEST_GAINS, [each], settings.test_seconds)
                thesis.runs[f"table 5-8 {name} {label} test {k + 1}"] = run
                errors.setdefault(label, []).append(run.tracking_rmse)
                torque_errors.setdefault(label, []).append(arm.torque_error(motion, each, settings.test_seconds))
        fit = model.fit
        assert fit is not None, "just identified"
        rows.append(
            {
                "motion": name,
                "published": printed,
                "condition": fit["condition"],
                "errors": {label: np.mean(each, axis=0) for label, each in errors.items()},
                "errors_of_tests": errors,
                "torque_errors_of_tests": torque_errors,
                "friction": friction_error(arm, model),
                "with_term": with_term,
            }
        )
    thesis.data["table_5_8"] = rows
    other_series(thesis, logs, tests, tell)


def sum_of_errors(arm: Arm, known: Known, tests: Sequence[Trajectory], settings: Settings) -> float:
    """Sum over joints of the position error at test gains, the mean of all tests, rad."""
    runs = [arm.follow(motion, published.TEST_GAINS, [known], settings.test_seconds) for motion in tests]
    return float(np.mean([run.tracking_rmse for run in runs], axis=0).sum())


def high_frequency(arm: Arm, seed: int) -> Trajectory:
    """A series from the harmonics above the other motions' to the closed-loop bandwidth."""
    return Trajectory.random(
        arm.robot,
        fundamental_hz=published.FUNDAMENTAL_HZ,
        harmonics=(arm.terms, round(published.BANDWIDTH_HZ / published.FUNDAMENTAL_HZ)),
        max_acceleration=[HFS_ACCELERATION] * arm.robot.dof,
        random_state=seed,
    )


def other_series(thesis: Thesis, logs: dict[str, Recording], tests: Sequence[Trajectory], tell: Tell) -> None:
    """The rows of table 5-8 with a high-frequency series, with other series of the same kind: sums of errors."""
    arm, settings = thesis.arms["puma560"], thesis.settings
    rows = []
    for seed in settings.other_series:
        tell(f"table 5-8: another high-frequency series ({seed})")
        run = arm.follow(
            high_frequency(arm, seed), published.IDENTIFICATION_GAINS, [arm.robot], settings.record_seconds
        )
        series = arm.log(run, "HFS")
        for name in published.TABLE_5_8:
            if not name.startswith("HFS"):
                continue
            training = [series, *(logs[part] for part in name.split(" + ")[1:])]
            known: dict[str, Known] = {
                IDENTIFIED: parametric(arm.robot, training, FRICTION),
                SEMI_PARAMETRIC: semi_parametric(arm.robot, training, FRICTION, settings.process, **GP_ON_FRICTION),
                IDENTIFIED_ALL: parametric(arm.robot, training, ALL_EFFECTS),
            }
            sums = {label: sum_of_errors(arm, each, tests, settings) for label, each in known.items()}
            rows.append({"motion": name, "seed": seed, "sums": sums})
    thesis.data["other_series"] = rows


def friction_error(arm: Arm, model: Model) -> float:
    """Largest relative error of the Coulomb friction, the mean of both directions taken as true."""
    values = dict(zip(model.all_parameter_names, model.all_parameters, strict=True))
    true = [0.5 * sum(drive.coulomb_friction) for drive in arm.drives]
    found = [values[f"{name}.Fc"] for name in arm.robot.joint_names]
    return float(np.max(np.abs(np.array(found) / np.array(true) - 1.0)))


def case_2(thesis: Thesis, tell: Tell) -> None:
    """Section 5-4: an internal model that is wrong and stays; what it lacks is identified and fed forward."""
    tell("two_link: case 2")
    arm, settings = thesis.arms["two_link"], thesis.settings
    robot = arm.robot
    base = robot.base_parameters([])
    error = published.WRONG_BASE - published.TRUE_BASE
    parameters = robot.standard_parameters.copy()
    # The parameters that stand for the combinations are wrong by the error of the thesis.
    for name, amount in zip(base.names, error, strict=True):
        parameters[robot.standard_parameter_names.index(name)] += amount
    internal = robot.with_standard_parameters(parameters)
    motion = thesis.motions["two_link condition fe"].trajectory
    thesis.runs["case 2 no feedback"] = arm.follow(motion, (0.0, 0.0), [internal], settings.test_seconds)
    recovered: dict[str, Array] = {}
    for rate_hz in (arm.record_hz, CASE_2_HZ):
        run = replace(arm, record_hz=rate_hz).follow(
            motion, published.IDENTIFICATION_GAINS, [internal], settings.record_seconds
        )
        whole = identify(robot, [run.recording("case 2")], effects=list(ALL_EFFECTS))
        recovered[f"measured motion, log at {rate_hz:g} Hz"] = base_error(robot, parameters, whole, arm)
        if rate_hz == arm.record_hz:
            recovered["wanted motion and feedback torque, as eq. 4-20"] = _from_feedback_torque(robot, run)
    thesis.runs["case 2 experiment"] = run
    best = recovered[f"measured motion, log at {CASE_2_HZ:g} Hz"]
    # Table of the thesis: viscous and Coulomb friction; the rest is for the process.
    logs = [replace(arm, record_hz=CASE_2_HZ).log(run, "case 2")]
    tracking = _compensated(thesis, arm, internal, logs, "case 2")
    thesis.data["case_2"] = {
        "base_parameters": base.expressions,
        "true_error": error,
        "recovered_errors": recovered,
        "largest_deviation": float(np.abs(best - error).max()),
        "tracking": tracking,
    }


def _compensated(
    thesis: Thesis, arm: Arm, internal: Robot, logs: Sequence[Recording], label: str
) -> list[dict[str, Any]]:
    """Tracking with the wrong internal model alone, and with what it lacks as feed-forward (eq. 4-21)."""
    settings = thesis.settings
    models: dict[str, Known | None] = {
        INTERNAL: None,
        IDENTIFIED: parametric(arm.robot, logs, FRICTION),
        SEMI_PARAMETRIC: semi_parametric(arm.robot, logs, FRICTION, settings.process, **GP_ON_FRICTION),
        IDENTIFIED_ALL: parametric(arm.robot, logs, ALL_EFFECTS),
        SEMI_PARAMETRIC_ALL: semi_parametric(arm.robot, logs, ALL_EFFECTS, settings.process, **GP_ON_FRICTION),
    }
    tracking = []
    motion = thesis.motions[f"{arm.name} condition fe"].trajectory
    for motion_name, each in {"train": motion, "test": arm.test_motions(settings)[0]}.items():
        wanted = arm.wanted(each, settings.test_seconds)
        for model_name, known in models.items():
            lacking = None
            if known is not None:
                assert not isinstance(known, Robot), "identified"
                lacking = known.predict(*wanted) - internal.inverse_dynamics(*wanted)
            run = arm.follow(each, published.TEST_GAINS, [internal], settings.test_seconds, feed_forward=lacking)
            thesis.runs[f"{label} {motion_name} {model_name}"] = run
            tracking.append({"motion": motion_name, "model": model_name, "rmse": run.tracking_rmse})
    return tracking


def case_2_puma(thesis: Thesis, tell: Tell) -> None:
    """Section 5-4 for the PUMA 560, which the thesis leaves out: every link by a quarter too heavy."""
    tell("puma560: case 2")
    arm, settings = thesis.arms["puma560"], thesis.settings
    robot = arm.robot
    parameters = PUMA_ERROR * robot.standard_parameters
    internal = robot.with_standard_parameters(parameters)
    motion = thesis.motions["puma560 condition fe"].trajectory
    run = arm.follow(motion, published.IDENTIFICATION_GAINS, [internal], settings.record_seconds)
    logs = [arm.log(run, "case 2")]
    whole = parametric(robot, logs, ALL_EFFECTS)
    found = base_error(robot, parameters, whole, arm)
    true = robot.base_parameters([]).matrix @ ((PUMA_ERROR - 1.0) * robot.standard_parameters)
    thesis.data["case_2_puma"] = {
        "factor": PUMA_ERROR,
        "true_error": true,
        "recovered_error": found,
        "deviation": float(np.linalg.norm(found - true) / np.linalg.norm(true)),
        "tracking": _compensated(thesis, arm, internal, logs, "puma case 2"),
    }


# An internal model like the one of the thesis, wrong by as much as the arm weighs, would hit the joint limits.
PUMA_ERROR = 1.25


def _from_feedback_torque(robot: Robot, run: Simulation) -> Array:
    """Error of the internal model from the feedback torque along the wanted motion (eq. 4-20), rotors included."""
    proportional, derivative = published.IDENTIFICATION_GAINS
    feedback = proportional * (run.q_wanted - run.q_measured) + derivative * (run.dq_wanted - run.dq_measured)
    time = np.round(1e9 * run.t).astype(np.int64)
    log = Recording(time, run.q_wanted, run.dq_wanted, feedback, joint_names=robot.joint_names, source="feedback")
    model = identify(robot, [log], effects=list(FRICTION), start="zero")
    base = robot.base_parameters(list(FRICTION))
    lacking = base.matrix @ model.all_parameters
    return np.array([-lacking[base.names.index(name)] for name in robot.base_parameters([]).names])


def base_error(robot: Robot, internal: Array, model: Model, arm: Arm) -> Array:
    """Error of the internal model in the base parameters of the rigid body, the rotors' share taken off.

    The rotor of joint 1 turns with link 1, so that motion reveals only the sum of both; its size stands on the motor's
    data sheet (table 5-2).
    """
    rotors = {f"{name}.Ia": drive.rotor_inertia for name, drive in zip(robot.joint_names, arm.drives, strict=True)}
    base = robot.base_parameters(list(model.effects))
    known = np.zeros(len(model.all_parameters))
    known[: len(internal)] = internal
    for index, name in enumerate(model.all_parameter_names):
        known[index] = rotors.get(name, known[index])
    error = base.matrix @ (known - model.all_parameters)
    names = robot.base_parameters([]).names
    return np.array([error[base.names.index(name)] for name in names])
