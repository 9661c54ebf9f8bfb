//! Records: what logs say about parameters, without the logs.

use std::collections::BTreeMap;

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict, PyList};
use sgpr_core::identification::JointFactor;
use sgpr_core::model::{self as core, Deviation, JointDeviation, RecordBlock, RecordOptions};

use crate::compare::processing_of;
use crate::convert::{Numbers, array, texts};
use crate::detached::detached;
use crate::errors::{IntoPyErr, invalid};
use crate::identification::Arguments;
use crate::log_set::recordings;
use crate::model::{Model, Processing};
use crate::recording::{Recording, require_usable};
use crate::robot::Robot;

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// What a log says about the parameters of a robot: triangular factors of its equations with the
/// torque, joint by joint and part by part, with what the residual remembers and where the log came
/// from. Some hundred kilobytes, whatever the length of the log; never changes.
///
/// Made by `record`; `sgpr.fleet.save_records` writes many into one Parquet file. Any choice of
/// records is identified (`identify_records`), compared with a model (`compare_records`) and looked
/// through for changes (`deviations`).
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> record = sgpr.record(robot, log, labels={"robot": "arm 17"})
/// >>> record.robot == robot.fingerprint, record.labels["robot"], len(record.blocks)
/// (True, 'arm 17', 5)
#[pyclass(module = "sgpr", frozen)]
pub struct Record {
    /// Of the core.
    pub inner: core::Record,
}

impl From<core::Record> for Record {
    fn from(inner: core::Record) -> Self {
        Self { inner }
    }
}

#[pymethods]
impl Record {
    /// `Robot.fingerprint` of the robot.
    #[getter]
    fn robot(&self) -> &str {
        &self.inner.robot
    }

