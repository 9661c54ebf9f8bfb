use crate::effects::{Needs, Site};
use sgpr_predict::internal::{Recorder, Tape};

use crate::expression::Expr;
use crate::model::{
    Provenance, Purpose, Sampler, StreamOptions, StreamStart, StreamedModel, TorqueModel,
};
use crate::simd::Number;

/// What a formula starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FormulaInput {
    Q(usize),
    Dq(usize),
    Ddq(usize),
    /// Of a joint, °C.
    Temperature(usize),
    /// Of the session, s.
    Time,
    /// One if there was a sample before, else zero.
    Begun,
    /// One if the hidden states start in a motion, zero if they start at rest.
    Moving,
    /// One if the acceleration of the sample before is known, else zero.
    HasLast,
    /// A number that is carried from call to call.
    Hidden(usize),
}

/// A number that is carried from call to call.
#[derive(Clone, Debug)]
pub(super) struct Hidden {
    /// What it belongs to.
    pub carrier: String,
    /// Its value after the sample.
    pub next: Expr,
}

/// A model as formulas.
#[derive(Debug)]
pub(super) struct FormulaProgram {
    pub tape: Tape,
    /// What each input of the tape is.
    pub inputs: Vec<FormulaInput>,
    /// Torque of each joint.
    pub tau: Vec<Expr>,
    /// Those hidden states that the torque depends on; [`FormulaInput::Hidden`] counts all that
    /// there are.
    pub hidden: Vec<(usize, Hidden)>,
    /// How often each operation is used.
    pub uses: Vec<usize>,
    /// Joint names, and whether each rotates.
    pub joints: Vec<(String, bool)>,
    /// What the torque holds: effect and site.
    pub effects: Vec<String>,
    pub needs_temperature: bool,
    pub purpose: Purpose,
    pub rate_hz: Option<f64>,
    pub robot: String,
    pub provenance: Provenance,
}

/// Inputs of a tape, each once.
#[derive(Default)]
struct TapeInputs(Vec<FormulaInput>);

impl TapeInputs {
    fn of(&mut self, input: FormulaInput) -> Expr {
        self.0.push(input);
        Expr::input(self.0.len() - 1)
    }
}

impl FormulaProgram {
    /// The formulas of a model that can be streamed.
    pub fn record(model: &TorqueModel, options: &StreamOptions) -> Self {
        let recorder = Recorder::start();
        let streamed = StreamedModel::from(model);
        let terms = options.terms(&streamed);
        let rate_hz = options.rate_hz.unwrap_or(f64::NAN);
        let mut sampler = Sampler::<Expr>::new(&streamed, options, &terms, rate_hz);
        sampler.robot = sampler.robot.clone().with_exact_right_angles();
        let mut inputs = TapeInputs::default();
        let carriers = set_inputs(&mut sampler, &mut inputs, model);
        let time =
            if rate_hz.is_nan() { Expr::constant(f64::NAN) } else { inputs.of(FormulaInput::Time) };
        let start = StreamStart::Either {
            done: inputs.of(FormulaInput::Begun),
            moving: inputs.of(FormulaInput::Moving),
        };
        sampler.sample(rate_hz, time, &start);
        let buffers = &sampler.buffers;
        let next = sampler
            .terms
            .hidden()
            .iter()
            .chain(sampler.transforms.hidden())
            .chain(&buffers.last_ddq);
        let all: Vec<Hidden> = carriers
            .into_iter()
            .zip(next)
            .map(|(carrier, next)| Hidden { carrier, next: *next })
            .collect();
        let tau = buffers.tau.clone();
        let tape = recorder.finish();
        let (hidden, uses) = needed(&tape, &inputs.0, &tau, all);
        let needs_temperature = terms.iter().any(|term| {
            let Needs { temperature, .. } = term.effect.needs();
            temperature
        });
        Self {
            tape,
            inputs: inputs.0,
            tau,
            hidden,
            uses,
            joints: model
                .robot()
                .joints()
                .iter()
                .map(|joint| (joint.name.clone(), joint.kind.is_rotation()))
                .collect(),
            effects: effects_of(model, options),
            needs_temperature,
            purpose: options.purpose,
            rate_hz: options.rate_hz,
            robot: model.robot().name().into(),
            provenance: model.provenance().clone(),
        }
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.tau.len()
    }

