//! The constrained problem that an optimiser solves: criterion and limits as smooth functions with
//! derivatives.

use faer::Mat;

use super::criterion::Objective;
use super::information::Information;
use super::surroundings::Checker;
use super::{Basis, MotionLimits, Trajectory, TrajectorySamples};
use crate::linalg::dot;

/// The functions of a basis in its free directions, at the times of a grid.
#[derive(Debug)]
pub(super) struct MotionGrid {
    time: Vec<f64>,
    /// Positions, velocities, accelerations: `[times, free]`.
    tables: [Vec<f64>; 3],
    free: usize,
}

impl MotionGrid {
    pub fn new(basis: &Basis, free: &[Vec<f64>], points: usize) -> Self {
        let time: Vec<f64> =
            (0..points).map(|k| (k as f64 + 0.5) * basis.duration() / points as f64).collect();
        let mut tables = [vec![], vec![], vec![]];
        let mut functions =
            [vec![0.0; basis.len()], vec![0.0; basis.len()], vec![0.0; basis.len()]];
        for &time in &time {
            let [value, slope, curvature] = &mut functions;
            basis.evaluate(time, [value, slope, curvature]);
            for (table, function) in tables.iter_mut().zip(&functions) {
                table.extend(free.iter().map(|direction| dot(direction, function)));
            }
        }
        Self { time, tables, free: free.len() }
    }

    /// Motion with these variables, `[n, free]`.
    pub fn samples(&self, start: &[f64], x: &[f64]) -> TrajectorySamples {
        let n = start.len();
        let [q, dq, ddq] = [0, 1, 2].map(|order| {
            let mut values = Vec::with_capacity(self.time.len() * n);
            for row in self.tables[order].chunks_exact(self.free) {
                for (start, own) in start.iter().zip(x.chunks_exact(self.free)) {
                    values.push(dot(row, own) + if order == 0 { *start } else { 0.0 });
                }
            }
            values
        });
        TrajectorySamples { time: self.time.clone(), q, dq, ddq }
    }

    /// Adds the derivative by the variables to `gradient`, from that by the motion.
    pub fn pull_back(&self, by_motion: &[Vec<f64>; 3], gradient: &mut [f64]) {
        let n = gradient.len() / self.free;
        for (table, by) in self.tables.iter().zip(by_motion) {
            for (row, by) in table.chunks_exact(self.free).zip(by.chunks_exact(n)) {
                for (by, own) in by.iter().zip(gradient.chunks_exact_mut(self.free)) {
                    own.iter_mut().zip(row).for_each(|(own, function)| *own += by * function);
                }
            }
        }
    }
}

/// How exactly condition numbers and maxima are taken: sharper is truer, and harder to descend on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sharpness {
    /// Power of the smooth condition number.
    pub power: f64,
    /// Of the smooth maximum, per share of a limit.
    pub maximum: f64,
}

/// Speeds within which sgn is smoothed out, as a share of the speed limit.
pub(super) const SIGN_WIDTH: f64 = 0.01;

/// What the torque limits are checked with.
#[derive(Debug)]
pub(super) struct TorqueLimits {
    pub limits: Vec<f64>,
    pub base_parameters: Vec<f64>,
}

#[derive(Debug)]
pub(super) struct MotionProblem<'a> {
    pub information: Information<'a>,
    pub objective: &'a Objective,
    pub limits: &'a MotionLimits,
    pub torque: Option<&'a TorqueLimits>,
    pub surroundings: Option<Checker<'a>>,
    pub start: &'a [f64],
    /// Samples of the criterion and of the torque.
    pub grid: &'a MotionGrid,
    /// Denser samples of the limits of position, speed and acceleration.
    pub limit_grid: &'a MotionGrid,
    pub sharpness: Sharpness,
}

/// Step of the central differences of distances and speeds, rad (m) and per s.
const DIFFERENCE: f64 = 1e-6;

/// The same of the columns of nominal effects, by the variables of the motion.
const NOMINAL_DIFFERENCE: f64 = 1e-5;

