//! Minimisation within bounds, with the best point kept whatever happens.

use std::cell::RefCell;

use basin::{
    BoxBounds, ConstraintDescription, ConstraintSet, Constraints, CostFunction, Executor, Gradient,
    Lbfgs, Termination,
};

use super::GpError;

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SearchStatus {
    /// At a stationary point, or where no step gains anything more.
    Converged,
    /// Out of evaluations: the result is the best so far.
    EvaluationLimit,
    /// No step along the last direction gained anything: the result is the best so far.
    NoProgress,
    /// The listener asked to stop: the result is the best so far.
    Stopped,
}

/// Result of a minimisation.
#[derive(Clone, Debug)]
pub(crate) struct Minimum {
    pub at: Vec<f64>,
    pub value: f64,
    pub status: SearchStatus,
    pub evaluations: usize,
}

/// When a minimisation ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StoppingCriteria {
    pub evaluations: usize,
    /// Gain of a step, relative to the value, below which there is no use in going on.
    pub gain: f64,
    /// Largest derivative at a minimum.
    pub gradient: f64,
}

/// Value and gradient; `Err` ends the search.
type Evaluate<'a> = dyn FnMut(&[f64]) -> Result<(f64, Vec<f64>), GpError> + 'a;

/// Minimises by L-BFGS-B from `start`. Points at which the function cannot be computed count as
/// very bad ones; the search ends early if the listener stops it.
///
/// Source: R. H. Byrd, P. Lu, J. Nocedal, C. Zhu, A limited memory algorithm for bound constrained
/// optimization, SIAM J. Sci. Comput. 16(5) (1995), as built in the crate basin.
///
/// # Errors
/// If not even the start could be evaluated.
pub(crate) fn minimise(
    start: &[f64],
    lower: &[f64],
    upper: &[f64],
    limits: StoppingCriteria,
    evaluate: &mut Evaluate<'_>,
) -> Result<Minimum, GpError> {
    let start: Vec<f64> =
        start.iter().zip(lower.iter().zip(upper)).map(|(x, (l, u))| x.clamp(*l, *u)).collect();
    let state = RefCell::new(MinimiserState { evaluate, best: None, evaluations: 0, ended: None });
    let objective = BoundedFunction {
        lower: lower.to_vec(),
        upper: upper.to_vec(),
        limit: limits.evaluations,
        state: &state,
    };
    let solver = Lbfgs::new()
        .with_relative_cost_reduction_tolerance(limits.gain)
        .with_absolute_projected_gradient_tolerance(limits.gradient);
    let outcome =
        Executor::from_start(objective, solver, start).max_iter(limits.evaluations as u64).run();
    let reached = match &outcome {
        Ok(result) => match result.report.termination {
            Termination::Converged(_) => SearchStatus::Converged,
            _ => SearchStatus::NoProgress,
        },
        Err(_) => SearchStatus::NoProgress,
    };
    drop(outcome);
    let MinimiserState { best, evaluations, ended, .. } = state.into_inner();
    let status = match &ended {
        Some(GpError::Interrupted(_)) => SearchStatus::Stopped,
        Some(_) => SearchStatus::NoProgress,
        None if evaluations >= limits.evaluations => SearchStatus::EvaluationLimit,
        None => reached,
    };
    match (best, ended) {
        (Some((value, at)), _) => Ok(Minimum { at, value, status, evaluations }),
        (None, Some(error)) => Err(error),
        (None, None) => Err(GpError::NotPositiveDefinite { jitter: 0.0 }),
    }
}

struct BoundedFunction<'s, 'a, 'b> {
    lower: Vec<f64>,
    upper: Vec<f64>,
    limit: usize,
    state: &'s RefCell<MinimiserState<'a, 'b>>,
}

struct MinimiserState<'a, 'b> {
    evaluate: &'a mut Evaluate<'b>,
    best: Option<(f64, Vec<f64>)>,
    evaluations: usize,
    ended: Option<GpError>,
}

/// The search is to end.
#[derive(Debug)]
struct Ended;

impl Constraints for BoundedFunction<'_, '_, '_> {
    type Set = ConstraintSet<BoxBounds<Vec<f64>>>;

    fn constraints(&self) -> <Self::Set as ConstraintDescription>::Borrowed<'_> {
        ConstraintSet::new().with_bounds(BoxBounds::new(Some(&self.lower), Some(&self.upper)))
    }
}

