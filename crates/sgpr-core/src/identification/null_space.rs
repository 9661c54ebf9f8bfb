//! The parameters that a robot's energy depends on, joint by joint, from its geometry alone.
//!
//! A set of parameters makes no torque if and only if it changes neither the kinetic energy of any
//! motion nor, by more than a constant, the potential energy. Both are linear in the ten parameters
//! of a link, so they are vectors here: a velocity v gives the vector k with k . parameters =
//! kinetic energy, gravity gives one for the potential.
//!
//! At a joint three things must vanish for a link that carries all that is behind it: what
//! multiplies the square of the joint's speed, what multiplies the speed, and how the others change
//! with the joint's position. A link of which all three vanish might as well be welded to the one
//! before it, so its parameters move there, and the recursion goes on. The vectors that motion can
//! reach form subspaces, closed under turning the joint: the smallest such subspaces are built by
//! applying the generator of the joint's motion until nothing new comes. No data, no random
//! numbers.
//!
//! Source: P. M. Wensing, G. Niemeyer, J.-J. E. Slotine, A geometric characterization of
//! observability in inertial parameter identification, IJRR 43(14) (2024): the recursive parameter
//! nullspace algorithm.

use super::{EffectColumn, ParameterSet};
use crate::effects::Role;
use crate::robot::{Joint, Robot};
use crate::spatial::{LinkInertia, Matrix3, PARAMETERS_PER_LINK, Pose, Vector3};

/// Vectors over the ten parameters of a link.
type Energy = [f64; PARAMETERS_PER_LINK];

/// A velocity: linear, then angular.
type Twist = [f64; 6];

/// Of a vector of unit length less than this is rounding: robot files write right angles with seven
/// digits and more.
const TOLERANCE: f64 = 1e-6;

/// Rows whose span is that of all rows of the observation matrix, `[rank, set.len()]`.
///
/// A rotor adds to the square of its joint's speed, a constant offset to what gravity does at its
/// joint; other effects are functions of their own joint's motion and get a row each.
pub(super) fn identifiable_rows(robot: &Robot, set: &ParameterSet) -> Vec<Vec<f64>> {
    let base = LinkReach { potential: potential(robot.gravity()), ..LinkReach::default() };
    let mut reached: Vec<LinkReach> = Vec::new();
    let mut rows = Vec::new();
    for (index, joint) in robot.joints().iter().enumerate() {
        let before = joint.parent.map_or(&base, |parent| &reached[parent]);
        let step = FrameChange::new(joint);
        let own = step.along_joint();
        let turn = |energy: &Energy| step.turned_energy(energy);

        let velocities = before.velocities.iter().map(|twist| step.carried(twist));
        let mut velocities = Span::closed(velocities, |twist| step.turned_velocity(twist));
        let energies =
            Span::closed(before.energies.iter().map(|energy| step.seen_from_link(energy)), turn);
        let potential = step.seen_from_link(&before.potential);
        let gravity = turn(&potential);
        let shifts =
            before.shifts.iter().map(|energy| step.seen_from_link(energy)).chain([gravity]);
        let shifts = Span::closed(shifts, turn);

        // How the energies change with the position, and what multiplies the speed. Of the
        // potential's change the part that depends on the position: a constant part looks like an
        // offset.
        let changing = before
            .shifts
            .iter()
            .map(|energy| turn(&step.seen_from_link(energy)))
            .chain([turn(&gravity)]);
        let changes = energies.iter().map(turn).chain(changing);
        let mut visible = Span::closed(changes, turn);
        let crossed: Vec<Energy> = velocities.iter().map(|twist| kinetic(&own, twist)).collect();
        crossed.iter().for_each(|energy| visible.add(*energy));

        let carried = Carried { robot, set, link: index };
        let square = kinetic(&own, &own);
        let mut with_effect = Vec::new();
        for (energy, effect) in [(gravity, OFFSET), (square, ROTOR)] {
            match carried.parameter(effect) {
                None => visible.add(energy),
                Some(parameter) => {
                    let mut row = carried.row(&energy);
                    row[parameter] = 1.0;
                    with_effect.push(row);
                }
            }
        }
        rows.extend(visible.iter().map(|energy| carried.row(energy)));
        rows.extend(with_effect);

        let mut all = energies;
        crossed.into_iter().chain([square]).for_each(|energy| all.add(energy));
        velocities.add(own);
        reached.push(LinkReach { velocities, energies: all, potential, shifts });
    }
    for (offset, column) in set.effect_columns().iter().enumerate() {
        if ![ROTOR, OFFSET].map(Some).contains(&set.effects()[column.effect].role()) {
            let mut row = vec![0.0; set.len()];
            row[set.inertial() + offset] = 1.0;
            rows.push(row);
        }
    }
    rows
}

