//! What the benchmarks share: robots and random states.

use std::path::Path;

use sgpr_core::effects::{Site, by_name};
use sgpr_core::model::{Term, TorqueModel};
use sgpr_core::robot::{Robot, UrdfOptions};
use sgpr_core::simulation::Reference;

/// Robots that every dynamics benchmark runs on.
pub const ROBOTS: [&str; 3] = ["puma560", "ur5e_like", "panda_like"];

/// A robot with states that differ from call to call, so that no branch or value can be learnt.
#[derive(Debug)]
pub struct Fixture {
    /// The robot.
    pub robot: Robot,
    /// `[samples, n]`, rad.
    pub q: Vec<f64>,
    /// `[samples, n]`, rad/s.
    pub dq: Vec<f64>,
    /// `[samples, n]`, rad/s².
    pub ddq: Vec<f64>,
    /// `[samples, n]`, N·m.
    pub tau: Vec<f64>,
}

impl Fixture {
    /// `samples` random states of one of the bundled reference robots.
    ///
    /// # Panics
    /// If there is no such robot.
    pub fn new(name: &str, samples: usize) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join(format!("../data/reference/urdf/{name}.urdf"));
        Self::of(Robot::from_urdf(path, &UrdfOptions::default()).expect("a bundled robot"), samples)
    }

    /// `samples` random states of a robot.
    pub fn of(robot: Robot, samples: usize) -> Self {
        let mut random = Uniform(2018);
        let mut states = |scale: f64| {
            (0..samples * robot.dof()).map(|_| scale * random.next()).collect::<Vec<_>>()
        };
        let (q, dq, ddq, tau) = (states(3.0), states(2.0), states(5.0), states(20.0));
        Self { robot, q, dq, ddq, tau }
    }

    /// All states in turn.
    pub fn states(&self) -> impl Iterator<Item = State<'_>> {
        let n = self.robot.dof();
        let motion =
            self.q.chunks_exact(n).zip(self.dq.chunks_exact(n)).zip(self.ddq.chunks_exact(n));
        motion.zip(self.tau.chunks_exact(n)).map(|(((q, dq), ddq), tau)| (q, dq, ddq, tau))
    }
}

/// q, dq, ddq, tau of one state.
pub type State<'a> = (&'a [f64], &'a [f64], &'a [f64], &'a [f64]);

/// Numbers in [-1, 1) from SplitMix64 (Steele, Lea, Flood 2014).
#[derive(Debug)]
pub struct Uniform(
    /// State.
    pub u64,
);

impl Uniform {
    /// The next number.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Every joint swings by half a radian, joint k at k rad/s: what the simulated arms follow.
#[derive(Clone, Copy, Debug)]
pub struct Sines;

impl Reference for Sines {
    fn dof(&self) -> usize {
        6
    }

    fn sample(&self, time: f64, q: &mut [f64], dq: &mut [f64], ddq: &mut [f64]) {
        for joint in 0..6 {
            let w = (joint + 1) as f64;
            let (sin, cos) = (w * time).sin_cos();
            (q[joint], dq[joint], ddq[joint]) = (0.5 * sin, 0.5 * w * cos, -0.5 * w * w * sin);
        }
    }
}

/// The model of a robot with friction, rotor inertia and offset at every joint.
///
/// # Panics
/// Never: its effects are known.
pub fn model(fixture: &Fixture) -> TorqueModel {
    let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"];
    let mut parameters = fixture.robot.standard_parameters();
    parameters.resize(parameters.len() + effects.len() * fixture.robot.dof(), 0.4);
    TorqueModel::with_parameters(&fixture.robot, &effects, parameters).expect("known effects")
}

/// Five effects at single joints of an arm with five joints or more, two of them with a memory.
///
/// # Panics
/// Never: they are effects of the library.
pub fn findings() -> Vec<Term> {
    let term = |name: &str, joint: usize, constants: &[f64]| {
        let mut term = Term::new(
            by_name(name).expect("of the library"),
            Site::Joint(joint),
            constants.to_vec(),
        );
        term.coefficients.fill(0.3);
        term
    };
    vec![
        term("presliding_friction", 1, &[0.01]),
        term("cable_hysteresis", 0, &[0.2]),
        term("stribeck_friction", 2, &[0.05]),
        term("load_dependent_friction", 3, &[]),
        term("torque_ripple", 4, &[30.0]),
    ]
}
