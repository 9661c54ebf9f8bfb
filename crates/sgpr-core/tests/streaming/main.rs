//! A model one sample after the other is the model along a trajectory.
#![allow(missing_docs)]

#[path = "../common/every_effect.rs"]
mod every_effect;
mod single;

use every_effect::{plain, term};
use sgpr_core::dynamics::Samples;
use sgpr_core::effects::{Entry, Origin, Scale, Site, Streamed, by_name, registry};
use sgpr_core::model::{
    Predictor, Purpose, SavedStates, StreamError, StreamOptions, Term, TorqueModel, Trajectory,
};
use sgpr_core::recording::Channel;
use sgpr_core::robot::{puma560, two_link};

const RATE_HZ: f64 = 250.0;

/// A motion of sines with many reversals, `[samples, n]` each, its times and a temperature.
struct Motion {
    time: Vec<f64>,
    q: Vec<f64>,
    dq: Vec<f64>,
    ddq: Vec<f64>,
    channels: Vec<Channel>,
}

impl Motion {
    fn new(n: usize, samples: usize) -> Self {
        let time: Vec<f64> = (0..samples).map(|k| k as f64 / RATE_HZ).collect();
        let [mut q, mut dq, mut ddq] = [const { Vec::new() }; 3];
        for t in &time {
            for joint in 0..n {
                let (mut x, mut v, mut a) = (0.3 * joint as f64, 0.0, 0.0);
                for harmonic in 1..4 {
                    let w = f64::from(harmonic) * (1.1 + 0.17 * joint as f64);
                    let (size, phase) =
                        (0.5 / f64::from(harmonic * harmonic), f64::from(harmonic) + joint as f64);
                    let (sine, cosine) = (w * t + phase).sin_cos();
                    x += size * sine;
                    v += size * w * cosine;
                    a -= size * w * w * sine;
                }
                q.push(x);
                dq.push(v);
                ddq.push(a);
            }
        }
        let channels = vec![Channel { name: "temperature".into(), values: vec![33.0; samples] }];
        Self { time, q, dq, ddq, channels }
    }

    fn trajectory(&self) -> Trajectory<'_> {
        let samples = Samples { q: &self.q, dq: &self.dq, ddq: &self.ddq };
        Trajectory::of_samples(samples)
            .with_rate_hz(RATE_HZ)
            .with_time(&self.time)
            .with_channels(&self.channels)
    }

    fn row(&self, k: usize, n: usize) -> [&[f64]; 3] {
        [&self.q, &self.dq, &self.ddq].map(|values| &values[k * n..(k + 1) * n])
    }

    fn streamed(&self, predictor: &mut Predictor) -> Vec<f64> {
        let n = predictor.dof();
        predictor.set_temperature(&vec![33.0; n]).expect("finite");
        let one = |k: usize| {
            let [q, dq, ddq] = self.row(k, n);
            predictor.try_torque(q, dq, ddq).expect("a good sample").to_vec()
        };
        (0..self.time.len()).flat_map(one).collect()
    }
}

fn options() -> StreamOptions {
    StreamOptions::default().with_rate_hz(Some(RATE_HZ))
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(count, sum), x| (count + 1.0, sum + x * x));
    (sum / count).sqrt()
}

