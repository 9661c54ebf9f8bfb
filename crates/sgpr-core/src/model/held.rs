//! Identification that poor logs cannot fool: what they do not determine stays with the robot file,
//! joints that the file predicts better keep it, and sentences say which motion would free them.

use std::collections::BTreeSet;

use faer::Mat;

use super::extent::JointExtent;
use crate::dynamics::Samples;
use crate::effects::Role;
pub(super) use crate::identification::Held;
use crate::identification::{
    BaseParameters, Dispersion, Equations, Estimate, IdentificationError, JointFactor, Judgement,
    LeftOut, Method, ParameterPrior, ParameterSet, PriorWidth, WIDTHS, equations_of, estimate,
    estimate_with_prior, usual_speed, variances, without_negative,
};
use crate::intervals::place_of_share;
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;
use sgpr_numeric::internal::Random;

/// What an estimate under a prior is made of.
pub(super) struct Task<'a> {
    pub robot: &'a Robot,
    pub set: &'a ParameterSet,
    pub base: &'a BaseParameters,
    pub factors: &'a [JointFactor],
    /// Of consecutive parts of all logs, one after the other.
    pub parts: &'a [Vec<JointFactor>],
    /// What joints did, `[n]`.
    pub extents: &'a [JointExtent],
}

/// An estimate, and what the user should know of it.
pub(super) struct HeldEstimate {
    pub estimate: Estimate,
    /// None if the logs are rich.
    pub held: Option<Held>,
    /// Width of the prior of rich logs; none if their estimate is bare.
    pub weak: Option<f64>,
    /// How wide intervals have to be ([`LeftOut::dispersion`]); that of noise for a bare estimate.
    pub dispersion: Dispersion,
    pub notes: Vec<String>,
}

/// Leaves out the rows of joints that never move: whatever holds such a joint, dry friction
/// included, is one unknown torque, which many equal rows would make certain. They still judge
/// ([`LeftOut::judge_against_file`]).
pub(super) fn leave_out_joints_at_rest(factors: &mut Vec<JointFactor>) {
    let moving: Vec<usize> =
        factors.iter().filter(|factor| !factor.resting).map(|factor| factor.joint).collect();
    factors.retain(|factor| moving.contains(&factor.joint));
}

/// Relative deviation of bodies under a prior that says next to nothing of them, as with consistent
/// parameters.
const FLAT: f64 = 30.0;

/// Relative deviation of bodies that are held although the file is wrong.
const WIDE: f64 = 10.0;

/// A prior of rich logs is at least so wide.
const WEAK: f64 = 3.0;

/// Torque of friction, offsets and gains under a prior that says next to nothing of them, in what
/// the file leaves of a joint's.
const FLAT_EFFECTS: f64 = 10.0;

/// Times that the logs may be less sure of the torque of other motions than the robot file is
/// wrong, before it holds them.
const CLEARLY: f64 = 2.0;

/// An estimate that is at most this many times less sure of faster motions without a prior than
/// with the most probable one, if that leaves them in no doubt, needs none for these; a joint that is
/// more times less sure than the median one stands out.
const FAR: f64 = 5.0;

/// How fast joints move in other motions than those of the logs, in both directions.
#[derive(Clone, Copy)]
enum Pace {
    /// As in the logs.
    OfLogs,
    /// At least as the joint that is fastest in the logs, up to what they are made for.
    OfFastestJoint,
    /// At least as they are made for: an oscillation of 1 rad (m) at half the speed limit.
    Usual,
}

/// Samples of other motions.
const OTHER_MOTIONS: usize = 200;

/// Share of the squared error that a prior has to save: a twentieth of the error, as a process has.
const LEAST_GAIN: f64 = 1.0 - 0.95 * 0.95;

/// Standard deviations of joints' torques in other motion, in what the robot file leaves there.
#[derive(Clone, Copy)]
struct Doubt {
    /// Of the median joint.
    median: f64,
    /// Of the joint that has most.
    most: f64,
}

