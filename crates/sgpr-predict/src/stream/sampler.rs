#![allow(missing_docs, reason = "hidden: for those who make code of a model")]

use alloc::vec::Vec;

use super::start::StreamStart;
use super::steps::TransformSteps;
use super::{StreamOptions, TermSteps};
use crate::effects::{JointState, LinkSample, SampleInput, Stepped};
use crate::model::{ParameterSet, StreamedModel, Term};
use crate::robot::Robot;

/// The torque of one sample from its motion and the hidden states: the formula that predictors run,
/// and that code is made from.
#[derive(Debug)]
pub struct Sampler<S: Stepped = f64> {
    /// With the inertias of the model, as its transforms make it.
    pub robot: Robot,
    set: ParameterSet,
    parameters: Vec<f64>,
    pub terms: TermSteps<S>,
    pub transforms: TransformSteps<S>,
    /// How far ahead the motion is taken, s.
    lead: f64,
    ws: S::Workspace,
    pub buffers: Buffers<S>,
}

/// Arrays of `[n]` each.
#[derive(Debug)]
pub struct Buffers<S> {
    /// Motion that the model is asked for: q, dq, ddq.
    pub motion: [Vec<S>; 3],
    /// Motion of the links.
    pub links: [Vec<S>; 3],
    /// Acceleration of the sample before.
    pub last_ddq: Vec<S>,
    /// Above zero if there is a sample before.
    pub has_last: S,
    /// Velocities with which the hidden states start, and accelerations of zero.
    starting: [Vec<S>; 2],
    rigid: Vec<S>,
    /// With the effects that the model has everywhere.
    torque: Vec<S>,
    pub tau: Vec<S>,
    /// Of each joint, °C; NaN if it is not known.
    pub temperature: Vec<S>,
}

impl<S: Stepped> Buffers<S> {
    fn new(n: usize) -> Self {
        let zeros = || vec![S::zero(()); n];
        let three = || [zeros(), zeros(), zeros()];
        Self {
            motion: three(),
            links: three(),
            last_ddq: zeros(),
            has_last: S::zero(()),
            starting: [zeros(), zeros()],
            rigid: zeros(),
            torque: zeros(),
            tau: zeros(),
            temperature: vec![S::constant(f64::NAN); n],
        }
    }

    /// The motion `lead` seconds ahead, by the series of the position up to the jerk, from the
    /// accelerations of this sample and the one before.
    fn look_ahead(&mut self, lead: f64, rate_hz: f64) {
        let [q, dq, ddq] = &mut self.motion;
        for (joint, last) in self.last_ddq.iter_mut().enumerate() {
            let (speed, acceleration) = (dq[joint], ddq[joint]);
            let jerk = self.has_last.where_positive((acceleration - *last) * rate_hz, S::zero(()));
            *last = acceleration;
            ddq[joint] += jerk * lead;
            dq[joint] += (acceleration + jerk * (0.5 * lead)) * lead;
            q[joint] += (speed + (acceleration / 2.0 + jerk * (lead / 6.0)) * lead) * lead;
        }
        self.has_last = S::constant(1.0);
    }
}

impl<S: Stepped> Sampler<S> {
    /// - `terms`: those that the torque holds
    /// - `rate_hz`: NaN if it is not known
    pub fn new(
        model: &StreamedModel,
        options: &StreamOptions,
        terms: &[Term],
        rate_hz: f64,
    ) -> Self {
        let n = model.robot().dof();
        let transforms = terms.iter().filter(|term| term.is_transform());
        let robot = transforms
            .clone()
            .fold(model.robot().clone(), |robot, t| t.effect.robot(t.site, &t.constants, robot));
        Self {
            ws: S::workspace(&robot),
            set: model.parameter_set().clone(),
            parameters: options.parameters(model),
            terms: TermSteps::new(terms, n, rate_hz),
            transforms: TransformSteps::new(terms, n, rate_hz),
            lead: transforms.map(|term| term.effect.lead(&term.constants)).sum(),
            buffers: Buffers::new(n),
            robot,
        }
    }

    /// The next sample is the first.
    pub fn forget(&mut self) {
        self.buffers.has_last = S::zero(());
    }

    /// Torque of the motion in the buffers.
    ///
    /// - `time`: of the session, s
    pub fn sample(&mut self, rate_hz: f64, time: S::Time, start: &StreamStart<S>) {
        if self.lead > 0.0 {
            self.buffers.look_ahead(self.lead, rate_hz);
        }
        let Self { robot, set, parameters, terms, transforms, ws, buffers, .. } = self;
        let Buffers {
            motion: [q, dq, ddq], links, rigid, torque, tau, temperature, starting, ..
        } = buffers;
        let time = time + self.lead;
        let [start_dq, zeros] = starting;
        for (start_dq, dq) in start_dq.iter_mut().zip(&*dq) {
            *start_dq = match start {
                StreamStart::Moving => *dq,
                StreamStart::Either { moving, .. } => *moving * *dq,
                StreamStart::AtRest | StreamStart::Done => S::zero(()),
            };
        }
        S::rnea(robot, ws, [q, dq, ddq], rigid);
        let (rigid_torque, temperature_celsius) = (&**zeros, &**temperature);
        let motion = SampleInput {
            robot,
            rate_hz,
            time,
            q,
            dq,
            ddq,
            rigid_torque,
            torque: zeros,
            temperature_celsius,
        };
        if transforms.move_links() {
            let [links_q, links_dq, links_ddq] = links;
            links_q.copy_from_slice(q);
            links_dq.copy_from_slice(dq);
            links_ddq.copy_from_slice(ddq);
            let measured = SampleInput { rigid_torque: rigid, torque: rigid, ..motion };
            if !start.is_done() {
                transforms.start_links(
                    start,
                    &SampleInput { dq: start_dq, ddq: zeros, ..measured },
                    ws,
                );
            }
            let mut moved = LinkSample { q: links_q, dq: links_dq, ddq: links_ddq };
            transforms.advance_links(&measured, ws, &mut moved);
            S::rnea(robot, ws, links.each_ref().map(Vec::as_slice), rigid);
        }
        torque.copy_from_slice(rigid);
        set.add_effect_torque(parameters, &JointState { q, dq, ddq }, torque);
        tau.copy_from_slice(torque);
        if !terms.is_empty() {
            let input = SampleInput { rigid_torque: rigid, torque, ..motion };
            if !start.is_done() {
                terms.start(start, &SampleInput { dq: start_dq, ddq: zeros, ..input }, ws);
            }
            terms.add_torque(&input, ws, tau);
        }
        transforms.transmit(tau, rate_hz, start);
    }
}
