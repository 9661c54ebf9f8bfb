"""The documentation as a site: built without a broken link, and with a page for all that it should explain."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import sgpr

ROOT = Path(__file__).resolve().parents[1]


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built without a broken link."""
    pytest.importorskip("mkdocs", reason="mkdocs is not installed: make docs")
    pytest.importorskip("material", reason="mkdocs-material is not installed: make docs")
    site = tmp_path_factory.mktemp("documentation") / "site"
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(site)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return site


# A page wider than the window, names, figures and options broken over lines, and list items without their list.
FAULTS = """() => {
  const found = [];
  const over = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  if (over > 0) found.push(`the page is ${over} px too wide`);
  for (const cell of document.querySelectorAll("article td")) {
    const written = document.createRange();
    written.selectNodeContents(cell);
    const lines = written.getBoundingClientRect().height / parseFloat(getComputedStyle(cell).lineHeight);
    if (/^[^ ]{1,12}$/.test(cell.textContent) && lines > 1.6) found.push(`broken: ${cell.textContent}`);
  }
  for (const option of document.querySelectorAll("article .option")) {
    if (option.getClientRects().length > 1) found.push(`broken: ${option.textContent}`);
  }
  for (const list of document.querySelectorAll("article ol")) {
    if (list.children.length === 1) found.push(`a list of one: ${list.textContent.slice(0, 40)}`);
  }
  return found;
}"""


@pytest.mark.parametrize("width", [400, 1280])
def test_no_page_is_too_wide_and_no_name_broken(site: Path, width: int) -> None:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no Chromium here: the site is not tested in a browser")
    faults = {}
    with playwright.sync_playwright() as program:
        browser = program.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        page = browser.new_page(viewport={"width": width, "height": 900})
        # Nothing from elsewhere: no fonts.
        page.route(re.compile("^(?!file:)"), lambda route: route.abort())
        for path in sorted(site.rglob("*.html")):
            page.goto(path.as_uri(), wait_until="domcontentloaded")
            faults[str(path.relative_to(site))] = page.evaluate(FAULTS)
        browser.close()
    assert len(faults) > 50
    assert 'class="option">--remember<' in (site / "first-hour.html").read_text()
    assert {path: found for path, found in faults.items() if found} == {}


def test_the_site_has_a_page_for_everything(site: Path) -> None:
    effects = {effect["name"] for effect in sgpr.effects()}
    assert {path.stem for path in (site / "effects").glob("*.html")} == effects | {"index"}
    assert {path.stem for path in (site / "datasets").glob("*.html")} == set(sgpr.datasets.names())
    pages = "".join(path.read_text() for path in (site / "reference" / "python").glob("*.html"))
    public = [name for name in sgpr.__all__ if not name.startswith("__")]
    assert [name for name in public if f'id="sgpr.{name}"' not in pages] == []
    commands = (site / "reference" / "command-line.html").read_text()
    assert all(f'<h2 id="sgpr-{name}"' in commands for name in ("identify", "diagnose", "data-get", "effects"))
    # What a page of docs/ is called stays its address.
    assert (site / "tutorial.html").exists() and (site / "index.html").exists()


def test_every_number_of_the_diagnosis_says_what_it_is_for() -> None:
    source = ROOT / "crates/sgpr-core/src/diagnosis"
    numbers = 0
    for path in source.rglob("*.rs"):
        lines = path.read_text().split("#[cfg(test)]")[0].splitlines()
        for above, line in zip(["", *lines], lines, strict=False):
            if re.match(r"\s*(pub(\(.*\))? )?const \w+: (?!&str)[^=]+ = ", line):
                numbers += 1
                assert above.strip().startswith("//"), f"{path.name}: {line.strip()}"
    pytest.importorskip("mkdocs", reason="mkdocs is not installed: make docs")
    sys.path.insert(0, str(ROOT / "tools"))
    from docs_site import diagnosis_numbers

    rows = [line for line in diagnosis_numbers() if line.startswith("| `")]
    assert len(rows) == numbers and not any(row.endswith("|  |") for row in rows)


def test_bold_lists_and_code_come_out_of_a_docstring() -> None:
    sys.path.insert(0, str(ROOT / "tools"))
    from docstrings import markdown, wrapped

    text = (
        "What it does, x[0].\n\nParameters\n----------\nx : array\n    Metres [m].\n\nExamples\n--------\n>>> f(1)\n2"
    )
    assert markdown(text).split("\n") == [
        "What it does, x\\[0].", "", "", "**Parameters**", "", "- `x`: array.", "  Metres \\[m].", "", "",
        "**Examples**", "", "", "```python", ">>> f(1)", "2", "```", "",
    ]  # fmt: skip
    long = "f(a: dict[str, int], *, b: tuple[int, ...] = (1, 2), " + "c: int = 0, " * 6 + "d: int = 0) -> int"
    assert wrapped("f(a)") == "f(a)"
    assert wrapped(long).split("\n")[:4] == [
        "f(",
        "    a: dict[str, int],",
        "    *,",
        "    b: tuple[int, ...] = (1, 2),",
    ]
