//! More rows than the budget of points: all of them, seen through inducing points.

use faer::Mat;

use super::process::{Process, ProcessTerms, Sparse};
use super::rows::{LeftOutRows, ResidualRows, SHORTEST_MEMORY, Unseen, longest_memory};
use crate::gp::{
    Compute, Covariance, Data, Evidence, FadingNoise, GaussianProcess, GpError, Kernel, Shape,
};

/// A process that has seen all rows.
#[derive(Clone, Debug)]
pub(super) struct SeenByAll {
    pub process: Process,
    /// Error and variance of every row, as [`super::joint_process::errors_left_out`].
    pub errors: Vec<(f64, f64)>,
    pub evidence: EvidenceParts,
}

/// What each part of the logs says, of the residual, of what physics without each part leaves over,
/// and of the derivatives by the linear parameters if these are estimated together with the
/// processes.
#[derive(Clone, Debug, Default)]
pub(super) struct EvidenceParts {
    of_parts: Vec<Evidence>,
    unknowns: usize,
}

impl EvidenceParts {
    /// What all parts say but one, or all if none is left out.
    pub fn without(&self, left_out: Option<usize>) -> Evidence {
        let first = &self.of_parts[0];
        let mut sum = Evidence::none(first.products.nrows(), first.projection.ncols());
        let kept = self.of_parts.iter().enumerate().filter(|(index, _)| Some(*index) != left_out);
        kept.for_each(|(_, part)| sum.add(part));
        sum
    }

    /// The linear terms of [`EvidenceParts::without`].
    pub fn terms(&self, evidence: &Evidence) -> ProcessTerms {
        let unknowns = self.unknowns;
        let first = evidence.projection.ncols() - unknowns;
        let information =
            evidence.squares.as_ref().submatrix(first, first, unknowns, unknowns).to_owned();
        let with_y = evidence.squares.as_ref().submatrix(first, 0, unknowns, 1).to_owned();
        let matrix = evidence.projection.as_ref().subcols(first, unknowns).to_owned();
        ProcessTerms { matrix, of_rows: Some((information, with_y)) }
    }
}

/// The process of all rows, with the signal of one that has seen some of them, its `points`. The
/// errors of the others say how large those of the measurement are and how long they last, which
/// points far apart cannot tell. None if there are no errors, or the memory does not suffice.
///
/// Parts of the logs have errors of their own; so what all but one say is the sum of what each
/// says.
///
/// - `inducing`: `[inducing, inputs]`, row-major
pub(super) fn see_all(
    gp: &GaussianProcess,
    points: &[usize],
    inducing: &[f64],
    rows: &ResidualRows,
    unseen: &Unseen,
    compute: &Compute,
) -> Result<Option<SeenByAll>, GpError> {
    let width = gp.data().inputs();
    let left_out = &unseen.parts[..];
    let others: Vec<usize> =
        (0..rows.residual.len()).filter(|row| points.binary_search(row).is_err()).collect();
    let Some(covariance) = with_errors_of(gp, &others, rows, longest_memory(rows, left_out))?
    else {
        return Ok(None);
    };
    let columns = 1 + unseen.parts_and_anew().count();
    let unknowns = rows.terms.as_ref().map_or(0, Mat::ncols);
    let m = inducing.len() / width;
    if !compute.allows(m, 6 + left_out.len() as u64) {
        return Ok(None);
    }
    let outputs = |row: usize| {
        let without_parts = unseen.parts_and_anew().map(move |part| part.residual[row]);
        let residuals = std::iter::once(rows.residual[row]).chain(without_parts);
        let terms =
            rows.terms.iter().flat_map(move |terms| (0..unknowns).map(move |k| terms[(row, k)]));
        residuals.chain(terms)
    };
    let evidence_of = |part: &LeftOutRows| {
        if part.part.is_empty() {
            return Ok(Evidence::none(m, columns + unknowns));
        }
        let y = part.part.iter().flat_map(|&row| outputs(row)).collect();
        let data = Data::new(rows.at(&part.part, width), width, y, columns + unknowns)?;
        Evidence::new(&data, &covariance, inducing, compute)
    };
    let of_parts = left_out.iter().map(evidence_of).collect::<Result<Vec<_>, GpError>>()?;
    let evidence = EvidenceParts { of_parts, unknowns };

    let all = evidence.without(None);
    let projection = all.projection.as_ref().subcols(0, 1).to_owned();
    let sparse = Sparse::new(covariance, inducing.to_vec(), width, all.products, projection)?;
    let errors = errors_left_out(&sparse, &evidence, rows, (left_out, 1))?;
    Ok(Some(SeenByAll { process: Process::Sparse(sparse), errors, evidence }))
}

/// Error and variance of every row, predicted by physics and process that have not seen the part
/// around it.
///
/// - `left_out`: the parts, and the output of the evidence that is the residual of the first one
pub(super) fn errors_left_out(
    sparse: &Sparse,
    evidence: &EvidenceParts,
    rows: &ResidualRows,
    (left_out, first): (&[LeftOutRows], usize),
) -> Result<Vec<(f64, f64)>, GpError> {
    let mut errors = Vec::with_capacity(rows.residual.len());
    for (index, part) in left_out.iter().enumerate() {
        let process =
            Process::Sparse(sparse.having_seen(&evidence.without(Some(index)), first + index)?);
        errors.extend(process.errors(rows, part)?);
    }
    Ok(errors)
}

/// The covariance with the errors of `others`, rows that the process has not seen; none if these
/// are zero.
///
/// - `longest_memory`: of the errors, s
fn with_errors_of(
    gp: &GaussianProcess,
    others: &[usize],
    rows: &ResidualRows,
    longest_memory: f64,
) -> Result<Option<Covariance>, GpError> {
    let width = gp.data().inputs();
    let x = rows.at(others, width);
    let mean = gp.predict(&x, false)?.mean;
    let errors: Vec<f64> =
        others.iter().zip(&mean).map(|(&row, mean)| rows.residual[row] - mean).collect();
    if errors.iter().all(|error| *error == 0.0) {
        return Ok(None);
    }
    let time = width - 1;
    let times: Vec<f64> = x.iter().skip(time).step_by(width).copied().collect();
    let noise = FadingNoise::most_likely(&times, &errors, time, (SHORTEST_MEMORY, longest_memory))?;
    let memory =
        Kernel::isotropic(Shape::Exponential, 1, noise.length).on(&[time]).scaled(noise.shared);
    Ok(Some(
        Covariance::new(gp.covariance().signal.clone(), noise.independent)
            .with_correlated_noise(memory),
    ))
}
