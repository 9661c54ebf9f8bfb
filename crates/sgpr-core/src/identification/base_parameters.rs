//! Which combinations of parameters motion can reveal.

use super::ParameterSet;
use crate::dynamics::{Workspace, regressor};
use crate::effects::JointState;
use crate::linalg::{ColumnSelection, select_columns};
use crate::robot::{Joint, Robot};
use crate::spatial::{PARAMETERS_PER_LINK, Vector3};
use sgpr_numeric::internal::Random;

/// What can be said of a single parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterClass {
    /// No motion depends on it.
    Invisible,
    /// Motion reveals it.
    Alone,
    /// Motion reveals it only together with others.
    Combined,
}

/// The identifiable combinations of a robot's parameters, friction and other effects included.
///
/// A structural property: it depends on the robot and the effects, never on data. One parameter
/// stands for each combination; which one is a matter of the order in which they are offered, here
/// inertias and first moments from base to tip as in Khalil's rules, then effects, then masses and
/// what else can be regrouped towards the base.
///
/// Source: M. Gautier, Numerical calculation of the base inertial parameters of robots, J. Robotic
/// Systems 8(4) (1991).
#[derive(Clone, Debug, PartialEq)]
pub struct BaseParameters {
    independent: Vec<usize>,
    /// Per base parameter: the other parameters in it, with their factors.
    combinations: Vec<Vec<(usize, f64)>>,
    classes: Vec<ParameterClass>,
    names: Vec<String>,
    units: Vec<&'static str>,
    parameters: Vec<String>,
}

/// Columns with less of their norm left are dependent. In eight reference robots dependent columns
/// leave 5e-16 and independent ones 0.25 and more; a robot file that writes a right angle as 1.57
/// leaves 8e-4 of what it makes dependent.
const TOLERANCE: f64 = 2e-3;

/// The same for rows that are exact.
const EXACT: f64 = 1e-7;

/// Smaller factors (SI) are computed with but not shown: a robot file that writes 1.57079633 for a
/// right angle mixes every parameter with a few billionths of others.
pub(super) const NEGLIGIBLE: f64 = 1e-6;

impl BaseParameters {
    /// The base parameters of a robot with effects.
    pub fn new(robot: &Robot, set: &ParameterSet) -> Self {
        let columns = random_columns(robot, set);
        let selection = select_columns(&columns, &preference(robot, set), TOLERANCE);
        Self::from_selection(selection, set)
    }

    /// The same, where effects stand for a combination before inertias do: a rotor's inertia takes
    /// what the link's, as the robot file has it, leaves.
    pub(crate) fn with_effects_first(robot: &Robot, set: &ParameterSet) -> Self {
        let (effects, inertias): (Vec<usize>, Vec<usize>) =
            preference(robot, set).into_iter().partition(|parameter| *parameter >= set.inertial());
        let order = [effects, inertias].concat();
        Self::from_selection(select_columns(&random_columns(robot, set), &order, TOLERANCE), set)
    }

    /// The same for a robot of another geometry: the base parameters of this robot, and what that
    /// one shows beside them. They span the columns of both.
    pub(crate) fn extended_for(&self, other: &Robot, set: &ParameterSet) -> Self {
        let rest = preference(other, set)
            .into_iter()
            .filter(|parameter| !self.independent.contains(parameter));
        let order: Vec<usize> = self.independent.iter().copied().chain(rest).collect();
        Self::from_selection(select_columns(&random_columns(other, set), &order, TOLERANCE), set)
    }

    /// The same with columns that a set has after those of this one, each a base parameter of its
    /// own.
    pub(crate) fn with_later_columns(mut self, set: &ParameterSet) -> Self {
        let later = self.parameters.len()..set.len();
        self.combinations.resize(self.rank() + later.len(), Vec::new());
        self.classes.resize(set.len(), ParameterClass::Alone);
        self.names.extend_from_slice(&set.names()[later.clone()]);
        self.units.extend_from_slice(&set.units()[later.clone()]);
        self.parameters = set.names().to_vec();
        self.independent.extend(later);
        self
    }

