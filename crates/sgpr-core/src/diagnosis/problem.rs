//! The logs as equations: rows of every joint, columns of the model and of candidates, all through one filter.

use super::DiagnosisError;
use crate::dynamics::{BatchWorkspace, Samples, for_each_regressor_block};
use crate::effects::{Context, Reach, sgn};
use crate::identification::{BaseParameters, ParameterSet, Row};
use crate::model::{Rigid, Term, TorqueModel, Trajectory, motions, select_joints, torque_of};
use crate::motion::{Motion, Processing};
use crate::recording::Recording;
use crate::signal::LowPass;
use crate::spatial::PARAMETERS_PER_LINK;

/// Highest cut-off of both sides of the equation, Hz: ripple and reversals show up to here.
const BAND_HZ: f64 = 25.0;

/// Rows per second, in cut-offs.
const ROWS_PER_CUTOFF: f64 = 2.5;

/// Folds of the held-out error, and the length of their blocks, s.
pub(super) const FOLDS: usize = 5;
const BLOCK_S: f64 = 2.0;

/// One processed stretch of a log.
#[derive(Debug)]
pub(super) struct Stretch {
    pub motion: Motion,
    /// On the clock of the session, s; empty if the logs share none.
    pub time: Vec<f64>,
    filter: LowPass,
    decimation: usize,
}

/// A column: per joint its rows, empty where it is zero.
pub(super) type Column = Vec<Vec<f64>>;

/// The equations of all joints.
#[derive(Debug)]
pub(super) struct Problem {
    pub set: ParameterSet,
    pub base: BaseParameters,
    /// The model without terms, from which constants of transforms are counted.
    pub nominal: TorqueModel,
    /// Terms that the model has already.
    pub given: Vec<Term>,
    pub stretches: Vec<Stretch>,
    /// Per joint: (stretch, sample) of each row.
    pub rows: Vec<Vec<(usize, usize)>>,
    /// Per joint and row: rows right before it without a gap.
    pub run: Vec<Vec<usize>>,
    /// Per joint and row: block of the held-out error.
    pub fold: Vec<Vec<usize>>,
    /// Torque, per joint.
    pub y: Column,
    /// Per joint: root mean square of the torque outside of the band, which is noise.
    pub beyond: Vec<f64>,
    /// Stamp at which the clock of the session starts, ns, if the logs share one.
    pub clock: Option<i64>,
}

impl Problem {
    pub fn new(model: &TorqueModel, train: &[Recording], processing: &Processing) -> Result<Self, DiagnosisError> {
        let robot = model.robot();
        let recordings = select_joints(robot, train)?;
        let motions = motions(&recordings, processing)?;
        let clock = common_clock(&motions).and(model.clock_start()).or(common_clock(&motions));
        let n = robot.dof();
        let mut stretches = Vec::new();
        for motion in motions {
            torque_of(&motion)?;
            let band = BAND_HZ.max(processing.cutoff_hz).min(0.2 * motion.rate_hz);
            let filter = LowPass::butterworth(4, band, motion.rate_hz)?;
            let decimation = (motion.rate_hz / (ROWS_PER_CUTOFF * band)).floor().max(1.0) as usize;
            let time = clock.map_or(vec![], |start| seconds_since(start, &motion.time));
            stretches.push(Stretch { motion, time, filter, decimation });
        }
        let set = model.parameter_set().clone();
        let mut nominal = model.clone().with_terms(vec![], clock);
        nominal.processing = Some(processing.clone());
        let mut problem = Self {
            base: BaseParameters::new(robot, &set),
            set,
            nominal,
            given: model.terms().to_vec(),
            rows: vec![vec![]; n],
            run: vec![vec![]; n],
            fold: vec![vec![]; n],
            y: vec![vec![]; n],
            beyond: vec![0.0; n],
            stretches,
            clock,
        };
        problem.lay_out_rows();
        problem.fill_torque()?;
        Ok(problem)
    }

    pub fn dof(&self) -> usize {
        self.rows.len()
    }

