use alloc::string::String;
use alloc::sync::Arc;
use alloc::vec::Vec;

use serde::{Deserialize, Serialize};

use crate::effects::parts::SMALLEST_TORQUE;
use crate::effects::{Constant, Context, Effect, Entry, Reach, Scale, Site};
use crate::robot::Robot;

/// Largest position, rad (m). Beyond it a number of 64 bits has less than seven digits after the
/// point: it no longer resolves what an encoder does.
#[doc(hidden)]
pub const LARGEST_POSITION: f64 = 1e9;

/// Largest torque, N·m (N): no drive has it, and the eighth power, the most that is made of a
/// torque, stays finite.
#[doc(hidden)]
pub const LARGEST_TORQUE: f64 = 1e15;

/// An effect at one site of a robot, with its constants and parameters.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Term {
    /// The effect.
    pub effect: Arc<dyn Effect>,
    /// Where.
    pub site: Site,
    /// Values of its constants.
    pub constants: Vec<f64>,
    /// Values of its linear parameters.
    pub coefficients: Vec<f64>,
    /// Standard deviations of the constants.
    pub constant_deviations: Vec<f64>,
    /// Standard deviations of the linear parameters.
    pub coefficient_deviations: Vec<f64>,
}

impl Term {
    setters! {
        with_effect(effect: Arc<dyn Effect>),
        with_site(site: Site),
        with_constants(constants: Vec<f64>),
        with_coefficients(coefficients: Vec<f64>),
        with_constant_deviations(constant_deviations: Vec<f64>),
        with_coefficient_deviations(coefficient_deviations: Vec<f64>),
    }
}

/// Those of the constants of an effect that are times of the session, s.
#[doc(hidden)]
pub fn times_of<'a>(
    effect: &'a dyn Effect,
    constants: &'a [f64],
) -> impl Iterator<Item = f64> + 'a {
    effect
        .constants()
        .iter()
        .zip(constants)
        .filter(|(c, _)| c.scale == Scale::Time)
        .map(|(_, time)| *time)
}

impl Term {
    /// A term with these constants, all linear parameters zero.
    pub fn new(effect: Arc<dyn Effect>, site: Site, constants: Vec<f64>) -> Self {
        let (k, m) = (effect.parameters().len(), constants.len());
        let [coefficients, coefficient_deviations, constant_deviations] =
            [vec![0.0; k], vec![0.0; k], vec![0.0; m]];
        Self { effect, site, constants, coefficients, constant_deviations, coefficient_deviations }
    }

    /// Whether it is of class X.
    pub fn is_transform(&self) -> bool {
        self.effect.entry() == Entry::Transform
    }

    /// Its constants that are times of the session, s.
    #[doc(hidden)]
    pub fn times(&self) -> impl Iterator<Item = f64> + '_ {
        times_of(self.effect.as_ref(), &self.constants)
    }

    /// Whether it is the same effect at the same site, whatever its values.
    #[doc(hidden)]
    pub fn is_like(&self, other: &Self) -> bool {
        self.effect.name() == other.effect.name() && self.site == other.site
    }

    /// What the names of its parameters begin with: `joint_2.`, or nothing for the whole arm.
    #[doc(hidden)]
    pub fn prefix(&self, robot: &Robot) -> String {
        let joint = |joint: usize| &robot.joints()[joint].name;
        match self.site {
            Site::Arm => String::new(),
            Site::Joint(own) => format!("{}.", joint(own)),
            Site::Pair(own, other) => format!("{}.{}.", joint(own), joint(other)),
        }
    }

    /// Columns along a trajectory, `[samples]` or `[samples, n]` each; zero where an effect of time
    /// has no clock.
    #[doc(hidden)]
    pub fn columns(&self, context: &Context<'_>) -> Vec<Vec<f64>> {
        let length = match self.effect.reach() {
            Reach::Own => context.len(),
            Reach::All => context.q.len(),
        };
        let mut out = vec![vec![0.0; length]; self.effect.parameters().len()];
        let lacks_time = context.time.is_empty() && self.effect.about().depends_on_time;
        if !out.is_empty() && !lacks_time {
            self.effect.trajectory_columns(self.site, context, &self.constants, &mut out);
        }
        out
    }
}

