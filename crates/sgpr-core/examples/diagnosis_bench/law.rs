//! Torques that no effect of the catalogue makes, and effects in a form that the catalogue does not
//! write them in.

/// Position, speed and acceleration of a joint.
pub type State = [f64; 3];

/// A torque on a joint, from its state and that of a neighbour.
#[derive(Clone, Copy)]
pub struct Law {
    pub name: &'static str,
    /// What a diagnosis should call it.
    pub answer: &'static str,
    pub torque: fn(State, State) -> f64,
}

/// Outside of the catalogue.
pub const UNKNOWN: [Law; 6] = [
    unknown("unknown_cross_drag", |[q, ..], [_, dp, _]| dp * (1.3 * q).cos()),
    unknown("unknown_cross_spring", |[q, ..], [p, ..]| q.sin() * (1.7 * p + 0.5).sin()),
    unknown("unknown_even_drag", |[q, dq, _], _| dq * dq * (1.9 * q).cos()),
    unknown("unknown_drag_by_neighbour", |[_, dq, _], [p, ..]| dq * (1.5 * p).cos()),
    unknown("unknown_twisted_spring", |[q, ..], [_, dp, _]| (2.5 * q).sin() * (1.0 + dp)),
    unknown("unknown_cross_inertia", |[_, dq, _], [p, dp, _]| dq * dp.abs() * p.cos()),
];

/// Effects of the catalogue in another form.
pub const FORMS: [Law; 6] = [
    form("exponential_stribeck", "stribeck_friction", |[_, dq, _], _| {
        sign(dq) * (-dq.abs() / 0.08).exp()
    }),
    form("saturating_cable", "cable_stiffness", |[q, ..], _| (1.5 * (q - 0.2)).tanh()),
    form("turbulent_drag", "quadratic_viscous_friction", |[_, dq, _], _| dq * dq.abs().powf(0.8)),
    form("tight_spot", "position_dependent_friction", |[q, dq, _], _| {
        sign(dq) * (-(q - 0.4).powi(2) / 0.3).exp()
    }),
    form("triangular_ripple", "torque_ripple", |[q, ..], _| (20.0 * q).cos().asin()),
    form("asymmetric_drag", "asymmetric_viscous_friction", |[_, dq, _], _| dq.max(0.0).powf(0.9)),
];

const fn unknown(name: &'static str, torque: fn(State, State) -> f64) -> Law {
    Law { name, answer: name, torque }
}

const fn form(name: &'static str, answer: &'static str, torque: fn(State, State) -> f64) -> Law {
    Law { name, answer, torque }
}

fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}
