"""The reports in a real browser: every plot is drawn, nothing is loaded, nothing fails."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sgpr
from cli_support import DEMO, DEMO_ROBOT, DEMO_TEST, DEMO_TRAIN, run

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
LARGEST_WITHOUT_DATA = 2_000_000


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("demo")
    logs = ("--train", *DEMO_TRAIN, "--test", DEMO_TEST)
    assert run("identify", "--robot", DEMO_ROBOT, *logs, "--out", out / "identify", "--quiet").code == 0
    model = out / "identify" / "model.sgpr"
    limits = ("--limit", "fit_percent=50", "joint_1:rmse=0.001")
    deep = out / "a folder of logs whose name is longer than a telephone is wide" / "train.csv.gz"
    deep.parent.mkdir()
    shutil.copy(DEMO_TRAIN[0], deep)
    arguments = (model, DEMO_TEST, deep, "--against", DEMO_ROBOT, *limits, "--out", out / "compare", "--quiet")
    assert run("compare", *arguments).code == 0
    small = ("--points", 40, "--inputs", "own_velocity", "--quiet")
    assert run("learn", "--robot", DEMO_ROBOT, *logs, *small, "--out", out / "learn").code == 0
    return out


@pytest.fixture(scope="module")
def pages(results: Path) -> Path:
    """Folders with a report each: those of `results`, and what the other commands write."""
    hidden = DEMO.parent / "hidden"
    logs = ("--train", hidden / "train_1.csv.gz", hidden / "train_3.csv.gz", "--test", hidden / "test.csv.gz")
    model = ("--effects", "viscous_friction", "coulomb_friction", "rotor_inertia")
    found = run("diagnose", "--robot", hidden / "robot.urdf", *logs, *model, "--out", results / "diagnose", "--quiet")
    assert found.code == 0, found.err
    sessions = [f"{name}={log}" for name, log in zip(("monday", "tuesday"), DEMO_TRAIN, strict=False)]
    found = run("sessions", "--robot", DEMO_ROBOT, "--logs", *sessions, "--out", results / "sessions", "--quiet")
    assert found.code == 0, found.err
    limits = ("--max-acceleration", 4, "--max-velocity", 2, "--max-torque", 100, "--position-range", -1, 1)
    search = ("--starts", 1, "--evaluations", 20, "--quiet")
    assert run("excite", "--robot", "puma560", *limits, *search, "--out", results / "excite").code == 0
    return results


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no Chromium here: the reports are not tested in a browser")
    with playwright.sync_playwright() as program:
        browser = program.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        yield browser
        browser.close()


# Of each plot: text that leaves it, text on text, and no room for the plot beside its labels. Of each table: figures
# that are broken over lines, a first column that hides the rest, and high rows for a cell out of sight.
FAULTS = """() => {
  const found = [];
  const size = (element) => element.getBoundingClientRect();
  for (const plot of document.querySelectorAll(".js-plotly-plot")) {
    const box = size(plot);
    const texts = [...plot.querySelectorAll(".main-svg text")]
      .filter((text) => text.textContent.trim() && size(text).width > 0)
      .map((text) => [size(text), text.textContent]);
    for (const [at, text] of texts) {
      if (at.left < box.left - 1 || at.right > box.right + 1 || at.top < box.top - 1 || at.bottom > box.bottom + 1)
        found.push(`${plot.id}: cut: ${text}`);
    }
    texts.forEach(([a, one], k) => texts.slice(k + 1).forEach(([b, other]) => {
      const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (wide > 2 && high > 3) found.push(`${plot.id}: ${one} covers ${other}`);
    }));
    const inner = plot.querySelector(".nsewdrag");
    if (!inner || size(inner).width < 150) found.push(`${plot.id}: no room`);
  }
  for (const cell of document.querySelectorAll("td:not(.text), dd")) {
    const written = document.createRange();
    written.selectNodeContents(cell);
    if (/^[^ ]{1,12}$/.test(cell.textContent) && size(written).height > 30) found.push(`broken: ${cell.textContent}`);
  }
  for (const table of document.querySelectorAll(".wide")) {
    const name = table.querySelector("tbody th");
    if (name && table.clientWidth < table.scrollWidth && size(name).width > 0.75 * table.clientWidth)
      found.push(`only names: ${name.textContent}`);
    // Nobody sees why the rows are that high.
    if (table.clientWidth < table.scrollWidth)
      for (const cell of table.querySelectorAll("td"))
        if (size(cell).height > 160 && size(cell).left > size(table).right) found.push(`high: ${cell.textContent}`);
  }
  const over = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  if (over > 0) found.push(`the page is ${over} px too wide`);
  return found;
}"""


@pytest.mark.parametrize("command", ["identify", "compare", "learn", "diagnose", "sessions", "excite"])
@pytest.mark.parametrize("width", [400, 1280])
def test_nothing_is_cut_or_covered(pages: Path, browser: Any, command: str, width: int) -> None:
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.goto((pages / command / "report.html").as_uri())
    assert page.evaluate(FAULTS) == []
    page.close()


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a small fleet."""
    pytest.importorskip("pyarrow", reason="fleets need the extra `fleet`")
    out = tmp_path_factory.mktemp("fleet")
    robots = ("--robot", "two_link=two_link", "--quiet")
    assert run("fleet", "simulate", *robots, "--arms", 3, "--days", 4, "--out", out / "logs").code == 0
    found = run("fleet", "run", out / "logs" / "fleet.csv", *robots, "--out", out / "records")
    assert found.code == 0, found.err
    assert run("fleet", "report", out / "records", *robots, "--out", out / "page").code == 0
    return out / "page" / "report.html"


