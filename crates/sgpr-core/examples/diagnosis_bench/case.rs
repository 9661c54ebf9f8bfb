//! A log with hidden effects, and what a model that is told of them leaves.

use std::f64::consts::TAU;

use sgpr_core::dynamics::Samples;
use sgpr_core::effects::{Scale, Site, by_name};
use sgpr_core::excitation::TrajectorySamples;
use sgpr_core::model::{Term, TorqueModel, Trajectory};
use sgpr_core::recording::Recording;
use sgpr_core::robot::Robot;

use crate::arm::{Motion, Random, arm};
use crate::closed_loop::{Plant, STEP, follow};
use crate::law::{FORMS, Law, State, UNKNOWN};

const BASE: [&str; 3] = ["viscous_friction", "coulomb_friction", "rotor_inertia"];

/// What the logs are like.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// 20 s each at 125 Hz or more, torque with white noise, encoders of 17 bits or more.
    Good,
    /// The noise of the torque has a memory (0.9 from sample to sample), and encoders have steps of
    /// 0.1 mrad.
    Rough,
    /// The same, 8 to 12 s each at 50 or 100 Hz.
    Poor,
}

/// Effects that are hidden one at a time, in turn.
///
/// Not `backlash`: play that is crossed in no time has no inverse dynamics, and the logs would be
/// full of spikes.
pub const SINGLES: [&str; 28] = [
    "viscous_friction",
    "coulomb_friction",
    "rotor_inertia",
    "stribeck_friction",
    "cable_stiffness",
    "torque_ripple",
    "quadratic_viscous_friction",
    "load_dependent_friction",
    "torque_offset",
    "wrist_coupling",
    "presliding_friction",
    "payload_change",
    "base_tilt",
    "friction_warmup",
    "torque_gain_error",
    "torque_delay",
    "encoder_offset",
    "link_length_error",
    "external_contact",
    "friction_step",
    "asymmetric_viscous_friction",
    "position_dependent_friction",
    "torque_offset_drift",
    "joint_elasticity",
    "cable_hysteresis",
    "nonlinear_viscous_friction",
    "torque_saturation",
    "spring_balancer",
];

/// Effects that the closed loop is simulated with.
pub const CLOSED: [&str; 8] = [
    "cable_stiffness",
    "torque_offset",
    "payload_change",
    "external_contact",
    "quadratic_viscous_friction",
    "asymmetric_viscous_friction",
    "position_dependent_friction",
    "coulomb_friction",
];

/// Pairs that are hidden at one joint.
pub const ONE_JOINT: [[&str; 2]; 6] = [
    ["stribeck_friction", "cable_stiffness"],
    ["torque_ripple", "load_dependent_friction"],
    ["quadratic_viscous_friction", "spring_balancer"],
    ["presliding_friction", "torque_ripple"],
    ["asymmetric_viscous_friction", "cable_stiffness"],
    ["position_dependent_friction", "torque_offset"],
];

/// Effects that are hidden in poor logs, and beside laws that no catalogue has.
pub const POOR: [&str; 12] = [
    "cable_stiffness",
    "torque_ripple",
    "stribeck_friction",
    "load_dependent_friction",
    "quadratic_viscous_friction",
    "asymmetric_viscous_friction",
    "viscous_friction",
    "coulomb_friction",
    "torque_offset",
    "torque_gain_error",
    "base_tilt",
    "position_dependent_friction",
];

/// How an arm moves in its logs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Style {
    /// Exactly as told, along series of five harmonics.
    Exact,
    /// The same, and what is hidden is at one joint.
    OneJoint,
    /// Under a controller, with friction that sticks.
    Closed,
    /// Exactly, but each joint with one frequency all the time, and what is hidden is small:
    /// effects look alike.
    Swinging,
}

/// Effects that look alike where each joint moves with one frequency.
pub const AMBIGUOUS: [&str; 12] = [
    "viscous_friction",
    "coulomb_friction",
    "rotor_inertia",
    "cable_stiffness",
    "quadratic_viscous_friction",
    "stribeck_friction",
    "load_dependent_friction",
    "position_dependent_friction",
    "nonlinear_viscous_friction",
    "cable_hysteresis",
    "asymmetric_viscous_friction",
    "torque_offset",
];