#[test]
fn every_effect_streams_what_the_trajectory_says() {
    let robot = puma560();
    let (short, long) = (Motion::new(robot.dof(), 1500), Motion::new(robot.dof(), 12_000));
    for effect in registry().iter().filter(|effect| effect.entry() != Entry::Gate) {
        // What is said of all samples of a trajectory takes some periods to be known.
        let motion = if effect.streamed() == Streamed::Exactly { &short } else { &long };
        let without = plain(&robot).predict_trajectory(&motion.trajectory());
        for site in effect.sites(&robot) {
            let name = format!("{} at {site:?}", effect.name());
            let model = plain(&robot).with_terms(vec![term(effect, site)], Some(0));
            let batch = model.predict_trajectory(&motion.trajectory());
            let mut predictor = model.predictor(&options()).expect("an effect of the library");
            let streamed = motion.streamed(&mut predictor);
            // What looks back alone has settled, and what looks ahead does not see the end.
            let settled = match effect.streamed() {
                Streamed::Nearly(_) => 9000 * robot.dof()..11_800 * robot.dof(),
                _ => 0..batch.len(),
            };
            let parts = [&batch, &without, &streamed].map(|values| &values[settled.clone()]);
            let own = rms(parts[0].iter().zip(parts[1]).map(|(with, without)| with - without));
            let missed =
                rms(parts[0].iter().zip(parts[2]).map(|(batch, streamed)| batch - streamed));
            // A torque beyond the limit of a saturation may not occur at every joint, and where the
            // first joint stands, which turns about the direction of gravity, changes no torque.
            let may_do_nothing = effect.name() == "torque_saturation" || site == Site::Joint(0);
            assert!(own > 0.0 || may_do_nothing, "{name} does nothing");
            match effect.streamed() {
                Streamed::Exactly => assert!(missed < 1e-9, "{name}: {missed} of {own}"),
                Streamed::Nearly(how) => {
                    assert!(
                        missed < (0.5 * own).max(1e-9) && !how.is_empty(),
                        "{name}: {missed} of {own}"
                    );
                }
                Streamed::Not(reason) => panic!("{name}: {reason}"),
            }
            predictor.reset();
            assert_eq!(streamed, motion.streamed(&mut predictor), "{name} after a reset");
        }
    }
}

/// All kinds at once: hidden states, times, links that move, a delay that is a whole number of
/// samples and more.
fn many_terms() -> Vec<Term> {
    let of = |name: &str, site: Site| term(&by_name(name).expect("of the library"), site);
    let mut delay = of("torque_delay", Site::Arm);
    delay.constants = vec![3.4 / RATE_HZ];
    vec![
        of("presliding_friction", Site::Joint(2)),
        of("cable_hysteresis", Site::Joint(0)),
        of("friction_warmup", Site::Joint(1)),
        of("load_dependent_friction", Site::Joint(3)),
        of("transmission_hysteresis", Site::Joint(4)),
        of("link_flexibility", Site::Joint(5)),
        of("external_contact", Site::Arm),
        of("payload_change", Site::Arm),
        of("encoder_offset", Site::Joint(1)),
        of("base_tilt", Site::Arm),
        delay,
        of("actuator_lag", Site::Arm),
        of("torque_gain_error", Site::Joint(2)),
        of("torque_saturation", Site::Joint(1)),
    ]
}

#[test]
fn many_effects_together_stream_what_the_trajectory_says() {
    let robot = puma560();
    let motion = Motion::new(robot.dof(), 2000);
    let model = plain(&robot).with_terms(many_terms(), Some(0));
    let batch = model.predict_trajectory(&motion.trajectory());
    let streamed = motion.streamed(&mut model.predictor(&options()).expect("streams"));
    let largest = batch.iter().zip(&streamed).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(largest < 1e-9, "{largest}");
}

#[test]
fn a_torque_that_is_logged_early_follows_from_the_motion_ahead() {
    let robot = puma560();
    let motion = Motion::new(robot.dof(), 1500);
    let mut early = term(&by_name("torque_delay").expect("of the library"), Site::Arm);
    early.constants = vec![-0.006];
    // Without dry friction, whose jumps a trajectory smears over some samples.
    let bare = TorqueModel::with_parameters(&robot, &[] as &[&str], robot.standard_parameters())
        .expect("valid");
    let model = bare.clone().with_terms(vec![early], Some(0));
    let batch = model.predict_trajectory(&motion.trajectory());
    let late = bare.predict_trajectory(&motion.trajectory());
    let streamed = motion.streamed(&mut model.predictor(&options()).expect("streams"));
    let missed = rms(batch.iter().zip(&streamed).map(|(a, b)| a - b));
    let unled = rms(batch.iter().zip(&late).map(|(a, b)| a - b));
    assert!(missed < 0.15 * unled, "{missed} of {unled}");
}

