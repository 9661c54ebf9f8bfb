//! Simulated experiments.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use numpy::{PyArray1, PyArrayDyn};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sgpr_core::gp::PredictorOptions;
use sgpr_core::model::StreamOptions;
use sgpr_core::robot::Robot as CoreRobot;
use sgpr_core::simulation::{
    self as core, ComputedTorque, Controller, Experiment, FeedForward, Gains, Integrator,
    InverseDynamics, JointImpedance, Measurement, Pd, PickUp, Reference, RigidBody,
    SampledReference, Scheduled, Sensors, Setpoint, Simulator, StandStill, VelocitySensor,
    drives_from_model,
};

use crate::convert::{
    Numbers, array, choice, not_negative_gains, per_joint, positive, view, whole,
};
use crate::errors::{IntoPyErr, invalid};
use crate::excitation::Trajectory;
use crate::keywords::Keywords;
use crate::model::Model;
use crate::progress::listen;
use crate::recording::Recording;
use crate::robot::Robot;
use crate::semi_parametric::semi_parametric;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Rotor and friction of one joint, all seen at the joint: rad, N·m (m, N for a sliding joint).
/// Never changes.
///
/// Parameters
/// ----------
/// rotor_inertia : float
///     kg·m², gear ratio² times that of the motor.
/// viscous_friction : float
///     N·m·s/rad.
/// coulomb_friction, static_friction : float or (float, float)
///     Sizes forwards and backwards, N·m; the static one is the Coulomb one by default.
/// stribeck_velocity : float
///     rad/s; speed over which static falls to Coulomb friction.
///
/// Examples
/// --------
/// >>> sgpr.Drive(rotor_inertia=0.8, coulomb_friction=(25.0, 27.0)).coulomb_friction
/// (25.0, 27.0)
#[pyclass(module = "sgpr", frozen, eq)]
#[derive(PartialEq, Clone)]
pub struct Drive {
    inner: core::Drive,
}

#[pymethods]
impl Drive {
    #[new]
    #[pyo3(signature = (*, rotor_inertia=0.0, viscous_friction=0.0, coulomb_friction=None, static_friction=None, stribeck_velocity=0.0),
        text_signature = "(*, rotor_inertia=0.0, viscous_friction=0.0, coulomb_friction=0.0, \
             static_friction=None, stribeck_velocity=0.0)")]
    fn new(
        rotor_inertia: f64,
        viscous_friction: f64,
        coulomb_friction: Option<&Bound<'_, PyAny>>,
        static_friction: Option<&Bound<'_, PyAny>>,
        stribeck_velocity: f64,
    ) -> PyResult<Self> {
        let both = |name: &str, value: &Bound<'_, PyAny>| -> PyResult<[f64; 2]> {
            if let Ok(size) = value.extract::<f64>() {
                return Ok([size; 2]);
            }
            value.extract().map_err(|_| {
                invalid(format!("{name}: expected a number, or one forwards and one backwards"))
            })
        };
        let coulomb =
            coulomb_friction.map_or(Ok([0.0; 2]), |value| both("coulomb_friction", value))?;
        let at_rest =
            static_friction.map_or(Ok(coulomb), |value| both("static_friction", value))?;
        let inner = core::Drive::default()
            .with_rotor_inertia(rotor_inertia)
            .with_viscous_friction(viscous_friction)
            .with_coulomb_friction(coulomb)
            .with_static_friction(at_rest)
            .with_stribeck_velocity(stribeck_velocity);
        Ok(Self { inner })
    }

    /// kg·m².
    #[getter]
    fn rotor_inertia(&self) -> f64 {
        self.inner.rotor_inertia
    }

    /// N·m·s/rad.
    #[getter]
    fn viscous_friction(&self) -> f64 {
        self.inner.viscous_friction
    }

    /// Sizes forwards and backwards, N·m.
    #[getter]
    fn coulomb_friction(&self) -> (f64, f64) {
        self.inner.coulomb_friction.into()
    }

    /// Sizes at rest, forwards and backwards, N·m.
    #[getter]
    fn static_friction(&self) -> (f64, f64) {
        self.inner.static_friction.into()
    }

    /// rad/s.
    #[getter]
    fn stribeck_velocity(&self) -> f64 {
        self.inner.stribeck_velocity
    }

    fn __repr__(&self) -> String {
        let drive = &self.inner;
        format!(
            "Drive(rotor_inertia={}, viscous_friction={}, coulomb_friction={:?}, \
             static_friction={:?}, stribeck_velocity={})",
            drive.rotor_inertia,
            drive.viscous_friction,
            self.coulomb_friction(),
            self.static_friction(),
            drive.stribeck_velocity
        )
    }
}

