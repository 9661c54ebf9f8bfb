//! Noise of the torque: what the largest model leaves.

use std::collections::HashSet;

use rayon::prelude::*;

use super::super::basis::{Basis, Noise, Rest};
use super::super::fit::{Fitted, refine_transforms, solve_like};
use super::super::problem::Column;
use super::super::remembered::key_of;
use super::super::unknown::{self, Group};
use super::Search;
use super::candidates::is_searched_apart;
use crate::effects::{Dimension, Reach, Site};
use crate::linalg::rms;
use crate::model::Term;
use crate::progress::Interrupted;

impl Search<'_> {
    /// Noise as what the candidates at their default constants and random features of the state
    /// leave.
    pub(super) fn noise_of_largest(&mut self, fitted: &Fitted) -> Result<Noise, Interrupted> {
        let n = self.problem.dof();
        let mut seen = HashSet::new();
        let mut terms = self.terms_to_try(fitted);
        terms.retain(|t| {
            t.effect.reach() == Reach::Own && seen.insert((t.effect.name().to_string(), t.site))
        });
        self.prepare(fitted, &terms)?;
        let of_joint = |joint: usize| {
            let own = terms.iter().filter(|term| term.site == Site::Joint(joint));
            let mut columns: Vec<Column> =
                own.flat_map(|term| self.cache[&key_of(term)].iter().cloned()).collect();
            columns.extend(unknown::features(&self.problem, joint, &Group::whole(joint, n), 0.8));
            let only = |column: &Column| -> Column {
                (0..n).map(|j| if j == joint { column[j].clone() } else { vec![] }).collect()
            };
            let is_here = |column: &Column| !column[joint].is_empty();
            let mut all: Vec<Column> =
                fitted.columns.iter().map(|column| only(column)).filter(is_here).collect();
            // What as many columns as rows leave is no measure of noise.
            let most = all.len().max(fitted.residual[joint].len() / 2);
            all.extend(columns.into_iter().filter(is_here));
            all.truncate(most);
            self.left_by(joint, &all, &fitted.residual[joint])
        };
        let left: Vec<Rest> = (0..n).into_par_iter().map(of_joint).collect();
        Ok(Noise::of(&self.problem, &left))
    }

    /// Joints of the last term of a fit, if less than the noise is left at one of them and the
    /// largest model at the start did not hold the term, a load, a contact, a ripple of some order,
    /// a tilt: it took that for noise. A lag, a delay, an elastic joint smooth the prediction: what
    /// they leave is no measure.
    pub(super) fn quieter_joints(&self, fitted: &Fitted) -> Option<Vec<usize>> {
        /// Share of the noise below which the residual says that it was too large.
        const QUIETER: f64 = 0.95;
        let is_new = |term: &&Term| {
            let mut constants = term.effect.constants().iter();
            if term.is_transform() {
                constants.all(|c| c.dimension() == Dimension::Position)
            } else {
                term.effect.reach() == Reach::All || constants.any(is_searched_apart)
            }
        };
        let joints = self.joints_of(fitted.terms().last().filter(is_new)?);
        let quieter = |joint: &usize| {
            let rows = &fitted.residual[*joint];
            !rows.is_empty() && rms(rows) < QUIETER * self.noise.level[*joint]
        };
        joints.iter().any(quieter).then_some(joints)
    }

    /// What columns leave of a joint's residual. Seconds with far more of it than others hold what
    /// begins and ends, a contact or a load: they are no noise, are left out of a second fit and
    /// marked.
    pub(super) fn left_by(&self, joint: usize, columns: &[Column], residual: &[f64]) -> Rest {
        /// Seconds with more than this times the median residual are left out.
        const LOUD: f64 = 4.0;
        let rows = &self.problem.rows[joint];
        let second = |row: usize| {
            let (stretch, sample) = rows[row];
            (stretch, (sample as f64 / self.problem.stretches[stretch].motion.rate_hz) as usize)
        };
        let (mut left, mut used, mut calm) = (residual.to_vec(), 0, vec![true; residual.len()]);
        for _ in 0..3 {
            let masked = |values: &[f64]| -> Vec<f64> {
                values
                    .iter()
                    .zip(calm.iter())
                    .map(|(x, calm)| if *calm { *x } else { 0.0 })
                    .collect()
            };
            let column = |values: Vec<f64>| -> Column {
                let mut column = vec![vec![]; self.problem.dof()];
                column[joint] = values;
                column
            };
            let some: Vec<Column> = columns.iter().map(|c| column(masked(&c[joint]))).collect();
            let basis = Basis::new(some);
            used = basis.rank();
            let factors = basis.solve(&column(masked(residual)));
            left = residual.to_vec();
            for (c, factor) in columns.iter().zip(&factors).filter(|(_, factor)| **factor != 0.0) {
                left.iter_mut().zip(&c[joint]).for_each(|(left, c)| *left -= factor * c);
            }
            let mut energies: Vec<((usize, usize), f64, f64)> = Vec::new();
            for (row, value) in left.iter().enumerate() {
                match energies.last_mut().filter(|(key, ..)| *key == second(row)) {
                    Some((_, sum, count)) => (*sum, *count) = (*sum + value * value, *count + 1.0),
                    None => energies.push((second(row), value * value, 1.0)),
                }
            }
            let mut sorted: Vec<f64> = energies.iter().map(|(_, sum, count)| sum / count).collect();
            sorted.sort_by(f64::total_cmp);
            let Some(median) = sorted.get(sorted.len() / 2) else { break };
            let loud: Vec<(usize, usize)> = energies
                .iter()
                .filter(|(_, sum, count)| sum / count > LOUD * median)
                .map(|(key, ..)| *key)
                .collect();
            (0..rows.len()).for_each(|row| calm[row] = loud.binary_search(&second(row)).is_err());
        }
        Rest { residual: left, used, calm }
    }

    /// The fit with the noise that the largest model leaves beside it, of some joints.
    pub(super) fn with_noise_anew(
        &mut self,
        fitted: &Fitted,
        joints: &[usize],
    ) -> Result<Fitted, Interrupted> {
        let anew = self.noise_of_largest(fitted)?;
        self.noise = self.noise.with_joints_of(&anew, joints);
        self.rows = self.noise.rows(&self.problem);
        let next = solve_like(&self.problem, fitted, fitted.terms(), &self.noise);
        Ok(refine_transforms(&self.problem, next, &self.noise))
    }
}
