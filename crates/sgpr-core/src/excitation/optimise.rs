//! The search for a motion that excites all parameters within its limits.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use derive_setters::Setters;
use serde::{Deserialize, Serialize};

use sgpr_predict::internal::with_role;
use slsqp::{StopTols, minimize};

use super::criterion::Objective;
use super::information::{BesideBase, Information, require_noise};
use super::nominal::RATE_HZ;
use super::peaks::suprema;
use super::problem::{MotionGrid, MotionProblem, SIGN_WIDTH, Sharpness, TorqueLimits, trajectory};
use super::surroundings::Checker;
use super::{
    Basis, Criterion, ExcitationError, ExcitationReport, MotionLimits, NominalEffects, Peaks,
    Surroundings, Trajectory, evaluate, forecast, peaks,
};
use crate::dynamics::{Workspace, gravity_torque};
use crate::effects::Role;
use crate::identification::{BaseParameters, Forecast, ParameterSet};
use crate::progress::{Interrupted, Progress};
use crate::robot::Robot;
use crate::simulation::{NormalNumbers, Reference};

/// Names of the effects that a motion is to reveal beside the rigid body unless others are named.
pub fn usual_effects() -> Vec<String> {
    [Role::ViscousFriction, Role::DryFriction]
        .map(|role| with_role(role).name().to_string())
        .to_vec()
}

/// What to search for, and how hard.
#[derive(Clone, Debug, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct ExciteOptions {
    /// What is made small.
    pub criterion: Criterion,
    /// Family of the motion.
    pub basis: Basis,
    /// Limits.
    pub limits: MotionLimits,
    /// Where the motion starts and ends, `[n]`, rad (m); [`MotionLimits::default_start`] if `None`.
    pub start: Option<Vec<f64>>,
    /// Standard deviations of the torque noise, `[n]`, N·m (N), which weigh the joints; all alike
    /// if `None`.
    pub noise: Option<Vec<f64>>,
    /// Parameters of the set that torque limits are checked with; those of the robot file if
    /// `None`.
    pub parameters: Option<Vec<f64>>,
    /// Effects that depend on the whole motion or enter nonlinearly, whose parameters shall be
    /// revealed too.
    pub nominal: Option<NominalEffects>,
    /// What is around the arm, if anything.
    pub surroundings: Option<Surroundings>,
    /// Searches from different random motions; the best result counts.
    pub starts: usize,
    /// Evaluations of the criterion per search.
    pub evaluations: usize,
    /// Threads; the result does not depend on them.
    pub threads: usize,
    /// Of the random motions.
    pub seed: u64,
}

impl ExciteOptions {
    /// Condition number, six searches of 1500 evaluations.
    pub fn new(basis: Basis, limits: MotionLimits) -> Self {
        Self {
            criterion: Criterion::Condition,
            basis,
            limits,
            start: None,
            noise: None,
            parameters: None,
            nominal: None,
            surroundings: None,
            starts: 6,
            evaluations: 1500,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            seed: 0,
        }
    }
}

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// All searches ran to their end.
    Finished,
    /// Stopped on request; the best motion so far.
    Interrupted,
}

/// Best value of a search after some evaluations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SearchStep {
    /// Number of the search.
    pub start: usize,
    /// Evaluations of this search so far.
    pub evaluation: usize,
    /// The criterion in its smooth form, with what the limits would cost.
    pub value: f64,
}

/// A motion that was found.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Excitation {
    /// The motion.
    pub trajectory: Trajectory,
    /// Value of the criterion, not smoothed.
    pub value: f64,
    /// What the motion reveals.
    pub report: ExcitationReport,
    /// Largest values of the motion.
    pub peaks: Peaks,
    /// How much of it to record ([`forecast`]); without the effects at nominal values.
    pub forecast: Forecast,
    /// The largest share of a limit that is used, one or less.
    pub utilisation: f64,
    /// That limit: what would have to be relaxed for a larger motion.
    pub tightest: String,
    /// How the searches went, by search and evaluation.
    pub history: Vec<SearchStep>,
    /// Value of the criterion that each search ended with; infinite if it was not begun.
    pub values: Vec<f64>,
    /// How it ended.
    pub status: Status,
}