/// Drives of the PUMA 560: rotors, viscous and direction-dependent Coulomb friction, seen at the
/// joints.
#[pyfunction]
pub fn puma560_drives() -> Vec<Drive> {
    core::puma560_drives().into_iter().map(|inner| Drive { inner }).collect()
}

/// Drives of the two-link arm.
#[pyfunction]
pub fn two_link_drives() -> Vec<Drive> {
    core::two_link_drives().into_iter().map(|inner| Drive { inner }).collect()
}

/// What happened in a simulated experiment, sample by sample; arrays are (N, n), read-only, SI.
#[pyclass(module = "sgpr", frozen)]
pub struct Simulation {
    inner: core::SimulationRecord,
    robot: CoreRobot,
}

/// The robot, the time of each sample, and all arrays.
type Pickled<'py> = (Robot, Vec<i64>, Vec<Array<'py>>);

/// All arrays of a simulation, in the order of a pickle.
const ARRAYS: [fn(&core::SimulationRecord) -> &[f64]; 11] = [
    |record| &record.q,
    |record| &record.dq,
    |record| &record.ddq,
    |record| &record.tau,
    |record| &record.friction,
    |record| &record.q_measured,
    |record| &record.dq_measured,
    |record| &record.tau_measured,
    |record| &record.q_wanted,
    |record| &record.dq_wanted,
    |record| &record.ddq_wanted,
];

impl Simulation {
    fn shown<'py>(
        slf: &Bound<'py, Self>,
        pick: fn(&core::SimulationRecord) -> &[f64],
    ) -> PyResult<Array<'py>> {
        let record = &slf.get().inner;
        view(slf, &[record.len(), record.dof()], |simulation| pick(&simulation.inner))
    }
}

