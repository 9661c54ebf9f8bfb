//! Gaussian processes: kernels, fitting, prediction. The estimator with scikit-learn's interface is
//! written in Python.

use std::sync::{Mutex, PoisonError};

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use sgpr_core::gp::{
    self as core, Calibration, Compute, Covariance, Data, GaussianProcess, GpError, GpPredictor,
    Inference, LeaveOneOut, Likelihood, LikelihoodMemory, Precision, PredictorOptions,
    SearchOptions, SearchStatus, Shape, SparseBound, SparseGaussianProcess, SparseOptions,
};

use crate::convert::{Numbers, array, choice, positive, whole};
use crate::detached::detached;
use crate::errors::{IntoPyErr, invalid};
use crate::progress::listen_and_keep;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// A stationary shape by its name.
pub fn shape(name: &str) -> PyResult<Shape> {
    let rational = Shape::RationalQuadratic { mixture: 1.0 };
    let shapes =
        [Shape::SquaredExponential, Shape::Exponential, Shape::Matern32, Shape::Matern52, rational];
    choice("kernel", name, &shapes.map(|shape| (shape.name(), shape)))
}

/// How a search ended, in words.
pub fn status_name(status: SearchStatus) -> &'static str {
    match status {
        SearchStatus::Converged => "converged",
        SearchStatus::EvaluationLimit => "evaluation_limit",
        SearchStatus::NoProgress => "no_progress",
        SearchStatus::Stopped => "stopped",
    }
}

/// Covariance function: a stationary shape over chosen inputs, to be added and multiplied. Never
/// changes.
///
/// Parameters
/// ----------
/// shape : {"squared_exponential", "exponential", "matern32", "matern52", "rational_quadratic"}
/// inputs : list of int
///     Columns of X that it looks at.
/// length_scale : float or list of float
///     One for all inputs, or one each (automatic relevance determination), in units of the input.
/// variance : float
///     k(x, x).
/// mixture : float
///     Of a rational quadratic.
/// periods : dict, optional
///     {column: difference after which everything repeats}, 2 pi for an angle.
///
/// Examples
/// --------
/// >>> friction = sgpr.Kernel("matern32", [2], variance=0.5)
/// >>> rest = sgpr.Kernel("squared_exponential", [0, 1, 2], [1.0, 1.0, 2.0])
/// >>> kernel = friction + rest
/// >>> kernel.names[:3]
/// ['signal_variance', 'length_scale[2]', 'signal_variance']
/// >>> kernel(np.zeros((1, 3)), np.zeros((1, 3)))
/// array([[1.5]])
#[pyclass(module = "sgpr", frozen, eq)]
#[derive(PartialEq, Clone)]
pub struct Kernel {
    /// Of the core.
    pub inner: core::Kernel,
}

