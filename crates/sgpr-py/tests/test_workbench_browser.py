"""The workbench in a real browser: from a folder to the effect that it lacks, and every stage at two widths."""

import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_support import DEMO
from sgpr._workbench import missing
from sgpr._workbench.running import Workbench
from test_report_browser import CHROMIUM, QUIET
from test_workbench import EFFECTS, write_arm

PICTURES = os.environ.get("SGPR_PICTURES")
"""Where to put pictures of the six clicks for docs/workbench.md, if they are to be made again."""

STAGES = (
    "Robot and logs",
    "Check and split",
    "Fit",
    "Compare",
    "Where it fails",
    "What is missing",
    "Add, watch, take back",
    "Take away",
)
SERIOUS = ("serious", "critical")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no Chromium here: the workbench is not tested in a browser")
    with playwright.sync_playwright() as program:
        browser = program.chromium.launch(executable_path=CHROMIUM, args=QUIET)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workbench]:
    """The two-link arm with a fit, a diagnosis and two branches."""
    running = Workbench([str(write_arm(tmp_path_factory.mktemp("browser") / "arm"))]).start()
    bench = running.bench
    bench.work.wait(60.0)
    bench.fit(EFFECTS)
    bench.work.wait(60.0)
    bench.diagnose()
    bench.work.wait(120.0)
    for effect in ("cable_stiffness@joint_2", "torque_ripple@joint_2"):
        bench.add([effect], after="m1")
        bench.work.wait(60.0)
    bench.use("m1")
    assert bench.message is None
    yield running
    running.stop()


class Tab:
    """A page with what went wrong in it."""

    def __init__(self, browser: Any, url: str, width: int, **settings: Any) -> None:
        self.page = browser.new_page(viewport={"width": width, "height": 900}, **settings)
        self.problems: list[str] = []
        self.strangers: list[str] = []
        host = url.split("/?")[0]
        self.page.on("console", lambda m: self.problems.append(m.text) if m.type in ("error", "warning") else None)
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on(
            "request", lambda r: None if r.url.startswith((host, "blob:", "data:")) else self.strangers.append(r.url)
        )
        self.page.goto(url)
        self.page.wait_for_selector("main h2")

    def stage(self, name: str) -> None:
        self.page.get_by_role("navigation").get_by_role("button", name=name, exact=False).first.click()
        self.page.get_by_role("heading", name=name, level=2).wait_for()

    def settled(self) -> None:
        """Waits for the plots of a stage."""
        for _ in range(100):
            places = self.page.locator(".joint, .two > div[id]")
            if (
                places.count()
                == self.page.locator(".joint .main-svg:first-child, .two > div[id] .main-svg:first-child").count()
            ):
                return
            time.sleep(0.1)
        raise AssertionError("plots are missing")

    def close(self) -> None:
        self.page.close()
        assert self.problems == []
        assert self.strangers == []


def test_six_clicks(browser: Any, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(DEMO, tmp_path / "demo"))
    (folder / "sgpr.toml").unlink(missing_ok=True)
    running = Workbench([str(folder)]).start()
    begun = time.monotonic()
    tab = Tab(browser, running.url, 1400)
    page = tab.page

    def picture(name: str) -> None:
        if PICTURES:
            page.screenshot(path=str(Path(PICTURES) / f"workbench_{name}.png"))

    findings = page.locator("p", has_text="belongs to no real body")
    assert findings.first.locator("code").inner_text() == "joint_1"
    fit = page.locator("button:enabled", has_text="Fit the model")
    page.get_by_role("progressbar").wait_for(state="detached")
    fit.wait_for()
    picture("robot")
    fit.click()
    page.locator("text=with the robot file it is").wait_for()
    tab.settled()
    picture("compare")
    page.get_by_role("button", name="What is missing?").click()
    page.locator(".card").first.wait_for(timeout=240_000)
    assert "coulomb transition at joint_4" in page.locator(".card").first.inner_text()
    picture("missing")
    page.locator(".card button.main").first.click()
    page.locator(".verdict", has_text="falls by").wait_for(timeout=120_000)
    seconds = time.monotonic() - begun
    picture("added")
    text = page.locator(".verdict").inner_text()
    assert "the error of joint_4 falls by" in text and "on logs that no step has seen" in text
    share = float(text.split("falls by")[1].split("%")[0])
    steps = {step["id"]: step["errors"]["test"]["joints"][3]["rmse"] for step in running.bench.to_dict()["steps"]}
    assert share >= 85.0 and abs(share - 100.0 * (1.0 - steps["m2"] / steps["m1"])) < 1.0
    print(f"three clicks, {seconds:.1f} s, the error of joint_4 down by {share:g} %")
    tab.stage("Take away")
    for name, beginning in (("model.h", b"/*"), ("model.rs", b"//"), ("report.html", b"<!DOCTYPE html>")):
        with page.expect_download() as waiting:
            page.get_by_role("button", name=f"({name})").click()
        assert Path(waiting.value.path()).read_bytes().startswith(beginning)
    tab.stage("Add, watch, take back")
    page.get_by_role("button", name="Take it back").click()
    page.locator(".verdict", has_text="The current model is “fit”").wait_for()
    tab.close()
    running.stop()