/// Value of a motion without any information: finite, so that a line search turns back.
const WORTHLESS: f64 = 1e3;

impl MotionProblem<'_> {
    /// Number of constraints.
    pub fn constraints(&self) -> usize {
        3 * self.start.len()
            + usize::from(self.torque.is_some())
            + usize::from(self.surroundings.is_some())
    }

    /// The largest constraint, if it is above zero: by how much of a limit the smooth maximum
    /// exceeds it.
    pub fn violation(&mut self, x: &[f64]) -> f64 {
        (0..self.constraints()).map(|index| self.constraint(index, x, None)).fold(0.0, f64::max)
    }

    /// What the criterion loses per share by which a motion has to be made smaller: all entries of
    /// W shrink together in a determinant; a condition number hardly changes.
    pub fn price_of_scaling(&self) -> f64 {
        if self.objective.is_condition() { 2.0 } else { 4.0 * self.information.parameters() as f64 }
    }

    /// The criterion (logarithm of a condition number) and its derivative.
    pub fn value(&mut self, x: &[f64], gradient: Option<&mut [f64]>) -> f64 {
        let samples = self.grid.samples(self.start, x);
        if samples.ddq.iter().chain(&samples.q).any(|value| !value.is_finite()) {
            return WORTHLESS;
        }
        self.information.observe(&samples);
        let (value, mut by_matrix) = self
            .objective
            .value_and_derivative(&self.information.matrix(), Some(self.sharpness.power));
        if !value.is_finite() {
            if let Some(gradient) = gradient {
                gradient.fill(0.0);
            }
            return WORTHLESS;
        }
        let mut result = value;
        if self.objective.is_condition() {
            result = value.ln();
            by_matrix *= faer::Scale(1.0 / value);
        }
        if let Some(gradient) = gradient {
            gradient.fill(0.0);
            let pull = self.information.by_rows(&by_matrix);
            let by_motion = self.information.by_motion(&samples, &pull);
            self.grid.pull_back(&by_motion, gradient);
            self.add_nominal(x, &samples, &pull, gradient);
        }
        result
    }

    /// Adds the share of the nominal effects to the derivative of the criterion, by differences
    /// along the variables: their columns are any function of the motion. Where a sample changes
    /// its direction between the two sides, friction jumps, and the side without the jump counts.
    fn add_nominal(
        &self,
        x: &[f64],
        samples: &TrajectorySamples,
        pull: &Mat<f64>,
        gradient: &mut [f64],
    ) {
        let Some(here) = self.information.along_nominal(samples, pull) else { return };
        let mut moved = x.to_vec();
        for (k, slope) in gradient.iter_mut().enumerate() {
            let step = NOMINAL_DIFFERENCE * (1.0 + x[k].abs());
            let mut side = |step: f64| {
                moved[k] = x[k] + step;
                let there =
                    self.information.along_nominal(&self.grid.samples(self.start, &moved), pull);
                moved[k] = x[k];
                (there.unwrap_or(here) - here) / step
            };
            let [above, below] = [side(step), side(-step)];
            let jump = (above - below).abs() > 0.1 * above.abs().max(below.abs());
            let least = if above.abs() < below.abs() { above } else { below };
            *slope += if jump { least } else { 0.5 * (above + below) };
        }
    }

    /// Constraint `index`, not above zero where the limit is kept, and its derivative: joint by
    /// joint position, speed, acceleration; then the torque of all joints, then the surroundings.
    pub fn constraint(&mut self, index: usize, x: &[f64], gradient: Option<&mut [f64]>) -> f64 {
        let n = self.start.len();
        if index >= 3 * n {
            let torque = index == 3 * n && self.torque.is_some();
            return if torque {
                self.torque_constraint(x, gradient)
            } else {
                self.clearance_constraint(x, gradient)
            };
        }
        let (joint, order) = (index / 3, index % 3);
        let free = self.limit_grid.free;
        let own = &x[joint * free..(joint + 1) * free];
        let table = &self.limit_grid.tables[order];
        // share = offset + scale · value, a limit being at ±1.
        let (offset, scale) = match order {
            0 => {
                let [low, high] = self.limits.position[joint];
                (self.limits.position_share(joint, self.start[joint]), 2.0 / (high - low))
            }
            1 => (0.0, 1.0 / self.limits.velocity[joint]),
            _ => (0.0, 1.0 / self.limits.acceleration[joint]),
        };
        let shares: Vec<f64> =
            table.chunks_exact(free).map(|row| offset + scale * dot(row, own)).collect();
        let (value, slopes) = smooth_maximum(&shares, self.sharpness.maximum);
        if let Some(gradient) = gradient {
            gradient.fill(0.0);
            let own = &mut gradient[joint * free..(joint + 1) * free];
            for (slope, row) in slopes.iter().zip(table.chunks_exact(free)) {
                own.iter_mut()
                    .zip(row)
                    .for_each(|(own, function)| *own += slope * scale * function);
            }
        }
        value - 1.0
    }

    fn clearance_constraint(&mut self, x: &[f64], gradient: Option<&mut [f64]>) -> f64 {
        let Some(checker) = &mut self.surroundings else { return -1.0 };
        let (n, checks) = (self.start.len(), checker.len());
        let samples = self.limit_grid.samples(self.start, x);
        let mut shares = vec![0.0; samples.len() * checks];
        let state = |k: usize| (&samples.q[k * n..(k + 1) * n], &samples.dq[k * n..(k + 1) * n]);
        for (k, row) in shares.chunks_exact_mut(checks).enumerate() {
            let (q, dq) = state(k);
            checker.shares(q, dq, row);
        }
        let (value, slopes) = smooth_upper(&shares, self.sharpness.maximum);
        if let Some(gradient) = gradient {
            gradient.fill(0.0);
            let mut by_motion = [
                vec![0.0; samples.q.len()],
                vec![0.0; samples.q.len()],
                vec![0.0; samples.q.len()],
            ];
            let (mut above, mut below) = (vec![0.0; checks], vec![0.0; checks]);
            for (k, slopes) in slopes.chunks_exact(checks).enumerate() {
                // Most samples are far from everything.
                if slopes.iter().all(|slope| *slope < 1e-9) {
                    continue;
                }
                let (q, dq) = state(k);
                let mut moved = [q.to_vec(), dq.to_vec()];
                for kind in 0..2 {
                    for joint in 0..n {
                        let here = moved[kind][joint];
                        moved[kind][joint] = here + DIFFERENCE;
                        checker.shares(&moved[0], &moved[1], &mut above);
                        moved[kind][joint] = here - DIFFERENCE;
                        checker.shares(&moved[0], &moved[1], &mut below);
                        moved[kind][joint] = here;
                        let change = above
                            .iter()
                            .zip(&below)
                            .zip(slopes)
                            .map(|((a, b), slope)| slope * (a - b));
                        by_motion[kind][k * n + joint] = change.sum::<f64>() / (2.0 * DIFFERENCE);
                    }
                }
            }
            self.limit_grid.pull_back(&by_motion, gradient);
        }
        value - 1.0
    }

    fn torque_constraint(&mut self, x: &[f64], gradient: Option<&mut [f64]>) -> f64 {
        let Some(torque) = self.torque else { return -1.0 };
        let n = self.start.len();
        let samples = self.grid.samples(self.start, x);
        self.information.observe(&samples);
        let tau = self.information.torque(&torque.base_parameters);
        let shares: Vec<f64> =
            tau.iter().enumerate().map(|(row, tau)| tau / torque.limits[row % n]).collect();
        let (value, slopes) = smooth_maximum(&shares, self.sharpness.maximum);
        if let Some(gradient) = gradient {
            gradient.fill(0.0);
            let factor = |row: usize| {
                slopes[row] / (torque.limits[row % n] * self.information.weight(row % n))
            };
            let pull = Mat::from_fn(torque.base_parameters.len(), tau.len(), |column, row| {
                torque.base_parameters[column] * factor(row)
            });
            let by_motion = self.information.by_motion(&samples, &pull);
            self.grid.pull_back(&by_motion, gradient);
        }
        value - 1.0
    }
}

