//! Power spectra, and the cut-off that they suggest.

use std::ops::RangeInclusive;

use realfft::RealFftPlanner;

/// One-sided power spectral density of a signal.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Spectrum {
    /// Frequencies, Hz, evenly spaced from zero to half the sampling rate.
    pub frequency_hz: Vec<f64>,
    /// Density, signal unit² / Hz.
    pub density: Vec<f64>,
}

impl Spectrum {
    /// Averaged periodograms of half-overlapping windows of `window` samples (Welch (1967)),
    /// Hann-weighted, with a line removed from each so that slow motion does not leak into the
    /// rest.
    ///
    /// A signal shorter than the window is one window.
    pub fn welch(signal: &[f64], rate_hz: f64, window: usize) -> Self {
        let length = window.min(signal.len()).max(2);
        let hann: Vec<f64> = (0..length)
            .map(|k| (std::f64::consts::PI * k as f64 / length as f64).sin().powi(2))
            .collect();
        let power: f64 = hann.iter().map(|w| w * w).sum();
        let transform = RealFftPlanner::<f64>::new().plan_fft_forward(length);
        let mut output = transform.make_output_vec();
        let mut density = vec![0.0; output.len()];
        let mut count = 0.0;
        let mut start = 0;
        while start + length <= signal.len() {
            let mut segment = without_line(&signal[start..start + length]);
            segment.iter_mut().zip(&hann).for_each(|(x, w)| *x *= w);
            transform.process(&mut segment, &mut output).expect("buffers of the planned length");
            density.iter_mut().zip(&output).for_each(|(sum, x)| *sum += x.norm_sqr());
            count += 1.0;
            start += (length / 2).max(1);
        }
        let scale = 2.0 / (f64::max(count, 1.0) * power * rate_hz);
        density.iter_mut().for_each(|value| *value *= scale);
        let step = rate_hz / length as f64;
        Self { frequency_hz: (0..density.len()).map(|k| k as f64 * step).collect(), density }
    }

    /// The spectrum of two signals together, of the same rate and length.
    pub fn with(mut self, other: Self) -> Self {
        self.density.iter_mut().zip(&other.density).for_each(|(sum, x)| *sum += x);
        self
    }

    /// Step of the frequencies, Hz.
    fn step_hz(&self) -> f64 {
        self.frequency_hz[1]
    }

    /// Sampling rate of the signal, Hz, to a step.
    fn rate_hz(&self) -> f64 {
        2.0 * self.frequency_hz[self.frequency_hz.len() - 1]
    }

    /// Density at the frequency nearest to this one.
    fn at(&self, hz: f64) -> f64 {
        self.density[((hz / self.step_hz()).round() as usize).min(self.density.len() - 1)]
    }

    /// Frequency below which a share of the power lies, Hz.
    pub fn bandwidth_hz(&self, share: f64) -> f64 {
        let total: f64 = self.density.iter().sum();
        let mut below = 0.0;
        let reached = self.density.iter().position(|density| {
            below += density;
            below >= share * total
        });
        reached.map_or(0.0, |index| self.frequency_hz[index])
    }
}

/// Power of a signal in waves over the position, by whole periods per turn: |sum r exp(i order
/// q)|².
///
/// - `samples`: position q, rad, and signal r
pub fn power_by_order(
    samples: impl Iterator<Item = (f64, f64)>,
    orders: RangeInclusive<usize>,
) -> Vec<f64> {
    let mut sums = vec![[0.0; 2]; orders.end().saturating_sub(*orders.start()) + 1];
    for (q, r) in samples {
        let (s1, c1) = q.sin_cos();
        let (mut s, mut c) = (*orders.start() as f64 * q).sin_cos();
        for sum in &mut sums {
            sum[0] += r * c;
            sum[1] += r * s;
            (s, c) = (s * c1 + c * s1, c * c1 - s * s1);
        }
    }
    sums.iter().map(|[a, b]| a * a + b * b).collect()
}

fn without_line(values: &[f64]) -> Vec<f64> {
    let n = values.len() as f64;
    let middle = 0.5 * (n - 1.0);
    let mean = values.iter().sum::<f64>() / n;
    let square: f64 = (0..values.len()).map(|k| (k as f64 - middle).powi(2)).sum();
    let slope =
        values.iter().enumerate().map(|(k, x)| (k as f64 - middle) * x).sum::<f64>() / square;
    values.iter().enumerate().map(|(k, x)| x - mean - slope * (k as f64 - middle)).collect()
}

