//! From recordings to a model.

use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use sgpr_core::effects::{Origin, registry};
use sgpr_core::identification::Method;
use sgpr_core::model::{self as core, Controller, IdentifyOptions, Start};
use sgpr_core::motion::TorqueBand;
use sgpr_core::recording as logs;
use sgpr_core::signal::Differentiation;

use crate::convert::{Numbers, choice, not_negative, not_negative_gains, positive, texts, whole};
use crate::errors::{IntoPyErr, invalid, warn};
use crate::estimators::{ConsistencyArguments, method, uncertainty};
use crate::keywords::{Keywords, number, word};
use crate::log_set::recordings;
use crate::model::Model;
use crate::progress::listen;
use crate::recording::Recording;
use crate::robot::Robot;

/// Refuses torques that cannot be those of the robot, and warns of samples that two recordings
/// share and that count once.
fn check_evidence(
    py: Python<'_>,
    robot: &Robot,
    recordings: &[logs::Recording],
    options: &core::IdentifyOptions,
) -> PyResult<()> {
    if options.instruments.is_empty() {
        warn(py, logs::LogSet::new(recordings).notes())?;
    }
    // What an internal model leaves over is no weight.
    if options.start != Start::RobotFile {
        return Ok(());
    }
    for recording in recordings {
        let found = core::torque_scale(&robot.inner, recording).map_err(IntoPyErr::into_py_err)?;
        if let Some(found) = found {
            let (recording, finding) = (recording.source().into(), found.message);
            return Err(logs::RecordingError::Doubtful { recording, finding }.into_py_err());
        }
    }
    Ok(())
}

/// Share of its moving time in which a recording repeats paths of known ones.
///
/// An error on a log that repeats motions of the training tells how well a model repeats what it
/// was fitted to, with all that it lacks, and not how it predicts.
///
/// Parameters
/// ----------
/// known : list of Recording or LogSet
/// new : Recording
///
/// Returns
/// -------
/// float or None
///     0 to 1; None if `new` never moves for a second or `known` is empty. Paths of a second are
///     compared. Logs of real robots with motions of their own reach a third, since arms start at
///     the same pose.
///
/// Raises
/// ------
/// ValueError
///     If the recordings have different numbers of joints.
///
/// Examples
/// --------
/// >>> log = sgpr.read("train.csv.gz")
/// >>> sgpr.repeated_share([log], log)
/// 1.0
#[pyfunction]
pub fn repeated_share(
    known: &Bound<'_, PyAny>,
    new: &Bound<'_, Recording>,
) -> PyResult<Option<f64>> {
    let (known, new) = (recordings(known)?, &new.get().inner);
    if let Some(other) = known.iter().find(|log| log.dof() != new.dof()) {
        let (found, expected) = (other.dof(), new.dof());
        return Err(invalid(format!(
            "known: got a recording of {found} joints, expected {expected}"
        )));
    }
    Ok(logs::repeated_share(&known, new))
}

/// Samples of a log that other logs have, too: an error there is not one on unseen data.
///
/// Samples are the same if positions and torques of a run of at least fifty are the same numbers,
/// whatever files and stamps say. Another run of the same motion has other noise; `repeated_share`
/// finds it.
///
/// Parameters
/// ----------
/// known : list of Recording or LogSet
/// new : Recording
///
/// Returns
/// -------
/// list of (int, int, int)
///     In the order of `new`: the index of the log in `known`, and the first sample of `new` and
///     the one after the last.
///
/// Examples
/// --------
/// >>> log = sgpr.read("train.csv.gz")
/// >>> sgpr.shared_samples([log], log) == [(0, 0, len(log))]
/// True
#[pyfunction]
pub fn shared_samples(
    known: &Bound<'_, PyAny>,
    new: &Bound<'_, Recording>,
) -> PyResult<Vec<(usize, usize, usize)>> {
    let runs = logs::shared_samples(&recordings(known)?, &new.get().inner);
    Ok(runs.into_iter().map(|(run, log)| (log, run.start, run.end)).collect())
}

