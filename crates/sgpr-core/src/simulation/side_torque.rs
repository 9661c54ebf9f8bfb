//! Torques beside rigid body, rotors and friction.

use std::fmt::Debug;

use super::{Drive, SimulationError};
use crate::dynamics::{Workspace, rnea};
use crate::effects::{Entry, JointState, Role, SampleInput};
use crate::identification::ParameterSet;
use crate::model::{StreamStart, Term, TermSteps, TorqueModel};

/// A torque that the drives have to overcome beside the rigid body and the friction of the
/// [`Drive`]s: a spring, a ripple, an effect with a memory.
///
/// Treated explicitly: it is asked once per step, in order, and may carry a state of its own from
/// step to step.
pub trait SideTorque: Send + Debug {
    /// Adds the torque in the step from `time` to `time + step` to `tau`, `[n]`, N·m (N), with the
    /// sign of tau = M ddq + ... + side torque.
    ///
    /// - `q`, `dq`: `[n]`, state at `time`
    /// - `ddq`: `[n]`, acceleration in the step before
    fn add(&mut self, time: f64, step: f64, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]);
}

/// Effects of the library that a [`Drive`] does not know, with their parameters.
#[derive(Debug)]
struct Effects {
    set: ParameterSet,
    /// Zero for what the drives do.
    parameters: Vec<f64>,
}

impl SideTorque for Effects {
    fn add(&mut self, _: f64, _: f64, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        self.set.add_effect_torque(&self.parameters, &JointState { q, dq, ddq }, tau);
    }
}

/// Drives and side torque that together are the effects of `set` with these parameters: viscous and
/// Coulomb friction and rotor inertia are treated as those of a [`Drive`], stiffly; every other
/// effect as a side torque.
///
/// # Panics
/// If `parameters` is not of the length of the set.
pub fn drives_from_parameters(
    set: &ParameterSet,
    parameters: &[f64],
) -> (Vec<Drive>, Option<Box<dyn SideTorque>>) {
    assert_eq!(parameters.len(), set.len(), "every parameter of the set");
    let mut drives = vec![Drive::default(); set.dof()];
    let mut rest = parameters.to_vec();
    for (index, column) in set.effect_columns().iter().enumerate() {
        let value = &mut rest[set.inertial() + index];
        let drive = &mut drives[column.joint];
        match set.effects()[column.effect].role() {
            Some(Role::ViscousFriction) => drive.viscous_friction = *value,
            Some(Role::DryFriction) => {
                (drive.coulomb_friction, drive.static_friction) = ([*value; 2], [*value; 2])
            }
            Some(Role::RotorInertia) => drive.rotor_inertia = *value,
            _ => continue,
        }
        *value = 0.0;
    }
    let others = rest[set.inertial()..].iter().any(|value| *value != 0.0);
    let side = others
        .then(|| Box::new(Effects { set: set.clone(), parameters: rest }) as Box<dyn SideTorque>);
    (drives, side)
}

/// Effects of a model at single sites, each carrying its hidden state from step to step.
#[derive(Debug)]
struct SteppedTerms {
    /// Without the terms.
    model: TorqueModel,
    terms: TermSteps,
    started: bool,
    ws: Workspace,
    rigid: Vec<f64>,
    /// With the effects that the model has everywhere.
    torque: Vec<f64>,
    /// Not known.
    temperature: Vec<f64>,
}

impl SteppedTerms {
    fn new(model: &TorqueModel, terms: &[Term]) -> Self {
        let n = model.robot().dof();
        Self {
            model: model.clone().with_terms(vec![], Some(0)),
            terms: TermSteps::new(terms, n, f64::NAN),
            started: false,
            ws: Workspace::new(model.robot()),
            rigid: vec![0.0; n],
            torque: vec![0.0; n],
            temperature: vec![f64::NAN; n],
        }
    }

    /// Adds the torque of the terms to `tau`, `[n]`, and moves their states on.
    fn add_torque(&mut self, time: f64, rate_hz: f64, motion: &JointState<'_>, tau: &mut [f64]) {
        let Self { model, terms, started, ws, rigid, torque, temperature } = self;
        let robot = model.identified_robot();
        let JointState { q, dq, ddq } = *motion;
        rigid.copy_from_slice(rnea(robot, ws, q, dq, ddq));
        torque.copy_from_slice(rigid);
        model.parameter_set().add_effect_torque(model.parameters(), motion, torque);
        let (rigid_torque, temperature_celsius) = (&*rigid, &*temperature);
        let input = SampleInput::new(robot, rate_hz, time, *motion)
            .with_rigid_torque(rigid_torque)
            .with_torque(torque)
            .with_temperature_celsius(temperature_celsius);
        if !*started {
            let rest = &vec![0.0; q.len()];
            terms.start(&StreamStart::AtRest, &input.with_dq(rest).with_ddq(rest), ws);
            *started = true;
        }
        terms.add_torque(&input, ws, tau);
    }

