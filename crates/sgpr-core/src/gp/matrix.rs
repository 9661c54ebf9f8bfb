//! Covariance matrices: the lower triangle assembled, factored and inverted in place.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor as llt;
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_inverse::invert_lower_triangular;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::prelude::*;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::kernels::{Features, Plan, TILE};
use super::{Compute, GpError};

/// Columns that one thread works on at a time.
const COLUMNS: usize = 64;

/// Share of the variance that is added to the diagonal when the first factorisation fails, and its largest value.
const FIRST_JITTER: f64 = 1e-10;
const LARGEST_JITTER: f64 = 1e-4;

/// A square matrix; more rows than needed where columns would fall on each other in the cache.
pub(super) fn square(n: usize) -> Mat<f64> {
    Mat::zeros(if n.is_multiple_of(512) { n + 8 } else { n }, n)
}

pub(super) fn view(matrix: &Mat<f64>) -> MatRef<'_, f64> {
    matrix.as_ref().submatrix(0, 0, matrix.ncols(), matrix.ncols())
}

pub(super) fn view_mut(matrix: &mut Mat<f64>) -> MatMut<'_, f64> {
    let n = matrix.ncols();
    matrix.as_mut().submatrix_mut(0, 0, n, n)
}

/// Lower triangle of K + diagonal * I.
pub(super) fn assemble(plan: &Plan, points: &Features<f64>, diagonal: f64, matrix: &mut Mat<f64>, compute: &Compute) {
    let work = |(block, columns): (usize, MatMut<'_, f64>)| {
        Arch::new().dispatch(Assemble { plan, points, diagonal, first: block * COLUMNS, columns });
    };
    if compute.threads > 1 {
        view_mut(matrix).par_col_chunks_mut(COLUMNS).enumerate().for_each(work);
    } else {
        let n = matrix.ncols();
        for first in (0..n).step_by(COLUMNS) {
            work((first / COLUMNS, view_mut(matrix).subcols_mut(first, COLUMNS.min(n - first))));
        }
    }
}

struct Assemble<'a> {
    plan: &'a Plan,
    points: &'a Features<f64>,
    diagonal: f64,
    first: usize,
    columns: MatMut<'a, f64>,
}

impl WithSimd for Assemble<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { plan, points, diagonal, first, mut columns } = self;
        let (mut query, mut work) = (plan.query(), plan.work());
        for (k, column) in columns.as_mut().col_iter_mut().enumerate() {
            let j = first + k;
            let column = column.try_as_col_major_mut().expect("column-major").as_slice_mut();
            points.point(j, &mut query);
            for (start, length) in points.tiles_from(j) {
                let values = plan.values::<_, S, false>(simd, points, (start, length), &query, &mut work);
                let end = (start + length).min(column.len());
                column[start..end].copy_from_slice(&values[..end - start]);
            }
            column[j] = plan.variance() + diagonal;
        }
    }
}

/// Columns of an inverse that exist at a time.
const PANEL: usize = 512;

/// Room for [`likelihood_gradient`].
pub(super) fn panel(n: usize) -> Mat<f64> {
    Mat::zeros(n, PANEL.min(n))
}

