//! A whole experiment: an arm, a controller, a motion to follow.

use derive_setters::Setters;

use super::controller::{Controller, Measurement, Setpoint};
use super::sensors::{NormalNumbers, Sensors, VelocitySensor, add_noise};
use super::{Reference, SimulationError, Simulator};
use crate::progress::Progress;
use crate::recording::Recording;

/// How an experiment is run. All times are whole numbers of simulation steps.
#[derive(Clone, Debug, PartialEq, Setters)]
#[setters(prefix = "with_")]
#[non_exhaustive]
pub struct Experiment {
    /// Time from one call of the controller to the next, s.
    pub control_period: f64,
    /// Time from a measurement until the torque computed from it acts, s. Until the first one acts,
    /// the first acts.
    pub delay: f64,
    /// Time between recorded samples, s: whole control periods.
    pub record_period: f64,
    /// What the controller sees.
    pub sensors: Sensors,
    /// Largest torque of each drive, `[n]`, N·m (N).
    pub torque_limits: Option<Vec<f64>>,
    /// Seed of all noise.
    pub seed: u64,
}

impl Default for Experiment {
    /// Control and recording at 1 kHz, no delay, ideal sensors, no limits.
    fn default() -> Self {
        Self {
            control_period: 1e-3,
            delay: 0.0,
            record_period: 1e-3,
            sensors: Sensors::default(),
            torque_limits: None,
            seed: 0,
        }
    }
}

/// What happened, sample by sample; every array `[samples, n]`, row-major, SI.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct SimulationRecord {
    /// Names of the joints.
    pub joint_names: Vec<String>,
    /// `[samples]`, ns.
    pub time: Vec<i64>,
    /// True positions.
    pub q: Vec<f64>,
    /// True velocities.
    pub dq: Vec<f64>,
    /// True accelerations, in the step that begins at the sample.
    pub ddq: Vec<f64>,
    /// True torque of the drives, in the step that begins at the sample.
    pub tau: Vec<f64>,
    /// Torque of friction, likewise.
    pub friction: Vec<f64>,
    /// Measured positions.
    pub q_measured: Vec<f64>,
    /// Measured velocities.
    pub dq_measured: Vec<f64>,
    /// Measured torques.
    pub tau_measured: Vec<f64>,
    /// Wanted positions.
    pub q_wanted: Vec<f64>,
    /// Wanted velocities.
    pub dq_wanted: Vec<f64>,
    /// Wanted accelerations.
    pub ddq_wanted: Vec<f64>,
}

impl SimulationRecord {
    /// Arrays of one number per sample and joint.
    const ARRAYS: u64 = 11;

    fn with_capacity(joint_names: Vec<String>, samples: usize) -> Self {
        let array = || Vec::with_capacity(samples * joint_names.len());
        Self {
            time: Vec::with_capacity(samples),
            q: array(),
            dq: array(),
            ddq: array(),
            tau: array(),
            friction: array(),
            q_measured: array(),
            dq_measured: array(),
            tau_measured: array(),
            q_wanted: array(),
            dq_wanted: array(),
            ddq_wanted: array(),
            joint_names,
        }
    }