    /// Whether an acceleration of this joint in the step before changes the torque by a large share
    /// of what it takes: the next step would overshoot.
    fn overshoots(&mut self, joint: usize) -> bool {
        let n = self.rigid.len();
        let moving = vec![0.1; n];
        let mut at = |acceleration: f64| {
            let (mut ddq, mut own) = (vec![0.0; n], vec![0.0; n]);
            ddq[joint] = acceleration;
            self.started = false;
            self.add_torque(
                0.0,
                f64::NAN,
                &JointState { q: &moving, dq: &moving, ddq: &ddq },
                &mut own,
            );
            (own[joint], self.torque[joint])
        };
        let ((own, all), (own_at_one, all_at_one)) = (at(0.0), at(1.0));
        (own_at_one - own).abs() > LARGEST_SHARE * (all_at_one - all).abs()
    }
}

/// Of the inertia at a joint: what an explicit torque may have of an inertia itself.
const LARGEST_SHARE: f64 = 0.5;

impl SideTorque for SteppedTerms {
    fn add(&mut self, time: f64, step: f64, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        self.add_torque(time, 1.0 / step, &JointState { q, dq, ddq }, tau);
    }
}

/// What acts on an arm beside its rigid body.
pub type DrivesAndSideTorques = (Vec<Drive>, Vec<Box<dyn SideTorque>>);

/// Drives and side torques that together are all effects of a model, those at single sites
/// included. Stribeck friction is treated as that of a [`Drive`]; hidden states are carried from
/// step to step. The clock of the session starts with the simulation.
///
/// # Errors
/// If an effect changes robot, motion or torque, has a hidden state that follows the torque or the
/// time between samples of a log, needs a temperature or a channel, or follows the acceleration as
/// an inertia does. For those write a [`SideTorque`].
pub fn drives_from_model(model: &TorqueModel) -> Result<DrivesAndSideTorques, SimulationError> {
    let (mut drives, side) = drives_from_parameters(model.parameter_set(), model.parameters());
    let mut side: Vec<_> = side.into_iter().collect();
    let mut terms = Vec::new();
    for term in model.terms() {
        if let Some(reason) = no_side_torque(term) {
            return Err(SimulationError::Effect { name: term.effect.name().into(), reason });
        }
        if let (Some(joint), Some(Role::Stribeck)) = (term.site.joint(), term.effect.role()) {
            let drive = &mut drives[joint];
            if drive.stribeck_velocity == 0.0 && term.coefficients[0] >= 0.0 {
                drive.static_friction =
                    drive.coulomb_friction.map(|size| size + term.coefficients[0]);
                drive.stribeck_velocity = term.constants[0];
                continue;
            }
        }
        let mut alone = SteppedTerms::new(model, std::slice::from_ref(term));
        if (0..drives.len()).any(|joint| alone.overshoots(joint)) {
            let reason =
                "it follows the acceleration as an inertia does; give the arm that inertia instead";
            return Err(SimulationError::Effect { name: term.effect.name().into(), reason });
        }
        terms.push(term.clone());
    }
    if !terms.is_empty() {
        side.push(Box::new(SteppedTerms::new(model, &terms)));
    }
    Ok((drives, side))
}

/// Why an effect cannot act on a simulated arm as a torque of the state, if it cannot.
fn no_side_torque(term: &Term) -> Option<&'static str> {
    let (effect, needs) = (&term.effect, term.effect.needs());
    match effect.entry() {
        Entry::Transform => Some("it changes robot, motion or torque"),
        Entry::Gate => Some("it is found by checks of a log"),
        _ if effect.has_memory() && (effect.follows_torque() || needs.rate) => {
            Some("it has a hidden state that follows the torque or the acceleration")
        }
        _ if needs.temperature => Some("it needs a temperature"),
        _ if !needs.channels.is_empty() => Some("it needs a channel of the logs"),
        Entry::State | Entry::Trajectory => None,
    }
}
