//! Covariance functions: stationary shapes over chosen inputs, scaled, added and multiplied.

#[cfg(feature = "simd")]
mod grid;
mod groups;
mod plan;
mod points;
mod shape;
mod tile;

#[cfg(feature = "simd")]
pub use grid::{Grid, GridPoints};
pub use groups::padded;
pub(crate) use groups::{GroupedPoints, weigh};
#[cfg(feature = "simd")]
pub(crate) use groups::{PADDED, group};
pub use plan::{Features, Plan, Query, Work};
pub use points::Points;
pub use shape::Shape;
pub(crate) use tile::{BLOCK, REGISTERS};
pub use tile::{Element, TILE};

use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;

use serde::{Deserialize, Serialize};

use super::KernelError;
#[cfg(not(feature = "std"))]
use crate::math::Float;

/// A covariance function k(x, x').
///
/// The leaves are stationary: k = shape(r²) with the squared distance r² = sum over inputs of ((x -
/// x') / length_scale)² and k = 1 at r = 0. A periodic input stands on a circle: (x - x')² becomes
/// (period / pi)² sin²(pi (x - x') / period), the squared chord, which keeps every shape a
/// covariance.
///
/// The hyperparameters theta are natural logarithms, in the order of [`Kernel::names`]: what scales
/// first, then what it scales; length scales, then the mixture of a rational quadratic.
///
/// Source: C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006), ch.
/// 4; thesis eqs. 5-5, 5-6.
///
/// # Examples
/// ```
/// use sgpr_predict::gp::{Kernel, Shape};
/// let friction = Kernel::ard(Shape::Matern32, &[0.5, 0.5]).on(&[1, 4]).scaled(2.0);
/// let rest = Kernel::isotropic(Shape::SquaredExponential, 6, 3.0).scaled(1.0);
/// let kernel = friction.plus(rest);
/// assert_eq!(kernel.theta().len(), 5);
/// assert!((kernel.value(&[0.1; 6], &[0.1; 6]) - 3.0).abs() < 1e-15);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kernel {
    /// A shape over inputs, with variance one.
    Stationary(Stationary),
    /// variance * kernel.
    Scaled {
        /// Factor; for a stationary kernel the signal variance.
        variance: f64,
        /// What it scales.
        kernel: Box<Kernel>,
    },
    /// Sum of kernels: the sum of independent functions.
    Sum(Vec<Kernel>),
    /// Product of kernels: points are alike only if they are so for each factor.
    Product(Vec<Kernel>),
}

/// A leaf of a [`Kernel`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Stationary {
    /// k as a function of the distance.
    pub shape: Shape,
    /// Inputs that it looks at.
    pub inputs: Vec<Input>,
    /// One for all inputs, or one each; in units of the input.
    pub length_scales: Vec<f64>,
}

/// An input that a kernel looks at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Input {
    /// Column, counted from zero.
    pub index: usize,
    /// Difference after which everything repeats, if there is one (2 pi for an angle).
    pub period: Option<f64>,
}

/// More leaves, or deeper trees, come from a damaged file.
const MOST_NODES: usize = 256;

/// Whether a length scale, a variance or a period can be computed with: its square, and one over
/// that, are numbers.
pub fn is_hyperparameter(value: f64) -> bool {
    (1e-150..=1e150).contains(&value)
}

impl Kernel {
    /// One length scale for the inputs 0..`inputs`.
    pub fn isotropic(shape: Shape, inputs: usize, length_scale: f64) -> Self {
        let inputs = (0..inputs).map(|index| Input { index, period: None }).collect();
        Self::Stationary(Stationary { shape, inputs, length_scales: vec![length_scale] })
    }

    /// A length scale for each input: those that do not matter get long ones (automatic relevance
    /// determination).
    pub fn ard(shape: Shape, length_scales: &[f64]) -> Self {
        let inputs = (0..length_scales.len()).map(|index| Input { index, period: None }).collect();
        Self::Stationary(Stationary { shape, inputs, length_scales: length_scales.to_vec() })
    }

    /// The same kernel looking at other columns: what was input i is now input `selection[i]`.
    ///
    /// # Panics
    /// If the kernel looks at more inputs than are selected.
    #[must_use]
    pub fn on(mut self, selection: &[usize]) -> Self {
        self.for_each_leaf(&mut |leaf| {
            leaf.inputs.iter_mut().for_each(|input| input.index = selection[input.index])
        });
        self
    }

    /// The same kernel with a period for the column `index`, wherever it looks at it.
    #[must_use]
    pub fn with_period(mut self, index: usize, period: f64) -> Self {
        self.for_each_leaf(&mut |leaf| {
            leaf.inputs
                .iter_mut()
                .filter(|input| input.index == index)
                .for_each(|input| input.period = Some(period));
        });
        self
    }

    /// The variance and the leaf of a kernel that is one stationary shape without periods, scaled
    /// or not.
    pub fn single_leaf(&self) -> Option<(f64, &Stationary)> {
        match self {
            Self::Stationary(leaf) if leaf.inputs.iter().all(|input| input.period.is_none()) => {
                Some((1.0, leaf))
            }
            Self::Scaled { variance, kernel } => {
                kernel.single_leaf().map(|(inner, leaf)| (variance * inner, leaf))
            }
            _ => None,
        }
    }

