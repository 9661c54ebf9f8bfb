/// Root mean square errors of one joint, N·m (N): of all logs together, then of each.
pub(super) type ByLog = Vec<f64>;

/// Sums of squares and counts: of all logs, then of each.
pub(super) struct LogSums(Vec<(f64, f64)>);

impl LogSums {
    pub fn new(logs: usize) -> Self {
        Self(vec![(0.0, 0.0); 1 + logs])
    }

    pub fn add(&mut self, log: usize, square: f64) {
        for index in [0, 1 + log] {
            self.0[index].0 += square;
            self.0[index].1 += 1.0;
        }
    }

    pub fn roots(&self) -> ByLog {
        self.0.iter().map(|(sum, count)| (sum / count.max(1.0)).sqrt()).collect()
    }
}