#[pymethods]
impl Kernel {
    #[new]
    #[pyo3(signature = (shape, inputs, length_scale=None, *, variance=1.0, mixture=1.0, periods=None),
        text_signature = "(shape, inputs, length_scale=1.0, *, variance=1.0, mixture=1.0, \
             periods=None)")]
    fn new(
        shape: &str,
        inputs: &Bound<'_, PyAny>,
        length_scale: Option<&Bound<'_, PyAny>>,
        variance: f64,
        mixture: f64,
        periods: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let shape = match self::shape(shape)? {
            Shape::RationalQuadratic { .. } => {
                Shape::RationalQuadratic { mixture: positive("mixture", mixture)? }
            }
            shape => shape,
        };
        let expected = |_| {
            invalid(format!("inputs = {inputs}: expected a list of whole numbers, columns of X"))
        };
        let columns = inputs
            .try_iter()
            .map_err(expected)?
            .map(|input| whole("inputs", &input?, 0..LARGEST_INPUT));
        let columns = columns.collect::<PyResult<Vec<usize>>>()?;
        let kernel = match length_scale {
            None => core::Kernel::isotropic(shape, columns.len(), 1.0),
            Some(scale) => {
                let numbers = Numbers::new("length_scale", scale)?.finite()?;
                match (numbers.shape(), numbers.values()) {
                    ([], &[scale]) => core::Kernel::isotropic(shape, columns.len(), scale),
                    (&[length], scales) if length == columns.len() => {
                        core::Kernel::ard(shape, scales)
                    }
                    _ => return Err(numbers.wrong_shape(&format!("() or ({},)", columns.len()))),
                }
            }
        };
        let mut kernel = kernel.on(&columns);
        for (column, period) in periods.map(|given| pairs(given)).transpose()?.unwrap_or_default() {
            kernel = kernel.with_period(column, positive("periods", period)?);
        }
        let inner = kernel.scaled(variance);
        inner.validate(LARGEST_INPUT).map_err(IntoPyErr::into_py_err)?;
        Ok(Self { inner })
    }

    /// Sum of independent functions.
    fn __add__(&self, other: &Self) -> Self {
        Self { inner: self.inner.clone().plus(other.inner.clone()) }
    }

    /// Points are alike only if they are so for both.
    fn __mul__(&self, other: &Self) -> Self {
        Self { inner: self.inner.clone().times(other.inner.clone()) }
    }

    /// Natural logarithms of the hyperparameters, in the order of `names`.
    #[getter]
    fn theta<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let theta = self.inner.theta();
        array(py, &[theta.len()], theta)
    }

    /// Names of the hyperparameters; numbers in brackets are columns.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.inner.names()
    }

    /// The same kernel with other hyperparameters.
    fn with_theta(&self, theta: &Bound<'_, PyAny>) -> PyResult<Self> {
        let numbers = Numbers::new("theta", theta)?.shaped(&[self.inner.theta_len()])?.finite()?;
        Ok(Self { inner: self.inner.with_theta(numbers.values()) })
    }

    /// k(X, Y), (N, M); Y is X if not given.
    #[pyo3(signature = (X, Y=None))]
    #[allow(non_snake_case)]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        X: &Bound<'py, PyAny>,
        Y: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Array<'py>> {
        let a = points("X", X)?;
        let b = Y.map(|y| points("Y", y)).transpose()?;
        let b = b.as_ref().unwrap_or(&a);
        let (rows, columns, width) = (a.shape()[0], b.shape()[0], a.shape()[1]);
        if b.shape()[1] != width {
            return Err(b.wrong_shape(&format!("(M, {width})")));
        }
        if self.inner.inputs() > width {
            return Err(a.wrong_shape(&format!("(N, {} or more)", self.inner.inputs())));
        }
        let (a, b) = (a.values(), b.values());
        let values = detached(py, || {
            let pairs =
                a.chunks_exact(width).flat_map(|a| b.chunks_exact(width).map(move |b| (a, b)));
            pairs.map(|(a, b)| self.inner.value(a, b)).collect()
        });
        array(py, &[rows, columns], values)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        let text =
            serde_json::to_string(&slf.get().inner).map_err(|error| invalid(error.to_string()))?;
        Ok((slf.get_type().getattr("from_json")?, (text,)))
    }

    /// The kernel that `to_json` described.
    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Self> {
        let inner: core::Kernel = serde_json::from_str(text)
            .map_err(|error| invalid(format!("not a kernel: {error}")))?;
        inner.validate(LARGEST_INPUT).map_err(IntoPyErr::into_py_err)?;
        Ok(Self { inner })
    }

    /// The kernel as JSON.
    fn to_json(&self) -> PyResult<String> {
        serde_json::to_string(&self.inner).map_err(|error| invalid(error.to_string()))
    }

    fn __repr__(&self) -> String {
        let values = self.inner.theta();
        let parts = self
            .inner
            .names()
            .into_iter()
            .zip(values)
            .map(|(name, value)| format!("{name}={:.4}", value.exp()));
        format!("Kernel({})", parts.collect::<Vec<_>>().join(", "))
    }
}

/// More inputs than anyone has.
const LARGEST_INPUT: usize = 1 << 20;

/// {column: number}.
fn pairs(given: &Bound<'_, PyAny>) -> PyResult<Vec<(usize, f64)>> {
    let expected =
        |_| invalid(format!("periods = {given}: expected a dict, {{column of X: number}}"));
    let pairs = given.call_method0("items").map_err(expected)?;
    pairs.try_iter()?.map(|pair| pair?.extract().map_err(expected)).collect()
}

fn points<'py>(name: &str, value: &Bound<'py, PyAny>) -> PyResult<Numbers<'py>> {
    let numbers = Numbers::new(name, value)?;
    match numbers.shape() {
        [_, columns] if *columns > 0 => numbers.finite(),
        _ => Err(numbers.wrong_shape("(N, d)")),
    }
}

