use alloc::vec::Vec;

use super::{About, Class, Effect, Entry, Origin, facts};

/// Jitter, lost samples, wrong units or signs: found by the checks of the log before any physics
/// (`recording::inspect`).
///
/// Source: checks of `recording::inspect`.
#[derive(Clone, Copy, Debug)]
pub(super) struct TimeBaseError;

impl Effect for TimeBaseError {
    facts! {
        name: "time_base_error",
        summary: "Wrong times, units or signs in the log.",
        parameters: &[],
        entry: Entry::Gate,
    }

    fn about(&self) -> About<'_> {
        About {
            class: Class::Gate,
            formula: "",
            source: "checks of `recording::inspect`.",
            signature: "found before any physics",
            confusable: &[],
            experiment: "repair the log",
            excitation: "",
            origin: Origin::Measurement,
            origin_reason: "times, units or signs of the log are wrong",
            ..About::default()
        }
    }

    fn sites(&self, _: &crate::robot::Robot) -> Vec<super::Site> {
        vec![]
    }
}