    /// The same from the robot's geometry, without a random motion: the subspace by the recursive
    /// parameter null space (Wensing, Niemeyer, Slotine (2024)), the choice of parameters as in
    /// [`Self::new`]. The two agree for robots whose file is exact to 1e-6; where a right angle is
    /// written 1.57 this one sees the difference.
    ///
    /// Effects other than rotor inertia and torque offset are taken to be independent of the rigid
    /// body, as those of the library are.
    pub fn by_recursion(robot: &Robot, set: &ParameterSet) -> Self {
        let rows = super::null_space::identifiable_rows(robot, set);
        let columns: Vec<Vec<f64>> =
            (0..set.len()).map(|k| rows.iter().map(|row| row[k]).collect()).collect();
        Self::from_selection(select_columns(&columns, &preference(robot, set), EXACT), set)
    }

    fn from_selection(selection: ColumnSelection, set: &ParameterSet) -> Self {
        let ColumnSelection { mut independent, dependent, .. } = selection;
        let offered = independent.clone();
        independent.sort_unstable();
        let mut combinations: Vec<Vec<(usize, f64)>> = vec![Vec::new(); independent.len()];
        let mut classes = vec![ParameterClass::Alone; set.len()];
        for (parameter, coefficients) in dependent {
            classes[parameter] = if coefficients.is_empty() {
                ParameterClass::Invisible
            } else {
                ParameterClass::Combined
            };
            for (position, coefficient) in coefficients.into_iter().enumerate() {
                let factor = tidy(coefficient);
                if factor != 0.0 {
                    let kept = offered[position];
                    let base = independent.binary_search(&kept).expect("the same indices, sorted");
                    combinations[base].push((parameter, factor));
                    if factor.abs() > NEGLIGIBLE {
                        classes[kept] = ParameterClass::Combined;
                    }
                }
            }
        }
        combinations
            .iter_mut()
            .for_each(|terms| terms.sort_unstable_by_key(|(parameter, _)| *parameter));
        Self {
            names: independent.iter().map(|&k| set.names()[k].clone()).collect(),
            units: independent.iter().map(|&k| set.units()[k]).collect(),
            parameters: set.names().to_vec(),
            independent,
            combinations,
            classes,
        }
    }

    /// Number of base parameters.
    pub fn rank(&self) -> usize {
        self.independent.len()
    }

    /// Index in the parameter set of the parameter that stands for each base parameter, ascending.
    pub fn independent(&self) -> &[usize] {
        &self.independent
    }

    /// Name of the parameter that stands for each base parameter.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Names of all parameters of the set.
    pub(super) fn parameter_names(&self) -> &[String] {
        &self.parameters
    }

    /// Units of the base parameters.
    pub fn units(&self) -> &[&'static str] {
        &self.units
    }

    /// The other parameters in base parameter `base`, as (index in the set, factor).
    pub fn combination(&self, base: usize) -> &[(usize, f64)] {
        &self.combinations[base]
    }

    /// What can be said of each parameter of the set.
    pub fn classes(&self) -> &[ParameterClass] {
        &self.classes
    }

    /// Base parameter `base` as the combination it is:
    /// `joint_2.Ixx - joint_2.Iyy + 0.1865 joint_3.m`; factors below 1e-6 are left out.
    pub fn expression(&self, base: usize) -> String {
        let mut text = self.names[base].clone();
        for &(parameter, factor) in
            self.combinations[base].iter().filter(|(_, factor)| factor.abs() > NEGLIGIBLE)
        {
            let sign = if factor < 0.0 { '-' } else { '+' };
            let size = factor.abs();
            text += &format!(" {sign} ");
            if (size - 1.0).abs() > 1e-6 {
                text += &format!("{} ", significant(size));
            }
            text += &self.parameters[parameter];
        }
        text
    }

    /// All expressions.
    pub fn expressions(&self) -> Vec<String> {
        (0..self.rank()).map(|base| self.expression(base)).collect()
    }

    /// Matrix B with base = B * parameters, `[rank, parameters]`, row-major.
    pub fn matrix(&self) -> Vec<f64> {
        let width = self.parameters.len();
        let mut matrix = vec![0.0; self.rank() * width];
        for (base, row) in matrix.chunks_exact_mut(width).enumerate() {
            row[self.independent[base]] = 1.0;
            for &(parameter, factor) in &self.combinations[base] {
                row[parameter] = factor;
            }
        }
        matrix
    }

    /// Base parameters of a full set of parameters.
    ///
    /// # Panics
    /// If `parameters` is not of the length of the set.
    pub fn combine(&self, parameters: &[f64]) -> Vec<f64> {
        assert_eq!(parameters.len(), self.parameters.len(), "every parameter of the set");
        let terms = self.independent.iter().zip(&self.combinations);
        terms
            .map(|(&kept, terms)| {
                parameters[kept]
                    + terms.iter().map(|(index, factor)| factor * parameters[*index]).sum::<f64>()
            })
            .collect()
    }

