//! What is known of the parameters beside the data.

use derive_setters::Setters;
use serde::{Deserialize, Serialize};

use super::program::{Affine, ConicProgram};
use crate::identification::{BaseParameters, ParameterClass, ParameterSet};
use crate::robot::{Joint, Robot};
use crate::spatial::PARAMETERS_PER_LINK;

/// Limits that the user sets on parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct PhysicalBounds {
    /// Link by link; links that are not named are not limited.
    pub links: Vec<LinkBounds>,
    /// Lowest and highest mass of all moving links together, kg.
    #[serde(with = "open_interval")]
    pub total_mass: Option<[f64; 2]>,
    /// Single parameters, by their names.
    pub parameters: Vec<ParameterBounds>,
}

/// Limits on the link that a joint carries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct LinkBounds {
    /// Name of the joint that carries it.
    pub joint: String,
    /// Lowest and highest mass, kg.
    #[serde(with = "open_interval")]
    pub mass: Option<[f64; 2]>,
    /// Where the centre of mass lies.
    pub centre: Option<Region>,
}

impl LinkBounds {
    /// A link that may be any body.
    pub fn new(joint: impl Into<String>) -> Self {
        Self { joint: joint.into(), mass: None, centre: None }
    }
}

/// A part of space, in the link frame, m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Region {
    /// A box along the frame's axes.
    Box {
        /// Lowest corner.
        lowest: [f64; 3],
        /// Highest corner.
        highest: [f64; 3],
    },
    /// An ellipsoid along the frame's axes.
    Ellipsoid {
        /// Its centre.
        centre: [f64; 3],
        /// Half its axes.
        half_axes: [f64; 3],
    },
}

/// Limits on one parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ParameterBounds {
    /// Name, as `joint_2.Fv`.
    pub name: String,
    /// Lowest value.
    pub lowest: Option<f64>,
    /// Highest value.
    pub highest: Option<f64>,
}

impl ParameterBounds {
    /// A parameter that may have any value.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), lowest: None, highest: None }
    }
}

/// JSON has no infinity: a side without limit is null.
mod open_interval {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(
        range: &Option<[f64; 2]>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        range.map(|sides| sides.map(|side| side.is_finite().then_some(side))).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<[f64; 2]>, D::Error> {
        let range: Option<[Option<f64>; 2]> = Option::deserialize(deserializer)?;
        Ok(range
            .map(|[low, high]| [low.unwrap_or(f64::NEG_INFINITY), high.unwrap_or(f64::INFINITY)]))
    }
}

/// One limit that can be named, as rows of a program.
#[derive(Clone, Debug)]
pub(super) struct Bound {
    pub name: String,
    /// Whether the user set it; others are physics.
    pub given: bool,
    rows: BoundRows,
}

#[derive(Clone, Debug)]
enum BoundRows {
    NonNegative(Vec<Affine>),
    Ball(Vec<Affine>),
}

impl Bound {
    fn linear(name: String, rows: Vec<Affine>) -> Self {
        Self { name, given: true, rows: BoundRows::NonNegative(rows) }
    }

    pub fn require(&self, program: &mut ConicProgram) {
        match &self.rows {
            BoundRows::NonNegative(rows) => program.require_non_negative(rows.clone()),
            BoundRows::Ball(rows) => program.require_in_ball(rows.clone()),
        }
    }

    /// How far inside a point is, in the unit of the rows, which are scaled to order one.
    pub fn margin(&self, x: &[f64]) -> f64 {
        match &self.rows {
            BoundRows::NonNegative(rows) => {
                rows.iter().map(|row| row.value(x)).fold(f64::INFINITY, f64::min)
            }
            BoundRows::Ball(rows) => {
                let distance: f64 = rows[1..].iter().map(|row| row.value(x).powi(2)).sum();
                rows[0].value(x) - distance.sqrt()
            }
        }
    }
}

/// A limit that cannot be read.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BadBound {
    pub bound: String,
    pub reason: String,
}

