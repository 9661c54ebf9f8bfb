//! Excitation trajectories: found, sampled, judged, written.

use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use pythonize::{depythonize, pythonize};
use sgpr_core::effects::{Entry, by_name};
use sgpr_core::excitation::{
    self as core, Basis, Block, Criterion, ExciteOptions, MotionLimits, NominalEffects, Status,
    Surroundings,
};
use sgpr_core::identification::{BaseParameters, Forecast, ParameterSet};
use sgpr_core::model::{Term, TorqueModel};
use sgpr_core::progress::{Interrupted, Progress};
use sgpr_core::robot::Robot as CoreRobot;

use crate::convert::{Numbers, array, choice, per_joint, positive, texts, whole};
use crate::detached::detached;
use crate::errors::{IntoPyErr, invalid};
use crate::identification_report::forecast_dict;
use crate::keywords::Keywords;
use crate::model::Model;
use crate::progress::listen;
use crate::robot::Robot;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Robot, and the motion as dicts and lists.
type Pickled<'py> = (Robot, Bound<'py, PyAny>);

/// A motion of all joints, at every time: sum of functions with coefficients. Never changes.
///
/// Made by `excite`, `Trajectory.fourier` or `Trajectory.random`.
///
/// Examples
/// --------
/// >>> robot = sgpr.robots.two_link()
/// >>> motion = sgpr.Trajectory.fourier(robot, 0.1, a=[[0.3, -0.2], [-0.3, 0.2]], b=[[0.0, 0.0], [0.0, 0.0]])
/// >>> t, q, dq, ddq = motion.samples(rate_hz=20)
/// >>> q.shape
/// (200, 2)
#[pyclass(module = "sgpr", frozen)]
pub struct Trajectory {
    /// Of the core.
    pub inner: core::Trajectory,
    robot: CoreRobot,
}

#[pymethods]
impl Trajectory {
    /// A Fourier series from the amplitudes of its velocity, dq = sum a_l cos(2 pi f l t) + b_l
    /// sin(2 pi f l t), that starts at position zero.
    ///
    /// Parameters
    /// ----------
    /// robot : Robot
    /// fundamental_hz : float
    /// a, b : array of shape (terms, n)
    ///     rad/s (m/s), two terms or more.
    #[staticmethod]
    fn fourier(
        robot: &Bound<'_, Robot>,
        fundamental_hz: f64,
        a: &Bound<'_, PyAny>,
        b: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let robot = robot.get().inner.clone();
        let n = robot.dof();
        let [a, b] = [("a", a), ("b", b)].map(|(name, value)| {
            let numbers = Numbers::new(name, value)?.finite()?;
            match *numbers.shape() {
                [_, columns] if columns == n => Ok(numbers),
                _ => Err(numbers.wrong_shape(&format!("(terms, {n})"))),
            }
        });
        let (a, b) = (a?, b?);
        let b = b.shaped(a.shape())?;
        let inner = core::Trajectory::fourier(fundamental_hz, n, a.values(), b.values());
        Ok(Self { inner: inner.map_err(IntoPyErr::into_py_err)?, robot })
    }

    /// A random motion that starts and ends at rest and uses its limits to the full, for tests and
    /// for high-frequency series.
    ///
    /// Parameters
    /// ----------
    /// robot : Robot
    /// start : array of shape (n,), optional
    ///     Position at both ends, rad (m); zero, or the middle of the range where zero is outside
    ///     it.
    /// random_state : int, default 0
    /// **options
    ///     Basis and limits as in `excite`.
    ///
    /// Examples
    /// --------
    /// >>> robot = sgpr.robots.puma560()
    /// >>> test = sgpr.Trajectory.random(robot, terms=4, max_acceleration=[6] * 6, random_state=3)
    /// >>> test.duration
    /// 10.0
    #[staticmethod]
    #[pyo3(signature = (robot, *, start=None, random_state=0, **options))]
    fn random(
        robot: &Bound<'_, Robot>,
        start: Option<&Bound<'_, PyAny>>,
        random_state: u64,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let robot = robot.get().inner.clone();
        let options = Keywords::new(options, &MOTION)?;
        let (basis, limits) = (basis(&options)?, limits(&options, &robot)?);
        let start = match start {
            Some(start) => per_joint("start", start, &robot)?,
            None => limits.default_start(),
        };
        let inner = core::random_motion(&robot, &basis, &limits, &start, random_state);
        Ok(Self { inner: inner.map_err(IntoPyErr::into_py_err)?, robot })
    }

