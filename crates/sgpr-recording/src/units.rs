//! Units of logged quantities, and what they are in SI.

use std::f64::consts::{PI, TAU};
use std::fmt;
use std::str::FromStr;

use derive_setters::Setters;

use super::RecordingError;

/// Units of the columns of a log. `None`: as the column names say, or else SI.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Units {
    /// Unit of the time.
    pub time: Option<TimeUnit>,
    /// Unit of all positions.
    pub position: Option<PositionUnit>,
    /// Unit of all velocities.
    pub velocity: Option<VelocityUnit>,
    /// Unit of all torques; not for torques that are computed from currents.
    pub torque: Option<TorqueUnit>,
}

/// A unit with its spellings: the first is the one written.
trait Unit: Copy + 'static {
    const QUANTITY: &'static str;
    const SPELLINGS: &'static [(Self, &'static [&'static str])];
}

/// The unit spelled `text`: exactly, or else without regard to case where that is clear.
fn parse<U: Unit>(text: &str) -> Result<U, RecordingError> {
    let text = text.trim();
    let spelled = |same: &dyn Fn(&str) -> bool| {
        U::SPELLINGS
            .iter()
            .find(|(_, names)| names.iter().any(|name| same(name)))
            .map(|(unit, _)| *unit)
    };
    // One letter means too many things (`M` is no metre), and mega is not milli.
    let clear = text.len() > 1 && !text.starts_with('M');
    let any_case = |name: &str| clear && name.eq_ignore_ascii_case(text);
    spelled(&|name| name == text).or_else(|| spelled(&any_case)).ok_or_else(|| {
        RecordingError::UnknownUnit {
            quantity: U::QUANTITY.into(),
            unit: text.into(),
            known: U::SPELLINGS.iter().map(|(_, names)| names[0].to_string()).collect(),
        }
    })
}

macro_rules! unit {
    ($unit:ident, $quantity:literal, $($variant:ident: $spellings:expr),+) => {
        impl Unit for $unit {
            const QUANTITY: &'static str = $quantity;
            const SPELLINGS: &'static [(Self, &'static [&'static str])] = &[$((Self::$variant, &$spellings)),+];
        }

        impl FromStr for $unit {
            type Err = RecordingError;

            fn from_str(text: &str) -> Result<Self, RecordingError> {
                parse(text)
            }
        }

        impl $unit {
            /// Its usual spelling.
            pub fn name(self) -> &'static str {
                let (_, names) = Self::SPELLINGS.iter().find(|(unit, _)| *unit == self).expect("each \
                     unit is listed");
                names[0]
            }
        }

        impl fmt::Display for $unit {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}

/// Unit of a joint position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PositionUnit {
    /// rad
    Radian,
    /// mrad
    Milliradian,
    /// deg
    Degree,
    /// Full turns
    Turn,
    /// m
    Metre,
    /// mm
    Millimetre,
}

// Beside the degree sign stand signs that look like it, and what it becomes in text of another
// encoding than was thought: `ø` (code page 850), `¡` (Mac), U+FFFD (lost).
unit!(PositionUnit, "position",
    Radian: ["rad", "radian", "radians"],
    Milliradian: ["mrad", "milliradian", "milliradians"],
    Degree: ["deg", "degree", "degrees", "°", "º", "˚", "∘", "\u{fffd}", "ø", "¡"],
    Turn: ["turn", "turns", "rev", "revolutions"],
    Metre: ["m", "metre", "metres", "meter", "meters"],
    Millimetre: ["mm", "millimetre", "millimetres", "millimeter", "millimeters"]);

impl PositionUnit {
    /// What one unit is in rad (m).
    pub fn factor(self) -> f64 {
        match self {
            Self::Radian | Self::Metre => 1.0,
            Self::Milliradian | Self::Millimetre => 1e-3,
            Self::Degree => PI / 180.0,
            Self::Turn => TAU,
        }
    }
}

/// Unit of a joint velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum VelocityUnit {
    /// rad/s
    RadianPerSecond,
    /// mrad/s
    MilliradianPerSecond,
    /// deg/s
    DegreePerSecond,
    /// Revolutions per minute
    Rpm,
    /// m/s
    MetrePerSecond,
    /// mm/s
    MillimetrePerSecond,
}

unit!(VelocityUnit, "velocity",
    RadianPerSecond: ["rad/s", "rad_s", "radps", "rads"],
    MilliradianPerSecond: ["mrad/s", "mrad_s", "mradps"],
    DegreePerSecond: [
        "deg/s", "deg_s", "degps", "degs", "°/s", "°_s", "º/s", "º_s", "˚/s", "˚_s", "\u{fffd}/s", "\u{fffd}_s", "ø/s", "ø_s"
    ],
    Rpm: ["rpm", "1/min", "rev/min"],
    MetrePerSecond: ["m/s", "m_s", "mps"],
    MillimetrePerSecond: ["mm/s", "mm_s", "mmps"]);

impl VelocityUnit {
    /// What one unit is in rad/s (m/s).
    pub fn factor(self) -> f64 {
        match self {
            Self::RadianPerSecond | Self::MetrePerSecond => 1.0,
            Self::DegreePerSecond => PI / 180.0,
            Self::Rpm => TAU / 60.0,
            Self::MilliradianPerSecond | Self::MillimetrePerSecond => 1e-3,
        }
    }
}

/// Unit of a joint torque or force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TorqueUnit {
    /// N·m
    NewtonMetre,
    /// mN·m
    MillinewtonMetre,
    /// kN·m
    KilonewtonMetre,
    /// N
    Newton,
    /// kN
    Kilonewton,
}

