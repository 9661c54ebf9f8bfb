//! Families of motions, each linear in its coefficients: q(t) = sum of coefficient · function(t),
//! per joint.

use std::f64::consts::TAU;
use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use super::ExcitationError;
use crate::simulation::quintic;

/// The functions that a motion is made of; the same for every joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Basis {
    /// A finite Fourier series, periodic.
    ///
    /// q(t) = sum over harmonics l of a_l / (ω l) sin(ω l t) - b_l / (ω l) cos(ω l t) + q_0 (thesis
    /// eq. 3-1), hence dq = sum a_l cos(ω l t) + b_l sin(ω l t) and ddq = sum ω l (-a_l sin(ω l
    /// t) + b_l cos(ω l t)): the amplitudes are those of the velocity. The factor ω l stands inside
    /// the sum; the thesis prints it before the sum in 3-3.
    ///
    /// Coefficients: a_l of all harmonics, b_l of all harmonics, q_0.
    Fourier {
        /// ω / 2π, Hz; one over the period.
        fundamental_hz: f64,
        /// Harmonics: 1 to L for identification; from L to bandwidth over fundamental for the
        /// high-frequency series.
        harmonics: RangeInclusive<usize>,
    },
    /// A B-spline of degree five over equal intervals, which starts and ends at its first and last
    /// control point.
    ///
    /// Coefficients: control points. Four derivatives are continuous.
    BSpline {
        /// s.
        duration: f64,
        /// Six or more.
        control_points: usize,
    },
    /// From point to point at rest, each way along a quintic, in equal times.
    ///
    /// Coefficients: points.
    PointToPoint {
        /// s.
        duration: f64,
        /// Two or more.
        points: usize,
    },
}

const DEGREE: usize = 5;

impl Basis {
    /// The series of the thesis: harmonics 1 to `terms`.
    pub fn fourier(fundamental_hz: f64, terms: usize) -> Self {
        Self::Fourier { fundamental_hz, harmonics: 1..=terms }
    }

    /// The high-frequency series: from the last harmonic of a series of `terms` up to the bandwidth
    /// of the closed loop (thesis section 3-4).
    pub fn high_frequency(fundamental_hz: f64, terms: usize, bandwidth_hz: f64) -> Self {
        let last = (bandwidth_hz / fundamental_hz + 1e-9).floor().clamp(0.0, 1e6) as usize;
        Self::Fourier { fundamental_hz, harmonics: terms..=last }
    }

    pub(super) fn require_valid(&self) -> Result<(), ExcitationError> {
        let invalid = |option, value, expected| {
            Err(ExcitationError::InvalidOption { option, value, expected })
        };
        match self {
            Self::Fourier { fundamental_hz, .. }
                if !(*fundamental_hz > 0.0 && fundamental_hz.is_finite()) =>
            {
                invalid("fundamental_hz", *fundamental_hz, "a frequency above zero")
            }
            Self::Fourier { harmonics, .. }
                if *harmonics.start() == 0 || harmonics.clone().count() < 2 =>
            {
                invalid(
                    "number of harmonics",
                    harmonics.clone().count() as f64,
                    "two or more, the first above zero",
                )
            }
            Self::BSpline { duration, .. } | Self::PointToPoint { duration, .. }
                if !(*duration > 0.0 && duration.is_finite()) =>
            {
                invalid("duration", *duration, "a time above zero")
            }
            Self::BSpline { control_points, .. } if *control_points <= DEGREE + 1 => {
                invalid("control_points", *control_points as f64, "seven or more")
            }
            Self::PointToPoint { points, .. } if *points < 3 => {
                invalid("points", *points as f64, "three or more")
            }
            _ => Ok(()),
        }
    }

    /// Number of coefficients per joint.
    pub fn len(&self) -> usize {
        match self {
            Self::Fourier { harmonics, .. } => 2 * harmonics.clone().count() + 1,
            Self::BSpline { control_points, .. } => *control_points,
            Self::PointToPoint { points, .. } => *points,
        }
    }

    /// Whether there is no coefficient.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Duration of the motion: one period of a series, s.
    pub fn duration(&self) -> f64 {
        match self {
            Self::Fourier { fundamental_hz, .. } => 1.0 / fundamental_hz,
            Self::BSpline { duration, .. } | Self::PointToPoint { duration, .. } => *duration,
        }
    }

    /// Time in which the fastest component turns once, s: what a grid of samples has to resolve.
    pub(super) fn shortest_time(&self) -> f64 {
        match self {
            Self::Fourier { fundamental_hz, harmonics } => {
                1.0 / (fundamental_hz * *harmonics.end() as f64)
            }
            Self::BSpline { duration, control_points } => {
                2.0 * duration / (control_points - DEGREE) as f64
            }
            Self::PointToPoint { duration, points } => duration / (points - 1) as f64,
        }
    }

