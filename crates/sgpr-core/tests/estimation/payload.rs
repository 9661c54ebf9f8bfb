//! Payloads and drive gains of the PUMA 560, which feels all ten parameters of a payload.

use sgpr_core::dynamics::{BatchWorkspace, Samples, rnea_batch};
use sgpr_core::effects::JointState;
use sgpr_core::identification::{
    BaseParameters, Consistency, Equations, GainEstimator, GainOptions, JointFactor, KnownPayload,
    ParameterSet, PayloadOptions, SimulatedMotion, identify_drive_gains, identify_payload,
};
use sgpr_core::robot::{Robot, puma560};

use crate::arm::trajectory;
use crate::noise::Noise;

const LINK: usize = 5;
/// 2 kg, centre of mass at (0.05, -0.02, 0.1) m, a ball of 0.004 kg·m².
const PAYLOAD: [f64; 10] = [2.0, 0.1, -0.04, 0.2, 0.0248, 0.002, 0.029, -0.01, 0.004, 0.0098];

struct Puma {
    robot: Robot,
    set: ParameterSet,
    base: BaseParameters,
    truth: Vec<f64>,
}

impl Puma {
    fn new() -> Self {
        let robot = puma560();
        let set =
            ParameterSet::new(&robot, &["viscous_friction", "coulomb_friction", "rotor_inertia"])
                .expect("known");
        let base = BaseParameters::new(&robot, &set);
        let mut truth = robot.standard_parameters();
        truth.extend((0..set.len() - set.inertial()).map(|k| 0.3 + 0.1 * k as f64));
        Self { robot, set, base, truth }
    }

    fn run(&self, load: &[f64; 10], noise: f64, gains: &[f64; 6], seed: u64) -> SimulatedMotion {
        let n = 6;
        let mut parameters = self.truth.clone();
        parameters[10 * LINK..].iter_mut().zip(load).for_each(|(own, load)| *own += load);
        let robot = self.robot.clone().with_standard_parameters(&parameters[..self.set.inertial()]);
        let mut motion = SimulatedMotion::default();
        for k in 0..4000 {
            let t = k as f64 / 100.0;
            for joint in 0..n {
                let (mut q, mut dq, mut ddq) = (0.0, 0.0, 0.0);
                for h in 1..=5 {
                    let w = 0.6 * h as f64 + 0.11 * joint as f64;
                    let (a, phase) = (0.8 / h as f64, 1.7 * (h * (joint + 1)) as f64);
                    q += a * (w * t + phase).sin();
                    dq += a * w * (w * t + phase).cos();
                    ddq -= a * w * w * (w * t + phase).sin();
                }
                motion.q.push(q);
                motion.dq.push(dq);
                motion.ddq.push(ddq);
            }
        }
        motion.tau = vec![0.0; motion.q.len()];
        let samples = Samples { q: &motion.q, dq: &motion.dq, ddq: &motion.ddq };
        rnea_batch(&robot, &mut BatchWorkspace::new(&robot), samples, &mut motion.tau);
        let mut random = Noise(seed);
        for (k, tau) in motion.tau.chunks_exact_mut(n).enumerate() {
            let row = k * n..(k + 1) * n;
            let state = JointState {
                q: &motion.q[row.clone()],
                dq: &motion.dq[row.clone()],
                ddq: &motion.ddq[row],
            };
            self.set.add_effect_torque(&parameters, &state, tau);
            for (tau, gain) in tau.iter_mut().zip(gains) {
                *tau = (*tau + noise * random.normal()) / gain;
            }
        }
        motion
    }

    fn factors(&self, motion: &SimulatedMotion) -> Vec<JointFactor> {
        let trajectories = vec![trajectory(motion, &motion.tau)];
        Equations::new(&self.robot, &self.set, &self.base, trajectories)
            .factors()
            .expect("good data")
    }

    fn nominal(&self) -> Vec<f64> {
        vec![0.0; self.base.rank()]
    }
}

#[test]
fn without_noise_the_payload_comes_back() {
    let puma = Puma::new();
    let (unloaded, loaded) =
        (puma.run(&[0.0; 10], 0.0, &[1.0; 6], 1), puma.run(&PAYLOAD, 0.0, &[1.0; 6], 2));
    let factors = [&puma.factors(&unloaded)[..], &puma.factors(&loaded)[..]];
    for friction_may_change in [false, true] {
        let options = PayloadOptions::new(LINK)
            .with_friction_may_change(friction_may_change)
            .with_consistent(false);
        let found =
            identify_payload(&puma.set, &puma.base, factors, &puma.nominal(), None, &options)
                .expect("good data");
        for (value, expected) in found.parameters.iter().zip(PAYLOAD) {
            assert!((value - expected).abs() < 1e-8, "{value} {expected}");
        }
    }
}

#[test]
fn with_noise_the_payload_is_within_its_deviations_and_a_body() {
    let puma = Puma::new();
    let (unloaded, loaded) =
        (puma.run(&[0.0; 10], 0.5, &[1.0; 6], 3), puma.run(&PAYLOAD, 0.5, &[1.0; 6], 4));
    let factors = [&puma.factors(&unloaded)[..], &puma.factors(&loaded)[..]];
    let options = PayloadOptions::new(LINK);
    let found = identify_payload(&puma.set, &puma.base, factors, &puma.nominal(), None, &options)
        .expect("good data");
    for ((value, expected), deviation) in
        found.parameters.iter().zip(PAYLOAD).zip(found.standard_deviations())
    {
        assert!((value - expected).abs() < 4.0 * deviation, "{value} {expected} {deviation}");
    }
    assert!((found.mass() / 2.0 - 1.0).abs() < 0.03, "{}", found.mass());
    let body = sgpr_core::spatial::LinkInertia::from_standard_parameters(&found.parameters);
    assert!(body.smallest_pseudo_inertia_eigenvalue() > 0.0);
}