/// What an option of `identify` says.
#[derive(Clone, Copy, PartialEq)]
enum Of {
    /// How logs become equations.
    Equations,
    /// What is made of sums of their products.
    Sums,
    /// What is made of single rows, or of other logs.
    Rows,
}

/// Options of `identify`.
const OPTIONS: [(&str, Of); 22] = [
    ("effects", Of::Equations),
    ("method", Of::Sums),
    ("noise", Of::Sums),
    ("start", Of::Sums),
    ("cutoff_hz", Of::Equations),
    ("filter_order", Of::Equations),
    ("differentiation", Of::Equations),
    ("torque_band", Of::Equations),
    ("decimation", Of::Equations),
    ("standstill_speed", Of::Equations),
    ("turn_margin", Of::Equations),
    ("progress", Of::Equations),
    ("consistent", Of::Sums),
    ("prior", Of::Sums),
    ("prior_deviation", Of::Sums),
    ("bounds", Of::Sums),
    ("essential", Of::Sums),
    ("forecast", Of::Rows),
    ("uncertainty", Of::Rows),
    ("instruments", Of::Rows),
    ("kp", Of::Rows),
    ("kd", Of::Rows),
];

/// Keyword arguments of `identify` and its like.
pub struct Arguments {
    /// For the core.
    pub options: IdentifyOptions,
    /// Who wants to hear of the progress.
    pub progress: Option<Py<PyAny>>,
}

impl Arguments {
    /// Reads them.
    pub fn new(robot: &Robot, given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        Self::among(&OPTIONS.map(|(name, _)| name), robot, given)
    }

    /// Reads those that say how logs become equations; no others are taken.
    pub fn of_equations(robot: &Robot, given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        Self::of(Of::Equations, robot, given)
    }

    /// Reads those that say what is made of sums; no others are taken.
    pub fn of_sums(robot: &Robot, given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        Self::of(Of::Sums, robot, given)
    }

    fn of(wanted: Of, robot: &Robot, given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let known: Vec<&str> =
            OPTIONS.iter().filter(|(_, of)| *of == wanted).map(|(name, _)| *name).collect();
        Self::among(&known, robot, given)
    }

