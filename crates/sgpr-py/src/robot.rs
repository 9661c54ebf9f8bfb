//! Robots: from files and tables.

use std::collections::HashMap;
use std::path::PathBuf;

use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sgpr_core::identification::{
    self as estimation, BaseParameters as CoreBase, ParameterClass, ParameterSet,
};
use sgpr_core::robot::{self as core, DhConvention, DhRow, JointKind, Limits, UrdfOptions};
use sgpr_core::spatial::{PARAMETERS_PER_LINK, Vector3};

use crate::convert::{Numbers, array, choice, items, texts, unknown, vector3};
use crate::detached::detached;
use crate::errors::{IntoPyErr, invalid};

/// Robot, names of effects, and whether by the recursion: what base parameters are made of.
type Origin = (Robot, Vec<String>, bool);

/// A robot arm on a fixed base: joints, links, limits. Never changes; share it freely.
///
/// Made by `from_urdf`, `from_urdf_text`, `from_dh`, or ready-made in `sgpr.robots`. Samples are
/// rows, joints are columns, in the order of `joint_names`; units are rad, m, s, kg, N·m (m and N
/// for prismatic joints). Every dynamics method takes one sample, `(n,)`, or many, `(N, n)`, and
/// covers the rigid body only: friction and rotor inertia belong to a `Model`.
///
/// Examples
/// --------
/// >>> robot = sgpr.robots.two_link()
/// >>> robot.dof
/// 2
/// >>> robot.inverse_dynamics([0.0, 0.0], [0.0, 0.0], [0.0, 0.0])  # stretched out level
/// array([19.62 ,  4.905])
#[pyclass(module = "sgpr", frozen)]
#[derive(Clone)]
pub struct Robot {
    /// Of the core.
    pub inner: core::Robot,
}

impl From<core::Robot> for Robot {
    fn from(inner: core::Robot) -> Self {
        Self { inner }
    }
}