/// A fitted Gaussian process; `sgpr.GaussianProcess` makes and holds it.
#[pyclass(module = "sgpr._sgpr", frozen)]
pub struct FittedProcess {
    process: Process,
    data: Data,
    compute: Compute,
    report: Report,
    /// Of the last likelihood; taken by one call at a time.
    memory: Mutex<Option<LikelihoodMemory>>,
    /// Found when first asked for.
    calibration: Mutex<Option<Vec<Calibration>>>,
}

impl FittedProcess {
    fn new(process: Process, data: Data, compute: Compute, report: Report) -> Self {
        Self {
            process,
            data,
            compute,
            report,
            memory: Mutex::default(),
            calibration: Mutex::default(),
        }
    }

    fn left_out(&self) -> Result<LeaveOneOut, GpError> {
        match &self.process {
            Process::Exact(gp) => Ok(gp.leave_one_out()),
            Process::Sparse(gp) => gp.leave_one_out(&self.data),
        }
    }
}

enum Process {
    Exact(GaussianProcess),
    Sparse(SparseGaussianProcess),
}

/// How the hyperparameters were found.
#[derive(Clone, Default)]
struct Report {
    inference: &'static str,
    status: Option<SearchStatus>,
    evaluations: usize,
    evaluations_on_subset: usize,
    at_bounds: Vec<String>,
    jitter: f64,
}

impl Process {
    fn covariance(&self) -> &Covariance {
        match self {
            Self::Exact(gp) => gp.covariance(),
            Self::Sparse(gp) => gp.covariance(),
        }
    }
}

/// Fits a process; returns it and what stopped the search, if anything did.
#[pyfunction]
#[pyo3(signature = (X, y, **options))]
#[allow(non_snake_case)]
pub fn fit_process(
    py: Python<'_>,
    X: &Bound<'_, PyAny>,
    y: &Bound<'_, PyAny>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<(FittedProcess, Option<PyErr>)> {
    let mut data = training_data(X, y)?;
    let mut options = FitOptions::read(options)?;
    let progress = options.progress.take();
    let start = options.start(&data)?;
    let inference = options.inference(&data, &start);
    if let Inference::Subset { points } = inference {
        let chosen = detached(py, || {
            core::informative_points(&start.signal, data.x(), data.inputs(), points)
        });
        data = data.select(&chosen);
    }
    let compute = options.compute;
    let work = |progress: &dyn sgpr_core::progress::Progress| match inference {
        Inference::Sparse { inducing } => options.sparse(&data, start, inducing, progress),
        _ => options.exact(&data, start, progress),
    };
    let ((process, mut report), stopped) = listen_and_keep(py, progress, work)?;
    report.inference = inference.name();
    Ok((FittedProcess::new(process, data, compute, report), stopped))
}

/// How a process is fitted, as Python says it.
struct FitOptions {
    /// The kernel with its hyperparameters, or the shape of one with a length scale for every
    /// input, or one for all.
    kernel: Option<core::Kernel>,
    shape: Shape,
    ard: bool,
    noise: Option<f64>,
    optimise: bool,
    search: SearchOptions,
    inducing: Option<usize>,
    budget: Option<usize>,
    move_inducing: bool,
    compute: Compute,
    progress: Option<Py<PyAny>>,
}

