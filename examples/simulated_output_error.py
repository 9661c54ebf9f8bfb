"""What output error leaves on simulated logs whose arm is known: the tables of `docs/estimators.md`.

    python examples/simulated_output_error.py

A two-link arm, and a PUMA 560 whose first joint sticks at its turns, follow a motion of 10 s under a PD controller.
The first table has the errors in the friction of the first joint without noise, the second the largest error of all
parameters with noise and coarse encoders, in standard deviations. A minute.
"""

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
import sgpr

EFFECTS = ["viscous_friction", "coulomb_friction", "rotor_inertia"]
EXCITED = [(0.5, 0.9, 0.3), (0.4, 1.7, 2.1), (0.25, 2.6, 4.0), (0.2, 3.3, 5.2)]
"""Amplitude, rad, circular frequency, rad/s, and phase of the waves of a reference; joints differ by a part of each."""
LONG_S = 10.0


@dataclass(frozen=True)
class Arm:
    """A robot under a PD controller; rotor inertia, viscous and Coulomb friction of each joint."""

    robot: sgpr.Robot
    friction: list[tuple[float, float, float]]
    gains: dict[str, list[float]]

    @staticmethod
    def two_link() -> "Arm":
        """Two links."""
        gains = {"kp": [400.0, 300.0], "kd": [40.0, 30.0]}
        return Arm(sgpr.robots.two_link(), [(0.085, 0.21, 2.0), (0.087, 0.11, 0.8)], gains)

    @staticmethod
    def puma560() -> "Arm":
        """The PUMA with the friction of its drives, the same in both directions."""
        friction = [
            (drive.rotor_inertia, float(np.mean(drive.viscous_friction)), float(np.mean(drive.coulomb_friction)))
            for drive in sgpr.robots.puma560_drives()
        ]
        gains = {"kp": [2000.0, 2000.0, 1000.0, 100.0, 100.0, 100.0], "kd": [200.0, 200.0, 100.0, 10.0, 10.0, 10.0]}
        return Arm(sgpr.robots.puma560(), friction, gains)

    def parameters(self) -> np.ndarray:
        """Its base parameters."""
        rotors, viscous, coulomb = zip(*self.friction, strict=True)
        standard = np.concatenate([self.robot.standard_parameters.ravel(), viscous, coulomb, rotors])
        return sgpr.Model.from_parameters(self.robot, standard, effects=EFFECTS).parameters.values

    def log(self, encoder_step: float, **options: Any) -> tuple[sgpr.Recording, sgpr.Recording]:
        """What is recorded with an encoder of this step, rad, and its reference."""
        drives = [sgpr.Drive(rotor_inertia=i, viscous_friction=v, coulomb_friction=c) for i, v, c in self.friction]
        resolution = np.full(self.robot.dof, encoder_step)
        wanted = (1000.0, *reference(self.robot.dof))
        run = sgpr.simulate(
            self.robot,
            wanted,
            controller="pd",
            drives=drives,
            position_resolution=resolution,
            **self.gains,
            **options,
        )
        time, names = (run.t * 1e9).round().astype(np.int64), self.robot.joint_names
        log = sgpr.Recording(time, run.q_measured, None, run.tau_measured, joint_names=names, source="log")
        return log, sgpr.Recording(time, run.q_wanted, None, None, joint_names=names, source="reference")

    def identified(
        self, log: sgpr.Recording, wanted: sgpr.Recording, cutoff_hz: float | None, guess: float = 1.0
    ) -> sgpr.Model:
        """The model by output error, from a robot file whose inertias are so many times those of the arm."""
        robot = self.robot.with_standard_parameters(guess * self.robot.standard_parameters)
        options: dict[str, Any] = {"method": "output_error", "instruments": [wanted], **self.gains}
        return sgpr.identify(robot, [log], effects=EFFECTS, cutoff_hz=cutoff_hz, **options)

    def errors(self, model: sgpr.Model) -> dict[str, float]:
        """What the parameters of a model are off by."""
        return dict(zip(model.parameters.names, model.parameters.values - self.parameters(), strict=True))