#[pymethods]
impl Robot {
    /// Reads a URDF file.
    ///
    /// Links behind fixed or locked joints are merged into the link that carries them; what is
    /// rigidly attached to the base does not count. Every URDF link becomes a frame.
    ///
    /// Parameters
    /// ----------
    /// path : str or os.PathLike
    ///     The file; expand xacro files first.
    /// joints : list of str, optional
    ///     Joints that move, base to tip; by default all movable ones that mimic no other
    ///     (`warnings` names those that do). The others are locked.
    /// locked : dict of str to float, optional
    ///     Position of locked joints, rad (m); zero for those not named.
    /// gravity : array of shape (3,), default (0, 0, -9.81)
    ///     In base axes, m/s².
    ///
    /// Raises
    /// ------
    /// RobotError
    ///     If the file makes no robot; the message says why.
    /// OSError
    ///     If the file cannot be read.
    ///
    /// Examples
    /// --------
    /// >>> robot = sgpr.Robot.from_urdf("robot.urdf")
    /// >>> robot.dof
    /// 6
    #[staticmethod]
    #[pyo3(signature = (path, joints=None, *, locked=None, gravity=None),
        text_signature = "(path, joints=None, *, locked=None, gravity=(0.0, 0.0, -9.81))")]
    fn from_urdf(
        py: Python<'_>,
        path: PathBuf,
        joints: Option<&Bound<'_, PyAny>>,
        locked: Option<&Bound<'_, PyAny>>,
        gravity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let options = urdf_options(joints, locked, gravity)?;
        let robot = detached(py, || core::Robot::from_urdf(path, &options));
        robot.map(Self::from).map_err(IntoPyErr::into_py_err)
    }

    /// As `from_urdf`, from text; `origin` names it in messages.
    ///
    /// Examples
    /// --------
    /// >>> text = '''<robot name="pendulum"><link name="base"/><link name="rod"><inertial>
    /// ...   <origin xyz="0 0 -0.5"/><mass value="2"/>
    /// ...   <inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
    /// ...   <joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
    /// ...   </joint></robot>'''
    /// >>> sgpr.Robot.from_urdf_text(text).joint_names
    /// ['hinge']
    #[staticmethod]
    #[pyo3(signature = (text, joints=None, *, origin="urdf", locked=None, gravity=None),
        text_signature = "(text, joints=None, *, origin='urdf', locked=None, gravity=(0.0, 0.0, \
             -9.81))")]
    fn from_urdf_text(
        text: &str,
        joints: Option<&Bound<'_, PyAny>>,
        origin: &str,
        locked: Option<&Bound<'_, PyAny>>,
        gravity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let options = urdf_options(joints, locked, gravity)?;
        core::Robot::from_urdf_text(text, origin, &options)
            .map(Self::from)
            .map_err(IntoPyErr::into_py_err)
    }

    /// A serial robot from its Denavit-Hartenberg table.
    ///
    /// Parameters
    /// ----------
    /// rows : list of dict
    ///     One per joint, base to tip. Keys, all optional: `a`, `alpha`, `d`, `theta` (m, rad;
    ///     those of position zero), `prismatic` (bool), `mass` (kg), `centre_of_mass` (3,) m,
    ///     `inertia` (3, 3) kg·m² about the centre of mass, both in the DH frame of the row; limits
    ///     `lower`, `upper`, `velocity`, `effort`.
    /// convention : {"standard", "modified"}
    ///     They look alike and mean different robots; there is no default.
    /// name : str, default "robot"
    /// joint_names : list of str, optional
    ///     `joint_1`, `joint_2`, ... by default.
    /// gravity : array of shape (3,), default (0, 0, -9.81)
    ///     In base axes, m/s².
    ///
    /// Notes
    /// -----
    /// The link frames of this library are joint frames: for "modified" the DH frame of the
    /// row, for "standard" the frame before its translation along z. A frame `tool` marks the last
    /// DH frame.
    ///
    /// Examples
    /// --------
    /// >>> row = {"a": 1.0, "mass": 1.0, "centre_of_mass": [-0.5, 0, 0]}
    /// >>> robot = sgpr.Robot.from_dh([row, row], convention="standard", gravity=(0, -9.81, 0))
    /// >>> bool(np.allclose(robot.standard_parameters, sgpr.robots.two_link().standard_parameters))
    /// True
    #[staticmethod]
    #[pyo3(signature = (rows, *, convention, name="robot", joint_names=None, gravity=None),
        text_signature = "(rows, *, convention, name='robot', joint_names=None, gravity=(0.0, 0.0, \
             -9.81))")]
    fn from_dh(
        rows: Vec<Bound<'_, PyAny>>,
        convention: &str,
        name: &str,
        joint_names: Option<&Bound<'_, PyAny>>,
        gravity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let known = [("standard", DhConvention::Standard), ("modified", DhConvention::Modified)];
        let convention = choice("convention", convention, &known)?;
        let rows: Vec<DhRow> = rows
            .iter()
            .enumerate()
            .map(|(index, row)| dh_row(index, row))
            .collect::<PyResult<_>>()?;
        let names = joint_names.map(|names| texts("joint_names", names)).transpose()?;
        let robot = core::Robot::from_dh(
            name,
            convention,
            &rows,
            names.as_deref(),
            gravity_or_standard(gravity)?,
        );
        robot.map(Self::from).map_err(IntoPyErr::into_py_err)
    }

    /// Name of the robot.
    #[getter]
    fn name(&self) -> &str {
        self.inner.name()
    }

    /// Number of joints n.
    #[getter]
    pub fn dof(&self) -> usize {
        self.inner.dof()
    }

    /// Names of the joints, base to tip; this order is the order of every array.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.inner.joint_names().map(String::from).collect()
    }

    /// How each joint moves: "revolute", "continuous" or "prismatic".
    #[getter]
    fn joint_kinds(&self) -> Vec<&'static str> {
        self.inner.joints().iter().map(|joint| kind_name(joint.kind)).collect()
    }

    /// Unit of each joint position: "rad" or "m".
    #[getter]
    fn position_units(&self) -> Vec<&'static str> {
        self.inner.joints().iter().map(|joint| joint.kind.position_unit()).collect()
    }

    /// Unit of each joint torque: "N·m" or "N".
    #[getter]
    fn torque_units(&self) -> Vec<&'static str> {
        self.inner.joints().iter().map(|joint| joint.kind.torque_unit()).collect()
    }

    /// Limits of the joints: "lower", "upper", "velocity", "effort", each `(n,)`; infinite where
    /// there is none.
    #[getter]
    fn limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        let set = |key: &str, select: fn(&Limits) -> f64| {
            let values: Vec<f64> =
                self.inner.joints().iter().map(|joint| select(&joint.limits)).collect();
            dict.set_item(key, array(py, &[self.dof()], values)?)
        };
        set("lower", |limits| limits.position.map_or(f64::NEG_INFINITY, |[lower, _]| lower))?;
        set("upper", |limits| limits.position.map_or(f64::INFINITY, |[_, upper]| upper))?;
        set("velocity", |limits| limits.velocity.unwrap_or(f64::INFINITY))?;
        set("effort", |limits| limits.effort.unwrap_or(f64::INFINITY))?;
        Ok(dict)
    }

    /// Names of the frames that `forward_kinematics` and `jacobian` know.
    #[getter]
    fn frames(&self) -> Vec<String> {
        self.inner.frames().iter().map(|frame| frame.name.clone()).collect()
    }

    /// Gravitational acceleration in base axes, (3,), m/s².
    #[getter]
    fn gravity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, &[3], self.inner.gravity().to_array().to_vec())
    }

    /// The ten parameters of every link, (10 n,): m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about
    /// the origin of the link frame, links in joint order.
    #[getter]
    fn standard_parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let values = self.inner.standard_parameters();
        array(py, &[values.len()], values)
    }

    /// Names of the standard parameters: "joint_2.Ixx".
    #[getter]
    fn standard_parameter_names(&self) -> Vec<String> {
        self.inner.standard_parameter_names()
    }

    /// What a careful reader would want to know: joints that mimic others and stand here, links
    /// without mass at the tip, inertias that no body can have.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.inner.warnings()
    }

    /// The same robot under another gravity, (3,), m/s² in base axes.
    ///
    /// Examples
    /// --------
    /// >>> flat = sgpr.robots.two_link().with_gravity([0, 0, -9.81])  # along the joint axes: it does no work
    /// >>> flat.base_parameters().rank
    /// 4
    fn with_gravity(&self, gravity: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(self.inner.clone().with_gravity(gravity_of(gravity)?).into())
    }

    /// The same kinematics with other inertias, (10 n,). Any values are allowed, also those that no
    /// single body has.
    ///
    /// Examples
    /// --------
    /// >>> robot = sgpr.robots.two_link()
    /// >>> robot.with_standard_parameters(2 * robot.standard_parameters).gravity_torque([0.0, 0.0])
    /// array([39.24,  9.81])
    fn with_standard_parameters(&self, parameters: &Bound<'_, PyAny>) -> PyResult<Self> {
        let numbers = Numbers::new("parameters", parameters)?;
        let numbers = numbers.shaped(&[PARAMETERS_PER_LINK * self.dof()])?.finite()?;
        let changed = self.inner.clone().try_with_standard_parameters(numbers.values());
        changed.map(Self::from).map_err(IntoPyErr::into_py_err)
    }

    /// The combinations of parameters that motion can reveal, together with those of `effects`.
    ///
    /// By `recursion` they follow from the geometry joint by joint, without a random motion; the
    /// result is the same for robot files that are exact to 1e-6.
    ///
    /// Examples
    /// --------
    /// >>> base = sgpr.robots.puma560().base_parameters()
    /// >>> base.rank, base.matrix.shape
    /// (36, (36, 60))
    /// >>> base.classes["joint_1.m"]
    /// 'invisible'
    #[pyo3(signature = (effects=None, *, recursion=false), text_signature = "($self, effects=(), \
         *, recursion=False)")]
    fn base_parameters(
        &self,
        py: Python<'_>,
        effects: Option<&Bound<'_, PyAny>>,
        recursion: bool,
    ) -> PyResult<BaseParameters> {
        let effects = effects.map(|names| texts("effects", names)).transpose()?.unwrap_or_default();
        let set = ParameterSet::new(&self.inner, &effects).map_err(IntoPyErr::into_py_err)?;
        let find = if recursion { CoreBase::by_recursion } else { CoreBase::new };
        let inner = detached(py, || find(&self.inner, &set));
        let origin = (self.clone(), effects, recursion);
        Ok(BaseParameters { inner, parameter_names: set.names().to_vec(), origin })
    }

    /// A Plotly figure of the joints in space, at positions `q`, (n,), zero by default.
    ///
    /// Examples
    /// --------
    /// >>> len(sgpr.robots.two_link().plot([0.0, 1.0]).data)
    /// 1
    #[pyo3(signature = (q=None))]
    fn plot<'py>(
        slf: &Bound<'py, Self>,
        q: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("plot_robot", (slf, q))
    }

    fn _repr_html_<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("sgpr._views")?.call_method1("robot_html", (slf,))
    }

    fn __repr__(&self) -> String {
        let mut text = format!("Robot '{}', {} joints", self.inner.name(), self.dof());
        let width = self.inner.joint_names().map(|name| name.chars().count()).max().unwrap_or(0);
        for joint in self.inner.joints() {
            let unit = joint.kind.position_unit();
            let range = joint
                .limits
                .position
                .map_or(String::new(), |[a, b]| format!("  {a:.4} to {b:.4} {unit}"));
            text += &format!("\n  {:width$}  {:10}{range}", joint.name, kind_name(joint.kind));
        }
        text
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.inner == other.inner
    }

    fn __hash__(&self) -> u64 {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        self.inner.name().hash(&mut hasher);
        self.joint_names().hash(&mut hasher);
        hasher.finish()
    }

    /// 32 letters that robots share whose joints, links, limits and gravity are the same, and only
    /// those; the name does not count.
    #[getter]
    fn fingerprint(&self) -> String {
        self.inner.fingerprint()
    }

    /// Inertias travel beside the description: those that were identified may be such as no robot
    /// file has.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Pickled<'py>> {
        let robot = &slf.get().inner;
        let parameters = robot.standard_parameters();
        let kinematics = robot.clone().with_standard_parameters(&vec![0.0; parameters.len()]);
        let text =
            serde_json::to_string(&kinematics).map_err(|error| invalid(error.to_string()))?;
        Ok((slf.get_type().getattr("_from_description")?, (text, parameters)))
    }

    #[staticmethod]
    fn _from_description(description: &str, parameters: Vec<f64>) -> PyResult<Self> {
        let robot: core::Robot =
            serde_json::from_str(description).map_err(|error| invalid(error.to_string()))?;
        if parameters.len() != PARAMETERS_PER_LINK * robot.dof() {
            return Err(invalid("a description and parameters of different robots"));
        }
        Ok(robot.with_standard_parameters(&parameters).into())
    }
}

