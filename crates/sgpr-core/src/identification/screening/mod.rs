//! What is wrong with data before anyone believes an estimate from them.
//!
//! A rigid arm is a strong test of its log: all joints share the same bodies. A torque of the wrong
//! sign or unit, or one that is late, breaks what the other joints say, and the break tells which.

mod delays;
mod logs_apart;
mod shifted_torques;

use std::fmt;

use faer::Mat;

pub use delays::screen_delays;
pub use logs_apart::screen_logs;
pub(crate) use logs_apart::{Apart, Left, beyond_own_rows, logs_apart};
pub(crate) use shifted_torques::ShiftedTorques;

use super::base_parameters::significant;
use super::extended_factor::{ExtendedFactor, own_noise};
use super::groups::Groups;
use super::least_squares::{Directions, Solution, stack, torque_norm};
use super::robust::MEDIAN_OF_NORMAL;
use super::{BaseParameters, Equations, Estimate, IdentificationError, JointFactor, ParameterSet};
use crate::recording::Severity;

/// Something suspicious in the data of an identification.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Finding {
    /// A torque has the other sign.
    Negated {
        /// Name of the joint.
        joint: String,
    },
    /// All torques have the other sign: friction would drive the arm.
    AllNegated,
    /// Friction would drive a joint, whose torque shares too little with the others for them to
    /// tell its sign.
    Driven {
        /// Name of the joint.
        joint: String,
    },
    /// A torque is in another unit than those of the other joints.
    Scaled {
        /// Name of the joint.
        joint: String,
        /// What it must be multiplied by.
        factor: f64,
    },
    /// The torque of a joint does not fit the bodies that it shares with the others.
    Contradiction {
        /// Name of the joint.
        joint: String,
        /// Its residual, as a multiple of what parameters of its own would leave.
        ratio: f64,
    },
    /// All torques are far from what the robot file's masses need.
    AllScaled {
        /// What they are of it.
        factor: f64,
    },
    /// The torques of all joints and the motion are not simultaneous.
    AllLate {
        /// By how much the torques come after the motion that they belong to, s; negative if
        /// before.
        seconds: f64,
        /// Share by which the residual falls if that is undone.
        gain: f64,
    },
    /// The torques were low-passed before they were logged: they end, and the motion goes on.
    TorqueEnds {
        /// Where half of what the motion asks for is left, Hz.
        hz: f64,
        /// End of the band in which both sides are compared by the motion's noise, Hz.
        band_hz: f64,
        /// Up to where they can be compared, Hz.
        compared_hz: f64,
    },
    /// Torque and motion of a joint are not simultaneous, and those of the others are, or less so.
    Late {
        /// Name of the joint.
        joint: String,
        /// By how much the torque comes after the motion that it belongs to, s; negative if before.
        seconds: f64,
        /// Share by which the residual falls if that is undone.
        gain: f64,
    },
    /// Rows far off.
    Outliers {
        /// Name of the joint.
        joint: String,
        /// How many.
        count: usize,
        /// Trajectory and sample of the worst.
        worst: (usize, usize),
        /// Its residual in standard deviations.
        deviations: f64,
    },
    /// Logs that are not of one arm, with one load.
    LogsApart {
        /// The log that suffers most from the others.
        log: String,
        /// What a fit to it alone and one to all logs leave of its torque, %, geometric means of
        /// the joints.
        left: [f64; 2],
        /// The log without which the others agree best.
        odd: String,
    },
    /// One second on which much of the estimate hangs.
    Leverage {
        /// Trajectory and sample where it begins.
        at: (usize, usize),
        /// Share of the time.
        time: f64,
        /// Share of what the data say.
        share: f64,
    },
    /// A combination that the motion hardly excites.
    Weak {
        /// The combination, as in `1.0 joint_5.Ixx - 0.7 joint_6.Iyy`.
        combination: String,
        /// Its singular value as a share of the largest.
        share: f64,
        /// Joints to move.
        joints: Vec<String>,
    },
    /// Torques at the limit of the robot file.
    Saturated {
        /// Name of the joint.
        joint: String,
        /// The limit.
        limit: f64,
        /// Its unit.
        unit: &'static str,
        /// Share of the samples.
        share: f64,
    },
    /// Positions that the robot file rules out.
    Outside {
        /// Name of the joint.
        joint: String,
        /// Lowest and highest position.
        limits: [f64; 2],
        /// Their unit.
        unit: &'static str,
        /// Share of the samples.
        share: f64,
        /// Whether they would be inside if they were degrees.
        in_degrees: bool,
    },
}