#[pymethods]
impl Simulation {
    /// Time, (N,), s.
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(
            py,
            &[self.inner.len()],
            self.inner.time.iter().map(|time| *time as f64 * 1e-9).collect(),
        )
    }

    /// Names of the joints.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.inner.joint_names.clone()
    }

    /// True positions.
    #[getter]
    fn q<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.q)
    }

    /// True velocities.
    #[getter]
    fn dq<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.dq)
    }

    /// True accelerations, in the step that begins at the sample.
    #[getter]
    fn ddq<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.ddq)
    }

    /// True torques of the drives.
    #[getter]
    fn tau<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.tau)
    }

    /// Torques of friction.
    #[getter]
    fn friction<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.friction)
    }

    /// Measured positions.
    #[getter]
    fn q_measured<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.q_measured)
    }

    /// Measured velocities.
    #[getter]
    fn dq_measured<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.dq_measured)
    }

    /// Measured torques.
    #[getter]
    fn tau_measured<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.tau_measured)
    }

    /// Wanted positions.
    #[getter]
    fn q_wanted<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.q_wanted)
    }

    /// Wanted velocities.
    #[getter]
    fn dq_wanted<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.dq_wanted)
    }

    /// Wanted accelerations.
    #[getter]
    fn ddq_wanted<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        Self::shown(slf, |record| &record.ddq_wanted)
    }

    /// Root mean square of wanted minus true position, (n,), rad (m).
    #[getter]
    fn tracking_rmse<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[self.inner.dof()], self.inner.tracking_rmse())
    }

    /// What a logger would have written: measured position, velocity and torque.
    #[pyo3(signature = (source="simulation"))]
    fn recording(&self, source: &str) -> Recording {
        self.inner.recording(source).into()
    }

    fn __len__(&self) -> usize {
        self.inner.len()
    }

    /// A Plotly figure of tracking error, torque and friction over time.
    fn plot<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("plot_simulation", (slf,))
    }

    /// Writes the page of `sgpr simulate`: wanted positions, tracking error, torque and friction.
    fn report(slf: &Bound<'_, Self>, path: PathBuf) -> PyResult<()> {
        let robot = Robot::from(slf.get().robot.clone());
        slf.py().import("sgpr.reporting")?.call_method1("save_report", (slf, robot, path)).map(drop)
    }

    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("simulation_html", (slf,))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Pickled<'py>)> {
        let arrays =
            ARRAYS.into_iter().map(|pick| Self::shown(slf, pick)).collect::<PyResult<Vec<_>>>()?;
        let parts = (slf.get().robot.clone().into(), slf.get().inner.time.clone(), arrays);
        Ok((slf.get_type().getattr("_from_parts")?, parts))
    }

    #[staticmethod]
    fn _from_parts(robot: &Robot, time: Vec<i64>, arrays: Vec<Bound<'_, PyAny>>) -> PyResult<Self> {
        let size = time.len() * robot.inner.dof();
        let rows =
            arrays.iter().map(|array| Ok(Numbers::new("a simulation", array)?.values().to_vec()));
        let rows = rows.collect::<PyResult<Vec<Vec<f64>>>>()?;
        if rows.iter().any(|values| values.len() != size) {
            return Err(invalid(
                "not a simulation of this robot: its parts do not belong together",
            ));
        }
        let [
            q,
            dq,
            ddq,
            tau,
            friction,
            q_measured,
            dq_measured,
            tau_measured,
            q_wanted,
            dq_wanted,
            ddq_wanted,
        ] = <[Vec<f64>; ARRAYS.len()]>::try_from(rows)
            .map_err(|_| invalid("not a simulation: arrays are missing"))?;
        let joint_names = robot.inner.joint_names().map(String::from).collect();
        let mut inner = core::SimulationRecord::default();
        (inner.joint_names, inner.time) = (joint_names, time);
        [inner.q, inner.dq, inner.ddq, inner.tau, inner.friction] = [q, dq, ddq, tau, friction];
        [inner.q_measured, inner.dq_measured, inner.tau_measured] =
            [q_measured, dq_measured, tau_measured];
        [inner.q_wanted, inner.dq_wanted, inner.ddq_wanted] = [q_wanted, dq_wanted, ddq_wanted];
        Ok(Self { inner, robot: robot.inner.clone() })
    }

    fn __repr__(&self) -> String {
        format!("Simulation of {} joints, {} samples", self.inner.dof(), self.inner.len())
    }
}

const INTEGRATORS: [(&str, Integrator); 2] =
    [("euler", Integrator::SemiImplicitEuler), ("runge_kutta", Integrator::RungeKutta4)];

const VELOCITY_SENSORS: [(&str, VelocitySensor); 2] =
    [("exact", VelocitySensor::Exact), ("difference", VelocitySensor::Difference)];

