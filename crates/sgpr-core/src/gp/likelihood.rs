use faer::Mat;
use faer::linalg::triangular_solve::{solve_lower_triangular_in_place, solve_upper_triangular_in_place};

use super::kernels::Plan;
use super::matrix::{assemble_and_factor, inverse_from, invert_factor, likelihood_gradient, square, view, view_mut};
use super::{Compute, Covariance, Data, GpError};

/// Log marginal likelihood of data for one covariance after the other, in the same memory: two matrices of n² numbers.
///
/// log p(y) = -½ yᵀ K⁻¹ y - ½ log det K - n/2 log 2π, summed over outputs, with K the covariance of the measurements. Its
/// gradient costs one inverse and one pass over the kernel for all hyperparameters: ½ tr((α αᵀ - K⁻¹) dK), α = K⁻¹ y.
///
/// Source: GPML eqs. 5.8 and 5.9.
#[derive(Debug)]
pub struct Likelihood<'a> {
    data: &'a Data,
    compute: Compute,
    first: Mat<f64>,
    second: Mat<f64>,
    jitter: f64,
}

impl<'a> Likelihood<'a> {
    /// Takes the memory.
    ///
    /// # Errors
    /// If it is more than allowed.
    pub fn new(data: &'a Data, compute: &Compute) -> Result<Self, GpError> {
        compute.check(data.len(), 2)?;
        let n = data.len();
        Ok(Self { data, compute: *compute, first: square(n), second: square(n), jitter: 0.0 })
    }

    /// log p(y).
    ///
    /// # Errors
    /// If the covariance does not fit the data, or is not positive definite.
    pub fn value(&mut self, covariance: &Covariance) -> Result<f64, GpError> {
        Ok(self.factor(covariance)?.2)
    }

    /// log p(y) and its derivatives by [`Covariance::theta`].
    ///
    /// # Errors
    /// As [`Likelihood::value`].
    pub fn value_and_gradient(&mut self, covariance: &Covariance) -> Result<(f64, Vec<f64>), GpError> {
        let (plan, alpha, value) = self.factor(covariance)?;
        let par = self.compute.par();
        invert_factor(view(&self.first), view_mut(&mut self.second), par);
        inverse_from(view(&self.second), view_mut(&mut self.first), par);
        let points = plan.features(self.data.x(), self.data.inputs());
        let mut gradient = likelihood_gradient(&plan, &points, &alpha, &self.first, &self.compute);
        let squares: f64 = alpha.iter().flatten().map(|a| a * a).sum();
        let trace: f64 = (0..self.data.len()).map(|i| self.first[(i, i)]).sum();
        gradient.push(0.5 * covariance.noise_variance * (squares - alpha.len() as f64 * trace));
        Ok((value, gradient))
    }

    /// What had to be added to the diagonal of the last covariance; zero if it was well-conditioned.
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Leaves L in `first`; returns K⁻¹ y per output and log p(y).
    fn factor(&mut self, covariance: &Covariance) -> Result<(Plan, Vec<Vec<f64>>, f64), GpError> {
        covariance.validate(self.data.inputs())?;
        let plan = Plan::new(&covariance.kernel());
        let points = plan.features(self.data.x(), self.data.inputs());
        self.jitter = assemble_and_factor(&plan, &points, covariance.noise_variance, &mut self.first, &self.compute)?;
        let (alpha, value) = weights_and_likelihood(&self.first, self.data, &self.compute);
        Ok((plan, alpha, value))
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
