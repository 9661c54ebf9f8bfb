"""Records of many logs, made by the workers of Dask: of a cluster that exists, or of one on this machine."""

import contextlib
import hashlib
import json
import logging
import os
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path, PurePosixPath
from typing import Any

from .. import __version__
from .._sgpr import Model, Processing, Record, Recording, Robot, SgprError, choose_processing, record
from ..reading import copies_of, read
from .files import list_records, save_records
from .logs import Log, is_remote

LOGS_AHEAD = 4
"""Tasks per worker that wait: enough to keep it busy, few enough that a stop is quick."""
LOGS_TO_CHOOSE_FROM = 3
RETRIES = 2
LOST_AFTER_SECONDS = 5.0
"""Between looks at whether the scheduler is still there."""


@dataclass(frozen=True)
class Kind:
    """A type of arm: its robot, how its logs are processed, and the effects of its records.

    - `model`: the reference that the user gave, if any
    """

    robot: Robot
    processing: Processing
    effects: list[str] | None = None
    model: Model | None = None


@dataclass(frozen=True)
class Outcome:
    """What became of the logs: numbers, and the reason for each that was set aside."""

    made: int
    kept: int
    aside: dict[str, str]
    copies: dict[str, str]


def kinds_of(
    given: dict[str, Robot | Model],
    logs: Sequence[Log],
    out: Path,
    *,
    reading: dict[str, Any] | None = None,
    storage: dict[str, Any] | None = None,
    conditioning: dict[str, Any] | None = None,
) -> dict[str, Kind]:
    """The types of arms with all choices made.

    Choices are made once, from the first logs of a type that can be read, and kept in the folder of the records:
    records of a later run can be summed with those that are there.
    """
    place = out / "processing.json"
    known: dict[str, str] = json.loads(place.read_text(encoding="utf-8")) if place.exists() else {}
    kinds = {}
    for name, robot_or_model in given.items():
        model = robot_or_model if isinstance(robot_or_model, Model) else None
        robot = model.robot if model is not None else robot_or_model
        assert isinstance(robot, Robot)
        own = model.processing if model is not None else None
        if own is None:
            text = known.get(name)
            own = Processing.from_json(text) if text else _chosen(robot, name, logs, reading, storage, conditioning)
        elif name in known and Processing.from_json(known[name]) != own:
            raise SgprError(
                f"{out}: holds records that were processed in another way than the model `{name}` says; give another "
                "folder (--out), or the model of before"
            )
        known[name] = own.to_json()
        kinds[name] = Kind(robot, own, model.effects if model is not None else None, model)
    _write_json(place, known)
    return kinds


def make_records(
    logs: Sequence[Log],
    kinds: dict[str, Kind],
    out: Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    reading: dict[str, Any] | None = None,
    storage: dict[str, Any] | None = None,
    blocks: int = 5,
    lags: bool = False,
    progress: Callable[[str, int, int], Any] | None = None,
) -> Outcome:
    """Makes the records of logs, each in a file of its own below `out`, by the name of its arm.

    Files that are there already are kept: a run that was stopped goes on. A log that cannot be recorded is set aside
    with its reason (`aside.json`) and stops nothing.
    """
    tasks, kept, aside = [], 0, {}
    for log in logs:
        kind = kinds.get(log.type)
        if kind is None:
            aside[log.path] = f"there is no robot of the type `{log.type}`: known are {', '.join(kinds)}"
            continue
        place = _place(out, log, kind, (blocks, lags))
        if place.exists():
            kept += 1
        else:
            tasks.append((log, place))
    made = 0
    _tell(progress, kept, len(logs))
    if tasks:
        with _cluster(scheduler, workers) as client:
            slim = {name: replace(kind, model=None) for name, kind in kinds.items()}
            parts = {"blocks": blocks, "lags": lags}
            jobs = ((log, slim[log.type], reading or {}, storage or {}, parts) for log, _ in tasks)
            places = dict(tasks)
            for log, found in _completed(client, jobs):
                if isinstance(found, str):
                    aside[log.path] = found
                else:
                    save_records(places[log], [Record.from_parts(*found)])
                    made += 1
                _tell(progress, kept + made + len(aside), len(logs))
    copies = _copies(out)
    _write_json(out / "aside.json", {"aside": aside, "copies": copies, "library_version": __version__})
    return Outcome(made, kept, aside, copies)


def record_one(log: Log, kind: Kind, reading: dict[str, Any], storage: dict[str, Any], parts: dict[str, Any]) -> Any:
    """The parts of a log's record, or the reason why there is none. Runs on a worker.

    - `parts`: what the record holds, `blocks` and `lags` of `sgpr.record`
    """
    import warnings

    try:
        with warnings.catch_warnings(), _local(log.path, storage) as path:
            warnings.simplefilter("ignore")
            recording = _read(path, kind.robot, reading)
            labels = {"robot": log.robot, "type": log.type, "path": log.path, **log.labels}
            made = record(
                kind.robot, recording, processing=kind.processing, effects=kind.effects, labels=labels, **parts
            )
        return made.to_parts()
    except (SgprError, OSError, ValueError, TypeError) as error:
        return str(error) or type(error).__name__
    except BaseException as error:
        # A broken assertion of the compiled half is no `Exception`, and must not take the worker along.
        if type(error).__name__ != "PanicException":
            raise
        return f"this should not happen, please report it: {error}"


