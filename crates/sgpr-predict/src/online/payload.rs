//! What a link holds, from the torque that the arm's model leaves over, sample by sample.

use alloc::vec::Vec;

use super::OnlineError;
use super::error::require_positive;
use crate::dynamics::{Workspace, regressor};
#[cfg(not(feature = "std"))]
use crate::math::Float;
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

const N: usize = PARAMETERS_PER_LINK;

/// Square of a residual, in standard deviations, that noise explains.
const EXPECTED: f64 = 16.0;

/// By how much faster data fade, at most, when a residual is none that the payload of before
/// explains.
const FASTEST: f64 = 10.0;

/// How a payload is tracked.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct PayloadOptions {
    /// Link that holds it; the last one if `None`.
    pub link: Option<usize>,
    /// How heavy payloads are, kg: the standard deviation of the mass before any data, about zero.
    pub mass: f64,
    /// How far from the link frame their mass is, m.
    pub radius: f64,
    /// Time over which old samples fade to a third, s.
    pub memory: f64,
    /// Standard deviation of what the arm's model leaves over without a payload, `[n]`, N·m (N).
    pub noise: Vec<f64>,
}

impl PayloadOptions {
    setters! {
        with_link(link: Option<usize>),
        with_mass(mass: f64),
        with_radius(radius: f64),
        with_memory(memory: f64),
        with_noise(noise: Vec<f64>),
    }
}

impl PayloadOptions {
    /// Up to a few kilograms within 0.2 m of the last link's frame, a memory of 0.3 s.
    pub fn new(noise: Vec<f64>) -> Self {
        Self { link: None, mass: 5.0, radius: 0.2, memory: 0.3, noise }
    }
}

/// Recursive least squares for the ten inertial parameters of a payload, with a memory that fades
/// towards "none".
///
/// residual = Y_link(q, dq, ddq) payload + noise. What is kept is the triangular factor of the
/// weighted rows. The data fade exponentially and the prior (no payload, spread as
/// [`PayloadOptions`] says) is put back by as much, so that directions which the motion does not
/// excite return to the prior instead of drifting. A residual of more than four standard deviations
/// says that something was picked up or put down: data fade faster then, in proportion to its
/// square, up to tenfold.
///
/// Source: J. Kubus, T. Kröger, F. M. Wahl, On-line estimation of inertial parameters using a
/// recursive total least-squares approach, IEEE/RSJ IROS (2008), for the task; S. Haykin, Adaptive
/// Filter Theory (2002), chapter 14, for the square-root recursion; R. Kulhavý, Restricted
/// exponential forgetting in real-time identification, Automatica 23(5) (1987), for forgetting
/// towards a prior; T. R. Fortescue, L. S. Kershenbaum, B. E. Ydstie, Implementation of self-tuning
/// regulators with variable forgetting factors, Automatica 17(6) (1981), for the memory that
/// follows the residual.
#[derive(Debug)]
pub struct PayloadTracker {
    robot: Robot,
    ws: Workspace,
    link: usize,
    /// One over the noise of each joint, `[n]`.
    precision: Vec<f64>,
    memory: f64,
    prior: [f64; N],
    /// Upper triangle; the last column belongs to the residual.
    factor: [[f64; N + 1]; N],
    parameters: [f64; N],
}

impl PayloadTracker {
    /// Nothing held yet; the only place that allocates.
    ///
    /// # Errors
    /// If an option is not positive, the link not there, or there is not one noise per joint.
    pub fn new(robot: &Robot, options: &PayloadOptions) -> Result<Self, OnlineError> {
        let n = robot.dof();
        let link = options.link.unwrap_or(n - 1);
        if link >= n {
            return Err(OnlineError::NoSuchLink { link, last: n - 1 });
        }
        for (option, value) in
            [("mass", options.mass), ("radius", options.radius), ("memory", options.memory)]
        {
            require_positive(option, value)?;
        }
        if options.noise.len() != n {
            return Err(OnlineError::Length {
                what: "noise",
                expected: n,
                found: options.noise.len(),
            });
        }
        options.noise.iter().try_for_each(|noise| require_positive("noise", *noise))?;
        let (moment, inertia) =
            (options.mass * options.radius, options.mass * options.radius * options.radius);
        let prior: [f64; N] = core::array::from_fn(|k| match k {
            0 => options.mass,
            1..4 => moment,
            _ => inertia,
        });
        let mut factor = [[0.0; N + 1]; N];
        (0..N).for_each(|k| factor[k][k] = 1.0 / prior[k]);
        Ok(Self {
            ws: Workspace::new(robot),
            robot: robot.clone(),
            link,
            precision: options.noise.iter().map(|noise| 1.0 / noise).collect(),
            memory: options.memory,
            prior,
            factor,
            parameters: [0.0; N],
        })
    }