#[test]
fn dry_friction_starts_where_reset_says() {
    let robot = two_link();
    let bare = TorqueModel::with_parameters(&robot, &[] as &[&str], robot.standard_parameters())
        .expect("valid");
    let mut friction = Term::new(
        by_name("presliding_friction").expect("of the library"),
        Site::Joint(1),
        vec![0.01],
    );
    friction.coefficients = vec![2.0];
    let model = bare.clone().with_terms(vec![friction], None);
    let mut predictor = Predictor::new(&model);
    let mut without = Predictor::new(&bare);
    let mut own = |predictor: &mut Predictor, q: f64| {
        let sample: [[f64; 2]; 3] = [[0.3, q], [0.0, 0.1], [0.0, 0.0]];
        let rigid = without.torque(&sample[0], &sample[1], &sample[2])[1];
        predictor.torque(&sample[0], &sample[1], &sample[2])[1] - rigid
    };
    // From rest, by Dahl's exponential over the distance from where it rested.
    assert!(own(&mut predictor, 0.0).abs() < 1e-12);
    assert!((own(&mut predictor, 0.005) - 2.0 * (1.0 - (-0.5f64).exp())).abs() < 1e-12);
    predictor.reset_at(&[0.3, -0.01], &[0.0; 2]).expect("finite");
    assert!((own(&mut predictor, 0.0) - 2.0 * (1.0 - (-1.0f64).exp())).abs() < 1e-12);
    // In motion it is fully built up, and turns round from there.
    predictor.reset_at(&[0.3, 0.0], &[0.0, -0.4]).expect("finite");
    assert!((own(&mut predictor, 0.0) + 2.0).abs() < 1e-12);
    assert!((own(&mut predictor, 0.02) - 2.0 * (1.0 - 2.0 * (-2.0f64).exp())).abs() < 1e-12);
}

#[test]
fn bad_samples_are_refused_and_leave_the_states_alone() {
    let robot = puma560();
    let (n, motion) = (robot.dof(), Motion::new(robot.dof(), 60));
    let model = plain(&robot).with_terms(many_terms(), Some(0));
    let mut predictor = model.predictor(&options()).expect("streams");
    let mut untroubled = model.predictor(&options()).expect("streams");
    for k in 0..60 {
        let [q, dq, ddq] = motion.row(k, n);
        let mut bad = dq.to_vec();
        bad[3] = f64::NAN;
        let error = predictor.try_torque(q, &bad, ddq).expect_err("not a number");
        assert!(matches!(error, StreamError::NotFinite { name: "dq", joint: 3, .. }), "{error}");
        assert!(predictor.torque(q, dq, &bad).iter().all(|tau| tau.is_nan()));
        let error = predictor.try_torque(&q[1..], dq, ddq).expect_err("one short");
        assert_eq!(error, StreamError::Length { name: "q", found: n - 1, expected: n });
        for step in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let error = predictor.torque_after(step, q, dq, ddq).expect_err("no step");
            assert!(matches!(error, StreamError::Step { .. }), "{error}");
        }
        let error = predictor.torque_after(0.4 / RATE_HZ, q, dq, ddq).expect_err("a delay");
        assert!(error.to_string().contains("higher rate_hz"), "{error}");
        let tau = predictor.try_torque(q, dq, ddq).expect("good").to_vec();
        assert_eq!(tau, untroubled.try_torque(q, dq, ddq).expect("good"));
    }
    assert!(predictor.reset_at(&[f64::INFINITY; 6], &[0.0; 6]).is_err());
    assert!((predictor.time() - 59.0 / RATE_HZ).abs() < 1e-12);
}