    /// Values of all functions at `time` and their first and second derivatives, `[len]` each. A
    /// Fourier series goes on for ever; the others stand still before their start and after their
    /// end.
    pub fn evaluate(&self, time: f64, out: [&mut [f64]; 3]) {
        let [value, slope, curvature] = out;
        for out in [&mut *value, &mut *slope, &mut *curvature] {
            out.fill(0.0);
        }
        self.for_each(time, |index, function| {
            [value[index], slope[index], curvature[index]] = function
        });
    }

    /// Calls `f(index, [value, slope, curvature])` for the functions that are not zero at `time`.
    #[inline]
    pub(super) fn for_each(&self, time: f64, mut f: impl FnMut(usize, [f64; 3])) {
        match self {
            Self::Fourier { fundamental_hz, harmonics } => {
                let count = harmonics.end() + 1 - harmonics.start();
                for (k, harmonic) in harmonics.clone().enumerate() {
                    let w = TAU * fundamental_hz * harmonic as f64;
                    let (sin, cos) = (w * time).sin_cos();
                    f(k, [sin / w, cos, -w * sin]);
                    f(count + k, [-cos / w, sin, w * cos]);
                }
                f(2 * count, [1.0, 0.0, 0.0]);
            }
            Self::BSpline { duration, control_points } => {
                b_splines(*duration, *control_points, time, f)
            }
            Self::PointToPoint { duration, points } => {
                let ways = points - 1;
                let rate = ways as f64 / duration;
                let position = (time * rate).clamp(0.0, ways as f64);
                let way = (position.floor() as usize).min(ways - 1);
                let [s, ds, dds] = quintic([0.0; 3], [1.0, 0.0, 0.0], position - way as f64);
                f(way, [1.0 - s, -ds * rate, -dds * rate * rate]);
                f(way + 1, [s, ds * rate, dds * rate * rate]);
            }
        }
    }

    /// An orthonormal basis of the coefficients whose motion starts and ends with zero position,
    /// velocity and acceleration, `[free]` rows of `[len]`: what replaces thesis eqs. 3-4 to 3-6.
    ///
    /// For the series these are sum b_l / (ω l) = q_0, sum a_l = 0 and sum ω l b_l = 0. The thesis
    /// prints ω_f^l (a power) where differentiating its own 3-1 gives the product ω_f l, in 3-4
    /// with the wrong sign of q_0 too.
    pub fn free_directions(&self) -> Vec<Vec<f64>> {
        let k = self.len();
        let mut conditions: Vec<Vec<f64>> = Vec::new();
        for time in [0.0, self.duration()] {
            let mut rows = [vec![0.0; k], vec![0.0; k], vec![0.0; k]];
            let [value, slope, curvature] = &mut rows;
            self.evaluate(time, [value, slope, curvature]);
            conditions.extend(rows);
        }
        let conditions = orthonormal(conditions, &[]);
        let units = (0..k).map(|index| {
            let mut unit = vec![0.0; k];
            unit[index] = 1.0;
            unit
        });
        orthonormal(units.collect(), &conditions)
    }
}

/// Orthonormal vectors that span the same as `vectors` beside `fixed`; twice Gram-Schmidt.
fn orthonormal(vectors: Vec<Vec<f64>>, fixed: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut found: Vec<Vec<f64>> = Vec::new();
    for mut vector in vectors {
        let size = norm(&vector);
        if size == 0.0 {
            continue;
        }
        vector.iter_mut().for_each(|x| *x /= size);
        for _ in 0..2 {
            for other in fixed.iter().chain(&found) {
                let along: f64 = vector.iter().zip(other).map(|(a, b)| a * b).sum();
                vector.iter_mut().zip(other).for_each(|(x, o)| *x -= along * o);
            }
        }
        let left = norm(&vector);
        // The period's end repeats its start to rounding; of other motions far more is left.
        if left > 1e-8 {
            vector.iter_mut().for_each(|x| *x /= left);
            found.push(vector);
        }
    }
    found
}

