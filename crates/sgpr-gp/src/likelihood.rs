use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Mat, MatRef};

use super::kernels::Plan;
use super::matrix::{
    FloatNumber, InverseSums, Storage, assemble_and_factor, invert_in_place, likelihood_gradient,
    panel,
};
use super::{Compute, Covariance, Data, GpError};
use sgpr_numeric::internal::linalg::{Svd, cholesky};

/// Log marginal likelihood of data for one covariance after the other, in the same memory: one
/// matrix of n² numbers, one of 512 n.
///
/// log p(y) = -½ yᵀ K⁻¹ y - ½ log det K - n/2 log 2π, summed over outputs, with K the covariance of
/// the measurements. Its gradient costs one inverse and one pass over the kernel for all
/// hyperparameters: ½ tr((α αᵀ - K⁻¹) dK), α = K⁻¹ y.
///
/// Of 2,000 points or more, L is inverted in single precision, twice as fast: only sums over K⁻¹
/// enter. What K⁻¹ y, known in double precision as α, is by that inverse says whether it holds; if
/// it is off by 1e-4, all is done in double precision, for the other covariances too. Likelihood
/// and α always are in double precision. Where the noise has a hundredth of the variance of the
/// signal, the gradient by the logarithms was found to be off by 6e-6 (2,000 points) and 4e-4
/// (6,000 points): next to an optimum that moves the likelihood by its square over the curvature,
/// less than 1e-6.
///
/// Source: GPML eqs. 5.8 and 5.9.
///
/// Linear terms H beta beside the process, of which nothing is known, leave of the likelihood that
/// of what they cannot explain ([`Likelihood::beside`]): with P = K⁻¹ - K⁻¹ H (Hᵀ K⁻¹ H)⁻¹ Hᵀ K⁻¹
/// in place of K⁻¹ it is -½ yᵀ P y - ½ log det K - ½ log det Hᵀ K⁻¹ H - (n - rank H)/2 log 2π, H
/// orthonormal, and its gradient ½ tr((P y yᵀ P - P) dK).
///
/// Source: GPML eq. 2.45; D. A. Harville, Maximum likelihood approaches to variance component
/// estimation and to related problems, J. American Statistical Association 72 (1977).
#[derive(Debug)]
pub struct Likelihood<'a> {
    data: &'a Data,
    compute: Compute,
    /// Orthonormal, `[points, rank H]`.
    terms: Option<Mat<f64>>,
    memory: LikelihoodMemory,
    jitter: f64,
    /// Whether the inverse is computed in single precision.
    single: bool,
}

/// Where a [`Likelihood`] computes, to be used again by the next one: memory that is taken anew is
/// cleared by the system, page by page.
#[derive(Debug)]
pub struct LikelihoodMemory {
    /// K, L or L⁻¹.
    matrix: Storage,
    panel: Storage,
}

/// Share of the largest singular value below which a combination of linear terms counts as none.
const RANK: f64 = 1e-9;

/// Points from which on the inverse is computed in single precision, and the largest relative error
/// of K⁻¹ y with which it is kept.
const SINGLE_FROM: usize = 2000;
const LARGEST_ERROR: f64 = 1e-4;

/// What one factorisation gives.
struct Factored {
    plan: Plan,
    /// K⁻¹ y, or P y, per output.
    alpha: Vec<Vec<f64>>,
    value: f64,
    /// G = K⁻¹ H R⁻¹ with RᵀR = Hᵀ K⁻¹ H, so that P = K⁻¹ - G Gᵀ.
    explained: Option<Mat<f64>>,
}

impl<'a> Likelihood<'a> {
    /// Takes the memory.
    ///
    /// # Errors
    /// If it is more than allowed.
    pub fn new(data: &'a Data, compute: &Compute) -> Result<Self, GpError> {
        Self::with_memory(data, compute, None)
    }

