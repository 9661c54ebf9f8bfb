//! Effects that follow the whole trajectory, and constants that enter nonlinearly, beside all that
//! is linear.
//!
//! With the constants given, everything else is linear: base parameters and parameters of effects
//! are solved for, and the residual that is left is a function of the constants alone. Gauss-Newton
//! steps take it down; their columns are the derivatives of the torque by the constants, beside
//! those of the linear parameters. Transforms, which change robot, motion or measured torque, enter
//! as the difference that they make to the torque of the model as it stands.
//!
//! Source: G. H. Golub, V. Pereyra, The differentiation of pseudo-inverses and nonlinear least
//! squares problems whose variables separate, SIAM J. Numer. Anal. 10(2) (1973); L. Kaufman, A
//! variable projection method for solving separable nonlinear least squares problems, BIT 15
//! (1975), for the step.

use std::sync::Arc;

use faer::Mat;
use rayon::prelude::*;
use sgpr_predict::internal::{JointRanges, points_of};

use super::correlation::correlation;
use super::experiment::{Experiment, TermColumns, torque_of};
use super::terms::{common_clock, seconds_since};
use super::{IdentifyError, Rigid, Term, TorqueModel, Trajectory};
use crate::effects::{self, Constant, Effect, Entry, Reach, Scale};
use crate::identification::{
    BaseParameters, JointFactor, LeastSquares, Method, Observation, ParameterSet, TrajectoryColumn,
    stack, triangular_solution,
};
use crate::linalg::triangle;
use crate::motion::{Motion, MotionError, Processing};
use crate::progress::Progress;
use crate::robot::Robot;

/// An effect, and the one joint that has it; all its sites if there is none.
pub(super) type Placed = (Arc<dyn Effect>, Option<usize>);

/// Names of effects that are columns of the present motion and at every joint, and the other
/// effects.
pub(super) fn split(
    robot: &Robot,
    names: &[String],
) -> Result<(Vec<String>, Vec<Placed>), IdentifyError> {
    let (mut plain, mut others) = (Vec::new(), Vec::<Placed>::new());
    for name in names {
        let (own, joint) =
            name.split_once('@').map_or((name.as_str(), None), |(own, joint)| (own, Some(joint)));
        let effect = effects::by_name(own)?;
        if effect.entry() == Entry::Gate {
            let reason = "checks of the log find it, and it adds no torque to a model".into();
            return Err(IdentifyError::NotTestable { effect: own.into(), reason });
        }
        let place = match joint {
            None if effect.entry() == Entry::State => {
                plain.push(name.clone());
                continue;
            }
            None => None,
            Some(joint) => {
                let index = robot.joint_index(joint);
                let sites = effect.sites(robot);
                let found = index.filter(|_| {
                    sites.iter().any(|site| site.joint().is_some() && site.joint() == index)
                });
                Some(found.ok_or_else(|| {
                    IdentifyError::NoSite {
                        effect: own.into(),
                        joint: joint.into(),
                        known: sites
                            .iter()
                            .filter_map(|site| Some(robot.joints()[site.joint()?].name.clone()))
                            .collect(),
                    }
                })?)
            }
        };
        others.push((effect, place));
    }
    Ok((plain, others))
}

/// The logs for a model with terms.
pub(super) struct TermFit<'a> {
    pub experiment: &'a Experiment,
    pub processing: &'a Processing,
    /// Stamp at which the clock of the session starts, ns, if the logs share one.
    pub clock: Option<i64>,
    /// Per motion: time of the session, s.
    times: Vec<Vec<f64>>,
    /// Per joint.
    ranges: Vec<JointRanges>,
}

/// A constant that steps are taken in, on a scale of its own.
#[derive(Clone, Copy)]
struct Unknown {
    term: usize,
    index: usize,
    /// Among the constants of all terms.
    row: usize,
    low: f64,
    high: f64,
    logarithmic: bool,
}

impl Unknown {
    /// Change of the constant per unit of the scale at `value`.
    fn slope(&self, value: f64) -> f64 {
        if self.logarithmic { value } else { 0.25 * (self.high - self.low) }
    }

