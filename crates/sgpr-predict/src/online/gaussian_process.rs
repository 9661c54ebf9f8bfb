//! A Gaussian process whose points come and go.

use alloc::vec::Vec;

use super::OnlineError;
use super::error::{require, require_positive};
use crate::gp::Kernel;
#[cfg(not(feature = "std"))]
use crate::math::Float;

/// How many points a process keeps, and which.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Budget {
    /// Most points.
    pub points: usize,
    /// A measurement of which the points leave less than this share of the variance unexplained is
    /// at a known place. It takes the place of the point most like it once that is old (`refresh`),
    /// and is left out before: a point that followed every measurement would be dragged along, and
    /// the ones it passes would stay as they were. Any other measurement takes a new place, or that
    /// of the oldest point.
    pub novelty: f64,
    /// Measurements after which a point at a known place is old.
    pub refresh: u64,
    /// Measurements after which a point is forgotten.
    pub memory: u64,
}

impl Budget {
    setters! {
        with_points(points: usize),
        with_novelty(novelty: f64),
        with_refresh(refresh: u64),
        with_memory(memory: u64),
    }
}

impl Default for Budget {
    /// 100 points, refreshed after 100 and forgotten after 2000 measurements: 0.1 s and 2 s at 1
    /// kHz.
    fn default() -> Self {
        Self { points: 100, novelty: 0.03, refresh: 100, memory: 2000 }
    }
}

/// A Gaussian process with hyperparameters that stay and points that come and go: L of K + noise =
/// L Lᵀ is updated, not computed again. A point added costs n² operations (one more row), a point
/// removed (n - i)² (the factor of what stands below it is updated by a matrix of rank one). Owns
/// its buffers and allocates nothing after [`Self::new`].
///
/// What changes over time is followed: a new measurement replaces an old one at the same place, and
/// points that no measurement came near are forgotten.
///
/// Source: C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006),
/// algorithm 2.1; P. E. Gill, G. H. Golub, W. Murray, M. A. Saunders, Methods for modifying matrix
/// factorizations, Math. Comp. 28 (1974), method C1; D. Nguyen-Tuong, J. Peters, Incremental online
/// sparsification for model learning in real-time robot control, Neurocomputing 74(11) (2011).
///
/// # Examples
/// ```
/// use sgpr_predict::gp::{Kernel, Shape};
/// use sgpr_predict::online::{Budget, OnlineGaussianProcess};
/// let kernel = Kernel::isotropic(Shape::SquaredExponential, 1, 0.5);
/// let mut gp = OnlineGaussianProcess::new(kernel, 1, 1, 1e-4, Budget::default().with_points(20).with_novelty(1e-3))?;
/// for k in 0..200 {
///     let x = 0.05 * f64::from(k % 60);
///     gp.add(&[x], &[x.sin()])?;
/// }
/// assert!(gp.len() <= 20 && (gp.mean(&[1.0])[0] - 1.0f64.sin()).abs() < 0.05);
/// assert!(gp.mean(&[50.0])[0].abs() < 1e-9, "far from the data nothing is said");
/// # Ok::<(), sgpr_predict::online::OnlineError>(())
/// ```
#[derive(Clone, Debug)]
pub struct OnlineGaussianProcess {
    kernel: Kernel,
    noise_variance: f64,
    prior_variance: f64,
    inputs: usize,
    outputs: usize,
    budget: Budget,
    count: usize,
    /// Measurements so far, and how many there were before each point.
    measurements: u64,
    born: Vec<u64>,
    /// `[points, inputs]`, the oldest first.
    x: Vec<f64>,
    /// `[points, outputs]`.
    y: Vec<f64>,
    /// Lower triangle, `[points, points]`, row-major.
    factor: Vec<f64>,
    /// (K + noise)⁻¹ y, `[outputs, points]`.
    weights: Vec<f64>,
    cross: Vec<f64>,
    work: Vec<f64>,
    mean: Vec<f64>,
}

/// Above it one update would take longer than a control period.
const MOST_POINTS: usize = 2000;

