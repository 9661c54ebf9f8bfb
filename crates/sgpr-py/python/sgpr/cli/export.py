"""`sgpr export`: a model as a source file for a controller."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from .. import SemiParametricModel
from .console import Output
from .errors import BadData
from .inputs import load_any_model
from .options import check_not_input


def export(
    model: Annotated[
        str, typer.Argument(metavar="MODEL", help="A saved model (.sgpr), or a robot for its file's model.")
    ],
    output: Output,
    language: Annotated[Literal["c", "rust"], typer.Option("--language", help="Language of the file.")],
    out: Annotated[str, typer.Option("--out", metavar="FILE", help="The file: arm.h, arm.rs.")],
    rate: Annotated[
        float | None,
        typer.Option("--rate", metavar="HZ", help="Rate of the calls; effects of time, delays and lags need it."),
    ] = None,
    purpose: Annotated[
        Literal["feed_forward", "expected_measurement"],
        typer.Option("--purpose", help="What the arm needs, or what its log would show."),
    ] = "feed_forward",
    keep: Annotated[
        list[str] | None,
        typer.Option("--keep", metavar="EFFECT...", help="Effects that a feed-forward torque holds all the same."),
    ] = None,
    name: Annotated[
        str | None, typer.Option("--name", metavar="NAME", help="What names in the file begin with, after sgpr_.")
    ] = None,
) -> None:
    """Writes a model as one C99 or Rust file that needs no library, for a controller.

    The file holds the robot unrolled into its formulas, the effects with their hidden states in one structure, and
    functions to reset it and to get the torque of the next sample: that of `Model.predictor` at the same rate. C
    files are included where they are used, from C or C++.
    """
    check_not_input(out, [model])
    loaded = load_any_model(model)
    if isinstance(loaded, SemiParametricModel):
        raise BadData(
            f"{model}: the Gaussian process of a learned model is not exported: run it with its predictor, or save "
            "its physics (model.physics_.save(...)) and export that"
        )
    loaded.export(language, out, name=name, rate_hz=rate, purpose=purpose, keep=keep)
    size = Path(out).stat().st_size
    output.result({"file": out, "language": language, "purpose": purpose, "rate_hz": rate, "bytes": size})
    output.line(f"{out}: {len(loaded.robot.joint_names)} joints, {purpose}, {size / 1000:.0f} kB of {language}")