    fn value(&self, model: &TorqueModel) -> f64 {
        model.terms()[self.term].constants[self.index]
    }

    fn moved(&self, value: f64, step: f64) -> f64 {
        let moved =
            if self.logarithmic { value * step.exp() } else { value + self.slope(value) * step };
        moved.clamp(self.low, self.high)
    }
}

/// Most solutions for the constants.
const MOST_STEPS: usize = 20;

/// A step that promises less of chi-squared is not worth a solution.
const SMALL_STEP: f64 = 0.1;

/// Least share of a step that is tried, and by how much shorter it becomes after one that made
/// chi-squared larger, or smaller by less than a tenth of what it promised: the tangents do not
/// reach so far.
const LEAST_SHARE: f64 = 0.02;
const SHORTER: f64 = 0.35;
const POOR: f64 = 0.1;

/// Columns of candidates held at once.
const AT_ONCE: usize = 48;

/// Points at which what begins or ends may do so at first.
const TIMES: usize = 24;

/// Highest order of a ripple that is looked for, per revolution.
const HIGHEST_ORDER: usize = 100;

impl<'a> TermFit<'a> {
    pub fn new(
        robot: &Robot,
        experiment: &'a Experiment,
        processing: &'a Processing,
        clock: Option<i64>,
    ) -> Result<Self, MotionError> {
        let n = robot.dof();
        let motions = &experiment.motions;
        let clock = common_clock(motions).and(clock).or(common_clock(motions));
        let times: Vec<Vec<f64>> = motions
            .iter()
            .map(|motion| clock.map_or(vec![], |start| seconds_since(start, &motion.time)))
            .collect();
        let span = |values: &mut dyn Iterator<Item = f64>| {
            values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
                [low.min(x), high.max(x)]
            })
        };
        let session = span(&mut times.iter().flatten().copied());
        let mut positions = vec![[f64::INFINITY, f64::NEG_INFINITY]; n];
        let (mut squares, mut largest, mut count) = (vec![0.0; n], vec![0.0f64; n], 0.0);
        for motion in motions {
            for q in motion.q.chunks_exact(n) {
                for ([low, high], q) in positions.iter_mut().zip(q) {
                    (*low, *high) = (low.min(*q), high.max(*q));
                }
            }
            for tau in torque_of(motion)?.chunks_exact(n) {
                for ((squares, largest), tau) in squares.iter_mut().zip(&mut largest).zip(tau) {
                    (*squares, *largest) = (*squares + tau * tau, largest.max(tau.abs()));
                }
                count += 1.0;
            }
        }
        let of_joint = |joint: usize| JointRanges {
            position: positions[joint],
            torque: (squares[joint] / f64::max(count, 1.0)).sqrt(),
            largest_torque: largest[joint],
            time: session,
            band_hz: processing.cutoff_hz,
        };
        let ranges = (0..n).map(of_joint).collect();
        Ok(Self { experiment, processing, clock, times, ranges })
    }

    /// `model` with these effects, constants and parameters fitted.
    pub fn with_effects(
        &self,
        model: TorqueModel,
        effects: &[Placed],
        progress: &dyn Progress,
    ) -> Result<TorqueModel, IdentifyError> {
        let start = self.linear(&model)?;
        let levels = LeastSquares::new(Method::Wls)
            .solve(&start.factors, &start.base, &start.nominal)?
            .weights;
        let mut plain = model.clone();
        plain.set_parameters(self.parameters_of(&plain, &start.solution(&levels)));
        let everywhere = |effect: &dyn Effect| {
            plain.parameter_set().effects().iter().any(|e| e.name() == effect.name())
        };
        let mut terms = model.terms().to_vec();
        for (index, (effect, joint)) in effects.iter().enumerate() {
            progress.step("start of effects", index, effects.len())?;
            self.require_testable(&plain, effect.as_ref())?;
            let sites = effect.sites(model.robot()).into_iter();
            for site in sites.filter(|site| joint.is_none() || site.joint() == *joint) {
                let term = Term::new(effect.clone(), site, vec![]);
                if !everywhere(effect.as_ref()) && !terms.iter().any(|own| own.is_like(&term)) {
                    terms.push(self.started(&plain, term, &levels)?);
                }
            }
        }
        progress.step("start of effects", effects.len(), effects.len())?;
        self.fitted(plain.with_terms(terms, self.clock), progress)
    }

    /// `model` with constants and parameters of its terms, and all other parameters, fitted.
    pub fn fitted(
        &self,
        model: TorqueModel,
        progress: &dyn Progress,
    ) -> Result<TorqueModel, IdentifyError> {
        let mut model = model;
        // Columns that follow the torque of the model, and what transforms make of it, are those of
        // the fit before.
        for _ in 0..2 {
            let linear = self.linear(&model)?;
            let levels = self.levels(&linear)?;
            model = self.at(&model, &linear.solution(&levels));
        }
        for round in 0..2 {
            let levels = self.levels(&self.linear(&model)?)?;
            model = self.descend(model, &levels, round, progress)?;
        }
        Ok(model)
    }

    /// Gauss-Newton steps at fixed noise levels.
    fn descend(
        &self,
        model: TorqueModel,
        levels: &[f64],
        round: usize,
        progress: &dyn Progress,
    ) -> Result<TorqueModel, IdentifyError> {
        let unknowns = self.unknowns(&model);
        if unknowns.is_empty() {
            return Ok(model);
        }
        struct Best {
            chi2: f64,
            model: TorqueModel,
            steps: Vec<f64>,
            promised: f64,
        }
        let mut best: Option<Best> = None;
        let (mut trial, mut share) = (model, 1.0);
        for step in 0..MOST_STEPS {
            progress.step("constants of effects", round * MOST_STEPS + step, 2 * MOST_STEPS)?;
            let linear = self.linear_with_tangents(&trial, &unknowns)?;
            let (chi2, values, steps, promised) = linear.projected(levels);
            let gain = best.as_ref().map_or(f64::INFINITY, |best| best.chi2 - chi2);
            let is_poor = best.as_ref().is_some_and(|best| gain < POOR * best.promised);
            share = if is_poor { SHORTER * share } else { f64::min(2.0 * share, 1.0) };
            if gain > 0.0 {
                best = Some(Best { chi2, model: self.at(&trial, &values), steps, promised });
            }
            let Best { model: from, steps, promised, .. } =
                best.as_ref().expect("the first solution is the best so far");
            if *promised < SMALL_STEP || share < LEAST_SHARE {
                break;
            }
            let mut terms = from.terms().to_vec();
            for (unknown, step) in unknowns.iter().zip(steps) {
                let constant = &mut terms[unknown.term].constants[unknown.index];
                *constant = unknown.moved(*constant, share * step);
            }
            trial = from.clone().with_terms(terms, self.clock);
        }
        progress.step("constants of effects", (round + 1) * MOST_STEPS, 2 * MOST_STEPS)?;
        Ok(best.expect("at least one solution").model)
    }

    /// The constants that steps are taken in: a limit of the torque is read off the logs.
    fn unknowns(&self, model: &TorqueModel) -> Vec<Unknown> {
        let terms = model.terms().iter().enumerate();
        let constants = terms.flat_map(|(term, own)| {
            own.effect
                .constants()
                .iter()
                .enumerate()
                .map(move |(index, constant)| (term, index, own, constant))
        });
        constants
            .enumerate()
            .filter(|(_, (_, _, own, constant))| {
                !(own.is_transform() && constant.scale == Scale::Torque)
            })
            .map(|(row, (term, index, own, constant))| {
                let [low, high] =
                    constant.bounds_in(&self.ranges[own.site.joint().unwrap_or_default()]);
                Unknown {
                    term,
                    index,
                    row,
                    low,
                    high,
                    logarithmic: constant.scale == Scale::Logarithmic,
                }
            })
            .collect()
    }

    /// Covariance of the base parameters, the linear parameters of all terms and all of their
    /// constants, in this order, `[width, width]`. The terms of `model` take their standard
    /// deviations from it.
    ///
    /// The constants are estimated with all linear parameters free and noise with its memory. What
    /// is linear follows them by -R₁₁⁻¹ R₁₂, with the triangular factor of the linear columns and
    /// the tangents.
    ///
    /// - `linear`: covariance of the linear parameters with the constants as they are
    pub fn joint_covariance(
        &self,
        model: &mut TorqueModel,
        linear: &Mat<f64>,
    ) -> Result<Mat<f64>, IdentifyError> {
        if model.terms().is_empty() {
            return Ok(linear.clone());
        }
        let unknowns = self.unknowns(model);
        let tangents = self.linear_with_tangents(model, &unknowns)?;
        let correlation =
            correlation(model, &self.experiment.motions, self.processing, &tangents.factors)?;
        let squares = LeastSquares { method: Method::Wls, correlation: Some(correlation) };
        let estimate = squares.solve(&tangents.factors, &tangents.base, &tangents.nominal)?;
        let first = tangents.width();
        let free: Vec<Unknown> = tangents.present.iter().map(|&index| unknowns[index]).collect();
        let variance = |i: usize, j: usize| estimate.covariance[(first + i, first + j)];
        let known: Vec<usize> = (0..free.len()).filter(|&i| variance(i, i).is_finite()).collect();
        let width = first + model.terms().iter().map(|term| term.constants.len()).sum::<usize>();
        // How all parameters and constants change with the constants that are known, on their
        // scales.
        let mut change = Mat::<f64>::zeros(width, known.len());
        for (column, &own) in known.iter().enumerate() {
            let follow = tangents.following(&estimate.whitened, own);
            follow.into_iter().enumerate().for_each(|(row, value)| change[(row, column)] = value);
            change[(first + free[own].row, column)] = free[own].slope(free[own].value(model));
        }
        let spread = Mat::from_fn(known.len(), known.len(), |i, j| variance(known[i], known[j]));
        let mut covariance = &change * spread * change.transpose();
        for i in 0..first {
            (0..first).for_each(|j| covariance[(i, j)] += linear[(i, j)]);
        }
        for own in (0..free.len()).filter(|own| !known.contains(own)) {
            covariance[(first + free[own].row, first + free[own].row)] = f64::INFINITY;
        }
        let deviations = (model.base().rank()..width).map(|k| covariance[(k, k)].max(0.0).sqrt());
        let mut deviations =
            deviations.map(|deviation| if deviation.is_finite() { deviation } else { 0.0 });
        let mut terms = model.terms().to_vec();
        let mut take = |all: &mut Vec<f64>| {
            all.iter_mut().zip(&mut deviations).for_each(|(own, next)| *own = next)
        };
        terms.iter_mut().for_each(|term| take(&mut term.coefficient_deviations));
        terms.iter_mut().for_each(|term| take(&mut term.constant_deviations));
        *model = model.clone().with_terms(terms, self.clock);
        Ok(covariance)
    }

    /// A term with the constants of the grid that explain most of what `model` leaves.
    fn started(
        &self,
        model: &TorqueModel,
        term: Term,
        levels: &[f64],
    ) -> Result<Term, IdentifyError> {
        let points = self.points(&term);
        let with = |point: &[f64]| Term::new(term.effect.clone(), term.site, point.to_vec());
        if points.len() == 1 || term.is_transform() {
            return Ok(with(&points[0]));
        }
        let per_point = term.effect.parameters().len().max(1);
        let mut best: (f64, &[f64]) = (f64::NEG_INFINITY, &points[0]);
        for some in points.chunks((AT_ONCE / per_point).max(1)) {
            let trial = model
                .clone()
                .with_terms(some.iter().map(|point| with(point)).collect(), self.clock);
            let linear = self.linear(&trial)?;
            for (point, gain) in some.iter().zip(linear.gains(levels, &with(&some[0]))) {
                if gain > best.0 {
                    best = (gain, point);
                }
            }
        }
        Ok(with(best.1))
    }

    /// Points from which the constants of a term start.
    fn points(&self, term: &Term) -> Vec<Vec<f64>> {
        let ranges = &self.ranges[term.site.joint().unwrap_or_default()];
        let constants = term.effect.constants();
        let grids: Vec<Vec<f64>> = constants
            .iter()
            .map(|constant| self.grid(constant, ranges, term.is_transform()))
            .collect();
        let mut points = points_of(&grids);
        // What begins and ends does so in this order.
        if constants.len() == 2 && constants.iter().all(|constant| constant.scale == Scale::Time) {
            points.retain(|point| point[0] < point[1]);
        }
        points
    }

    fn grid(&self, constant: &Constant, ranges: &JointRanges, transform: bool) -> Vec<f64> {
        match constant.scale {
            Scale::Time => {
                let [first, last] = ranges.time;
                (1..TIMES).map(|k| first + (last - first) * k as f64 / TIMES as f64).collect()
            }
            Scale::Order => (1..=HIGHEST_ORDER).map(|order| order as f64).collect(),
            Scale::Torque if transform => vec![ranges.largest_torque],
            _ => constant.grid_in(ranges),
        }
    }

    fn require_testable(
        &self,
        model: &TorqueModel,
        effect: &dyn Effect,
    ) -> Result<(), IdentifyError> {
        for (index, motion) in self.experiment.motions.iter().enumerate() {
            let trajectory = Trajectory::of(motion, &self.times[index]);
            let rigid = model.rigid(&trajectory);
            if let Some(reason) = effect.not_testable(&model.context(&trajectory, &rigid)) {
                return Err(IdentifyError::NotTestable { effect: effect.name().into(), reason });
            }
        }
        Ok(())
    }

    /// Torques and columns of the linear parameters of all terms.
    pub fn columns(&self, model: &TorqueModel) -> Result<TermColumns, MotionError> {
        self.columns_with(model, &[])
    }

    /// The same, and tangents by constants behind them.
    fn columns_with(
        &self,
        model: &TorqueModel,
        unknowns: &[Unknown],
    ) -> Result<TermColumns, MotionError> {
        let parameters = self.parameters(model, unknowns);
        let gains = gains(model);
        let of_motion = |(motion, times): (&Arc<Motion>, &Vec<f64>)| -> Result<(Vec<f64>, Vec<Vec<f64>>), MotionError> {
            let mut tau = torque_of(motion)?.to_vec();
            if parameters.is_empty() && model.terms().is_empty() {
                return Ok((tau, vec![]));
            }
            let trajectory = Trajectory::of(motion, times);
            let rigid = model.rigid(&trajectory);
            let context = model.context(&trajectory, &rigid);
            let mut values = Vec::with_capacity(parameters.len());
            for term in model.terms() {
                let mut columns = term.columns(&context);
                columns.iter_mut().for_each(|column| take_gains(&gains, own_joint(term), column));
                values.append(&mut columns);
            }
            take_transforms_off((model, &gains), &trajectory, &values, &mut tau);
            for unknown in unknowns {
                let Unknown { term, index, low, high, .. } = *unknown;
                let mut tangent = tangent(model, &trajectory, &rigid, (term, index), [low, high]);
                let slope = unknown.slope(unknown.value(model));
                tangent.iter_mut().for_each(|value| *value *= slope);
                values.push(tangent);
            }
            Ok((tau, values))
        };
        let motions = self.experiment.motions.par_iter().zip(&self.times);
        let (tau, values) =
            motions.map(of_motion).collect::<Result<Vec<_>, _>>()?.into_iter().unzip();
        let mut columns = TermColumns { tau, values, parameters, gains };
        for (k, parameter) in columns.parameters.iter_mut().enumerate() {
            let (squares, count) = columns.values.iter().fold((0.0, 0), |(sum, count), values| {
                (sum + values[k].iter().map(|x| x * x).sum::<f64>(), count + values[k].len())
            });
            parameter.size = (squares / f64::max(count as f64, 1.0)).sqrt();
        }
        Ok(columns)
    }

    fn parameters(&self, model: &TorqueModel, unknowns: &[Unknown]) -> Vec<TrajectoryColumn> {
        let robot = model.robot();
        let kind = |term: &Term| robot.joints()[term.site.joint().unwrap_or_default()].kind;
        // Two effects of a joint may call their parameters alike.
        let name = |term: &Term, symbol: &str| {
            let plain = format!("{}{symbol}", term.prefix(robot));
            let taken = model.parameter_set().names().contains(&plain);
            if taken { format!("{plain} of {}", term.effect.name()) } else { plain }
        };
        let mut all = Vec::new();
        for term in model.terms() {
            for parameter in term.effect.parameters() {
                let (name, unit) = (name(term, parameter.symbol), parameter.unit_at(kind(term)));
                let mut column = TrajectoryColumn::new(name, unit, own_joint(term), 0.0);
                column.non_negative = parameter.non_negative;
                all.push(column);
            }
        }
        for unknown in unknowns {
            let term = &model.terms()[unknown.term];
            let name =
                format!("{}{}", term.prefix(robot), term.effect.constants()[unknown.index].symbol);
            let joint = own_joint(term).filter(|_| !term.is_transform());
            all.push(TrajectoryColumn::new(name, "1", joint, 0.0));
        }
        all
    }

    /// The equations of all parameters of the model and its terms.
    fn linear(&self, model: &TorqueModel) -> Result<Linear, IdentifyError> {
        Linear::new(model, self.experiment, self.columns(model)?, 0, vec![])
    }

    fn linear_with_tangents(
        &self,
        model: &TorqueModel,
        unknowns: &[Unknown],
    ) -> Result<Linear, IdentifyError> {
        let mut columns = self.columns_with(model, unknowns)?;
        // Constants of a term without torque change nothing.
        let first = columns.parameters.len() - unknowns.len();
        let present: Vec<usize> =
            (0..unknowns.len()).filter(|k| columns.parameters[first + k].size > 0.0).collect();
        let kept: Vec<usize> = (0..first).chain(present.iter().map(|k| first + k)).collect();
        columns.parameters = kept.iter().map(|&k| columns.parameters[k].clone()).collect();
        for values in &mut columns.values {
            *values = kept.iter().map(|&k| std::mem::take(&mut values[k])).collect();
        }
        Linear::new(model, self.experiment, columns, unknowns.len(), present)
    }

    fn levels(&self, linear: &Linear) -> Result<Vec<f64>, IdentifyError> {
        Ok(LeastSquares::new(Method::Wls)
            .solve(&linear.factors, &linear.base, &linear.nominal)?
            .weights)
    }

    /// All parameters of the model with these base parameters.
    fn parameters_of(&self, model: &TorqueModel, base: &[f64]) -> Vec<f64> {
        model.base().expand(&base[..model.base().rank()], model.parameters())
    }

    /// The model with the linear parameters of a solution.
    fn at(&self, model: &TorqueModel, values: &[f64]) -> TorqueModel {
        let mut next = model.clone();
        let mut parameters = self.parameters_of(model, values);
        parameters.extend(&values[model.base().rank()..]);
        next.set_all_parameters(&parameters);
        next
    }
}

