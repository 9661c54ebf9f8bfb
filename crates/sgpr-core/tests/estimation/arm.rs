//! The two-link arm under a controller, with friction and rotors, and noise to spoil its logs with.

use sgpr_core::dynamics::Samples;
use sgpr_core::identification::{
    BaseParameters, ClosedLoop, Equations, Estimate, IdentificationError, Method, ParameterSet,
    SimulatedMotion, Trajectory, estimate,
};
use sgpr_core::robot::{Robot, two_link};

pub const EFFECTS: [&str; 3] = ["viscous_friction", "coulomb_friction", "rotor_inertia"];
pub const RATE: f64 = 200.0;

/// The two-link arm under a PD controller, and what it does.
pub struct Experiment {
    pub robot: Robot,
    pub set: ParameterSet,
    pub base: BaseParameters,
    pub truth: Vec<f64>,
    pub reference: SimulatedMotion,
    pub kp: [f64; 2],
    pub kd: [f64; 2],
}

impl Experiment {
    pub fn new(samples: usize) -> Self {
        let robot = two_link();
        // Dry friction as the simulation can follow it, in the logs and in the equations.
        let set =
            ParameterSet::new(&robot, &EFFECTS).expect("known effects").with_sticking_joints();
        let base = BaseParameters::new(&robot, &set);
        let mut truth = robot.standard_parameters();
        truth.extend([0.5, 0.3, 0.4, 0.2, 0.08, 0.09]);
        let mut reference = SimulatedMotion::default();
        for k in 0..samples {
            let t = k as f64 / RATE;
            for joint in 0..2 {
                let (mut q, mut dq, mut ddq) = (0.0, 0.0, 0.0);
                for h in 1..=4 {
                    let (a, w) = (0.7 / h as f64, 0.9 * h as f64 + 0.17 * joint as f64);
                    let phase = w * t + 1.7 * (h * (joint + 1)) as f64;
                    (q, dq, ddq) = (
                        q + a * phase.sin(),
                        dq + a * w * phase.cos(),
                        ddq - a * w * w * phase.sin(),
                    );
                }
                reference.q.push(q);
                reference.dq.push(dq);
                reference.ddq.push(ddq);
            }
        }
        Self { robot, set, base, truth, reference, kp: [400.0, 300.0], kd: [40.0, 30.0] }
    }

    pub fn closed_loop(&self) -> ClosedLoop<'_> {
        ClosedLoop::new(self.reference.samples(), &self.kp, &self.kd, RATE).with_steps(5)
    }

    /// What the arm with these parameters does.
    pub fn run(&self, parameters: &[f64]) -> SimulatedMotion {
        let Samples { q, dq, .. } = self.reference.samples();
        let motion =
            self.closed_loop().simulate(&self.robot, &self.set, parameters, &q[..2], &dq[..2]);
        motion.expect("a stable loop")
    }

    pub fn expected(&self) -> Vec<f64> {
        self.base.combine(&self.truth)
    }

    /// Robot file off by a tenth, friction unknown.
    pub fn nominal(&self) -> Vec<f64> {
        let mut nominal: Vec<f64> = self.truth.iter().map(|value| 1.1 * value).collect();
        nominal[self.set.inertial()..].fill(0.0);
        self.base.combine(&nominal)
    }

    pub fn estimate(
        &self,
        method: &Method,
        motion: &SimulatedMotion,
        tau: &[f64],
    ) -> Result<Estimate, IdentificationError> {
        let closed_loop = self.closed_loop();
        let trajectory =
            Trajectory::new(motion.samples(), tau).with_closed_loop(Some(&closed_loop));
        let mut equations = Equations::new(&self.robot, &self.set, &self.base, vec![trajectory]);
        let factors = equations.factors()?;
        estimate(method, &mut equations, &factors, &self.nominal(), None)
    }
}

pub fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// A plain trajectory.
pub fn trajectory<'a>(motion: &'a SimulatedMotion, tau: &'a [f64]) -> Trajectory<'a> {
    Trajectory::new(motion.samples(), tau)
}