    /// The same in memory of an earlier one, if that was for as many points.
    ///
    /// # Errors
    /// As [`Likelihood::new`].
    pub fn with_memory(
        data: &'a Data,
        compute: &Compute,
        memory: Option<LikelihoodMemory>,
    ) -> Result<Self, GpError> {
        let n = data.len();
        let memory = match memory.filter(|memory| memory.matrix.columns() == n) {
            Some(memory) => memory,
            None => {
                compute.check(n, 1)?;
                LikelihoodMemory { matrix: Storage::square(n), panel: panel(n) }
            }
        };
        Ok(Self {
            data,
            compute: *compute,
            terms: None,
            memory,
            jitter: 0.0,
            single: n >= SINGLE_FROM,
        })
    }

    /// The memory, for the next one.
    pub fn into_memory(self) -> LikelihoodMemory {
        self.memory
    }

    /// The same beside linear terms with unknown coefficients.
    ///
    /// - `terms`: `[points, terms]`; they may depend on each other
    ///
    /// # Errors
    /// As [`Likelihood::new`].
    ///
    /// # Panics
    /// If there is not one row per point.
    #[doc(hidden)]
    pub fn beside(
        data: &'a Data,
        terms: MatRef<'_, f64>,
        compute: &Compute,
    ) -> Result<Self, GpError> {
        assert_eq!(terms.nrows(), data.len(), "a row per point");
        let scaled = Mat::from_fn(terms.nrows(), terms.ncols(), |i, k| {
            let length = terms.col(k).norm_l2();
            if length > 0.0 { terms[(i, k)] / length } else { 0.0 }
        });
        let svd = Svd::new(scaled.as_ref());
        let rank = svd.values.iter().filter(|value| **value > RANK * svd.values[0]).count();
        let terms = (rank > 0).then(|| svd.u.subcols(0, rank).to_owned());
        Ok(Self { terms, ..Self::new(data, compute)? })
    }

    /// log p(y).
    ///
    /// # Errors
    /// If the covariance does not fit the data, or is not positive definite.
    pub fn value(&mut self, covariance: &Covariance) -> Result<f64, GpError> {
        Ok(self.factor(covariance)?.value)
    }

    /// log p(y) and its derivatives by [`Covariance::theta`].
    ///
    /// # Errors
    /// As [`Likelihood::value`].
    pub fn value_and_gradient(
        &mut self,
        covariance: &Covariance,
    ) -> Result<(f64, Vec<f64>), GpError> {
        let mut factored = self.factor(covariance)?;
        if self.single {
            self.memory.matrix.round();
            let (gradient, error) = self.gradient::<f32>(covariance, &factored);
            if error < LARGEST_ERROR {
                return Ok((factored.value, gradient));
            }
            self.single = false;
            factored = self.factor(covariance)?;
        }
        Ok((factored.value, self.gradient::<f64>(covariance, &factored).0))
    }

    /// From L, which it overwrites, in the precision in which the matrix is; and how far K⁻¹ y is
    /// from alpha, relative.
    fn gradient<T: FloatNumber>(
        &mut self,
        covariance: &Covariance,
        factored: &Factored,
    ) -> (Vec<f64>, f64) {
        let Factored { plan, alpha, explained, .. } = factored;
        let LikelihoodMemory { matrix, panel } = &mut self.memory;
        invert_in_place::<T>(matrix.view_mut(), panel.view_mut(), self.compute.par());
        let (inverse_factor, panel) = (matrix.view(), panel.view_mut());
        let InverseSums { mut gradient, trace, product } = likelihood_gradient::<T>(
            plan,
            self.data,
            alpha,
            inverse_factor,
            explained.as_ref(),
            panel,
            &self.compute,
        );
        let (outputs, squares) =
            (alpha.len() as f64, alpha.iter().flatten().map(|a| a * a).sum::<f64>());
        if let Some(scale) = plan.scale() {
            // tr(P K) is the rank of P, so that K itself need not be multiplied by an inverse that
            // is only nearly one.
            let rank = (self.data.len() - explained.as_ref().map_or(0, Mat::ncols)) as f64;
            let diagonal = covariance.noise_variance + self.jitter;
            gradient[scale] = 0.5
                * (fit(self.data, alpha) - outputs * rank - diagonal * (squares - outputs * trace));
        }
        gradient.push(0.5 * covariance.noise_variance * (squares - outputs * trace));
        let norm =
            |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
        let difference =
            norm(&mut product.iter().zip(&alpha[0]).map(|(product, alpha)| product - alpha));
        let size = norm(&mut alpha[0].iter().copied());
        (gradient, if size > 0.0 { difference / size } else { difference })
    }

