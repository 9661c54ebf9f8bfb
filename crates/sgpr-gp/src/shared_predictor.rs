//! Several processes over the same points, asked one query after the other.

use sgpr_predict::gp::{Precision, SharedPredictor, WeightedKernel};

use super::{GaussianProcess, InducedProcess};

/// One predictor for several processes. None if there is no process, if they do not have the same
/// points, have several outputs, or if a kernel is more than one stationary shape: ask each by
/// [`GaussianProcess::predictor`] then.
///
/// # Examples
/// ```
/// use sgpr_gp::{Compute, Covariance, Data, GaussianProcess, Kernel, Precision, Shape, shared_predictor};
/// let x = vec![0.0, 1.0, 2.0];
/// let process = |scale: f64, y: Vec<f64>| {
///     let kernel = Kernel::isotropic(Shape::Matern52, 1, scale).scaled(1.0);
///     GaussianProcess::fit(Data::new(x.clone(), 1, y, 1)?, Covariance::new(kernel, 1e-4), &Compute::default())
/// };
/// let joints = [process(1.0, vec![0.0, 1.0, 0.5])?, process(0.5, vec![1.0, 0.0, 1.0])?];
/// let mut predictor = shared_predictor(&joints.each_ref(), Precision::Double).expect("same points");
/// let means = predictor.means(&[1.0]);
/// assert!((means[0] - 1.0).abs() < 1e-3 && means[1].abs() < 1e-3);
/// # Ok::<(), sgpr_gp::GpError>(())
/// ```
pub fn shared_predictor(
    processes: &[&GaussianProcess],
    precision: Precision,
) -> Option<SharedPredictor> {
    if processes.iter().any(|gp| gp.data().outputs() != 1) {
        return None;
    }
    let sums: Vec<WeightedKernel<'_>> = processes.iter().map(|gp| gp.weighted_kernel()).collect();
    SharedPredictor::new(&sums, precision)
}

impl GaussianProcess {
    /// Its mean, of the first output.
    #[doc(hidden)]
    pub fn weighted_kernel(&self) -> WeightedKernel<'_> {
        let (data, weights) = (self.data(), &self.alpha[0]);
        WeightedKernel {
            signal: &self.covariance().signal,
            x: data.x(),
            inputs: data.inputs(),
            weights,
        }
    }
}

impl InducedProcess {
    /// Its mean, of the first output.
    #[doc(hidden)]
    pub fn weighted_kernel(&self) -> WeightedKernel<'_> {
        let (signal, weights) = (&self.covariance.signal, &self.weights[0]);
        WeightedKernel { signal, x: &self.inducing, inputs: self.inputs, weights }
    }
}
