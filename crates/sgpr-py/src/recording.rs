//! Logs: made, read, checked, repaired, written.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use numpy::{PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyList, PySlice};
use pythonize::{depythonize, pythonize};
use sgpr_core::motion::average_periods;
use sgpr_core::recording::csv::{self, ColumnMap, Columns, ReadOptions, Rows};
use sgpr_core::recording::mcap::{self, Clock, McapOptions};
use sgpr_core::recording::{
    self as core, Channel, Format, IssueKind, Layout, Reader, RecordingError, Repair, Resample,
    Severity, Units, parquet,
};

use crate::convert::{Numbers, array, choice, items, kind_of, positive, texts, unknown, view};
use crate::detached::detached;
use crate::errors::{IntoPyErr, invalid};
use crate::keywords::Keywords;

type Any<'py> = Bound<'py, PyAny>;
type Array<'py> = Bound<'py, PyArrayDyn<f64>>;
type Times<'py> = Bound<'py, PyArrayDyn<i64>>;
type Motion<'py> = (
    Times<'py>,
    Array<'py>,
    Option<Array<'py>>,
    Option<Array<'py>>,
    Vec<String>,
    Bound<'py, PyDict>,
);
type Given<'py> = (Any<'py>, Any<'py>, Option<Any<'py>>, Option<Any<'py>>, Any<'py>, Any<'py>);
/// Where a recording comes from: source, notes, layout, accepted findings.
type Origin<'py> = (String, Vec<String>, Option<Any<'py>>, Vec<String>);
/// What builds a recording again: its arrays, and where it comes from.
type Parts<'py> = (Motion<'py>, Origin<'py>);

/// One trajectory as it was logged. Samples are rows, joints are columns; SI units; time in integer
/// nanoseconds.
///
/// Values may be anything, NaN included: `issues` tells what is wrong with them, and only `repair`
/// changes them. Arrays are read-only views of the recording's memory.
///
/// Parameters
/// ----------
/// t : array of shape (N,)
///     Seconds, or integer nanoseconds, or datetime64.
/// q : array of shape (N, n)
///     Positions, rad (m).
/// dq, tau : array of shape (N, n), optional
///     Velocities, rad/s (m/s), and torques, N·m (N).
/// joint_names : list of str, optional
///     `joint_1`, `joint_2`, ... by default.
/// channels : dict of str to array of shape (N,), optional
///     Whatever else was logged.
/// source : str, default "array"
///     Where the recording comes from, for messages.
///
/// Examples
/// --------
/// >>> t = np.arange(1000) / 250
/// >>> rec = sgpr.Recording(t, np.sin(t)[:, None], np.cos(t)[:, None], joint_names=["elbow"])
/// >>> len(rec), rec.dof, rec.sample_rate_hz
/// (1000, 1, 250.0)
#[pyclass(module = "sgpr", frozen)]
pub struct Recording {
    /// Of the core.
    pub inner: core::Recording,
    issues: PyOnceLock<Vec<Py<Issue>>>,
}

impl From<core::Recording> for Recording {
    fn from(inner: core::Recording) -> Self {
        Self { inner, issues: PyOnceLock::new() }
    }
}

#[pymethods]
impl Recording {
    #[new]
    #[pyo3(signature = (t, q, dq=None, tau=None, *, joint_names=None, channels=None, source="array"))]
    fn new(
        t: &Bound<'_, PyAny>,
        q: &Bound<'_, PyAny>,
        dq: Option<&Bound<'_, PyAny>>,
        tau: Option<&Bound<'_, PyAny>>,
        joint_names: Option<&Bound<'_, PyAny>>,
        channels: Option<&Bound<'_, PyAny>>,
        source: &str,
    ) -> PyResult<Self> {
        let time = nanoseconds(t)?;
        let rows = time.len();
        let q = Numbers::new("q", q)?;
        let n = match *q.shape() {
            [samples, n] if samples == rows && n > 0 => n,
            _ => return Err(q.wrong_shape(&format!("({rows}, n), one row per time"))),
        };
        let names = match joint_names {
            Some(names) => texts("joint_names", names)?,
            None => (1..=n).map(|joint| format!("joint_{joint}")).collect(),
        };
        if names.len() != n {
            return Err(invalid(format!(
                "joint_names: got {}, expected {n}: one name for each joint",
                names.len()
            )));
        }
        require_distinct(source, &names)?;
        let optional = |name: &str,
                        values: Option<&Bound<'_, PyAny>>|
         -> PyResult<Option<Vec<f64>>> {
            let numbers =
                values.map(|values| Numbers::new(name, values)?.shaped(&[rows, n])).transpose()?;
            Ok(numbers.map(|numbers| numbers.values().to_vec()))
        };
        let (velocity, torque) = (optional("dq", dq)?, optional("tau", tau)?);
        let mut kept = Vec::new();
        for (name, values) in
            channels.map(|channels| items("channels", channels)).transpose()?.unwrap_or_default()
        {
            let values = Numbers::new(&format!("channels['{name}']"), &values)?
                .shaped(&[rows])?
                .values()
                .to_vec();
            kept.push(Channel { name, values });
        }
        let recording =
            core::Recording::new(source, names, time, q.values().to_vec(), velocity, torque, kept);
        recording.map(Self::from).map_err(IntoPyErr::into_py_err)
    }

    /// Where the recording comes from.
    #[getter]
    fn source(&self) -> &str {
        self.inner.source()
    }