    /// Duration; one period of a series, s.
    #[getter]
    fn duration(&self) -> f64 {
        self.inner.duration()
    }

    /// Names of the joints.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.robot.joint_names().map(String::from).collect()
    }

    /// Coefficients of the functions, (n, functions): of a series a_l, b_l, q_0.
    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let shape = [self.robot.dof(), self.inner.basis().len()];
        array(py, &shape, self.inner.coefficients().to_vec())
    }

    /// Position at both ends of an optimised motion, (n,), rad (m).
    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[self.robot.dof()], self.inner.start().to_vec())
    }

    /// The same motion about its start, smaller or larger.
    fn scaled(&self, factor: f64) -> PyResult<Self> {
        if !factor.is_finite() {
            return Err(invalid(format!("factor = {factor}: expected a number")));
        }
        Ok(Self { inner: self.inner.clone().scaled(factor), robot: self.robot.clone() })
    }

    /// Position, velocity and acceleration at these times.
    ///
    /// Parameters
    /// ----------
    /// t : array of shape (N,)
    ///     s.
    ///
    /// Returns
    /// -------
    /// q, dq, ddq : arrays of shape (N, n)
    fn at<'py>(
        &self,
        py: Python<'py>,
        t: &Bound<'py, PyAny>,
    ) -> PyResult<(Array<'py>, Array<'py>, Array<'py>)> {
        let times = Numbers::new("t", t)?.finite()?;
        let [count] = *times.shape() else { return Err(times.wrong_shape("(N,)")) };
        let samples = self.inner.at(times.values().iter().copied());
        let shape = [count, self.robot.dof()];
        Ok((
            array(py, &shape, samples.q)?,
            array(py, &shape, samples.dq)?,
            array(py, &shape, samples.ddq)?,
        ))
    }

    /// Samples from time zero on.
    ///
    /// Parameters
    /// ----------
    /// rate_hz : float
    /// duration : float, optional
    ///     s; one period or the whole motion by default.
    ///
    /// Returns
    /// -------
    /// t, q, dq, ddq : arrays of shape (N,), (N, n), (N, n), (N, n)
    #[pyo3(signature = (rate_hz, duration=None))]
    #[allow(clippy::type_complexity)]
    fn samples<'py>(
        &self,
        py: Python<'py>,
        rate_hz: f64,
        duration: Option<f64>,
    ) -> PyResult<(Array<'py>, Array<'py>, Array<'py>, Array<'py>)> {
        let samples = self.sampled(rate_hz, duration)?;
        let shape = [samples.len(), self.robot.dof()];
        Ok((
            array(py, &shape[..1], samples.time)?,
            array(py, &shape, samples.q)?,
            array(py, &shape, samples.dq)?,
            array(py, &shape, samples.ddq)?,
        ))
    }

    /// How well the motion excites the base parameters.
    ///
    /// Parameters
    /// ----------
    /// effects : list of str, optional
    ///     Effects beside the rigid body, as in `excite`.
    /// noise : array of shape (n,), optional
    ///     Standard deviations of the torque, N·m (N).
    /// rate_hz : float, default 100
    ///
    /// Returns
    /// -------
    /// dict
    ///     "condition", "scaled_condition", "frobenius_condition", "link_conditions",
    ///     "sum_of_conditions", "log_determinant" (per sample), "singular_values", "rank",
    ///     "not_told_apart" (names of the parameters that the motion confuses, if rank is below
    ///     their number), "base_parameters"; with effects that enter nonlinearly "nominal", the
    ///     values at which their torque is differentiated, and "hidden", parameters that no motion
    ///     can tell from others. "base_parameters" counts those of "nominal".
    #[pyo3(signature = (effects=None, *, noise=None, rate_hz=100.0), text_signature = "($self, \
         effects=(), *, noise=None, rate_hz=100.0)")]
    fn excitation<'py>(
        &self,
        py: Python<'py>,
        effects: Option<&Bound<'py, PyAny>>,
        noise: Option<&Bound<'py, PyAny>>,
        rate_hz: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let effects = effects.map(|names| texts("effects", names)).transpose()?.unwrap_or_default();
        let noise = noise.map(|noise| per_joint("noise", noise, &self.robot)).transpose()?;
        let (set, terms) = split(&self.robot, &effects, None, self.inner.duration())?;
        let samples = self.sampled(rate_hz, None)?;
        let report = detached(py, || {
            let base = BaseParameters::new(&self.robot, &set);
            let nominal = nominal(&self.robot, &set, &base, None, terms, self.inner.duration());
            let report = core::evaluate(
                &self.robot,
                &set,
                &base,
                nominal.as_ref(),
                &samples,
                noise.as_deref(),
            );
            report.map(|report| (report, nominal))
        });
        let (report, nominal) = report.map_err(IntoPyErr::into_py_err)?;
        report_dict(py, &report, nominal.as_ref().map(named).as_ref())
    }

    /// Largest values in continuous time.
    ///
    /// Returns
    /// -------
    /// dict of arrays
    ///     "position" (n, 2), "velocity", "acceleration", "torque" (n,); the torque is that of the
    ///     rigid body.
    fn peaks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let none: &[&str] = &[];
        let set = ParameterSet::new(&self.robot, none).map_err(IntoPyErr::into_py_err)?;
        peaks_dict(
            py,
            &core::peaks(&self.robot, &set, &self.robot.standard_parameters(), &self.inner),
        )
    }

    /// Writes a table (.csv, .csv.gz) of time, position, velocity and acceleration, from rest to
    /// rest; the file is complete or not there.
    #[pyo3(signature = (path, rate_hz=100.0))]
    fn save_csv(&self, py: Python<'_>, path: PathBuf, rate_hz: f64) -> PyResult<()> {
        let samples = self.whole(rate_hz)?;
        detached(py, || samples.write_csv(&self.robot, path)).map_err(IntoPyErr::into_py_err)
    }

    /// Writes an MCAP file with one trajectory_msgs/msg/JointTrajectory message, from rest to rest;
    /// the file is complete or not there.
    #[pyo3(signature = (path, rate_hz=100.0, topic="/joint_trajectory"))]
    fn save_mcap(&self, py: Python<'_>, path: PathBuf, rate_hz: f64, topic: &str) -> PyResult<()> {
        let samples = self.whole(rate_hz)?;
        detached(py, || samples.write_mcap(&self.robot, topic, path))
            .map_err(IntoPyErr::into_py_err)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Pickled<'py>)> {
        let Self { inner, robot } = slf.get();
        Ok((
            slf.get_type().getattr("_from_parts")?,
            (robot.clone().into(), pythonize(slf.py(), inner)?),
        ))
    }

    #[staticmethod]
    fn _from_parts(robot: &Robot, trajectory: &Bound<'_, PyAny>) -> PyResult<Self> {
        let inner: core::Trajectory = depythonize(trajectory)
            .map_err(|error| invalid(format!("not a trajectory: {error}")))?;
        if inner.start().len() != robot.inner.dof() {
            return Err(invalid("not a trajectory of this robot: it has another number of joints"));
        }
        Ok(Self { inner, robot: robot.inner.clone() })
    }

    fn __repr__(&self) -> String {
        format!("Trajectory of {} joints, {} s", self.robot.dof(), self.inner.duration())
    }
}

