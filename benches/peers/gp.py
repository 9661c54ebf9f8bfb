"""Times Gaussian processes against other packages, each in a process of its own on one core.

    python benches/peers/gp.py [--points 2002 --inputs 6] [--rounds 3] [--no-fit]

Needs sgpr in this interpreter. Peers that are missing are installed from the package index into a virtual environment
of their own (scikit-learn and GPy; GPyTorch is large and taken along if that environment has it already). Two tables
for the ARD squared exponential: one log marginal likelihood with its gradient, at the same hyperparameters, where the
values must agree; and a whole search from one start, by L-BFGS-B with the same tolerance, where the optima must.
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
# How many times as fast as each peer, at this size.
GOAL_SIZE = (6006, 18)
GOALS = {"scipy": None, "gpy": 2.5, "gpytorch": 5.0, "scikit-learn": 9.0}
# Gradients by the logarithms of variance, length scales and noise variance.
SAME_PARAMETERS = {"sgpr", "scipy", "scikit-learn"}
ONE_CORE = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "RAYON")}
NOISE = 0.01
# Gain of a step, relative to the likelihood, at which a search ends.
GAIN = 1e-9


def data(points: int, inputs: int):
    import numpy as np

    i, m = np.arange(points)[:, None], np.arange(inputs)[None, :]
    X = np.sin(0.01 * i * (1.0 + 0.37 * m) + m)
    y = np.sin(3 * X[:, 0]) + X[:, 1] * X[:, 2]
    return X, y + 0.05 * ((np.arange(points) * 7919 % 1000) / 500 - 1), 1.0 + 0.1 * np.arange(inputs)


def data_with_optimum(points: int, inputs: int):
    """Every input matters, and the noise is white: one optimum, which all searches can agree on."""
    import numpy as np

    random = np.random.default_rng(0)
    X = random.normal(size=(points, inputs))
    m = np.arange(inputs)
    y = np.sin((1.0 - 0.1 * m) * X + m).sum(axis=1) + 0.3 * random.normal(size=points)
    return X, y, np.full(inputs, 2.0)


def by_sgpr(X, y, scales):
    import sgpr

    kernel = sgpr.Kernel("squared_exponential", range(X.shape[1]), scales)

    def likelihood():
        gp = sgpr.GaussianProcess(kernel, noise_variance=NOISE, optimise=False).fit(X, y)
        return lambda: gp.log_marginal_likelihood(eval_gradient=True)

    def fit():
        gp = sgpr.GaussianProcess(kernel, noise_variance=NOISE, starts=1).fit(X, y)
        return gp.log_marginal_likelihood_value_, gp.report_["evaluations"]

    return likelihood, fit


def minimise(objective, start, bounds=None):
    """By SciPy's L-BFGS-B. `objective` returns value and gradient."""
    from scipy.optimize import minimize

    return minimize(objective, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": GAIN})


def by_scipy(X, y, scales):
    """By hand: Cholesky, its inverse, and one pass over the kernel for each length scale."""
    import numpy as np
    from scipy.linalg import lapack, solve_triangular

    def evaluate(theta):
        variance, scales, noise = np.exp(theta[0]), np.exp(theta[1:-1]), np.exp(theta[-1])
        scaled = X / scales
        squares = (scaled**2).sum(1)
        K = scaled @ scaled.T
        K *= -2.0
        K += squares[:, None]
        K += squares
        np.exp(-0.5 * np.maximum(K, 0.0), out=K)
        K *= variance
        factor, _ = lapack.dpotrf(np.asfortranarray(K + noise * np.eye(len(y))), lower=1)
        alpha = solve_triangular(factor, solve_triangular(factor, y, lower=True), lower=True, trans="T")
        value = -0.5 * y @ alpha - np.log(np.diag(factor)).sum() - 0.5 * len(y) * np.log(2 * np.pi)
        inverse, _ = lapack.dpotri(factor, lower=1)
        inverse = np.tril(inverse) + np.tril(inverse, -1).T
        W = np.outer(alpha, alpha) - inverse
        by_noise = 0.5 * noise * np.trace(W)
        W *= K
        rows = W.sum(1)
        # ½ sum W (a - b)² = sum of rows a² - a' W a for each input
        by_scale = [rows @ a**2 - a @ (W @ a) for a in scaled.T]
        return value, np.array([0.5 * rows.sum(), *by_scale, by_noise])

    theta = np.log([1.0, *scales, NOISE])

    def fit():
        found = minimise(lambda theta: tuple(-part for part in evaluate(theta)), theta)
        return -found.fun, found.nfev

    return lambda: lambda: evaluate(theta), fit


def by_scikit_learn(X, y, scales):
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    kernel = ConstantKernel(1.0) * RBF(scales, (1e-3, 1e4)) + WhiteKernel(NOISE)

    def likelihood():
        gp = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None).fit(X, y)
        return lambda: gp.log_marginal_likelihood(kernel.theta, eval_gradient=True, clone_kernel=False)

    def fit():
        evaluations = []

        def optimizer(objective, start, bounds):
            found = minimise(objective, start, bounds)
            evaluations.append(found.nfev)
            return found.x, found.fun

        gp = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=optimizer).fit(X, y)
        return gp.log_marginal_likelihood_value_, evaluations[0]

    return likelihood, fit


