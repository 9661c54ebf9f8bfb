//! The training logs as a set: no result depends on their order, and a copy counts once.

use std::cmp::Ordering;

use crate::recording::Recording;

/// The logs in an order that follows from what is in them, by their first stamps and then by their content; of identical
/// ones, whatever their names, one.
pub(super) fn as_set(recordings: &[Recording]) -> Vec<Recording> {
    let mut set = recordings.to_vec();
    set.sort_by(by_content);
    set.dedup_by(|a, b| by_content(a, b) == Ordering::Equal);
    set
}

fn by_content(a: &Recording, b: &Recording) -> Ordering {
    let first = |recording: &Recording| recording.time().first().copied();
    let numbers = |a: &[f64], b: &[f64]| {
        let differ = a.iter().zip(b).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne());
        a.len().cmp(&b.len()).then(differ.unwrap_or(Ordering::Equal))
    };
    first(a)
        .cmp(&first(b))
        .then_with(|| numbers(a.position(), b.position()))
        .then_with(|| numbers(a.torque().unwrap_or(&[]), b.torque().unwrap_or(&[])))
        .then_with(|| a.time().cmp(b.time()))
}
