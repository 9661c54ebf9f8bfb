"""Where the thesis stops (section 6-2): other control structures, and a payload picked up during the motion."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import OnlineModel, Simulation, Trajectory, simulate
from . import published
from .experiments import IDENTIFIED, INTERNAL, SEMI_PARAMETRIC, Arm, Tell, Thesis
from .models import ALL_EFFECTS, parametric

Array = NDArray[np.float64]

# Computed torque: 1/s² and 1/s, every joint a critically damped oscillator of 10 rad/s. Impedance: the test gains.
LAWS: dict[str, tuple[str, tuple[float, float]]] = {
    "computed torque": ("computed_torque", (100.0, 20.0)),
    "joint impedance": ("impedance", published.TEST_GAINS),
}

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
    rows = []
    for arm in thesis.arms.values():
        tell(f"{arm.name}: computed torque and joint impedance")
        motion = arm.test_motions(settings)[0]
        for label, (controller, gains) in LAWS.items():
            for model in (INTERNAL, IDENTIFIED, SEMI_PARAMETRIC):
                known = thesis.models[arm.name][model]
                run = arm.follow(motion, gains, [known], settings.test_seconds, controller)
                rows.append({"robot": arm.name, "law": label, "model": model, "rmse": run.tracking_rmse})
    thesis.data["control_laws"] = rows


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