    /// Names of the joints, in column order.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.inner.joint_names().to_vec()
    }

    /// Number of joints n.
    #[getter]
    fn dof(&self) -> usize {
        self.inner.dof()
    }

    /// Time since the first sample, (N,), s.
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        array(py, &[self.inner.len()], self.inner.time_seconds())
    }

    /// Time stamps, (N,), ns.
    #[getter]
    fn time_ns<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArrayDyn<i64>>> {
        view(slf, &[slf.get().inner.len()], |recording| recording.inner.time())
    }

    /// Positions, (N, n), rad (m).
    #[getter]
    fn q<'py>(slf: &Bound<'py, Self>) -> PyResult<Array<'py>> {
        view(slf, &shape(slf), |recording| recording.inner.position())
    }

    /// Velocities, (N, n), rad/s (m/s), or None if they were not logged.
    #[getter]
    fn dq<'py>(slf: &Bound<'py, Self>) -> PyResult<Option<Array<'py>>> {
        let logged = slf.get().inner.velocity().is_some();
        logged
            .then(|| {
                view(slf, &shape(slf), |recording| recording.inner.velocity().unwrap_or_default())
            })
            .transpose()
    }

    /// Torques, (N, n), N·m (N), or None if they were not logged.
    #[getter]
    fn tau<'py>(slf: &Bound<'py, Self>) -> PyResult<Option<Array<'py>>> {
        let logged = slf.get().inner.torque().is_some();
        logged
            .then(|| {
                view(slf, &shape(slf), |recording| recording.inner.torque().unwrap_or_default())
            })
            .transpose()
    }

    /// Everything else that was logged, name to (N,).
    #[getter]
    fn channels<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(slf.py());
        for (index, channel) in slf.get().inner.channels().iter().enumerate() {
            let values = view(slf, &[slf.get().inner.len()], |recording| {
                &recording.inner.channels()[index].values
            })?;
            dict.set_item(&channel.name, values)?;
        }
        Ok(dict)
    }

    /// What the reader assumed or left out, in sentences.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.inner.notes().to_vec()
    }

    /// Which column of a table became what, in which unit; None for recordings that are not made
    /// from a table.
    ///
    /// Keys: "time" (in words), "joints" (a dict for each joint with its name, and "position",
    /// "velocity", "torque" with "column", "unit", whether the unit was "stated", and
    /// "torque_constant"), "by_order" (whether joints were given columns in the order of their
    /// numbers), and "text": all of it in one line.
    ///
    /// Examples
    /// --------
    /// >>> sgpr.read("train.csv.gz").layout["joints"][0]["torque"]["column"]
    /// 'tau_1'
    #[getter]
    fn layout<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        self.inner.layout().map(|layout| layout_dict(py, layout)).transpose()
    }

    /// Findings that are taken as they are, see `accept`.
    #[getter]
    fn accepted(&self) -> Vec<&'static str> {
        self.inner.accepted().iter().map(|kind| kind.name()).collect()
    }

    /// A hexadecimal number that recordings with the same joints, times and values share, and
    /// others do not.
    ///
    /// Examples
    /// --------
    /// >>> log = sgpr.read("train.csv.gz")
    /// >>> log.content_hash == sgpr.read("train.csv.gz").content_hash
    /// True
    #[getter]
    fn content_hash(&self) -> String {
        format!("{:032x}", self.inner.content_hash())
    }

    /// The same recording, in which findings of these kinds are right: "position_in_degrees",
    /// "unlikely_rate", "torque_scale", "stray_sample", "joints_by_order".
    ///
    /// What looks like a wrong unit, order or sample is refused until it is stated or repaired, or
    /// accepted.
    ///
    /// Examples
    /// --------
    /// >>> slow = sgpr.Recording([0.0, 2.0, 4.0], [[0.0], [0.1], [0.2]])
    /// >>> [issue.rank for issue in slow.issues if issue.kind == "unlikely_rate"]
    /// ['stop']
    /// >>> [issue.rank for issue in slow.accept(["unlikely_rate"]).issues if issue.kind == "unlikely_rate"]
    /// ['know']
    fn accept(&self, kinds: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(self.inner.clone().accepting(&issue_kinds(kinds)?).into())
    }

    /// What is wrong, or worth knowing, about the log: errors first, then warnings, then notes.
    ///
    /// Examples
    /// --------
    /// >>> rec = sgpr.Recording([0.0, 0.1, 0.2], [[0.0], [np.nan], [0.2]])
    /// >>> [(issue.kind, issue.severity) for issue in rec.issues][0]
    /// ('not_finite', 'error')
    #[getter]
    fn issues(&self, py: Python<'_>) -> PyResult<Vec<Py<Issue>>> {
        let found = self.issues.get_or_try_init(py, || {
            let issues = detached(py, || core::inspect(&self.inner));
            issues.into_iter().map(|issue| Py::new(py, Issue::from(issue))).collect::<PyResult<_>>()
        })?;
        Ok(found.iter().map(|issue| issue.clone_ref(py)).collect())
    }

    /// One over the median period, Hz; None with fewer than two samples or a time that stands
    /// still.
    #[getter]
    fn sample_rate_hz(&self) -> Option<f64> {
        self.inner.sample_rate_hz()
    }

    /// Time from the first to the last sample, s.
    #[getter]
    fn duration(&self) -> f64 {
        self.inner.duration()
    }

    fn __len__(&self) -> usize {
        self.inner.len()
    }

    /// The joints of these names, in this order.
    ///
    /// Examples
    /// --------
    /// >>> rec = sgpr.Recording([0.0, 0.1], [[1.0, 2.0], [3.0, 4.0]], joint_names=["a", "b"])
    /// >>> rec.select(["b"]).q
    /// array([[2.],
    ///        [4.]])
    fn select(&self, joints: &Bound<'_, PyAny>) -> PyResult<Self> {
        let names = texts("joints", joints)?;
        self.inner.select(&names).map(Self::from).map_err(IntoPyErr::into_py_err)
    }

    /// The same recording with other names for its joints, in order.
    fn renamed(&self, joints: &Bound<'_, PyAny>) -> PyResult<Self> {
        let names = texts("joints", joints)?;
        self.inner.clone().with_joint_names(names).map(Self::from).map_err(IntoPyErr::into_py_err)
    }

    /// The samples from `start` up to, not including, `stop`.
    fn slice(&self, start: i64, stop: i64) -> PyResult<Self> {
        let samples = self.inner.len();
        match (usize::try_from(start), usize::try_from(stop)) {
            (Ok(start), Ok(stop)) if start <= stop && stop <= samples => {
                Ok(self.inner.slice(start..stop).into())
            }
            _ => Err(invalid(format!(
                "samples {start} to {stop}: expected 0 <= start <= stop <= {samples}"
            ))),
        }
    }

    /// The samples from `start` to `end`, both ends included, s since the first sample.
    ///
    /// Examples
    /// --------
    /// >>> log = sgpr.Recording(np.arange(100) / 10, np.zeros((100, 1)))
    /// >>> len(log.between(2.0, 3.0))
    /// 11
    fn between(&self, start: f64, end: f64) -> PyResult<Self> {
        let request = Repair::default().with_trim(Some(range("between", start, end)?));
        let (mut parts, _) = core::repair(&self.inner, &request).map_err(IntoPyErr::into_py_err)?;
        parts
            .pop()
            .map(Self::from)
            .ok_or_else(|| invalid(format!("between({start}, {end}): there is no sample")))
    }

    /// Samples by number, `log[100:200]`, as a list would give them.
    ///
    /// Examples
    /// --------
    /// >>> log = sgpr.Recording(np.arange(100) / 10, np.zeros((100, 1)))
    /// >>> len(log[-30:]), len(log.between(2.0, 3.0))
    /// (30, 11)
    fn __getitem__(&self, key: &Bound<'_, PyAny>) -> PyResult<Self> {
        let wrong = || {
            let text = "expected a slice of sample numbers, log[100:200]; for seconds there is \
                 log.between(start, end)";
            pyo3::exceptions::PyTypeError::new_err(text)
        };
        let part = key.cast::<PySlice>().map_err(|_| wrong())?;
        let found =
            part.indices(self.inner.len().try_into().map_err(|_| wrong())?).map_err(|_| wrong())?;
        if found.step != 1 {
            return Err(invalid(
                "samples are taken one after the other: a step would change the rate (see \
                 `repair`)",
            ));
        }
        let start = usize::try_from(found.start).unwrap_or_default();
        Ok(self.inner.slice(start..start + found.slicelength).into())
    }

    /// A pandas DataFrame: `t_s`, then `NAME_position`, `NAME_velocity`, `NAME_torque` for each
    /// joint, then the channels.
    ///
    /// Examples
    /// --------
    /// >>> log = sgpr.Recording([0.0, 0.1], [[1.0], [2.0]], joint_names=["elbow"])
    /// >>> list(log.to_dataframe().columns)
    /// ['t_s', 'elbow_position']
    fn to_dataframe<'py>(slf: &Bound<'py, Self>) -> PyResult<Any<'py>> {
        slf.py().import("sgpr._frames")?.call_method1("to_dataframe", (slf,))
    }

    /// A recording from a pandas or polars DataFrame whose columns are named as those of a CSV
    /// file.
    ///
    /// Parameters
    /// ----------
    /// frame : pandas.DataFrame or polars.DataFrame
    ///     A time may also be its index. Dates are understood.
    /// joints, **options
    ///     As in `read_csv`.
    ///
    /// Examples
    /// --------
    /// >>> log = sgpr.read("train.csv.gz")
    /// >>> again = sgpr.Recording.from_dataframe(log.to_dataframe(), joints=log.joint_names)
    /// >>> bool(np.array_equal(again.tau, log.tau))
    /// True
    #[staticmethod]
    #[pyo3(signature = (frame, joints=None, **options))]
    fn from_dataframe<'py>(
        frame: &Bound<'py, PyAny>,
        joints: Option<&Bound<'py, PyAny>>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Any<'py>> {
        frame.py().import("sgpr._frames")?.call_method("read", (frame, joints), options)
    }

    /// A Plotly figure of position, velocity and torque over time.
    ///
    /// Examples
    /// --------
    /// >>> log = sgpr.Recording([0.0, 0.1], [[1.0], [2.0]])
    /// >>> len(log.plot().data)
    /// 1
    fn plot<'py>(slf: &Bound<'py, Self>) -> PyResult<Any<'py>> {
        slf.py().import("sgpr._views")?.call_method1("plot_recording", (slf,))
    }

    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Any<'py>> {
        slf.py().import("sgpr._views")?.call_method1("recording_html", (slf,))
    }

    /// The same recording from another source and with more notes, for readers that go through
    /// another file.
    ///
    /// - `layout`: which column became what, as in `layout`
    #[pyo3(signature = (source, notes, layout=None))]
    fn _from_source(
        &self,
        source: &str,
        notes: Vec<String>,
        layout: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let recording = self.inner.clone().with_source(source);
        let recording = notes.into_iter().fold(recording, core::Recording::with_note);
        Ok(match layout {
            Some(layout) => recording.with_layout(Some(depythonize(layout)?)),
            None => recording,
        }
        .into())
    }

    /// Changes the recording as asked, and nothing else, in the order of the parameters.
    ///
    /// Parameters
    /// ----------
    /// trim : (float, float), optional
    ///     Keep this part only, s since the first sample, both ends included.
    /// sort : bool
    ///     Bring the samples into the order of their stamps.
    /// drop_duplicates : bool
    ///     Of samples with the same stamp, keep the first.
    /// drop_not_finite : bool
    ///     Remove samples with a position, velocity or torque that is not finite.
    /// replace_strays : bool
    ///     Put what lies between its neighbours in the place of a sample with a value that leaves
    ///     them and comes back; without those at the ends.
    /// drop_repeated : bool
    ///     Remove samples that repeat the one before while the arm moves.
    /// unwrap : bool
    ///     Take back jumps of positions by a full turn, of joints whose position is wrapped to one.
    /// split_gaps : float, optional
    ///     Cut where the time makes a step longer than this, s.
    /// resample : float or "median", optional
    ///     Bring the samples to equal steps: a rate in Hz, or one over the median step. Cuts at
    ///     gaps.
    ///
    /// Returns
    /// -------
    /// Repaired
    ///     `recordings` (several if it was cut) and `actions`, a sentence for each thing done.
    ///
    /// Examples
    /// --------
    /// >>> rec = sgpr.Recording([0.0, 0.1, 0.2], [[0.0], [np.nan], [0.2]], source="log")
    /// >>> repaired = rec.repair(drop_not_finite=True)
    /// >>> repaired.actions
    /// ['log: dropped 1 of 3 samples with values that are not finite']
    #[pyo3(signature = (*, trim=None, sort=false, drop_duplicates=false, drop_not_finite=false, replace_strays=false,
        drop_repeated=false, unwrap=false, split_gaps=None, resample=None))]
    #[expect(clippy::too_many_arguments, reason = "one per step of the repair")]
    fn repair(
        &self,
        py: Python<'_>,
        trim: Option<(f64, f64)>,
        sort: bool,
        drop_duplicates: bool,
        drop_not_finite: bool,
        replace_strays: bool,
        drop_repeated: bool,
        unwrap: bool,
        split_gaps: Option<f64>,
        resample: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Repaired> {
        let resample = match resample {
            None => None,
            Some(rate) => Some(match rate.extract::<f64>() {
                Ok(rate) => Resample::Hz(positive("resample", rate)?),
                Err(_) if rate.extract::<String>().is_ok_and(|word| word == "median") => {
                    Resample::MedianRate
                }
                Err(_) => {
                    return Err(invalid(format!(
                        "resample = {}: expected a rate in Hz or 'median'",
                        rate.repr()?
                    )));
                }
            }),
        };
        let trim = trim.map(|(start, end)| range("trim", start, end)).transpose()?;
        let request = Repair::default()
            .with_trim(trim)
            .with_sort(sort)
            .with_drop_duplicates(drop_duplicates)
            .with_drop_not_finite(drop_not_finite)
            .with_replace_strays(replace_strays)
            .with_drop_repeated(drop_repeated)
            .with_unwrap(unwrap)
            .with_split_gaps(split_gaps)
            .with_resample(resample);
        let (parts, actions) =
            detached(py, || core::repair(&self.inner, &request)).map_err(IntoPyErr::into_py_err)?;
        let recordings =
            parts.into_iter().map(|part| Py::new(py, Self::from(part))).collect::<PyResult<_>>()?;
        Ok(Repaired { recordings, actions })
    }

    /// Averages a periodic motion over its periods, leaving out the first `skip` periods, in which
    /// the arm settles.
    ///
    /// Parameters
    /// ----------
    /// period : float
    ///     s; a whole number of samples.
    /// skip : int, default 0
    ///
    /// Returns
    /// -------
    /// recording : Recording
    ///     One period: mean position, velocity and torque.
    /// noise : dict of str to array of shape (n,)
    ///     "position_noise" and "torque_noise": standard deviation of a single sample about the
    ///     mean; the latter are weights for `identify(..., noise=...)`.
    ///
    /// Examples
    /// --------
    /// >>> t = np.arange(300) / 100
    /// >>> q = np.sin(2 * np.pi * t)[:, None]
    /// >>> mean, noise = sgpr.Recording(t, q, tau=2 * q).average_periods(1.0)
    /// >>> len(mean), bool(noise["torque_noise"][0] < 1e-12)
    /// (100, True)
    #[pyo3(signature = (period, *, skip=0))]
    fn average_periods<'py>(
        &self,
        py: Python<'py>,
        period: f64,
        skip: usize,
    ) -> PyResult<(Self, Bound<'py, PyDict>)> {
        let step = self.inner.sample_rate_hz().map_or(0.0, |rate| 1.0 / rate);
        if positive("period", period)? < step {
            return Err(invalid(format!(
                "period = {period}: shorter than one step of the time, {step} s"
            )));
        }
        let average = detached(py, || average_periods(&self.inner, period, skip))
            .map_err(IntoPyErr::into_py_err)?;
        let noise = PyDict::new(py);
        noise.set_item("position_noise", array(py, &[self.dof()], average.position_noise)?)?;
        noise.set_item("torque_noise", array(py, &[self.dof()], average.torque_noise)?)?;
        Ok((average.recording.into(), noise))
    }

    /// Writes the recording whole or not at all: `.csv`, `.csv.gz`, or `.mcap` (topic
    /// `/joint_states`, no channels).
    ///
    /// Examples
    /// --------
    /// >>> rec = sgpr.Recording([0.0, 0.1], [[1.0], [2.0]])
    /// >>> rec.save("out.csv")
    /// >>> bool(np.array_equal(sgpr.read("out.csv").q, rec.q))
    /// True
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let name =
            path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
        let write = || match &name {
            name if name.ends_with(".mcap") => {
                mcap::write(&path, &[("/joint_states", &self.inner)])
            }
            _ => csv::write(&path, &self.inner),
        };
        if ![".mcap", ".csv", ".csv.gz"].iter().any(|suffix| name.ends_with(suffix)) {
            return Err(invalid(format!(
                "{}: expected a name that ends in .csv, .csv.gz or .mcap",
                path.display()
            )));
        }
        detached(py, write).map_err(IntoPyErr::into_py_err)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Parts<'py>)> {
        let (time, q) = (Self::time_ns(slf)?, Self::q(slf)?);
        let motion = (
            time,
            q,
            Self::dq(slf)?,
            Self::tau(slf)?,
            slf.get().joint_names(),
            Self::channels(slf)?,
        );
        let layout = slf.get().layout(slf.py())?.map(Bound::into_any);
        let accepted = slf.get().accepted().into_iter().map(String::from).collect();
        let origin = (slf.get().source().into(), slf.get().notes(), layout, accepted);
        Ok((slf.get_type().getattr("_from_parts")?, (motion, origin)))
    }

    #[staticmethod]
    fn _from_parts(motion: Given<'_>, origin: Origin<'_>) -> PyResult<Self> {
        let ((t, q, dq, tau, joint_names, channels), (source, notes, layout, accepted)) =
            (motion, origin);
        let made = Self::new(
            &t,
            &q,
            dq.as_ref(),
            tau.as_ref(),
            Some(&joint_names),
            Some(&channels),
            &source,
        )?;
        let accepted =
            accepted.iter().map(|kind| kind.parse()).collect::<Result<Vec<IssueKind>, _>>();
        let accepted = accepted.map_err(RecordingError::into_py_err)?;
        let layout = layout.map(|layout| depythonize(&layout)).transpose()?;
        let recording = notes.into_iter().fold(made.inner, core::Recording::with_note);
        Ok(recording.with_layout(layout).accepting(&accepted).into())
    }

    fn __repr__(&self) -> String {
        let log = &self.inner;
        let has = |logged: bool, name| if logged { name } else { "" };
        let rate = log.sample_rate_hz().map_or(String::new(), |rate| format!(", {rate:.6} Hz"));
        let mut text = format!(
            "Recording '{}'\n  {} samples{rate}, {:.3} s\n  joints: {}\n  position{}{}",
            log.source(),
            log.len(),
            log.duration(),
            log.joint_names().join(", "),
            has(log.velocity().is_some(), ", velocity"),
            has(log.torque().is_some(), ", torque"),
        );
        if !log.channels().is_empty() {
            text += &format!("; {} channels", log.channels().len());
        }
        text
    }
}

