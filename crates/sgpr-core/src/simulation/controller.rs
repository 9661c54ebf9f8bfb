//! Control laws.

pub use sgpr_predict::control::InverseDynamics;

use crate::dynamics::{Workspace, bias_forces, rnea};
use crate::robot::Robot;

/// What a controller sees at a sample.
#[derive(Clone, Copy, Debug)]
pub struct Measurement<'a> {
    /// s.
    pub time: f64,
    /// Measured positions, `[n]`, rad (m).
    pub q: &'a [f64],
    /// Measured velocities, `[n]`, rad/s (m/s).
    pub dq: &'a [f64],
}

/// What is wanted at a sample.
#[derive(Clone, Copy, Debug)]
pub struct Setpoint<'a> {
    /// Positions, `[n]`, rad (m).
    pub q: &'a [f64],
    /// Velocities, `[n]`, rad/s (m/s).
    pub dq: &'a [f64],
    /// Accelerations, `[n]`, rad/s² (m/s²).
    pub ddq: &'a [f64],
}

/// A control law, called once per control period.
pub trait Controller: Send {
    /// Torque that the drives shall make until the next call, `[n]`, N·m (N); a number that is not
    /// finite ends the simulation.
    fn torque(&mut self, measured: &Measurement<'_>, wanted: &Setpoint<'_>, tau: &mut [f64]);
}

fn add(tau: &mut [f64], more: &[f64]) {
    tau.iter_mut().zip(more).for_each(|(tau, more)| *tau += more);
}

/// The rigid body of a robot, without friction and rotors.
#[derive(Debug)]
pub struct RigidBody {
    robot: Robot,
    ws: Workspace,
}

impl RigidBody {
    /// With the inertias of `robot`.
    pub fn new(robot: &Robot) -> Self {
        Self { ws: Workspace::new(robot), robot: robot.clone() }
    }

    /// C(q, dq) dq + g(q), `[n]`.
    pub fn bias(&mut self, q: &[f64], dq: &[f64]) -> &[f64] {
        bias_forces(&self.robot, &mut self.ws, q, dq)
    }
}

impl InverseDynamics for RigidBody {
    fn add_torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        add(tau, rnea(&self.robot, &mut self.ws, q, dq, ddq));
    }
}

/// Proportional and derivative gains, joint by joint.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    /// Kp, `[n]`, N·m/rad (N/m); 1/s² for [`ComputedTorque`].
    pub kp: Vec<f64>,
    /// Kd, `[n]`, N·m·s/rad (N·s/m); 1/s for [`ComputedTorque`].
    pub kd: Vec<f64>,
}

impl Gains {
    /// The same gains at all of `dof` joints.
    pub fn uniform(dof: usize, kp: f64, kd: f64) -> Self {
        Self { kp: vec![kp; dof], kd: vec![kd; dof] }
    }

    /// Gains given at the motors, seen at the joints: times gear ratio².
    #[must_use]
    pub fn through_gears(mut self, ratios: &[f64]) -> Self {
        for gains in [&mut self.kp, &mut self.kd] {
            gains.iter_mut().zip(ratios).for_each(|(gain, ratio)| *gain *= ratio * ratio);
        }
        self
    }

    /// Adds Kp (q_d - q) + Kd (dq_d - dq).
    #[inline]
    fn add_feedback(&self, measured: &Measurement<'_>, wanted: &Setpoint<'_>, tau: &mut [f64]) {
        for (joint, tau) in tau.iter_mut().enumerate() {
            let (e, de) =
                (wanted.q[joint] - measured.q[joint], wanted.dq[joint] - measured.dq[joint]);
            *tau += self.kp[joint] * e + self.kd[joint] * de;
        }
    }
}

/// u = Kp (q_d - q) + Kd (dq_d - dq).
#[derive(Clone, Debug)]
pub struct Pd(pub Gains);

impl Controller for Pd {
    fn torque(&mut self, measured: &Measurement<'_>, wanted: &Setpoint<'_>, tau: &mut [f64]) {
        tau.fill(0.0);
        self.0.add_feedback(measured, wanted, tau);
    }
}

/// u = model(q_d, dq_d, ddq_d) + Kp (q_d - q) + Kd (dq_d - dq) (thesis eq. 5-1).
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct FeedForward<M> {
    /// Model of the torque of the wanted motion.
    pub model: M,
    /// Gains.
    pub gains: Gains,
}