const ROTOR: Role = Role::RotorInertia;
const OFFSET: Role = Role::Offset;

/// What the motion of all joints up to a link can reach there.
#[derive(Clone, Debug, Default)]
struct LinkReach {
    velocities: Span<6>,
    /// Vectors of kinetic energy.
    energies: Span<PARAMETERS_PER_LINK>,
    /// Vector of the potential, all joints at zero ...
    potential: Energy,
    /// ... and what motion can add to it.
    shifts: Span<PARAMETERS_PER_LINK>,
}

/// The parameters of a link and of all that it carries, each moved along the chain to it.
struct Carried<'a> {
    robot: &'a Robot,
    set: &'a ParameterSet,
    link: usize,
}

impl Carried<'_> {
    /// A vector over the link's parameters as a row over those of all links.
    fn row(&self, energy: &Energy) -> Vec<f64> {
        let mut row = vec![0.0; self.set.len()];
        let mut of_link: Vec<Option<Energy>> = vec![None; self.robot.dof()];
        of_link[self.link] = Some(*energy);
        for (index, joint) in self.robot.joints().iter().enumerate().skip(self.link) {
            if index > self.link {
                let parent = joint.parent.and_then(|parent| of_link[parent]);
                of_link[index] =
                    parent.map(|energy| FrameChange::new(joint).seen_from_link(&energy));
            }
            if let Some(energy) = of_link[index] {
                row[index * PARAMETERS_PER_LINK..][..PARAMETERS_PER_LINK].copy_from_slice(&energy);
            }
        }
        row
    }

    /// Index of the parameter of a part at the link's joint, if the set has it.
    fn parameter(&self, role: Role) -> Option<usize> {
        let is_it = |column: &EffectColumn| {
            column.joint == self.link && self.set.effects()[column.effect].role() == Some(role)
        };
        self.set.effect_columns().iter().position(is_it).map(|offset| self.set.inertial() + offset)
    }
}

/// From the frame of the link before a joint to that of the link behind it.
struct FrameChange<'a> {
    joint: &'a Joint,
}

impl<'a> FrameChange<'a> {
    fn new(joint: &'a Joint) -> Self {
        Self { joint }
    }

    /// Velocity that unit speed of the joint gives.
    fn along_joint(&self) -> Twist {
        let [x, y, z] = self.joint.axis.to_array();
        if self.joint.kind.is_rotation() {
            [0.0, 0.0, 0.0, x, y, z]
        } else {
            [x, y, z, 0.0, 0.0, 0.0]
        }
    }

    /// A velocity of the link before, in the frame of the link behind, the joint at zero.
    fn carried(&self, twist: &Twist) -> Twist {
        let (linear, angular) = split(twist);
        let Pose { rotation, translation } = self.joint.placement;
        let back = rotation.transposed();
        join(back * (linear + angular.cross(translation)), back * angular)
    }

    /// Derivative of a velocity in the link's frame by the joint's position, beside what the
    /// joint's own speed adds.
    fn turned_velocity(&self, twist: &Twist) -> Twist {
        let (linear, angular) = split(twist);
        let axis = self.joint.axis;
        if self.joint.kind.is_rotation() {
            join(linear.cross(axis), angular.cross(axis))
        } else {
            join(angular.cross(axis), Vector3::ZERO)
        }
    }

    /// A vector over the parameters of the link before, as one over those of the link behind, the
    /// joint at zero.
    fn seen_from_link(&self, energy: &Energy) -> Energy {
        by_parameter(|body| {
            dot(energy, &body.expressed_in(&self.joint.placement).standard_parameters())
        })
    }

    /// Derivative of a vector over the link's parameters by the joint's position.
    fn turned_energy(&self, energy: &Energy) -> Energy {
        let axis = self.joint.axis;
        let hat = Matrix3::skew(axis);
        by_parameter(|body| {
            let (h, inertia) = (body.first_moment, body.inertia);
            let moved = if self.joint.kind.is_rotation() {
                let turned = hat * inertia + (inertia * hat).scaled(-1.0);
                LinkInertia { mass: 0.0, first_moment: axis.cross(h), inertia: turned }
            } else {
                let moment = Matrix3::skew(h);
                let spread = (moment * hat + hat * moment).scaled(-1.0);
                LinkInertia { mass: 0.0, first_moment: axis * body.mass, inertia: spread }
            };
            dot(energy, &moved.standard_parameters())
        })
    }
}