fn shape(recording: &Bound<'_, Recording>) -> [usize; 2] {
    [recording.get().inner.len(), recording.get().inner.dof()]
}

fn require_distinct(source: &str, names: &[String]) -> PyResult<()> {
    match names.iter().enumerate().find(|(index, name)| names[..*index].contains(name)) {
        Some((_, joint)) => {
            let (recording, joint) = (source.into(), joint.clone());
            Err(RecordingError::DuplicateJoint { recording, joint }.into_py_err())
        }
        None => Ok(()),
    }
}

/// Time stamps from seconds, integer nanoseconds or datetime64.
fn nanoseconds(t: &Bound<'_, PyAny>) -> PyResult<Vec<i64>> {
    let given = t.py().import("numpy")?.call_method1("asarray", (t,))?;
    let integers = match kind_of(&given)? {
        'M' => {
            given.call_method1("astype", ("datetime64[ns]",))?.call_method1("astype", ("int64",))?
        }
        'i' => given.call_method1("astype", ("int64",))?,
        _ => return Numbers::new("t", &given).and_then(|seconds| from_seconds(&seconds)),
    };
    let integers = integers.cast_into::<PyArrayDyn<i64>>()?;
    if integers.ndim() != 1 {
        return Err(invalid(format!("t: got an array of {} axes, expected (N,)", integers.ndim())));
    }
    integers.to_vec().map_err(|_| invalid("t: expected a contiguous array"))
}

