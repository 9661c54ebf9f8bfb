//! Covariance matrices: the lower triangle assembled, factored and inverted in place.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor as llt;
use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_inverse::invert_lower_triangular;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::prelude::*;
use faer::traits::RealField;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::kernels::{Element, Features, Plan, TILE};
use super::{Compute, Data, GpError};

/// Columns that one thread works on at a time.
const COLUMNS: usize = 64;

/// Share of the variance that is added to the diagonal when the first factorisation fails, and its
/// largest value.
const FIRST_JITTER: f64 = 1e-10;
const LARGEST_JITTER: f64 = 1e-4;

/// Double or single precision.
pub(super) trait FloatNumber: Element + RealField + bytemuck::Pod {}

impl FloatNumber for f64 {}
impl FloatNumber for f32 {}

/// Memory of a matrix, by columns: of doubles, or of singles in the first half of each column.
#[derive(Clone, Debug)]
pub(super) struct Storage {
    numbers: Vec<f64>,
    rows: usize,
    columns: usize,
    /// Doubles from one column to the next.
    stride: usize,
}

impl Storage {
    /// More rows than needed where columns would fall on each other in the cache.
    pub fn new(rows: usize, columns: usize) -> Self {
        // Whole cache lines.
        let stride = rows.next_multiple_of(8);
        let stride = if stride.is_multiple_of(512) { stride + 8 } else { stride };
        Self { numbers: vec![0.0; stride * columns], rows, columns, stride }
    }

    pub fn square(n: usize) -> Self {
        Self::new(n, n)
    }

    pub fn columns(&self) -> usize {
        self.columns
    }

    pub fn view<T: FloatNumber>(&self) -> MatRef<'_, T> {
        let stride = self.stride * size_of::<f64>() / size_of::<T>();
        let numbers = bytemuck::cast_slice(&self.numbers);
        MatRef::from_column_major_slice_with_stride(numbers, self.rows, self.columns, stride)
    }

    pub fn view_mut<T: FloatNumber>(&mut self) -> MatMut<'_, T> {
        let stride = self.stride * size_of::<f64>() / size_of::<T>();
        let numbers = bytemuck::cast_slice_mut(&mut self.numbers);
        MatMut::from_column_major_slice_with_stride_mut(numbers, self.rows, self.columns, stride)
    }

    /// Rounds doubles to singles, in place.
    pub fn round(&mut self) {
        let mut doubles = vec![0.0; self.stride];
        for column in self.numbers.chunks_exact_mut(self.stride) {
            doubles.copy_from_slice(column);
            let singles: &mut [f32] = bytemuck::cast_slice_mut(column);
            singles.iter_mut().zip(&doubles).for_each(|(single, double)| *single = *double as f32);
        }
    }
}

