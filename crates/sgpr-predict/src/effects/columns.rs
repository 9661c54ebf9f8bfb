//! What columns of several effects have in common.

#[cfg(feature = "trajectories")]
use super::Context;
use super::stepping::cubic_weights;
use super::{EffectParameter, SampleInput, Site, StepState, Stepped};
#[cfg(feature = "trajectories")]
use crate::dynamics::parts::for_each_regressor_block;
#[cfg(feature = "trajectories")]
use crate::dynamics::{BatchWorkspace, Samples};
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::simd::Number;
use crate::spatial::{Matrix3, PARAMETERS_PER_LINK, Vector3};

/// Columns cos(n q) and sin(n q) of the joint's position, with n = `order`.
pub(super) fn harmonic<S: Stepped>(
    input: &SampleInput<'_, S>,
    site: Site,
    order: f64,
    columns: &mut [S],
) {
    let (sine, cosine) = (input.q[site.joint().expect("at a joint")] * order).sin_cos();
    columns[0] = cosine;
    columns[1] = sine;
}

/// One after the time `edge`, zero before it and where the time is not known; the sample in whose
/// period the edge falls gets its share.
#[inline]
pub(super) fn after<S: Stepped>(time: S::Time, edge: f64, rate_hz: f64) -> S {
    let [zero, one] = [0.0, 1.0].map(S::constant);
    let since = S::since(time, edge);
    if !since.is_known() {
        return zero;
    }
    if rate_hz.is_finite() {
        (since * rate_hz + 0.5).clamp(zero, one)
    } else {
        since.where_positive(one, zero)
    }
}

/// The ten inertial parameters of a link, of which the mass is `mass`.
pub(super) const fn of_a_link(mass: EffectParameter) -> [EffectParameter; 10] {
    const fn inertia(symbol: &'static str) -> EffectParameter {
        EffectParameter::signed(symbol, "kg·m²", "kg·m²")
    }
    const fn moment(symbol: &'static str) -> EffectParameter {
        EffectParameter::signed(symbol, "kg·m", "kg·m")
    }
    [
        mass,
        moment("mx"),
        moment("my"),
        moment("mz"),
        inertia("Ixx"),
        inertia("Ixy"),
        inertia("Iyy"),
        inertia("Ixz"),
        inertia("Iyz"),
        inertia("Izz"),
    ]
}

/// Columns of the ten inertial parameters of the link that `joint` carries, each sample times
/// `weight(sample)`.
///
/// - `out`: ten times `[samples, n]`, zero before: rows without weight and joints that do not carry
///   the link stay as they are
#[cfg(feature = "trajectories")]
pub(super) fn link_regressor(
    context: &Context<'_>,
    joint: usize,
    weight: impl Fn(usize) -> f64,
    out: &mut [Vec<f64>],
) {
    let n = context.dof();
    let counts = |k: &usize| weight(*k) != 0.0;
    let Some(start) = (0..context.len()).find(counts) else { return };
    let end = (start..context.len()).rfind(counts).map_or(start, |last| last + 1);
    let rows = n * start..n * end;
    let mut ws = BatchWorkspace::new(context.robot);
    let samples = Samples {
        q: &context.q[rows.clone()],
        dq: &context.dq[rows.clone()],
        ddq: &context.ddq[rows],
    };
    for_each_regressor_block(context.robot, &mut ws, samples, |row, link, first, count, block| {
        if link == joint {
            for (out, values) in out.iter_mut().zip(block) {
                for (k, value) in (start + first..start + first + count).zip(values) {
                    out[k * n + row] = weight(k) * value;
                }
            }
        }
    });
}

/// Columns of the ten inertial parameters of the link that `joint` carries at one sample, times
/// `weight`.
///
/// - `columns`: ten times `[n]`
pub(super) fn link_columns<S: Stepped>(
    input: &SampleInput<'_, S>,
    joint: usize,
    weight: S,
    state: &mut StepState<'_, S>,
    columns: &mut [S],
) {
    if weight.is_surely_zero() {
        return columns.fill(S::zero(()));
    }
    let n = input.robot.dof();
    let matrix = S::regressor(input.robot, state.workspace, [input.q, input.dq, input.ddq]);
    for row in 0..n {
        let block = &matrix[(row * n + joint) * PARAMETERS_PER_LINK..][..PARAMETERS_PER_LINK];
        for (parameter, value) in block.iter().enumerate() {
            columns[parameter * n + row] = weight * *value;
        }
    }
}

/// Calls `each(joint, lever)` for the joints that move the last link's origin: how it moves with
/// each, and the axes of that link as columns.
pub(super) fn tip_levers<S: Stepped>(
    input: &SampleInput<'_, S>,
    state: &mut StepState<'_, S>,
    mut each: impl FnMut(usize, Vector3<S>),
) -> Matrix3<S> {
    let (robot, tip) = (input.robot, input.robot.dof() - 1);
    let poses = S::forward_kinematics(robot, state.workspace, input.q);
    for &carrier in robot.path(tip) {
        let (joint, pose) = (&robot.joints()[carrier], &poses[carrier]);
        let axis = pose.rotation * Vector3::constant(joint.axis);
        let rotates = joint.kind.is_rotation();
        each(
            carrier,
            if rotates { axis.cross(poses[tip].translation - pose.translation) } else { axis },
        );
    }
    poses[tip].rotation
}

/// Delays every column of `[samples, width]` by `delay` samples, by cubic interpolation; the ends
/// repeat.
pub(super) fn shift(values: &mut [f64], width: usize, delay: f64) {
    let samples = values.len() / width.max(1);
    if samples == 0 || delay == 0.0 {
        return;
    }
    let whole = (-delay).floor();
    let x = -delay - whole;
    let weights = cubic_weights(x);
    let source = values.to_vec();
    for (k, row) in values.chunks_exact_mut(width).enumerate() {
        row.fill(0.0);
        for (offset, weight) in weights.iter().enumerate() {
            let from =
                (k as i64 + whole as i64 + offset as i64 - 1).clamp(0, samples as i64 - 1) as usize;
            for (value, source) in row.iter_mut().zip(&source[from * width..]) {
                *value += weight * source;
            }
        }
    }
}

/// First-order lag with a time constant of `samples` sampling periods, for a torque that is linear
/// between samples.
pub(super) fn lag(values: &mut [f64], width: usize, samples: f64) {
    let decay = Number::exp(-1.0 / samples);
    // Exact for a ramp between samples: y' = (u - y) / T.
    let slope = samples * (1.0 - decay);
    let (old, new) = (slope - decay, 1.0 - slope);
    let Some(first) = values.get(..width).map(<[f64]>::to_vec) else { return };
    let (mut state, mut input) = (first.clone(), first);
    for row in values.chunks_exact_mut(width) {
        for ((value, state), input) in row.iter_mut().zip(&mut state).zip(&mut input) {
            *state = decay * *state + old * *input + new * *value;
            *input = *value;
            *value = *state;
        }
    }
}
