use faer::Mat;

use super::rows::{LeftOutRows, ResidualRows};
use crate::gp::{
    Compute, Covariance, Evidence, GaussianProcess, GpError, GpPredictor, InducedProcess,
    Prediction, PredictorOptions, WeightedKernel,
};

/// The process of one joint. Its mean is k(x, X) times weights; these solve a linear system for
/// what it has seen.
#[derive(Clone, Debug)]
pub(super) enum Process {
    /// What is seen are the rows at the points X.
    Exact(GaussianProcess),
    /// What is seen are all rows, projected on the inducing points X.
    Sparse(Sparse),
}

/// A process that has seen all rows through inducing points.
#[derive(Clone, Debug)]
pub(super) struct Sparse {
    process: InducedProcess,
    /// Of [`Evidence`], for the residual alone.
    pub products: Mat<f64>,
    pub projection: Mat<f64>,
}

/// Linear terms beside a process, as it sees them.
pub(super) struct ProcessTerms {
    /// Their derivatives at the points, or projected on the inducing points, `[points, unknowns]`.
    pub matrix: Mat<f64>,
    /// Hᵀ R⁻¹ H and Hᵀ R⁻¹ y of all rows, if they are seen through inducing points.
    pub of_rows: Option<(Mat<f64>, Mat<f64>)>,
}

impl ProcessTerms {
    /// Of some rows.
    ///
    /// - `all`: `[rows, unknowns]`
    pub fn at_rows(all: &Mat<f64>, rows: &[usize]) -> Self {
        Self {
            matrix: Mat::from_fn(rows.len(), all.ncols(), |i, k| all[(rows[i], k)]),
            of_rows: None,
        }
    }
}

impl Sparse {
    /// # Errors
    /// If the covariance is none, or the arrays do not belong together.
    pub fn new(
        covariance: Covariance,
        inducing: Vec<f64>,
        inputs: usize,
        products: Mat<f64>,
        projection: Mat<f64>,
    ) -> Result<Self, GpError> {
        // On one thread, so that a model read from a file has the same bits.
        let compute = Compute::default().with_threads(1);
        let process =
            InducedProcess::new(covariance, inducing, inputs, &products, &projection, &compute)?;
        Ok(Self { process, products, projection })
    }

    /// The same inducing points and hyperparameters with what other rows say of an output.
    ///
    /// # Errors
    /// If the arrays do not belong together.
    pub fn having_seen(&self, evidence: &Evidence, output: usize) -> Result<Self, GpError> {
        let projection = evidence.projection.as_ref().subcols(output, 1).to_owned();
        self.with(evidence.products.clone(), projection)
    }

    fn with(&self, products: Mat<f64>, projection: Mat<f64>) -> Result<Self, GpError> {
        let (covariance, inducing) =
            (self.process.covariance().clone(), self.process.inducing().to_vec());
        Self::new(covariance, inducing, self.process.inputs(), products, projection)
    }
}

impl Process {
    /// The covariance with its hyperparameters.
    pub fn covariance(&self) -> &Covariance {
        match self {
            Self::Exact(gp) => gp.covariance(),
            Self::Sparse(sparse) => sparse.process.covariance(),
        }
    }

    /// X, `[points, inputs]`, row-major.
    pub fn x(&self) -> &[f64] {
        match self {
            Self::Exact(gp) => gp.data().x(),
            Self::Sparse(sparse) => sparse.process.inducing(),
        }
    }