/// Samples of one motion that an array still has room for.
const MOST_SAMPLES: f64 = 1e8;

fn rate(rate_hz: f64, duration: f64) -> PyResult<f64> {
    if positive("rate_hz", rate_hz)? * duration > MOST_SAMPLES {
        return Err(invalid(format!(
            "rate_hz = {rate_hz}: that are more than {MOST_SAMPLES} samples"
        )));
    }
    Ok(rate_hz)
}

impl Trajectory {
    fn sampled(&self, rate_hz: f64, duration: Option<f64>) -> PyResult<core::TrajectorySamples> {
        let duration = positive("duration", duration.unwrap_or(self.inner.duration()))?;
        Ok(self.inner.samples(rate(rate_hz, duration)?, duration))
    }

    fn whole(&self, rate_hz: f64) -> PyResult<core::TrajectorySamples> {
        Ok(self.inner.whole(rate(rate_hz, self.inner.duration())?))
    }
}

/// A motion that reveals the parameters, and how it was found.
#[pyclass(module = "sgpr", frozen)]
pub struct Excitation {
    inner: core::Excitation,
    criterion: Criterion,
    nominal: Option<Nominal>,
    robot: CoreRobot,
}

/// Values about which effects were judged, by name, and what no motion can tell from others.
type Nominal = (Vec<(String, f64)>, Vec<String>);

