//! One step after the other.

use super::SimulationError;
use super::drive::{Drive, require_valid};
use super::dry_friction::{Contact, DryFriction};
use super::side_torque::SideTorque;
use crate::dynamics::{Workspace, bias_forces, mass_matrix};
use crate::robot::Robot;

/// How the equation of motion is carried from one step to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Integrator {
    /// First order: new velocities with friction treated implicitly, new positions from the new
    /// velocities.
    ///
    /// Viscous friction of any size is stable and held joints stand still, at any step.
    #[default]
    SemiImplicitEuler,
    /// Fourth order by the classical Runge-Kutta scheme between the events of dry friction.
    ///
    /// Whether a joint sticks or slides is settled at the start of a step, as is its direction; a
    /// velocity that would change its sign ends at zero. Viscous friction is explicit: the step has
    /// to stay below 2.7 times inertia over viscous friction.
    RungeKutta4,
}

/// An arm that moves under torques, stepwise. Owns all buffers; a step allocates nothing.
///
/// (M(q) + Ia) ddq + C(q, dq) dq + g(q) + friction + side torques = tau
///
/// Dry friction is a bounded torque, not a function of velocity: joints stick and break away as the
/// balance of all joints says, which is solved exactly in every step.
///
/// # Examples
/// ```
/// use sgpr_core::{robot::two_link, simulation::{Integrator, Simulator, two_link_drives}};
/// let mut arm = Simulator::new(&two_link(), &two_link_drives(), Integrator::default(), 1e-3)?;
/// arm.set_state(&[0.3, -0.2], &[0.0, 0.0])?;
/// for _ in 0..100 {
///     arm.step(&[0.0, 0.0])?;
/// }
/// assert!(arm.dq()[0] < 0.0, "it falls");
/// # Ok::<(), sgpr_core::simulation::SimulationError>(())
/// ```
#[derive(Debug)]
pub struct Simulator {
    robot: Robot,
    drives: Vec<Drive>,
    integrator: Integrator,
    step: f64,
    steps: u64,
    speed_limit: f64,
    ws: Workspace,
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    friction: Vec<f64>,
    balance: DryFriction,
    /// What a joint does while it stands to be decided: `Free` where there is no dry friction.
    side: Vec<Box<dyn SideTorque>>,
    side_torque: Vec<f64>,
    stages: Stages,
}

/// States and slopes of a Runge-Kutta step.
#[derive(Debug)]
struct Stages {
    q: Vec<f64>,
    dq: Vec<f64>,
    sum_dq: Vec<f64>,
    sum_ddq: Vec<f64>,
}

/// Speed beyond which a joint counts as run away, rad/s: no arm comes near.
pub const SPEED_LIMIT: f64 = 1e3;

impl Simulator {
    /// An arm at rest at position zero; the only place that allocates.
    ///
    /// - `drives`: `[n]`
    /// - `step`: s
    ///
    /// # Errors
    /// If the step is not positive or a drive has values that none can have.
    pub fn new(
        robot: &Robot,
        drives: &[Drive],
        integrator: Integrator,
        step: f64,
    ) -> Result<Self, SimulationError> {
        require_valid(robot, drives)?;
        if !(step > 0.0 && step.is_finite()) {
            return Err(SimulationError::InvalidOption {
                option: "step",
                value: step,
                expected: "a time above zero",
            });
        }
        let n = robot.dof();
        let zeros = vec![0.0; n];
        let mut balance = DryFriction::new(n);
        reset_contacts(&mut balance, drives, &zeros);
        Ok(Self {
            ws: Workspace::new(robot),
            robot: robot.clone(),
            drives: drives.to_vec(),
            integrator,
            step,
            steps: 0,
            speed_limit: SPEED_LIMIT,
            q: zeros.clone(),
            dq: zeros.clone(),
            ddq: zeros.clone(),
            friction: zeros.clone(),
            balance,
            side: Vec::new(),
            side_torque: zeros.clone(),
            stages: Stages {
                q: zeros.clone(),
                dq: zeros.clone(),
                sum_dq: zeros.clone(),
                sum_ddq: zeros,
            },
        })
    }

    /// With one more torque beside rigid body and friction.
    #[must_use]
    pub fn with_side_torque(mut self, torque: Box<dyn SideTorque>) -> Self {
        self.side.push(torque);
        self
    }

    /// With another speed at which a joint counts as run away, rad/s (m/s).
    #[must_use]
    pub fn with_speed_limit(mut self, limit: f64) -> Self {
        self.speed_limit = limit;
        self
    }

    /// Puts the arm at a state; time goes on.
    ///
    /// # Errors
    /// If a slice is not of length n or a value not finite.
    pub fn set_state(&mut self, q: &[f64], dq: &[f64]) -> Result<(), SimulationError> {
        let expected = self.robot.dof();
        for (what, values) in [("position", q), ("velocity", dq)] {
            if values.len() != expected {
                return Err(SimulationError::Length { what, expected, found: values.len() });
            }
            if let Some(joint) = values.iter().position(|value| !value.is_finite()) {
                return Err(self.not_finite("initial state", joint, values[joint]));
            }
        }
        self.q.copy_from_slice(q);
        self.dq.copy_from_slice(dq);
        reset_contacts(&mut self.balance, &self.drives, dq);
        Ok(())
    }