/// B-splines of degree five and two derivatives by the recursion of Cox and de Boor.
///
/// Source: L. Piegl, W. Tiller, The NURBS Book (1997), eqs. 2.5 and 2.7.
fn b_splines(duration: f64, count: usize, time: f64, mut f: impl FnMut(usize, [f64; 3])) {
    let intervals = count - DEGREE;
    let knot = |k: usize| (k as f64 - DEGREE as f64).clamp(0.0, intervals as f64);
    let rate = intervals as f64 / duration;
    let u = (time * rate).clamp(0.0, intervals as f64);
    let span = (u.floor() as usize).min(intervals - 1) + DEGREE;
    // functions[p][r]: spline of degree p that begins at knot span - p + r.
    let mut functions = [[0.0; DEGREE + 1]; DEGREE + 1];
    functions[0][0] = 1.0;
    for p in 1..=DEGREE {
        for r in 0..=p {
            let first = span - p + r;
            let share = |from: f64, to: f64, f: f64| if to > from { f / (to - from) } else { 0.0 };
            let mut sum = 0.0;
            if r > 0 {
                sum += (u - knot(first))
                    * share(knot(first), knot(first + p), functions[p - 1][r - 1]);
            }
            if r < p {
                sum += (knot(first + p + 1) - u)
                    * share(knot(first + 1), knot(first + p + 1), functions[p - 1][r]);
            }
            functions[p][r] = sum;
        }
    }
    // The derivative of a spline of degree p is p times the difference of two of degree p - 1, over
    // their supports.
    let derivative = |p: usize, r: usize, lower: &[f64]| {
        let first = span - p + r;
        let share = |r: Option<usize>, width: f64| match r.and_then(|r| lower.get(r)) {
            Some(function) if width > 0.0 => p as f64 * function / width,
            _ => 0.0,
        };
        share(r.checked_sub(1), knot(first + p) - knot(first))
            - share(Some(r), knot(first + p + 1) - knot(first + 1))
    };
    let lower: [f64; DEGREE] =
        std::array::from_fn(|r| derivative(DEGREE - 1, r, &functions[DEGREE - 2][..DEGREE - 1]));
    for r in 0..=DEGREE {
        let slope = rate * derivative(DEGREE, r, &functions[DEGREE - 1][..DEGREE]);
        let curvature = rate * rate * derivative(DEGREE, r, &lower);
        f(span - DEGREE + r, [functions[DEGREE][r], slope, curvature]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn families() -> Vec<Basis> {
        vec![
            Basis::fourier(0.1, 4),
            Basis::high_frequency(0.1, 4, 5.0),
            Basis::BSpline { duration: 7.0, control_points: 12 },
            Basis::PointToPoint { duration: 9.0, points: 6 },
        ]
    }

    fn evaluate(basis: &Basis, time: f64) -> [Vec<f64>; 3] {
        let k = basis.len();
        let mut rows = [vec![0.0; k], vec![0.0; k], vec![0.0; k]];
        let [value, slope, curvature] = &mut rows;
        basis.evaluate(time, [value, slope, curvature]);
        rows
    }

    #[test]
    fn derivatives_are_those_of_the_values() {
        // Thesis eqs. 3-2, 3-3 against the derivative of 3-1; and the other families alike.
        for basis in families() {
            let duration = basis.duration();
            for k in 0..200 {
                let time = duration * (f64::from(k) + 0.31) / 200.0;
                let h = 1e-4 * basis.shortest_time();
                let (before, here, after) = (
                    evaluate(&basis, time - h),
                    evaluate(&basis, time),
                    evaluate(&basis, time + h),
                );
                for order in 0..2 {
                    let scale =
                        here[order + 1].iter().fold(1e-2f64, |largest, x| largest.max(x.abs()));
                    for index in 0..basis.len() {
                        let difference = (after[order][index] - before[order][index]) / (2.0 * h);
                        let error = (difference - here[order + 1][index]).abs();
                        assert!(
                            error < 1e-5 * scale,
                            "{basis:?} order {order} function {index} at {time}: {error}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn free_directions_start_and_end_at_rest_and_none_is_missing() {
        let dimension = [6, 2 * 47 - 2, 6, 4];
        for (basis, dimension) in families().into_iter().zip(dimension) {
            let free = basis.free_directions();
            assert_eq!(free.len(), dimension, "{basis:?}");
            for time in [0.0, basis.duration()] {
                for row in evaluate(&basis, time) {
                    for direction in &free {
                        let sum: f64 = row.iter().zip(direction).map(|(a, b)| a * b).sum();
                        let scale = row.iter().map(|x| x.abs()).sum::<f64>().max(1.0);
                        assert!(sum.abs() < 1e-12 * scale, "{basis:?} at {time}: {sum}");
                    }
                }
            }
        }
    }

    #[test]
    fn splines_sum_to_one() {
        for control_points in [7, 12, 30] {
            let basis = Basis::BSpline { duration: 3.0, control_points };
            for k in 0..=100 {
                let [value, slope, curvature] = evaluate(&basis, 0.03 * f64::from(k));
                assert!((value.iter().sum::<f64>() - 1.0).abs() < 1e-14);
                assert!(
                    slope.iter().sum::<f64>().abs() < 1e-11
                        && curvature.iter().sum::<f64>().abs() < 1e-9
                );
            }
        }
    }
}
