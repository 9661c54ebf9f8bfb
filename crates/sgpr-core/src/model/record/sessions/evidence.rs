//! Whether sessions differ: what they scatter by, and what values of their own save on parts that
//! were left out.

use faer::{Col, Mat};
use statrs::distribution::{ContinuousCDF, FisherSnedecor};

use super::super::deviation::predicted;
use super::arm::{Arm, SessionFit, residual};
use super::{SessionCause, SessionTest};
use crate::effects::Role;
use crate::identification::{JointFactor, Judgement, role_of};
use crate::linalg::symmetric_eigen;

/// What is told of a cause: a combination of its numbers, and what comes to it.
struct Told {
    unit: &'static str,
    share: Col<f64>,
    rest: f64,
}

/// What parts of one session differ by: the variance of a row, and how many degrees of freedom it
/// rests on.
struct Scatter {
    variance: f64,
    freedom: f64,
}

/// Normal equations of a cause.
struct CauseSums {
    parts: Vec<Part>,
    /// Of each session, and its values.
    sessions: Vec<SessionEquations>,
    values: Vec<Col<f64>>,
    inverses: Vec<Inverse>,
    /// Of all sessions, and values that they have in common.
    total: SessionEquations,
    common: Col<f64>,
    rank: usize,
}

/// Gram matrix and products with what is to be explained.
struct SessionEquations {
    gram: Mat<f64>,
    right: Col<f64>,
}

/// Inverse of a Gram matrix in the directions that it determines, and their number.
struct Inverse {
    matrix: Mat<f64>,
    rank: usize,
}

/// Normal equations of a part of a session.
struct Part {
    session: usize,
    gram: Mat<f64>,
    right: Col<f64>,
    squares: f64,
}

