//! Effects that depend on the whole motion or enter nonlinearly, about values that are taken for
//! true.

use std::f64::consts::PI;
use std::sync::Arc;

use super::information::{BesideBase, Information};
use super::{Basis, ExcitationError, Trajectory, TrajectorySamples};
use crate::dynamics::{BatchWorkspace, Samples, rnea_batch};
use crate::effects::{Constant, Context, Effect, Entry, Reach, Scale, Site};
use crate::identification::{BaseParameters, ParameterSet};
use crate::linalg::dot;
use crate::model::{Term, TorqueModel, Trajectory as Motion};
use crate::robot::Robot;
use crate::simulation::NormalNumbers;

/// Columns of the observation matrix beside those that the present joint motion gives: derivatives
/// of the torque by the parameters and constants of effects, at nominal values. A motion that makes
/// a criterion of them small is good for parameters near these values (local optimality); only
/// D-optimality does not depend on the units of the parameters.
///
/// Parameters that no motion can tell from the base parameters, such as those of a payload that is
/// never put down, have no column: [`NominalEffects::hidden`].
///
/// Source: V. V. Fedorov, Theory of Optimal Experiments (1972), section 1.3, on locally optimal
/// designs.
#[derive(Clone, Debug)]
pub struct NominalEffects {
    model: TorqueModel,
    columns: Vec<TermColumn>,
    hidden: Vec<String>,
}

#[derive(Clone, Copy, Debug)]
struct TermColumn {
    term: usize,
    of: Of,
}

#[derive(Clone, Copy, Debug)]
enum Of {
    Coefficient(usize),
    /// Constant, with the values below and above that the difference is taken between.
    Constant(usize, [f64; 2]),
}

/// Share of a column that the others must leave over.
const INDEPENDENT: f64 = 1e-5;

/// Share of a torque below which its change by a constant is rounding.
const ROUNDING: f64 = 1e-12;

/// Random motions by which columns are compared.
const MOTIONS: u64 = 3;

/// Samples per second that effects with hidden states need: those of the library move at up to 25
/// Hz.
pub(super) const RATE_HZ: f64 = 100.0;

impl NominalEffects {
    /// - `set`, `base`: the parameters beside which the effects stand
    /// - `parameters`: nominal values of `set`, `[set.len()]`
    /// - `terms`: with nominal constants and coefficients
    /// - `duration`: of the motions, s
    pub fn new(
        robot: &Robot,
        set: &ParameterSet,
        base: &BaseParameters,
        parameters: &[f64],
        terms: Vec<Term>,
        duration: f64,
    ) -> Self {
        let names: Vec<&str> = set.effects().iter().map(|effect| effect.name()).collect();
        let model = TorqueModel::with_parameters(robot, &names, parameters.to_vec());
        let model = model.expect("effects of a set").with_terms(terms, Some(0));
        let mut all = Self { columns: columns_of(&model), model, hidden: vec![] };
        let motions: Vec<TrajectorySamples> =
            (0..MOTIONS).map(|seed| some_motion(robot, duration, seed)).collect();
        let mut known = base_columns(robot, set, base, &motions);
        let mut own: Vec<Vec<f64>> = vec![vec![]; all.columns.len()];
        for motion in &motions {
            own.iter_mut()
                .zip(all.values_along(motion))
                .for_each(|(column, part)| column.extend(part));
        }
        all.silence_rounding(&mut own);
        let kept = independent(&mut known, own);
        all.hidden =
            (0..kept.len()).filter(|k| !kept[*k]).map(|k| all.name(&all.columns[k])).collect();
        let kept = all
            .columns
            .iter()
            .zip(kept)
            .filter(|(_, kept)| *kept)
            .map(|(column, _)| *column)
            .collect();
        all.columns = kept;
        all
    }

    /// Sets columns of coefficients to zero that are rounding beside those of other coefficients of
    /// their term.
    fn silence_rounding(&self, columns: &mut [Vec<f64>]) {
        let squares: Vec<f64> = columns.iter().map(|column| dot(column, column)).collect();
        let coefficient = |index: &usize| matches!(self.columns[*index].of, Of::Coefficient(_));
        for index in (0..columns.len()).filter(coefficient) {
            let term = self.columns[index].term;
            let of_term = (0..columns.len())
                .filter(coefficient)
                .filter(|other| self.columns[*other].term == term);
            let largest = of_term.map(|other| squares[other]).fold(0.0, f64::max);
            if squares[index] <= ROUNDING * ROUNDING * largest {
                columns[index].fill(0.0);
            }
        }
    }

