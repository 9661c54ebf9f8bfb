//! Which rows of the equations belong together: those of a joint that moves, and those of one at
//! rest.

use super::autocorrelation::Memory;
use super::{Equation, Equations, IdentificationError, JointFactor};

/// Per factor: the residuals that `base` leaves, in the order of time.
pub(super) fn memories(
    equations: &mut Equations<'_>,
    factors: &[JointFactor],
    base: &[f64],
) -> Result<Vec<Memory>, IdentificationError> {
    let group = Groups::of(factors);
    let mut memories = vec![Memory::default(); factors.len()];
    let steps: Vec<usize> =
        equations.trajectories().iter().map(|trajectory| trajectory.decimation).collect();
    equations.for_each(|equation| {
        let time = equation.sample / steps[equation.trajectory];
        if let Some(index) = group.index(&equation) {
            memories[index].push(equation.trajectory, time, equation.residual(base));
        }
    })?;
    Ok(memories)
}

/// Which factor an equation belongs to.
pub(super) struct Groups(Vec<[Option<usize>; 2]>);

impl Groups {
    pub fn of(factors: &[JointFactor]) -> Self {
        let joints = factors.iter().map(|factor| factor.joint + 1).max().unwrap_or(0);
        let mut index = vec![[None; 2]; joints];
        for (position, factor) in factors.iter().enumerate() {
            index[factor.joint][usize::from(factor.resting)] = Some(position);
        }
        Self(index)
    }

    /// None for an equation that does not count: of a joint that stands still in all logs.
    pub fn index(&self, equation: &Equation<'_>) -> Option<usize> {
        self.0.get(equation.joint).and_then(|of_joint| of_joint[usize::from(equation.resting)])
    }
}