impl<M> FeedForward<M> {
    /// Both for the same joints.
    pub fn new(model: M, gains: Gains) -> Self {
        Self { model, gains }
    }
}

impl<M: InverseDynamics> Controller for FeedForward<M> {
    fn torque(&mut self, measured: &Measurement<'_>, wanted: &Setpoint<'_>, tau: &mut [f64]) {
        tau.fill(0.0);
        self.model.add_torque(wanted.q, wanted.dq, wanted.ddq, tau);
        self.gains.add_feedback(measured, wanted, tau);
    }
}

/// u = model(q, dq, ddq_d + Kp (q_d - q) + Kd (dq_d - dq)): each joint an oscillator of its own.
///
/// Source: B. Siciliano, L. Sciavicco, L. Villani, G. Oriolo, Robotics: Modelling, Planning and
/// Control (2009), section 8.5.2.
#[derive(Clone, Debug)]
pub struct ComputedTorque<M> {
    model: M,
    gains: Gains,
    ddq: Vec<f64>,
}

impl<M: InverseDynamics> ComputedTorque<M> {
    /// Gains per unit of inertia: 1/s² and 1/s.
    pub fn new(model: M, gains: Gains) -> Self {
        Self { ddq: vec![0.0; gains.kp.len()], model, gains }
    }
}

impl<M: InverseDynamics> Controller for ComputedTorque<M> {
    fn torque(&mut self, measured: &Measurement<'_>, wanted: &Setpoint<'_>, tau: &mut [f64]) {
        self.ddq.copy_from_slice(wanted.ddq);
        self.gains.add_feedback(measured, wanted, &mut self.ddq);
        tau.fill(0.0);
        self.model.add_torque(measured.q, measured.dq, &self.ddq, tau);
    }
}

/// u = model(q, dq_d, ddq_d) + K (q_d - q) + D (dq_d - dq): a spring and a damper at every joint,
/// the arm's own inertia left as it is.
///
/// Gravity and inertia are those of the position where the arm is. Velocities are the wanted ones:
/// at the measured one of a joint that stands, no model knows which way friction will act, and
/// under a soft spring the joint would stay.
///
/// Source: N. Hogan, Impedance control: an approach to manipulation, J. Dyn. Sys. Meas. Control 107
/// (1985); B. Paden, R. Panja, Globally asymptotically stable 'PD+' controller for robot
/// manipulators, Int. J. Control 47 (1988), whose Coriolis forces have one measured and one wanted
/// velocity.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct JointImpedance<M> {
    /// Model of the torque at the measured position.
    pub model: M,
    /// Stiffness K as `kp`, damping D as `kd`.
    pub gains: Gains,
}

impl<M> JointImpedance<M> {
    /// Both for the same joints.
    pub fn new(model: M, gains: Gains) -> Self {
        Self { model, gains }
    }
}

impl<M: InverseDynamics> Controller for JointImpedance<M> {
    fn torque(&mut self, measured: &Measurement<'_>, wanted: &Setpoint<'_>, tau: &mut [f64]) {
        tau.fill(0.0);
        self.model.add_torque(measured.q, wanted.dq, wanted.ddq, tau);
        self.gains.add_feedback(measured, wanted, tau);
    }
}

/// Another controller's torque and a torque prepared beforehand, one row per call: the feed-forward
/// of a model that is too slow for a controller, or of another program.
#[derive(Clone, Debug)]
pub struct Scheduled<C> {
    controller: C,
    torque: Vec<f64>,
    next: usize,
}

impl<C: Controller> Scheduled<C> {
    /// - `torque`: `[calls, n]`, row-major, N·m (N); after its end the last row stays
    pub fn new(controller: C, torque: Vec<f64>) -> Self {
        Self { controller, torque, next: 0 }
    }
}

impl<C: Controller> Controller for Scheduled<C> {
    fn torque(&mut self, measured: &Measurement<'_>, wanted: &Setpoint<'_>, tau: &mut [f64]) {
        self.controller.torque(measured, wanted, tau);
        let n = tau.len();
        if let Some(row) = self.torque.get(self.next * n..(self.next + 1) * n) {
            add(tau, row);
        }
        if (self.next + 2) * n <= self.torque.len() {
            self.next += 1;
        }
    }
}

impl Controller for Box<dyn Controller> {
    fn torque(&mut self, measured: &Measurement<'_>, wanted: &Setpoint<'_>, tau: &mut [f64]) {
        (**self).torque(measured, wanted, tau);
    }
}
