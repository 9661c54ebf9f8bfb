use std::ops::Range;

use crate::identification::Row;

/// Says of every sample whether each joint moves, and stills those that rest.
///
/// A joint rests where its speed stays below `threshold` for half a period of the cut-off or
/// longer. A reversal passes through zero speed in less time and counts as motion. While a joint
/// rests, dry friction holds it with any torque up to the Coulomb level, and what is measured of
/// its motion is noise, whose sign is no direction of friction: speed and acceleration are set to
/// zero. Near the ends of a rest the filter mixes the two, and samples are skipped; with a
/// `turn_margin`, near reversals, too.
///
/// - `dq`, `ddq`: `[samples, n]`
/// - `threshold`: `[n]`
/// - `period`: of the cut-off, samples
/// - `turn_margin`: before and after a reversal or a rest, in periods
/// - returns `[samples, n]`
pub(crate) fn separate_rests(
    dq: &mut [f64],
    ddq: &mut [f64],
    threshold: &[f64],
    period: f64,
    turn_margin: f64,
) -> Vec<Row> {
    let n = threshold.len();
    for joint in 0..n {
        for resting in rests(dq, joint, threshold, period).into_iter().flatten() {
            (dq[resting * n + joint], ddq[resting * n + joint]) = (0.0, 0.0);
        }
    }
    rows_of(dq, threshold, period, turn_margin)
}

/// What [`separate_rests`] says of every sample of joints that it has stilled, with any margin near
/// reversals.
///
/// - arguments and result as there
pub(crate) fn rows_of(dq: &[f64], threshold: &[f64], period: f64, turn_margin: f64) -> Vec<Row> {
    let n = threshold.len();
    let samples = dq.len() / n;
    let window = window(period);
    let turn = (turn_margin * period).ceil() as usize;
    let margin = window.max(turn);
    let mut rows = vec![Row::Moving; dq.len()];
    for joint in 0..n {
        for rest in rests(dq, joint, threshold, period) {
            for near in
                rest.start.saturating_sub(margin)..rest.end.saturating_add(margin).min(samples)
            {
                let inside = near >= rest.start + window && near + window < rest.end;
                rows[near * n + joint] = if inside { Row::Resting } else { Row::Skip };
            }
        }
        if turn == 0 {
            continue;
        }
        let mut before = 0.0;
        for k in 0..samples {
            let speed = dq[k * n + joint];
            if before * speed < 0.0 {
                for near in k.saturating_sub(turn)..k.saturating_add(turn).min(samples) {
                    let row = &mut rows[near * n + joint];
                    *row = if *row == Row::Moving { Row::Skip } else { *row };
                }
            }
            if speed != 0.0 {
                before = speed;
            }
        }
    }
    rows
}

/// Samples that a rest has at least.
fn window(period: f64) -> usize {
    ((0.5 * period).ceil() as usize).max(3)
}

/// Where a joint rests.
fn rests(dq: &[f64], joint: usize, threshold: &[f64], period: f64) -> Vec<Range<usize>> {
    let n = threshold.len();
    let mut found = Vec::new();
    let mut start = None;
    for (k, speeds) in dq.chunks_exact(n).enumerate() {
        match (speeds[joint].abs() < threshold[joint], start) {
            (true, None) => start = Some(k),
            (false, Some(first)) => {
                found.push(first..k);
                start = None;
            }
            _ => {}
        }
    }
    found.extend(start.map(|first| first..dq.len() / n));
    found.retain(|rest| rest.len() >= window(period));
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rests_are_marked_and_reversals_are_not() {
        // At 100 Hz with a cut-off of 10 Hz the window is five samples. One joint swings, the other
        // stops for 30.
        let mut dq: Vec<f64> = (0..200)
            .flat_map(|k| {
                let swing = (f64::from(k) * 0.1).sin();
                let stop = if (80..110).contains(&k) { 1e-4 * f64::from(k % 3 - 1) } else { 1.0 };
                [swing, stop]
            })
            .collect();
        let mut ddq = vec![1.0; dq.len()];
        let (mut dq_again, mut ddq_again) = (dq.clone(), vec![1.0; dq.len()]);
        let rows = separate_rests(&mut dq, &mut ddq, &[0.01, 0.01], 10.0, 0.0);
        assert!(rows.iter().step_by(2).all(|row| *row == Row::Moving), "reversals are motion");
        for (k, row) in rows.iter().skip(1).step_by(2).enumerate() {
            let expected = match k {
                85..105 => Row::Resting,
                75..115 => Row::Skip,
                _ => Row::Moving,
            };
            assert_eq!(*row, expected, "{k}");
            assert_eq!(
                dq[2 * k + 1] == 0.0 && ddq[2 * k + 1] == 0.0,
                (80..110).contains(&k),
                "{k}"
            );
        }
        // The swing turns between samples 31 and 32, 62 and 63, ...; eight samples are 0.8 periods.
        let rows = separate_rests(&mut dq_again, &mut ddq_again, &[0.01, 0.01], 10.0, 0.8);
        for k in 0..200 {
            let near_turn =
                [32, 63, 95, 126, 158, 189].iter().any(|turn| (turn - 8..turn + 8).contains(&k));
            assert_eq!(rows[2 * k] == Row::Moving, !near_turn, "{k}");
            let near_rest = (72..118).contains(&k);
            assert_eq!(rows[2 * k + 1] == Row::Moving, !near_rest, "{k}");
            assert_eq!(rows[2 * k + 1] == Row::Resting, (85..105).contains(&k), "{k}");
        }
        // Joints that are stilled give the rows of any margin.
        assert_eq!(rows_of(&dq, &[0.01, 0.01], 10.0, 0.8), rows);
    }
}
