"""`sgpr compare`: a model against logs that it has not seen."""

from collections.abc import Sequence
from pathlib import Path, PurePath
from typing import Annotated, Any

import typer

from .. import (
    Comparison,
    LogSet,
    Model,
    SemiParametricModel,
    SgprError,
    compare_streaming,
    residual_structure,
)
from .. import compare as compare_with
from ..report.comparison import ComparisonPage
from ..report.numbers import percent, significant
from . import describe
from .console import Output, to_json
from .error_table import show_errors
from .errors import LIMITS_NOT_MET, BadData
from .inputs import load_any_model
from .limits import limits_of, verdicts
from .options import Open, open_page
from .output_folder import OutputFolder
from .predictions import residuals_by_log
from .project import ModelArgument, joints_of, model_and_logs
from .reading import Log, ReadingOptions, read_log, read_logs, stretches, tell_layouts
from .results import headed
from .screening import repeated


def compare(
    reading: ReadingOptions,
    output: Output,
    model: ModelArgument = None,
    files: Annotated[
        list[str] | None,
        typer.Argument(metavar="[FILE]...", help="Logs.", show_default="those to test of sgpr.toml"),
    ] = None,
    against: Annotated[
        str | None, typer.Option("--against", metavar="MODEL|ROBOT", help="Another model, to set beside this one.")
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            "--limit",
            metavar="FIGURE=VALUE...",
            help="Limits to judge by, for all joints or one: fit_percent=90 joint_2:rmse=1.2. Figures: rmse, "
            "fit_percent, r2, relative_error_percent, largest_error, rmse_full_band, rmse_with_rests, "
            "relative_error_with_rests_percent.",
        ),
    ] = None,
    limits: Annotated[
        str | None,
        typer.Option("--limits", metavar="FILE", help='Limits in JSON: {"fit_percent": 90, "joint_2": {"rmse": 1.2}}.'),
    ] = None,
    joints: Annotated[
        list[str] | None,
        typer.Option("--joints", metavar="JOINT...", help="Joints of a URDF to model; the others are locked."),
    ] = None,
    streaming: Annotated[
        bool,
        typer.Option(
            "--streaming",
            help="Also run the model one sample after the other as a controller does, hidden states carried along: "
            "over the motion filtered without delay, and over one that is filtered and differentiated from past "
            "samples alone.",
        ),
    ] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 if a limit is not met.")] = False,
    out: Annotated[
        str | None, typer.Option("--out", metavar="DIR", help="Folder for report.html and comparison.json.")
    ] = None,
    open_report: Open = False,
) -> None:
    """Compares the torque that a model predicts with the torque in logs, joint by joint."""
    model, files = model_and_logs(model, files)
    joints = joints_of(model, joints, files)
    main_model = load_any_model(model, joints)
    names = main_model.robot.joint_names
    wanted = limits_of(limit or [], limits, names)
    models = {model: main_model}
    if against is not None:
        other = load_any_model(against, names)
        # What is shown last is what matters.
        models = {against if against != model else f"{against} (again)": other, model: main_model}
    folder = OutputFolder(out) if out else None
    logs = read_logs(files, reading, names, output, _physics(main_model).reading)
    recordings = LogSet(stretches(logs))
    physics = {name: _physics(each) for name, each in models.items()}
    processed = [*physics.values()][::-1]
    processing = next((each for each in processed if each.processing), None)
    found: dict[str, Comparison] = {
        name: each.compare(recordings)
        if isinstance(each, SemiParametricModel)
        else compare_with(each, recordings, processing=processing)
        for name, each in models.items()
    }
    streamed = _streamed(main_model, recordings, processing) if streaming else {}
    trained_on = [log.path for log in logs if _same_file(log.path, physics[model].logs)]
    for path in trained_on:
        output.warning(f"{path} trained the model: no proof of what it can do elsewhere")
    unseen = [log for log in logs if log.path not in trained_on]
    repeating = repeated(_training_logs(physics[model], reading), unseen)
    for text in [*repeating, *found[model].notes]:
        output.warning(text)
    labels = _labels(list(found))
    judged = verdicts(wanted, found[model])
    failed = [verdict for verdict in judged if verdict["verdict"] == "fail"]
    data: dict[str, Any] = headed(
        "compare",
        main_model.robot,
        settings={"model": model, "against": against, "reading": reading.to_dict()},
        logs=[describe.repaired_log(log, "compared") for log in logs],
        comparison=describe.comparison(found[model]),
        structure=residual_structure(physics[model], found[model]),
        streaming={name: describe.comparison(each) for name, each in streamed.items()} if streaming else None,
        comparison_against=describe.comparison(found[next(iter(found))]) if against is not None else None,
        trained_on=trained_on,
        repeated_motions=repeating,
        limits=judged,
        verdict=None if not judged else "fail" if failed else "pass",
    )
    if folder:
        with folder:
            residuals = {name: residuals_by_log(logs, each) for name, each in found.items()}
            page = ComparisonPage(
                physics[model],
                {labels[name]: each for name, each in found.items()},
                {labels[name]: each for name, each in residuals.items()},
                data,
            )
            folder.write("comparison.json", to_json(data))
            folder.write("report.html", page.html())
    tell_layouts(logs, output)
    show({labels[name]: each for name, each in found.items()}, judged, output)
    if streamed:
        _show_streamed(found[model], streamed, output)
    if data["structure"]:
        output.line("what the error on these logs depends on:")
    for joint in data["structure"]:
        output.line(f"  {joint['summary']}")
    if folder:
        output.line(f"report: {folder.path / 'report.html'}")
    output.result(data)
    if folder and open_report:
        open_page(folder.path / "report.html")
    if not folder:
        output.next("sgpr", "compare", model, *files, "--out", "comparison", why="a page with the torques")
    else:
        output.next("sgpr", "predict", model, files[0], "--out", "torque.csv")
    if strict and failed:
        raise typer.Exit(LIMITS_NOT_MET)


