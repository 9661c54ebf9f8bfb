//! Motions that tell effects apart.

use super::super::answer::RATE_HZ;
use super::path::{JointLimits, Path, QUINTIC_PEAKS, quintic_time};
use crate::excitation::TrajectorySamples;
use crate::simulation::{Reference, SampledReference};

/// A motion to record, and what to do while recording it.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    /// What to do, in words.
    pub text: String,
    pub motion: TrajectorySamples,
    /// Whether it is recorded with a known payload.
    pub loaded: bool,
    /// Time after the end of the logs, s.
    pub later: f64,
}

/// What the arm did in the logs, and may do again.
#[derive(Clone, Debug)]
pub(super) struct Room {
    /// A pose of the logs, from which every motion starts.
    pub home: Vec<f64>,
    pub limits: Vec<JointLimits>,
    pub units: Vec<&'static str>,
    /// A piece of a log: rate, positions, velocities, accelerations, `[samples, n]`.
    pub piece: Option<(f64, [Vec<f64>; 3])>,
}

/// A warm machine: after so many seconds of motion.
const WARM_S: f64 = 1200.0;

/// The motions that come into question for a joint.
pub(super) fn plans(room: &Room, joint: usize, name: &str) -> Vec<Plan> {
    let limits = room.limits[joint];
    let mut plans = Vec::new();
    if limits.span() > 1e-3 && limits.speed > 0.0 && limits.acceleration > 0.0 {
        let own = LoneJoint { name, unit: room.units[joint], limits, start: room.home[joint] };
        let paths =
            [own.through_its_range(), own.at_constant_speeds(), own.by_small_steps(), own.shaken()];
        let plan = |(text, path)| Plan {
            text,
            motion: alone(room, joint, &path),
            loaded: false,
            later: 0.0,
        };
        plans.extend(paths.map(plan));
    }
    if let Some(piece) = &room.piece {
        plans.extend(repetitions(room, piece));
    }
    plans
}

/// A joint that moves alone.
struct LoneJoint<'a> {
    name: &'a str,
    unit: &'static str,
    limits: JointLimits,
    /// Position from which it moves, rad (m).
    start: f64,
}