impl Finding {
    /// What it is, for machines: `saturated`, `all_late`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Negated { .. } => "negated",
            Self::AllNegated => "all_negated",
            Self::Driven { .. } => "driven",
            Self::Scaled { .. } => "scaled",
            Self::Contradiction { .. } => "contradiction",
            Self::AllScaled { .. } => "all_scaled",
            Self::AllLate { .. } => "all_late",
            Self::TorqueEnds { .. } => "torque_ends",
            Self::Late { .. } => "late",
            Self::Outliers { .. } => "outliers",
            Self::LogsApart { .. } => "logs_apart",
            Self::Leverage { .. } => "leverage",
            Self::Weak { .. } => "weak",
            Self::Saturated { .. } => "saturated",
            Self::Outside { .. } => "outside",
        }
    }

    /// The joint that it is about; none if it is about all, or the motion.
    pub fn joint(&self) -> Option<&str> {
        match self {
            Self::Negated { joint }
            | Self::Driven { joint }
            | Self::Scaled { joint, .. }
            | Self::Contradiction { joint, .. }
            | Self::Late { joint, .. }
            | Self::Outliers { joint, .. }
            | Self::Saturated { joint, .. }
            | Self::Outside { joint, .. } => Some(joint),
            Self::AllNegated
            | Self::AllScaled { .. }
            | Self::AllLate { .. }
            | Self::TorqueEnds { .. }
            | Self::LogsApart { .. }
            | Self::Leverage { .. }
            | Self::Weak { .. } => None,
        }
    }

    /// What to do about it: a note where it is right more often than it is a fault, or where the
    /// motion is to blame.
    pub fn severity(&self) -> Severity {
        match self {
            Self::Outliers { .. }
            | Self::Late { .. }
            | Self::Leverage { .. }
            | Self::Weak { .. } => Severity::Note,
            _ => Severity::Warning,
        }
    }
}

impl fmt::Display for Finding {
    #[expect(clippy::too_many_lines, reason = "a table of messages")]
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Negated { joint } => write!(
                f,
                "the torque of {joint} looks negated: with the other sign it agrees with the other \
                 joints; check the sign conventions of the log"
            ),
            Self::AllNegated => write!(
                f,
                "all torques look negated: as they are, friction would drive the arm; check the \
                 sign convention of the log"
            ),
            Self::Driven { joint } => write!(
                f,
                "the torque or the position of {joint} looks negated: as they are, friction would \
                 drive the joint; check the sign conventions of the log, and whether friction is \
                 compensated twice"
            ),
            Self::Scaled { joint, factor } => write!(
                f,
                "the torque of {joint} is in another unit or has another gain than the others: \
                 times {factor:.3} it agrees with them"
            ),
            Self::Contradiction { joint, ratio } => write!(
                f,
                "the torque of {joint} does not fit one arm: its residual is {ratio:.1} times what \
                 parameters of its own would leave. Check the order of the joints, signs, zeros \
                 and units of positions and torques, and the lengths of the robot file; or the \
                 model lacks something large there, such as a spring"
            ),
            Self::AllScaled { factor } => write!(
                f,
                "the torques are {} times what the masses of the robot file need: check their unit \
                 (mN·m, currents without their torque constants, the motor's side of a gear), or \
                 the masses",
                match *factor {
                    1.0.. => format!("{factor:.0}"),
                    0.01.. => format!("{factor:.3}"),
                    _ => format!("{factor:.2e}"),
                }
            ),
            Self::AllLate { seconds, gain } => write!(
                f,
                "the torques come {} their motion; shifted, the residual would be {:.0} % smaller. \
                 Give the torque the time at which it was measured, or shift it; a drive that lags \
                 looks the same",
                by(*seconds),
                100.0 * gain
            ),
            Self::TorqueEnds { hz, band_hz, compared_hz } => write!(
                f,
                "the torques end at {hz:.1} Hz, while the motion goes on to {band_hz:.1} Hz: they \
                 were low-passed before they were logged, and rows above say nothing of the arm. \
                 Compare both sides up to {compared_hz:.1} Hz (torque_band), or log torques as \
                 they are measured; a filter that ran forward only made them late, too, as \
                 `actuator_lag` does"
            ),
            Self::Late { joint, seconds, gain } => write!(
                f,
                "the torque of {joint} comes {} its motion, which is not so at the other joints; \
                 shifted, its residual would be {:.0} % smaller. Friction that lags behind a \
                 reversal, a spring or an elastic joint looks the same",
                by(*seconds),
                100.0 * gain
            ),
            Self::Outliers { joint, count, worst, deviations } => write!(
                f,
                "{count} {} far off the model, the farthest by {deviations:.0} standard deviations \
                 (log {}, sample {}): look there, or use a robust method (irls); turns of a joint \
                 that sticks look the same",
                if *count == 1 {
                    format!("torque of {joint} lies")
                } else {
                    format!("torques of {joint} lie")
                },
                worst.0 + 1,
                worst.1
            ),
            Self::LogsApart { log, left: [alone, together], odd } => write!(
                f,
                "the logs do not fit one model: a fit to {log} alone leaves {alone:.1} % of its \
                 torque, one to all of them {together:.1} %, and they agree best without {odd}. \
                 They are of two robots, have other loads, or columns in another order or unit: \
                 leave out what is not of this arm, or identify the logs one by one (`sgpr \
                 diagnose` finds a load that is taken up)"
            ),
            Self::Leverage { at, time, share } => write!(
                f,
                "{:.0} % of what the data say come from {:.1} % of the time (log {}, from sample \
                 {}): the estimate hangs on it",
                100.0 * share,
                100.0 * time,
                at.0 + 1,
                at.1
            ),
            Self::Weak { combination, share, joints } => write!(
                f,
                "the motion hardly excites {combination} (1/{:.0} of what it excites most): move \
                 {} faster, farther and against each other",
                1.0 / share,
                joints.join(" and ")
            ),
            Self::Saturated { joint, limit, unit, share } => write!(
                f,
                "the torque of {joint} is at or above its limit of {} {unit} in {:.1} % of the \
                 samples: what the drive could not give is not in the model; leave these times \
                 out, or move slower",
                significant(*limit),
                100.0 * share
            ),
            Self::Outside { joint, limits: [low, high], unit, share, in_degrees } => write!(
                f,
                "the position of {joint} is outside its limits of {} to {} {unit} in {:.1} % of \
                 the samples: {}",
                significant(*low),
                significant(*high),
                100.0 * share,
                if *in_degrees {
                    "read as degrees it is inside; give the unit of the position"
                } else {
                    "check its sign, zero and unit, and the order of the joints"
                }
            ),
        }
    }
}