    /// Whether a formula starts from this.
    pub fn starts_from(&self, input: FormulaInput) -> bool {
        let used = |index: usize| {
            (0..self.tape.len()).any(|k| self.uses[k] > 0 && self.tape.input(k) == Some(index))
        };
        self.inputs.iter().position(|one| *one == input).is_some_and(used)
    }
}

/// Makes everything that the torque of a sample depends on an input; what each hidden state belongs
/// to.
fn set_inputs(
    sampler: &mut Sampler<Expr>,
    inputs: &mut TapeInputs,
    model: &TorqueModel,
) -> Vec<String> {
    let buffers = &mut sampler.buffers;
    let kinds = [FormulaInput::Q as fn(usize) -> FormulaInput, FormulaInput::Dq, FormulaInput::Ddq];
    for (values, kind) in buffers.motion.iter_mut().zip(kinds) {
        values.iter_mut().enumerate().for_each(|(joint, value)| *value = inputs.of(kind(joint)));
    }
    for (joint, value) in buffers.temperature.iter_mut().enumerate() {
        *value = inputs.of(FormulaInput::Temperature(joint));
    }
    buffers.has_last = inputs.of(FormulaInput::HasLast);
    let mut carriers: Vec<String> = Vec::new();
    let terms = sampler.terms.carriers().chain(sampler.transforms.carriers());
    carriers.extend(terms.map(|(effect, site)| format!("{effect}{}", at(site, model))));
    let own = carriers.len();
    carriers.extend(buffers.last_ddq.iter().map(|_| "acceleration of the sample before".into()));
    let leaves: Vec<Expr> =
        (0..carriers.len()).map(|k| inputs.of(FormulaInput::Hidden(k))).collect();
    let (of_terms, rest) = leaves[..own].split_at(sampler.terms.hidden().len());
    sampler.terms.set_hidden(of_terms);
    sampler.transforms.set_hidden(rest);
    buffers.last_ddq.copy_from_slice(&leaves[own..]);
    carriers
}

/// Those hidden states that the torque depends on, in one call or later, and the uses of all
/// operations for them.
fn needed(
    tape: &Tape,
    inputs: &[FormulaInput],
    tau: &[Expr],
    all: Vec<Hidden>,
) -> (Vec<(usize, Hidden)>, Vec<usize>) {
    let mut taken = vec![false; all.len()];
    loop {
        let next =
            all.iter().zip(&taken).filter(|(_, taken)| **taken).map(|(hidden, _)| hidden.next);
        let outputs: Vec<Expr> = tau.iter().copied().chain(next).collect();
        let uses = tape.uses(&outputs);
        let before = taken.clone();
        for (index, _) in uses.iter().enumerate().filter(|(_, uses)| **uses > 0) {
            if let Some(FormulaInput::Hidden(k)) = tape.input(index).map(|input| inputs[input]) {
                taken[k] = true;
            }
        }
        if taken == before {
            let hidden = all
                .into_iter()
                .enumerate()
                .zip(taken)
                .filter(|(_, taken)| *taken)
                .map(|(hidden, _)| hidden);
            return (hidden.collect(), uses);
        }
    }
}

fn at(site: Site, model: &TorqueModel) -> String {
    let name = |joint: usize| &model.robot().joints()[joint].name;
    match site {
        Site::Arm => String::new(),
        Site::Joint(joint) => format!("@{}", name(joint)),
        Site::Pair(joint, other) => format!("@{}+{}", name(joint), name(other)),
    }
}

/// Effects that the torque holds, and where.
fn effects_of(model: &TorqueModel, options: &StreamOptions) -> Vec<String> {
    let held =
        |effect: &&std::sync::Arc<dyn crate::effects::Effect>| options.holds(effect.as_ref());
    let everywhere =
        model.parameter_set().effects().iter().filter(held).map(|effect| effect.name().to_string());
    let terms = model.terms().iter().filter(|term| held(&&term.effect));
    everywhere
        .chain(terms.map(|term| format!("{}{}", term.effect.name(), at(term.site, model))))
        .collect()
}
