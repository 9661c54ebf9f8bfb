//! An arm under a controller, with dry friction that really sticks: impulses per step, by projected
//! Gauss-Seidel.
//!
//! Source: D. E. Stewart, J. C. Trinkle, An implicit time-stepping scheme for rigid body dynamics
//! with inelastic collisions and Coulomb friction, Int. J. Numer. Meth. Eng. 39 (1996).

use sgpr_core::dynamics::{Samples, Workspace, bias_forces, mass_matrix, rnea};
use sgpr_core::effects::Context;
use sgpr_core::model::Term;
use sgpr_core::robot::Robot;

use crate::arm::Motion;

pub const STEP: f64 = 5e-4;
const SWEEPS: usize = 12;

pub struct Plant<'a> {
    pub robot: &'a Robot,
    pub viscous: &'a [f64],
    pub coulomb: &'a [f64],
    pub rotor: &'a [f64],
    pub terms: &'a [Term],
}

const PAYLOAD: &str = "payload_change";

impl Plant<'_> {
    /// When the arm takes a payload, and the arm with it.
    fn loaded(&self) -> Option<(f64, Robot)> {
        let term = self.terms.iter().find(|term| term.effect.name() == PAYLOAD)?;
        let mut parameters = self.robot.standard_parameters();
        let last = parameters.len() - term.coefficients.len();
        parameters[last..].iter_mut().zip(&term.coefficients).for_each(|(own, more)| *own += more);
        Some((term.constants[0], self.robot.clone().with_standard_parameters(&parameters)))
    }
}

/// Follows `motion` from the session time `start`; every `every` steps a row of position, velocity
/// and motor torque.
pub fn follow(
    plant: &Plant<'_>,
    guess: &Robot,
    motion: &Motion,
    start: f64,
    seconds: f64,
    every: usize,
) -> [Vec<f64>; 3] {
    let n = plant.robot.dof();
    let (mut ws, mut ws_guess) = (Workspace::new(plant.robot), Workspace::new(guess));
    let loaded = plant.loaded();
    let [mut q, mut dq, _] = motion.at(0.0);
    let (mut qs, mut dqs, mut taus) = (vec![], vec![], vec![]);
    let mut impulse = vec![0.0; n];
    for k in 0..(seconds / STEP).round() as usize {
        let time = k as f64 * STEP;
        let [q_wanted, dq_wanted, ddq_wanted] = motion.at(time);
        let robot = match &loaded {
            Some((from, robot)) if start + time >= *from => robot,
            _ => plant.robot,
        };
        let mut mass = mass_matrix(robot, &mut ws, &q).to_vec();
        (0..n).for_each(|j| mass[j * n + j] += plant.rotor[j]);
        let forward = rnea(guess, &mut ws_guess, &q_wanted, &dq_wanted, &ddq_wanted);
        // A stiff loop: 4 Hz, well damped, scaled by the inertia that the joint sees.
        let tau: Vec<f64> = (0..n)
            .map(|j| {
                let (w, m) = (25.0, mass[j * n + j]);
                forward[j] + m * (w * w * (q_wanted[j] - q[j]) + 2.0 * w * (dq_wanted[j] - dq[j]))
            })
            .collect();
        if k % every == 0 {
            qs.extend_from_slice(&q);
            dqs.extend_from_slice(&dq);
            taus.extend_from_slice(&tau);
        }
        let extra = torque_of_terms(plant, &q, &dq, start + time);
        let bias = bias_forces(robot, &mut ws, &q, &dq);
        // Viscous friction implicit, so that light wrists stay stable.
        let force: Vec<f64> =
            (0..n).map(|j| tau[j] - bias[j] - extra[j] - plant.viscous[j] * dq[j]).collect();
        (0..n).for_each(|j| mass[j * n + j] += STEP * plant.viscous[j]);
        let inverse = inverted(&mass, n);
        let times =
            |x: &[f64], row: usize| (0..n).map(|j| inverse[row * n + j] * x[j]).sum::<f64>();
        let free: Vec<f64> = (0..n).map(|j| dq[j] + STEP * times(&force, j)).collect();
        for _ in 0..SWEEPS {
            for j in 0..n {
                let speed = free[j] - times(&impulse, j);
                let limit = STEP * plant.coulomb[j];
                impulse[j] = (impulse[j] + speed / inverse[j * n + j]).clamp(-limit, limit);
            }
        }
        dq = (0..n).map(|j| free[j] - times(&impulse, j)).collect();
        q.iter_mut().zip(&dq).for_each(|(q, dq)| *q += STEP * dq);
    }
    [qs, dqs, taus]
}

fn torque_of_terms(plant: &Plant<'_>, q: &[f64], dq: &[f64], time: f64) -> Vec<f64> {
    let n = q.len();
    let mut torque = vec![0.0; n];
    let still = vec![0.0; n];
    let (time, motion) = ([time], Samples { q, dq, ddq: &still });
    let context = Context::new(plant.robot, 1.0 / STEP, &time, motion)
        .with_rigid_torque(&still)
        .with_torque(&still);
    for term in plant.terms.iter().filter(|term| term.effect.name() != PAYLOAD) {
        let joint = term.site.joint();
        let length = if term.effect.reach() == sgpr_core::effects::Reach::All { n } else { 1 };
        let mut columns = vec![vec![0.0; length]; term.coefficients.len()];
        term.effect.trajectory_columns(term.site, &context, &term.constants, &mut columns);
        for (column, factor) in columns.iter().zip(&term.coefficients) {
            match joint.filter(|_| length == 1) {
                Some(joint) => torque[joint] += factor * column[0],
                None => torque.iter_mut().zip(column).for_each(|(t, c)| *t += factor * c),
            }
        }
    }
    torque
}

/// Inverse of a positive definite matrix, by Gauss and Jordan.
fn inverted(matrix: &[f64], n: usize) -> Vec<f64> {
    let mut a = matrix.to_vec();
    for p in 0..n {
        let pivot = 1.0 / a[p * n + p];
        a[p * n + p] = 1.0;
        (0..n).for_each(|j| a[p * n + j] *= pivot);
        for i in (0..n).filter(|i| *i != p) {
            let factor = std::mem::take(&mut a[i * n + p]);
            (0..n).for_each(|j| a[i * n + j] -= factor * a[p * n + j]);
        }
    }
    a
}