#[test]
fn what_an_effect_needs_is_asked_for() {
    let robot = puma560();
    let with = |name: &str, site: Site| {
        plain(&robot).with_terms(vec![term(&by_name(name).expect("of the library"), site)], Some(0))
    };
    let none = StreamOptions::default();
    for (name, site) in [
        ("friction_warmup", Site::Joint(0)),
        ("torque_delay", Site::Arm),
        ("actuator_lag", Site::Arm),
        ("joint_elasticity", Site::Joint(1)),
        ("link_flexibility", Site::Joint(1)),
    ] {
        let error = with(name, site).predictor(&none).expect_err("no rate").to_string();
        assert!(error.contains(name) && error.contains("rate_hz"), "{error}");
    }
    for rate_hz in [0.0, -5.0, f64::NAN, f64::INFINITY] {
        let error = plain(&robot).predictor(&none.clone().with_rate_hz(Some(rate_hz)));
        assert!(error.expect_err("no rate").to_string().contains("rate_hz"));
    }
    let warm = with("temperature_dependent_friction", Site::Joint(2));
    let mut predictor = warm.predictor(&none).expect("needs no rate");
    let error =
        predictor.try_torque(&[0.1; 6], &[0.1; 6], &[0.0; 6]).expect_err("how warm?").to_string();
    assert!(error.contains("joint_3") || error.contains("set_temperature"), "{error}");
    predictor.set_temperature(&[40.0; 6]).expect("finite");
    assert!(predictor.try_torque(&[0.1; 6], &[0.1; 6], &[0.0; 6]).is_ok());
    let error = plain(&robot).predictor(&none.with_keep(vec!["payload".into()]));
    assert!(error.expect_err("not there").to_string().contains("`payload`"));
}

#[test]
fn feed_forward_holds_what_the_arm_needs() {
    let robot = puma560();
    let motion = Motion::new(robot.dof(), 500);
    let of = |names: &[(&str, Site)]| -> Vec<Term> {
        names
            .iter()
            .map(|(name, site)| term(&by_name(name).expect("of the library"), *site))
            .collect()
    };
    let arm = [
        ("presliding_friction", Site::Joint(1)),
        ("payload", Site::Arm),
        ("encoder_offset", Site::Joint(2)),
    ];
    let errors = [
        ("torque_gain_error", Site::Joint(1)),
        ("torque_delay", Site::Arm),
        ("actuator_lag", Site::Arm),
        ("torque_offset_drift", Site::Joint(0)),
        ("external_contact", Site::Arm),
        ("payload_change", Site::Arm),
    ];
    let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia"];
    let mut parameters = robot.standard_parameters();
    parameters.extend((0..3 * robot.dof()).map(|k| 0.3 + 0.05 * k as f64));
    let bare = TorqueModel::with_parameters(&robot, &effects, parameters).expect("known effects");
    let needed = bare.clone().with_terms(of(&arm), Some(0));
    let measured = bare.with_terms([of(&arm), of(&errors)].concat(), Some(0));
    let feed_forward = options().with_purpose(Purpose::FeedForward);
    let expected = motion.streamed(&mut needed.predictor(&options()).expect("streams"));
    let found = motion.streamed(&mut measured.predictor(&feed_forward).expect("streams"));
    assert_eq!(expected, found);
    let kept = feed_forward.clone().with_keep(vec!["payload_change".into()]);
    assert_ne!(expected, motion.streamed(&mut measured.predictor(&kept).expect("streams")));
    // The offset that a model has at every joint is one of the log; the friction's step has
    // happened.
    let everywhere = plain(&robot).with_terms(of(&[("friction_step", Site::Joint(0))]), Some(0));
    let mut parameters = everywhere.parameters().to_vec();
    let offsets = parameters.len() - robot.dof();
    parameters[offsets..].fill(0.0);
    let effects = ["viscous_friction", "coulomb_friction", "rotor_inertia", "torque_offset"];
    let mut stepped = of(&[("friction_step", Site::Joint(0))]);
    stepped[0].constants = vec![-1e9];
    let without = TorqueModel::with_parameters(&robot, &effects, parameters)
        .expect("known")
        .with_terms(stepped, Some(0));
    let expected = motion.streamed(&mut without.predictor(&options()).expect("streams"));
    assert_eq!(
        expected,
        motion.streamed(&mut everywhere.predictor(&feed_forward).expect("streams"))
    );
}