/// A cut-off chosen from the spectra of the joint positions, and why.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct CutoffChoice {
    /// The cut-off for all joints: the highest of theirs, so that every joint's motion passes.
    pub cutoff_hz: f64,
    /// Per joint: where the spectrum of its acceleration is lowest, between motion and noise, Hz;
    /// zero for a joint whose motion cannot be seen: it is held, or moves at constant speed.
    pub joint_hz: Vec<f64>,
    /// Per joint: standard deviation of the white noise of its position, from the upper half of the
    /// spectrum, where no arm moves.
    pub noise: Vec<f64>,
    /// Per joint: spectrum of the position.
    pub spectra: Vec<Spectrum>,
    /// Length of the signal, s.
    pub duration: f64,
    /// Whether the signal is shorter than a window: its spectrum, averaged over none, is a rough
    /// one.
    pub is_rough: bool,
}

/// A position that varies by less (root mean square, rad or m) does not move.
const STILL: f64 = 1e-9;

/// Highest cut-off, as a share of the sampling rate: differences need some samples per period.
const HIGHEST_CUTOFF: f64 = 0.2;

/// Share of the density of speed of the joint that has most of it below which a joint is held, and
/// trembles with others.
const HELD: f64 = 1e-3;

/// Share of the power of speed in the lower half of the spectrum from which on it is that of
/// motion: of white noise of the position it is an eighth, of a tremble between the two.
const OF_MOTION: f64 = 0.5;

/// Chooses the low-pass for joint positions `[samples, n]`, row-major.
///
/// Motion dies out with frequency; the noise of an encoder does not, and in the acceleration it
/// grows with the fourth power. So the spectrum of the acceleration, position times (2 pi f)^4,
/// falls, has a lowest point and rises again. Below that point there is more motion than noise,
/// above it more noise than motion, whatever colour either has: it is the cut-off. Of a motion that
/// hides in the noise of its speed the spectrum of the acceleration has no such point: such joints
/// are asked only where no other moves.
pub fn choose_cutoff(position: &[f64], joints: usize, rate_hz: f64) -> CutoffChoice {
    let samples = position.len() / joints;
    // Windows of some eight seconds resolve the slow end, and average the noise of a log of a
    // minute.
    let whole = (8.0 * rate_hz) as usize;
    let window = whole.clamp(64, samples.max(64));
    let of_joint = |joint: usize| {
        let signal: Vec<f64> = position.iter().skip(joint).step_by(joints).copied().collect();
        Spectrum::welch(&signal, rate_hz, window)
    };
    CutoffChoice::of(
        (0..joints).map(of_joint).collect(),
        rate_hz,
        samples as f64 / rate_hz,
        samples < whole,
    )
}

impl CutoffChoice {
    fn of(spectra: Vec<Spectrum>, rate_hz: f64, duration: f64, is_rough: bool) -> Self {
        let noise = |spectrum: &Spectrum| {
            let bins = spectrum.density.len();
            let floor = median(&spectrum.density[bins / 2..(bins * 19 / 20).max(bins / 2 + 1)]);
            (0.5 * floor * rate_hz).sqrt()
        };
        let lowest: Vec<LowestAcceleration> = spectra.iter().map(LowestAcceleration::of).collect();
        let most = lowest.iter().map(|own| own.speed_density).fold(0.0, f64::max);
        let is_seen = |own: &&LowestAcceleration| {
            own.of_motion > OF_MOTION && own.speed_density >= HELD * most
        };
        let joint_hz: Vec<f64> =
            lowest.iter().map(|own| Some(own).filter(is_seen).map_or(0.0, |own| own.hz)).collect();
        let of_all: Vec<f64> = lowest.iter().map(|own| own.hz).collect();
        let highest =
            |all: &[f64]| Some(all.iter().copied().fold(0.0, f64::max)).filter(|hz| *hz > 0.0);
        let highest = highest(&joint_hz).or_else(|| highest(&of_all));
        let cutoff_hz = highest.unwrap_or(f64::INFINITY).min(HIGHEST_CUTOFF * rate_hz);
        Self {
            cutoff_hz,
            joint_hz,
            noise: spectra.iter().map(noise).collect(),
            spectra,
            duration,
            is_rough,
        }
    }

    /// Whether the motion of a joint can be seen.
    fn sees_motion(&self) -> bool {
        self.joint_hz.iter().any(|hz| *hz > 0.0)
    }

    /// The cut-off for several signals, Hz: the highest of theirs, so that the motion of each
    /// passes. The highest of many rough ones would be chance; those that are rough are judged by
    /// what all spectra say together. A signal in which nothing moves has no motion to keep: it is
    /// asked only where none has. None of no signals.
    pub fn highest_hz(choices: &[Self]) -> Option<f64> {
        let some_move = choices.iter().any(Self::sees_motion);
        let asked: Vec<&Self> =
            choices.iter().filter(|choice| !some_move || choice.sees_motion()).collect();
        let fine = asked.iter().filter(|choice| !choice.is_rough).map(|choice| choice.cutoff_hz);
        let rough =
            asked.iter().any(|choice| choice.is_rough).then(|| Self::together(&asked).cutoff_hz);
        fine.chain(rough).reduce(f64::max)
    }