/// Lower triangle of K + diagonal * I.
pub(super) fn assemble(
    plan: &Plan,
    points: &Features<f64>,
    diagonal: f64,
    mut matrix: MatMut<'_, f64>,
    compute: &Compute,
) {
    let work = |(block, columns): (usize, MatMut<'_, f64>)| {
        Arch::new().dispatch(Assemble { plan, points, diagonal, first: block * COLUMNS, columns });
    };
    if compute.threads > 1 {
        matrix.par_col_chunks_mut(COLUMNS).enumerate().for_each(work);
    } else {
        let n = matrix.ncols();
        for first in (0..n).step_by(COLUMNS) {
            work((first / COLUMNS, matrix.rb_mut().subcols_mut(first, COLUMNS.min(n - first))));
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
        let queries = points.queries(plan, first, columns.ncols());
        let mut work = plan.work();
        for (start, length) in points.tiles_from(first) {
            let end = (start + length).min(columns.nrows());
            for (k, query) in queries.iter().enumerate().filter(|(k, _)| first + k < end) {
                let values =
                    plan.values::<_, S, false>(simd, points, (start, length), query, &mut work);
                let column = columns
                    .as_mut()
                    .col_mut(k)
                    .try_as_col_major_mut()
                    .expect("column-major")
                    .as_slice_mut();
                column[start..end].copy_from_slice(&values[..end - start]);
            }
        }
        for k in 0..columns.ncols() {
            columns[(first + k, k)] = plan.variance() + diagonal;
        }
    }
}

/// Columns of an inverse that exist at a time.
const PANEL: usize = 512;

const FULL: BlockStructure = BlockStructure::Rectangular;
const LOWER: BlockStructure = BlockStructure::TriangularLower;
const UPPER: BlockStructure = BlockStructure::TriangularUpper;

/// Room for [`likelihood_gradient`].
pub(super) fn panel(n: usize) -> Storage {
    Storage::new(n, PANEL.min(n))
}

/// What sums over an inverse give.
pub(super) struct InverseSums {
    pub gradient: Vec<f64>,
    pub trace: f64,
    /// The inverse times the first output.
    pub product: Vec<f64>,
}

/// Sum over the lower triangle of dK/dtheta * weight, with weight = sum over outputs of alpha
/// alpha' - outputs * inverse off the diagonal and half of it on the diagonal: the gradient of the
/// log marginal likelihood (GPML eq. 5.9).
///
/// The inverse is K⁻¹ - G Gᵀ with `explained` = G, if there is one, and K⁻¹ = L⁻ᵀ L⁻¹; some of its
/// columns at a time, in `panel`.
pub(super) fn likelihood_gradient<T: FloatNumber>(
    plan: &Plan,
    data: &Data,
    alpha: &[Vec<f64>],
    inverse_factor: MatRef<'_, T>,
    explained: Option<&Mat<f64>>,
    mut panel: MatMut<'_, T>,
    compute: &Compute,
) -> InverseSums {
    let n = inverse_factor.ncols();
    let points = &plan.features(data.x(), data.inputs());
    let y: Vec<f64> = data.y().iter().step_by(data.outputs()).copied().collect();
    let explained = explained
        .map(|explained| Mat::from_fn(n, explained.ncols(), |i, k| T::from_f64(explained[(i, k)])));
    let (mut gradient, mut trace, mut product) = (vec![0.0; plan.theta_len()], 0.0, vec![0.0; n]);
    for start in (0..n).step_by(PANEL) {
        let width = PANEL.min(n - start);
        let mut inverse = panel.rb_mut().submatrix_mut(0, 0, n - start, width);
        inverse_columns(
            inverse_factor.submatrix(start, start, n - start, n - start),
            inverse.rb_mut(),
            compute.par(),
        );
        if let Some(explained) = &explained {
            let rows = explained.as_ref().subrows(start, n - start);
            let columns = rows.subrows(0, width).transpose();
            faer::linalg::matmul::matmul(
                inverse.rb_mut(),
                Accum::Add,
                rows,
                columns,
                T::from_f64(-1.0),
                compute.par(),
            );
        }
        trace += (0..width).map(|k| inverse[(k, k)].to_f64()).sum::<f64>();
        let inverse = inverse.rb();
        let block = |first: usize| {
            let columns = inverse.subcols(first, COLUMNS.min(width - first));
            Arch::new().dispatch(LikelihoodGradient {
                plan,
                points,
                alpha,
                start,
                first: start + first,
                columns,
            })
        };
        let blocks: Vec<Vec<f64>> = if compute.threads > 1 {
            (0..width.div_ceil(COLUMNS)).into_par_iter().map(|k| block(k * COLUMNS)).collect()
        } else {
            (0..width).step_by(COLUMNS).map(block).collect()
        };
        for block in blocks {
            gradient.iter_mut().zip(block).for_each(|(sum, part)| *sum += part);
        }
        for k in 0..width {
            let column = inverse.col(k).try_as_col_major().expect("column-major").as_slice();
            add_symmetric_product(&column[k..], &y[start + k..], &mut product[start + k..]);
        }
    }
    InverseSums { gradient, trace, product }
}

/// Adds A y for a symmetric A with this first column and zeros elsewhere.
fn add_symmetric_product<T: FloatNumber>(column: &[T], y: &[f64], product: &mut [f64]) {
    let mut sum = 0.0;
    for ((value, y_below), product) in column.iter().zip(y).zip(product.iter_mut()).skip(1) {
        let value = value.to_f64();
        *product += value * y[0];
        sum += value * y_below;
    }
    product[0] += sum + column[0].to_f64() * y[0];
}

/// The first columns of L⁻ᵀ L⁻¹, of which the lower triangle counts: a sum over blocks of rows of
/// L⁻¹.
fn inverse_columns<T: FloatNumber>(
    inverse_factor: MatRef<'_, T>,
    mut out: MatMut<'_, T>,
    par: Par,
) {
    let one = T::from_f64(1.0);
    let (n, width) = (inverse_factor.nrows(), out.ncols());
    let top = inverse_factor.submatrix(0, 0, width, width);
    matmul(
        out.rb_mut().subrows_mut(0, width),
        LOWER,
        Accum::Replace,
        top.transpose(),
        UPPER,
        top,
        LOWER,
        one,
        par,
    );
    let block = block(n - width, par);
    for start in (width..n).step_by(block) {
        let height = block.min(n - start);
        let (left, diagonal) =
            inverse_factor.submatrix(start, 0, height, start + height).split_at_col(start);
        let (right, left) = left.split_at_col(width);
        let (above, rest) = out.rb_mut().split_at_row_mut(start);
        let (first, above) = above.split_at_row_mut(width);
        matmul(first, LOWER, Accum::Add, right.transpose(), FULL, right, FULL, one, par);
        add_product(above, left.transpose(), right, one, par);
        let here = rest.split_at_row_mut(height).0;
        matmul(here, FULL, Accum::Replace, diagonal.transpose(), UPPER, right, FULL, one, par);
    }
}

struct LikelihoodGradient<'a, T> {
    plan: &'a Plan,
    points: &'a Features<f64>,
    alpha: &'a [Vec<f64>],
    /// The point of the first row.
    start: usize,
    /// The point of the first column.
    first: usize,
    columns: MatRef<'a, T>,
}