    /// Takes the rows at which torque lies at a limit out.
    pub fn drop_rows(&mut self, joint: usize, keep: impl Fn(f64) -> bool) -> Result<(), DiagnosisError> {
        let n = self.dof();
        for stretch in &mut self.stretches {
            let tau = stretch.motion.tau.as_deref().expect("checked in `new`");
            let reach = stretch.filter.settling_samples() / 2;
            let samples = stretch.motion.time.len();
            let clipped: Vec<usize> = (0..samples).filter(|k| !keep(tau[k * n + joint])).collect();
            for k in clipped {
                for near in k.saturating_sub(reach)..(k + reach + 1).min(samples) {
                    stretch.motion.use_as[near * n + joint] = Row::Skip;
                }
            }
        }
        self.lay_out_rows();
        self.fill_torque()
    }

    fn lay_out_rows(&mut self) {
        let n = self.dof();
        let mut offset = 0;
        self.rows.iter_mut().for_each(Vec::clear);
        self.run.iter_mut().for_each(Vec::clear);
        self.fold.iter_mut().for_each(Vec::clear);
        for (index, stretch) in self.stretches.iter().enumerate() {
            let motion = &stretch.motion;
            let block = (BLOCK_S * motion.rate_hz).max(1.0) as usize;
            for joint in 0..n {
                let mut run = 0;
                for sample in (0..motion.len()).step_by(stretch.decimation) {
                    if motion.use_as[sample * n + joint] != Row::Moving {
                        run = 0;
                        continue;
                    }
                    self.rows[joint].push((index, sample));
                    self.run[joint].push(run);
                    self.fold[joint].push((offset + sample / block) % FOLDS);
                    run += 1;
                }
            }
            offset += motion.len() / block + 1;
        }
    }

    fn fill_torque(&mut self) -> Result<(), DiagnosisError> {
        let n = self.dof();
        let mut y = vec![vec![]; n];
        let mut beyond = vec![(0.0, 0.0); n];
        for (index, stretch) in self.stretches.iter().enumerate() {
            let tau = torque_of(&stretch.motion)?;
            let mut smooth = tau.to_vec();
            stretch.filter.apply(&mut smooth, n)?;
            for joint in 0..n {
                for k in (0..stretch.motion.len()).filter(|&k| stretch.motion.use_as[k * n + joint] == Row::Moving) {
                    beyond[joint].0 += (tau[k * n + joint] - smooth[k * n + joint]).powi(2);
                    beyond[joint].1 += 1.0;
                }
                let own = self.rows[joint].iter().filter(|(stretch, _)| *stretch == index);
                y[joint].extend(own.map(|(_, sample)| smooth[sample * n + joint]));
            }
        }
        self.beyond = beyond.into_iter().map(|(sum, count): (f64, f64)| (sum / count.max(1.0)).sqrt()).collect();
        self.y = y;
        Ok(())
    }

    /// Per stretch: the rigid body as `model` has it.
    pub fn rigid(&self, model: &TorqueModel) -> Vec<Rigid> {
        self.stretches.iter().map(|stretch| model.rigid(&stretch.trajectory())).collect()
    }

