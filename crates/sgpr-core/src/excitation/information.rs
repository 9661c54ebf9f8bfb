//! The information matrix A = WᵀΣ⁻¹W / samples of a motion, its derivative by the motion, and what
//! is reported of W.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

use super::{ExcitationError, TrajectorySamples};
use sgpr_predict::internal::{Body, regressor_kernel};

use crate::dynamics::{BatchWorkspace, Samples, regressor_batch};
use crate::effects::{JointState, Role};
use crate::identification::{BaseParameters, ParameterSet};
use crate::robot::Robot;
use crate::simd;
use crate::spatial::{PARAMETERS_PER_LINK, Vector3};

/// Directions that one number carries: two AVX2 registers, one of AVX-512.
const DIRECTIONS: usize = 8;

type DualState = simd::Dual<f64, DIRECTIONS>;

/// Columns of the observation matrix beside those of the base parameters.
pub(super) trait BesideBase: std::fmt::Debug + Sync {
    /// How many.
    fn len(&self) -> usize;

    /// Each along a motion, `[samples n]`.
    fn columns(&self, samples: &TrajectorySamples) -> Vec<Vec<f64>>;
}

/// Observation matrix of base parameters along a motion.
#[derive(Debug)]
pub(super) struct Information<'a> {
    robot: &'a Robot,
    set: &'a ParameterSet,
    base: &'a BaseParameters,
    /// Columns beside those of the base parameters.
    nominal: Option<&'a dyn BesideBase>,
    /// 1 / standard deviation of the torque noise of each joint.
    weights: Vec<f64>,
    /// Speed over which sgn is smoothed out, rad/s; zero for none.
    smoothing: f64,
    batch: BatchWorkspace,
    full: Vec<f64>,
    /// W Σ^-1/2, `[samples n, parameters]`.
    pub rows: Vec<f64>,
    bodies: Vec<Body<DualState>>,
    axes: Vec<[Vector3<DualState>; 2]>,
}

impl<'a> Information<'a> {
    /// - `noise`: standard deviations of the torque, `[n]`; all alike if `None`
    pub fn new(
        robot: &'a Robot,
        set: &'a ParameterSet,
        base: &'a BaseParameters,
        nominal: Option<&'a dyn BesideBase>,
        noise: Option<&[f64]>,
        smoothing: f64,
    ) -> Self {
        let n = robot.dof();
        let zero = Vector3::zero(());
        Self {
            robot,
            set,
            base,
            nominal,
            weights: noise.map_or(vec![1.0; n], |noise| noise.iter().map(|s| 1.0 / s).collect()),
            smoothing,
            batch: BatchWorkspace::new(robot),
            full: Vec::new(),
            rows: Vec::new(),
            bodies: vec![Body::zero(()); n],
            axes: vec![[zero, zero]; n * n],
        }
    }

    /// Values of the effect columns of `joint`, sgn smoothed.
    fn effect_row(&self, joint: usize, state: &JointState<'_>, out: &mut [f64]) {
        self.set.effect_row(joint, state, out);
        if self.smoothing > 0.0 {
            let mut index = 0;
            for effect in self.set.effects() {
                if effect.role() == Some(Role::DryFriction) {
                    out[index] = (state.dq[joint] / self.smoothing).tanh();
                }
                index += effect.parameters().len();
            }
        }
    }

    /// Sets `rows` to the observation matrix of the samples.
    pub fn observe(&mut self, samples: &TrajectorySamples) {
        let n = self.robot.dof();
        let (rows, columns, width) =
            (samples.len() * n, self.parameters(), PARAMETERS_PER_LINK * n);
        self.full.resize(rows * width, 0.0);
        let motion = Samples { q: &samples.q, dq: &samples.dq, ddq: &samples.ddq };
        regressor_batch(self.robot, &mut self.batch, motion, &mut self.full);
        let mut kept = std::mem::take(&mut self.rows);
        kept.resize(rows * columns, 0.0);
        let mut effects = vec![0.0; self.set.effect_columns_per_joint()];
        for (index, row) in kept.chunks_exact_mut(columns).enumerate() {
            let (sample, joint) = (index / n, index % n);
            let weight = self.weights[joint];
            let full = &self.full[index * width..(index + 1) * width];
            let range = sample * n..(sample + 1) * n;
            let state = JointState {
                q: &samples.q[range.clone()],
                dq: &samples.dq[range.clone()],
                ddq: &samples.ddq[range],
            };
            self.effect_row(joint, &state, &mut effects);
            for (entry, &parameter) in row.iter_mut().zip(self.base.independent()) {
                *entry = weight
                    * match parameter.checked_sub(width) {
                        None => full[parameter],
                        Some(index) => self.effect_entry(index, joint, &effects),
                    };
            }
        }
        let nominal = self.nominal.map_or_else(Vec::new, |nominal| nominal.columns(samples));
        for (index, column) in nominal.iter().enumerate() {
            let at = self.base.rank() + index;
            for (k, (row, value)) in kept.chunks_exact_mut(columns).zip(column).enumerate() {
                row[at] = self.weights[k % n] * value;
            }
        }
        self.rows = kept;
    }