    /// Its joints.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.inner.joints.clone()
    }

    /// Effects beside the rigid body.
    #[getter]
    fn effects(&self) -> Vec<String> {
        self.inner.effects.clone()
    }

    /// How the log was processed; records are summed only where this is the same.
    #[getter]
    fn processing(&self) -> Processing {
        self.inner.processing.clone().into()
    }

    /// Effects that the equations lack and that the record has columns of: "effect", "joint",
    /// "constants".
    #[getter]
    fn suspects<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        self.inner
            .suspects
            .iter()
            .map(|suspect| described(py, suspect, &self.inner.joints))
            .collect()
    }

    /// Where the log came from.
    #[getter]
    fn source(&self) -> &str {
        &self.inner.source
    }

    /// `Recording.content_hash` of the log.
    #[getter]
    fn content_hash(&self) -> &str {
        &self.inner.content_hash
    }

    /// Part of the log that counts, [start, end) in ns, or None for all of it.
    #[getter]
    fn counted(&self) -> Option<(i64, i64)> {
        self.inner.counted.map(Into::into)
    }

    /// Stamp of the first sample, ns.
    #[getter]
    fn start_time(&self) -> i64 {
        self.inner.time[0]
    }

    /// Stamp of the last sample, ns.
    #[getter]
    fn end_time(&self) -> i64 {
        self.inner.time[1]
    }

    /// Samples that count.
    #[getter]
    fn samples(&self) -> usize {
        self.inner.samples
    }

    /// Equations of all joints.
    #[getter]
    fn rows(&self) -> usize {
        self.inner.rows()
    }

    /// What a look at the log found, one sentence each.
    #[getter]
    fn findings(&self) -> Vec<String> {
        self.inner.findings.iter().map(|finding| finding.message.clone()).collect()
    }

    /// The same for machines: "kind" (`frozen_torque`, `saturated`), "rank" ("stop", "look",
    /// "know"), "subject" (the joint or column, or None), "message".
    #[getter]
    fn screening<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let described = |finding: &core::RecordFinding| {
            let dict = PyDict::new(py);
            dict.set_item("kind", &finding.kind)?;
            dict.set_item("rank", &finding.rank)?;
            dict.set_item("subject", &finding.subject)?;
            dict.set_item("message", &finding.message)?;
            Ok(dict)
        };
        self.inner.findings.iter().map(described).collect()
    }

    /// Names that the caller gave: the arm, the session, its tool.
    #[getter]
    fn labels(&self) -> BTreeMap<String, String> {
        self.inner.labels.clone()
    }

    /// Version of the library that made it.
    #[getter]
    fn library_version(&self) -> &str {
        &self.inner.library_version
    }

    /// Parts of the log in the order of time: "start_time" and "end_time" (ns), "channels" (the
    /// mean of each), "rows" of all joints.
    #[getter]
    fn blocks<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let of_block = |block: &RecordBlock| {
            let dict = PyDict::new(py);
            dict.set_item("start_time", block.time[0])?;
            dict.set_item("end_time", block.time[1])?;
            dict.set_item("channels", block.channels.clone())?;
            dict.set_item("rows", block.factors.iter().map(|factor| factor.rows).sum::<usize>())?;
            Ok(dict)
        };
        self.inner.blocks.iter().map(of_block).collect()
    }

    /// Triangular factors of a block: "joint", "resting", "columns" (base parameters), "rows" and
    /// "factor", of shape (columns + 1, columns + 1), the torque last.
    fn factors<'py>(&self, py: Python<'py>, block: usize) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let Some(block) = self.inner.blocks.get(block) else {
            return Err(invalid(format!(
                "block: got {block}, the record has {}",
                self.inner.blocks.len()
            )));
        };
        let of_factor = |factor: &JointFactor| {
            let width = factor.factor.ncols();
            let values =
                (0..width * width).map(|k| factor.factor[(k / width, k % width)]).collect();
            let dict = PyDict::new(py);
            dict.set_item("joint", factor.joint)?;
            dict.set_item("resting", factor.resting)?;
            dict.set_item("columns", &factor.columns)?;
            dict.set_item("rows", factor.rows)?;
            dict.set_item("factor", array(py, &[width, width], values)?)?;
            Ok(dict)
        };
        block.factors.iter().map(of_factor).collect()
    }

    /// The record as JSON text and numbers, for files.
    fn to_parts<'py>(&self, py: Python<'py>) -> PyResult<(String, Array<'py>)> {
        let (head, numbers) = self.inner.to_parts();
        Ok((head, array(py, &[numbers.len()], numbers)?))
    }

    /// The record that `to_parts` took apart. Safe with what strangers send: nothing is run,
    /// lengths are checked.
    #[staticmethod]
    fn from_parts(head: &str, numbers: &Bound<'_, PyAny>) -> PyResult<Self> {
        let numbers = Numbers::new("numbers", numbers)?;
        core::Record::from_parts(head, numbers.values())
            .map(Self::from)
            .map_err(IntoPyErr::into_py_err)
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (String, Array<'py>))> {
        Ok((slf.get_type().getattr("from_parts")?, slf.get().to_parts(slf.py())?))
    }

    fn __repr__(&self) -> String {
        let core::Record { source, samples, blocks, .. } = &self.inner;
        format!(
            "Record({source}: {samples} samples, {} blocks, {} rows)",
            blocks.len(),
            self.inner.rows()
        )
    }
}

/// What is done to logs so that they can be compared, chosen from these logs: for `record`.
///
/// Parameters
/// ----------
/// robot : Robot
/// recordings : list of Recording or LogSet
/// **options
///     Wishes, as those of `identify`: `cutoff_hz`, `filter_order`, `differentiation`,
///     `torque_band`, `decimation`, `standstill_speed`, `turn_margin`.
///
/// Returns
/// -------
/// Processing
///     What `identify` would choose for the same logs and options.
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> processing = sgpr.choose_processing(robot, [log], cutoff_hz=10.0)
/// >>> processing.cutoff_hz
/// 10.0
#[pyfunction]
#[pyo3(signature = (robot, recordings, **options), text_signature = "(robot, recordings, \
     **options)")]
