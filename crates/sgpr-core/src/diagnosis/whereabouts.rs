//! Where the error sits.

use serde::{Deserialize, Serialize};

use super::fit::Fitted;
use super::problem::Problem;

/// Error energy in one cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Excess {
    /// The cell, in words.
    pub cell: String,
    /// Share of the joint's error energy.
    pub share: f64,
    /// Share of the joint's samples.
    pub samples: f64,
}

/// Where the error of each joint sits.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Whereabouts {
    /// Per joint: root mean square error in the band over the noise beyond it, and the
    /// autocorrelation of neighbours.
    pub joints: Vec<JointWhereabouts>,
}

/// Where the error of one joint sits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct JointWhereabouts {
    /// Joint.
    pub joint: String,
    /// Root mean square error in the band, N·m (N).
    pub rmse: f64,
    /// Correlation of the error with itself one row later: zero for white noise.
    pub correlation: f64,
    /// Two standard deviations of that correlation for white noise.
    pub correlation_band: f64,
    /// Cells with far more error than samples, largest first.
    pub cells: Vec<Excess>,
}

/// Cells by speed, position, time since reversal and time of the session.
pub(super) fn locate(problem: &Problem, fitted: &Fitted) -> Whereabouts {
    let n = problem.dof();
    let names: Vec<&str> = problem.nominal.robot().joint_names().collect();
    let mut joints = Vec::new();
    for joint in 0..n {
        let unit = problem.nominal.robot().joints()[joint].kind.position_unit();
        let residual = &fitted.residual[joint];
        let total: f64 = residual.iter().map(|r| r * r).sum();
        let count = residual.len().max(1) as f64;
        let run = &problem.run[joint];
        let (products, pairs) = (1..residual.len())
            .filter(|&k| run[k] > 0)
            .fold((0.0, 0.0), |(s, c), k| (s + residual[k] * residual[k - 1], c + 1.0));
        let at = |k: usize| {
            let (stretch, sample) = problem.rows[joint][k];
            (&problem.stretches[stretch], sample)
        };
        let speed = |k: usize| at(k).0.motion.dq[at(k).1 * n + joint];
        let position = |k: usize| at(k).0.motion.q[at(k).1 * n + joint];
        let top = (0..residual.len()).map(|k| speed(k).abs()).fold(1e-12, f64::max);
        let [low, high] = problem.range(joint);
        let mut cells: Vec<Excess> = Vec::new();
        let mut cell = |name: String, inside: &dyn Fn(usize) -> bool| {
            let (energy, samples) = (0..residual.len())
                .filter(|&k| inside(k))
                .fold((0.0, 0.0), |(e, s), k| (e + residual[k].powi(2), s + 1.0));
            cells.push(Excess {
                cell: name,
                share: energy / total.max(1e-300),
                samples: samples / count,
            });
        };
        for (from, to) in [(0.0, 0.01), (0.01, 0.05), (0.05, 0.2), (0.2, 1.01)] {
            let inside = |k: usize| (from..to).contains(&(speed(k).abs() / top));
            cell(
                format!("speed {:.3} to {:.3} {unit}/s", from * top, f64::min(to, 1.0) * top),
                &inside,
            );
        }
        cell("moving forwards".into(), &|k| speed(k) > 0.0);
        cell("moving backwards".into(), &|k| speed(k) < 0.0);
        for part in 0..6 {
            let edge = |part: usize| low + (high - low) * part as f64 / 6.0;
            let inside = |k: usize| position(k) >= edge(part) && position(k) < edge(part + 1);
            cell(format!("position {:.2} to {:.2} {unit}", edge(part), edge(part + 1)), &inside);
        }
        if problem.clock.is_some() {
            let [start, end] = problem.time_span();
            for part in 0..6 {
                let edge = |part: usize| start + (end - start) * part as f64 / 6.0;
                let inside = |k: usize| {
                    let time = problem.time_of(problem.rows[joint][k]);
                    time >= edge(part) && time < edge(part + 1)
                };
                cell(format!("time {:.1} to {:.1} s", edge(part), edge(part + 1)), &inside);
            }
        }
        cells.retain(|c| c.samples > 0.002 && c.share > 1.3 * c.samples && c.share > 0.05);
        cells.sort_by(|a, b| (b.share / b.samples).total_cmp(&(a.share / a.samples)));
        joints.push(JointWhereabouts {
            joint: names[joint].into(),
            rmse: (total / count).sqrt(),
            correlation: products / f64::max(pairs, 1.0) / (total / count).max(1e-300),
            correlation_band: 2.0 / f64::max(pairs, 1.0).sqrt(),
            cells,
        });
    }
    Whereabouts { joints }
}