    /// `variance` times this kernel.
    #[must_use]
    pub fn scaled(self, variance: f64) -> Self {
        Self::Scaled { variance, kernel: Box::new(self) }
    }

    /// This kernel plus another.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        match self {
            Self::Sum(mut parts) => {
                parts.push(other);
                Self::Sum(parts)
            }
            first => Self::Sum(vec![first, other]),
        }
    }

    /// This kernel times another.
    #[must_use]
    pub fn times(self, other: Self) -> Self {
        match self {
            Self::Product(mut parts) => {
                parts.push(other);
                Self::Product(parts)
            }
            first => Self::Product(vec![first, other]),
        }
    }

    /// Hyperparameters, natural logarithms.
    pub fn theta(&self) -> Vec<f64> {
        let mut theta = Vec::new();
        self.clone().for_each_parameter(&mut |_, value| theta.push(value.ln()));
        theta
    }

    /// This kernel with other hyperparameters.
    ///
    /// # Panics
    /// If their number is another.
    #[must_use]
    pub fn with_theta(&self, theta: &[f64]) -> Self {
        assert_eq!(theta.len(), self.theta_len(), "one logarithm per hyperparameter");
        let mut kernel = self.clone();
        let mut next = theta.iter();
        kernel.for_each_parameter(&mut |_, value| *value = next.next().expect("counted").exp());
        kernel
    }

    /// Number of hyperparameters.
    pub fn theta_len(&self) -> usize {
        let mut count = 0;
        self.clone().for_each_parameter(&mut |_, _| count += 1);
        count
    }

    /// Names of the hyperparameters, `signal_variance`, `length_scale[3]` (the input's column) and
    /// so on.
    pub fn names(&self) -> Vec<String> {
        let mut names = Vec::new();
        self.clone().for_each_parameter(&mut |name, _| names.push(name));
        names
    }

    /// k(x, x): the variance before any data.
    pub fn variance(&self) -> f64 {
        match self {
            Self::Stationary(_) => 1.0,
            Self::Scaled { variance, kernel } => variance * kernel.variance(),
            Self::Sum(parts) => parts.iter().map(Self::variance).sum(),
            Self::Product(parts) => parts.iter().map(Self::variance).product(),
        }
    }

    /// k(a, b) of two points, in the plainest arithmetic.
    ///
    /// # Panics
    /// If the points have fewer inputs than the kernel looks at.
    pub fn value(&self, a: &[f64], b: &[f64]) -> f64 {
        match self {
            Self::Stationary(leaf) => leaf.shape.value(leaf.squared_distance(a, b)),
            Self::Scaled { variance, kernel } => variance * kernel.value(a, b),
            Self::Sum(parts) => parts.iter().map(|part| part.value(a, b)).sum(),
            Self::Product(parts) => parts.iter().map(|part| part.value(a, b)).product(),
        }
    }

    /// One more than the last column that the kernel looks at.
    pub fn inputs(&self) -> usize {
        let mut inputs = 0;
        self.clone().for_each_leaf(&mut |leaf| {
            inputs = leaf.inputs.iter().map(|input| input.index + 1).fold(inputs, usize::max);
        });
        inputs
    }

    /// The same kernel with length scales and variances that fit the data: each length scale is the
    /// spread of its input times the square root of the number of inputs of the leaf, the variance
    /// is shared by the summands.
    ///
    /// - `x`: `[samples, inputs]`, row-major
    #[must_use]
    pub fn fitted_to(&self, x: &[f64], inputs: usize, variance: f64) -> Self {
        let mut kernel = self.clone();
        let spread = spreads(x, inputs);
        kernel.for_each_leaf(&mut |leaf| {
            let root = (leaf.inputs.len() as f64).sqrt();
            let of = |input: &Input| {
                root * input
                    .period
                    .map_or(spread[input.index], |p| spread[input.index].min(0.25 * p))
            };
            if leaf.length_scales.len() == leaf.inputs.len() {
                leaf.length_scales = leaf.inputs.iter().map(of).collect();
            } else {
                let mean = leaf.inputs.iter().map(|input| of(input).ln()).sum::<f64>()
                    / leaf.inputs.len() as f64;
                leaf.length_scales = vec![mean.exp()];
            }
        });
        kernel.set_variance(variance);
        kernel
    }

    /// Checks everything that the arithmetic relies on.
    ///
    /// # Errors
    /// If a hyperparameter is not positive, or the kernel looks at an input that is not there.
    pub fn validate(&self, inputs: usize) -> Result<(), KernelError> {
        let mut nodes = 0;
        self.validate_node(inputs, 0, &mut nodes)?;
        let mut result = Ok(());
        self.clone().for_each_parameter(&mut |name, value| {
            if result.is_ok() && !is_hyperparameter(*value) {
                result = Err(KernelError::Hyperparameter { name, value: *value });
            }
        });
        result
    }

    fn validate_node(
        &self,
        inputs: usize,
        depth: usize,
        nodes: &mut usize,
    ) -> Result<(), KernelError> {
        *nodes += 1;
        if *nodes > MOST_NODES || depth > 32 {
            let found = format!("more than {MOST_NODES} parts or a depth beyond 32");
            return Err(KernelError::Unfit { found, advice: "use fewer" });
        }
        let wrong = |found: String, advice| Err(KernelError::Unfit { found, advice });
        match self {
            Self::Stationary(leaf) => {
                if leaf.inputs.is_empty() {
                    return wrong("a part without inputs".into(), "name at least one");
                }
                let scales = leaf.length_scales.len();
                if scales != 1 && scales != leaf.inputs.len() {
                    let found = format!("{scales} length scales for {} inputs", leaf.inputs.len());
                    return wrong(found, "give one for all, or one each");
                }
                for input in &leaf.inputs {
                    if input.index >= inputs {
                        return Err(KernelError::Input { input: input.index, inputs });
                    }
                    if let Some(period) = input.period.filter(|period| !is_hyperparameter(*period))
                    {
                        return Err(KernelError::Hyperparameter {
                            name: "the period".into(),
                            value: period,
                        });
                    }
                }
                Ok(())
            }
            Self::Scaled { kernel, .. } => kernel.validate_node(inputs, depth + 1, nodes),
            Self::Sum(parts) | Self::Product(parts) if parts.is_empty() => {
                wrong("an empty sum or product".into(), "leave it out")
            }
            Self::Sum(parts) | Self::Product(parts) => {
                parts.iter().try_for_each(|part| part.validate_node(inputs, depth + 1, nodes))
            }
        }
    }

    fn set_variance(&mut self, wanted: f64) {
        match self {
            Self::Stationary(_) => {}
            Self::Scaled { variance, kernel } => {
                kernel.set_variance(1.0);
                *variance = wanted / kernel.variance();
            }
            Self::Sum(parts) => {
                let share = wanted / parts.len() as f64;
                parts.iter_mut().for_each(|part| part.set_variance(share));
            }
            Self::Product(parts) => {
                let (first, rest) = parts.split_first_mut().expect("no empty product");
                rest.iter_mut().for_each(|part| part.set_variance(1.0));
                first.set_variance(wanted);
            }
        }
    }

    fn for_each_leaf(&mut self, visit: &mut dyn FnMut(&mut Stationary)) {
        match self {
            Self::Stationary(leaf) => visit(leaf),
            Self::Scaled { kernel, .. } => kernel.for_each_leaf(visit),
            Self::Sum(parts) | Self::Product(parts) => {
                parts.iter_mut().for_each(|part| part.for_each_leaf(visit))
            }
        }
    }

    fn for_each_parameter(&mut self, visit: &mut dyn FnMut(String, &mut f64)) {
        match self {
            Self::Stationary(leaf) => {
                let single = leaf.length_scales.len() == 1 && leaf.inputs.len() != 1;
                for (k, scale) in leaf.length_scales.iter_mut().enumerate() {
                    let name = match leaf.inputs.get(k) {
                        Some(input) if !single => format!("length_scale[{}]", input.index),
                        _ => "length_scale".into(),
                    };
                    visit(name, scale);
                }
                if let Shape::RationalQuadratic { mixture } = &mut leaf.shape {
                    visit("mixture".into(), mixture);
                }
            }
            Self::Scaled { variance, kernel } => {
                visit("signal_variance".into(), variance);
                kernel.for_each_parameter(visit);
            }
            Self::Sum(parts) | Self::Product(parts) => {
                parts.iter_mut().for_each(|part| part.for_each_parameter(visit))
            }
        }
    }
}

