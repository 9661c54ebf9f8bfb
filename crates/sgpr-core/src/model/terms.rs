use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use sgpr_predict::model::Term;

use super::torque_model::Provenance;
use super::{Rigid, TorqueModel, Trajectory};
use crate::dynamics::{BatchWorkspace, Samples, rnea_batch};
use crate::effects::{Context, JointState, LinkMotion, Reach};
use crate::motion::Motion;
use crate::recording::{Recording, seconds};

/// What depends on the measured motion alone, for models that are asked for the same motion again
/// and again.
pub(crate) trait AlongMotion {
    /// Columns of a term, `[samples]` or `[samples, n]` each.
    fn columns(&self, term: &Term, context: &Context<'_>) -> Arc<Vec<Vec<f64>>> {
        term.columns(context).into()
    }

    /// Torque of the effects that a model has everywhere, `[samples, n]`, N·m (N).
    fn effects(&self, model: &TorqueModel, samples: Samples<'_>) -> Arc<Vec<f64>> {
        model.effects_along(samples).into()
    }
}

/// Nothing is known.
impl AlongMotion for () {}

impl TorqueModel {
    /// Effects at single sites.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// Time stamp at which the clock of the session starts, ns.
    pub fn clock_start(&self) -> Option<i64> {
        self.clock_start
    }

    /// The same model with other terms.
    #[must_use]
    pub fn with_terms(mut self, terms: Vec<Term>, clock_start: Option<i64>) -> Self {
        self.terms = terms;
        self.clock_start = clock_start;
        if let Some(fit) = &mut self.fit {
            fit.covariance_with_terms.clear();
        }
        self
    }

    /// The same model without terms.
    pub(super) fn without_terms(&self) -> Self {
        self.clone().with_terms(vec![], self.clock_start)
    }

    /// Takes all parameters: those of the set, then those of the terms.
    pub(super) fn set_all_parameters(&mut self, parameters: &[f64]) {
        let (own, of_terms) = parameters.split_at(self.set.len());
        self.set_parameters(own.to_vec());
        let coefficients = self.terms.iter_mut().flat_map(|term| &mut term.coefficients);
        coefficients.zip(of_terms).for_each(|(coefficient, value)| *coefficient = *value);
    }

    /// Times of a log on the clock of the model, s.
    pub fn session_time(&self, stamps: &[i64]) -> Vec<f64> {
        let start = self.clock_start.or(stamps.first().copied()).unwrap_or_default();
        seconds_since(start, stamps)
    }

    /// Times of a stretch of a log on the clock of the model, s. A log that was recorded at the
    /// same stamps as one that the model was fitted to, and is another, has a clock of its own: it
    /// is taken as one after the session.
    pub fn time_of(&self, motion: &Motion) -> Vec<f64> {
        let times = self.session_time(&motion.time);
        match self.end_before(&motion.source, &motion.time) {
            Some(end) => {
                let (first, start) =
                    (times.first().copied().unwrap_or_default(), self.session_time(&[end])[0]);
                times.into_iter().map(|time| time - first + start).collect()
            }
            None => times,
        }
    }

    /// Of logs that effects of time take as ones after the session of the model, whatever their
    /// stamps say ([`Self::time_of`]), a sentence for each.
    pub fn clock_notes(&self, logs: &[Recording]) -> Vec<String> {
        // What begins and ends is over by then.
        let lasts =
            |term: &&Term| term.effect.about().depends_on_time && term.times().nth(1).is_none();
        let of_time = self.terms.iter().filter(lasts);
        let names: BTreeSet<&str> = of_time.map(|term| term.effect.name()).collect();
        if names.is_empty() {
            return vec![];
        }
        let names = names.into_iter().collect::<Vec<&str>>().join(", ");
        let after = logs.iter().filter(|log| self.end_before(log.source(), log.time()).is_some());
        let note = |log: &Recording| {
            format!(
                "{}: another log at the time stamps of those that the model was fitted to; effects \
                 that depend on time ({names}) take it as one after them. Logs of one session need \
                 one clock",
                log.source()
            )
        };
        after.map(note).collect()
    }

