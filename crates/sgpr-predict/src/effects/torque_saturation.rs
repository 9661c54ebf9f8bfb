use super::{About, Class, Constant, Effect, Entry, Origin, Scale, Site, facts};

/// A drive or sensor that shows no more than L: tau_log = clip(tau, -L, L).
///
/// Source: K. J. Åström, L. Rundqwist, Integrator windup and how to avoid it, American Control
/// Conference (1989), for saturating drives.
#[derive(Clone, Copy, Debug)]
pub(super) struct TorqueSaturation;

const CONSTANTS: [Constant; 1] =
    [Constant::new("L", ["N·m", "N"], [0.0, f64::INFINITY], Scale::Torque, &[])];

impl Effect for TorqueSaturation {
    facts! {
        name: "torque_saturation",
        summary: "The torque is cut at a limit.",
        parameters: &[],
        constants: &CONSTANTS,
        entry: Entry::Transform,
        is_generic: true,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Transform,
            formula: "tau_log = clip(tau, -L, L)",
            source: "K. J. Åström, L. Rundqwist, Integrator windup and how to avoid it, American \
                 Control Conference (1989), for saturating drives.",
            signature: "flat tops of the torque, a residual of one sign only beyond the limit",
            confusable: &["asymmetric_coulomb_friction"],
            experiment: "look for flat tops; slower motion that stays below the limit",
            excitation: "torque beyond the limit for part of the time",
            origin: Origin::Measurement,
            origin_reason: "what the log or the drive cuts off is needed nevertheless; the drive \
                 knows its own limit",
            ..About::default()
        }
    }

    fn limit(&self, site: Site, constants: &[f64], joint: usize) -> Option<f64> {
        (site.joint() == Some(joint)).then(|| constants[0])
    }
}
