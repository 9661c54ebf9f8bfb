#![allow(missing_docs, reason = "hidden: for those who make code of a model")]

use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::ops::Range;

use super::start::StreamStart;
use crate::effects::{Effect, LinkSample, Reach, SampleInput, Site, StepState, Stepped};
use crate::model::Term;

/// An effect at its site, and where its hidden state is.
#[derive(Clone, Debug)]
struct EffectStep {
    effect: Arc<dyn Effect>,
    site: Site,
    constants: Vec<f64>,
    coefficients: Vec<f64>,
    hidden: Range<usize>,
    columns: Range<usize>,
}

impl EffectStep {
    fn at(&self) -> (Site, &[f64]) {
        (self.site, &self.constants)
    }

    fn carriers(&self) -> impl Iterator<Item = (&str, Site)> {
        self.hidden.clone().map(|_| (self.effect.name(), self.site))
    }
}

/// Torques of effects at single sites, sample by sample. Nothing but [`Self::new`] allocates,
/// unless an effect does.
#[derive(Clone, Debug)]
pub struct TermSteps<S = f64> {
    steps: Vec<EffectStep>,
    hidden: Vec<S>,
    /// Of the last sample, one after the other.
    columns: Vec<S>,
}

impl<S: Stepped> TermSteps<S> {
    /// Of those terms that are torques.
    ///
    /// - `rate_hz`: NaN if it is not known
    pub fn new(terms: &[Term], dof: usize, rate_hz: f64) -> Self {
        let (mut steps, mut hidden, mut columns) = (Vec::new(), 0, 0);
        for term in terms.iter().filter(|term| !term.is_transform()) {
            let carried = term.effect.state_len(&term.constants, rate_hz);
            let width = if term.effect.reach() == Reach::All { dof } else { 1 };
            let wide = width * term.coefficients.len();
            steps.push(step(term, hidden..hidden + carried, columns..columns + wide));
            (hidden, columns) = (hidden + carried, columns + wide);
        }
        Self { steps, hidden: vec![S::zero(()); hidden], columns: vec![S::zero(()); columns] }
    }

    /// Whether there is no term.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// As [`Effect::start`].
    pub fn start(
        &mut self,
        start: &StreamStart<S>,
        input: &SampleInput<'_, S>,
        workspace: &mut S::Workspace,
    ) {
        start_each(&self.steps, &mut self.hidden, start, input, workspace);
    }

    /// Adds the torque at the next sample to `tau`, `[n]`.
    pub fn add_torque(
        &mut self,
        input: &SampleInput<'_, S>,
        workspace: &mut S::Workspace,
        tau: &mut [S],
    ) {
        let n = tau.len();
        for step in &self.steps {
            let columns = &mut self.columns[step.columns.clone()];
            let mut state = StepState {
                hidden: &mut self.hidden[step.hidden.clone()],
                workspace: &mut *workspace,
            };
            S::advance(step.effect.as_ref(), step.at(), input, &mut state, columns);
            if step.effect.reach() == Reach::All {
                for (column, factor) in columns.chunks_exact(n).zip(&step.coefficients) {
                    tau.iter_mut().zip(column).for_each(|(tau, value)| *tau += *value * *factor);
                }
            } else {
                let joint = step.site.joint().expect("it reaches its own joint");
                for (value, factor) in columns.iter().zip(&step.coefficients) {
                    tau[joint] += *value * *factor;
                }
            }
        }
    }

    /// Whether an effect may fail.
    pub fn may_fail(&self) -> bool {
        self.steps.iter().any(|step| !step.effect.steps())
    }

    /// The name of an effect that failed, and why.
    pub fn failure(&self) -> Option<(String, String)> {
        self.steps.iter().find_map(|step| Some((step.effect.name().into(), step.effect.failure()?)))
    }

    /// Derivatives of a joint's torque by the coefficients of each term at the last sample: calls
    /// `set` with the index of the term and of its coefficient.
    pub fn for_each_column(&self, joint: usize, dof: usize, mut set: impl FnMut(usize, usize, S)) {
        for (index, step) in self.steps.iter().enumerate() {
            let columns = &self.columns[step.columns.clone()];
            let of_arm = step.effect.reach() == Reach::All;
            if of_arm || step.site.joint() == Some(joint) {
                let (width, at) = if of_arm { (dof, joint) } else { (1, 0) };
                columns
                    .chunks_exact(width)
                    .enumerate()
                    .for_each(|(k, column)| set(index, k, column[at]));
            }
        }
    }

    /// Effect and site of each hidden state.
    pub fn carriers(&self) -> impl Iterator<Item = (&str, Site)> {
        self.steps.iter().flat_map(EffectStep::carriers)
    }

    /// Hidden states.
    pub fn hidden(&self) -> &[S] {
        &self.hidden
    }

    /// Sets the hidden states.
    pub fn set_hidden(&mut self, hidden: &[S]) {
        self.hidden.copy_from_slice(hidden);
    }
}

