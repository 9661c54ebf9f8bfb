//! In 32 bits a model streams what it does in 64, but for rounding.

use super::*;
use sgpr_core::model::StreamedModel;

/// Motion as 32 bits hold it, in both widths.
struct Rounded([Vec<f32>; 3], [Vec<f64>; 3]);

impl Rounded {
    fn of(motion: &Motion) -> Self {
        let single = [&motion.q, &motion.dq, &motion.ddq]
            .map(|all| all.iter().map(|x| *x as f32).collect::<Vec<_>>());
        let double = single.each_ref().map(|all| all.iter().map(|x| f64::from(*x)).collect());
        Self(single, double)
    }

    /// The torques in both widths, `step(k)` seconds after the sample before.
    fn streamed(
        &self,
        model: &TorqueModel,
        start: f64,
        step: impl Fn(usize) -> f64,
    ) -> [Vec<f64>; 2] {
        let n = model.robot().dof();
        let streamed = StreamedModel::from(model);
        let mut single = streamed.single_predictor(&options()).expect("an effect of the library");
        let mut double = streamed.predictor(&options()).expect("an effect of the library");
        single.set_time(start).expect("finite");
        double.set_time(start).expect("finite");
        single.set_temperature(&vec![33.0; n]).expect("finite");
        double.set_temperature(&vec![33.0; n]).expect("finite");
        let mut tau = [Vec::new(), Vec::new()];
        for k in 0..self.0[0].len() / n {
            let row = k * n..(k + 1) * n;
            let [q, dq, ddq] = self.0.each_ref().map(|values| &values[row.clone()]);
            let own = single.torque_after(step(k), q, dq, ddq).expect("a good sample");
            tau[0].extend(own.iter().map(|x| f64::from(*x)));
            let [q, dq, ddq] = self.1.each_ref().map(|values| &values[row.clone()]);
            tau[1].extend(double.torque_after(step(k), q, dq, ddq).expect("a good sample"));
        }
        tau
    }
}

/// Largest difference over the largest torque.
fn apart([single, double]: &[Vec<f64>; 2]) -> f64 {
    let largest = double.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
    single.iter().zip(double).fold(0.0f64, |most, (a, b)| most.max((a - b).abs())) / largest
}

#[test]
fn every_effect_streams_in_32_bits() {
    let robot = puma560();
    let rounded = Rounded::of(&Motion::new(robot.dof(), 3000));
    let mut largest = [0.0f64; 2];
    for effect in registry().iter().filter(|effect| effect.entry() != Entry::Gate) {
        for site in effect.sites(&robot) {
            let model = plain(&robot).with_terms(vec![term(effect, site)], Some(0));
            let apart = apart(&rounded.streamed(&model, 0.0, |_| 1.0 / RATE_HZ));
            // Second derivatives of a torque by differences cost digits.
            let (kind, bound) =
                if effect.streamed() == Streamed::Exactly { (0, 1e-6) } else { (1, 1e-4) };
            assert!(apart < bound, "{} at {site:?}: {apart:e}", effect.name());
            largest[kind] = largest[kind].max(apart);
        }
    }
    println!(
        "32 bits: {:.1e} of the largest torque, {:.1e} where it is differentiated",
        largest[0], largest[1]
    );
}

#[test]
fn many_effects_together_stream_in_32_bits_at_any_time_and_pace() {
    let robot = puma560();
    let rounded = Rounded::of(&Motion::new(robot.dof(), 3000));
    let mut terms = many_terms();
    let model = plain(&robot).with_terms(terms.clone(), Some(0));
    let apart_at = |model: &TorqueModel, start: f64, step: &dyn Fn(usize) -> f64| {
        apart(&rounded.streamed(model, start, step))
    };
    let even = |_: usize| 1.0 / RATE_HZ;
    let uneven = |k: usize| {
        (1.0 + 0.4 * (0.7 * k as f64).sin()) / RATE_HZ * if k % 500 == 499 { 20.0 } else { 1.0 }
    };
    assert!(apart_at(&model, 0.0, &even) < 2e-6);
    assert!(apart_at(&model, 0.0, &uneven) < 2e-6);
    // A fortnight on the clock of the session, where 32 bits would tell no tenth of a second apart.
    let late = 1.2e6;
    for term in &mut terms {
        for (constant, value) in term.effect.constants().iter().zip(&mut term.constants) {
            if constant.scale == Scale::Time {
                *value += late;
            }
        }
    }
    let model = plain(&robot).with_terms(terms, Some(0));
    assert!(apart_at(&model, late, &even) < 2e-6);
}

#[test]
fn saved_states_come_back_in_32_bits() {
    let robot = puma560();
    let Rounded(motion, _) = Rounded::of(&Motion::new(robot.dof(), 200));
    let model = plain(&robot).with_terms(many_terms(), Some(0));
    let mut predictor = StreamedModel::from(&model).single_predictor(&options()).expect("streams");
    let row =
        |k: usize| motion.each_ref().map(|values| &values[k * robot.dof()..(k + 1) * robot.dof()]);
    for k in 0..120 {
        let [q, dq, ddq] = row(k);
        predictor.torque(q, dq, ddq);
    }
    let mut states = SavedStates::default();
    predictor.save(&mut states);
    let go_on = |predictor: &mut Predictor<f32>| -> Vec<f32> {
        let mut torque = |[q, dq, ddq]: [&[f32]; 3]| predictor.torque(q, dq, ddq).to_vec();
        (120..200).flat_map(|k| torque(row(k))).collect()
    };
    let first = go_on(&mut predictor);
    predictor.restore(&states);
    assert_eq!(first, go_on(&mut predictor));
}

#[test]
fn bad_samples_are_refused_in_32_bits() {
    let model = StreamedModel::nominal(&two_link());
    let mut predictor = model.single_predictor(&StreamOptions::default()).expect("streams");
    let wrong = predictor.try_torque(&[0.0], &[0.0; 2], &[0.0; 2]);
    assert_eq!(wrong, Err(StreamError::Length { name: "q", found: 1, expected: 2 }));
    let wrong = predictor.try_torque(&[0.0, f32::INFINITY], &[0.0; 2], &[0.0; 2]);
    assert_eq!(wrong, Err(StreamError::NotFinite { name: "q", joint: 1, value: f64::INFINITY }));
    assert!(predictor.torque(&[f32::NAN; 2], &[0.0; 2], &[0.0; 2]).iter().all(|tau| tau.is_nan()));
}
