//! What a controller sees of the arm.

use derive_setters::Setters;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Encoders, noise of position and torque; per joint, an empty list for none.
#[derive(Clone, Debug, Default, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Sensors {
    /// Step of the encoder, rad (m); zero for none.
    pub position_resolution: Vec<f64>,
    /// Standard deviation of the position before it is quantised, rad (m).
    pub position_noise: Vec<f64>,
    /// Standard deviation of the measured torque, N·m (N).
    pub torque_noise: Vec<f64>,
    /// Standard deviation of the torque that the drive makes beside the commanded one, anew in
    /// every control period, N·m (N).
    pub actuation_noise: Vec<f64>,
    /// Where velocities come from.
    pub velocity: VelocitySensor,
}

/// Where a controller has velocities from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum VelocitySensor {
    /// The true velocity.
    #[default]
    Exact,
    /// The difference of two measured positions over a control period.
    Difference,
}

/// Normally distributed numbers from ChaCha8 by the method of Box and Muller.
#[derive(Debug)]
pub(crate) struct NormalNumbers {
    random: ChaCha8Rng,
    spare: Option<f64>,
}

impl NormalNumbers {
    pub fn new(seed: u64) -> Self {
        Self { random: ChaCha8Rng::seed_from_u64(seed), spare: None }
    }

    /// In (0, 1).
    pub fn uniform(&mut self) -> f64 {
        ((self.random.next_u64() >> 12) as f64 + 0.5) / (1u64 << 52) as f64
    }

    pub fn normal(&mut self) -> f64 {
        if let Some(value) = self.spare.take() {
            return value;
        }
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * self.uniform()).sin_cos();
        self.spare = Some(radius * sin);
        radius * cos
    }
}

impl Sensors {
    pub(super) fn lists(&self) -> [(&'static str, &[f64]); 4] {
        [
            ("position resolution", &self.position_resolution),
            ("position noise", &self.position_noise),
            ("torque noise", &self.torque_noise),
            ("actuation noise", &self.actuation_noise),
        ]
    }

    pub(super) fn measure_position(
        &self,
        noise: &mut NormalNumbers,
        q: &[f64],
        measured: &mut [f64],
    ) {
        add_noise(noise, &self.position_noise, q, measured);
        for (value, resolution) in measured.iter_mut().zip(&self.position_resolution) {
            if *resolution > 0.0 {
                *value = (*value / resolution).round() * resolution;
            }
        }
    }
}

/// `noisy` = `values` + noise of these standard deviations.
pub(super) fn add_noise(
    noise: &mut NormalNumbers,
    deviations: &[f64],
    values: &[f64],
    noisy: &mut [f64],
) {
    noisy.copy_from_slice(values);
    for (value, deviation) in noisy.iter_mut().zip(deviations) {
        if *deviation > 0.0 {
            *value += deviation * noise.normal();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_normal() {
        let mut noise = NormalNumbers::new(1);
        let values: Vec<f64> = (0..200_000).map(|_| noise.normal()).collect();
        let moment = |p: i32| values.iter().map(|x| x.powi(p)).sum::<f64>() / values.len() as f64;
        // Five standard errors of each moment: sqrt(var / 200 000).
        assert!(
            moment(1).abs() < 0.012 && (moment(2) - 1.0).abs() < 0.016,
            "{} {}",
            moment(1),
            moment(2)
        );
        assert!((moment(4) - 3.0).abs() < 0.11, "{}", moment(4));
    }
}
