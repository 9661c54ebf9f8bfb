"""Gaussian process regression with scikit-learn's interface."""

from collections.abc import Callable
from importlib import import_module
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._estimator import Estimator
from ._sgpr import FittedProcess, Kernel, ProcessPredictor, SgprError, fit_process

_Array = NDArray[np.float64]


class GaussianProcess(Estimator):
    """Gaussian process regression: y = f(x) + noise, f ~ GP(0, k), one process per output.

    Hyperparameters maximise the log marginal likelihood, by L-BFGS from several starts on a subset of the points; the
    noise variance is learned with them, under a weak prior that keeps it from running to zero. The mean before any
    data is zero: far from the data predictions return there, and their standard deviation to that of k(x, x).

    Parameters
    ----------
    kernel : str or Kernel, default "squared_exponential"
        Also "exponential", "matern32", "matern52", "rational_quadratic", over all inputs with scales from the data;
        or a `Kernel`, whose hyperparameters are where the search starts.
    ard : bool, default True
        A length scale for each input (automatic relevance determination), or one for all. Not for a `Kernel`.
    noise_variance : float, optional
        Where the search for the noise variance starts, in the square of the unit of y; a hundredth of the mean square
        of y by default.
    optimise : bool, default True
        Whether hyperparameters are searched for, or stay as they are.
    starts : int, default 3
        Starts of the search.
    max_evaluations : int, default 100
        Evaluations of the likelihood in each search.
    budget : int, optional
        Points of the largest exact process that is affordable: a likelihood takes budget³ operations and 16 budget²
        bytes. More points than this are seen through as many inducing points as cost the same; if these were fewer than
        50, the most informative points within the budget are taken and the others dropped. `report_` says what was
        done. Without a budget all points are taken.
    inducing_points : int, optional
        Number of inducing points of a sparse process (Titsias' variational bound), instead of a budget: time grows with
        points times its square. The most informative data points are taken.
    move_inducing_points : bool, default True
        Whether they are moved to where they say most, or stay where data points are, for half the time.
    memory_limit_gb : float, optional
        Memory that the computation may take, 1e9 bytes; four fifths of what is free by default. More is refused
        before it is taken.
    n_jobs : int, default 1
        Threads.
    random_state : int, default 0
        Seed of the subset and of the starts.
    progress : callable, optional
        Called with (stage, done, total) now and then. What it raises stops the search, and so does Ctrl-C: the
        estimator is then fitted with the best hyperparameters so far, and the exception is raised.

    Attributes
    ----------
    kernel_ : Kernel
        With its hyperparameters.
    noise_variance_ : float
        Variance of the noise, in the square of the unit of y.
    theta_ : array of shape (hyperparameters,)
        Natural logarithms of the hyperparameters, in the order of `theta_names_`; the noise variance is the last.
    theta_names_ : list of str
    log_marginal_likelihood_value_ : float
        Of the fitted hyperparameters; of a sparse process its lower bound.
    report_ : dict
        "status" of the search ("converged", "evaluation_limit", "no_progress" or "stopped"), its "evaluations",
        "evaluations_on_subset", hyperparameters "at_bounds", the "jitter" that was needed, the "inference" that was
        chosen ("exact", "sparse" or "subset") and the number of its "points" (of a sparse process inducing points).
    inducing_points_ : array of shape (inducing points, d), or None
    n_features_in_ : int
        Inputs.

    Examples
    --------
    >>> X = np.linspace(0, 6, 60)[:, None]
    >>> gp = sgpr.GaussianProcess(kernel="squared_exponential").fit(X, np.sin(X[:, 0]))
    >>> mean, std = gp.predict([[1.0], [100.0]], return_std=True)
    >>> round(float(mean[0]), 3), round(float(mean[1]), 3), bool(std[0] < 0.01 * std[1])
    (0.841, 0.0, True)
    """

    _estimator_type = "regressor"

    def __init__(
        self,
        kernel: str | Kernel = "squared_exponential",
        *,
        ard: bool = True,
        noise_variance: float | None = None,
        optimise: bool = True,
        starts: int = 3,
        max_evaluations: int = 100,
        budget: int | None = None,
        inducing_points: int | None = None,
        move_inducing_points: bool = True,
        memory_limit_gb: float | None = None,
        n_jobs: int = 1,
        random_state: int = 0,
        progress: Callable[[str, int, int], object] | None = None,
    ) -> None:
        self.kernel = kernel
        self.ard = ard
        self.noise_variance = noise_variance
        self.optimise = optimise
        self.starts = starts
        self.max_evaluations = max_evaluations
        self.budget = budget
        self.inducing_points = inducing_points
        self.move_inducing_points = move_inducing_points
        self.memory_limit_gb = memory_limit_gb
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.progress = progress

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Search for the hyperparameters and condition on data.

        Parameters
        ----------
        X : array of shape (N, d)
        y : array of shape (N,) or (N, outputs)
            Outputs share their hyperparameters and the work.

        Returns
        -------
        the estimator

        Raises
        ------
        GaussianProcessError
            If the data or the kernel cannot be.
        MemoryError
            If the points need more memory than allowed; the message names the size and the sparse alternative.
        """
        names = _column_names(X)
        X = _inputs(X, "fit", self)
        y = _outputs(y, X.shape[0])
        if self.budget is not None and self.inducing_points is not None:
            raise SgprError("budget and inducing_points exclude each other: give one of them")
        inducing = None if self.inducing_points is None else min(_count(self.inducing_points), X.shape[0])
        process, stopped = fit_process(
            X,
            y,
            kernel=self.kernel,
            ard=bool(self.ard),
            noise_variance=self.noise_variance,
            optimise=bool(self.optimise),
            starts=self.starts,
            max_evaluations=self.max_evaluations,
            budget=self.budget,
            inducing=inducing,
            move_inducing=bool(self.move_inducing_points),
            seed=0 if self.random_state is None else self.random_state,
            threads=1 if self.n_jobs is None else self.n_jobs,
            memory_limit_gb=self.memory_limit_gb,
            progress=self.progress,
        )
        self.n_features_in_ = X.shape[1]
        if names is None:
            vars(self).pop("feature_names_in_", None)
        else:
            self.feature_names_in_ = names
        self._single = y.ndim == 1
        self._process = process
        self.kernel_ = process.kernel
        self.noise_variance_ = process.noise_variance
        self.theta_ = process.theta
        self.theta_names_ = process.names
        self.log_marginal_likelihood_value_ = process.log_marginal_likelihood_value
        self.report_ = process.report
        self.inducing_points_ = process.inducing
        if stopped is not None:
            raise stopped
        return self

    def predict(
        self, X: ArrayLike, return_std: bool = False, *, include_noise: bool = False, return_interval: bool = False
    ) -> _Array | tuple[_Array, ...]:
        """Mean of f at points, and how sure it is.

        What is said of a measurement is calibrated by the errors of every training point predicted from all others:
        68 % of such errors are smaller than the standard deviation, 95 % smaller than half the interval. That holds for
        points that are drawn as the training points were; samples of one log are near their neighbours, unseen motion
        is not (`SemiParametricModel` leaves parts of the logs out). Of fewer than 100 points a normal distribution is
        assumed.

        Parameters
        ----------
        X : array of shape (N, d)
        return_std : bool
            Whether the standard deviation is returned, too.
        include_noise : bool
            Whether it is that of a measurement, y, calibrated, instead of f.
        return_interval : bool
            Whether half of the interval that 95 % of the measurements fall into is returned, too.

        Returns
        -------
        mean : array of shape (N,) or (N, outputs)
        std : array of the same shape
            If asked for.
        half_interval : array of the same shape
            If asked for.

        Examples
        --------
        >>> rng = np.random.default_rng(0)
        >>> X = rng.uniform(0, 6, (200, 1))
        >>> y = np.sin(X[:, 0]) + 0.1 * rng.standard_t(3, 200)
        >>> gp = sgpr.GaussianProcess().fit(X, y)
        >>> mean, std, half = gp.predict([[1.0]], True, include_noise=True, return_interval=True)
        >>> bool(half[0] > 2.2 * std[0])  # heavy tails
        True
        """
        process: FittedProcess = self._require_fitted("_process")
        _check_column_names(X, self)
        mean, std = process.predict(_inputs(X, "predict", self), return_std or return_interval)
        found = [mean]
        if std is not None:
            of_signal = np.repeat(std[:, None], mean.shape[1], axis=1)
            of_measurement = np.sqrt(of_signal**2 + self.noise_variance_)
            deviation, half_interval = process.calibration() if include_noise or return_interval else (1.0, 1.0)
            if return_std:
                found.append(of_measurement * deviation if include_noise else of_signal)
            if return_interval:
                found.append(of_measurement * half_interval)
        found = [values[:, 0] if self._single else values for values in found]
        return found[0] if len(found) == 1 else tuple(found)

    def score(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> float:
        """Coefficient of determination R² of the predicted mean, averaged over outputs.

        Parameters
        ----------
        X : array of shape (N, d)
        y : array of shape (N,) or (N, outputs)
        sample_weight : array of shape (N,), optional

        Returns
        -------
        float
            At most one; zero for the mean of y.
        """
        predicted = np.asarray(self.predict(X))
        y = np.asarray(y, dtype=float).reshape(predicted.shape)
        weight = np.ones(len(y)) if sample_weight is None else np.asarray(sample_weight, dtype=float)
        residual = np.tensordot(weight, (y - predicted) ** 2, 1)
        spread = np.tensordot(weight, (y - np.average(y, axis=0, weights=weight)) ** 2, 1)
        return float(np.mean(1.0 - residual / np.where(spread > 0.0, spread, 1.0)))

    def log_marginal_likelihood(
        self, theta: ArrayLike | None = None, eval_gradient: bool = False
    ) -> float | tuple[float, _Array]:
        """Log marginal likelihood of the training data, summed over outputs; of a sparse process its lower bound.

        Parameters
        ----------
        theta : array of shape (hyperparameters,), optional
            Natural logarithms, as `theta_`; those by default.
        eval_gradient : bool
            Whether the gradient by theta is returned, too.

        Returns
        -------
        float, or float and array of shape (hyperparameters,)
        """
        process: FittedProcess = self._require_fitted("_process")
        value, gradient = process.log_marginal_likelihood(self.theta_ if theta is None else theta, eval_gradient)
        return value if gradient is None else (value, gradient)

    def leave_one_out(self) -> tuple[_Array, _Array, float]:
        """Predict every training point from all others, in closed form; a sparse process through its inducing points.

        Returns
        -------
        mean : array of the shape of y
        std : array of shape (N,)
            Of the measurement.
        log_predictive_density : float
            Sum of the log densities of y under these predictions.
        """
        process: FittedProcess = self._require_fitted("_process")
        mean, std, density = process.leave_one_out()
        return (mean[:, 0] if self._single else mean), std, density

    def predictor(
        self, *, single_precision: bool = False, variance_rank: int | None = 0, compact: bool = False
    ) -> ProcessPredictor:
        """Predict one point after the other, for a control loop.

        Parameters
        ----------
        single_precision : bool
            Twice as fast; `ProcessPredictor.error` says what it costs.
        variance_rank : int or None
            What the variance is computed from: nothing, for no variance (0), all measurements (None), or so many
            combinations of them, those that say most. A variance of lower rank is too large, never too small;
            `ProcessPredictor.variance_error` says by how much at most, at points of the data and between them. A
            prediction then reads rank * N numbers instead of N²/2; 100 to 200 are enough for many logs.
        compact : bool
            Less memory to read, for points that do not fit into the cache: points on a grid of 16 bits for each input,
            with weights that are exact for these points, and variances from numbers of 32 bits. Conditions the process
            anew, which takes N³/3 operations. `error` and `variance_error` say what it costs.

        Returns
        -------
        ProcessPredictor
        """
        process: FittedProcess = self._require_fitted("_process")
        return process.predictor(single_precision, variance_rank, compact)

    def plot(self, X: ArrayLike, y: ArrayLike | None = None) -> Any:
        """Plot the first output at points: over a single input, or measured over predicted.

        Parameters
        ----------
        X : array of shape (N, d)
        y : array of shape (N,) or (N, outputs), optional
            What was measured there; needed with several inputs.

        Returns
        -------
        plotly.graph_objects.Figure

        Raises
        ------
        ValueError
            If X has another width than the fit, or y is missing with several inputs.

        Examples
        --------
        >>> X = np.linspace(0, 6, 50)[:, None]
        >>> figure = sgpr.GaussianProcess().fit(X, np.sin(X[:, 0])).plot(X, np.sin(X[:, 0]))
        """
        from ._views import plot_process

        self._require_fitted("_process")
        return plot_process(self, np.asarray(X, dtype=np.float64), None if y is None else np.asarray(y))

    def _repr_html_(self) -> str:
        from html import escape

        from ._views import process_html

        return process_html(self) if hasattr(self, "_process") else f"<pre>{escape(repr(self))}</pre>"

    def __sklearn_tags__(self) -> Any:
        """Describe the estimator to scikit-learn."""
        tags = import_module("sklearn.utils")
        return tags.Tags(
            estimator_type="regressor",
            target_tags=tags.TargetTags(required=True, multi_output=True),
            input_tags=tags.InputTags(),
            regressor_tags=tags.RegressorTags(),
        )


def _count(inducing_points: object) -> int:
    if not isinstance(inducing_points, int | np.integer) or inducing_points < 1:
        raise SgprError(f"inducing_points = {inducing_points}: expected a whole number, at least 1")
    return int(inducing_points)


def _inputs(X: ArrayLike, name: str, estimator: GaussianProcess) -> _Array:
    """X as an array of floats; shapes are checked here for messages that scikit-learn's tools know."""
    if hasattr(X, "toarray"):
        raise TypeError("X is a sparse matrix; a dense array is required: call X.toarray()")
    array = np.asarray(X)
    if np.iscomplexobj(array):
        raise SgprError("Complex data not supported: X must be real")
    if array.dtype == object or array.dtype.kind in "US":
        try:
            array = array.astype(float)
        except (TypeError, ValueError) as error:
            raise type(error)(
                f"X: expected an array of real numbers; argument must be a string or a number: {error}"
            ) from None
    if array.ndim != 2:
        raise SgprError(f"X: got {array.ndim} dimensions, expected 2D array. Reshape your data with X.reshape(-1, 1)")
    if array.shape[1] == 0:
        raise SgprError(f"X: 0 feature(s) (shape={array.shape}) while a minimum of 1 is required.")
    if name == "fit" and array.shape[0] == 0:
        raise SgprError(f"X: 0 sample(s) (shape={array.shape}) while a minimum of 1 is required.")
    if name == "predict" and array.shape[1] != estimator.n_features_in_:
        raise SgprError(
            f"X has {array.shape[1]} features, but {type(estimator).__name__} is expecting "
            f"{estimator.n_features_in_} features as input"
        )
    array = np.ascontiguousarray(array, dtype=float)
    if not np.isfinite(array).all():
        raise SgprError("X contains NaN or infinity: drop such rows first")
    return array


