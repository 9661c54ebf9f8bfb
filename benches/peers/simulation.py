"""Times a simulation step of sgpr against MuJoCo's mj_step (Euler), both on this machine in one run.

    python benches/peers/simulation.py [--venv FOLDER] [--rounds 5]

Needs cargo, a C compiler and pip; MuJoCo comes from the package index into a virtual environment of its own. The
programs take turns, and the fastest time of each counts.
"""

import argparse
import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PEERS = ROOT / "benches" / "peers"
FIGURE = re.compile(r"(.*): (\d+) ns per step")


def output(*command: object) -> str:
    return subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True, cwd=ROOT).stdout


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--venv", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(temporary)
        place = options.venv or work / "venv"
        if not (place / "bin" / "python").exists():
            venv.create(place, with_pip=True)
        python = place / "bin" / "python"
        output(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "mujoco", "numpy")
        wheel = Path(output(python, "-c", "import mujoco; print(mujoco.__path__[0])").strip())
        output(python, PEERS / "mujoco_puma.py", ROOT / "data" / "reference" / "puma560.json", work)
        [library] = wheel.glob("libmujoco.so.*")
        program = work / "mujoco_step"
        flags = ["-O3", f"-I{wheel / 'include'}", library, f"-Wl,-rpath,{wheel}", "-lm"]
        output("cc", PEERS / "mujoco_step.c", *flags, "-o", program)
        sgpr = ["cargo", "run", "--quiet", "--release", "--locked", "--package", "benches", "--bin", "peer_simulation"]
        output(*sgpr)
        best: dict[str, float] = {}
        for _ in range(options.rounds):
            for text in (output(program, work / "viscous.mjb", work / "friction.mjb"), output(*sgpr)):
                for name, figure in FIGURE.findall(text):
                    label = f"MuJoCo, {Path(name).stem}" if name.endswith(".mjb") else f"sgpr, {name}"
                    best[label] = min(best.get(label, float(figure)), float(figure))
    for label, figure in best.items():
        print(f"{label}: {figure:.0f} ns per step, {250e3 / figure:.0f} times real time")
    return 0


if __name__ == "__main__":
    sys.exit(main())
