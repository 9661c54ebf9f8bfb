//! What a motion must not touch, and how fast its tool may go.

use derive_setters::Setters;

use super::ExcitationError;
use crate::dynamics::{Workspace, forward_kinematics, jacobian};
use crate::robot::{Frame, Robot};
use crate::spatial::Vector3;

/// All points within `radius` of a segment: the shape of a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Capsule {
    /// Joint whose link it is, `None` for the base.
    pub joint: Option<usize>,
    /// Ends of the segment, in the link's frame, m.
    pub ends: [Vector3<f64>; 2],
    /// m.
    pub radius: f64,
}

/// A box along the base axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Block {
    /// Lowest corner, m.
    pub low: [f64; 3],
    /// Highest corner, m.
    pub high: [f64; 3],
}

/// The cell around an arm.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Surroundings {
    /// Shapes of the links.
    pub capsules: Vec<Capsule>,
    /// Height of the floor in base axes, m.
    pub floor: Option<f64>,
    /// Obstacles.
    pub blocks: Vec<Block>,
    /// Whether links that are no neighbours must stay clear of each other.
    pub self_collision: bool,
    /// Distance that is kept from everything, m.
    pub clearance: f64,
    /// Highest speed of the origin of a frame, m/s.
    pub tip_speed: Option<(Frame, f64)>,
}

/// Distance over which a broken clearance counts as a whole limit, m.
const SCALE: f64 = 0.1;

impl Surroundings {
    /// Links as capsules of one radius along the robot's skeleton: from each joint to the joints
    /// and frames that its link carries. Nothing around it yet.
    pub fn skeleton(robot: &Robot, radius: f64) -> Self {
        let mut capsules = Vec::new();
        let mut add = |joint: usize, end: Vector3<f64>| {
            if end.norm() > 1e-6 {
                capsules.push(Capsule { joint: Some(joint), ends: [Vector3::ZERO, end], radius });
            }
        };
        for joint in robot.joints() {
            if let Some(parent) = joint.parent {
                add(parent, joint.placement.translation);
            }
        }
        for frame in robot.frames() {
            let leaf =
                |joint: usize| robot.joints().iter().all(|other| other.parent != Some(joint));
            if let Some(joint) = frame.joint.filter(|joint| leaf(*joint)) {
                add(joint, frame.pose.translation);
            }
        }
        Self {
            capsules,
            floor: None,
            blocks: vec![],
            self_collision: false,
            clearance: 0.0,
            tip_speed: None,
        }
    }

    pub(super) fn require_valid(&self) -> Result<(), ExcitationError> {
        let invalid = |option, value, expected| {
            Err(ExcitationError::InvalidOption { option, value, expected })
        };
        if let Some(capsule) =
            self.capsules.iter().find(|c| !c.radius.is_finite() || c.radius < 0.0)
        {
            return invalid("radius of a capsule", capsule.radius, "a length, not below zero");
        }
        if !self.clearance.is_finite() || self.clearance < 0.0 {
            return invalid("clearance", self.clearance, "a length, not below zero");
        }
        if let Some(floor) = self.floor.filter(|floor| !floor.is_finite()) {
            return invalid("floor", floor, "a height");
        }
        for block in &self.blocks {
            let mut ends = block.low.iter().zip(&block.high);
            if let Some((_, high)) =
                ends.find(|(low, high)| !(low < high && low.is_finite() && high.is_finite()))
            {
                return invalid(
                    "highest corner of a box",
                    *high,
                    "a number above that of the lowest corner",
                );
            }
        }
        match &self.tip_speed {
            Some((_, limit)) if !limit.is_finite() || *limit <= 0.0 => {
                invalid("tip speed", *limit, "above zero")
            }
            _ => Ok(()),
        }
    }

    /// Number of shares that [`Checker::shares`] gives.
    fn checks(&self, robot: &Robot) -> usize {
        let obstacles = usize::from(self.floor.is_some()) + self.blocks.len();
        self.capsules.len() * obstacles
            + self.pairs(robot).len()
            + usize::from(self.tip_speed.is_some())
    }

