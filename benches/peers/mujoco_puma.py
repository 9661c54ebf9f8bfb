"""The PUMA 560 with its drives as a MuJoCo model: driven motion for the tests, model file for `mujoco_step.c`.

Usage: python mujoco_puma.py REFERENCE.json MODEL_DIRECTORY     (pip install mujoco numpy)
The DH parameters are read from data/reference/puma560.json; rotors are `armature`, viscous friction `damping`, Coulomb
friction (the mean of both directions) `frictionloss`.
"""
import json
import pathlib
import sys

import mujoco
import numpy as np

GEAR = np.array([62.61, 107.8, 53.79, 76.04, 71.92, 76.69])
INERTIA = np.array([2e-4, 2e-4, 2e-4, 3.3e-5, 3.3e-5, 3.3e-5]) * GEAR**2
VISCOUS = np.array([1.48e-3, 8.17e-4, 1.38e-3, 7.12e-5, 8.26e-5, 3.67e-5]) * GEAR**2
COULOMB = np.array([0.415, 0.0985, 0.1185, 0.01405, 0.01188, 0.00723]) * GEAR


def pose(rotation=np.eye(3), translation=(0, 0, 0)):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def turn_x(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])


def model(dh, gravity, dry_friction):
    n = len(dh["a"])
    after = [pose(turn_x(dh["alpha"][i]), (dh["a"][i], 0, dh["d"][i])) for i in range(n)]
    bodies, before = "", np.eye(4)
    for i in range(n):
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, before[:3, :3].flatten())
        place = " ".join(repr(float(x)) for x in before[:3, 3])
        turned = " ".join(repr(float(x)) for x in quaternion)
        loss = f'frictionloss="{float(COULOMB[i])!r}"' if dry_friction else ""
        bodies += (
            f'<body pos="{place}" quat="{turned}"><joint name="j{i + 1}" type="hinge" axis="0 0 1" '
            f'armature="{float(INERTIA[i])!r}" damping="{float(VISCOUS[i])!r}" {loss}/>'
            '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        )
        before = after[i]
    g = " ".join(str(x) for x in gravity)
    actuators = "".join(f'<motor joint="j{i + 1}"/>' for i in range(n))
    result = mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="{g}" timestep="0.00025"/><worldbody>{bodies}{"</body>" * n}'
        f"</worldbody><actuator>{actuators}</actuator></mujoco>"
    )
    # Set after compiling, so that a link without mass gets through.
    for i in range(n):
        moments, axes = np.linalg.eigh(np.asarray(dh["inertia_com"][i], float))
        if np.linalg.det(axes) < 0:
            axes[:, 0] *= -1
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, (after[i][:3, :3] @ axes).flatten())
        result.body_mass[i + 1], result.body_inertia[i + 1] = dh["mass"][i], moments
        result.body_iquat[i + 1] = quaternion
        result.body_ipos[i + 1] = (after[i] @ np.append(dh["com"][i], 1))[:3]
        result.body_sameframe[i + 1] = result.body_simple[i + 1] = 0
    result.dof_simplenum[:] = 0
    return result


def driven_motion(arm):
    """q and dq every 50 ms under tau_i = amplitude_i sin((i + 1) t), RK4 of 0.1 ms, torque held over each step."""
    amplitude = np.array([30.0, 60.0, 25.0, 3.0, 2.0, 1.0])
    arm.opt.timestep, arm.opt.integrator = 1e-4, mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(arm)
    data.qpos[:] = [0.1, -1.2, 0.4, 0.2, -0.3, 0.5]
    rows = []
    for step in range(10001):
        if step % 500 == 0:
            rows.append([*data.qpos, *data.qvel])
        data.qfrc_applied[:] = amplitude * np.sin((np.arange(6) + 1) * step * 1e-4)
        mujoco.mj_step(arm, data)
    return rows


if __name__ == "__main__":
    reference, folder = json.loads(pathlib.Path(sys.argv[1]).read_text()), pathlib.Path(sys.argv[2])
    dh, gravity = reference["dh"], reference["gravity"]
    for name, dry in [("viscous", False), ("friction", True)]:
        mujoco.mj_saveModel(model(dh, gravity, dry), str(folder / f"{name}.mjb"), None)
    rows = [[float(f"{x:.15g}") for x in row] for row in driven_motion(model(dh, gravity, False))]
    result = {
        "source": f"MuJoCo {mujoco.__version__}, RK4 of 1e-4 s, benches/peers/mujoco_puma.py",
        "period_s": 0.05,
        "rows": "q[6], dq[6]",
        "motion": rows,
    }
    (folder / "puma560_driven.json").write_text(json.dumps(result, indent=None).replace("], [", "],\n[") + "\n")