fn from_seconds(seconds: &Numbers<'_>) -> PyResult<Vec<i64>> {
    if seconds.shape().len() != 1 {
        return Err(seconds.wrong_shape("(N,)"));
    }
    /// 64 bits of nanoseconds reach 292 years.
    const FURTHEST: f64 = 9.2e9;
    let convert = |(index, &time): (usize, &f64)| {
        if time.is_nan() || time.abs() >= FURTHEST {
            return Err(invalid(format!("t[{index}] is {time}: not a time in seconds")));
        }
        let whole = time.trunc();
        Ok(whole as i64 * 1_000_000_000 + ((time - whole) * 1e9).round() as i64)
    };
    seconds.values().iter().enumerate().map(convert).collect()
}

fn layout_dict<'py>(py: Python<'py>, layout: &Layout) -> PyResult<Bound<'py, PyDict>> {
    let dict = pythonize(py, layout)?.cast_into::<PyDict>()?;
    dict.set_item("text", layout.to_string())?;
    Ok(dict)
}

fn issue_kinds(given: &Bound<'_, PyAny>) -> PyResult<Vec<IssueKind>> {
    texts("accept", given)?
        .iter()
        .map(|kind| kind.parse().map_err(RecordingError::into_py_err))
        .collect()
}

/// Refuses a recording with an error, in the words of its inspection.
pub fn require_usable(recording: &core::Recording) -> PyResult<()> {
    let doubts = core::refusals(recording);
    let Some(first) = doubts.first() else { return Ok(()) };
    let more = match doubts.len() - 1 {
        0 => String::new(),
        1 => " (1 more finding like this)".into(),
        count => format!(" ({count} more findings like this)"),
    };
    Err(RecordingError::Doubtful {
        recording: recording.source().into(),
        finding: first.message.clone() + &more,
    }
    .into_py_err())
}