/// Random motions that are looked at for each search, of which the best is taken.
const DRAWS: usize = 16;

/// Grid points per turn of the fastest component: a product of two components turns twice as fast,
/// and the criterion is an average over all of them.
const POINTS_PER_TURN: f64 = 16.0;

/// From easy to true: smooth condition number and smooth limits.
const STAGES: [Sharpness; 3] = [
    Sharpness { power: 2.0, maximum: 60.0 },
    Sharpness { power: 6.0, maximum: 150.0 },
    Sharpness { power: 24.0, maximum: 400.0 },
];

/// Searches for the motion of a basis that makes the criterion smallest within the limits.
///
/// Sequential quadratic programming (the crate `slsqp`) from several random motions, on smooth
/// forms of criterion and limits that are sharpened in three stages, with derivatives of the
/// regressor recursion. Whatever the search returns is then scaled about its start until its
/// largest values in continuous time are at the limits. `progress` hears of the evaluations of all
/// searches; if it stops the work, the best motion so far is the result.
///
/// # Errors
/// If a limit or an option has no meaning, the start position breaks a limit, no motion found
/// excites all base parameters, or the work is stopped before there is any motion.
///
/// # Examples
/// ```
/// use sgpr_core::excitation::{Basis, ExciteOptions, MotionLimits, optimise};
/// use sgpr_core::identification::{BaseParameters, ParameterSet};
/// use sgpr_core::robot::two_link;
/// let robot = two_link();
/// let set = ParameterSet::new(&robot, &["viscous_friction", "coulomb_friction"])?;
/// let base = BaseParameters::new(&robot, &set);
/// let limits = MotionLimits::of_robot(&robot, &[2.0, 2.0])?;
/// let options = ExciteOptions::new(Basis::fourier(0.1, 3), limits).with_starts(1).with_evaluations(100);
/// let found = optimise(&robot, &set, &base, &options, &())?;
/// assert!(found.value < 40.0 && found.utilisation <= 1.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn optimise(
    robot: &Robot,
    set: &ParameterSet,
    base: &BaseParameters,
    options: &ExciteOptions,
    progress: &dyn Progress,
) -> Result<Excitation, ExcitationError> {
    let search = MotionSearch::new(robot, set, base, options)?;
    let (total, stop) = (options.starts * options.evaluations, AtomicBool::new(false));
    let (next, done, finished) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicUsize::new(0));
    let results: Mutex<Vec<SearchResult>> = Mutex::new(Vec::new());
    let threads = options.threads.clamp(1, options.starts);
    progress.step("excite", 0, total)?;
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let _leaves = Leaves(&finished);
                loop {
                    let start = next.fetch_add(1, Ordering::Relaxed);
                    if start >= options.starts || stop.load(Ordering::Relaxed) {
                        break;
                    }
                    let result = search.from(start, &stop, &done);
                    results.lock().unwrap_or_else(PoisonError::into_inner).push(result);
                }
            });
        }
        // The listener is asked on this thread: an interpreter handles its signals nowhere else.
        while finished.load(Ordering::Acquire) < threads {
            std::thread::sleep(Duration::from_millis(5));
            let count = done.load(Ordering::Relaxed).min(total);
            if progress.step("excite", count, total.max(count + 1)) == Err(Interrupted) {
                stop.store(true, Ordering::Relaxed);
            }
        }
    });
    let stopped = stop.load(Ordering::Relaxed);
    if !stopped && progress.step("excite", total, total) == Err(Interrupted) {
        return search.best(results.into_inner().unwrap_or_else(PoisonError::into_inner), true);
    }
    search.best(results.into_inner().unwrap_or_else(PoisonError::into_inner), stopped)
}

