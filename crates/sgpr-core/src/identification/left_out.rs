//! Parts of the data predicted from the others: by the robot file, and by what is identified.

use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Mat, Par};

use super::least_squares::{residual_norm, stack, weighted_gram};
use super::prior::PULLS;
use super::{IdentificationError, JointFactor, Judgement, ParameterPrior};
use crate::intervals::{HALF_INTERVAL_95, WITHIN_ONE_DEVIATION, place_of_share};
use crate::linalg::Matrix;
use crate::linalg::cholesky;

/// Parts of the data, each of which is predicted from the others.
#[derive(Debug)]
pub struct LeftOut<'a> {
    parts: &'a [Vec<JointFactor>],
    /// Noise level of the rows of each factor, N·m (N); infinite for those that are left out.
    levels: Vec<Vec<f64>>,
    normal: Vec<PartEquations>,
    /// Number of base parameters.
    rank: usize,
}

/// A part of the data, and the others.
pub(super) struct Split<'a> {
    /// Weighted triangle of the others.
    pub others: Matrix,
    /// Factors of the part, each with its noise level.
    pub part: Vec<(&'a JointFactor, f64)>,
}

impl<'a> LeftOut<'a> {
    /// - `parts`: factors of parts of the data, [`Observation::parts`](super::Observation::parts)
    /// - `level`: noise level of the rows of a factor, N·m (N); infinite leaves them out
    /// - `rank`: number of base parameters
    pub fn new(
        parts: &'a [Vec<JointFactor>],
        level: impl Fn(&JointFactor) -> f64,
        rank: usize,
    ) -> Self {
        let levels: Vec<Vec<f64>> =
            parts.iter().map(|part| part.iter().map(&level).collect()).collect();
        let pairs = parts.iter().zip(&levels);
        let normal = pairs.map(|(part, levels)| PartEquations::of(part, levels, rank)).collect();
        Self { parts, levels, normal, rank }
    }

