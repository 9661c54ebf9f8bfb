//! Estimators against each other on simulated logs: bias, spread, and whether their intervals hold
//! what they say.
//!
//! ```text
//! cargo run --release --package sgpr-core --example estimators -- 100
//! cargo run --release --package sgpr-core --example estimators -- 20 IV
//! ```
//!
//! The first number is that of experiments; a word after it leaves only estimators whose name
//! contains it. The two-link arm with friction and rotors follows a reference under a PD
//! controller. Its logs are spoilt in four ways and go through the whole pipeline, filters and
//! derivatives included. Experiments run on all cores, each with noise of its own seed. The table
//! is Markdown.

use std::error::Error;
use std::time::Instant;

use rayon::prelude::*;
use sgpr_core::identification::{
    BaseParameters, ClosedLoop, EstimatorNeeds, INSTRUMENTAL_VARIABLES, IRLS, Method, OUTPUT_ERROR,
    ParameterSet, RECURSIVE, RIDGE, SimulatedMotion, TOTAL_LEAST_SQUARES,
};
use sgpr_core::model::{Controller, Fit, IdentifyOptions, Uncertainty, identify};
use sgpr_core::recording::Recording;
use sgpr_core::robot::{Robot, two_link};

const EFFECTS: [&str; 3] = ["viscous_friction", "coulomb_friction", "rotor_inertia"];
const RATE_HZ: f64 = 200.0;
const SAMPLES: usize = 4000;
const GAINS: ([f64; 2], [f64; 2]) = ([400.0, 300.0], [40.0, 30.0]);

/// How a log is spoilt.
struct Scenario {
    title: &'static str,
    /// Standard deviation of the position's noise, rad.
    position: f64,
    /// Standard deviation of the torque's noise, N·m, and how much of it remains from sample to
    /// sample.
    torque: f64,
    memory: f64,
    /// Share of torques that are wrong by twenty standard deviations.
    outliers: f64,
    /// Cut-off of the filters, Hz; from the spectra if none.
    cutoff_hz: Option<f64>,
}

const SCENARIOS: [Scenario; 4] = [
    Scenario {
        title: "white torque noise, cut-off from the spectrum",
        position: 1e-5,
        torque: 0.5,
        memory: 0.0,
        outliers: 0.0,
        cutoff_hz: None,
    },
    Scenario {
        title: "coloured torque noise, cut-off from the spectrum",
        position: 1e-5,
        torque: 0.5,
        memory: 0.95,
        outliers: 0.0,
        cutoff_hz: None,
    },
    Scenario {
        title: "white torque noise, coarse encoder, a cut-off of 30 Hz that lets its noise through",
        position: 2e-4,
        torque: 0.5,
        memory: 0.0,
        outliers: 0.0,
        cutoff_hz: Some(30.0),
    },
    Scenario {
        title: "white torque noise and 2 % outliers",
        position: 1e-5,
        torque: 0.5,
        memory: 0.0,
        outliers: 0.02,
        cutoff_hz: None,
    },
];

fn main() -> Result<(), Box<dyn Error>> {
    let runs: usize = std::env::args().nth(1).map_or(Ok(100), |count| count.parse())?;
    let word = std::env::args().nth(2).unwrap_or_default();
    let arm = Arm::new();
    let methods = [
        ("OLS", Method::Ols, Uncertainty::Memory),
        ("WLS", Method::Wls, Uncertainty::Memory),
        ("WLS, HAC", Method::Wls, Uncertainty::Hac),
        ("WLS, bootstrap", Method::Wls, Uncertainty::Bootstrap { replicates: 200 }),
        ("IRLS (Huber)", IRLS.method(), Uncertainty::Memory),
        ("ridge to CAD values 10 % off", RIDGE.with(0.1), Uncertainty::Memory),
        ("TLS", TOTAL_LEAST_SQUARES.with(0.01), Uncertainty::Memory),
        ("IV, simulated instruments", INSTRUMENTAL_VARIABLES.method(), Uncertainty::Memory),
        ("output error (DIDIM)", OUTPUT_ERROR.method(), Uncertainty::Memory),
        ("RLS, no forgetting", RECURSIVE.with(1.0), Uncertainty::Memory),
    ];
    println!("{runs} experiments of {} s each.", SAMPLES as f64 / RATE_HZ);
    for scenario in &SCENARIOS {
        println!("\n### {}\n", scenario.title);
        println!(
            "| estimator | bias % | spread % | 95 % intervals cover % |\n| --- | ---: | ---: | ---: |"
        );
        for (name, method, uncertainty) in methods.iter().filter(|(name, ..)| name.contains(&word))
        {
            let start = Instant::now();
            let score = arm.score(scenario, method, *uncertainty, runs)?;
            println!(
                "| {name} | {:.2} | {:.2} | {:.1} |",
                score.bias, score.spread, score.coverage
            );
            eprintln!("{name}: {:.1} s", start.elapsed().as_secs_f64());
        }
    }
    Ok(())
}

struct Arm {
    /// With inertias of the robot file.
    robot: Robot,
    truth: Vec<f64>,
    reference: SimulatedMotion,
    motion: SimulatedMotion,
}

/// Root mean squares over the base parameters that are not zero, percent of their values.
struct Score {
    bias: f64,
    spread: f64,
    coverage: f64,
}

