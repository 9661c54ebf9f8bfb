"""Where the thesis stops (section 6-2): other control structures, and a payload picked up during the motion."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sgpr import Model, OnlineModel, Robot, Simulation, Trajectory, simulate

from . import published
from .experiments import IDENTIFIED, IDENTIFIED_ALL, INTERNAL, SEMI_PARAMETRIC, Arm, Known, Tell, Thesis
from .models import ALL_EFFECTS, parametric

Array = NDArray[np.float64]

# Computed torque: 1/s² and 1/s, every joint a critically damped oscillator of 10 rad/s. Impedance: the test gains.
LAWS: dict[str, tuple[str, tuple[float, float]]] = {
    "computed torque": ("computed_torque", (100.0, 20.0)),
    "joint impedance": ("impedance", published.TEST_GAINS),
}

# What the parameters of the thesis say of the links, and nothing of friction.
LINKS_ALONE = "identified, links alone"

# Of a motion, to see the inertia at.
POSITIONS = 50

PICK_UP_SECONDS = 4.0
PAYLOAD_SECONDS = 10.0
CONTROL_PERIOD = 1e-3
# N·m/rad and N·m·s/rad: the stiffness of the identification, and one that a controller at 1 kHz would have.
PAYLOAD_CUTOFF_HZ = 20.0
PAYLOAD_GAINS = {"soft": (75.0, 5.0), "stiff": (300.0, 30.0)}
# An error of twice what it was before at most is none that the payload leaves.
RECOVERED = 2.0

# 2 kg, 0.15 m in front of the wrist: m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz in the frame of link 6.
HELD = np.array([2.0, 0.04, -0.06, 0.30, 0.06, 0.001, 0.055, -0.006, 0.009, 0.012])


def control_laws(thesis: Thesis, tell: Tell) -> None:
    """The models of case 1 in laws that ask them at the measured state."""
    settings = thesis.settings
    rows, inertias = [], []
    for arm in thesis.arms.values():
        tell(f"{arm.name}: computed torque and joint impedance")
        motion = arm.test_motions(settings)[0]
        models = {
            model: thesis.models[arm.name][model] for model in (INTERNAL, IDENTIFIED, SEMI_PARAMETRIC, IDENTIFIED_ALL)
        }
        models[LINKS_ALONE] = links_of(arm, models[IDENTIFIED])
        for label, (controller, gains) in LAWS.items():
            for model, known in models.items():
                run = arm.follow(motion, gains, [known], settings.test_seconds, controller)
                rows.append({"robot": arm.name, "law": label, "model": model, "rmse": run.tracking_rmse})
        shares = {model: inertia(known, motion) / true_inertia(arm, motion) for model, known in models.items()}
        inertias += [{"robot": arm.name, "model": model, "share": share} for model, share in shares.items()]
    thesis.data["control_laws"] = rows
    thesis.data["inertias"] = inertias


def inertia(known: Known, motion: Trajectory) -> Array:
    """Torque of each joint per acceleration of that joint alone, the mean along a motion, kg·m²."""
    q, _, _ = motion.at(np.linspace(0.0, motion.duration, POSITIONS))
    dof, still = q.shape[1], np.zeros_like(q)

    def torque(acceleration: Array) -> Array:
        of = known.inverse_dynamics if isinstance(known, Robot) else known.predict
        values: Array = of(q, still, acceleration)
        return values

    at_rest = torque(still)
    units = [np.tile(unit, (len(q), 1)) for unit in np.eye(dof)]
    return np.array([(torque(unit) - at_rest)[:, joint].mean() for joint, unit in enumerate(units)])


def true_inertia(arm: Arm, motion: Trajectory) -> Array:
    """The same of the machine: links and rotors."""
    return np.asarray(inertia(arm.robot, motion) + np.array([drive.rotor_inertia for drive in arm.drives]))


def links_of(arm: Arm, model: Known) -> Robot:
    """The robot with the identified parameters of its links."""
    assert isinstance(model, Model), "identified"
    parameters = np.asarray(model.all_parameters)[: len(arm.robot.standard_parameters)]
    return arm.robot.with_standard_parameters(parameters)


@dataclass
class Adaptive:
    """Feed-forward of a model that learns while it runs, as a user would write it."""

    model: OnlineModel
    gains: tuple[float, float]
    torque: Array | None = None

    def __post_init__(self) -> None:
        """No estimate yet."""
        self.estimates: list[tuple[float, float]] = []

    def __call__(self, t: float, q: Array, dq: Array, wanted: Array, d_wanted: Array, dd_wanted: Array) -> ArrayLike:
        """Learns from the torque of the period before, then commands the next."""
        if self.torque is not None:
            self.model.update(q, self.torque)
        held = self.model.payload
        if held is not None:
            self.estimates.append((t, float(held[0])))
        kp, kd = self.gains
        self.torque = self.model.torque(wanted, d_wanted, dd_wanted) + kp * (wanted - q) + kd * (d_wanted - dq)
        return self.torque


def payload(thesis: Thesis, tell: Tell) -> None:
    """A payload picked up: without adaptation, with a payload tracked, with a process, with both."""
    tell("puma560: a payload picked up")
    arm = thesis.arms["puma560"]
    logs = [arm.log(thesis.runs["puma560 experiment"], "experiment")]
    model = parametric(arm.robot, logs, ALL_EFFECTS)
    motion = arm.test_motions(thesis.settings)[0]
    rows: list[dict[str, Any]] = []
    for stiffness, gains in PAYLOAD_GAINS.items():
        usual = 0.0
        for label, (held, process) in FOLLOWED.items():
            online = OnlineModel(
                arm.robot,
                model,
                payload=held,
                process=process,
                period=CONTROL_PERIOD,
                cutoff_hz=PAYLOAD_CUTOFF_HZ,
            )
            controller = Adaptive(online, gains)
            run = _picks_up(arm, motion, controller)
            error = np.linalg.norm(run.q - run.q_wanted, axis=1)
            # What is usual is the error of the model that follows nothing, which comes first.
            usual = usual or float(error[(run.t >= 1.0) & (run.t < PICK_UP_SECONDS)].max())
            rows.append(
                {
                    "model": label,
                    "gains": list(gains),
                    "before": _rms(error, run.t, 1.0, PICK_UP_SECONDS),
                    "first_second": _rms(error, run.t, PICK_UP_SECONDS, PICK_UP_SECONDS + 1.0),
                    "after": _rms(error, run.t, PICK_UP_SECONDS + 1.0, PAYLOAD_SECONDS),
                    "recovered": _recovered(error, run.t, RECOVERED * usual),
                    "mass": None if online.payload is None else float(online.payload[0]),
                }
            )
            thesis.curves[f"error, {stiffness}, {label}"] = (run.t, error)
            if controller.estimates:
                thesis.curves[f"mass, {stiffness}, {label}"] = tuple(np.array(controller.estimates).T)
    thesis.data["payload"] = {"mass": float(HELD[0]), "time": PICK_UP_SECONDS, "rows": rows}


# What is followed: a payload, and what is left over, by a process.
FOLLOWED = {
    "identified model": (False, False),
    "payload tracked": (True, False),
    "online process": (False, True),
    "payload and process": (True, True),
}


def _recovered(error: Array, time: Array, limit: float) -> float | None:
    """Seconds from the pick-up until the error stays below the limit; `None` if it does not."""
    last = float(time[(error > limit) & (time >= PICK_UP_SECONDS)].max(initial=PICK_UP_SECONDS))
    return last - PICK_UP_SECONDS if last < time[-1] else None


def _picks_up(arm: Arm, motion: Trajectory, controller: Adaptive) -> Simulation:
    options: dict[str, Any] = {"position_resolution": [1e-5] * arm.robot.dof, "drives": arm.drives}
    return simulate(
        arm.robot,
        motion,
        duration=PAYLOAD_SECONDS,
        controller=controller,
        control_period=CONTROL_PERIOD,
        pick_up=(PICK_UP_SECONDS, HELD),
        **options,
    )


def _rms(values: Array, time: Array, start: float, end: float) -> float:
    part = values[(time >= start) & (time < end)]
    return float(np.sqrt(np.mean(part**2)))
