//! Order statistics of small copies.

/// Quantile `p` (0 to 1) of `values` by linear interpolation between order statistics; NaN without
/// values. NaN must not be among them.
pub(super) fn quantile(values: &mut [f64], p: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let place = p * (values.len() - 1) as f64;
    let lower = place.floor() as usize;
    let (_, low, above) = values.select_nth_unstable_by(lower, f64::total_cmp);
    let low = *low;
    let high = above.iter().copied().min_by(f64::total_cmp).unwrap_or(low);
    low + (place - lower as f64) * (high - low)
}

/// Median of `values`; NaN without values.
pub(super) fn median(values: &mut [f64]) -> f64 {
    quantile(values, 0.5)
}

/// Smallest and largest finite value; `None` without any.
pub(super) fn range(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.filter(|value| value.is_finite()).fold(None, |range, value| match range {
        None => Some([value, value]),
        Some([low, high]) => Some([f64::min(low, value), f64::max(high, value)]),
    })
}

/// Values that are looked at before it is asked whether one of them was found: a loop without exits
/// uses whole registers.
const AT_ONCE: usize = 1024;

/// Index of the first of `values` for which `found` is true, for conditions that are seldom true.
pub(super) fn first_place(values: &[f64], found: impl Fn(f64) -> bool) -> Option<usize> {
    let block = values
        .chunks(AT_ONCE)
        .position(|block| block.iter().fold(false, |any, value| any | found(*value)))?;
    let start = block * AT_ONCE;
    values[start..].iter().position(|value| found(*value)).map(|index| start + index)
}

/// Index of the first of `values` of which and the one `distance` before it `found` is true, for
/// conditions that are seldom true.
pub(super) fn first_change(
    values: &[f64],
    distance: usize,
    found: impl Fn(f64, f64) -> bool,
) -> Option<usize> {
    let later = values.get(distance..)?;
    let blocks = values.chunks(AT_ONCE).zip(later.chunks(AT_ONCE));
    let any = |(before, now): (&[f64], &[f64])| {
        before.iter().zip(now).fold(false, |any, (b, n)| any | found(*b, *n))
    };
    let start = blocks.map(any).position(|any| any)? * AT_ONCE;
    let mut pairs = values[start..].iter().zip(&later[start..]);
    pairs.position(|(before, now)| found(*before, *now)).map(|index| start + distance + index)
}

/// Smallest and largest finite value of each of the `n` columns of a row-major array; `None` for
/// those without any.
pub(super) fn ranges(values: &[f64], n: usize) -> Vec<Option<[f64; 2]>> {
    /// Rows beside each other, so that a register has no half of a row.
    const ROWS: usize = 8;
    let width = ROWS * n.max(1);
    let (mut low, mut high) = (vec![f64::INFINITY; width], vec![f64::NEG_INFINITY; width]);
    for rows in values.chunks(width) {
        for ((low, high), value) in low.iter_mut().zip(&mut high).zip(rows) {
            let finite = value.is_finite();
            *low = if finite && *value < *low { *value } else { *low };
            *high = if finite && *value > *high { *value } else { *high };
        }
    }
    let least =
        |column: usize| low.iter().skip(column).step_by(n).copied().fold(f64::INFINITY, f64::min);
    let most = |column: usize| {
        high.iter().skip(column).step_by(n).copied().fold(f64::NEG_INFINITY, f64::max)
    };
    (0..n)
        .map(|column| Some([least(column), most(column)]).filter(|[low, high]| low <= high))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(quantile(&mut [0.0, 10.0], 0.25), 2.5);
        assert!(median(&mut []).is_nan());
    }

    #[test]
    fn ranges_are_those_of_each_column() {
        let rows: Vec<f64> =
            (0..1000).flat_map(|k| [f64::from(k), (f64::from(k) * 0.1).sin(), f64::NAN]).collect();
        let of_columns = (0..3).map(|column| range(rows.iter().skip(column).step_by(3).copied()));
        assert_eq!(ranges(&rows, 3), of_columns.collect::<Vec<_>>());
        assert_eq!(ranges(&[], 2), [None, None]);
    }

    #[test]
    fn first_places_are_those_of_a_plain_search() {
        let values: Vec<f64> = (0..5000).map(|k| f64::from(k % 4999)).collect();
        for limit in [0.0, 1.0, 1023.0, 1024.0, 3000.0, 4998.0, 5000.0] {
            assert_eq!(
                first_place(&values, |value| value >= limit),
                values.iter().position(|value| *value >= limit)
            );
            let change = |before: f64, now: f64| now < before && now < limit;
            let plain = (3..5000).find(|&k| change(values[k - 3], values[k]));
            assert_eq!(first_change(&values, 3, change), plain, "{limit}");
        }
        assert_eq!(first_change(&[1.0], 3, |_, _| true), None);
    }

    #[test]
    fn range_skips_what_is_not_finite() {
        assert_eq!(range([f64::NAN, 2.0, -1.0].into_iter()), Some([-1.0, 2.0]));
        assert_eq!(range([f64::NAN].into_iter()), None);
    }
}