    /// Columns of X.
    pub fn inputs(&self) -> usize {
        match self {
            Self::Exact(gp) => gp.data().inputs(),
            Self::Sparse(sparse) => sparse.process.inputs(),
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.x().len() / self.inputs()
    }

    /// As [`GaussianProcess::predict`].
    pub fn predict(&self, x: &[f64], with_variance: bool) -> Result<Prediction, GpError> {
        match self {
            Self::Exact(gp) => gp.predict(x, with_variance),
            Self::Sparse(sparse) => sparse.process.predict(x, with_variance),
        }
    }

    /// Error and variance at the rows of a part that neither the process nor the physics has seen,
    /// N·m (N) and its square. What uncertain parameters of the physics bring counts as far as the
    /// process does not know.
    ///
    /// # Errors
    /// As [`GaussianProcess::predict`].
    pub fn errors(
        &self,
        rows: &ResidualRows,
        left_out: &LeftOutRows,
    ) -> Result<Vec<(f64, f64)>, GpError> {
        let predicted = self.predict(&rows.at(&left_out.part, self.inputs()), true)?;
        let (noise, prior) =
            (self.covariance().total_noise_variance(), self.covariance().signal.variance());
        let predictions = predicted.mean.iter().zip(&predicted.variance).zip(&left_out.variance);
        let total = |variance: &f64, of_parameters: &f64| {
            variance + noise + variance / prior * of_parameters
        };
        let errors = left_out.measured().zip(predictions);
        Ok(errors.map(|(y, ((mean, own), more))| (y - mean, total(own, more))).collect())
    }

    /// Weights of what has been seen of other outputs, such as that of linear terms,
    /// `[points, ...]`.
    pub fn solve(&self, seen: &Mat<f64>) -> Mat<f64> {
        match self {
            Self::Exact(gp) => gp.solve(seen),
            Self::Sparse(sparse) => sparse.process.solve(seen),
        }
    }

    /// k(x, X) times each of `columns`, `[points of x, columns]`, row-major.
    pub fn weigh(&self, x: &[f64], columns: &[Vec<f64>]) -> Vec<f64> {
        match self {
            Self::Exact(gp) => gp.weigh(x, columns),
            Self::Sparse(sparse) => sparse.process.weigh(x, columns),
        }
    }

    /// For one point after the other.
    ///
    /// # Errors
    /// As [`GaussianProcess::predictor`].
    pub fn predictor(&self, options: PredictorOptions) -> Result<GpPredictor, GpError> {
        match self {
            Self::Exact(gp) => gp.predictor(options),
            Self::Sparse(sparse) => Ok(sparse.process.predictor(options)),
        }
    }

    /// Its mean.
    pub fn weighted_kernel(&self) -> WeightedKernel<'_> {
        match self {
            Self::Exact(gp) => gp.weighted_kernel(),
            Self::Sparse(sparse) => sparse.process.weighted_kernel(),
        }
    }

    /// Normal equations of linear terms beside the process: Hᵀ K⁻¹ H and Hᵀ K⁻¹ y, K the covariance
    /// of what it has seen.
    pub fn normal_equations(&self, terms: &ProcessTerms) -> (Mat<f64>, Mat<f64>) {
        let solved = self.solve(&terms.matrix);
        let information = terms.matrix.transpose() * &solved;
        let projection = solved.transpose() * self.seen();
        match &terms.of_rows {
            None => (information, projection),
            // (Q + R)⁻¹ = R⁻¹ - R⁻¹ K_fu (K_uu + K_uf R⁻¹ K_fu)⁻¹ K_uf R⁻¹
            Some((of_rows, with_y)) => (of_rows - information, with_y - projection),
        }
    }

    /// The same process of y - H change.
    ///
    /// # Errors
    /// If a number is not finite.
    pub fn without(&self, terms: &ProcessTerms, change: &Mat<f64>) -> Result<Self, GpError> {
        let residual = self.seen() - &terms.matrix * change;
        Ok(match self {
            Self::Exact(gp) => Self::Exact(gp.with_outputs(residual.col_as_slice(0).to_vec())?),
            Self::Sparse(sparse) => Self::Sparse(sparse.with(sparse.products.clone(), residual)?),
        })
    }

    /// Of the residual, a column.
    fn seen(&self) -> Mat<f64> {
        match self {
            Self::Exact(gp) => Mat::from_fn(gp.data().len(), 1, |i, _| gp.data().y()[i]),
            Self::Sparse(sparse) => sparse.projection.clone(),
        }
    }
}