fn options(known: KnownPayload) -> GainOptions {
    GainOptions::new(LINK, known)
}

#[test]
fn gains_of_all_drives_follow_from_the_mass_of_the_payload() {
    let puma = Puma::new();
    let gains = [10.0, 11.0, 8.5, 9.0, 9.5, 10.1];
    let mut known = [None; 10];
    known[0] = Some(PAYLOAD[0]);
    for (noise, tolerance) in [(0.0, 1e-6), (0.5, 0.05)] {
        let (unloaded, loaded) =
            (puma.run(&[0.0; 10], noise, &gains, 5), puma.run(&PAYLOAD, noise, &gains, 6));
        let factors = [&puma.factors(&unloaded)[..], &puma.factors(&loaded)[..]];
        let found = identify_drive_gains(
            &puma.robot,
            &puma.set,
            &puma.base,
            factors,
            None,
            &options(known),
        )
        .expect("good data");
        for (gain, expected) in found.gains.iter().zip(gains) {
            assert!((gain / expected - 1.0).abs() < tolerance, "{gain} {expected}");
        }
        for (value, expected) in found.payload.iter().zip(PAYLOAD) {
            assert!((value - expected).abs() < 0.05, "{value} {expected}");
        }
    }
    // Least squares keeps to its bounds.
    let (unloaded, loaded) =
        (puma.run(&[0.0; 10], 0.5, &gains, 5), puma.run(&PAYLOAD, 0.5, &gains, 6));
    let factors = [&puma.factors(&unloaded)[..], &puma.factors(&loaded)[..]];
    let lowest = gains.map(|gain| 0.97 * gain).to_vec();
    let least_squares =
        options(known).with_estimator(GainEstimator::LeastSquares).with_lowest(lowest.clone());
    let found =
        identify_drive_gains(&puma.robot, &puma.set, &puma.base, factors, None, &least_squares)
            .expect("good data");
    assert!(
        found.gains.iter().zip(&lowest).all(|(gain, lowest)| *gain > lowest - 1e-5),
        "{:?}",
        found.gains
    );
    // Held to bodies the gains are as good, and lower bounds hold for the likelihood too.
    for estimator in [GainEstimator::MaximumLikelihood, GainEstimator::LeastSquares] {
        let bodies = options(known)
            .with_estimator(estimator)
            .with_lowest(gains.map(|gain| 0.5 * gain).to_vec())
            .with_consistency(Some(Consistency::default()));
        let found =
            identify_drive_gains(&puma.robot, &puma.set, &puma.base, factors, None, &bodies)
                .expect("good data");
        for (gain, expected) in found.gains.iter().zip(gains) {
            // Noise draws least squares to zero.
            let lowest = if estimator == GainEstimator::LeastSquares { 0.5 - 1e-5 } else { 0.95 };
            assert!(
                (lowest..1.05).contains(&(gain / expected)),
                "{estimator:?}: {gain} {expected}"
            );
        }
        let body = sgpr_core::spatial::LinkInertia::from_standard_parameters(&found.payload);
        assert!(body.smallest_pseudo_inertia_eigenvalue() > -1e-6, "{:?}", found.payload);
        assert_eq!(found.payload[0], PAYLOAD[0]);
    }
    let nothing = identify_drive_gains(
        &puma.robot,
        &puma.set,
        &puma.base,
        [&[], &[]],
        None,
        &options([None; 10]),
    );
    assert!(nothing.expect_err("no scale").to_string().contains("payload"));
}

#[test]
fn intervals_of_the_gains_cover() {
    const PAIRS: usize = 16;
    let puma = Puma::new();
    let gains = [10.0, 11.0, 8.5, 9.0, 9.5, 10.1];
    let mut known = [None; 10];
    known[0] = Some(PAYLOAD[0]);
    let (mut hits, mut squares) = (0, 0.0);
    for pair in 0..PAIRS as u64 {
        let unloaded = puma.run(&[0.0; 10], 0.5, &gains, 100 + 2 * pair);
        let loaded = puma.run(&PAYLOAD, 0.5, &gains, 101 + 2 * pair);
        let factors = [&puma.factors(&unloaded)[..], &puma.factors(&loaded)[..]];
        let found = identify_drive_gains(
            &puma.robot,
            &puma.set,
            &puma.base,
            factors,
            None,
            &options(known),
        );
        let found = found.expect("good data");
        for ((gain, expected), deviation) in
            found.gains.iter().zip(gains).zip(&found.standard_deviations)
        {
            let z = (gain - expected) / deviation;
            hits += usize::from(z.abs() < 1.96);
            squares += z * z;
        }
    }
    // The gains of one pair share the noise of what the payload adds: these are some fifty
    // independent intervals.
    let count = (PAIRS * gains.len()) as f64;
    let (cover, ratio) = (hits as f64 / count, (squares / count).sqrt());
    println!("gains covered: {cover:.3}, errors are {ratio:.2} standard deviations");
    assert!(cover > 0.88, "{cover}");
    assert!((0.75..1.25).contains(&ratio), "{ratio}");
}