impl<T: FloatNumber> WithSimd for LikelihoodGradient<'_, T> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<f64> {
        let Self { plan, points, alpha, start: above, first, columns } = self;
        let queries = points.queries(plan, first, columns.ncols());
        let mut work = plan.work();
        let mut gradient = vec![0.0; plan.theta_len()];
        let mut weights = [0.0; TILE];
        let outputs = alpha.len() as f64;
        for (start, length) in points.tiles_from(first) {
            let end = (start + length).min(above + columns.nrows());
            let weights = &mut weights[..length];
            for (k, query) in queries.iter().enumerate().filter(|(k, _)| first + k < end) {
                let j = first + k;
                let column = columns.col(k).try_as_col_major().expect("column-major").as_slice();
                let inverse = &column[start - above..end - above];
                weights
                    .iter_mut()
                    .zip(inverse)
                    .for_each(|(w, inverse)| *w = -outputs * inverse.to_f64());
                for alpha in alpha {
                    let own = alpha[j];
                    weights
                        .iter_mut()
                        .zip(&alpha[start..end])
                        .for_each(|(w, alpha)| *w += own * alpha);
                }
                weights[end - start..].fill(0.0);
                // Above the diagonal nothing counts.
                if start <= j {
                    weights[..j - start].fill(0.0);
                    weights[j - start] *= 0.5;
                }
                plan.values::<_, S, true>(simd, points, (start, length), query, &mut work);
                plan.gradient(
                    simd,
                    (points, start, length),
                    query,
                    weights,
                    &mut work,
                    (&mut gradient, None),
                );
            }
        }
        gradient
    }
}

/// Assembles and factors K + noise * I = L Lᵀ in place, with jitter on the diagonal only if it
/// fails without; returns the jitter.
pub(super) fn assemble_and_factor(
    plan: &Plan,
    points: &Features<f64>,
    noise: f64,
    mut matrix: MatMut<'_, f64>,
    compute: &Compute,
) -> Result<f64, GpError> {
    let mut jitter = 0.0;
    loop {
        assemble(plan, points, noise + jitter, matrix.rb_mut(), compute);
        if factor(matrix.rb_mut(), compute.par()) {
            return Ok(jitter);
        }
        jitter = if jitter == 0.0 { FIRST_JITTER * plan.variance() } else { 10.0 * jitter };
        // The product of rounding can fall on either side of the limit; that of a tiny variance can
        // vanish.
        if !(jitter > 0.0 && jitter <= 1.5 * LARGEST_JITTER * plan.variance()) {
            return Err(GpError::NotPositiveDefinite { jitter: LARGEST_JITTER * plan.variance() });
        }
    }
}

/// L in the lower triangle of `matrix`; false if it is not positive definite.
///
/// Column by column of blocks, each less the products of what is to its left: sums as long as they
/// can be, for a product of few columns waits for memory.
pub(super) fn factor(mut matrix: MatMut<'_, f64>, par: Par) -> bool {
    let n = matrix.nrows();
    let block = block(n, par);
    let mut copy = Mat::zeros(if block < n { block } else { 0 }, block);
    for start in (0..n).step_by(block) {
        let width = block.min(n - start);
        let (_, _, left, columns) = matrix.rb_mut().split_at_mut(start, start);
        let (left, columns) = (left.rb(), columns.split_at_col_mut(width).0);
        let (mut diagonal, mut below) = columns.split_at_row_mut(width);
        for first in (0..start).step_by(block) {
            let (beside, left) = left.subcols(first, block).split_at_row(width);
            // Transposed in memory: rows that are read across the columns of a large matrix cost a
            // tenth.
            let mut transposed = copy.as_mut().subcols_mut(0, width);
            transposed.copy_from(beside.transpose());
            matmul(
                diagonal.rb_mut(),
                LOWER,
                Accum::Add,
                beside,
                FULL,
                transposed.rb(),
                FULL,
                -1.0,
                par,
            );
            add_product(below.rb_mut(), left, transposed.rb(), -1.0, par);
        }
        if !factor_block(diagonal.rb_mut(), par) {
            return false;
        }
        solve_lower_triangular_in_place(diagonal.rb(), below.transpose_mut(), par);
    }
    true
}