/// Simulates an arm that follows a motion under a controller.
///
/// The same arguments give the same bits. Dry friction sticks and breaks away as the balance of
/// torques says; friction of any stiffness is stable at any step with the integrator "euler".
///
/// Parameters
/// ----------
/// robot : Robot or Model
///     The arm. A model brings its effects; `drives` is then not given. Effects at single sites act
///     as they depend on the present motion and on time, and Dahl elements of a position
///     (presliding friction, cables) carry their state; those with another hidden state, and those
///     that change robot, motion or torque, are refused by name.
/// reference : Trajectory, array of shape (n,), or (rate_hz, q, dq, ddq)
///     The wanted motion: at every time, standing still, or samples of shape (N, n) that are
///     interpolated.
/// duration : float, optional
///     s; that of the trajectory by default.
/// controller : {"feed_forward", "computed_torque", "impedance", "pd"} or callable
///     The law: model(q_d, dq_d, ddq_d) + PD; model(q, dq, ddq_d + PD); model(q, dq_d, ddq_d) + PD;
///     PD alone. A callable is called as ``controller(t, q, dq, q_wanted, dq_wanted, ddq_wanted)``
///     and returns the torques, (n,).
/// kp, kd : float or array of shape (n,)
///     Gains at the joints.
/// model : Robot, Model, SemiParametricModel or list of them, optional
///     What the controller knows of the arm; several are added. By default the rigid body of
///     `robot`.
/// feed_forward : array of shape (K, n), optional
///     Torque added by the controller, one row per control period; the last row stays.
/// drives : list of Drive, optional
///     Rotors and friction.
/// integrator : {"euler", "runge_kutta"}
/// step, control_period, record_period, delay : float
///     s; whole numbers of steps (of control periods for the record).
/// position_resolution, position_noise, torque_noise, actuation_noise : array (n,), optional
///     Encoder step, and standard deviations.
/// velocity : {"exact", "difference"}
///     What the controller sees.
/// torque_limits : array of shape (n,), optional
/// speed_limit : float, default 1000
///     Above it a joint counts as run away, rad/s (m/s).
/// pick_up : (float, array of shape (10,)), optional
///     Time, s, and the inertial parameters of what the last link holds from then on, in its frame.
/// random_state : int, default 0
///     Of all noise.
/// progress : callable, optional
///     Called as ``progress(stage, done, total)``; what it raises stops the work, as Ctrl-C does.
///
/// Returns
/// -------
/// Simulation
///
/// Raises
/// ------
/// SimulationError
///     If a joint runs away (with time and joint), or a torque is not finite.
///
/// Examples
/// --------
/// >>> robot = sgpr.robots.two_link()
/// >>> run = sgpr.simulate(robot, [0.3, -0.2], duration=0.5, drives=sgpr.robots.two_link_drives())
/// >>> bool(run.tracking_rmse.max() < 1e-6)
/// True
#[pyfunction]
#[pyo3(signature = (robot, reference, **options),
    text_signature = "(robot, reference, *, duration=None, controller='feed_forward', kp=75.0, \
         kd=5.0, model=None, feed_forward=None, drives=None, integrator='euler', step=2.5e-4, \
         control_period=1e-3, record_period=None, delay=0.0, position_resolution=None, \
         position_noise=None, torque_noise=None, actuation_noise=None, velocity='exact', \
         torque_limits=None, speed_limit=1000.0, pick_up=None, random_state=0, progress=None)")]
pub fn simulate(
    py: Python<'_>,
    robot: &Bound<'_, PyAny>,
    reference: &Bound<'_, PyAny>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Simulation> {
    let options = Keywords::new(options, &KEYWORDS)?;
    let mut simulator = simulator(robot, &options)?;
    let arm = simulator.robot().clone();
    let (reference, own_duration) = self::reference(reference, &arm)?;
    let Some(duration) = options.number("duration")?.or(own_duration) else {
        return Err(invalid("duration: give one, a position to hold has none"));
    };
    let experiment = experiment(&options, &arm)?;
    let failure = Arc::new(Mutex::new(None));
    let mut controller = controller(&options, &arm, experiment.control_period, &failure)?;
    let pick_up =
        options.get("pick_up")?.map(|value| pick_up(&value, arm.dof() - 1)).transpose()?;
    let progress = options.get("progress")?.map(Bound::unbind);
    let result = listen(py, progress, |progress| {
        let (controller, reference) = (controller.as_mut(), reference.as_ref());
        match &pick_up {
            None => core::simulate(
                &mut simulator,
                controller,
                reference,
                duration,
                &experiment,
                progress,
            ),
            Some(pick_up) => core::simulate_pick_up(
                &mut simulator,
                controller,
                reference,
                duration,
                &experiment,
                pick_up,
                progress,
            ),
        }
    });
    if let Some(error) = failure.lock().unwrap_or_else(PoisonError::into_inner).take() {
        return Err(error);
    }
    Ok(Simulation { inner: result?, robot: arm })
}