/// `12.0 ms after`
fn by(seconds: f64) -> String {
    format!("{:.1} ms {}", 1e3 * seconds.abs(), if seconds > 0.0 { "after" } else { "before" })
}

/// A direction is weak below this share of the strongest, columns of unit length.
const WEAK: f64 = 1.0 / 500.0;

/// Joints that see the same arm leave at most this many times the residual that each leaves with
/// parameters of its own.
const DISAGREEMENT: f64 = 2.0;

/// The same of a joint that is wrong in some way: missing effects of real arms reach 2.5. And its
/// residual as a share of its torque, as a sensor that is off by a thousandth contradicts the
/// others, too, where they are good.
const CONTRADICTION: f64 = 3.5;
const WORTH_A_MESSAGE: f64 = 0.03;

/// What the factors alone tell: signs, units, weak directions. Costs nothing against collecting
/// them.
pub fn screen_factors(
    set: &ParameterSet,
    base: &BaseParameters,
    joints: &[String],
    factors: &[JointFactor],
    estimate: &Estimate,
) -> Vec<Finding> {
    let ratios = factors
        .iter()
        .zip(&estimate.noise)
        .map(|(factor, noise)| (factor, noise / noise_alone(factor), *noise));
    let worst = ratios.max_by(|a, b| a.1.total_cmp(&b.1));
    let (joint, ratio, share) = worst.map_or((0, 0.0, 0.0), |(factor, ratio, noise)| {
        (factor.joint, ratio, noise * (factor.rows as f64).sqrt() / torque_norm(factor))
    });
    let mut findings =
        if ratio > DISAGREEMENT { wrong_torques(set, base, joints, factors) } else { Vec::new() };
    if findings.is_empty() {
        findings.extend(wrong_gain(base, joints, factors, estimate.unit));
    }
    if findings.is_empty()
        && friction_drives(set, base, &estimate.values, &estimate.standard_deviations())
    {
        findings = driven(set, base, joints, factors);
    }
    if findings.is_empty() {
        findings = driven_alone(set, base, joints, factors, estimate.unit);
    }
    if findings.is_empty() && ratio > CONTRADICTION && share > WORTH_A_MESSAGE {
        findings.push(Finding::Contradiction { joint: joints[joint].clone(), ratio });
    }
    findings.extend(weak_direction(base.names(), joints, estimate));
    findings
}