/// What builds a robot again, and from what: its kinematics as JSON, its inertias as numbers.
type Pickled<'py> = (Bound<'py, PyAny>, (String, Vec<f64>));

fn kind_name(kind: JointKind) -> &'static str {
    match kind {
        JointKind::Revolute => "revolute",
        JointKind::Continuous => "continuous",
        JointKind::Prismatic => "prismatic",
    }
}

fn gravity_or_standard(gravity: Option<&Bound<'_, PyAny>>) -> PyResult<Vector3<f64>> {
    gravity.map_or(Ok(core::STANDARD_GRAVITY), gravity_of)
}

/// No more than a robot file may say.
fn gravity_of(given: &Bound<'_, PyAny>) -> PyResult<Vector3<f64>> {
    let gravity = vector3("gravity", given)?;
    match gravity.iter().find(|component| component.abs() > core::LARGEST_VALUE) {
        Some(component) => Err(invalid(format!(
            "gravity has a component of {component:e}: give m/s², in base axes, such as (0, 0, \
             -9.81)"
        ))),
        None => Ok(gravity.into()),
    }
}

/// What to make of a URDF.
pub fn urdf_options(
    joints: Option<&Bound<'_, PyAny>>,
    locked: Option<&Bound<'_, PyAny>>,
    gravity: Option<&Bound<'_, PyAny>>,
) -> PyResult<UrdfOptions> {
    let mut positions = HashMap::new();
    for (joint, position) in
        locked.map(|locked| items("locked", locked)).transpose()?.unwrap_or_default()
    {
        let position: f64 = position.extract()?;
        if !position.is_finite() {
            return Err(invalid(format!(
                "locked['{joint}'] is {position}: expected a finite number"
            )));
        }
        positions.insert(joint, position);
    }
    Ok(UrdfOptions::default()
        .with_joints(joints.map(|joints| texts("joints", joints)).transpose()?)
        .with_locked(positions)
        .with_gravity(gravity_or_standard(gravity)?))
}

