use super::super::{Predictor, StreamError, StreamOptions};
use super::basis::BasisPredictor;
use super::process::Process;
use super::rest::Rest;
use super::{SemiParametricError, SemiParametricModel};
use crate::gp::{GpPredictor, PredictorOptions, SharedPredictor, WeightedKernel};

/// Torque of one sample after the other, for a controller: physics and processes. Owns its buffers, allocates nothing,
/// takes no lock, can move to another thread, and its work does not depend on the sample. Effects of the physics with a
/// memory carry it from call to call, as in [`Predictor`].
///
/// Joints whose processes have the same points are computed together; so is a kernel that they share.
///
/// Source: thesis eqs. 4-17 and 4-21, the feed-forward torque.
#[derive(Debug)]
pub struct SemiParametricPredictor {
    physics: Predictor,
    /// For the joints without a process, where it differs.
    identified: Option<Predictor>,
    joints: Vec<Joint>,
    /// Joints of the same points, and their means.
    together: Vec<(Vec<usize>, SharedPredictor)>,
    parameters: Option<BasisPredictor>,
    x: Vec<f64>,
    tau: Vec<f64>,
    deviation: Vec<f64>,
    of_parameters: Vec<f64>,
    novelty: Vec<f64>,
    /// Made with variance.
    with_variance: bool,
}

#[derive(Debug)]
struct Joint {
    /// None without a process, or if it is only asked together with others.
    process: Option<GpPredictor>,
    /// It has a process.
    learned: bool,
    /// Its mean comes from the processes that are asked together.
    together: bool,
    noise_variance: f64,
    /// Variance of its process before the logs.
    prior: f64,
    calibration: f64,
}

impl SemiParametricPredictor {
    /// All of a model, without a rate.
    ///
    /// # Errors
    /// If the variance needs more memory than allowed, or the physics needs a rate: see [`Self::streaming`].
    pub fn new(model: &SemiParametricModel, options: PredictorOptions) -> Result<Self, SemiParametricError> {
        Self::streaming(model, options, &StreamOptions::default())
    }

    /// The only place that allocates. The processes hold what the physics leaves of the logs, whatever it is a property of.
    ///
    /// # Errors
    /// If the variance needs more memory than allowed; as [`super::super::TorqueModel::predictor`].
    pub fn streaming(
        model: &SemiParametricModel,
        options: PredictorOptions,
        stream: &StreamOptions,
    ) -> Result<Self, SemiParametricError> {
        let n = model.physics.robot().dof();
        let together = together(&model.joints, options);
        let with_variance = options.variance_rank != Some(0);
        let mut joints = Vec::with_capacity(n);
        for (index, rest) in model.joints.iter().enumerate() {
            let together = together.iter().any(|(members, _)| members.contains(&index));
            let wanted = rest.gp.as_ref().filter(|_| with_variance || !together);
            joints.push(Joint {
                process: wanted.map(|gp| gp.predictor(options)).transpose()?,
                learned: rest.gp.is_some(),
                together,
                noise_variance: rest.noise_variance,
                prior: rest.gp.as_ref().map_or(1.0, |gp| gp.covariance().signal.variance()),
                calibration: rest.report.calibration,
            });
        }
        let basis = model.basis.as_ref().filter(|_| with_variance);
        Ok(Self {
            physics: model.physics.predictor(stream)?,
            identified: model.identified.as_ref().map(|identified| identified.predictor(stream)).transpose()?,
            joints,
            together,
            parameters: basis.map(|basis| BasisPredictor::new(basis, &model.physics, &model.joints)),
            x: vec![0.0; 3 * n + 1],
            tau: vec![0.0; n],
            deviation: vec![0.0; n],
            of_parameters: vec![0.0; n],
            novelty: vec![1.0; n],
            with_variance,
        })
    }

    /// The physics, as it was at the last sample.
    pub fn physics(&self) -> &Predictor {
        &self.physics
    }

    /// As [`Predictor::reset`].
    pub fn reset(&mut self) {
        self.each(&mut |physics| {
            physics.reset();
            Ok(())
        })
        .expect("a reset cannot fail");
    }

    /// As [`Predictor::reset_at`].
    ///
    /// # Errors
    /// As [`Predictor::reset_at`].
    pub fn reset_at(&mut self, q: &[f64], dq: &[f64]) -> Result<(), StreamError> {
        self.each(&mut |physics| physics.reset_at(q, dq))
    }

    /// As [`Predictor::set_time`].
    ///
    /// # Errors
    /// As [`Predictor::set_time`].
    pub fn set_time(&mut self, time: f64) -> Result<(), StreamError> {
        self.each(&mut |physics| physics.set_time(time))
    }

    /// As [`Predictor::set_temperature`].
    ///
    /// # Errors
    /// As [`Predictor::set_temperature`].
    pub fn set_temperature(&mut self, celsius: &[f64]) -> Result<(), StreamError> {
        self.each(&mut |physics| physics.set_temperature(celsius))
    }