def by_gpy(X, y, scales):
    import GPy
    import numpy as np

    def model():
        kernel = GPy.kern.RBF(X.shape[1], variance=1.0, lengthscale=scales, ARD=True)
        return GPy.models.GPRegression(X, y[:, None], kernel, noise_var=NOISE)

    def likelihood():
        gp = model()

        def evaluate():
            gp.parameters_changed()
            return gp.log_likelihood(), gp.gradient

        return evaluate

    def fit():
        gp = model()
        optimiser = gp.optimize("lbfgsb", max_iters=1000, bfgs_factor=GAIN / np.finfo(float).eps)
        return gp.log_likelihood(), optimiser.funct_eval

    return likelihood, fit


def by_gpytorch(X, y, scales):
    """By Cholesky; it comes without an L-BFGS with bounds, so SciPy's does the search."""
    import gpytorch
    import numpy as np
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

    noise = gpytorch.likelihoods.GaussianLikelihood().double()
    model = Model(noise).double()
    model.kernel.outputscale, model.kernel.base_kernel.lengthscale = 1.0, torch.tensor(scales)
    noise.noise = NOISE
    objective = gpytorch.mlls.ExactMarginalLogLikelihood(noise, model)
    model.train()

    def evaluate():
        model.zero_grad()
        with gpytorch.settings.fast_computations(False, False, False):
            value = objective(model(X), y) * len(y)
            value.backward()
        return value.item(), None

    def fit():
        parameters = list(model.parameters())

        def negative(raw):
            torch.nn.utils.vector_to_parameters(torch.tensor(raw), parameters)
            value, _ = evaluate()
            return -value, -np.concatenate([parameter.grad.numpy().ravel() for parameter in parameters])

        found = minimise(negative, torch.nn.utils.parameters_to_vector(parameters).detach().numpy())
        return -found.fun, found.nfev

    return lambda: evaluate, fit


BY = {
    "sgpr": by_sgpr,
    "scipy": by_scipy,
    "scikit-learn": by_scikit_learn,
    "gpy": by_gpy,
    "gpytorch": by_gpytorch,
}


def measure(name: str, points: int, inputs: int, rounds: int, whole: bool) -> None:
    """Print what one package needs, as JSON: for a likelihood with its gradient, or for the whole fit."""
    import resource

    likelihood, fit = BY[name](*(data_with_optimum if whole else data)(points, inputs))
    work = fit if whole else likelihood()
    fastest = float("inf")
    for _ in range(1 if whole else rounds):
        start = time.process_time()
        value, rest = work()
        fastest = min(fastest, time.process_time() - start)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    evaluations = int(rest) if whole else 1
    found = {"value": float(value), "seconds": fastest, "memory": memory, "evaluations": evaluations}
    if name in SAME_PARAMETERS and not whole:
        found["gradient"] = [float(derivative) for derivative in rest]
    print(json.dumps(found))


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


def compare(size: tuple[int, int], rounds: int, whole: bool, python: Path) -> dict[str, dict[str, float]]:
    """Measure every package that is there."""
    results = {}
    for name in BY:
        interpreter = sys.executable if name == "sgpr" else python
        options = ["--points", str(size[0]), "--inputs", str(size[1]), "--rounds", str(rounds)]
        command = [interpreter, __file__, "--only", name, *options, *(["--whole"] if whole else [])]
        environment = {**os.environ, **ONE_CORE}
        result = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        if result.returncode:
            # Killed for its memory it says nothing.
            reason = [f"ended with {result.returncode}", *result.stderr.strip().splitlines()][-1]
            print(f"{name}: left out ({reason})", file=sys.stderr)
            continue
        results[name] = json.loads(result.stdout.splitlines()[-1])
    return results


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, default=2002)
    parser.add_argument("--inputs", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--no-fit", action="store_true", help="leave the whole fit out")
    parser.add_argument("--venv", type=Path, default=ROOT / "out" / "peers-gp")
    parser.add_argument("--only", choices=BY, help=argparse.SUPPRESS)
    parser.add_argument("--whole", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    size = (arguments.points, arguments.inputs)
    if arguments.only:
        measure(arguments.only, *size, arguments.rounds, arguments.whole)
        return 0
    python = environment(arguments.venv)
    of = f"ARD squared exponential, n = {size[0]}, d = {size[1]}, one core"
    results = compare(size, arguments.rounds, False, python)
    ours = results["sgpr"]
    print(f"\nLog marginal likelihood with gradient, {of}\n")
    print("| package | CPU s | peak memory GiB | sgpr is faster by | goal | gradient beside sgpr's, per point |")
    print("|---|---|---|---|---|---|")
    for name, result in results.items():
        agrees = abs(result["value"] - ours["value"]) < 1e-4 * abs(ours["value"])
        ratio = "-" if name == "sgpr" else f"{result['seconds'] / ours['seconds']:.2f}"
        goal = GOALS.get(name) if size == GOAL_SIZE else None
        note = "" if agrees else " (another value!)"
        beside = "-"
        if name != "sgpr" and "gradient" in result:
            pairs = zip(result["gradient"], ours["gradient"], strict=True)
            beside = f"{max(abs(theirs - own) for theirs, own in pairs) / size[0]:.1e}"
        cells = [f"{result['seconds']:.3f}", f"{result['memory']:.2f}", ratio, f"{goal or '-'}", beside]
        print(f"| {name}{note} | {' | '.join(cells)} |")
    if arguments.no_fit:
        return 0
    results = compare(size, 1, True, python)
    ours = results["sgpr"]
    print(f"\nWhole fit from one start, {of}\n")
    print("| package | log likelihood | evaluations | CPU s | sgpr is faster by |\n|---|---|---|---|---|")
    for name, result in results.items():
        ratio = "-" if name == "sgpr" else f"{result['seconds'] / ours['seconds']:.2f}"
        print(f"| {name} | {result['value']:.4f} | {result['evaluations']} | {result['seconds']:.2f} | {ratio} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