pub struct Case {
    pub name: String,
    pub guess: Robot,
    pub known: Vec<String>,
    pub train: Vec<Recording>,
    pub test: Vec<Recording>,
    /// The same logs without the hidden effects: what is left there is the floor.
    pub twin_train: Vec<Recording>,
    pub twin_test: Vec<Recording>,
    /// Effect and joint, none for the whole arm.
    pub hidden: Vec<(String, Option<usize>)>,
    /// If there are several: training and test logs with each of them alone, none for those of the
    /// base model.
    pub alone: Vec<Option<[Vec<Recording>; 2]>>,
    /// Whether a controller moves the arm: its twin moves otherwise, and sticks elsewhere.
    pub closed: bool,
    truth: Truth,
    sensors: Sensors,
}

impl Case {
    /// What is hidden, as terms of a model.
    pub fn terms(&self) -> Vec<Term> {
        let of_base = |(effect, joint): &(String, Option<usize>)| {
            let known = BASE.contains(&effect.as_str()).then(|| by_name(effect).ok())??;
            Some(Term::new(known, Site::Joint((*joint)?), vec![]))
        };
        self.hidden.iter().filter_map(of_base).chain(self.truth.terms.iter().cloned()).collect()
    }

    /// Constants and linear parameters of what is hidden.
    pub fn parameters(&self) -> Vec<f64> {
        let of_base = |(effect, joint): &(String, Option<usize>)| {
            let index = BASE.iter().position(|base| base == effect)?;
            Some(self.truth.base[index][(*joint)?])
        };
        let of_terms = self
            .truth
            .terms
            .iter()
            .flat_map(|term| term.constants.iter().chain(&term.coefficients));
        self.hidden.iter().filter_map(of_base).chain(of_terms.copied()).collect()
    }

    /// The log of a motion that begins at a time, s.
    pub fn record(&self, motion: TrajectorySamples, start: f64) -> Recording {
        let rate = 1.0 / (motion.time[1] - motion.time[0]);
        let motion = [motion.q, motion.dq, motion.ddq];
        let tau = torque(&self.truth, &motion, rate, start);
        let [q, dq, _] = motion;
        self.sensors.log(
            "next experiment".into(),
            [q, dq, tau],
            &self.truth,
            rate,
            start,
            &mut Random(start.to_bits()),
        )
    }
}

/// What the logs have of a motion and its torque.
struct Sensors {
    names: Vec<String>,
    /// Standard deviation of the torque, per joint.
    noise: Vec<f64>,
    /// Correlation of the noise of the torque from one sample to the next.
    memory: f64,
    /// Of the encoders, rad.
    resolution: f64,
}

impl Sensors {
    fn log(
        &self,
        source: String,
        [q, dq, mut tau]: [Vec<f64>; 3],
        truth: &Truth,
        rate: f64,
        start: f64,
        random: &mut Random,
    ) -> Recording {
        let (n, resolution) = (self.names.len(), self.resolution);
        let mut off = vec![0.0; n];
        for (k, tau) in tau.chunks_exact_mut(n).enumerate() {
            let fresh = if k == 0 { 1.0 } else { (1.0 - self.memory.powi(2)).sqrt() };
            for ((tau, off), noise) in tau.iter_mut().zip(&mut off).zip(&self.noise) {
                *off = self.memory * *off + fresh * noise * random.normal();
                *tau += *off;
            }
        }
        if let Some(limit) = truth.terms.iter().find(|t| t.effect.name() == "torque_saturation") {
            let joint = limit.site.joint().expect("at a joint");
            let own = tau.iter_mut().skip(joint).step_by(n);
            own.for_each(|tau| *tau = tau.clamp(-limit.constants[0], limit.constants[0]));
        }
        let q: Vec<f64> = q
            .iter()
            .map(|q| ((q + 0.2 * resolution * random.normal()) / resolution).round() * resolution)
            .collect();
        let dq: Vec<f64> = dq.iter().map(|dq| dq + 2e-3 * random.normal()).collect();
        let time =
            (0..q.len() / n).map(|k| ((start + k as f64 / rate) * 1e9).round() as i64).collect();
        Recording::new(source, self.names.clone(), time, q, Some(dq), Some(tau), vec![])
            .expect("whole arrays")
    }
}

