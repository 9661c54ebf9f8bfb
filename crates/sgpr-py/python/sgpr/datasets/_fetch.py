"""From the origin to a folder: download, check, convert, and only then show."""

import importlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ._dataset import ROBOTS, Dataset, DatasetError, Fetched, Source
from ._registry import describe
from ._tables import write

ABOUT = "dataset.json"
"""Marks a folder as that of a data set."""

BESIDE = ".fetching-"
"""Begins the name of the folder in which files are made; one that was killed leaves it."""

TIMEOUT_S = 30.0
CHUNK = 1 << 16

Progress = Callable[[str, int, int], object]


def fetch(
    dataset: str | Dataset, folder: str | os.PathLike[str] | None = None, *, progress: Progress | None = None
) -> Fetched:
    """Downloads a public data set, checks that it is the recorded one, and converts it to logs that sgpr reads.

    - `dataset`: a name (see `names`), or a data set of your own
    - `folder`: where the logs, the robot file and `sgpr.toml` appear; a folder in the user's cache if it is None.
      A data set that is there already is not fetched again.
    - `progress`: called with stage, bytes done and bytes in all

    Files of the origin stay in the user's cache, so that a second call needs no network. Nothing appears in `folder`
    before every file was checked and converted.

    Raises `DatasetError` (a `ValueError`) if a file cannot be had or is not the recorded one, or the folder holds
    something else; `OSError` if it cannot be written.
    """
    wanted = describe(dataset) if isinstance(dataset, str) else dataset
    cache = Path(_package("pooch", wanted.name).os_cache("sgpr"))
    place = cache / "datasets" / wanted.name if folder is None else Path(folder)
    if _is_there(wanted, place):
        return Fetched(wanted, place)
    needed = {source.file: _downloaded(source, cache / "origins" / wanted.name, progress) for source in wanted.sources}
    place.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=BESIDE, dir=place) as beside:
        try:
            _convert(wanted, needed, Path(beside))
        except OSError as error:
            # What is written beside is not the user's file, and some writers name none.
            raise OSError(error.errno, error.strerror or str(error), str(place)) from error
        # The mark of a whole data set comes last.
        for path in sorted(Path(beside).iterdir(), key=lambda path: path.name == ABOUT):
            os.replace(path, place / path.name)
    return Fetched(wanted, place)


def _is_there(dataset: Dataset, place: Path) -> bool:
    """Whether the folder holds this data set whole."""
    if not place.exists() or all(path.name.startswith(BESIDE) for path in place.iterdir()):
        return False
    try:
        known = json.loads((place / ABOUT).read_text(encoding="utf-8"))
        whose = known["name"], known["sha256"]
    except (OSError, ValueError, KeyError, TypeError):
        raise DatasetError(f"{place}: this folder holds other files; name one that is empty or new (--out)") from None
    if whose != (dataset.name, [source.sha256 for source in dataset.sources]):
        raise DatasetError(f"{place}: this folder holds the data set {whose[0]}; name another one (--out)")
    return all((place / log.file).exists() for log in dataset.logs)


def _convert(dataset: Dataset, needed: Mapping[str, Path], folder: Path) -> None:
    """Everything that shall be in the folder of the data set."""
    for name, table in dataset.convert(needed).items():
        write(folder / name, table)
    if dataset.robot_file:
        shutil.copyfile(needed.get(dataset.robot_file, ROBOTS / dataset.robot_file), folder / dataset.robot_file)
    if dataset.settings:
        (folder / "sgpr.toml").write_text(dataset.settings, encoding="utf-8")
    (folder / ABOUT).write_text(json.dumps(about(dataset), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def about(dataset: Dataset) -> dict[str, Any]:
    """The data set for programs, and for whoever finds the folder later."""
    return {
        "name": dataset.name,
        "robot": dataset.robot,
        "torque": dataset.torque,
        "rate_hz": dataset.rate_hz,
        "licence": dataset.licence,
        "citation": dataset.citation,
        "home": dataset.home,
        "origins": [source.url for source in dataset.sources],
        "sha256": [source.sha256 for source in dataset.sources],
        "bytes": dataset.size,
        "robot_file": dataset.robot_file,
        "logs": {log.file: {"role": log.role, "what": log.what} for log in dataset.logs},
        "effects": list(dataset.effects),
        "physics": dataset.physics,
        "published": dataset.published,
        "unseen_percent": dataset.unseen_percent,
    }


def _downloaded(source: Source, folder: Path, progress: Progress | None) -> Path:
    """The file of the origin, in the cache; what is not the recorded file is not kept."""
    pooch = _package("pooch", source.file)
    requests = importlib.import_module("requests")
    pooch.get_logger().setLevel("WARNING")

    def stream(url: str, target: str, _: object) -> None:
        _stream(url, Path(target), source, progress)

    try:
        found: str = pooch.retrieve(
            source.url, f"sha256:{source.sha256}", fname=source.file, path=folder, downloader=stream
        )
    except requests.RequestException as error:
        place = folder / source.file
        raise DatasetError(
            f"{source.url}: cannot be downloaded: {_reason(error)} A file that was downloaded elsewhere is taken, too: "
            f"as {place}"
        ) from None
    except ValueError as error:
        if isinstance(error, DatasetError):
            raise
        raise DatasetError(
            f"{source.url}: this is not the file that was recorded (sha256 {source.sha256[:12]}...): the download was "
            f"damaged, or the origin has changed it. Nothing was kept; try again."
        ) from None
    except OSError as error:
        # A full disk is met in pooch's temporary file; the user knows the folder.
        raise OSError(error.errno, error.strerror or str(error), str(folder)) from error
    return Path(found)


def _stream(url: str, target: Path, source: Source, progress: Progress | None) -> None:
    """Writes what the server sends, but no more than the recorded file has."""
    requests = importlib.import_module("requests")
    done = 0
    with requests.get(url, stream=True, timeout=TIMEOUT_S) as response, target.open("wb") as file:
        response.raise_for_status()
        for chunk in response.iter_content(CHUNK):
            done += len(chunk)
            if done > source.size:
                raise DatasetError(
                    f"{url}: the server sends more than the {source.size} bytes that were recorded: the origin has "
                    "changed the file. Nothing was kept."
                )
            file.write(chunk)
            if progress is not None:
                progress(f"download {source.file}", done, source.size)


def _reason(error: Exception) -> str:
    """What a person can do something about."""
    response = getattr(error, "response", None)
    if response is not None:
        return f"the server answers {response.status_code} {response.reason}."
    if "Timeout" in type(error).__name__:
        return f"the server has been silent for {TIMEOUT_S:.0f} s; try again later."
    if "ChunkedEncoding" in type(error).__name__:
        return "the connection broke off; try again."
    return "the server cannot be reached; is there a network, and does it need a proxy (HTTPS_PROXY)?"


def _package(name: str, what: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise DatasetError(f'{what}: downloading needs {name}: pip install "sgpr[datasets]"') from None