def test_steps_on_a_telephone(browser: Any, arm: Workbench) -> None:
    tab = Tab(browser, arm.url, 400)
    tab.stage("Add, watch, take back")
    name = tab.page.get_by_label("Name of robot file")
    assert name.bounding_box()["width"] < 200, "no room for the error beside it"
    tab.close()


@pytest.mark.parametrize("width", [1400, 800])
def test_every_stage(browser: Any, arm: Workbench, width: int) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    # The checker is put into the page as text, which the page itself forbids: not for this one test.
    tab = Tab(browser, arm.url, width, bypass_csp=True)
    for name in STAGES:
        tab.stage(name)
        tab.settled()
        overflow = tab.page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        assert overflow <= 0, f"{name} is wider than {width} px"
        assert "`" not in tab.page.inner_text("main"), name
        answer = axe.Axe().run(tab.page).response
        assert len(answer["passes"]) > 10
        found = answer["violations"]
        faults = [f"{one['id']}: {one['nodes'][0]['html'][:200]}" for one in found if one["impact"] in SERIOUS]
        assert not faults, f"{name}: {faults}"
    tab.close()


def test_zoom_is_linked_and_ends_at_raw_samples(browser: Any, arm: Workbench) -> None:
    tab = Tab(browser, arm.url, 1400)
    page = tab.page
    tab.stage("Compare")
    tab.settled()
    ranges = "[...document.querySelectorAll('.joint')].map((place) => place.layout.xaxis.range)"

    def drawn() -> int:
        return int(page.evaluate("Number(document.body.dataset.drawn ?? 0)"))

    def after(action: Any) -> None:
        before = drawn()
        action()
        for _ in range(100):
            if drawn() > before:
                return
            time.sleep(0.05)
        raise AssertionError("nothing was drawn")

    box = page.locator("#joint-0").bounding_box()

    def drag() -> None:
        page.mouse.move(box["x"] + 300, box["y"] + 40)
        page.mouse.down()
        page.mouse.move(box["x"] + 420, box["y"] + 42, steps=4)
        page.mouse.up()

    after(drag)
    first, second = page.evaluate(ranges)
    assert first == second and 0.0 < first[0] < first[1] < 19.0
    page.locator("#joint-1").focus()
    after(lambda: page.keyboard.press("+"))
    narrow = page.evaluate(ranges)[0]
    assert abs((narrow[1] - narrow[0]) - 0.5 * (first[1] - first[0])) < 1e-6
    assert "Every sample is drawn" in page.inner_text(".readout")
    x = page.evaluate("Array.from(document.getElementById('joint-0').data[0].x)")
    assert abs((x[1] - x[0]) - 0.01) < 1e-9
    page.mouse.move(box["x"] + 500, box["y"] + 60)
    assert page.locator(".cursor").is_visible() and "joint_1 at" in page.inner_text(".readout")
    after(lambda: page.get_by_label("with <b>").or_(page.get_by_label("robot file")).first.check())
    assert page.evaluate("document.getElementById('joint-0').data.length") > 2
    after(lambda: page.get_by_label("robot file").first.uncheck())
    tab.close()


def test_brushing_marks_the_same_samples(browser: Any, arm: Workbench) -> None:
    tab = Tab(browser, arm.url, 1400)
    page = tab.page
    tab.stage("Where it fails")
    page.get_by_label("Residual of").select_option("joint_2")
    page.get_by_label("against").select_option("q:1")
    page.locator("#correlation .main-svg").first.wait_for()
    tab.settled()
    time.sleep(0.5)
    box = page.locator("#against").bounding_box()
    page.mouse.move(box["x"] + 0.70 * box["width"], box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.95 * box["width"], box["y"] + 300, steps=6)
    page.mouse.up()
    page.locator(".verdict", has_text="of the squared error of joint_2").wait_for()
    picked = "(id) => { const t = document.getElementById(id).data.find((t) => t.name === 'picked'); return t.y; }"
    for _ in range(50):
        names = page.evaluate("document.getElementById('against-too').data.map((t) => t.name)")
        if "picked" in names:
            break
        time.sleep(0.1)
    first, second = page.evaluate(picked, "against"), page.evaluate(picked, "against-too")
    assert len(first) > 10 and first == second
    page.get_by_role("button", name="Pick nothing").last.click()
    page.locator(".verdict").wait_for(state="detached")
    tab.close()