impl FitOptions {
    fn read(options: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut own = Self {
            kernel: None,
            shape: Shape::SquaredExponential,
            ard: true,
            noise: None,
            optimise: true,
            search: SearchOptions::default(),
            inducing: None,
            budget: None,
            move_inducing: SparseOptions::default().move_inducing,
            compute: Compute::default(),
            progress: None,
        };
        for (key, value) in options.into_iter().flatten() {
            let key: String = key.extract()?;
            if value.is_none() {
                continue;
            }
            match key.as_str() {
                "kernel" => match value.cast::<Kernel>() {
                    Ok(kernel) => own.kernel = Some(kernel.get().inner.clone()),
                    Err(_) => own.shape = shape(&word("kernel", &value)?)?,
                },
                "ard" => own.ard = value.extract()?,
                "noise_variance" => own.noise = Some(positive("noise_variance", value.extract()?)?),
                "optimise" => own.optimise = value.extract()?,
                "starts" => own.search.starts = whole("starts", &value, 1..1001)?,
                "subset" => own.search.subset = whole("subset", &value, 2..usize::MAX)?,
                "max_evaluations" => {
                    own.search.evaluations = whole("max_evaluations", &value, 1..usize::MAX)?
                }
                "inducing" => own.inducing = Some(whole("inducing", &value, 1..usize::MAX)?),
                "budget" => own.budget = Some(whole("budget", &value, 1..usize::MAX)?),
                "move_inducing" => own.move_inducing = value.extract()?,
                "seed" => own.search.seed = whole("random_state", &value, 0..usize::MAX)? as u64,
                "threads" => own.compute.threads = whole("n_jobs", &value, 1..1025)?,
                "memory_limit_gb" => {
                    own.compute.memory_limit =
                        (1e9 * positive("memory_limit_gb", value.extract()?)?) as u64;
                }
                "progress" => own.progress = Some(value.unbind()),
                _ => {
                    return Err(pyo3::exceptions::PyTypeError::new_err(format!(
                        "unexpected option '{key}'"
                    )));
                }
            }
        }
        Ok(own)
    }

    /// The covariance from which the search starts; it takes a prior of the noise.
    fn start(&mut self, data: &Data) -> PyResult<Covariance> {
        let scale = match data.mean_square() {
            0.0 => 1.0,
            scale => scale,
        };
        let inputs = data.inputs();
        let kernel = match self.kernel.take() {
            // A kernel with numbers keeps them as the start of the search.
            Some(kernel) => {
                kernel.validate(inputs).map_err(IntoPyErr::into_py_err)?;
                kernel
            }
            None => {
                let kernel = match self.ard {
                    true => core::Kernel::ard(self.shape, &vec![1.0; inputs]),
                    false => core::Kernel::isotropic(self.shape, inputs, 1.0),
                };
                let kernel = kernel.scaled(1.0);
                kernel.validate(inputs).map_err(IntoPyErr::into_py_err)?;
                kernel.fitted_to(data.x(), inputs, scale)
            }
        };
        let start = Covariance::new(kernel, self.noise.unwrap_or(1e-2 * scale));
        self.search.priors = noise_prior(&start, scale);
        Ok(start)
    }

    fn inference(&self, data: &Data, start: &Covariance) -> Inference {
        match (self.inducing, self.budget) {
            (Some(inducing), _) => Inference::Sparse { inducing },
            (None, Some(budget)) => {
                Inference::within(budget, data.len(), start.correlated_noise.is_some())
            }
            (None, None) => Inference::Exact,
        }
    }

    fn sparse(
        self,
        data: &Data,
        start: Covariance,
        inducing: usize,
        progress: &dyn sgpr_core::progress::Progress,
    ) -> Result<(Process, Report), GpError> {
        let Self { search, move_inducing, compute, .. } = self;
        if !self.optimise {
            let chosen = core::informative_points(&start.signal, data.x(), data.inputs(), inducing);
            let points = data.select(&chosen).x().to_vec();
            let gp = SparseGaussianProcess::fit(data, start, points, &compute)?;
            return Ok((Process::Sparse(gp), Report::default()));
        }
        let options = SparseOptions::default()
            .with_inducing(inducing)
            .with_move_inducing(move_inducing)
            .with_search(search);
        let (gp, found) = core::search_sparse(data, &start, &options, &compute, progress)?;
        let report = Report {
            status: Some(found.status),
            evaluations: found.evaluations,
            evaluations_on_subset: found.evaluations_on_subset,
            at_bounds: found.at_bounds,
            ..Report::default()
        };
        Ok((Process::Sparse(gp), report))
    }

    fn exact(
        self,
        data: &Data,
        start: Covariance,
        progress: &dyn sgpr_core::progress::Progress,
    ) -> Result<(Process, Report), GpError> {
        let (covariance, mut report) = if self.optimise {
            let found = core::search(data, &start, &self.search, &self.compute, progress)?;
            let report = Report {
                status: Some(found.status),
                evaluations: found.evaluations,
                evaluations_on_subset: found.evaluations_on_subset,
                at_bounds: found.at_bounds,
                jitter: found.jitter,
                ..Report::default()
            };
            (found.covariance, report)
        } else {
            (start, Report::default())
        };
        let gp = GaussianProcess::fit(data.clone(), covariance, &self.compute)?;
        report.jitter = report.jitter.max(gp.jitter());
        Ok((Process::Exact(gp), report))
    }
}