/// Noise of a factor with parameters of its own; infinite where these can follow its few rows.
fn noise_alone(factor: &JointFactor) -> f64 {
    const ROWS_PER_COLUMN: usize = 2;
    if factor.rows < ROWS_PER_COLUMN * factor.columns.len() {
        f64::INFINITY
    } else {
        own_noise(factor)
    }
}

/// Whether all torques are far from those of the robot file, as they are in another unit. Nothing
/// is said where they are no multiple of the file at all. What effects explain does not count: the
/// file says nothing of friction and rotors, which can be most of the torque of a light link.
///
/// - `nominal`: base parameters of the robot file, `[rank]`
pub fn screen_scale(
    set: &ParameterSet,
    base: &BaseParameters,
    nominal: &[f64],
    factors: &[JointFactor],
) -> Option<Finding> {
    // Robot files are wrong by less, and torques in another unit by more.
    const FACTOR: f64 = 5.0;
    const ALIKE: f64 = 0.7;
    let rank = base.rank();
    let of_effects = |k: usize| {
        let combined = base.combination(k).iter().map(|(parameter, _)| *parameter);
        combined.chain([base.independent()[k]]).any(|parameter| parameter >= set.inertial())
    };
    let (mut file, mut along, mut log) = (0.0, 0.0, 0.0);
    for factor in factors.iter().filter(|factor| !factor.resting) {
        let mut extended = ExtendedFactor::new(factor);
        for effect in (0..rank).filter(|&k| of_effects(k)) {
            extended.add(effect, extended.combined(|base| if base == effect { 1.0 } else { 0.0 }));
        }
        extended.add(rank, extended.combined(|base| nominal[base]));
        let measured = extended.torque();
        let JointFactor { columns, factor: left, .. } = extended.finish(&measured);
        let last = columns.len();
        if columns.last() == Some(&rank) {
            file += left[(last - 1, last - 1)].powi(2);
            along += left[(last - 1, last - 1)] * left[(last - 1, last)];
            log += left[(last - 1, last)].powi(2);
        }
        log += left[(last, last)].powi(2);
    }
    let factor = along / file;
    let alike = along > ALIKE * (file * log).sqrt();
    (alike && !(1.0 / FACTOR..FACTOR).contains(&factor)).then_some(Finding::AllScaled { factor })
}

/// Signs and units, joint by joint: the factor on a joint's torque with which it agrees best with
/// the other joints.
fn wrong_torques(
    set: &ParameterSet,
    base: &BaseParameters,
    joints: &[String],
    factors: &[JointFactor],
) -> Vec<Finding> {
    // Residual ratio by which a correction must be better before anyone is told.
    const BETTER: f64 = 2.0;
    let rank = base.rank();
    let mut factors = factors.to_vec();
    let mut noise: Vec<f64> = factors.iter().map(noise_alone).collect();
    let mut corrections = vec![1.0; joints.len()];
    let mut correct =
        |joint: usize, correction: f64, factors: &mut [JointFactor], noise: &mut [f64]| {
            corrections[joint] *= correction;
            for (factor, noise) in
                factors.iter_mut().zip(noise).filter(|(factor, _)| factor.joint == joint)
            {
                let last = factor.factor.ncols() - 1;
                factor.factor.col_mut(last).iter_mut().for_each(|value| *value *= correction);
                *noise *= correction.abs();
            }
        };
    for joint in negated(set, base, &factors, &noise) {
        correct(joint, -1.0, &mut factors, &mut noise);
    }
    let mut corrected = vec![false; joints.len()];
    for _ in 0..joints.len() {
        let now = residual(&stack(&factors, rank, &noise));
        let rows = total_rows(&factors);
        let wrong = |candidate: &ScaledTorque| {
            let ScaledTorque { joint, factor, deviation, residual: after } = *candidate;
            let suspicious = !(0.6..1.7).contains(&factor) && !corrected[joint];
            // A joint whose torque may as well be zero agrees with everything.
            let known = factor.abs() > 10.0 * deviation * (after / rows).sqrt();
            suspicious && known && now > BETTER * after
        };
        let candidates = (0..joints.len())
            .map(|joint| ScaledTorque::new(joint, &factors, &noise, rank))
            .filter(wrong);
        let Some(best) = candidates.min_by(|a, b| a.residual.total_cmp(&b.residual)) else { break };
        let ScaledTorque { joint, factor, .. } = best;
        corrected[joint] = true;
        correct(
            joint,
            if (-1.7..-0.6).contains(&factor) { -1.0 } else { factor },
            &mut factors,
            &mut noise,
        );
    }
    // What agrees is known up to a common sign: friction must brake.
    let system = stack(&factors, rank, &noise);
    let Solution { values, inverse, .. } = Solution::new(&system, &vec![0.0; rank]);
    let unit = residual(&system) / total_rows(&factors);
    let deviations: Vec<f64> = (0..rank).map(|k| (unit * inverse[(k, k)]).sqrt()).collect();
    if corrections.contains(&-1.0) && friction_drives(set, base, &values, &deviations) {
        corrections.iter_mut().for_each(|correction| *correction = -*correction);
    }
    let finding = |(joint, correction): (&String, f64)| match correction {
        1.0 => None,
        -1.0 => Some(Finding::Negated { joint: joint.clone() }),
        factor => Some(Finding::Scaled { joint: joint.clone(), factor }),
    };
    joints.iter().zip(corrections).filter_map(finding).collect()
}

