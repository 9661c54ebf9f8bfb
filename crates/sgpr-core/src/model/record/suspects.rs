//! Effects that a model lacks, asked of records: their columns are kept at set up, and whether they
//! lower the error on parts of the logs that were left out is found without the logs.

use std::sync::Arc;

use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Mat, Par};
use serde::{Deserialize, Serialize};
use sgpr_predict::internal::points_of;

use super::super::experiment::{Experiment, TermColumns};
use super::super::identify::parts_of_blocks;
use super::super::torque_model::nominal_parameters;
use super::super::variable_projection::TermFit;
use super::super::{IdentifyError, Term, TorqueModel};
use super::sum::{check, correlation, factors_of, ordered, place_of};
use super::{Record, RecordError};
use crate::effects::{self, Effect, Entry, Reach, Scale, Site};
use crate::identification::{
    BaseParameters, JointFactor, Judgement, LeastSquares, Method, ParameterSet, residual_norm,
    stacked,
};
use crate::linalg::cholesky;
use crate::motion::Processing;
use crate::robot::Robot;

/// An effect at a joint, with constants, of which a record keeps columns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Suspect {
    /// Name of the effect.
    pub effect: String,
    /// Joint.
    pub joint: usize,
    /// Values of its constants.
    pub constants: Vec<f64>,
}

/// What records say of a suspect, beside those that were found.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SuspectTest {
    /// Which, at the constants that save most.
    pub suspect: Suspect,
    /// What it saves of the joint's squared error on parts that were left out; of one that was
    /// found, beside the others.
    pub judgement: Judgement,
    /// Whether it is there.
    pub found: bool,
    /// Its parameters if it was found: symbol, unit, value, standard deviation.
    pub parameters: Vec<(&'static str, &'static str, f64, f64)>,
    /// Others that would have saved as much in its place, up to the standard error: the logs do not
    /// tell which it is.
    pub alternatives: Vec<Suspect>,
    /// Whether more of the joint's error goes on from row to row, as no noise does, than all that
    /// was found there explains: it can be the shadow of an effect that is no suspect.
    pub mostly_unexplained: bool,
}

/// What records say of effects that the model lacks.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RecordDiagnosis {
    /// Found ones first, in the order in which they were; then the others, by what they would save.
    pub tests: Vec<SuspectTest>,
    /// Root mean square error of each joint on parts that were left out, without suspects and with
    /// those that were found, N·m (N); zero for a joint that never moves.
    pub left_out_errors: [Vec<f64>; 2],
    /// Share of each joint's squared error, with what was found, that goes on from row to row, as
    /// no noise does: what the model lacks still.
    pub unexplained: Vec<f64>,
}

/// Parts that are left out one after the other.
const PARTS: usize = 10;

/// What is found lowers the squared error of its joint by this share at least ...
const MATTERS: f64 = 0.05;

/// ... and by so many of its standard errors, by the parts alike and by where the effect acts.
const SURE: f64 = 2.5;

/// Group of lags over which noise in the band of the equations has forgotten itself, 1 to 1 1/3
/// periods of the cut-off, and an effect that follows the motion has not.
const LONGER_THAN_NOISE: usize = 3;

/// More of one arm are no diagnosis.
const MOST: usize = 12;

/// Share of a column's square that is added to it, so that columns without content have a solution.
const RIDGE: f64 = 1e-11;