/// All limits of the physics of effects and of the user, in scaled variables: parameter = scale *
/// variable.
pub(super) fn collect(
    bounds: &PhysicalBounds,
    robot: &Robot,
    set: &ParameterSet,
    scale: &[f64],
) -> Result<Vec<Bound>, BadBound> {
    let parameter = |index: usize| Affine::variable(index, scale[index]);
    let mut all = Vec::new();
    for index in (set.inertial()..set.len()).filter(|index| set.is_non_negative(*index)) {
        let bound = Bound::linear(
            format!("{} >= 0", set.names()[index]),
            vec![Affine::variable(index, 1.0)],
        );
        all.push(Bound { given: false, ..bound });
    }
    for link in &bounds.links {
        let joint = link.joint.as_str();
        let known = || robot.joint_names().collect::<Vec<_>>().join(", ");
        let position = robot.joint_index(joint).ok_or_else(|| BadBound {
            bound: format!("the limits on the link of `{joint}`"),
            reason: format!("the robot has no such joint; it has {}", known()),
        })?;
        let first = position * PARAMETERS_PER_LINK;
        if let Some(range) = link.mass {
            let text =
                |side: &str, value: f64| format!("mass of the link of `{joint}` {side} {value} kg");
            all.extend(two_sided(&parameter(first), range, scale[first], text)?);
        }
        if let Some(region) = link.centre {
            all.extend(region.bounds(
                joint,
                [0, 1, 2, 3].map(|k| parameter(first + k)),
                scale[first],
            )?);
        }
    }
    if let Some(range) = bounds.total_mass {
        let masses = (0..robot.dof()).map(|link| parameter(link * PARAMETERS_PER_LINK));
        let total = masses.fold(Affine::default(), Affine::and);
        let size = (0..robot.dof()).map(|link| scale[link * PARAMETERS_PER_LINK]).sum();
        all.extend(two_sided(&total, range, size, |side, value| {
            format!("mass of all links together {side} {value} kg")
        })?);
    }
    for bound in &bounds.parameters {
        let index =
            set.names().iter().position(|name| *name == bound.name).ok_or_else(|| BadBound {
                bound: format!("the limits on `{}`", bound.name),
                reason: "there is no such parameter; names are as in `joint_2.Fv`".into(),
            })?;
        let range =
            [bound.lowest.unwrap_or(f64::NEG_INFINITY), bound.highest.unwrap_or(f64::INFINITY)];
        let unit = set.units()[index];
        let text = |side: &str, value: f64| format!("{} {side} {value} {unit}", bound.name);
        all.extend(two_sided(&parameter(index), range, scale[index], text)?);
    }
    Ok(all)
}

/// An arm weighs at most this many times as much as the weight that makes its largest torque on a
/// lever of its whole reach. That is 22 to 24 kg from logs of the Panda, 27 to 40 of the KUKA LWR
/// and 12 to 17 of Baxter's arm.
const CLASS: f64 = 10.0;

/// Standard gravity, m/s².
const GRAVITY: f64 = 9.806_65;

/// No link is heavier than the whole arm: that of the robot file or, if the file has placeholders,
/// that of an arm with such torques. Nothing for masses that motion reveals by themselves, and none
/// that the user limits.
///
/// - `torque`: size of the torque per joint, N·m (N), `[n]`
pub(super) fn masses(
    bounds: &PhysicalBounds,
    robot: &Robot,
    base: &BaseParameters,
    nominal: &[f64],
    torque: &[f64],
    scale: &[f64],
) -> Vec<Bound> {
    if bounds.total_mass.is_some() {
        return Vec::new();
    }
    let whole =
        (0..robot.dof()).map(|link| nominal[link * PARAMETERS_PER_LINK].max(0.0)).sum::<f64>();
    let reach =
        robot.joints().iter().skip(1).map(|joint| joint.placement.translation.norm()).sum::<f64>();
    let lever = |joint: &Joint| if joint.kind.is_rotation() { reach } else { 1.0 };
    let lifted =
        robot.joints().iter().zip(torque).map(|(joint, torque)| torque / (GRAVITY * lever(joint)));
    let most = whole.max(CLASS * lifted.filter(|mass| mass.is_finite()).fold(0.0, f64::max));
    let limited =
        |joint: &str| bounds.links.iter().any(|link| link.joint == joint && link.mass.is_some());
    let links = robot.joints().iter().enumerate().filter(|(link, joint)| {
        base.classes()[link * PARAMETERS_PER_LINK] != ParameterClass::Alone && !limited(&joint.name)
    });
    let bound = |(link, joint): (usize, &Joint)| {
        let first = link * PARAMETERS_PER_LINK;
        let row = Affine::variable(first, scale[first]).scaled(-1.0).plus(most).scaled(1.0 / most);
        let name = format!(
            "mass of the link of `{}` at most {most:.3} kg, that of the whole arm",
            joint.name
        );
        Bound { given: false, ..Bound::linear(name, vec![row]) }
    };
    if most > 0.0 { links.map(bound).collect() } else { Vec::new() }
}