/// The motion with these variables, `[n, free]`.
pub(super) fn trajectory(basis: &Basis, free: &[Vec<f64>], start: &[f64], x: &[f64]) -> Trajectory {
    let mut coefficients = Vec::with_capacity(start.len() * basis.len());
    for own in x.chunks_exact(free.len()) {
        coefficients.extend(
            (0..basis.len())
                .map(|k| own.iter().zip(free).map(|(x, direction)| x * direction[k]).sum::<f64>()),
        );
    }
    Trajectory::new(basis.clone(), start.to_vec(), coefficients).expect("a basis that was checked")
}

/// ln(sum exp(s |values|)) / s, never below the largest size, and its derivatives.
///
/// Source: G. Kreisselmeier, R. Steinhauser, Systematic control design by optimizing a vector
/// performance index, IFAC Symposium on CAD of Control Systems (1979).
fn smooth_maximum(values: &[f64], sharpness: f64) -> (f64, Vec<f64>) {
    let most = values.iter().fold(0.0f64, |most, value| most.max(value.abs()));
    let mut sum = 0.0;
    let mut slopes: Vec<f64> = Vec::with_capacity(values.len());
    for value in values {
        let up = (sharpness * (value - most)).exp();
        let down = (sharpness * (-value - most)).exp();
        sum += up + down;
        slopes.push(up - down);
    }
    slopes.iter_mut().for_each(|slope| *slope /= sum);
    (most + sum.ln() / sharpness, slopes)
}