/// Joints whose torques agree with the others with the other sign, any number of them at once.
///
/// With a column for each joint's torque the squared residual is a quadratic form in the factors on
/// the torques, so that all signs can be tried. Among those that are about as good, friction
/// decides, which must brake, then their number.
fn negated(
    set: &ParameterSet,
    base: &BaseParameters,
    factors: &[JointFactor],
    noise: &[f64],
) -> Vec<usize> {
    // More joints than any arm has.
    const MOST: usize = 12;
    // Residual ratios by which signs must be better than none, and within which they are as good as
    // others.
    const BETTER: f64 = 2.0;
    const AS_GOOD: f64 = 1.25;
    let (rank, joints) = (base.rank(), set.dof());
    if joints > MOST {
        return Vec::new();
    }
    let extended: Vec<JointFactor> = factors
        .iter()
        .map(|factor| {
            let mut extended = ExtendedFactor::new(factor);
            extended.keep(1.0);
            extended.add(rank + factor.joint, extended.torque());
            extended.finish(&vec![0.0; factor.factor.nrows()])
        })
        .collect();
    let system = stack(&extended, rank + joints, noise);
    let sign = |signs: usize, joint: usize| if signs >> joint & 1 == 1 { -1.0 } else { 1.0 };
    let squares = |signs: usize| -> f64 {
        let row = |row: usize| {
            (row..joints).map(|k| system[(rank + row, rank + k)] * sign(signs, k)).sum::<f64>()
        };
        (0..joints).map(|k| row(k).powi(2)).sum()
    };
    let all: Vec<(f64, usize)> =
        (0..1_usize << joints).map(|signs| (squares(signs), signs)).collect();
    let least = all.iter().map(|(squares, _)| *squares).fold(f64::INFINITY, f64::min);
    if squares(0) <= BETTER * least {
        return Vec::new();
    }
    let mut brakes = vec![0.0; joints];
    factors.iter().for_each(|factor| brakes[factor.joint] += friction_sign(set, base, factor));
    let braking =
        |signs: usize| (0..joints).map(|joint| sign(signs, joint) * brakes[joint]).sum::<f64>();
    let good =
        all.iter().filter(|(squares, _)| *squares <= AS_GOOD * least).map(|(_, signs)| *signs);
    let best = good.max_by(|&a, &b| {
        braking(a).total_cmp(&braking(b)).then(b.count_ones().cmp(&a.count_ones()))
    });
    let signs = best.unwrap_or(0);
    (0..joints).filter(|joint| signs >> joint & 1 == 1).collect()
}

/// Whether friction and rotor of a joint, found from its own rows alone, are what they can be (1)
/// or negative (-1), beyond doubt; 0 if neither.
fn friction_sign(set: &ParameterSet, base: &BaseParameters, factor: &JointFactor) -> f64 {
    const SURE: f64 = 5.0;
    let friction = surest_friction(set, base, factor);
    if friction.abs() > SURE { friction.signum() } else { 0.0 }
}

