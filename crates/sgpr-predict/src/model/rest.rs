use alloc::string::String;
use alloc::vec::Vec;

use super::StreamedModel;
use crate::gp::LearnedProcess;

/// More points than this are a matter of a machine with the memory for the square of them.
const MOST_FOR_DEVIATION: usize = 5_000;

/// What a semi-parametric model has learned of what its physics leaves over.
#[derive(Clone, Debug)]
pub(crate) struct LearnedRest {
    pub joints: Vec<LearnedJoint>,
    /// The physics as it was identified, for the joints without a process, if there are some and it differs.
    pub identified: Option<StreamedModel>,
    /// None if nobody knows how sure the parameters are.
    pub basis: Option<LearnedBasis>,
    /// Whether the file says how sure the parameters are; those of early versions do not.
    pub knows_parameters: bool,
}

/// What was learned at a joint.
#[derive(Clone, Debug)]
pub(crate) struct LearnedJoint {
    pub process: Option<LearnedProcess>,
    pub noise_variance: f64,
    pub calibration: f64,
}

/// How sure the linear parameters are.
#[derive(Clone, Debug)]
pub(crate) struct LearnedBasis {
    pub independent: Vec<usize>,
    /// `[unknowns, unknowns]`, row-major.
    pub covariance: Vec<f64>,
    /// Rows of their regressor at the points of each joint's process, `[points, unknowns]`, if they were estimated together.
    pub rows: Vec<Option<Vec<f64>>>,
}

impl LearnedRest {
    /// Whether a standard deviation can be computed; if not, for which joint, and why.
    pub fn check_deviation(&self) -> Result<(), (usize, String)> {
        if !self.knows_parameters {
            let old = "its file was written by a version that did not keep how sure the parameters are: load it and save it again \
                       in Python (`sgpr.SemiParametricModel.load`, `save`), or ask for no deviation";
            return Err((0, old.into()));
        }
        for (joint, learned) in self.joints.iter().enumerate() {
            let points = learned.process.as_ref().map_or(0, LearnedProcess::len);
            if points > MOST_FOR_DEVIATION {
                return Err((
                    joint,
                    format!(
                        "the deviation of {points} points takes too much memory, at most {MOST_FOR_DEVIATION} are taken: ask for none"
                    ),
                ));
            }
        }
        Ok(())
    }
}
