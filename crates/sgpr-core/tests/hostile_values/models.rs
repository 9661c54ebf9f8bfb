//! Model files.

use sgpr_core::dynamics::Samples;
use sgpr_core::effects::{Site, registry};
use sgpr_core::gp::{Compute, Covariance, Data, GaussianProcess, Kernel, Shape};
use sgpr_core::model::{Term, TorqueModel, Trajectory};
use sgpr_core::recording::Channel;
use sgpr_core::robot::{Robot, puma560};
use sgpr_core::simulation::drives_from_model;

const SAMPLES: usize = 400;
const RATE_HZ: f64 = 100.0;

/// Numbers that a file may hold.
const VALUES: [f64; 12] =
    [0.0, -0.0, 1.0, -1.0, 1e-320, -1e-320, 1e-30, 1e9, -1e9, 1e30, 1e300, -1e300];

/// The bytes of a model with another head, of the length that its file says.
fn with_head(model: &TorqueModel, change: impl Fn(&mut serde_json::Value)) -> Vec<u8> {
    let bytes = model.to_bytes();
    let length = u64::from_le_bytes(bytes[..8].try_into().expect("eight bytes")) as usize;
    let mut header: serde_json::Value =
        serde_json::from_slice(&bytes[8..8 + length]).expect("a header");
    let entry = &mut header["__metadata__"]["sgpr"];
    let mut head: serde_json::Value =
        serde_json::from_str(entry.as_str().expect("text")).expect("a head");
    change(&mut head);
    *entry = head.to_string().into();
    let header = header.to_string().into_bytes();
    [&(header.len() as u64).to_le_bytes()[..], &header, &bytes[8 + length..]].concat()
}

fn identified() -> TorqueModel {
    let text = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../../data/demo/robot.urdf"))
        .expect("bundled");
    let text = String::from_utf8(text).expect("text");
    let robot = Robot::from_urdf_text(&text, "robot.urdf", &Default::default()).expect("a robot");
    let read = |name: &str| {
        let path = format!("{}/../../data/demo/{name}.csv.gz", env!("CARGO_MANIFEST_DIR"));
        sgpr_core::recording::csv::read(path, &Default::default()).expect("bundled").slice(0..1500)
    };
    sgpr_core::model::identify(&robot, &[read("train_1")], &Default::default(), &())
        .expect("a good log")
        .0
}

/// Everything that a model is asked for along a motion with time and channels.
fn ask(model: &TorqueModel) {
    let n = model.robot().dof();
    let wave = |rate: f64| -> Vec<f64> {
        (0..SAMPLES * n)
            .map(|k| rate * ((k / n) as f64 / RATE_HZ * (1.0 + (k % n) as f64)).sin())
            .collect()
    };
    let (q, dq, ddq) = (wave(1.0), wave(2.0), wave(5.0));
    let time: Vec<f64> = (0..SAMPLES).map(|k| k as f64 / RATE_HZ).collect();
    let channels = [Channel { name: "temperature".into(), values: vec![30.0; SAMPLES] }];
    let samples = Samples { q: &q, dq: &dq, ddq: &ddq };
    let known = Trajectory::of_samples(samples)
        .with_rate_hz(RATE_HZ)
        .with_time(&time)
        .with_channels(&channels);
    for trajectory in [known, Trajectory::of_samples(samples)] {
        assert_eq!(model.predict_trajectory(&trajectory).len(), q.len());
    }
    drop(drives_from_model(model));
}

#[test]
fn terms_with_any_constants_are_refused_or_predict() {
    let model = TorqueModel::nominal(&puma560());
    for effect in registry() {
        let Some(&site) = effect.sites(model.robot()).first() else { continue };
        let count = effect.constants().len();
        let neutral: Vec<f64> = effect
            .constants()
            .iter()
            .map(|constant| constant.grid.first().map_or(10.0, |value| *value))
            .collect();
        for value in VALUES {
            for place in 0..=count {
                // One constant, or all of them.
                let odd = |k: usize| if k == place || place == count { value } else { neutral[k] };
                let mut term = Term::new(effect.clone(), site, (0..count).map(odd).collect());
                term.coefficients.fill(0.1);
                let bytes = model.clone().with_terms(vec![term], Some(0)).to_bytes();
                match TorqueModel::from_bytes(&bytes, "odd.sgpr") {
                    Ok(model) => ask(&model),
                    Err(error) => assert!(error.to_string().contains(effect.name()), "{error}"),
                }
            }
        }
    }
}

#[test]
fn parameters_of_any_size_are_refused_or_predict() {
    let model = TorqueModel::nominal(&puma560());
    let effect = registry()
        .into_iter()
        .find(|effect| effect.name() == "coulomb_friction")
        .expect("of the library");
    for value in VALUES {
        let mut term = Term::new(effect.clone(), Site::Joint(0), vec![]);
        term.coefficients.fill(value);
        let bytes = model.clone().with_terms(vec![term], Some(i64::MIN)).to_bytes();
        if let Ok(model) = TorqueModel::from_bytes(&bytes, "odd.sgpr") {
            ask(&model);
            drop(model.session_time(&[i64::MAX]));
        }
    }
}

