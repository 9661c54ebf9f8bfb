use crate::identification::ParameterPrior;

/// What the robot file says of the first columns' factors, at one width: their precision, and its
/// product with what is expected of them.
#[derive(Clone, Debug)]
pub(super) struct FilePrior {
    pub precision: Vec<f64>,
    pub pull: Vec<f64>,
}

impl FilePrior {
    /// Of changes from a model's base parameters.
    pub fn new(of_file: &ParameterPrior, from: &[f64]) -> Self {
        let rows = of_file.rows();
        let rank = rows.nrows();
        let rest =
            |i: usize| rows[(i, rank)] - (0..rank).map(|k| rows[(i, k)] * from[k]).sum::<f64>();
        let rest: Vec<f64> = (0..rank).map(rest).collect();
        let precision =
            |at: usize| (0..rank).map(|i| rows[(i, at / rank)] * rows[(i, at % rank)]).sum();
        let pull = |k: usize| (0..rank).map(|i| rows[(i, k)] * rest[i]).sum();
        Self {
            precision: (0..rank * rank).map(precision).collect(),
            pull: (0..rank).map(pull).collect(),
        }
    }
}
