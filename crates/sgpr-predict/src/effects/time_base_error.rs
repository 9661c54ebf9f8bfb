use alloc::vec::Vec;

use super::{About, Class, Effect, Entry, Origin};

/// Jitter, lost samples, wrong units or signs: found by the checks of the log before any physics
/// (`recording::inspect`).
///
/// Source: checks of `recording::inspect`.
#[derive(Clone, Copy, Debug)]
pub(super) struct TimeBaseError;

impl Effect for TimeBaseError {
    fn name(&self) -> &str {
        "time_base_error"
    }

    fn summary(&self) -> &str {
        "Wrong times, units or signs in the log."
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

    fn parameters(&self) -> &[super::EffectParameter] {
        &[]
    }

    fn entry(&self) -> Entry {
        Entry::Gate
    }

    fn sites(&self, _: &crate::robot::Robot) -> Vec<super::Site> {
        vec![]
    }
}
