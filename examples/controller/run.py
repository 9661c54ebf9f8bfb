"""A controller in C++ at 1 kHz on an arm that MuJoCo moves; its model is identified and diagnosed from its own logs.

Usage: python run.py [--out out/controller] [--library out/c-library]   (make controller-demo; needs g++, mujoco,
matplotlib)

The arm is heavier or lighter than its robot file says by up to a tenth, has friction that MuJoCo makes, and a ripple in
the gear of one joint. Three runs of the same motion: with the model of the robot file, with the identified one, with
what the diagnosis found. Writes results.json, tracking.png and the models.
"""

import argparse
import dataclasses
import json
import subprocess
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import matplotlib
import mujoco
import numpy as np
import sgpr
from numpy.typing import NDArray

matplotlib.use("agg")
import matplotlib.pyplot as plt

Array = NDArray[np.float64]
HERE = Path(__file__).resolve().parent
URDF = HERE.parents[1] / "data" / "reference" / "urdf" / "ur5e_like.urdf"
EFFECTS = ("viscous_friction", "coulomb_friction", "rotor_inertia")
RATE_HZ, SECONDS, LOG_EVERY = 1000, 20.0, 4
VISCOUS = (8.0, 8.0, 6.0, 1.5, 1.2, 1.0)  # N·m·s/rad
COULOMB = (6.0, 7.0, 5.0, 1.2, 1.0, 0.8)  # N·m
ROTOR = (1.2, 1.2, 0.8, 0.12, 0.1, 0.08)  # kg·m²
STIFFNESS = (600.0, 600.0, 400.0, 80.0, 60.0, 40.0)  # N·m/rad
RIPPLE_JOINT, RIPPLE_SIZE, RIPPLE_ORDER = 2, 4.0, 12.0  # index, N·m, per revolution
STAGES = {"robot file": "nominal", "identified": "identified", "with the finding": "found"}


def true_arm(path: Path) -> None:
    """The arm as it is, for MuJoCo: masses and inertias off by up to a tenth, friction and rotors."""
    tree = ElementTree.parse(URDF).getroot()
    for link in tree.iter("link"):
        for name in ("visual", "collision"):
            for element in link.findall(name):
                link.remove(element)
    settings = ElementTree.SubElement(tree, "mujoco")
    ElementTree.SubElement(settings, "compiler", fusestatic="false", balanceinertia="true")
    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(ElementTree.tostring(tree, encoding="unicode"))
        file.flush()
        model = mujoco.MjModel.from_xml_path(file.name)
    share = np.random.default_rng(5).uniform(0.9, 1.1, model.nbody)
    model.body_mass[:] *= share
    model.body_inertia[:] *= share[:, None]
    model.opt.timestep = 0.5 / RATE_HZ
    model.jnt_limited[:] = 0
    model.jnt_actfrclimited[:] = 0
    model.dof_damping[:], model.dof_frictionloss[:], model.dof_armature[:] = VISCOUS, COULOMB, ROTOR
    mujoco.mj_setConst(model, mujoco.MjData(model))
    mujoco.mj_saveModel(model, str(path))


def motion(seed: int) -> Array:
    """A sum of five sines per joint: rows of q, dq, ddq."""
    random = np.random.default_rng(seed)
    n, k = len(STIFFNESS), 2 * np.pi / SECONDS * np.arange(1, 6)[:, None]
    a, b = (random.normal(size=(5, n)) * 0.45 / np.arange(1, 6)[:, None] ** 0.7 for _ in range(2))
    centre = np.array([0.0, -1.2, 1.2, -0.8, 0.6, 0.0])
    phase = np.arange(int(SECONDS * RATE_HZ))[:, None, None] / RATE_HZ * k
    sine, cosine = np.sin(phase), np.cos(phase)
    q = centre + (a * sine + b * cosine).sum(1)
    return np.hstack([q, (k * (a * cosine - b * sine)).sum(1), (-(k**2) * (a * sine + b * cosine)).sum(1)])


