//! The arm under its controller: the motion that a set of parameters makes of a reference.

use derive_setters::Setters;

use sgpr_predict::internal::BARELY_MOVING;

use super::ParameterSet;
use crate::dynamics::{Samples, Workspace, forward_dynamics_with_rotors};
use crate::effects::JointState;
use crate::robot::Robot;

/// The controller of a trajectory, continuous in time: tau = feed-forward + kp (reference - q) + kd
/// (its speed - dq).
#[derive(Clone, Copy, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ClosedLoop<'a> {
    /// Reference at the samples of the trajectory; its accelerations are not used. Between samples
    /// it is a cubic.
    pub reference: Samples<'a>,
    /// Torque of an internal model at the samples, `[samples, n]`, N·m (N); between samples it is a
    /// line.
    pub feed_forward: Option<&'a [f64]>,
    /// Gain on the position at the joint, `[n]`, N·m/rad (N/m).
    pub kp: &'a [f64],
    /// Gain on the velocity at the joint, `[n]`, N·m·s/rad (N·s/m).
    pub kd: &'a [f64],
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Integration steps per sample.
    pub steps: usize,
}

impl<'a> ClosedLoop<'a> {
    /// A loop without feed-forward, one integration step per sample.
    ///
    /// - `kp`, `kd`: `[n]`, N·m/rad (N/m) and N·m·s/rad (N·s/m)
    pub fn new(reference: Samples<'a>, kp: &'a [f64], kd: &'a [f64], rate_hz: f64) -> Self {
        Self { reference, feed_forward: None, kp, kd, rate_hz, steps: 1 }
    }
}

/// A simulated motion, `[samples, n]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SimulatedMotion {
    /// Positions, rad (m).
    pub q: Vec<f64>,
    /// Velocities, rad/s (m/s); of a joint that sticks, its friction: see
    /// [`ParameterSet::with_sticking_joints`].
    pub dq: Vec<f64>,
    /// Accelerations, rad/s² (m/s²).
    pub ddq: Vec<f64>,
    /// Torques of the controller, N·m (N).
    pub tau: Vec<f64>,
}

impl SimulatedMotion {
    /// The motion as the dynamics takes it.
    pub fn samples(&self) -> Samples<'_> {
        Samples { q: &self.q, dq: &self.dq, ddq: &self.ddq }
    }
}

/// Poses of the reference at which inertias are looked at.
const POSES: usize = 50;

/// Spring of a joint that sticks, as a share of the stiffest of one that the integration follows:
/// with the damper it swings no more than critically damped.
const SPRING: f64 = 0.25;

