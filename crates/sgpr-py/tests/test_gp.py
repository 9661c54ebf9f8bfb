"""Gaussian process regression: against scikit-learn, and with its tools."""

import _thread
import copy
import pickle
import threading
from typing import Any

import numpy as np
import pytest
import sgpr


@pytest.fixture(scope="module")
def points() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    X = rng.uniform(-2, 2, (120, 3))
    return X, np.sin(2 * X[:, 0]) + 0.3 * X[:, 1] ** 2 + 0.05 * rng.standard_normal(120)


@pytest.mark.filterwarnings("ignore")
def test_scikit_learn_takes_it_for_one_of_its_own() -> None:
    checks = pytest.importorskip("sklearn.utils.estimator_checks")
    results = checks.check_estimator(sgpr.GaussianProcess(), on_fail=None)
    failed = {result["check_name"]: result["exception"] for result in results if result["status"] == "failed"}
    assert not failed
    assert sum(result["status"] == "passed" for result in results) > 45


def test_likelihood_gradient_and_optimum_are_those_of_scikit_learn(points: tuple[np.ndarray, np.ndarray]) -> None:
    regression = pytest.importorskip("sklearn.gaussian_process")
    kernels = regression.kernels
    X, y = points
    kernel = kernels.ConstantKernel(1.0) * kernels.RBF([1.0] * 3) + kernels.WhiteKernel(0.01)
    peer = regression.GaussianProcessRegressor(kernel, alpha=0.0, n_restarts_optimizer=3, random_state=0).fit(X, y)
    gp = sgpr.GaussianProcess().fit(X, y)
    assert gp.report_["status"] == "converged"
    # Both in the order signal variance, length scales, noise variance; the prior on the noise is weak.
    value, gradient = gp.log_marginal_likelihood(peer.kernel_.theta, eval_gradient=True)
    expected, expected_gradient = peer.log_marginal_likelihood(peer.kernel_.theta, eval_gradient=True)
    assert value == pytest.approx(expected, abs=1e-8)
    assert np.allclose(gradient, expected_gradient, atol=1e-6)
    assert gp.log_marginal_likelihood() == pytest.approx(expected, abs=0.5)
    assert gp.log_marginal_likelihood_value_ == pytest.approx(gp.log_marginal_likelihood(), abs=1e-9)
    new = np.random.default_rng(6).uniform(-2, 2, (20, 3))
    same = sgpr.GaussianProcess(gp.kernel_.with_theta(peer.kernel_.theta[:-1]), optimise=False)
    same = same.set_params(noise_variance=float(np.exp(peer.kernel_.theta[-1]))).fit(X, y)
    mean, std = same.predict(new, return_std=True)
    peer_mean, peer_std = peer.predict(new, return_std=True)
    assert np.allclose(mean, peer_mean, atol=1e-8)
    assert np.allclose(np.hypot(std, np.sqrt(same.noise_variance_)), peer_std, atol=1e-7)
    assert same.score(new, peer_mean) > 0.999


def test_likelihoods_are_computed_in_the_memory_of_the_last_one() -> None:
    resource = pytest.importorskip("resource")
    x = np.linspace(0, 50, 2200)[:, None]
    gp = sgpr.GaussianProcess(sgpr.Kernel("matern32", [0]), noise_variance=0.1, optimise=False).fit(x, np.sin(x[:, 0]))

    def new_pages() -> int:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        gp.log_marginal_likelihood(eval_gradient=True)
        return int(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)

    first = new_pages()
    # A matrix of 39 MB.
    assert new_pages() < 0.3 * max(first, 2200**2 * 8 / resource.getpagesize())