    /// What had to be added to the diagonal of the last covariance; zero if it was
    /// well-conditioned.
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Leaves L in the matrix.
    fn factor(&mut self, covariance: &Covariance) -> Result<Factored, GpError> {
        covariance.validate(self.data.inputs())?;
        let plan = Plan::new(&covariance.kernel());
        let points = plan.features(self.data.x(), self.data.inputs());
        let noise = covariance.noise_variance;
        self.jitter = assemble_and_factor(
            &plan,
            &points,
            noise,
            self.memory.matrix.view_mut(),
            &self.compute,
        )?;
        let factor = self.memory.matrix.view::<f64>();
        let (alpha, value) = weights_and_likelihood(factor, self.data, &self.compute);
        let Some(terms) = &self.terms else {
            return Ok(Factored { plan, alpha, value, explained: None });
        };

        let par = self.compute.par();
        let mut solved = terms.clone();
        solve_lower_triangular_in_place(factor, solved.as_mut(), par);
        solve_upper_triangular_in_place(factor.transpose(), solved.as_mut(), par);
        let information = terms.transpose() * &solved;
        let root = cholesky(information.as_ref())
            .ok_or(GpError::NotPositiveDefinite { jitter: self.jitter })?;
        // G = K⁻¹ H R⁻¹, by columns of Gᵀ.
        let mut transposed = solved.transpose().to_owned();
        solve_lower_triangular_in_place(root.transpose(), transposed.as_mut(), par);
        let explained = transposed.transpose().to_owned();
        let (rank, outputs) = (explained.ncols(), self.data.outputs());
        let log_root: f64 = (0..rank).map(|k| root[(k, k)].ln()).sum();
        let mut value =
            value - outputs as f64 * (log_root - 0.5 * rank as f64 * std::f64::consts::TAU.ln());
        let beside = |(output, alpha): (usize, Vec<f64>)| {
            let y = Mat::from_fn(alpha.len(), 1, |i, _| self.data.y()[i * outputs + output]);
            let share = explained.transpose() * y;
            let part = &explained * &share;
            value += 0.5 * share.squared_norm_l2();
            alpha.iter().enumerate().map(|(i, alpha)| alpha - part[(i, 0)]).collect()
        };
        let alpha = alpha.into_iter().enumerate().map(beside).collect();
        Ok(Factored { plan, alpha, value, explained: Some(explained) })
    }
}

/// K⁻¹ y per output, and log p(y), from L.
pub(super) fn weights_and_likelihood(
    factor: MatRef<'_, f64>,
    data: &Data,
    compute: &Compute,
) -> (Vec<Vec<f64>>, f64) {
    let (n, outputs) = (data.len(), data.outputs());
    let par = compute.par();
    let mut solution = Mat::from_fn(n, outputs, |i, o| data.y()[i * outputs + o]);
    solve_lower_triangular_in_place(factor, solution.as_mut(), par);
    solve_upper_triangular_in_place(factor.transpose(), solution.as_mut(), par);
    let alpha: Vec<Vec<f64>> = (0..outputs).map(|o| solution.col_as_slice(o).to_vec()).collect();
    let log_root: f64 = (0..n).map(|i| factor[(i, i)].ln()).sum();
    let value = -0.5 * fit(data, &alpha)
        - outputs as f64 * (log_root + 0.5 * n as f64 * std::f64::consts::TAU.ln());
    (alpha, value)
}

