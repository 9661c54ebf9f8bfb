use alloc::string::ToString;
use alloc::vec::Vec;

use super::*;
use crate::robot::{Robot, puma560};

fn with_context<R>(robot: &Robot, run: impl FnOnce(&Context<'_>) -> R) -> R {
    let n = robot.dof();
    let samples = 200;
    let (mut q, mut dq, mut ddq, mut torque) = (vec![], vec![], vec![], vec![]);
    let time: Vec<f64> = (0..samples).map(|k| k as f64 * 0.01).collect();
    for t in &time {
        for joint in 0..n {
            let w = 1.0 + 0.3 * joint as f64;
            q.push((w * t).sin());
            dq.push(w * (w * t).cos());
            ddq.push(-w * w * (w * t).sin());
            torque.push((2.0 * w * t).cos() - 0.2);
        }
    }
    let temperature = Channel { name: "temperature".into(), values: vec![31.0; samples] };
    run(&Context {
        robot,
        rate_hz: 100.0,
        time: &time,
        q: &q,
        dq: &dq,
        ddq: &ddq,
        rigid_torque: &torque,
        torque: &torque,
        channels: &[temperature],
    })
}

/// A value of each constant at which the effect does something.
fn some_constants(effect: &dyn Effect) -> Vec<f64> {
    let value = |constant: &Constant| match constant.scale {
        Scale::Time if constant.symbol == "t1" => 1.6,
        Scale::Time => 0.7,
        Scale::Order => 12.0,
        Scale::Neutral { step } => 20.0 * step,
        Scale::Torque => 0.5,
        _ => constant.grid[0],
    };
    effect.constants().iter().map(value).collect()
}

/// Every effect is asked the same questions.
#[test]
fn every_effect_keeps_the_contract() {
    let robot = puma560();
    for effect in registry() {
        let name = effect.name();
        let about = effect.about();
        assert!(name.chars().all(|c| c.is_ascii_lowercase() || c == '_'), "{name}");
        assert!(effect.summary().ends_with('.'), "{name}: a sentence ends with a stop");
        assert_eq!(by_name(name).expect("registered").name(), name);
        assert!(
            !about.source.is_empty() && !about.signature.is_empty() && !about.experiment.is_empty(),
            "{name}"
        );
        assert!(
            about.source.chars().any(|c| c.is_ascii_digit()) || effect.entry() == Entry::Gate,
            "{name}: a year"
        );
        for other in about.confusable.iter().chain(about.alias_of.as_ref()) {
            assert!(by_name(other).is_ok() && *other != name, "{name}: {other}");
        }
        if effect.entry() == Entry::Gate {
            continue;
        }
        assert!(
            effect.entry() == Entry::Transform || effect.steps(),
            "{name} takes no memory when it is streamed"
        );
        assert!(!about.formula.is_empty() && !about.excitation.is_empty(), "{name}");
        assert!(!effect.parameters().is_empty() || !effect.constants().is_empty(), "{name}");
        for constant in effect.constants() {
            assert!(constant.low < constant.high, "{name}");
            assert!(
                constant.grid.iter().all(|x| (constant.low..=constant.high).contains(x)),
                "{name}"
            );
        }
        for site in effect.sites(&robot) {
            with_context(&robot, |context| act(effect.as_ref(), site, context));
        }
    }
}

fn act(effect: &dyn Effect, site: Site, context: &Context<'_>) {
    let name = effect.name();
    let constants = some_constants(effect);
    let (samples, n) = (context.len(), context.dof());
    if effect.entry() == Entry::Transform {
        let robot = effect.robot(site, &constants, context.robot.clone());
        let mut motion = LinkMotion {
            q: context.q.to_vec(),
            dq: context.dq.to_vec(),
            ddq: context.ddq.to_vec(),
        };
        let measured = motion.clone();
        effect.link_motion(site, &constants, context, &mut motion);
        let mut torque = context.torque.to_vec();
        (0..n).for_each(|joint| {
            let mut column: Vec<f64> = context.of_joint(context.torque, joint).collect();
            effect.transmit(site, &constants, joint, 100.0, &mut column, 1);
            torque.iter_mut().skip(joint).step_by(n).zip(column).for_each(|(to, from)| *to = from);
        });
        let limited = (0..n).any(|joint| effect.limit(site, &constants, joint).is_some());
        let moved = motion != measured;
        assert_eq!(moved, effect.moves_links(), "{name}");
        assert!(motion.ddq.iter().chain(&torque).all(|x| x.is_finite()), "{name}");
        assert!(
            robot != *context.robot || moved || torque != context.torque || limited,
            "{name} does nothing"
        );
        return;
    }
    let length = if effect.reach() == Reach::All { samples * n } else { samples };
    let mut out = vec![vec![0.0; length]; effect.parameters().len()];
    effect.trajectory_columns(site, context, &constants, &mut out);
    let mut stepped = out.clone();
    stepping::columns_by_steps(effect, site, context, &constants, &mut stepped);
    let largest = out.iter().flatten().fold(0.0f64, |largest, x| largest.max(x.abs()));
    for (column, stepped) in out.iter().zip(&stepped) {
        let close = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-12 * largest;
        assert!(
            column.iter().zip(stepped).all(close),
            "{name}: steps are not the columns of the trajectory"
        );
    }
    assert!(
        out.iter().all(|column| column.len() == length && column.iter().all(|x| x.is_finite())),
        "{name}"
    );
    assert!(
        out.iter().any(|column| column.iter().any(|x| *x != 0.0)),
        "{name} {site:?} does nothing"
    );
    if effect.entry() == Entry::State {
        let mut at_rest = vec![f64::NAN; effect.parameters().len()];
        let zeros = vec![0.0; n];
        let state = JointState { q: &zeros, dq: &zeros, ddq: &zeros };
        effect.columns(1, &state, &mut at_rest);
        let constant = ["torque_offset", "cable_stiffness"].contains(&name);
        assert_eq!(
            at_rest.iter().any(|c| *c != 0.0),
            constant,
            "{name}: at rest only an offset acts"
        );
        for dq in [-1e-12, 0.0, 1e-12] {
            effect.columns(1, &JointState { q: &zeros, dq: &[dq; 6], ddq: &zeros }, &mut at_rest);
            assert!(at_rest.iter().all(|c| c.is_finite()), "{name}");
        }
    }
}

#[test]
fn a_delay_shifts_and_a_lag_trails() {
    let sine: Vec<f64> = (0..400).map(|k| (0.05 * f64::from(k)).sin()).collect();
    let mut late = sine.clone();
    columns::shift(&mut late, 1, 2.5);
    let mut trailing = sine.clone();
    columns::lag(&mut trailing, 1, 2.5);
    let ramp: Vec<f64> = (0..100).map(f64::from).collect();
    let mut slow = ramp.clone();
    columns::lag(&mut slow, 1, 2.5);
    for k in 10..390 {
        assert!((late[k] - (0.05 * (k as f64 - 2.5)).sin()).abs() < 1e-6);
        // Of a slow sine a first-order lag makes a delay.
        assert!((trailing[k] - (0.05 * (k as f64 - 2.5)).sin()).abs() < 2e-2);
    }
    assert!((slow[90] - (90.0 - 2.5)).abs() < 1e-9, "a ramp trails by the time constant");
}

#[test]
fn an_unknown_name_says_where_the_known_ones_are() {
    let error = by_name("stiction").expect_err("not there");
    assert!(error.known.iter().any(|name| name == "coulomb_friction"));
    let message = error.to_string();
    assert!(message.contains("`stiction`") && message.contains("`sgpr effects`"), "{message}");
    // A few can be read in the message.
    let few = UnknownEffect { known: vec!["coulomb_friction".into()], ..error };
    assert!(few.to_string().contains("coulomb_friction"), "{few}");
}