impl Arm<'_> {
    /// Whether values of a cause that each session has for itself predict better, and differ by
    /// more than chance; none if the logs cannot tell.
    pub fn examine(&self, cause: SessionCause, state: &SessionFit) -> Option<SessionTest> {
        let sums = CauseSums::new(self.parts(cause, state), self.records.len())?;
        let Scatter { variance, freedom } = sums.scatter()?;
        let errors = sums.left_out();
        let noise = match cause {
            SessionCause::Tool => 1.0,
            SessionCause::Friction { joint }
            | SessionCause::Offset { joint }
            | SessionCause::Gain { joint } => state.noise[joint].powi(2),
        };
        let Told { unit, share, rest } = self.told_of(cause, sums.common.nrows(), state);
        Some(SessionTest {
            cause,
            values: sums.values.iter().map(|values| rest + share.transpose() * values).collect(),
            deviations: sums.deviations(&share, variance),
            unit,
            chance: exceeded(sums.between() / variance, sums.apart() as f64, freedom),
            saved: errors.iter().map(|(before, after)| before - after).sum::<f64>()
                / noise.max(f64::MIN_POSITIVE),
            judgement: Judgement::of(&errors),
            changed: false,
        })
    }

    /// What is told of a cause.
    fn told_of(&self, cause: SessionCause, count: usize, state: &SessionFit) -> Told {
        // The first number tells: the offset, the factor, the mass.
        let first = Col::from_fn(count, |k| f64::from(u8::from(k == 0)));
        let joint = match cause {
            SessionCause::Tool => return Told { unit: "kg", share: first, rest: 0.0 },
            SessionCause::Gain { .. } => return Told { unit: "", share: first, rest: 0.0 },
            SessionCause::Offset { joint } | SessionCause::Friction { joint } => joint,
        };
        let unit = self.robot.joints()[joint].kind.torque_unit();
        if cause == (SessionCause::Offset { joint }) {
            return Told { unit, share: first, rest: 0.0 };
        }
        // Friction is the mean of its torque times the direction of motion, which is the column of
        // dry friction, or the shape that comes next to it.
        let dry =
            |k: &&usize| role_of(self.set, self.base.independent()[**k]) == Some(Role::DryFriction);
        let direction = self.friction[joint].iter().find(dry).or(self.shapes[joint].first());
        let mut means = vec![0.0; self.base.rank()];
        let mut length = 0.0;
        for (_, factor) in self.moving().filter(|(_, factor)| factor.joint == joint) {
            let place = |column: usize| factor.columns.iter().position(|k| *k == column);
            let Some(along) = direction.and_then(|column| place(*column)) else { continue };
            let along = factor.factor.col(along);
            length += along.squared_norm_l2();
            for column in self.friction[joint].iter().chain(&self.shapes[joint]) {
                means[*column] +=
                    place(*column).map_or(0.0, |k| along.transpose() * factor.factor.col(k));
            }
        }
        let mean = |column: &usize| means[*column] / length.max(f64::MIN_POSITIVE);
        let rest = self.shapes[joint].iter().map(|k| mean(k) * state.values[0][*k]).sum();
        let own = &self.friction[joint];
        Told { unit, share: Col::from_fn(count, |k| mean(&own[k])), rest }
    }

    /// The equations of each part of the sessions for the numbers of a cause, everything else as
    /// fitted.
    fn parts(&self, cause: SessionCause, state: &SessionFit) -> Vec<Part> {
        let mut parts = Vec::new();
        for (session, records) in self.records.iter().enumerate() {
            for block in records.iter().flat_map(|record| &record.blocks) {
                let mut part: Option<Part> = None;
                for factor in block.factors.iter().filter(|factor| !factor.resting) {
                    if let Some((columns, target)) = self.rows(cause, session, factor, state) {
                        part.get_or_insert_with(|| Part::empty(session, columns.len()))
                            .add(&columns, &target);
                    }
                }
                parts.extend(part);
            }
        }
        parts
    }

    /// Columns of the numbers of a cause in rows of a joint, and what they have to explain
    /// together; none if the joint has nothing to do with it.
    fn rows(
        &self,
        cause: SessionCause,
        session: usize,
        factor: &JointFactor,
        state: &SessionFit,
    ) -> Option<(Vec<Vec<f64>>, Vec<f64>)> {
        let (joint, values) = (factor.joint, &state.values[session]);
        let gain = state.gains[session][joint];
        let mut target = residual(factor, values, gain);
        let (columns, amounts): (Vec<Vec<f64>>, Vec<f64>) = match cause {
            SessionCause::Tool => {
                let noise = state.noise[joint];
                if noise == 0.0 {
                    return None;
                }
                target.iter_mut().for_each(|value| *value /= noise);
                let column = |direction: &Vec<f64>| {
                    predicted(factor, direction).into_iter().map(|v| v / noise).collect()
                };
                (self.tool.iter().map(column).collect(), state.tool[session].clone())
            }
            SessionCause::Friction { joint: asked } | SessionCause::Offset { joint: asked }
                if asked == joint =>
            {
                let own = if matches!(cause, SessionCause::Offset { .. }) {
                    &self.offset
                } else {
                    &self.friction
                };
                let place = |column: &usize| factor.columns.iter().position(|k| k == column);
                let own: Vec<(usize, usize)> =
                    own[joint].iter().filter_map(|k| Some((*k, place(k)?))).collect();
                let column = |(_, place): &(usize, usize)| {
                    factor.factor.col(*place).iter().copied().collect()
                };
                (own.iter().map(column).collect(), own.iter().map(|(k, _)| values[*k]).collect())
            }
            SessionCause::Gain { joint: asked } if asked == joint => {
                let model = predicted(factor, values);
                // The torque as measured.
                target =
                    model.iter().zip(&target).map(|(model, left)| gain * (model + left)).collect();
                return Some((vec![model], target));
            }
            _ => return None,
        };
        for (column, amount) in columns.iter().zip(amounts) {
            target.iter_mut().zip(column).for_each(|(target, value)| *target += amount * value);
        }
        (!columns.is_empty()).then_some((columns, target))
    }
}

impl CauseSums {
    /// None without parts.
    fn new(parts: Vec<Part>, sessions: usize) -> Option<Self> {
        let count = parts.first()?.right.nrows();
        let zero = || SessionEquations { gram: Mat::zeros(count, count), right: Col::zeros(count) };
        let mut sums: Vec<SessionEquations> = (0..sessions).map(|_| zero()).collect();
        let mut total = zero();
        for part in &parts {
            for sum in [&mut sums[part.session], &mut total] {
                sum.gram += &part.gram;
                sum.right += &part.right;
            }
        }
        let Inverse { matrix, rank } = Inverse::of(&total.gram);
        let common = &matrix * &total.right;
        let inverses = sums.iter().map(|sum| Inverse::of(&sum.gram)).collect();
        let values = sums.iter().map(|sum| own_values(&sum.gram, &sum.right, &common)).collect();
        Some(Self { parts, sessions: sums, values, inverses, total, common, rank })
    }