impl LoneJoint<'_> {
    fn begin(&self) -> Path {
        Path::new(self.start, self.limits, RATE_HZ)
    }

    /// Position at a share of the range.
    fn at(&self, share: f64) -> f64 {
        self.limits.range[0] + share * self.limits.span()
    }

    fn through_its_range(&self) -> (String, Path) {
        let Self { name, unit, limits, .. } = self;
        let [low, high] = limits.range;
        let speed = (limits.span() / 12.0).min(0.3 * limits.speed);
        let mut path = self.begin();
        path.move_to(low, 0.7);
        path.hold(0.5);
        path.ramp_to(high, speed);
        path.hold(0.5);
        path.ramp_to(low, speed);
        path.hold(0.5);
        let text = format!(
            "move {name} slowly ({speed:.3} {unit}/s) through its range, {low:.2} to {high:.2} \
             {unit}, in both directions"
        );
        (text, path)
    }

    fn at_constant_speeds(&self) -> (String, Path) {
        let Self { name, unit, limits, .. } = self;
        let [low, high] = limits.range;
        let mut path = self.begin();
        let speeds = [0.02, 0.05, 0.12, 0.3, 0.6, 0.95].map(|share| share * limits.speed);
        for speed in speeds {
            // Slow runs are short ones: at most five seconds each way.
            let half = (0.5 * limits.span()).min(2.5 * speed);
            let middle = 0.5 * (low + high);
            path.move_to(middle - half, 0.7);
            path.hold(0.3);
            path.ramp_to(middle + half, speed);
            path.hold(0.3);
            path.ramp_to(middle - half, speed);
            path.hold(0.3);
        }
        let text = format!(
            "move {name} to and fro at constant speeds from {:.3} to {:.2} {unit}/s, as long in \
             both directions",
            speeds[0], speeds[5]
        );
        (text, path)
    }

    fn by_small_steps(&self) -> (String, Path) {
        let Self { name, unit, limits, .. } = self;
        let mut path = self.begin();
        for share in [0.25, 0.5, 0.75] {
            path.move_to(self.at(share), 0.7);
            for size in [0.004, 0.015, 0.06].map(|size: f64| size.min(0.1 * limits.span())) {
                for pace in [0.25, 1.0] {
                    // A swing takes a second, or a quarter of one.
                    let speed = (QUINTIC_PEAKS[0] * size * 4.0 * pace / limits.speed).min(1.0);
                    for side in [1.0, -1.0, 1.0, -1.0] {
                        path.move_to(self.at(share) + side * size, speed);
                    }
                    path.move_to(self.at(share), speed);
                }
            }
        }
        let places = [0.25, 0.5, 0.75].map(|share| format!("{:.2}", self.at(share))).join(", ");
        (
            format!(
                "reverse {name} again and again by small steps, slow and fast, at {places} {unit}"
            ),
            path,
        )
    }

    fn shaken(&self) -> (String, Path) {
        let Self { name, unit, limits, .. } = self;
        let mut path = self.begin();
        path.move_to(self.at(0.5), 0.7);
        path.hold(0.3);
        for (hz, periods) in [(0.3, 3), (0.7, 4), (1.5, 5), (3.0, 8), (5.0, 10)] {
            path.sine(hz, periods, 0.45 * limits.span());
            path.hold(0.2);
        }
        (
            format!("shake {name} about {:.2} {unit} with 0.3, 0.7, 1.5, 3 and 5 Hz", self.at(0.5)),
            path,
        )
    }
}

/// A piece of a log once more: slowly, with a payload, warm.
fn repetitions(room: &Room, (rate, [q, dq, ddq]): &(f64, [Vec<f64>; 3])) -> [Plan; 3] {
    let log = SampledReference::new(room.home.len(), *rate, q.clone(), dq.clone(), ddq.clone());
    let seconds = (q.len() / room.home.len() - 1) as f64 / rate;
    let plan = |text: &str, pace: f64, loaded: bool, later: f64| {
        let text = format!("repeat the beginning of the first log {text}");
        Plan { text, motion: replay(room, &log, seconds, pace), loaded, later }
    };
    [
        plan("at a sixth of its speed", 1.0 / 6.0, false, 0.0),
        plan("twice, without and with a known payload of 2 kg", 1.0, true, 0.0),
        plan("after twenty minutes of motion, on the same clock", 1.0, false, WARM_S),
    ]
}

/// One joint along a path and home again, the others at rest.
fn alone(room: &Room, joint: usize, path: &Path) -> TrajectorySamples {
    let mut path = path.clone();
    path.move_to(room.home[joint], 0.7);
    path.hold(0.5);
    let n = room.home.len();
    let mut samples = TrajectorySamples { time: vec![], q: vec![], dq: vec![], ddq: vec![] };
    for (k, [x, v, a]) in path.samples.iter().enumerate() {
        samples.time.push(k as f64 / path.rate_hz);
        let at = samples.q.len();
        samples.q.extend_from_slice(&room.home);
        samples.dq.resize(at + n, 0.0);
        samples.ddq.resize(at + n, 0.0);
        (samples.q[at + joint], samples.dq[at + joint], samples.ddq[at + joint]) = (*x, *v, *a);
    }
    samples
}

/// A log again at another pace, from home to home, its clock brought up to the pace as slowly as
/// accelerations ask for.
fn replay(room: &Room, log: &SampledReference, seconds: f64, pace: f64) -> TrajectorySamples {
    let n = room.home.len();
    let within = |samples: &TrajectorySamples| {
        let kept = |(k, ddq): (usize, &f64)| ddq.abs() <= room.limits[k % n].acceleration;
        samples.ddq.iter().enumerate().all(kept)
    };
    let mut motion = replay_with(room, log, seconds, pace, 1.0);
    for fade in [2.0, 4.0, 8.0] {
        if within(&motion) {
            break;
        }
        motion = replay_with(room, log, seconds, pace, fade);
    }
    motion
}