def reference(dof: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, speed and acceleration of every joint at 1 kHz; the arm starts from rest, as robots do."""
    t = np.arange(0.0, LONG_S, 1e-3)
    q, dq, ddq = np.zeros((3, t.size, dof))
    for joint in range(dof):
        for size, rate, phase in EXCITED:
            a, w, p = size * (1.0 - 0.07 * joint), rate * (1.0 + 0.09 * joint), phase + 1.3 * joint
            q[:, joint] += a * np.sin(w * t + p)
            dq[:, joint] += a * w * np.cos(w * t + p)
            ddq[:, joint] -= a * w * w * np.sin(w * t + p)
    s = np.clip(t, 0.0, 1.0)[:, None]
    f, df, ddf = (
        s**3 * (10.0 - 15.0 * s + 6.0 * s**2),
        30.0 * (s * (1.0 - s)) ** 2,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )
    return f * q, f * dq + df * q, f * ddq + 2.0 * df * dq + ddf * q


FIRST = ("joint_1.Fv", "joint_1.Fc")
NOISE = [0.3, 0.3]
FINE = 1e-9


def two_link_row(rate_khz: float) -> str:
    """Errors of the friction of the first of two links, in standard deviations of the same log with noise."""
    arm, cutoff_hz = Arm.two_link(), 30.0
    loop = {"control_period": 1e-3 / rate_khz, "step": min(2.5e-4, 1e-3 / rate_khz), "record_period": 1e-3}
    noisy = arm.identified(*arm.log(FINE, torque_noise=NOISE, **loop), cutoff_hz).parameters
    deviations = dict(zip(noisy.names, noisy.standard_deviations, strict=True))
    errors = arm.errors(arm.identified(*arm.log(FINE, **loop), cutoff_hz))
    cells = [f"{abs(errors[name]) / deviations[name]:.1f} standard deviations" for name in FIRST]
    return f"| two links | 30 Hz | {rate_khz:g} kHz | {' | '.join(cells)} |"


def puma_row(rate_khz: float) -> str:
    """Errors of the friction of the first joint of the PUMA."""
    arm = Arm.puma560()
    log = arm.log(FINE, integrator="runge_kutta", control_period=1e-3 / rate_khz, record_period=1e-3)
    errors = arm.errors(arm.identified(*log, 20.0))
    _, *friction = arm.friction[0]
    units = ("N·m·s/rad", "N·m")
    cells = [
        f"{abs(errors[name]):.2g} of {value:.2g} {unit}"
        for name, value, unit in zip(FIRST, friction, units, strict=True)
    ]
    return f"| PUMA 560, this joint sticks | 20 Hz | {rate_khz:g} kHz | {' | '.join(cells)} |"


def encoder_row(encoder_step: float) -> str:
    """Largest error of all parameters of the two links with noise, from a robot file that is a tenth off."""
    arm = Arm.two_link()
    log = arm.log(encoder_step, torque_noise=NOISE)
    cells = []
    for cutoff_hz in (None, 30.0):
        model = arm.identified(*log, cutoff_hz, guess=1.1)
        errors = np.array(list(arm.errors(model).values())) / model.parameters.standard_deviations
        cells.append(f"{np.abs(errors).max():.1f}")
    return f"| {encoder_step:g} | {' | '.join(cells)} |"


def main() -> int:
    """Print the tables."""
    print("| arm | rows up to | controller | viscous friction is off by | Coulomb friction is off by |")
    print("|---|---|---|---|---|")
    for row, rates in ((two_link_row, (1.0, 20.0)), (puma_row, (1.0, 4.0))):
        for rate_khz in rates:
            print(row(rate_khz), flush=True)
    print("\n| step of the encoders, rad | cut-off from the spectrum | cut-off 30 Hz |\n|---|---:|---:|")
    for encoder_step in (1e-4, 5e-4, 1e-3):
        print(encoder_row(encoder_step), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
