//! Joint-space mass matrix by the composite-rigid-body algorithm.

use super::body::along_axis;
use super::scratch::{LoneNumber, OnOneSample, Scratch};
use super::workspace::Workspace;
use crate::robot::Robot;
use crate::simd::Real;
use crate::spatial::{LinkInertia, Matrix3, Vector3};

/// Mass matrix M(q), rigid body only.
///
/// - `q`: `[n]`, rad (m for prismatic joints)
/// - returns `[n, n]`, row-major, symmetric, both triangles, kg·m² (kg·m, kg)
///
/// # Panics
/// If `q` is not of length `robot.dof()`.
///
/// Source: M. W. Walker, D. E. Orin, Efficient dynamic computer simulation of robotic mechanisms,
/// J. Dyn. Sys. Meas. Control 104 (1982), method 3.
pub fn mass_matrix<'ws>(robot: &Robot, ws: &'ws mut Workspace, q: &[f64]) -> &'ws [f64] {
    let mut matrix = core::mem::take(&mut ws.mass_matrix);
    ws.run(robot, q, CompositeRigidBody { matrix: &mut matrix });
    ws.mass_matrix = matrix;
    &ws.mass_matrix
}

struct CompositeRigidBody<'a> {
    matrix: &'a mut [f64],
}

impl OnOneSample for CompositeRigidBody<'_> {
    #[inline(always)]
    fn run<T: LoneNumber>(self, robot: &Robot, scratch: &mut Scratch<T>) {
        let n = robot.dof();
        let Scratch { bodies, composite, .. } = scratch;
        let members = &robot.chain().members;
        for (index, member) in members.iter().enumerate() {
            bodies[index].place((), member);
            composite[index] = LinkInertia::splat((), &member.link);
        }
        let mut carried = composite[n - 1];
        for (index, member) in members.iter().enumerate().rev() {
            // In registers from link to link along a chain; through memory only where branches
            // meet.
            let own = carried;
            if let Some(parent) = member.parent {
                let body = &bodies[index];
                let sum = composite[parent].plus_moved(&own, body.rotation, body.position);
                carried = if parent + 1 == index { sum } else { composite[index - 1] };
                if parent + 1 != index {
                    composite[parent] = sum;
                }
            } else if index > 0 {
                carried = composite[index - 1];
            }
            let carried = own;
            // Wrench of a unit acceleration of this joint, handed down to the base.
            let axis = Vector3::splat((), member.axis);
            let (mut force, mut moment) = if member.about_z {
                let h = carried.first_moment;
                (Vector3::new(-h.y, h.x, T::zero(())), carried.inertia.columns[2])
            } else if member.is_rotation {
                (axis.cross(carried.first_moment), carried.inertia * axis)
            } else {
                (axis * carried.mass, carried.first_moment.cross(axis))
            };
            let mut carrier = index;
            loop {
                let member = &members[carrier];
                let entry = along_axis((), member, force, moment).value();
                self.matrix[index * n + carrier] = entry;
                self.matrix[carrier * n + index] = entry;
                let Some(parent) = member.parent else { break };
                let body = &bodies[carrier];
                force = body.rotation * force;
                moment = body.position.cross_add(force, body.rotation * moment);
                carrier = parent;
            }
        }
    }
}

impl<T: Real> LinkInertia<T> {
    /// With a body added that is given in a frame at `position` with axes `rotation`.
    #[inline(always)]
    fn plus_moved(&self, other: &Self, rotation: Matrix3<T>, position: Vector3<T>) -> Self {
        let h = rotation * other.first_moment;
        let turned = rotation * (other.inertia * rotation.transposed());
        // Inertia about the new origin: -[p]x[h]x - [h]x[p]x - m [p]x[p]x, with [a]x[b]x = b aᵀ -
        // (a·b) 1.
        let p = position;
        let moved = p.scale_add(other.mass, h);
        let diagonal = (moved + h).dot(p);
        let mut inertia = (self.inertia + turned).minus_outer(p, h).minus_outer(moved, p);
        inertia.columns[0].x = inertia.columns[0].x + diagonal;
        inertia.columns[1].y = inertia.columns[1].y + diagonal;
        inertia.columns[2].z = inertia.columns[2].z + diagonal;
        Self { mass: self.mass + other.mass, first_moment: self.first_moment + moved, inertia }
    }
}
