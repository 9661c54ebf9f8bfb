//! Names in messages: quoting, and the names that may have been meant.

pub(super) use sgpr_predict::names::suggestion;

/// Longest list of names in a message.
const LONGEST_LIST: usize = 40;

/// `` `a`, `b`, `c` ``, cut when it gets long.
pub(super) fn quoted(names: &[String]) -> String {
    if names.is_empty() {
        return "none".into();
    }
    let shown: Vec<String> = names.iter().take(LONGEST_LIST).map(|name| format!("`{name}`")).collect();
    let rest = names.len() - shown.len();
    let more = if rest > 0 { format!(" and {rest} more") } else { String::new() };
    shown.join(", ") + &more
}
