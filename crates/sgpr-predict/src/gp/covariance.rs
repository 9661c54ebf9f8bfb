use alloc::string::String;
use alloc::vec::Vec;

use serde::{Deserialize, Serialize};

use super::kernels::is_hyperparameter;
use super::{Kernel, KernelError};
#[cfg(not(feature = "std"))]
use crate::math::Float;

/// Covariance of the measurements: signal + correlated noise + noise_variance on the diagonal.
///
/// Samples of one log share their errors with their neighbours in time. A process that knows only
/// white noise takes such errors for signal and learns them by heart. `correlated_noise` is a
/// kernel of its own, over an input such as time, which explains the measurements but is left out
/// of predictions: they are of the signal alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Covariance {
    /// Kernel of the function that is learned.
    pub signal: Kernel,
    /// Kernel of errors that neighbours share.
    pub correlated_noise: Option<Kernel>,
    /// Variance of independent errors, in the square of the unit of y.
    pub noise_variance: f64,
}

impl Covariance {
    /// Signal and independent errors.
    pub fn new(signal: Kernel, noise_variance: f64) -> Self {
        Self { signal, correlated_noise: None, noise_variance }
    }

    /// With errors that neighbours share.
    #[must_use]
    pub fn with_correlated_noise(mut self, kernel: Kernel) -> Self {
        self.correlated_noise = Some(kernel);
        self
    }

    /// The covariance of `scale` times what has this covariance.
    #[must_use]
    pub fn in_units_of(mut self, scale: f64) -> Self {
        let square = scale * scale;
        self.signal = times(square, self.signal);
        self.correlated_noise = self.correlated_noise.map(|kernel| times(square, kernel));
        self.noise_variance *= square;
        self
    }

    /// Logarithms of all hyperparameters: of the signal, of the correlated noise, of the noise
    /// variance.
    pub fn theta(&self) -> Vec<f64> {
        let mut theta = self.kernel().theta();
        theta.push(self.noise_variance.ln());
        theta
    }

    /// The same covariance with other hyperparameters.
    ///
    /// # Panics
    /// If their number is another.
    #[must_use]
    pub fn with_theta(&self, theta: &[f64]) -> Self {
        let (noise, rest) = theta.split_last().expect("at least the noise variance");
        let (signal, correlated) = rest.split_at(self.signal.theta_len());
        Self {
            signal: self.signal.with_theta(signal),
            correlated_noise: self
                .correlated_noise
                .as_ref()
                .map(|kernel| kernel.with_theta(correlated)),
            noise_variance: noise.exp(),
        }
    }

    /// Names of the hyperparameters.
    pub fn names(&self) -> Vec<String> {
        let mut names = self.signal.names();
        if let Some(kernel) = &self.correlated_noise {
            names.extend(kernel.names().into_iter().map(|name| format!("correlated_noise.{name}")));
        }
        names.push("noise_variance".into());
        names
    }

    /// Variance of a measurement about the signal.
    pub fn total_noise_variance(&self) -> f64 {
        self.noise_variance + self.correlated_noise.as_ref().map_or(0.0, Kernel::variance)
    }

    /// # Errors
    /// If a hyperparameter is not positive, or a kernel looks at an input that is not there.
    pub fn validate(&self, inputs: usize) -> Result<(), KernelError> {
        self.signal.validate(inputs)?;
        self.correlated_noise.iter().try_for_each(|kernel| kernel.validate(inputs))?;
        if self.noise_variance != 0.0 && !is_hyperparameter(self.noise_variance) {
            return Err(KernelError::Hyperparameter {
                name: "noise_variance".into(),
                value: self.noise_variance,
            });
        }
        Ok(())
    }

    /// Signal and correlated noise.
    pub fn kernel(&self) -> Kernel {
        match &self.correlated_noise {
            Some(noise) => Kernel::Sum(vec![self.signal.clone(), noise.clone()]),
            None => self.signal.clone(),
        }
    }
}

/// `factor` times a kernel, without another layer if it has one.
fn times(factor: f64, kernel: Kernel) -> Kernel {
    match kernel {
        Kernel::Scaled { variance, kernel } => {
            Kernel::Scaled { variance: factor * variance, kernel }
        }
        other => other.scaled(factor),
    }
}
