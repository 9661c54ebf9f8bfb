//! How well a model predicts the logs, its noise taken for whatever it looks like beside that very
//! model.
//!
//! Evidence that is counted with one estimate of the noise is only as right as that. With few rows
//! the columns of a large model take up most of what a noise with a memory does, what they leave
//! looks smaller and whiter than it is, and everything has evidence. So noise is estimated here
//! twice, beside a model with something and beside the one without it, from what is orthogonal to
//! its columns (restricted likelihood: H. D. Patterson, R. Thompson, Recovery of inter-block
//! information when block sizes are unequal, Biometrika 58(3) (1971)), and each of the two is
//! believed to have the noise that makes it likelier.

use std::convert::Infallible;

use basin::{
    Bobyqa, BoxBounds, ConstraintDescription, ConstraintSet, Constraints, CostFunction, Executor,
    PointState,
};
use faer::linalg::matmul::matmul;
use faer::linalg::solvers::Solve;
use faer::{Accum, Mat, Par};
use rayon::prelude::*;

use super::basis::{Basis, LEAST_SHARE, ORDER, ROWS_PER_ORDER};
use super::evidence::largest_correlation;
use super::file_prior::FilePrior;
use super::fit::Fitted;
use super::problem::{Column, Problem};
use crate::linalg::{dot_in_lanes, rms};
use sgpr_predict::internal::Autoregression;

/// Noise of a joint's torque, an autoregression by its partial autocorrelations, which may take any
/// values below one (O. Barndorff-Nielsen, G. Schou, On the parametrization of autoregressive
/// models by partial autocorrelations, J. Multivar. Anal. 3(4) (1973)).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct JointNoise {
    partial: Vec<f64>,
    /// Of the innovations, (N·m)² (N²).
    variance: f64,
}

/// The autoregressions of all orders up to that of some partial autocorrelations, with which the
/// first rows of a run are predicted from those that there are.
struct Orders {
    /// Coefficients, the latest row's first.
    phi: Vec<Vec<f64>>,
    /// Variance of what they do not predict, in that of the innovations.
    variance: Vec<f64>,
}

impl Orders {
    fn of(partial: &[f64]) -> Self {
        let mut phi: Vec<Vec<f64>> = vec![vec![]];
        for &last in partial {
            phi.push(Autoregression::of_next_order(&phi[phi.len() - 1], last));
        }
        let not_predicted =
            |order: usize| partial[order..].iter().map(|k| 1.0 / (1.0 - k * k)).product();
        let variance = (0..=partial.len()).map(not_predicted).collect();
        Self { phi, variance }
    }

    fn order(&self, run: usize) -> usize {
        run.min(self.phi.len() - 1)
    }

    /// What a row has that those before it do not predict, in standard deviations of the
    /// innovations.
    fn innovation(&self, x: &[f64], row: usize, run: usize) -> f64 {
        let order = self.order(run);
        let predicted: f64 =
            self.phi[order].iter().enumerate().map(|(lag, phi)| phi * x[row - 1 - lag]).sum();
        (x[row] - predicted) / self.variance[order].sqrt()
    }

    /// Log of the determinant of the correlation of all rows.
    fn log_determinant(&self, run: &[usize]) -> f64 {
        run.iter().map(|run| self.variance[self.order(*run)].ln()).sum()
    }
}

/// A joint's equations: free columns, held ones and the target, by products of rows with those some
/// lags before.
struct RestrictedLikelihood {
    free: usize,
    held: usize,
    /// Of the factors of held columns, times the variance of the innovations.
    precision: f64,
    run: Vec<usize>,
    /// Least variance of the noise, (N·m)² (N²).
    least: f64,
    highest: usize,
    /// Products of lags i and j at i (i + 1) / 2 + j, of the rows that have as many before them as
    /// the highest order.
    products: Vec<Mat<f64>>,
    /// The other rows, by column.
    starts: Vec<usize>,
    columns: Vec<Vec<f64>>,
}