/// Counts a thread that ends, by a panic too.
struct Leaves<'a>(&'a AtomicUsize);

impl Drop for Leaves<'_> {
    fn drop(&mut self) {
        self.0.fetch_add(1, Ordering::Release);
    }
}

/// A random motion of a basis that uses the limits of position, speed and acceleration to the full.
///
/// # Errors
/// If a limit has no meaning or the start is outside.
pub fn random_motion(
    robot: &Robot,
    basis: &Basis,
    limits: &MotionLimits,
    start: &[f64],
    seed: u64,
) -> Result<Trajectory, ExcitationError> {
    basis.require_valid()?;
    limits.require_valid(robot)?;
    require_start(robot, limits, start)?;
    let free = basis.free_directions();
    let motion = random_variables(&mut NormalNumbers::new(seed), robot.dof(), &free, basis);
    let motion = trajectory(basis, &free, start, &motion);
    let set = ParameterSet::new(robot, &[] as &[&str]).expect("no effects");
    let used =
        peaks(robot, &set, &robot.standard_parameters(), &motion).motion_utilisation(limits, start);
    Ok(motion.scaled(WITHIN / used))
}

/// The largest share of a limit that a motion is scaled to; what is left covers rounding.
const WITHIN: f64 = 1.0 - 1e-9;

/// A motion over less than this share of every position range stands still.
const STILL: f64 = 1e-4;

/// Normally distributed, every component of the motion alike in acceleration.
fn random_variables(
    noise: &mut NormalNumbers,
    n: usize,
    free: &[Vec<f64>],
    basis: &Basis,
) -> Vec<f64> {
    let middle = 0.37 * basis.duration();
    let mut functions = [vec![0.0; basis.len()], vec![0.0; basis.len()], vec![0.0; basis.len()]];
    let [value, slope, curvature] = &mut functions;
    basis.evaluate(middle, [value, slope, curvature]);
    // Size of the acceleration that a direction makes.
    let sizes: Vec<f64> = free
        .iter()
        .map(|direction| {
            let sum: f64 = direction.iter().zip(&functions[2]).map(|(d, f)| d * f * (d * f)).sum();
            sum.sqrt().max(1e-3)
        })
        .collect();
    (0..n * free.len()).map(|k| noise.normal() / sizes[k % free.len()]).collect()
}

struct MotionSearch<'a> {
    robot: &'a Robot,
    set: &'a ParameterSet,
    base: &'a BaseParameters,
    options: &'a ExciteOptions,
    objective: Objective,
    /// The same without nominal effects.
    plain: Objective,
    start: Vec<f64>,
    parameters: Vec<f64>,
    torque: Option<TorqueLimits>,
    free: Vec<Vec<f64>>,
    grid: MotionGrid,
    limit_grid: MotionGrid,
}

struct SearchResult {
    start: usize,
    trajectory: Trajectory,
    value: f64,
    history: Vec<SearchStep>,
}