/// The one joint that a term reaches.
pub(super) fn own_joint(term: &Term) -> Option<usize> {
    (term.effect.reach() == Reach::Own).then(|| term.site.joint()).flatten()
}

/// `[n]`, how much of a torque that stands the logs show of each joint, all transforms in between;
/// empty if they show it as it is.
pub(super) fn gains(model: &TorqueModel) -> Vec<f64> {
    let transforms = || model.terms().iter().filter(|term| term.is_transform());
    if transforms().next().is_none() {
        return vec![];
    }
    let of_joint = |joint: usize| {
        let mut unit = [1.0];
        // Without a rate nothing is late.
        transforms().for_each(|t| {
            t.effect.transmit(t.site, &t.constants, joint, f64::INFINITY, &mut unit, 1)
        });
        unit[0]
    };
    (0..model.robot().dof()).map(of_joint).collect()
}

/// Turns a torque into what the logs show of it.
///
/// - `values`: `[samples]` of a joint, or `[samples, n]`
pub(super) fn take_gains(gains: &[f64], joint: Option<usize>, values: &mut [f64]) {
    match joint {
        _ if gains.is_empty() => {}
        Some(joint) => values.iter_mut().for_each(|value| *value *= gains[joint]),
        None => {
            values.iter_mut().zip(gains.iter().cycle()).for_each(|(value, gain)| *value *= gain)
        }
    }
}

