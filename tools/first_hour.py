"""The path of a stranger, timed: from an empty environment to a judged model on logs of their own.

    python tools/first_hour.py WHEEL FOLDER

Makes an environment and a folder with logs as in tools/own_logs.py, then runs the commands of docs/first-hour.md one
after the other. Every option that a command has must have been named by what an earlier one printed, or be one of the
four that `sgpr identify --help` marks as required or names first. Fails if a verdict that the page quotes is not what a
command says, and prints the table of that page.
"""

import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

TOOLS = Path(__file__).parent
PAGE = TOOLS.parent / "docs" / "first-hour.md"
LOGS = "monday_a.csv monday_b.csv monday_c.csv"
STEPS = [
    ("look at robot and log", "sgpr info arm.urdf monday_a.csv", 1),
    (
        "say which columns are the joints",
        "sgpr info arm.urdf monday_a.csv --columns 'position=Ax{} act pos [deg]' 'torque=Ax{} drv' --remember",
        0,
    ),
    ("identify", f"sgpr identify --robot arm.urdf --train {LOGS} --test tuesday.csv --out result", 0),
    ("what is missing", f"sgpr diagnose --robot arm.urdf --train {LOGS} --test tuesday.csv --out diagnosis", 0),
    ("judge", "sgpr compare diagnosis/model.sgpr tuesday.csv --out comparison", 0),
]
"""What is done, the command, and its exit code."""

KNOWN = {"--robot", "--train", "--test", "--out"}
"""Options that the help of every command with logs begins with."""


def main(wheel: Path, folder: Path) -> None:
    """Runs and times it all."""
    folder.mkdir(parents=True, exist_ok=False)
    place = folder / "environment"
    rows = [("make an environment and install", timed_install(wheel, place), 0)]
    work = folder / "robot"
    subprocess.run([sys.executable, TOOLS / "own_logs.py", work], check=True, capture_output=True)
    environment = {**os.environ, "PATH": f"{place / 'bin'}{os.pathsep}{os.environ['PATH']}"}
    environment.pop("PYTHONPATH", None)
    seen = ""
    for what, command, code in STEPS:
        words = shlex.split(command)
        unnamed = [word for word in words if word.startswith("--") and word not in KNOWN and word not in seen]
        begin = time.perf_counter()
        done = subprocess.run(words, cwd=work, env=environment, capture_output=True, text=True)
        rows.append((what, time.perf_counter() - begin, done.returncode))
        print(f"$ {command}\n{done.stdout}{done.stderr}", file=sys.stderr)
        if done.returncode != code or unnamed:
            sys.exit(f"{command}: exit code {done.returncode}, expected {code}; options nobody named: {unnamed}")
        seen += done.stdout + done.stderr
    wrong = [verdict for verdict in quoted(PAGE.read_text(encoding="utf-8")) if verdict not in seen]
    if wrong:
        sys.exit(f"{PAGE.name} quotes what no command says: {' '.join(wrong)}")
    print("| step | seconds |\n|---|---|")
    for what, seconds, code in rows:
        print(f"| {what}{' (refused: it says what to do)' if code else ''} | {seconds:.1f} |")
    print(f"| all | {sum(seconds for _, seconds, _ in rows):.0f} |")


def quoted(page: str) -> list[str]:
    """The verdicts on unseen logs that a page quotes."""
    return [" ".join(verdict.split()) for verdict in re.findall(r"\*(On \d+ unseen [^*]*)\*", page)]


def timed_install(wheel: Path, place: Path) -> float:
    """A new environment with the wheel and what it needs."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    pip = [place / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, wheel.resolve()], check=True)
    return time.perf_counter() - begin


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