/// What a predictor keeps, as the methods `predictor` are given it.
pub fn predictor_options(
    single: bool,
    variance_rank: Option<usize>,
    compact: bool,
) -> PredictorOptions {
    let precision = if single { Precision::Single } else { Precision::Double };
    PredictorOptions::default()
        .with_precision(precision)
        .with_variance_rank(variance_rank)
        .with_compact(compact)
}

/// The process that `FittedProcess.__reduce__` described.
#[pyfunction]
pub fn restore_process(
    py: Python<'_>,
    x: &Bound<'_, PyAny>,
    y: &Bound<'_, PyAny>,
    covariance: &str,
    inducing: Option<&Bound<'_, PyAny>>,
    threads: usize,
) -> PyResult<FittedProcess> {
    let data = training_data(x, y)?;
    let covariance: Covariance = serde_json::from_str(covariance)
        .map_err(|error| invalid(format!("not a Gaussian process: {error}")))?;
    let inducing = inducing
        .map(|given| points("inducing", given))
        .transpose()?
        .map(|points| points.values().to_vec());
    let compute = Compute::default().with_threads(threads.clamp(1, 1024));
    let process = detached(py, || match inducing {
        Some(inducing) => {
            SparseGaussianProcess::fit(&data, covariance, inducing, &compute).map(Process::Sparse)
        }
        None => GaussianProcess::fit(data.clone(), covariance, &compute).map(Process::Exact),
    });
    let process = process.map_err(IntoPyErr::into_py_err)?;
    Ok(FittedProcess::new(process, data, compute, Report::default()))
}

fn word(name: &str, value: &Bound<'_, PyAny>) -> PyResult<String> {
    match value.cast::<PyString>() {
        Ok(text) => Ok(text.to_string()),
        Err(_) => Err(invalid(format!("{name} = {}: expected a word or a Kernel", value.repr()?))),
    }
}

/// Weak, on the noise only: within a factor of some twenty of a hundredth of the mean square, where
/// data say nothing.
fn noise_prior(start: &Covariance, scale: f64) -> Vec<Option<(f64, f64)>> {
    let mut priors = vec![None; start.theta().len()];
    *priors.last_mut().expect("the noise variance") = Some(((1e-2 * scale).ln(), 3.0));
    priors
}

fn training_data(x: &Bound<'_, PyAny>, y: &Bound<'_, PyAny>) -> PyResult<Data> {
    let x = points("X", x)?;
    let y = Numbers::new("y", y)?.finite()?;
    let rows = x.shape()[0];
    let outputs = match *y.shape() {
        [length] if length == rows => 1,
        [length, outputs] if length == rows && outputs > 0 => outputs,
        _ => return Err(y.wrong_shape(&format!("({rows},) or ({rows}, outputs)"))),
    };
    Data::new(x.values().to_vec(), x.shape()[1], y.values().to_vec(), outputs)
        .map_err(IntoPyErr::into_py_err)
}