/// Of the friction and rotor of a joint, found from its own rows alone, the parameter that is known
/// best, in standard deviations of independent rows; 0 at rest. The others follow what the model
/// lacks.
fn surest_friction(set: &ParameterSet, base: &BaseParameters, factor: &JointFactor) -> f64 {
    if factor.resting {
        return 0.0;
    }
    let system = stack(std::slice::from_ref(factor), base.rank(), &[1.0]);
    let Solution { values, inverse, .. } = Solution::new(&system, &vec![0.0; base.rank()]);
    let unit = residual(&system) / factor.rows.max(1) as f64;
    let own = base.independent().iter().enumerate().filter(|&(_, &parameter)| {
        parameter >= set.inertial()
            && set.is_non_negative(parameter)
            && set
                .effect_columns()
                .get(parameter - set.inertial())
                .is_some_and(|column| column.joint == factor.joint)
    });
    let deviations =
        own.map(|(k, _)| values[k] / (unit * inverse[(k, k)]).sqrt()).filter(|t| t.is_finite());
    deviations.max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0)
}

/// A factor on one joint's torque.
struct ScaledTorque {
    joint: usize,
    factor: f64,
    deviation: f64,
    residual: f64,
}

impl ScaledTorque {
    fn new(joint: usize, factors: &[JointFactor], noise: &[f64], rank: usize) -> Self {
        let extended: Vec<JointFactor> =
            factors.iter().map(|factor| with_free_torque(factor, joint, rank)).collect();
        let mut noise = noise.to_vec();
        let mut found = Self { joint, factor: 1.0, deviation: 0.0, residual: f64::INFINITY };
        // The noise of the torque is scaled with it: once more with the right one.
        for _ in 0..3 {
            let system = stack(&extended, rank + 1, &noise);
            let solution = Solution::new(&system, &vec![0.0; rank + 1]);
            let (before, factor) = (found.factor, solution.values[rank]);
            let deviation = solution.inverse[(rank, rank)].sqrt();
            found = Self { joint, factor, deviation, residual: residual(&system) };
            if factor == 0.0 || !factor.is_finite() {
                break;
            }
            let own = factors.iter().zip(&mut noise).filter(|(part, _)| part.joint == joint);
            own.for_each(|(_, noise)| *noise *= (factor / before).abs());
        }
        found
    }
}

fn residual(system: &Mat<f64>) -> f64 {
    let last = system.ncols() - 1;
    system[(last, last)].powi(2)
}

fn total_rows(factors: &[JointFactor]) -> f64 {
    factors
        .iter()
        .filter(|factor| !factor.resting)
        .map(|factor| factor.rows as f64)
        .sum::<f64>()
        .max(1.0)
}

/// The joint whose torque has another gain than the others, as far as it shares bodies with them.
///
/// Friction, rotor and what only this joint moves take any gain up; what it shares with others does
/// not. The squared residual over the gain says how well it is known.
///
/// - `unit`: standard deviation of a weighted row, memory included
fn wrong_gain(
    base: &BaseParameters,
    joints: &[String],
    factors: &[JointFactor],
    unit: f64,
) -> Option<Finding> {
    // Healthy logs of real arms give gains of 0.85 to 1.27 where they are known, and any with four
    // deviations where not.
    const WRONG: f64 = 1.5;
    const SURE: f64 = 8.0;
    // Share of the squared residual that the right gain saves, and what is left as a multiple of
    // what each joint leaves with parameters of its own.
    const BETTER: f64 = 0.1;
    const AGREEMENT: f64 = 1.5;
    let noise: Vec<f64> = factors.iter().map(noise_alone).collect();
    let now = residual(&stack(factors, base.rank(), &noise));
    let rows = total_rows(factors);
    let variance = unit.powi(2).max(1.0) / rows;
    let found = (0..joints.len()).filter_map(|joint| {
        let gain = GainCurve::search(&mut |logarithm| {
            with_gain(joint, logarithm, factors, &noise, base.rank())
        })?;
        let deviation = (2.0 * variance * gain.residual / gain.curvature).sqrt();
        let certain = gain.logarithm.abs() > WRONG.ln() && gain.logarithm.abs() > SURE * deviation;
        // Joints that contradict each other afterwards, too, have something else, such as springs.
        let agrees = gain.residual < AGREEMENT.powi(2) * rows;
        (certain && agrees && gain.residual < (1.0 - BETTER) * now).then_some((joint, gain))
    });
    let (joint, gain) = found.min_by(|a, b| a.1.residual.total_cmp(&b.1.residual))?;
    Some(Finding::Scaled { joint: joints[joint].clone(), factor: (-gain.logarithm).exp() })
}

