"""The commands and programs in the documentation run as printed."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from sgpr import datasets

ROOT = Path(__file__).resolve().parents[1]


def blocks(document: str, language: str) -> list[str]:
    text = (ROOT / document).read_text()
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def run(command: list[str], **options: object) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=environment, timeout=300, **options)


def test_the_tutorial_runs() -> None:
    commands = blocks("docs/tutorial.md", "sh")
    assert len(commands) >= 3
    for command in commands:
        done = run(["sh", "-euc", command])
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    for name in ("model.sgpr", "report.html", "predictions.csv", "identification.json"):
        assert (ROOT / "out/tutorial" / name).stat().st_size > 1000, name
    for program in blocks("docs/tutorial.md", "python"):
        done = run([sys.executable, "-c", program])
        assert done.returncode == 0, done.stderr


def test_the_page_on_excitation_runs() -> None:
    (ROOT / "out").mkdir(exist_ok=True)
    for command in blocks("docs/excitation.md", "sh"):
        done = run(["sh", "-euc", command])
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    assert (ROOT / "out/excite/trajectory.mcap").stat().st_size > 1000
    done = run([sys.executable, "-c", "\n".join(blocks("docs/excitation.md", "python"))])
    assert done.returncode == 0, done.stderr


def test_the_program_on_fleets_runs() -> None:
    done = run([sys.executable, "-c", "\n".join(blocks("docs/fleets.md", "python"))])
    assert done.returncode == 0 and done.stdout == "joint_1 True\n", done.stderr


def test_the_page_on_the_workbench_runs() -> None:
    for needed in ("scipy", "starlette", "tomlkit", "tsdownsample", "uvicorn"):
        pytest.importorskip(needed, reason="the workbench needs pip install sgpr[workbench]")
    for command in blocks("docs/workbench.md", "sh"):
        arguments = [sys.executable, "-m", *command.split(), "--no-browser"]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True, cwd=ROOT) as program:
            assert program.stdout is not None
            assert program.stdout.readline().startswith("workbench: http://127.0.0.1:")
            assert program.stdout.readline().startswith("Ctrl-C ends it")
            time.sleep(0.5)
            program.send_signal(signal.SIGINT)
            assert program.wait(20) == 0
    for text in blocks("docs/workbench.md", "python"):
        done = run([sys.executable, "-c", text])
        assert done.returncode == 0, done.stderr
        assert done.stdout.startswith("http://127.0.0.1:")


def test_the_page_on_controllers_runs() -> None:
    done = run([sys.executable, "-c", "\n".join(blocks("docs/controllers.md", "python"))])
    assert done.returncode == 0, done.stderr
    for command in blocks("docs/controllers.md", "sh"):
        done = run(["sh", "-euc", command])
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    folder = ROOT / "out/controllers"
    (folder / "arm.c").write_text("".join(blocks("docs/controllers.md", "c")))
    (folder / "arm.cpp").write_text("".join(blocks("docs/controllers.md", "cpp")))
    strict = ["-Wall", "-Wextra", "-Werror"]
    for command in (
        ["gcc", "-std=c99", *strict, str(folder / "arm.c"), "-o", str(folder / "arm"), "-lm"],
        [str(folder / "arm")],
        # What is linked with the library is tested beside it (crates/sgpr-c/tests).
        ["g++", "-std=c++17", *strict, "-fsyntax-only", "-Icrates/sgpr-c/include", str(folder / "arm.cpp")],
    ):
        done = run(command)
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"


def test_the_program_in_the_readme_runs() -> None:
    # `Model.save` makes the folder, as in a fresh clone.
    shutil.rmtree(ROOT / "out" / "readme", ignore_errors=True)
    for program in blocks("README.md", "python"):
        done = run([sys.executable, "-c", program])
        assert done.returncode == 0, done.stderr
        assert "joint_6" in done.stdout


PAGES = ("docs/index.md", "docs/online.md", "docs/gaussian-process.md", "docs/datasets.md", "docs/diagnosis.md")


@pytest.mark.parametrize(
    "page", [*PAGES, *sorted(f"docs/how-to/{path.name}" for path in ROOT.glob("docs/how-to/*.md"))]
)
def test_what_a_page_shows_runs(page: str) -> None:
    for command in blocks(page, "sh"):
        done = run(["sh", "-euc", command])
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    for program in blocks(page, "python"):
        done = run([sys.executable, "-c", program])
        assert done.returncode == 0, done.stderr


def test_every_page_with_programs_is_named_in_a_test() -> None:
    tests = "".join(path.read_text() for folder in ("tests", "crates") for path in ROOT.glob(f"{folder}/**/test_*.py"))
    with_code = [
        path.relative_to(ROOT).as_posix()
        for path in ROOT.glob("docs/*.md")
        if re.search(r"^```(sh|python)$", path.read_text(), re.MULTILINE)
    ]
    assert [page for page in with_code if page not in tests] == []


def test_the_expected_errors_on_the_page_are_those_of_the_data_sets() -> None:
    expected = dict(
        re.findall(r"^\| `(\w+)` \| .*? \| ([\d.-]+) \|", (ROOT / "docs/datasets.md").read_text(), re.MULTILINE)
    )
    measured = {name: datasets.describe(name).unseen_percent for name in datasets.names()}
    assert expected == {
        name: "-" if percent is None else f"{percent:.3g}" if percent >= 10 else f"{percent:.2f}"
        for name, percent in measured.items()
    }


def test_the_executions_on_the_page_of_fuzzing_are_those_of_its_runs() -> None:
    sums: dict[str, int] = {}
    for line in (ROOT / "fuzz/executions.txt").read_text().splitlines():
        target, count = line.split()
        sums[target] = sums.get(target, 0) + int(count)
    expected = [f"| `{target}` | {sums[target]} |" for target in sorted(sums)] + [f"| all | {sum(sums.values())} |"]
    counted = run(["make", "--silent", "fuzz-count"])
    assert counted.stdout.splitlines()[2:] == expected
    assert "\n".join(expected) in (ROOT / "fuzz/README.md").read_text()


def test_the_figures_of_the_readme_are_what_is_measured() -> None:
    done = run([sys.executable, "tools/readme.py", "--check"])
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_example_identifies_the_demo() -> None:
    done = run([sys.executable, "examples/identify.py"])
    assert done.returncode == 0, done.stderr
    errors = re.findall(r"joint_\d: +([\d.]+) -> ([\d.]+) N·m", done.stdout)
    assert len(errors) == 6
    assert all(float(after) < 0.5 * float(before) for before, after in errors)


def test_intervals_of_parameters_hold_the_truth_of_simulated_logs() -> None:
    done = run(
        [sys.executable, "examples/parameter_coverage.py", "--robots", "ur5e_like", "--seconds", "10", "--draws", "40"]
    )
    assert done.returncode == 0, done.stderr
    # Noise that remembers 0, 0.5, 0.9 and 0.97 of itself, in percent with the standard error over the draws.
    shares = [float(share) for share in re.findall(r"([\d.]+) ±", done.stdout)]
    assert len(shares) == 4
    assert all(93.0 < share < 98.5 for share in shares), shares


def test_real_robots_run_or_say_why_not(tmp_path: Path) -> None:
    done = run([sys.executable, "examples/real_robots.py", "--data", str(tmp_path), "--out", str(tmp_path / "out")])
    assert done.returncode == 1
    assert "SGPR_DATA" in done.stderr and "Traceback" not in done.stderr


PLACES = ("*.md", "docs/**/*.md", "research/*.md", "*/README.md")
DOCUMENTS = sorted({path for place in PLACES for path in ROOT.glob(place)})


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", document.read_text()):
        if not target.startswith("http"):
            assert (document.parent / target).exists(), f"{document.name}: {target}"