pub fn choose_processing(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    recordings: &Bound<'_, PyAny>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Processing> {
    let Arguments { options, .. } = Arguments::of_equations(robot.get(), options)?;
    let robot = &robot.get().inner;
    let recordings = self::recordings(recordings)?;
    let chosen =
        detached(py, || core::choose_processing(robot, &recordings, &options.conditioning));
    chosen.map(Processing::from).map_err(IntoPyErr::into_py_err)
}

/// The record of a log: all that it says about the parameters of the robot and its effects.
///
/// Parameters
/// ----------
/// robot : Robot
/// recording : Recording
///     With torque.
/// processing : Model or Processing, optional
///     How the log is processed: as a model was identified, or as `choose_processing` says; chosen
///     from this log by default. Only records that were processed alike can be summed.
/// effects : list of str
///     Physics beside the rigid body, at every joint; by default those of the model that
///     `processing` is, else those of `identify`. Effects that follow the whole trajectory or have
///     constants cannot be recorded.
/// blocks : int, default 5
///     Parts of the log, of equal length, that keep factors of their own.
/// counted : (int, int), optional
///     Part of the log that counts, from the first stamp to before the second, ns; what is before
///     and after only settles filters. For a piece of a long log.
/// lags : bool, default True
///     Whether products of rows some time apart are kept, three quarters of the record: then
///     several records together have the standard deviations of their logs. Without, each log's own
///     solution speaks for the memory of its residual.
/// suspects : list of str, default ()
///     Effects that the equations lack and that `diagnose_records` is to look for, at all joints
///     that can have them or at one: "stribeck_friction", "cable_stiffness@joint_2". The record
///     keeps their columns at a grid of their constants, and becomes larger by as much. Effects
///     with constants that differ from log to log (times, places, torques) or that change the
///     motion cannot be suspects.
/// labels : dict of str to str, optional
///     Names that the record keeps: {"robot": "arm 17", "session": "4 March"}.
///
/// Returns
/// -------
/// Record
///
/// Raises
/// ------
/// RecordingError
///     If the log lacks a joint or torque, or cannot be differentiated.
/// IdentificationError
///     If an effect cannot be recorded.
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> model = sgpr.identify_records(robot, [sgpr.record(robot, log)])
/// >>> model.logs
/// ['train.csv.gz']
#[pyfunction]
#[pyo3(signature = (robot, recording, *, processing=None, effects=None, blocks=5, counted=None, lags=true, suspects=None, labels=None),
    text_signature = "(robot, recording, *, processing=None, effects=None, blocks=5, counted=None, \
         lags=True, suspects=(), labels=None)")]
#[expect(clippy::too_many_arguments, reason = "one for each Python keyword")]
pub fn record(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    recording: &Bound<'_, Recording>,
    processing: Option<&Bound<'_, PyAny>>,
    effects: Option<&Bound<'_, PyAny>>,
    blocks: usize,
    counted: Option<(i64, i64)>,
    lags: bool,
    suspects: Option<&Bound<'_, PyAny>>,
    labels: Option<BTreeMap<String, String>>,
) -> PyResult<Record> {
    if !(1..=10_000).contains(&blocks) {
        return Err(invalid(format!("blocks: got {blocks}, expected 1 to 10000")));
    }
    let (robot, recording) = (&robot.get().inner, &recording.get().inner);
    require_usable(recording)?;
    let found = core::torque_scale(robot, recording).map_err(IntoPyErr::into_py_err)?;
    if let Some(found) = found {
        let (recording, finding) = (recording.source().into(), found.message);
        return Err(
            sgpr_core::recording::RecordingError::Doubtful { recording, finding }.into_py_err()
        );
    }
    let mut options = RecordOptions::default()
        .with_blocks(blocks)
        .with_counted(counted.map(Into::into))
        .with_lags(lags);
    options.labels = labels.unwrap_or_default();
    if let Some(suspects) = suspects {
        options.suspects = texts("suspects", suspects)?;
    }
    let model = processing.and_then(|given| given.cast::<Model>().ok());
    match (effects, model) {
        (Some(effects), _) => options.effects = texts("effects", effects)?,
        (None, Some(model)) => {
            let of_model = model.get().inner.parameter_set().effects().iter();
            options.effects = of_model.map(|effect| effect.name().to_string()).collect();
        }
        (None, None) => {}
    }
    let processing = processing.map(processing_of).transpose()?.flatten();
    let made = detached(py, || {
        let processing = match processing {
            Some(processing) => processing,
            None => core::choose_processing(
                robot,
                std::slice::from_ref(recording),
                &Default::default(),
            )?,
        };
        core::record(robot, recording, &processing, &options)
    });
    made.map(Record::from).map_err(IntoPyErr::into_py_err)
}