/// yᵀ alpha, summed over outputs.
fn fit(data: &Data, alpha: &[Vec<f64>]) -> f64 {
    let outputs = data.outputs();
    let of_output = |(o, alpha): (usize, &Vec<f64>)| -> f64 {
        data.y().iter().skip(o).step_by(outputs).zip(alpha).map(|(y, alpha)| y * alpha).sum()
    };
    alpha.iter().enumerate().map(of_output).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Kernel, Shape};

    /// Points on a smooth path, as those of a log are.
    fn path(n: usize) -> Data {
        let at = |i: usize, m: usize| (0.01 * i as f64 * (1.0 + 0.37 * m as f64) + m as f64).sin();
        let x: Vec<f64> = (0..n).flat_map(|i| (0..3).map(move |m| at(i, m))).collect();
        let y = (0..n).map(|i| {
            (3.0 * x[3 * i]).sin() + x[3 * i + 1] * x[3 * i + 2] + 0.05 * (1e3 * at(i, 7)).sin()
        });
        let y = y.collect();
        Data::new(x, 3, y, 1).expect("finite")
    }

    fn covariance(noise: f64) -> Covariance {
        Covariance::new(Kernel::ard(Shape::SquaredExponential, &[1.0, 1.2, 1.4]).scaled(2.0), noise)
    }

    #[test]
    fn an_inverse_in_single_precision_gives_the_gradient_or_is_not_used() {
        let data = path(SINGLE_FROM + 100);
        let terms = Mat::from_fn(data.len(), 2, |i, k| data.x()[3 * i + k]);
        let compute = Compute::default();
        for likelihood in
            [Likelihood::new(&data, &compute), Likelihood::beside(&data, terms.as_ref(), &compute)]
        {
            let mut likelihood = likelihood.expect("enough memory");
            let mut both = |noise: f64| {
                let covariance = covariance(noise);
                let mut gradient = |single: bool| {
                    likelihood.single = single;
                    let gradient =
                        likelihood.value_and_gradient(&covariance).expect("positive definite").1;
                    (gradient, likelihood.single)
                };
                let ((used, single), (double, _)) = (gradient(true), gradient(false));
                let difference =
                    used.iter().zip(&double).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                (difference / data.len() as f64, single)
            };
            for noise in [1e-1, 1e-2, 1e-3] {
                let (difference, single) = both(noise);
                assert!(
                    single && 0.0 < difference && difference < 2e-10 / noise,
                    "noise {noise}: {difference}"
                );
            }
            // Nearly singular: what single precision leaves of the inverse is noticed.
            for noise in [1e-5, 1e-7] {
                assert_eq!(both(noise), (0.0, false), "noise {noise}");
            }
        }
    }

    #[test]
    fn derivatives_of_many_points_are_finite_differences_of_every_kind_of_kernel() {
        let one = path(SINGLE_FROM);
        let y = one.y().iter().flat_map(|y| [*y, 0.5 - y * y]).collect();
        let two = Data::new(one.x().to_vec(), 3, y, 2).expect("finite");
        let smooth = || Kernel::ard(Shape::SquaredExponential, &[1.0, 1.2, 1.4]).scaled(2.0);
        let rough = || Kernel::isotropic(Shape::Matern32, 1, 0.7).scaled(0.4);
        // A variance of the whole kernel keeps the errors of single precision out of its
        // derivative.
        for (kernel, tolerance) in
            [(smooth(), 1e-7), (smooth().plus(rough()), 2e-6), (smooth().times(rough()), 2e-6)]
        {
            let covariance = Covariance::new(kernel, 0.02);
            for (data, threads) in [(&one, 1), (&two, 2)] {
                let compute = Compute { threads, ..Compute::default() };
                let mut likelihood = Likelihood::new(data, &compute).expect("enough memory");
                let (_, gradient) =
                    likelihood.value_and_gradient(&covariance).expect("positive definite");
                assert!(likelihood.single);
                let mut at = |k: usize, step: f64| {
                    let mut theta = covariance.theta();
                    theta[k] += step;
                    likelihood.value(&covariance.with_theta(&theta)).expect("positive definite")
                };
                for (k, derivative) in gradient.iter().enumerate() {
                    let expected = (at(k, 1e-4) - at(k, -1e-4)) / 2e-4;
                    let per_point = (derivative - expected).abs() / data.len() as f64;
                    assert!(
                        per_point < tolerance,
                        "{covariance:?}, parameter {k}: {derivative}, {expected}"
                    );
                }
            }
        }
    }
}