    fn among(known: &[&str], robot: &Robot, given: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut options = IdentifyOptions::default();
        let (mut progress, mut noise) = (None, None);
        let mut consistency = ConsistencyArguments::default();
        let gains = |key: &str, value: &Bound<'_, PyAny>| -> PyResult<Vec<f64>> {
            let numbers = Numbers::new(key, value)?.shaped(&[robot.dof()])?.finite()?;
            not_negative_gains(key, numbers.values().to_vec())
        };
        let (mut kp, mut kd) = (None, None);
        for (key, value) in Keywords::new(given, known)?.all() {
            let key: String = key.extract()?;
            // None stands for the default, whatever it is, but for the prior, which can be left
            // out.
            if value.is_none() && key != "prior" {
                continue;
            }
            let conditioning = &mut options.conditioning;
            match key.as_str() {
                "effects" => options.effects = texts("effects", &value)?,
                "method" => options.method = method(&word(&key, &value)?)?,
                key if ConsistencyArguments::OPTIONS.contains(&key) => {
                    consistency.take(key, &value)?
                }
                "essential" => options.essential = value.extract()?,
                "forecast" => options.forecast = value.extract()?,
                "uncertainty" => options.uncertainty = uncertainty(&word(&key, &value)?)?,
                "instruments" => options.instruments = recordings(&value)?,
                "kp" => kp = Some(gains(&key, &value)?),
                "kd" => kd = Some(gains(&key, &value)?),
                "noise" => {
                    let numbers =
                        Numbers::new("noise", &value)?.shaped(&[robot.dof()])?.finite()?;
                    noise = Some(numbers.values().to_vec());
                }
                "start" => {
                    let known = [("robot_file", Start::RobotFile), ("zero", Start::Zero)];
                    options.start = choice("start", &word(&key, &value)?, &known)?;
                }
                "cutoff_hz" => {
                    conditioning.cutoff_hz = Some(positive(&key, number(&key, &value)?)?)
                }
                "filter_order" => conditioning.order = whole(&key, &value, 1..11)?,
                "differentiation" => {
                    conditioning.differentiation = differentiation(&word(&key, &value)?)?
                }
                "torque_band" => conditioning.torque_band = torque_band(&value)?,
                "decimation" => conditioning.decimation = Some(whole(&key, &value, 1..usize::MAX)?),
                "standstill_speed" => {
                    conditioning.standstill_speed = Some(positive(&key, number(&key, &value)?)?)
                }
                "turn_margin" => {
                    conditioning.turn_margin = not_negative(&key, number(&key, &value)?)?
                }
                "progress" => progress = Some(value.unbind()),
                _ => unreachable!("an option of the list"),
            }
        }
        if let Some(noise) = noise {
            if options.method != Method::Wls {
                return Err(invalid(
                    "noise: known noise makes the weights of method 'wls', and only of that",
                ));
            }
            options.method = Method::WlsKnown(noise);
        }
        options.prior = consistency.prior()?;
        (options.consistency, options.cross_validated_prior) = consistency.finish()?;
        options.controller = match (kp, kd) {
            (None, None) => None,
            (Some(kp), Some(kd)) => Some(Controller { kp, kd }),
            _ => {
                return Err(invalid(
                    "kp, kd: a controller has both; zeros where it has no such gain",
                ));
            }
        };
        Ok(Self { options, progress })
    }
}

fn torque_band(value: &Bound<'_, PyAny>) -> PyResult<TorqueBand> {
    if let Ok(hz) = value.extract::<f64>() {
        return positive("torque_band", hz).map(TorqueBand::Hz);
    }
    match value.extract::<String>().as_deref() {
        Ok("position") => Ok(TorqueBand::AsPosition),
        Ok("full") => Ok(TorqueBand::Full),
        _ => Err(invalid(format!(
            "torque_band = {}: expected 'position', 'full' or a cut-off in Hz",
            value.repr()?
        ))),
    }
}

/// Longest window, and highest degree of a polynomial that still can be fitted to it.
const LONGEST_WINDOW: usize = 9999;
const HIGHEST_DEGREE: usize = 10;

/// "central", "central:4", "savitzky_golay:11:3"
fn differentiation(text: &str) -> PyResult<Differentiation> {
    let wrong = || {
        invalid(format!(
            "differentiation = '{text}': expected 'central', 'central:ACCURACY' with 2, 4, 6 or 8, \
             or 'savitzky_golay:WINDOW:DEGREE' with an odd window of at most {LONGEST_WINDOW} \
             samples and a degree from 2 to {HIGHEST_DEGREE}, less than the window"
        ))
    };
    let mut parts = text.split(':');
    let method = parts.next().unwrap_or_default();
    let numbers: Vec<usize> =
        parts.map(|part| part.parse().map_err(|_| wrong())).collect::<PyResult<_>>()?;
    match (method, numbers[..].as_ref()) {
        ("central", []) => Ok(Differentiation::default()),
        ("central", &[accuracy @ (2 | 4 | 6 | 8)]) => Ok(Differentiation::Central { accuracy }),
        ("savitzky_golay", &[window, degree])
            if window % 2 == 1
                && window <= LONGEST_WINDOW
                && (2..=HIGHEST_DEGREE.min(window - 1)).contains(&degree) =>
        {
            Ok(Differentiation::SavitzkyGolay { window, degree })
        }
        _ => Err(wrong()),
    }
}