    /// Changes the bodies of the arm, as when it picks something up; position and velocity stay.
    ///
    /// # Panics
    /// If the robot has another number of joints.
    pub fn set_robot(&mut self, robot: &Robot) {
        assert_eq!(robot.dof(), self.robot.dof(), "the same arm with other bodies");
        self.robot.clone_from(robot);
    }

    /// Time since the start, s.
    pub fn time(&self) -> f64 {
        self.steps as f64 * self.step
    }

    /// Length of a step, s.
    pub fn step_length(&self) -> f64 {
        self.step
    }

    /// The arm.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Positions, `[n]`, rad (m).
    pub fn q(&self) -> &[f64] {
        &self.q
    }

    /// Velocities, `[n]`, rad/s (m/s).
    pub fn dq(&self) -> &[f64] {
        &self.dq
    }

    /// Accelerations in the last step, `[n]`, rad/s² (m/s²).
    pub fn ddq(&self) -> &[f64] {
        &self.ddq
    }

    /// Friction torque in the last step, `[n]`, N·m (N); holding torque of joints that stick.
    pub fn friction(&self) -> &[f64] {
        &self.friction
    }

    /// One step under the torque `tau`, `[n]`, N·m (N).
    ///
    /// # Errors
    /// If a joint moves no inertia, runs away, or a side torque is not finite.
    ///
    /// # Panics
    /// If `tau` is not of length n.
    pub fn step(&mut self, tau: &[f64]) -> Result<(), SimulationError> {
        assert_eq!(tau.len(), self.robot.dof(), "one torque per joint");
        self.update_side_torque()?;
        match self.integrator {
            Integrator::SemiImplicitEuler => self.euler(tau)?,
            Integrator::RungeKutta4 => self.runge_kutta(tau)?,
        }
        self.steps += 1;
        let ran_away = |speed: &f64| speed.is_nan() || speed.abs() > self.speed_limit;
        if let Some(joint) = self.dq.iter().position(ran_away) {
            return Err(SimulationError::Unstable {
                joint: self.joint_name(joint),
                time: self.time(),
                speed: self.dq[joint],
                limit: self.speed_limit,
            });
        }
        Ok(())
    }

    fn update_side_torque(&mut self) -> Result<(), SimulationError> {
        if self.side.is_empty() {
            return Ok(());
        }
        let time = self.time();
        self.side_torque.fill(0.0);
        for torque in &mut self.side {
            torque.add(time, self.step, &self.q, &self.dq, &self.ddq, &mut self.side_torque);
        }
        match self.side_torque.iter().position(|value| !value.is_finite()) {
            Some(joint) => Err(self.not_finite("side torque", joint, self.side_torque[joint])),
            None => Ok(()),
        }
    }

    /// (M + h Fv) v⁺ + h f = M v + h (tau - bias), f the dry friction.
    fn euler(&mut self, tau: &[f64]) -> Result<(), SimulationError> {
        let n = self.robot.dof();
        let h = self.step;
        self.fill_mass_matrix(None);
        let bias = bias_forces(&self.robot, &mut self.ws, &self.q, &self.dq);
        for i in 0..n {
            let (drive, v) = (&self.drives[i], self.dq[i]);
            let mut momentum = 0.0;
            for j in 0..n {
                momentum += self.balance.a[i.max(j) * n + i.min(j)] * self.dq[j];
            }
            self.balance.b[i] = momentum + h * (tau[i] - bias[i] - self.side_torque[i]);
            if self.balance.contact[i] != Contact::Free {
                // Against the present motion what the curve says; against any other what holds at
                // rest.
                let size = |direction: usize, along: f64| {
                    if along > 0.0 {
                        drive.sliding(direction, along)
                    } else {
                        drive.holding(direction)
                    }
                };
                self.balance.bound[i] = [h * size(0, v), h * size(1, -v)];
            }
        }
        for i in 0..n {
            self.balance.a[i * n + i] += h * self.drives[i].viscous_friction;
        }
        let solved = self.balance.solve();
        solved.map_err(|row| self.no_inertia(row.0))?;
        for i in 0..n {
            let v = self.balance.x[i];
            self.ddq[i] = (v - self.dq[i]) / h;
            self.friction[i] = self.balance.friction[i] / h + self.drives[i].viscous_friction * v;
            self.dq[i] = v;
            self.q[i] += h * v;
        }
        Ok(())
    }

