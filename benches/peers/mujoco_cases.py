"""Logs of arms that MuJoCo moves in closed loop, each with a hidden effect: cases for the diagnosis that share no code
with sgpr. Friction is MuJoCo's own and really sticks; the controller is PD with a feed-forward that is off.

Usage: python mujoco_cases.py DIRECTORY [--seed 1] [--count N] [--only EFFECT] [--pairs] (pip install mujoco numpy sgpr)
then   cargo run --release --example evaluate_diagnosis -- DIRECTORY

Writes one folder for each case (robot.urdf: the guess, three training logs, test.csv, case.json) and answers/NAME.json
with the noise, the error of a model without the effect and of one whose logs have none (`oracle_rmse`).
"""

import argparse
import dataclasses
import json
import pathlib
import tempfile
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import sgpr

URDFS = pathlib.Path(__file__).resolve().parents[2] / "data" / "reference" / "urdf"
ROBOTS = ["puma560", "ur5e_like", "panda_like", "two_link", "stanford_like", "scara"]
BASE = ["viscous_friction", "coulomb_friction", "rotor_inertia"]
STEP = 0.0005
SECONDS = 20.0

EFFECTS = [
    "none",
    "viscous_friction",
    "coulomb_friction",
    "rotor_inertia",
    "cable_stiffness",
    "torque_offset",
    "torque_ripple",
    "quadratic_viscous_friction",
    "asymmetric_viscous_friction",
    "stribeck_friction",
    "load_dependent_friction",
    "position_dependent_friction",
    "friction_warmup",
    "friction_step",
    "torque_offset_drift",
    "payload_change",
    "external_contact",
    "base_tilt",
    "torque_gain_error",
    "torque_delay",
    "wrist_coupling",
    "unknown_cross",
]
WHOLE_ARM = {"payload_change", "external_contact", "base_tilt", "torque_delay"}


def numbers(text):
    return np.array([float(x) for x in text.split()])


def perturbed(tree, random, share):
    """The same arm with masses, centres of mass and inertias off by up to `share`."""
    copy = ElementTree.fromstring(ElementTree.tostring(tree))
    for inertial in copy.iter("inertial"):
        mass, origin, inertia = inertial.find("mass"), inertial.find("origin"), inertial.find("inertia")
        mass.set("value", repr(float(mass.get("value")) * random.uniform(1 - share, 1 + share)))
        if origin is not None:
            where = numbers(origin.get("xyz", "0 0 0")) * random.uniform(1 - share, 1 + share)
            origin.set("xyz", " ".join(repr(float(x)) for x in where))
        factor = random.uniform(1 - share, 1 + share)
        for name, value in inertia.attrib.items():
            inertia.set(name, repr(float(value) * factor))
    return copy


def scaled(tree, random):
    """Another arm of the same kind: longer or shorter links."""
    copy = ElementTree.fromstring(ElementTree.tostring(tree))
    size = random.uniform(0.7, 1.3)
    for name in ("joint", "inertial"):
        for element in copy.iter(name):
            origin = element.find("origin")
            if origin is not None:
                where = numbers(origin.get("xyz", "0 0 0")) * size
                origin.set("xyz", " ".join(repr(float(x)) for x in where))
    for inertia in copy.iter("inertia"):
        for name, value in inertia.attrib.items():
            inertia.set(name, repr(float(value) * size**2))
    return copy


def compiled(tree):
    """The arm in MuJoCo, with a payload of no mass in the last link."""
    copy = ElementTree.fromstring(ElementTree.tostring(tree))
    for visual in ("visual", "collision"):
        for link in copy.iter("link"):
            for element in link.findall(visual):
                link.remove(element)
    moving = [j for j in copy.iter("joint") if j.get("type") != "fixed"]
    last = moving[-1].find("child").get("link")
    extra = ElementTree.fromstring(
        '<x><link name="held"><inertial><mass value="1e-6"/>'
        '<inertia ixx="1e-9" ixy="0" ixz="0" iyy="1e-9" iyz="0" izz="1e-9"/></inertial></link>'
        f'<joint name="hold" type="fixed"><parent link="{last}"/><child link="held"/></joint>'
        '<mujoco><compiler fusestatic="false" balanceinertia="true" boundmass="1e-7" boundinertia="1e-10"/></mujoco>'
        "</x>"
    )
    copy.extend(list(extra))
    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(ElementTree.tostring(copy, encoding="unicode"))
        file.flush()
        model = mujoco.MjModel.from_xml_path(file.name)
    model.opt.timestep = STEP
    model.jnt_limited[:] = 0
    model.jnt_actfrclimited[:] = 0
    return model