/// Identifies the torque model of a robot from recordings.
///
/// The joints of each recording are picked by the names of the robot's joints. What is left open is
/// chosen from the logs and kept in `Model.processing`; what the user should read is in
/// `Model.report.warnings`.
///
/// Parameters
/// ----------
/// robot : Robot
/// recordings : list of Recording or LogSet
///     With torque; each one a trajectory of its own.
/// effects : list of str
///     Physics beside the rigid body, see `effects`, at all joints or at one: "cable_stiffness",
///     "cable_hysteresis@joint_4"; by default viscous and Coulomb friction, rotor inertia and
///     torque offset. Constants that enter nonlinearly are fitted, too, by variable projection: see
///     `Model.terms`.
/// method : str, default "wls"
///     "wls", least squares with each joint weighted by its noise; "ols", all alike; "irls" or
///     "irls:THRESHOLD", Huber's weights against outliers; "ridge" or "ridge:DEVIATION", drawn to
///     the robot file, whose values have that relative standard deviation; "tls" or "tls:NOISE",
///     total least squares for columns of that relative noise; "iv", instrumental variables, and
///     "output_error", both with `instruments`; "rls" or "rls:FORGETTING", recursive. See
///     `estimators`.
/// noise : array of shape (n,), optional
///     Known standard deviation of each joint's torque, N·m (N), for the weights of "wls".
/// start : {"robot_file", "zero"}
///     Values that parameters keep where the motion does not determine them. With "zero" the result
///     is the error of an internal model, from the torque that it leaves over, to be added with
///     `Model.plus`.
/// cutoff_hz : float, optional
///     Cut-off of the position filter; from the spectrum by default.
/// filter_order : int, default 4
///     Order of the Butterworth filter of one pass, 1 to 10; it runs in both directions.
/// differentiation : str
///     "central" (of accuracy 6), "central:2" to "central:8", or "savitzky_golay:WINDOW:DEGREE".
/// torque_band : "position", "full" or float
///     Band in which both sides of the equation are compared: that of the position, all, or a
///     cut-off in Hz.
/// decimation : int, optional
///     Every how many rows of the filtered equation are taken; from the band by default.
/// standstill_speed : float, optional
///     Speed below which a joint counts as standing, rad/s (m/s); from the noise by default.
/// turn_margin : float, default 0.0
///     Periods of the cut-off before and after each turn of a joint in which its rows do not count.
///     Dry friction jumps at a turn; where samples are few, much of the jump is error.
/// consistent : bool, default False
///     Whether the full set of parameters is to be that of bodies: every link with a positive mass
///     and an inertia that some distribution of it has, friction and rotor inertia not negative.
///     See `Model.certificate`.
/// prior : {"entropic", "euclidean"} or None
///     What the logs determine worse than the robot file does is held by the file, and joints that
///     the file predicts better on parts of the logs that were left out keep it; see the warnings.
///     With None the estimate is bare. The words say, with `consistent`, how the distance to the
///     robot file is measured.
/// prior_deviation : float or "auto", optional
///     Relative standard deviation of the robot file's values; 1 for a file that is roughly right.
///     By default the one that the logs make probable; with `consistent` 30, and with "auto" the
///     one with which parts of the logs are predicted best from the others.
/// bounds : dict, optional
///     Limits: {"joint_2": {"mass": (1, 5), "box": (lowest, highest)}} for the link that a joint
///     carries, or "ellipsoid": (centre, half_axes) for its centre of mass; "total_mass": (20, 30);
///     any parameter, "joint_2.Fv": (0, None).
/// essential : bool, default False
///     Whether base parameters that the data do not support are left out; see
///     `IdentificationReport.essential`.
/// forecast : bool, default False
///     Whether the report says how much data is enough; see `IdentificationReport.forecast`.
/// uncertainty : str, default "memory"
///     Where standard deviations come from: "memory" of each joint's residual, "hac" for residuals
///     that are correlated between joints too, "bootstrap" or "bootstrap:REPLICATES" for
///     experiments drawn from blocks of this one.
/// instruments : list of Recording, optional
///     The same motions without noise, simulated or references; the references of the controller,
///     with its feed-forward torques, if `kp` and `kd` are given: then instruments are simulated.
/// kp, kd : array of shape (n,), optional
///     Gains of the controller at the joints, N·m/rad and N·m·s/rad, for "output_error" and
///     simulated instruments.
/// progress : callable, optional
///     Called with (stage, done, total) now and then; what it raises stops the work. So does
///     Ctrl-C.
///
/// Returns
/// -------
/// Model
///
/// Raises
/// ------
/// RecordingError
///     If a recording lacks a joint or torque, or cannot be differentiated.
/// IdentificationError
///     If the recordings hold too little, or an option cannot be.
///
/// Warns
/// -----
/// UserWarning
///     If logs share samples. What contradicts the robot (torques that are negated, in another unit
///     or at their limit, joints in another order, positions outside of their limits) is in
///     `model.report.warnings`; `screen` looks closer.
///
/// Examples
/// --------
/// >>> robot = sgpr.Robot.from_urdf("robot.urdf")
/// >>> model = sgpr.identify(robot, [sgpr.read("train.csv.gz")], effects=["viscous_friction", "coulomb_friction"])
/// >>> parameter = model.parameters["joint_2.Izz"]
/// >>> parameter.unit
/// 'kg·m²'
#[pyfunction]
#[pyo3(signature = (robot, recordings, **options),
    text_signature = "(robot, recordings, *, effects=('viscous_friction', 'coulomb_friction', \
         'rotor_inertia', 'torque_offset'), method='wls', noise=None, start='robot_file', \
         cutoff_hz=None, filter_order=4, differentiation='central', torque_band='position', \
         decimation=None, standstill_speed=None, turn_margin=0.0, consistent=False, \
         prior='entropic', prior_deviation=None, bounds=None, essential=False, forecast=False, \
         uncertainty='memory', instruments=(), kp=None, kd=None, progress=None)")]