#[pymethods]
impl FittedProcess {
    /// Mean, (N, outputs), and standard deviation of the signal, (N,), if asked for.
    #[pyo3(signature = (X, with_std))]
    #[allow(non_snake_case)]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        X: &Bound<'py, PyAny>,
        with_std: bool,
    ) -> PyResult<(Array<'py>, Option<Array<'py>>)> {
        let x = points("X", X)?;
        if x.shape()[1] != self.data.inputs() {
            return Err(x.wrong_shape(&format!("(N, {})", self.data.inputs())));
        }
        let values = x.values();
        let prediction = detached(py, || match &self.process {
            Process::Exact(gp) => gp.predict(values, with_std),
            Process::Sparse(gp) => gp.predict(values, with_std),
        });
        let prediction = prediction.map_err(IntoPyErr::into_py_err)?;
        let rows = x.shape()[0];
        let std = with_std
            .then(|| array(py, &[rows], prediction.variance.iter().map(|v| v.sqrt()).collect()));
        Ok((array(py, &[rows, self.data.outputs()], prediction.mean)?, std.transpose()?))
    }

    /// Log marginal likelihood (of a sparse process its lower bound), and its gradient by theta if
    /// asked for.
    fn log_marginal_likelihood<'py>(
        &self,
        py: Python<'py>,
        theta: &Bound<'py, PyAny>,
        eval_gradient: bool,
    ) -> PyResult<(f64, Option<Array<'py>>)> {
        let current = self.process.covariance();
        let numbers = Numbers::new("theta", theta)?.shaped(&[current.theta().len()])?.finite()?;
        let covariance = current.with_theta(numbers.values());
        let result = detached(py, || -> Result<(f64, Option<Vec<f64>>), GpError> {
            match &self.process {
                Process::Exact(_) => {
                    let memory = || self.memory.lock().unwrap_or_else(PoisonError::into_inner);
                    let kept = memory().take();
                    let mut likelihood = Likelihood::with_memory(&self.data, &self.compute, kept)?;
                    let result = if eval_gradient {
                        likelihood
                            .value_and_gradient(&covariance)
                            .map(|(value, gradient)| (value, Some(gradient)))
                    } else {
                        likelihood.value(&covariance).map(|value| (value, None))
                    };
                    *memory() = Some(likelihood.into_memory());
                    result
                }
                Process::Sparse(gp) => {
                    let bound = SparseBound::new(&self.data, &self.compute);
                    if !eval_gradient {
                        return Ok((bound.value(&covariance, gp.inducing())?, None));
                    }
                    let (value, gradient) = bound.value_and_gradient(&covariance, gp.inducing())?;
                    Ok((value, Some(gradient.theta)))
                }
            }
        });
        let (value, gradient) = result.map_err(IntoPyErr::into_py_err)?;
        Ok((value, gradient.map(|gradient| array(py, &[gradient.len()], gradient)).transpose()?))
    }

    /// Of the fitted hyperparameters.
    #[getter]
    fn log_marginal_likelihood_value(&self) -> f64 {
        match &self.process {
            Process::Exact(gp) => gp.log_marginal_likelihood(),
            Process::Sparse(gp) => gp.bound(),
        }
    }

    /// Means, (N, outputs), standard deviations of the measurements, (N,), and the log predictive
    /// density.
    fn leave_one_out<'py>(&self, py: Python<'py>) -> PyResult<(Array<'py>, Array<'py>, f64)> {
        let found = detached(py, || self.left_out()).map_err(IntoPyErr::into_py_err)?;
        let rows = self.data.len();
        let deviations = found.variance.iter().map(|variance| variance.sqrt()).collect();
        let mean = array(py, &[rows, self.data.outputs()], found.mean)?;
        Ok((mean, array(py, &[rows], deviations)?, found.log_predictive_density))
    }

    /// What standard deviations of measurements have to be multiplied by to give half of the
    /// intervals of 68 and of 95 %, (outputs,) each.
    fn calibration<'py>(&self, py: Python<'py>) -> PyResult<(Array<'py>, Array<'py>)> {
        let kept = || self.calibration.lock().unwrap_or_else(PoisonError::into_inner);
        let known = kept().clone();
        let factors = match known {
            Some(factors) => factors,
            None => {
                let found = detached(py, || {
                    self.left_out().map(|left_out| left_out.calibration(&self.data))
                });
                kept().insert(found.map_err(IntoPyErr::into_py_err)?).clone()
            }
        };
        let numbers = |of: fn(&Calibration) -> f64| {
            array(py, &[factors.len()], factors.iter().map(of).collect())
        };
        Ok((numbers(|factor| factor.deviation)?, numbers(|factor| factor.half_interval_95)?))
    }

    /// Natural logarithms of the hyperparameters.
    #[getter]
    fn theta<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let theta = self.process.covariance().theta();
        array(py, &[theta.len()], theta)
    }

    /// Their names.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.process.covariance().names()
    }

    /// Kernel with its hyperparameters.
    #[getter]
    fn kernel(&self) -> Kernel {
        Kernel { inner: self.process.covariance().signal.clone() }
    }

    /// Variance of the noise.
    #[getter]
    fn noise_variance(&self) -> f64 {
        self.process.covariance().noise_variance
    }

    /// Inducing points of a sparse process.
    #[getter]
    fn inducing<'py>(&self, py: Python<'py>) -> PyResult<Option<Array<'py>>> {
        let Process::Sparse(gp) = &self.process else { return Ok(None) };
        let inputs = self.data.inputs();
        array(py, &[gp.inducing().len() / inputs, inputs], gp.inducing().to_vec()).map(Some)
    }

    /// How the search ended, and what it took.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        dict.set_item("status", self.report.status.map(status_name))?;
        dict.set_item("evaluations", self.report.evaluations)?;
        dict.set_item("evaluations_on_subset", self.report.evaluations_on_subset)?;
        dict.set_item("at_bounds", self.report.at_bounds.clone())?;
        dict.set_item("inference", self.report.inference)?;
        let points = match &self.process {
            Process::Exact(gp) => gp.data().len(),
            Process::Sparse(gp) => gp.inducing().len() / self.data.inputs(),
        };
        dict.set_item("points", points)?;
        dict.set_item("jitter", self.report.jitter)?;
        Ok(dict)
    }

    /// One point after the other.
    fn predictor(
        &self,
        py: Python<'_>,
        single: bool,
        variance_rank: Option<usize>,
        compact: bool,
    ) -> PyResult<ProcessPredictor> {
        let options = predictor_options(single, variance_rank, compact);
        let inner = detached(py, || match &self.process {
            Process::Exact(gp) => gp.predictor(options),
            Process::Sparse(gp) => Ok(gp.predictor(options)),
        });
        let with_variance = variance_rank != Some(0);
        Ok(ProcessPredictor {
            inner: Mutex::new(inner.map_err(IntoPyErr::into_py_err)?),
            with_variance,
        })
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, pyo3::types::PyTuple>)> {
        let (py, own) = (slf.py(), slf.get());
        let (rows, inputs, outputs) = (own.data.len(), own.data.inputs(), own.data.outputs());
        let covariance = serde_json::to_string(own.process.covariance())
            .map_err(|error| invalid(error.to_string()))?;
        let arguments = (
            array(py, &[rows, inputs], own.data.x().to_vec())?,
            array(py, &[rows, outputs], own.data.y().to_vec())?,
            covariance,
            own.inducing(py)?,
            own.compute.threads,
        );
        Ok((py.import("sgpr._sgpr")?.getattr("restore_process")?, arguments.into_pyobject(py)?))
    }
}

