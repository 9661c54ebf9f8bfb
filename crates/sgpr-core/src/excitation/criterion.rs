//! What makes a motion a good one: functions of the information matrix A = WᵀW.

use faer::Mat;

use super::NominalEffects;
use crate::identification::{BaseParameters, ParameterSet};
use crate::linalg::symmetric_eigen;
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

/// What is made small by a good motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Criterion {
    /// cond(W), the ratio of the largest and smallest singular value (thesis eq. 3-10).
    Condition,
    /// |W|_F |W⁺|_F (thesis section 3-3-2): an upper bound of cond(W), and smooth.
    FrobeniusCondition,
    /// Sum over links of cond of the link's own columns (thesis eq. 3-13); friction columns go with
    /// the joint's link.
    SumOfConditions,
    /// Sum over links of link mass times cond of its columns of mass and first moment (thesis eq.
    /// 3-11).
    ///
    /// Source: G. Venture, K. Ayusawa, Y. Nakamura, A numerical method for choosing motions with
    /// optimal excitation properties for identification of biped dynamics, IEEE ICRA (2009).
    StaticConditions,
    /// The same with the columns of inertia (thesis eq. 3-12).
    DynamicConditions,
    /// -log det(Wᵀ Σ⁻¹ W), per sample: the volume of the confidence ellipsoid.
    ///
    /// Source: J. Swevers, C. Ganseman, D. B. Tükel, J. De Schutter, H. Van Brussel, Optimal robot
    /// excitation and identification, IEEE Trans. Robotics and Automation 13(5) (1997).
    DOptimality,
    /// The same with the determinant replaced by Hadamard's bound, the product of the diagonal: it
    /// excites every column but cares for no correlation between them.
    Hadamard,
}

impl Criterion {
    /// All criteria.
    pub const ALL: [Self; 7] = [
        Self::Condition,
        Self::FrobeniusCondition,
        Self::SumOfConditions,
        Self::StaticConditions,
        Self::DynamicConditions,
        Self::DOptimality,
        Self::Hadamard,
    ];

    /// Name in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Condition => "condition",
            Self::FrobeniusCondition => "frobenius_condition",
            Self::SumOfConditions => "sum_of_conditions",
            Self::StaticConditions => "static_conditions",
            Self::DynamicConditions => "dynamic_conditions",
            Self::DOptimality => "d_optimality",
            Self::Hadamard => "hadamard",
        }
    }
}

/// A criterion for the base parameters of a robot.
#[derive(Clone, Debug)]
pub(super) struct Objective {
    criterion: Criterion,
    /// Columns that belong together, with the weight of their condition number.
    groups: Vec<(f64, Vec<usize>)>,
}

impl Objective {
    pub fn new(
        criterion: Criterion,
        robot: &Robot,
        set: &ParameterSet,
        base: &BaseParameters,
        nominal: Option<&NominalEffects>,
    ) -> Self {
        let all: Vec<usize> = (0..base.rank() + nominal.map_or(0, NominalEffects::len)).collect();
        let of_link = |keep: &dyn Fn(usize) -> bool, effects: bool| {
            let mut groups = vec![Vec::new(); robot.dof()];
            for (column, &parameter) in base.independent().iter().enumerate() {
                if parameter < set.inertial() {
                    if keep(parameter % PARAMETERS_PER_LINK) {
                        groups[parameter / PARAMETERS_PER_LINK].push(column);
                    }
                } else if effects {
                    groups[set.effect_columns()[parameter - set.inertial()].joint].push(column);
                }
            }
            if let Some(nominal) = nominal.filter(|_| effects) {
                (0..nominal.len())
                    .for_each(|index| groups[nominal.link(index)].push(base.rank() + index));
            }
            groups
        };
        let weigh = |groups: Vec<Vec<usize>>, weight: &dyn Fn(usize) -> f64| {
            let weighted =
                groups.into_iter().enumerate().map(|(link, columns)| (weight(link), columns));
            weighted.filter(|(weight, columns)| *weight > 0.0 && !columns.is_empty()).collect()
        };
        let mass = |link: usize| robot.links()[link].mass;
        let groups = match criterion {
            Criterion::SumOfConditions => weigh(of_link(&|_| true, true), &|_| 1.0),
            Criterion::StaticConditions => weigh(of_link(&|k| k < 4, false), &mass),
            Criterion::DynamicConditions => weigh(of_link(&|k| k >= 4, false), &mass),
            _ => vec![(1.0, all)],
        };
        Self { criterion, groups }
    }