    /// Each part in turn, beside all others.
    ///
    /// # Errors
    /// [`IdentificationError::NoData`] with fewer than two parts.
    pub(super) fn splits(&self) -> Result<impl Iterator<Item = Split<'a>>, IdentificationError> {
        if self.parts.len() < 2 {
            return Err(IdentificationError::NoData);
        }
        Ok((0..self.parts.len()).map(|index| {
            let others = || (0..self.parts.len()).filter(move |other| *other != index);
            let factors: Vec<JointFactor> =
                others().flat_map(|other| self.parts[other].iter().cloned()).collect();
            let noise: Vec<f64> =
                others().flat_map(|other| self.levels[other].iter().copied()).collect();
            let part = self.parts[index].iter().zip(self.levels[index].iter().copied()).collect();
            Split { others: stack(&factors, self.rank, &noise).into(), part }
        }))
    }

    /// Base parameters by data and prior of all parts but one, each part in turn; none where
    /// rounding makes the equations indefinite.
    fn without(&self, prior: &ParameterPrior) -> Vec<Option<Vec<f64>>> {
        let by = |part: usize| Some(self.without_parts(prior, |other| other == part)?.values);
        (0..self.normal.len()).map(by).collect()
    }

    /// Base parameters by data and prior of all parts but some; none where rounding makes the
    /// equations indefinite.
    fn without_parts(
        &self,
        prior: &ParameterPrior,
        left_out: impl Fn(usize) -> bool,
    ) -> Option<NormalSolution> {
        let rows = prior.rows();
        let rank = prior.mean().len();
        let p = rows.as_ref().subcols(0, rank);
        let information = p.transpose() * p;
        let mut data =
            PartEquations { information: Mat::zeros(rank, rank), projection: Mat::zeros(rank, 1) };
        let others = self.normal.iter().enumerate().filter(|(part, _)| !left_out(*part));
        others.for_each(|(_, part)| data.add(part));
        let mut center = prior.mean().to_vec();
        let mut solution = None;
        for _ in 0..PULLS {
            let mean = Mat::from_fn(rank, 1, |k, _| center[k]);
            let mut all =
                PartEquations { information: information.clone(), projection: &information * mean };
            all.add(&data);
            let found = all.solution(prior)?;
            center.clone_from(&found.values);
            solution = Some(found);
        }
        solution
    }

    /// How wide intervals have to be for other motions. Runs of up to half of the parts are left
    /// out in turn, and what uncertain parameters bring to their errors is compared with what is
    /// expected of them, run by run and joint by joint. What a model lacks is not noise: it moves
    /// the parameters in the same way at every sample of a motion, which only other motions show.
    /// That of the noise for fewer than two parts.
    ///
    /// - `noise`: of the rows of a factor, N·m (N)
    ///
    /// Source: R. T. Birge, The calculation of errors by the method of least squares, Physical
    /// Review 40 (1932), the ratio of external to internal consistency; here its distribution, for
    /// errors that run off at some joints.
    pub fn dispersion(
        &self,
        prior: &ParameterPrior,
        noise: impl Fn(&JointFactor) -> f64,
    ) -> Dispersion {
        let (mut ratios, mut moving) = (Vec::new(), 0);
        for first in 0..self.parts.len() {
            let run = half_run(first, self.parts.len());
            let Some(solution) = self.without_parts(prior, |part| run.contains(&part)) else {
                continue;
            };
            let mut joints: Vec<(usize, Missed)> = Vec::new();
            for &part in &run {
                let used = self.parts[part].iter().zip(&self.levels[part]);
                for (factor, _) in
                    used.filter(|(factor, level)| !factor.resting && level.is_finite())
                {
                    let missed = Missed {
                        square: residual_norm(factor, &solution.values).powi(2),
                        noise: factor.rows as f64 * noise(factor).powi(2),
                        of_parameters: solution.spread(factor, prior),
                    };
                    match joints.iter_mut().find(|(joint, _)| *joint == factor.joint) {
                        Some((_, sum)) => sum.add(&missed),
                        None => joints.push((factor.joint, missed)),
                    }
                }
            }
            moving = moving.max(joints.len());
            ratios.extend(
                joints.iter().map(|(_, missed)| missed.ratio()).filter(|ratio| ratio.is_finite()),
            );
        }
        Dispersion::of(ratios, moving)
    }

    /// Whether parts are predicted better from the others with the prior `after` than with
    /// `before`, motion in units of its noise. Parts count alike: one in which an estimate runs off
    /// would hide all others.
    pub fn judge(&self, before: &ParameterPrior, after: &ParameterPrior) -> Judgement {
        self.judge_each(before, std::slice::from_ref(after))[0]
    }

    /// The same of several priors.
    pub fn judge_each(&self, before: &ParameterPrior, after: &[ParameterPrior]) -> Vec<Judgement> {
        let before = self.squares(before);
        let judgement = |after: &ParameterPrior| {
            let pairs = before.iter().zip(self.squares(after));
            let shares = pairs.filter_map(|(before, after)| {
                let (before, after) = ((*before)?, after?);
                let both = before + after;
                (both > 0.0 && both.is_finite()).then(|| (before / both, after / both))
            });
            Judgement::of(&shares.collect::<Vec<_>>())
        };
        after.iter().map(judgement).collect()
    }

    /// Root mean square of what is left of a joint's rows in motion on parts, each predicted from
    /// the others, N·m (N); none for fewer than two parts.
    pub fn error(&self, prior: &ParameterPrior) -> impl Fn(usize) -> Option<f64> + use<> {
        let mut sums: Vec<(f64, usize)> = Vec::new();
        for (part, values) in self.parts.iter().zip(self.without(prior)) {
            let Some(values) = values.filter(|_| self.parts.len() > 1) else { continue };
            for factor in part.iter().filter(|factor| !factor.resting) {
                sums.resize(sums.len().max(factor.joint + 1), (0.0, 0));
                sums[factor.joint].0 += residual_norm(factor, &values).powi(2);
                sums[factor.joint].1 += factor.rows;
            }
        }
        move |joint| {
            sums.get(joint)
                .filter(|(_, rows)| *rows > 0)
                .map(|(square, rows)| (square / *rows as f64).sqrt())
        }
    }

    /// Squares of what is left of each part in motion, in units of its noise.
    fn squares(&self, prior: &ParameterPrior) -> Vec<Option<f64>> {
        let of_part = |part: usize, values: &[f64]| -> f64 {
            let used = self.parts[part].iter().zip(&self.levels[part]);
            let used = used.filter(|(factor, level)| !factor.resting && level.is_finite());
            used.map(|(factor, level)| (residual_norm(factor, values) / level).powi(2)).sum()
        };
        let estimates = self.without(prior).into_iter().enumerate();
        estimates.map(|(part, values)| Some(of_part(part, &values?))).collect()
    }

    /// Whether identified parameters predict what they have not seen better than the robot file:
    /// per joint what they gain, in squares of the residual in motion, of a joint that never moves
    /// at rest.
    pub fn judge_against_file(&self, prior: &ParameterPrior, joints: usize) -> Vec<Judgement> {
        let mut errors = vec![Vec::with_capacity(self.parts.len()); joints];
        let moves = |joint| {
            self.parts.iter().flatten().any(|factor| factor.joint == joint && !factor.resting)
        };
        let moves: Vec<bool> = (0..joints).map(moves).collect();
        for ((part, levels), values) in self.parts.iter().zip(&self.levels).zip(self.without(prior))
        {
            let Some(values) = values else { continue };
            let counts = |(factor, level): &(&JointFactor, &f64)| match moves[factor.joint] {
                true => !factor.resting && level.is_finite(),
                false => true,
            };
            for (factor, _) in part.iter().zip(levels).filter(counts) {
                let square = |values: &[f64]| residual_norm(factor, values).powi(2);
                errors[factor.joint].push((square(prior.mean()), square(&values)));
            }
        }
        errors.iter().map(|errors| Judgement::of(errors)).collect()
    }
}