    fn each(&mut self, work: &mut dyn FnMut(&mut Predictor) -> Result<(), StreamError>) -> Result<(), StreamError> {
        work(&mut self.physics)?;
        self.identified.as_mut().map_or(Ok(()), work)
    }

    /// Torque that the motion needs.
    ///
    /// - `q`, `dq`, `ddq`: `[n]`, rad, rad/s, rad/s² (m for prismatic joints)
    /// - returns `[n]`, N·m (N); NaN as [`Predictor::torque`]
    ///
    /// # Panics
    /// If a slice is not of length n.
    pub fn torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) -> &[f64] {
        let n = self.tau.len();
        assert!([q, dq, ddq].iter().all(|values| values.len() == n), "one value per joint");
        if self.try_torque(q, dq, ddq).is_err() {
            self.tau.fill(f64::NAN);
        }
        &self.tau
    }

    /// As [`Self::torque`], with what is wrong with a sample as an error.
    ///
    /// # Errors
    /// As [`Predictor::try_torque`].
    pub fn try_torque(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) -> Result<&[f64], StreamError> {
        self.set(q, dq, ddq)?;
        for (joint, tau) in self.joints.iter_mut().zip(&mut self.tau).filter(|(joint, _)| !joint.together) {
            if let Some(process) = &mut joint.process {
                *tau += process.mean(&self.x)[0];
            }
        }
        for (members, predictor) in &mut self.together {
            for (joint, mean) in members.iter().zip(predictor.means(&self.x)) {
                self.tau[*joint] += mean;
            }
        }
        Ok(&self.tau)
    }

    /// Torque, and the standard deviation of its measurement, `[n]` each, N·m (N). Uncertain
    /// parameters bring their variance, beside a process as far as that does not know.
    ///
    /// # Panics
    /// If a slice is not of length n, or the predictor was made without variance.
    pub fn torque_and_deviation(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) -> (&[f64], &[f64]) {
        assert!(self.with_variance, "made with variance");
        let n = self.tau.len();
        assert!([q, dq, ddq].iter().all(|values| values.len() == n), "one value per joint");
        if self.set(q, dq, ddq).is_err() {
            self.tau.fill(f64::NAN);
            self.deviation.fill(f64::NAN);
            return (&self.tau, &self.deviation);
        }
        let spreads = self.deviation.iter_mut().zip(&mut self.novelty);
        for ((joint, tau), (variance, novelty)) in self.joints.iter_mut().zip(&mut self.tau).zip(spreads) {
            *variance = joint.noise_variance;
            if let Some(process) = &mut joint.process {
                let (mean, unexplained) = process.mean_and_variance(&self.x);
                *tau += mean[0];
                *variance += unexplained;
                *novelty = unexplained / joint.prior;
            }
        }
        if let Some(parameters) = &mut self.parameters {
            self.of_parameters.fill(0.0);
            parameters.add_variance(&self.physics, &self.x, &self.novelty, &mut self.of_parameters);
        }
        for ((joint, deviation), of_parameters) in self.joints.iter().zip(&mut self.deviation).zip(&self.of_parameters)
        {
            *deviation = (joint.calibration.powi(2) * *deviation + of_parameters).sqrt();
        }
        (&self.tau, &self.deviation)
    }

    fn set(&mut self, q: &[f64], dq: &[f64], ddq: &[f64]) -> Result<(), StreamError> {
        self.tau.copy_from_slice(self.physics.try_torque(q, dq, ddq)?);
        if let Some(identified) = &mut self.identified {
            let own = identified.try_torque(q, dq, ddq)?;
            let without = self.joints.iter().zip(&mut self.tau).zip(own).filter(|((joint, _), _)| !joint.learned);
            without.for_each(|((_, tau), own)| *tau = *own);
        }
        let n = self.tau.len();
        for (part, x) in [q, dq, ddq].into_iter().zip(self.x.chunks_exact_mut(n)) {
            x.copy_from_slice(part);
        }
        Ok(())
    }
}

/// Groups of two or more joints whose processes have the same points and can be asked together.
fn together(joints: &[Rest], options: PredictorOptions) -> Vec<(Vec<usize>, SharedPredictor)> {
    let mut groups: Vec<Vec<(usize, &Process)>> = vec![];
    for (index, gp) in joints.iter().enumerate().filter_map(|(index, rest)| Some((index, rest.gp.as_ref()?))) {
        match groups.iter_mut().find(|group| group[0].1.x() == gp.x()) {
            Some(group) => group.push((index, gp)),
            None => groups.push(vec![(index, gp)]),
        }
    }
    let several = groups.into_iter().filter(|group| group.len() > 1);
    let predictor = |group: Vec<(usize, &Process)>| {
        let (members, means): (Vec<usize>, Vec<WeightedKernel<'_>>) =
            group.into_iter().map(|(index, gp)| (index, gp.weighted_kernel())).unzip();
        Some((members, SharedPredictor::of_sums(&means, options.precision)?))
    };
    several.filter_map(predictor).collect()
}
