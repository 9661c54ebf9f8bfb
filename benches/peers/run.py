"""Times sgpr against Pinocchio, both on this machine in one run.

    python benches/peers/run.py [--venv FOLDER] [--rounds 5]

Needs cargo, a C++ compiler (clang++ if there is one: its code is faster than gcc's here) and pip. Pinocchio comes from
the package index into a virtual environment of its own. The programs take turns, and the fastest time of each counts.
"""

import argparse
import math
import os
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PEERS = ROOT / "benches" / "peers"
URDF = ROOT / "data" / "reference" / "urdf"
ROBOTS = {"PUMA 560": "puma560", "UR5e-like": "ur5e_like", "Panda-like": "panda_like"}
PACKAGES = ["pin", "cmeel-eigen", "numpy", "scipy"]
SAMPLES = 6006

# The joint models are one boost variant of some fifty types; boost's own tables stop at twenty.
FLAGS = [
    "-O3",
    "-march=native",
    "-std=c++17",
    "-DNDEBUG",
    "-DBOOST_MPL_LIMIT_LIST_SIZE=30",
    "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS",
    "-DBOOST_FUSION_INVOKE_MAX_ARITY=12",
]

# Name, our figure, Pinocchio's figure, goal for the ratio.
ROWS = [
    ("RNEA", "rnea", "rnea", 0.8),
    ("ABA", "aba", "aba", 0.8),
    ("CRBA", "crba", "crba", 0.8),
    ("regressor, one sample", "regressor", "regressor", 0.5),
    ("RNEA, batch, per sample", "rnea_batch", "rnea", None),
    ("regressor, batch of 1 MB, per sample", "regressor_batch_1MB", "regressor", 0.2),
    ("regressor, batch of 16 MB, per sample", "regressor_batch_16MB", "regressor", 0.2),
    ("regressor, batch of 1 GB, per sample", "regressor_batch_1GB", "regressor", None),
]
IDENTIFICATION_GOAL = 20

ONE_CORE = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "RAYON")}


def run(*command, **options):
    return subprocess.run([str(part) for part in command], check=True, text=True, **options)


def environment(folder: Path) -> Path:
    """The interpreter of a virtual environment with the peers in it."""
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
    has_all = (
        "import pinocchio, scipy, sysconfig, os, sys; "
        "sys.exit(not os.path.isdir(sysconfig.get_path('purelib') + '/cmeel.prefix/include/eigen3'))"
    )
    if subprocess.run([python, "-c", has_all], stderr=subprocess.DEVNULL).returncode:
        run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *PACKAGES)
    return python


def pinocchio_program(python: Path, folder: Path) -> Path:
    """The compiled C++ benchmark; compiled again when its source is newer."""
    program, source = folder / "pinocchio", PEERS / "pinocchio.cpp"
    if program.exists() and program.stat().st_mtime > source.stat().st_mtime:
        return program
    libraries = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", stdout=subprocess.PIPE)
    prefix = Path(libraries.stdout.strip()) / "cmeel.prefix"
    compiler = shutil.which("clang++") or shutil.which("g++")
    if compiler is None:
        sys.exit("no C++ compiler: install clang or g++")
    print(f"compiling Pinocchio's benchmark with {Path(compiler).name} (a minute) ...", flush=True)
    run(
        compiler, *FLAGS, "-isystem", prefix / "include", "-isystem", prefix / "include" / "eigen3", source,
        "-o", program,
    )  # fmt: skip
    return program


def sgpr_program() -> Path:
    build = ["cargo", "build", "--release", "--quiet", "--package", "benches", "--bin", "peers"]
    run(*build, cwd=ROOT)
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    return target / "release" / "peers"


def measure(command) -> dict[str, float]:
    output = run(*command, stdout=subprocess.PIPE, env={**os.environ, **ONE_CORE}).stdout
    pairs = (line.split() for line in output.splitlines())
    return {name: float(value) for name, value in pairs}


def fastest(commands: list, rounds: int) -> list[dict[str, float]]:
    """The programs in turn, `rounds` times; of every figure the smallest."""
    results: list[dict[str, float]] = [{} for _ in commands]
    for _ in range(rounds):
        for result, command in zip(results, commands, strict=True):
            for name, value in measure(command).items():
                result[name] = min(value, result.get(name, math.inf))
    return results


def compare_dynamics(python: Path, ours: Path, theirs: Path, rounds: int) -> list[str]:
    figures = {}
    for label, name in ROBOTS.items():
        urdf = URDF / f"{name}.urdf"
        with tempfile.NamedTemporaryFile("w", suffix=".txt") as model:
            run(python, PEERS / "numpy_pinocchio.py", "model", urdf, stdout=model)
            figures[label] = fastest([[ours, urdf], [theirs, model.name]], rounds)
    lines = [
        "| ns (ratio) | " + " | ".join(ROBOTS) + " | goal |",
        "|---|" + "---|" * (len(ROBOTS) + 1),
    ]
    for title, mine, other, goal in ROWS:
        cells = []
        for own, peer in figures.values():
            cells.append(f"{own[mine]:.0f} / {peer[other]:.0f} ({own[mine] / peer[other]:.2f})")
        lines.append(f"| {title} | " + " | ".join(cells) + f" | {goal or ''} |")
    fills = [f"{own['regressor_batch_1GB_fill']:.0f}" for own, _ in figures.values()]
    lines.append("| filling 1 GB with zeros, per sample | " + " | ".join(fills) + " | |")
    return lines


def compare_identification(python: Path, ours: Path, rounds: int) -> list[str]:
    lines = [
        f"| identification of {SAMPLES} samples | sgpr, ms | numpy + Pinocchio, ms | times as fast | goal |",
        "|---|---|---|---|---|",
    ]
    for label, name in ROBOTS.items():
        urdf = URDF / f"{name}.urdf"
        with tempfile.NamedTemporaryFile(suffix=".f64") as samples:
            script = PEERS / "numpy_pinocchio.py"
            run(python, script, "samples", urdf, samples.name, SAMPLES)
            own, peer = fastest([[ours, urdf, samples.name], [python, script, "identify", urdf, samples.name]], rounds)
        # Both must have done the same work.
        assert own["rank"] == peer["rank"], (own["rank"], peer["rank"])
        joints = [key for key in own if key.startswith("noise_")]
        assert all(math.isclose(own[key], peer[key], rel_tol=1e-4) for key in joints), (own, peer)
        mine, other = own["identification"] * 1e-6, peer["identification"] * 1e-6
        lines.append(f"| {label} | {mine:.2f} | {other:.1f} | {other / mine:.0f} | {IDENTIFICATION_GOAL} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--venv", type=Path, default=ROOT / ".venv-peers", help="where Pinocchio is or goes")
    parser.add_argument("--rounds", type=int, default=5, help="turns of each program")
    options = parser.parse_args()
    folder = options.venv.resolve()
    python = environment(folder)
    theirs = pinocchio_program(python, folder)
    ours = sgpr_program()
    print("\n".join(compare_dynamics(python, ours, theirs, options.rounds)), end="\n\n", flush=True)
    print("\n".join(compare_identification(python, ours, options.rounds)), end="\n\n", flush=True)
    wheels = list((ROOT / ".venv" / "wheels").glob("sgpr-*.whl"))
    if wheels:
        install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        run(*install, "--force-reinstall", "--no-deps", *wheels)
        run(*install, "pytest-benchmark", *wheels)
        run(python, "-m", "pytest", "-q", PEERS / "test_python.py", env={**os.environ, **ONE_CORE})
    else:
        print("Python interfaces not compared: no wheel, run `make build`")


if __name__ == "__main__":
    main()