/// What a file keeps of a [`Term`].
#[derive(Clone, Debug, Serialize, Deserialize)]
#[doc(hidden)]
pub struct TermDescription {
    effect: String,
    site: Site,
    constants: Vec<f64>,
    coefficients: Vec<f64>,
    constant_deviations: Vec<f64>,
    coefficient_deviations: Vec<f64>,
}

impl TermDescription {
    pub fn of(term: &Term) -> Self {
        Self {
            effect: term.effect.name().into(),
            site: term.site,
            constants: term.constants.clone(),
            coefficients: term.coefficients.clone(),
            constant_deviations: term.constant_deviations.clone(),
            coefficient_deviations: term.coefficient_deviations.clone(),
        }
    }

    /// The term, its effect one of `effects`.
    pub fn term(self, effects: &[Arc<dyn Effect>], robot: &Robot) -> Result<Term, String> {
        let effect = effects.iter().find(|effect| effect.name() == self.effect).cloned();
        let unknown = || {
            format!(
                "it has the effect `{}`, which is not one of the library: give it along \
                 (`load_with`; in Python call `sgpr.register_effect` first)",
                self.effect
            )
        };
        let effect = effect.ok_or_else(unknown)?;
        if !effect.sites(robot).contains(&self.site) {
            return Err(format!("`{}` cannot be at {:?}", self.effect, self.site));
        }
        let (k, m) = (effect.parameters().len(), effect.constants().len());
        let lengths = [&self.coefficients, &self.coefficient_deviations].map(Vec::len);
        if lengths != [k; 2] || [&self.constants, &self.constant_deviations].map(Vec::len) != [m; 2]
        {
            return Err(format!("`{}` has another number of parameters", self.effect));
        }
        if self.constants.iter().chain(&self.coefficients).any(|value| !value.is_finite()) {
            return Err(format!("a parameter of `{}` is not a number", self.effect));
        }
        for (constant, value) in effect.constants().iter().zip(&self.constants) {
            let [low, high] = usable_range(constant);
            if !(low..=high).contains(value) {
                let symbol = constant.symbol;
                return Err(format!(
                    "the constant `{symbol}` of `{}` is {value:e}, which should be from {low:e} to \
                     {high:e}",
                    self.effect
                ));
            }
        }
        let Self {
            site, constants, coefficients, constant_deviations, coefficient_deviations, ..
        } = self;
        Ok(Term {
            effect,
            site,
            constants,
            coefficients,
            constant_deviations,
            coefficient_deviations,
        })
    }
}

/// What the arithmetic of effects can take of a constant: no fit leaves its bounds, and what a
/// person put in by hand is no more than a thousand times beyond them.
fn usable_range(constant: &Constant) -> [f64; 2] {
    const BEYOND: f64 = 1e3;
    // Seconds between two stamps of 64 bits.
    const LONGEST_TIME: f64 = 2e10;
    let least = |smallest: f64| if constant.low > 0.0 { smallest } else { 0.0 };
    match constant.scale {
        Scale::Position => [-LARGEST_POSITION, LARGEST_POSITION],
        Scale::PositionWidth => [least(1.0 / LARGEST_POSITION), LARGEST_POSITION],
        Scale::Torque => [least(SMALLEST_TORQUE), LARGEST_TORQUE],
        Scale::Time => [-LONGEST_TIME, LONGEST_TIME],
        _ => {
            let low =
                if constant.low > 0.0 { constant.low / BEYOND } else { constant.low * BEYOND };
            let high =
                if constant.high < 0.0 { constant.high / BEYOND } else { constant.high * BEYOND };
            [low, high]
        }
    }
}