    /// Entry of effect column `index` in a row of `joint`.
    fn effect_entry(&self, index: usize, joint: usize, effects: &[f64]) -> f64 {
        let column = self.set.effect_columns()[index];
        if column.joint != joint {
            return 0.0;
        }
        let before: usize = self.set.effects()[..column.effect]
            .iter()
            .map(|effect| effect.parameters().len())
            .sum();
        effects[before + column.parameter]
    }

    /// WᵀΣ⁻¹W / samples of the last observed motion.
    pub fn matrix(&self) -> Mat<f64> {
        let columns = self.parameters();
        let rows = self.rows.len() / columns;
        let w = MatRef::from_row_major_slice(&self.rows, rows, columns);
        let mut a = Mat::zeros(columns, columns);
        let scale = self.robot.dof() as f64 / rows as f64;
        matmul(a.as_mut(), Accum::Replace, w.transpose(), w, scale, Par::Seq);
        a
    }

    /// Derivative of a function of the information matrix by the entries of the last observed
    /// `rows`, `[parameters, rows]`: d f = 2 / samples · sum over rows of (S w_row) · dw_row, where
    /// S is the derivative by the matrix.
    pub fn by_rows(&self, by_matrix: &Mat<f64>) -> Mat<f64> {
        let columns = self.parameters();
        let rows = self.rows.len() / columns;
        let w = MatRef::from_row_major_slice(&self.rows, rows, columns);
        let mut pull = Mat::<f64>::zeros(columns, rows);
        let scale = 2.0 * self.robot.dof() as f64 / rows as f64;
        matmul(pull.as_mut(), Accum::Replace, by_matrix, w.transpose(), scale, Par::Seq);
        pull
    }

    /// Number of columns: base parameters, then those of the nominal effects.
    pub fn parameters(&self) -> usize {
        self.base.rank() + self.nominal.map_or(0, BesideBase::len)
    }

    /// What the derivative by the entries of the observation matrix, `[parameters, rows]`, makes of
    /// the columns of the nominal effects along `samples`; none without such effects.
    pub fn along_nominal(&self, samples: &TrajectorySamples, pull: &Mat<f64>) -> Option<f64> {
        let (n, first) = (self.robot.dof(), self.base.rank());
        let columns = self.nominal.filter(|nominal| nominal.len() > 0)?.columns(samples);
        let of_column = |(index, column): (usize, &Vec<f64>)| {
            let entries = column.iter().enumerate();
            entries
                .map(|(row, value)| pull[(first + index, row)] * self.weights[row % n] * value)
                .sum::<f64>()
        };
        Some(columns.iter().enumerate().map(of_column).sum())
    }

    /// 1 / standard deviation of the torque noise of a joint.
    pub fn weight(&self, joint: usize) -> f64 {
        self.weights[joint]
    }

    /// Torque of joint `row % n` at sample `row / n` of the last observed motion with these base
    /// parameters.
    pub fn torque(&self, base_parameters: &[f64]) -> Vec<f64> {
        let torque = |(row, values): (usize, &[f64])| {
            let sum: f64 = values
                .iter()
                .zip(base_parameters)
                .map(|(value, parameter)| value * parameter)
                .sum();
            sum / self.weights[row % self.weights.len()]
        };
        self.rows.chunks_exact(self.parameters()).enumerate().map(torque).collect()
    }

    /// Derivative of a function by the motion, `[samples, n]` by q, dq and ddq, from its derivative
    /// by the entries of the observation matrix, `[parameters, rows]`, without the nominal effects
    /// ([`Self::along_nominal`]).
    ///
    /// The entries come from the regressor recursion on dual numbers, the effects' share from
    /// central differences (they may be any function).
    pub fn by_motion(&mut self, samples: &TrajectorySamples, pull: &Mat<f64>) -> [Vec<f64>; 3] {
        let n = self.robot.dof();
        let count = samples.len();
        let rows = count * n;
        let inertial = self.set.inertial();
        let mut result = [vec![0.0; rows], vec![0.0; rows], vec![0.0; rows]];
        let mut factors = vec![[0.0; PARAMETERS_PER_LINK]; n * n];
        let mut effect_factors = vec![0.0; n * self.set.effect_columns_per_joint()];
        for sample in 0..count {
            factors.as_flattened_mut().fill(0.0);
            effect_factors.fill(0.0);
            for joint in 0..n {
                let pull = pull.col_as_slice(sample * n + joint);
                for (&parameter, &value) in self.base.independent().iter().zip(pull) {
                    let value = self.weights[joint] * value;
                    if parameter < inertial {
                        factors.as_flattened_mut()[joint * inertial + parameter] = value;
                    } else {
                        self.set_effect_factor(
                            parameter - inertial,
                            joint,
                            value,
                            &mut effect_factors,
                        );
                    }
                }
            }
            let at = sample * n..(sample + 1) * n;
            let motion =
                [&samples.q[at.clone()], &samples.dq[at.clone()], &samples.ddq[at.clone()]];
            self.add_rigid_body(motion, &factors, &mut result, sample);
            if self.set.effect_columns_per_joint() > 0 {
                self.add_effects(motion, &effect_factors, &mut result, sample);
            }
        }
        result
    }