/// Sum over the lower triangle of dK/dtheta * weight, with weight = sum over outputs of alpha alpha' - outputs * inverse
/// off the diagonal and half of it on the diagonal: the gradient of the log marginal likelihood (GPML eq. 5.9). Returns the
/// trace of the inverse, too.
///
/// The inverse is K⁻¹ - G Gᵀ with `explained` = G, if there is one, and K⁻¹ = L⁻ᵀ L⁻¹; some of its columns at a time, in `panel`.
pub(super) fn likelihood_gradient(
    plan: &Plan,
    points: &Features<f64>,
    alpha: &[Vec<f64>],
    inverse_factor: MatRef<'_, f64>,
    explained: Option<&Mat<f64>>,
    panel: &mut Mat<f64>,
    compute: &Compute,
) -> (Vec<f64>, f64) {
    let n = inverse_factor.ncols();
    let (mut gradient, mut trace) = (vec![0.0; plan.theta_len()], 0.0);
    for start in (0..n).step_by(PANEL) {
        let width = PANEL.min(n - start);
        let mut inverse = panel.as_mut().submatrix_mut(0, 0, n - start, width);
        inverse_columns(inverse_factor.submatrix(start, start, n - start, n - start), inverse.rb_mut(), compute.par());
        if let Some(explained) = explained {
            let rows = explained.as_ref().subrows(start, n - start);
            let columns = rows.subrows(0, width).transpose();
            faer::linalg::matmul::matmul(inverse.rb_mut(), Accum::Add, rows, columns, -1.0, compute.par());
        }
        trace += (0..width).map(|k| inverse[(k, k)]).sum::<f64>();
        let inverse = inverse.rb();
        let block = |first: usize| {
            let columns = inverse.subcols(first, COLUMNS.min(width - first));
            Arch::new().dispatch(LikelihoodGradient { plan, points, alpha, start, first: start + first, columns })
        };
        let blocks: Vec<Vec<f64>> = if compute.threads > 1 {
            (0..width.div_ceil(COLUMNS)).into_par_iter().map(|k| block(k * COLUMNS)).collect()
        } else {
            (0..width).step_by(COLUMNS).map(block).collect()
        };
        for block in blocks {
            gradient.iter_mut().zip(block).for_each(|(sum, part)| *sum += part);
        }
    }
    (gradient, trace)
}

/// The first columns of L⁻ᵀ L⁻¹, of which the lower triangle counts.
fn inverse_columns(inverse_factor: MatRef<'_, f64>, mut out: MatMut<'_, f64>, par: Par) {
    let width = out.ncols();
    let (top, _, side, rest) = inverse_factor.split_at(width, width);
    let (mut first, mut below) = out.rb_mut().split_at_row_mut(width);
    let (upper, lower, rectangular) =
        (BlockStructure::TriangularUpper, BlockStructure::TriangularLower, BlockStructure::Rectangular);
    matmul(first.rb_mut(), lower, Accum::Replace, top.transpose(), upper, top, lower, 1.0, par);
    matmul(first.rb_mut(), lower, Accum::Add, side.transpose(), rectangular, side, rectangular, 1.0, par);
    matmul(below.rb_mut(), rectangular, Accum::Replace, rest.transpose(), upper, side, rectangular, 1.0, par);
}

struct LikelihoodGradient<'a> {
    plan: &'a Plan,
    points: &'a Features<f64>,
    alpha: &'a [Vec<f64>],
    /// The point of the first row.
    start: usize,
    /// The point of the first column.
    first: usize,
    columns: MatRef<'a, f64>,
}

impl WithSimd for LikelihoodGradient<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f64> {
        let Self { plan, points, alpha, start: above, first, columns } = self;
        let (mut query, mut work) = (plan.query(), plan.work());
        let mut gradient = vec![0.0; plan.theta_len()];
        let mut weights = [0.0; TILE];
        let outputs = alpha.len() as f64;
        for (k, column) in columns.col_iter().enumerate() {
            let j = first + k;
            let column = column.try_as_col_major().expect("column-major").as_slice();
            points.point(j, &mut query);
            for (start, length) in points.tiles_from(j) {
                let end = (start + length).min(above + column.len());
                let weights = &mut weights[..length];
                weights
                    .iter_mut()
                    .zip(&column[start - above..end - above])
                    .for_each(|(w, inverse)| *w = -outputs * *inverse);
                for alpha in alpha {
                    let own = alpha[j];
                    weights.iter_mut().zip(&alpha[start..end]).for_each(|(w, alpha)| *w += own * alpha);
                }
                weights[end - start..].fill(0.0);
                if start <= j {
                    weights[..j - start].fill(0.0);
                    weights[j - start] *= 0.5;
                }
                plan.values::<_, S, true>(simd, points, (start, length), &query, &mut work);
                plan.gradient(simd, points, (start, length), &query, weights, &mut work, &mut gradient, None);
            }
        }
        gradient
    }
}