    /// Whether a term has a hidden state, so that its columns need samples that are close in time.
    pub(super) fn has_memory(&self) -> bool {
        self.model.terms().iter().any(|term| term.effect.has_memory())
    }

    /// Number of columns.
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// Whether there is no column.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// Names of the columns: `joint_2.vs (stribeck_friction)`.
    pub fn names(&self) -> Vec<String> {
        self.columns.iter().map(|column| self.name(column)).collect()
    }

    /// The nominal value of each column's parameter.
    pub fn values(&self) -> Vec<f64> {
        let value = |column: &TermColumn| {
            let term = &self.model.terms()[column.term];
            match column.of {
                Of::Coefficient(index) => term.coefficients[index],
                Of::Constant(index, _) => term.constants[index],
            }
        };
        self.columns.iter().map(value).collect()
    }

    /// Parameters without a column: motion cannot tell them from others, or they change no torque.
    pub fn hidden(&self) -> &[String] {
        &self.hidden
    }

    /// The effects with their nominal values.
    pub fn terms(&self) -> &[Term] {
        self.model.terms()
    }

    fn name(&self, column: &TermColumn) -> String {
        let term = &self.model.terms()[column.term];
        let symbol = match column.of {
            Of::Coefficient(index) => term.effect.parameters()[index].symbol,
            Of::Constant(index, _) => term.effect.constants()[index].symbol,
        };
        format!("{}{symbol} ({})", term.prefix(self.model.robot()), term.effect.name())
    }

    /// The link that a column goes with where links are looked at one by one: the last one for the
    /// whole arm.
    pub(super) fn link(&self, column: usize) -> usize {
        self.model.terms()[self.columns[column].term]
            .site
            .joint()
            .unwrap_or(self.model.robot().dof() - 1)
    }

    /// Values along evenly spaced samples, `[samples, n]` each.
    fn values_along(&self, samples: &TrajectorySamples) -> Vec<Vec<f64>> {
        let (n, count) = (self.model.robot().dof(), samples.len());
        let rate_hz = (count - 1) as f64 / (samples.time[count - 1] - samples.time[0]);
        let motion = Motion {
            samples: Samples { q: &samples.q, dq: &samples.dq, ddq: &samples.ddq },
            rate_hz,
            time: &samples.time,
            channels: &[],
        };
        let rigid = self.model.rigid(&motion);
        let context = self.model.context(&motion, &rigid);
        let mut of_term: Option<(usize, Vec<Vec<f64>>)> = None;
        let mut out = Vec::with_capacity(self.columns.len());
        for TermColumn { term: index, of } in &self.columns {
            let term = &self.model.terms()[*index];
            match of {
                Of::Coefficient(parameter) => {
                    if of_term.as_ref().is_none_or(|(known, _)| known != index) {
                        of_term = Some((*index, term.columns(&context)));
                    }
                    let (_, columns) = of_term.as_ref().expect("just set");
                    out.push(self.spread(term, &columns[*parameter], n, rate_hz));
                }
                Of::Constant(constant, values) => {
                    out.push(self.slope(*index, *constant, *values, &motion, &context))
                }
            }
        }
        out
    }

    /// Difference quotient of the torque by a constant.
    fn slope(
        &self,
        index: usize,
        constant: usize,
        values: [f64; 2],
        motion: &Motion<'_>,
        context: &Context<'_>,
    ) -> Vec<f64> {
        let term = &self.model.terms()[index];
        let [below, above] = values.map(|value| {
            let mut moved = term.clone();
            moved.constants[constant] = value;
            if term.is_transform() {
                let mut terms = self.model.terms().to_vec();
                terms[index] = moved;
                return self.model.clone().with_terms(terms, Some(0)).predict_trajectory(motion);
            }
            let columns = moved.columns(context);
            let mut torque = vec![0.0; columns.first().map_or(0, Vec::len)];
            for (column, coefficient) in columns.iter().zip(&term.coefficients) {
                torque
                    .iter_mut()
                    .zip(column)
                    .for_each(|(torque, value)| *torque += coefficient * value);
            }
            self.spread(term, &torque, self.model.robot().dof(), motion.rate_hz)
        });
        let change: Vec<f64> =
            above.iter().zip(&below).map(|(above, below)| above - below).collect();
        if dot(&change, &change) <= ROUNDING * ROUNDING * dot(&above, &above) {
            return vec![0.0; change.len()];
        }
        let step = values[1] - values[0];
        change.into_iter().map(|change| change / step).collect()
    }

