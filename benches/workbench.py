"""Memory, first page, zoom and cursor of the workbench with a log of 1 000 000 samples of seven joints.

python benches/workbench.py            # needs sgpr[workbench], playwright and Chromium
"""

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import sgpr
from playwright.sync_api import sync_playwright

SAMPLES, SHORT, RATE = 1_000_000, 40_000, 1000.0
JOINTS = 7
ZOOMS = 20

LINK = """<link name="l{k}"><inertial><origin xyz="0.01 0.02 0.1"/><mass value="{mass}"/>
<inertia ixx="0.03" iyy="0.025" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint_{k}" type="revolute"><parent link="l{before}"/><child link="l{k}"/><origin xyz="0 0 0.25"/>
<axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="3" effort="200"/></joint>"""


def write_arm(folder: Path) -> None:
    """A robot with seven joints, a log to train and a long one to test."""
    links = [
        LINK.format(k=k, before=k - 1, mass=6 - 0.7 * k, axis="0 0 1" if k % 2 else "0 1 0")
        for k in range(1, JOINTS + 1)
    ]
    (folder / "arm.urdf").write_text(f'<robot name="arm"><link name="l0"/>{"".join(links)}</robot>')
    robot = sgpr.Robot.from_urdf(folder / "arm.urdf")
    rng = np.random.default_rng(1)
    for name, count in (("train.npz", SHORT), ("test.npz", SAMPLES)):
        t = np.arange(count) / RATE
        q, dq, ddq = (np.zeros((count, JOINTS)) for _ in range(3))
        for k in range(JOINTS):
            for speed, phase in zip(rng.uniform(0.5, 3.0, 4), rng.uniform(0.0, 6.0, 4), strict=True):
                q[:, k] += 0.3 * np.sin(speed * t + phase)
                dq[:, k] += 0.3 * speed * np.cos(speed * t + phase)
                ddq[:, k] -= 0.3 * speed**2 * np.sin(speed * t + phase)
        tau = robot.inverse_dynamics(q, dq, ddq) + 2.0 * np.sign(dq) + 3.0 * dq + np.sin(6.0 * q)
        tau += 0.05 * rng.standard_normal(tau.shape)
        np.savez(folder / name, t=t, q=q, dq=dq, tau=tau, joint_names=np.array(robot.joint_names))


def memory(process: subprocess.Popen[str]) -> dict[str, float]:
    """Now, and at most so far, GB (10⁹ bytes)."""
    lines = dict(
        line.split(":")
        for line in Path(f"/proc/{process.pid}/status").read_text().splitlines()
        if "VmHWM" in line or "VmRSS" in line
    )
    return {key: round(int(value.split()[0]) * 1024 / 1e9, 3) for key, value in lines.items()}


def main() -> None:
    folder = Path(tempfile.mkdtemp(prefix="sgpr-bench-"))
    try:
        write_arm(folder)
        command = [sys.executable, "-m", "sgpr", "workbench", str(folder), "--no-browser"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            measured(process)
        finally:
            process.terminate()
            process.wait(10)
    finally:
        shutil.rmtree(folder)


MOVES = """() => {
  const place = document.getElementById("joint-0"), box = place.getBoundingClientRect();
  let most = 0;
  for (let k = 0; k < 100; k++) {
    const begun = performance.now(), at = {clientX: box.left + 80 + k * 10, clientY: box.top + 20};
    place.dispatchEvent(new MouseEvent("mousemove", {bubbles: true, ...at}));
    place.getBoundingClientRect();
    most = Math.max(most, performance.now() - begun);
  }
  return most;
}"""


class Figures(dict[str, Any]):
    """Figures that are printed as they come."""

    def __setitem__(self, key: str, value: Any) -> None:
        print(f"{key}: {value}", flush=True)
        super().__setitem__(key, value)


def measured(process: subprocess.Popen[str]) -> dict[str, Any]:
    """All figures."""
    assert process.stdout is not None
    url = next(word for line in process.stdout for word in line.split() if word.startswith("http://"))
    found = Figures()
    with sync_playwright() as program:
        browser = program.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1400, "height": 900}, bypass_csp=True)
        page.set_default_timeout(300_000)
        page.goto(url)
        page.wait_for_selector("main h2")
        found["first page, s, of the browser"] = page.evaluate("performance.now()") / 1e3
        idle(page)
        found["read"] = memory(process)
        page.get_by_role("button", name="Fit the model").click()
        page.locator("text=with the robot file it is").wait_for()
        idle(page)
        found["fit"] = memory(process)
        page.get_by_label("robot file").first.check()
        page.wait_for_timeout(2000)
        found["zoom, ms"] = zooms(page)
        found["cursor, ms"] = cursor(page)
        page.get_by_role("navigation").get_by_role("button", name="Where it fails").click()
        page.locator("#correlation .main-svg").first.wait_for()
        found["where it fails"] = memory(process)
        page.get_by_role("navigation").get_by_role("button", name="What is missing").click()
        hand = page.get_by_role("region", name="Add by hand")
        hand.get_by_label("Effect").select_option("torque_ripple")
        hand.get_by_role("button", name="Add").click()
        idle(page)
        found["answer"] = page.locator(".verdict").first.inner_text()
        found["effect added"] = memory(process)
        browser.close()
    return found


def idle(page: Any) -> None:
    page.wait_for_timeout(1500)
    page.wait_for_function("!document.getElementById('job').textContent")


def zooms(page: Any) -> dict[str, float]:
    """From a click to the frame in which all joints in view are drawn."""
    times = []
    for k in range(ZOOMS):
        before = page.evaluate("document.body.dataset.drawn")
        page.evaluate("document.body.dataset.zoom = ''")
        page.get_by_role("button", name="Zoom in" if k % 10 < 5 else "Zoom out").click()
        page.wait_for_function(f"document.body.dataset.drawn !== '{before}'")
        times.append(float(page.evaluate("document.body.dataset.zoom")))
    return {"median": statistics.median(times), "largest": max(times)}


def cursor(page: Any) -> float:
    """The longest that the page needs for a movement of the mouse."""
    return float(page.evaluate(MOVES))


if __name__ == "__main__":
    begun = time.monotonic()
    main()
    print(f"{time.monotonic() - begun:.0f} s in all")