#[test]
fn processing_that_cannot_be_done_is_refused() {
    let model = identified();
    let refused = |change: &dyn Fn(&mut serde_json::Value)| {
        let bytes = with_head(&model, |head| change(&mut head["processing"]));
        TorqueModel::from_bytes(&bytes, "odd.sgpr").expect_err("cannot be done").to_string()
    };
    let number =
        |field: &'static str, value: f64| refused(&|processing| processing[field] = value.into());
    assert!(TorqueModel::from_bytes(&with_head(&model, |_| ()), "same.sgpr").is_ok());
    for value in [0.0, -1.0, 1e300] {
        let text = number("cutoff_hz", value);
        assert!(
            text.contains("odd.sgpr") && text.contains("its processing: cutoff_hz is"),
            "{text}"
        );
        assert!(number("torque_cutoff_hz", value).contains("its processing: torque_cutoff_hz is"));
    }
    for field in ["decimation", "order"] {
        for value in [0u64, 1 << 62] {
            let text = refused(&|processing| processing[field] = value.into());
            assert!(text.contains(&format!("its processing: {field} is {value}")), "{text}");
        }
    }
    for value in [-1.0, 1e9] {
        assert!(number("turn_margin", value).contains("its processing: turn_margin is"));
    }
    for list in [vec![], vec![-1.0; 6], vec![0.1; 7]] {
        let text = refused(&|processing| processing["standstill_speed"] = list.clone().into());
        assert!(text.contains("its processing: standstill_speed is"), "{text}");
    }
    for (window, degree) in [(u64::MAX, 2u64), (4, 2), (5, 5), (0, 0), (1 << 40 | 1, 3)] {
        let ways = serde_json::json!({"savitzky_golay": {"window": window, "degree": degree}});
        let text = refused(&|processing| processing["differentiation"] = ways.clone());
        assert!(text.contains("its processing:"), "{text}");
    }
    let text = refused(&|processing| {
        processing["differentiation"] = serde_json::json!({"central": {"accuracy": 3}})
    });
    assert!(text.contains("choose 2, 4, 6 or 8"), "{text}");
}

#[test]
fn figures_of_a_fit_are_of_its_joints_and_within_range() {
    let model = identified();
    let refused = |field: &str, value: serde_json::Value| {
        let bytes = with_head(&model, |head| head["fit"][field] = value.clone());
        TorqueModel::from_bytes(&bytes, "odd.sgpr").expect_err("no fit says it").to_string()
    };
    for field in ["noise", "rows", "correlation"] {
        let text = refused(field, serde_json::json!([1, 2]));
        assert!(
            text.contains("odd.sgpr") && text.contains(&format!("{field} is of 2 joints")),
            "{text}"
        );
    }
    for field in ["dispersion", "half_interval_95", "prior_standard_deviation"] {
        for value in [-1.0, 1e300] {
            assert!(refused(field, value.into()).contains(&format!("its fit: {field} is")));
        }
    }
    for value in [-1.0, 1e300] {
        let text = refused("prior", serde_json::json!({ "given": value }));
        assert!(text.contains("its fit:") && text.contains("prior"), "{text}");
    }
}

#[test]
fn a_cutoff_that_no_log_can_have_is_an_error() {
    for cutoff in [1e-300, 1e300] {
        let bytes =
            with_head(&identified(), |head| head["processing"]["cutoff_hz"] = cutoff.into());
        let text =
            TorqueModel::from_bytes(&bytes, "odd.sgpr").expect_err("no log has it").to_string();
        assert!(
            text.contains("odd.sgpr") && text.contains("cutoff_hz") && text.contains("Hz"),
            "{text}"
        );
    }
}

#[test]
fn processes_of_vanishing_variance_are_refused() {
    let data = || Data::new(vec![0.0, 0.0, 1.0], 1, vec![1.0, 2.0, 3.0], 1).expect("finite");
    let fit = |variance: f64, scale: f64, noise: f64| {
        let kernel = Kernel::isotropic(Shape::SquaredExponential, 1, scale).scaled(variance);
        GaussianProcess::fit(data(), Covariance::new(kernel, noise), &Compute::default())
    };
    for tiny in [5e-324, 1e-320, 1e-200, 0.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
        assert!(fit(tiny, 1.0, 0.0).is_err() && fit(1.0, tiny, 0.0).is_err(), "{tiny}");
    }
    for (variance, noise) in [(1e-150, 0.0), (1e150, 0.0), (1e-150, 1e150), (1.0, 1e-150)] {
        // An answer or an error, and an end.
        drop(fit(variance, 1.0, noise));
    }
}
