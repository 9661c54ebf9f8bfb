"""Times models that sgpr exported as C against Pinocchio's RNEA, all in one program, on the arm with seven joints.

    python benches/peers/exported.py [--venv FOLDER]

Needs cargo, a C++ compiler and pip, as run.py does.
"""

import argparse
import os
import shutil
import sys
import tempfile
from pathlib import Path

from run import FLAGS, PEERS, ROOT, URDF, environment, measure, run


def program(python: Path, folder: Path) -> Path:
    """The compiled comparison."""
    build = ["cargo", "build", "--release", "--quiet", "--package", "benches", "--bin", "peer_export"]
    run(*build, cwd=ROOT)
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    run(target / "release" / "peer_export", folder)
    libraries = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", capture_output=True)
    prefix = Path(libraries.stdout.strip()) / "cmeel.prefix" / "include"
    compiler = shutil.which("clang++") or shutil.which("g++")
    if compiler is None:
        sys.exit("no C++ compiler: install clang or g++")
    places = ["-I", PEERS, "-I", folder, "-isystem", prefix, "-isystem", prefix / "eigen3"]
    run(compiler, *FLAGS, *places, PEERS / "exported.cpp", "-o", folder / "exported")
    return folder / "exported"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--venv", type=Path, default=ROOT / ".venv-peers")
    python = environment(parser.parse_args().venv)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with (folder / "model.txt").open("w") as model:
            run(python, PEERS / "numpy_pinocchio.py", "model", URDF / "panda_like.urdf", stdout=model)
        times = measure([program(python, folder), folder / "model.txt"])
    peer = times["pinocchio_rnea"]
    for what, nanoseconds in times.items():
        print(f"{what.replace('_', ' ')}: {nanoseconds:.0f} ns, {peer / nanoseconds:.2f} times as fast as Pinocchio")


if __name__ == "__main__":
    main()