pub fn identify(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    recordings: &Bound<'_, PyAny>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Model> {
    let Arguments { options, progress } = Arguments::new(robot.get(), options)?;
    let recordings = self::recordings(recordings)?;
    check_evidence(py, robot.get(), &recordings, &options)?;
    let robot = &robot.get().inner;
    let (model, report) =
        listen(py, progress, |progress| core::identify(robot, &recordings, &options, progress))?;
    Model::with_report(py, model, report)
}

/// Repeats an identification with half to twice the cut-off that was used: results must not hinge
/// on it.
///
/// Parameters
/// ----------
/// robot : Robot
/// recordings : list of Recording or LogSet
/// model : Model
///     What `identify` returned for them.
/// progress : callable, optional
///     As in `identify`.
/// **options
///     Those that were given to `identify`.
///
/// Returns
/// -------
/// list of CutoffInfluence
///     Empty for a model that was not identified. Cut-offs that the sampling rate cannot hold are
///     left out.
///
/// Examples
/// --------
/// >>> robot, recordings = sgpr.Robot.from_urdf("robot.urdf"), [sgpr.read("train.csv.gz")]
/// >>> model = sgpr.identify(robot, recordings)
/// >>> influences = sgpr.cutoff_influence(robot, recordings, model)
/// >>> [round(influence.cutoff_hz / model.processing.cutoff_hz, 2) for influence in influences]
/// [0.5, 0.71, 1.41, 2.0]
#[pyfunction]
#[pyo3(signature = (robot, recordings, model, **options),
    text_signature = "(robot, recordings, model, *, progress=None, **options)")]