fn named(nominal: &NominalEffects) -> Nominal {
    (nominal.names().into_iter().zip(nominal.values()).collect(), nominal.hidden().to_vec())
}

/// Robot, criterion, what was found as dicts and lists, nominal values.
type Found<'py> = (Robot, &'static str, Bound<'py, PyAny>, Option<Nominal>);

#[pymethods]
impl Excitation {
    /// The motion.
    #[getter]
    fn trajectory(&self) -> Trajectory {
        Trajectory { inner: self.inner.trajectory.clone(), robot: self.robot.clone() }
    }

    /// What was made small, by its name in `excite`.
    #[getter]
    fn criterion(&self) -> &'static str {
        self.criterion.name()
    }

    /// Value of the criterion, not smoothed.
    #[getter]
    fn value(&self) -> f64 {
        self.inner.value
    }

    /// Value that each search ended with; infinite if it was not begun.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[self.inner.values.len()], self.inner.values.clone())
    }

    /// As `Trajectory.excitation`.
    #[getter]
    fn report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        report_dict(py, &self.inner.report, self.nominal.as_ref())
    }

    /// As `Trajectory.peaks`, with the torque of the parameters that were given.
    #[getter]
    fn peaks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        peaks_dict(py, &self.inner.peaks)
    }

    /// How much of this motion to record: what parameters that are identified from it, repeated,
    /// add to the torque of other motion of its kind, joint by joint. The keys are those of
    /// `IdentificationReport.forecast`; "noise" is that which was given, else 2.4 % of a joint's
    /// largest torque, the median of what models of five real robots leave, half a second of whose
    /// errors is worth one independent equation. The effects at nominal values are not in it.
    #[getter]
    fn forecast<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        forecast_dict(py, &self.inner.forecast)
    }

    /// The largest share of a limit that the motion uses, over continuous time.
    #[getter]
    fn utilisation(&self) -> f64 {
        self.inner.utilisation
    }

    /// That limit, by name: what would have to be relaxed for a larger motion.
    #[getter]
    fn tightest(&self) -> &str {
        &self.inner.tightest
    }

    /// How the searches went, (evaluations, 3): number of the search, evaluation in it, smoothed
    /// value.
    #[getter]
    fn history<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let steps = &self.inner.history;
        let rows = steps
            .iter()
            .flat_map(|step| [step.start as f64, step.evaluation as f64, step.value])
            .collect();
        array(py, &[steps.len(), 3], rows)
    }

    /// "finished", or "interrupted" by Ctrl-C or the progress callback: then it is the best motion
    /// so far.
    #[getter]
    fn status(&self) -> &'static str {
        match self.inner.status {
            Status::Finished => "finished",
            Status::Interrupted => "interrupted",
        }
    }

    /// A Plotly figure of positions, speeds and accelerations over time.
    fn plot<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("plot_excitation", (slf,))
    }

    /// Writes the page of `sgpr excite`, without the files beside it.
    fn save_report(slf: &Bound<'_, Self>, path: PathBuf) -> PyResult<()> {
        let robot = Robot::from(slf.get().robot.clone());
        slf.py().import("sgpr.reporting")?.call_method1("save_report", (slf, robot, path)).map(drop)
    }

    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("excitation_html", (slf,))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Found<'py>)> {
        let Self { inner, criterion, nominal, robot } = slf.get();
        let parts =
            (robot.clone().into(), criterion.name(), pythonize(slf.py(), inner)?, nominal.clone());
        Ok((slf.get_type().getattr("_from_parts")?, parts))
    }

    #[staticmethod]
    fn _from_parts(
        robot: &Robot,
        criterion: &str,
        found: &Bound<'_, PyAny>,
        nominal: Option<Nominal>,
    ) -> PyResult<Self> {
        let criterion =
            choice("criterion", criterion, &Criterion::ALL.map(|known| (known.name(), known)))?;
        let inner: core::Excitation = depythonize(found)
            .map_err(|error| invalid(format!("not what was pickled: {error}")))?;
        let n = robot.inner.dof();
        let core::Peaks { position, velocity, acceleration, torque, .. } = &inner.peaks;
        let Forecast { seconds, deviation, noise, .. } = &inner.forecast;
        let joints = [
            inner.trajectory.start().len(),
            velocity.len(),
            acceleration.len(),
            torque.len(),
            noise.len(),
        ];
        let fits = joints == [n; 5] && position.len() == n && deviation.len() == seconds.len();
        if !fits || deviation.iter().any(|joints| joints.len() != n) {
            return Err(invalid("not what was pickled: its parts do not belong together"));
        }
        Ok(Self { inner, criterion, nominal, robot: robot.inner.clone() })
    }

    fn __repr__(&self) -> String {
        format!(
            "Excitation of {} joints, value {:.6}, {}",
            self.robot.dof(),
            self.inner.value,
            self.status()
        )
    }
}

