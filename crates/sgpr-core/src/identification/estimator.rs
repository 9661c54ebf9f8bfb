//! Estimators, of which each is a file of its own, and how one is chosen.

use std::fmt;
use std::str::FromStr;

use super::{ESTIMATORS, Equations, Estimate, IdentificationError, JointFactor};

/// How the base parameters are estimated.
///
/// On data without noise all agree; they differ in what they make of noise.
/// [`estimate`](super::estimate()) runs any of them. As text, `wls`, `irls` or `irls:1.345`: see
/// [`Method::choices`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// All rows in motion alike (thesis eq. 4-10).
    Ols,
    /// Each joint by the inverse of its noise variance, found from its residual and iterated
    /// (thesis eqs. 4-5, 4-6).
    ///
    /// The rows of a joint at rest are a group of their own: what dry friction may hold shows in
    /// their residual.
    Wls,
    /// Each joint by the inverse of a noise variance known beforehand, for instance from repeated
    /// periods (thesis eq. 4-8): standard deviations `[n]`, N·m (N).
    WlsKnown(Vec<f64>),
    /// One of [`ESTIMATORS`], which begins where `Wls` ends, made by [`Estimator::method`] or
    /// [`Estimator::with`].
    By(&'static Estimator, f64),
}

impl Method {
    /// Whether it is least squares and nothing beyond.
    pub(crate) fn is_least_squares(&self) -> bool {
        !matches!(self, Self::By(..))
    }

    fn estimator(&self) -> Option<&'static Estimator> {
        match self {
            Self::By(estimator, _) => Some(estimator),
            _ => None,
        }
    }

    /// Whether joints are weighted by what their residual turns out to be.
    pub(crate) fn reweights(&self) -> bool {
        self.estimator().map_or(*self == Self::Wls, |estimator| estimator.reweights)
    }

    /// Whether it draws parameters to a prior of its own.
    pub(crate) fn has_prior(&self) -> bool {
        self.estimator().is_some_and(|estimator| estimator.has_prior)
    }

    /// Whether its covariance counts already what residuals remember.
    pub(crate) fn counts_memory(&self) -> bool {
        self.estimator().is_some_and(|estimator| estimator.counts_memory)
    }

    /// What it asks for beside triangular factors.
    pub fn needs(&self) -> EstimatorNeeds {
        self.estimator().map_or(EstimatorNeeds::Factors, |estimator| estimator.needs)
    }

    /// Name in files.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Ols => "ols",
            Self::Wls => "wls",
            Self::WlsKnown(_) => "wls_known_noise",
            Self::By(estimator, _) => estimator.name,
        }
    }

    /// Name for a sentence.
    pub fn title(&self) -> &'static str {
        match self {
            Self::Ols => "ordinary least squares",
            Self::Wls => "weighted least squares",
            Self::WlsKnown(_) => "least squares weighted by known noise",
            Self::By(estimator, _) => estimator.title,
        }
    }

    /// What a user may ask for: `ols`, `wls`, and the names of [`ESTIMATORS`], those with a setting
    /// also as `NAME:SETTING`.
    pub fn choices() -> Vec<String> {
        let of = |estimator: &&Estimator| {
            let with =
                estimator.setting.map(|setting| format!("{}:{}", estimator.name, setting.name));
            [Some(estimator.name.to_string()), with].into_iter().flatten()
        };
        ["ols", "wls"].map(String::from).into_iter().chain(ESTIMATORS.iter().flat_map(of)).collect()
    }
}

impl FromStr for Method {
    type Err = IdentificationError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let unknown = || IdentificationError::UnknownMethod { text: text.into() };
        let (name, number) =
            text.split_once(':').map_or((text, None), |(name, number)| (name, Some(number)));
        let estimator = ESTIMATORS.iter().find(|estimator| estimator.name == name);
        match (name, estimator, number) {
            ("ols", _, None) => Ok(Self::Ols),
            ("wls", _, None) => Ok(Self::Wls),
            (_, Some(estimator), None) => Ok(estimator.method()),
            (_, Some(estimator), Some(number)) if estimator.setting.is_some() => {
                number.parse().map(|setting| estimator.with(setting)).map_err(|_| unknown())
            }
            _ => Err(unknown()),
        }
    }
}

/// An estimator that begins where weighted least squares ends.
#[derive(Clone, Copy)]
#[non_exhaustive]
pub struct Estimator {
    /// Name in files and options.
    pub name: &'static str,
    /// Name for a sentence.
    pub title: &'static str,
    /// The number that may be given to it.
    pub setting: Option<EstimatorSetting>,
    /// What it asks for beside triangular factors.
    pub needs: EstimatorNeeds,
    pub(super) reweights: bool,
    pub(super) has_prior: bool,
    pub(super) counts_memory: bool,
    pub(super) run: EstimatorRun,
}

/// From an estimate by least squares to that of the estimator.
type EstimatorRun = fn(EstimatorTask<'_, '_>, Estimate) -> Result<Estimate, IdentificationError>;

/// The number that an estimator takes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct EstimatorSetting {
    /// What it is, in capital letters.
    pub name: &'static str,
    /// Its value unless told otherwise.
    pub usual: f64,
}

/// What an estimator asks for, each more than the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum EstimatorNeeds {
    /// Triangular factors: it works on sums of logs.
    Factors,
    /// Single rows.
    Rows,
    /// The motion without noise: [`Trajectory::instruments`](super::Trajectory::instruments), or a
    /// controller.
    Instruments,
    /// The controller of the arm: [`Trajectory::closed_loop`](super::Trajectory::closed_loop).
    Controller,
}

impl EstimatorNeeds {
    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Factors => "factors",
            Self::Rows => "rows",
            Self::Instruments => "instruments",
            Self::Controller => "controller",
        }
    }
}

/// What an estimator works on.
pub(super) struct EstimatorTask<'t, 'a> {
    /// Zero for an estimator without.
    pub setting: f64,
    pub equations: &'t mut Equations<'a>,
    /// Those of the equations.
    pub factors: &'t [JointFactor],
    /// Base parameters of the robot file, `[rank]`.
    pub nominal: &'t [f64],
    /// Per factor, rows that carry as much as one independent row.
    pub correlation: Option<&'t [f64]>,
}

impl Estimator {
    /// One that looks at single rows, has no setting, and whose weights are those of the start.
    pub(super) const fn new(name: &'static str, title: &'static str, run: EstimatorRun) -> Self {
        let (needs, setting) = (EstimatorNeeds::Rows, None);
        Self {
            name,
            title,
            setting,
            needs,
            reweights: false,
            has_prior: false,
            counts_memory: false,
            run,
        }
    }

    /// With its usual setting.
    pub fn method(&'static self) -> Method {
        self.with(self.setting.map_or(0.0, |setting| setting.usual))
    }

    /// With this setting; one without takes none.
    pub fn with(&'static self, setting: f64) -> Method {
        Method::By(self, setting)
    }
}

impl EstimatorSetting {
    pub(super) const fn new(name: &'static str, usual: f64) -> Option<Self> {
        Some(Self { name, usual })
    }
}

impl fmt::Debug for Estimator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

impl PartialEq for Estimator {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}
