"""The model of many logs: sgpr's records on Dask against the same written with Dask arrays and SciPy, in one run.

    python benches/peers/dask_fleet.py [--logs 8] [--seconds 120] [--workers 2] [--regressor sgpr|pinocchio]
        [--solver lstsq|newton|admm]

The same job: from Parquet logs to base parameters by weighted least squares, both sides of the equation filtered, one
noise level for each joint. The other way is as one writes it: a delayed function makes the rows of a log, Dask stacks
them to a tall array, and `dask.array.linalg.lstsq` (a tall-skinny QR) solves it, first with equal weights, then by the
noise that each joint is left with; or `LinearRegression` of dask-ml does, by Newton's method or by its default, ADMM
(`pip install dask-ml`). Its regressor is sgpr's, or Pinocchio's sample by sample. Both run on one cluster,
started before, and the parameters of both are held against each other.
"""

import argparse
import tempfile
import time
import warnings
from pathlib import Path

import dask
import dask.array as da
import distributed
import numpy as np
import pyarrow as pa
import sgpr
from numpy.typing import NDArray
from pyarrow import parquet
from scipy.signal import butter, sosfiltfilt
from sgpr.fleet import engine, simulated
from sgpr.fleet.files import load_records
from sgpr.fleet.logs import Log, find

URDF = Path(__file__).parent.parent.parent / "data/reference/urdf/ur5e_like.urdf"
EFFECTS = ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"]
EDGE = 50
"""Samples at either end in which the filters settle."""
Array = NDArray[np.float64]


def main() -> None:
    """Both ways, in turns."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--logs", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=120.0, help="of each log")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--regressor", choices=["sgpr", "pinocchio"], default="sgpr")
    parser.add_argument("--solver", choices=["lstsq", "newton", "admm"], default="lstsq")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    robot = sgpr.Robot.from_urdf(URDF)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        logs = written(folder, robot, options.logs, options.seconds)
        kinds = engine.kinds_of({"ur5e": robot}, logs, folder)
        workers = {"n_workers": options.workers, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
        times: dict[str, list[float]] = {"sgpr": [], "dask": []}
        with distributed.LocalCluster(**workers) as cluster, distributed.Client(cluster) as client:
            # Imports of the workers belong to neither.
            client.run(rows_of, logs[0], kinds["ur5e"], options.regressor)
            for turn in range(options.turns):
                begin = time.perf_counter()
                out = folder / f"records_{turn}"
                engine.make_records(logs, kinds, out, scheduler=cluster.scheduler_address, blocks=1)
                model = sgpr.identify_records(robot, load_records(out / "records"))
                times["sgpr"].append(time.perf_counter() - begin)
                begin = time.perf_counter()
                base = with_dask(logs, kinds["ur5e"], options.regressor, options.solver)
                times["dask"].append(time.perf_counter() - begin)
    ours, theirs = min(times["sgpr"]), min(times["dask"])
    apart = np.abs(base - model.parameters.values) / model.parameters.standard_deviations
    print(f"{options.logs} logs of {options.seconds:.0f} s, 6 joints, 100 Hz, ", end="")
    print(f"{options.workers} workers, fastest of {options.turns} turns")
    way = f"Dask arrays ({options.solver}) with the regressor of {options.regressor}"
    print(f"sgpr {ours:.2f} s, {way} {theirs:.2f} s: {theirs / ours:.1f} times as fast")
    print(f"parameters differ by {np.median(apart):.2f} standard deviations in the median")


def written(folder: Path, robot: sgpr.Robot, count: int, seconds: float) -> list[Log]:
    """Logs of a simulated arm."""
    rows = ["path,robot,type"]
    for k in range(count):
        log = simulated.session_log(simulated.Arm("arm", "ur5e", 1), robot, k, 1, seconds=seconds, tracked=False)
        columns = {"t": pa.array(log["t"]).cast(pa.timestamp("ns"))}
        for name, key in (("position", "q"), ("torque", "tau")):
            columns |= {f"{joint}_{name}": log[key][:, j] for j, joint in enumerate(robot.joint_names)}
        parquet.write_table(pa.table(columns), folder / f"{k:04d}.parquet")
        rows.append(f"{k:04d}.parquet,arm,ur5e")
    (folder / "fleet.csv").write_text("\n".join(rows))
    return find(str(folder / "fleet.csv"))


def with_dask(logs: list[Log], kind: engine.Kind, regressor: str, solver: str) -> Array:
    """Base parameters."""
    n, columns = kind.robot.dof, kind.robot.base_parameters(EFFECTS).rank
    samples = rows_of(logs[0], kind, regressor).shape[0]
    parts = [dask.delayed(rows_of)(log, kind, regressor) for log in logs]
    stacked = [da.from_delayed(part, (samples, n, columns + 1), dtype=float) for part in parts]
    rows = da.concatenate(stacked).persist()
    noise, base = np.ones(n), np.zeros(columns)
    for _ in range(2):
        weighted = (rows / noise[:, None]).reshape(-1, columns + 1)
        base = solution(weighted[:, :-1], weighted[:, -1], solver)
        residual = rows[:, :, -1] - rows[:, :, :-1] @ base
        noise = np.asarray(da.sqrt((residual**2).mean(axis=0)).compute())
    return base


def solution(columns: da.Array, torque: da.Array, solver: str) -> Array:
    """Least squares, all rows alike."""
    if solver == "lstsq":
        return np.asarray(da.linalg.lstsq(columns, torque)[0].compute())
    from dask_ml.linear_model import LinearRegression

    # Its penalty cannot be left out, only be made small.
    model = LinearRegression(fit_intercept=False, solver=solver, penalty="l2", C=1e9)
    return np.asarray(model.fit(columns, torque).coef_)


def rows_of(log: Log, kind: engine.Kind, regressor: str) -> Array:
    """Filtered rows of a log, every few samples: base columns, and the torque. Runs on a worker."""
    robot, how = kind.robot, kind.processing
    recording = sgpr.read(log.path, robot.joint_names)
    rate = recording.sample_rate_hz
    sections = butter(how.order, how.cutoff_hz, fs=rate, output="sos")
    q = sosfiltfilt(sections, recording.q, axis=0)
    dq = np.gradient(q, 1.0 / rate, axis=0)
    ddq = np.gradient(dq, 1.0 / rate, axis=0)
    n, samples = robot.dof, len(q)
    body = robot.regressor(q, dq, ddq) if regressor == "sgpr" else with_pinocchio(q, dq, ddq)
    whole = np.zeros((samples, n, 10 * n + 4 * n))
    whole[:, :, : 10 * n] = body.reshape(samples, n, 10 * n)
    for k, column in enumerate((dq, np.sign(dq), ddq, np.ones_like(q))):
        whole[:, np.arange(n), 10 * n + k * n + np.arange(n)] = column
    base = robot.base_parameters(EFFECTS)
    chosen = [base.parameter_names.index(name) for name in base.names]
    rows = np.concatenate([whole[:, :, chosen], recording.tau[:, :, None]], axis=2)
    return np.ascontiguousarray(sosfiltfilt(sections, rows, axis=0)[EDGE : -EDGE : how.decimation])


def with_pinocchio(q: Array, dq: Array, ddq: Array) -> Array:
    """The regressor, sample by sample."""
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(URDF))
    data = model.createData()
    return np.array([pinocchio.computeJointTorqueRegressor(model, data, *row) for row in zip(q, dq, ddq, strict=True)])


if __name__ == "__main__":
    main()