const KEYWORDS: [&str; 22] = [
    "duration",
    "controller",
    "kp",
    "kd",
    "model",
    "feed_forward",
    "drives",
    "integrator",
    "step",
    "control_period",
    "record_period",
    "delay",
    "position_resolution",
    "position_noise",
    "torque_noise",
    "actuation_noise",
    "velocity",
    "torque_limits",
    "speed_limit",
    "pick_up",
    "random_state",
    "progress",
];

/// How the arm is run and measured.
fn experiment(options: &Keywords<'_, '_>, arm: &CoreRobot) -> PyResult<Experiment> {
    let list =
        |name: &str| options.get(name)?.map(|value| per_joint(name, &value, arm)).transpose();
    let velocity = options
        .word("velocity")?
        .map(|word| choice("velocity", &word, &VELOCITY_SENSORS))
        .transpose()?;
    let sensors = Sensors::default()
        .with_position_resolution(list("position_resolution")?.unwrap_or_default())
        .with_position_noise(list("position_noise")?.unwrap_or_default())
        .with_torque_noise(list("torque_noise")?.unwrap_or_default())
        .with_actuation_noise(list("actuation_noise")?.unwrap_or_default())
        .with_velocity(velocity.unwrap_or_default());
    let control_period =
        positive("control_period", options.number("control_period")?.unwrap_or(1e-3))?;
    let record_period =
        positive("record_period", options.number("record_period")?.unwrap_or(control_period))?;
    let seed = options.get("random_state")?;
    let seed = seed.map_or(Ok(0), |value| whole("random_state", &value, 0..usize::MAX))?;
    Ok(Experiment::default()
        .with_control_period(control_period)
        .with_delay(options.number("delay")?.unwrap_or(0.0))
        .with_record_period(record_period)
        .with_sensors(sensors)
        .with_torque_limits(list("torque_limits")?)
        .with_seed(seed as u64))
}

/// One number for all joints, or one per joint.
fn gain(
    name: &str,
    value: Option<&Bound<'_, PyAny>>,
    default: f64,
    arm: &CoreRobot,
) -> PyResult<Vec<f64>> {
    let Some(value) = value else { return Ok(vec![default; arm.dof()]) };
    let gains = match value.extract::<f64>() {
        Ok(gain) if gain.is_finite() => vec![gain; arm.dof()],
        Ok(gain) => return Err(invalid(format!("{name} = {gain}: expected a finite number"))),
        Err(_) => per_joint(name, value, arm)?,
    };
    not_negative_gains(name, gains)
}

/// Rows of one number per joint, row-major.
fn rows(name: &str, value: &Bound<'_, PyAny>, arm: &CoreRobot) -> PyResult<Vec<f64>> {
    let (numbers, n) = (Numbers::new(name, value)?.finite()?, arm.dof());
    match *numbers.shape() {
        [_, columns] if columns == n => Ok(numbers.values().to_vec()),
        _ => Err(numbers.wrong_shape(&format!("(K, {n})"))),
    }
}

