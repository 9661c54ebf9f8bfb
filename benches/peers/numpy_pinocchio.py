"""What one writes with numpy, scipy and Pinocchio: the peer of a whole identification.

model ROBOT.urdf                   the robot as pinocchio.cpp reads it
samples ROBOT.urdf FILE COUNT      a file of random motion with its torque: q, dq, ddq, tau of every sample
identify ROBOT.urdf FILE           time of an identification from the file, ns, and what it found
"""

import sys
import time

import numpy as np
import pinocchio as pin
import scipy.linalg

REPEATS = 5


def print_model(urdf: str) -> None:
    model = pin.buildModelFromUrdf(urdf)
    for joint in range(1, model.njoints):
        assert model.joints[joint].shortname() == "JointModelRZ", model.joints[joint].shortname()
        placement, body = model.jointPlacements[joint], model.inertias[joint]
        i = body.inertia
        numbers = [*placement.rotation.ravel(), *placement.translation, body.mass, *body.lever]
        numbers += [i[0, 0], i[0, 1], i[1, 1], i[0, 2], i[1, 2], i[2, 2]]
        print(model.parents[joint], *(f"{number:.17g}" for number in numbers))


def write_samples(urdf: str, path: str, count: int) -> None:
    model = pin.buildModelFromUrdf(urdf)
    data = model.createData()
    random = np.random.default_rng(2018)
    q, dq, ddq = (scale * random.uniform(-1, 1, (count, model.nv)) for scale in (3, 2, 5))
    tau = np.array([pin.rnea(model, data, *state) for state in zip(q, dq, ddq, strict=True)])
    tau += 3 * dq + 2 * np.sign(dq)
    tau += 0.05 * tau.std(axis=0) * random.standard_normal(tau.shape)
    np.hstack([q, dq, ddq, tau]).astype("<f8").tofile(path)


def identify(model, data, q, dq, ddq, tau):
    """Weighted least squares for base parameters found by a pivoted QR, friction included."""
    samples, n = q.shape
    w = np.zeros((samples, n, 12 * n))
    for k in range(samples):
        w[k, :, : 10 * n] = pin.computeJointTorqueRegressor(model, data, q[k], dq[k], ddq[k])
    joints = np.arange(n)
    w[:, joints, 10 * n + joints] = dq
    w[:, joints, 11 * n + joints] = np.sign(dq)
    w = w.reshape(samples * n, 12 * n)
    b = tau.ravel()
    r, pivots = scipy.linalg.qr(w, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(r))
    rank = int((diagonal > 1e-9 * diagonal[0]).sum())
    w = w[:, pivots[:rank]]
    freedom = samples * (1 - rank / (samples * n))

    def noise(values):
        return np.sqrt(((b - w @ values).reshape(samples, n) ** 2).sum(axis=0) / freedom)

    sigma = noise(np.linalg.lstsq(w, b, rcond=None)[0])
    for _ in range(20):
        weights = np.tile(1 / sigma, samples)
        root = scipy.linalg.qr(np.column_stack([w * weights[:, None], b * weights]), mode="r")[0][: rank + 1]
        values = scipy.linalg.solve_triangular(root[:rank, :rank], root[:rank, rank])
        before, sigma = sigma, noise(values)
        if np.abs(sigma / before - 1).max() < 1e-4:
            break
    inverse = scipy.linalg.solve_triangular(root[:rank, :rank], np.eye(rank))
    return values, inverse @ inverse.T, sigma


def time_identification(urdf: str, path: str) -> None:
    model = pin.buildModelFromUrdf(urdf)
    data = model.createData()
    q, dq, ddq, tau = np.hsplit(np.fromfile(path, "<f8").reshape(-1, 4 * model.nv), 4)
    fastest = float("inf")
    for _ in range(REPEATS):
        start = time.perf_counter_ns()
        values, _, sigma = identify(model, data, q, dq, ddq, tau)
        fastest = min(fastest, time.perf_counter_ns() - start)
    print("identification", fastest)
    print("rank", len(values))
    for joint, level in enumerate(sigma):
        print(f"noise_{joint} {level:.12e}")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["model", urdf]:
            print_model(urdf)
        case ["samples", urdf, path, count]:
            write_samples(urdf, path, int(count))
        case ["identify", urdf, path]:
            time_identification(urdf, path)
        case _:
            sys.exit(__doc__)