/// Finds a motion that reveals the parameters of a robot and stays within its limits.
///
/// Sequential quadratic programming with exact derivatives, from several random motions. Limits of
/// position, speed, acceleration and torque hold in continuous time. Ctrl-C gives the best motion
/// so far.
///
/// Parameters
/// ----------
/// robot : Robot
/// effects : list of str, default ("viscous_friction", "coulomb_friction")
///     Effects whose parameters shall be revealed too. Of one that depends on the whole motion or
///     enters nonlinearly, such as "stribeck_friction", the torque is differentiated by parameters
///     and constants at nominal values: those of `model`, or the middle of what is known of the
///     constants and coefficients of one. The motion is good for values near these; with such
///     effects "d_optimality" is the criterion that does not depend on units.
/// criterion : str, default "condition"
///     What is made small: "condition", "frobenius_condition", "sum_of_conditions" (per link),
///     "static_conditions", "dynamic_conditions", "d_optimality", "hadamard".
/// basis : {"fourier", "b_spline", "point_to_point"}
/// fundamental_hz : float, default 0.1
///     Of a series; it lasts one period.
/// terms : int, default 4
///     Harmonics 1 to `terms`.
/// harmonics : (int, int), optional
///     First and last harmonic, instead of `terms`.
/// duration : float, default 10
///     Of splines and points, s.
/// points : int, default 12
///     Control points of a spline; points of point-to-point.
/// max_acceleration : array of shape (n,)
///     rad/s² (m/s²); robot files do not know it.
/// position_range, max_velocity, max_torque : arrays of shape (n, 2), (n,), (n,), optional
///     Those of the robot by default.
/// floor : float, optional
///     Height that links stay above, base axes, m.
/// boxes : list of (lowest corner, highest corner), optional
///     Boxes along the base axes that links stay out of, m.
/// self_collision : bool, default False
///     Keep links that are no neighbours apart.
/// clearance, link_radius : float, default 0 and 0.05
///     Distance that is kept; radius of the links, which are capsules from joint to joint, m.
/// link_shapes : path, optional
///     The robot's URDF, whose collision shapes (cylinders, boxes, spheres, capsules) are the
///     links, instead of a radius.
/// max_tip_speed : float, optional
///     Of the last frame of the last joint, m/s.
/// start : array of shape (n,), optional
///     Position at both ends, rad (m); zero, or the middle of the range where zero is outside it.
/// noise : array of shape (n,), optional
///     Standard deviations of the torque, N·m (N), which weigh the joints.
/// model : Model, optional
///     What torque limits are checked with, and nominal values of effects; the effects that it has
///     at all joints must be those of `effects` that enter linearly. The rigid body by default.
/// starts : int, default 6
///     Searches.
/// max_evaluations : int, default 1500
///     Per search.
/// random_state : int, default 0
/// n_jobs : int, optional
///     Threads; all by default. The result does not depend on them.
/// progress : callable, optional
///     Called as ``progress(stage, done, total)``; what it raises ends the search with the best
///     motion so far.
///
/// Returns
/// -------
/// Excitation
///
/// Examples
/// --------
/// >>> robot = sgpr.robots.two_link()
/// >>> found = sgpr.excite(robot, terms=3, max_acceleration=[2, 2], starts=1, max_evaluations=200)
/// >>> bool(found.report["condition"] < 40 and found.utilisation <= 1)
/// True
#[pyfunction]
#[pyo3(signature = (robot, effects=None, *, criterion="condition", start=None, noise=None, model=None, starts=None,
    max_evaluations=None, random_state=0, n_jobs=None, progress=None, **options),
    text_signature = "(robot, effects=('viscous_friction', 'coulomb_friction'), *, \
         criterion='condition', start=None, noise=None, model=None, starts=6, \
         max_evaluations=1500, random_state=0, n_jobs=None, progress=None, **options)")]