/// What the last link picks up.
fn pick_up(value: &Bound<'_, PyAny>, link: usize) -> PyResult<PickUp> {
    let wrong = |_| wrong_type("pick_up", value, "a time and ten inertial parameters");
    let (time, parameters): (f64, Bound<'_, PyAny>) = value.extract().map_err(wrong)?;
    let numbers = Numbers::new("pick_up", &parameters)?.shaped(&[10])?.finite()?;
    let parameters = numbers.values().try_into().expect("ten numbers");
    Ok(PickUp::new(time, link, parameters))
}

/// The arm with what turns it.
fn simulator(robot: &Bound<'_, PyAny>, options: &Keywords<'_, '_>) -> PyResult<Simulator> {
    let integrator = options
        .word("integrator")?
        .map(|word| choice("integrator", &word, &INTEGRATORS))
        .transpose()?;
    let step = options.number("step")?.unwrap_or(2.5e-4);
    let speed_limit = positive("speed_limit", options.number("speed_limit")?.unwrap_or(1000.0))?;
    let given: Option<Vec<Bound<'_, Drive>>> = match options.get("drives")? {
        Some(drives) => {
            Some(drives.extract().map_err(|_| wrong_type("drives", &drives, "a list of Drive"))?)
        }
        None => None,
    };
    let given =
        given.map(|drives| drives.iter().map(|drive| drive.get().inner).collect::<Vec<_>>());
    let (arm, drives, side) = if let Ok(robot) = robot.cast::<Robot>() {
        let robot = robot.get().inner.clone();
        let drives = given.unwrap_or_else(|| vec![core::Drive::default(); robot.dof()]);
        (robot, drives, vec![])
    } else if let Ok(model) = robot.cast::<Model>() {
        if given.is_some() {
            return Err(invalid(
                "drives: the model brings its own effects; give its `identified_robot` instead",
            ));
        }
        let model = &model.get().inner;
        let (drives, side) = drives_from_model(model).map_err(IntoPyErr::into_py_err)?;
        (model.identified_robot().clone(), drives, side)
    } else {
        return Err(wrong_type("robot", robot, "a Robot or Model"));
    };
    let simulator =
        Simulator::new(&arm, &drives, integrator.unwrap_or(Integrator::SemiImplicitEuler), step);
    let simulator = simulator.map_err(IntoPyErr::into_py_err)?.with_speed_limit(speed_limit);
    Ok(side.into_iter().fold(simulator, Simulator::with_side_torque))
}

type Wanted = (Box<dyn Reference>, Option<f64>);

fn reference(value: &Bound<'_, PyAny>, robot: &CoreRobot) -> PyResult<Wanted> {
    let n = robot.dof();
    if let Ok(trajectory) = value.cast::<Trajectory>() {
        let inner = trajectory.get().inner.clone();
        let duration = sgpr_core::excitation::Trajectory::duration(&inner);
        return Ok((Box::new(inner), Some(duration)));
    }
    if let Ok((rate_hz, q, dq, ddq)) =
        value.extract::<(f64, Bound<'_, PyAny>, Bound<'_, PyAny>, Bound<'_, PyAny>)>()
    {
        let rate_hz = positive("rate_hz", rate_hz)?;
        let [q, dq, ddq] =
            crate::convert::Samples::together([("q", &q), ("dq", &dq), ("ddq", &ddq)], n)?;
        if q.count() == 0 {
            return Err(invalid("reference: there is no sample"));
        }
        let last = (q.count() - 1) as f64 / rate_hz;
        let own = |samples: &crate::convert::Samples<'_>| samples.values().to_vec();
        let sampled = SampledReference::new(n, rate_hz, own(&q), own(&dq), own(&ddq));
        return Ok((Box::new(sampled), (last > 0.0).then_some(last)));
    }
    Ok((Box::new(StandStill(per_joint("reference", value, robot)?)), None))
}

/// What the controller knows.
pub(crate) fn models(
    value: Option<&Bound<'_, PyAny>>,
    robot: &CoreRobot,
    period: f64,
) -> PyResult<Vec<Box<dyn InverseDynamics>>> {
    let stream = StreamOptions::default().with_rate_hz(Some(1.0 / period));
    let Some(value) = value else { return Ok(vec![Box::new(RigidBody::new(robot))]) };
    let one = |item: &Bound<'_, PyAny>| -> PyResult<Option<Box<dyn InverseDynamics>>> {
        let (found, model): (usize, Box<dyn InverseDynamics>) = if let Ok(robot) =
            item.cast::<Robot>()
        {
            let robot = &robot.get().inner;
            (robot.dof(), Box::new(RigidBody::new(robot)))
        } else if let Ok(model) = item.cast::<Model>() {
            let model = &model.get().inner;
            (
                model.robot().dof(),
                Box::new(model.predictor(&stream).map_err(IntoPyErr::into_py_err)?),
            )
        } else if let Some(fitted) = semi_parametric(item)? {
            let model = &fitted.get().inner;
            let predictor = model.predictor(PredictorOptions::default(), &stream);
            (model.physics().robot().dof(), Box::new(predictor.map_err(IntoPyErr::into_py_err)?))
        } else {
            return Ok(None);
        };
        if found != robot.dof() {
            return Err(invalid(format!(
                "model: it has {found} joints, the arm has {}",
                robot.dof()
            )));
        }
        Ok(Some(model))
    };
    if let Some(model) = one(value)? {
        return Ok(vec![model]);
    }
    let wrong =
        || wrong_type("model", value, "a Robot, a Model, a SemiParametricModel, or a list of them");
    let mut all = Vec::new();
    for item in value.try_iter().map_err(|_| wrong())? {
        all.push(one(&item?)?.ok_or_else(wrong)?);
    }
    Ok(all)
}