/// Suspects by name, `torque_ripple` for all joints that can have it, `cable_stiffness@joint_2` for
/// one; a column of each parameter at every point of the grid of its constants.
///
/// # Errors
/// If there is no such effect or joint, or its columns are not those of a joint at constants that
/// are the same for all logs.
pub(super) fn suspects_of(
    robot: &Robot,
    present: &[String],
    names: &[String],
) -> Result<Vec<Suspect>, RecordError> {
    let mut all = Vec::new();
    for name in names {
        let (own, joint) =
            name.split_once('@').map_or((name.as_str(), None), |(own, joint)| (own, Some(joint)));
        let effect = effects::by_name(own).map_err(IdentifyError::from)?;
        let refuse = |reason: &str| {
            Err(RecordError::NotSuspected { effect: own.into(), reason: reason.into() })
        };
        if present.iter().any(|effect| effect == own) {
            return refuse("the equations have it already");
        }
        if matches!(effect.entry(), Entry::Transform | Entry::Gate) || effect.reach() != Reach::Own
        {
            return refuse("it is no torque of one joint in proportion to its parameters");
        }
        if effect.about().depends_on_time
            || !effect.constants().iter().all(|constant| is_fixed(constant.scale))
        {
            return refuse(
                "its constants are times, places or torques, which differ from log to log",
            );
        }
        let sites: Vec<usize> = effect.sites(robot).into_iter().filter_map(joint_alone).collect();
        let wanted = joint.map(|joint| robot.joint_index(joint));
        let sites: Vec<usize> = sites
            .into_iter()
            .filter(|site| wanted.is_none_or(|wanted| wanted == Some(*site)))
            .collect();
        if sites.is_empty() {
            return refuse("the robot has no such joint, or none that can have it");
        }
        let grids: Vec<Vec<f64>> =
            effect.constants().iter().map(|constant| constant.grid.to_vec()).collect();
        for joint in sites {
            let at = |constants| Suspect { effect: own.into(), joint, constants };
            all.extend(
                points_of(&grids)
                    .into_iter()
                    .map(at)
                    .filter(|suspect| !all.contains(suspect))
                    .collect::<Vec<_>>(),
            );
        }
    }
    Ok(all)
}

fn is_fixed(scale: Scale) -> bool {
    matches!(scale, Scale::Logarithmic | Scale::Linear(_))
}

fn joint_alone(site: Site) -> Option<usize> {
    match site {
        Site::Joint(joint) => Some(joint),
        _ => None,
    }
}

/// Columns of suspects along a log. Those that follow the torque of the model follow that of the
/// robot file.
pub(super) fn columns_of(
    robot: &Robot,
    set: &ParameterSet,
    (experiment, processing): (&Experiment, &Processing),
    suspects: &[Suspect],
) -> Result<TermColumns, RecordError> {
    let term = |suspect: &Suspect| {
        let effect = effects::by_name(&suspect.effect).map_err(IdentifyError::from)?;
        Ok(Term::new(effect, Site::Joint(suspect.joint), suspect.constants.clone()))
    };
    let terms: Vec<Term> = suspects.iter().map(term).collect::<Result<_, RecordError>>()?;
    let fit = TermFit::new(robot, experiment, processing, None).map_err(IdentifyError::from)?;
    let model = TorqueModel::from_parameters(
        robot.clone(),
        set.clone(),
        nominal_parameters(robot, set),
        vec![],
    );
    Ok(fit.columns(&model.with_terms(terms, fit.clock)).map_err(IdentifyError::from)?)
}

/// Looks for effects among the suspects of records: what lowers the error on parts of the logs that
/// were left out of the fit, all base parameters and what was found before fitted again each time,
/// is taken up, that which saves most first; what the others then make superfluous goes again.
///
/// # Errors
/// As [`identify_records`](super::identify_records), and if the records have no suspects or others
/// than the first.
pub fn diagnose_records(
    robot: &Robot,
    records: &[&Record],
) -> Result<RecordDiagnosis, RecordError> {
    let (_, base) = check(robot, records)?;
    let first = records[0];
    require_columns(robot, base.rank(), records)?;
    if first.suspects.is_empty() {
        return Err(RecordError::NoSuspects { source_name: first.source.clone() });
    }
    if let Some(other) = records.iter().find(|record| record.suspects != first.suspects) {
        let (first, other) = (first.source.clone(), other.source.clone());
        return Err(RecordError::Different { first, other, what: "suspects" });
    }
    let (records, _) = ordered(records);
    let search = SuspectSearch::new(robot, &base, &records)?;
    search.diagnosis(&records)
}