def test_names_are_shown_as_text(browser: Any, arm: Workbench) -> None:
    name = '<img src=x onerror="document.title=1"> "quoted" & <b>'
    tab = Tab(browser, arm.url, 800)
    page = tab.page
    tab.stage("Add, watch, take back")
    field = page.get_by_label("Name of torque ripple at joint_2")
    field.fill(name)
    field.press("Enter")
    page.get_by_label(f"Name of {name}").wait_for()
    for stage in ("Compare", "Where it fails", "Add, watch, take back"):
        tab.stage(stage)
        tab.settled()
        assert page.locator("main img").count() == 0
    assert page.title() != "1"
    step = next(step for step in arm.bench.ladder.steps.values() if step.name == name)
    arm.bench.rename(step.id, "torque ripple at joint_2")
    tab.close()


def test_keyboard_alone(browser: Any, arm: Workbench) -> None:
    tab = Tab(browser, arm.url, 1400)
    page = tab.page
    tab.stage("Robot and logs")
    reached = set()
    page.locator("body").press("Tab")
    for _ in range(60):
        reached.add(page.evaluate("document.activeElement.textContent.trim() || document.activeElement.id"))
        page.keyboard.press("Tab")
    assert {"Compare the models", "files"} <= reached and any("Where it fails" in each for each in reached)
    page.get_by_role("button", name="Compare the models").focus()
    page.keyboard.press("Enter")
    page.get_by_role("heading", name="Compare", level=2).wait_for()
    tab.close()


def test_a_server_that_ends_is_said(browser: Any, tmp_path: Path) -> None:
    running = Workbench([str(write_arm(tmp_path / "arm"))]).start()
    running.bench.work.wait(60.0)
    tab = Tab(browser, running.url, 1400)
    running.stop()
    tab.page.locator("[role=alert]", has_text="Nothing is lost").wait_for(timeout=15_000)
    tab.problems.clear()
    tab.close()


def test_a_log_that_stops_a_fit_is_repaired_by_clicks(browser: Any, tmp_path: Path) -> None:
    folder = write_arm(tmp_path / "arm")
    rng = np.random.default_rng(4)
    for path in folder.glob("t*.csv"):
        head, *rows = path.read_text().splitlines()
        times = [row.split(",", 1) for row in rows]
        jitter = 0.004 * rng.uniform(-1.0, 1.0, len(rows))
        lines = [f"{float(t) + dt:.6f},{rest}" for (t, rest), dt in zip(times, jitter, strict=True)]
        path.write_text("\n".join([head, *lines]) + "\n")
    running = Workbench([str(folder)]).start()
    tab = Tab(browser, running.url, 1400)
    page = tab.page
    page.locator(".verdict.bad", has_text="have to be repaired").wait_for()
    page.get_by_role("button", name=re.compile("^Resample at [0-9.]+ Hz$")).click()
    page.locator(".verdict:not(.bad)").wait_for()
    page.locator("button:enabled", has_text="Fit the model").click()
    page.locator("text=with the robot file it is").wait_for()
    tab.close()
    running.stop()


def test_what_is_known_stays_after_a_cancel(browser: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def endless(*logs: Any, progress: Callable[[str, int, int], object], **options: Any) -> None:
        for step in range(10_000):
            progress("a search", step, 10_000)
            time.sleep(0.01)

    monkeypatch.setattr(missing, "diagnose", endless)
    running = Workbench([str(write_arm(tmp_path / "arm"))]).start()
    running.bench.work.wait(60.0)
    running.bench.fit(EFFECTS)
    running.bench.work.wait(60.0)
    tab = Tab(browser, running.url, 1400)
    page = tab.page
    tab.stage("What is missing")
    page.get_by_role("button", name="Look for it").click()
    page.locator("li", has_text="joint_2: ").wait_for()
    page.get_by_role("button", name="Cancel").click()
    page.locator("text=What was known when the search was stopped").wait_for()
    assert "joint_2: " in page.inner_text("main")
    tab.close()
    running.stop()