#[test]
fn every_effect_says_what_it_is_a_property_of() {
    for effect in registry() {
        let about = effect.about();
        assert!(about.origin_reason.len() > 20, "{}", effect.name());
        let log = ["torque_gain_error", "torque_delay", "torque_offset_drift", "time_base_error"];
        assert!(
            !log.contains(&effect.name()) || about.origin == Origin::Measurement,
            "{}",
            effect.name()
        );
        let there = ["external_contact", "payload_change"].contains(&effect.name());
        assert_eq!(about.origin == Origin::Temporary, there, "{}", effect.name());
    }
}

#[test]
fn irregular_steps_lag_and_delay_by_the_time_that_passed() {
    let robot = two_link();
    let bare = TorqueModel::with_parameters(&robot, &[] as &[&str], robot.standard_parameters())
        .expect("valid");
    let of = |name: &str, seconds: f64| {
        let term = Term::new(by_name(name).expect("of the library"), Site::Arm, vec![seconds]);
        bare.clone().with_terms(vec![term], Some(0)).predictor(&options()).expect("streams")
    };
    // Slow enough for a straight line between samples.
    let position = |t: f64| [0.4 * (0.9 * t).sin(), 0.3 * (1.3 * t).cos()];
    let mut plain = Predictor::new(&bare);
    let mut torque = |t: f64| plain.torque(&position(t), &[0.0; 2], &[0.0; 2]).to_vec();
    let (delay, lag) = (0.013, 0.02);
    let (mut delayed, mut lagging) = (of("torque_delay", delay), of("actuator_lag", lag));
    let (mut t, mut largest) = (0.0, [0.0f64; 2]);
    for k in 0..2000 {
        let step = (1.0 + 0.4 * (0.7 * f64::from(k)).sin()) / RATE_HZ
            * if k % 500 == 499 { 20.0 } else { 1.0 };
        t += if k == 0 { 0.0 } else { step };
        let sample = (position(t), [0.0; 2], [0.0; 2]);
        let late = delayed
            .torque_after(step, &sample.0, &sample.1, &sample.2)
            .expect("a good sample")
            .to_vec();
        let slow = lagging
            .torque_after(step, &sample.0, &sample.1, &sample.2)
            .expect("a good sample")
            .to_vec();
        if k > 30 {
            for joint in 0..2 {
                largest[0] = largest[0].max((late[joint] - torque(t - delay)[joint]).abs());
                // A slow torque is late by the time constant.
                largest[1] = largest[1].max((slow[joint] - torque(t - lag)[joint]).abs());
            }
        }
    }
    assert!((delayed.time() - t).abs() < 1e-9, "{} {t}", delayed.time());
    assert!(largest[0] < 0.02 && largest[1] < 0.03, "{largest:?}");
}

#[test]
fn saved_states_come_back() {
    let robot = puma560();
    let motion = Motion::new(robot.dof(), 200);
    let model = plain(&robot).with_terms(many_terms(), Some(0));
    let mut predictor = model.predictor(&options()).expect("streams");
    let mut states = SavedStates::default();
    let mut after = Vec::new();
    for k in 0..200 {
        if k == 120 {
            predictor.save(&mut states);
        }
        let [q, dq, ddq] = motion.row(k, robot.dof());
        let tau = predictor.torque(q, dq, ddq).to_vec();
        after.extend((k >= 120).then_some(tau).into_iter().flatten());
    }
    predictor.restore(&states);
    let again = (120..200).flat_map(|k| {
        let [q, dq, ddq] = motion.row(k, robot.dof());
        predictor.torque(q, dq, ddq).to_vec()
    });
    assert!(after.iter().copied().eq(again));
}