/// Columns of strangers' records are those of their suspects.
fn require_columns(robot: &Robot, rank: usize, records: &[&Record]) -> Result<(), RecordError> {
    for record in records {
        let wrong = |what: &str| {
            let message =
                format!("{}: {what} that `{}` does not have", record.source, robot.name());
            Err(RecordError::Malformed { message })
        };
        let mut width = rank;
        for suspect in &record.suspects {
            let effect = effects::by_name(&suspect.effect).map_err(IdentifyError::from)?;
            if suspect.joint >= robot.dof() || suspect.constants.len() != effect.constants().len() {
                return wrong("a suspect");
            }
            width += effect.parameters().len();
        }
        let mut factors = record.blocks.iter().flat_map(|block| &block.suspected);
        if factors.any(|factor| {
            factor.joint >= robot.dof() || factor.columns.last().is_some_and(|k| *k >= width)
        }) {
            return wrong("columns of suspects");
        }
    }
    Ok(())
}

/// A suspect with its columns.
struct SuspectColumns {
    suspect: Suspect,
    effect: Arc<dyn Effect>,
    columns: std::ops::Range<usize>,
}

struct SuspectSearch {
    candidates: Vec<SuspectColumns>,
    /// Number of base parameters, of columns with those of suspects.
    rank: usize,
    width: usize,
    /// Factors of each part.
    parts: Vec<Vec<JointFactor>>,
    /// Per joint: noise level of rows in motion and at rest, N·m (N); infinite where there are
    /// none.
    levels: Vec<[f64; 2]>,
    /// Per part: weighted products of all columns and the torque.
    products: Vec<Mat<f64>>,
    /// Of all parts.
    all: Mat<f64>,
}

/// A part as the fit to the others predicts it.
#[derive(Clone)]
struct Predicted {
    /// Parameters of that fit.
    values: Vec<f64>,
    /// Per joint, (N·m)² (N²).
    squares: Vec<f64>,
}

/// Each part.
type Errors = Vec<Predicted>;

/// Something that is not taken yet, at its best constants.
#[derive(Clone, Copy)]
struct Open {
    candidate: usize,
    judgement: Judgement,
    is_sure: bool,
}

/// Symbol, unit, value and standard deviation of a parameter.
type FittedParameter = (&'static str, &'static str, f64, f64);

impl SuspectSearch {
    fn new(robot: &Robot, base: &BaseParameters, records: &[&Record]) -> Result<Self, RecordError> {
        let rank = base.rank();
        let mut width = rank;
        let mut candidates = Vec::new();
        for suspect in &records[0].suspects {
            let effect = effects::by_name(&suspect.effect).map_err(IdentifyError::from)?;
            let columns = width..width + effect.parameters().len();
            width = columns.end;
            candidates.push(SuspectColumns { suspect: suspect.clone(), effect, columns });
        }
        let places: Vec<_> = records.iter().map(|record| place_of(record)).collect();
        let of_blocks = parts_of_blocks(&places, PARTS);
        let mut of_parts: Vec<Vec<&JointFactor>> = vec![vec![]; PARTS];
        for (record, of_blocks) in records.iter().zip(&of_blocks) {
            for (block, part) in record.blocks.iter().zip(of_blocks) {
                of_parts[*part].extend(&block.suspected);
            }
        }
        let parts: Vec<Vec<JointFactor>> =
            of_parts.into_iter().filter(|part| !part.is_empty()).map(stacked).collect();
        let factors: Vec<JointFactor> = stacked(parts.iter().flatten())
            .iter()
            .map(|factor| restricted(factor, rank, &[]))
            .collect();
        let first = LeastSquares::new(Method::Wls).solve_unknowns(&factors, &vec![0.0; rank]);
        let mut levels = vec![[f64::INFINITY; 2]; robot.dof()];
        for (factor, weight) in factors.iter().zip(&first.map_err(IdentifyError::from)?.weights) {
            levels[factor.joint][usize::from(factor.resting)] = *weight;
        }
        let products: Vec<Mat<f64>> =
            parts.iter().map(|part| products_of(part, &levels, width)).collect();
        let mut all = Mat::zeros(width + 1, width + 1);
        products.iter().for_each(|part| all += part);
        Ok(Self { candidates, rank, width, parts, levels, products, all })
    }