impl RestrictedLikelihood {
    /// None where there are not enough rows.
    fn new(
        free: &[&[f64]],
        (held, precision): (&[&[f64]], f64),
        target: &[f64],
        run: &[usize],
    ) -> Option<Self> {
        let independent = Basis::new(free.iter().map(|column| vec![column.to_vec()]).collect());
        let unit = |column: &[f64]| -> Vec<f64> {
            let length = dot_in_lanes(column, column).sqrt();
            column.iter().map(|x| x / length).collect()
        };
        let mut columns: Vec<Vec<f64>> =
            independent.independent().iter().map(|column| unit(&column[0])).collect();
        let free = columns.len();
        columns.extend(held.iter().chain([&target]).map(|column| column.to_vec()));
        if target.len() < free + LEAST_FREEDOM {
            return None;
        }
        let highest = ORDER.min((target.len() as f64 / ROWS_PER_ORDER) as usize);
        let (late, starts): (Vec<usize>, Vec<usize>) =
            (0..target.len()).partition(|row| run[*row] >= highest);
        let lagged = |lag: usize| {
            Mat::from_fn(late.len(), columns.len(), |row, k| columns[k][late[row] - lag])
        };
        let lagged: Vec<Mat<f64>> = (0..=highest).map(lagged).collect();
        let product = |(i, j): (usize, usize)| {
            let mut own = Mat::zeros(columns.len(), columns.len());
            matmul(
                own.as_mut(),
                Accum::Replace,
                lagged[i].transpose(),
                lagged[j].as_ref(),
                1.0,
                Par::Seq,
            );
            if i == j { own } else { &own + own.transpose() }
        };
        let products =
            (0..=highest).flat_map(|i| (0..=i).map(move |j| (i, j))).map(product).collect();
        let least = (LEAST_SHARE * rms(target)).max(1e-12).powi(2);
        Some(Self {
            free,
            held: held.len(),
            precision,
            run: run.to_vec(),
            least,
            highest,
            products,
            starts,
            columns,
        })
    }

    /// Minus twice the restricted log likelihood, and the variance of the innovations at which it
    /// is greatest.
    fn cost(&self, partial: &[f64]) -> Option<(f64, f64)> {
        let orders = Orders::of(partial);
        let size = self.columns.len();
        let of_lag = |lag: usize| if lag == 0 { 1.0 } else { -orders.phi[partial.len()][lag - 1] };
        let mut sum = Mat::<f64>::zeros(size, size);
        for (i, j) in (0..=partial.len()).flat_map(|i| (0..=i).map(move |j| (i, j))) {
            let (factor, product) = (of_lag(i) * of_lag(j), &self.products[i * (i + 1) / 2 + j]);
            for column in 0..size {
                let product = product.col_as_slice(column);
                sum.col_as_slice_mut(column)
                    .iter_mut()
                    .zip(product)
                    .for_each(|(sum, x)| *sum += factor * x);
            }
        }
        let innovation =
            |row: usize, k: usize| orders.innovation(&self.columns[k], row, self.run[row]);
        let starts =
            Mat::from_fn(self.starts.len(), size, |row, k| innovation(self.starts[row], k));
        matmul(sum.as_mut(), Accum::Add, starts.transpose(), starts.as_ref(), 1.0, Par::Seq);
        (0..self.free).for_each(|k| sum[(k, k)] *= 1.0 + ROUNDING);
        (self.free..self.free + self.held).for_each(|k| sum[(k, k)] += self.precision);
        let factor = sum.llt(faer::Side::Lower).ok()?;
        let pivot = |k: usize| factor.L()[(k, k)];
        let freedom = (self.run.len() - self.free) as f64;
        let variance = pivot(size - 1).powi(2) / freedom + self.least;
        let of_columns: f64 = (0..size - 1).map(|k| 2.0 * pivot(k).ln()).sum();
        let of_prior = self.held as f64 * self.precision.max(f64::MIN_POSITIVE).ln();
        Some((
            freedom * variance.ln() + of_columns - of_prior + orders.log_determinant(&self.run),
            variance,
        ))
    }
}

/// Fewest rows beyond the columns from which noise is estimated.
const LEAST_FREEDOM: usize = 20;

/// Share of a free column's products by which they are wrong.
const ROUNDING: f64 = 1e-10;

/// The partial autocorrelations are searched by their inverse hyperbolic tangents, within this
/// range: 0.999.
const RANGE: f64 = 3.8;

struct NoiseSearch<'e> {
    equations: &'e RestrictedLikelihood,
    bounds: [Vec<f64>; 2],
}

