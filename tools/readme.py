"""The figures of README.md, measured again and written into it: `make readme`.

    python tools/readme.py [--check]

With --check nothing is written; the program ends with 1 if the page says something else than what was measured.
"""

import json
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from sgpr.cli import main

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "README.md"
DEMO, HIDDEN = ROOT / "data" / "demo", ROOT / "data" / "hidden"
EFFECTS = ("--effects", "viscous_friction", "coulomb_friction", "rotor_inertia")


def run(*arguments: object) -> None:
    """A command of sgpr, without a word."""
    try:
        main([*map(str, arguments), "--quiet", "--no-report"])
    except SystemExit as end:
        if end.code:
            raise


def demo(work: Path) -> str:
    """Errors of robot file and identified model by joint."""
    train = [DEMO / f"train_{number}.csv.gz" for number in (1, 2, 3)]
    logs = ["--robot", DEMO / "robot.urdf", "--train", *train, "--test", DEMO / "test.csv.gz"]
    run("identify", *logs, *EFFECTS, "--out", work)
    comparison = json.loads((work / "identification.json").read_text())["comparison"]
    before, after = comparison["before"], comparison["after"]
    rows = ["| joint | error of the robot file, N·m | after identification, N·m | fit, % |", "|---|---|---|---|"]
    for old, new in zip(before["joints"], after["joints"], strict=True):
        rows.append(f"| {new['joint']} | {old['rmse']:.3g} | {new['rmse']:.3g} | {new['fit_percent']:.3g} |")
    total = [f"{each['relative_error_percent']:.3g}" for each in (before, after)]
    return "\n".join([*rows, f"| all, % of the torque | {total[0]} | {total[1]} | |"])


def hidden(work: Path) -> str:
    """What a diagnosis finds, and the errors on the unseen log before and after."""
    train = [HIDDEN / f"train_{number}.csv.gz" for number in (1, 3)]
    logs = ["--robot", HIDDEN / "robot.urdf", "--train", *train, "--test", HIDDEN / "test.csv.gz"]
    run("diagnose", *logs, *EFFECTS, "--out", work)
    found: dict[str, Any] = json.loads((work / "diagnosis.json").read_text())
    rows = ["| found | at | probability | size | error of that joint, unseen log, N·m |", "|---|---|---|---|---|"]
    for finding in found["findings"]:
        sizes = ", ".join(
            f"{each['value']:.3f} ± {each['standard_deviation']:.3f} {each['unit']}" for each in finding["parameters"]
        )
        joint = found["joints"][finding["joints"][0]]
        rows.append(
            f"| `{finding['effect']}` | {', '.join(finding['joints'])} | {finding['probability']:.2f} | {sizes} "
            f"| {joint['rmse_before']:.3g} -> {joint['rmse_after']:.3g} |"
        )
    return "\n".join(rows)


def filled(text: str, work: Path) -> str:
    """The page with what was measured."""
    for name, measure in (("demo", demo), ("hidden", hidden)):
        table = measure(work / name)
        text = re.sub(rf"(<!-- {name} -->\n).*?(<!-- end -->)", rf"\g<1>{table}\n\g<2>", text, flags=re.DOTALL)
    return text


if __name__ == "__main__":
    old = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as place:
        new = filled(old, Path(place))
    if "--check" in sys.argv:
        print("README.md says what was measured" if new == old else "README.md says something else: make readme")
        sys.exit(new != old)
    PAGE.write_text(new, encoding="utf-8")
    print("\n".join(re.findall(r"^\|.*", new, flags=re.MULTILINE)))