    /// Whether small values are a ratio of large to small: its logarithm is the better thing to
    /// descend on.
    pub fn is_condition(&self) -> bool {
        !matches!(self.criterion, Criterion::DOptimality | Criterion::Hadamard)
    }

    /// Value, and derivative by the (symmetric) matrix `a`. Condition numbers are taken in the
    /// smooth form of [`smooth_condition`] with this `power`; `None` for the exact one, whose
    /// derivative is one of several where singular values coincide.
    ///
    /// Infinite where the matrix is singular.
    pub fn value_and_derivative(&self, a: &Mat<f64>, power: Option<f64>) -> (f64, Mat<f64>) {
        let size = a.nrows();
        let mut derivative = Mat::zeros(size, size);
        match self.criterion {
            Criterion::Hadamard => {
                let mut value = 0.0;
                for k in 0..size {
                    value -= a[(k, k)].ln();
                    derivative[(k, k)] = -1.0 / a[(k, k)];
                }
                (value, derivative)
            }
            Criterion::DOptimality => {
                // With columns of unit length, so that units do not decide what is singular.
                let length: Vec<f64> = (0..size).map(|k| a[(k, k)].sqrt()).collect();
                let scaled = Mat::from_fn(size, size, |i, j| a[(i, j)] / (length[i] * length[j]));
                if length.iter().any(|length| !(*length > 0.0 && length.is_finite())) {
                    return (f64::INFINITY, derivative);
                }
                let (values, mut vectors) = symmetric_eigen(scaled.as_ref());
                if is_singular(values[0], values[size - 1]) {
                    return (f64::INFINITY, derivative);
                }
                length.iter().enumerate().for_each(|(i, length)| {
                    vectors.row_mut(i).iter_mut().for_each(|x| *x /= length)
                });
                add_spectral(
                    &mut derivative,
                    &vectors,
                    &values.iter().map(|x| -1.0 / x).collect::<Vec<_>>(),
                    None,
                );
                let logarithms = values.iter().map(|x| x.ln()).sum::<f64>();
                (-logarithms - 2.0 * length.iter().map(|x| x.ln()).sum::<f64>(), derivative)
            }
            Criterion::FrobeniusCondition => self.conditions(a, Some(1.0), derivative),
            _ => self.conditions(a, power, derivative),
        }
    }

    fn conditions(
        &self,
        a: &Mat<f64>,
        power: Option<f64>,
        mut derivative: Mat<f64>,
    ) -> (f64, Mat<f64>) {
        let mut sum = 0.0;
        for (weight, columns) in &self.groups {
            let block =
                Mat::from_fn(columns.len(), columns.len(), |i, j| a[(columns[i], columns[j])]);
            let (values, vectors) = symmetric_eigen(block.as_ref());
            let Some((condition, slopes)) = smooth_condition(&values, power) else {
                return (f64::INFINITY, derivative);
            };
            sum += weight * condition;
            let slopes: Vec<f64> = slopes.iter().map(|slope| weight * slope).collect();
            add_spectral(&mut derivative, &vectors, &slopes, Some(columns));
        }
        (sum, derivative)
    }
}

/// Eigenvalues of WᵀW below this share of the largest one are rounding.
pub(super) const SINGULAR: f64 = 1e-13;

/// Whether a matrix with these eigenvalues, the squares of singular values, is singular to
/// rounding; NaN counts as such.
fn is_singular(least: f64, most: f64) -> bool {
    least.is_nan() || most.is_nan() || least <= SINGULAR * most
}

/// derivative += V diag(slopes) Vᵀ, in the rows and columns `columns`.
fn add_spectral(
    derivative: &mut Mat<f64>,
    vectors: &Mat<f64>,
    slopes: &[f64],
    columns: Option<&[usize]>,
) {
    let k = slopes.len();
    let scaled = Mat::from_fn(k, k, |i, j| vectors[(i, j)] * slopes[j]);
    let product = &scaled * vectors.transpose();
    for i in 0..k {
        for j in 0..k {
            let (row, column) = columns.map_or((i, j), |columns| (columns[i], columns[j]));
            derivative[(row, column)] += product[(i, j)];
        }
    }
}