impl Constraints for NoiseSearch<'_> {
    type Set = ConstraintSet<BoxBounds<Vec<f64>>>;

    fn constraints(&self) -> <Self::Set as ConstraintDescription>::Borrowed<'_> {
        ConstraintSet::new()
            .with_bounds(BoxBounds::new(Some(&self.bounds[0]), Some(&self.bounds[1])))
    }
}

impl CostFunction for NoiseSearch<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    type Error = Infallible;

    fn cost(&self, at: &Vec<f64>) -> Result<f64, Infallible> {
        let partial: Vec<f64> = at.iter().map(|x| x.tanh()).collect();
        // Where rounding leaves nothing the likelihood says nothing.
        Ok(self.equations.cost(&partial).map_or(1e300, |(cost, _)| cost))
    }
}

impl JointNoise {
    /// The noise beside which some columns are likeliest to leave what they leave of a target; none
    /// where there are too few rows to tell.
    ///
    /// - `held`: columns whose factors are expected near zero, and the precision of that, times the
    ///   variance of the innovations
    /// - `run`: rows right before each row without a gap
    /// - `like`: a noise from which to look for it, too
    /// - `most`: largest correlation of neighbouring rows
    pub fn of(
        free: &[&[f64]],
        held: (&[&[f64]], f64),
        (target, run): (&[f64], &[usize]),
        (like, most): (Option<&Self>, f64),
    ) -> Option<Self> {
        /// How far the search looks around at first, in inverse hyperbolic tangents ...
        const FIRST_RADIUS: f64 = 0.5;
        /// ... and how well it finds them: the likelihood knows a correlation of a hundred rows
        /// five times less well.
        const LAST_RADIUS: f64 = 0.02;
        /// Of the likelihood; what was reached by then counts.
        const MOST_EVALUATIONS: u64 = 300;
        let equations = RestrictedLikelihood::new(free, held, target, run)?;
        let highest = equations.highest;
        let noise = |partial: Vec<f64>| {
            let (cost, variance) = equations.cost(&partial)?;
            Some((cost, Self { partial, variance }))
        };
        if highest == 0 {
            return noise(vec![]).map(|(_, noise)| noise);
        }
        let mut bounds = [vec![-RANGE; highest], vec![RANGE; highest]];
        bounds[1][0] = most.atanh().min(RANGE);
        let end = |start: Vec<f64>| {
            let search = NoiseSearch { equations: &equations, bounds: bounds.clone() };
            let solver =
                Bobyqa::new().with_initial_radius(FIRST_RADIUS).with_final_radius(LAST_RADIUS);
            let run = Executor::new(search, solver, PointState::new(start))
                .max_cost_evals(MOST_EVALUATIONS)
                .run();
            let best = run.ok()?.best_param().clone();
            noise(best.iter().map(|x| x.tanh()).collect())
        };
        let known = like.filter(|own| own.partial.len() == highest);
        let known = known.map(|own| own.partial.iter().map(|k| k.atanh()).collect());
        let all = known.into_iter().chain([vec![0.0; highest]]).filter_map(end);
        all.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, noise)| noise)
    }

    /// A column in standard deviations of the innovations.
    fn whiten(&self, x: &[f64], run: &[usize]) -> Vec<f64> {
        let (orders, scale) = (Orders::of(&self.partial), self.variance.sqrt().recip());
        (0..x.len()).map(|row| scale * orders.innovation(x, row, run[row])).collect()
    }

    /// Log of the determinant of the covariance of all rows.
    fn log_determinant(&self, run: &[usize]) -> f64 {
        run.len() as f64 * self.variance.ln() + Orders::of(&self.partial).log_determinant(run)
    }
}

/// A model of all joints' torques, and its noise.
pub(super) struct Hypothesis<'f> {
    /// Each with the precision of its factor before any data; of the first ones the robot file says
    /// what is known.
    columns: Vec<(&'f Column, f64)>,
    target: &'f Column,
    noise: Vec<JointNoise>,
}

impl<'f> Hypothesis<'f> {
    /// Of a fit.
    ///
    /// - `noise`: of each joint
    pub fn new(fitted: &'f Fitted, noise: Vec<JointNoise>) -> Self {
        let columns = fitted
            .columns
            .iter()
            .map(|column| &**column)
            .zip(fitted.precision.iter().copied())
            .collect();
        Self { columns, target: &fitted.target, noise }
    }