struct Truth {
    robot: Robot,
    /// viscous, Coulomb, rotor: per joint.
    base: [Vec<f64>; 3],
    terms: Vec<Term>,
    /// Joint, its neighbour, the law and its factor.
    unknown: Option<(usize, usize, Law, f64)>,
}

/// Case number `seed` of a kind: the effects hidden in it, `[]` for none. Draws under which the arm
/// runs away are left out.
///
pub fn make(seed: u64, effects: &[&str], style: Style, quality: Quality) -> Case {
    let draws = (0..).map(|k| attempt(seed + 10_000_000 * k, effects, style, quality));
    draws.flatten().next().expect("an arm that follows")
}

fn attempt(seed: u64, effects: &[&str], style: Style, quality: Quality) -> Option<Case> {
    /// Farthest that an arm may be from what it is told, rad.
    const FARTHEST: f64 = 0.3;
    let mut random = Random(seed.wrapping_mul(0x5851_F42D_4C95_7F2D) ^ 0xD1A6);
    let robot = arm(&mut random);
    let n = robot.dof();
    let closed = style == Style::Closed;
    let poor = quality == Quality::Poor;
    let every = match poor {
        true => [20, 40][random.below(2)],
        false => [2usize, 4, 8, 16][random.below(4)].max(if closed { 4 } else { 2 }),
    };
    let length = if poor { random.between(8.0, 12.0) } else { 20.0 };
    let rate = 1.0 / (STEP * every as f64);
    let slow = random.between(3.0, 6.0);
    let motions: Vec<Motion> = match style {
        Style::Swinging => Motion::swinging(n, &mut random, 4),
        _ => [1.0, 1.0, slow, 1.0].iter().map(|s| Motion::new(n, &mut random, *s)).collect(),
    };
    let samples = (length * rate) as usize;

    // Torques of the rigid body set the sizes.
    let motion = sampled(&motions[0], rate, samples);
    let rigid = TorqueModel::nominal(&robot).predict(as_samples(&motion));
    let [size, speed, acceleration] = [&rigid, &motion[1], &motion[2]]
        .map(|values| (0..n).map(|j| rms(values, j, n)).collect::<Vec<f64>>());
    let mut base = [vec![], vec![], vec![]];
    for j in 0..n {
        base[0].push(random.between(0.05, 0.2) * size[j] / speed[j]);
        base[1].push(random.between(0.05, 0.25) * size[j]);
        base[2].push(random.between(0.05, 0.3) * size[j] / acceleration[j]);
    }
    let noise: Vec<f64> = size.iter().map(|s| s * random.logarithmic(0.003, 0.03)).collect();
    // Effects are a few times as large as this.
    let seen: Vec<f64> = noise
        .iter()
        .map(|noise| noise * if style == Style::Swinging { 0.6 } else { 1.0 })
        .collect();
    if style == Style::Swinging {
        for j in 0..n {
            let weak = seen[j] * random.logarithmic(1.0, 6.0);
            for (values, size) in base.iter_mut().zip([speed[j], 1.0, acceleration[j]]) {
                values[j] = weak / size;
            }
        }
    }
    let mut truth = Truth { robot: robot.clone(), base, terms: vec![], unknown: None };
    let mut known: Vec<String> = BASE.map(String::from).to_vec();
    let mut hidden = Vec::new();
    let mut used = vec![];
    for effect in effects {
        // The rotor of the first joint turns with its link.
        let is_hidden = |joint| used.contains(&joint) || (*effect == "rotor_inertia" && joint == 0);
        let mut joint = random.below(n);
        while style != Style::OneJoint && is_hidden(joint) {
            joint = random.below(n);
        }
        if let (Style::OneJoint, Some(first)) = (style, used.first()) {
            joint = *first;
        }
        used.push(joint);
        let wish = Wish { effect, joint, size: &size, noise: &seen, motion: &motion, rate };
        hide(&mut truth, &wish, &mut known, &mut hidden, &mut random);
    }
    let mut bare = Truth { robot, base: truth.base.clone(), terms: vec![], unknown: None };
    if let Some(k) = BASE.iter().position(|name| !known.iter().any(|known| known == name)) {
        bare.base[k].fill(0.0);
    }
    let guess = perturbed(&bare.robot, &mut random);
    let (seed_noise, resolution) = (random.0, TAU / f64::from(1u32 << (17 + random.below(4))));
    let names: Vec<String> = guess.joint_names().map(String::from).collect();
    let (memory, resolution) =
        if quality == Quality::Good { (0.0, resolution) } else { (0.9, 1e-4) };
    let sensors = Sensors { names, noise, memory, resolution };
    let record = |truth: &Truth| -> Option<Vec<Recording>> {
        let mut random = Random(seed_noise);
        let mut logs = Vec::new();
        for (index, motion) in motions.iter().enumerate() {
            let start = index as f64 * length;
            let [q, dq, tau] = if closed {
                let plant = Plant {
                    robot: &truth.robot,
                    viscous: &truth.base[0],
                    coulomb: &truth.base[1],
                    rotor: &truth.base[2],
                    terms: &truth.terms,
                };
                let log = follow(&plant, &guess, motion, start, length, every);
                let wanted = sampled(motion, rate, samples);
                let near =
                    log[0].iter().zip(&wanted[0]).all(|(q, wanted)| (q - wanted).abs() < FARTHEST);
                if !near {
                    return None;
                }
                log
            } else {
                let motion = sampled(motion, rate, samples);
                let tau = torque(truth, &motion, rate, start);
                let [q, dq, _] = motion;
                [q, dq, tau]
            };
            logs.push(sensors.log(
                format!("log {index}"),
                [q, dq, tau],
                truth,
                rate,
                start,
                &mut random,
            ));
        }
        Some(logs)
    };
    let mut train = record(&truth)?;
    let test = vec![train.pop().expect("four logs")];
    let (mut twin_train, twin_test);
    if effects.is_empty() {
        (twin_train, twin_test) = (train.clone(), test.clone());
    } else {
        twin_train = record(&bare)?;
        twin_test = vec![twin_train.pop().expect("four logs")];
    }
    let mut alone = vec![];
    let mut terms = truth.terms.iter();
    for effect in effects.iter().filter(|_| effects.len() > 1) {
        let of_catalogue = !BASE.contains(effect) && !UNKNOWN.iter().any(|law| law.name == *effect);
        let term = if of_catalogue { terms.next() } else { None };
        let logs = |term: &Term| -> Option<[Vec<Recording>; 2]> {
            let one = Truth {
                robot: bare.robot.clone(),
                base: bare.base.clone(),
                terms: vec![term.clone()],
                unknown: None,
            };
            let mut train = record(&one)?;
            let test = vec![train.pop().expect("four logs")];
            Some([train, test])
        };
        alone.push(match term {
            Some(term) => Some(logs(term)?),
            None => None,
        });
    }
    let name = format!("{}{seed}", if closed { "closed " } else { "" });
    Some(Case {
        name,
        guess,
        known,
        train,
        test,
        twin_train,
        twin_test,
        hidden,
        alone,
        closed,
        truth,
        sensors,
    })
}