impl OnlineGaussianProcess {
    /// Without points; the only place that allocates.
    ///
    /// - `noise_variance`: of the measurements, in units of the variance of the kernel
    ///
    /// # Errors
    /// If the kernel does not fit the inputs, the noise variance is not positive, or the budget is
    /// out of range.
    pub fn new(
        kernel: Kernel,
        inputs: usize,
        outputs: usize,
        noise_variance: f64,
        budget: Budget,
    ) -> Result<Self, OnlineError> {
        kernel.validate(inputs)?;
        require_positive("noise_variance", noise_variance)?;
        let Budget { points, novelty, .. } = budget;
        if !(1..=MOST_POINTS).contains(&points) {
            let value = points as f64;
            return Err(OnlineError::InvalidOption {
                option: "points",
                value,
                expected: "between 1 and 2000",
            });
        }
        if !(0.0..=1.0).contains(&novelty) {
            let expected = "a share between 0 and 1";
            return Err(OnlineError::InvalidOption { option: "novelty", value: novelty, expected });
        }
        Ok(Self {
            prior_variance: kernel.variance(),
            kernel,
            noise_variance,
            inputs,
            outputs,
            budget,
            count: 0,
            measurements: 0,
            born: vec![0; points],
            x: vec![0.0; points * inputs],
            y: vec![0.0; points * outputs],
            factor: vec![0.0; points * points],
            weights: vec![0.0; points * outputs],
            cross: vec![0.0; points],
            work: vec![0.0; points],
            mean: vec![0.0; outputs],
        })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Points, `[len, inputs]`, the oldest first.
    pub fn x(&self) -> &[f64] {
        &self.x[..self.count * self.inputs]
    }

    /// Their measurements, `[len, outputs]`.
    pub fn y(&self) -> &[f64] {
        &self.y[..self.count * self.outputs]
    }

    /// Takes a measurement; makes room for it as the [`Budget`] says.
    ///
    /// # Errors
    /// If a slice has another length or a value is not finite; nothing changes then.
    pub fn add(&mut self, x: &[f64], y: &[f64]) -> Result<(), OnlineError> {
        require("x", x, self.inputs)?;
        require("y", y, self.outputs)?;
        self.measurements += 1;
        let forgotten = self.count > 0 && self.age(0) > self.budget.memory;
        if forgotten {
            self.take_out(0);
        }
        let mut explained = self.explain(x);
        let known = self.prior_variance - explained < self.budget.novelty * self.prior_variance;
        let gone = match () {
            () if known && self.count > 0 => Some(self.nearest()),
            () if self.count == self.budget.points => Some(0),
            () => None,
        };
        if let Some(index) = gone {
            if known && self.age(index) <= self.budget.refresh {
                if forgotten {
                    self.weigh();
                }
                return Ok(());
            }
            self.take_out(index);
            explained = self.explain(x);
        }
        let (n, width) = (self.count, self.budget.points);
        self.factor[n * width..n * width + n].copy_from_slice(&self.work[..n]);
        // Rounding may leave less than the noise, which is there in truth.
        let pivot =
            (self.prior_variance + self.noise_variance - explained).max(self.noise_variance);
        self.factor[n * width + n] = pivot.sqrt();
        self.x[n * self.inputs..(n + 1) * self.inputs].copy_from_slice(x);
        self.y[n * self.outputs..(n + 1) * self.outputs].copy_from_slice(y);
        self.born[n] = self.measurements;
        self.count += 1;
        self.weigh();
        Ok(())
    }

    /// Takes point `index` out.
    ///
    /// # Panics
    /// If there is no such point.
    pub fn remove(&mut self, index: usize) {
        assert!(index < self.count, "one of the points");
        self.take_out(index);
        self.weigh();
    }

    /// Mean at `x`, one number per output.
    ///
    /// # Panics
    /// If `x` has another length than the inputs.
    pub fn mean(&mut self, x: &[f64]) -> &[f64] {
        assert_eq!(x.len(), self.inputs, "one number per input");
        self.cross_to(x);
        self.set_mean();
        &self.mean
    }

    /// Mean at `x`, and the variance of what is learned there (the same for all outputs).
    ///
    /// # Panics
    /// If `x` has another length than the inputs.
    pub fn mean_and_variance(&mut self, x: &[f64]) -> (&[f64], f64) {
        assert_eq!(x.len(), self.inputs, "one number per input");
        let explained = self.explain(x);
        self.set_mean();
        (&self.mean, (self.prior_variance - explained).max(0.0))
    }

    fn set_mean(&mut self) {
        let points = self.budget.points;
        for (mean, weights) in self.mean.iter_mut().zip(self.weights.chunks_exact(points)) {
            *mean = weights[..self.count]
                .iter()
                .zip(&self.cross)
                .map(|(weight, cross)| weight * cross)
                .sum();
        }
    }

    /// k(x, points) into `cross`.
    fn cross_to(&mut self, x: &[f64]) {
        for (cross, point) in
            self.cross.iter_mut().zip(self.x[..self.count * self.inputs].chunks_exact(self.inputs))
        {
            *cross = self.kernel.value(x, point);
        }
    }

    /// L⁻¹ k(points, x) into `work`; its square, the variance that the points explain.
    fn explain(&mut self, x: &[f64]) -> f64 {
        self.cross_to(x);
        let width = self.budget.points;
        let mut squares = 0.0;
        for i in 0..self.count {
            let row = &self.factor[i * width..=i * width + i];
            let sum: f64 = row[..i].iter().zip(&self.work).map(|(l, w)| l * w).sum();
            self.work[i] = (self.cross[i] - sum) / row[i];
            squares += self.work[i] * self.work[i];
        }
        squares
    }

    /// Measurements since a point was one.
    fn age(&self, index: usize) -> u64 {
        self.measurements - self.born[index]
    }

    /// The point most like the one that `cross` is of.
    fn nearest(&self) -> usize {
        let like = self.cross[..self.count].iter().enumerate();
        like.max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(index, _)| index)
    }