    /// The fit to all parts but one, or to all, with some candidates; zero for the columns of the
    /// others.
    fn values(&self, taken: &[usize], left_out: Option<usize>) -> Vec<f64> {
        let extra = taken.iter().flat_map(|candidate| self.candidates[*candidate].columns.clone());
        let columns: Vec<usize> = (0..self.rank).chain(extra).collect();
        let known = |i: usize, j: usize| {
            self.all[(i, j)] - left_out.map_or(0.0, |part| self.products[part][(i, j)])
        };
        let size: Vec<f64> =
            columns.iter().map(|k| known(*k, *k).max(f64::MIN_POSITIVE).sqrt()).collect();
        let entry = |i: usize, j: usize| {
            known(columns[i], columns[j]) / (size[i] * size[j]) + if i == j { RIDGE } else { 0.0 }
        };
        let mut values = vec![0.0; self.width];
        if let Some(root) = cholesky(Mat::from_fn(columns.len(), columns.len(), entry).as_ref()) {
            let mut right =
                Mat::from_fn(columns.len(), 1, |i, _| known(columns[i], self.width) / size[i]);
            solve_lower_triangular_in_place(root.transpose(), right.as_mut(), Par::Seq);
            solve_upper_triangular_in_place(root.as_ref(), right.as_mut(), Par::Seq);
            columns.iter().enumerate().for_each(|(i, k)| values[*k] = right[(i, 0)] / size[i]);
        }
        values
    }

    /// Errors on each part of the fit to the others, with some candidates.
    fn errors(&self, taken: &[usize]) -> Errors {
        let of_part = |part: usize| {
            let values = self.values(taken, Some(part));
            let mut squares = vec![0.0; self.levels.len()];
            let moving = self.parts[part].iter().filter(|factor| !factor.resting);
            moving
                .for_each(|factor| squares[factor.joint] += residual_norm(factor, &values).powi(2));
            Predicted { values, squares }
        };
        (0..self.parts.len()).map(of_part).collect()
    }

    /// Whether the last of some candidates comes out as its effect can be, friction not negative.
    fn is_plausible(&self, taken: &[usize]) -> bool {
        taken.last().is_none_or(|last| {
            let SuspectColumns { effect, columns, .. } = &self.candidates[*last];
            effect.is_plausible(&self.values(taken, None)[columns.clone()])
        })
    }

    /// What errors `after` save of `before`, all joints in units of their noise, as a share of
    /// those of the joint.
    fn judge(&self, joint: usize, before: &Errors, after: &Errors) -> Judgement {
        let weight = |joint: usize| self.levels[joint][0].powi(-2);
        let pairs = before.iter().zip(after).map(|(before, after)| {
            let (before, after) = (&before.squares, &after.squares);
            let saved: f64 = (0..before.len())
                .filter(|j| weight(*j) > 0.0)
                .map(|j| weight(j) * (before[j] - after[j]))
                .sum();
            let own = weight(joint) * before[joint];
            (own, own - saved)
        });
        Judgement::of(&pairs.collect::<Vec<_>>())
    }

    /// Whether what errors `after` save of `before` is no chance. It matters, parts agree on it,
    /// Student's t for as few as they are, the best of them does not carry it alone, and it helps
    /// wherever it acts, as [`Self::where_it_acts`] says.
    fn is_sure(&self, joint: usize, before: &Errors, after: &Errors) -> bool {
        let judged = self.judge(joint, before, after);
        if judged.gain <= MATTERS || judged.deviate() <= SURE {
            return false;
        }
        let falls: Vec<f64> =
            before.iter().zip(after).map(|(b, a)| b.squares[joint] - a.squares[joint]).collect();
        let best = (0..falls.len()).max_by(|a, b| falls[*a].total_cmp(&falls[*b])).unwrap_or(0);
        let others = |errors: &Errors| -> Errors {
            let others = errors.iter().enumerate().filter(|(part, _)| *part != best);
            others.map(|(_, predicted)| predicted.clone()).collect()
        };
        self.judge(joint, &others(before), &others(after)).is_better()
            && self.where_it_acts(joint, before, after) > SURE
    }