    /// A column as the log shows it, `[samples, n]`.
    fn spread(&self, term: &Term, column: &[f64], n: usize, rate_hz: f64) -> Vec<f64> {
        let mut all = match term.effect.reach() {
            Reach::All => column.to_vec(),
            Reach::Own => {
                let joint = term.site.joint().expect("it reaches its own joint");
                let mut all = vec![0.0; column.len() * n];
                all.iter_mut()
                    .skip(joint)
                    .step_by(n)
                    .zip(column)
                    .for_each(|(all, value)| *all = *value);
                all
            }
        };
        for transform in self.model.terms().iter().filter(|term| term.is_transform()) {
            for joint in 0..n {
                let mut own: Vec<f64> = all.iter().skip(joint).step_by(n).copied().collect();
                transform.effect.transmit(
                    transform.site,
                    &transform.constants,
                    joint,
                    rate_hz,
                    &mut own,
                    1,
                );
                all.iter_mut().skip(joint).step_by(n).zip(own).for_each(|(all, own)| *all = own);
            }
        }
        all
    }
}

/// The terms of an effect at all its sites, with values in the middle of what is known of them;
/// coefficients are one.
///
/// - `duration`: of the motion, s
///
/// # Errors
/// If no motion of this robot can show the effect: it needs another channel, is found before any
/// physics, or has no place.
pub fn nominal_terms(
    robot: &Robot,
    effect: &Arc<dyn Effect>,
    duration: f64,
) -> Result<Vec<Term>, ExcitationError> {
    let refuse = |reason: String| ExcitationError::Effect { name: effect.name().into(), reason };
    if effect.entry() == Entry::Gate {
        return Err(refuse(
            "it is found by checks of a log before any physics, and no motion shows it better"
                .into(),
        ));
    }
    let motion = some_motion(robot, duration, 0);
    let mut torque = vec![0.0; motion.q.len()];
    let samples = Samples { q: &motion.q, dq: &motion.dq, ddq: &motion.ddq };
    rnea_batch(robot, &mut BatchWorkspace::new(robot), samples, &mut torque);
    let context = Context::new(robot, RATE_HZ, &motion.time, samples)
        .with_rigid_torque(&torque)
        .with_torque(&torque);
    if let Some(reason) = effect.not_testable(&context) {
        return Err(refuse(format!("a motion alone does not show it: {reason}")));
    }
    let sites = effect.sites(robot);
    if sites.is_empty() {
        return Err(refuse(format!("the robot `{}` has no place for it", robot.name())));
    }
    let term = |site: Site| {
        let joint = site.joint().unwrap_or_default();
        let constants = effect.constants();
        let times = constants.iter().filter(|constant| constant.scale == Scale::Time).count();
        let mut time = 0;
        let values = constants.iter().map(|constant| {
            let [low, high] = range(robot, joint);
            match (constant.scale, middle(constant)) {
                (Scale::Position, share) => low + share * (high - low),
                (Scale::PositionWidth, share) => share * (high - low),
                (Scale::Torque, share) => {
                    share * context.rms(&torque, joint).max(f64::MIN_POSITIVE)
                }
                (Scale::Time, _) => {
                    time += 1;
                    duration * time as f64 / (times + 1) as f64
                }
                (_, value) => value,
            }
        });
        let mut term = Term::new(effect.clone(), site, values.collect());
        term.coefficients.fill(1.0);
        term
    };
    Ok(sites.into_iter().map(term).collect())
}

/// The middle of the grid; without one that of the bounds, or one.
fn middle(constant: &Constant) -> f64 {
    match constant.grid {
        [] if constant.low > 0.0 && constant.high.is_finite() => {
            (constant.low * constant.high).sqrt()
        }
        [] => 1.0,
        grid => grid[grid.len() / 2],
    }
}

impl BesideBase for NominalEffects {
    fn len(&self) -> usize {
        self.columns.len()
    }

    fn columns(&self, samples: &TrajectorySamples) -> Vec<Vec<f64>> {
        self.values_along(samples)
    }
}