fn sampled(motion: &Motion, rate: f64, samples: usize) -> [Vec<f64>; 3] {
    let mut out = [vec![], vec![], vec![]];
    for k in 0..samples {
        out.iter_mut().zip(motion.at(k as f64 / rate)).for_each(|(out, values)| out.extend(values));
    }
    out
}

/// Root mean square of a joint's values in `[samples, n]`.
fn rms(values: &[f64], joint: usize, n: usize) -> f64 {
    let own = values.iter().skip(joint).step_by(n);
    (own.map(|x| x * x).sum::<f64>() / (values.len() / n) as f64).sqrt()
}

/// What a joint has to turn with all others at zero and held, kg·m².
fn inertia(robot: &Robot, joint: usize) -> f64 {
    let zero = vec![0.0; robot.dof()];
    let mut unit = zero.clone();
    unit[joint] = 1.0;
    let torque = |ddq: &[f64]| {
        TorqueModel::nominal(robot).predict(Samples { q: &zero, dq: &zero, ddq })[joint]
    };
    torque(&unit) - torque(&zero)
}

fn as_samples(motion: &[Vec<f64>; 3]) -> Samples<'_> {
    Samples { q: &motion[0], dq: &motion[1], ddq: &motion[2] }
}

/// State of a joint at a sample.
fn state(motion: &[Vec<f64>; 3], sample: usize, n: usize, joint: usize) -> State {
    std::array::from_fn(|order| motion[order][sample * n + joint])
}