/// Something found in a recording.
#[pyclass(module = "sgpr", frozen, get_all)]
pub struct Issue {
    /// What it is: "not_finite", "gap", ...
    kind: &'static str,
    /// "error": nothing can be computed before it is repaired; "warning": results may suffer;
    /// "note": good to know.
    severity: &'static str,
    /// The same as what to do about it: "stop", "look", "know".
    rank: &'static str,
    /// First occurrence, s since the first sample; None if it concerns the whole log.
    time: Option<f64>,
    /// The quantity concerned; None if it concerns all.
    channel: Option<String>,
    /// Number of samples (or joints) concerned.
    count: usize,
    /// A sentence with numbers, and what to do.
    message: String,
}

impl From<core::Issue> for Issue {
    fn from(issue: core::Issue) -> Self {
        let core::Issue { kind, severity, time, channel, count, message, .. } = issue;
        let rank = severity.rank();
        let severity = match severity {
            Severity::Error => "error",
            Severity::Warning => "warning",
            Severity::Note => "note",
        };
        Self { kind: kind.name(), severity, rank, time, channel, count, message }
    }
}

#[pymethods]
impl Issue {
    fn __repr__(&self) -> String {
        format!("Issue({}, {}: {})", self.severity, self.kind, self.message)
    }
}

/// What a repair made of a recording.
#[pyclass(module = "sgpr", frozen, get_all)]
pub struct Repaired {
    /// The stretches that result.
    recordings: Vec<Py<Recording>>,
    /// A sentence for each thing done.
    actions: Vec<String>,
}

#[pymethods]
impl Repaired {
    fn __repr__(&self) -> String {
        let done: Vec<String> = self.actions.iter().map(|action| format!("\n  {action}")).collect();
        format!("Repaired, {} recordings{}", self.recordings.len(), done.concat())
    }
}

