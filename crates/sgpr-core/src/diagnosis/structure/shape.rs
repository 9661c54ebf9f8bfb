//! The shape of a function of the state, in words.

use super::OfState;
use super::rows::JointRows;
use super::smoother::Variable;
use crate::effects::sgn;
use sgpr_predict::internal::power_by_order;

/// Lowest and highest number of periods per turn that is looked for.
const ORDERS: std::ops::RangeInclusive<usize> = 3..=200;

/// A function with so many periods per turn of the joint.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Periodic {
    /// Periods per turn.
    pub order: f64,
    /// Whether it changes sign with the direction, as friction does.
    pub with_direction: bool,
    /// Share of the residual's variance.
    pub share: f64,
}

impl Periodic {
    /// Its sine and cosine.
    pub fn columns(&self, rows: &JointRows) -> [Vec<f64>; 2] {
        let (q, dq) = (&rows.q[rows.joint], &rows.dq[rows.joint]);
        let sign = |k: usize| if self.with_direction { sgn(dq[k]) } else { 1.0 };
        let of = |f: fn(f64) -> f64| {
            q.iter().enumerate().map(|(k, q)| sign(k) * f(self.order * q)).collect()
        };
        [of(f64::cos), of(f64::sin)]
    }
}

/// The strongest line of a periodogram over the position, if the range shows two periods of it and
/// it stands out.
pub(super) fn periodic(rows: &JointRows) -> Option<Periodic> {
    /// A line is periodic if it has so many times the median power.
    const STANDS_OUT: f64 = 12.0;
    let (q, dq) = (&rows.q[rows.joint], &rows.dq[rows.joint]);
    let [low, high] =
        q.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], q| [a.min(*q), b.max(*q)]);
    let first = (*ORDERS.start())
        .max((2.0 * std::f64::consts::TAU / (high - low).max(1e-9)).ceil().min(1e6) as usize);
    let power = |with_direction: bool, order: f64| {
        let sums = q.iter().zip(dq).zip(&rows.residual).fold([0.0; 2], |[a, b], ((q, dq), r)| {
            let r = if with_direction { r * sgn(*dq) } else { *r };
            let (sine, cosine) = (order * q).sin_cos();
            [a + r * cosine, b + r * sine]
        });
        sums[0] * sums[0] + sums[1] * sums[1]
    };
    let mut best: Option<(f64, bool, f64)> = None;
    for with_direction in [false, true] {
        let sign = |k: usize| if with_direction { sgn(dq[k]) } else { 1.0 };
        let signed = q.iter().zip(&rows.residual).enumerate().map(|(k, (q, r))| (*q, sign(k) * r));
        let all = power_by_order(signed, first..=*ORDERS.end());
        let mut sorted = all.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied()?;
        for (k, value) in all.iter().enumerate() {
            if *value > STANDS_OUT * median && best.is_none_or(|(most, ..)| *value > most) {
                best = Some((*value, with_direction, (first + k) as f64));
            }
        }
    }
    let (_, with_direction, around) = best?;
    let near = (-20..=20).map(|k| around + 0.05 * f64::from(k));
    let order =
        near.max_by(|a, b| power(with_direction, *a).total_cmp(&power(with_direction, *b)))?;
    Some(Periodic { order, with_direction, share: 0.0 })
}

/// Sentences on what explains a residual.
pub(super) fn words(rows: &JointRows, state: &OfState, unit: &str) -> Vec<String> {
    let mut words = Vec::new();
    let joint = rows.joint;
    let columns = state.smooth.columns(rows, false);
    let value = |columns: &[Vec<f64>]| -> Vec<f64> {
        let mut sum = vec![0.0; rows.len()];
        for (column, factor) in columns.iter().zip(&state.explained.coefficients) {
            sum.iter_mut().zip(column).for_each(|(sum, x)| *sum += factor * x);
        }
        sum
    };
    let f = value(&columns);
    let energy: f64 = f.iter().map(|x| x * x).sum::<f64>().max(1e-300);
    let depends = |variable: Variable| state.variables.contains(&variable);
    if depends(Variable::Speed(joint)) {
        let mirrored = value(&state.smooth.columns(rows, true));
        let part = |sign: f64| {
            f.iter().zip(&mirrored).map(|(a, b)| (0.5 * (a + sign * b)).powi(2)).sum::<f64>()
        };
        let (even, odd) = (part(1.0), part(-1.0));
        match odd / (odd + even).max(1e-300) {
            share if share > 0.85 => words.push("odd in the speed".into()),
            share if share < 0.15 => words.push("even in the speed".into()),
            _ => {}
        }
        let top = rows.top_speed(joint);
        let slow = |k: &usize| rows.dq[joint][*k].abs() < 0.05 * top;
        let inside: f64 = (0..rows.len()).filter(slow).map(|k| f[k] * f[k]).sum();
        let samples = (0..rows.len()).filter(slow).count() as f64 / rows.len() as f64;
        if inside / energy > 0.5 && inside / energy > 4.0 * samples {
            words.push(format!("mostly below {:.3} {unit}/s, near reversals", 0.05 * top));
        }
    }
    if depends(Variable::Position(joint)) {
        let slope = correlation(&rows.q[joint], &f);
        if slope.abs() > 0.9 {
            words
                .push(format!("{} with the position", if slope > 0.0 { "rises" } else { "falls" }));
        }
    }
    if depends(Variable::Acceleration) {
        let slope = correlation(&rows.ddq, &f);
        if slope.abs() > 0.8 {
            words.push("in proportion to the acceleration".into());
        }
    }
    if depends(Variable::Load) {
        let sizes: Vec<f64> = f.iter().map(|x| x.abs()).collect();
        let loads: Vec<f64> = rows.load.iter().map(|x| x.abs()).collect();
        if correlation(&loads, &sizes) > 0.4 {
            words.push("grows with the load".into());
        }
    }
    if let Some(periodic) = &state.periodic {
        let kind = if periodic.with_direction { ", with the sign of the speed" } else { "" };
        words.push(format!(
            "periodic in the position, {:.1} periods per turn (every {:.3} {unit}){kind}",
            periodic.order,
            std::f64::consts::TAU / periodic.order
        ));
    }
    words
}

fn correlation(x: &[f64], y: &[f64]) -> f64 {
    let count = x.len().max(1) as f64;
    let (mx, my) = (x.iter().sum::<f64>() / count, y.iter().sum::<f64>() / count);
    let product = |a: &[f64], ma: f64, b: &[f64], mb: f64| {
        a.iter().zip(b).map(|(a, b)| (a - ma) * (b - mb)).sum::<f64>()
    };
    product(x, mx, y, my) / (product(x, mx, x, mx) * product(y, my, y, my)).max(1e-300).sqrt()
}