fn torque(truth: &Truth, motion: &[Vec<f64>; 3], rate: f64, start: f64) -> Vec<f64> {
    let n = truth.robot.dof();
    let mut parameters = truth.robot.standard_parameters();
    parameters.extend(truth.base.iter().flatten());
    let model = TorqueModel::with_parameters(&truth.robot, &BASE, parameters)
        .expect("effects of the library");
    let order: Vec<&str> =
        model.parameter_set().names()[10 * n..].iter().step_by(n).map(String::as_str).collect();
    assert_eq!(order, ["joint_1.Fv", "joint_1.Fc", "joint_1.Ia"]);
    let model = model.with_terms(truth.terms.clone(), Some(0));
    let samples = motion[0].len() / n;
    let time: Vec<f64> = (0..samples).map(|k| start + k as f64 / rate).collect();
    let trajectory = Trajectory::of_samples(as_samples(motion)).with_rate_hz(rate).with_time(&time);
    let mut tau = model.predict_trajectory(&trajectory);
    if let Some((joint, other, law, factor)) = truth.unknown {
        for k in 0..samples {
            tau[k * n + joint] +=
                factor * (law.torque)(state(motion, k, n, joint), state(motion, k, n, other));
        }
    }
    tau
}

struct Wish<'a> {
    effect: &'a str,
    joint: usize,
    size: &'a [f64],
    noise: &'a [f64],
    motion: &'a [Vec<f64>; 3],
    rate: f64,
}

fn hide(
    truth: &mut Truth,
    wish: &Wish<'_>,
    known: &mut Vec<String>,
    hidden: &mut Vec<(String, Option<usize>)>,
    random: &mut Random,
) {
    let Wish { effect, joint, size, noise, motion, rate } = wish;
    let (effect, joint, rate) = (*effect, *joint, *rate);
    let n = truth.robot.dof();
    if let Some(law) = UNKNOWN.into_iter().chain(FORMS).find(|law| law.name == effect) {
        let other = if joint + 1 < n { joint + 1 } else { joint - 1 };
        let samples = motion[0].len() / n;
        let plain = |k: usize| (law.torque)(state(motion, k, n, joint), state(motion, k, n, other));
        let rms = ((0..samples).map(|k| plain(k).powi(2)).sum::<f64>() / samples as f64).sqrt();
        truth.unknown =
            Some((joint, other, law, noise[joint] * random.logarithmic(1.5, 6.0) / rms.max(1e-9)));
        hidden.push((law.answer.into(), Some(joint)));
        return;
    }
    if let Some(index) = BASE.iter().position(|base| *base == effect) {
        known.retain(|name| name != effect);
        let value = truth.base[index][joint];
        truth.base[index].fill(0.0);
        truth.base[index][joint] = value;
        hidden.push((effect.into(), Some(joint)));
        return;
    }
    let found = by_name(effect).expect("an effect of the library");
    let site = match found.sites(&truth.robot).as_slice() {
        [Site::Arm] => Site::Arm,
        sites if sites.iter().any(|s| matches!(s, Site::Pair(..))) => {
            sites[random.below(sites.len())]
        }
        sites if sites.contains(&Site::Joint(joint)) => Site::Joint(joint),
        sites => sites[random.below(sites.len())],
    };
    let time = |random: &mut Random| random.between(12.0, 45.0);
    let constants = match effect {
        "stribeck_friction" => vec![random.logarithmic(0.02, 0.2)],
        "torque_ripple" => vec![random.between(8.0, 60.0).round()],
        "friction_warmup" => vec![random.logarithmic(8.0, 60.0)],
        "presliding_friction" => vec![random.logarithmic(0.002, 0.02)],
        "payload_change" | "friction_step" => vec![time(random)],
        "external_contact" => {
            let start = time(random);
            vec![start, start + random.between(2.0, 8.0)]
        }
        "base_tilt" => vec![
            random.sign() * random.between(0.02, 0.08),
            random.sign() * random.between(0.02, 0.08),
        ],
        "torque_gain_error" => vec![random.sign() * random.between(0.05, 0.15)],
        "torque_delay" => vec![random.between(0.003, 0.012)],
        "encoder_offset" => vec![random.sign() * random.between(0.03, 0.1)],
        "link_length_error" => (0..3).map(|_| random.between(-0.05, 0.05)).collect(),
        "joint_elasticity" => {
            // Nobody moves an arm near its resonance: that of the joint is at least four times as
            // fast as the motion.
            let stiffest = inertia(&truth.robot, joint)
                * (4.0 * rms(&motion[2], joint, n) / rms(&motion[1], joint, n)).powi(2);
            vec![(random.between(0.003, 0.015) / size[joint]).min(1.0 / stiffest)]
        }
        "cable_hysteresis" => vec![random.logarithmic(0.05, 0.4)],
        "nonlinear_viscous_friction" => vec![random.between(0.3, 0.7)],
        "torque_saturation" => vec![random.between(1.2, 1.7) * size[joint]],
        "spring_balancer" => vec![random.between(-2.5, 2.5), random.between(0.25, 0.9)],
        _ => vec![],
    };
    let wanted = found.constants().len();
    let constants = if constants.len() == wanted {
        constants
    } else {
        found.constants().iter().map(|c| c.grid.first().copied().unwrap_or(c.low)).collect()
    };
    let mut term = Term::new(found, site, constants);
    match effect {
        "payload_change" => {
            let mass = random.between(0.1, 0.5)
                * truth.robot.standard_parameters()[10 * (n - 1)].max(0.5)
                * 4.0;
            let centre: [f64; 3] = std::array::from_fn(|_| random.between(-0.1, 0.1));
            let [x, y, z] = centre;
            let i = 0.002 * mass;
            let values = [mass, mass * x, mass * y, mass * z];
            term.coefficients[..4].copy_from_slice(&values);
            let m = mass;
            term.coefficients[4..].copy_from_slice(&[
                i + m * (y * y + z * z),
                -m * x * y,
                i + m * (x * x + z * z),
                -m * x * z,
                -m * y * z,
                i + m * (x * x + y * y),
            ]);
        }
        "external_contact" => {
            term.coefficients
                .iter_mut()
                .for_each(|force| *force = random.sign() * random.between(5.0, 25.0));
        }
        _ => {
            let positive: Vec<bool> =
                term.effect.parameters().iter().map(|p| p.non_negative).collect();
            for (value, positive) in term.coefficients.iter_mut().zip(positive) {
                *value = if positive { 1.0 } else { random.sign() } * random.between(0.3, 1.0);
            }
            scale(&mut term, truth, motion, rate, noise, random);
        }
    }
    let named = if effect == "link_length_error" { None } else { site.joint() };
    hidden.push((effect.into(), named));
    truth.terms.push(term);
}