/// Predicts one point after the other, for a control loop: allocates nothing but its result. One
/// per thread.
///
/// Examples
/// --------
/// >>> X = np.linspace(0, 6, 50)[:, None]
/// >>> predictor = sgpr.GaussianProcess().fit(X, np.sin(X[:, 0])).predictor()
/// >>> round(float(predictor.mean([1.0])[0]), 2)
/// 0.84
#[pyclass(module = "sgpr", frozen)]
pub struct ProcessPredictor {
    inner: Mutex<GpPredictor>,
    with_variance: bool,
}

#[pymethods]
impl ProcessPredictor {
    /// Mean of the signal, (outputs,).
    fn mean<'py>(&self, py: Python<'py>, x: &Bound<'py, PyAny>) -> PyResult<Array<'py>> {
        let mut predictor = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        let x = Numbers::new("x", x)?.shaped(&[predictor.inputs()])?.finite()?;
        let mean = predictor.mean(x.values()).to_vec();
        array(py, &[mean.len()], mean)
    }

    /// Mean, (outputs,), standard deviation of the signal, and whether the point is far from the
    /// data.
    fn mean_and_std<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
    ) -> PyResult<(Array<'py>, f64, bool)> {
        if !self.with_variance {
            return Err(invalid("the predictor was made without variance: give variance_rank"));
        }
        let mut predictor = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        let x = Numbers::new("x", x)?.shaped(&[predictor.inputs()])?.finite()?;
        let (mean, variance) = predictor.mean_and_variance(x.values());
        let mean = mean.to_vec();
        let far = predictor.is_far(variance);
        Ok((array(py, &[mean.len()], mean)?, variance.sqrt(), far))
    }

    /// Largest error of the mean in single precision, measured at points of the data and between
    /// them.
    #[getter]
    fn error(&self) -> f64 {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).error()
    }

    /// Largest difference of the variance to that from all points in double precision, measured at
    /// the same points; of fewer points it is too large there, never too small.
    #[getter]
    fn variance_error(&self) -> f64 {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).variance_error()
    }

    fn __repr__(&self) -> String {
        let inputs = self.inner.lock().unwrap_or_else(PoisonError::into_inner).inputs();
        format!("ProcessPredictor of {inputs} inputs")
    }
}