/// Identifies the torque model of a robot from records, without the logs: what `identify` finds in
/// the logs, processed alike, with the same options.
///
/// The order of the records does not matter, not even for the last bit; copies of a log count once.
///
/// Parameters
/// ----------
/// robot : Robot
/// records : list of Record
/// method : str, default "wls"
///     "wls", "ols", "ridge", "tls", as in `identify`; methods that look at single rows need the
///     logs.
/// noise, start, consistent, prior, prior_deviation, bounds, essential
///     As in `identify`. Parts of the data that are left out are blocks of records: with the five
///     of the default they are those of the logs.
///
/// Returns
/// -------
/// Model
///
/// Raises
/// ------
/// IdentificationError
///     If a record is of another robot, records differ in effects or processing, or hold too
///     little.
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> record = sgpr.record(robot, log, effects=["viscous_friction"])
/// >>> sgpr.identify_records(robot, [record]).effects
/// ['viscous_friction']
#[pyfunction]
#[pyo3(signature = (robot, records, **options),
    text_signature = "(robot, records, *, method='wls', noise=None, start='robot_file', \
         consistent=False, prior='entropic', prior_deviation=None, bounds=None, essential=False)")]
pub fn identify_records(
    py: Python<'_>,
    robot: &Bound<'_, Robot>,
    records: &Bound<'_, PyAny>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Model> {
    let Arguments { options, .. } = Arguments::of_sums(robot.get(), options)?;
    let records = given(records)?;
    let robot = &robot.get().inner;
    let records: Vec<&core::Record> = records.iter().map(|record| &record.get().inner).collect();
    let (model, report) = detached(py, || core::identify_records(robot, &records, &options))
        .map_err(IntoPyErr::into_py_err)?;
    crate::errors::warn(py, &core::copies_among(&records))?;
    Model::with_report(py, model, report)
}

/// How far a model is off on the rows of records at which joints move, without the logs.
///
/// Parameters
/// ----------
/// model : Model
///     Any of the same robot whose effects the records have.
/// records : list of Record
///
/// Returns
/// -------
/// list of dict
///     Per joint: "joint", "rows", "rmse" of measured minus predicted torque and "torque", the root
///     mean square of the measured one, N·m (N), in the band of the records.
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> record = sgpr.record(robot, log)
/// >>> errors = sgpr.compare_records(sgpr.identify_records(robot, [record]), [record])
/// >>> errors[0]["joint"], errors[0]["rmse"] < errors[0]["torque"]
/// ('joint_1', True)
#[pyfunction]
pub fn compare_records<'py>(
    py: Python<'py>,
    model: &Bound<'py, Model>,
    records: &Bound<'py, PyAny>,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let records = given(records)?;
    let model = &model.get().inner;
    let records: Vec<&core::Record> = records.iter().map(|record| &record.get().inner).collect();
    let errors =
        detached(py, || core::compare_records(model, &records)).map_err(IntoPyErr::into_py_err)?;
    let of_joint = |(joint, error): (&sgpr_core::robot::Joint, core::RecordedError)| {
        let dict = PyDict::new(py);
        dict.set_item("joint", &joint.name)?;
        dict.set_item("rows", error.rows)?;
        dict.set_item("rmse", error.rmse)?;
        dict.set_item("torque", error.torque)?;
        Ok(dict)
    };
    model.robot().joints().iter().zip(errors).map(of_joint).collect()
}

