//! Huber's M-estimator by iteratively reweighted least squares.
//!
//! A joint has a scale of its own in every log: what the parameters cannot describe is larger in
//! some motions than in others, such as that of rotors under large accelerations, and would pull
//! parameters from where calmer logs see them.
//!
//! Source: P. J. Huber, E. M. Ronchetti, Robust Statistics (2009), sections 7.3 (normal equations),
//! 7.8 (scale).

use faer::Mat;

use super::autocorrelation::Memory;
use super::estimator::{Estimator, EstimatorSetting, EstimatorTask};
use super::groups::Groups;
use super::least_squares::{Solution, floored, least_noise, stack, weighted_gram};
use super::{Equation, Equations, Estimate, IdentificationError, JointFactor};
use crate::linalg::TriangularFactor;

const MOST_ITERATIONS: usize = 100;

/// A step shorter than this, in standard deviations, moves nothing that could be told from noise.
const SMALL_STEP: f64 = 1e-4;

/// The median of |normal noise| is this share of its standard deviation.
pub(super) const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;

/// A log with fewer rows of a joint has the scale of all logs.
const FEWEST_ROWS: usize = 100;

/// Smallest scale of a joint in one log, of that in all: where parameters follow the rows of one
/// log, its residual is no measure of noise.
const SMALLEST_SHARE: f64 = 0.25;

/// Below this threshold, standard deviations, no row is left that tells how the estimate varies.
const SMALLEST_THRESHOLD: f64 = 1e-3;

/// Weighted least squares with rows that lie far off the others held down: Huber's weights, each
/// joint's scale in each log from the median of its residual, iterated. Setting: residuals count
/// linearly, not squared, beyond this many standard deviations; Huber's 1.345 loses 5 % where the
/// noise is normal.
pub static IRLS: Estimator = Estimator {
    setting: EstimatorSetting::new("THRESHOLD", 1.345),
    ..Estimator::new("irls", "iteratively reweighted (Huber) least squares", estimate)
};

fn estimate(
    task: EstimatorTask<'_, '_>,
    mut start: Estimate,
) -> Result<Estimate, IdentificationError> {
    let EstimatorTask { setting: threshold, equations, factors, nominal, .. } = task;
    if threshold.is_nan() || threshold < SMALLEST_THRESHOLD {
        let setting =
            "threshold of Huber's estimator, in standard deviations, at least a thousandth";
        return Err(IdentificationError::Setting { setting, value: threshold });
    }
    let used: Vec<bool> = start.weights.iter().map(|weight| weight.is_finite()).collect();
    let ones = used.iter().map(|used| if *used { 1.0 } else { f64::INFINITY }).collect();
    let huber = Huber { threshold, factors, group: Groups::of(factors), used, ones, nominal };
    let (values, scales, system) = huber.solve(equations, &mut start)?;
    let EstimateSpread { covariance, inflation, down } =
        huber.spread(equations, &values, &scales)?;

    let used = &huber.used;
    let rows: usize =
        factors.iter().zip(used).map(|(factor, used)| if *used { factor.rows } else { 0 }).sum();
    start
        .notes
        .push(format!("{:.1} % of the rows were held down", 100.0 * down as f64 / rows as f64));
    let counted =
        factors.iter().zip(used).filter(|(_, used)| **used).map(|(factor, _)| factor.rows as f64);
    let mean_memory =
        inflation.iter().zip(used).filter(|(_, used)| **used).map(|(inflation, _)| inflation);
    let memory = counted.zip(mean_memory).map(|(rows, inflation)| rows * inflation).sum::<f64>()
        / rows as f64;
    Ok(Estimate {
        values,
        covariance: covariance.into(),
        noise: scales.all.clone(),
        whitened: (faer::Scale(1.0 / memory.sqrt()) * system).into(),
        unit: memory.sqrt(),
        log_shares: scales.shares(),
        weights: scales
            .all
            .iter()
            .zip(used)
            .map(|(s, used)| if *used { *s } else { f64::INFINITY })
            .collect(),
        ..start
    })
}

/// Equations of which some are held down.
struct Huber<'a> {
    threshold: f64,
    factors: &'a [JointFactor],
    group: Groups,
    /// Which factors count, and the weights of rows that are scaled already: infinite for the
    /// others.
    used: Vec<bool>,
    ones: Vec<f64>,
    nominal: &'a [f64],
}

/// What an estimate is known to.
struct EstimateSpread {
    covariance: Mat<f64>,
    /// Per factor: rows that carry as much as one independent row.
    inflation: Vec<f64>,
    /// Rows that were held down.
    down: usize,
}

