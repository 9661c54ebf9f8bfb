//! Identification that poor logs cannot fool: what they do not determine stays with the robot file, joints that the file
//! predicts better keep it, and sentences say which motion would free them.

use crate::identification::{
    BaseParameters, Equations, Estimate, Held, IdentificationError, JointFactor, Judgement, LeftOut, Method,
    ParameterPrior, ParameterSet, PriorWidth, Row, estimate, estimate_with_prior,
};
use crate::motion::Motion;
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

/// What an estimate under a prior is made of.
pub(super) struct Task<'a> {
    pub robot: &'a Robot,
    pub set: &'a ParameterSet,
    pub base: &'a BaseParameters,
    pub factors: &'a [JointFactor],
    /// Of consecutive parts of all logs, one after the other.
    pub parts: &'a [Vec<JointFactor>],
    pub motions: &'a [Motion],
}

/// An estimate, and what the user should know of it.
pub(super) struct Found {
    pub estimate: Estimate,
    /// None if the logs are rich: the estimate is bare.
    pub held: Option<Held>,
    pub notes: Vec<String>,
}

/// Leaves out the rows of joints that never move: whatever holds such a joint, dry friction included, is one unknown torque,
/// which many equal rows would make certain.
pub(super) fn leave_out_joints_at_rest(factors: &mut Vec<JointFactor>, parts: &mut [Vec<JointFactor>]) {
    let moving: Vec<usize> = factors.iter().filter(|factor| !factor.resting).map(|factor| factor.joint).collect();
    factors.retain(|factor| moving.contains(&factor.joint));
    parts.iter_mut().for_each(|part| part.retain(|factor| moving.contains(&factor.joint)));
}

/// Relative deviation of bodies under a prior that says next to nothing of them, as with consistent
/// parameters.
const FLAT: f64 = 30.0;

/// Relative deviation of bodies that are held although the file is wrong.
const WIDE: f64 = 10.0;

/// Torque of friction, offsets and gains under a prior that says next to nothing of them, in what
/// the file leaves of a joint's.
const FLAT_EFFECTS: f64 = 10.0;

/// Share of the squared error that a prior has to save: a twentieth of the error, as a process has.
const LEAST_GAIN: f64 = 1.0 - 0.95 * 0.95;

/// What the identification gains over the robot file, all joints alike.
fn total(judged: &[Judgement]) -> f64 {
    judged.iter().map(|judgement| judgement.gain).sum()
}