/// What a record says against a reference model: the rigid body stays, the effects of each joint
/// are fitted anew, and the gain of its torque and a tool at the last link are tried alone.
///
/// Parameters
/// ----------
/// model : Model
///     The reference, of the same robot; its effects are in the record.
/// record : Record
/// by_block : bool, default False
///     Whether each block speaks for itself.
///
/// Returns
/// -------
/// list of dict
///     One, or one per block: "tool_mass" (kg beyond the reference),
///     "tool_mass_standard_deviation", "tool_share" of the residual that the tool explains, and
///     "joints", each with "joint", "rows", "memory", "torque", "error" (root mean squares, N·m
///     (N)), "error_after" fitting the effects, "error_with_tool" if the last link's mass and
///     moments alone had changed, and "parameters", each with "name", "unit", "reference",
///     "change", "standard_deviation" and "error_alone", the error if this parameter alone had
///     changed; the last is the "gain".
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> record = sgpr.record(robot, log)
/// >>> found = sgpr.deviations(sgpr.identify_records(robot, [record]), record)
/// >>> [parameter["name"] for parameter in found[0]["joints"][0]["parameters"]][:2]
/// ['joint_1.Fv', 'joint_1.Fc']
#[pyfunction]
#[pyo3(signature = (model, record, *, by_block=false))]
pub fn deviations<'py>(
    py: Python<'py>,
    model: &Bound<'py, Model>,
    record: &Bound<'py, Record>,
    by_block: bool,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let (model, record) = (&model.get().inner, &record.get().inner);
    let found = detached(py, || core::deviations(model, record, by_block))
        .map_err(IntoPyErr::into_py_err)?;
    let joint = |joint: &JointDeviation| {
        let parameters = PyList::empty(py);
        for parameter in &joint.parameters {
            let dict = PyDict::new(py);
            dict.set_item("name", &parameter.name)?;
            dict.set_item("unit", parameter.unit)?;
            dict.set_item("reference", parameter.reference)?;
            dict.set_item("change", parameter.change)?;
            dict.set_item("standard_deviation", parameter.standard_deviation)?;
            dict.set_item("error_alone", parameter.error_alone)?;
            parameters.append(dict)?;
        }
        let figures = [
            ("memory", joint.memory),
            ("torque", joint.torque),
            ("error", joint.error),
            ("error_after", joint.error_after),
            ("error_with_tool", joint.error_with_tool),
        ];
        let dict = figures.into_py_dict(py)?;
        dict.set_item("joint", &record.joints[joint.joint])?;
        dict.set_item("rows", joint.rows)?;
        dict.set_item("parameters", parameters)?;
        Ok::<_, PyErr>(dict)
    };
    let block = |deviation: &Deviation| {
        let figures = [
            ("tool_mass", deviation.tool_mass),
            ("tool_mass_standard_deviation", deviation.tool_mass_deviation),
            ("tool_share", deviation.tool_share),
        ];
        let dict = figures.into_py_dict(py)?;
        dict.set_item("joints", deviation.joints.iter().map(joint).collect::<PyResult<Vec<_>>>()?)?;
        Ok(dict)
    };
    found.iter().map(block).collect()
}

