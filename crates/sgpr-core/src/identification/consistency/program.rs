//! A conic program, built row by row and solved by clarabel.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus,
    SupportedConeT::{
        self, ExponentialConeT, NonnegativeConeT, PSDTriangleConeT, SecondOrderConeT, ZeroConeT,
    },
};

// The symbols that clarabel's cone of semidefinite matrices calls.
#[cfg(feature = "bundled-lapack")]
extern crate sgpr_lapack as _;

/// constant + sum of factor * variable.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Affine {
    pub terms: Vec<(usize, f64)>,
    pub constant: f64,
}

impl Affine {
    pub fn constant(constant: f64) -> Self {
        Self { terms: vec![], constant }
    }

    pub fn variable(index: usize, factor: f64) -> Self {
        Self { terms: vec![(index, factor)], constant: 0.0 }
    }

    pub fn plus(mut self, constant: f64) -> Self {
        self.constant += constant;
        self
    }

    pub fn scaled(mut self, factor: f64) -> Self {
        self.terms.iter_mut().for_each(|(_, value)| *value *= factor);
        self.constant *= factor;
        self
    }

    pub fn and(mut self, other: Self) -> Self {
        self.terms.extend(other.terms);
        self.constant += other.constant;
        self
    }

    pub fn value(&self, x: &[f64]) -> f64 {
        self.constant + self.terms.iter().map(|(index, factor)| factor * x[*index]).sum::<f64>()
    }
}

/// Where the solver cannot get closer: objectives count half squared standard deviations, of which
/// a hundredth is nothing.
const WORTHLESS: f64 = 1e-2;

/// Squares of larger numbers are soon infinite, where the solver stops the program.
const LARGEST: f64 = 1e100;

/// Minimise 1/2 sum of curvature x² + slope x under conic constraints.
#[derive(Clone, Debug, Default)]
pub(super) struct ConicProgram {
    curvature: Vec<f64>,
    slope: Vec<f64>,
    rows: Vec<Affine>,
    cones: Vec<SupportedConeT<f64>>,
}

/// How a program ended.
#[derive(Clone, Debug)]
pub(super) struct ConicOutcome {
    pub x: Vec<f64>,
    pub status: ConicStatus,
    pub iterations: u32,
    pub seconds: f64,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum ConicStatus {
    /// To full or slightly reduced accuracy.
    Solved,
    Infeasible,
    /// With the solver's word for it.
    Failed(String),
}

impl ConicProgram {
    /// New variables; the index of the first.
    pub fn variables(&mut self, count: usize) -> usize {
        let first = self.slope.len();
        self.slope.resize(first + count, 0.0);
        self.curvature.resize(first + count, 0.0);
        first
    }

    /// Adds `weight`/2 (x - centre)² to the objective.
    pub fn add_square(&mut self, variable: usize, centre: f64, weight: f64) {
        self.curvature[variable] += weight;
        self.slope[variable] -= weight * centre;
    }

    /// Adds an affine term to the objective; its constant does not matter.
    pub fn add_cost(&mut self, cost: &Affine) {
        for &(variable, factor) in &cost.terms {
            self.slope[variable] += factor;
        }
    }

    /// row = 0 for all rows.
    pub fn require_zero(&mut self, rows: Vec<Affine>) {
        self.require(ZeroConeT(rows.len()), rows);
    }

    /// row >= 0 for all rows.
    pub fn require_non_negative(&mut self, rows: Vec<Affine>) {
        self.require(NonnegativeConeT(rows.len()), rows);
    }

    /// |others| <= first.
    pub fn require_in_ball(&mut self, rows: Vec<Affine>) {
        self.require(SecondOrderConeT(rows.len()), rows);
    }

    /// `value` <= ln `argument`.
    pub fn require_below_log(&mut self, value: Affine, argument: Affine) {
        self.require(ExponentialConeT(), vec![value, Affine::constant(1.0), argument]);
    }

    /// A symmetric matrix, of which `entry(row, column)` with row <= column is asked, has no
    /// negative eigenvalue.
    pub fn require_semidefinite(&mut self, size: usize, entry: impl Fn(usize, usize) -> Affine) {
        let mut rows = Vec::with_capacity(size * (size + 1) / 2);
        for column in 0..size {
            for row in 0..=column {
                let scale = if row == column { 1.0 } else { std::f64::consts::SQRT_2 };
                rows.push(entry(row, column).scaled(scale));
            }
        }
        self.require(PSDTriangleConeT(size), rows);
    }

    /// All that the solver computes with.
    fn numbers(&self) -> impl Iterator<Item = f64> {
        let of_row = |row: &'_ Affine| {
            row.terms.iter().map(|(_, value)| *value).chain([row.constant]).collect::<Vec<_>>()
        };
        self.curvature.iter().chain(&self.slope).copied().chain(self.rows.iter().flat_map(of_row))
    }

    fn require(&mut self, cone: SupportedConeT<f64>, rows: Vec<Affine>) {
        if !rows.is_empty() {
            self.rows.extend(rows);
            self.cones.push(cone);
        }
    }