/// Squared residual with a joint's torque, and its noise, divided by a gain.
fn with_gain(
    joint: usize,
    logarithm: f64,
    factors: &[JointFactor],
    noise: &[f64],
    rank: usize,
) -> f64 {
    let (mut factors, mut noise) = (factors.to_vec(), noise.to_vec());
    for (factor, noise) in
        factors.iter_mut().zip(&mut noise).filter(|(factor, _)| factor.joint == joint)
    {
        let last = factor.factor.ncols() - 1;
        factor.factor.col_mut(last).iter_mut().for_each(|value| *value *= (-logarithm).exp());
        *noise *= (-logarithm).exp();
    }
    residual(&stack(&factors, rank, &noise))
}

/// The least of a squared residual over the logarithm of a gain.
#[derive(Clone, Copy, Debug)]
struct GainCurve {
    logarithm: f64,
    residual: f64,
    curvature: f64,
}

impl GainCurve {
    /// None close to one, and if the residual falls without end.
    fn search(residual: &mut impl FnMut(f64) -> f64) -> Option<Self> {
        const STEP: f64 = 0.4;
        const STEPS: usize = 8;
        let [before, here, after] = [-STEP, 0.0, STEP].map(&mut *residual);
        let direction = if before < here.min(after) { -STEP } else { STEP };
        let mut least = before.min(after);
        if here <= least {
            return None;
        }
        let mut steps = 1;
        loop {
            if steps == STEPS {
                return None;
            }
            let next = residual(direction * (steps + 1) as f64);
            if next >= least {
                break;
            }
            (steps, least) = (steps + 1, next);
        }
        // Parabolas ever closer to the least.
        let mut centre = direction * steps as f64;
        let mut found = None;
        for step in [STEP, 0.5 * STEP, 0.1 * STEP] {
            let [before, here, after] = [centre - step, centre, centre + step].map(&mut *residual);
            let curvature = (before + after - 2.0 * here) / step.powi(2);
            if curvature <= 0.0 {
                return None;
            }
            let shift = (0.5 * (before - after) / (step * curvature)).clamp(-step, step);
            centre += shift;
            let residual = here - 0.5 * curvature * shift.powi(2);
            found = Some(Self { logarithm: centre, residual, curvature });
        }
        found
    }
}

/// W base - scale tau = 0 for the joint, as it was for the others.
fn with_free_torque(factor: &JointFactor, joint: usize, rank: usize) -> JointFactor {
    if factor.joint != joint {
        return factor.clone();
    }
    let mut extended = ExtendedFactor::new(factor);
    extended.keep(1.0);
    let torque: Vec<f64> = extended.torque().iter().map(|value| -value).collect();
    extended.add(rank, torque);
    extended.finish(&vec![0.0; factor.factor.nrows()])
}

/// The joints that friction would drive, where most are so: all, or those that their own rows name.
fn driven(
    set: &ParameterSet,
    base: &BaseParameters,
    joints: &[String],
    factors: &[JointFactor],
) -> Vec<Finding> {
    let signs: Vec<(usize, f64)> =
        factors.iter().map(|factor| (factor.joint, friction_sign(set, base, factor))).collect();
    if !signs.iter().any(|(_, sign)| *sign > 0.0) {
        return vec![Finding::AllNegated];
    }
    let negative = signs.iter().filter(|(_, sign)| *sign < 0.0);
    negative.map(|(joint, _)| Finding::Negated { joint: joints[*joint].clone() }).collect()
}

/// Joints whose own rows have friction drive them, while the other joints say nothing of their
/// sign.
///
/// - `unit`: standard deviation of a weighted row, memory included
fn driven_alone(
    set: &ParameterSet,
    base: &BaseParameters,
    joints: &[String],
    factors: &[JointFactor],
    unit: f64,
) -> Vec<Finding> {
    const SURE: f64 = 5.0;
    let drives = |factor: &&JointFactor| {
        noise_alone(factor).is_finite()
            && surest_friction(set, base, factor) < -SURE * unit.max(1.0)
    };
    factors
        .iter()
        .filter(drives)
        .map(|factor| Finding::Driven { joint: joints[factor.joint].clone() })
        .collect()
}

/// Whether most of the parameters that cannot be negative are, beyond doubt.
fn friction_drives(
    set: &ParameterSet,
    base: &BaseParameters,
    values: &[f64],
    deviations: &[f64],
) -> bool {
    const SURE: f64 = 5.0;
    let (mut negative, mut positive) = (0, 0);
    for (k, &parameter) in base.independent().iter().enumerate() {
        if parameter < set.inertial() {
            continue;
        }
        if set.is_non_negative(parameter) && values[k].abs() > SURE * deviations[k] {
            if values[k] < 0.0 { negative += 1 } else { positive += 1 }
        }
    }
    negative > 0 && negative >= set.dof().div_ceil(2) && negative > positive
}