/// Takes off what transforms change, beside their gains, of the torque that the model predicts.
///
/// - `columns`: of the terms, as logged
fn take_transforms_off(
    (model, gains): (&TorqueModel, &[f64]),
    trajectory: &Trajectory<'_>,
    columns: &[Vec<f64>],
    tau: &mut [f64],
) {
    if gains.is_empty() {
        return;
    }
    let changed = model.predict_trajectory(trajectory);
    let mut plain = model.without_terms().predict(trajectory.samples);
    take_gains(gains, None, &mut plain);
    let parameters = model
        .terms()
        .iter()
        .flat_map(|term| term.coefficients.iter().map(move |factor| (term, factor)));
    for ((term, factor), column) in parameters.zip(columns) {
        let (first, step) = own_joint(term).map_or((0, 1), |joint| (joint, gains.len()));
        plain
            .iter_mut()
            .skip(first)
            .step_by(step)
            .zip(column)
            .for_each(|(tau, c)| *tau += factor * c);
    }
    for (tau, (changed, plain)) in tau.iter_mut().zip(changed.iter().zip(&plain)) {
        *tau -= changed - plain;
    }
}

/// The linear equations with the constants of a model as they are.
struct Linear {
    base: BaseParameters,
    nominal: Vec<f64>,
    factors: Vec<JointFactor>,
    /// Unknowns beyond the base parameters: linear parameters of terms, then tangents.
    columns: usize,
    /// Constants asked for, and those among them that have a tangent.
    constants: usize,
    present: Vec<usize>,
}