    /// End of the session, ns, for a stretch of another log than those of the session whose stamps
    /// overlap with theirs.
    fn end_before(&self, source: &str, stamps: &[i64]) -> Option<i64> {
        let Provenance { logs, spans, .. } = &self.provenance;
        let (first, last) = (*stamps.first()?, *stamps.last()?);
        let own = Path::new(source);
        let is_part = |(log, [start, end]): (&String, &[i64; 2])| {
            (own.ends_with(log) || Path::new(log).ends_with(own)) && *start <= first && last <= *end
        };
        let overlaps = spans.iter().any(|[start, end]| first <= *end && *start <= last);
        let another = overlaps && !logs.iter().zip(spans).any(is_part);
        spans.iter().map(|[_, end]| *end).max().filter(|_| another)
    }

    /// Torque of every sample of a trajectory, hidden states, time and transforms included.
    ///
    /// - returns `[samples, n]`, row-major, N·m (N)
    ///
    /// # Panics
    /// If the arrays do not hold whole samples.
    pub fn predict_trajectory(&self, trajectory: &Trajectory<'_>) -> Vec<f64> {
        self.predict_with(trajectory, &())
    }

    /// The same with what is known of the motion.
    pub(crate) fn predict_with(
        &self,
        trajectory: &Trajectory<'_>,
        known: &dyn AlongMotion,
    ) -> Vec<f64> {
        let n = self.robot.dof();
        let rigid = self.rigid_with(trajectory, known);
        // Effects look at the torque without them. Of a long motion only the joints where some act
        // are held twice.
        let of_joint = |joint: usize| rigid.torque.iter().skip(joint).step_by(n).copied().collect();
        let mut with_effects: Vec<Option<Vec<f64>>> = vec![None; n];
        for term in &self.terms {
            let joints = match term.effect.reach() {
                Reach::All => 0..n,
                Reach::Own => {
                    let joint = term.site.joint().expect("it reaches its own joint");
                    joint..joint + 1
                }
            };
            let apart = joints.len();
            let columns = known.columns(term, &self.context(trajectory, &rigid));
            for (k, joint) in joints.enumerate() {
                let tau: &mut Vec<f64> = with_effects[joint].get_or_insert_with(|| of_joint(joint));
                for (column, factor) in columns.iter().zip(&term.coefficients) {
                    tau.iter_mut()
                        .zip(column[k..].iter().step_by(apart))
                        .for_each(|(tau, c)| *tau += factor * c);
                }
            }
        }
        let mut tau = rigid.torque;
        for (joint, with) in
            with_effects.into_iter().enumerate().filter_map(|(joint, with)| Some((joint, with?)))
        {
            tau.iter_mut().skip(joint).step_by(n).zip(with).for_each(|(tau, with)| *tau = with);
        }
        for term in self.terms.iter().filter(|term| term.is_transform()) {
            for joint in 0..n {
                let mut own: Vec<f64> = tau.iter().skip(joint).step_by(n).copied().collect();
                term.effect.transmit(
                    term.site,
                    &term.constants,
                    joint,
                    trajectory.rate_hz,
                    &mut own,
                    1,
                );
                if let Some(limit) = term.effect.limit(term.site, &term.constants, joint) {
                    own.iter_mut().for_each(|tau| *tau = tau.clamp(-limit, limit));
                }
                tau.iter_mut().skip(joint).step_by(n).zip(own).for_each(|(tau, own)| *tau = own);
            }
        }
        tau
    }

    /// The rigid body after all transforms of robot and motion; deflections follow the torque
    /// without them.
    pub(crate) fn rigid(&self, trajectory: &Trajectory<'_>) -> Rigid {
        self.rigid_with(trajectory, &())
    }