impl<'a> MotionSearch<'a> {
    fn new(
        robot: &'a Robot,
        set: &'a ParameterSet,
        base: &'a BaseParameters,
        options: &'a ExciteOptions,
    ) -> Result<Self, ExcitationError> {
        options.basis.require_valid()?;
        options.limits.require_valid(robot)?;
        require_noise(robot, options.noise.as_deref())?;
        for (option, value) in [("starts", options.starts), ("evaluations", options.evaluations)] {
            if value == 0 {
                return Err(ExcitationError::InvalidOption {
                    option,
                    value: 0.0,
                    expected: "one or more",
                });
            }
        }
        let start = options.start.clone().unwrap_or_else(|| options.limits.default_start());
        require_start(robot, &options.limits, &start)?;
        let mut parameters = robot.standard_parameters();
        parameters.resize(set.len(), 0.0);
        if let Some(given) = &options.parameters {
            assert_eq!(given.len(), set.len(), "every parameter of the set");
            parameters.clone_from(given);
        }
        if let Some(limits) = &options.limits.torque {
            require_start_torque(robot, set, limits, &parameters, &start)?;
        }
        if let Some(cell) = &options.surroundings {
            cell.require_valid()?;
            require_start_clearance(robot, cell, &start)?;
        }
        let torque = options.limits.torque.clone();
        let free = options.basis.free_directions();
        let turns = options.basis.duration() / options.basis.shortest_time();
        let unknowns = set.len() + options.nominal.as_ref().map_or(0, NominalEffects::len);
        let with_memory = options.nominal.as_ref().is_some_and(NominalEffects::has_memory);
        let in_time = if with_memory { RATE_HZ * options.basis.duration() } else { 0.0 };
        let enough = (POINTS_PER_TURN * turns).max(2.0 * unknowns as f64 / robot.dof() as f64);
        let points = enough.max(in_time).ceil() as usize;
        Ok(Self {
            objective: Objective::new(
                options.criterion,
                robot,
                set,
                base,
                options.nominal.as_ref(),
            ),
            plain: Objective::new(options.criterion, robot, set, base, None),
            torque: torque
                .map(|limits| TorqueLimits { limits, base_parameters: base.combine(&parameters) }),
            grid: MotionGrid::new(&options.basis, &free, points),
            limit_grid: MotionGrid::new(&options.basis, &free, 2 * points),
            robot,
            set,
            base,
            options,
            start,
            parameters,
            free,
        })
    }