fn start_each<S: Stepped>(
    steps: &[EffectStep],
    hidden: &mut [S],
    start: &StreamStart<S>,
    input: &SampleInput<'_, S>,
    workspace: &mut S::Workspace,
) {
    for step in steps {
        start.apply(&mut hidden[step.hidden.clone()], |hidden| {
            let mut state = StepState { hidden, workspace: &mut *workspace };
            S::start(step.effect.as_ref(), step.at(), input, &mut state);
        });
    }
}

fn step(term: &Term, hidden: Range<usize>, columns: Range<usize>) -> EffectStep {
    EffectStep {
        effect: Arc::clone(&term.effect),
        site: term.site,
        constants: term.constants.clone(),
        coefficients: term.coefficients.clone(),
        hidden,
        columns,
    }
}

/// What transforms do to the motion of the links and to the torque, sample by sample.
#[derive(Clone, Debug)]
pub struct TransformSteps<S = f64> {
    /// Those that move links.
    movers: Vec<EffectStep>,
    /// All, with the hidden state of each joint.
    transmitters: Vec<EffectStep>,
    hidden: Vec<S>,
}

impl TransformSteps {
    /// What a constant torque of one becomes at each joint, and the largest torque that is shown,
    /// infinite without a limit.
    pub fn static_gains(&self, dof: usize) -> Vec<[f64; 2]> {
        let of_joint = |joint: usize| {
            let (mut gain, mut largest) = (1.0, f64::INFINITY);
            for step in &self.transmitters {
                let mut hidden = vec![0.0; step.hidden.len() / dof];
                step.effect.start_transmitted(gain, &mut hidden);
                gain = step.effect.advance_transmitted(
                    step.site,
                    &step.constants,
                    joint,
                    1.0,
                    &mut hidden,
                    gain,
                );
                largest = step
                    .effect
                    .limit(step.site, &step.constants, joint)
                    .unwrap_or(f64::INFINITY)
                    .min(largest);
            }
            [gain, largest]
        };
        (0..dof).map(of_joint).collect()
    }
}

impl<S: Stepped> TransformSteps<S> {
    pub fn new(terms: &[Term], dof: usize, rate_hz: f64) -> Self {
        let (mut movers, mut transmitters, mut hidden) = (Vec::new(), Vec::new(), 0);
        for term in terms.iter().filter(|term| term.is_transform()) {
            let carried = term.effect.state_len(&term.constants, rate_hz);
            if term.effect.moves_links() {
                movers.push(step(term, hidden..hidden + carried, 0..0));
                hidden += carried;
            }
            transmitters.push(step(term, hidden..hidden + dof * carried, 0..0));
            hidden += dof * carried;
        }
        Self { movers, transmitters, hidden: vec![S::zero(()); hidden] }
    }

    /// Whether the motion of the links is another than the measured one.
    pub fn move_links(&self) -> bool {
        !self.movers.is_empty()
    }

    pub fn start_links(
        &mut self,
        start: &StreamStart<S>,
        input: &SampleInput<'_, S>,
        workspace: &mut S::Workspace,
    ) {
        start_each(&self.movers, &mut self.hidden, start, input, workspace);
    }

    pub fn advance_links(
        &mut self,
        input: &SampleInput<'_, S>,
        workspace: &mut S::Workspace,
        links: &mut LinkSample<'_, S>,
    ) {
        for step in &self.movers {
            let mut state = StepState {
                hidden: &mut self.hidden[step.hidden.clone()],
                workspace: &mut *workspace,
            };
            S::advance_links(step.effect.as_ref(), step.at(), input, &mut state, links);
        }
    }

    /// Sends the torques on the way from the drive to the log; from a long time at these torques,
    /// if they are the first.
    pub fn transmit(&mut self, tau: &mut [S], rate_hz: f64, start: &StreamStart<S>) {
        let n = tau.len();
        for step in &self.transmitters {
            let effect = step.effect.as_ref();
            let hidden = &mut self.hidden[step.hidden.clone()];
            let carried = hidden.len() / n;
            for (joint, tau) in tau.iter_mut().enumerate() {
                let own = &mut hidden[joint * carried..(joint + 1) * carried];
                start.apply(own, |hidden| S::start_transmitted(effect, *tau, hidden));
                *tau = S::advance_transmitted(effect, step.at(), joint, rate_hz, own, *tau);
                if let Some(limit) = effect.limit(step.site, &step.constants, joint) {
                    *tau = tau.clamp(S::constant(-limit), S::constant(limit));
                }
            }
        }
    }

    /// Effect and site of each hidden state.
    pub fn carriers(&self) -> Vec<(&str, Site)> {
        let mut steps: Vec<&EffectStep> = self.movers.iter().chain(&self.transmitters).collect();
        steps.sort_by_key(|step| step.hidden.start);
        steps.into_iter().flat_map(EffectStep::carriers).collect()
    }

    pub fn hidden(&self) -> &[S] {
        &self.hidden
    }

    pub fn set_hidden(&mut self, hidden: &[S]) {
        self.hidden.copy_from_slice(hidden);
    }
}