/// The law, with the torque that is added to it.
fn controller(
    options: &Keywords<'_, '_>,
    arm: &CoreRobot,
    period: f64,
    failure: &Arc<Mutex<Option<PyErr>>>,
) -> PyResult<Box<dyn Controller>> {
    let gain = |name: &str, usual: f64| gain(name, options.get(name)?.as_ref(), usual, arm);
    let gains = Gains { kp: gain("kp", 75.0)?, kd: gain("kd", 5.0)? };
    let model = models(options.get("model")?.as_ref(), arm, period)?;
    let law = options.get("controller")?;
    let law: Box<dyn Controller> = match law.as_ref().filter(|law| law.is_callable()) {
        Some(callable) => Box::new(UserController {
            callable: callable.clone().unbind(),
            failure: failure.clone(),
        }),
        None => {
            let wrong =
                |law: &Bound<'_, PyAny>| wrong_type("controller", law, "a name or a callable");
            let name = law.map_or(Ok("feed_forward".into()), |law| {
                law.extract::<String>().map_err(|_| wrong(&law))
            })?;
            let known = [("feed_forward", 0), ("computed_torque", 1), ("impedance", 2), ("pd", 3)];
            match choice("controller", &name, &known)? {
                0 => Box::new(FeedForward::new(model, gains)),
                1 => Box::new(ComputedTorque::new(model, gains)),
                2 => Box::new(JointImpedance::new(model, gains)),
                _ => Box::new(Pd(gains)),
            }
        }
    };
    Ok(match options.get("feed_forward")? {
        Some(torque) => Box::new(Scheduled::new(law, rows("feed_forward", &torque, arm)?)),
        None => law,
    })
}

fn wrong_type(name: &str, value: &Bound<'_, PyAny>, expected: &str) -> PyErr {
    let found = value.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
    PyTypeError::new_err(format!("{name}: got {found}, expected {expected}"))
}

/// A control law written in Python.
struct UserController {
    callable: Py<PyAny>,
    failure: Arc<Mutex<Option<PyErr>>>,
}

impl UserController {
    fn call(
        &self,
        measured: &Measurement<'_>,
        wanted: &Setpoint<'_>,
        tau: &mut [f64],
    ) -> PyResult<()> {
        Python::attach(|py| {
            let array = |values: &[f64]| PyArray1::from_slice(py, values);
            let arguments = (
                measured.time,
                array(measured.q),
                array(measured.dq),
                array(wanted.q),
                array(wanted.dq),
                array(wanted.ddq),
            );
            let result = self.callable.bind(py).call1(arguments)?;
            tau.copy_from_slice(
                Numbers::new("the controller's torque", &result)?.shaped(&[tau.len()])?.values(),
            );
            Ok(())
        })
    }
}

impl Controller for UserController {
    fn torque(&mut self, measured: &Measurement<'_>, wanted: &Setpoint<'_>, tau: &mut [f64]) {
        if let Err(error) = self.call(measured, wanted, tau) {
            // A torque that is not finite ends the simulation; the exception is raised instead of
            // its error.
            tau.fill(f64::NAN);
            *self.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
    }
}