#[expect(clippy::too_many_arguments, reason = "one for each Python keyword")]
pub fn excite(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    effects: Option<&Bound<'_, PyAny>>,
    criterion: &str,
    start: Option<&Bound<'_, PyAny>>,
    noise: Option<&Bound<'_, PyAny>>,
    model: Option<&Bound<'_, Model>>,
    starts: Option<&Bound<'_, PyAny>>,
    max_evaluations: Option<&Bound<'_, PyAny>>,
    random_state: u64,
    n_jobs: Option<&Bound<'_, PyAny>>,
    progress: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Excitation> {
    let robot = robot.get().inner.clone();
    let effects = match effects {
        Some(names) => texts("effects", names)?,
        None => core::usual_effects(),
    };
    let keywords = Keywords::new(options, &[&MOTION[..], &SURROUNDINGS].concat())?;
    let basis = basis(&keywords)?;
    let duration = basis.duration();
    let (set, terms) = split(&robot, &effects, model.map(|model| &*model.get().inner), duration)?;
    let limits = limits(&keywords, &robot)?;
    let surroundings = surroundings(&keywords, &robot)?;
    let mut options = ExciteOptions::new(basis, limits);
    options.surroundings = surroundings;
    options.criterion =
        choice("criterion", criterion, &Criterion::ALL.map(|known| (known.name(), known)))?;
    options.start = start.map(|start| per_joint("start", start, &robot)).transpose()?;
    options.noise = noise.map(|noise| per_joint("noise", noise, &robot)).transpose()?;
    if let Some(model) = model {
        let model = &model.get().inner;
        if model.parameter_set().names() != set.names() {
            return Err(invalid(
                "model: its joints and effects must be those of robot and effects",
            ));
        }
        options.parameters = Some(model.parameters().to_vec());
    }
    options.starts =
        starts.map_or(Ok(options.starts), |value| whole("starts", value, 1..100_001))?;
    options.evaluations = max_evaluations
        .map_or(Ok(options.evaluations), |value| whole("max_evaluations", value, 1..1_000_001))?;
    options.threads =
        n_jobs.map_or(Ok(options.threads), |value| whole("n_jobs", value, 1..1025))?;
    options.seed = random_state;
    // An interruption is no failure here: it ends the search, and what was found is returned.
    let found = listen(py, progress, |progress| {
        let base = BaseParameters::new(&robot, &set);
        options.nominal =
            nominal(&robot, &set, &base, options.parameters.as_deref(), terms, duration);
        core::optimise(
            &robot,
            &set,
            &base,
            &options,
            &Once { progress, stopped: Mutex::new(false) },
        )
    })?;
    let nominal = options.nominal.as_ref().map(named);
    Ok(Excitation { inner: found, criterion: options.criterion, nominal, robot })
}

/// The effects that enter by columns of the present joint motion, and the terms of the others:
/// those of the model, or with values from the middle of what is known.
fn split(
    robot: &CoreRobot,
    effects: &[String],
    model: Option<&TorqueModel>,
    duration: f64,
) -> PyResult<(ParameterSet, Vec<Term>)> {
    let (mut state, mut terms) = (vec![], vec![]);
    for name in effects {
        let effect = by_name(name).map_err(IntoPyErr::into_py_err)?;
        if effect.entry() == Entry::State {
            state.push(name);
            continue;
        }
        let known = model
            .into_iter()
            .flat_map(TorqueModel::terms)
            .filter(|term| term.effect.name() == name);
        let known: Vec<Term> = known.cloned().collect();
        match known.is_empty() {
            true => terms.extend(
                core::nominal_terms(robot, &effect, duration).map_err(IntoPyErr::into_py_err)?,
            ),
            false => terms.extend(known),
        }
    }
    Ok((ParameterSet::new(robot, &state).map_err(IntoPyErr::into_py_err)?, terms))
}

/// The effects of `terms` about their values; none without terms.
fn nominal(
    robot: &CoreRobot,
    set: &ParameterSet,
    base: &BaseParameters,
    parameters: Option<&[f64]>,
    terms: Vec<Term>,
    duration: f64,
) -> Option<NominalEffects> {
    let mut own = robot.standard_parameters();
    own.resize(set.len(), 0.0);
    let parameters = parameters.unwrap_or(&own);
    (!terms.is_empty()).then(|| NominalEffects::new(robot, set, base, parameters, terms, duration))
}

/// Asks a listener that has stopped the work no more.
struct Once<'a> {
    progress: &'a dyn Progress,
    stopped: Mutex<bool>,
}

