//! Intervals of 95 % hold the truth 95 times in a hundred, also where the noise remembers.

use sgpr_core::dynamics::Samples;
use sgpr_core::identification::{
    Equations, INSTRUMENTAL_VARIABLES, LeastSquares, Method, block_bootstrap, essential_parameters,
    hac_covariance, residual_correlation,
};

use crate::arm::{Experiment, trajectory};
use crate::noise::Noise;

/// First-order noise, with a common part at both joints.
fn coloured(samples: usize, memory: f64, random: &mut Noise) -> Vec<f64> {
    let mut state = [0.0; 2];
    let mut noise = Vec::with_capacity(2 * samples);
    for _ in 0..samples {
        let common = random.normal();
        for x in &mut state {
            *x = memory * *x + 0.8 * random.normal() + 0.6 * common;
            noise.push(*x);
        }
    }
    noise
}

/// Shares of intervals of 95 % that hold the truth, over many experiments of 2500 samples in
/// `parts` logs.
struct Coverage {
    /// Rows taken as independent.
    naive: f64,
    memory: f64,
    hac: f64,
    bootstrap: f64,
}

fn coverage(memory: f64, parts: usize, seed: u64) -> Coverage {
    const EXPERIMENTS: usize = 250;
    const SAMPLES: usize = 2500;
    let experiment = Experiment::new(SAMPLES);
    let motion = experiment.run(&experiment.truth);
    let expected = experiment.expected();
    let nominal = experiment.nominal();
    let (robot, set, base) = (&experiment.robot, &experiment.set, &experiment.base);
    let mut random = Noise(seed);
    let mut hits = [0; 4];
    for _ in 0..EXPERIMENTS {
        // Logs were taken at different times: the noise of one knows nothing of that of another.
        let noise: Vec<f64> =
            (0..parts).flat_map(|_| coloured(SAMPLES / parts, memory, &mut random)).collect();
        let tau: Vec<f64> = motion.tau.iter().zip(&noise).map(|(tau, noise)| tau + noise).collect();
        let logs = (0..parts).map(|part| {
            let rows = part * SAMPLES / parts * 2..(part + 1) * SAMPLES / parts * 2;
            let samples = Samples {
                q: &motion.q[rows.clone()],
                dq: &motion.dq[rows.clone()],
                ddq: &motion.ddq[rows.clone()],
            };
            trajectory(&motion, &tau[rows]).with_samples(samples)
        });
        let mut equations = Equations::new(robot, set, base, logs.collect());
        let factors = equations.factors().expect("good data");
        let plain =
            LeastSquares::new(Method::Wls).solve(&factors, base, &nominal).expect("good data");
        let correlation =
            residual_correlation(&mut equations, &factors, &plain.values).expect("good data");
        let remembering =
            LeastSquares::new(Method::Wls).with_correlation(Some(correlation.clone()));
        let fit = remembering.solve(&factors, base, &nominal).expect("good data");
        let mut widened = fit.clone();
        widened.widen_for_few_rows(&factors, &correlation);
        let hac = hac_covariance(&mut equations, &factors, &fit, None).expect("good data");
        let bootstrap =
            block_bootstrap(&mut equations, &factors, &fit, 200, None).expect("good data");
        let intervals = bootstrap.intervals(0.95);
        for k in 0..expected.len() {
            let error = (fit.values[k] - expected[k]).abs();
            hits[0] += usize::from(error < 1.96 * plain.standard_deviations()[k]);
            hits[1] += usize::from(error < 1.96 * widened.standard_deviations()[k]);
            hits[2] += usize::from(error < 1.96 * hac[(k, k)].sqrt());
            hits[3] += usize::from((intervals[k][0]..intervals[k][1]).contains(&expected[k]));
        }
    }
    let [naive, memory, hac, bootstrap] =
        hits.map(|hits| hits as f64 / (EXPERIMENTS * expected.len()) as f64);
    println!(
        "{parts} logs covered: naive {naive:.3}, memory {memory:.3}, HAC {hac:.3}, bootstrap \
         {bootstrap:.3}"
    );
    Coverage { naive, memory, hac, bootstrap }
}

/// Of 2750 intervals, those of one experiment are not independent: 1.5 hundredths are two
/// deviations.
const NOMINAL: std::ops::Range<f64> = 0.935..0.965;

#[test]
fn intervals_cover() {
    let Coverage { naive, memory, hac, bootstrap } = coverage(0.8, 1, 17);
    assert!(naive < 0.8, "{naive}");
    assert!(NOMINAL.contains(&memory), "{memory}");
    assert!(NOMINAL.contains(&hac), "{hac}");
    assert!(NOMINAL.contains(&bootstrap), "{bootstrap}");
}

#[test]
fn intervals_of_several_logs_cover() {
    let Coverage { memory, hac, bootstrap, .. } = coverage(0.8, 5, 31);
    assert!(NOMINAL.contains(&memory), "{memory}");
    assert!(NOMINAL.contains(&hac), "{hac}");
    assert!(NOMINAL.contains(&bootstrap), "{bootstrap}");
}