unit!(TorqueUnit, "torque",
    NewtonMetre: ["Nm", "N·m", "N*m", "N.m", "N_m"],
    MillinewtonMetre: ["mNm", "mN·m", "mN*m", "mN.m", "mN_m"],
    KilonewtonMetre: ["kNm", "kN·m", "kN*m", "kN.m", "kN_m"],
    Newton: ["N", "newton", "newtons"],
    Kilonewton: ["kN", "kilonewton", "kilonewtons"]);

impl TorqueUnit {
    /// What one unit is in N·m (N).
    pub fn factor(self) -> f64 {
        match self {
            Self::NewtonMetre | Self::Newton => 1.0,
            Self::MillinewtonMetre => 1e-3,
            Self::KilonewtonMetre | Self::Kilonewton => 1e3,
        }
    }
}

/// Unit of a motor current.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CurrentUnit {
    Ampere,
    Milliampere,
}

unit!(CurrentUnit, "current", Ampere: ["A", "amp", "amps", "ampere"], Milliampere: ["mA", "milliampere"]);

impl CurrentUnit {
    /// What one unit is in A.
    pub(super) fn factor(self) -> f64 {
        match self {
            Self::Ampere => 1.0,
            Self::Milliampere => 1e-3,
        }
    }
}

/// Unit of a time stamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TimeUnit {
    /// s
    Second,
    /// ms
    Millisecond,
    /// µs
    Microsecond,
    /// ns
    Nanosecond,
}

unit!(TimeUnit, "time",
    Second: ["s", "sec", "secs", "second", "seconds"],
    Millisecond: ["ms", "msec", "millis", "milliseconds"],
    Microsecond: ["us", "µs", "μs", "usec", "micros", "microseconds"],
    Nanosecond: ["ns", "nsec", "nanos", "nanosec", "nanoseconds"]);

impl TimeUnit {
    /// k where one unit is 10^k ns.
    pub(super) fn power_of_ten(self) -> i32 {
        match self {
            Self::Second => 9,
            Self::Millisecond => 6,
            Self::Microsecond => 3,
            Self::Nanosecond => 0,
        }
    }

    /// So many units as ns; `None` beyond what 64 bits reach.
    pub(super) fn nanoseconds(self, count: i64) -> Option<i64> {
        count.checked_mul(10_i64.pow(self.power_of_ten().unsigned_abs()))
    }

    /// The unit of a time that comes without: seconds, unless that would be later than the
    /// year 5000.
    pub(super) fn likely(time: f64) -> Self {
        match time.abs() {
            time if time >= 1e17 => Self::Nanosecond,
            time if time >= 1e14 => Self::Microsecond,
            time if time >= 1e11 => Self::Millisecond,
            _ => Self::Second,
        }
    }

    /// What one unit is in s.
    pub fn factor(self) -> f64 {
        match self {
            Self::Second => 1.0,
            Self::Millisecond => 1e-3,
            Self::Microsecond => 1e-6,
            Self::Nanosecond => 1e-9,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_in_their_usual_spellings() {
        assert_eq!("deg".parse::<PositionUnit>().expect("known"), PositionUnit::Degree);
        assert_eq!("RPM".parse::<VelocityUnit>().expect("known"), VelocityUnit::Rpm);
        assert_eq!("mNm".parse::<TorqueUnit>().expect("known"), TorqueUnit::MillinewtonMetre);
        assert_eq!("nm".parse::<TorqueUnit>().expect("known"), TorqueUnit::NewtonMetre);
        assert_eq!("N·m".parse::<TorqueUnit>().expect("known"), TorqueUnit::NewtonMetre);
        assert_eq!("ns".parse::<TimeUnit>().expect("known"), TimeUnit::Nanosecond);
    }

    #[test]
    fn case_matters_where_it_tells_units_apart() {
        assert!("M".parse::<PositionUnit>().is_err());
        assert!("n".parse::<TorqueUnit>().is_err());
        // A meganewton metre is nobody's unit, and a thousandth of it must not be guessed.
        assert!("MNm".parse::<TorqueUnit>().is_err());
    }

    #[test]
    fn unknown_units_are_answered_with_the_known_ones() {
        let message = "grad".parse::<PositionUnit>().expect_err("not a unit").to_string();
        assert_eq!(
            message,
            "`grad` is no unit of position; known are `rad`, `mrad`, `deg`, `turn`, `m`, `mm`"
        );
    }

    #[test]
    fn degree_signs_of_all_encodings() {
        for sign in ["°", "º", "˚", "∘", "\u{fffd}", "ø", "¡"] {
            assert_eq!(sign.parse::<PositionUnit>().expect(sign), PositionUnit::Degree);
        }
        assert_eq!("°/s".parse::<VelocityUnit>().expect("known"), VelocityUnit::DegreePerSecond);
        // Micro sign and Greek mu.
        assert_eq!("\u{b5}s".parse::<TimeUnit>().expect("known"), TimeUnit::Microsecond);
        assert_eq!("\u{3bc}s".parse::<TimeUnit>().expect("known"), TimeUnit::Microsecond);
    }

    #[test]
    fn factors_lead_to_si() {
        assert!((180.0 * PositionUnit::Degree.factor() - PI).abs() < 1e-15);
        assert!((60.0 * VelocityUnit::Rpm.factor() - TAU).abs() < 1e-15);
        assert_eq!(250.0 * TorqueUnit::MillinewtonMetre.factor(), 0.25);
        assert_eq!(TimeUnit::Microsecond.power_of_ten(), 3);
    }
}