@pytest.mark.parametrize("width", [400, 1280])
def test_nothing_of_a_fleet_is_cut_or_covered(fleet: Path, browser: Any, width: int) -> None:
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.goto(fleet.as_uri())
    assert page.evaluate(FAULTS) == []
    page.close()


@pytest.mark.parametrize("command", ["identify", "compare", "learn"])
@pytest.mark.parametrize("width", [1400, 800])
def test_report(results: Path, browser: Any, command: str, width: int) -> None:
    path = results / command / "report.html"
    page = browser.new_page(viewport={"width": width, "height": 900})
    problems: list[str] = []
    requests: list[str] = []
    page.on("console", lambda message: problems.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(path.as_uri())
    plots = page.locator(".plot")
    assert plots.count() == page.locator(".plot .main-svg:first-child").count() > 6
    assert [joint for joint in range(6) if page.locator(f"#torque-{joint} .lines path").count() == 0] == []
    text = page.inner_text("body")
    assert all(f"joint_{number}" in text for number in range(1, 7))
    overflow = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
    assert overflow <= 0
    buttons = page.eval_on_selector_all(".modebar-btn", "all => all.map(each => each.getAttribute('data-title'))")
    assert "Zoom" in buttons
    assert not [title for title in buttons if "hare" in title or "loud" in title or "tudio" in title]
    # Zooming draws finer data at all joints, the selections change the plots.
    page.evaluate("Plotly.relayout('torque-0', {'xaxis.range': [5, 6]})")
    page.wait_for_function("document.getElementById('torque-5').data[0].x.length < 700")
    assert page.evaluate("document.getElementById('torque-3').layout.xaxis.range") == [5, 6]
    page.evaluate("Plotly.relayout('torque-3', {'xaxis.autorange': true})")
    page.wait_for_function("document.getElementById('torque-0').layout.xaxis.range[1] > 19")
    for select in page.locator("select:visible").all():
        select.select_option(index=1)
    assert page.locator("#torque-0 .lines path").count() > 0
    page.close()
    assert problems == []
    assert requests == [path.as_uri()]


def test_residual_against_any_variable(results: Path, browser: Any) -> None:
    page = browser.new_page()
    page.goto((results / "compare" / "report.html").as_uri())
    plot = "document.getElementById('residual-plot')"
    axes = f"[{plot}.layout.xaxis.title.text, {plot}.layout.yaxis.title.text]"
    page.locator("#residual-joint").select_option(label="joint_4")
    assert page.evaluate(axes) == ["speed of joint_4 [rad/s]", "residual of joint_4 [N·m]"]
    page.locator("#residual-x").select_option(label="position of joint_2 [rad]")
    page.locator("#residual-log").select_option(index=1)
    x, y = page.evaluate(f"[Array.from({plot}.data[1].x), Array.from({plot}.data[1].y)]")
    assert page.evaluate(axes)[0] == "position of joint_2 [rad]"
    page.close()
    # The same samples from the library: those of the page are every n-th of them.
    model = sgpr.load(results / "identify" / "model.sgpr")
    [log] = sgpr.compare(model, [sgpr.read(DEMO_TEST, model.robot.joint_names)]).logs
    residual = (log.measured_in_band - log.predicted_in_band)[:, 3]
    for k in range(0, len(x), 97):
        nearest = np.argmin(
            np.abs(log.q[:, 1] - x[k]) + np.where(log.counted[:, 3], 0.0, np.inf) + np.abs(residual - y[k])
        )
        assert abs(log.q[nearest, 1] - x[k]) < 1e-6 and abs(residual[nearest] - y[k]) < 1e-5


def test_a_page_is_small_without_its_data(results: Path) -> None:
    for command in ("identify", "compare", "learn"):
        text = (results / command / "report.html").read_text()
        data = re.search(r'<script type="application/json" id="payload">(.*?)</script>', text, re.DOTALL)
        assert data is not None and len(text) - len(data.group(1)) < LARGEST_WITHOUT_DATA


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours(results: Path, browser: Any, scheme: str) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    page = browser.new_page(color_scheme=scheme, bypass_csp=True)
    page.goto((results / "compare" / "report.html").as_uri())
    page.wait_for_selector("#torque-5 .lines path")
    paper = "getComputedStyle(document.querySelector('#torque-0 .main-svg')).backgroundColor"
    ink = "getComputedStyle(document.body).color"
    light = {"light": "rgb(255, 255, 255)", "dark": "rgb(13, 17, 23)"}
    assert page.evaluate(paper) == light[scheme]
    found = axe.Axe().run(page).response["violations"]
    assert not [
        f"{one['id']}: {one['nodes'][0]['html'][:200]}" for one in found if one["impact"] in ("serious", "critical")
    ]
    # Paper is white.
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(paper) == light["light"]
    assert page.evaluate(ink) == "rgb(31, 35, 40)"
    page.close()


def test_text_of_the_report(results: Path) -> None:
    text = (results / "identify" / "report.html").read_text()
    text = text[: text.index('id="payload"')]
    for heading in (
        "Errors on unseen logs",
        "Parameters",
        "Excitation",
        "Signal processing",
        "Data quality",
        "Settings",
    ):
        assert heading in text
    for joint in range(1, 7):
        assert f"joint_{joint}.Fv" in text
    assert "http" not in text.replace("http-equiv", "")
    text = (results / "compare" / "report.html").read_text()
    assert "limits not met" in text