/// Up to half of so many parts, one after the other from `first` on, the first ones after the last.
pub(crate) fn half_run(first: usize, count: usize) -> Vec<usize> {
    (first..first + count / 2).map(|part| part % count).collect()
}

/// How wide intervals of what uncertain parameters bring are for motions that were not seen.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Dispersion {
    /// By what standard deviations have to be multiplied, at least one: those of two thirds of the
    /// joints then suffice in another motion.
    pub deviation: f64,
    /// Half the interval of 95 %, in these standard deviations: such that it suffices at 95 % of
    /// the joints there.
    pub half_interval_95: f64,
    /// The deviation for two thirds of the joints as they were seen.
    pub(crate) as_seen: f64,
}

/// Variance between a motion and two others, in what these two differ by: half of it is that of the
/// mean of the two.
const TWO_OTHERS: f64 = 1.5;

impl Dispersion {
    /// Of errors that are as large as noise makes them.
    pub const NONE: Self =
        Self { deviation: 1.0, half_interval_95: HALF_INTERVAL_95, as_seen: 1.0 };

    /// The excess over noise grows from halves of the logs to other motions: two halves are
    /// independent, and another motion differs from them as they do from each other. Runs of one
    /// set of logs miss the same joints, so that there are as many observations as joints: of n of
    /// them a share s suffices for a new one if s (n + 1) / n of them do.
    ///
    /// - `ratios`: of squared errors to what was expected of them, each of a joint in a run
    /// - `joints`: how many there are
    ///
    /// Source: J. Lei, M. G'Sell, A. Rinaldo, R. J. Tibshirani, L. Wasserman, Distribution-free
    /// predictive inference for regression, Journal of the American Statistical Association 113
    /// (2018), section 2, for the quantile of few.
    fn of(mut ratios: Vec<f64>, joints: usize) -> Self {
        if ratios.is_empty() {
            return Self::NONE;
        }
        ratios.sort_unstable_by(f64::total_cmp);
        let of_share = |share: f64| {
            let ratio = ratios[place_of_share(share, ratios.len())];
            (1.0 + TWO_OTHERS * (ratio - 1.0).max(0.0)).sqrt()
        };
        let few = 1.0 + 1.0 / joints as f64;
        let (deviation, tail) = (of_share(few * WITHIN_ONE_DEVIATION), of_share(few * 0.95));
        let as_seen = of_share(WITHIN_ONE_DEVIATION);
        Self { deviation, half_interval_95: HALF_INTERVAL_95 * tail / deviation, as_seen }
    }
}

/// Squares at a joint that were not seen, summed over rows, N²·m² (N²).
struct Missed {
    /// Of the error.
    square: f64,
    /// Expected from noise.
    noise: f64,
    /// Expected from uncertain parameters.
    of_parameters: f64,
}

impl Missed {
    fn add(&mut self, more: &Self) {
        self.square += more.square;
        self.noise += more.noise;
        self.of_parameters += more.of_parameters;
    }

    /// What parameters brought, in what was expected of them.
    fn ratio(&self) -> f64 {
        (self.square - self.noise).max(0.0) / self.of_parameters
    }
}

/// What normal equations say.
struct NormalSolution {
    values: Vec<f64>,
    /// R with RᵀR the information of the scaled parameters.
    root: Mat<f64>,
    /// What scaled parameters are multiplied by.
    scale: Vec<f64>,
}