/// The same for a block.
fn factor_block(matrix: MatMut<'_, f64>, par: Par) -> bool {
    let n = matrix.nrows();
    let mut buffer =
        MemBuffer::new(llt::cholesky_in_place_scratch::<f64>(n, par, Default::default()));
    llt::cholesky_in_place(
        matrix,
        Default::default(),
        par,
        MemStack::new(&mut buffer),
        Default::default(),
    )
    .is_ok()
}

/// Rows and columns of the blocks in which triangular matrices are treated: what one core keeps in
/// its cache; several share work better if there is much of it.
fn block(n: usize, par: Par) -> usize {
    if matches!(par, Par::Seq) { PANEL } else { n.max(1) }
}

/// out += factor * a b, a block of rows after the other.
fn add_product<T: FloatNumber>(
    mut out: MatMut<'_, T>,
    a: MatRef<'_, T>,
    b: MatRef<'_, T>,
    factor: T,
    par: Par,
) {
    let rows = out.nrows();
    for start in (0..rows).step_by(PANEL) {
        let height = PANEL.min(rows - start);
        let out = out.rb_mut().subrows_mut(start, height);
        faer::linalg::matmul::matmul(out, Accum::Add, a.subrows(start, height), b, factor, par);
    }
}

/// L⁻¹ in the lower triangle of `out`.
pub(super) fn invert_factor(factor: MatRef<'_, f64>, out: MatMut<'_, f64>, par: Par) {
    invert_lower_triangular(out, factor, par);
}

/// The same in place of L, `panel` as for [`likelihood_gradient`]: the columns of a block of the
/// identity by forward substitution.
pub(super) fn invert_in_place<T: FloatNumber>(
    mut lower: MatMut<'_, T>,
    mut panel: MatMut<'_, T>,
    par: Par,
) {
    let n = lower.nrows();
    for start in (0..n).step_by(PANEL) {
        let width = PANEL.min(n - start);
        let (mut diagonal, _, mut side, rest) =
            lower.rb_mut().split_at_mut(start, start).3.split_at_mut(width, width);
        let rest = rest.rb();
        let mut copy = panel.rb_mut().submatrix_mut(0, 0, width, width);
        invert_lower_triangular(copy.rb_mut(), diagonal.rb(), par);
        diagonal.copy_from_triangular_lower(copy.rb());
        // [A 0; B C]⁻¹ = [A⁻¹ 0; -C⁻¹ B A⁻¹ C⁻¹]
        let rows = side.nrows();
        let mut copy = panel.rb_mut().submatrix_mut(0, 0, rows, width);
        copy.copy_from(side.rb());
        matmul(
            side.rb_mut(),
            FULL,
            Accum::Replace,
            copy.rb(),
            FULL,
            diagonal.rb(),
            LOWER,
            T::from_f64(-1.0),
            par,
        );
        substitute(rest, side, par);
    }
}

/// Diagonal of (L Lᵀ)⁻¹: squares of the columns of L⁻¹, of which some exist at a time.
pub(super) fn inverse_diagonal(lower: MatRef<'_, f64>, par: Par) -> Vec<f64> {
    let n = lower.nrows();
    let mut panel = panel(n);
    let mut diagonal = Vec::with_capacity(n);
    for start in (0..n).step_by(PANEL) {
        let width = PANEL.min(n - start);
        let mut columns = panel.view_mut().submatrix_mut(0, 0, n - start, width);
        columns.fill(0.0);
        (0..width).for_each(|k| columns[(k, k)] = 1.0);
        substitute(lower.submatrix(start, start, n - start, n - start), columns.rb_mut(), par);
        diagonal.extend(columns.rb().col_iter().map(|column| column.squared_norm_l2()));
    }
    diagonal
}