    /// The fall of a joint's squared error in its standard deviations. If the larger model is right
    /// the fall in each part is its share of the squares of what the two predict differently, and
    /// varies with the noise by four times that.
    fn where_it_acts(&self, joint: usize, before: &Errors, after: &Errors) -> f64 {
        let variance = after.iter().map(|part| part.squares[joint]).sum::<f64>()
            / f64::max(self.rows(joint) as f64, 1.0);
        if variance <= 0.0 {
            return f64::INFINITY;
        }
        let of_part = |((part, before), after): ((&Vec<JointFactor>, &Predicted), &Predicted)| {
            let moving = part.iter().filter(|factor| factor.joint == joint && !factor.resting);
            let apart: f64 =
                moving.map(|factor| difference(factor, &before.values, &after.values)).sum();
            ((before.squares[joint] - after.squares[joint]) / variance, apart / variance)
        };
        let parts: Vec<(f64, f64)> =
            self.parts.iter().zip(before).zip(after).map(of_part).collect();
        let (fall, size) =
            parts.iter().fold((0.0, 0.0), |(fall, size), part| (fall + part.0, size + part.1));
        let rate = if size > 0.0 { fall / size } else { 0.0 };
        let scatter: f64 = parts.iter().map(|(fall, size)| (fall - rate * size).powi(2)).sum();
        fall / (4.0 * size).max(scatter).sqrt().max(f64::MIN_POSITIVE)
    }

    /// Rows of a joint in motion.
    fn rows(&self, joint: usize) -> usize {
        let own =
            self.parts.iter().flatten().filter(|factor| factor.joint == joint && !factor.resting);
        own.map(|factor| factor.rows).sum()
    }

    fn is_like(&self, one: usize, other: usize) -> bool {
        let [one, other] = [one, other].map(|k| &self.candidates[k].suspect);
        (&one.effect, one.joint) == (&other.effect, other.joint)
    }

    /// Of each effect at each joint that is not taken and can be what the logs make it: what its
    /// best constants save.
    fn open(&self, taken: &[usize], before: &Errors) -> Vec<Open> {
        let mut best: Vec<Open> = Vec::new();
        let fresh =
            (0..self.candidates.len()).filter(|k| !taken.iter().any(|own| self.is_like(*own, *k)));
        for candidate in fresh {
            let joint = self.candidates[candidate].suspect.joint;
            if self.levels[joint][0].is_infinite() {
                continue;
            }
            let with: Vec<usize> = taken.iter().copied().chain([candidate]).collect();
            if !self.is_plausible(&with) {
                continue;
            }
            let after = self.errors(&with);
            let judgement = self.judge(joint, before, &after);
            let own = Open { candidate, judgement, is_sure: self.is_sure(joint, before, &after) };
            match best.iter_mut().find(|other| self.is_like(other.candidate, candidate)) {
                Some(other) if judgement.gain > other.judgement.gain => *other = own,
                Some(_) => {}
                None => best.push(own),
            }
        }
        best.sort_by(|a, b| b.judgement.gain.total_cmp(&a.judgement.gain));
        best
    }