fn columns_of(model: &TorqueModel) -> Vec<TermColumn> {
    let of_term = |(term, own): (usize, &Term)| {
        let coefficients = (0..own.coefficients.len()).map(Of::Coefficient);
        let constants = own.constants.iter().zip(own.effect.constants()).enumerate();
        let constants = constants.map(|(index, (value, constant))| {
            let step = match constant.scale {
                Scale::Neutral { step } => step,
                Scale::Time => 1e-2,
                Scale::Order => 1e-4,
                _ => 1e-4 * value.abs().max(1e-3),
            };
            let [low, high] = match constant.scale {
                Scale::Position | Scale::PositionWidth | Scale::Torque => {
                    [f64::NEG_INFINITY, f64::INFINITY]
                }
                _ => [constant.low, constant.high],
            };
            Of::Constant(index, [(value - step).max(low), (value + step).min(high)])
        });
        coefficients.chain(constants).map(move |of| TermColumn { term, of }).collect::<Vec<_>>()
    };
    model.terms().iter().enumerate().flat_map(of_term).collect()
}

/// Position limits of a joint; a turn if it has none.
fn range(robot: &Robot, joint: usize) -> [f64; 2] {
    robot.joints()[joint]
        .limits
        .position
        .filter(|[low, high]| (high - low).is_finite())
        .unwrap_or([-PI, PI])
}

/// A smooth motion of all joints, wide and fast enough to show what an effect does.
fn some_motion(robot: &Robot, duration: f64, seed: u64) -> TrajectorySamples {
    let (n, mut noise) = (robot.dof(), NormalNumbers::new(seed));
    let basis = Basis::fourier(1.0 / duration, 5);
    let mut start = Vec::with_capacity(n);
    let mut coefficients = Vec::with_capacity(n * basis.len());
    for joint in 0..n {
        let [low, high] = range(robot, joint);
        start.push(0.5 * (low + high));
        // A series has functions of velocity: their positions are smaller by the angular frequency.
        let size = 0.2 * (high - low) * std::f64::consts::TAU / duration;
        coefficients.extend((0..basis.len()).map(|_| size * noise.normal()));
    }
    let motion = Trajectory::new(basis, start, coefficients).expect("five terms");
    motion.samples(RATE_HZ, duration)
}

/// Columns of the base parameters along motions, orthonormal.
fn base_columns(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    motions: &[TrajectorySamples],
) -> Vec<Vec<f64>> {
    let mut information = Information::new(robot, set, base, None, None, 0.0);
    let mut columns = vec![vec![]; base.rank()];
    for motion in motions {
        information.observe(motion);
        for row in information.rows.chunks_exact(base.rank()) {
            columns.iter_mut().zip(row).for_each(|(column, value)| column.push(*value));
        }
    }
    let mut known = Vec::with_capacity(columns.len());
    for column in columns {
        push_if_independent(&mut known, column);
    }
    known
}

/// Adds what orthonormal columns leave of another one to them, if that is more than rounding.
fn push_if_independent(known: &mut Vec<Vec<f64>>, column: Vec<f64>) {
    independent(known, vec![column]);
}

/// Which columns are no combinations of `known` ones, which are orthonormal, and of each other. The
/// one that the others leave most of comes first, so that of a combination the column goes that
/// says least beside the others. What is kept is added to the known columns.
fn independent(known: &mut Vec<Vec<f64>>, mut columns: Vec<Vec<f64>>) -> Vec<bool> {
    let mut kept = vec![false; columns.len()];
    for column in &mut columns {
        let length = dot(column, column).sqrt();
        if !(length > 0.0 && length.is_finite()) {
            column.fill(0.0);
            continue;
        }
        column.iter_mut().for_each(|value| *value /= length);
        take_away(known, column);
    }
    let left = |columns: &[Vec<f64>], k: usize| dot(&columns[k], &columns[k]);
    while let Some(next) = (0..columns.len())
        .filter(|k| !kept[*k] && left(&columns, *k) >= INDEPENDENT * INDEPENDENT)
        .max_by(|a, b| left(&columns, *a).total_cmp(&left(&columns, *b)))
    {
        kept[next] = true;
        let mut direction = std::mem::take(&mut columns[next]);
        take_away(known, &mut direction);
        let length = dot(&direction, &direction).sqrt();
        direction.iter_mut().for_each(|value| *value /= length);
        known.push(direction);
        let direction = &known[known.len() - 1..];
        columns
            .iter_mut()
            .zip(&kept)
            .filter(|(_, kept)| !**kept)
            .for_each(|(column, _)| take_away(direction, column));
    }
    kept
}

/// Takes the shares of orthonormal columns away from another one.
fn take_away(known: &[Vec<f64>], column: &mut [f64]) {
    // Twice is enough (Parlett, The Symmetric Eigenvalue Problem, section 6.9).
    for _ in 0..2 {
        for other in known {
            let share = dot(other, column);
            column.iter_mut().zip(other).for_each(|(value, other)| *value -= share * other);
        }
    }
}
