//! Where in a URDF it is that the parser stumbled: it says what is wrong, but not in which element.

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

/// Attributes that hold numbers: element, those that must be there, those that may be, how many
/// numbers each.
const NUMBERS: [(&str, &[&str], &[&str], usize); 8] = [
    ("mass", &["value"], &[], 1),
    ("inertia", &["ixx", "ixy", "ixz", "iyy", "iyz", "izz"], &[], 1),
    ("origin", &[], &["xyz", "rpy"], 3),
    ("axis", &["xyz"], &[], 3),
    ("limit", &["velocity"], &["lower", "upper", "effort"], 1),
    ("dynamics", &[], &["damping", "friction"], 1),
    ("mimic", &[], &["multiplier", "offset"], 1),
    ("box", &["size"], &[], 3),
];

/// The first element that lacks what it must have, or holds text in the place of numbers: a
/// sentence with its line, its link or joint, and what was expected.
pub(super) fn first_fault(text: &str) -> Option<String> {
    let mut reader = Reader::from_str(text);
    let (mut depth, mut owner) = (0, "robot".to_string());
    // What an `inertial` still lacks.
    let mut lacking = vec![];
    loop {
        let event = reader.read_event().ok()?;
        let position = reader.buffer_position();
        // Counted where it is told alone: a file may have a million elements.
        let line = || line_at(text, position);
        if let Event::Start(element) | Event::Empty(element) = &event {
            let tag = String::from_utf8_lossy(element.name().as_ref()).into_owned();
            if depth == 1 && matches!(tag.as_str(), "link" | "joint") {
                let Some(name) = attribute(element, "name") else {
                    return Some(format!("line {}: a {tag} has no name", line()));
                };
                owner = format!("{tag} `{name}`");
            }
            if tag == "inertial" {
                lacking = vec!["mass", "inertia"];
            }
            lacking.retain(|wanted| *wanted != tag);
            if let Some(fault) = number_fault(element, &tag) {
                return Some(format!("line {}, {owner}: {fault}", line()));
            }
        }
        match event {
            Event::Start(_) => depth += 1,
            Event::End(element)
                if element.name().as_ref() == b"inertial" && !lacking.is_empty() =>
            {
                return Some(format!(
                    "line {}, {owner}: the inertial lacks its {}",
                    line(),
                    lacking.join(" and ")
                ));
            }
            Event::End(_) => depth -= 1,
            Event::Eof => return None,
            _ => {}
        }
    }
}

/// Line of a byte, counted from one.
pub(super) fn line_at(text: &str, position: u64) -> usize {
    1 + text.bytes().take(position as usize).filter(|byte| *byte == b'\n').count()
}

fn attribute(element: &BytesStart, name: &str) -> Option<String> {
    let found = element.try_get_attribute(name).ok().flatten()?;
    Some(found.unescape_value().ok()?.into_owned())
}

fn number_fault(element: &BytesStart, tag: &str) -> Option<String> {
    let (_, required, optional, count) = NUMBERS.into_iter().find(|(name, ..)| *name == tag)?;
    let wanted = if count == 1 { "a number".to_string() } else { format!("{count} numbers") };
    required.iter().chain(optional).find_map(|name| match attribute(element, name) {
        Some(value) => {
            let numbers: Result<Vec<f64>, _> = value.split_whitespace().map(str::parse).collect();
            let fits = numbers.is_ok_and(|numbers| numbers.len() == count);
            (!fits).then(|| format!("the {tag} has {name}=\"{value}\", expected {wanted}"))
        }
        None => {
            required.contains(name).then(|| format!("the {tag} lacks {name}, expected {wanted}"))
        }
    })
}