fn dh_row(index: usize, given: &Bound<'_, PyAny>) -> PyResult<DhRow> {
    let name = format!("rows[{index}]");
    let mut row = DhRow::revolute(0.0, 0.0, 0.0, 0.0);
    let (mut lower, mut upper) = (None, None);
    for (key, value) in items(&name, given)? {
        let label = format!("{name}['{key}']");
        match key.as_str() {
            "a" => row.a = number(&label, &value)?,
            "alpha" => row.alpha = number(&label, &value)?,
            "d" => row.d = number(&label, &value)?,
            "theta" => row.theta = number(&label, &value)?,
            "prismatic" => row.prismatic = value.extract()?,
            "mass" => row.mass = number(&label, &value)?,
            "centre_of_mass" => row.centre_of_mass = vector3(&label, &value)?,
            "inertia" => {
                let numbers = Numbers::new(&label, &value)?.shaped(&[3, 3])?.finite()?;
                row.inertia.as_flattened_mut().copy_from_slice(numbers.values());
            }
            "lower" => lower = Some(limit(&label, &value)?),
            "upper" => upper = Some(limit(&label, &value)?),
            "velocity" => row.limits.velocity = Some(limit(&label, &value)?),
            "effort" => row.limits.effort = Some(limit(&label, &value)?),
            _ => {
                let known = "a alpha d theta prismatic mass centre_of_mass inertia lower upper \
                     velocity effort";
                return Err(unknown(&name, &key, &known.split(' ').collect::<Vec<_>>()));
            }
        }
    }
    row.limits.position = match (lower, upper) {
        (None, None) => None,
        (Some(lower), Some(upper)) if lower <= upper => Some([lower, upper]),
        (Some(_), Some(_)) => return Err(invalid(format!("{name}: `lower` is above `upper`"))),
        _ => return Err(invalid(format!("{name}: give `lower` and `upper`, or neither"))),
    };
    Ok(row)
}

