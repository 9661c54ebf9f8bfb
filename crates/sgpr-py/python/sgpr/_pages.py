"""Pages about what Python holds: those that the commands write."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ._files import make_folder_of
from ._sgpr import Comparison, Diagnosis, LogSet, Model, Recording, compare, residual_structure


def write_page(path: str | os.PathLike[str], text: str) -> None:
    """Writes a page, complete or not there; its folder is made if need be."""
    make_folder_of(path)
    place = Path(path)
    beside = place.with_name(f".{os.getpid()}-{place.name}")
    try:
        beside.write_text(text, encoding="utf-8", newline="\n")
        os.replace(beside, place)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(place)) from error
    finally:
        beside.unlink(missing_ok=True)


def diagnosis_page(
    diagnosis: Diagnosis,
    path: str | os.PathLike[str],
    before: Model,
    train: Sequence[Recording] | LogSet,
    test: Sequence[Recording] | LogSet,
) -> None:
    """The page of `sgpr diagnose`."""
    # The commands need this package themselves.
    from .cli import diagnose as command
    from .cli.screening import repeated

    train_logs, test_logs = _logs(train), _logs(test)
    judged = list(test) or list(train)
    after = diagnosis.model
    result = command.Result(
        diagnosis=diagnosis,
        before=before,
        after=after,
        train=train_logs,
        test=test_logs,
        errors_before=compare(before, judged, processing=after),
        errors_after=compare(after, judged),
        repeated=repeated(train_logs, test_logs),
    )
    data = result.to_dict()
    data["settings"] = {"effects": before.effects}
    write_page(path, result.page(data).html())


def model_page(model: Model, path: str | os.PathLike[str], recordings: Sequence[Recording] | LogSet) -> None:
    """The page of `sgpr compare`."""
    comparison_page(compare(model, list(recordings)), path, model, recordings)


def comparison_page(
    found: Comparison, path: str | os.PathLike[str], model: Model, recordings: Sequence[Recording] | LogSet
) -> None:
    """The same of a comparison that there is."""
    from .cli import describe
    from .cli.predictions import residuals_by_log
    from .report.comparison import ComparisonPage
    from .report.versions import versions

    logs = _logs(recordings)
    data: dict[str, Any] = {
        "command": "compare",
        "settings": {"model": model.robot.name, "against": None, "reading": {}},
        "logs": [describe.repaired_log(log, "compared") for log in logs],
        "structure": residual_structure(model, found),
        "trained_on": [log.path for log in logs if log.path in model.logs],
        "repeated_motions": [],
        "limits": [],
        "versions": versions(),
    }
    page = ComparisonPage(model, {"model": found}, {"model": residuals_by_log(logs, found)}, data)
    write_page(path, page.html())


def rest_page(
    model: Any, path: str | os.PathLike[str], train: Sequence[Recording] | LogSet, test: Sequence[Recording] | LogSet
) -> None:
    """The page of `sgpr learn`."""
    from .cli import learn as command

    result = command.Result.of(model, _logs(train), _logs(test))
    data = result.to_dict() | {"settings": {}}
    write_page(path, result.page(data).html())


def _logs(recordings: Sequence[Recording] | LogSet) -> list[Any]:
    from .cli.reading import Log

    return [Log(recording.source, recording, [recording], []) for recording in recordings]
