"""`sgpr reproduce`: published experiments, run again."""

from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from ..report.numbers import significant
from .console import Output, to_json
from .errors import BadData, one_of
from .output_folder import OutputFolder
from .results import headed

WORKS = ("thesis",)


def reproduce(
    work: Annotated[str, typer.Argument(metavar="thesis", help="What to reproduce.")],
    output: Output,
    out: Annotated[
        str, typer.Option("--out", metavar="DIR", help="Folder for the results; an existing one is reused.")
    ],
    short: Annotated[bool, typer.Option("--short", help="Fewer searches and shorter experiments.")] = False,
    page: Annotated[
        str | None, typer.Option("--page", metavar="FILE", help="Also write the tables as a Markdown page here.")
    ] = None,
) -> None:
    """Runs every experiment of the thesis behind this library, and sets its numbers beside ours.

    Writes to DIR: thesis.json, thesis.md (the tables) and report.html (the figures). Needs the package examples/thesis
    of the repository.
    """
    one_of(work, WORKS, "thesis", "work")
    try:
        # Another package, which needs this one.
        works: Any = import_module("sgpr_thesis")
    except ImportError:
        raise BadData(
            "the experiments of the thesis are a package of their own: pip install examples/thesis, in the repository "
            "of sgpr"
        ) from None
    folder = OutputFolder(out)
    thesis = works.run(works.Settings.short() if short else works.Settings(), output.note)
    data: dict[str, Any] = headed(
        "reproduce",
        work=work,
        short=short,
        **thesis.data,
    )
    text = works.markdown(thesis)
    with folder:
        folder.write("thesis.json", to_json(data))
        folder.write("thesis.md", text)
        folder.write("report.html", works.html(thesis, data))
        if page is not None:
            folder.write(str(Path(page).absolute()), text)
    deviation = 100.0 * thesis.data["case_2"]["largest_deviation"]
    output.heading(f"Case 2: the error of the internal model is recovered within {significant(deviation)} %")
    rows = [
        [row["motion"], significant(sum(row["published"])), *(significant(e.sum()) for e in row["errors"].values())]
        for row in thesis.data["table_5_8"]
    ]
    output.table(["trained on", "thesis", *thesis.data["table_5_8"][0]["errors"]], rows)
    output.line(f"results: {Path(out)}")
    output.result(data)
