//! Names and words that come from a model, so that they can do no harm in a source file.

use super::ExportError;

/// Longest name that identifiers begin with.
const LONGEST: usize = 40;

/// What identifiers of a file begin with: the name that was given, or one made of the robot's.
pub(super) fn identifier(given: Option<&str>, robot: &str) -> Result<String, ExportError> {
    let Some(name) = given else {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
        let words: String = robot.chars().map(plain).take(LONGEST).collect();
        let name: Vec<&str> = words.split('_').filter(|word| !word.is_empty()).collect();
        return Ok(if name.is_empty() { "arm".into() } else { name.join("_") });
    };
    let allowed = !name.is_empty()
        && name.len() <= LONGEST
        && name.bytes().all(|c| c.is_ascii_alphanumeric() || c == b'_');
    if allowed { Ok(name.into()) } else { Err(ExportError::Name { name: name.into() }) }
}

/// Words for a comment: letters, digits and what cannot end a comment or a line stay, at most 200
/// of them.
pub(super) fn comment(words: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || " _-.,:()[]+=%@".contains(c) { c } else { '_' };
    words.chars().take(200).map(plain).collect()
}