    /// Row `index` leaves; what stands below it in its column goes into the factor of the others.
    fn take_out(&mut self, index: usize) {
        let (n, width) = (self.count, self.budget.points);
        for row in index + 1..n {
            self.work[row - 1] = self.factor[row * width + index];
            let (from, to) = (row * width, (row - 1) * width);
            self.factor.copy_within(from..from + index, to);
            self.factor.copy_within(from + index + 1..from + row + 1, to + index);
        }
        self.born.copy_within(index + 1..n, index);
        self.x.copy_within((index + 1) * self.inputs..n * self.inputs, index * self.inputs);
        self.y.copy_within((index + 1) * self.outputs..n * self.outputs, index * self.outputs);
        self.count -= 1;
        for k in index..self.count {
            let (pivot, v) = (self.factor[k * width + k], self.work[k]);
            let new = pivot.hypot(v);
            let (c, s) = (new / pivot, v / pivot);
            self.factor[k * width + k] = new;
            for row in k + 1..self.count {
                let l = (self.factor[row * width + k] + s * self.work[row]) / c;
                self.work[row] = c * self.work[row] - s * l;
                self.factor[row * width + k] = l;
            }
        }
    }

    /// L Lᵀ weights = y.
    fn weigh(&mut self) {
        let (n, width) = (self.count, self.budget.points);
        for output in 0..self.outputs {
            let weights = &mut self.weights[output * width..output * width + n];
            for i in 0..n {
                let row = &self.factor[i * width..=i * width + i];
                let sum: f64 = row[..i].iter().zip(&*weights).map(|(l, w)| l * w).sum();
                weights[i] = (self.y[i * self.outputs + output] - sum) / row[i];
            }
            for i in (0..n).rev() {
                let row = &self.factor[i * width..=i * width + i];
                weights[i] /= row[i];
                let weight = weights[i];
                weights[..i].iter_mut().zip(row).for_each(|(w, l)| *w -= l * weight);
            }
        }
    }
}