    fn diagnosis(&self, records: &[&Record]) -> Result<RecordDiagnosis, RecordError> {
        let plain = self.errors(&[]);
        let (mut taken, mut with): (Vec<usize>, Errors) = (Vec::new(), plain.clone());
        let mut alternatives: Vec<Vec<usize>> = Vec::new();
        let rest = loop {
            let open = self.open(&taken, &with);
            let Some(Open { candidate: best, judgement: judged, .. }) =
                open.iter().find(|one| one.is_sure).copied()
            else {
                break open;
            };
            if taken.len() == MOST {
                break open;
            }
            let joint = self.candidates[best].suspect.joint;
            let as_good = |other: &&Open| {
                other.candidate != best
                    && self.candidates[other.candidate].suspect.joint == joint
                    && other.judgement.gain >= judged.gain - judged.standard_error
            };
            alternatives.push(open.iter().filter(as_good).map(|other| other.candidate).collect());
            taken.push(best);
            with = self.errors(&taken);
        };
        // What was taken up early can be the shadow of what came later.
        let without = |taken: &[usize], k: usize| {
            let others: Vec<usize> =
                taken.iter().copied().filter(|other| *other != taken[k]).collect();
            self.errors(&others)
        };
        let joint_of = |candidate: usize| self.candidates[candidate].suspect.joint;
        while let Some(k) = (0..taken.len())
            .find(|k| !self.is_sure(joint_of(taken[*k]), &without(&taken, *k), &with))
        {
            taken.remove(k);
            alternatives.remove(k);
            with = self.errors(&taken);
        }
        let parameters = self.parameters(&taken, records)?;
        let mean_root = |errors: &Errors| -> Vec<f64> {
            let sum = |joint: usize| errors.iter().map(|part| part.squares[joint]).sum::<f64>();
            (0..self.levels.len())
                .map(|joint| (sum(joint) / f64::max(self.rows(joint) as f64, 1.0)).sqrt())
                .collect()
        };
        let left_out_errors = [mean_root(&plain), mean_root(&with)];
        let going_on = going_on(records, self.levels.len());
        // What was found does not go on any more.
        let explained = |joint: usize| {
            1.0 - (left_out_errors[1][joint] / left_out_errors[0][joint].max(f64::MIN_POSITIVE))
                .powi(2)
        };
        let unexplained = |joint: usize| {
            let explained = explained(joint).clamp(0.0, 1.0);
            ((going_on[joint] - explained) / (1.0 - explained).max(f64::MIN_POSITIVE))
                .clamp(0.0, 1.0)
        };
        let found = taken.iter().enumerate().map(|(k, candidate)| SuspectTest {
            suspect: self.candidates[*candidate].suspect.clone(),
            judgement: self.judge(joint_of(*candidate), &without(&taken, k), &with),
            found: true,
            parameters: parameters[k].clone(),
            alternatives: alternatives[k]
                .iter()
                .map(|other| self.candidates[*other].suspect.clone())
                .collect(),
            mostly_unexplained: going_on[joint_of(*candidate)]
                > 2.0 * explained(joint_of(*candidate)),
        });
        let others = rest.into_iter().filter(|one| !taken.contains(&one.candidate));
        let others = others.map(|Open { candidate, judgement, .. }| SuspectTest {
            suspect: self.candidates[candidate].suspect.clone(),
            judgement,
            found: false,
            parameters: vec![],
            alternatives: vec![],
            mostly_unexplained: false,
        });
        let tests = found.chain(others).collect();
        let unexplained = (0..self.levels.len()).map(unexplained).collect();
        Ok(RecordDiagnosis { tests, left_out_errors, unexplained })
    }

    /// Parameters of what was found, fitted to all rows beside the base parameters, by weighted
    /// least squares. What the residual remembers is that of each record's own solution, without
    /// the effects: standard deviations are rather too large.
    fn parameters(
        &self,
        taken: &[usize],
        records: &[&Record],
    ) -> Result<Vec<Vec<FittedParameter>>, RecordError> {
        let extra: Vec<usize> = taken
            .iter()
            .flat_map(|candidate| self.candidates[*candidate].columns.clone())
            .collect();
        let all = stacked(self.parts.iter().flatten());
        let factors: Vec<JointFactor> =
            all.iter().map(|factor| restricted(factor, self.rank, &extra)).collect();
        let unknowns = self.rank + extra.len();
        let mut solver = LeastSquares::new(Method::Wls);
        let plain = stacked(records.iter().flat_map(|record| factors_of(record)));
        let memory = correlation(records, &plain, &records[0].center);
        let of = |factor: &JointFactor| {
            let same = |other: &JointFactor| {
                (other.joint, other.resting) == (factor.joint, factor.resting)
            };
            plain.iter().position(same).map_or(1.0, |index| memory[index])
        };
        solver.correlation = Some(factors.iter().map(of).collect());
        let estimate =
            solver.solve_unknowns(&factors, &vec![0.0; unknowns]).map_err(IdentifyError::from)?;
        let deviations = estimate.standard_deviations();
        let mut next = self.rank;
        let mut of_candidate = |candidate: &usize| {
            let SuspectColumns { effect, .. } = &self.candidates[*candidate];
            let own = effect.parameters().iter().map(|parameter| {
                next += 1;
                (parameter.symbol, parameter.unit, estimate.values[next - 1], deviations[next - 1])
            });
            own.collect()
        };
        Ok(taken.iter().map(&mut of_candidate).collect())
    }
}