def test_likelihoods_of_several_threads_at_once_do_not_mix(points: tuple[np.ndarray, np.ndarray]) -> None:
    gp = sgpr.GaussianProcess(optimise=False, noise_variance=0.1).fit(*points)
    thetas = [gp.theta_ + 0.1 * k for k in range(8)]
    expected = [gp.log_marginal_likelihood(theta) for theta in thetas]
    found: dict[int, list[float]] = {}

    def work(k: int) -> None:
        found[k] = [float(gp.log_marginal_likelihood(thetas[k])) for _ in range(20)]

    threads = [threading.Thread(target=work, args=(k,)) for k in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(found[k] == [expected[k]] * 20 for k in range(8))


def test_every_kernel_learns(points: tuple[np.ndarray, np.ndarray]) -> None:
    X, y = points
    for kernel in ["squared_exponential", "exponential", "matern32", "matern52", "rational_quadratic"]:
        for ard in [True, False]:
            gp = sgpr.GaussianProcess(kernel, ard=ard, starts=1, max_evaluations=30).fit(X[:90], y[:90])
            assert gp.score(X[90:], y[90:]) > 0.6, (kernel, ard)
            assert len(gp.theta_) == len(gp.theta_names_) == 2 + (3 if ard else 1) + (kernel == "rational_quadratic")
    with pytest.raises(sgpr.SgprError, match="kernel = 'rbf': expected 'squared_exponential' or"):
        sgpr.GaussianProcess("rbf").fit(X, y)


def test_kernels_add_multiply_and_repeat() -> None:
    angle = sgpr.Kernel("squared_exponential", [0], 0.7, periods={0: 2 * np.pi})
    speed = sgpr.Kernel("matern32", [1], [2.0], variance=0.5)
    X = np.random.default_rng(1).uniform(-3, 3, (5, 2))
    turned = X + np.array([2 * np.pi, 0.0])
    assert np.allclose((angle * speed + speed)(X, turned), angle(X) * speed(X) + speed(X))
    assert (angle + speed).names == ["signal_variance", "length_scale[0]", "signal_variance", "length_scale[1]"]
    assert sgpr.Kernel.from_json(angle.to_json()) == angle == pickle.loads(pickle.dumps(angle))
    gp = sgpr.GaussianProcess(angle + speed, starts=1).fit(X, X[:, 1])
    assert gp.predict(turned) == pytest.approx(gp.predict(X), abs=1e-9)
    for wrong, message in [
        (lambda: sgpr.Kernel("matern32", [0], [1.0, 2.0]), r"length_scale: got \(2,\), expected \(\) or \(1,\)"),
        (lambda: sgpr.Kernel("matern32", []), "at least one"),
        (lambda: sgpr.Kernel("matern32", [0], -1.0), r"length_scale\[0\] is -1; it must be positive"),
        (lambda: sgpr.Kernel("matern32", [0], periods={0: 0.0}), "periods = 0"),
        (lambda: angle(np.zeros((3, 0))), r"X: got \(3, 0\)"),
        (
            lambda: sgpr.GaussianProcess(speed).fit(np.zeros((3, 1)), np.zeros(3)),
            "looks at input 1, but there are only 1",
        ),
        (lambda: sgpr.Kernel.from_json("{}"), "not a kernel"),
    ]:
        with pytest.raises(sgpr.SgprError, match=message):
            wrong()


def test_outputs_share_one_process_and_everything_is_kept(points: tuple[np.ndarray, np.ndarray]) -> None:
    X, y = points
    gp = sgpr.GaussianProcess(starts=1).fit(X, np.column_stack([y, -2 * y]))
    mean, std = gp.predict(X[:7], return_std=True)
    assert mean.shape == std.shape == (7, 2)
    assert np.allclose(mean[:, 1], -2 * mean[:, 0])
    for again in [pickle.loads(pickle.dumps(gp)), copy.deepcopy(gp)]:
        assert np.array_equal(again.predict(X), gp.predict(X))
    left_out, deviation, density = gp.leave_one_out()
    assert left_out.shape == (120, 2)
    assert deviation.shape == (120,)
    assert np.isfinite(density)


def test_one_point_after_the_other(points: tuple[np.ndarray, np.ndarray]) -> None:
    X, y = points
    gp = sgpr.GaussianProcess(starts=1).fit(X, y)
    mean, std = gp.predict(X, return_std=True)
    exact = gp.predictor(variance_rank=None)
    fast = gp.predictor(single_precision=True, variance_rank=60)
    assert 0 < fast.error < 5e-3
    for k in range(5):
        one, deviation, far = exact.mean_and_std(X[k])
        assert one[0] == pytest.approx(mean[k], abs=1e-9)
        assert deviation == pytest.approx(std[k], abs=1e-7)
        assert not far
        assert fast.mean(X[k])[0] == pytest.approx(mean[k], abs=2 * fast.error)
        assert fast.mean_and_std(X[k])[1] >= 0.9 * deviation
    assert exact.mean_and_std([1e3, 0.0, 0.0])[2]
    with pytest.raises(sgpr.SgprError, match="made without variance"):
        gp.predictor().mean_and_std(X[0])
    with pytest.raises(sgpr.SgprError, match=r"x: got \(2,\), expected \(3,\)"):
        exact.mean([1.0, 2.0])


def test_a_sparse_process_keeps_to_its_budget() -> None:
    rng = np.random.default_rng(2)
    X = rng.uniform(-3, 3, (4000, 2))
    y = np.sin(2 * X[:, 0]) * X[:, 1] + 0.1 * rng.standard_normal(4000)
    gp = sgpr.GaussianProcess(inducing_points=80, starts=1).fit(X, y)
    assert gp.inducing_points_ is not None
    # Fewer where no variance is left.
    assert 40 <= len(gp.inducing_points_) <= 80
    assert gp.noise_variance_ == pytest.approx(0.01, rel=0.1)
    value, gradient = gp.log_marginal_likelihood(eval_gradient=True)
    assert value == pytest.approx(gp.log_marginal_likelihood_value_)
    assert gradient.shape == gp.theta_.shape
    assert np.array_equal(pickle.loads(pickle.dumps(gp)).predict(X[:50]), gp.predict(X[:50]))
    predictor = gp.predictor(variance_rank=None)
    mean, std = gp.predict(X[:1], return_std=True)
    assert predictor.mean_and_std(X[0])[:2] == (pytest.approx(mean, abs=1e-9), pytest.approx(std[0], abs=1e-6))
    left_out, deviation, _ = gp.leave_one_out()
    new = rng.uniform(-3, 3, (4000, 2))
    mean, std = gp.predict(new, return_std=True)
    error = np.sin(2 * new[:, 0]) * new[:, 1] + 0.1 * rng.standard_normal(4000) - mean
    in_deviations = error / np.hypot(std, np.sqrt(gp.noise_variance_))
    assert np.std((y - left_out) / deviation) == pytest.approx(np.std(in_deviations), rel=0.04)


@pytest.mark.parametrize("inducing", [None, 60])
def test_intervals_hold_what_they_say_of_errors_with_heavy_tails(inducing: int | None) -> None:
    rng = np.random.default_rng(11)
    X = rng.uniform(-3, 3, (6000, 2))
    y = np.sin(2 * X[:, 0]) * X[:, 1] + 0.1 * rng.standard_t(2.2, 6000)
    gp = sgpr.GaussianProcess(inducing_points=inducing, starts=1).fit(X[:1000], np.column_stack([y, 2 * y])[:1000])
    mean, std, half = gp.predict(X[1000:], True, include_noise=True, return_interval=True)
    error = np.abs(np.column_stack([y, 2 * y])[1000:] - mean)
    # Quantiles of 1,000 errors: two of their standard errors.
    assert np.mean(error < std, axis=0) == pytest.approx([0.683, 0.683], abs=0.03)
    assert np.mean(error < half, axis=0) == pytest.approx([0.95, 0.95], abs=0.014)
    signal = gp.predict(X[1000:], True)[1]
    normal = np.hypot(signal, np.sqrt(gp.noise_variance_))
    assert np.mean(error < normal) > 0.8, "as a normal distribution with the same variance would have it"
    assert np.array_equal(gp.predict(X[1000:], return_interval=True)[1], half)


def test_what_stops_the_search_leaves_the_best_so_far(points: tuple[np.ndarray, np.ndarray]) -> None:
    X, y = points

    def stop(stage: str, done: int, total: int) -> None:
        raise RuntimeError(f"{stage} {done} of {total}")

    gp = sgpr.GaussianProcess(progress=stop)
    with pytest.raises(RuntimeError, match="of 100"):
        gp.fit(X, y)
    assert gp.report_["status"] == "stopped"
    assert np.isfinite(gp.predict(X)).all()

    # Ctrl-C, while a search that would take long is under way.
    big = np.random.default_rng(1).uniform(-1, 1, (1500, 12))
    gp = sgpr.GaussianProcess(starts=200, progress=lambda *_: None)
    timer = threading.Timer(1.0, _thread.interrupt_main)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        gp.fit(big, np.sin(3 * big[:, 0]) + big[:, 1])
    timer.join()
    assert gp.report_["status"] == "stopped"
    assert np.isfinite(gp.predict(big[:3])).all()


def test_bad_input_is_refused_with_advice(points: tuple[np.ndarray, np.ndarray]) -> None:
    X, y = points
    nan = X.copy()
    nan[3, 1] = np.nan
    gp = sgpr.GaussianProcess()
    for X_wrong, y_wrong, message in [
        (nan, y, "X contains NaN"),
        (X, nan[:, 1], "y contains NaN"),
        (X[:5], y, r"y: got \(120,\), expected \(5,\)"),
        (X[:, 0], y, "Reshape your data"),
        (X[:0], y[:0], r"0 sample\(s\)"),
    ]:
        with pytest.raises(sgpr.SgprError, match=message):
            gp.fit(X_wrong, y_wrong)
    with pytest.raises(AttributeError, match="not fitted yet"):
        gp.predict(X)
    with pytest.raises(MemoryError, match=r"200000 points need 320\.0 GB .* take the sparse one, or at most"):
        gp.fit(np.zeros((200_000, 1)), np.zeros(200_000))
    with pytest.raises(sgpr.SgprError, match="there is no parameter 'kernels'"):
        gp.set_params(kernels=1)
    # Hard, but possible.
    for X_hard, y_hard in [
        (np.ones((20, 2)), np.arange(20.0)),
        (np.arange(20.0)[:, None], np.full(20, 3.0)),
        (np.arange(20.0)[:, None], np.zeros(20)),
        (np.array([[1.0]]), np.array([2.0])),
        (1e12 * X[:40], 1e-12 * y[:40]),
        (np.repeat(X[:20], 3, axis=0), np.repeat(y[:20], 3)),
    ]:
        gp = sgpr.GaussianProcess().fit(X_hard, y_hard)
        mean, std = gp.predict(X_hard, return_std=True)
        assert np.isfinite(mean).all()
        assert np.isfinite(std).all()


def test_parameters_are_shown() -> None:
    gp = sgpr.GaussianProcess("matern52", ard=False)
    assert repr(gp) == "GaussianProcess(ard=False, kernel='matern52')"
    params: dict[str, Any] = gp.get_params()
    assert sgpr.GaussianProcess(**params).get_params() == params


def test_a_budget_decides_how_many_points_are_computed() -> None:
    rng = np.random.default_rng(7)
    X = rng.uniform(-3, 3, (4000, 2))
    y = np.sin(X[:, 0]) * X[:, 1] + 0.1 * rng.standard_normal(4000)
    settings = {"max_evaluations": 20, "starts": 1}
    chosen = {}
    for budget in (300, 1000):
        gp = sgpr.GaussianProcess(budget=budget, **settings).fit(X[: 10 * budget // 3], y[: 10 * budget // 3])
        chosen[budget] = (gp.report_["inference"], gp.report_["points"])
        assert np.sqrt(np.mean((gp.predict(X[:200]) - np.sin(X[:200, 0]) * X[:200, 1]) ** 2)) < 0.06
    # sqrt(budget³ / (3 N)), or fewer where no variance is left.
    for budget, most in ((300, 94), (1000, 316)):
        assert chosen[budget][0] == "sparse" and 30 <= chosen[budget][1] <= most
    exact = sgpr.GaussianProcess(budget=300, **settings).fit(X[:300], y[:300])
    assert (exact.report_["inference"], exact.report_["points"]) == ("exact", 300)
    few = sgpr.GaussianProcess(budget=200, **settings).fit(X, y)
    assert few.report_["inference"] == "subset" and 50 <= few.report_["points"] <= 200
    assert few.leave_one_out()[0].shape == (few.report_["points"],)
    with pytest.raises(sgpr.SgprError, match="exclude each other"):
        sgpr.GaussianProcess(budget=100, inducing_points=10).fit(X, y)