    /// One sample; `period` s after the one before.
    ///
    /// - `q`, `dq`, `ddq`: `[n]`, rad, rad/s, rad/s² (m for prismatic joints)
    /// - `residual`: measured torque minus that of the arm's model, `[n]`, N·m (N)
    /// - `counted`: joints whose residual counts, `[n]`
    /// - `repeats`: how many samples tell as much as one independent sample
    ///
    /// # Panics
    /// If a slice is not of length n.
    pub fn update(
        &mut self,
        period: f64,
        [q, dq, ddq]: [&[f64]; 3],
        residual: &[f64],
        counted: &[bool],
        repeats: f64,
    ) {
        let n = self.robot.dof();
        assert!(residual.len() == n && counted.len() == n, "one residual per joint");
        let matrix = regressor(&self.robot, &mut self.ws, q, dq, ddq);
        let row_of = |j: usize| &matrix[j * n * N + self.link * N..][..N];
        let mut surprise = 0.0;
        for j in (0..n).filter(|&j| counted[j]) {
            let expected: f64 = row_of(j).iter().zip(&self.parameters).map(|(y, p)| y * p).sum();
            surprise = f64::max(surprise, ((residual[j] - expected) * self.precision[j]).powi(2));
        }
        let memory = self.memory / (surprise / EXPECTED).clamp(1.0, FASTEST);
        let keep = (-period / memory).exp();
        for (k, row) in self.factor.iter_mut().enumerate() {
            row[k..].iter_mut().for_each(|value| *value *= keep.sqrt());
        }
        for k in 0..N {
            let mut row = [0.0; N + 1];
            row[k] = (1.0 - keep).sqrt() / self.prior[k];
            absorb(&mut self.factor, &mut row, k);
        }
        for j in (0..n).filter(|&j| counted[j]) {
            let weight = self.precision[j] / repeats.sqrt();
            let mut row = [0.0; N + 1];
            row[..N].copy_from_slice(row_of(j));
            row[N] = residual[j];
            row.iter_mut().for_each(|value| *value *= weight);
            absorb(&mut self.factor, &mut row, 0);
        }
        for k in (0..N).rev() {
            let row = &self.factor[k];
            let rest: f64 = (k + 1..N).map(|i| row[i] * self.parameters[i]).sum();
            self.parameters[k] = (row[N] - rest) / row[k];
        }
    }

    /// Link that holds the payload.
    pub fn link(&self) -> usize {
        self.link
    }

    /// m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz in the frame of the link.
    pub fn parameters(&self) -> &[f64; N] {
        &self.parameters
    }

    /// Standard deviations of the parameters, prior included.
    pub fn standard_deviations(&self) -> [f64; N] {
        // Rows of the inverse of the factor: R x = e_i by back substitution.
        let mut variance = [0.0; N];
        for column in 0..N {
            let mut x = [0.0; N];
            for k in (0..=column).rev() {
                let rest: f64 = (k + 1..=column).map(|i| self.factor[k][i] * x[i]).sum();
                x[k] = (f64::from(u8::from(k == column)) - rest) / self.factor[k][k];
                variance[k] += x[k] * x[k];
            }
        }
        variance.map(f64::sqrt)
    }

    /// Adds the torque that the payload needs to `tau`.
    ///
    /// # Panics
    /// If a slice is not of length n.
    pub fn add_torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64], tau: &mut [f64]) {
        let n = self.robot.dof();
        let matrix = regressor(&self.robot, &mut self.ws, q, dq, ddq);
        for (j, tau) in tau.iter_mut().enumerate() {
            let start = j * n * N + self.link * N;
            *tau += matrix[start..start + N]
                .iter()
                .zip(&self.parameters)
                .map(|(y, p)| y * p)
                .sum::<f64>();
        }
    }
}

/// Turns `row`, zero before column `first`, into the factor by Givens rotations.
fn absorb(factor: &mut [[f64; N + 1]; N], row: &mut [f64; N + 1], first: usize) {
    for k in first..N {
        let y = row[k];
        if y == 0.0 {
            continue;
        }
        let x = factor[k][k];
        let length = x.hypot(y);
        let (c, s) = (x / length, y / length);
        for i in k..=N {
            let (a, b) = (factor[k][i], row[i]);
            factor[k][i] = c * a + s * b;
            row[i] = c * b - s * a;
        }
    }
}