impl Arm {
    fn new() -> Self {
        let real = two_link();
        let set = ParameterSet::new(&real, &EFFECTS).expect("effects of the library");
        let mut parameters = real.standard_parameters();
        parameters.extend([0.5, 0.3, 0.4, 0.2, 0.08, 0.09]);
        let reference = reference();
        let (kp, kd) = GAINS;
        let closed_loop = ClosedLoop::new(reference.samples(), &kp, &kd, RATE_HZ).with_steps(10);
        let set = set.with_sticking_joints();
        let motion =
            closed_loop.simulate(&real, &set, &parameters, &reference.q[..2], &reference.dq[..2]);
        let cad: Vec<f64> = real.standard_parameters().iter().map(|value| 1.1 * value).collect();
        Self {
            truth: BaseParameters::new(&real, &set).combine(&parameters),
            robot: real.with_standard_parameters(&cad),
            reference,
            motion: motion.expect("a stable loop"),
        }
    }

    fn score(
        &self,
        scenario: &Scenario,
        method: &Method,
        uncertainty: Uncertainty,
        runs: usize,
    ) -> Result<Score, Box<dyn Error>> {
        let mut options = IdentifyOptions::default()
            .with_effects(EFFECTS.map(String::from).to_vec())
            .with_method(method.clone())
            .with_uncertainty(uncertainty);
        options.conditioning.cutoff_hz = scenario.cutoff_hz;
        // The arm never stands, however noisy its speed looks.
        options.conditioning.standstill_speed = Some(0.0);
        if method.needs() >= EstimatorNeeds::Instruments {
            options.instruments = vec![self.recording(&self.reference.q, None)?];
            options.controller = Some(Controller { kp: GAINS.0.to_vec(), kd: GAINS.1.to_vec() });
        }
        let experiment = |run: usize| -> Result<Fit, String> {
            let log = self
                .spoilt(scenario, &mut Noise::of_run(run))
                .map_err(|error| error.to_string())?;
            let (model, _) =
                identify(&self.robot, &[log], &options, &()).map_err(|error| error.to_string())?;
            Ok(model.fit().expect("identified").clone())
        };
        let fits: Vec<Fit> = (0..runs).into_par_iter().map(experiment).collect::<Result<_, _>>()?;
        let mut estimates: Vec<Vec<f64>> = Vec::new();
        let (mut covered, mut intervals) = (0, 0);
        for fit in fits {
            for ((value, truth), deviation) in
                fit.values.iter().zip(&self.truth).zip(&fit.standard_deviations)
            {
                covered += usize::from((value - truth).abs() < 1.96 * deviation);
                intervals += 1;
            }
            estimates.push(fit.values);
        }
        let (mut bias, mut spread, mut count) = (0.0, 0.0, 0.0);
        for (k, truth) in self.truth.iter().enumerate().filter(|(_, truth)| truth.abs() > 1e-9) {
            let mean = estimates.iter().map(|values| values[k]).sum::<f64>() / runs as f64;
            let variance = estimates.iter().map(|values| (values[k] - mean).powi(2)).sum::<f64>()
                / runs as f64;
            bias += (mean / truth - 1.0).powi(2);
            spread += variance / truth.powi(2);
            count += 1.0;
        }
        let percent = |sum: f64| 100.0 * (sum / count).sqrt();
        let coverage = 100.0 * covered as f64 / intervals as f64;
        Ok(Score { bias: percent(bias), spread: percent(spread), coverage })
    }

    fn spoilt(&self, scenario: &Scenario, random: &mut Noise) -> Result<Recording, Box<dyn Error>> {
        let q: Vec<f64> =
            self.motion.q.iter().map(|q| q + scenario.position * random.normal()).collect();
        let fresh = (1.0 - scenario.memory * scenario.memory).sqrt();
        let mut state = [0.0; 2];
        let mut tau = self.motion.tau.clone();
        for sample in tau.chunks_exact_mut(2) {
            for (tau, state) in sample.iter_mut().zip(&mut state) {
                *state = scenario.memory * *state + fresh * scenario.torque * random.normal();
                *tau += *state;
                if random.uniform() < scenario.outliers {
                    *tau +=
                        20.0 * scenario.torque * if random.uniform() < 0.7 { 1.0 } else { -1.0 };
                }
            }
        }
        self.recording(&q, Some(tau))
    }

    fn recording(&self, q: &[f64], tau: Option<Vec<f64>>) -> Result<Recording, Box<dyn Error>> {
        let names = self.robot.joint_names().map(String::from).collect();
        let time = (0..SAMPLES as i64).map(|k| k * (1e9 / RATE_HZ) as i64).collect();
        Ok(Recording::new("simulated", names, time, q.to_vec(), None, tau, vec![])?)
    }
}

fn reference() -> SimulatedMotion {
    let mut motion = SimulatedMotion::default();
    for k in 0..SAMPLES {
        let t = k as f64 / RATE_HZ;
        for joint in 0..2 {
            let (mut q, mut dq) = (0.0, 0.0);
            for h in 1..=4 {
                let (a, w) = (0.7 / h as f64, 0.9 * h as f64 + 0.17 * joint as f64);
                let phase = w * t + 1.7 * (h * (joint + 1)) as f64;
                (q, dq) = (q + a * phase.sin(), dq + a * w * phase.cos());
            }
            motion.q.push(q);
            motion.dq.push(dq);
            motion.ddq.push(0.0);
        }
    }
    motion
}

/// SplitMix64 (Steele, Lea, Flood (2014)), and the sum of twelve uniform numbers for a normal one.
struct Noise(u64);

impl Noise {
    fn of_run(run: usize) -> Self {
        Self((run as u64 + 1).wrapping_mul(0xD134_2543_DE82_EF95))
    }

    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}