    /// Solves the program by an interior-point method.
    ///
    /// Source: P. J. Goulart, Y. Chen, Clarabel: An interior-point solver for conic programs with
    /// quadratic objectives (2024), arXiv:2405.12762.
    pub fn solve(&self) -> ConicOutcome {
        let n = self.slope.len();
        if let Some(value) = self.numbers().find(|value| value.is_nan() || value.abs() > LARGEST) {
            let status = ConicStatus::Failed(format!("a number of {value:e} in it"));
            return ConicOutcome { x: vec![0.0; n], status, iterations: 0, seconds: 0.0 };
        }
        let diagonal = self.curvature.iter().enumerate().filter(|(_, weight)| **weight != 0.0);
        let diagonal: Vec<(usize, f64)> = diagonal.map(|(k, weight)| (k, *weight)).collect();
        let quadratic = CscMatrix::new_from_triplets(
            n,
            n,
            diagonal.iter().map(|(k, _)| *k).collect(),
            diagonal.iter().map(|(k, _)| *k).collect(),
            diagonal.iter().map(|(_, weight)| *weight).collect(),
        );
        let entries = || {
            let rows = self.rows.iter().enumerate();
            rows.flat_map(|(row, affine)| {
                affine.terms.iter().map(move |(column, value)| (row, *column, -value))
            })
        };
        let constraints = CscMatrix::new_from_triplets(
            self.rows.len(),
            n,
            entries().map(|(row, _, _)| row).collect(),
            entries().map(|(_, column, _)| column).collect(),
            entries().map(|(_, _, value)| value).collect(),
        );
        let constants: Vec<f64> = self.rows.iter().map(|row| row.constant).collect();
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .max_threads(1)
            .max_iter(300)
            .reduced_tol_gap_abs(WORTHLESS)
            .reduced_tol_feas(1e-6)
            .build()
            .expect("settings that the solver knows");
        let mut solver = DefaultSolver::new(
            &quadratic,
            &self.slope,
            &constraints,
            &constants,
            &self.cones,
            settings,
        )
        .expect("matrices of fitting sizes");
        solver.solve();
        let solution = &solver.solution;
        let status = match solution.status {
            SolverStatus::Solved | SolverStatus::AlmostSolved => ConicStatus::Solved,
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
                ConicStatus::Infeasible
            }
            other => ConicStatus::Failed(format!("{other:?}")),
        };
        ConicOutcome {
            x: solution.x.clone(),
            status,
            iterations: solution.iterations,
            seconds: solution.solve_time,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_semidefinite_matrix_loses_its_negative_eigenvalues() {
        // Higham (1988): in the Frobenius norm it is the matrix with negative eigenvalues set to
        // zero.
        let matrix = nalgebra::Matrix4::new(
            2.0, -1.0, 0.5, 3.0, -1.0, 0.3, 0.2, -0.4, 0.5, 0.2, -1.0, 0.1, 3.0, -0.4, 0.1, 1.0,
        );
        let mut program = ConicProgram::default();
        let first = program.variables(10);
        let index = |row: usize, column: usize| first + column * (column + 1) / 2 + row;
        for column in 0..4 {
            for row in 0..=column {
                let weight = if row == column { 1.0 } else { 2.0 };
                program.add_square(index(row, column), matrix[(row, column)], weight);
            }
        }
        program.require_semidefinite(4, |row, column| Affine::variable(index(row, column), 1.0));
        let outcome = program.solve();
        assert_eq!(outcome.status, ConicStatus::Solved);
        let eigen = matrix.symmetric_eigen();
        let expected = eigen.eigenvectors
            * nalgebra::Matrix4::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0)))
            * eigen.eigenvectors.transpose();
        for column in 0..4 {
            for row in 0..=column {
                assert!((outcome.x[index(row, column)] - expected[(row, column)]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn a_program_without_a_point_is_infeasible() {
        let mut program = ConicProgram::default();
        let x = program.variables(1);
        program.require_non_negative(vec![
            Affine::variable(x, 1.0).plus(-2.0),
            Affine::variable(x, -1.0).plus(1.0),
        ]);
        assert_eq!(program.solve().status, ConicStatus::Infeasible);
    }

    #[test]
    fn logarithms_bound_from_above() {
        // max t - x with t <= ln x: at x = 1, where the objective is flat: a gap of 1e-8 is 1e-4 in
        // x.
        let mut program = ConicProgram::default();
        let x = program.variables(2);
        program.add_cost(&Affine::variable(x, 1.0).and(Affine::variable(x + 1, -1.0)));
        program.require_below_log(Affine::variable(x + 1, 1.0), Affine::variable(x, 1.0));
        let outcome = program.solve();
        assert_eq!(outcome.status, ConicStatus::Solved);
        assert!((outcome.x[0] - 1.0).abs() < 3e-4 && outcome.x[1].abs() < 3e-4, "{:?}", outcome.x);
    }
}