/// The vector k with k . parameters = aᵀ (spatial inertia) b.
fn kinetic(a: &Twist, b: &Twist) -> Energy {
    let ((va, wa), (vb, wb)) = (split(a), split(b));
    by_parameter(|body| {
        let momentum = vb * body.mass + wb.cross(body.first_moment);
        let angular = body.inertia * wb + body.first_moment.cross(vb);
        va.dot(momentum) + wa.dot(angular)
    })
}

/// The vector of the potential energy of a body at the base.
fn potential(gravity: Vector3<f64>) -> Energy {
    by_parameter(|body| -gravity.dot(body.first_moment))
}

fn by_parameter(value: impl Fn(&LinkInertia) -> f64) -> Energy {
    std::array::from_fn(|parameter| {
        let mut one = [0.0; PARAMETERS_PER_LINK];
        one[parameter] = 1.0;
        value(&LinkInertia::from_standard_parameters(&one))
    })
}

fn split(twist: &Twist) -> (Vector3<f64>, Vector3<f64>) {
    let [a, b, c, d, e, f] = *twist;
    (Vector3::new(a, b, c), Vector3::new(d, e, f))
}

fn join(linear: Vector3<f64>, angular: Vector3<f64>) -> Twist {
    let ([a, b, c], [d, e, f]) = (linear.to_array(), angular.to_array());
    [a, b, c, d, e, f]
}

fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A subspace by an orthonormal basis.
#[derive(Clone, Debug)]
struct Span<const N: usize> {
    basis: Vec<[f64; N]>,
}

impl<const N: usize> Default for Span<N> {
    fn default() -> Self {
        Self { basis: Vec::new() }
    }
}

impl<const N: usize> Span<N> {
    /// The smallest subspace with these vectors that `generator` does not lead out of.
    fn closed(
        vectors: impl Iterator<Item = [f64; N]>,
        generator: impl Fn(&[f64; N]) -> [f64; N],
    ) -> Self {
        let mut span = Self::default();
        vectors.for_each(|vector| span.add(vector));
        let mut next = 0;
        while let Some(vector) = span.basis.get(next) {
            let image = generator(vector);
            span.add(image);
            next += 1;
        }
        span
    }

    fn iter(&self) -> impl Iterator<Item = &[f64; N]> {
        self.basis.iter()
    }

    fn add(&mut self, vector: [f64; N]) {
        self.basis.extend(self.without(vector));
    }

    /// Direction of a vector that is not in the subspace, by modified Gram-Schmidt, done twice.
    fn without(&self, vector: [f64; N]) -> Option<[f64; N]> {
        let size = dot(&vector, &vector).sqrt();
        // Generators of unit vectors are of the size of the arm; less is a zero that was rounded.
        if size < TOLERANCE {
            return None;
        }
        let mut rest = vector.map(|value| value / size);
        for _ in 0..2 {
            for basis in &self.basis {
                let along = dot(&rest, basis);
                rest.iter_mut().zip(basis).for_each(|(rest, basis)| *rest -= along * basis);
            }
        }
        let left = dot(&rest, &rest).sqrt();
        (left > TOLERANCE).then(|| rest.map(|value| value / left))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn generators_are_derivatives() {
        let robot = crate::robot::puma560();
        let body = LinkInertia::from_standard_parameters(&[
            2.0, 0.3, -0.2, 0.5, 0.6, 0.01, 0.7, -0.02, 0.03, 0.4,
        ]);
        let energy: Energy = std::array::from_fn(|k| 0.3 + 0.1 * k as f64);
        for (kind, pose) in [
            (
                crate::robot::JointKind::Revolute,
                Pose::from_rotation(Matrix3::rotation(Vector3::new(0.0, 0.0, 1.0), 1e-6)),
            ),
            (
                crate::robot::JointKind::Prismatic,
                Pose::from_translation(Vector3::new(0.0, 0.0, 1e-6)),
            ),
        ] {
            let joint =
                robot.joints()[0].clone().with_kind(kind).with_axis(Vector3::new(0.0, 0.0, 1.0));
            let step = FrameChange::new(&joint);
            let (before, after) =
                (body.standard_parameters(), body.expressed_in(&pose).standard_parameters());
            let difference = (dot(&energy, &after) - dot(&energy, &before)) / 1e-6;
            let derivative = dot(&step.turned_energy(&energy), &before);
            assert!((difference - derivative).abs() < 1e-5, "{kind:?}: {difference} {derivative}");
        }
    }
}
