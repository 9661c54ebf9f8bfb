"""Runs the notebook of the documentation, and keeps its outputs in it, figures as small pictures: `make notebook`.

    python tools/notebook.py        # needs Jupyter's nbclient and ipykernel, playwright and Chromium

A code host shows pictures but no plot of Plotly; one who runs the notebook has the plots themselves.
"""

import base64
import json
import os
import shutil
from pathlib import Path
from typing import Any

import nbclient
import nbformat
from playwright.sync_api import sync_playwright
from sgpr.report.page import plotly_source

NOTEBOOK = Path(__file__).resolve().parents[1] / "docs" / "diagnosis.ipynb"
PLOTLY = "application/vnd.plotly.v1+json"
WIDTH, HEIGHT = 760, 360


def main() -> None:
    # Without the real logs, which are others' and stay where they are.
    os.environ.pop("SGPR_DATA", None)
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(NOTEBOOK.parent)}}).execute()
    with sync_playwright() as program:
        browser = program.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page()
        page.set_content("<div id=place></div>")
        page.add_script_tag(content=plotly_source())
        for cell in notebook.cells:
            for output in cell.get("outputs", []):
                keep(output, page)
            cell.metadata.pop("execution", None)
        browser.close()
    notebook.metadata.pop("language_info", None)
    nbformat.write(notebook, NOTEBOOK)
    print(f"{NOTEBOOK}: {NOTEBOOK.stat().st_size / 1e3:.0f} kB")


def keep(output: Any, page: Any) -> None:
    """A picture in place of a plot, and no names of folders."""
    data = output.get("data", {})
    if PLOTLY in data:
        picture = page.evaluate(
            """([figure, width, height]) => {
                const {data, layout} = JSON.parse(figure);
                for (const line of data) if (line.type === "scattergl") line.type = "scatter";
                return Plotly.newPlot("place", data, {...layout, width, height: layout.height ?? height})
                    .then((place) => Plotly.toImage(place, {format: "png", width, height: layout.height ?? height}));
            }""",
            [json.dumps(data[PLOTLY]), WIDTH, HEIGHT],
        )
        content = base64.b64decode(picture.split(",", 1)[1])
        output["data"] = {"image/png": base64.b64encode(content).decode(), "text/plain": "the figure"}


if __name__ == "__main__":
    main()
