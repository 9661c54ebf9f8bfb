#![allow(missing_docs, reason = "hidden: for those who make code of a model")]

use crate::effects::Stepped;

/// What the next sample is to the hidden states.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StreamStart<S = f64> {
    /// They start with it at rest.
    AtRest,
    /// They start with it in a motion of constant speed.
    Moving,
    /// They have started.
    Done,
    /// Not known yet.
    Either {
        /// Above zero if they have started.
        done: S,
        /// One if they start in a motion, zero if they start at rest.
        moving: S,
    },
}

impl<S: Stepped> StreamStart<S> {
    /// Starts hidden states, if this sample does.
    pub fn apply(&self, hidden: &mut [S], start: impl FnOnce(&mut [S])) {
        match *self {
            Self::Done => {}
            Self::AtRest | Self::Moving => start(hidden),
            Self::Either { done, .. } => {
                let before = hidden.to_vec();
                start(hidden);
                hidden
                    .iter_mut()
                    .zip(before)
                    .for_each(|(started, before)| *started = done.where_positive(before, *started));
            }
        }
    }

    pub fn is_done(&self) -> bool {
        matches!(self, Self::Done)
    }
}