    /// Number of joints n.
    pub fn dof(&self) -> usize {
        self.joint_names.len()
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Puts what happened afterwards behind.
    pub(super) fn append(&mut self, mut later: Self) {
        self.time.append(&mut later.time);
        for (array, more) in [
            (&mut self.q, &mut later.q),
            (&mut self.dq, &mut later.dq),
            (&mut self.ddq, &mut later.ddq),
            (&mut self.tau, &mut later.tau),
            (&mut self.friction, &mut later.friction),
            (&mut self.q_measured, &mut later.q_measured),
            (&mut self.dq_measured, &mut later.dq_measured),
            (&mut self.tau_measured, &mut later.tau_measured),
            (&mut self.q_wanted, &mut later.q_wanted),
            (&mut self.dq_wanted, &mut later.dq_wanted),
            (&mut self.ddq_wanted, &mut later.ddq_wanted),
        ] {
            array.append(more);
        }
    }

    /// What a logger would have written: measured position, velocity and torque.
    pub fn recording(&self, source: &str) -> Recording {
        Recording::new(
            source,
            self.joint_names.clone(),
            self.time.clone(),
            self.q_measured.clone(),
            Some(self.dq_measured.clone()),
            Some(self.tau_measured.clone()),
            vec![],
        )
        .expect("arrays of the same samples")
    }

    /// Root mean square of wanted minus true position, `[n]`, rad (m).
    pub fn tracking_rmse(&self) -> Vec<f64> {
        let n = self.dof();
        let mut sums = vec![0.0; n];
        for (wanted, q) in self.q_wanted.chunks_exact(n).zip(self.q.chunks_exact(n)) {
            for ((sum, wanted), q) in sums.iter_mut().zip(wanted).zip(q) {
                *sum += (wanted - q) * (wanted - q);
            }
        }
        sums.iter().map(|sum| (sum / self.len() as f64).sqrt()).collect()
    }
}

/// Lets `controller` move the arm along `reference` for `duration` seconds, from where the
/// simulator stands.
///
/// A simulator at time zero is first put where the reference starts. One that has been running goes
/// on from its time and state, so that an experiment may be cut where something is picked up; the
/// reference is asked for the simulator's time.
///
/// # Errors
/// If a time is not a whole number of steps, a list has another length than the joints, the
/// controller gives a number that is not finite, a joint runs away, or the work is stopped.
///
/// # Examples
/// ```
/// use sgpr_core::{robot::two_link, simulation::*};
/// let robot = two_link();
/// let mut arm = Simulator::new(&robot, &two_link_drives(), Integrator::default(), 2.5e-4)?;
/// let mut controller = FeedForward::new(RigidBody::new(&robot), Gains::uniform(2, 75.0, 5.0));
/// let reference = StandStill(vec![0.3, -0.2]);
/// let record = simulate(&mut arm, &mut controller, &reference, 0.5, &Experiment::default(), &())?;
/// assert!(record.len() == 500 && record.tracking_rmse()[0] < 1e-6);
/// # Ok::<(), SimulationError>(())
/// ```
pub fn simulate(
    simulator: &mut Simulator,
    controller: &mut dyn Controller,
    reference: &dyn Reference,
    duration: f64,
    experiment: &Experiment,
    progress: &dyn Progress,
) -> Result<SimulationRecord, SimulationError> {
    let mut run = RunBuffers::new(simulator, reference, duration, experiment)?;
    run.all(simulator, controller, reference, experiment, progress)?;
    Ok(run.record)
}

/// Refuses a record, and commands on their way, that do not fit before memory is taken.
fn require_memory(samples: usize, commands: usize, joints: usize) -> Result<(), SimulationError> {
    let (samples, commands, joints) = (samples as u64, commands as u64, joints as u64);
    let per_sample = 1 + SimulationRecord::ARRAYS * joints;
    let numbers =
        samples.saturating_mul(per_sample).saturating_add(commands.saturating_mul(joints));
    let needed = numbers.saturating_mul(8);
    let limit = crate::memory::usable();
    if needed <= limit {
        return Ok(());
    }
    let (needed_gb, limit_gb) = (needed as f64 / 1e9, limit as f64 / 1e9);
    Err(SimulationError::TooLong { samples: samples as usize, needed_gb, limit_gb })
}

/// Buffers of a run.
struct RunBuffers {
    steps: usize,
    control_steps: usize,
    record_steps: usize,
    noise: NormalNumbers,
    record: SimulationRecord,
    wanted: [Vec<f64>; 3],
    q: Vec<f64>,
    q_before: Vec<f64>,
    dq: Vec<f64>,
    tau: Vec<f64>,
    tau_measured: Vec<f64>,
    /// Commands under way, the one that acts first: a ring of `[commands, n]`.
    commands: Vec<f64>,
    /// Control periods between measurement and action, and the steps beyond that.
    whole_delay: usize,
    rest_delay: usize,
}

impl RunBuffers {
    fn new(
        simulator: &mut Simulator,
        reference: &dyn Reference,
        duration: f64,
        experiment: &Experiment,
    ) -> Result<Self, SimulationError> {
        let n = simulator.robot().dof();
        let step = simulator.step_length();
        let whole = |option, time: f64, unit: f64, least: usize, expected| {
            let count = (time / unit).round();
            let fits = count >= least as f64
                && count < 1e12
                && (time / unit - count).abs() < 1e-6 * count.max(1.0);
            if fits {
                Ok(count as usize)
            } else {
                Err(SimulationError::InvalidOption { option, value: time, expected })
            }
        };
        let control_steps = whole(
            "control_period",
            experiment.control_period,
            step,
            1,
            "a whole number of steps, at least one",
        )?;
        let delay =
            whole("delay", experiment.delay, step, 0, "a whole number of steps, zero or more")?;
        let expected = "a whole number of control periods, at least one";
        let records = whole(
            "record_period",
            experiment.record_period,
            experiment.control_period,
            1,
            expected,
        )?;
        let steps = whole("duration", duration, step, 1, "a whole number of steps, at least one")?;
        let limits = ("torque limits", experiment.torque_limits.as_deref().unwrap_or_default());
        for (what, list) in experiment.sensors.lists().into_iter().chain([limits]) {
            if !list.is_empty() && list.len() != n {
                return Err(SimulationError::Length { what, expected: n, found: list.len() });
            }
            if let Some(&value) = list.iter().find(|value| value.is_nan() || **value < 0.0) {
                return Err(SimulationError::InvalidOption {
                    option: what,
                    value,
                    expected: "a number not below zero",
                });
            }
        }
        if reference.dof() != n {
            return Err(SimulationError::Length {
                what: "reference",
                expected: n,
                found: reference.dof(),
            });
        }
        let (samples, commands) =
            (steps.div_ceil(control_steps * records), delay / control_steps + 2);
        require_memory(samples, commands, n)?;
        let zeros = vec![0.0; n];
        let mut wanted = [zeros.clone(), zeros.clone(), zeros.clone()];
        if simulator.time() == 0.0 {
            let [q, dq, ddq] = &mut wanted;
            reference.sample(0.0, q, dq, ddq);
            simulator.set_state(q, dq)?;
        }
        let record_steps = control_steps * records;
        let names = simulator.robot().joint_names().map(String::from).collect();
        let (whole_delay, rest_delay) = (delay / control_steps, delay % control_steps);
        Ok(Self {
            steps,
            control_steps,
            record_steps,
            noise: NormalNumbers::new(experiment.seed),
            record: SimulationRecord::with_capacity(names, steps.div_ceil(record_steps)),
            wanted,
            q: zeros.clone(),
            q_before: zeros.clone(),
            dq: zeros.clone(),
            tau: zeros.clone(),
            tau_measured: zeros,
            commands: vec![0.0; (whole_delay + 2) * n],
            whole_delay,
            rest_delay,
        })
    }