impl Task<'_> {
    /// The estimate under the prior, and, with `keeping`, the robot file for joints that it predicts better.
    ///
    /// The widths that make the logs most probable take what the model lacks for noise. Where it is
    /// certain, by one standard error, that they save less than [`LEAST_GAIN`] on parts that were
    /// left out, logs that know each parameter better than a prior that says next to nothing have
    /// the bare estimate; the others a wide prior, if the chosen one costs errors for certain.
    pub fn estimate(
        &self,
        method: &Method,
        equations: &mut Equations<'_>,
        (prior, width): (ParameterPrior, PriorWidth),
        correlation: &[f64],
        keeping: bool,
    ) -> Result<Found, IdentificationError> {
        let mut held = self.solve(method, equations, (&prior, width), correlation)?;
        let mut notes = Vec::new();
        let flat = prior.with_relative_deviation(FLAT).with_effect_scale(FLAT_EFFECTS);
        let saved = self.left_out(&held).judge(&flat, &held.prior);
        if width == PriorWidth::Chosen && saved.parts > 1 && saved.gain + saved.standard_error < LEAST_GAIN {
            let bare = estimate(method, equations, self.factors, flat.mean(), Some(correlation))?;
            if flat.knows_less(&bare.covariance) {
                return Ok(Found { estimate: bare, held: None, notes });
            }
            if saved.is_worse() {
                let wide = flat.with_relative_deviation(WIDE).with_effect_scale(1.0);
                held = self.solve(method, equations, (&wide, PriorWidth::Given(WIDE)), correlation)?;
            }
        }
        if keeping {
            let judged = self.judge(&held);
            let worse: Vec<usize> = (0..judged.len()).filter(|joint| judged[*joint].is_worse()).collect();
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
        notes.extend(self.negative_notes(&held));
        notes.extend(self.held_note(&held));
        Ok(Found { estimate: held.estimate.clone(), held: Some(held), notes })
    }

    fn solve(
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
            let same = |factor: &JointFactor| (factor.joint, factor.resting) == (part.joint, part.resting);
            self.factors.iter().position(same).map_or(f64::INFINITY, |index| held.levels[index])
        };
        LeftOut::new(self.parts, level, self.base.rank())
    }

    /// The joint whose link, friction or rotor a base parameter is named after; none for an effect of the whole arm.
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
                "`{}` keeps link, friction and rotor of the robot file: on parts of the logs that were left out the \
                 identified ones leave {:.0} % more squared error. Record longer, with all joints moving both ways",
                self.robot.joints()[joint].name,
                -100.0 * judged[joint].gain
            )
        };
        kept.iter().map(note).collect()
    }

    /// Friction that comes out negative for certain.
    fn negative_notes(&self, held: &Held) -> Vec<String> {
        let deviations = held.estimate.standard_deviations();
        let negative = held.prior.non_negative().iter().filter(|k| held.estimate.values[**k] < 0.0);
        let note = |&k: &usize| {
            format!(
                "`{}` comes out negative ({:.3} ± {:.3} {}), which no friction or rotor is: something that the model lacks \
                 imitates it. `sgpr diagnose` looks for it; `--consistent` forbids it",
                self.base.names()[k],
                held.estimate.values[k],
                deviations[k],
                self.base.units()[k]
            )
        };
        negative.map(note).collect()
    }

    /// What the prior holds, and which motion would free it.
    fn held_note(&self, held: &Held) -> Option<String> {
        let parameters = held.prior.undecided(&held.data);
        if parameters.is_empty() {
            return None;
        }
        let names: Vec<&str> = parameters.iter().map(|&k| self.base.names()[k].as_str()).collect();
        let advice: Vec<String> = (0..self.robot.dof()).filter_map(|joint| self.advice(joint, &parameters)).collect();
        let advice = if advice.is_empty() { String::new() } else { format!(". To free them: {}", advice.join("; ")) };
        Some(format!(
            "the motion does not excite {} of {} base parameters enough: {}; they stay near the robot file{advice}",
            names.len(),
            self.base.rank(),
            names.join(", ")
        ))
    }

    /// The motion that would free parameters of a joint; none if none of them is held.
    fn advice(&self, joint: usize, held: &[usize]) -> Option<String> {
        let own: Vec<usize> = held.iter().copied().filter(|k| self.joint_of(*k) == Some(joint)).collect();
        if own.is_empty() {
            return None;
        }
        let name = &self.robot.joints()[joint].name;
        let [forwards, backwards] = self.rows_by_direction(joint);
        if forwards + backwards == 0 {
            return Some(format!("`{name}` must move, both ways, slowly and fast"));
        }
        if forwards == 0 || backwards == 0 {
            return Some(format!("`{name}` must reverse: it moves one way only"));
        }
        let mut wishes: Vec<&str> = own.iter().map(|k| self.wish(*k)).collect();
        wishes.sort_unstable();
        wishes.dedup();
        Some(format!("`{name}` {}", wishes.join(" and ")))
    }

    /// What shows a base parameter of a joint that moves both ways.
    fn wish(&self, base: usize) -> &'static str {
        let parameter = self.base.independent()[base];
        match parameter.checked_sub(self.set.inertial()) {
            None if parameter % PARAMETERS_PER_LINK < 4 => {
                "and the joints before it must take more poses, over their ranges"
            }
            None => "and the joints before it must accelerate more",
            Some(effect) => match self.set.effect_columns().get(effect) {
                Some(column) if self.set.effects()[column.effect].name() == "rotor_inertia" => "must accelerate more",
                Some(_) => "must move slowly and fast, both ways",
                None => "must move over its whole range, both ways",
            },
        }
    }

    /// Samples at which a joint moves forwards and backwards.
    fn rows_by_direction(&self, joint: usize) -> [usize; 2] {
        let n = self.robot.dof();
        let mut counts = [0, 0];
        for motion in self.motions {
            let samples = motion.dq.iter().zip(&motion.use_as).skip(joint).step_by(n);
            for (speed, _) in samples.filter(|(speed, use_as)| **use_as == Row::Moving && **speed != 0.0) {
                counts[usize::from(*speed < 0.0)] += 1;
            }
        }
        counts
    }
}
