use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};
use faer::{Mat, MatRef};

use super::kernels::Plan;
use super::matrix::{assemble_and_factor, invert_in_place, likelihood_gradient, panel, square, view, view_mut};
use super::{Compute, Covariance, Data, GpError};
use crate::linalg::{Svd, cholesky};

/// Log marginal likelihood of data for one covariance after the other, in the same memory: one matrix of n² numbers, one of 512 n.
///
/// log p(y) = -½ yᵀ K⁻¹ y - ½ log det K - n/2 log 2π, summed over outputs, with K the covariance of the measurements. Its
/// gradient costs one inverse and one pass over the kernel for all hyperparameters: ½ tr((α αᵀ - K⁻¹) dK), α = K⁻¹ y.
///
/// Source: GPML eqs. 5.8 and 5.9.
///
/// Linear terms H beta beside the process, of which nothing is known, leave of the likelihood that of what they cannot
/// explain ([`Likelihood::beside`]): with P = K⁻¹ - K⁻¹ H (Hᵀ K⁻¹ H)⁻¹ Hᵀ K⁻¹ in place of K⁻¹ it is
/// -½ yᵀ P y - ½ log det K - ½ log det Hᵀ K⁻¹ H - (n - rank H)/2 log 2π, H orthonormal, and its gradient
/// ½ tr((P y yᵀ P - P) dK).
///
/// Source: GPML eq. 2.45; D. A. Harville, Maximum likelihood approaches to variance component estimation and to related
/// problems, J. American Statistical Association 72 (1977).
#[derive(Debug)]
pub struct Likelihood<'a> {
    data: &'a Data,
    compute: Compute,
    /// Orthonormal, `[points, rank H]`.
    terms: Option<Mat<f64>>,
    memory: LikelihoodMemory,
    jitter: f64,
}

/// Where a [`Likelihood`] computes, to be used again by the next one: memory that is taken anew is cleared by the system, page
/// by page.
#[derive(Debug)]
pub struct LikelihoodMemory {
    /// K, L or L⁻¹.
    matrix: Mat<f64>,
    panel: Mat<f64>,
}

/// Share of the largest singular value below which a combination of linear terms counts as none.
const RANK: f64 = 1e-9;

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
    pub fn with_memory(data: &'a Data, compute: &Compute, memory: Option<LikelihoodMemory>) -> Result<Self, GpError> {
        let n = data.len();
        let memory = match memory.filter(|memory| memory.matrix.ncols() == n) {
            Some(memory) => memory,
            None => {
                compute.check(n, 1)?;
                LikelihoodMemory { matrix: square(n), panel: panel(n) }
            }
        };
        Ok(Self { data, compute: *compute, terms: None, memory, jitter: 0.0 })
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
    pub fn beside(data: &'a Data, terms: MatRef<'_, f64>, compute: &Compute) -> Result<Self, GpError> {
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
    pub fn value_and_gradient(&mut self, covariance: &Covariance) -> Result<(f64, Vec<f64>), GpError> {
        let Factored { plan, alpha, value, explained } = self.factor(covariance)?;
        let par = self.compute.par();
        let LikelihoodMemory { matrix, panel } = &mut self.memory;
        invert_in_place(view_mut(matrix), panel, par);
        let points = plan.features(self.data.x(), self.data.inputs());
        let (mut gradient, trace) =
            likelihood_gradient(&plan, &points, &alpha, view(matrix), explained.as_ref(), panel, &self.compute);
        let squares: f64 = alpha.iter().flatten().map(|a| a * a).sum();
        gradient.push(0.5 * covariance.noise_variance * (squares - alpha.len() as f64 * trace));
        Ok((value, gradient))
    }

    /// What had to be added to the diagonal of the last covariance; zero if it was well-conditioned.
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Leaves L in the matrix.
    fn factor(&mut self, covariance: &Covariance) -> Result<Factored, GpError> {
        covariance.validate(self.data.inputs())?;
        let plan = Plan::new(&covariance.kernel());
        let points = plan.features(self.data.x(), self.data.inputs());
        let matrix = &mut self.memory.matrix;
        self.jitter = assemble_and_factor(&plan, &points, covariance.noise_variance, matrix, &self.compute)?;
        let (alpha, value) = weights_and_likelihood(matrix, self.data, &self.compute);
        let Some(terms) = &self.terms else { return Ok(Factored { plan, alpha, value, explained: None }) };

        let par = self.compute.par();
        let mut solved = terms.clone();
        solve_lower_triangular_in_place(view(matrix), solved.as_mut(), par);
        solve_upper_triangular_in_place(view(matrix).transpose(), solved.as_mut(), par);
        let information = terms.transpose() * &solved;
        let root = cholesky(information.as_ref()).ok_or(GpError::NotPositiveDefinite { jitter: self.jitter })?;
        // G = K⁻¹ H R⁻¹, by columns of Gᵀ.
        let mut transposed = solved.transpose().to_owned();
        solve_lower_triangular_in_place(root.transpose(), transposed.as_mut(), par);
        let explained = transposed.transpose().to_owned();
        let (rank, outputs) = (explained.ncols(), self.data.outputs());
        let log_root: f64 = (0..rank).map(|k| root[(k, k)].ln()).sum();
        let mut value = value - outputs as f64 * (log_root - 0.5 * rank as f64 * std::f64::consts::TAU.ln());
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
pub(super) fn weights_and_likelihood(factor: &Mat<f64>, data: &Data, compute: &Compute) -> (Vec<Vec<f64>>, f64) {
    let (n, outputs) = (data.len(), data.outputs());
    let par = compute.par();
    let mut solution = Mat::from_fn(n, outputs, |i, o| data.y()[i * outputs + o]);
    solve_lower_triangular_in_place(view(factor), solution.as_mut(), par);
    solve_upper_triangular_in_place(view(factor).transpose(), solution.as_mut(), par);
    let alpha: Vec<Vec<f64>> = (0..outputs).map(|o| solution.col_as_slice(o).to_vec()).collect();
    let fit: f64 = (0..outputs)
        .flat_map(|o| (0..n).map(move |i| (i, o)))
        .map(|(i, o)| data.y()[i * outputs + o] * alpha[o][i])
        .sum();
    let log_root: f64 = (0..n).map(|i| factor[(i, i)].ln()).sum();
    let value = -0.5 * fit - outputs as f64 * (log_root + 0.5 * n as f64 * std::f64::consts::TAU.ln());
    (alpha, value)
}