def _streamed(
    model: Model | SemiParametricModel, recordings: LogSet, processing: Model | None
) -> dict[str, Comparison]:
    """The model one sample after the other, over the filtered motion and over one known from past samples alone."""
    own = None if isinstance(model, SemiParametricModel) else processing
    return {
        name: compare_streaming(model, recordings, processing=own, causal=causal)
        for name, causal in (("filtered", False), ("causal", True))
    }


def _show_streamed(batch: Comparison, streamed: dict[str, Comparison], output: Output) -> None:
    filtered, causal = streamed["filtered"], streamed["causal"]
    output.line(
        f"one sample after the other: error {percent(filtered.relative_error_percent)} % of the torque over the "
        f"filtered motion, {percent(causal.relative_error_percent)} % over a motion known from past samples alone"
    )
    rows = [
        [whole.joint, whole.unit, *(significant(joint.rmse) for joint in (whole, stream, late))]
        for whole, stream, late in zip(batch.joints, filtered.joints, causal.joints, strict=True)
    ]
    output.table(["joint", "unit", "RMSE", "RMSE streamed", "RMSE causal"], rows, text_columns=(0, 1))


def _physics(model: Model | SemiParametricModel) -> Model:
    """The part of a model that has effects, logs and a history."""
    physics: Model = model.physics_ if isinstance(model, SemiParametricModel) else model
    return physics


def _same_file(path: str, others: Sequence[str]) -> bool:
    return Path(path).resolve() in (Path(other).resolve() for other in others)


def _training_logs(model: Model, reading: ReadingOptions) -> list[Log]:
    """The logs that trained a model, those that are still where they were and can be read as the compared ones."""
    logs = []
    for path in dict.fromkeys(model.logs):
        try:
            logs.append(read_log(path, reading, model.robot.joint_names, model.reading))
        except (SgprError, BadData, OSError):
            continue
    return logs


def _labels(names: Sequence[str]) -> dict[str, str]:
    """The file names without their folders, if that leaves them different."""
    short = [PurePath(name).name for name in names]
    return dict(zip(names, short if len(set(short)) == len(short) else names, strict=True))


def show(found: dict[str, Comparison], judged: list[dict[str, Any]], output: Output) -> None:
    """The result for people."""
    for name, comparison in found.items():
        output.line(
            f"{name}: error {percent(comparison.relative_error_percent)} % of the torque over all joints in motion"
        )
    show_errors(found, output)
    if judged:
        rows = [
            [v["joint"], v["figure"], significant(v["value"]), significant(v["limit"]), v["unit"], v["verdict"]]
            for v in judged
        ]
        columns = ["joint", "figure", "found", "limit", "unit", "verdict"]
        output.table(columns, rows, text_columns=(0, 1, 4, 5), spare=("unit",))
        failed = sum(v["verdict"] == "fail" for v in judged)
        text = f"{failed} of {len(judged)} limits not met" if failed else f"all {len(judged)} limits met"
        output.line(text, "red" if failed else "green")