impl Stationary {
    /// Length scale of the k-th input.
    pub fn scale(&self, k: usize) -> f64 {
        self.length_scales[if self.length_scales.len() == 1 { 0 } else { k }]
    }

    fn squared_distance(&self, a: &[f64], b: &[f64]) -> f64 {
        let term = |(k, input): (usize, &Input)| {
            let difference = a[input.index] - b[input.index];
            let difference = match input.period {
                None => difference,
                Some(period) => {
                    period / core::f64::consts::PI
                        * (core::f64::consts::PI * difference / period).sin()
                }
            };
            (difference / self.scale(k)).powi(2)
        };
        self.inputs.iter().enumerate().map(term).sum()
    }
}

/// Standard deviation of every column; one for a column that is constant.
pub fn spreads(x: &[f64], inputs: usize) -> Vec<f64> {
    let samples = (x.len() / inputs).max(1) as f64;
    let column = |m: usize| x.iter().skip(m).step_by(inputs);
    let spread = |m: usize| {
        let mean = column(m).sum::<f64>() / samples;
        let deviation = (column(m).map(|x| (x - mean).powi(2)).sum::<f64>() / samples).sqrt();
        if deviation > 1e-12 * mean.abs() && deviation > 0.0 { deviation } else { 1.0 }
    };
    (0..inputs).map(spread).collect()
}