    /// Per stretch: what effects may depend on.
    pub fn with_contexts(&self, model: &TorqueModel, rigid: &[Rigid], mut run: impl FnMut(usize, &Context<'_>)) {
        for (index, (stretch, rigid)) in self.stretches.iter().zip(rigid).enumerate() {
            run(index, &model.context(&stretch.trajectory(), rigid));
        }
    }

    /// Filters full-rate columns of a joint, `[samples, width]` row-major, and appends their rows to `out`.
    fn append(&self, model: &TorqueModel, at: (usize, usize), values: &mut [f64], out: &mut [Column]) {
        let (index, joint) = at;
        let width = out.len();
        let stretch = &self.stretches[index];
        for term in model.terms().iter().filter(|term| term.is_transform()) {
            term.effect.transmit(term.site, &term.constants, joint, stretch.motion.rate_hz, values, width);
        }
        stretch.filter.apply(values, width).expect("a stretch is longer than the filter");
        for (_, sample) in self.rows[joint].iter().filter(|(stretch, _)| *stretch == index) {
            for (column, value) in out.iter_mut().zip(&values[sample * width..]) {
                column[joint].push(*value);
            }
        }
    }

    /// Columns of the base parameters, rank of them, under the transforms of `model`.
    pub fn base_columns(&self, model: &TorqueModel, rigid: &[Rigid]) -> Vec<Column> {
        let n = self.dof();
        let robot = model.robot();
        let inertial = self.set.inertial();
        let mut columns = vec![vec![vec![]; n]; self.base.rank()];
        for (index, (stretch, rigid)) in self.stretches.iter().zip(rigid).enumerate() {
            let samples = stretch.motion.len();
            let trajectory = stretch.trajectory();
            let links = rigid.motion.as_ref();
            let motion = links.map_or(trajectory.samples, |m| Samples { q: &m.q, dq: &m.dq, ddq: &m.ddq });
            let mut of_joint: Vec<Vec<usize>> = vec![vec![]; n];
            for (column, &parameter) in self.base.independent().iter().enumerate() {
                for (joint, own) in of_joint.iter_mut().enumerate() {
                    let there = match parameter.checked_sub(inertial) {
                        None => robot.carries(joint, parameter / PARAMETERS_PER_LINK),
                        Some(effect) => self.set.effect_columns()[effect].joint == joint,
                    };
                    if there {
                        own.push(column);
                    }
                }
            }
            let mut tables: Vec<Vec<f64>> = of_joint.iter().map(|own| vec![0.0; samples * own.len()]).collect();
            // Per joint and link: (parameter of the link, position in the row).
            let place = |joint: usize, link: usize| -> Vec<(usize, usize)> {
                let own = of_joint[joint].iter().enumerate();
                let of_link = own.filter(|(_, column)| self.base.independent()[**column] < inertial);
                of_link
                    .map(|(position, column)| (self.base.independent()[*column], position))
                    .filter(|(parameter, _)| parameter / PARAMETERS_PER_LINK == link)
                    .map(|(parameter, position)| (parameter % PARAMETERS_PER_LINK, position))
                    .collect()
            };
            let places: Vec<Vec<Vec<(usize, usize)>>> =
                (0..n).map(|joint| (0..n).map(|link| place(joint, link)).collect()).collect();
            for_each_regressor_block(
                &rigid.robot,
                &mut BatchWorkspace::new(&rigid.robot),
                motion,
                |joint, link, first, count, block| {
                    let width = of_joint[joint].len();
                    for &(parameter, position) in &places[joint][link] {
                        for (k, value) in (first..first + count).zip(&block[parameter]) {
                            tables[joint][k * width + position] = *value;
                        }
                    }
                },
            );
            let context = model.context(&trajectory, rigid);
            let mut values = vec![0.0; self.set.effect_columns_per_joint()];
            for joint in 0..n {
                let parameters = self.set.effect_parameters_of(joint);
                let width = of_joint[joint].len();
                let wanted: Vec<(usize, usize)> = of_joint[joint]
                    .iter()
                    .enumerate()
                    .filter_map(|(position, column)| {
                        let parameter = self.base.independent()[*column];
                        parameters.iter().position(|own| *own == parameter).map(|index| (index, position))
                    })
                    .collect();
                for k in 0..samples {
                    self.set.effect_row(joint, &context.state(k), &mut values);
                    wanted.iter().for_each(|&(index, at)| tables[joint][k * width + at] = values[index]);
                }
                let mut out: Vec<Column> = of_joint[joint].iter().map(|_| vec![vec![]; n]).collect();
                self.append(model, (index, joint), &mut tables[joint], &mut out);
                for (own, out) in of_joint[joint].iter().zip(&out) {
                    columns[*own][joint].extend_from_slice(&out[joint]);
                }
            }
        }
        columns
    }

    /// Columns of the linear parameters of terms that enter by columns.
    pub fn term_columns(&self, model: &TorqueModel, rigid: &[Rigid], terms: &[&Term]) -> Vec<Vec<Column>> {
        let n = self.dof();
        let mut result: Vec<Vec<Column>> =
            terms.iter().map(|term| vec![vec![vec![]; n]; term.effect.parameters().len()]).collect();
        self.with_contexts(model, rigid, |index, context| {
            for (term, result) in terms.iter().zip(&mut result) {
                let columns = term.columns(context);
                if columns.is_empty() {
                    continue;
                }
                match term.effect.reach() {
                    Reach::Own => {
                        let joint = term.site.joint().expect("it reaches its own joint");
                        let mut table = interleaved(&columns, |column, k| column[k], context.len());
                        self.append(model, (index, joint), &mut table, result);
                    }
                    Reach::All => {
                        for joint in 0..n {
                            let mut table = interleaved(&columns, |column, k| column[k * n + joint], context.len());
                            self.append(model, (index, joint), &mut table, result);
                        }
                    }
                }
            }
        });
        result
    }

    /// A column from the torque difference of two models, per unit.
    pub fn difference(&self, models: [&TorqueModel; 2], per: f64) -> Column {
        let n = self.dof();
        let mut out = vec![vec![vec![]; n]];
        for (index, stretch) in self.stretches.iter().enumerate() {
            let [a, b] = models.map(|model| model.predict_trajectory(&stretch.trajectory()));
            for joint in 0..n {
                let pairs = a.iter().zip(&b).skip(joint).step_by(n);
                let mut values: Vec<f64> = pairs.map(|(a, b)| (b - a) / per).collect();
                if values.iter().all(|value| *value == 0.0) {
                    let rows = self.rows[joint].iter().filter(|(stretch, _)| *stretch == index).count();
                    out[0][joint].extend(std::iter::repeat_n(0.0, rows));
                    continue;
                }
                self.append(&self.nominal, (index, joint), &mut values, &mut out);
            }
        }
        out.swap_remove(0)
    }

    /// Columns that take up what is wrong with sgn(dq) near reversals, two per joint with dry friction.
    pub fn reversal_columns(
        &self,
        model: &TorqueModel,
        rigid: &[Rigid],
        joint: usize,
        widths: [f64; 2],
    ) -> Vec<Column> {
        let mut out = vec![vec![vec![]; self.dof()]; 2];
        self.with_contexts(model, rigid, |index, context| {
            let shape = |dq: f64, width: f64| sgn(dq) * (-(dq / width).abs()).exp();
            let both = |dq: f64| widths.map(|width| shape(dq, width));
            let mut table: Vec<f64> = context.of_joint(context.dq, joint).flat_map(both).collect();
            self.append(model, (index, joint), &mut table, &mut out);
        });
        out
    }

    /// Columns of any function of a sample at one joint.
    pub fn feature_columns(
        &self,
        joint: usize,
        width: usize,
        mut features: impl FnMut(&Stretch, usize, &mut [f64]),
    ) -> Vec<Column> {
        let mut out = vec![vec![vec![]; self.dof()]; width];
        for (index, stretch) in self.stretches.iter().enumerate() {
            let mut table = vec![0.0; stretch.motion.len() * width];
            for (k, row) in table.chunks_exact_mut(width).enumerate() {
                features(stretch, k, row);
            }
            self.append(&self.nominal, (index, joint), &mut table, &mut out);
        }
        out
    }

    /// Lowest and highest value of a joint's positions.
    pub fn range(&self, joint: usize) -> [f64; 2] {
        let n = self.dof();
        let all = self.stretches.iter().flat_map(|s| s.motion.q.iter().skip(joint).step_by(n));
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], q| [low.min(*q), high.max(*q)])
    }

    /// First and last time of the session, s.
    pub fn time_span(&self) -> [f64; 2] {
        let times = self.stretches.iter().flat_map(|s| s.time.iter());
        times.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], t| [low.min(*t), high.max(*t)])
    }

    /// Time of a row, s.
    pub fn time_of(&self, (stretch, sample): (usize, usize)) -> f64 {
        self.stretches[stretch].time[sample]
    }
}