/// The same; the clock runs from rest to the pace, and to rest again, in `fade` seconds.
fn replay_with(
    room: &Room,
    log: &SampledReference,
    seconds: f64,
    pace: f64,
    fade: f64,
) -> TrajectorySamples {
    let n = room.home.len();
    let mut samples = TrajectorySamples { time: vec![], q: vec![], dq: vec![], ddq: vec![] };
    let (mut first, mut last) = (vec![0.0; n], vec![0.0; n]);
    let mut unused = [vec![0.0; n], vec![0.0; n]];
    let [a, b] = &mut unused;
    log.sample(0.0, &mut first, a, b);
    log.sample(seconds, &mut last, a, b);
    append_move(&mut samples, room, &room.home, &first);
    let total = seconds / pace + fade;
    let count = (total * RATE_HZ).ceil() as usize;
    let (mut q, mut dq, mut ddq) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    for k in 0..=count {
        let t = k as f64 / RATE_HZ;
        // Speed of the clock pace · (3 s² - 2 s³), whose integral is s³ - s⁴/2.
        let faded = |t: f64| {
            let s = (t / fade).clamp(0.0, 1.0);
            let past = (t - fade).max(0.0);
            let integral = fade * (s * s * s - 0.5 * s.powi(4)) + past;
            [pace * integral, pace * s * s * (3.0 - 2.0 * s), pace * 6.0 * s * (1.0 - s) / fade]
        };
        let [at, rate, change] = if t < 0.5 * total {
            faded(t)
        } else {
            let [left, rate, change] = faded((total - t).max(0.0));
            [seconds - left, rate, -change]
        };
        log.sample(at, &mut q, &mut dq, &mut ddq);
        samples.time.push(samples.time.len() as f64 / RATE_HZ);
        samples.q.extend_from_slice(&q);
        samples.dq.extend(dq.iter().map(|dq| dq * rate));
        samples.ddq.extend(dq.iter().zip(&ddq).map(|(dq, ddq)| ddq * rate * rate + dq * change));
    }
    append_move(&mut samples, room, &last, &room.home);
    samples
}

/// All joints from rest to rest together.
fn append_move(samples: &mut TrajectorySamples, room: &Room, from: &[f64], to: &[f64]) {
    /// Share of the largest speed and acceleration of the logs with which joints are moved from
    /// pose to pose.
    const SHARE: f64 = 0.5;
    let n = from.len();
    let own = |j: usize| {
        let limits = room.limits[j];
        quintic_time(
            to[j] - from[j],
            SHARE * limits.speed.max(1e-6),
            SHARE * limits.acceleration.max(1e-6),
        )
    };
    let seconds = (0..n).map(own).fold(0.5, f64::max);
    let rest = vec![0.0; n];
    let both = |values: [&[f64]; 2]| values.concat();
    // Between two samples at rest the reference is the quintic that is wanted.
    let way = SampledReference::new(
        n,
        1.0 / seconds,
        both([from, to]),
        both([&rest, &rest]),
        both([&rest, &rest]),
    );
    let (mut q, mut dq, mut ddq) = (rest.clone(), rest.clone(), rest);
    for k in 0..=(seconds * RATE_HZ).ceil() as usize {
        way.sample((k as f64 / RATE_HZ).min(seconds), &mut q, &mut dq, &mut ddq);
        samples.time.push(samples.time.len() as f64 / RATE_HZ);
        samples.q.extend_from_slice(&q);
        samples.dq.extend_from_slice(&dq);
        samples.ddq.extend_from_slice(&ddq);
    }
}