    /// What the spectra of several signals of the same joints say together, each by its duration.
    fn together(choices: &[&Self]) -> Self {
        let first_spectra = choices.iter().map(|choice| &choice.spectra[0]);
        let rate_hz = first_spectra.clone().map(Spectrum::rate_hz).fold(f64::INFINITY, f64::min);
        let step = first_spectra.map(Spectrum::step_hz).fold(f64::INFINITY, f64::min);
        let frequency_hz: Vec<f64> =
            (0..=(0.5 * rate_hz / step).round() as usize).map(|k| k as f64 * step).collect();
        let duration = choices.iter().map(|choice| choice.duration).sum();
        let of_joint = |joint: usize| {
            let density = |hz: &f64| -> f64 {
                let own = choices
                    .iter()
                    .map(|choice| choice.duration / duration * choice.spectra[joint].at(*hz));
                own.sum()
            };
            Spectrum {
                density: frequency_hz.iter().map(density).collect(),
                frequency_hz: frequency_hz.clone(),
            }
        };
        let spectra = (0..choices[0].spectra.len()).map(of_joint).collect();
        Self::of(spectra, rate_hz, duration, choices.iter().all(|choice| choice.is_rough))
    }
}

/// Where the smoothed spectrum of an acceleration is lowest beyond the peak of that of the speed.
#[derive(Clone, Copy, Debug, Default)]
struct LowestAcceleration {
    /// Zero where nothing moves, Hz.
    hz: f64,
    /// Density of the speed at its peak, (rad/s)² / Hz ((m/s)² / Hz).
    speed_density: f64,
    /// Share of the power of the speed that is in the lower half of the spectrum.
    of_motion: f64,
}

impl LowestAcceleration {
    fn of(spectrum: &Spectrum) -> Self {
        let power = |k: usize, exponent: i32| {
            spectrum.density[k] * (std::f64::consts::TAU * spectrum.frequency_hz[k]).powi(exponent)
        };
        let bins = spectrum.density.len();
        let upper = bins * 9 / 10;
        let peak = (1..upper).max_by(|&a, &b| power(a, 2).total_cmp(&power(b, 2))).unwrap_or(1);
        let power_of_all: f64 = spectrum.density.iter().sum::<f64>() * spectrum.step_hz();
        // A number that never changes has only rounding.
        if power_of_all.sqrt() < STILL {
            return Self::default();
        }
        let speed = |of: std::ops::Range<usize>| of.map(|k| power(k, 2)).sum::<f64>();
        let (speed_density, of_motion) = (power(peak, 2), speed(1..bins / 2) / speed(1..bins));
        // White noise has its highest velocity at the upper end.
        if peak > bins / 2 {
            return Self { hz: 0.0, speed_density, of_motion };
        }
        // Averages over bands a third of an octave wide, so that single lines and dips do not
        // decide.
        let smoothed = |centre: usize| {
            let half_band = (centre as f64 * 0.13).ceil() as usize;
            let band = centre.saturating_sub(half_band).max(1)..(centre + half_band + 1).min(bins);
            let count = band.len() as f64;
            band.map(|k| power(k, 4)).sum::<f64>() / count
        };
        let lowest =
            (peak..upper).min_by(|&a, &b| smoothed(a).total_cmp(&smoothed(b))).unwrap_or(peak);
        Self { hz: spectrum.frequency_hz[lowest], speed_density, of_motion }
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            let mut uniform = || {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
            };
            (-2.0 * uniform().ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()
        }
    }

    #[test]
    fn density_of_white_noise_integrates_to_its_variance() {
        let mut next = noise(1);
        let signal: Vec<f64> = (0..100_000).map(|_| 0.3 * next()).collect();
        let spectrum = Spectrum::welch(&signal, 200.0, 1000);
        let step = spectrum.frequency_hz[1];
        let variance: f64 = spectrum.density.iter().sum::<f64>() * step;
        assert!((variance / 0.09 - 1.0).abs() < 0.03, "{variance}");
    }

    #[test]
    fn density_of_a_sine_stands_at_its_frequency() {
        let signal: Vec<f64> = (0..8000)
            .map(|k| 2.0 * (std::f64::consts::TAU * 5.0 * f64::from(k) / 100.0).sin())
            .collect();
        let spectrum = Spectrum::welch(&signal, 100.0, 800);
        let peak = (0..spectrum.density.len())
            .max_by(|a, b| spectrum.density[*a].total_cmp(&spectrum.density[*b]));
        assert!((spectrum.frequency_hz[peak.expect("not empty")] - 5.0).abs() < 0.13);
        let power: f64 = spectrum.density.iter().sum::<f64>() * spectrum.frequency_hz[1];
        assert!((power - 2.0).abs() < 0.02, "{power}");
    }

