use std::ops::Range;
use std::sync::Arc;

use crate::dynamics::Workspace;
use crate::effects::{Effect, LinkSample, Reach, SampleInput, Site, StepState};
use crate::model::Term;

/// An effect at its site, and where its hidden state is.
#[derive(Clone, Debug)]
struct Step {
    effect: Arc<dyn Effect>,
    site: Site,
    constants: Vec<f64>,
    coefficients: Vec<f64>,
    hidden: Range<usize>,
    columns: Range<usize>,
}

/// Torques of effects at single sites, sample by sample. Nothing but [`Self::new`] allocates, unless an effect does.
#[derive(Clone, Debug)]
pub(crate) struct TermSteps {
    steps: Vec<Step>,
    hidden: Vec<f64>,
    /// Of the last sample, one after the other.
    columns: Vec<f64>,
}

impl TermSteps {
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
        Self { steps, hidden: vec![0.0; hidden], columns: vec![0.0; columns] }
    }

    /// Whether there is no term.
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// As [`Effect::start`].
    pub fn start(&mut self, input: &SampleInput<'_>, workspace: &mut Workspace) {
        for step in &self.steps {
            let mut state = StepState { hidden: &mut self.hidden[step.hidden.clone()], workspace: &mut *workspace };
            step.effect.start(step.site, &step.constants, input, &mut state);
        }
    }

    /// Adds the torque at the next sample to `tau`, `[n]`.
    pub fn add_torque(&mut self, input: &SampleInput<'_>, workspace: &mut Workspace, tau: &mut [f64]) {
        let n = tau.len();
        for step in &self.steps {
            let columns = &mut self.columns[step.columns.clone()];
            let mut state = StepState { hidden: &mut self.hidden[step.hidden.clone()], workspace: &mut *workspace };
            step.effect.advance(step.site, &step.constants, input, &mut state, columns);
            if step.effect.reach() == Reach::All {
                for (column, factor) in columns.chunks_exact(n).zip(&step.coefficients) {
                    tau.iter_mut().zip(column).for_each(|(tau, value)| *tau += factor * value);
                }
            } else {
                let joint = step.site.joint().expect("it reaches its own joint");
                for (value, factor) in columns.iter().zip(&step.coefficients) {
                    tau[joint] += factor * value;
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

    /// Derivatives of a joint's torque by the coefficients of each term at the last sample: calls `set` with the index of
    /// the term and of its coefficient.
    pub fn for_each_column(&self, joint: usize, dof: usize, mut set: impl FnMut(usize, usize, f64)) {
        for (index, step) in self.steps.iter().enumerate() {
            let columns = &self.columns[step.columns.clone()];
            let of_arm = step.effect.reach() == Reach::All;
            if of_arm || step.site.joint() == Some(joint) {
                let (width, at) = if of_arm { (dof, joint) } else { (1, 0) };
                columns.chunks_exact(width).enumerate().for_each(|(k, column)| set(index, k, column[at]));
            }
        }
    }

    /// Hidden states.
    pub fn hidden(&self) -> &[f64] {
        &self.hidden
    }

    /// Sets the hidden states.
    pub fn set_hidden(&mut self, hidden: &[f64]) {
        self.hidden.copy_from_slice(hidden);
    }
}

fn step(term: &Term, hidden: Range<usize>, columns: Range<usize>) -> Step {
    Step {
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
pub(super) struct TransformSteps {
    /// Those that move links.
    movers: Vec<Step>,
    /// All, with the hidden state of each joint.
    transmitters: Vec<Step>,
    hidden: Vec<f64>,
}

impl TransformSteps {
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
        Self { movers, transmitters, hidden: vec![0.0; hidden] }
    }

    /// Whether the motion of the links is another than the measured one.
    pub fn move_links(&self) -> bool {
        !self.movers.is_empty()
    }

    /// What a constant torque of one becomes at each joint, and the largest torque that is shown, infinite without a limit.
    pub fn static_gains(&self, dof: usize) -> Vec<[f64; 2]> {
        let of_joint = |joint: usize| {
            let (mut gain, mut largest) = (1.0, f64::INFINITY);
            for step in &self.transmitters {
                let mut hidden = vec![0.0; step.hidden.len() / dof];
                step.effect.start_transmitted(gain, &mut hidden);
                gain = step.effect.advance_transmitted(step.site, &step.constants, joint, 1.0, &mut hidden, gain);
                largest = step.effect.limit(step.site, &step.constants, joint).unwrap_or(f64::INFINITY).min(largest);
            }
            [gain, largest]
        };
        (0..dof).map(of_joint).collect()
    }

    pub fn start_links(&mut self, input: &SampleInput<'_>, workspace: &mut Workspace) {
        for step in &self.movers {
            let mut state = StepState { hidden: &mut self.hidden[step.hidden.clone()], workspace: &mut *workspace };
            step.effect.start(step.site, &step.constants, input, &mut state);
        }
    }

    pub fn advance_links(&mut self, input: &SampleInput<'_>, workspace: &mut Workspace, links: &mut LinkSample<'_>) {
        for step in &self.movers {
            let mut state = StepState { hidden: &mut self.hidden[step.hidden.clone()], workspace: &mut *workspace };
            step.effect.advance_links(step.site, &step.constants, input, &mut state, links);
        }
    }

    /// Sends the torques on the way from the drive to the log; from a long time at these torques, if they are the first.
    pub fn transmit(&mut self, tau: &mut [f64], rate_hz: f64, first: bool) {
        let n = tau.len();
        for step in &self.transmitters {
            let (effect, constants) = (&step.effect, &step.constants);
            let hidden = &mut self.hidden[step.hidden.clone()];
            let carried = hidden.len() / n;
            for (joint, tau) in tau.iter_mut().enumerate() {
                let own = &mut hidden[joint * carried..(joint + 1) * carried];
                if first {
                    effect.start_transmitted(*tau, own);
                }
                *tau = effect.advance_transmitted(step.site, constants, joint, rate_hz, own, *tau);
                if let Some(limit) = effect.limit(step.site, constants, joint) {
                    *tau = tau.clamp(-limit, limit);
                }
            }
        }
    }

    pub fn hidden(&self) -> &[f64] {
        &self.hidden
    }

    pub fn set_hidden(&mut self, hidden: &[f64]) {
        self.hidden.copy_from_slice(hidden);
    }
}