class Motion:
    """A finite Fourier series."""

    def __init__(self, model, random, slower):
        n = model.nv
        slide = model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE
        reach = np.where(slide, 0.15, 1.0) * random.uniform(0.5, 1.1, n)
        self.w = 2 * np.pi * random.uniform(0.08, 0.12) / slower
        self.centre = np.where(slide, 0.3, 1.0) * random.uniform(-0.8, 0.8, n)
        self.a, self.b = (reach * random.normal(size=(5, n)) / np.arange(1, 6)[:, None] ** 0.8 / 2 for _ in range(2))

    def at(self, t):
        k = np.arange(1, 6)[:, None] * self.w
        s, c = np.sin(k * t), np.cos(k * t)
        q = self.centre + (self.a * s + self.b * c).sum(0)
        return q, (k * (self.a * c - self.b * s)).sum(0), (-(k**2) * (self.a * s + self.b * c)).sum(0)


@dataclasses.dataclass
class Hidden:
    """An effect, where it acts, and what it may do."""

    effect: str
    joint: int
    other: int
    size: float  # N·m or N
    speed: float  # of the joint, root mean square
    place: tuple[float, float]  # a middle and a width within its positions
    order: float
    mass: float
    push: float  # N
    draw: np.ndarray

    def torque(self, model, data, t):
        """Torque that it takes from the motor besides friction; a load or a contact acts by itself."""
        a, draw, q, v = self.size, self.draw, data.qpos[self.joint], data.qvel[self.joint]
        neighbour = data.qvel[self.other]
        match self.effect:
            case "cable_stiffness":
                return a * (q - (draw[0] - 0.5))
            case "torque_offset":
                return a
            case "torque_ripple":
                return 0.4 * a * np.sin(self.order * q + 6.28 * draw[0])
            case "quadratic_viscous_friction":
                return 1.5 * a * v * abs(v) / self.speed**2
            case "asymmetric_viscous_friction":
                return a * abs(v) / self.speed
            case "torque_offset_drift":
                return a * t / 40
            case "wrist_coupling":
                return a * (0.5 * neighbour / self.speed + 0.4 * np.tanh(neighbour / 0.01 / self.speed))
            case "unknown_cross":
                return 1.5 * a * neighbour * np.cos(q) / self.speed
            case "payload_change" if t > 24 + 12 * draw[0]:
                held = model.body("held").id
                model.body_mass[held] = self.mass
                model.body_ipos[held] = (0.03 * draw[1], -0.03 * draw[2], 0.05 + 0.05 * draw[3])
                model.body_inertia[held] = 1e-3 * self.mass
            case "external_contact" if 0 < t - 22 - 10 * draw[0] < 3 + 4 * draw[1]:
                last, force = model.jnt_bodyid[-1], self.push * (2 * draw[2:5] - 1)
                mujoco.mj_applyFT(model, data, force, np.zeros(3), data.xpos[last], last, data.qfrc_applied)
        return 0.0

    def dry(self, model, data, t):
        """Dry friction that it adds."""
        a, draw, q, v = self.size, self.draw, data.qpos[self.joint], data.qvel[self.joint]
        match self.effect:
            case "stribeck_friction":
                return 1.5 * a * np.exp(-((v / (self.speed * (0.08 + 0.12 * draw[0]))) ** 2))
            case "load_dependent_friction":
                inertial = np.zeros(model.nv)
                mujoco.mj_mulM(model, data, inertial, data.qacc)
                rotor = model.dof_armature[self.joint] * data.qacc[self.joint]
                return (0.1 + 0.1 * draw[0]) * abs(inertial[self.joint] + data.qfrc_bias[self.joint] - rotor)
            case "position_dependent_friction":
                middle, width = self.place
                return 1.5 * a * np.exp(-0.5 * ((q - middle) / width) ** 2)
            case "friction_warmup":
                return 0.6 * a * np.exp(-t / (15 + 20 * draw[0]))
            case "friction_step":
                return a * (t > 24 + 12 * draw[0])
        return 0.0

    def viscous(self, t):
        """Viscous friction that it adds."""
        warms_up = self.effect == "friction_warmup"
        return self.size / self.speed * np.exp(-t / (15 + 20 * self.draw[0])) if warms_up else 0.0

    def measured(self, tau):
        """What the log shows of the torques of the motors."""
        if self.effect == "torque_gain_error":
            tau[:, self.joint] *= 1 + (0.15 + 0.15 * self.draw[0]) * np.sign(self.draw[1] - 0.5)
        if self.effect == "torque_delay":
            steps = round((0.006 + 0.014 * self.draw[0]) / STEP)
            tau = np.vstack([np.repeat(tau[:1], steps, axis=0), tau[:-steps]])
        return tau


