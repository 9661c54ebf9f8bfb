use crate::identification::Row;

/// Says of every sample whether each joint moves, and stills those that rest.
///
/// A joint rests where its speed stays below `threshold` for half a period of the cut-off or longer. A reversal passes
/// through zero speed in less time and counts as motion. While a joint rests, dry friction holds it with any torque up to
/// the Coulomb level, and what is measured of its motion is noise, whose sign is no direction of friction: speed and
/// acceleration are set to zero. Near the ends of a rest the filter mixes the two, and samples are skipped; with a
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
    let samples = dq.len() / n;
    let window = ((0.5 * period).ceil() as usize).max(3);
    let turn = (turn_margin * period).ceil() as usize;
    let margin = window.max(turn);
    let mut rows = vec![Row::Moving; dq.len()];
    for joint in 0..n {
        let mut k = 0;
        while k < samples {
            if dq[k * n + joint].abs() >= threshold[joint] {
                k += 1;
                continue;
            }
            let end = (k..samples).find(|&later| dq[later * n + joint].abs() >= threshold[joint]).unwrap_or(samples);
            if end - k >= window {
                for near in k.saturating_sub(margin)..end.saturating_add(margin).min(samples) {
                    let inside = near >= k + window && near + window < end;
                    rows[near * n + joint] = if inside { Row::Resting } else { Row::Skip };
                }
                for resting in k..end {
                    (dq[resting * n + joint], ddq[resting * n + joint]) = (0.0, 0.0);
                }
            }
            k = end;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rests_are_marked_and_reversals_are_not() {
        // At 100 Hz with a cut-off of 10 Hz the window is five samples. One joint swings, the other stops for 30.
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
            assert_eq!(dq[2 * k + 1] == 0.0 && ddq[2 * k + 1] == 0.0, (80..110).contains(&k), "{k}");
        }
        // The swing turns between samples 31 and 32, 62 and 63, ...; eight samples are 0.8 periods.
        let rows = separate_rests(&mut dq_again, &mut ddq_again, &[0.01, 0.01], 10.0, 0.8);
        for k in 0..200 {
            let near_turn = [32, 63, 95, 126, 158, 189].iter().any(|turn| (turn - 8..turn + 8).contains(&k));
            assert_eq!(rows[2 * k] == Row::Moving, !near_turn, "{k}");
            let near_rest = (72..118).contains(&k);
            assert_eq!(rows[2 * k + 1] == Row::Moving, !near_rest, "{k}");
            assert_eq!(rows[2 * k + 1] == Row::Resting, (85..105).contains(&k), "{k}");
        }
    }
}