impl Linear {
    fn new(
        model: &TorqueModel,
        experiment: &Experiment,
        columns: TermColumns,
        constants: usize,
        present: Vec<usize>,
    ) -> Result<Self, IdentifyError> {
        let robot = model.robot();
        let count = columns.parameters.len();
        let set = model.parameter_set().clone().with_trajectory_columns(columns.parameters.clone());
        let base = BaseParameters::new(robot, &set);
        let mut nominal = model.parameters().to_vec();
        nominal.resize(set.len(), 0.0);
        let factors = factors(robot, &set, &base, experiment, &columns)?;
        Ok(Self {
            nominal: base.combine(&nominal),
            base,
            factors,
            columns: count,
            constants,
            present,
        })
    }

    /// Linear unknowns without tangents.
    fn width(&self) -> usize {
        self.base.rank() - self.present.len()
    }

    /// The linear parameters with least residual.
    fn solution(&self, levels: &[f64]) -> Vec<f64> {
        self.leading(&stack(&self.factors, self.base.rank(), levels))
    }

    fn leading(&self, triangle: &Mat<f64>) -> Vec<f64> {
        let (width, last) = (self.width(), triangle.ncols() - 1);
        let own = Mat::from_fn(width + 1, width + 1, |i, j| {
            if i == width { 0.0 } else { triangle[(i, if j == width { last } else { j })] }
        });
        triangular_solution(&own, &self.nominal[..width])
    }