    /// Of a fit that is the same as another one but at some joints; none where there are too few
    /// rows to tell.
    pub fn like(&self, problem: &Problem, fitted: &'f Fitted, changed: &[usize]) -> Option<Self> {
        let of_joint = |joint: usize| match changed.contains(&joint) {
            true => noise(problem, fitted, joint, (&[], 0.0), Some(&self.noise[joint])),
            false => Some(self.noise[joint].clone()),
        };
        let noise = (0..problem.dof()).into_par_iter().map(of_joint).collect::<Option<Vec<_>>>()?;
        Some(Self::new(fitted, noise))
    }

    /// The same with columns of one joint beside those of the fit, of factors with some precision.
    pub fn with(
        &self,
        problem: &Problem,
        fitted: &'f Fitted,
        (joint, columns, precision): (usize, &'f [Column], f64),
    ) -> Option<Self> {
        let known = &self.noise[joint];
        let mut own = Self::new(fitted, self.noise.clone());
        own.noise[joint] =
            noise(problem, fitted, joint, (columns, precision * known.variance), Some(known))?;
        own.columns.extend(columns.iter().map(|column| (column, precision)));
        Some(own)
    }

    /// Log of the Bayes factor of this hypothesis against another one, each with the one's noise or
    /// the other's, whichever makes it likelier.
    pub fn log_bayes_factor(&self, other: &Self, problem: &Problem) -> Option<f64> {
        let evidence = |own: &Self| {
            let with =
                |noise: &[JointNoise]| own.log_evidence(noise, problem.priors.last(), &problem.run);
            [&self.noise, &other.noise]
                .into_iter()
                .filter_map(|noise| with(noise))
                .max_by(f64::total_cmp)
        };
        Some(evidence(self)? - evidence(other)?)
    }

    /// Log of the evidence with some noise, apart from what is the same of every hypothesis.
    ///
    /// - `run`: per joint and row: rows right before it without a gap
    fn log_evidence(
        &self,
        noise: &[JointNoise],
        file: Option<&FilePrior>,
        run: &[Vec<usize>],
    ) -> Option<f64> {
        let Self { columns, target, .. } = self;
        let size = columns.len();
        let mut products = Mat::<f64>::zeros(size + 1, size + 1);
        for (joint, noise) in
            noise.iter().enumerate().filter(|(joint, _)| !target[*joint].is_empty())
        {
            let here: Vec<usize> = (0..size).filter(|k| !columns[*k].0[joint].is_empty()).collect();
            let own = here.iter().map(|k| &columns[*k].0[joint]).chain([&target[joint]]);
            let white: Vec<Vec<f64>> = own.map(|x| noise.whiten(x, &run[joint])).collect();
            let rows = Mat::from_fn(target[joint].len(), white.len(), |row, k| white[k][row]);
            let mut own = Mat::<f64>::zeros(white.len(), white.len());
            matmul(own.as_mut(), Accum::Replace, rows.transpose(), rows.as_ref(), 1.0, Par::Seq);
            let place = |k: usize| here.get(k).copied().unwrap_or(size);
            for (a, b) in (0..white.len()).flat_map(|a| (0..white.len()).map(move |b| (a, b))) {
                products[(place(a), place(b))] += own[(a, b)];
            }
        }
        let of_file = file.map_or(0, |file| file.pull.len());
        if let Some(file) = file {
            for (at, precision) in file.precision.iter().enumerate() {
                products[(at / of_file, at % of_file)] += precision;
            }
            file.pull.iter().enumerate().for_each(|(k, pull)| products[(size, k)] += pull);
        }
        let mut of_columns = 0.0;
        for (k, (_, precision)) in columns.iter().enumerate().skip(of_file) {
            // A column of nothing may have any factor.
            let precision = if products[(k, k)] + precision > 0.0 {
                precision.max(f64::MIN_POSITIVE)
            } else {
                1.0
            };
            products[(k, k)] += precision;
            of_columns -= precision.ln();
        }
        let factor = products.submatrix(0, 0, size, size).llt(faer::Side::Lower).ok()?;
        of_columns += (0..size).map(|k| 2.0 * factor.L()[(k, k)].ln()).sum::<f64>();
        let along = Mat::from_fn(size, 1, |k, _| products[(size, k)]);
        let factors = factor.solve(&along);
        let explained: f64 = (0..size).map(|k| along[(k, 0)] * factors[(k, 0)]).sum();
        let of_noise: f64 =
            noise.iter().zip(run).map(|(noise, run)| noise.log_determinant(run)).sum();
        Some(-0.5 * (products[(size, size)] - explained + of_columns + of_noise))
    }
}

/// The noise of every joint beside a fit; none where there are too few rows to tell.
pub(super) fn noises(problem: &Problem, fitted: &Fitted) -> Option<Vec<JointNoise>> {
    let of_joint = |joint: usize| noise(problem, fitted, joint, (&[], 0.0), None);
    (0..problem.dof()).into_par_iter().map(of_joint).collect()
}

/// The noise of a joint beside a fit and columns whose factors are expected near zero.
///
/// - `precision`: of these factors, times the variance of the innovations
/// - `like`: a noise that may be much like it
fn noise(
    problem: &Problem,
    fitted: &Fitted,
    joint: usize,
    (held, precision): (&[Column], f64),
    like: Option<&JointNoise>,
) -> Option<JointNoise> {
    let target = &fitted.target[joint];
    if target.is_empty() {
        return Some(JointNoise { partial: vec![], variance: 1.0 });
    }
    let free =
        fitted.columns.iter().map(|column| &column[joint][..]).filter(|column| !column.is_empty());
    let held = held.iter().map(|column| &column[joint][..]).filter(|column| !column.is_empty());
    let (free, held): (Vec<&[f64]>, Vec<&[f64]>) = (free.collect(), held.collect());
    let most = largest_correlation(problem, joint);
    JointNoise::of(&free, (&held, precision), (target, &problem.run[joint]), (like, most))
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::*;
    use sgpr_numeric::internal::Random;

    /// Covariance of all rows, from how an autoregression makes them of its innovations: a run
    /// begins so long after the beginning of the noise that nothing is left of that.
    fn covariance(noise: &JointNoise, run: &[usize]) -> DMatrix<f64> {
        const LONG: usize = 2000;
        let phi = Orders::of(&noise.partial).phi.pop().expect("an order");
        let mut response = vec![1.0];
        while response.len() < LONG {
            let known = phi
                .iter()
                .enumerate()
                .filter_map(|(lag, p)| Some(p * response.iter().rev().nth(lag)?));
            response.push(known.sum());
        }
        let of_lag =
            |lag: usize| response.iter().zip(&response[lag..]).map(|(a, b)| a * b).sum::<f64>();
        let of_lags: Vec<f64> = (0..run.len()).map(of_lag).collect();
        let same_run = |a: usize, b: usize| run[a.max(b)] >= a.abs_diff(b);
        let value = |a: usize, b: usize| {
            if same_run(a, b) { noise.variance * of_lags[a.abs_diff(b)] } else { 0.0 }
        };
        DMatrix::from_fn(run.len(), run.len(), value)
    }

    fn log_determinant(matrix: &DMatrix<f64>) -> f64 {
        2.0 * matrix.clone().cholesky().expect("positive").l().diagonal().map(f64::ln).sum()
    }

    fn runs() -> Vec<usize> {
        (0..90).chain(0..3).chain(0..57).collect()
    }

    fn draw(random: &mut Random, noise: &JointNoise, run: &[usize]) -> Vec<f64> {
        let root = covariance(noise, run).cholesky().expect("positive").l();
        (root * DVector::from_fn(run.len(), |_, _| random.normal())).iter().copied().collect()
    }

    #[test]
    fn the_restricted_likelihood_is_that_of_the_dense_formula() {
        let (run, mut random) = (runs(), Random::new(5));
        let mut column = || -> Vec<f64> { run.iter().map(|_| random.normal()).collect() };
        let (columns, held, target) = ([column(), column()], column(), column());
        let free: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let cost = |partial: &[f64]| {
            let equations = RestrictedLikelihood::new(&free, (&[&held], 0.7), &target, &run)
                .expect("enough rows");
            equations.cost(partial).expect("positive")
        };
        // With the variance that it is greatest at the dense one has no part in that but by the
        // rows and the columns.
        let dense = |partial: &[f64]| {
            let (_, variance) = cost(partial);
            let of_unit =
                covariance(&JointNoise { partial: partial.to_vec(), variance: 1.0 }, &run);
            let z = DVector::from_column_slice(&held);
            let sigma = (of_unit + &z * z.transpose() / 0.7) * variance;
            let x = DMatrix::from_fn(run.len(), 2, |row, k| columns[k][row]);
            let x =
                DMatrix::from_columns(&x.column_iter().map(|c| c.normalize()).collect::<Vec<_>>());
            let inverse = sigma.clone().try_inverse().expect("positive");
            let information = x.transpose() * &inverse * &x;
            let y = DVector::from_column_slice(&target);
            let factors = information.clone().try_inverse().expect("positive")
                * x.transpose()
                * &inverse
                * &y;
            let left = &y - &x * factors;
            log_determinant(&sigma)
                + log_determinant(&information)
                + (left.transpose() * inverse * &left)[(0, 0)]
        };
        let partial: [&[f64]; 3] = [&[], &[0.6], &[0.9, -0.5, 0.3]];
        let difference = |of: &dyn Fn(&[f64]) -> f64, k: usize| of(partial[k]) - of(partial[0]);
        for k in 1..3 {
            let [own, other] = [difference(&|p| cost(p).0, k), difference(&dense, k)];
            assert!((own - other).abs() < 1e-6, "{own} {other}");
        }
    }

    #[test]
    fn what_many_columns_leave_says_what_the_noise_was() {
        let (run, mut random) = ((0..160).collect::<Vec<usize>>(), Random::new(11));
        let truth = JointNoise { partial: vec![0.85], variance: 1.0 };
        // Slow columns: they take up most of what the noise does, and least squares leave what
        // looks white.
        let wave = |k: usize| -> Vec<f64> {
            let angle = |row: usize| std::f64::consts::TAU * (k / 2) as f64 * row as f64 / 160.0;
            (0..160)
                .map(|row| if k.is_multiple_of(2) { angle(row).cos() } else { angle(row).sin() })
                .collect()
        };
        let columns: Vec<Vec<f64>> = (2..42).map(wave).collect();
        let free: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
        let (mut first, mut neighbours) = (0.0, 0.0);
        const DRAWS: usize = 20;
        for _ in 0..DRAWS {
            let target = draw(&mut random, &truth, &run);
            let own = JointNoise::of(&free, (&[], 0.0), (&target, &run), (None, 0.99))
                .expect("enough rows");
            first += own.partial[0] / DRAWS as f64;
            let basis = Basis::new(columns.iter().map(|column| vec![column.clone()]).collect());
            let mut left = vec![target];
            basis.project_out(&mut left);
            let products =
                |lag: usize| left[0].iter().zip(&left[0][lag..]).map(|(a, b)| a * b).sum::<f64>();
            neighbours += products(1) / products(0) / DRAWS as f64;
        }
        assert!((first - 0.85).abs() < 0.2 && neighbours < 0.4, "{first} {neighbours}");
    }

    #[test]
    fn a_bayes_factor_is_that_of_two_normal_distributions() {
        let (run, mut random) = (runs(), Random::new(7));
        let mut column = || -> Column { vec![run.iter().map(|_| random.normal()).collect()] };
        let (columns, target) = ([column(), column()], column());
        let noise = vec![JointNoise { partial: vec![0.7, -0.2], variance: 0.4 }];
        let runs = vec![run.clone()];
        let of = |count: usize| {
            let columns = columns[..count].iter().zip([0.3, 2.0]).collect();
            Hypothesis { columns, target: &target, noise: noise.clone() }
        };
        let dense = |count: usize| {
            let mut sigma = covariance(&noise[0], &run);
            for (column, precision) in columns[..count].iter().zip([0.3, 2.0]) {
                let z = DVector::from_column_slice(&column[0]);
                sigma += &z * z.transpose() / precision;
            }
            let y = DVector::from_column_slice(&target[0]);
            let squares =
                (y.transpose() * sigma.clone().try_inverse().expect("positive") * &y)[(0, 0)];
            -0.5 * (log_determinant(&sigma) + squares)
        };
        let own = |count: usize| of(count).log_evidence(&noise, None, &runs).expect("positive");
        for count in [1, 2] {
            let [own, other] = [own(count) - own(0), dense(count) - dense(0)];
            assert!((own - other).abs() < 1e-8, "{own} {other}");
        }
    }
}