impl Progress for Once<'_> {
    fn step(&self, stage: &'static str, done: usize, total: usize) -> Result<(), Interrupted> {
        let mut stopped = self.stopped.lock().unwrap_or_else(PoisonError::into_inner);
        if *stopped {
            return Err(Interrupted);
        }
        let answer = self.progress.step(stage, done, total);
        *stopped = answer.is_err();
        answer
    }
}

fn report_dict<'py>(
    py: Python<'py>,
    report: &core::ExcitationReport,
    nominal: Option<&Nominal>,
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("condition", report.condition)?;
    dict.set_item("scaled_condition", report.scaled_condition)?;
    dict.set_item("frobenius_condition", report.frobenius_condition)?;
    dict.set_item(
        "link_conditions",
        array(py, &[report.link_conditions.len()], report.link_conditions.clone())?,
    )?;
    dict.set_item("sum_of_conditions", report.sum_of_conditions())?;
    dict.set_item("log_determinant", report.log_determinant)?;
    dict.set_item(
        "singular_values",
        array(py, &[report.singular_values.len()], report.singular_values.clone())?,
    )?;
    dict.set_item("rank", report.rank)?;
    dict.set_item("not_told_apart", &report.not_told_apart)?;
    dict.set_item("base_parameters", report.singular_values.len())?;
    if let Some((named, hidden)) = nominal {
        let values = PyDict::new(py);
        for (name, value) in named {
            values.set_item(name, value)?;
        }
        dict.set_item("nominal", values)?;
        dict.set_item("hidden", hidden)?;
    }
    Ok(dict)
}

fn peaks_dict<'py>(py: Python<'py>, peaks: &core::Peaks) -> PyResult<Bound<'py, PyDict>> {
    let n = peaks.velocity.len();
    let dict = PyDict::new(py);
    dict.set_item("position", array(py, &[n, 2], peaks.position.as_flattened().to_vec())?)?;
    dict.set_item("velocity", array(py, &[n], peaks.velocity.clone())?)?;
    dict.set_item("acceleration", array(py, &[n], peaks.acceleration.clone())?)?;
    dict.set_item("torque", array(py, &[n], peaks.torque.clone())?)?;
    Ok(dict)
}

/// Keyword arguments of basis and limits ...
const MOTION: [&str; 10] = [
    "basis",
    "fundamental_hz",
    "terms",
    "harmonics",
    "duration",
    "points",
    "max_acceleration",
    "position_range",
    "max_velocity",
    "max_torque",
];

/// ... and of what is around the arm.
const SURROUNDINGS: [&str; 7] = [
    "floor",
    "boxes",
    "self_collision",
    "clearance",
    "link_radius",
    "link_shapes",
    "max_tip_speed",
];

