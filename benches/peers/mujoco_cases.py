"""Logs of arms that MuJoCo moves in closed loop, each with a hidden effect: cases for the diagnosis that share no code
with sgpr. Friction is MuJoCo's own and really sticks; the controller is PD with a feed-forward that is off.

Usage: python mujoco_cases.py DIRECTORY [--seed 1] [--count 24] [--only EFFECT]     (pip install mujoco numpy sgpr)
then   cargo run --release --example evaluate_diagnosis -- DIRECTORY

Writes one folder for each case (robot.urdf: the guess, three training logs, test.csv, case.json) and answers/NAME.json
with the noise, the error of a model without the effect and of one whose logs have none (`oracle_rmse`).
"""

import argparse
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

#: Effect and what it may do, as shares of the rigid-body torque of its joint.
EFFECTS = [
    "",
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
        f'<mujoco><compiler fusestatic="false" balanceinertia="true" boundmass="1e-7" boundinertia="1e-10"/></mujoco></x>'
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


class Arm:
    """Truth: inertias, drives and the hidden effect (none if its name is empty)."""

    def __init__(self, tree, effect, joint, random, sizes):
        self.model = compiled(tree)
        n = self.model.nv
        tau, speed, acceleration = sizes
        self.viscous = random.uniform(0.05, 0.2, n) * tau / speed
        self.coulomb = random.uniform(0.05, 0.25, n) * tau
        self.rotor = random.uniform(0.05, 0.3, n) * tau / acceleration
        self.effect, self.joint = effect, joint
        self.size = random.uniform(0.1, 0.3) * tau[joint]
        self.speed = speed[joint]
        self.draw = random.uniform(0, 1, 8)
        for k, values in enumerate([self.viscous, self.coulomb, self.rotor]):
            if effect == BASE[k]:
                own = values[joint] * 2
                values[:] = 0
                values[joint] = own
        self.load = tau.copy()
        self.heaviest = tau.max()
        self.other = joint - 1 if joint else 1
        self.span = None

    def set_up(self, model):
        model.dof_damping[:], model.dof_frictionloss[:], model.dof_armature[:] = self.viscous, self.coulomb, self.rotor
        if self.effect == "base_tilt":
            roll, pitch = 0.03 + 0.05 * self.draw[:2]
            turn = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
            turn = turn @ np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
            model.opt.gravity[:] = turn.T @ np.array([0, 0, -9.81])
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def act(self, model, data, t):
        """Before a step: what the effect changes."""
        j, a, draw = self.joint, self.size, self.draw
        q, v = data.qpos[j], data.qvel[j]
        extra, loss = 0.0, self.coulomb[j]
        match self.effect:
            case "cable_stiffness":
                extra = a * (q - (draw[0] - 0.5))
            case "torque_offset":
                extra = a
            case "torque_ripple":
                extra = 0.4 * a * np.sin(self.order * q + 6.28 * draw[0])
            case "quadratic_viscous_friction":
                extra = 1.5 * a * v * abs(v) / self.speed**2
            case "asymmetric_viscous_friction":
                extra = a * abs(v) / self.speed
            case "stribeck_friction":
                loss += 1.5 * a * np.exp(-((v / (self.speed * (0.08 + 0.12 * draw[0]))) ** 2))
            case "load_dependent_friction":
                inertial = np.zeros(model.nv)
                mujoco.mj_mulM(model, data, inertial, data.qacc)
                loss += (0.1 + 0.1 * draw[0]) * abs(inertial[j] + data.qfrc_bias[j] - self.rotor[j] * data.qacc[j])
            case "position_dependent_friction":
                loss += 1.5 * a * np.exp(-0.5 * ((q - self.centre) / self.width) ** 2)
            case "friction_warmup":
                fade = np.exp(-t / (15 + 20 * draw[0]))
                loss += 0.6 * a * fade
                model.dof_damping[j] = self.viscous[j] + a * fade / self.speed
            case "friction_step":
                loss += a * (t > 24 + 12 * draw[0])
            case "torque_offset_drift":
                extra = a * t / 40
            case "wrist_coupling":
                speed = data.qvel[self.other]
                extra = a * (0.5 * speed / self.speed + 0.4 * np.tanh(speed / 0.01 / self.speed))
            case "unknown_cross":
                extra = 1.5 * a * data.qvel[self.other] * np.cos(q) / self.speed
            case "payload_change":
                held = model.body("held").id
                if t > 24 + 12 * draw[0] and model.body_mass[held] < 1e-3:
                    model.body_mass[held] = self.mass
                    model.body_ipos[held] = (0.03 * draw[1], -0.03 * draw[2], 0.05 + 0.05 * draw[3])
                    model.body_inertia[held] = 1e-3 * self.mass
            case "external_contact":
                start = 22 + 10 * draw[0]
                push = np.zeros(model.nv)
                if start < t < start + 3 + 4 * draw[1]:
                    last = model.jnt_bodyid[-1]
                    force = self.force * (2 * draw[2:5] - 1)
                    mujoco.mj_applyFT(model, data, force, np.zeros(3), data.xpos[last], last, push)
                data.qfrc_applied += push
        model.dof_frictionloss[j] = loss
        data.qfrc_applied[j] -= extra

    def measured(self, tau):
        if self.effect == "torque_gain_error":
            tau[:, self.joint] *= 1 + (0.15 + 0.15 * self.draw[0]) * np.sign(self.draw[1] - 0.5)
        if self.effect == "torque_delay":
            steps = round((0.006 + 0.014 * self.draw[0]) / STEP)
            tau = np.vstack([np.repeat(tau[:1], steps, axis=0), tau[:-steps]])
        return tau


def follow(arm, feed_forward, motion, start, gains, friction_share):
    """One log at every step: q, dq and torque of the motors."""
    model = arm.model
    data, rigid = mujoco.MjData(model), mujoco.MjData(feed_forward)
    data.qpos[:], data.qvel[:], _ = motion.at(start)
    log = []
    for k in range(int(SECONDS / STEP)):
        t = start + k * STEP
        rigid.qpos[:], rigid.qvel[:], rigid.qacc[:] = q, dq, _ = motion.at(t)
        mujoco.mj_inverse(feed_forward, rigid)
        tau = rigid.qfrc_inverse + friction_share * (arm.viscous * dq + arm.coulomb * np.tanh(dq / 0.05))
        tau += gains[0] * (q - data.qpos) + gains[1] * (dq - data.qvel)
        log.append(np.concatenate([data.qpos, data.qvel, tau]))
        data.qfrc_applied[:] = tau
        arm.act(model, data, t)
        mujoco.mj_step(model, data)
    log = np.array(log)
    n = model.nv
    if not np.all(np.abs(log[:, :n] - [motion.at(start + k * STEP)[0] for k in range(len(log))]) < 0.4):
        return None
    return log[:, :n], log[:, n : 2 * n], arm.measured(log[:, 2 * n :])


def rms(x):
    return np.sqrt(np.mean(np.square(x), axis=0))


def attempt(effect, seed):
    random = np.random.default_rng(seed)
    kinds = [r for r in ROBOTS if not (r in ("two_link", "scara") and effect in ("base_tilt", "payload_change"))]
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
        rows.append(np.concatenate([data.qfrc_inverse, data.qvel, data.qacc, np.diag(inertia)]))
    tau, speed, acceleration, inertia = np.split(rms(rows), 4)
    tau = np.maximum(tau, 0.02 * tau.max())
    joint = int(random.integers(n))
    effects = [effect, ""] if effect else [""]
    state = random.bit_generator.state
    arms = []
    for name in effects:
        random.bit_generator.state = state
        arm = Arm(truth, name, joint, random, (tau, speed, acceleration))
        if name == "" and effect in BASE:
            arm.viscous, arm.coulomb, arm.rotor = (v.copy() for v in (arms[0].viscous, arms[0].coulomb, arms[0].rotor))
            [arm.viscous, arm.coulomb, arm.rotor][BASE.index(effect)][:] = 0
        arms.append(arm)
    positions = np.array([motions[0].at(t)[0][joint] for t in np.arange(0, SECONDS, 0.05)])
    mean, spread = positions.mean(), positions.std()
    order = float(random.integers(8, 40))
    scale = inertia + arms[-1].rotor
    bandwidth = 2 * np.pi * random.uniform(3, 6)
    gains = (scale * bandwidth**2, scale * 2 * bandwidth)
    share = random.uniform(0.3, 0.9)
    rate = [100, 125, 200, 250, 500][random.integers(5)]
    every = round(1 / rate / STEP)
    noise = tau * np.exp(random.uniform(np.log(0.003), np.log(0.02), n))
    noise_seed = int(random.integers(2**31))
    mass = 0.15 * tau.max() / 9.81 / 0.5
    logs = []
    for arm in arms:
        arm.order, arm.centre, arm.width = order, mean + 0.5 * spread, 0.5 * spread
        arm.mass, arm.force = mass * (0.7 + arm.draw[4]), 0.4 * tau.max()
        arm.set_up(arm.model)
        random = np.random.default_rng(noise_seed)
        mine = []
        for index, motion in enumerate(motions):
            log = follow(arm, guessed, motion, index * SECONDS, gains, share)
            if log is None:
                return None
            q, dq, tau_now = (x[::every] for x in log)
            step = 2 * np.pi / 2**18
            q = np.round((q + 0.2 * step * random.normal(size=q.shape)) / step) * step
            dq = dq + 2e-3 * random.normal(size=dq.shape)
            tau_now = tau_now + noise * random.normal(size=q.shape)
            t = index * SECONDS + np.arange(len(q)) / rate
            mine.append(np.column_stack([t, q, dq, tau_now]))
        logs.append(mine)
    return kind, guess, joint, rate, noise, arms[0], logs


def as_logged(comparison):
    """Error of each joint against the torque as logged, N·m or N."""
    logs = comparison.logs
    return rms(np.vstack([log.measured - log.predicted for log in logs])).tolist()


def write(directory, name, effect, case):
    kind, guess, joint, rate, noise, arm, logs = case
    folder = directory / name
    folder.mkdir(parents=True, exist_ok=True)
    ElementTree.ElementTree(guess).write(folder / "robot.urdf")
    robot = sgpr.Robot.from_urdf(str(folder / "robot.urdf"))
    joints = list(robot.joint_names)
    header = ",".join(["t"] + [f"{x}_{j}" for x in ("q", "dq", "tau") for j in joints])
    files = ["train_1.csv", "train_2.csv", "train_3.csv", "test.csv"]
    known = [b for b in BASE if b != effect]
    errors = []
    for which, mine in list(enumerate(logs))[::-1]:
        for file, log in zip(files, mine, strict=True):
            np.savetxt(folder / file, log, delimiter=",", header=header, comments="", fmt="%.7g")
        read = [sgpr.read(folder / file, joints=joints) for file in files]
        model = sgpr.identify(robot, read[:3], effects=known)
        model = model[0] if isinstance(model, tuple) else model
        errors.append(as_logged(sgpr.compare(model, read[3:])))
    info = {"name": name, "robot": "robot.urdf", "joints": joints, "rate_hz": rate, "model_effects": known}
    (folder / "case.json").write_text(json.dumps({**info, "train": files[:3], "test": files[3:]}, indent=1))
    hidden = [{"effect": effect, **({} if effect in WHOLE_ARM else {"joint": joint})}] if effect else []
    answer = {"name": name, "robot": kind, "hidden": hidden, "noise_rmse": noise.tolist()}
    answer |= {"base_rmse": errors[-1], "oracle_rmse": errors[0]}
    (directory / "answers").mkdir(exist_ok=True)
    (directory / "answers" / f"{name}.json").write_text(json.dumps(answer, indent=1))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("directory", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=len(EFFECTS))
    parser.add_argument("--only", choices=EFFECTS)
    options = parser.parse_args()
    for k in range(options.count):
        effect = EFFECTS[k % len(EFFECTS)] if options.only is None else options.only
        for again in range(20):
            case = attempt(effect, [options.seed, k, again])
            if case is not None:
                break
        else:
            raise SystemExit(f"{effect}: no arm follows")
        name = f"mujoco{options.seed}_{k:02d}"
        write(options.directory, name, effect, case)
        print(name, case[0], effect or "nothing", f"joint {case[2] + 1}", flush=True)


if __name__ == "__main__":
    main()
