use derive_setters::Setters;

use super::GpError;

/// Points and what was measured there.
#[derive(Clone, Debug, PartialEq)]
pub struct Data {
    x: Vec<f64>,
    inputs: usize,
    y: Vec<f64>,
    outputs: usize,
}

impl Data {
    /// - `x`: `[points, inputs]`, row-major
    /// - `y`: `[points, outputs]`, row-major; several outputs share one kernel and its
    ///   factorisation
    ///
    /// # Errors
    /// If there is no point, the arrays do not hold the same points, or a value is not finite.
    pub fn new(x: Vec<f64>, inputs: usize, y: Vec<f64>, outputs: usize) -> Result<Self, GpError> {
        if x.is_empty() || y.is_empty() || inputs == 0 || outputs == 0 {
            return Err(GpError::Empty);
        }
        let points = x.len() / inputs;
        if x.len() != points * inputs {
            return Err(GpError::Shape {
                what: "x",
                found: x.len(),
                expected: (points + 1) * inputs,
            });
        }
        if y.len() != points * outputs {
            return Err(GpError::Shape { what: "y", found: y.len(), expected: points * outputs });
        }
        require_finite("x", &x, inputs)?;
        require_finite("y", &y, outputs)?;
        Ok(Self { x, inputs, y, outputs })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.x.len() / self.inputs
    }

    /// Whether there is no point; never.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Points, `[points, inputs]`, row-major.
    pub fn x(&self) -> &[f64] {
        &self.x
    }

    /// Number of inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Measurements, `[points, outputs]`, row-major.
    pub fn y(&self) -> &[f64] {
        &self.y
    }

    /// Number of outputs.
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Mean square of the measurements: the variance that a process of mean zero has to explain.
    pub fn mean_square(&self) -> f64 {
        self.y.iter().map(|y| y * y).sum::<f64>() / self.y.len() as f64
    }

    /// Some of the points.
    ///
    /// # Panics
    /// If an index is not that of a point.
    #[must_use]
    pub fn select(&self, indices: &[usize]) -> Self {
        let rows = |values: &[f64], width: usize| {
            indices
                .iter()
                .flat_map(|&i| values[i * width..(i + 1) * width].iter().copied())
                .collect()
        };
        Self {
            x: rows(&self.x, self.inputs),
            inputs: self.inputs,
            y: rows(&self.y, self.outputs),
            outputs: self.outputs,
        }
    }
}

pub(super) fn require_finite(
    what: &'static str,
    values: &[f64],
    columns: usize,
) -> Result<(), GpError> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(k) => Err(GpError::NotFinite {
            what,
            row: k / columns,
            column: k % columns,
            value: values[k],
        }),
        None => Ok(()),
    }
}

/// What an exact computation may use of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Compute {
    /// Threads; results are the same for one and differ by rounding for another number.
    pub threads: usize,
    /// Memory, bytes; by default four fifths of what the system says is free.
    pub memory_limit: u64,
}

impl Default for Compute {
    fn default() -> Self {
        Self { threads: 1, memory_limit: sgpr_numeric::internal::memory::usable() }
    }
}

impl Compute {
    /// Whether so many square matrices fit.
    #[doc(hidden)]
    pub fn allows(&self, points: usize, matrices: u64) -> bool {
        needed(points, matrices) <= self.memory_limit
    }

    /// Refuses matrices that do not fit before memory is taken.
    pub(super) fn check(&self, points: usize, matrices: u64) -> Result<(), GpError> {
        if self.allows(points, matrices) {
            return Ok(());
        }
        Err(GpError::TooLarge {
            points,
            needed_gb: needed(points, matrices) as f64 / 1e9,
            limit_gb: self.memory_limit as f64 / 1e9,
            largest: ((self.memory_limit / (8 * matrices)) as f64).sqrt() as usize,
        })
    }

    pub(super) fn par(&self) -> faer::Par {
        if self.threads > 1 { faer::Par::rayon(self.threads) } else { faer::Par::Seq }
    }
}

/// Bytes of square matrices.
fn needed(points: usize, matrices: u64) -> u64 {
    let points = points as u64;
    (8 * matrices).saturating_mul(points.saturating_mul(points))
}