/// Makes the torque of a term a few times as large as the noise.
fn scale(
    term: &mut Term,
    truth: &Truth,
    motion: &[Vec<f64>; 3],
    rate: f64,
    noise: &[f64],
    random: &mut Random,
) {
    if term.coefficients.is_empty() {
        return;
    }
    let n = truth.robot.dof();
    // What begins at a moment has begun.
    let begins = term.effect.constants().iter().any(|constant| constant.scale == Scale::Time);
    let start = if begins { 50.0 } else { 10.0 };
    // Each column first as large as any other: parameters have different units.
    for k in 0..term.coefficients.len() {
        let mut single = term.clone();
        (0..single.coefficients.len())
            .filter(|j| *j != k)
            .for_each(|j| single.coefficients[j] = 0.0);
        let joint = term.site.joint().unwrap_or(0);
        let [with, without] = [vec![single], vec![]].map(|terms| {
            let truth = Truth {
                robot: truth.robot.clone(),
                base: truth.base.clone(),
                terms,
                unknown: None,
            };
            torque(&truth, motion, rate, start)
        });
        let squares: f64 =
            with.iter().zip(&without).skip(joint).step_by(n).map(|(a, b)| (a - b).powi(2)).sum();
        let rms = (squares / (with.len() / n) as f64).sqrt().max(1e-9);
        term.coefficients[k] *= noise[joint] * random.logarithmic(1.0, 6.0) / rms;
    }
}

/// A CAD guess: masses, centres of mass and inertias off by up to 15 %.
fn perturbed(robot: &Robot, random: &mut Random) -> Robot {
    let parameters = robot.standard_parameters();
    let off: Vec<f64> = parameters.iter().map(|p| p * random.between(0.85, 1.15)).collect();
    robot.clone().with_standard_parameters(&off)
}
