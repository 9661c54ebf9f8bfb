"""`sgpr predict`: the torque for every sample of a log."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from .. import Comparison, LogSet, Model, Recording, SemiParametricModel
from .. import compare as compare_with
from ..report.numbers import counted
from .console import Output
from .errors import wrong_use
from .inputs import load_any_model
from .options import check_not_input
from .output_folder import OutputFolder
from .predictions import INTERVAL, STD, Pieces, beside, predictions, spread_of, write_table, write_topics
from .project import ModelArgument, joints_of, model_and_logs
from .reading import ReadingOptions, read_log, tell_layouts
from .results import headed

SUFFIXES = (".csv", ".csv.gz", ".mcap")
PREDICTED = "predicted"
STD_WITH_NOISE = "std_with_noise"


def predict(
    reading: ReadingOptions,
    output: Output,
    out: Annotated[
        str,
        typer.Option("--out", metavar="FILE", help="Table (.csv, .csv.gz), or MCAP file with topics (.mcap)."),
    ],
    model: ModelArgument = None,
    file: Annotated[
        str | None,
        typer.Argument(metavar="[FILE]", help="A log.", show_default="the one to test of sgpr.toml"),
    ] = None,
    joints: Annotated[
        list[str] | None,
        typer.Option("--joints", metavar="JOINT...", help="Joints of a URDF to model; the others are locked."),
    ] = None,
) -> None:
    """Predicts the torque for each sample of a log.

    Tables have the columns t, then NAME_measured and NAME_predicted for each joint; MCAP files the topics /measured,
    /predicted and /residual. A log without torque gives the predictions alone.

    Tables also say how sure that is. With a model identified from logs NAME_std is the standard deviation of the
    prediction that the uncertainty of the parameters makes, and NAME_std_with_noise that of a single torque in the
    band of the fit. With a model that `sgpr learn` wrote NAME_std is the standard deviation of a measurement, and
    NAME_interval_95 half its interval of 95 %.
    """
    if not out.endswith(SUFFIXES):
        raise wrong_use(f"`{out}`: the name must end in {', '.join(SUFFIXES)}", "--out")
    model, files = model_and_logs(model, [] if file is None else [file])
    if len(files) > 1:
        raise wrong_use(f"is missing: name one of {', '.join(files)}", "FILE")
    [file] = files
    check_not_input(out, [model, file])
    place = Path(out).absolute()
    joints = joints_of(model, joints, files)
    loaded = load_any_model(model, joints)
    names = loaded.robot.joint_names
    with OutputFolder(str(place.parent)) as folder:
        physics: Any = getattr(loaded, "physics_", loaded)
        log = read_log(file, reading, names, physics.reading)
        measured = log.raw.tau is not None
        if not measured:
            log = replace(log, raw=_with_torque(log.raw), stretches=[_with_torque(part) for part in log.stretches])
        columns = {PREDICTED: "predicted"}
        if isinstance(loaded, SemiParametricModel):
            found, spread = loaded.compare_with_spread(LogSet(log.stretches, whole=True))
            [row] = predictions([log], {PREDICTED: found, **spread_of(found, spread)}, names)
            columns |= {STD: STD, INTERVAL: INTERVAL}
        else:
            found = compare_with(loaded, LogSet(log.stretches, whole=True))
            bands = {} if out.endswith(".mcap") or loaded.fit is None else _bands(loaded, found)
            [row] = predictions([log], {PREDICTED: found, **bands}, names)
            columns |= {name: name for name in bands}
        written = folder.file(str(place))
        if out.endswith(".mcap"):
            write_topics(written, [row], names, PREDICTED, with_measured=measured)
        else:
            write_table(written, [row], names, columns, with_file=False, with_measured=measured)
    log.tell(output)
    if row.left_out:
        output.warning(
            f"{counted(row.left_out, 'sample')} of {file} without prediction: see the notes on repairs and gaps"
        )
    data: dict[str, Any] = headed(
        "predict",
        model=model,
        log=file,
        out=out,
        joints=names,
        samples=len(row.time_ns),
        left_out=row.left_out,
        actions=log.actions,
    )
    tell_layouts([log], output)
    output.line(f"{counted(len(row.time_ns), 'sample')} written to {out}")
    output.result(data)
    if measured:
        output.next("sgpr", "compare", model, file, "--out", "comparison", why="how good is the prediction?")


def _bands(model: Model, found: Comparison) -> dict[str, Pieces]:
    """Standard deviations along the motion, without and with the noise of a single torque."""
    assert model.fit is not None, "asked before"
    noise = np.asarray(model.fit["noise"])
    deviations = [model.standard_deviation(log) for log in found.logs]
    noisy = [np.hypot(deviation, noise) for deviation in deviations]
    return {STD: beside(found, deviations), STD_WITH_NOISE: beside(found, noisy)}


def _with_torque(recording: Recording) -> Recording:
    """A log without torque, made fit for a comparison of which only the prediction is used."""
    nothing = np.zeros_like(recording.q)
    names = recording.joint_names
    return Recording(recording.time_ns, recording.q, recording.dq, nothing, joint_names=names, source=recording.source)