impl NormalSolution {
    /// Sum of the variances that uncertain parameters bring to the rows of a factor.
    fn spread(&self, factor: &JointFactor, prior: &ParameterPrior) -> f64 {
        let count = factor.columns.len();
        // (Rᵀ)⁻¹ of the rows as columns: its square is the variance.
        let mut columns = Mat::zeros(self.scale.len(), count);
        for (place, &base) in
            factor.columns.iter().enumerate().filter(|(_, base)| !prior.kept().contains(base))
        {
            (0..count)
                .for_each(|i| columns[(base, i)] = self.scale[base] * factor.factor[(i, place)]);
        }
        solve_lower_triangular_in_place(self.root.transpose(), columns.as_mut(), Par::Seq);
        columns.squared_norm_l2()
    }
}

/// Normal equations.
#[derive(Clone, Debug)]
struct PartEquations {
    information: Mat<f64>,
    projection: Mat<f64>,
}

impl PartEquations {
    fn of(factors: &[JointFactor], levels: &[f64], rank: usize) -> Self {
        let weights: Vec<f64> = levels.iter().map(|level| level.powi(-2)).collect();
        let used: Vec<bool> = weights.iter().map(|weight| *weight > 0.0).collect();
        let mut projection = Mat::zeros(rank, 1);
        for ((factor, weight), _) in
            factors.iter().zip(&weights).zip(&used).filter(|(_, used)| **used)
        {
            let count = factor.columns.len();
            for (k, &column) in factor.columns.iter().enumerate() {
                let products = (0..=k).map(|i| factor.factor[(i, k)] * factor.factor[(i, count)]);
                projection[(column, 0)] += weight * products.sum::<f64>();
            }
        }
        Self { information: weighted_gram(factors, &used, &weights, rank), projection }
    }

    fn add(&mut self, other: &Self) {
        self.information += &other.information;
        self.projection += &other.projection;
    }

    /// `None` if the equations are not definite by rounding.
    fn solution(&self, prior: &ParameterPrior) -> Option<NormalSolution> {
        let rank = self.information.nrows();
        let kept = |k: usize| prior.kept().contains(&k).then(|| prior.mean()[k]);
        let scale: Vec<f64> = (0..rank).map(|k| self.information[(k, k)].sqrt().recip()).collect();
        let entry = |i: usize, j: usize| match (kept(i).is_some() || kept(j).is_some(), i == j) {
            (true, same) => f64::from(same),
            _ => self.information[(i, j)] * scale[i] * scale[j],
        };
        let root = cholesky(Mat::from_fn(rank, rank, entry).as_ref())?;
        let mut values = Mat::from_fn(rank, 1, |i, _| match kept(i) {
            Some(value) => value / scale[i],
            None => {
                let known =
                    (0..rank).filter_map(|j| kept(j).map(|value| self.information[(i, j)] * value));
                (self.projection[(i, 0)] - known.sum::<f64>()) * scale[i]
            }
        });
        solve_lower_triangular_in_place(root.transpose(), values.as_mut(), Par::Seq);
        solve_upper_triangular_in_place(root.as_ref(), values.as_mut(), Par::Seq);
        let values = (0..rank).map(|k| values[(k, 0)] * scale[k]).collect();
        Some(NormalSolution { values, root, scale })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_hold_for_the_joints_that_run_off() {
        let share = |count: usize, ratio: f64| vec![ratio; count];
        // As noise makes them, or by chance less: nothing is added.
        assert_eq!(Dispersion::of(share(20, 0.7), 20), Dispersion::NONE);
        assert_eq!(Dispersion::of(vec![], 0), Dispersion::NONE);
        // All alike: three times the variance on halves, four times on another motion; tails of
        // normal errors.
        let alike = Dispersion::of(share(20, 3.0), 20);
        assert!(
            (alike.deviation - 2.0).abs() < 1e-12 && (alike.half_interval_95 - 1.96).abs() < 1e-12
        );
        // One joint in ten runs off: it is in the interval of 95 %, not in the standard deviation.
        let one = Dispersion::of([share(18, 1.0), share(2, 17.0)].concat(), 20);
        assert!(
            one.deviation == 1.0 && (one.half_interval_95 - 5.0 * 1.96).abs() < 1e-12,
            "{one:?}"
        );
        // Of four joints one runs off in every run: three of four are no two thirds of a new
        // motion's joints, but of these.
        let few = Dispersion::of([share(15, 1.0), share(5, 17.0)].concat(), 4);
        assert!((few.deviation - 5.0).abs() < 1e-12 && few.as_seen == 1.0, "{few:?}");
    }
}