    fn all(
        &mut self,
        simulator: &mut Simulator,
        controller: &mut dyn Controller,
        reference: &dyn Reference,
        experiment: &Experiment,
        progress: &dyn Progress,
    ) -> Result<(), SimulationError> {
        let n = self.q.len();
        let slots = self.whole_delay + 2;
        for step in 0..self.steps {
            let (sample, phase) = (step / self.control_steps, step % self.control_steps);
            if phase == 0 {
                if sample % 1024 == 0 {
                    progress.step("simulate", step, self.steps)?;
                }
                self.measure(simulator, reference, experiment, sample == 0);
                let slot = sample % slots * n;
                let measured = Measurement { time: simulator.time(), q: &self.q, dq: &self.dq };
                let [q, dq, ddq] = &self.wanted;
                let command = &mut self.commands[slot..slot + n];
                controller.torque(&measured, &Setpoint { q, dq, ddq }, command);
                if let Some(joint) = command.iter().position(|value| !value.is_finite()) {
                    return Err(simulator.not_finite("controller", joint, command[joint]));
                }
                for (command, limit) in
                    command.iter_mut().zip(experiment.torque_limits.iter().flatten())
                {
                    *command = command.clamp(-limit, *limit);
                }
            }
            if phase == self.rest_delay || step == 0 {
                let acting = sample.saturating_sub(self.whole_delay) % slots * n;
                let command = &self.commands[acting..acting + n];
                add_noise(
                    &mut self.noise,
                    &experiment.sensors.actuation_noise,
                    command,
                    &mut self.tau,
                );
            }
            let recorded = step % self.record_steps == 0;
            if recorded {
                self.record_before(simulator, experiment);
            }
            simulator.step(&self.tau)?;
            if recorded {
                self.record.ddq.extend_from_slice(simulator.ddq());
                self.record.friction.extend_from_slice(simulator.friction());
            }
        }
        progress.step("simulate", self.steps, self.steps)?;
        Ok(())
    }

    fn measure(
        &mut self,
        simulator: &Simulator,
        reference: &dyn Reference,
        experiment: &Experiment,
        first: bool,
    ) {
        let sensors = &experiment.sensors;
        std::mem::swap(&mut self.q, &mut self.q_before);
        sensors.measure_position(&mut self.noise, simulator.q(), &mut self.q);
        match sensors.velocity {
            VelocitySensor::Difference if !first => {
                for (dq, (q, before)) in self.dq.iter_mut().zip(self.q.iter().zip(&self.q_before)) {
                    *dq = (q - before) / experiment.control_period;
                }
            }
            VelocitySensor::Exact | VelocitySensor::Difference => {
                self.dq.copy_from_slice(simulator.dq())
            }
        }
        let [q, dq, ddq] = &mut self.wanted;
        reference.sample(simulator.time(), q, dq, ddq);
    }

    /// What is known before the step.
    fn record_before(&mut self, simulator: &Simulator, experiment: &Experiment) {
        add_noise(
            &mut self.noise,
            &experiment.sensors.torque_noise,
            &self.tau,
            &mut self.tau_measured,
        );
        let record = &mut self.record;
        record.time.push((simulator.time() * 1e9).round() as i64);
        let arrays = [
            (&mut record.q, simulator.q()),
            (&mut record.dq, simulator.dq()),
            (&mut record.tau, &self.tau),
            (&mut record.q_measured, &self.q),
            (&mut record.dq_measured, &self.dq),
            (&mut record.tau_measured, &self.tau_measured),
            (&mut record.q_wanted, &self.wanted[0]),
            (&mut record.dq_wanted, &self.wanted[1]),
            (&mut record.ddq_wanted, &self.wanted[2]),
        ];
        for (array, row) in arrays {
            array.extend_from_slice(row);
        }
    }
}