/// lowest <= value <= highest as two bounds, so that an explanation can name one of them.
fn two_sided(
    value: &Affine,
    [lowest, highest]: [f64; 2],
    size: f64,
    text: impl Fn(&str, f64) -> String,
) -> Result<Vec<Bound>, BadBound> {
    if lowest.is_nan() || highest.is_nan() {
        return Err(BadBound {
            bound: text("within", f64::NAN),
            reason: "a limit is not a number".into(),
        });
    }
    let mut bounds = Vec::new();
    let size = size.max(f64::MIN_POSITIVE);
    if lowest.is_finite() {
        let row = value.clone().plus(-lowest).scaled(1.0 / size);
        bounds.push(Bound::linear(text("at least", lowest), vec![row]));
    }
    if highest.is_finite() {
        let row = value.clone().scaled(-1.0).plus(highest).scaled(1.0 / size);
        bounds.push(Bound::linear(text("at most", highest), vec![row]));
    }
    Ok(bounds)
}

impl Region {
    /// `link`: mass and first moment. A centre of mass c in a region is a linear or a second-order
    /// condition on m and m c.
    fn bounds(&self, joint: &str, link: [Affine; 4], size: f64) -> Result<Vec<Bound>, BadBound> {
        let [mass, moment @ ..] = link;
        let name = format!("centre of mass of the link of `{joint}`");
        let bad = |reason: &str| BadBound { bound: name.clone(), reason: reason.into() };
        let mut bounds = Vec::new();
        match *self {
            Self::Box { lowest, highest } => {
                for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
                    let (low, high) = (lowest[axis], highest[axis]);
                    if !low.is_finite() || !high.is_finite() {
                        return Err(bad("a corner of its box is not finite"));
                    }
                    let from = |corner: f64, sign: f64| {
                        let row = moment[axis].clone().and(mass.clone().scaled(-corner));
                        row.scaled(sign / (size * (high - low).abs().max(1e-3)))
                    };
                    bounds.push(Bound::linear(
                        format!("{name}: {letter} at least {low} m"),
                        vec![from(low, 1.0)],
                    ));
                    bounds.push(Bound::linear(
                        format!("{name}: {letter} at most {high} m"),
                        vec![from(high, -1.0)],
                    ));
                }
            }
            Self::Ellipsoid { centre, half_axes } => {
                if !half_axes.iter().all(|axis| *axis > 0.0 && axis.is_finite())
                    || centre.iter().any(|c| !c.is_finite())
                {
                    return Err(bad(
                        "its ellipsoid needs a finite centre and half axes above zero",
                    ));
                }
                let mut rows = vec![mass.clone().scaled(1.0 / size)];
                for axis in 0..3 {
                    let row = moment[axis].clone().and(mass.clone().scaled(-centre[axis]));
                    rows.push(row.scaled(1.0 / (size * half_axes[axis])));
                }
                let [x, y, z] = centre;
                let name = format!("{name} in the ellipsoid around ({x}, {y}, {z}) m");
                bounds.push(Bound { name, given: true, rows: BoundRows::Ball(rows) });
            }
        }
        Ok(bounds)
    }
}