/// ln(sum exp(s values)) / s, and its derivatives.
fn smooth_upper(values: &[f64], sharpness: f64) -> (f64, Vec<f64>) {
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut slopes: Vec<f64> =
        values.iter().map(|value| (sharpness * (value - most)).exp()).collect();
    let sum: f64 = slopes.iter().sum();
    slopes.iter_mut().for_each(|slope| *slope /= sum);
    (most + sum.ln() / sharpness, slopes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::excitation::{Criterion, NominalEffects, Surroundings, nominal_terms};
    use crate::identification::{BaseParameters, ParameterSet};
    use crate::robot::puma560;

    type Function<'a> = &'a mut dyn FnMut(&[f64], Option<&mut [f64]>) -> f64;

    #[test]
    fn derivatives_agree_with_differences() {
        let robot = puma560();
        let set = ParameterSet::new(&robot, &["viscous_friction", "coulomb_friction"])
            .expect("known effects");
        let base = BaseParameters::new(&robot, &set);
        let limits = MotionLimits::of_robot(&robot, &[6.0; 6]).expect("limits");
        let basis = Basis::fourier(0.1, 4);
        let free = basis.free_directions();
        let (grid, limit_grid) =
            (MotionGrid::new(&basis, &free, 40), MotionGrid::new(&basis, &free, 64));
        let start = [0.1; 6];
        let x: Vec<f64> = (0..6 * free.len()).map(|k| 0.4 * (1.3 * k as f64 + 0.2).sin()).collect();
        let mut parameters = robot.standard_parameters();
        parameters.extend([5.0; 12]);
        let torque = TorqueLimits {
            limits: vec![90.0, 200.0, 80.0, 20.0, 15.0, 12.0],
            base_parameters: base.combine(&parameters),
        };
        let mut cell = Surroundings::skeleton(&robot, 0.05);
        cell.floor = Some(-0.6);
        cell.self_collision = true;
        cell.tip_speed = robot.frames().last().map(|frame| (frame.clone(), 2.0));
        for criterion in Criterion::ALL {
            let objective = Objective::new(criterion, &robot, &set, &base, None);
            let noise = [0.5, 0.7, 0.2, 0.1, 0.1, 0.3];
            let mut problem = MotionProblem {
                information: Information::new(&robot, &set, &base, None, Some(&noise), 0.1),
                objective: &objective,
                limits: &limits,
                torque: Some(&torque),
                surroundings: Some(Checker::new(&robot, &cell)),
                start: &start,
                grid: &grid,
                limit_grid: &limit_grid,
                sharpness: Sharpness { power: 4.0, maximum: 30.0 },
            };
            let constraints = problem.constraints();
            let check = |what: &str, f: Function<'_>| {
                let mut gradient = vec![0.0; x.len()];
                f(&x, Some(&mut gradient));
                let scale = gradient.iter().fold(0.0f64, |most, g| most.max(g.abs()));
                for k in (0..x.len()).step_by(5) {
                    let mut moved = x.clone();
                    let h = 1e-6;
                    moved[k] += h;
                    let above = f(&moved, None);
                    moved[k] -= 2.0 * h;
                    let difference = (above - f(&moved, None)) / (2.0 * h);
                    let error = (difference - gradient[k]).abs();
                    assert!(
                        error < 2e-5 * scale,
                        "{criterion:?} {what} by {k}: {difference} {}",
                        gradient[k]
                    );
                }
            };
            check("value", &mut |x, gradient| problem.value(x, gradient));
            if criterion == Criterion::Condition {
                for index in 0..constraints {
                    check(&format!("constraint {index}"), &mut |x, gradient| {
                        problem.constraint(index, x, gradient)
                    });
                }
            }
        }
    }

    /// Of smooth columns: a delay, a tilted base.
    #[test]
    fn derivatives_by_nominal_effects_agree_with_differences() {
        let robot = puma560();
        let set = ParameterSet::new(&robot, &["viscous_friction"]).expect("known effects");
        let base = BaseParameters::new(&robot, &set);
        let mut parameters = robot.standard_parameters();
        parameters.extend([5.0; 6]);
        let mut terms = vec![];
        for name in ["torque_delay", "base_tilt"] {
            let effect = crate::effects::by_name(name).expect("of the library");
            terms.extend(nominal_terms(&robot, &effect, 10.0).expect("shown by a motion"));
        }
        let nominal = NominalEffects::new(&robot, &set, &base, &parameters, terms, 10.0);
        assert_eq!(nominal.len(), 3, "{:?}", nominal.names());
        let limits = MotionLimits::of_robot(&robot, &[6.0; 6]).expect("limits");
        let basis = Basis::fourier(0.1, 5);
        let free = basis.free_directions();
        let (grid, limit_grid) =
            (MotionGrid::new(&basis, &free, 60), MotionGrid::new(&basis, &free, 64));
        let start = [0.1; 6];
        let mut x: Vec<f64> =
            (0..6 * free.len()).map(|k| 2.0 * (1.3 * k as f64 + 0.2).sin()).collect();
        let objective = Objective::new(Criterion::DOptimality, &robot, &set, &base, Some(&nominal));
        let mut problem = MotionProblem {
            information: Information::new(&robot, &set, &base, Some(&nominal), None, 0.1),
            objective: &objective,
            limits: &limits,
            torque: None,
            surroundings: None,
            start: &start,
            grid: &grid,
            limit_grid: &limit_grid,
            sharpness: Sharpness { power: 4.0, maximum: 30.0 },
        };
        let mut gradient = vec![0.0; x.len()];
        assert!(
            problem.value(&x, Some(&mut gradient)) < WORTHLESS,
            "columns that the motion tells apart"
        );
        let scale = gradient.iter().fold(0.0f64, |most, g| most.max(g.abs()));
        for k in (0..x.len()).step_by(7) {
            let (h, here) = (1e-5, x[k]);
            x[k] = here + h;
            let above = problem.value(&x, None);
            x[k] = here - h;
            let below = problem.value(&x, None);
            x[k] = here;
            let difference = (above - below) / (2.0 * h);
            // Columns by constants are differences themselves.
            assert!(
                (gradient[k] - difference).abs() < 1e-3 * scale,
                "{k}: {} {difference}",
                gradient[k]
            );
        }
    }
}