/// Reads a table of numbers, `.csv` or `.csv.gz`, whose first line names the columns.
///
/// Columns are found by their names, with or without a unit at their end: `t`, `time_ns`,
/// `header.stamp.sec`; `q1_rad`, `pos_1`, `elbow_position`; `dq1_rad_s`, `elbow_velocity`;
/// `tau1_Nm`, `effort_1`; currents `i1_A`. Titles above the names, a line of units below them,
/// dates, Latin-1 and decimal commas are understood. Which column became what is in
/// `Recording.layout`, what was assumed or left out in `Recording.notes`; numeric columns that
/// belong to no joint become channels.
///
/// Parameters
/// ----------
/// path : str or os.PathLike
/// joints : list of str, optional
///     Joints wanted, in order, e.g. `robot.joint_names`; by default those that the columns name.
/// columns : dict, optional
///     Columns, where their names do not tell: keys "time", "position", "velocity", "torque";
///     values a pattern (`"i{}_A"`, where {} is the number of the joint from 1 and {name} its name)
///     or a list of names in joint order.
/// units : dict, optional
///     Units, where the names do not tell: keys as in `columns`; `"deg"`, `"rpm"`, `"mNm"`, `"ms"`,
///     ...
/// torque_constants : array of shape (n,) in the order of the joints, or dict, optional
///     N·m per A: the torque is computed from the currents, which are the columns of "torque" or
///     those named `i1_A`.
/// accept : list of str, optional
///     Findings that are right, as in `Recording.accept`; "joints_by_order": joints with names are
///     columns with numbers, in the order of the joints.
/// rows : (int, int), optional
///     Data rows to read, counted from 1, both ends included.
/// seconds : (float, float), optional
///     Part to read, s since the first row, both ends included.
/// sample_rate_hz : float, optional
///     Rate of a log without time column.
/// limit_bytes : int, default 4 GiB
///     Largest amount of unpacked text that is read.
///
/// Examples
/// --------
/// >>> rec = sgpr.read_csv("train.csv.gz", seconds=(0, 10))
/// >>> len(rec), rec.dof
/// (2501, 6)
#[pyfunction]
#[pyo3(signature = (path, joints=None, *, columns=None, units=None, torque_constants=None, accept=None, rows=None,
    seconds=None, sample_rate_hz=None, limit_bytes=None))]
#[expect(clippy::too_many_arguments, reason = "the options of a format")]
pub fn read_csv(
    py: Python<'_>,
    path: PathBuf,
    joints: Option<&Bound<'_, PyAny>>,
    columns: Option<&Bound<'_, PyAny>>,
    units: Option<&Bound<'_, PyAny>>,
    torque_constants: Option<&Bound<'_, PyAny>>,
    accept: Option<&Bound<'_, PyAny>>,
    rows: Option<(i128, i128)>,
    seconds: Option<(f64, f64)>,
    sample_rate_hz: Option<f64>,
    limit_bytes: Option<u64>,
) -> PyResult<Recording> {
    let given = TableOptions {
        joints,
        columns,
        units,
        torque_constants,
        accept,
        rows,
        seconds,
        sample_rate_hz,
        limit_bytes,
    };
    let options = given.read()?;
    let recording = detached(py, || csv::read(&path, &options));
    recording.map(Recording::from).map_err(IntoPyErr::into_py_err)
}

/// Options of tables as Python gives them.
struct TableOptions<'a, 'py> {
    joints: Option<&'a Any<'py>>,
    columns: Option<&'a Any<'py>>,
    units: Option<&'a Any<'py>>,
    torque_constants: Option<&'a Any<'py>>,
    accept: Option<&'a Any<'py>>,
    rows: Option<(i128, i128)>,
    seconds: Option<(f64, f64)>,
    sample_rate_hz: Option<f64>,
    limit_bytes: Option<u64>,
}

impl TableOptions<'_, '_> {
    fn read(self) -> PyResult<ReadOptions> {
        let Self {
            joints,
            columns,
            units,
            torque_constants,
            accept,
            rows,
            seconds,
            sample_rate_hz,
            limit_bytes,
        } = self;
        let (mut constants, mut named) = (None, Vec::new());
        match torque_constants {
            Some(given) if given.is_instance_of::<PyDict>() => {
                for (joint, constant) in items("torque_constants", given)? {
                    named.push((joint, constant.extract()?));
                }
            }
            Some(given) => constants = Some(Numbers::new("torque_constants", given)?),
            None => {}
        }
        let rows = match (rows, seconds) {
            (Some(_), Some(_)) => return Err(invalid("rows and seconds: give one of them")),
            (Some((first, last)), None) if (1..=last).contains(&first) => {
                let index = |row: i128| usize::try_from(row).unwrap_or(usize::MAX);
                Some(Rows::Numbers(index(first)..=index(last)))
            }
            (Some((first, last)), None) => {
                return Err(invalid(format!(
                    "rows = ({first}, {last}): expected 1 <= first <= last"
                )));
            }
            (None, Some((start, end))) => Some(Rows::Seconds(range("seconds", start, end)?)),
            (None, None) => None,
        };
        Ok(ReadOptions::default()
            .with_joints(joints.map(|joints| texts("joints", joints)).transpose()?)
            .with_columns(columns.map_or(Ok(ColumnMap::default()), column_map)?)
            .with_units(units.map_or(Ok(Units::default()), unit_map)?)
            .with_torque_constants(constants.map(|numbers| numbers.values().to_vec()))
            .with_named_torque_constants(named)
            .with_accept(accept.map_or(Ok(Vec::new()), issue_kinds)?)
            .with_rows(rows)
            .with_sample_rate_hz(sample_rate_hz)
            .with_limit_bytes(limit_bytes.unwrap_or(ReadOptions::default().limit_bytes)))
    }
}

/// Reads a table in memory as `read_csv` reads one of text, by the same rules.
///
/// Parameters
/// ----------
/// source : str
///     What the table is called in messages.
/// names : list of str
///     Names of the columns.
/// values : list of array of shape (N,), or of list of str
///     Numbers are float64 or int64; timedelta64[ns] are seconds, datetime64[ns] dates; text is as
///     in the cells of a file.
/// joints, **options
///     As in `read_csv`; `limit_bytes` is that of the numbers.
#[pyfunction]
#[pyo3(signature = (source, names, values, joints=None, **options))]
pub fn read_columns(
    py: Python<'_>,
    source: &str,
    names: Vec<String>,
    values: Vec<Bound<'_, PyAny>>,
    joints: Option<&Bound<'_, PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Recording> {
    let options = table_options(joints, options)?;
    let held = values.iter().map(HeldColumn::new).collect::<PyResult<Vec<_>>>()?;
    let named = names.len() == held.len();
    let mut columns = Vec::with_capacity(held.len());
    for (name, held) in names.into_iter().zip(&held) {
        columns.push(csv::NamedColumn { name, values: held.values()? });
    }
    let rows = columns.first().map_or(0, |column| column.values.rows());
    if !named || columns.iter().any(|column| column.values.rows() != rows) {
        return Err(invalid("columns: expected a name for each, and values for each row"));
    }
    let recording = detached(py, || csv::read_columns(source, &columns, &options));
    recording.map(Recording::from).map_err(IntoPyErr::into_py_err)
}