    /// Change of the linear parameters with the free constant `own`, on its scale: they go where
    /// the residual stays least.
    ///
    /// - `whitened`: triangular factor of all columns
    fn following(&self, whitened: &Mat<f64>, own: usize) -> Vec<f64> {
        let width = self.width();
        let triangle = Mat::from_fn(width + 1, width + 1, |i, j| match j == width {
            _ if i == width => 0.0,
            true => -whitened[(i, width + own)],
            false => whitened[(i, j)],
        });
        triangular_solution(&triangle, &vec![0.0; width])
    }

    /// Squared residual with constants as they are, the linear parameters with which it is least,
    /// the step for all constants and what it promises of the residual.
    fn projected(&self, levels: &[f64]) -> (f64, Vec<f64>, Vec<f64>, f64) {
        let (rank, width) = (self.base.rank(), self.width());
        let whole = stack(&self.factors, rank, levels);
        let chi2: f64 = (width..=rank).map(|i| whole[(i, rank)].powi(2)).sum();
        // Behind the linear columns: tangents and torque with all of those projected out, and one
        // unit of each constant's scale as expected step.
        let free = self.present.len();
        let damped = Mat::from_fn(2 * free + 1, free + 1, |i, j| match i.checked_sub(free + 1) {
            None => whole[(width + i, width + j)],
            Some(own) => f64::from(own == j && j < free),
        });
        let damped = triangle(damped.as_ref());
        let found = triangular_solution(&damped, &vec![0.0; free]);
        let mut steps = vec![0.0; self.constants];
        self.present
            .iter()
            .zip(found)
            .for_each(|(&index, step)| steps[index] = step.clamp(-1.0, 1.0));
        (chi2, self.leading(&whole), steps, chi2 - damped[(free, free)].powi(2))
    }