    #[test]
    fn the_cutoff_is_where_the_motion_sinks_into_the_noise() {
        // Motion whose density falls steeply: harmonics of 0.5 Hz with amplitudes f^-4, noise of 20
        // µrad.
        let mut next = noise(2);
        let rate = 250.0;
        let position: Vec<f64> = (0..15_000)
            .flat_map(|k| {
                let t = f64::from(k) / rate;
                let motion: f64 = (1..40)
                    .map(|h| {
                        f64::from(h).powi(-4) * (std::f64::consts::PI * f64::from(h) * t).sin()
                    })
                    .sum();
                [motion + 2e-5 * next(), 1.0 + 2e-5 * next()]
            })
            .collect();
        let choice = choose_cutoff(&position, 2, rate);
        for found in &choice.noise {
            assert!((found / 2e-5 - 1.0).abs() < 0.1, "{found}");
        }
        // The line of harmonic h has power h^-8 / 2 per 0.5 Hz; it equals the noise density 2
        // (2e-5)² / 250 at h = 28, 14 Hz. The sum of h^-4 and h^4 is lowest there, and flat around.
        assert!((9.0..18.0).contains(&choice.cutoff_hz), "{}", choice.cutoff_hz);
        assert_eq!(choice.joint_hz[1], 0.0, "the second joint stands still");
    }

    #[test]
    fn short_signals_have_the_cutoff_that_they_have_in_one() {
        // A sum of waves that dies out at some 4 Hz, with the noise of an encoder.
        let mut next = noise(4);
        let rate = 100.0;
        let position: Vec<f64> = (0..6000)
            .map(|k| {
                let t = f64::from(k) / rate;
                let wave =
                    |h: i32| (-2.0 * f64::from(h).sqrt()).exp() * (1.3 * f64::from(h) * t).sin();
                (1..60).map(wave).sum::<f64>() + 2e-4 * next()
            })
            .collect();
        let whole = choose_cutoff(&position, 1, rate);
        assert!(!whole.is_rough && whole.duration == 60.0);
        let pieces: Vec<CutoffChoice> =
            position.chunks(300).map(|piece| choose_cutoff(piece, 1, rate)).collect();
        assert!(pieces.iter().all(|piece| piece.is_rough));
        let highest = pieces.iter().map(|piece| piece.cutoff_hz).fold(0.0, f64::max);
        let together = CutoffChoice::highest_hz(&pieces).expect("some signals");
        assert!(
            (together / whole.cutoff_hz - 1.0).abs() < 0.2,
            "{together} Hz, in one {} Hz",
            whole.cutoff_hz
        );
        assert!(
            highest > 1.4 * whole.cutoff_hz,
            "one piece alone {highest} Hz, in one {} Hz",
            whole.cutoff_hz
        );
        // A long signal keeps its own say beside short ones; without signals there is none.
        let mixed =
            CutoffChoice::highest_hz(&[whole.clone(), pieces[0].clone()]).expect("two signals");
        assert!(mixed >= whole.cutoff_hz && mixed < 1.2 * whole.cutoff_hz, "{mixed}");
        assert_eq!(CutoffChoice::highest_hz(&[]), None);
    }

    #[test]
    fn a_joint_that_is_held_has_no_say() {
        // The second joint trembles 30 times a second.
        let mut next = noise(3);
        let position: Vec<f64> = (0..15_000)
            .flat_map(|k| {
                let time = f64::from(k) / 250.0;
                let tremble = 1e-7 * (std::f64::consts::TAU * 30.0 * time).sin();
                [(2.5 * time).sin() + 2e-5 * next(), tremble + 1e-9 * next()]
            })
            .collect();
        let choice = choose_cutoff(&position, 2, 250.0);
        assert_eq!(choice.joint_hz[1], 0.0, "{:?}", choice.joint_hz);
        assert_eq!(choice.cutoff_hz, choice.joint_hz[0]);
    }

    #[test]
    fn a_move_at_constant_speed_has_no_say() {
        // A ramp with the noise of a sensor, which wobbles 30 times a second.
        let mut next = noise(5);
        let wobble = |k: i32| 1e-5 * (std::f64::consts::TAU * 30.0 * f64::from(k) / 250.0).sin();
        let ramp: Vec<f64> =
            (0..2500).map(|k| 0.002 * f64::from(k) + wobble(k) + 1e-5 * next()).collect();
        let choice = choose_cutoff(&ramp, 1, 250.0);
        assert_eq!(choice.joint_hz, [0.0]);
        assert!(
            choice.cutoff_hz > 20.0,
            "where nothing else moves the wobble is all there is: {}",
            choice.cutoff_hz
        );
    }
}