impl Stretch {
    pub fn trajectory(&self) -> Trajectory<'_> {
        Trajectory {
            samples: self.motion.samples(),
            rate_hz: self.motion.rate_hz,
            time: &self.time,
            channels: &self.motion.channels,
        }
    }
}

fn interleaved(columns: &[Vec<f64>], at: impl Fn(&[f64], usize) -> f64, samples: usize) -> Vec<f64> {
    (0..samples).flat_map(|k| columns.iter().map(|column| at(column, k)).collect::<Vec<_>>()).collect()
}

fn seconds_since(start: i64, stamps: &[i64]) -> Vec<f64> {
    stamps.iter().map(|stamp| (stamp - start) as f64 * 1e-9).collect()
}

/// The earliest stamp, if no two logs overlap in time. A clock that starts near zero starts at zero.
fn common_clock(motions: &[Motion]) -> Option<i64> {
    let mut spans: Vec<(i64, i64)> = motions.iter().filter_map(|m| Some((*m.time.first()?, *m.time.last()?))).collect();
    spans.sort_unstable();
    let apart = spans.windows(2).all(|pair| pair[0].1 <= pair[1].0);
    let first = spans.first()?.0;
    apart.then_some(if first.abs() < 3_600_000_000_000 { 0 } else { first })
}