    /// The same with what is known of the motion.
    pub(crate) fn rigid_with(&self, trajectory: &Trajectory<'_>, known: &dyn AlongMotion) -> Rigid {
        let Samples { q, dq, ddq } = trajectory.samples;
        let transforms = || self.terms.iter().filter(|term| term.is_transform());
        let robot = transforms()
            .fold(self.dynamics.clone(), |robot, t| t.effect.robot(t.site, &t.constants, robot));
        let mut ws = BatchWorkspace::new(&robot);
        let mut rigid_torque = vec![0.0; q.len()];
        rnea_batch(&robot, &mut ws, trajectory.samples, &mut rigid_torque);
        let motion = transforms().any(|term| term.effect.moves_links()).then(|| {
            let mut links = LinkMotion { q: q.to_vec(), dq: dq.to_vec(), ddq: ddq.to_vec() };
            let context =
                Context::new(&robot, trajectory.rate_hz, trajectory.time, trajectory.samples)
                    .with_rigid_torque(&rigid_torque)
                    .with_torque(&rigid_torque)
                    .with_channels(trajectory.channels);
            transforms()
                .for_each(|t| t.effect.link_motion(t.site, &t.constants, &context, &mut links));
            links
        });
        if let Some(links) = &motion {
            let samples = Samples { q: &links.q, dq: &links.dq, ddq: &links.ddq };
            rnea_batch(&robot, &mut ws, samples, &mut rigid_torque);
        }
        let effects = known.effects(self, trajectory.samples);
        let torque = rigid_torque
            .iter()
            .zip(effects.iter())
            .map(|(rigid, effects)| rigid + effects)
            .collect();
        Rigid { robot, motion, rigid_torque, torque }
    }

    /// Torque of this model's parameters on the robot and along the motion that the transforms of
    /// another make.
    pub(crate) fn torque_under(&self, rigid: &Rigid, trajectory: &Trajectory<'_>) -> Vec<f64> {
        let robot =
            rigid.robot.clone().with_standard_parameters(&self.dynamics.standard_parameters());
        let links = rigid.motion.as_ref();
        let motion =
            links.map_or(trajectory.samples, |m| Samples { q: &m.q, dq: &m.dq, ddq: &m.ddq });
        let mut torque = vec![0.0; motion.q.len()];
        rnea_batch(&robot, &mut BatchWorkspace::new(&robot), motion, &mut torque);
        self.add_effects(trajectory.samples, &mut torque);
        torque
    }

    /// Torque of the effects that the model has everywhere, `[samples, n]`.
    pub(crate) fn effects_along(&self, samples: Samples<'_>) -> Vec<f64> {
        let mut torque = vec![0.0; samples.q.len()];
        self.add_effects(samples, &mut torque);
        torque
    }

    /// Adds the torque of the effects that the model has everywhere.
    fn add_effects(&self, samples: Samples<'_>, torque: &mut [f64]) {
        if self.set.len() == self.set.inertial() {
            return;
        }
        let n = self.robot.dof();
        for (k, tau) in torque.chunks_exact_mut(n).enumerate() {
            let row = k * n..(k + 1) * n;
            let state = JointState {
                q: &samples.q[row.clone()],
                dq: &samples.dq[row.clone()],
                ddq: &samples.ddq[row],
            };
            self.set.add_effect_torque(&self.parameters, &state, tau);
        }
    }

    pub(crate) fn context<'a>(&self, trajectory: &Trajectory<'a>, rigid: &'a Rigid) -> Context<'a> {
        Context::new(&rigid.robot, trajectory.rate_hz, trajectory.time, trajectory.samples)
            .with_rigid_torque(&rigid.rigid_torque)
            .with_torque(&rigid.torque)
            .with_channels(trajectory.channels)
    }
}

/// Longest time that logs of one session span, s: the clock of the session tells warming up and
/// changes of load, which take minutes, and everything that is asked of every moment of it takes
/// memory for every moment.
const LONGEST_SESSION: f64 = 4.0 * 3600.0;

/// A clock that starts within this of zero counts from zero, ns.
const NEAR_ZERO: u64 = 3_600_000_000_000;

/// The earliest stamp, if no two logs overlap in time and all belong to one session. A clock that
/// starts near zero starts at zero.
pub(crate) fn common_clock(motions: &[Arc<Motion>]) -> Option<i64> {
    let mut spans: Vec<(i64, i64)> =
        motions.iter().filter_map(|m| Some((*m.time.first()?, *m.time.last()?))).collect();
    spans.sort_unstable();
    let apart = spans.windows(2).all(|pair| pair[0].1 <= pair[1].0);
    let (first, last) = (spans.first()?.0, spans.last()?.1);
    let together = seconds(first, last) <= LONGEST_SESSION;
    (apart && together).then_some(if first.unsigned_abs() < NEAR_ZERO { 0 } else { first })
}