    fn checker(&self) -> Option<Checker<'_>> {
        self.options
            .surroundings
            .as_ref()
            .map(|cell| Checker::new(self.robot, cell))
            .filter(|checker| checker.len() > 0)
    }

    fn information(&self, nominal: Option<&'a NominalEffects>, smoothing: f64) -> Information<'a> {
        let nominal = nominal.map(|nominal| nominal as &dyn BesideBase);
        Information::new(
            self.robot,
            self.set,
            self.base,
            nominal,
            self.options.noise.as_deref(),
            smoothing,
        )
    }

    /// With the nominal effects or without.
    fn problem(&self, nominal: Option<&'a NominalEffects>) -> MotionProblem<'_> {
        let slowest = self.options.limits.velocity.iter().copied().fold(f64::INFINITY, f64::min);
        MotionProblem {
            information: self.information(nominal, SIGN_WIDTH * slowest),
            objective: if nominal.is_some() { &self.objective } else { &self.plain },
            limits: &self.options.limits,
            torque: self.torque.as_ref(),
            surroundings: self.checker(),
            start: &self.start,
            grid: &self.grid,
            limit_grid: &self.limit_grid,
            sharpness: STAGES[0],
        }
    }

    /// One search. With nominal effects it is two of half the length, one of them without these
    /// effects, on a smooth criterion: jumps of friction can keep the other from getting anywhere.
    fn from(&self, start: usize, stop: &AtomicBool, done: &AtomicUsize) -> SearchResult {
        let mut problem = self.problem(None);
        let mut noise = NormalNumbers::new(
            self.options.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(start as u64),
        );
        let mut draw = || {
            let x = random_variables(&mut noise, self.robot.dof(), &self.free, &self.options.basis);
            let motion =
                self.scaled(trajectory(&self.options.basis, &self.free, &self.start, &x), None);
            let factor = motion.1;
            let x: Vec<f64> = x.iter().map(|x| 0.8 * factor * x).collect();
            (problem.value(&x, None), x)
        };
        let mut best = draw();
        for _ in 1..DRAWS {
            let other = draw();
            if other.0 < best.0 {
                best = other;
            }
        }
        let result = |x: &[f64], history: Vec<SearchStep>| {
            let (motion, _) =
                self.scaled(trajectory(&self.options.basis, &self.free, &self.start, x), Some(()));
            SearchResult { start, value: self.value(&motion), trajectory: motion, history }
        };
        let condition = self.objective.is_condition();
        let descent = || Descent { start, condition, stop, done, history: vec![] };
        let Some(nominal) = self.options.nominal.as_ref().filter(|nominal| !nominal.is_empty())
        else {
            let (x, history) = descent().in_stages(&mut problem, best.1, self.options.evaluations);
            return result(&x, history);
        };
        let half = self.options.evaluations.div_ceil(2);
        let (x, history) = descent().in_stages(&mut problem, best.1.clone(), half);
        let without = result(&x, history);
        let rest = (self.options.evaluations - half).max(1);
        let (x, history) = descent().in_stages(&mut self.problem(Some(nominal)), best.1, rest);
        let with = result(&x, history);
        if with.value <= without.value {
            with
        } else {
            SearchResult { history: with.history, ..without }
        }
    }

    /// The motion scaled about its start so that its peaks are at the limits, and the factor; with
    /// `all`, torque and surroundings too.
    fn scaled(&self, motion: Trajectory, all: Option<()>) -> (Trajectory, f64) {
        let limits = &self.options.limits;
        let of = |motion: &Trajectory| peaks(self.robot, self.set, &self.parameters, motion);
        let mut factor = WITHIN / of(&motion).motion_utilisation(limits, &self.start).max(1e-12);
        if all.is_none() || (limits.torque.is_none() && self.checker().is_none()) {
            return (motion.scaled(factor), factor);
        }
        // Torque and distance are no linear functions of the motion: bisection between a smaller
        // motion that keeps within its limits, in the end standing still, and the whole one.
        let fits = |factor: f64| self.utilisation(&motion.clone().scaled(factor)) <= WITHIN.sqrt();
        if !fits(factor) {
            let (mut low, mut high) = (0.0, factor);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if fits(middle) {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            factor = low;
        }
        (motion.scaled(factor), factor)
    }

    /// The largest share of any limit, over continuous time.
    fn utilisation(&self, motion: &Trajectory) -> f64 {
        let used =
            peaks(self.robot, self.set, &self.parameters, motion).utilisation(&self.options.limits);
        self.shares_of_surroundings(motion).into_iter().fold(used, f64::max)
    }

    /// The limit of which a motion uses the largest share.
    fn tightest(&self, motion: &Trajectory, peaks: &Peaks) -> String {
        let of_joints =
            peaks.shares(&self.options.limits).into_iter().map(|(quantity, joint, share)| {
                (share, format!("{quantity} of joint `{}`", self.robot.joints()[joint].name))
            });
        let names = self.checker();
        let around = self.shares_of_surroundings(motion).into_iter().enumerate();
        let around = around.filter_map(|(index, share)| Some((share, names.as_ref()?.name(index))));
        let most = of_joints.chain(around).max_by(|a, b| a.0.total_cmp(&b.0));
        most.map(|(_, limit)| limit).expect("a robot has joints")
    }

    /// How much of each limit of the surroundings a motion uses at most, over continuous time.
    fn shares_of_surroundings(&self, motion: &Trajectory) -> Vec<f64> {
        let Some(mut checker) = self.checker() else { return vec![] };
        let (n, count) = (self.robot.dof(), checker.len());
        let mut state = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        let mut values = |time: f64, out: &mut [f64]| {
            let [q, dq, ddq] = &mut state;
            motion.sample(time, q, dq, ddq);
            checker.shares(q, dq, out);
        };
        suprema(count, motion.duration(), motion.basis().shortest_time(), &mut values)
    }

    /// The limit that stops a motion which hardly leaves its start.
    fn limit_without_room(&self, motion: &Trajectory) -> Option<ExcitationError> {
        let peaks = peaks(self.robot, self.set, &self.parameters, motion);
        let limits = &self.options.limits;
        let ranges = peaks.position.iter().zip(&limits.position);
        let room = ranges
            .map(|([least, largest], [low, high])| (largest - least) / (high - low))
            .fold(0.0, f64::max);
        if room >= STILL {
            return None;
        }
        Some(ExcitationError::NoRoom { limit: self.tightest(motion, &peaks), room })
    }

    /// The criterion of a motion on a dense grid, with the true sign function.
    fn value(&self, motion: &Trajectory) -> f64 {
        let mut information = self.information(self.options.nominal.as_ref(), 0.0);
        information.observe(&dense(motion));
        self.objective.value_and_derivative(&information.matrix(), None).0
    }

    fn best(
        &self,
        mut results: Vec<SearchResult>,
        stopped: bool,
    ) -> Result<Excitation, ExcitationError> {
        results.sort_by_key(|result| result.start);
        let mut values = vec![f64::INFINITY; self.options.starts];
        for result in &results {
            values[result.start] = result.value;
        }
        let history = results.iter().flat_map(|result| result.history.iter().copied()).collect();
        let Some(best) = results.into_iter().min_by(|a, b| a.value.total_cmp(&b.value)) else {
            return Err(Interrupted.into());
        };
        let noise = self.options.noise.as_deref();
        let report = evaluate(
            self.robot,
            self.set,
            self.base,
            self.options.nominal.as_ref(),
            &dense(&best.trajectory),
            noise,
        )?;
        if !best.value.is_finite() {
            let (rank, expected) = (report.rank, report.singular_values.len());
            return Err(match rank < expected {
                true => self.limit_without_room(&best.trajectory).unwrap_or(
                    ExcitationError::RankDeficient { rank, expected, names: report.not_told_apart },
                ),
                false => ExcitationError::Units { criterion: self.options.criterion.name() },
            });
        }
        let peaks = peaks(self.robot, self.set, &self.parameters, &best.trajectory);
        Ok(Excitation {
            forecast: forecast(
                self.robot,
                self.set,
                self.base,
                &best.trajectory,
                &self.parameters,
                noise,
            )?,
            utilisation: self.utilisation(&best.trajectory),
            tightest: self.tightest(&best.trajectory, &peaks),
            value: best.value,
            trajectory: best.trajectory,
            report,
            peaks,
            history,
            values,
            status: if stopped { Status::Interrupted } else { Status::Finished },
        })
    }
}

/// A descent from one start.
struct Descent<'a> {
    /// Number of the start.
    start: usize,
    /// Whether the criterion is the logarithm of a condition number.
    condition: bool,
    stop: &'a AtomicBool,
    /// Evaluations of all starts.
    done: &'a AtomicUsize,
    history: Vec<SearchStep>,
}

impl Descent<'_> {
    /// Descends on criterion and limits that are sharpened step by step.
    fn in_stages(
        mut self,
        problem: &mut MotionProblem<'_>,
        mut x: Vec<f64>,
        evaluations: usize,
    ) -> (Vec<f64>, Vec<SearchStep>) {
        let stages: &[Sharpness] = if self.condition { &STAGES } else { &[STAGES[0], STAGES[2]] };
        for (index, stage) in stages.iter().enumerate() {
            problem.sharpness = *stage;
            // What earlier stages left over is used by the last.
            let share = evaluations * (index + 1) / stages.len();
            let most = share.saturating_sub(self.history.len()).max(1);
            x = self.descend(problem, x, most);
        }
        self.done.fetch_add(evaluations.saturating_sub(self.history.len()), Ordering::Relaxed);
        (x, self.history)
    }

    fn descend(&mut self, problem: &mut MotionProblem<'_>, x: Vec<f64>, most: usize) -> Vec<f64> {
        let Self { start, condition, stop, done, ref mut history } = *self;
        let constraints = problem.constraints();
        // Iterates of sequential quadratic programming lie just outside of their limits as often as
        // inside: the best one is that which is best once it has been made small enough.
        let best = RefCell::new((f64::INFINITY, x.clone()));
        let shared = RefCell::new((problem, history));
        let value = |x: &[f64], gradient: Option<&mut [f64]>, (): &mut ()| {
            let (problem, history) = &mut *shared.borrow_mut();
            if stop.load(Ordering::Relaxed) {
                // Flat: the optimiser has arrived.
                if let Some(gradient) = gradient {
                    gradient.fill(0.0);
                }
                return 0.0;
            }
            let value = problem.value(x, gradient);
            let merit = value + problem.price_of_scaling() * problem.violation(x);
            if merit < best.borrow().0 {
                *best.borrow_mut() = (merit, x.to_vec());
            }
            let shown = if condition { merit.exp() } else { merit };
            history.push(SearchStep { start, evaluation: history.len() + 1, value: shown });
            done.fetch_add(1, Ordering::Relaxed);
            value
        };
        let limits: Vec<_> = (0..constraints)
            .map(|index| {
                let shared = &shared;
                move |x: &[f64], gradient: Option<&mut [f64]>, (): &mut ()| {
                    shared.borrow_mut().0.constraint(index, x, gradient)
                }
            })
            .collect();
        let tolerances =
            StopTols { ftol_rel: 1e-7, ftol_abs: 1e-7, xtol_rel: 1e-7, ..StopTols::default() };
        let bounds = vec![(f64::NEG_INFINITY, f64::INFINITY); x.len()];
        // However it ends, its best iterate is what counts.
        let _ = minimize(value, &x, &bounds, &limits, (), most, Some(tolerances));
        best.into_inner().1
    }
}