@dataclasses.dataclass
class Arm:
    """Truth: inertias, drives (viscous, dry, rotor) and what is hidden."""

    model: mujoco.MjModel
    drives: list[np.ndarray]
    hidden: list[Hidden]

    def __post_init__(self):
        model = self.model
        model.dof_damping[:], model.dof_frictionloss[:], model.dof_armature[:] = self.drives
        for tilt in (h.draw for h in self.hidden if h.effect == "base_tilt"):
            roll, pitch = 0.03 + 0.05 * tilt[:2]
            turn = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
            turn = turn @ np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
            model.opt.gravity[:] = turn.T @ np.array([0, 0, -9.81])
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def step(self, data, tau, t):
        data.qfrc_applied[:] = tau
        loss, damping = self.drives[1].copy(), self.drives[0].copy()
        for hidden in self.hidden:
            data.qfrc_applied[hidden.joint] -= hidden.torque(self.model, data, t)
            loss[hidden.joint] += hidden.dry(self.model, data, t)
            damping[hidden.joint] += hidden.viscous(t)
        self.model.dof_frictionloss[:], self.model.dof_damping[:] = loss, damping
        mujoco.mj_step(self.model, data)


def follow(arm, feed_forward, motion, start, gains, friction_share):
    """One log at every step: q, dq and torque of the motors; None if the arm does not follow."""
    data, rigid = mujoco.MjData(arm.model), mujoco.MjData(feed_forward)
    data.qpos[:], data.qvel[:], _ = motion.at(start)
    log = []
    for k in range(int(SECONDS / STEP)):
        t = start + k * STEP
        rigid.qpos[:], rigid.qvel[:], rigid.qacc[:] = q, dq, _ = motion.at(t)
        mujoco.mj_inverse(feed_forward, rigid)
        tau = rigid.qfrc_inverse + friction_share * (arm.drives[0] * dq + arm.drives[1] * np.tanh(dq / 0.05))
        tau += gains[0] * (q - data.qpos) + gains[1] * (dq - data.qvel)
        if not np.all(np.abs(q - data.qpos) < 0.4):
            return None
        log.append([data.qpos.copy(), data.qvel.copy(), tau])
        arm.step(data, tau, t)
    q, dq, tau = (np.array(values) for values in zip(*log, strict=True))
    for hidden in arm.hidden:
        tau = hidden.measured(tau)
    return q, dq, tau


def rms(x):
    return np.sqrt(np.mean(np.square(x), axis=0))


@dataclasses.dataclass
class Case:
    kind: str
    guess: ElementTree.Element
    hidden: list[Hidden]
    rate: int
    noise: np.ndarray
    logs: list[list[np.ndarray]]  # with what is hidden, and without


def attempt(effects, seed):
    random = np.random.default_rng(seed)
    # In two links and in one plane some effects are not what they are called.
    large = {"base_tilt", "payload_change", "wrist_coupling"} & set(effects) or len(effects) > 1
    kinds = [kind for kind in ROBOTS if not (large and kind in ("two_link", "scara"))]
    kind = kinds[random.integers(len(kinds))]
    original = ElementTree.parse(URDFS / f"{kind}.urdf").getroot()
    truth = scaled(perturbed(original, random, 0.3), random)
    guess = perturbed(truth, random, 0.15)
    model, guessed = compiled(truth), compiled(guess)
    n = model.nv
    motions = [Motion(model, random, slower) for slower in (1, 1, random.uniform(3, 6), 1)]
    data, rows, inertia = mujoco.MjData(model), [], np.zeros((n, n))
    for t in np.arange(0, SECONDS, 0.02):
        data.qpos[:], data.qvel[:], data.qacc[:] = motions[0].at(t)
        mujoco.mj_inverse(model, data)
        mujoco.mj_fullM(model, data, inertia)
        rows.append(np.concatenate([data.qfrc_inverse, data.qvel, data.qacc, np.diag(inertia), data.qpos]))
    tau, speed, acceleration, inertia, _ = np.split(rms(rows), 5)
    tau = np.maximum(tau, 0.02 * tau.max())
    positions = np.array(rows)[:, -n:]
    drives = [
        random.uniform(0.05, 0.2, n) * tau / speed,
        random.uniform(0.05, 0.25, n) * tau,
        random.uniform(0.05, 0.3, n) * tau / acceleration,
    ]
    hidden = []
    free = list(random.permutation(n))
    for effect in effects:
        joint = max(free) if effect == "wrist_coupling" else free[0]
        free.remove(joint)
        hidden.append(
            Hidden(
                effect,
                int(joint),
                other=int(joint - 1 if joint else 1),
                size=random.uniform(0.1, 0.3) * tau[joint],
                speed=speed[joint],
                place=(positions[:, joint].mean() + 0.5 * positions[:, joint].std(), 0.5 * positions[:, joint].std()),
                order=float(random.integers(8, 40)),
                mass=0.3 * tau.max() / 9.81 * random.uniform(0.7, 1.7),
                push=0.4 * tau.max(),
                draw=random.uniform(0, 1, 8),
            )
        )
        if effect in BASE:
            own = drives[BASE.index(effect)]
            own[np.arange(n) != joint] = 0
            own[joint] *= 2
    bare = [np.zeros(n) if name in effects else own for name, own in zip(BASE, drives, strict=True)]
    stiff, bandwidth = inertia + drives[2], 2 * np.pi * random.uniform(3, 6)
    gains, share = (stiff * bandwidth**2, stiff * 2 * bandwidth), random.uniform(0.3, 0.9)
    rate = [100, 125, 200, 250, 500][random.integers(5)]
    noise = tau * np.exp(random.uniform(np.log(0.003), np.log(0.02), n))
    noise_seed = int(random.integers(2**31))
    logs = []
    for arm in [Arm(compiled(truth), drives, hidden), Arm(compiled(truth), bare, [])][: 2 if effects else 1]:
        random = np.random.default_rng(noise_seed)
        mine = []
        for index, motion in enumerate(motions):
            log = follow(arm, guessed, motion, index * SECONDS, gains, share)
            if log is None:
                return None
            q, dq, torque = (values[:: round(1 / rate / STEP)] for values in log)
            resolution = 2 * np.pi / 2**18
            q = np.round(q / resolution + 0.2 * random.normal(size=q.shape)) * resolution
            dq = dq + 2e-3 * random.normal(size=q.shape)
            torque = torque + noise * random.normal(size=q.shape)
            t = index * SECONDS + np.arange(len(q)) / rate
            mine.append(np.column_stack([t, q, dq, torque]))
        logs.append(mine)
    return Case(kind, guess, hidden, rate, noise, logs)


