"""Learn the inverse dynamics of the SARCOS arm: an exact process and a sparse one with a tenth of the points.

    python examples/sarcos.py --out out/sarcos

The data are not part of this repository: `sarcos_inv_test` of the Gaussian Processes for Machine Learning book, 4,449
samples of 21 inputs (position, velocity, acceleration) and 7 torques. The environment variable SGPR_DATA names the
folder that holds `sarcos/sarcos_inv_test.npz`. Every fifth sample is for testing (`index % 5 == 4`). The public test
file is a random tenth of the recording, so these are not the published benchmark's figures.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import sgpr
from real_robots import data_folder

# Mean squared error over variance, joints 1 to 7, of an exact process of another package (squared exponential, ARD).
REFERENCE = [0.0259, 0.0223, 0.0153, 0.0055, 0.0279, 0.0359, 0.0088]

KINDS = ("exact", "sparse")

# Of these the one under which the training points are most likely, for each joint. For the exact process these are
# every fourth; for the sparse one all, by its lower bound: a likelier kernel may be harder to see through few points.
KERNELS = ("squared_exponential", "matern52", "rational_quadratic")


def split(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Inputs and torques for training and for testing; inputs in units of their standard deviation."""
    with np.load(path) as file:
        x = np.hstack([file[name] for name in ("q", "dq", "ddq")]).astype(float)
        tau = file["tau"].astype(float)
    test = np.arange(len(x)) % 5 == 4
    x = (x - x[~test].mean(axis=0)) / x[~test].std(axis=0)
    return x[~test], tau[~test], x[test], tau[test]


def fit_likeliest(
    x: np.ndarray, tau: np.ndarray, kind: str, jobs: int, evaluations: int
) -> tuple[sgpr.GaussianProcess, str, dict[str, float]]:
    """The process with the likeliest kernel, this kernel, and the log likelihoods, or bounds, of all kernels."""
    budget = len(x) // 10 if kind == "sparse" else None

    def fit(kernel: str) -> sgpr.GaussianProcess:
        process = sgpr.GaussianProcess(kernel, inducing_points=budget, n_jobs=jobs, max_evaluations=evaluations)
        return process.fit(x, tau)

    def fit_quarter(kernel: str) -> sgpr.GaussianProcess:
        return sgpr.GaussianProcess(kernel, n_jobs=jobs).fit(x[::4], tau[::4])

    tried = {kernel: (fit if kind == "sparse" else fit_quarter)(kernel) for kernel in KERNELS}
    likelihoods = {kernel: process.log_marginal_likelihood_value_ for kernel, process in tried.items()}
    best = max(likelihoods, key=likelihoods.__getitem__)
    return tried[best] if kind == "sparse" else fit(best), best, likelihoods


def learn(path: Path, kind: str, joint: int, jobs: int, evaluations: int) -> dict[str, object]:
    """Fit one joint, predict the rest; figures of this process alone."""
    x, tau, x_test, tau_test = split(path)
    mean = tau[:, joint].mean()
    start, cpu = time.perf_counter(), time.process_time()
    process, kernel, likelihoods = fit_likeliest(x, tau[:, joint] - mean, kind, jobs, evaluations)
    wall, cpu = time.perf_counter() - start, time.process_time() - cpu
    predicted, std, half_interval = process.predict(x_test, True, include_noise=True, return_interval=True)
    error = tau_test[:, joint] - mean - predicted
    return {
        "kind": kind,
        "joint": joint + 1,
        "kernel": kernel,
        "likelihoods": likelihoods,
        "smse": float(np.mean(error**2) / tau_test[:, joint].var()),
        "within_68": float(100 * np.mean(np.abs(error) < std)),
        "within_95": float(100 * np.mean(np.abs(error) < half_interval)),
        "wall_s": wall,
        "cpu_s": cpu,
        "peak_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9,
        "report": process.report_,
    }


def table(rows: list[dict[str, object]]) -> str:
    """The figures as a table in Markdown."""
    kinds = [kind for kind in KINDS if kind in {row["kind"] for row in rows}]
    units = ("", ", within 68 / 95 %", ", CPU s", ", GB")
    names = ["joint", "kernel", "reference", *(kind + unit for unit in units for kind in kinds)]
    lines = ["| " + " | ".join(names) + " |", "|" + "---|" * len(names)]
    found = {(row["kind"], row["joint"]): row for row in rows}
    for joint in sorted({row["joint"] for row in rows}):
        pair = [found[kind, joint] for kind in kinds]
        cells = [f"{joint}", f"{pair[0]['kernel']}", f"{REFERENCE[joint - 1]:.4f}"]
        cells += [f"{row['smse']:.4f}" for row in pair]
        cells += [f"{row['within_68']:.0f} / {row['within_95']:.0f}" for row in pair]
        for name, digits in (("cpu_s", 0), ("peak_gb", 2)):
            cells += [f"{row[name]:.{digits}f}" for row in pair]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    """Learn all joints, each in a process of its own, and write a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/sarcos"))
    parser.add_argument("--joints", type=int, nargs="+", default=list(range(1, 8)), choices=range(1, 8))
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--jobs", type=int, default=2, help="threads")
    parser.add_argument("--evaluations", type=int, default=200, help="of the likelihood in each search")
    parser.add_argument("--one", nargs=2, metavar=("KIND", "JOINT"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    path = data_folder() / "sarcos" / "sarcos_inv_test.npz"
    if not path.is_file():
        sys.exit(f"{path} is not there: set SGPR_DATA to the folder that holds sarcos/sarcos_inv_test.npz")
    if arguments.one:
        kind, joint = arguments.one
        print(json.dumps(learn(path, kind, int(joint) - 1, arguments.jobs, arguments.evaluations)))
        return
    rows = []
    for joint in arguments.joints:
        for kind in arguments.kinds:
            # A process of its own, so that its peak memory is its own.
            command = [sys.executable, __file__, "--one", kind, str(joint)]
            command += ["--jobs", str(arguments.jobs), "--evaluations", str(arguments.evaluations)]
            rows.append(json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout))
            row = rows[-1]
            print(
                f"joint {joint}, {kind}, {row['kernel']}: {row['smse']:.4f} (reference {REFERENCE[joint - 1]:.4f}), "
                f"within 68 / 95 %: {row['within_68']:.0f} / {row['within_95']:.0f}, "
                f"{row['wall_s']:.0f} s, CPU {row['cpu_s']:.0f} s, "
                f"{row['peak_gb']:.2f} GB",
                flush=True,
            )
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "sarcos.json").write_text(json.dumps(rows, indent=1))
    (arguments.out / "sarcos.md").write_text(table(rows) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
