//! Torques that one session has with the other sign: a sensor that was mounted, or a log that was
//! written, the other way.
//!
//! Such a torque is a gain of -1, but a fit that takes it as it is finds common parameters between
//! both signs, near zero, beside which no gain can be told, and a friction that drives the joint in
//! one session. So the fit starts from the signs with which one set of parameters explains all
//! sessions, and the gain is tested there, as any other.

use faer::Mat;

use super::super::RecordError;
use super::super::deviation::predicted;
use super::arm::{Arm, Own, SessionGains};
use super::{FALSE_ALARM, MATTERS, SessionCause, SessionTest};
use crate::identification::JointFactor;
use crate::linalg::triangle;

/// The torque of a joint that some sessions have with another sign than the others.
pub(super) struct OtherSign {
    pub joint: usize,
    /// Sessions with the wrong sign: there friction would drive the joint. None if friction says
    /// nothing.
    pub wrong: Vec<usize>,
    /// Of the gain.
    pub test: SessionTest,
}

impl Arm<'_> {
    /// Torques whose gain is that of other sessions with the other sign, beyond chance and by so
    /// much that it matters.
    pub fn other_signs(&self) -> Result<Vec<OtherSign>, RecordError> {
        let signs = self.signs();
        let turned = |joint: &usize| signs.iter().any(|session| session[*joint] < 0.0);
        let joints: Vec<usize> = (0..self.robot.dof()).filter(turned).collect();
        if joints.is_empty() {
            return Ok(vec![]);
        }
        // What may have changed at the same time, and is easily taken for a sign.
        let offsets = joints.iter().map(|joint| SessionCause::Offset { joint: *joint });
        let own: Own = offsets.chain([SessionCause::Tool]).collect();
        let state = self.fit(&own, signs.clone())?;
        let limit = FALSE_ALARM / self.causes().len() as f64;
        let found = |&joint: &usize| {
            let test = self
                .examine(SessionCause::Gain { joint }, &state)
                .filter(|test| test.is_sure(limit))?;
            let friction =
                self.examine(SessionCause::Friction { joint }, &state).map_or(0.0, |friction| {
                    let known = friction
                        .values
                        .iter()
                        .zip(&friction.deviations)
                        .filter(|(_, deviation)| deviation.is_finite());
                    known
                        .map(
                            |(value, deviation)| {
                                if value.abs() > 2.0 * deviation { value.signum() } else { 0.0 }
                            },
                        )
                        .sum()
                });
            let wrong = (0..signs.len())
                .filter(|session| signs[*session][joint] * friction < 0.0)
                .collect();
            Some(OtherSign { joint, wrong, test })
        };
        Ok(joints.iter().filter_map(found).collect())
    }

    /// Signs of the torques by session and joint, 1 or -1, with which one set of parameters leaves
    /// least of each joint's torque, its offset and the tool those of each session; 1 unless -1 is
    /// better by as much as matters.
    fn signs(&self) -> SessionGains {
        let mut signs = self.no_gains();
        for joint in 0..self.robot.dof() {
            let all: Vec<(usize, &JointFactor)> =
                self.moving().filter(|(_, factor)| factor.joint == joint).collect();
            for last in 1..all.len() {
                let left = |sign: f64| {
                    let sign_of = |session: usize| {
                        if session == all[last].0 { sign } else { signs[session][joint] }
                    };
                    self.left(&all[..=last], sign_of)
                };
                let [as_it_is, negated] = [1.0, -1.0].map(left);
                if negated < (1.0 - MATTERS) * as_it_is {
                    signs[all[last].0][joint] = -1.0;
                }
            }
        }
        signs
    }

    /// Squares that one set of parameters leaves of a joint's torque, times signs.
    fn left(&self, factors: &[(usize, &JointFactor)], sign_of: impl Fn(usize) -> f64) -> f64 {
        let Some(((_, first), later)) = factors.split_first() else { return 0.0 };
        let (width, offsets) = (first.columns.len(), &self.offset[first.joint]);
        let own = offsets.len() + self.tool.len();
        let count = width + later.len() * own;
        let rows: usize = factors.iter().map(|(_, factor)| factor.factor.nrows()).sum();
        let mut all = Mat::<f64>::zeros(rows, count + 1);
        let mut row = 0;
        for (place, (session, factor)) in factors.iter().enumerate() {
            let (height, sign) = (factor.factor.nrows(), sign_of(*session));
            let mut here = all.as_mut().subrows_mut(row, height);
            for column in 0..width {
                here.as_mut().col_mut(column).copy_from(factor.factor.col(column));
            }
            here.as_mut().col_mut(count).copy_from(sign * factor.factor.col(width));
            if let Some(start) = place.checked_sub(1).map(|before| width + before * own) {
                let of_base = offsets.iter().map(|column| {
                    let mut unit = vec![0.0; self.base.rank()];
                    unit[*column] = 1.0;
                    predicted(factor, &unit)
                });
                let of_tool = self.tool.iter().map(|direction| predicted(factor, direction));
                for (k, values) in of_base.chain(of_tool).enumerate() {
                    values.iter().enumerate().for_each(|(i, value)| here[(i, start + k)] = *value);
                }
            }
            row += height;
        }
        triangle(all.as_ref())[(count, count)].powi(2)
    }
}
