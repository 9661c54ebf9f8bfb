"""Times one log marginal likelihood with its gradient against other packages, each in a process of its own on one core.

    python benches/peers/gp.py [--points 2002 --inputs 6] [--rounds 3]

Needs sgpr in this interpreter. Peers that are missing are installed from the package index into a virtual environment
of their own (scikit-learn and GPy; GPyTorch is large and taken along if that environment has it already). Every package
computes the ARD squared exponential of the same data at the same hyperparameters; the values must agree.
"""

import argparse
import json
import os
import subprocess
import sys
import time
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ["numpy", "scipy", "scikit-learn", "GPy"]
# How many times as fast as each peer.
GOALS = {"scipy": None, "gpy": 2.5, "gpytorch": 5.0, "scikit-learn": 9.0}
ONE_CORE = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "RAYON")}
NOISE = 0.01


def data(points: int, inputs: int):
    import numpy as np

    i, m = np.arange(points)[:, None], np.arange(inputs)[None, :]
    X = np.sin(0.01 * i * (1.0 + 0.37 * m) + m)
    y = np.sin(3 * X[:, 0]) + X[:, 1] * X[:, 2]
    return X, y + 0.05 * ((np.arange(points) * 7919 % 1000) / 500 - 1), 1.0 + 0.1 * np.arange(inputs)


def by_sgpr(X, y, scales):
    import sgpr

    kernel = sgpr.Kernel("squared_exponential", range(X.shape[1]), scales)
    gp = sgpr.GaussianProcess(kernel, noise_variance=NOISE, optimise=False).fit(X, y)
    return lambda: gp.log_marginal_likelihood(eval_gradient=True)


def by_scipy(X, y, scales):
    """By hand: Cholesky, its inverse, and one pass over the kernel for each length scale."""
    import numpy as np
    from scipy.linalg import lapack, solve_triangular

    def evaluate():
        scaled = X / scales
        squares = (scaled**2).sum(1)
        K = scaled @ scaled.T
        K *= -2.0
        K += squares[:, None]
        K += squares
        np.exp(-0.5 * np.maximum(K, 0.0), out=K)
        factor, _ = lapack.dpotrf(np.asfortranarray(K + NOISE * np.eye(len(y))), lower=1)
        alpha = solve_triangular(factor, solve_triangular(factor, y, lower=True), lower=True, trans="T")
        value = -0.5 * y @ alpha - np.log(np.diag(factor)).sum() - 0.5 * len(y) * np.log(2 * np.pi)
        inverse, _ = lapack.dpotri(factor, lower=1)
        inverse = np.tril(inverse) + np.tril(inverse, -1).T
        W = np.outer(alpha, alpha) - inverse
        noise = 0.5 * NOISE * np.trace(W)
        W *= K
        rows = W.sum(1)
        # sum W (a - b)² = 2 (sum of rows a² - a' W a) for each input
        scale = [rows @ a**2 - a @ (W @ a) for a in scaled.T]
        return value, np.array([0.5 * rows.sum(), *scale, noise])

    return evaluate


def by_scikit_learn(X, y, scales):
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    kernel = ConstantKernel(1.0) * RBF(scales) + WhiteKernel(NOISE)
    gp = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None).fit(X, y)
    return lambda: gp.log_marginal_likelihood(kernel.theta, eval_gradient=True, clone_kernel=False)


def by_gpy(X, y, scales):
    import GPy

    kernel = GPy.kern.RBF(X.shape[1], variance=1.0, lengthscale=scales, ARD=True)
    model = GPy.models.GPRegression(X, y[:, None], kernel, noise_var=NOISE)

    def evaluate():
        model.parameters_changed()
        return model.log_likelihood(), model.gradient

    return evaluate


def by_gpytorch(X, y, scales):
    import gpytorch
    import torch

    torch.set_num_threads(1)
    X, y = torch.tensor(X), torch.tensor(y)

    class Model(gpytorch.models.ExactGP):
        def __init__(self, likelihood):
            super().__init__(X, y, likelihood)
            self.mean = gpytorch.means.ZeroMean()
            self.kernel = gpytorch.kernels.ScaleKernel(gpytorch.kernels.RBFKernel(ard_num_dims=X.shape[1]))

        def forward(self, x):
            return gpytorch.distributions.MultivariateNormal(self.mean(x), self.kernel(x))

    likelihood = gpytorch.likelihoods.GaussianLikelihood().double()
    model = Model(likelihood).double()
    model.kernel.outputscale, model.kernel.base_kernel.lengthscale = 1.0, torch.tensor(scales)
    likelihood.noise = NOISE
    objective = gpytorch.mlls.ExactMarginalLogLikelihood(likelihood, model)
    model.train()

    def evaluate():
        model.zero_grad()
        with gpytorch.settings.fast_computations(False, False, False):
            value = objective(model(X), y) * len(y)
            value.backward()
        return value.item(), None

    return evaluate


BY = {
    "sgpr": by_sgpr,
    "scipy": by_scipy,
    "scikit-learn": by_scikit_learn,
    "gpy": by_gpy,
    "gpytorch": by_gpytorch,
}


def measure(name: str, points: int, inputs: int, rounds: int) -> None:
    """Print what one package needs, as JSON."""
    import resource

    evaluate = BY[name](*data(points, inputs))
    fastest = float("inf")
    for _ in range(rounds):
        start = time.process_time()
        value, _ = evaluate()
        fastest = min(fastest, time.process_time() - start)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    print(json.dumps({"value": float(value), "seconds": fastest, "memory": memory}))


def environment(folder: Path) -> Path:
    """The interpreter of a virtual environment with the peers in it."""
    python = folder / "bin" / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
    if subprocess.run([python, "-c", "import sklearn, GPy"], stderr=subprocess.DEVNULL, check=False).returncode:
        install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        for package in PACKAGES:
            subprocess.run([*install, package], check=False)
    return python


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=2002)
    parser.add_argument("--inputs", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--venv", type=Path, default=ROOT / "out" / "peers-gp")
    parser.add_argument("--only", choices=BY, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    size = (arguments.points, arguments.inputs)
    if arguments.only:
        measure(arguments.only, *size, arguments.rounds)
        return 0
    python = environment(arguments.venv)
    results = {}
    for name in BY:
        interpreter = sys.executable if name == "sgpr" else python
        options = ["--points", str(size[0]), "--inputs", str(size[1]), "--rounds", str(arguments.rounds)]
        command = [interpreter, __file__, "--only", name, *options]
        result = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, **ONE_CORE},
        )
        if result.returncode:
            print(f"{name}: left out ({result.stderr.strip().splitlines()[-1]})", file=sys.stderr)
            continue
        results[name] = json.loads(result.stdout.splitlines()[-1])
    ours = results["sgpr"]
    print(f"\nLog marginal likelihood with gradient, ARD squared exponential, n = {size[0]}, d = {size[1]}, one core\n")
    print("| package | CPU s | peak memory GiB | sgpr is faster by | goal |\n|---|---|---|---|---|")
    for name, result in results.items():
        agrees = abs(result["value"] - ours["value"]) < 1e-4 * abs(ours["value"])
        ratio = "-" if name == "sgpr" else f"{result['seconds'] / ours['seconds']:.2f}"
        goal = GOALS.get(name)
        note = "" if agrees else " (another value!)"
        print(f"| {name}{note} | {result['seconds']:.3f} | {result['memory']:.2f} | {ratio} | {goal or '-'} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
