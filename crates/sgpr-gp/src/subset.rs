//! Which points carry the information: near-duplicates, of which logs are full, say nothing new.

use pulp::{Arch, Simd, WithSimd};

use super::Kernel;
use super::kernels::{Features, Plan};

/// Numbers that the partial Cholesky factor of [`informative_points`] may hold; candidates are
/// thinned to this.
const LARGEST_FACTOR: usize = 1 << 26;

/// The `count` points of `x` (`[points, inputs]`, row-major) about which the others say least: one
/// after the other, the point whose variance, given those chosen before, is largest (a Cholesky
/// factorisation with pivoting). Ends early when no variance is left. The order is that of choice.
///
/// More candidates than memory is meant for are first thinned: of each stretch of 2,048 the most
/// informative ones stay.
///
/// Source: L. Foster et al., Stable and efficient Gaussian process calculations, J. Mach. Learn.
/// Res. 10 (2009).
pub fn informative_points(kernel: &Kernel, x: &[f64], inputs: usize, count: usize) -> Vec<usize> {
    let points = x.len() / inputs;
    let most = (LARGEST_FACTOR / count.max(1)).max(count);
    if points > most {
        let candidates = if 4 * count <= most {
            stay(kernel, x, inputs, 4 * count)
        } else {
            spread_points(kernel, x, inputs, most)
        };
        let thinned: Vec<f64> = candidates
            .iter()
            .flat_map(|&i| x[i * inputs..(i + 1) * inputs].iter().copied())
            .collect();
        let chosen = informative_points(kernel, &thinned, inputs, count);
        return chosen.into_iter().map(|k| candidates[k]).collect();
    }
    let plan = Plan::new(kernel);
    let features = plan.features::<f64>(x, inputs);
    partial_factor(&plan, &features, count).0
}

/// At most `count` steps of a Cholesky factorisation with pivoting: the points that were chosen,
/// and for each the row of R, K ≈ Rᵀ R. Ends early when no variance is left.
pub(super) fn partial_factor(
    plan: &Plan,
    features: &Features<f64>,
    count: usize,
) -> (Vec<usize>, Vec<Vec<f64>>) {
    let mut variance = vec![plan.variance(); features.count()];
    let mut factor: Vec<Vec<f64>> = Vec::new();
    let mut chosen = Vec::new();
    while chosen.len() < count.min(variance.len()) {
        let (pivot, largest) = largest_of(&variance);
        if largest <= 1e-10 * plan.variance() {
            break;
        }
        let mut row = covariances(plan, features, pivot);
        for earlier in &factor {
            let share = earlier[pivot];
            row.iter_mut().zip(earlier).for_each(|(row, earlier)| *row -= share * earlier);
        }
        let root = largest.sqrt();
        for (row, variance) in row.iter_mut().zip(&mut variance) {
            *row /= root;
            *variance -= *row * *row;
        }
        variance[pivot] = f64::NEG_INFINITY;
        factor.push(row);
        chosen.push(pivot);
    }
    (chosen, factor)
}

/// Points that a stretch is thinned to, if `fewest` allow it, and its length: the factor of a
/// stretch fits into the cache.
const STAYING: usize = 128;
const STRETCH: usize = 2048;

/// At least `fewest` points, if there are: the most informative ones of every stretch.
fn stay(kernel: &Kernel, x: &[f64], inputs: usize, fewest: usize) -> Vec<usize> {
    let points = x.len() / inputs;
    let staying = (fewest * STRETCH).div_ceil(points).clamp(STAYING, STRETCH);
    let of_stretch = |(stretch, x): (usize, &[f64])| {
        let mut chosen = informative_points(kernel, x, inputs, staying);
        chosen.sort_unstable();
        chosen.into_iter().map(move |k| stretch * STRETCH + k)
    };
    x.chunks(STRETCH * inputs).enumerate().flat_map(of_stretch).collect()
}