fn number(label: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    let number = limit(label, value)?;
    if number.is_finite() {
        Ok(number)
    } else {
        Err(invalid(format!("{label} is {number}: expected a finite number")))
    }
}

/// A number; infinite is no limit.
fn limit(label: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    let number: f64 =
        value.extract().map_err(|_| invalid(format!("{label}: expected a number")))?;
    if number.is_nan() {
        Err(invalid(format!("{label} is NaN: expected a number")))
    } else {
        Ok(number)
    }
}

/// The identifiable combinations of a robot's parameters, friction and other effects included.
///
/// A property of the robot, never of data. One parameter stands for each combination.
///
/// Examples
/// --------
/// >>> base = sgpr.robots.two_link().base_parameters()
/// >>> base.names
/// ['joint_1.mx', 'joint_1.my', 'joint_1.Izz', 'joint_2.mx', 'joint_2.my', 'joint_2.Izz']
/// >>> base.expressions[0]
/// 'joint_1.mx + joint_2.m'
#[pyclass(module = "sgpr", frozen)]
pub struct BaseParameters {
    inner: CoreBase,
    parameter_names: Vec<String>,
    /// Robot, effects and whether by recursion: what makes them again.
    origin: Origin,
}

#[pymethods]
impl BaseParameters {
    /// Number of base parameters.
    #[getter]
    fn rank(&self) -> usize {
        self.inner.rank()
    }

