//! Parts of the data predicted from the others: by the robot file, and by what is identified.

use faer::Mat;

use super::least_squares::{residual_norm, weighted_gram};
use super::prior::WIDTHS;
use super::{JointFactor, Judgement, ParameterPrior};
use crate::linalg::cholesky;

/// Parts of the data, each of which is predicted from the others.
#[derive(Debug)]
pub struct LeftOut<'a> {
    parts: &'a [Vec<JointFactor>],
    /// Noise level of the rows of each factor, N·m (N); infinite for those that are left out.
    levels: Vec<Vec<f64>>,
    normal: Vec<Normal>,
    all: Normal,
}

impl<'a> LeftOut<'a> {
    /// - `parts`: factors of parts of the data, [`Observation::parts`](super::Observation::parts)
    /// - `level`: noise level of the rows of a factor, N·m (N); infinite leaves them out
    /// - `rank`: number of base parameters
    pub fn new(parts: &'a [Vec<JointFactor>], level: impl Fn(&JointFactor) -> f64, rank: usize) -> Self {
        let levels: Vec<Vec<f64>> = parts.iter().map(|part| part.iter().map(&level).collect()).collect();
        let pairs = parts.iter().zip(&levels);
        let normal: Vec<Normal> = pairs.map(|(part, levels)| Normal::of(part, levels, rank)).collect();
        let mut all = Normal { information: Mat::zeros(rank, rank), projection: Mat::zeros(rank, 1) };
        normal.iter().for_each(|part| all.add(part, 1.0));
        Self { parts, levels, normal, all }
    }

    /// Base parameters by the posterior mean of all parts but one; none where rounding makes the equations indefinite.
    fn without(&self, prior: &ParameterPrior) -> Vec<Option<Vec<f64>>> {
        let rows = prior.rows();
        let rank = prior.mean().len();
        let p = rows.as_ref().subcols(0, rank);
        let mut all = self.all.clone();
        all.add(&Normal { information: p.transpose() * p, projection: p.transpose() * rows.col(rank).as_mat() }, 1.0);
        let without = |normal: &Normal| {
            let mut others = all.clone();
            others.add(normal, -1.0);
            others.solution(prior)
        };
        self.normal.iter().map(without).collect()
    }

    /// Squares of the residual in motion that `values` leave in a part, in units of the noise.
    fn loss(&self, part: usize, values: &[f64]) -> f64 {
        let pairs = self.parts[part].iter().zip(&self.levels[part]);
        let used = pairs.filter(|(factor, level)| !factor.resting && level.is_finite());
        used.map(|(factor, level)| (residual_norm(factor, values) / level).powi(2)).sum()
    }

    /// The prior with the relative deviation of bodies under which parts of the data are predicted best from the others.
    /// Of those that are as good, but for the standard error, the one nearest to what `prior` has, which may be the most
    /// probable one ([`ParameterPrior::chosen_by`]).
    #[must_use]
    pub fn choose(&self, prior: &ParameterPrior) -> ParameterPrior {
        let losses = |deviation: f64| -> Vec<f64> {
            let without = self.without(&prior.clone().with_relative_deviation(deviation));
            let loss = |(part, values): (usize, Option<Vec<f64>>)| values.map_or(f64::MAX, |v| self.loss(part, &v));
            without.into_iter().enumerate().map(loss).collect()
        };
        let losses: Vec<Vec<f64>> = WIDTHS.iter().map(|deviation| losses(*deviation)).collect();
        let total = |index: &usize| losses[*index].iter().sum::<f64>();
        let best = (0..WIDTHS.len()).min_by(|a, b| total(a).total_cmp(&total(b))).expect("several widths");
        let as_good = |index: &usize| {
            let pairs: Vec<(f64, f64)> = losses[*index].iter().copied().zip(losses[best].iter().copied()).collect();
            *index == best || !Judgement::of(&pairs).is_better()
        };
        let distance = |index: usize| (WIDTHS[index] / prior.relative_deviation()).ln().abs();
        let good = (0..WIDTHS.len()).filter(as_good);
        let chosen = good.min_by(|a, b| distance(*a).total_cmp(&distance(*b))).expect("the best one");
        prior.clone().with_relative_deviation(WIDTHS[chosen])
    }

    /// Whether identified parameters predict what they have not seen better than the robot file: per joint what they gain, in
    /// squares of the residual in motion.
    pub fn judge_against_file(&self, prior: &ParameterPrior, joints: usize) -> Vec<Judgement> {
        let mut errors = vec![Vec::with_capacity(self.parts.len()); joints];
        for ((part, levels), values) in self.parts.iter().zip(&self.levels).zip(self.without(prior)) {
            let Some(values) = values else { continue };
            let used = part.iter().zip(levels).filter(|(factor, level)| !factor.resting && level.is_finite());
            for (factor, _) in used {
                let square = |values: &[f64]| residual_norm(factor, values).powi(2);
                errors[factor.joint].push((square(prior.mean()), square(&values)));
            }
        }
        errors.iter().map(|errors| Judgement::of(errors)).collect()
    }
}

/// Normal equations.
#[derive(Clone, Debug)]
struct Normal {
    information: Mat<f64>,
    projection: Mat<f64>,
}

impl Normal {
    fn of(factors: &[JointFactor], levels: &[f64], rank: usize) -> Self {
        let weights: Vec<f64> = levels.iter().map(|level| level.powi(-2)).collect();
        let used: Vec<bool> = weights.iter().map(|weight| *weight > 0.0).collect();
        let mut projection = Mat::zeros(rank, 1);
        for ((factor, weight), _) in factors.iter().zip(&weights).zip(&used).filter(|(_, used)| **used) {
            let count = factor.columns.len();
            for (k, &column) in factor.columns.iter().enumerate() {
                let products = (0..=k).map(|i| factor.factor[(i, k)] * factor.factor[(i, count)]);
                projection[(column, 0)] += weight * products.sum::<f64>();
            }
        }
        Self { information: weighted_gram(factors, &used, &weights, rank), projection }
    }

    fn add(&mut self, other: &Self, sign: f64) {
        self.information += faer::Scale(sign) * &other.information;
        self.projection += faer::Scale(sign) * &other.projection;
    }

    /// `None` if the equations are not definite by rounding.
    fn solution(&self, prior: &ParameterPrior) -> Option<Vec<f64>> {
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
                let known = (0..rank).filter_map(|j| kept(j).map(|value| self.information[(i, j)] * value));
                (self.projection[(i, 0)] - known.sum::<f64>()) * scale[i]
            }
        });
        let sequential = faer::Par::Seq;
        faer::linalg::triangular_solve::solve_lower_triangular_in_place(root.transpose(), values.as_mut(), sequential);
        faer::linalg::triangular_solve::solve_upper_triangular_in_place(root.as_ref(), values.as_mut(), sequential);
        Some((0..rank).map(|k| values[(k, 0)] * scale[k]).collect())
    }
}