/// `count` points of `x` spread evenly: one after the other, the point least alike to those chosen
/// before. Memory grows with the number of points only, so a million are no burden.
///
/// Source: T. F. Gonzalez, Clustering to minimize the maximum intercluster distance, Theor. Comput.
/// Sci. 38 (1985), with the kernel as the measure.
pub fn spread_points(kernel: &Kernel, x: &[f64], inputs: usize, count: usize) -> Vec<usize> {
    let points = x.len() / inputs;
    if count >= points {
        return (0..points).collect();
    }
    let plan = Plan::new(kernel);
    let features = plan.features::<f32>(x, inputs);
    let mut unlike = vec![f64::INFINITY; points];
    let mut chosen = Vec::new();
    let mut next = 0;
    while chosen.len() < count {
        let similarity =
            Arch::new().dispatch(CovarianceRow { plan: &plan, features: &features, point: next });
        let variance = plan.variance() as f32;
        for (unlike, k) in unlike.iter_mut().zip(similarity) {
            *unlike = unlike.min(f64::from(variance - k));
        }
        unlike[next] = f64::NEG_INFINITY;
        chosen.push(next);
        next = largest_of(&unlike).0;
    }
    chosen
}

fn largest_of(values: &[f64]) -> (usize, f64) {
    let mut best = (0, f64::NEG_INFINITY);
    for (index, value) in values.iter().enumerate() {
        if *value > best.1 {
            best = (index, *value);
        }
    }
    best
}

fn covariances(plan: &Plan, features: &Features<f64>, point: usize) -> Vec<f64> {
    Arch::new().dispatch(CovarianceRow { plan, features, point })
}

/// Covariances of a point with all points.
struct CovarianceRow<'a, T> {
    plan: &'a Plan,
    features: &'a Features<T>,
    point: usize,
}

impl<T: super::kernels::Element> WithSimd for CovarianceRow<'_, T> {
    type Output = Vec<T>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Vec<T> {
        let Self { plan, features, point } = self;
        let (mut query, mut work) = (plan.query(), plan.work());
        features.point(point, &mut query);
        let mut row = Vec::with_capacity(features.count() + 16);
        for (start, length) in features.tiles_from(0) {
            row.extend_from_slice(plan.values::<T, S, false>(
                simd,
                features,
                (start, length),
                &query,
                &mut work,
            ));
        }
        row.truncate(features.count());
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Shape;

    #[test]
    fn near_duplicates_are_passed_over() {
        // Five places, each visited two hundred times.
        let x: Vec<f64> =
            (0..1000).map(|k| f64::from(k % 5) + 1e-4 * (f64::from(k) * 0.7).sin()).collect();
        let kernel = Kernel::isotropic(Shape::SquaredExponential, 1, 0.5).scaled(2.0);
        for chosen in [informative_points(&kernel, &x, 1, 5), spread_points(&kernel, &x, 1, 5)] {
            let mut places: Vec<usize> = chosen.iter().map(|k| k % 5).collect();
            places.sort_unstable();
            assert_eq!(places, [0, 1, 2, 3, 4]);
        }
        assert!(informative_points(&kernel, &x, 1, 600).len() < 100, "no variance is left");
        assert_eq!(spread_points(&kernel, &x, 1, 2000).len(), 1000);
    }

    #[test]
    fn of_too_many_points_the_rare_ones_stay() {
        // A million samples about the origin but for three.
        let mut x: Vec<f64> = (0..1_000_000).map(|k| (0.001 * f64::from(k)).sin()).collect();
        let rare = [(17, 9.0), (300_000, -7.0), (999_999, 5.0)];
        rare.iter().for_each(|(k, far)| x[*k] = *far);
        let kernel = Kernel::isotropic(Shape::SquaredExponential, 1, 0.5);
        let chosen = informative_points(&kernel, &x, 1, 70);
        assert!(rare.iter().all(|(k, _)| chosen[..12].contains(k)), "{chosen:?}");
    }
}