def _outputs(y: ArrayLike | None, rows: int) -> _Array:
    if y is None:
        raise SgprError("requires y to be passed, but the target y is None")
    array = np.asarray(y)
    if np.iscomplexobj(array):
        raise SgprError("Complex data not supported: y must be real")
    if array.ndim == 2 and array.shape[1] == 1:
        import sys
        import warnings

        module = sys.modules.get("sklearn.exceptions")
        category = UserWarning if module is None else module.DataConversionWarning
        warnings.warn("A column-vector y was passed when a 1d array was expected", category, stacklevel=3)
        array = array[:, 0]
    array = np.ascontiguousarray(array, dtype=float)
    if array.ndim not in (1, 2) or array.shape[0] != rows:
        raise SgprError(
            f"y: got {array.shape}, expected ({rows},) or ({rows}, outputs): inconsistent numbers of samples"
        )
    if not np.isfinite(array).all():
        raise SgprError("y contains NaN or infinity: drop such rows first")
    return array


def _column_names(X: Any) -> NDArray[np.object_] | None:
    columns = getattr(X, "columns", None)
    if columns is None or not all(isinstance(name, str) for name in columns):
        return None
    return np.asarray(columns, dtype=object)


def _check_column_names(X: Any, estimator: GaussianProcess) -> None:
    names, known = _column_names(X), vars(estimator).get("feature_names_in_")
    if names is not None and known is not None and list(names) != list(known):
        raise SgprError(
            "The feature names should match those that were passed during fit: "
            f"got {', '.join(names)}, expected {', '.join(known)}"
        )
