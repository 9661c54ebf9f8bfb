"""`sgpr predict`: the torque for every sample of a log."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from .. import Comparison, LogResidual, Model, Recording, __version__
from .. import compare as compare_with
from ..report.numbers import counted
from .console import Output
from .errors import wrong_use
from .inputs import load_model
from .output_folder import OutputFolder
from .predictions import predictions, write_table, write_topics
from .reading import ReadingOptions, read_log

SUFFIXES = (".csv", ".csv.gz", ".mcap")
PREDICTED = "predicted"
STD, STD_WITH_NOISE = "std", "std_with_noise"


def predict(
    model: Annotated[
        str, typer.Argument(metavar="MODEL", help="A saved model (.sgpr), or a robot for its file's model.")
    ],
    file: Annotated[str, typer.Argument(metavar="FILE", help="A log.")],
    reading: ReadingOptions,
    output: Output,
    out: Annotated[
        str,
        typer.Option("--out", metavar="FILE", help="Table (.csv, .csv.gz), or MCAP file with topics (.mcap)."),
    ],
    joints: Annotated[
        list[str] | None,
        typer.Option("--joints", metavar="JOINT...", help="Joints of a URDF to model; the others are locked."),
    ] = None,
) -> None:
    """Predicts the torque for each sample of a log.

    Tables have the columns t, then NAME_measured and NAME_predicted for each joint, and for a model identified from
    logs NAME_std, the standard deviation of the prediction that the uncertainty of the parameters makes, and
    NAME_std_with_noise, that of a single torque in the band of the fit. MCAP files have the topics /measured,
    /predicted and /residual. A log without torque gives the predictions alone.
    """
    if not out.endswith(SUFFIXES):
        raise wrong_use(f"`{out}`: the name must end in {', '.join(SUFFIXES)}", "--out")
    place = Path(out).absolute()
    loaded = load_model(model, joints)
    names = loaded.robot.joint_names
    with OutputFolder(str(place.parent)) as folder:
        log = read_log(file, reading, names)
        measured = log.raw.tau is not None
        if not measured:
            log = replace(log, raw=_with_torque(log.raw), stretches=[_with_torque(part) for part in log.stretches])
        found = compare_with(loaded, log.stretches)
        bands = {} if out.endswith(".mcap") or loaded.fit is None else _bands(loaded, found)
        [row] = predictions([log], {PREDICTED: found, **bands}, names)
        written = folder.file(str(place))
        if out.endswith(".mcap"):
            write_topics(written, [row], names, PREDICTED, with_measured=measured)
        else:
            columns = {PREDICTED: PREDICTED, **{name: name for name in bands}}
            write_table(written, [row], names, columns, with_file=False, with_measured=measured)
    for action in log.actions:
        output.note(f"{file}: {action}")
    if row.left_out:
        output.warning(
            f"{counted(row.left_out, 'sample')} of {file} without prediction: see the notes on repairs and gaps"
        )
    data: dict[str, Any] = {
        "command": "predict",
        "model": model,
        "log": file,
        "out": out,
        "joints": names,
        "samples": len(row.time_ns),
        "left_out": row.left_out,
        "actions": log.actions,
        "library_version": __version__,
    }
    output.line(f"{counted(len(row.time_ns), 'sample')} written to {out}")
    output.result(data)


@dataclass(frozen=True)
class _Piece:
    """What of a stretch of a log is brought to the samples of the table."""

    source: str
    time_ns: NDArray[np.int64]
    q: NDArray[np.float64]
    dq: NDArray[np.float64]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]


@dataclass(frozen=True)
class _Band:
    """Standard deviations in the place of predictions."""

    logs: list[_Piece]


def _bands(model: Model, found: Comparison) -> dict[str, _Band]:
    """Standard deviations along the motion, without and with the noise of a single torque."""
    assert model.fit is not None, "asked before"
    noise = np.asarray(model.fit["noise"])

    def piece(log: LogResidual, deviation: NDArray[np.float64]) -> _Piece:
        return _Piece(log.source, log.time_ns, log.q, log.dq, log.measured, deviation)

    deviations = [model.predict(log.q, log.dq, log.ddq, return_std=True)[1] for log in found.logs]
    plain = [piece(log, deviation) for log, deviation in zip(found.logs, deviations, strict=True)]
    noisy = [piece(log, np.hypot(deviation, noise)) for log, deviation in zip(found.logs, deviations, strict=True)]
    return {STD: _Band(plain), STD_WITH_NOISE: _Band(noisy)}


def _with_torque(recording: Recording) -> Recording:
    """A log without torque, made fit for a comparison of which only the prediction is used."""
    nothing = np.zeros_like(recording.q)
    names = recording.joint_names
    return Recording(recording.time_ns, recording.q, recording.dq, nothing, joint_names=names, source=recording.source)