impl ClosedLoop<'_> {
    /// The motion of `robot` with `parameters` from a given state on, by the classical Runge-Kutta
    /// method of order four; `None` if it leaves all bounds.
    ///
    /// Effects enter as the set says. Where they jump at rest a joint chatters about zero speed,
    /// unless they stick in the set ([`ParameterSet::with_sticking_joints`]): then a spring and a
    /// damper hold the joint, as stiff as the integration can follow, up to the whole of its
    /// friction, from where on it slides. So it keeps its place but for some 1e-5 rad, whereas
    /// friction that is a steep line over the speed alone lets it creep.
    ///
    /// - `parameters`: all of the set
    /// - `q`, `dq`: `[n]`, the state at the first sample
    ///
    /// # Panics
    /// If the lengths do not fit.
    ///
    /// Source: P. Dupont, V. Hayward, B. Armstrong, F. Altpeter, Single state elastoplastic
    /// friction models, IEEE T-AC 47(5) (2002), for the spring that slides.
    pub fn simulate(
        &self,
        robot: &Robot,
        set: &ParameterSet,
        parameters: &[f64],
        q: &[f64],
        dq: &[f64],
    ) -> Option<SimulatedMotion> {
        let n = robot.dof();
        let count = self.reference.count(n);
        assert_eq!(
            (parameters.len(), q.len(), dq.len()),
            (set.len(), n, n),
            "parameters and state of this robot"
        );
        assert_eq!((self.kp.len(), self.kd.len()), (n, n), "gains of every joint");
        let mut arm = ControlledArm::new(robot, set, parameters);
        if set.sticks() {
            arm.widths = self.widths_at_rest(robot, set, parameters);
        }
        let step = self.step();
        let mut state = [q, dq, &vec![0.0; n]].concat();
        let mut motion = SimulatedMotion::default();
        let (mut slope, mut trial) = (vec![vec![0.0; 3 * n]; 4], vec![0.0; 3 * n]);
        for sample in 0..count {
            self.slope(&mut arm, sample as f64, &state, &mut slope[0]);
            motion.q.extend_from_slice(&state[..n]);
            motion.dq.extend_from_slice(&arm.speeds);
            motion.ddq.extend_from_slice(&slope[0][n..2 * n]);
            motion.tau.extend_from_slice(&arm.tau);
            if slope[0][..2 * n].iter().any(|value| value.abs() > 1e9 || value.is_nan()) {
                return None;
            }
            for k in 0..self.steps {
                let at = |share: f64| sample as f64 + (k as f64 + share) / self.steps as f64;
                if k > 0 {
                    self.slope(&mut arm, at(0.0), &state, &mut slope[0]);
                }
                for (stage, share) in [(1, 0.5), (2, 0.5), (3, 1.0)] {
                    for ((trial, state), slope) in
                        trial.iter_mut().zip(&state).zip(&slope[stage - 1])
                    {
                        *trial = state + share * step * slope;
                    }
                    self.slope(&mut arm, at(share), &trial, &mut slope[stage]);
                }
                for (index, state) in state.iter_mut().enumerate() {
                    let [a, b, c, d] = [0, 1, 2, 3].map(|stage: usize| slope[stage][index]);
                    *state += step / 6.0 * (a + 2.0 * b + 2.0 * c + d);
                }
                // Beyond the whole friction the spring slides.
                state[2 * n..].iter_mut().for_each(|share| *share = share.clamp(-1.0, 1.0));
            }
        }
        Some(motion)
    }

    /// Speeds at which the damper of a joint that sticks gives the whole of what jumps there, dry
    /// friction above all: the narrowest that the integration can follow.
    ///
    /// The speed dies out at the rate jump / (2 width · inertia). The rates of all joints together
    /// are one per step at most, a third of what the method of Runge and Kutta bears.
    ///
    /// - returns `[n]`, rad/s (m/s); zero for joints without such an effect
    fn widths_at_rest(&self, robot: &Robot, set: &ParameterSet, parameters: &[f64]) -> Vec<f64> {
        let n = robot.dof();
        let count = self.reference.count(n);
        let mut arm = ControlledArm::new(robot, set, parameters);
        let mut widths = vec![0.0f64; n];
        let (mut forwards, mut backwards) = (vec![0.0; n], vec![0.0; n]);
        let (mut still, mut pushed) = (vec![0.0; n], vec![0.0; n]);
        for sample in (0..count).step_by(count.div_ceil(POSES).max(1)) {
            let q = &self.reference.q[sample * n..(sample + 1) * n];
            for (tau, speed) in [(&mut forwards, BARELY_MOVING), (&mut backwards, -BARELY_MOVING)] {
                tau.fill(0.0);
                set.add_effect_torque(
                    parameters,
                    &JointState { q, dq: &vec![speed; n], ddq: &vec![0.0; n] },
                    tau,
                );
            }
            arm.tau.fill(0.0);
            arm.accelerate(q, &mut still);
            for joint in 0..n {
                arm.tau[joint] = 0.5 * (forwards[joint] - backwards[joint]);
                arm.accelerate(q, &mut pushed);
                arm.tau[joint] = 0.0;
                let lost = (self.step() * (pushed[joint] - still[joint])).abs();
                widths[joint] = widths[joint].max(n as f64 * lost);
            }
        }
        // What viscous friction changes between the two speeds is no jump.
        widths.into_iter().map(|width| if width > BARELY_MOVING { width } else { 0.0 }).collect()
    }

    /// Integration step, s.
    fn step(&self) -> f64 {
        1.0 / (self.rate_hz * self.steps as f64)
    }

    /// Derivative of the state [q, dq, share of its friction that the spring of each joint holds]
    /// at a time in samples.
    fn slope(&self, arm: &mut ControlledArm<'_>, time: f64, state: &[f64], out: &mut [f64]) {
        let n = self.kp.len();
        let [q, dq, held] = [0, 1, 2].map(|part| &state[part * n..(part + 1) * n]);
        let last = self.reference.q.len() / n - 1;
        let from = (time as usize).min(last.saturating_sub(1));
        let (to, t) = ((from + 1).min(last), (time - from as f64).min(1.0));
        for joint in 0..n {
            let (a, b) = (from * n + joint, to * n + joint);
            let (position, speed) = self.reference_between(a, b, t);
            let forward = self.feed_forward.map_or(0.0, |tau| tau[a] + t * (tau[b] - tau[a]));
            arm.tau[joint] = forward
                + self.kp[joint] * (position - q[joint])
                + self.kd[joint] * (speed - dq[joint]);
        }
        out[..n].copy_from_slice(dq);
        for joint in 0..n {
            let width = arm.widths[joint];
            arm.speeds[joint] = speed_or_friction(dq[joint], held[joint], width);
            out[2 * n + joint] =
                if width > 0.0 { SPRING * dq[joint] / (self.step() * width) } else { 0.0 };
        }
        arm.accelerate(q, &mut out[n..2 * n]);
    }

    /// Hermite's cubic between two samples.
    fn reference_between(&self, a: usize, b: usize, t: f64) -> (f64, f64) {
        let Samples { q, dq, .. } = self.reference;
        let h = 1.0 / self.rate_hz;
        let (s, t2) = (1.0 - t, t * t);
        let position =
            (1.0 + 2.0 * t) * s * s * q[a] + t * s * s * h * dq[a] + t2 * (3.0 - 2.0 * t) * q[b]
                - t2 * s * h * dq[b];
        let speed = 6.0 * t * s / h * (q[b] - q[a])
            + (1.0 - 4.0 * t + 3.0 * t2) * dq[a]
            + (3.0 * t2 - 2.0 * t) * dq[b];
        (position, speed)
    }
}