def as_logged(comparison, rate):
    """Error of each joint against the torque as logged, N·m or N, without the first and last 0.3 s."""
    edge = int(0.3 * rate)
    return rms(np.vstack([(log.measured - log.predicted)[edge:-edge] for log in comparison.logs])).tolist()


def write(directory, name, case):
    folder = directory / name
    folder.mkdir(parents=True, exist_ok=True)
    ElementTree.ElementTree(case.guess).write(folder / "robot.urdf")
    robot = sgpr.Robot.from_urdf(folder / "robot.urdf")
    joints = list(robot.joint_names)
    header = ",".join(["t"] + [f"{x}_{j}" for x in ("q", "dq", "tau") for j in joints])
    files = ["train_1.csv", "train_2.csv", "train_3.csv", "test.csv"]
    known = [effect for effect in BASE if effect not in [h.effect for h in case.hidden]]
    errors = []
    for mine in case.logs[::-1]:
        for file, log in zip(files, mine, strict=True):
            np.savetxt(folder / file, log, delimiter=",", header=header, comments="", fmt="%.7g")
        logs = [sgpr.read(folder / file, joints=joints) for file in files]
        model = sgpr.identify(robot, logs[:3], effects=known)
        errors.append(as_logged(sgpr.compare(model, logs[3:]), case.rate))
    info = {"name": name, "robot": "robot.urdf", "joints": joints, "rate_hz": case.rate, "model_effects": known}
    (folder / "case.json").write_text(json.dumps({**info, "train": files[:3], "test": files[3:]}, indent=1))
    hidden = [{"effect": h.effect, **({} if h.effect in WHOLE_ARM else {"joint": h.joint})} for h in case.hidden]
    answer = {"name": name, "robot": case.kind, "hidden": hidden, "noise_rmse": case.noise.tolist()}
    answer |= {"base_rmse": errors[-1], "oracle_rmse": errors[0]}
    (directory / "answers").mkdir(exist_ok=True)
    (directory / "answers" / f"{name}.json").write_text(json.dumps(answer, indent=1))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directory", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, help="cases (default: each effect, or pair, once)")
    parser.add_argument("--only", help="this effect (nothing: `none`)")
    parser.add_argument("--pairs", action="store_true", help="two effects in each case")
    options = parser.parse_args()
    kinds = [options.only] if options.only else list(EFFECTS)
    for k in range(options.count or len(kinds)):
        effects = [kinds[k % len(kinds)]]
        if options.pairs:
            effects = [
                EFFECTS[1 + (7 * k + options.seed) % (len(EFFECTS) - 2)],
                EFFECTS[1 + (11 * k + 5) % (len(EFFECTS) - 2)],
            ]
        effects = [effect for effect in dict.fromkeys(effects) if effect != "none"]
        cases = (attempt(effects, [options.seed, k, again]) for again in range(20))
        case = next((case for case in cases if case is not None), None)
        if case is None:
            raise SystemExit(f"{effects}: no arm follows")
        name = f"mujoco{options.seed}{'p' * options.pairs}_{k:02d}"
        write(options.directory, name, case)
        print(name, case.kind, [(h.effect, h.joint + 1) for h in case.hidden], flush=True)


if __name__ == "__main__":
    main()