@dataclasses.dataclass
class Cell:
    """The controller's program and its arm."""

    out: Path
    program: Path

    def run(self, model: Path, reference: Array, seed: int) -> tuple[sgpr.Recording, Array]:
        """Its log, and the error of the position at each period, (N, n) rad."""
        rows, log = self.out / "reference.bin", self.out / "log.bin"
        reference.tofile(rows)
        ripple = [str(value) for value in (RIPPLE_JOINT, RIPPLE_SIZE, RIPPLE_ORDER)]
        names = [str(path) for path in (self.out / "arm.mjb", model, rows, log)]
        subprocess.run([self.program, *names, str(seed), *ripple, *map(str, STIFFNESS)], check=True)
        q, dq, tau, error = np.split(np.fromfile(log).reshape(len(reference), -1), 4, axis=1)
        time = np.arange(len(q)) / RATE_HZ
        every = slice(None, None, LOG_EVERY)
        recording = sgpr.Recording(time[every], q[every], dq[every], tau[every], source=f"run {seed}")
        return recording, error


def compiled(out: Path, library: Path) -> Path:
    """The controller, compiled with MuJoCo's library of the Python package."""
    package, program = Path(mujoco.__file__).parent, out / "controller"
    [shared] = package.glob("libmujoco.so.*")
    command = ["g++", "-std=c++17", "-O2", "-Wall", "-Wextra", HERE / "controller.cpp", "-o", program]
    command += [f"-I{library}/include", f"-I{package}/include", f"-L{library}/lib", "-lsgpr", shared]
    command += [f"-Wl,-rpath,{(library / 'lib').resolve()}", f"-Wl,-rpath,{package}"]
    subprocess.run([str(word) for word in command], check=True)
    return program


def learned(cell: Cell) -> list[dict[str, str]]:
    """Models from the robot file, then from logs that it was driven by; what was found."""
    robot = sgpr.Robot.from_urdf(URDF)
    nominal = cell.out / "nominal.sgpr"
    sgpr.Model.nominal(robot).save(nominal)
    logs = [cell.run(nominal, motion(seed), seed)[0] for seed in (11, 12, 13)]
    logs = [log.renamed(robot.joint_names) for log in logs]
    model = sgpr.identify(robot, logs, effects=EFFECTS)
    model.save(cell.out / "identified.sgpr")
    diagnosis = sgpr.diagnose(model, logs)
    diagnosis.model.save(cell.out / "found.sgpr")
    return [{"effect": finding.effect, "joints": ", ".join(finding.joints)} for finding in diagnosis.findings]


def plot(errors: dict[str, Array], path: Path) -> None:
    """Errors of one joint over time, and of all joints as bars."""
    plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False})
    colours = ("#888888", "#0072b2", "#d55e00")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), width_ratios=(3, 2), layout="constrained")
    places = np.arange(len(STIFFNESS))
    for k, ((name, error), colour) in enumerate(zip(errors.items(), colours, strict=True)):
        milliradians = 1000 * error
        time = np.arange(len(error)) / RATE_HZ
        left.plot(time, milliradians[:, RIPPLE_JOINT], color=colour, label=name, linewidth=1)
        right.bar(places + 0.27 * (k - 1), rms(milliradians), 0.25, color=colour, label=name)
    left.set(xlabel="time (s)", ylabel=f"error of joint {RIPPLE_JOINT + 1} (mrad)", xlim=(0, SECONDS))
    right.set(xlabel="joint", ylabel="root mean square error (mrad)", yscale="log")
    right.set_xticks(places, [str(place + 1) for place in places])
    right.yaxis.set_major_formatter("{x:g}")
    figure.legend(*left.get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=150)


def rms(values: Array) -> Array:
    """Root mean square of each column."""
    return np.sqrt(np.mean(np.square(values), axis=0))


def main() -> None:
    """The whole way, from a robot file to a controller that knows its arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/controller"))
    parser.add_argument("--library", type=Path, default=Path("out/c-library"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    cell = Cell(options.out, compiled(options.out, options.library))
    true_arm(options.out / "arm.mjb")
    findings = learned(cell)
    test = motion(21)
    errors = {name: cell.run(options.out / f"{file}.sgpr", test, 21)[1] for name, file in STAGES.items()}
    plot(errors, options.out / "tracking.png")
    table = {name: (1000 * rms(error)).round(3).tolist() for name, error in errors.items()}
    (options.out / "results.json").write_text(json.dumps({"findings": findings, "rms_mrad": table}, indent=1) + "\n")
    for finding in findings:
        print(f"found: {finding['effect']} at {finding['joints']}")
    for name, values in table.items():
        print(f"{name:17}", *(f"{value:8.3f}" for value in values), "mrad")


if __name__ == "__main__":
    main()
