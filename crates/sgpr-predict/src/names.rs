//! Parts of messages: the names that may have been meant, and counts of things.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

/// " (did you mean `x`?)", or nothing when no known name is close or has `name` as a word of its
/// own.
pub fn suggestion(name: &str, known: &[String]) -> String {
    match closest(name, known).or_else(|| with_word(name, known)) {
        Some(close) => format!(" (did you mean `{close}`?)"),
        None => String::new(),
    }
}

/// `1 joint`, `2 joints`.
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// The known name nearest to `name`, if it is near enough to be a slip of the pen.
fn closest<'a>(name: &str, known: &'a [String]) -> Option<&'a str> {
    let name = name.to_lowercase();
    let length = name.chars().count();
    let distances =
        known.iter().take(1000).map(|other| (edit_distance(&name, &other.to_lowercase()), other));
    let (distance, other) = distances.min_by_key(|(distance, _)| *distance)?;
    (distance <= length / 3 + 1 && distance < length).then_some(other.as_str())
}

/// The first known name of which `name` is a word: `stribeck` of `stribeck_friction`.
fn with_word<'a>(name: &str, known: &'a [String]) -> Option<&'a str> {
    let name = name.to_lowercase();
    let is_word = |other: &&String| {
        !name.is_empty() && other.to_lowercase().split('_').any(|word| word == name)
    };
    known.iter().take(1000).find(is_word).map(String::as_str)
}

/// Number of inserted, removed and replaced characters (Levenshtein) that lead from `a` to `b`.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().take(200).collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().take(200).enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != *to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(row[j + 1] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

    use super::*;

    #[test]
    fn edit_distance_counts_single_changes() {
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("abc", "abc"), 0);
    }

    #[test]
    fn only_close_names_are_suggested() {
        let known = ["shoulder_pan_joint".to_string(), "elbow_joint".to_string()];
        assert_eq!(
            suggestion("sholder_pan_joint", &known),
            " (did you mean `shoulder_pan_joint`?)"
        );
        assert_eq!(suggestion("xyz", &known), "");
        assert_eq!(suggestion("", &known), "");
    }

    #[test]
    fn a_word_of_a_name_suggests_it() {
        let known = ["viscous_friction".to_string(), "stribeck_friction".to_string()];
        assert_eq!(suggestion("Stribeck", &known), " (did you mean `stribeck_friction`?)");
        assert_eq!(suggestion("stri", &known), "");
    }
}
