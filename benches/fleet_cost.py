"""What a fleet costs: CPU time and bytes of records and reports, workers, a million samples, logs longer than memory.

    python benches/fleet_cost.py [--logs 200] [--samples 1000000] [--stream 10000000]

Logs are simulated: 20 s at 100 Hz, six joints (UR5e-like), Parquet. The million samples are of seven joints
(Panda-like) at 1 kHz, from memory; the streamed ones are made piece by piece, and counted is the work on them.
"""

import argparse
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import sgpr
from sgpr.fleet import engine
from sgpr.fleet.changes import histories
from sgpr.fleet.files import list_records, load_records
from sgpr.fleet.logs import find
from sgpr.fleet.simulated import SECONDS, simulate_fleet

URDF = Path(__file__).parent.parent / "data/reference/urdf"
RATE_HZ, PIECE, PERIOD = 1000.0, 50_000, 50_000
ARMS_OF_ESTIMATE = 10_000


def main() -> None:
    """All rows of the table, then what they come to for many arms."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--logs", type=int, default=200)
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--stream", type=int, default=10_000_000)
    parser.add_argument("--only-stream", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.only_stream:
        stream(options.stream)
        return
    with tempfile.TemporaryDirectory() as folder:
        of_records(Path(folder), options.logs)
    reports()
    million(options.samples)
    # A process of its own, whose memory is that of the streaming.
    command = [sys.executable, __file__, "--only-stream", "--stream", str(options.stream)]
    subprocess.run(command, check=True)


def of_records(folder: Path, logs: int) -> None:
    """Records of logs: one process without Dask, one worker, two workers."""
    robot = sgpr.Robot.from_urdf(URDF / "ur5e_like.urdf")
    types = {"ur5e": robot}
    table = simulate_fleet(folder, types=types, arms=4, days=max(logs // 4, 1), sessions_per_day=1, spoiled=False)
    found = find(str(table))
    kinds = engine.kinds_of(types, found, folder)
    size = np.mean([Path(log.path).stat().st_size for log in found])

    def alone() -> None:
        for k, log in enumerate(found):
            parts = engine.record_one(log, kinds["ur5e"], {}, {}, {"blocks": 5, "lags": False})
            engine.save_records(folder / f"alone/{k}.parquet", [sgpr.Record.from_parts(*parts)])

    cpu, wall = timed(alone)
    paths = list((folder / "alone").glob("*.parquet"))
    of_record = np.mean([path.stat().st_size for path in paths])
    assert len(list(list_records(paths))) == len(found)
    per_hour = 3600.0 / SECONDS
    print(f"record of a log of 20 s, 6 joints, 100 Hz: {cpu / len(found):.3f} s CPU, {of_record / 1e6:.2f} MB")
    hour = f"{per_hour * cpu / len(found):.0f} s CPU, {per_hour * of_record / 1e6:.0f} MB of records"
    print(f"an hour of such logs: {hour}, {per_hour * size / 1e6:.0f} MB of logs")
    print(f"{len(found)} logs: {wall:.1f} s in one process without Dask", end="")
    for workers in (1, 2):
        (folder / f"of_{workers}").mkdir()
        started: list[float] = []

        def tell(stage: str, done: int, total: int, started: list[float] = started) -> None:
            started.append(time.perf_counter())

        begin = time.perf_counter()
        engine.make_records(found, kinds, folder / f"of_{workers}", workers=workers, progress=tell)
        whole = time.perf_counter() - begin
        # Without what starting the cluster and the first tasks takes.
        running = (started[-1] - started[1 + workers]) * len(found) / (len(found) - 1 - workers)
        print(f"; {whole:.1f} s with {workers} worker{'s' * (workers > 1)}, {running:.1f} s of it at work", end="")
    print()
    hours = ARMS_OF_ESTIMATE * per_hour
    print(f"estimate for {ARMS_OF_ESTIMATE} arms, an hour a day each: ", end="")
    print(f"{hours * cpu / len(found) / 3600:.0f} core hours, ", end="")
    print(f"{hours * of_record / 1e9:.0f} GB of records, {hours * size / 1e9:.0f} GB of logs a day, ", end="")
    print(f"{8e-6 * hours * size / 86400:.0f} Mbit/s on average")


def reports() -> None:
    """Histories and alarms, per session."""
    for name, file, arms, sessions in (("two", "two_link.urdf", 6, 60), ("six", "ur5e_like.urdf", 4, 30)):
        robot = sgpr.Robot.from_urdf(URDF / file)
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            types = {name: robot}
            table = simulate_fleet(folder, types=types, arms=arms, days=sessions, sessions_per_day=1, spoiled=False)
            logs = find(str(table))
            engine.make_records(logs, engine.kinds_of(types, logs, folder), folder)
            records = load_records(folder / "records")
        cpu, _ = timed(lambda records=records, types=types: histories(records, types))
        print(f"report, per session of {name} joints: {1e3 * cpu / len(records):.1f} ms CPU")


def million(samples: int) -> None:
    """One identification from memory."""
    robot, pieces = long_log(samples, samples)
    log = next(pieces)
    cpu, wall = timed(lambda: sgpr.identify(robot, [log]))
    print(f"identify, {samples:,} samples of 7 joints at 1 kHz, from memory: {cpu:.1f} s CPU, {wall:.1f} s")


def stream(samples: int) -> None:
    """A log that is never in memory: records of its pieces, their sum, the model."""
    robot, pieces = long_log(samples, PIECE)
    making = np.zeros(2)

    def made() -> Iterator[sgpr.Recording]:
        while True:
            found: list[sgpr.Recording | None] = []
            making[:] += timed(lambda found=found: found.append(next(pieces, None)))
            if found[0] is None:
                return
            yield found[0]

    _, first = long_log(PIECE, PIECE)
    processing = sgpr.choose_processing(robot, [next(first)])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "records.parquet"
        records = sgpr.fleet.record_pieces(robot, made(), processing=processing, lags=False)
        cpu, wall = np.array(timed(lambda: sgpr.fleet.save_records(file, watched(records)))) - making
        model = sgpr.identify_records(robot, load_records(file))
        size = file.stat().st_size
    memory = peak_memory()
    print(f"stream, {samples:,} samples of 7 joints at 1 kHz in pieces of {PIECE:,}: {cpu:.1f} s CPU, ", end="")
    print(
        f"{wall:.1f} s, {samples / wall / 1e6:.2f} million samples a second, {size / 1e6:.0f} MB of records, ", end=""
    )
    print(f"{memory / 1e6:.0f} MB at most, {len(model.parameters)} base parameters")


def watched(records: Iterator[sgpr.Record]) -> Iterator[sgpr.Record]:
    """Records, with a line on the memory whenever as many samples again are done."""
    done, told = 0, 1_000_000
    for record in records:
        yield record
        done += record.samples
        if done >= told:
            print(f"  after {done:,} samples: {peak_memory() / 1e6:.0f} MB at most", flush=True)
            told *= 2


def peak_memory() -> int:
    """Of this process, bytes."""
    # What getrusage says begins at the peak of the process that started this one.
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.split("VmHWM:")[1].split()[0])


def long_log(samples: int, piece: int) -> tuple[sgpr.Robot, Iterator[sgpr.Recording]]:
    """Sums of sines below 1.5 Hz at all joints, the torque with noise, in pieces. It repeats after 50 s."""
    robot = sgpr.Robot.from_urdf(URDF / "panda_like.urdf")
    rng = np.random.default_rng(0)
    w = 2.0 * np.pi * 0.14 * np.arange(1, 11)
    phase = rng.uniform(0.0, 2.0 * np.pi, (10, robot.dof))

    angle = (np.arange(PERIOD) / RATE_HZ)[:, None, None] * w[:, None] + phase
    sin, cos = np.sin(angle), np.cos(angle)
    once_q = 0.2 * sin.sum(axis=1)
    dq = 0.2 * np.einsum("kij,i->kj", cos, w)
    ddq = -0.2 * np.einsum("kij,i->kj", sin, w**2)
    once_tau = robot.inverse_dynamics(once_q, dq, ddq) + 2.0 * np.sign(dq) + 3.0 * dq
    del angle, sin, cos

    def pieces() -> Iterator[sgpr.Recording]:
        for start in range(0, samples, piece):
            k = np.arange(start, min(start + piece, samples))
            q, tau = once_q[k % PERIOD], once_tau[k % PERIOD]
            tau += 0.05 * rng.standard_normal(tau.shape)
            yield sgpr.Recording(k * 1_000_000, q, tau=tau, joint_names=robot.joint_names)

    return robot, pieces()


def timed(work: Callable[[], Any]) -> tuple[float, float]:
    """CPU time of this process, all threads, and wall time, s."""
    cpu, wall = time.process_time(), time.perf_counter()
    work()
    return time.process_time() - cpu, time.perf_counter() - wall


if __name__ == "__main__":
    main()
