"""`sgpr export`: a model as a source file for a controller, or as a robot file for other tools."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from .. import Model, SemiParametricModel
from .._pages import write_page
from .console import Output
from .errors import BadData
from .inputs import load_any_model
from .options import check_not_input
from .robot_files import without_place


def export(
    model: Annotated[
        str, typer.Argument(metavar="MODEL", help="A saved model (.sgpr), or a robot for its file's model.")
    ],
    output: Output,
    language: Annotated[Literal["c", "rust", "urdf", "mjcf"], typer.Option("--language", help="Language of the file.")],
    out: Annotated[str, typer.Option("--out", metavar="FILE", help="The file: arm.h, arm.rs, arm.urdf, arm.xml.")],
    rate: Annotated[
        float | None,
        typer.Option("--rate", metavar="HZ", help="Rate of the calls; effects of time, delays and lags need it."),
    ] = None,
    precision: Annotated[
        Literal["double", "single"] | None,
        typer.Option(
            "--precision", help="Numbers of 64 bits, or of 32 for processors without others.", show_default="double"
        ),
    ] = None,
    purpose: Annotated[
        Literal["feed_forward", "expected_measurement"] | None,
        typer.Option("--purpose", help="What the arm needs, or what its log would show.", show_default="feed_forward"),
    ] = None,
    keep: Annotated[
        list[str] | None,
        typer.Option("--keep", metavar="EFFECT...", help="Effects that a feed-forward torque holds all the same."),
    ] = None,
    name: Annotated[
        str | None, typer.Option("--name", metavar="NAME", help="What names in the file begin with, after sgpr_.")
    ] = None,
    robot: Annotated[
        str | None,
        typer.Option("--robot", metavar="URDF", help="For urdf: the file that the robot was read from."),
    ] = None,
) -> None:
    """Writes a model as one C99 or Rust file that needs no library, or as a robot file for other tools.

    A C or Rust file holds the robot unrolled into its formulas, the effects with their hidden states in one structure,
    and functions to reset it and to get the torque of the next sample: that of `Model.predictor` at the same rate. C
    files are included where they are used, from C or C++.

    URDF and MJCF hold bodies and friction; what else the model has and they have no place for is listed.
    """
    check_not_input(out, [model])
    loaded = load_any_model(model)
    if isinstance(loaded, SemiParametricModel):
        raise BadData(
            f"{model}: the Gaussian process of a learned model is not exported: run it with its predictor, or save "
            "its physics (model.physics_.save(...)) and export that"
        )
    of_code = {"--rate": rate, "--precision": precision, "--purpose": purpose, "--keep": keep, "--name": name}
    if language == "urdf" or language == "mjcf":
        if given := [option for option, value in of_code.items() if value is not None]:
            raise BadData(f"{', '.join(given)}: for c and rust; a robot file has no calls")
        left = write_robot_file(loaded, language, out, robot)
        output.result({"file": out, "language": language, "left_out": left})
        output.line(f"{out}: {len(loaded.robot.joint_names)} joints, bodies and friction")
        if left:
            output.note(f"{language} has no place for {', '.join(left)}")
        return
    if robot is not None:
        raise BadData("--robot: for urdf; code holds the robot of the model")
    purpose, precision = purpose or "feed_forward", precision or "double"
    loaded.export(language, out, precision=precision, name=name, rate_hz=rate, purpose=purpose, keep=keep)
    size = Path(out).stat().st_size
    settings = {"purpose": purpose, "precision": precision, "rate_hz": rate}
    output.result({"file": out, "language": language, **settings, "bytes": size})
    bits = ", numbers of 32 bits" if precision == "single" else ""
    output.line(f"{out}: {len(loaded.robot.joint_names)} joints, {purpose}{bits}, {size / 1000:.0f} kB of {language}")


def write_robot_file(model: Model, language: str, out: str, robot: str | None) -> list[str]:
    """Writes a URDF or MJCF file; what of the model it has no place for."""
    if language == "urdf":
        if robot is None:
            raise BadData("--robot: a URDF is written from the one that the robot was read from: give it")
        check_not_input(out, [robot])
        model.write_urdf(robot, out)
    else:
        if robot is not None:
            raise BadData("--robot: for urdf; mjcf is written from the model alone")
        write_page(out, model.to_mjcf())
    return without_place(language, model)