    fn runge_kutta(&mut self, tau: &[f64]) -> Result<(), SimulationError> {
        let n = self.robot.dof();
        let h = self.step;
        // Moving joints slide on; joints at rest stick or break away as the accelerations say.
        let mut undecided = false;
        for i in 0..n {
            if self.balance.contact[i] == Contact::Free {
                continue;
            }
            let v = self.dq[i];
            self.balance.known[i] = v != 0.0;
            undecided |= v == 0.0;
            if v != 0.0 {
                self.balance.contact[i] =
                    if v > 0.0 { Contact::Forwards } else { Contact::Backwards };
            }
        }
        self.stages.q.copy_from_slice(&self.q);
        self.stages.dq.copy_from_slice(&self.dq);
        self.accelerate(tau, undecided)?;
        for i in 0..n {
            self.ddq[i] = self.balance.x[i];
            self.friction[i] =
                self.balance.friction[i] + self.drives[i].viscous_friction * self.dq[i];
            self.stages.sum_dq[i] = self.dq[i];
            self.stages.sum_ddq[i] = self.balance.x[i];
        }
        for (share, weight) in [(0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
            for i in 0..n {
                // The slope of the stage before: its velocity and its acceleration.
                self.stages.q[i] = self.q[i] + share * h * self.stages.dq[i];
                self.stages.dq[i] = self.dq[i] + share * h * self.balance.x[i];
                self.stages.sum_dq[i] += weight * self.stages.dq[i];
            }
            self.accelerate(tau, false)?;
            for i in 0..n {
                self.stages.sum_ddq[i] += weight * self.balance.x[i];
            }
        }
        for i in 0..n {
            self.q[i] += h / 6.0 * self.stages.sum_dq[i];
            let v = self.dq[i] + h / 6.0 * self.stages.sum_ddq[i];
            let turned = match self.balance.contact[i] {
                Contact::Forwards => v < 0.0,
                Contact::Backwards => v > 0.0,
                Contact::Free | Contact::Stuck => false,
            };
            self.dq[i] = if turned { 0.0 } else { v };
        }
        Ok(())
    }

    /// Accelerations at the stage into `balance.x`; contacts as they are unless `decide`.
    fn accelerate(&mut self, tau: &[f64], decide: bool) -> Result<(), SimulationError> {
        let n = self.robot.dof();
        self.fill_mass_matrix(Some(()));
        let bias = bias_forces(&self.robot, &mut self.ws, &self.stages.q, &self.stages.dq);
        for i in 0..n {
            let (drive, v) = (&self.drives[i], self.stages.dq[i]);
            self.balance.b[i] = tau[i] - bias[i] - self.side_torque[i] - drive.viscous_friction * v;
            self.balance.bound[i] = match self.balance.contact[i] {
                Contact::Free => continue,
                _ if decide && !self.balance.known[i] => [drive.holding(0), drive.holding(1)],
                _ => [drive.sliding(0, v.max(0.0)), drive.sliding(1, (-v).max(0.0))],
            };
        }
        let solved = if decide { self.balance.solve() } else { self.balance.solve_pattern() };
        solved.map_err(|row| self.no_inertia(row.0))
    }

    /// M(q) with the rotors into `balance.a`, at the state or at the stage.
    fn fill_mass_matrix(&mut self, stage: Option<()>) {
        let n = self.robot.dof();
        let q = if stage.is_some() { &self.stages.q } else { &self.q };
        self.balance.a.copy_from_slice(mass_matrix(&self.robot, &mut self.ws, q));
        for (i, drive) in self.drives.iter().enumerate() {
            self.balance.a[i * n + i] += drive.rotor_inertia;
        }
    }

    fn joint_name(&self, joint: usize) -> String {
        self.robot.joints()[joint].name.clone()
    }

    /// A pivot that is not positive: nothing to move, or a state that is no number any more.
    fn no_inertia(&self, joint: usize) -> SimulationError {
        let broken = |values: &[f64]| values.iter().position(|value| !value.is_finite());
        if let Some(joint) = broken(&self.dq).or(broken(&self.q)).or(broken(&self.stages.dq)) {
            let (joint, speed) = (self.joint_name(joint), f64::NAN);
            return SimulationError::Unstable {
                joint,
                time: self.time(),
                speed,
                limit: self.speed_limit,
            };
        }
        SimulationError::NoInertia { joint: self.joint_name(joint), time: self.time() }
    }

    pub(super) fn not_finite(
        &self,
        source_name: &'static str,
        joint: usize,
        value: f64,
    ) -> SimulationError {
        SimulationError::NotFinite {
            source_name,
            joint: self.joint_name(joint),
            time: self.time(),
            value,
        }
    }
}

fn reset_contacts(balance: &mut DryFriction, drives: &[Drive], dq: &[f64]) {
    for (contact, (drive, v)) in balance.contact.iter_mut().zip(drives.iter().zip(dq)) {
        *contact = match v {
            _ if !drive.has_dry_friction() => Contact::Free,
            v if *v > 0.0 => Contact::Forwards,
            v if *v < 0.0 => Contact::Backwards,
            _ => Contact::Stuck,
        };
    }
}