/// A factor with the base columns and some of the others, which come after them in this order.
fn restricted(factor: &JointFactor, rank: usize, extra: &[usize]) -> JointFactor {
    let place = |column: usize| match column < rank {
        true => Some(column),
        false => Some(rank + extra.iter().position(|own| *own == column)?),
    };
    let count = factor.columns.len();
    let kept: Vec<usize> = (0..count).filter(|k| place(factor.columns[*k]).is_some()).collect();
    let columns = kept.iter().filter_map(|k| place(factor.columns[*k])).collect();
    let column = |j: usize| kept.get(j).copied().unwrap_or(count);
    let all = Mat::from_fn(count + 1, kept.len() + 1, |i, j| factor.factor[(i, column(j))]);
    JointFactor { columns, factor: crate::linalg::triangle(all.as_ref()).into(), ..factor.clone() }
}

/// Squares of what two fits predict differently on the rows of a factor, (N·m)² (N²).
fn difference(factor: &JointFactor, one: &[f64], other: &[f64]) -> f64 {
    let apart: Vec<f64> =
        factor.columns.iter().map(|column| one[*column] - other[*column]).collect();
    let row = |i: usize| (i..apart.len()).map(|j| factor.factor[(i, j)] * apart[j]).sum::<f64>();
    (0..apart.len()).map(|i| row(i).powi(2)).sum()
}

/// Share of each joint's squared residual in motion, that of each log's own solution, which it has
/// in common with that of rows so much later that noise has forgotten itself.
fn going_on(records: &[&Record], joints: usize) -> Vec<f64> {
    let of_joint = |joint: usize| {
        let mut means = [0.0; 2];
        for (mean, group) in means.iter_mut().zip([0, LONGER_THAN_NOISE]) {
            let moving = records.iter().flat_map(|record| &record.memory);
            let moving = moving.filter(|memory| memory.joint == joint && !memory.resting);
            let sums = moving.filter_map(|memory| {
                let sum = memory.sums.get(group)?;
                let last = sum.ncols().checked_sub(1)?;
                Some((sum[(last, last)], memory.counts.get(group).copied()?))
            });
            let (sum, count) =
                sums.fold((0.0, 0), |(sum, count), own| (sum + own.0, count + own.1));
            *mean = sum / f64::max(count as f64, 1.0);
        }
        if means[0] > 0.0 { (means[1] / means[0]).clamp(0.0, 1.0) } else { 0.0 }
    };
    (0..joints).map(of_joint).collect()
}

/// Products of all columns and the torque, each joint in units of its noise.
fn products_of(factors: &[JointFactor], levels: &[[f64; 2]], width: usize) -> Mat<f64> {
    let mut products = Mat::zeros(width + 1, width + 1);
    for factor in factors {
        let weight = levels[factor.joint][usize::from(factor.resting)].powi(-2);
        if weight == 0.0 {
            continue;
        }
        let gram = factor.factor.transpose() * &*factor.factor;
        let place = |k: usize| factor.columns.get(k).copied().unwrap_or(width);
        for i in 0..gram.nrows() {
            (0..gram.ncols()).for_each(|j| products[(place(i), place(j))] += weight * gram[(i, j)]);
        }
    }
    products
}