fn weak_direction(names: &[String], joints: &[String], estimate: &Estimate) -> Option<Finding> {
    let weakest = estimate.excitation.weakest.as_ref()?;
    if weakest.relative_singular_value >= WEAK || !estimate.excitation.unexcited.is_empty() {
        return None;
    }
    let mut combination = String::new();
    let mut moving: Vec<String> = Vec::new();
    for (k, (base, share)) in weakest.shares.iter().take(4).enumerate() {
        let sign = match (k, *share < 0.0) {
            (0, false) => "",
            (0, true) => "-",
            (_, false) => " + ",
            (_, true) => " - ",
        };
        combination += &format!("{sign}{:.2} {}", share.abs(), names[*base]);
        let own = joints.iter().find(|joint| {
            names[*base].strip_prefix(joint.as_str()).is_some_and(|rest| rest.starts_with('.'))
        });
        if let Some(joint) = own.filter(|joint| !moving.contains(joint)) {
            moving.push(joint.clone());
        }
    }
    Some(Finding::Weak { combination, share: weakest.relative_singular_value, joints: moving })
}

/// What only the rows tell: rows far off, times on which everything hangs. Goes through the data
/// once.
///
/// Dry friction near a turn of its joint leaves rows far off the model: give equations without the
/// rows there, nor those at the ends of a log.
///
/// - `joints`: names
/// - `rates_hz`: sampling rate of each trajectory
///
/// # Errors
/// As [`Equations::for_each`].
pub fn screen_rows(
    equations: &mut Equations<'_>,
    joints: &[String],
    rates_hz: &[f64],
    factors: &[JointFactor],
    estimate: &Estimate,
) -> Result<Vec<Finding>, IdentificationError> {
    // Normal noise has one row in 1e15 beyond eight deviations; friction and filters have tails.
    const FAR: f64 = 8.0;
    // A hundredth of the time may carry this much of the information.
    const SHARE: f64 = 0.3;
    const TIME: f64 = 0.02;
    let group = Groups::of(factors);
    let directions = Directions::of(&estimate.whitened);
    let mut residuals: Vec<Vec<(f64, usize, usize)>> = vec![Vec::new(); joints.len()];
    let mut leverage: Vec<((usize, usize), f64)> = Vec::new();
    let mut coordinates = vec![0.0; directions.len()];
    let mut rows = 0usize;
    equations.for_each(|equation| {
        let Some(index) = group.index(&equation) else { return };
        let noise = estimate.row_noise(index, equation.trajectory);
        if equation.resting || !noise.is_finite() {
            return;
        }
        rows += 1;
        residuals[equation.joint].push((
            equation.residual(&estimate.values),
            equation.trajectory,
            equation.sample,
        ));
        coordinates.fill(0.0);
        directions.add_coordinates(equation.columns, equation.row, 1.0 / noise, &mut coordinates);
        let weight: f64 = coordinates.iter().map(|value| value * value).sum();
        let second = (equation.sample as f64 / rates_hz[equation.trajectory]) as usize;
        match leverage.last_mut() {
            Some((at, sum)) if *at == (equation.trajectory, second) => *sum += weight,
            _ => leverage.push(((equation.trajectory, second), weight)),
        }
    })?;
    let mut findings = Vec::new();
    for (joint, own) in residuals.iter().enumerate().filter(|(_, own)| !own.is_empty()) {
        let mut sizes: Vec<f64> = own.iter().map(|(residual, ..)| residual.abs()).collect();
        let middle = sizes.len() / 2;
        let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
        let scale = (median / MEDIAN_OF_NORMAL).max(1e-9);
        let far = own.iter().filter(|(residual, ..)| residual.abs() > FAR * scale);
        let count = far.clone().count();
        if let Some(worst) = far.max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())) {
            findings.push(Finding::Outliers {
                joint: joints[joint].clone(),
                count,
                worst: (worst.1, worst.2),
                deviations: worst.0.abs() / scale,
            });
        }
    }
    let total: f64 = leverage.iter().map(|(_, weight)| weight).sum();
    let time = 1.0 / leverage.len().max(1) as f64;
    if let Some(((trajectory, second), weight)) = leverage.iter().max_by(|a, b| a.1.total_cmp(&b.1))
        && time < TIME
        && *weight > SHARE * total
    {
        let sample = (*second as f64 * rates_hz[*trajectory]) as usize;
        findings.push(Finding::Leverage { at: (*trajectory, sample), time, share: weight / total });
    }
    Ok(findings)
}