impl Doubt {
    const ENDLESS: Self = Self { median: f64::INFINITY, most: f64::INFINITY };

    /// Whether a joint is in doubt as no other is: the logs say nothing of it.
    fn stands_out(self) -> bool {
        self.most > CLEARLY && self.most > FAR * self.median
    }
}

/// What the identification gains over the robot file, all joints alike.
fn total(judged: &[Judgement]) -> f64 {
    judged.iter().map(|judgement| judgement.gain).sum()
}

/// Root mean square of the standard deviations of a joint's torque over its rows in motion, N·m
/// (N).
fn deviation(covariance: &Mat<f64>, factors: &[JointFactor], joint: usize) -> f64 {
    let own = factors.iter().filter(|factor| factor.joint == joint && !factor.resting);
    let (sum, rows) =
        own.fold((0.0, 0), |(sum, rows), own| (sum + variances(covariance, own), rows + own.rows));
    (sum / f64::max(rows as f64, 1.0)).sqrt()
}

impl Task<'_> {
    /// Noise of each joint's rows in motion, N·m (N): of what the parameters leave of the rows that
    /// they follow and of what they leave of parts that they do not know, the geometric mean. A row
    /// that a fit follows by a share h of it is left 1 - h of its noise, and 1 / (1 - h) if the fit
    /// does not know it; few rows look less noisy than they are, and would weigh the more, the more
    /// of them the parameters follow.
    ///
    /// Source: R. D. Cook, S. Weisberg, Residuals and Influence in Regression (1982), section
    /// 2.2.1, for residuals with and without a row.
    pub fn noise(&self, held: &Held) -> Vec<f64> {
        let error = self.left_out(held).error(&held.prior);
        let pairs = self.factors.iter().zip(&held.estimate.noise);
        let noise = |(factor, noise): (&JointFactor, &f64)| match error(factor.joint)
            .filter(|_| !factor.resting)
        {
            Some(error) if error > *noise => (error * noise).sqrt(),
            _ => 0.0,
        };
        pairs.map(noise).collect()
    }

    /// The estimate, and, with `keeping`, the robot file for joints that it predicts better.
    ///
    /// The logs are rich if they know the torque of other motions better than the robot file does
    /// ([`Self::knows_more_than_file`]), of faster ones at the median joint ([`Self::doubt`]), and
    /// if the prior that makes them most probable does not save [`LEAST_GAIN`] for certain, by one
    /// standard error, on parts that were left out: it takes what the model lacks for noise. Nor are
    /// they if the doubt of one joint stands out. What holds rich logs is weak
    /// ([`Self::of_rich_logs`]). Else a wide prior takes the place of the most probable one where
    /// that costs errors for certain. Parts of slow logs are slow: a prior that leaves faster motions
    /// in more doubt than the file is too wide for them.
    pub fn estimate(
        &self,
        method: &Method,
        equations: &mut Equations<'_>,
        (prior, width): (ParameterPrior, PriorWidth),
        correlation: &[f64],
        keeping: bool,
    ) -> Result<HeldEstimate, IdentificationError> {
        let mut held = self.solve(method, equations, (&prior, width), correlation)?;
        let mut notes = Vec::new();
        if matches!(width, PriorWidth::Chosen | PriorWidth::InForce) {
            let flat = prior.clone().with_relative_deviation(FLAT).with_effect_scale(FLAT_EFFECTS);
            let parts = self.left_out(&held);
            let saved = parts.judge(&flat, &held.prior);
            let saves_little = saved.gain - saved.standard_error < LEAST_GAIN || saved.parts < 2;
            let wider = faer::Scale(self.dispersion(&held).as_seen.powi(2));
            let may_be_rich = saves_little && width == PriorWidth::Chosen;
            let bare =
                if may_be_rich { self.bare(method, equations, &flat, correlation)? } else { None };
            let bare =
                bare.filter(|bare| self.knows_more_than_file(&(wider * &*bare.covariance), &flat));
            let doubt_at =
                |pace, of: &Estimate| self.doubt(&(wider * &*of.covariance), &flat, pace);
            let doubt = |of: &Estimate| doubt_at(Pace::Usual, of);
            let bare = bare.filter(|bare| !doubt_at(Pace::OfFastestJoint, bare).stands_out());
            let probable = doubt(&held.estimate).median;
            let most = if probable <= CLEARLY { CLEARLY.max(FAR * probable) } else { CLEARLY };
            let bare = bare.filter(|bare| doubt(bare).median <= most);
            if let Some(bare) = bare {
                let (priors, known) = ((&prior, &flat), (bare, &parts));
                return self.of_rich_logs(method, equations, priors, correlation, known);
            }
            if saves_little && saved.is_worse() {
                let wide = flat.with_effect_scale(1.0);
                let wide = (&wide, PriorWidth::Given(WIDE));
                held = self.solve(method, equations, wide, correlation)?;
            }
            held = self.with_less_doubt(method, equations, held, correlation)?;
        }
        if keeping {
            let judged = self.judge(&held);
            let worse: Vec<usize> =
                (0..judged.len()).filter(|joint| judged[*joint].is_worse()).collect();
            if !worse.is_empty() {
                let own = |k: &usize| self.joint_of(*k).is_some_and(|joint| worse.contains(&joint));
                let kept: Vec<usize> = (0..self.base.rank()).filter(own).collect();
                let given = PriorWidth::Given(held.prior.relative_deviation());
                let keeping = held.prior.clone().keeping(kept);
                let keeps = self.solve(method, equations, (&keeping, given), correlation)?;
                let after = self.judge(&keeps);
                // Joints share bodies: what one keeps may cost the others more.
                if total(&after) >= total(&judged) {
                    held = keeps;
                    notes.extend(self.kept_notes(&worse, &judged));
                }
            }
        }
        notes.extend(self.refused_note(&held.refused));
        notes.extend(self.held_note(&held));
        Ok(HeldEstimate {
            estimate: held.estimate.clone(),
            dispersion: self.dispersion(&held),
            held: Some(held),
            weak: None,
            notes,
        })
    }

    /// The estimate without prior; none if there are fewer rows than parameters.
    fn bare(
        &self,
        method: &Method,
        equations: &mut Equations<'_>,
        prior: &ParameterPrior,
        correlation: &[f64],
    ) -> Result<Option<Estimate>, IdentificationError> {
        let factors = self.factors_of_many_rows();
        match estimate(method, equations, &factors, prior.mean(), Some(correlation)) {
            Err(IdentificationError::TooFewRows { .. }) => Ok(None),
            found => found.map(Some),
        }
    }

    /// The estimate of rich logs: the values under the weak prior with which parts that were left out
    /// are predicted best, bare if none saves anything, and the spread of the bare estimate.
    fn of_rich_logs(
        &self,
        method: &Method,
        equations: &mut Equations<'_>,
        (prior, flat): (&ParameterPrior, &ParameterPrior),
        correlation: &[f64],
        (bare, parts): (Estimate, &LeftOut<'_>),
    ) -> Result<HeldEstimate, IdentificationError> {
        let widths: Vec<f64> = WIDTHS.into_iter().filter(|width| *width >= WEAK).collect();
        let priors: Vec<ParameterPrior> =
            widths.iter().map(|width| prior.clone().of_rich_logs(*width)).collect();
        let saved = parts.judge_each(flat, &priors).into_iter().map(|judgement| judgement.gain);
        let best = widths.into_iter().zip(saved).max_by(|a, b| a.1.total_cmp(&b.1));
        let weak = best.filter(|(_, saved)| *saved > 0.0).map(|(width, _)| width);
        let (estimate, refused) = match weak {
            Some(width) => {
                let task = Task { factors: &self.factors_of_many_rows(), ..*self };
                let weak = (&prior.clone().of_rich_logs(width), PriorWidth::Given(width));
                let weak = task.solve(method, equations, weak, correlation)?;
                (Estimate { values: weak.estimate.values, ..bare }, weak.refused)
            }
            None => without_negative(bare, flat.friction()),
        };
        let notes = self.refused_note(&refused).into_iter().collect();
        Ok(HeldEstimate { estimate, held: None, weak, dispersion: Dispersion::NONE, notes })
    }

    /// The factors, with the noise that an estimate leaves ([`Self::noise`]).
    fn factors_of_many_rows(&self) -> Vec<JointFactor> {
        let plain = |factor: &JointFactor| JointFactor { least_noise: 0.0, ..factor.clone() };
        self.factors.iter().map(plain).collect()
    }

    /// Whether an estimate of this covariance predicts the torque of every joint with a standard
    /// deviation of at most [`CLEARLY`] times what the robot file leaves of it, in poses over the
    /// whole range of the joints at speeds and accelerations of the logs, in both directions.
    fn knows_more_than_file(&self, covariance: &Mat<f64>, prior: &ParameterPrior) -> bool {
        if (0..self.base.rank()).any(|k| !covariance[(k, k)].is_finite()) {
            return false;
        }
        let Ok(seen) = self.other_motions(Pace::OfLogs) else { return false };
        let certain =
            |joint| deviation(covariance, &seen, joint) <= CLEARLY * prior.left_by_file()[joint];
        (0..self.robot.dof()).all(certain)
    }

    /// The estimate, or one that a narrower prior holds, the first that does not leave faster
    /// motions in doubt; if all do, the one that does it least.
    fn with_less_doubt(
        &self,
        method: &Method,
        equations: &mut Equations<'_>,
        held: Held,
        correlation: &[f64],
    ) -> Result<Held, IdentificationError> {
        let doubt = |held: &Held| {
            let covariance =
                faer::Scale(self.dispersion(held).as_seen.powi(2)) * &*held.estimate.covariance;
            self.doubt(&covariance, &held.prior, Pace::Usual).median
        };
        let (mut least, mut best) = (doubt(&held), held);
        let chosen = best.prior.relative_deviation();
        for width in WIDTHS.into_iter().rev().filter(|width| *width < chosen) {
            if least <= CLEARLY {
                break;
            }
            let prior = best.prior.clone().with_relative_deviation(width);
            let narrower =
                self.solve(method, equations, (&prior, PriorWidth::Given(width)), correlation)?;
            let now = doubt(&narrower);
            if now < least {
                (least, best) = (now, narrower);
            }
        }
        Ok(best)
    }

    /// Standard deviation of the torque at a pace, of an estimate of this covariance, in what the
    /// robot file leaves there. What the file leaves grows from the logs' motion as its uncertainty
    /// does.
    fn doubt(&self, covariance: &Mat<f64>, prior: &ParameterPrior, pace: Pace) -> Doubt {
        let Ok(fast) = self.other_motions(pace) else { return Doubt::ENDLESS };
        let of_file =
            prior.clone().with_relative_deviation(1.0).with_effect_scale(1.0).covariance();
        let ratio = |joint| {
            let grows = (deviation(&of_file, &fast, joint)
                / deviation(&of_file, self.factors, joint))
            .max(1.0);
            let known = deviation(covariance, &fast, joint);
            if known > 0.0 { known / (prior.left_by_file()[joint] * grows) } else { 0.0 }
        };
        let mut ratios: Vec<f64> = (0..self.robot.dof()).map(ratio).collect();
        ratios.sort_unstable_by(f64::total_cmp);
        Doubt { median: ratios[place_of_share(0.5, ratios.len())], most: ratios[ratios.len() - 1] }
    }

    /// Equations of other motions than those of the logs.
    fn other_motions(&self, pace: Pace) -> Result<Vec<JointFactor>, IdentificationError> {
        let n = self.robot.dof();
        let ranges: Vec<[[f64; 2]; 3]> = (0..n).map(|joint| self.ranges(joint, pace)).collect();
        let mut random = Random::new(0);
        let mut draw = |quantity: usize| -> Vec<f64> {
            let of_joint = |[low, high]: [f64; 2], share: f64| low + share * (high - low);
            (0..OTHER_MOTIONS * n)
                .map(|k| of_joint(ranges[k % n][quantity], random.uniform()))
                .collect()
        };
        let [q, dq, ddq] = [0, 1, 2].map(&mut draw);
        equations_of(self.robot, self.set, self.base, Samples { q: &q, dq: &dq, ddq: &ddq })
    }

    /// Ranges of position, speed and acceleration of a joint: of position the limits, a whole turn
    /// where there are none; of the others, in both directions, up to the largest of the logs, or
    /// to those of an oscillation of 1 rad (m) at a pace.
    fn ranges(&self, joint: usize, pace: Pace) -> [[f64; 2]; 3] {
        let JointExtent { position: seen, speed, acceleration, .. } = self.extents[joint];
        let of = &self.robot.joints()[joint];
        let turn = [-std::f64::consts::PI, std::f64::consts::PI];
        let position = match of.limits.position {
            Some([low, high]) if high > low && high - low < 2.0 * turn[1] => [low, high],
            _ if of.kind.is_rotation() => turn,
            _ => seen,
        };
        let usual = match pace {
            Pace::OfLogs => 0.0,
            Pace::OfFastestJoint => {
                let fastest = self.extents.iter().map(|extent| extent.speed).fold(0.0, f64::max);
                usual_speed(of).min(fastest)
            }
            Pace::Usual => usual_speed(of),
        };
        let (speed, acceleration) = (speed.max(usual), acceleration.max(usual * usual));
        [position, [-speed, speed], [-acceleration, acceleration]]
    }

    pub fn solve(
        &self,
        method: &Method,
        equations: &mut Equations<'_>,
        (prior, width): (&ParameterPrior, PriorWidth),
        correlation: &[f64],
    ) -> Result<Held, IdentificationError> {
        estimate_with_prior(method, equations, self.factors, prior, width, Some(correlation))
    }

    fn judge(&self, held: &Held) -> Vec<Judgement> {
        self.left_out(held).judge_against_file(&held.prior, self.robot.dof())
    }

    fn left_out(&self, held: &Held) -> LeftOut<'_> {
        let level = |part: &JointFactor| {
            self.factor_of(part).map_or(f64::INFINITY, |index| held.levels[index])
        };
        LeftOut::new(self.parts, level, self.base.rank())
    }

    fn dispersion(&self, held: &Held) -> Dispersion {
        let noise = |part: &JointFactor| {
            self.factor_of(part).map_or(0.0, |index| held.estimate.noise[index])
        };
        self.left_out(held).dispersion(&held.prior, noise)
    }

    /// Of all data: the factor that a part's is a part of.
    fn factor_of(&self, part: &JointFactor) -> Option<usize> {
        self.factors
            .iter()
            .position(|factor| (factor.joint, factor.resting) == (part.joint, part.resting))
    }

    /// The joint whose link, friction or rotor a base parameter is named after; none for an effect
    /// of the whole arm.
    fn joint_of(&self, base: usize) -> Option<usize> {
        let parameter = self.base.independent()[base];
        match parameter.checked_sub(self.set.inertial()) {
            None => Some(parameter / PARAMETERS_PER_LINK),
            Some(effect) => match self.set.effect_columns().get(effect) {
                Some(column) => Some(column.joint),
                None => self.set.trajectory_columns()[parameter - self.set.of_state()].joint,
            },
        }
    }

    fn kept_notes(&self, kept: &[usize], judged: &[Judgement]) -> Vec<String> {
        let note = |&joint: &usize| {
            format!(
                "`{}` keeps link, friction and rotor of the robot file: on parts of the logs that \
                 were left out the identified ones leave {:.0} % more squared error. Record \
                 longer, with all joints moving both ways",
                self.robot.joints()[joint].name,
                -100.0 * judged[joint].gain
            )
        };
        kept.iter().map(note).collect()
    }

    /// Friction and rotors that the data make negative.
    fn refused_note(&self, refused: &[(usize, f64)]) -> Option<String> {
        let of = |(k, value): &(usize, f64)| {
            format!("`{}` ({value:.3} {})", self.base.names()[*k], self.base.units()[*k])
        };
        let all: Vec<String> = refused.iter().map(of).collect();
        (!all.is_empty()).then(|| {
            format!(
                "{} would come out negative, which no friction or rotor is: something that the \
                 model lacks, and that a diagnosis looks for, imitates it. Friction is held at zero",
                all.join(", ")
            )
        })
    }

    /// What the prior holds, and which motion would free it.
    fn held_note(&self, held: &Held) -> Option<String> {
        let parameters = held.prior.undecided(&held.data);
        if parameters.is_empty() {
            return None;
        }
        let names: Vec<&str> = parameters.iter().map(|&k| self.base.names()[k].as_str()).collect();
        let advice = self.all_advice(held);
        let advice = if advice.is_empty() {
            String::new()
        } else {
            format!(". To free them: {}", advice.join("; "))
        };
        Some(format!(
            "the motion does not excite {} of {} base parameters enough: {}; they stay near the \
             robot file{advice}",
            names.len(),
            self.base.rank(),
            names.join(", ")
        ))
    }

    /// The motion that would free parameters that the prior holds, for each joint that has some.
    pub fn all_advice(&self, held: &Held) -> Vec<String> {
        let parameters = held.prior.undecided(&held.data);
        (0..self.robot.dof()).filter_map(|joint| self.advice(joint, &parameters)).collect()
    }

    /// The motion that would free parameters of a joint; none if none of them is held.
    fn advice(&self, joint: usize, held: &[usize]) -> Option<String> {
        let own: Vec<usize> =
            held.iter().copied().filter(|k| self.joint_of(*k) == Some(joint)).collect();
        if own.is_empty() {
            return None;
        }
        let name = &self.robot.joints()[joint].name;
        let [forwards, backwards] = self.extents[joint].samples;
        if forwards + backwards == 0 {
            return Some(format!("`{name}` must move, both ways, slowly and fast"));
        }
        if forwards == 0 || backwards == 0 {
            return Some(format!("`{name}` must reverse: it moves one way only"));
        }
        let (mut together, mut alone) = (BTreeSet::new(), BTreeSet::new());
        for k in own {
            let (with_others, wish) = self.wish(k);
            if with_others && joint > 0 { &mut together } else { &mut alone }.insert(wish);
        }
        let alone: Vec<&str> = alone.difference(&together).copied().collect();
        let together: Vec<&str> = together.into_iter().collect();
        Some(match (&together[..], &alone[..]) {
            ([], alone) => format!("`{name}` must {}", alone.join(" and ")),
            (together, []) => {
                format!("`{name}` and the joints before it must {}", together.join(" and "))
            }
            (together, alone) => format!(
                "`{name}` and the joints before it must {}, `{name}` itself {}",
                together.join(" and "),
                alone.join(" and ")
            ),
        })
    }

    /// Whether the joints before a joint that moves both ways have to join in to show one of its
    /// base parameters, and in what.
    fn wish(&self, base: usize) -> (bool, &'static str) {
        let parameter = self.base.independent()[base];
        match parameter.checked_sub(self.set.inertial()) {
            None if parameter % PARAMETERS_PER_LINK < 4 => {
                (true, "take more poses all over the range")
            }
            None => (true, "accelerate more"),
            Some(effect) => match self.set.effect_columns().get(effect) {
                Some(column)
                    if self.set.effects()[column.effect].role() == Some(Role::RotorInertia) =>
                {
                    (false, "accelerate more")
                }
                Some(_) => (false, "move slowly and fast, both ways"),
                None => (false, "move over its whole range, both ways"),
            },
        }
    }
}