/// The functions that the motion is made of.
fn basis(options: &Keywords<'_, '_>) -> PyResult<Basis> {
    let kind = options.get("basis")?.map_or(Ok("fourier".to_string()), |value| value.extract())?;
    let kind = choice("basis", &kind, &[("fourier", 0), ("b_spline", 1), ("point_to_point", 2)])?;
    let fundamental_hz = options.number("fundamental_hz")?.unwrap_or(0.1);
    let duration = options.number("duration")?.unwrap_or(10.0);
    let terms = options.get("terms")?.map_or(Ok(4), |value| whole("terms", &value, 2..10_001))?;
    let points =
        options.get("points")?.map_or(Ok(12), |value| whole("points", &value, 3..10_001))?;
    let (first, last): (usize, usize) = match options.get("harmonics")? {
        Some(pair) => {
            pair.extract().map_err(|_| invalid("harmonics: expected first and last harmonic"))?
        }
        None => (1, terms),
    };
    Ok(match kind {
        0 => Basis::Fourier { fundamental_hz, harmonics: first..=last },
        1 => Basis::BSpline { duration, control_points: points },
        _ => Basis::PointToPoint { duration, points },
    })
}

/// What is around the arm; nothing if no option says so.
fn surroundings(options: &Keywords<'_, '_>, robot: &CoreRobot) -> PyResult<Option<Surroundings>> {
    let radius = options.get("link_radius")?;
    let mut cell = match (options.get("link_shapes")?, radius) {
        (Some(_), Some(_)) => {
            return Err(invalid(
                "link_shapes, link_radius: the links are shapes of a file or capsules of a radius",
            ));
        }
        (Some(path), None) => Surroundings::from_urdf(robot, path.extract::<PathBuf>()?)
            .map_err(IntoPyErr::into_py_err)?,
        (None, radius) => {
            Surroundings::skeleton(robot, radius.map_or(Ok(0.05), |value| value.extract())?)
        }
    };
    cell.floor = options.get("floor")?.map(|value| value.extract()).transpose()?;
    if let Some(boxes) = options.get("boxes")? {
        let corners: Vec<([f64; 3], [f64; 3])> = boxes.extract().map_err(|_| {
            invalid("boxes: expected pairs of lowest and highest corner, three numbers each")
        })?;
        cell.blocks = corners.into_iter().map(|(low, high)| Block { low, high }).collect();
    }
    cell.self_collision =
        options.get("self_collision")?.map_or(Ok(false), |value| value.extract())?;
    cell.clearance = options.number("clearance")?.unwrap_or(0.0);
    if let Some(limit) = options.get("max_tip_speed")? {
        let tip = robot.frames().iter().rev().find(|frame| frame.joint == Some(robot.dof() - 1));
        let tip =
            tip.ok_or_else(|| invalid("max_tip_speed: the robot has no frame at its last joint"))?;
        cell.tip_speed = Some((tip.clone(), limit.extract()?));
    }
    let empty = cell.floor.is_none()
        && cell.blocks.is_empty()
        && !cell.self_collision
        && cell.tip_speed.is_none();
    Ok((!empty).then_some(cell))
}

/// Limits of the motion.
fn limits(options: &Keywords<'_, '_>, robot: &CoreRobot) -> PyResult<MotionLimits> {
    let n = robot.dof();
    let Some(acceleration) = options.get("max_acceleration")? else {
        return Err(invalid(format!(
            "max_acceleration: give one number per joint, ({n},); robot files do not know it"
        )));
    };
    let acceleration = per_joint("max_acceleration", &acceleration, robot)?;
    let mut given: [Option<Vec<f64>>; 2] = [None, None];
    for (slot, name) in given.iter_mut().zip(["max_velocity", "max_torque"]) {
        *slot = options.get(name)?.map(|value| per_joint(name, &value, robot)).transpose()?;
    }
    let [velocity, torque] = given;
    let position = match options.get("position_range")? {
        Some(value) => {
            let numbers = Numbers::new("position_range", &value)?.shaped(&[n, 2])?.finite()?;
            Some(
                numbers.values().chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect::<Vec<_>>(),
            )
        }
        None => None,
    };
    let known = MotionLimits::of_robot_or(robot, &acceleration, position, velocity);
    let known = known.map_err(IntoPyErr::into_py_err)?;
    let torque = torque.or_else(|| known.torque.clone());
    Ok(known.with_torque(torque))
}