impl Huber<'_> {
    /// Values, the scales of their residuals, and the triangle that they solve; `start` counts the
    /// iterations.
    fn solve(
        &self,
        equations: &mut Equations<'_>,
        start: &mut Estimate,
    ) -> Result<(Vec<f64>, Scales, Mat<f64>), IdentificationError> {
        let Self { threshold, factors, group, used, .. } = self;
        let mut values = start.values.clone();
        let least = least_noise(&start.weights, factors);
        let mut scales = Scales::new(equations, factors, group, &values, &least)?;
        loop {
            start.iterations += 1;
            let mut weighted = empty(factors);
            let mut scaled_row = Vec::new();
            equations.for_each(|equation| {
                let Some(index) = group.index(&equation) else { return };
                let scale = scales.of(index, &equation);
                let size = equation.residual(&values).abs() / scale;
                let weight = if size > *threshold { (threshold / size).sqrt() } else { 1.0 };
                scaled_row.clear();
                scaled_row.extend(equation.row.iter().map(|value| value * weight / scale));
                weighted[index].push(&scaled_row);
            })?;
            let system = self.stacked(&weighted);
            let next = Solution::new(&system, self.nominal).values;
            let step = length_in_deviations(&system, &next, &values);
            values = next;
            let before = std::mem::replace(
                &mut scales,
                Scales::new(equations, factors, group, &values, &least)?,
            );
            let settled = step < SMALL_STEP && scales.change_since(&before, used) < SMALL_STEP;
            if settled || start.iterations > MOST_ITERATIONS {
                return Ok((values, scales, system));
            }
        }
    }

    /// Sandwich: the slope of Huber's function inside, its square outside, and the memory of what
    /// it lets through.
    fn spread(
        &self,
        equations: &mut Equations<'_>,
        values: &[f64],
        scales: &Scales,
    ) -> Result<EstimateSpread, IdentificationError> {
        let Self { factors, used, .. } = self;
        let threshold = self.threshold;
        let mut slope = empty(factors);
        let mut square = empty(factors);
        let mut memory = vec![Memory::default(); factors.len()];
        let mut down = 0usize;
        let steps: Vec<usize> =
            equations.trajectories().iter().map(|trajectory| trajectory.decimation).collect();
        let mut scaled_row = Vec::new();
        equations.for_each(|equation| {
            let Some(index) = self.group.index(&equation) else { return };
            let scale = scales.of(index, &equation);
            let size = equation.residual(values) / scale;
            let kept = size.clamp(-threshold, threshold);
            memory[index].push(
                equation.trajectory,
                equation.sample / steps[equation.trajectory],
                kept,
            );
            scaled_row.clear();
            scaled_row.extend(equation.row.iter().map(|value| value * kept / scale));
            square[index].push(&scaled_row);
            if size.abs() <= threshold {
                scaled_row.clear();
                scaled_row.extend(equation.row.iter().map(|value| value / scale));
                slope[index].push(&scaled_row);
            } else if used[index] {
                down += 1;
            }
        })?;
        let inside = Solution::new(&self.stacked(&slope), self.nominal);
        let inflation: Vec<f64> =
            memory.into_iter().map(Memory::rows_per_independent_row).collect();
        let outside =
            weighted_gram(&with_factors(factors, &square), used, &inflation, self.nominal.len());
        Ok(EstimateSpread { covariance: inside.sandwich(&outside), inflation, down })
    }

    /// The triangle of rows that are scaled already.
    fn stacked(&self, scaled: &[TriangularFactor]) -> Mat<f64> {
        stack(&with_factors(self.factors, scaled), self.nominal.len(), &self.ones)
    }
}

/// |R (new - old)| / sqrt(unknowns).
fn length_in_deviations(system: &Mat<f64>, new: &[f64], old: &[f64]) -> f64 {
    let unknowns = new.len();
    let row = |i: usize| (i..unknowns).map(|j| system[(i, j)] * (new[j] - old[j])).sum::<f64>();
    ((0..unknowns).map(|i| row(i).powi(2)).sum::<f64>() / unknowns as f64).sqrt()
}

fn empty(factors: &[JointFactor]) -> Vec<TriangularFactor> {
    factors.iter().map(|factor| TriangularFactor::new(factor.columns.len() + 1)).collect()
}

fn with_factors(factors: &[JointFactor], weighted: &[TriangularFactor]) -> Vec<JointFactor> {
    let pairs = factors.iter().zip(weighted);
    pairs
        .map(|(factor, weighted)| JointFactor { factor: weighted.factor(), ..factor.clone() })
        .collect()
}

/// Standard deviation of the residual by its median size.
struct Scales {
    /// Per factor, over all logs.
    all: Vec<f64>,
    /// Per factor and trajectory.
    own: Vec<Vec<f64>>,
}

impl Scales {
    fn new(
        equations: &mut Equations<'_>,
        factors: &[JointFactor],
        group: &Groups,
        values: &[f64],
        least: &[f64],
    ) -> Result<Self, IdentificationError> {
        let trajectories = equations.trajectories().len();
        let mut sizes = vec![vec![Vec::new(); trajectories]; factors.len()];
        equations.for_each(|equation| {
            if let Some(index) = group.index(&equation) {
                sizes[index][equation.trajectory].push(equation.residual(values).abs());
            }
        })?;
        let all: Vec<f64> = sizes.iter().map(|of_logs| scale(&mut of_logs.concat())).collect();
        let all = floored(&all, factors, least);
        let own = sizes.iter_mut().zip(&all).map(|(of_logs, &all)| {
            let own = of_logs.iter_mut().map(|sizes| match sizes.len() {
                0..FEWEST_ROWS => all,
                _ => scale(sizes).max(SMALLEST_SHARE * all),
            });
            own.collect()
        });
        Ok(Self { own: own.collect(), all })
    }

    fn of(&self, factor: usize, equation: &Equation<'_>) -> f64 {
        self.own[factor][equation.trajectory]
    }

    /// Per factor and trajectory, of the scale of all logs.
    fn shares(&self) -> Vec<Vec<f64>> {
        let pairs = self.own.iter().zip(&self.all);
        pairs.map(|(own, all)| own.iter().map(|own| own / all).collect()).collect()
    }

    /// Largest relative change of a scale that is used.
    fn change_since(&self, before: &Self, used: &[bool]) -> f64 {
        let pairs = self.own.iter().zip(&before.own).zip(used).filter(|(_, used)| **used);
        let changes = pairs.flat_map(|((new, old), _)| {
            new.iter().zip(old).map(|(new, old)| (new / old - 1.0).abs())
        });
        changes.fold(0.0, f64::max)
    }
}

fn scale(sizes: &mut [f64]) -> f64 {
    let middle = sizes.len() / 2;
    if sizes.is_empty() {
        0.0
    } else {
        *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / MEDIAN_OF_NORMAL
    }
}