/// Stamps in seconds since `start`.
pub(crate) fn seconds_since(start: i64, stamps: &[i64]) -> Vec<f64> {
    stamps.iter().map(|stamp| seconds(start, *stamp)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Site, by_name};
    use crate::robot::two_link;

    #[test]
    fn another_log_at_the_stamps_of_the_session_comes_after_it() {
        let mut model = TorqueModel::nominal(&two_link()).with_terms(vec![], Some(0));
        let second = 1_000_000_000;
        model.provenance.logs = vec!["logs/monday.csv".into(), "logs/tuesday.csv".into()];
        model.provenance.spans = vec![[0, 10 * second], [20 * second, 30 * second]];
        let motion = |source: &str, [first, last]: [i64; 2]| Motion {
            source: source.into(),
            rate_hz: 1.0,
            time: vec![first * second, last * second],
            q: vec![],
            dq: vec![],
            ddq: vec![],
            tau: None,
            channels: vec![],
            inner: vec![],
            use_as: vec![],
        };
        for (source, stamps, times) in [
            // A log of the session, a part of one under another path, one between them and one
            // after them.
            ("logs/monday.csv", [0, 10], [0.0, 10.0]),
            ("/data/logs/tuesday.csv", [22, 25], [22.0, 25.0]),
            ("logs/test.csv", [12, 18], [12.0, 18.0]),
            ("logs/test.csv", [40, 50], [40.0, 50.0]),
            // Others whose clocks began anew.
            ("logs/test.csv", [0, 10], [30.0, 40.0]),
            ("logs/monday.csv", [5, 15], [30.0, 40.0]),
        ] {
            let motion = motion(source, stamps);
            assert_eq!(model.time_of(&motion), times, "{source} {stamps:?}");
            let log = Recording::new(
                source,
                vec!["a".into()],
                motion.time,
                vec![0.0; 2],
                None,
                None,
                vec![],
            );
            let log = log.expect("two samples");
            let said = |model: &TorqueModel| model.clock_notes(std::slice::from_ref(&log));
            assert!(said(&model).is_empty(), "nothing depends on time");
            let load = by_name("payload_change").expect("in the library");
            let with_load =
                model.clone().with_terms(vec![Term::new(load, Site::Arm, vec![3.0])], Some(0));
            let said = said(&with_load);
            assert_eq!(said.len(), usize::from(times[0] != stamps[0] as f64), "{said:?}");
            assert!(
                said.iter().all(|note| note.contains(source) && note.contains("payload_change")),
                "{said:?}"
            );
        }
    }

    /// A slow log in which the torque is mostly noise of the accelerations: the elastic joint must
    /// not blow that up.
    #[test]
    fn a_slow_log_with_noise_predicts_as_without() {
        let (robot, rate_hz, n) = (two_link(), 100.0, 2000);
        let mut random = sgpr_numeric::internal::Random::new(7);
        let w = 0.4;
        let [mut q, mut dq, mut ddq, mut noisy] = [const { Vec::new() }; 4];
        for t in (0..n).map(|k| k as f64 / rate_hz) {
            for joint in [0.0, 1.0] {
                let (sine, cosine) = (w * t + joint).sin_cos();
                q.push(0.8 * sine);
                dq.push(0.8 * w * cosine);
                ddq.push(-0.8 * w * w * sine);
                noisy.push(-0.8 * w * w * sine + 0.1 * random.normal());
            }
        }
        let elastic = Term::new(
            by_name("joint_elasticity").expect("an effect of the library"),
            Site::Joint(0),
            vec![0.004],
        );
        let model = TorqueModel::nominal(&robot).with_terms(vec![elastic], None);
        let rigid = TorqueModel::nominal(&robot);
        let change = |ddq: &[f64]| -> Vec<f64> {
            let trajectory = Trajectory {
                samples: Samples { q: &q, dq: &dq, ddq },
                rate_hz,
                time: &[],
                channels: &[],
            };
            let [with, without] =
                [&model, &rigid].map(|model| model.predict_trajectory(&trajectory));
            with.iter().zip(without).map(|(with, without)| with - without).collect()
        };
        let rms = |values: &[f64]| {
            (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
        };
        let (clean, noisy) = (change(&ddq), change(&noisy));
        let apart: Vec<f64> =
            clean.iter().zip(&noisy).map(|(clean, noisy)| clean - noisy).collect();
        assert!(
            rms(&clean) > 0.0 && rms(&apart) < 0.5 * rms(&clean),
            "{} {}",
            rms(&clean),
            rms(&apart)
        );
    }
}