    /// Capsules of links that are neither the same nor neighbours.
    fn pairs(&self, robot: &Robot) -> Vec<(usize, usize)> {
        if !self.self_collision {
            return vec![];
        }
        let parent = |joint: Option<usize>| joint.and_then(|joint| robot.joints()[joint].parent);
        let apart = |a: Option<usize>, b: Option<usize>| a != b && parent(a) != b && parent(b) != a;
        let all = (0..self.capsules.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
        all.filter(|&(a, b)| apart(self.capsules[a].joint, self.capsules[b].joint)).collect()
    }
}

/// Surroundings with the buffers to check them.
#[derive(Debug)]
pub(super) struct Checker<'a> {
    robot: &'a Robot,
    surroundings: &'a Surroundings,
    pairs: Vec<(usize, usize)>,
    ws: Workspace,
    segments: Vec<[Vector3<f64>; 2]>,
}

impl<'a> Checker<'a> {
    pub fn new(robot: &'a Robot, surroundings: &'a Surroundings) -> Self {
        let pairs = surroundings.pairs(robot);
        Self { robot, surroundings, pairs, ws: Workspace::new(robot), segments: Vec::new() }
    }

    /// Number of shares.
    pub fn len(&self) -> usize {
        self.surroundings.checks(self.robot)
    }

    /// How much of each limit a state uses; one or less where it is kept.
    pub fn shares(&mut self, q: &[f64], dq: &[f64], out: &mut [f64]) {
        let cell = self.surroundings;
        let poses = forward_kinematics(self.robot, &mut self.ws, q);
        self.segments.clear();
        self.segments.extend(cell.capsules.iter().map(|capsule| {
            capsule
                .ends
                .map(|end| capsule.joint.map_or(end, |joint| poses[joint].transform_point(end)))
        }));
        let share = |distance: f64| 1.0 + (cell.clearance - distance) / SCALE;
        let mut out = out.iter_mut();
        let mut put = |value: f64| *out.next().expect("one place per check") = value;
        for (capsule, segment) in cell.capsules.iter().zip(&self.segments) {
            if let Some(floor) = cell.floor {
                put(share(segment[0].z.min(segment[1].z) - capsule.radius - floor));
            }
            for block in &cell.blocks {
                put(share(to_block(*segment, block) - capsule.radius));
            }
        }
        for &(a, b) in &self.pairs {
            let radii = cell.capsules[a].radius + cell.capsules[b].radius;
            put(share(between(self.segments[a], self.segments[b]) - radii));
        }
        if let Some((frame, limit)) = &cell.tip_speed {
            let j = jacobian(self.robot, &mut self.ws, q, frame);
            let n = dq.len();
            let speed = |axis: usize| (0..n).map(|k| j[axis * n + k] * dq[k]).sum::<f64>();
            put((0..3).map(|axis| speed(axis).powi(2)).sum::<f64>().sqrt() / limit);
        }
    }

    /// What the check of share `index` is about.
    pub fn name(&self, index: usize) -> String {
        let cell = self.surroundings;
        let of = |capsule: usize| {
            let joint = cell.capsules[capsule].joint;
            joint.map_or("the base".to_string(), |joint| {
                format!("link of joint `{}`", self.robot.joints()[joint].name)
            })
        };
        let obstacles = usize::from(cell.floor.is_some()) + cell.blocks.len();
        if index < cell.capsules.len() * obstacles {
            let (capsule, obstacle) = (index / obstacles, index % obstacles);
            let what = match obstacle.checked_sub(usize::from(cell.floor.is_some())) {
                None => "the floor".to_string(),
                Some(block) => format!("box {}", block + 1),
            };
            return format!("distance of the {} from {what}, m", of(capsule));
        }
        match self.pairs.get(index - cell.capsules.len() * obstacles) {
            Some(&(a, b)) => format!("distance of the {} from the {}, m", of(a), of(b)),
            None => "speed of the tip, m/s".into(),
        }
    }

    /// The quantity behind a share, and its limit.
    pub fn quantity(&self, index: usize, share: f64) -> (f64, f64) {
        match &self.surroundings.tip_speed {
            Some((_, limit)) if index + 1 == self.len() => (share * limit, *limit),
            _ => (self.surroundings.clearance - (share - 1.0) * SCALE, self.surroundings.clearance),
        }
    }
}

