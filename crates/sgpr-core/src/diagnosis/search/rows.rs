//! Rows that are left out because something else holds there.

use super::super::basis::{Basis, INVISIBLE, gain};
use super::super::fit::{Fitted, solve};
use super::super::problem::Column;
use super::{EVIDENCE, Search};
use crate::effects::{Dimension, Site};
use crate::model::Term;
use crate::progress::Interrupted;

/// How much later than the motion a term says that the whole torque is logged, s; `None` if it says
/// nothing of it.
pub(super) fn delay(term: &Term) -> Option<f64> {
    let [constant] = term.effect.constants() else { return None };
    let late =
        term.is_transform() && term.site == Site::Arm && constant.dimension() == Dimension::Time;
    late.then(|| term.constants[0])
}

impl Search<'_> {
    /// The fit without the moments before reversals at which joints stick, if there are joints that
    /// do.
    pub(super) fn without_holds(
        &mut self,
        fitted: &Fitted,
        (basis, white): (&Basis, &Column),
    ) -> Result<Option<Fitted>, Interrupted> {
        /// How long before a reversal a joint may stick, s.
        const DURATIONS_S: [f64; 5] = [0.016, 0.03, 0.05, 0.08, 0.12];
        /// Rows are left out somewhat farther than the jump is seen: stops differ in length.
        const FARTHER: f64 = 1.5;
        let mut holds = Vec::new();
        for joint in 0..self.problem.dof() {
            if fitted.dry_friction(joint).is_none() || self.problem.leaves_holds_out(joint) {
                continue;
            }
            let tried = DURATIONS_S.map(|seconds| {
                let column =
                    self.noise.whiten(&self.problem, &self.problem.approach_column(joint, seconds));
                (seconds, gain(basis, white, &[column], INVISIBLE))
            });
            let best = tried
                .into_iter()
                .max_by(|a, b| a.1.chi2.total_cmp(&b.1.chi2))
                .expect("some durations");
            let (seconds, gain) = best;
            let size = gain.coefficients[0];
            if 0.5 * gain.chi2 > 3.0 * EVIDENCE && size > self.noise.level[joint] {
                holds.push((joint, FARTHER * seconds + 0.02));
            }
        }
        if holds.is_empty() || self.problem.leave_out_holds(&holds).is_err() {
            return Ok(None);
        }
        self.on_other_rows(fitted).map(Some)
    }

    /// The fit without the moments after rests into which a delay, if it is the last term, carries
    /// the torque of the rest: a lag that rounds steps would look better.
    pub(super) fn without_late_rests(
        &mut self,
        fitted: &Fitted,
    ) -> Result<Option<Fitted>, Interrupted> {
        /// Of the delay, which other effects may hide in part.
        const FARTHER: f64 = 2.0;
        let seconds = FARTHER * fitted.terms().last().and_then(delay).unwrap_or_default();
        if seconds <= self.problem.after_rest
            || self.problem.leave_out_after_rests(seconds).is_err()
        {
            return Ok(None);
        }
        self.on_other_rows(fitted).map(Some)
    }

    /// The fit on rows that were chosen anew, with the noise there.
    pub(super) fn on_other_rows(&mut self, fitted: &Fitted) -> Result<Fitted, Interrupted> {
        self.cache.clear();
        let again = solve(&self.problem, &fitted.model, fitted.terms(), &self.noise);
        self.with_noise_anew(&again, &self.all_joints())
    }

    /// The fit on the rows of all joints but the closed ones.
    pub(in super::super) fn on_rows_without(&mut self, closed: &[bool], fitted: &Fitted) -> Fitted {
        self.problem.leave_out_joints(closed).expect("the logs had torque before");
        self.cache.clear();
        self.rows = self.noise.rows(&self.problem);
        solve(&self.problem, &fitted.model, fitted.terms(), &self.noise)
    }
}
