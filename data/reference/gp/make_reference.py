"""Writes reference.json: log marginal likelihoods, gradients, predictions and optima of scikit-learn and SciPy.

    python make_reference.py

scikit-learn 1.9.1, SciPy 1.17.1, numpy 2.4.6. White noise is alpha of GaussianProcessRegressor where it is fixed and a
WhiteKernel where it is learned. theta and gradients are in scikit-learn's order.
"""

import json
from pathlib import Path

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, RationalQuadratic, WhiteKernel

rng = np.random.default_rng(3)
n, d = 70, 3
x = rng.uniform(-2, 2, (n, d))
y = np.sin(2 * x[:, 0]) + 0.3 * x[:, 1] ** 2 + 0.05 * rng.standard_normal(n)
x_new = rng.uniform(-3, 3, (9, d))
ard = [0.7, 1.3, 4.0]
noise = 0.01

cases = {
    "squared_exponential_isotropic": ConstantKernel(1.7) * RBF(0.9),
    "squared_exponential_ard": ConstantKernel(1.7) * RBF(ard),
    "exponential_isotropic": ConstantKernel(1.7) * Matern(0.9, nu=0.5),
    "exponential_ard": ConstantKernel(1.7) * Matern(ard, nu=0.5),
    "matern32_isotropic": ConstantKernel(1.7) * Matern(0.9, nu=1.5),
    "matern32_ard": ConstantKernel(1.7) * Matern(ard, nu=1.5),
    "matern52_isotropic": ConstantKernel(1.7) * Matern(0.9, nu=2.5),
    "matern52_ard": ConstantKernel(1.7) * Matern(ard, nu=2.5),
    # theta: constant, alpha, length scale
    "rational_quadratic_isotropic": ConstantKernel(1.7) * RationalQuadratic(0.9, 0.6),
    "sum": ConstantKernel(1.7) * RBF(ard) + ConstantKernel(0.4) * Matern(2.0, nu=1.5),
    "product": ConstantKernel(1.7) * RBF(ard) * Matern(2.0, nu=2.5),
}
reference = {"x": x.ravel().tolist(), "y": y.tolist(), "x_new": x_new.ravel().tolist(), "noise": noise, "cases": {}}
for name, kernel in cases.items():
    gp = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None).fit(x, y)
    value, gradient = gp.log_marginal_likelihood(kernel.theta, eval_gradient=True)
    mean, std = gp.predict(x_new, return_std=True)
    reference["cases"][name] = {
        "theta": kernel.theta.tolist(),
        "log_marginal_likelihood": float(value),
        "gradient": gradient.tolist(),
        "mean": mean.tolist(),
        "variance": (std**2).tolist(),
    }

# What SciPy's L-BFGS-B finds from several starts: the best optimum.
optima = {}
for name, kernel in {
    "squared_exponential_isotropic": ConstantKernel(1.0, (1e-3, 1e3)) * RBF(1.0, (1e-2, 1e3)),
    "squared_exponential_ard": ConstantKernel(1.0, (1e-3, 1e3)) * RBF([1.0] * d, (1e-2, 1e3)),
    "matern52_ard": ConstantKernel(1.0, (1e-3, 1e3)) * Matern([1.0] * d, (1e-2, 1e3), nu=2.5),
}.items():
    kernel = kernel + WhiteKernel(1e-2, (1e-6, 1e1))
    gp = GaussianProcessRegressor(kernel, alpha=0.0, n_restarts_optimizer=20, random_state=0).fit(x, y)
    optima[name] = {"theta": gp.kernel_.theta.tolist(), "log_marginal_likelihood": float(gp.log_marginal_likelihood_value_)}
reference["optima"] = optima
Path(__file__).with_name("reference.json").write_text(json.dumps(reference, indent=1) + "\n")
