"""Physics and what it leaves over, with scikit-learn's manners."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._estimator import Estimator
from ._files import make_folder_of
from ._sgpr import (
    Comparison,
    FittedSemiParametric,
    LogSet,
    Model,
    Recording,
    Robot,
    SemiParametricPredictor,
    fit_semi_parametric,
)

_Array = NDArray[np.float64]


class SemiParametricModel(Estimator):
    """tau = physics(q, dq, ddq) + f(x) + noise, with a Gaussian process f of what the physics leaves over at each
    joint.

    The physics is what `identify` finds. The process of a joint sees q, dq and ddq, or some of them: stretches of the
    logs are left out in turn, and only a process that predicts those better than the physics alone is kept. Far from
    the data its mean is zero, so that the physics still predicts. Errors that neighbouring samples share have a
    kernel of their own, over time, so that the process does not take them for a function of the motion.

    Parameters
    ----------
    robot : Robot
    effects : list of str, optional
        Physics beside the rigid body, as in `identify`.
    physics : Model, optional
        The physics if it is there already, such as the model of a diagnosis with the effects that were found;
        identified from the logs by default. Give its robot, `physics.robot`, as the robot.
    kernel : {"squared_exponential", "exponential", "matern32", "matern52", "rational_quadratic"}
    ard : bool, default True
        A length scale for each input, or one for all.
    inputs : str, optional
        What the processes look at: "own_velocity", "own_joint", "own_motion", "velocities", "positions",
        "positions_and_velocities" or "all"; chosen for each joint by stretches left out by default (among all but
        "own_motion").
    shared : bool, default False
        One kernel for all joints, over the points at which all of them move: a faster fit and a faster predictor, often
        less accurate, for joints differ. Of the inputs "velocities", "positions", "positions_and_velocities" and "all".
    mean : {"physics", "joint", "zero"}
        What the processes are the rest of: the physics as least squares found it, the physics estimated again together
        with them (generalised least squares; the hyperparameters are searched with the linear parameters unknown, and a
        joint where that predicts stretches left out no better than the physics has no process), or nothing, for
        comparison.
    points : int, default 500
        Budget of each process. Of more rows the most informative ones are taken, for the search for hyperparameters
        and, unless `sparse`, for the process.
    sparse : bool, optional
        Whether more rows than the budget are all seen, through as many inducing points (time grows with the rows times
        the square of the budget); by default chosen for each joint by stretches left out, from ten rows per
        point on.
    starts : int, default 1
        Starts of the search for hyperparameters.
    max_evaluations : int, default 60
        Evaluations of the likelihood in each search.
    n_jobs : int, default 2
        Threads, which share the joints among them.
    progress : callable, optional
        Called with (stage, done, total) now and then. What it raises stops the work, and so does Ctrl-C: once the
        physics is there, the model is then fitted with the processes so far, and the exception is raised.
    options : dict, optional
        Further options of `identify`: method, cutoff_hz, ...; {"start": "zero"} for the feedback torque of an internal
        model (case 2 of the thesis).

    Attributes
    ----------
    physics_ : Model
        Its `report` says what speaks against the logs, unless `physics` was given.
    reports_ : list of dict
        For each joint what was tried, chosen ("inputs", None if the physics alone is better; "inference": "exact",
        "subset" or "sparse", with all rows as points, some of them, or all seen through inducing points) and learned.
    stopped_ : bool
        Whether the search was stopped before its end.

    Examples
    --------
    >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
    >>> model = sgpr.SemiParametricModel(robot, effects=[], inputs="own_velocity", points=50, max_evaluations=10)
    >>> model = model.fit([log])
    >>> tau, std = model.predict(np.zeros((3, 6)), np.zeros((3, 6)), np.zeros((3, 6)), return_std=True)
    >>> tau.shape, std.shape
    ((3, 6), (3, 6))
    """

    def __init__(
        self,
        robot: Robot,
        *,
        effects: Sequence[str] | None = None,
        physics: Model | None = None,
        kernel: str = "squared_exponential",
        ard: bool = True,
        inputs: str | None = None,
        shared: bool = False,
        mean: str = "physics",
        points: int = 500,
        sparse: bool | None = None,
        starts: int = 1,
        max_evaluations: int = 60,
        n_jobs: int = 2,
        progress: Callable[[str, int, int], object] | None = None,
        options: dict[str, Any] | None = None,
    ) -> None:
        self.robot = robot
        self.effects = effects
        self.physics = physics
        self.kernel = kernel
        self.ard = ard
        self.inputs = inputs
        self.shared = shared
        self.mean = mean
        self.points = points
        self.sparse = sparse
        self.starts = starts
        self.max_evaluations = max_evaluations
        self.n_jobs = n_jobs
        self.progress = progress
        self.options = options

    def fit(self, recordings: Sequence[Recording] | LogSet) -> Self:
        """Identify the physics, then learn what it leaves over.

        Parameters
        ----------
        recordings : list of Recording or LogSet
            With torque; each one a trajectory of its own.

        Returns
        -------
        the model

        Raises
        ------
        RecordingError, IdentificationError
            As `identify`.
        """
        options = dict(self.options or {}, progress=self.progress)
        if self.effects is not None:
            options["effects"] = list(self.effects)
        fitted, stopped = fit_semi_parametric(
            self.robot,
            recordings,
            physics=self.physics,
            mean=self.mean,
            kernel=self.kernel,
            ard=bool(self.ard),
            inputs=self.inputs,
            shared=bool(self.shared),
            points=self.points,
            sparse=self.sparse,
            starts=self.starts,
            max_evaluations=self.max_evaluations,
            n_jobs=self.n_jobs,
            options=options,
        )
        self._set(fitted)
        if stopped is not None:
            raise stopped
        return self

    def _set(self, fitted: FittedSemiParametric) -> None:
        self._fitted = fitted
        self.physics_: Model = fitted.physics
        self.reports_ = fitted.reports
        self.stopped_ = fitted.stopped

    def predict(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        return_std: bool = False,
        *,
        return_interval: bool = False,
        return_novelty: bool = False,
    ) -> Any:
        """Torque that a motion needs, and how sure it is.

        Effects of the physics that need time, a sampling rate or another channel are left out; `compare` has them all.

        Parameters
        ----------
        q, dq, ddq : array of shape (N, n) or (n,)
            rad, rad/s, rad/s² (m for prismatic joints).
        return_std : bool
            Whether the standard deviation of a measurement in the band of the model is returned, too: half the interval
            of 68 %.
        return_interval : bool
            Whether half the interval of 95 % is returned, too: 1.96 standard deviations for errors with a normal
            distribution, more where those on parts left out had heavy tails.
        return_novelty : bool
            Whether the share of the process's variance that the data have not explained is returned, too: 0 at a point
            of the data, 1 far from all, where the prediction is that of the physics; 0 for a joint without a process.

        Returns
        -------
        tau : array of the shape of q
            N·m (N).
        std, interval, novelty : array of the shape of q
            If asked for.
        """
        fitted: FittedSemiParametric = self._require_fitted("_fitted")
        asked = [return_std, return_interval, return_novelty]
        tau, spread = fitted.predict(q, dq, ddq, any(asked))
        if spread is None:
            return tau
        return tau, *(values for values, wanted in zip(spread, asked, strict=True) if wanted)

    def compare(self, recordings: Sequence[Recording] | LogSet) -> Comparison:
        """Compare with recordings, best with logs that no fit has seen, as `sgpr.compare` does."""
        fitted: FittedSemiParametric = self._require_fitted("_fitted")
        return fitted.compare(recordings)

    def compare_with_spread(self, recordings: Sequence[Recording] | LogSet) -> tuple[Comparison, list[list[_Array]]]:
        """Compare with recordings, and say how sure the predictions are.

        Returns
        -------
        Comparison
        list of [std, interval, novelty], (N, n) each
            For each of the comparison's logs, as `predict` returns them.
        """
        fitted: FittedSemiParametric = self._require_fitted("_fitted")
        return fitted.compare_with_spread(recordings)

    def score(self, recordings: Sequence[Recording] | LogSet) -> float:
        """Share of the variance of the torque that is explained on recordings, the mean over joints; at most one."""
        fitted: FittedSemiParametric = self._require_fitted("_fitted")
        return fitted.score(recordings)

    def coverage(self, recordings: Sequence[Recording] | LogSet, *, following: bool = False) -> list[dict[str, Any]]:
        """How many measurements fall within their predicted intervals.

        Parameters
        ----------
        recordings : list of Recording or LogSet
            Logs that no fit has seen.
        following : bool
            Whether the intervals follow the errors of the torques measured before (adaptive conformal inference),
            rather than stay as they are predicted from the motion alone: they then hold on logs with disturbances
            that the training logs do not have, too.

        Returns
        -------
        list of dict
            For each joint "joint", "samples", "percent_68" and "percent_95", the measurements within the intervals
            of 68 and 95 %, percent, and "half_width_68" and "half_width_95", half these intervals, the mean over the
            samples, N·m (N).
        """
        fitted: FittedSemiParametric = self._require_fitted("_fitted")
        return fitted.coverage(recordings, following)

    def predictor(
        self,
        *,
        single_precision: bool = False,
        variance_rank: int | None = 0,
        compact: bool = False,
        rate_hz: float | None = None,
        purpose: Literal["expected_measurement", "feed_forward"] = "expected_measurement",
        keep: Sequence[str] = (),
    ) -> SemiParametricPredictor:
        """Predict one sample after the other, for a control loop.

        Parameters
        ----------
        single_precision : bool
            Twice as fast.
        variance_rank : int or None
            What variances are computed from: nothing, for no variance (0), all measurements (None), or so many
            combinations of them, those that say most: faster, and too large rather than too small.
        compact : bool
            Points on a grid of 16 bits for each input and variances from numbers of 32 bits: less memory to read.
        rate_hz : float, optional
            Rate of the calls, for effects of the physics that need it; as for `Model.predictor`, as are the next two.
        purpose : {"expected_measurement", "feed_forward"}
            What the torque of the physics is for. The processes hold what the physics leaves, whatever it is.
        keep : list of str
            Effects that a feed-forward torque holds all the same.

        Returns
        -------
        SemiParametricPredictor
        """
        fitted: FittedSemiParametric = self._require_fitted("_fitted")
        return fitted.predictor((single_precision, variance_rank, compact), (rate_hz, purpose, list(keep)))

    def plot(self, recordings: Sequence[Recording] | LogSet) -> Any:
        """Plot measured torque of recordings, that of the physics and that with the processes, joint by joint.

        Returns
        -------
        plotly.graph_objects.Figure
        """
        from ._views import plot_semi_parametric

        self._require_fitted("_fitted")
        return plot_semi_parametric(self, recordings)

    def report(
        self, path: str | PathLike[str], train: Sequence[Recording] | LogSet, test: Sequence[Recording] | LogSet = ()
    ) -> None:
        """Write the page of `sgpr learn`: what was learned, how sure it is, and the errors with and without it.

        Parameters
        ----------
        path : path
            Of the HTML file, which needs no other; complete or not there.
        train : list of Recording or LogSet
            The logs of `fit`.
        test : list of Recording or LogSet, optional
            Unseen logs to judge by.
        """
        from ._pages import rest_page

        self._require_fitted("_fitted")
        rest_page(self, path, train, test)

    def _repr_html_(self) -> str:
        from html import escape

        from ._views import semi_parametric_html

        return semi_parametric_html(self) if hasattr(self, "_fitted") else f"<pre>{escape(repr(self))}</pre>"

    def save(self, path: str | PathLike[str]) -> None:
        """Write the model to a file; the file is complete or not there. `load` reads it back."""
        fitted: FittedSemiParametric = self._require_fitted("_fitted")
        make_folder_of(path)
        fitted.save(path)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a model file. Safe with files from strangers: nothing in them is run.

        Raises
        ------
        ModelFileError
            If the file is no semi-parametric model, damaged, or of a later version.
        OSError
            If the file cannot be read.
        """
        fitted = FittedSemiParametric.load(path)
        model = cls(fitted.physics.robot, effects=fitted.physics.effects, mean=fitted.mean)
        model._set(fitted)
        return model