def _completed(client: Any, jobs: Iterator[tuple[Any, ...]]) -> Iterator[tuple[Log, Any]]:
    """Results as they come, never more than a few tasks ahead of the workers."""
    waiting: dict[Any, Log] = {}

    def submit() -> None:
        job = next(jobs, None)
        if job is not None:
            waiting[client.submit(record_one, *job, pure=False, retries=RETRIES)] = job[0]

    for _ in range(LOGS_AHEAD * max(len(client.scheduler_info(n_workers=-1)["workers"]), 1)):
        submit()
    while waiting:
        for future in _done(client, list(waiting)):
            log = waiting.pop(future)
            try:
                found = future.result()
            except Exception as error:
                found = f"its worker failed {RETRIES + 1} times: {type(error).__name__}: {error}"
            submit()
            yield log, found


def _done(client: Any, futures: list[Any]) -> Any:
    """Those that are done, as soon as there is one.

    A client that lost its scheduler forgets its tasks, and those that it is given later never end.
    """
    dask = import_module("distributed")
    while client.status == "running":
        try:
            with client.as_current():
                return dask.wait(futures, timeout=LOST_AFTER_SECONDS, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            continue
        except CancelledError:
            break
    raise SgprError("the scheduler is gone; the records that are made stay, and the same command goes on")


@contextlib.contextmanager
def _cluster(scheduler: str | None, workers: int | None) -> Iterator[Any]:
    """A client of the scheduler at an address, or of a cluster on this machine that ends with it."""
    try:
        dask = import_module("distributed")
    except ImportError:
        raise SgprError("a fleet needs Dask: pip install sgpr[fleet]") from None
    if scheduler is not None:
        try:
            client = dask.Client(scheduler, timeout="10s", set_as_default=False)
        except (OSError, ValueError) as error:
            raise SgprError(f"{scheduler}: no scheduler of Dask answers there: {error}") from None
        with client:
            yield client
        return
    for name in ("distributed", "distributed.nanny", "distributed.worker", "distributed.scheduler"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    # Ctrl-C is for this process: it ends its workers.
    with _without_interrupts():
        try:
            cluster = dask.LocalCluster(
                n_workers=workers or os.cpu_count() or 1,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
                env={"RAYON_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            )
        except (OSError, RuntimeError) as error:
            # What Dask says of workers that a busy machine does not start within a minute.
            message = f"the workers did not start: {error}; the machine is busy, or allows no more processes: "
            raise SgprError(message + "try again, or with fewer (--workers 1)") from None
    with cluster, dask.Client(cluster, set_as_default=False) as client:
        yield client


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:
        # Not in the main thread, which alone hears of signals.
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _read(path: str, robot: Robot, reading: dict[str, Any]) -> Recording:
    """A log as `sgpr.read` reads and `Recording.repair` repairs it: the options under "read" and "repair"."""
    recording = read(path, robot.joint_names, **reading.get("read", {}))
    repairs = reading.get("repair", {})
    return recording.repair(**repairs).recordings[0] if repairs else recording


@contextlib.contextmanager
def _local(path: str, storage: dict[str, Any]) -> Iterator[str]:
    """The log as a file of this machine."""
    if not is_remote(path):
        yield path.removeprefix("file://")
        return
    fsspec = import_module("fsspec")

    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / PurePosixPath(path).name
        system, inside = fsspec.core.url_to_fs(path, **storage)
        system.get_file(inside, str(copy))
        yield str(copy)


def _chosen(
    robot: Robot,
    name: str,
    logs: Sequence[Log],
    reading: dict[str, Any] | None,
    storage: dict[str, Any] | None,
    conditioning: dict[str, Any] | None,
) -> Processing:
    found, fault = [], "there is none"
    for log in logs:
        if log.type != name:
            continue
        try:
            with _local(log.path, storage or {}) as path:
                recording = _read(path, robot, reading or {})
                choose_processing(robot, [recording], **(conditioning or {}))
                found.append(recording)
        except (SgprError, OSError) as error:
            fault = str(error)
        if len(found) == LOGS_TO_CHOOSE_FROM:
            break
    if not found:
        raise SgprError(f"no log of the type `{name}` can be read: {fault}" if name else f"no log can be read: {fault}")
    return choose_processing(robot, found, **(conditioning or {}))


def _place(out: Path, log: Log, kind: Kind, parts: tuple[int, bool]) -> Path:
    """File of a log's record; another one if the log, or how it is recorded, is another."""
    about: list[Any] = [log.path, log.robot, log.type, sorted(log.labels.items()), parts, kind.effects]
    about += [kind.robot.fingerprint, kind.processing.to_json()]
    if not is_remote(log.path):
        with contextlib.suppress(OSError):
            found = os.stat(log.path.removeprefix("file://"))
            about += [found.st_size, found.st_mtime_ns]
    key = hashlib.sha256(json.dumps(about).encode()).hexdigest()[:16]
    stem = "".join(c if c.isalnum() or c in "-_" else "_" for c in PurePosixPath(log.path).name.partition(".")[0])
    arm = "".join(c if c.isalnum() or c in "-_ " else "_" for c in log.robot)
    return out / "records" / arm / f"{stem[:60]}-{key}.parquet"


def _copies(out: Path) -> dict[str, str]:
    """Logs whose samples are those of another log of the same arm, with the first of these by name."""
    of_arms: dict[str, list[tuple[str, str]]] = {}
    for one in list_records(sorted((out / "records").glob("*/*.parquet"))):
        labels = one["labels"]
        own = of_arms.setdefault(labels.get("robot", ""), [])
        own.append((labels.get("path", one["source"]), one["content_hash"]))
    return {path: other for own in of_arms.values() for path, other in copies_of(sorted(own)).items()}


def _tell(progress: Callable[[str, int, int], Any] | None, done: int, total: int) -> None:
    if progress is not None:
        progress("logs", done, total)


def _write_json(place: Path, data: Any) -> None:
    from .._pages import write_page

    write_page(place, json.dumps(data, indent=2, sort_keys=True, ensure_ascii=False) + "\n")
