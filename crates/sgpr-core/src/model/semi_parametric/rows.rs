//! The rows of a joint that a process is learned from, and what is left out of them in turn.

use faer::Mat;

/// Residual of a joint at the samples in which it moves.
pub(super) struct ResidualRows {
    /// `[rows, 3 n + 1]`: q, dq, ddq, time (s); logs lie far apart in time.
    pub x: Vec<f64>,
    /// Measured minus predicted in the band of the model, N·m (N).
    pub residual: Vec<f64>,
    /// Recording stretch and sample of each.
    pub source: Vec<(usize, usize)>,
    /// Derivatives by the linear parameters, `[rows, unknowns]`, if these are estimated together
    /// with the processes.
    pub terms: Option<Mat<f64>>,
}

impl ResidualRows {
    /// x of some rows, `[chosen, inputs]`, row-major.
    pub fn at(&self, chosen: &[usize], inputs: usize) -> Vec<f64> {
        chosen.iter().flat_map(|row| &self.x[row * inputs..(row + 1) * inputs]).copied().collect()
    }
}

/// Rows of a joint and, for every part that is left out in turn, what physics identified without
/// that part leaves over at all of them.
pub(super) struct LeftOutRows {
    /// Rows, in order.
    pub part: Vec<usize>,
    pub residual: Vec<f64>,
    /// What the uncertain parameters of that physics bring to the torque at the part, N²·m² (N²).
    pub variance: Vec<f64>,
}

impl LeftOutRows {
    /// What the physics leaves over at the part.
    pub fn measured(&self) -> impl Iterator<Item = f64> {
        self.part.iter().map(|&row| self.residual[row])
    }
}

/// What is left out of a joint's rows in turn: parts, which lie among the others, and runs of half
/// of all parts, which are as far from the others in time and motion as the logs allow.
#[derive(Default)]
pub(super) struct Unseen {
    pub parts: Vec<LeftOutRows>,
    pub runs: Vec<LeftOutRows>,
    /// The parts once more, with physics that was estimated anew without each, if that of `parts`
    /// and `runs` stays as it is.
    pub anew: Vec<LeftOutRows>,
}

impl Unseen {
    /// The parts and, if there are any, the same with physics that was estimated anew: a motion to
    /// come may be like one that the physics has seen, or not.
    pub fn parts_and_anew(&self) -> impl Iterator<Item = &LeftOutRows> {
        self.parts.iter().chain(&self.anew)
    }

    /// How many runs have no part in common.
    pub fn independent_runs(&self) -> f64 {
        let count = self.runs.len();
        count as f64 / (count / 2).max(1) as f64
    }
}

/// Bounds of the time over which neighbouring errors are taken to be alike, s.
pub(super) const SHORTEST_MEMORY: f64 = 0.005;
const LONGEST_MEMORY: f64 = 5.0;

/// Memories, each of which leaves 1/e of the covariance, after which errors have nothing to do with
/// each other: 5 % are left.
const RANGE: f64 = 3.0;

/// Longest time over which errors of a joint may be taken to be alike, s: they must have nothing to
/// do with each other from the middle of a stretch that is left out to its ends. Errors that last
/// for longer would be judged by what was seen of them, and take constant torques for their own
/// that the motion explains.
///
/// Source: J.-P. Chilès, P. Delfiner, Geostatistics (2012), section 2.5, practical range of the
/// exponential covariance.
pub(super) fn longest_memory(rows: &ResidualRows, left_out: &[LeftOutRows]) -> f64 {
    let width = rows.x.len() / rows.residual.len().max(1);
    let time = |row: usize| rows.x[(row + 1) * width - 1];
    let together = |a: &usize, b: &usize| a + 1 == *b && rows.source[*a].0 == rows.source[*b].0;
    let stretches = || left_out.iter().flat_map(|part| part.part.chunk_by(together));
    let seconds: f64 =
        stretches().map(|stretch| time(stretch[stretch.len() - 1]) - time(stretch[0])).sum();
    let mean = seconds / stretches().count().max(1) as f64;
    (0.5 * mean / RANGE).clamp(2.0 * SHORTEST_MEMORY, LONGEST_MEMORY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_not_remembered_over_a_part_that_is_left_out() {
        // Two logs of 24 s and 2 s, a row every 0.1 s; one joint, so that the time is the fourth
        // input.
        let times = [(0..=240, 0.0), (0..=20, 1e3)];
        let times: Vec<f64> = times
            .iter()
            .flat_map(|(steps, start)| steps.clone().map(move |k| start + 0.1 * f64::from(k)))
            .collect();
        let count = times.len();
        let rows = ResidualRows {
            x: times.iter().flat_map(|time| [0.0, 0.0, 0.0, *time]).collect(),
            residual: vec![1.0; count],
            source: (0..count).map(|k| (usize::from(k > 240), k)).collect(),
            terms: None,
        };
        let longest = |parts: Vec<Vec<usize>>| {
            let left_out: Vec<LeftOutRows> = parts
                .into_iter()
                .map(|part| LeftOutRows {
                    variance: vec![0.0; part.len()],
                    part,
                    residual: vec![1.0; count],
                })
                .collect();
            longest_memory(&rows, &left_out)
        };
        // The logs; eighths of the first; two stretches of it at a time, as of a motion that
        // repeats itself.
        assert!(
            (longest(vec![(0..241).collect(), (241..count).collect()]) - 13.0 / 6.0).abs() < 1e-9
        );
        assert!(
            (longest((0..8).map(|k| (30 * k..30 * k + 31).collect()).collect()) - 0.5).abs() < 1e-9
        );
        let twice = |k: usize| (15 * k..15 * k + 13).chain(15 * k + 120..15 * k + 133).collect();
        assert!((longest((0..8).map(twice).collect()) - 0.2).abs() < 1e-9);
        // A part that goes on in the next log has two stretches, of 1 s and 2 s.
        assert!((longest(vec![(230..count).collect()]) - 0.25).abs() < 1e-9);
        assert!((longest(vec![vec![7], vec![]]) - 2.0 * SHORTEST_MEMORY).abs() < 1e-9);
    }
}