/// A column borrowed from Python.
enum HeldColumn<'py> {
    Numbers(Numbers<'py>),
    /// numpy's letter for what the integers are: `i`, `m` (durations) or `M` (dates).
    Integers(char, PyReadonlyArrayDyn<'py, i64>),
    Texts(Vec<String>),
}

impl<'py> HeldColumn<'py> {
    fn new(values: &Any<'py>) -> PyResult<Self> {
        if values.is_instance_of::<PyList>() {
            return Ok(Self::Texts(values.extract()?));
        }
        match kind_of(values)? {
            kind @ ('i' | 'm' | 'M') => {
                let integers =
                    values.call_method1("view", ("int64",))?.cast_into::<PyArrayDyn<i64>>()?;
                Ok(Self::Integers(
                    kind,
                    integers.try_readonly().map_err(|_| invalid("a column is being written to"))?,
                ))
            }
            _ => Numbers::new("values", values).map(Self::Numbers),
        }
    }

    fn values(&self) -> PyResult<csv::Values<'_>> {
        Ok(match self {
            Self::Numbers(numbers) => csv::Values::Numbers(numbers.values().into()),
            Self::Integers(kind, integers) => {
                let integers = integers
                    .as_slice()
                    .map_err(|_| invalid("columns: expected contiguous arrays"))?
                    .into();
                match kind {
                    'm' => csv::Values::Seconds(integers),
                    'M' => csv::Values::Instants(integers),
                    _ => csv::Values::Integers(integers),
                }
            }
            Self::Texts(texts) => csv::Values::Texts(texts.clone()),
        })
    }
}

const QUANTITIES: [&str; 4] = ["time", "position", "velocity", "torque"];

fn column_map(given: &Bound<'_, PyAny>) -> PyResult<ColumnMap> {
    let mut map = ColumnMap::default();
    for (key, value) in items("columns", given)? {
        let columns = || match value.extract::<String>() {
            Ok(pattern) => Ok(Some(Columns::Pattern(pattern))),
            Err(_) => {
                texts(&format!("columns['{key}']"), &value).map(|names| Some(Columns::Names(names)))
            }
        };
        match key.as_str() {
            "time" => map.time = Some(value.extract()?),
            "position" => map.position = columns()?,
            "velocity" => map.velocity = columns()?,
            "torque" => map.torque = columns()?,
            _ => return Err(unknown("columns", &key, &QUANTITIES)),
        }
    }
    Ok(map)
}

fn unit_map(given: &Bound<'_, PyAny>) -> PyResult<Units> {
    let mut units = Units::default();
    for (key, value) in items("units", given)? {
        let value: String = value.extract()?;
        match key.as_str() {
            "time" => units.time = Some(value.parse().map_err(RecordingError::into_py_err)?),
            "position" => {
                units.position = Some(value.parse().map_err(RecordingError::into_py_err)?)
            }
            "velocity" => {
                units.velocity = Some(value.parse().map_err(RecordingError::into_py_err)?)
            }
            "torque" => units.torque = Some(value.parse().map_err(RecordingError::into_py_err)?),
            _ => return Err(unknown("units", &key, &QUANTITIES)),
        }
    }
    Ok(units)
}

fn range(name: &str, start: f64, end: f64) -> PyResult<RangeInclusive<f64>> {
    if start <= end {
        return Ok(start..=end);
    }
    Err(invalid(format!("{name} = ({start}, {end}): expected a start and a later end, s")))
}

/// Reads an MCAP file: a ROS 2 bag with `sensor_msgs/msg/JointState`, or JSON messages with
/// `position` or `q`.
///
/// Joints are found by name, wherever they stand in a message. Joints on several topics are merged
/// at the times of the topic with the most messages; other numbers become channels.
///
/// Parameters
/// ----------
/// path : str or os.PathLike
/// joints : list of str, optional
///     Joints wanted, in order, e.g. `robot.joint_names`; by default all, in order of appearance.
/// logged_names : list of str, optional
///     Names of the wanted joints in the log, if they differ; in the same order.
/// topics : list of str, optional
///     Topics with the joint states wanted; by default all with wanted joints.
/// clock : {"header", "log"}, default "header"
///     Time stamps of the message headers, or the times when messages were recorded.
/// recover : bool, default False
///     Take what is intact of a truncated or damaged file.
/// limit_bytes : int, default 4 GiB
///     Largest amount of unpacked data that is read.
///
/// Examples
/// --------
/// >>> rec = sgpr.read_mcap("train.mcap", joints=["joint_2", "joint_1"])
/// >>> rec.joint_names
/// ['joint_2', 'joint_1']
#[pyfunction]
#[pyo3(signature = (path, joints=None, *, logged_names=None, topics=None, clock="header", recover=false,
    limit_bytes=None))]
#[expect(clippy::too_many_arguments, reason = "the options of a format")]
pub fn read_mcap(
    py: Python<'_>,
    path: PathBuf,
    joints: Option<&Bound<'_, PyAny>>,
    logged_names: Option<&Bound<'_, PyAny>>,
    topics: Option<&Bound<'_, PyAny>>,
    clock: &str,
    recover: bool,
    limit_bytes: Option<u64>,
) -> PyResult<Recording> {
    let options =
        TopicOptions { joints, logged_names, topics, clock, recover, limit_bytes }.read()?;
    let recording = detached(py, || mcap::read(&path, &options));
    recording.map(Recording::from).map_err(IntoPyErr::into_py_err)
}

/// Names and endings of the formats that are read, and the options of their files.
#[pyfunction]
pub fn formats() -> Vec<(&'static str, Vec<&'static str>, Vec<&'static str>)> {
    let of = |format: &&Format| (format.name, format.endings.to_vec(), options_of(format));
    core::FORMATS.iter().map(of).collect()
}

/// The name of the format of a file, and its options.
#[pyfunction]
pub fn format_of(py: Python<'_>, path: PathBuf) -> PyResult<(&'static str, Vec<&'static str>)> {
    let format = detached(py, || Format::of(&path)).map_err(IntoPyErr::into_py_err)?;
    Ok((format.name, options_of(format)))
}

fn options_of(format: &Format) -> Vec<&'static str> {
    match format.read {
        Reader::Table(_) => TABLE_OPTIONS.to_vec(),
        Reader::Topics(_) => TOPIC_OPTIONS.to_vec(),
    }
}

