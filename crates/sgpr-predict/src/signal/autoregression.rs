/// An autoregression `x[k] = sum of phi[i] x[k - 1 - i] + innovation`.
#[derive(Clone, Debug, PartialEq)]
pub struct Autoregression {
    /// Coefficients, the latest value's first; none for white noise.
    pub phi: Vec<f64>,
    /// Share of the variance that the innovations have.
    pub innovation: f64,
}

impl Autoregression {
    /// The order that describes a series best by Akaike's criterion.
    ///
    /// - `covariance`: autocovariance by lag, zero first; the last one is the highest order; the
    ///   first one positive
    /// - `count`: values of the series
    ///
    /// Source: N. Levinson (1947), J. Durbin (1960): the Yule-Walker equations solved order by
    /// order.
    pub fn of(covariance: &[f64], count: f64) -> Self {
        let (mut phi, mut error) = (Vec::<f64>::new(), covariance[0]);
        let mut best = (count * error.ln(), Self { phi: vec![], innovation: 1.0 });
        for order in 1..covariance.len() {
            let known: f64 =
                phi.iter().enumerate().map(|(k, p)| p * covariance[order - 1 - k]).sum();
            let reflection = (covariance[order] - known) / error;
            if reflection.is_nan() || reflection.abs() >= 0.999 {
                break;
            }
            phi = Self::of_next_order(&phi, reflection);
            error *= 1.0 - reflection * reflection;
            let criterion = count * error.ln() + 2.0 * order as f64;
            if criterion < best.0 {
                best = (criterion, Self { phi: phi.clone(), innovation: error / covariance[0] });
            }
        }
        best.1
    }

    /// The coefficients of the next order, which has one more partial autocorrelation.
    ///
    /// Source: as of [`Self::of`].
    pub fn of_next_order(phi: &[f64], partial: f64) -> Vec<f64> {
        let changed = phi.iter().zip(phi.iter().rev()).map(|(p, mirrored)| p - partial * mirrored);
        changed.chain([partial]).collect()
    }
}
