//! Times as people write them: dates with times of day, and times of day alone.

const SECOND: i64 = 1_000_000_000;
const DAY_SECONDS: i64 = 86_400;

/// What a text says of the time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Moment {
    /// ns since 1970; without a time zone as if it were universal time.
    Instant(i64),
    /// ns since midnight.
    TimeOfDay(i64),
}

/// Reads ISO 8601 (`2026-03-03T09:15:00.000+01:00`, with a blank for the `T`, `/` for `-`, a comma
/// for the point, or without zone), the same with a date like `03.03.2026`, or a time of day
/// (`09:15:00.000`). Dates like `03/04/2026`, which mean two days, are not read.
pub(super) fn moment(text: &str) -> Option<Moment> {
    let text = text.trim();
    if !text.is_ascii() {
        return None;
    }
    let (day, rest) = match text.find(['T', ' ']) {
        Some(at) => (Some(day_number(&text[..at])?), text[at + 1..].trim_start()),
        None => (None, text),
    };
    let (clock, zone_seconds) = zone(rest)?;
    let nanoseconds = time_of_day(clock)?;
    match day {
        None => Some(Moment::TimeOfDay(nanoseconds)),
        Some(day) => {
            let seconds = day.checked_mul(DAY_SECONDS)?.checked_sub(zone_seconds)?;
            seconds.checked_mul(SECOND)?.checked_add(nanoseconds).map(Moment::Instant)
        }
    }
}

/// A whole number of exactly `digits` digits.
fn number(text: &str, digits: usize) -> Option<i64> {
    let valid = text.len() == digits && text.bytes().all(|byte| byte.is_ascii_digit());
    if valid { text.parse().ok() } else { None }
}

/// Days since 1970-01-01 of `2026-03-03`, `2026/03/03` or `03.03.2026`.
fn day_number(text: &str) -> Option<i64> {
    let parts: Vec<&str> = text.split(['-', '/', '.']).collect();
    let [first, month, last] = parts[..] else { return None };
    let dotted = text.contains('.');
    let (year, day) = if dotted { (last, first) } else { (first, last) };
    let (year, month, day) = (number(year, 4)?, number(month, 2)?, number(day, 2)?);
    let leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let length = match month {
        2 => 28 + i64::from(leap),
        4 | 6 | 9 | 11 => 30,
        1..=12 => 31,
        _ => return None,
    };
    if !(1..=length).contains(&day) {
        return None;
    }
    // Years begin in March, so that the odd day is the last one; the months before have 30.6 days
    // on average.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days = 365 * year + year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    /// Days from 0000-03-01 to 1970-01-01.
    const TO_1970: i64 = 719_468;
    Some(days + (153 * month + 2) / 5 + day - 1 - TO_1970)
}

/// The time of day, and by how many seconds its zone is ahead of universal time.
fn zone(text: &str) -> Option<(&str, i64)> {
    for universal in ["Z", "z", " UTC", " GMT"] {
        if let Some(clock) = text.strip_suffix(universal) {
            return Some((clock.trim_end(), 0));
        }
    }
    let Some(at) = text.rfind(['+', '-']) else { return Some((text, 0)) };
    let digits: String = text[at + 1..].split(':').collect();
    let (hours, minutes) = match digits.len() {
        2 => (number(&digits, 2)?, 0),
        4 => (number(&digits[..2], 2)?, number(&digits[2..], 2)?),
        _ => return None,
    };
    let seconds = 3600 * hours + 60 * minutes;
    (hours < 24 && minutes < 60).then(|| {
        (text[..at].trim_end(), if text.as_bytes()[at] == b'-' { -seconds } else { seconds })
    })
}

/// ns since midnight of `09:15`, `09:15:00` or `09:15:00.000`.
fn time_of_day(text: &str) -> Option<i64> {
    let mut parts = text.splitn(3, ':');
    let (hours, minutes) = (parts.next()?, parts.next()?);
    let hours = number(hours, 2).or_else(|| number(hours, 1)).filter(|hours| *hours < 24)?;
    let minutes = number(minutes, 2).filter(|minutes| *minutes < 60)?;
    let (whole, fraction) = match parts.next() {
        None => (0, 0),
        Some(seconds) => {
            let (whole, fraction) = seconds.split_once(['.', ',']).unwrap_or((seconds, "0"));
            // A leap second is the sixtieth.
            (number(whole, 2).filter(|whole| *whole <= 60)?, billionths(fraction)?)
        }
    };
    Some((3600 * hours + 60 * minutes + whole) * SECOND + fraction)
}

/// Decimals of a second in ns; digits beyond the ninth are cut.
fn billionths(decimals: &str) -> Option<i64> {
    if decimals.is_empty() || !decimals.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let nine: String = decimals.chars().chain(std::iter::repeat('0')).take(9).collect();
    nine.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn instant(text: &str) -> i64 {
        match moment(text) {
            Some(Moment::Instant(nanoseconds)) => nanoseconds,
            other => panic!("{text}: {other:?}"),
        }
    }

    #[test]
    fn dates_are_counted_as_unix_does() {
        // `date --date=... +%s`
        for (text, seconds) in [
            ("1970-01-01T00:00:00Z", 0),
            ("2000-02-29T12:00:00Z", 951_825_600),
            ("2026-03-03T09:15:00Z", 1_772_529_300),
            ("2023-11-14T22:13:20Z", 1_700_000_000),
            ("1969-12-31T23:59:59Z", -1),
            ("2024-12-31 23:59:59", 1_735_689_599),
        ] {
            assert_eq!(instant(text), seconds * SECOND, "{text}");
        }
    }

    #[test]
    fn one_moment_in_many_spellings() {
        let expected = 1_772_529_300_125_000_000;
        for text in [
            "2026-03-03T09:15:00.125Z",
            "2026-03-03T09:15:00.125",
            "2026-03-03 09:15:00,125",
            "2026/03/03 09:15:00.125",
            "03.03.2026 09:15:00.125",
            "2026-03-03T10:15:00.125+01:00",
            "2026-03-03T10:15:00.125+0100",
            "2026-03-03 10:15:00.125+01",
            "2026-03-03T03:45:00.125-05:30",
            "2026-03-03 09:15:00.125 UTC",
            "2026-03-03 09:15:00.125000000+00:00",
        ] {
            assert_eq!(instant(text), expected, "{text}");
        }
    }

    #[test]
    fn times_of_day() {
        assert_eq!(moment("09:15:00.004"), Some(Moment::TimeOfDay(33_300_004_000_000)));
        assert_eq!(moment("9:15"), Some(Moment::TimeOfDay(33_300 * SECOND)));
    }

    #[test]
    fn what_is_no_time_or_two() {
        for text in [
            "",
            "now",
            "03/04/2026 09:15:00",
            "2026-02-29T00:00:00",
            "2026-13-01T00:00:00",
            "24:00:00",
            "09:60:00",
            "9",
            "09:15:00.",
            "09:15:00.1x",
            "2026-03-03",
            "2026-03-03T",
            "09:15:00+1",
            "12.5",
            "T09:15:00",
            "é9:15:00",
            "9999-01-01T00:00:00Z",
        ] {
            assert_eq!(moment(text), None, "{text}");
        }
    }
}