    /// The parameter that stands for each combination.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.inner.names().to_vec()
    }

    /// Units of the base parameters.
    #[getter]
    fn units(&self) -> Vec<&'static str> {
        self.inner.units().to_vec()
    }

    /// Each base parameter as the combination it is.
    #[getter]
    fn expressions(&self) -> Vec<String> {
        self.inner.expressions()
    }

    /// The same as formulas in the letters of the literature, links and joints numbered from one:
    /// "ZZ1R = ZZ1 + M2".
    #[getter]
    fn formulas(&self) -> Vec<String> {
        self.inner.formulas()
    }

    /// Matrix B, (rank, parameters), with base parameters = B @ parameters.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, &[self.inner.rank(), self.parameter_names.len()], self.inner.matrix())
    }

    /// Names of all parameters, the columns of `matrix`.
    #[getter]
    fn parameter_names(&self) -> Vec<String> {
        self.parameter_names.clone()
    }

    /// What motion reveals of each parameter: "identifiable", only in "combination" with others, or
    /// "invisible".
    #[getter]
    fn classes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, class) in self.parameter_names.iter().zip(self.inner.classes()) {
            let class = match class {
                ParameterClass::Alone => "identifiable",
                ParameterClass::Combined => "combination",
                ParameterClass::Invisible => "invisible",
            };
            dict.set_item(name, class)?;
        }
        Ok(dict)
    }

    fn __len__(&self) -> usize {
        self.inner.rank()
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Origin)> {
        Ok((slf.get_type().getattr("_from_robot")?, slf.get().origin.clone()))
    }

    #[staticmethod]
    fn _from_robot(
        robot: &Bound<'_, Robot>,
        effects: Vec<String>,
        recursion: bool,
    ) -> PyResult<Self> {
        let effects = effects.into_pyobject(robot.py())?;
        robot.get().base_parameters(robot.py(), Some(effects.as_any()), recursion)
    }

    fn __repr__(&self) -> String {
        let mut text = format!(
            "BaseParameters, {} of {} parameters",
            self.inner.rank(),
            self.parameter_names.len()
        );
        for (expression, unit) in self.inner.expressions().iter().zip(self.inner.units()) {
            text += &format!("\n  {expression}  [{unit}]");
        }
        text
    }
}

/// The Unimation PUMA 560, six revolute joints, base upright; rigid body only.
///
/// Parameters of Corke and Armstrong-Hélouvry (1994), limits of Krishnamoorthi (2018), table 5-5.
///
/// Examples
/// --------
/// >>> sgpr.robots.puma560().dof
/// 6
#[pyfunction]
pub fn puma560() -> Robot {
    core::puma560().into()
}

/// Two links of 1 m and 1 kg with the mass in the middle, moving in a vertical plane; rigid body
/// only.
///
/// Krishnamoorthi (2018), tables 5-2 and 5-4.
///
/// Examples
/// --------
/// >>> sgpr.robots.two_link().gravity
/// array([ 0.  , -9.81,  0.  ])
#[pyfunction]
pub fn two_link() -> Robot {
    core::two_link().into()
}

/// The regrouping rules of Gautier and Khalil for a modified Denavit-Hartenberg table, as formulas.
///
/// Three parameters of a link behind a rotating joint, and six behind a sliding one, act as if they
/// belonged to the link before it. `Robot.base_parameters` has the complete result for a robot,
/// numbers in the place of symbols.
///
/// Parameters
/// ----------
/// rows : list of dict
///     As in `Robot.from_dh`. The formulas call `a` d and `d` r, as the literature does.
///
/// Returns
/// -------
/// list of list of str
///     For each joint: "SOURCE(j): TARGET(j-1) + FACTOR, ...".
///
/// Examples
/// --------
/// >>> sgpr.regroupings([{"a": 0.4, "d": 0.1}])[0][1]
/// 'mz(j): Ixx(j-1) + 2 r, Ixy(j-1) + d sin(alpha), Ixz(j-1) - d cos(alpha), Iyy(j-1) + 2 r cos(alpha)^2, Iyz(j-1) + 2 r sin(alpha) cos(alpha), Izz(j-1) + 2 r sin(alpha)^2, my(j-1) - sin(alpha), mz(j-1) + cos(alpha)'
#[pyfunction]
pub fn regroupings(rows: &Bound<'_, PyAny>) -> PyResult<Vec<Vec<String>>> {
    let rows = rows.try_iter()?.enumerate().map(|(index, row)| dh_row(index, &row?));
    let rows: Vec<DhRow> = rows.collect::<PyResult<_>>()?;
    Ok(rows
        .iter()
        .map(|row| estimation::regroupings(row).iter().map(ToString::to_string).collect())
        .collect())
}