/// The speed of a joint that slides; of one that sticks, a trifle in proportion to its friction.
///
/// - `held`: share of the friction that the spring holds, the damper gives the remainder
/// - `width`: speed at which the damper gives all of it; zero for a joint that always slides
fn speed_or_friction(speed: f64, held: f64, width: f64) -> f64 {
    if width == 0.0 {
        return speed;
    }
    let share = held + speed / width;
    if share.abs() < 1.0 {
        share * BARELY_MOVING
    } else {
        speed.abs().max(BARELY_MOVING).copysign(share)
    }
}

struct ControlledArm<'a> {
    robot: Robot,
    ws: Workspace,
    set: &'a ParameterSet,
    parameters: &'a [f64],
    zeros: Vec<f64>,
    ones: Vec<f64>,
    drag: Vec<f64>,
    rotor: Vec<f64>,
    tau: Vec<f64>,
    /// Speeds as the effects take them.
    speeds: Vec<f64>,
    /// Of joints that stick; zeros if none does.
    widths: Vec<f64>,
}

impl<'a> ControlledArm<'a> {
    fn new(robot: &Robot, set: &'a ParameterSet, parameters: &'a [f64]) -> Self {
        let n = robot.dof();
        Self {
            robot: robot.clone().with_standard_parameters(&parameters[..set.inertial()]),
            ws: Workspace::new(robot),
            set,
            parameters,
            zeros: vec![0.0; n],
            ones: vec![1.0; n],
            drag: vec![0.0; n],
            rotor: vec![0.0; n],
            tau: vec![0.0; n],
            speeds: vec![0.0; n],
            widths: vec![0.0; n],
        }
    }

    /// Effects are linear in the acceleration of their own joint: what they take at unit
    /// acceleration more than at none is a rotor inertia.
    fn accelerate(&mut self, q: &[f64], out: &mut [f64]) {
        let Self { robot, ws, set, parameters, zeros, ones, drag, rotor, tau, speeds: dq, .. } =
            self;
        drag.fill(0.0);
        rotor.fill(0.0);
        set.add_effect_torque(parameters, &JointState { q, dq, ddq: zeros }, drag);
        set.add_effect_torque(parameters, &JointState { q, dq, ddq: ones }, rotor);
        rotor.iter_mut().zip(drag.iter()).for_each(|(rotor, drag)| *rotor -= drag);
        // The net torque stands where the drag was.
        drag.iter_mut().zip(tau.iter()).for_each(|(drag, tau)| *drag = tau - *drag);
        out.copy_from_slice(forward_dynamics_with_rotors(robot, ws, q, dq, drag, rotor));
    }
}