    /// A full set of parameters with these base parameters: parameters that do not stand for a
    /// combination keep the value they have in `nominal`, the others take what is left. The torque
    /// is that of the base parameters.
    ///
    /// # Panics
    /// If the lengths do not fit.
    pub fn expand(&self, base: &[f64], nominal: &[f64]) -> Vec<f64> {
        assert_eq!(base.len(), self.rank(), "every base parameter");
        let change = base.iter().zip(self.combine(nominal)).map(|(new, old)| new - old);
        let mut parameters = nominal.to_vec();
        for (&kept, change) in self.independent.iter().zip(change) {
            parameters[kept] += change;
        }
        parameters
    }
}

/// Factors within rounding of a whole number or of zero are that number.
fn tidy(factor: f64) -> f64 {
    let near = factor.round();
    if (factor - near).abs() < 1e-10 { near } else { factor }
}

pub(super) fn significant(value: f64) -> String {
    let digits = (5 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    let text = format!("{value:.digits$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// Parameters in the order in which they are offered to stand for a combination.
fn preference(robot: &Robot, set: &ParameterSet) -> Vec<usize> {
    let mut first = Vec::new();
    let mut last = Vec::new();
    for (link, joint) in robot.joints().iter().enumerate() {
        for parameter in 0..PARAMETERS_PER_LINK {
            let list = if is_preferred(joint, parameter) { &mut first } else { &mut last };
            list.push(link * PARAMETERS_PER_LINK + parameter);
        }
    }
    first.extend(set.inertial()..set.len());
    first.extend(last);
    first
}

/// Whether a parameter stays with its link where there is a choice (Khalil and Dombre (2002),
/// section 9.4.2): at a joint that turns about z not m, mz and Iyy; at one that slides m and the
/// first moments.
fn is_preferred(joint: &Joint, parameter: usize) -> bool {
    if !joint.kind.is_rotation() {
        return parameter < 4;
    }
    let (along, second) = match largest_component(joint.axis) {
        0 => (1, 9),
        1 => (2, 9),
        _ => (3, 6),
    };
    parameter != 0 && parameter != along && parameter != second
}

fn largest_component(axis: Vector3<f64>) -> usize {
    let sizes = axis.to_array().map(f64::abs);
    (0..3).max_by(|&a, &b| sizes[a].total_cmp(&sizes[b])).expect("three components")
}

/// Observation matrix of random states, by columns. Seeded: the same robot gives the same matrix.
fn random_columns(robot: &Robot, set: &ParameterSet) -> Vec<Vec<f64>> {
    let n = robot.dof();
    let samples = 3 * set.of_state() / n + 20;
    let mut random = Random::new(0x5EED_0F5E_ED0F);
    let mut ws = Workspace::new(robot);
    // Columns that come with a trajectory follow from no state: each is taken to be independent of
    // all others.
    let mut columns = vec![vec![0.0; samples * n + set.trajectory_columns().len()]; set.len()];
    (set.of_state()..set.len())
        .enumerate()
        .for_each(|(row, column)| columns[column][samples * n + row] = 1.0);
    let width = set.inertial();
    for sample in 0..samples {
        let mut state =
            |scale: f64| (0..n).map(|_| scale * (2.0 * random.uniform() - 1.0)).collect::<Vec<_>>();
        let (mut q, dq, ddq) = (state(std::f64::consts::PI), state(2.0), state(5.0));
        for (q, joint) in q.iter_mut().zip(robot.joints()) {
            if !joint.kind.is_rotation() {
                *q *= 0.2;
            }
        }
        let matrix = regressor(robot, &mut ws, &q, &dq, &ddq);
        for (joint, row) in matrix.chunks_exact(width).enumerate() {
            for (column, value) in columns.iter_mut().zip(row) {
                column[sample * n + joint] = *value;
            }
        }
        let state = JointState { q: &q, dq: &dq, ddq: &ddq };
        let mut values = vec![0.0; set.effect_columns_per_joint()];
        for joint in 0..n {
            set.effect_row(joint, &state, &mut values);
            for (parameter, value) in set.effect_parameters_of(joint).into_iter().zip(&values) {
                columns[parameter][sample * n + joint] = *value;
            }
        }
    }
    columns
}