/// Condition number of W from the eigenvalues of WᵀW, ascending, and its derivatives by them;
/// `None` if singular.
///
/// With a power p it is (sum λ^p · sum λ^-p)^(1 / 2p), which is smooth, never below the true one,
/// the Frobenius condition number for p = 1 and the true one as p grows.
fn smooth_condition(values: &[f64], power: Option<f64>) -> Option<(f64, Vec<f64>)> {
    let k = values.len();
    let (least, most) = (values[0], values[k - 1]);
    if is_singular(least, most) {
        return None;
    }
    let Some(p) = power else {
        let condition = (most / least).sqrt();
        let mut slopes = vec![0.0; k];
        slopes[k - 1] += 0.5 * condition / most;
        slopes[0] -= 0.5 * condition / least;
        return Some((condition, slopes));
    };
    let up: Vec<f64> = values.iter().map(|x| (x / most).powf(p)).collect();
    let down: Vec<f64> = values.iter().map(|x| (least / x).powf(p)).collect();
    let (sum_up, sum_down) = (up.iter().sum::<f64>(), down.iter().sum::<f64>());
    let condition = (most / least).sqrt() * (sum_up * sum_down).powf(0.5 / p);
    let slope = |((x, up), down): ((&f64, &f64), &f64)| {
        0.5 * condition * (up / sum_up - down / sum_down) / x
    };
    Some((condition, values.iter().zip(&up).zip(&down).map(slope).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::puma560;

    fn matrix(size: usize) -> Mat<f64> {
        let root = Mat::from_fn(size + 3, size, |i, j| {
            (1.7 * i as f64 + 0.3 * (i * j) as f64 + j as f64).sin()
        });
        root.transpose() * &root
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let robot = puma560();
        let set = ParameterSet::new(&robot, &["viscous_friction"]).expect("known effects");
        let base = BaseParameters::new(&robot, &set);
        let a = matrix(base.rank());
        let change = matrix(base.rank() + 1).submatrix(1, 0, base.rank(), base.rank()).to_owned();
        let change =
            Mat::from_fn(base.rank(), base.rank(), |i, j| 0.5 * (change[(i, j)] + change[(j, i)]));
        for criterion in Criterion::ALL {
            let objective = Objective::new(criterion, &robot, &set, &base, None);
            for power in [Some(2.0), Some(20.0), None] {
                let value = |h: f64| {
                    let moved = Mat::from_fn(base.rank(), base.rank(), |i, j| {
                        a[(i, j)] + h * change[(i, j)]
                    });
                    objective.value_and_derivative(&moved, power).0
                };
                let h = 1e-6 * symmetric_eigen(a.as_ref()).0[0];
                let difference = (value(h) - value(-h)) / (2.0 * h);
                let (_, derivative) = objective.value_and_derivative(&a, power);
                let mut along = 0.0;
                for i in 0..base.rank() {
                    for j in 0..base.rank() {
                        along += derivative[(i, j)] * change[(i, j)];
                    }
                }
                assert!(
                    (along - difference).abs() < 1e-5 * along.abs(),
                    "{criterion:?} {power:?}: {along} {difference}"
                );
            }
        }
    }

    #[test]
    fn the_smooth_condition_is_frobenius_at_one_and_exact_in_the_limit() {
        let values = [1e-4, 2e-4, 0.3, 0.9, 1.0];
        let exact = smooth_condition(&values, None).expect("regular").0;
        assert!((exact - 100.0).abs() < 1e-10);
        let trace = |p: i32| values.iter().map(|x: &f64| x.powi(p)).sum::<f64>();
        let frobenius = (trace(1) * trace(-1)).sqrt();
        assert!(
            (smooth_condition(&values, Some(1.0)).expect("regular").0 - frobenius).abs() < 1e-10
        );
        let mut before = frobenius;
        for p in [2.0, 8.0, 32.0, 128.0] {
            let value = smooth_condition(&values, Some(p)).expect("regular").0;
            assert!(value < before && value > exact);
            before = value;
        }
        assert!(before < 1.01 * exact);
        assert!(smooth_condition(&[0.0, 1.0], None).is_none());
    }
}
