use derive_setters::Setters;
use serde::{Deserialize, Serialize};

use super::{MotionError, uniform_rate};
use crate::recording::{GAP_FACTOR, Recording, stretches};
use sgpr_predict::internal::HIGHEST_ORDER;
use sgpr_predict::names::counted;

use crate::signal::{CutoffChoice, Differentiation, choose_cutoff};

/// What the user asks for; what is left open is chosen from the logs.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Conditioning {
    /// Cut-off of the position filter, Hz; from the spectrum if `None`.
    pub cutoff_hz: Option<f64>,
    /// Order of the Butterworth filter (of one pass; it runs in both directions).
    pub order: usize,
    /// How derivatives are taken.
    pub differentiation: Differentiation,
    /// Band in which the two sides of the equation are compared.
    pub torque_band: TorqueBand,
    /// Every how many rows of the filtered equation are taken; from the band if `None`.
    pub decimation: Option<usize>,
    /// Speed below which a joint counts as standing, rad/s (m/s); from the noise if `None`.
    pub standstill_speed: Option<f64>,
    /// Periods of the cut-off before and after a turn or a rest of a joint in which its rows do not
    /// count; zero for none but half a period about a rest. Dry friction jumps at a turn, and a
    /// sample stands on either side: the slower the sampling, the more of the jump is error, which
    /// the filters spread.
    pub turn_margin: f64,
}

impl Default for Conditioning {
    fn default() -> Self {
        Self {
            cutoff_hz: None,
            order: 4,
            differentiation: Differentiation::default(),
            torque_band: TorqueBand::AsPosition,
            decimation: None,
            standstill_speed: None,
            turn_margin: 0.0,
        }
    }
}

/// Low-pass on the torque and, alike, on every column of the observation matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TorqueBand {
    /// The cut-off of the position.
    AsPosition,
    /// This cut-off, Hz.
    Hz(f64),
    /// No filter.
    Full,
}

/// What is done to every log, with all choices made. Kept with the model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Processing {
    /// Cut-off of the position filter, Hz.
    pub cutoff_hz: f64,
    /// Order of the filters.
    pub order: usize,
    /// How derivatives are taken.
    pub differentiation: Differentiation,
    /// Cut-off of both sides of the equation, Hz; none if they are not filtered.
    pub torque_cutoff_hz: Option<f64>,
    /// Every how many rows of the equation are taken.
    pub decimation: usize,
    /// Per joint: speed below which it counts as standing, rad/s (m/s).
    pub standstill_speed: Vec<f64>,
    /// Periods of the cut-off about turns and rests of a joint in which its rows do not count.
    #[serde(default)]
    pub turn_margin: f64,
}

/// Rows per second of the filtered equation, in cut-offs: at one and a half cut-offs the filter
/// passes 4 %.
const ROWS_PER_CUTOFF: f64 = 3.0;

/// A joint stands below this many standard deviations of the noise of its speed ...
const NOISE_MARGIN: f64 = 6.0;

/// ... and below this share of its highest speed.
const SPEED_SHARE: f64 = 5e-4;

/// ... and below this, rad/s (m/s), whatever the noise.
const SLOWEST: f64 = 1e-6;

/// A joint that goes less than this share of the way of the one that goes farthest, of a turn at
/// most, is held by its brake or its dry friction, and trembles with the others: what holds it is no
/// friction of motion, whatever torque it takes ...
const HELD: f64 = 1e-3;

/// ... and it stands below this share of the highest speed of all joints.
const TREMBLE: f64 = 0.01;

/// A period of a day, Hz: slower motions are none.
const LOWEST_CUTOFF_HZ: f64 = 1e-5;
/// No stamp of integer nanoseconds tells more, Hz; what a log can hold is checked beside the log.
const HIGHEST_CUTOFF_HZ: f64 = 1e9;

/// Most rows of the filtered equation for one that is taken: of stamps of a nanosecond, one in a
/// second.
const HIGHEST_DECIMATION: usize = 1_000_000_000;

