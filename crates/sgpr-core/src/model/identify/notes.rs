//! What an identification says of itself.

use super::{IdentifyOptions, Start};
use crate::identification::{
    BaseParameters, Costs, Essential, Estimate, JointFactor, KeptOut, ParameterPrior, residual_norm,
};
use crate::motion::Processing;
use crate::robot::Robot;

pub(super) fn cross_validation_note(chosen: f64, scores: &[(f64, f64)]) -> String {
    let scores: Vec<String> =
        scores.iter().map(|(deviation, error)| format!("{deviation}: {error:.3}")).collect();
    format!(
        "the robot file's values are taken to be right within {chosen} times their size: the \
         weakest pull with which parts of the logs are predicted from the others as well as with \
         any (error by relative deviation: {})",
        scores.join(", ")
    )
}

/// Sentences on what the limits cost, which of them, and whether that costs where the motion is
/// new.
pub(super) fn cost_note(costs: &Costs, kept_out: Option<KeptOut>, joint: &str) -> Option<String> {
    let stages: Vec<String> = costs
        .stages
        .iter()
        .map(|stage| format!("{} ({:.1} %)", stage.limit, stage.residual_percent))
        .collect();
    let kept_out = kept_out.map(|KeptOut { unconstrained_percent, consistent_percent }| {
        format!(
            ". Parts of the logs predicted from the others: error {consistent_percent:.2} % of the \
             torque with the limits, {unconstrained_percent:.2} % without: {}",
            if consistent_percent <= unconstrained_percent {
                "where the motion is new they cost nothing"
            } else {
                "they cost where the motion is new, too"
            }
        )
    });
    let given = match &costs.given[..] {
        [] => String::new(),
        limits => format!(" Check what you set: {}.", limits.join(", ")),
    };
    (!stages.is_empty()).then(|| {
        format!(
            "consistency costs more than noise explains: the weighted residual is {:.1} % larger \
             than without limits, most at {joint}. Limits left out one after the other, and what \
             is left of that: {}.{given} Limits of physics are not wrong: look there for an effect \
             that the model lacks (a cable, a spring, a sensor), which inertias that no body has \
             and negative friction imitate{}",
            costs.residual_percent,
            stages.join("; "),
            kept_out.unwrap_or_default()
        )
    })
}

/// The joint whose residual the limits raise most, with the residual before and after.
pub(super) fn dearest_joint(
    robot: &Robot,
    factors: &[JointFactor],
    estimate: &Estimate,
    consistent: &[f64],
) -> String {
    let moving = factors
        .iter()
        .zip(&estimate.weights)
        .filter(|(factor, _)| !factor.resting && factor.rows > 0);
    let norms = moving.map(|(factor, weight)| {
        let [before, after] =
            [&estimate.values[..], consistent].map(|base| residual_norm(factor, base));
        (factor, before, after, (after.powi(2) - before.powi(2)) / weight.powi(2))
    });
    norms.max_by(|a, b| a.3.total_cmp(&b.3)).map_or_else(
        String::new,
        |(factor, before, after, _)| {
            let joint = &robot.joints()[factor.joint];
            let rows = (factor.rows as f64).sqrt();
            let unit = joint.kind.torque_unit();
            format!("{} ({:.3} to {:.3} {unit})", joint.name, before / rows, after / rows)
        },
    )
}

pub(super) fn essential_note(essential: &Essential, base: &BaseParameters) -> String {
    let Some(last) = essential.dropped.last() else {
        return format!("the data support all {} base parameters", base.rank());
    };
    let names: Vec<&str> =
        essential.dropped.iter().map(|dropped| base.names()[dropped.base].as_str()).collect();
    let change = 100.0 * (essential.validation[names.len()] - 1.0);
    format!(
        "{} of {} base parameters are not supported by the data and are left out: {}; that raises \
         the squared residual by {:.1} of its variance ({:.1} are chance), and the error on data \
         kept out of the fit changes by {change:+.2} %",
        names.len(),
        base.rank(),
        names.join(", "),
        last.rise,
        last.limit
    )
}

pub(super) fn dispersed(dispersion: f64) -> String {
    if dispersion == 1.0 {
        return String::new();
    }
    format!(
        "; standard deviations are {dispersion:.2} times those of the noise, because parts of the \
         logs predict the others so much worse"
    )
}

pub(super) fn describe(
    options: &IdentifyOptions,
    processing: &Processing,
    factors: &[JointFactor],
    (prior, weak): (Option<&ParameterPrior>, Option<f64>),
) -> String {
    let what = match options.start {
        Start::RobotFile => "identified",
        Start::Zero => "identified as the error of an internal model",
    };
    let mut method = options.method.title().to_string();
    if options.consistency.is_some() {
        method += " under physical consistency";
    }
    let band = match processing.torque_cutoff_hz {
        Some(hz) => {
            format!("both sides filtered at {hz:.2} Hz, one row of {} taken", processing.decimation)
        }
        None => "both sides unfiltered".into(),
    };
    let effects =
        if options.effects.is_empty() { "no effects".into() } else { options.effects.join(", ") };
    let rows: usize = factors.iter().map(|factor| factor.rows).sum();
    let hz = processing.cutoff_hz;
    let held = |how: &str, bodies, effects| {
        format!(
            "; {how} by the robot file, right within {} times the size of a link, and by friction \
             within {} times the torque that the file leaves",
            two_digits(bodies),
            two_digits(effects)
        )
    };
    let prior = match (prior, weak) {
        (Some(prior), _) => held(
            "what the logs do not determine is held",
            prior.relative_deviation(),
            prior.effect_scale(),
        ),
        (None, Some(width)) => held("held weakly", width, width),
        (None, None) => String::new(),
    };
    format!(
        "{what} by {method} from {rows} rows with {effects}; position filtered at {hz:.2} Hz, \
         {band}{prior}"
    )
}

/// A share or a multiple to two digits.
fn two_digits(value: f64) -> String {
    let decimals =
        (1.0 - value.abs().max(f64::MIN_POSITIVE).log10().floor()).clamp(0.0, 9.0) as usize;
    let text = format!("{value:.decimals$}");
    if decimals == 0 { text } else { text.trim_end_matches('0').trim_end_matches('.').into() }
}