/// Distance of a segment from a box; the distance of a point on the segment is a convex function of
/// its place.
fn to_block([from, to]: [Vector3<f64>; 2], block: &Block) -> f64 {
    let at = |s: f64| {
        let point = (from + (to + -from) * s).to_array();
        let outside =
            (0..3).map(|k| (block.low[k] - point[k]).max(point[k] - block.high[k]).max(0.0));
        let distance = outside.map(|d| d * d).sum::<f64>().sqrt();
        if distance > 0.0 {
            return distance;
        }
        // Inside: minus the way out.
        -(0..3)
            .map(|k| (point[k] - block.low[k]).min(block.high[k] - point[k]))
            .fold(f64::INFINITY, f64::min)
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..40 {
        let (a, b) = (low + (high - low) * 0.382, low + (high - low) * 0.618);
        if at(a) < at(b) { high = b } else { low = a }
    }
    at(0.5 * (low + high)).min(at(0.0)).min(at(1.0))
}

/// Distance of two segments.
///
/// Source: C. Ericson, Real-Time Collision Detection (2005), section 5.1.9.
fn between([p1, q1]: [Vector3<f64>; 2], [p2, q2]: [Vector3<f64>; 2]) -> f64 {
    let (d1, d2, r) = (q1 + -p1, q2 + -p2, p1 + -p2);
    let (a, e, f) = (d1.dot(d1), d2.dot(d2), d2.dot(r));
    let (c, b) = (d1.dot(r), d1.dot(d2));
    let denominator = a * e - b * b;
    let mut s = if denominator > 1e-12 * a * e {
        ((b * f - c * e) / denominator).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let mut t = if e > 0.0 { (b * s + f) / e } else { 0.0 };
    if !(0.0..=1.0).contains(&t) {
        t = t.clamp(0.0, 1.0);
        s = if a > 0.0 { ((b * t - c) / a).clamp(0.0, 1.0) } else { 0.0 };
    }
    (p1 + d1 * s + -(p2 + d2 * t)).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{puma560, two_link};

    #[test]
    fn distances_are_those_of_dense_samples() {
        let point =
            |k: f64| Vector3::new((1.7 * k).sin(), (2.3 * k + 0.4).cos(), (0.9 * k + 1.0).sin());
        let block = Block { low: [0.2, -0.3, 0.1], high: [0.9, 0.4, 0.5] };
        for k in 0..200 {
            let k = f64::from(k);
            let (a, b) =
                ([point(k), point(k + 0.31)], [point(2.0 * k + 5.0), point(k * 1.1 + 9.0)]);
            let along = |[p, q]: [Vector3<f64>; 2], s: f64| p + (q + -p) * s;
            let (mut least, mut to_box) = (f64::INFINITY, f64::INFINITY);
            for i in 0..=100 {
                let from = along(a, f64::from(i) / 100.0);
                let v = from.to_array();
                let outside = (0..3)
                    .map(|k| (block.low[k] - v[k]).max(v[k] - block.high[k]).max(0.0).powi(2));
                to_box = to_box.min(outside.sum::<f64>().sqrt());
                for j in 0..=100 {
                    least = least.min((from + -along(b, f64::from(j) / 100.0)).norm());
                }
            }
            let found = between(a, b);
            assert!(found <= least + 1e-12 && found > least - 0.03, "{found} {least}");
            let found = to_block(a, &block);
            assert!(
                found <= to_box + 1e-9 && (found > to_box - 0.02 || found < 0.0),
                "{found} {to_box}"
            );
        }
    }

    #[test]
    fn a_stretched_arm_is_as_far_from_things_as_it_looks() {
        let robot = two_link();
        let mut cell = Surroundings::skeleton(&robot, 0.1);
        assert_eq!(cell.capsules.len(), 2);
        cell.floor = Some(-0.5);
        cell.blocks.push(Block { low: [2.3, -1.0, -1.0], high: [3.0, 1.0, 1.0] });
        let tip = robot.frames().last().expect("a tool frame").clone();
        cell.tip_speed = Some((tip, 4.0));
        let mut checker = Checker::new(&robot, &cell);
        let mut shares = vec![0.0; checker.len()];
        checker.shares(&[0.0; 2], &[1.0, 0.0], &mut shares);
        let distance = |share: f64| (1.0 - share) * SCALE;
        assert!((distance(shares[0]) - 0.4).abs() < 1e-12, "floor");
        assert!((distance(shares[3]) - 0.2).abs() < 1e-9, "box");
        assert!((shares[4] - 0.5).abs() < 1e-12, "2 m/s of 4");
        assert_eq!(checker.name(3), "distance of the link of joint `joint_2` from box 1, m");
        assert!(Surroundings::skeleton(&puma560(), 0.05).capsules.len() >= 3);
    }
}