impl CostFunction for BoundedFunction<'_, '_, '_> {
    type Param = Vec<f64>;
    type Output = f64;
    type Error = Ended;

    fn cost(&self, x: &Vec<f64>) -> Result<f64, Ended> {
        self.cost_and_gradient(x).map(|(value, _)| value)
    }
}

impl Gradient for BoundedFunction<'_, '_, '_> {
    type Gradient = Vec<f64>;

    fn gradient(&self, x: &Vec<f64>) -> Result<Vec<f64>, Ended> {
        self.cost_and_gradient(x).map(|(_, gradient)| gradient)
    }

    fn cost_and_gradient(&self, x: &Vec<f64>) -> Result<(f64, Vec<f64>), Ended> {
        let mut state = self.state.borrow_mut();
        if state.evaluations >= self.limit {
            return Err(Ended);
        }
        state.evaluations += 1;
        match (state.evaluate)(x) {
            Ok((value, gradient))
                if value.is_finite() && gradient.iter().all(|g| g.is_finite()) =>
            {
                if state.best.as_ref().is_none_or(|(best, _)| value < *best) {
                    state.best = Some((value, x.clone()));
                }
                Ok((value, gradient))
            }
            Ok(_) | Err(GpError::NotPositiveDefinite { .. }) => {
                let Some((best, _)) = &state.best else {
                    state.ended = Some(GpError::NotPositiveDefinite { jitter: 0.0 });
                    return Err(Ended);
                };
                // A wall, so that the line search turns back.
                Ok((best.abs() * 10.0 + 1e6, vec![0.0; x.len()]))
            }
            Err(error) => {
                state.ended = Some(error);
                Err(Ended)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sgpr_numeric::progress::Interrupted;

    /// Rosenbrock's valley, minimum at (1, 1).
    fn rosenbrock(x: &[f64]) -> (f64, Vec<f64>) {
        let (a, b) = (1.0 - x[0], x[1] - x[0] * x[0]);
        (a * a + 100.0 * b * b, vec![-2.0 * a - 400.0 * b * x[0], 200.0 * b])
    }

    const LIMITS: StoppingCriteria =
        StoppingCriteria { evaluations: 200, gain: 1e-15, gradient: 1e-9 };

    #[test]
    fn finds_a_minimum_inside_and_on_a_bound() {
        let mut function = |x: &[f64]| Ok(rosenbrock(x));
        let free = minimise(&[-1.2, 1.0], &[-5.0; 2], &[5.0; 2], LIMITS, &mut function)
            .expect("evaluated");
        assert!(
            (free.at[0] - 1.0).abs() < 1e-6 && free.status == SearchStatus::Converged,
            "{free:?}"
        );
        let bound = minimise(&[-1.2, 1.0], &[-5.0; 2], &[0.5, 5.0], LIMITS, &mut function)
            .expect("evaluated");
        assert!(
            (bound.at[0] - 0.5).abs() < 1e-12 && (bound.at[1] - 0.25).abs() < 1e-6,
            "{bound:?}"
        );
    }

    #[test]
    fn keeps_the_best_when_stopped_or_out_of_evaluations() {
        let mut count = 0;
        let mut best = f64::INFINITY;
        let mut stopping = |x: &[f64]| {
            count += 1;
            if count > 7 {
                return Err(Interrupted.into());
            }
            best = best.min(rosenbrock(x).0);
            Ok(rosenbrock(x))
        };
        let stopped = minimise(&[-1.2, 1.0], &[-5.0; 2], &[5.0; 2], LIMITS, &mut stopping)
            .expect("seven points");
        assert_eq!((stopped.status, stopped.value), (SearchStatus::Stopped, best));
        let few = StoppingCriteria { evaluations: 5, ..LIMITS };
        let few = minimise(&[-1.2, 1.0], &[-5.0; 2], &[5.0; 2], few, &mut |x| Ok(rosenbrock(x)))
            .expect("five");
        assert_eq!((few.status, few.evaluations), (SearchStatus::EvaluationLimit, 5));
        let none =
            minimise(&[0.0; 2], &[-5.0; 2], &[5.0; 2], LIMITS, &mut |_| Err(Interrupted.into()));
        assert_eq!(none.expect_err("nothing"), GpError::Interrupted(Interrupted));
    }
}
