//! Names in messages: quoting, and the names that may have been meant.

pub(super) use sgpr_predict::names::{counted, suggestion};

/// Longest list of names in a message.
const LONGEST_LIST: usize = 40;
/// Longer names, in bytes, have no pattern that a person could read.
const LONGEST_NAME: usize = 200;
/// More names are not looked through for patterns.
const MOST_NAMES: usize = 1000;

/// Patterns of names that differ in one number alone, quoted: `` `angle {} [rad]` `` of
/// `angle 1 [rad]`, `angle 2 [rad]`; `` `q{}` `` if there are none.
pub(super) fn patterns(names: &[String]) -> String {
    let of_name = |name: &String| {
        let digits = |part: &str| {
            part.len() - part.trim_start_matches(|letter: char| letter.is_ascii_digit()).len()
        };
        let is_start = |at: &usize| {
            digits(&name[*at..]) > 0 && !name[..*at].ends_with(|c: char| c.is_ascii_digit())
        };
        let starts = (0..name.len()).filter(|at| name.is_char_boundary(*at)).filter(is_start);
        starts
            .map(|at| format!("`{}{{}}{}`", &name[..at], &name[at + digits(&name[at..])..]))
            .collect::<Vec<_>>()
    };
    let all: Vec<String> = names
        .iter()
        .filter(|name| name.len() <= LONGEST_NAME)
        .take(MOST_NAMES)
        .flat_map(of_name)
        .collect();
    let mut found: Vec<String> = Vec::new();
    for pattern in &all {
        if !found.contains(pattern) && all.iter().filter(|other| *other == pattern).count() > 1 {
            found.push(pattern.clone());
        }
    }
    found.truncate(LONGEST_LIST);
    if found.is_empty() { "`q{}`".into() } else { found.join(", ") }
}

/// `` `a`, `b`, `c` ``, cut when it gets long.
pub(super) fn quoted(names: &[String]) -> String {
    if names.is_empty() {
        return "none".into();
    }
    let shown: Vec<String> =
        names.iter().take(LONGEST_LIST).map(|name| format!("`{name}`")).collect();
    let rest = names.len() - shown.len();
    let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    shown.join(", ") + &more
}