    /// How much of the squared residual each of several terms explains by itself, all like `term`;
    /// nothing if the sign of its first parameter cannot be.
    fn gains(&self, levels: &[f64], term: &Term) -> Vec<f64> {
        let rank = self.base.rank();
        let whole = stack(&self.factors, rank, levels);
        let first = rank - self.columns;
        let parameters = term.effect.parameters();
        let size = parameters.len();
        let gain = |point: usize| {
            let own = |k: usize| if k == size { rank } else { first + point * size + k };
            let rest = Mat::from_fn(rank + 1 - first, size + 1, |i, j| whole[(first + i, own(j))]);
            let visible =
                (0..size).all(|k| rest.col(k).norm_l2() > 1e-6 * whole.col(own(k)).norm_l2());
            let reduced = triangle(rest.as_ref());
            let found = triangular_solution(&reduced, &vec![0.0; size]);
            let wrong = parameters
                .first()
                .is_some_and(|parameter| parameter.non_negative && found[0] < 0.0);
            if !visible || wrong {
                0.0
            } else {
                (0..size).map(|i| reduced[(i, size)].powi(2)).sum()
            }
        };
        (0..self.columns / size.max(1)).map(gain).collect()
    }
}

/// Factors of all joints with the columns of terms.
pub(super) fn factors(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    experiment: &Experiment,
    columns: &TermColumns,
) -> Result<Vec<JointFactor>, IdentifyError> {
    let mut observation = Observation::new(robot, set, base);
    for trajectory in experiment.trajectories_with(&[], &[], Some(columns))? {
        observation.add(&trajectory)?;
    }
    Ok(observation.factors())
}

