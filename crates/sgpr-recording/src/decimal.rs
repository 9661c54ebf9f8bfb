//! Decimal text to integer nanoseconds, without a detour through floating point.

/// `text`, a decimal number of 10^`power` ns, in ns, rounded half away from zero; `None` if it is
/// no number or does not fit.
pub(super) fn nanoseconds(text: &str, power: i32) -> Option<i64> {
    let (negative, unsigned) = match text.as_bytes() {
        [b'-', ..] => (true, &text[1..]),
        [b'+', ..] => (false, &text[1..]),
        _ => (false, text),
    };
    let (mantissa, exponent) = match unsigned.split_once(['e', 'E']) {
        Some((mantissa, exponent)) => (mantissa, exponent.parse::<i32>().ok()?),
        None => (unsigned, 0),
    };
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    if whole.is_empty() && fraction.is_empty() || exponent.unsigned_abs() > 100 {
        return None;
    }
    // Digits before this many count as nanoseconds or more; the next one rounds.
    let counted = whole.len() as i64 + i64::from(exponent + power);
    let mut value: i64 = 0;
    let mut digits = whole.bytes().chain(fraction.bytes());
    for place in 0..counted.max((whole.len() + fraction.len()) as i64) {
        let digit = match digits.next() {
            Some(digit @ b'0'..=b'9') => i64::from(digit - b'0'),
            Some(_) => return None,
            None => 0,
        };
        if place < counted {
            value = value.checked_mul(10)?.checked_add(digit)?;
        } else if place == counted && digit >= 5 {
            value = value.checked_add(1)?;
        }
    }
    Some(if negative { -value } else { value })
}

#[cfg(test)]
mod tests {
    use super::nanoseconds;

    #[test]
    fn seconds_become_nanoseconds_exactly() {
        for (text, expected) in [
            ("60.0040", 60_004_000_000),
            ("0", 0),
            ("-0.002", -2_000_000),
            ("+1.", 1_000_000_000),
            (".5", 500_000_000),
            ("1.5e-3", 1_500_000),
            ("6.00E+01", 60_000_000_000),
            ("1700000000.123456789", 1_700_000_000_123_456_789),
            ("0.0000000014", 1),
            ("0.0000000015", 2),
            ("0.00000000009", 0),
            ("1e-10", 0),
            ("12e-20", 0),
        ] {
            assert_eq!(nanoseconds(text, 9), Some(expected), "{text}");
        }
    }

    #[test]
    fn other_units() {
        assert_eq!(nanoseconds("1700000000123456789", 0), Some(1_700_000_000_123_456_789));
        assert_eq!(nanoseconds("12.5", 6), Some(12_500_000));
        assert_eq!(nanoseconds("12.5", 0), Some(13));
        assert_eq!(nanoseconds("0.25", 3), Some(250));
    }

    #[test]
    fn what_is_no_time() {
        for text in [
            "",
            ".",
            "-",
            "abc",
            "1.2.3",
            "1e",
            "1e999999999999",
            "nan",
            "inf",
            "1 2",
            "9300000000",
            "--1",
            "1e50",
        ] {
            assert_eq!(nanoseconds(text, 9), None, "{text}");
        }
    }
}