    /// Scores of parts under the values of their session; none if the sessions cannot be told
    /// apart.
    fn scatter(&self) -> Option<Scatter> {
        let (mut squares, mut weight, mut freedom) = (0.0, 0.0, 0.0);
        let mut number = vec![0usize; self.sessions.len()];
        for part in &self.parts {
            let inverse = &self.inverses[part.session].matrix;
            let score = &part.right - &part.gram * &self.values[part.session];
            squares += (score.transpose() * inverse * &score).max(0.0);
            // What the values take of their own part: its score has the variance of I - share.
            let share = inverse * &part.gram;
            weight -= (&share * &share).diagonal().column_vector().sum();
            number[part.session] += 1;
        }
        for (inverse, number) in self.inverses.iter().zip(&number) {
            weight += inverse.rank as f64;
            freedom += (inverse.rank * number.saturating_sub(1)) as f64;
        }
        let tells = self.apart() > 0 && freedom >= 1.0 && weight > 0.0;
        tells.then(|| Scatter { variance: (squares / weight).max(f64::MIN_POSITIVE), freedom })
    }

    /// Numbers that the sessions have beyond the common ones.
    fn apart(&self) -> usize {
        self.inverses.iter().map(|inverse| inverse.rank).sum::<usize>().saturating_sub(self.rank)
    }

    /// Squares by which the sessions are apart from the common values.
    fn between(&self) -> f64 {
        let of = |(session, values): (&SessionEquations, &Col<f64>)| {
            let off = values - &self.common;
            off.transpose() * &session.gram * &off
        };
        self.sessions.iter().zip(&self.values).map(of).sum()
    }

    /// Squares that common values leave of each part that was left out, and that values of its
    /// session do.
    fn left_out(&self) -> Vec<(f64, f64)> {
        let of = |part: &Part| {
            let common = &Inverse::of(&(&self.total.gram - &part.gram)).matrix
                * (&self.total.right - &part.right);
            let session = &self.sessions[part.session];
            let own =
                own_values(&(&session.gram - &part.gram), &(&session.right - &part.right), &common);
            (part.left_by(&common), part.left_by(&own))
        };
        self.parts.iter().map(of).collect()
    }

    /// Standard deviations of a combination of the numbers of each session; infinite where it does
    /// not determine it.
    fn deviations(&self, share: &Col<f64>, variance: f64) -> Vec<f64> {
        let of = |(session, Inverse { matrix, .. }): (&SessionEquations, &Inverse)| {
            let seen = &session.gram * (matrix * share);
            let determined = (seen - share).norm_max() <= 1e-6 * share.norm_max();
            let own = (share.transpose() * matrix * share).max(0.0);
            if determined { (variance * own).sqrt() } else { f64::INFINITY }
        };
        self.sessions.iter().zip(&self.inverses).map(of).collect()
    }
}

impl Part {
    fn empty(session: usize, count: usize) -> Self {
        Self { session, gram: Mat::zeros(count, count), right: Col::zeros(count), squares: 0.0 }
    }

    fn add(&mut self, columns: &[Vec<f64>], target: &[f64]) {
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        for (i, a) in columns.iter().enumerate() {
            for (j, b) in columns.iter().enumerate() {
                self.gram[(i, j)] += product(a, b);
            }
            self.right[i] += product(a, target);
        }
        self.squares += product(target, target);
    }

    /// Squares that these numbers leave.
    fn left_by(&self, values: &Col<f64>) -> f64 {
        (self.squares - 2.0 * (values.transpose() * &self.right)
            + values.transpose() * &self.gram * values)
            .max(0.0)
    }
}

/// What the rows of a session say; where they say nothing, the common values.
fn own_values(gram: &Mat<f64>, right: &Col<f64>, common: &Col<f64>) -> Col<f64> {
    common + &Inverse::of(gram).matrix * (right - gram * common)
}

impl Inverse {
    /// Columns count scaled to unit length.
    fn of(gram: &Mat<f64>) -> Self {
        const DETERMINED: f64 = 1e-9;
        let count = gram.nrows();
        let scale: Vec<f64> = (0..count)
            .map(|k| if gram[(k, k)] > 0.0 { gram[(k, k)].sqrt().recip() } else { 0.0 })
            .collect();
        let scaled = Mat::from_fn(count, count, |i, j| gram[(i, j)] * scale[i] * scale[j]);
        let (values, vectors) = symmetric_eigen(scaled.as_ref());
        let kept: Vec<usize> = (0..count).filter(|k| values[*k] > DETERMINED).collect();
        let entry = |i: usize, j: usize| {
            kept.iter().map(|k| vectors[(i, *k)] * vectors[(j, *k)] / values[*k]).sum::<f64>()
                * scale[i]
                * scale[j]
        };
        Self { matrix: Mat::from_fn(count, count, entry), rank: kept.len() }
    }
}

/// Probability of a ratio of variances above this one.
fn exceeded(chi_squared: f64, of: f64, freedom: f64) -> f64 {
    let ratio = chi_squared / of;
    FisherSnedecor::new(of, freedom)
        .map_or(1.0, |law| if ratio.is_finite() { law.sf(ratio.max(0.0)) } else { 0.0 })
}