/// L⁻¹ times `columns`, in place.
fn substitute<T: FloatNumber>(lower: MatRef<'_, T>, columns: MatMut<'_, T>, par: Par) {
    if matches!(par, Par::Seq) {
        substitute_here(lower, columns);
    } else {
        let share = columns.ncols().div_ceil(par.degree());
        columns.par_col_chunks_mut(share).for_each(|columns| substitute_here(lower, columns));
    }
}

/// The same on one thread.
fn substitute_here<T: FloatNumber>(lower: MatRef<'_, T>, mut columns: MatMut<'_, T>) {
    let n = lower.nrows();
    for start in (0..n).step_by(PANEL) {
        let height = PANEL.min(n - start);
        let (diagonal, left) =
            lower.submatrix(start, start, n - start, height).split_at_row(height);
        let (mut solved, below) =
            columns.rb_mut().split_at_row_mut(start).1.split_at_row_mut(height);
        solve_lower_triangular_in_place(diagonal, solved.rb_mut(), Par::Seq);
        add_product(below, left, solved.rb(), T::from_f64(-1.0), Par::Seq);
    }
}

/// Lower triangle of (L Lᵀ)⁻¹ = L⁻ᵀ L⁻¹ from L⁻¹.
pub(super) fn inverse_from(inverse_factor: MatRef<'_, f64>, out: MatMut<'_, f64>, par: Par) {
    matmul(
        out,
        LOWER,
        Accum::Replace,
        inverse_factor.transpose(),
        UPPER,
        inverse_factor,
        LOWER,
        1.0,
        par,
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A covariance of points on a line, of two whole blocks and a part of one.
    fn covariance_matrix(n: usize) -> Mat<f64> {
        Mat::from_fn(n, n, |i, j| {
            (-((i as f64 - j as f64) / 40.0).powi(2)).exp() + if i == j { 0.1 } else { 0.0 }
        })
    }

    fn lower(matrix: &Mat<f64>) -> Mat<f64> {
        Mat::from_fn(
            matrix.nrows(),
            matrix.ncols(),
            |i, j| if i >= j { matrix[(i, j)] } else { 0.0 },
        )
    }

    #[test]
    fn factor_and_inverse_in_blocks_are_those_of_the_matrix() {
        let n = 2 * PANEL + 77;
        let (covariance, identity) = (covariance_matrix(n), Mat::<f64>::identity(n, n));
        for par in [Par::Seq, Par::rayon(2)] {
            let mut matrix = covariance.clone();
            assert!(factor(matrix.as_mut(), par));
            let root = lower(&matrix);
            assert!((&root * root.transpose() - &covariance).norm_max() < 1e-13);

            let mut panel = Mat::zeros(n, PANEL);
            invert_in_place(matrix.as_mut(), panel.as_mut(), par);
            let inverse_root = lower(&matrix);
            assert!((&root * &inverse_root - &identity).norm_max() < 1e-13);

            for start in (0..n).step_by(PANEL) {
                let width = PANEL.min(n - start);
                let rest = matrix.as_ref().submatrix(start, start, n - start, n - start);
                inverse_columns(rest, panel.as_mut().submatrix_mut(0, 0, n - start, width), par);
                let expected = inverse_root.transpose() * inverse_root.subcols(start, width);
                let difference =
                    |i: usize, k: usize| (panel[(i - start, k)] - expected[(i, k)]).abs();
                assert!((0..width).all(|k| (start + k..n).all(|i| difference(i, k) < 1e-12)));
            }
        }
    }

    #[test]
    fn the_diagonal_of_an_inverse_is_found_by_itself() {
        let n = PANEL + 77;
        let mut matrix = covariance_matrix(n);
        assert!(factor(matrix.as_mut(), Par::Seq));
        let root = lower(&matrix);
        let inverse_root = {
            let mut inverse = Mat::<f64>::identity(n, n);
            solve_lower_triangular_in_place(root.as_ref(), inverse.as_mut(), Par::Seq);
            inverse
        };
        for par in [Par::Seq, Par::rayon(2)] {
            for (i, value) in inverse_diagonal(matrix.as_ref(), par).into_iter().enumerate() {
                assert!((value - inverse_root.col(i).squared_norm_l2()).abs() < 1e-11);
            }
        }
    }

    #[test]
    fn a_matrix_that_is_not_positive_definite_is_found_in_every_block() {
        for wrong in [3, PANEL + 3, 2 * PANEL + 3] {
            let mut matrix = covariance_matrix(2 * PANEL + 77);
            matrix[(wrong, wrong)] = -1.0;
            assert!(!factor(matrix.as_mut(), Par::Seq));
        }
    }
}
