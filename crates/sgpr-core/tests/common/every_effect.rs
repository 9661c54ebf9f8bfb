//! Every effect of the library at values at which it does something, for tests that go through the
//! registry.
#![allow(dead_code, missing_docs)]

use std::sync::Arc;

use sgpr_core::effects::{Effect, Scale, Site};
use sgpr_core::model::{Term, TorqueModel};
use sgpr_core::robot::Robot;

/// A value of each constant at which the effect does something in the motion.
fn some_constants(effect: &dyn Effect) -> Vec<f64> {
    let value = |constant: &sgpr_core::effects::Constant| match constant.scale {
        Scale::Time if constant.symbol == "t1" => 2.603,
        Scale::Time => 1.3,
        Scale::Order => 12.0,
        Scale::Neutral { step } => 40.0 * step,
        Scale::Torque => 8.0,
        Scale::Position | Scale::PositionWidth => 0.3,
        _ => constant.grid[0],
    };
    effect.constants().iter().map(value).collect()
}

/// The effect with constants and coefficients at which it does something.
pub fn term(effect: &Arc<dyn Effect>, site: Site) -> Term {
    let mut term = Term::new(Arc::clone(effect), site, some_constants(effect.as_ref()));
    for (k, coefficient) in term.coefficients.iter_mut().enumerate() {
        *coefficient = 0.7 - 0.11 * k as f64;
    }
    term
}

/// The robot with the effects that every model begins with.
pub fn plain(robot: &Robot) -> TorqueModel {
    let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"];
    let mut parameters = robot.standard_parameters();
    parameters.extend((0..4 * robot.dof()).map(|k| 0.3 + 0.05 * k as f64));
    TorqueModel::with_parameters(robot, &effects, parameters).expect("known effects")
}
