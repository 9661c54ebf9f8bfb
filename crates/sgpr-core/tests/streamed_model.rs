//! The file of a model as a controller reads it, which has a reader of its own for the format.
#![allow(missing_docs)]

use sgpr_core::effects::{Site, by_name};
use sgpr_core::model::{StreamOptions, StreamedModel, Term, TorqueModel};
use sgpr_core::robot::puma560;

fn model() -> TorqueModel {
    let robot = puma560();
    let mut parameters = robot.standard_parameters();
    parameters.extend((0..robot.dof()).map(|k| 0.3 + 0.05 * k as f64));
    let mut term = Term::new(
        by_name("presliding_friction").expect("of the library"),
        Site::Joint(1),
        vec![0.01],
    );
    term.coefficients.fill(0.7);
    let model =
        TorqueModel::with_parameters(&robot, &["coulomb_friction"], parameters).expect("known");
    model.with_terms(vec![term], Some(0))
}

fn refused(bytes: &[u8]) -> String {
    StreamedModel::from_bytes(bytes, "file").expect_err("no model").to_string()
}

#[test]
fn both_readers_give_the_same_bits() {
    let model = model();
    let options = StreamOptions::default().with_rate_hz(Some(100.0));
    let read = StreamedModel::from_bytes(&model.to_bytes(), "file").expect("just written");
    assert_eq!(read.parameters(), model.parameters());
    assert_eq!(read.robot(), model.identified_robot());
    assert_eq!(read.effect_names(), ["coulomb_friction", "presliding_friction"]);
    let (mut own, mut other) =
        (model.predictor(&options).expect("streams"), read.predictor(&options).expect("streams"));
    for k in 0..200 {
        let [q, dq, ddq] =
            [0.3, 1.1, 2.0].map(|scale: f64| [(scale * 0.05 * f64::from(k)).sin(); 6]);
        assert_eq!(own.torque(&q, &dq, &ddq), other.torque(&q, &dq, &ddq));
    }
}

#[test]
fn what_is_no_model_is_refused_with_its_reason() {
    let bytes = model().to_bytes();
    for length in (0..bytes.len()).step_by(7) {
        refused(&bytes[..length]);
    }
    let text = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len(), "lengths are part of the header");
        let at =
            bytes.windows(from.len()).position(|window| window == from.as_bytes()).expect("there");
        let mut changed = bytes.clone();
        changed[at..at + to.len()].copy_from_slice(to.as_bytes());
        refused(&changed)
    };
    assert!(
        text("sgpr torque model", "sgpr other models")
            .contains("its head says `sgpr other models`")
    );
    assert!(
        text("\\\"version\\\":1", "\\\"version\\\":9")
            .contains("has version 9, this library reads up to 1")
    );
    assert!(text("presliding_friction", "presliding_fraction").contains("presliding_fraction"));
    let mut huge = bytes.clone();
    huge[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(refused(&huge).contains("ends before its header does"));
    let mut not_a_number = bytes.clone();
    let last = not_a_number.len() - 8;
    not_a_number[last..].copy_from_slice(&f64::NAN.to_le_bytes());
    assert!(refused(&not_a_number).contains("NaN"));
}

#[test]
fn no_changed_byte_of_the_head_makes_a_panic() {
    let bytes = model().to_bytes();
    for at in (0..bytes.len()).step_by(11) {
        for byte in [0, b'"', b'9', 0xff] {
            let mut changed = bytes.clone();
            changed[at] = byte;
            // Some changes make another model, as of a name or of a number.
            let _ = StreamedModel::from_bytes(&changed, "file");
        }
    }
}