/// Reads a log of any format.
///
/// Parameters
/// ----------
/// path : str or os.PathLike
/// joints, **options
///     As in `read_csv` for tables and arrays, as in `read_mcap` for files with topics.
#[pyfunction]
#[pyo3(signature = (path, joints=None, **options))]
pub fn read_log(
    py: Python<'_>,
    path: PathBuf,
    joints: Option<&Bound<'_, PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Recording> {
    let format = detached(py, || Format::of(&path)).map_err(IntoPyErr::into_py_err)?;
    let recording = match format.read {
        Reader::Table(read) => {
            let options = table_options(joints, options)?;
            detached(py, || read(&path, &options))
        }
        Reader::Topics(read) => {
            let options = topic_options(joints, options)?;
            detached(py, || read(&path, &options))
        }
    };
    recording.map(Recording::from).map_err(IntoPyErr::into_py_err)
}

/// The rows of a Parquet file in pieces of so many, one in memory at a time.
///
/// Parameters
/// ----------
/// path : str or os.PathLike
/// samples : int
/// joints, **options
///     As in `read_csv`.
#[pyfunction]
#[pyo3(signature = (path, samples, joints=None, **options))]
pub fn read_parquet_pieces(
    py: Python<'_>,
    path: PathBuf,
    samples: usize,
    joints: Option<&Bound<'_, PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Pieces> {
    let options = table_options(joints, options)?;
    let pieces = detached(py, || parquet::pieces(&path, samples, &options));
    let inner = Box::new(pieces.map_err(IntoPyErr::into_py_err)?);
    Ok(Pieces { inner: Mutex::new(inner) })
}

/// Recordings one after the other.
#[pyclass(module = "sgpr._sgpr", frozen)]
pub struct Pieces {
    inner: Mutex<Box<dyn Iterator<Item = Result<core::Recording, RecordingError>> + Send>>,
}

#[pymethods]
impl Pieces {
    fn __iter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Recording>> {
        let next =
            detached(py, || self.inner.lock().unwrap_or_else(PoisonError::into_inner).next());
        next.transpose().map(|piece| piece.map(Recording::from)).map_err(IntoPyErr::into_py_err)
    }
}

const TABLE_OPTIONS: [&str; 8] = [
    "columns",
    "units",
    "torque_constants",
    "accept",
    "rows",
    "seconds",
    "sample_rate_hz",
    "limit_bytes",
];

fn table_options(
    joints: Option<&Bound<'_, PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<ReadOptions> {
    let given = Keywords::new(options, &TABLE_OPTIONS)?;
    TableOptions {
        joints,
        columns: given.get("columns")?.as_ref(),
        units: given.get("units")?.as_ref(),
        torque_constants: given.get("torque_constants")?.as_ref(),
        accept: given.get("accept")?.as_ref(),
        rows: given.extract("rows")?,
        seconds: given.extract("seconds")?,
        sample_rate_hz: given.number("sample_rate_hz")?,
        limit_bytes: given.extract("limit_bytes")?,
    }
    .read()
}

const TOPIC_OPTIONS: [&str; 5] = ["logged_names", "topics", "clock", "recover", "limit_bytes"];

fn topic_options(
    joints: Option<&Bound<'_, PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<McapOptions> {
    let given = Keywords::new(options, &TOPIC_OPTIONS)?;
    TopicOptions {
        joints,
        logged_names: given.get("logged_names")?.as_ref(),
        topics: given.get("topics")?.as_ref(),
        clock: given.word("clock")?.as_deref().unwrap_or("header"),
        recover: given.extract("recover")?.unwrap_or(false),
        limit_bytes: given.extract("limit_bytes")?,
    }
    .read()
}

/// Options of topics as Python gives them.
struct TopicOptions<'a, 'py> {
    joints: Option<&'a Any<'py>>,
    logged_names: Option<&'a Any<'py>>,
    topics: Option<&'a Any<'py>>,
    clock: &'a str,
    recover: bool,
    limit_bytes: Option<u64>,
}

impl TopicOptions<'_, '_> {
    fn read(self) -> PyResult<McapOptions> {
        let Self { joints, logged_names, topics, clock, recover, limit_bytes } = self;
        let clocks = [("header", Clock::HeaderStamp), ("log", Clock::LogTime)];
        Ok(McapOptions::default()
            .with_joints(joints.map(|names| texts("joints", names)).transpose()?)
            .with_logged_names(logged_names.map(|names| texts("logged_names", names)).transpose()?)
            .with_topics(topics.map(|names| texts("topics", names)).transpose()?)
            .with_clock(choice("clock", clock, &clocks)?)
            .with_recover(recover)
            .with_limit_bytes(limit_bytes.unwrap_or(McapOptions::default().limit_bytes)))
    }
}

/// Writes recordings as an MCAP file, one topic with `sensor_msgs/msg/JointState` for each;
/// Foxglove, PlotJuggler and ROS 2 read it. Channels are not written.
///
/// Examples
/// --------
/// >>> rec = sgpr.Recording([0.0, 0.1], [[1.0], [2.0]])
/// >>> sgpr.write_mcap("out.mcap", {"/measured": rec, "/predicted": rec})
/// >>> len(sgpr.read_mcap("out.mcap", topics=["/predicted"]))
/// 2
#[pyfunction]
pub fn write_mcap(py: Python<'_>, path: PathBuf, topics: &Bound<'_, PyAny>) -> PyResult<()> {
    let mut given: Vec<(String, Py<Recording>)> = Vec::new();
    for (topic, recording) in items("topics", topics)? {
        given.push((topic, recording.cast_into::<Recording>()?.unbind()));
    }
    let topics: Vec<(&str, &core::Recording)> =
        given.iter().map(|(topic, recording)| (topic.as_str(), &recording.get().inner)).collect();
    let path: &Path = &path;
    detached(py, || mcap::write(path, &topics)).map_err(IntoPyErr::into_py_err)
}

/// Which quantity an array holds by its name: "time", "position", "velocity", "torque", "current",
/// or None.
#[pyfunction]
pub fn quantity_of_array(name: &str) -> Option<&'static str> {
    csv::quantity_of_array(name)
}
