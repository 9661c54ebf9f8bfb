//! Terms as a report names them.

use super::answer::FoundParameter;
use crate::effects::Site;
use crate::model::Term;
use crate::robot::Robot;

/// Joints that a report names.
pub(super) fn joints_of(term: &Term) -> Vec<usize> {
    match term.site {
        Site::Joint(joint) | Site::Pair(joint, _) if !term.effect.is_of_arm() => vec![joint],
        _ => vec![],
    }
}

/// Constants and linear parameters of a term, with their names.
pub fn parameters_of(term: &Term, robot: &Robot) -> Vec<FoundParameter> {
    let joint = &robot.joints()[term.site.joint().unwrap_or_default()];
    let at = term.prefix(robot);
    let constants =
        term.effect.constants().iter().zip(&term.constants).zip(&term.constant_deviations);
    let constants =
        constants.map(|((c, value), std)| (c.symbol, c.unit_at(joint.kind), value, std));
    let linear =
        term.effect.parameters().iter().zip(&term.coefficients).zip(&term.coefficient_deviations);
    let linear = linear.map(|((p, value), std)| (p.symbol, p.unit_at(joint.kind), value, std));
    let described = |(symbol, unit, value, std): (&str, &str, &f64, &f64)| FoundParameter {
        name: format!("{at}{symbol}"),
        value: *value,
        std: (*std > 0.0).then_some(*std),
        unit: unit.into(),
    };
    constants.chain(linear).map(described).collect()
}
