//! Pieces of a long log, and a processing as text.

use super::{MotionError, Processing};
use crate::signal::{LowPass, SignalError};

impl Processing {
    /// Samples at this rate by which position filter, derivatives, and the filter of the equation
    /// reach over the end of a piece of a log, to fifteen digits, and by which a turn or a rest
    /// reaches over its own end.
    ///
    /// # Errors
    /// If the rate cannot hold the cut-offs.
    pub fn reach(&self, rate_hz: f64) -> Result<usize, MotionError> {
        /// Memory of a filter to fifteen digits, in settling times to one percent.
        const SETTLINGS: usize = 8;
        let mut samples = self.differentiation.edge();
        for cutoff_hz in [Some(self.cutoff_hz), self.torque_cutoff_hz].into_iter().flatten() {
            samples += SETTLINGS
                * LowPass::butterworth(self.order, cutoff_hz, rate_hz)?.settling_samples();
        }
        let period = rate_hz / self.cutoff_hz;
        Ok(samples + (self.turn_margin.max(1.0) * period).ceil() as usize)
    }

    /// Torques of one stretch through the filter of the equations, in place, `[samples, columns]`
    /// row-major.
    ///
    /// # Errors
    /// If the rate cannot hold the cut-off, or the stretch is shorter than the filter.
    ///
    /// # Panics
    /// If `values` does not hold whole rows.
    pub fn in_band(
        &self,
        values: &mut [f64],
        columns: usize,
        rate_hz: f64,
    ) -> Result<(), MotionError> {
        if let Some(filter) = self.band_filter(rate_hz)? {
            filter.apply(values, columns)?;
        }
        Ok(())
    }

    /// The filter on both sides of the equations, if there is one.
    ///
    /// # Errors
    /// If the rate cannot hold the cut-off.
    pub(crate) fn band_filter(&self, rate_hz: f64) -> Result<Option<LowPass>, SignalError> {
        self.torque_cutoff_hz.map(|hz| LowPass::butterworth(self.order, hz, rate_hz)).transpose()
    }

    /// The processing as text.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("plain data")
    }

    /// The processing that [`Self::to_json`] wrote.
    ///
    /// # Errors
    /// What is wrong with the text.
    pub fn from_json(text: &str) -> Result<Self, String> {
        let processing: Self =
            serde_json::from_str(text).map_err(|error| format!("no processing: {error}"))?;
        processing.check(processing.standstill_speed.len()).map_err(|error| error.to_string())?;
        Ok(processing)
    }
}
