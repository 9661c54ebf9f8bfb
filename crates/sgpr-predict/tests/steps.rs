//! Steps that are too short for a torque that is late or early.
#![allow(missing_docs)]

use sgpr_predict::effects::{Site, by_name};
use sgpr_predict::model::{StreamedModel, Term};
use sgpr_predict::robot::two_link;
use sgpr_predict::stream::{StreamError, StreamOptions};

#[test]
fn steps_below_half_a_period_are_refused_beside_a_delay_of_either_sign() {
    let options = StreamOptions::default().with_rate_hz(Some(100.0));
    let still = [0.0; 2];
    for (delay, refused) in [(0.02, true), (-0.02, true), (0.0, false)] {
        let term =
            Term::new(by_name("torque_delay").expect("of the library"), Site::Arm, vec![delay]);
        let model = StreamedModel::nominal(&two_link()).with_terms(vec![term]);
        let mut predictor = model.predictor(&options).expect("streams");
        predictor.torque(&still, &still, &still);
        let short = predictor.torque_after(0.004, &still, &still, &still).map(<[f64]>::to_vec);
        let expected = StreamError::StepTooShort { found: 0.004, shortest: 0.005 };
        assert_eq!(short == Err(expected), refused, "a delay of {delay} s: {short:?}");
        predictor.torque_after(0.006, &still, &still, &still).expect("long enough");
    }
}