/// Looks for effects that the equations of records lack, among the suspects that they were made
/// with, without the logs.
///
/// What lowers the squared error on parts of the logs that were left out of the fit by 5 % of its
/// joint's and by 2.5 standard errors is taken up, the largest first, all base parameters and what
/// was found fitted again each time; what others make superfluous goes again.
///
/// Parameters
/// ----------
/// robot : Robot
/// records : list of Record
///     Made with the same `suspects`.
///
/// Returns
/// -------
/// dict
///     "tests", what was found first, each with "effect", "joint", "constants" (those of the grid
///     that save most), "found", "gain" (share of the joint's squared error on left-out parts that
///     it saves) and "gain_standard_error", "parameters" of what was found ("symbol", "unit",
///     "value", "standard_deviation"), "alternatives", suspects that would have saved as much in
///     its place, and "mostly_unexplained": more of the joint's error goes on from row to row, as
///     no noise does, than what was found there explains, so that it can be the shadow of an effect
///     that is no suspect; and "left_out_errors": per joint "joint", "without" and "with" what was
///     found, N·m (N), and "unexplained", the share of the squared error that still goes on.
///
/// Raises
/// ------
/// IdentificationError
///     If records have no suspects, or different ones, or are of another robot.
///
/// Examples
/// --------
/// >>> robot, log = sgpr.Robot.from_urdf("robot.urdf"), sgpr.read("train.csv.gz")
/// >>> record = sgpr.record(robot, log, suspects=["quadratic_viscous_friction"])
/// >>> found = sgpr.diagnose_records(robot, [record])
/// >>> len(found["left_out_errors"]) == robot.dof
/// True
#[pyfunction]
pub fn diagnose_records<'py>(
    py: Python<'py>,
    robot: &Bound<'py, Robot>,
    records: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyDict>> {
    let records = given(records)?;
    let robot = &robot.get().inner;
    let records: Vec<&core::Record> = records.iter().map(|record| &record.get().inner).collect();
    let found =
        detached(py, || core::diagnose_records(robot, &records)).map_err(IntoPyErr::into_py_err)?;
    let joints: Vec<String> = robot.joint_names().map(String::from).collect();
    let test = |test: &core::SuspectTest| {
        let dict = described(py, &test.suspect, &joints)?;
        dict.set_item("found", test.found)?;
        dict.set_item("gain", test.judgement.gain)?;
        dict.set_item("gain_standard_error", test.judgement.standard_error)?;
        let parameters = PyList::empty(py);
        for (symbol, unit, value, deviation) in &test.parameters {
            let one = PyDict::new(py);
            one.set_item("symbol", symbol)?;
            one.set_item("unit", unit)?;
            one.set_item("value", value)?;
            one.set_item("standard_deviation", deviation)?;
            parameters.append(one)?;
        }
        dict.set_item("parameters", parameters)?;
        let alternatives = test.alternatives.iter().map(|other| described(py, other, &joints));
        dict.set_item("alternatives", alternatives.collect::<PyResult<Vec<_>>>()?)?;
        dict.set_item("mostly_unexplained", test.mostly_unexplained)?;
        Ok(dict)
    };
    let [without, with] = &found.left_out_errors;
    let error = |joint: usize| {
        let dict = PyDict::new(py);
        dict.set_item("joint", &joints[joint])?;
        dict.set_item("without", without[joint])?;
        dict.set_item("with", with[joint])?;
        dict.set_item("unexplained", found.unexplained[joint])?;
        Ok(dict)
    };
    let dict = PyDict::new(py);
    dict.set_item("tests", found.tests.iter().map(test).collect::<PyResult<Vec<_>>>()?)?;
    let errors = (0..joints.len()).map(error);
    dict.set_item("left_out_errors", errors.collect::<PyResult<Vec<_>>>()?)?;
    Ok(dict)
}

fn described<'py>(
    py: Python<'py>,
    suspect: &core::Suspect,
    joints: &[String],
) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("effect", &suspect.effect)?;
    dict.set_item("joint", &joints[suspect.joint])?;
    dict.set_item("constants", &suspect.constants)?;
    Ok(dict)
}

fn given<'py>(records: &Bound<'py, PyAny>) -> PyResult<Vec<Bound<'py, Record>>> {
    let wrong = |found: &Bound<'_, PyAny>| {
        let found = found.get_type().name().map_or_else(|_| "?".into(), |name| name.to_string());
        pyo3::exceptions::PyTypeError::new_err(format!(
            "records: got {found}, expected a list of Record"
        ))
    };
    let mut all = Vec::new();
    for item in records.try_iter().map_err(|_| wrong(records))? {
        let item = item?;
        all.push(item.cast::<Record>().map_err(|_| wrong(&item))?.clone());
    }
    Ok(all)
}