#[test]
fn intervals_cover_where_there_is_little_to_learn_the_noise_from() {
    // 65 independent rows per joint for 11 parameters: how much the noise remembers is itself
    // hardly known.
    let Coverage { naive, memory, hac, bootstrap } = coverage(0.95, 1, 5);
    assert!(naive < 0.5, "{naive}");
    for cover in [memory, hac, bootstrap] {
        assert!((0.92..0.965).contains(&cover), "{cover}");
    }
}

/// Share of intervals of instrumental variables that hold the truth, and its standard error:
/// intervals of one experiment are not independent.
fn coverage_with_instruments(positions: f64, memory: f64, seed: u64) -> [f64; 2] {
    const EXPERIMENTS: usize = 400;
    let experiment = Experiment::new(2500);
    let motion = experiment.run(&experiment.truth);
    let expected = experiment.expected();
    let mut random = Noise(seed);
    let mut shares = Vec::with_capacity(EXPERIMENTS);
    for _ in 0..EXPERIMENTS {
        // Second differences of white noise in the positions: the sum over time is next to nothing.
        let white: Vec<f64> =
            (0..motion.q.len() + 4).map(|_| positions * random.normal()).collect();
        let mut noisy = motion.clone();
        for (k, ddq) in noisy.ddq.iter_mut().enumerate() {
            *ddq += white[k] - 2.0 * white[k + 2] + white[k + 4];
        }
        let noise = coloured(2500, memory, &mut random);
        let tau: Vec<f64> =
            motion.tau.iter().zip(noise).map(|(tau, noise)| tau + 0.5 * noise).collect();
        let found =
            experiment.estimate(&INSTRUMENTAL_VARIABLES.method(), &noisy, &tau).expect("good data");
        let spread = found.standard_deviations();
        let covered = |k: &usize| (found.values[*k] - expected[*k]).abs() < 1.96 * spread[*k];
        shares.push((0..expected.len()).filter(covered).count() as f64 / expected.len() as f64);
    }
    let mean = shares.iter().sum::<f64>() / EXPERIMENTS as f64;
    let variance =
        shares.iter().map(|share| (share - mean).powi(2)).sum::<f64>() / (EXPERIMENTS - 1) as f64;
    let error = (variance / EXPERIMENTS as f64).sqrt();
    println!("instruments, positions {positions}, memory {memory}: covered {mean:.4} ± {error:.4}");
    [mean, error]
}

#[test]
fn intervals_of_instrumental_variables_cover() {
    for (positions, memory, seed) in [(1.0, 0.0, 29), (0.0, 0.8, 43), (1.0, 0.8, 47)] {
        let [cover, error] = coverage_with_instruments(positions, memory, seed);
        assert!(
            (cover - 0.95).abs() < 0.005 + 2.5 * error,
            "{positions} {memory}: {cover} ± {error}"
        );
    }
}

#[test]
fn what_the_data_do_not_support_is_left_out_and_nothing_else() {
    let experiment = Experiment::new(3000);
    let mut truth = experiment.truth.clone();
    // Without Coulomb friction at the second joint, nor viscous friction at the first.
    let gone = ["joint_2.Fc", "joint_1.Fv"];
    for (name, value) in experiment.set.names().iter().zip(&mut truth) {
        if gone.contains(&name.as_str()) {
            *value = 0.0;
        }
    }
    let motion = experiment.run(&truth);
    let mut random = Noise(23);
    let tau: Vec<f64> = motion.tau.iter().map(|tau| tau + 0.3 * random.normal()).collect();
    let folds: Vec<_> = (0..4)
        .map(|fold| {
            let n = 2;
            let part = fold * 750 * n..(fold + 1) * 750 * n;
            let samples = Samples {
                q: &motion.q[part.clone()],
                dq: &motion.dq[part.clone()],
                ddq: &motion.ddq[part.clone()],
            };
            let trajectory = trajectory(&motion, &tau[part]).with_samples(samples);
            let equations = Equations::new(
                &experiment.robot,
                &experiment.set,
                &experiment.base,
                vec![trajectory],
            );
            equations.factors().expect("good data")
        })
        .collect();
    let found = essential_parameters(&folds, experiment.base.rank(), |_| 0.3).expect("good data");
    let dropped: Vec<&str> =
        found.dropped.iter().map(|gone| experiment.base.names()[gone.base].as_str()).collect();
    assert!(gone.iter().all(|name| dropped.contains(name)), "{dropped:?}");
    let expected = experiment.base.combine(&truth);
    for (k, (value, expected)) in found.values.iter().zip(&expected).enumerate() {
        let deviation = found.covariance[(k, k)].sqrt();
        assert!(
            (value - expected).abs() < 5.0 * deviation.max(2e-3),
            "{} {value} {expected}",
            experiment.base.names()[k]
        );
    }
    assert!(found.validation[dropped.len()] < 1.001);
}
