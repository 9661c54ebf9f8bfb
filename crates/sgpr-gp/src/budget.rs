/// How a process of many points is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Inference {
    /// Exactly, with all points.
    Exact,
    /// Through so many inducing points, with all data points.
    Sparse {
        /// Inducing points.
        inducing: usize,
    },
    /// Exactly, with so many of the most informative points; what the others say is lost.
    Subset {
        /// Points.
        points: usize,
    },
}

/// Fewer inducing points than this see less than an exact process of part of the points.
const FEWEST_INDUCING: usize = 50;

impl Inference {
    /// Its name in files, tables and other languages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Sparse { .. } => "sparse",
            Self::Subset { .. } => "subset",
        }
    }

    /// What one likelihood with gradient may cost: as much as an exact one of `budget` points,
    /// which takes budget³ operations. So many `points` are taken exactly if they are within it; of
    /// more, as many inducing points m as cost the same, 3 n m² = budget³; if these were too few to
    /// be of use, or the covariance has correlated noise, which no sparse process can have, an
    /// exact process of the `budget` most informative points.
    ///
    /// # Examples
    /// ```
    /// use sgpr_gp::Inference;
    /// assert_eq!(Inference::within(4000, 3000, false), Inference::Exact);
    /// assert_eq!(Inference::within(4000, 1_000_000, false), Inference::Sparse { inducing: 146 });
    /// assert_eq!(Inference::within(4000, 1_000_000, true), Inference::Subset { points: 4000 });
    /// ```
    pub fn within(budget: usize, points: usize, correlated_noise: bool) -> Self {
        if points <= budget {
            return Self::Exact;
        }
        let inducing = ((budget as f64).powi(3) / (3.0 * points as f64)).sqrt() as usize;
        if correlated_noise || inducing < FEWEST_INDUCING {
            return Self::Subset { points: budget };
        }
        Self::Sparse { inducing }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sparse_process_costs_no_more_than_the_budget() {
        for points in [1001, 5000, 100_000, 132_000, 140_000, 10_000_000] {
            match Inference::within(1000, points, false) {
                Inference::Sparse { inducing } => {
                    assert!(
                        3 * points * inducing * inducing <= 1_000_000_000
                            && inducing >= FEWEST_INDUCING
                    );
                    assert!(
                        3 * points * (inducing + 1) * (inducing + 1) > 1_000_000_000,
                        "not less than it allows"
                    );
                }
                other => {
                    assert_eq!(other, Inference::Subset { points: 1000 });
                    assert!(3 * points * FEWEST_INDUCING * FEWEST_INDUCING > 1_000_000_000);
                }
            }
        }
        assert_eq!(Inference::within(1000, 1000, true), Inference::Exact);
    }
}