/// Assembles and factors K + noise * I = L Lᵀ in place, with jitter on the diagonal only if it fails without; returns
/// the jitter.
pub(super) fn assemble_and_factor(
    plan: &Plan,
    points: &Features<f64>,
    noise: f64,
    matrix: &mut Mat<f64>,
    compute: &Compute,
) -> Result<f64, GpError> {
    let mut jitter = 0.0;
    loop {
        assemble(plan, points, noise + jitter, matrix, compute);
        if factor(view_mut(matrix), compute.par()) {
            return Ok(jitter);
        }
        jitter = if jitter == 0.0 { FIRST_JITTER * plan.variance() } else { 10.0 * jitter };
        // The product of rounding can fall on either side of the limit.
        if jitter.is_nan() || jitter > 1.5 * LARGEST_JITTER * plan.variance() {
            return Err(GpError::NotPositiveDefinite { jitter: LARGEST_JITTER * plan.variance() });
        }
    }
}

/// L in the lower triangle of `matrix`; false if it is not positive definite.
pub(super) fn factor(matrix: MatMut<'_, f64>, par: Par) -> bool {
    let n = matrix.nrows();
    let mut buffer = MemBuffer::new(llt::cholesky_in_place_scratch::<f64>(n, par, Default::default()));
    llt::cholesky_in_place(matrix, Default::default(), par, MemStack::new(&mut buffer), Default::default()).is_ok()
}

/// L⁻¹ in the lower triangle of `out`.
pub(super) fn invert_factor(factor: MatRef<'_, f64>, out: MatMut<'_, f64>, par: Par) {
    invert_lower_triangular(out, factor, par);
}

/// The same in place of L; `panel` as for [`likelihood_gradient`].
pub(super) fn invert_in_place(mut lower: MatMut<'_, f64>, panel: &mut Mat<f64>, par: Par) {
    let n = lower.nrows();
    if n <= PANEL {
        let copy = panel.as_mut().submatrix_mut(0, 0, n, n);
        invert_lower_triangular(copy, lower.rb(), par);
        for column in 0..n {
            let inverse = panel.col_as_slice(column);
            lower.rb_mut().col_mut(column).try_as_col_major_mut().expect("column-major").as_slice_mut()[column..]
                .copy_from_slice(&inverse[column..n]);
        }
        return;
    }
    // [A 0; B C]⁻¹ = [A⁻¹ 0; -C⁻¹ B A⁻¹ C⁻¹]
    let middle = (n / 2).next_multiple_of(PANEL);
    let (mut first, _, mut side, mut last) = lower.split_at_mut(middle, middle);
    invert_in_place(first.rb_mut(), panel, par);
    let (rectangular, triangular) = (BlockStructure::Rectangular, BlockStructure::TriangularLower);
    for start in (0..n - middle).step_by(PANEL) {
        let rows = side.rb_mut().subrows_mut(start, PANEL.min(n - middle - start));
        // Transposed, for a panel is tall.
        let mut copy = panel.as_mut().submatrix_mut(0, 0, middle, rows.nrows());
        copy.copy_from(rows.rb().transpose());
        matmul(rows, rectangular, Accum::Replace, copy.transpose(), rectangular, first.rb(), triangular, -1.0, par);
    }
    solve_lower_triangular_in_place(last.rb(), side, par);
    invert_in_place(last.rb_mut(), panel, par);
}

/// Lower triangle of (L Lᵀ)⁻¹ = L⁻ᵀ L⁻¹ from L⁻¹.
pub(super) fn inverse_from(inverse_factor: MatRef<'_, f64>, out: MatMut<'_, f64>, par: Par) {
    matmul(
        out,
        BlockStructure::TriangularLower,
        Accum::Replace,
        inverse_factor.transpose(),
        BlockStructure::TriangularUpper,
        inverse_factor,
        BlockStructure::TriangularLower,
        1.0,
        par,
    );
}