/// Derivative of the torque that the logs show by a constant, of which the term and the place in it
/// are given: of its joint, `[samples]`, or of all for a transform or an effect that reaches them,
/// `[samples, n]`.
pub(super) fn tangent(
    model: &TorqueModel,
    trajectory: &Trajectory<'_>,
    rigid: &Rigid,
    (index, constant): (usize, usize),
    [lowest, highest]: [f64; 2],
) -> Vec<f64> {
    let term = &model.terms()[index];
    let value = term.constants[constant];
    let step = term.effect.constants()[constant].difference_step(value);
    let [low, high] = [(value - step).max(lowest), (value + step).min(highest)];
    // A constant at the only value that it may have.
    let slope = if high > low { 1.0 / (high - low) } else { 0.0 };
    let with = |value: f64| {
        let mut changed = term.clone();
        changed.constants[constant] = value;
        changed
    };
    let gains = gains(model);
    let torque = |value: f64| -> Vec<f64> {
        if term.is_transform() {
            let mut terms = model.terms().to_vec();
            terms[index] = with(value);
            return model
                .clone()
                .with_terms(terms, model.clock_start())
                .predict_trajectory(trajectory);
        }
        let columns = with(value).columns(&model.context(trajectory, rigid));
        let mut sum = vec![0.0; columns.first().map_or(0, Vec::len)];
        for (column, factor) in columns.iter().zip(&term.coefficients) {
            sum.iter_mut().zip(column).for_each(|(sum, c)| *sum += factor * c);
        }
        take_gains(&gains, own_joint(term), &mut sum);
        sum
    };
    let lower = torque(low);
    let mut difference = torque(high);
    difference.iter_mut().zip(&lower).for_each(|(high, low)| *high = slope * (*high - low));
    difference
}