/// Longest window of a derivative, samples: ten seconds at a kilohertz.
const LONGEST_WINDOW: usize = 10_001;

/// Longest margin about turns and rests, periods of the cut-off.
const WIDEST_TURN_MARGIN: f64 = 1e3;

impl Processing {
    /// Checks everything that the arithmetic relies on, as it may come from a file or from a user.
    ///
    /// - `joints`: of the robot
    ///
    /// # Errors
    /// If a number is out of its range, or a list has not one number per joint.
    pub fn check(&self, joints: usize) -> Result<(), MotionError> {
        let wrong = |option, value: String, expected: String| {
            Err(MotionError::Processing { option, value, expected })
        };
        let is_cutoff = |hz: f64| (LOWEST_CUTOFF_HZ..HIGHEST_CUTOFF_HZ).contains(&hz);
        let cutoffs =
            [("cutoff_hz", Some(self.cutoff_hz)), ("torque_cutoff_hz", self.torque_cutoff_hz)];
        for (option, hz) in cutoffs {
            if let Some(hz) = hz.filter(|hz| !is_cutoff(*hz)) {
                return wrong(
                    option,
                    format!("{hz:?} Hz"),
                    format!("from {LOWEST_CUTOFF_HZ:e} to {HIGHEST_CUTOFF_HZ:e} Hz"),
                );
            }
        }
        if !(1..=HIGHEST_ORDER).contains(&self.order) {
            return wrong("order", self.order.to_string(), format!("1 to {HIGHEST_ORDER}"));
        }
        if !(1..=HIGHEST_DECIMATION).contains(&self.decimation) {
            return wrong(
                "decimation",
                self.decimation.to_string(),
                format!("1 to {HIGHEST_DECIMATION}"),
            );
        }
        if !(0.0..=WIDEST_TURN_MARGIN).contains(&self.turn_margin) {
            return wrong(
                "turn_margin",
                self.turn_margin.to_string(),
                format!("0 to {WIDEST_TURN_MARGIN}"),
            );
        }
        if self.standstill_speed.len() != joints {
            let found = self.standstill_speed.len();
            return wrong(
                "standstill_speed",
                counted(found, "value"),
                format!("one for each of {}", counted(joints, "joint")),
            );
        }
        if let Some(speed) =
            self.standstill_speed.iter().find(|speed| !(**speed >= 0.0 && speed.is_finite()))
        {
            return wrong(
                "standstill_speed",
                speed.to_string(),
                "a finite number not below 0".into(),
            );
        }
        if self.differentiation.edge() > LONGEST_WINDOW / 2 {
            let expected = format!("a window of at most {LONGEST_WINDOW} samples");
            return wrong("differentiation", format!("{:?}", self.differentiation), expected);
        }
        Ok(self.differentiation.check()?)
    }