pub fn cutoff_influence(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    recordings: &Bound<'_, PyAny>,
    model: &Bound<'_, Model>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Vec<CutoffInfluence>> {
    let Arguments { options, progress } = Arguments::new(robot.get(), options)?;
    let recordings = self::recordings(recordings)?;
    let (robot, model) = (&robot.get().inner, &model.get().inner);
    let set = sgpr_core::identification::ParameterSet::new(robot, &options.effects);
    if set.is_ok_and(|set| set.names() != model.parameter_set().names()) {
        return Err(invalid(
            "model: it has other parameters; give the robot and the options that it was identified \
             with",
        ));
    }
    let influences = listen(py, progress, |progress| {
        core::cutoff_influence(robot, &recordings, &options, model, progress)
    })?;
    let wrapped = influences.into_iter().map(|influence| {
        let core::CutoffInfluence { cutoff_hz, largest_change, typical_change, model, .. } =
            influence;
        let model = Py::new(py, Model { inner: Arc::new(model), report: None })?;
        Ok(CutoffInfluence { cutoff_hz, largest_change, typical_change, model })
    });
    wrapped.collect()
}

/// The effects that a model can have beside the rigid body.
///
/// Returns
/// -------
/// list of dict
///     "name", "summary", "parameters" of a joint as (symbol, unit, unit at a prismatic joint),
///     "constants" as (symbol, unit, lowest, highest), and in words "class", "formula", "source",
///     "signature", "confusable_with", "experiment" (that tells it apart), "excitation" (that it
///     needs), "alias_of"; what it is a property of ("origin": "the arm", "the measurement", "a
///     time of the logs"), whether a feed-forward torque holds it ("fed_forward"), and why
///     ("origin_reason").
///
/// Examples
/// --------
/// >>> [effect["name"] for effect in sgpr.effects()][:2]
/// ['viscous_friction', 'coulomb_friction']
#[pyfunction]
pub fn effects(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
    let describe = |effect: Arc<dyn sgpr_core::effects::Effect>| {
        let parameters = effect.parameters().iter();
        let parameters: Vec<_> =
            parameters.map(|one| (one.symbol, one.unit, one.sliding_unit)).collect();
        let dict = PyDict::new(py);
        dict.set_item("name", effect.name())?;
        dict.set_item("summary", effect.summary())?;
        dict.set_item("parameters", parameters)?;
        let constants = effect.constants().iter();
        let constants: Vec<_> =
            constants.map(|one| (one.symbol, one.unit, one.low, one.high)).collect();
        dict.set_item("constants", constants)?;
        let about = effect.about();
        dict.set_item("class", about.class.to_string())?;
        for (key, text) in [
            ("formula", about.formula),
            ("source", about.source),
            ("signature", about.signature),
            ("experiment", about.experiment),
            ("excitation", about.excitation),
        ] {
            dict.set_item(key, text)?;
        }
        dict.set_item("confusable_with", about.confusable.to_vec())?;
        dict.set_item("alias_of", about.alias_of)?;
        dict.set_item("origin", about.origin.to_string())?;
        dict.set_item("fed_forward", about.origin == Origin::Arm)?;
        dict.set_item("origin_reason", about.origin_reason)?;
        Ok(dict)
    };
    registry().into_iter().map(describe).collect()
}

/// What another cut-off would have made of the same logs.
#[pyclass(module = "sgpr", frozen, get_all)]
pub struct CutoffInfluence {
    /// Cut-off, Hz.
    cutoff_hz: f64,
    /// Largest change of a base parameter, in its standard deviations.
    largest_change: f64,
    /// Root mean square change of the base parameters, in their standard deviations.
    typical_change: f64,
    /// The model that results.
    model: Py<Model>,
}

#[pymethods]
impl CutoffInfluence {
    fn __repr__(&self) -> String {
        format!(
            "CutoffInfluence({:.2} Hz: parameters change by {:.2}, at most {:.2} standard \
             deviations)",
            self.cutoff_hz, self.typical_change, self.largest_change
        )
    }
}