/// Samples over one duration, a hundred per turn of the fastest component, close enough for effects
/// with a memory.
fn dense(motion: &Trajectory) -> super::TrajectorySamples {
    motion.samples((100.0 / motion.basis().shortest_time()).max(RATE_HZ), motion.duration())
}

fn require_start(
    robot: &Robot,
    limits: &MotionLimits,
    start: &[f64],
) -> Result<(), ExcitationError> {
    if start.len() != robot.dof() {
        return Err(ExcitationError::Length {
            what: "start",
            expected: robot.dof(),
            found: start.len(),
        });
    }
    for ((joint, &value), &[low, high]) in robot.joint_names().zip(start).zip(&limits.position) {
        if !(low < value && value < high) {
            let limit = if value >= high { high } else { low };
            return Err(ExcitationError::InfeasibleStart {
                what: format!("position of joint `{joint}`"),
                value,
                limit,
            });
        }
    }
    Ok(())
}

fn require_start_torque(
    robot: &Robot,
    set: &ParameterSet,
    limits: &[f64],
    parameters: &[f64],
    start: &[f64],
) -> Result<(), ExcitationError> {
    let robot = robot.clone().with_standard_parameters(&parameters[..set.inertial()]);
    let mut ws = Workspace::new(&robot);
    let tau = gravity_torque(&robot, &mut ws, start);
    for ((joint, &value), &limit) in robot.joint_names().zip(tau).zip(limits) {
        if value.abs() >= limit {
            let what = format!("torque of joint `{joint}` against gravity");
            return Err(ExcitationError::InfeasibleStart { what, value, limit });
        }
    }
    Ok(())
}

fn require_start_clearance(
    robot: &Robot,
    cell: &Surroundings,
    start: &[f64],
) -> Result<(), ExcitationError> {
    let mut checker = Checker::new(robot, cell);
    let mut shares = vec![0.0; checker.len()];
    checker.shares(start, &vec![0.0; start.len()], &mut shares);
    match shares.iter().position(|share| *share >= 1.0) {
        Some(index) => {
            let (value, limit) = checker.quantity(index, shares[index]);
            Err(ExcitationError::InfeasibleStart { what: checker.name(index), value, limit })
        }
        None => Ok(()),
    }
}