    /// Makes the choices that `conditioning` leaves open, from the recordings a model is fitted to,
    /// and says how the cut-off was found.
    ///
    /// # Errors
    /// If there is no recording, one is irregular or has samples that are not finite, or a wish
    /// cannot be met.
    pub fn choose(
        recordings: &[Recording],
        conditioning: &Conditioning,
    ) -> Result<(Self, Vec<CutoffChoice>), MotionError> {
        let mut choices = Vec::new();
        let mut slowest = f64::INFINITY;
        let (mut top_speed, mut range): (Vec<f64>, Vec<f64>) = Default::default();
        for recording in recordings {
            let fits = |known: &Spectra| known.joints == recording.joint_names();
            let spectra = recording.keeping(fits, || Spectra::new(recording))?;
            let Some(choice) = &spectra.choice else { continue };
            choices.push(choice.clone());
            slowest = slowest.min(spectra.rate_hz);
            for (all, own) in [(&mut top_speed, &spectra.top_speed), (&mut range, &spectra.range)] {
                all.resize(recording.dof(), 0.0);
                all.iter_mut().zip(own).for_each(|(all, own)| *all = all.max(*own));
            }
        }
        let most = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
        let (fastest, farthest) = (most(&top_speed), most(&range).min(std::f64::consts::TAU));
        let Some(highest) = CutoffChoice::highest_hz(&choices) else {
            return Err(MotionError::NoRecording);
        };
        let cutoff_hz = conditioning.cutoff_hz.unwrap_or(highest.min(0.2 * slowest));
        let torque_cutoff_hz = match conditioning.torque_band {
            TorqueBand::AsPosition => Some(cutoff_hz),
            TorqueBand::Hz(hz) => Some(hz),
            TorqueBand::Full => None,
        };
        let decimation = conditioning.decimation.unwrap_or_else(|| {
            torque_cutoff_hz
                .map_or(1, |hz| (slowest / (ROWS_PER_CUTOFF * hz)).floor().max(1.0) as usize)
        });
        let standstill = |joint: usize| {
            let noise = choices.iter().map(|choice| choice.noise[joint]).fold(0.0, f64::max);
            let speed_noise = std::f64::consts::TAU
                * cutoff_hz
                * noise
                * (2.0 * cutoff_hz / (3.0 * slowest)).sqrt();
            let tremble = if range[joint] < HELD * farthest { TREMBLE * fastest } else { 0.0 };
            (NOISE_MARGIN * speed_noise)
                .max(SPEED_SHARE * top_speed[joint])
                .max(tremble)
                .max(SLOWEST)
        };
        if let Some(speed) = conditioning.standstill_speed {
            let moved = |(joint, &top): (usize, &f64)| top > standstill(joint);
            if speed >= fastest && top_speed.iter().enumerate().any(moved) {
                return Err(MotionError::NothingMoves { speed, fastest });
            }
        }
        let standstill_speed = (0..top_speed.len())
            .map(|joint| conditioning.standstill_speed.unwrap_or_else(|| standstill(joint)));
        let processing = Self {
            cutoff_hz,
            order: conditioning.order,
            differentiation: conditioning.differentiation,
            torque_cutoff_hz,
            decimation: decimation.max(1),
            standstill_speed: standstill_speed.collect(),
            turn_margin: conditioning.turn_margin,
        };
        processing.check(top_speed.len())?;
        Ok((processing, choices))
    }
}

/// What choices are made from, of one log.
struct Spectra {
    joints: Vec<String>,
    /// None of a log without samples.
    choice: Option<CutoffChoice>,
    rate_hz: f64,
    /// Per joint, from coarse steps: noise makes little of it, rad/s (m/s).
    top_speed: Vec<f64>,
    /// From the lowest to the highest position of these steps, rad (m).
    range: Vec<f64>,
}

impl Spectra {
    fn new(recording: &Recording) -> Result<Self, MotionError> {
        let n = recording.dof();
        let mut spectra = Self {
            joints: recording.joint_names().to_vec(),
            choice: None,
            rate_hz: 0.0,
            top_speed: vec![0.0; n],
            range: vec![0.0; n],
        };
        // The longest stretch speaks for a log.
        let stretches = stretches(recording, GAP_FACTOR);
        let Some(longest) = stretches.max_by_key(|stretch| stretch.len()) else {
            return Ok(spectra);
        };
        spectra.rate_hz = uniform_rate(&longest)?;
        spectra.choice = Some(choose_cutoff(longest.position(), n, spectra.rate_hz));
        let stride = (0.05 * spectra.rate_hz).ceil() as usize;
        for joint in 0..n {
            let coarse: Vec<f64> =
                longest.position().iter().skip(joint).step_by(n * stride).copied().collect();
            let speed = |pair: &[f64]| (pair[1] - pair[0]).abs() * spectra.rate_hz / stride as f64;
            spectra.top_speed[joint] = coarse.windows(2).map(speed).fold(0.0, f64::max);
            let ends = |[low, high]: [f64; 2], q: &f64| [low.min(*q), high.max(*q)];
            let [low, high] = coarse.iter().fold([f64::INFINITY, f64::NEG_INFINITY], ends);
            spectra.range[joint] = high - low;
        }
        Ok(spectra)
    }
}