    fn set_effect_factor(&self, index: usize, joint: usize, value: f64, factors: &mut [f64]) {
        let column = self.set.effect_columns()[index];
        if column.joint == joint {
            let before: usize = self.set.effects()[..column.effect]
                .iter()
                .map(|effect| effect.parameters().len())
                .sum();
            factors[joint * self.set.effect_columns_per_joint() + before + column.parameter] =
                value;
        }
    }

    fn add_rigid_body(
        &mut self,
        motion: [&[f64]; 3],
        factors: &[[f64; PARAMETERS_PER_LINK]],
        result: &mut [Vec<f64>; 3],
        sample: usize,
    ) {
        let n = self.robot.dof();
        for first in (0..3 * n).step_by(DIRECTIONS) {
            set_motion(&mut self.bodies, motion, first);
            let mut sum = [0.0; DIRECTIONS];
            regressor_kernel(
                (),
                self.robot.chain(),
                &mut self.bodies,
                &mut self.axes,
                |joint, link, block: [DualState; 10]| {
                    for (entry, factor) in block.iter().zip(&factors[joint * n + link]) {
                        for k in 0..DIRECTIONS {
                            sum[k] += factor * entry.slope[k];
                        }
                    }
                },
            );
            for (k, slope) in sum.iter().enumerate() {
                let variable = first + k;
                if variable < 3 * n {
                    result[variable / n][sample * n + variable % n] += slope;
                }
            }
        }
    }

    fn add_effects(
        &self,
        motion: [&[f64]; 3],
        factors: &[f64],
        result: &mut [Vec<f64>; 3],
        sample: usize,
    ) {
        let n = self.robot.dof();
        let width = self.set.effect_columns_per_joint();
        let mut moved = motion.map(<[f64]>::to_vec);
        let mut row = vec![0.0; width];
        let mut contracted = |moved: &[Vec<f64>; 3]| {
            let state = JointState { q: &moved[0], dq: &moved[1], ddq: &moved[2] };
            let mut sum = 0.0;
            for joint in 0..n {
                self.effect_row(joint, &state, &mut row);
                sum += row
                    .iter()
                    .zip(&factors[joint * width..])
                    .map(|(value, factor)| value * factor)
                    .sum::<f64>();
            }
            sum
        };
        for kind in 0..3 {
            for joint in 0..n {
                let here = moved[kind][joint];
                let h = 1e-5 * (1.0 + here.abs());
                moved[kind][joint] = here + h;
                let above = contracted(&moved);
                moved[kind][joint] = here - h;
                let below = contracted(&moved);
                moved[kind][joint] = here;
                result[kind][sample * n + joint] += (above - below) / (2.0 * h);
            }
        }
    }
}

/// Puts a motion into the bodies, the variables from `first` on (q, then dq, then ddq) as
/// directions.
pub(super) fn set_motion(bodies: &mut [Body<DualState>], [q, dq, ddq]: [&[f64]; 3], first: usize) {
    let n = bodies.len();
    for (joint, body) in bodies.iter_mut().enumerate() {
        let variable = |kind: usize, value: f64| {
            DualState::variable(value, (kind * n + joint).checked_sub(first))
        };
        body.q = variable(0, q[joint]);
        let (sin, cos) = q[joint].sin_cos();
        body.sin = body.q.chain(sin, cos);
        body.cos = body.q.chain(cos, -sin);
        body.dq = variable(1, dq[joint]);
        body.ddq = variable(2, ddq[joint]);
    }
}

pub(super) fn require_noise(robot: &Robot, noise: Option<&[f64]>) -> Result<(), ExcitationError> {
    let Some(noise) = noise else { return Ok(()) };
    if noise.len() != robot.dof() {
        return Err(ExcitationError::Length {
            what: "noise",
            expected: robot.dof(),
            found: noise.len(),
        });
    }
    match noise.iter().find(|value| !(**value > 0.0 && value.is_finite())) {
        Some(&value) => Err(ExcitationError::InvalidOption {
            option: "noise",
            value,
            expected: "a standard deviation above zero",
        }),
        None => Ok(()),
    }
}
