//! Parameters that sessions have in common, and those that each has for itself.

use std::collections::BTreeSet;

use faer::Mat;

use super::super::super::torque_model::{Fit, nominal_parameters};
use super::super::super::{IdentifyError, TorqueModel};
use super::super::deviation::predicted;
use super::super::sum::correlation;
use super::super::{Record, RecordError};
use super::SessionCause;
use super::shapes::Shapes;
use crate::effects::Role;
use crate::identification::{
    BaseParameters, Dispersion, Estimate, JointFactor, LeastSquares, Method, ParameterSet,
    PriorWidth, role_of, stacked,
};
use crate::linalg::triangle;
use crate::robot::Robot;
use crate::spatial::PARAMETERS_PER_LINK;

/// Parameters of a tool that sessions tell: mass and first moments.
const OF_TOOL: usize = 4;

/// What is taken to differ between sessions.
pub(super) type Own = BTreeSet<SessionCause>;

/// Factors on the torque of each joint, by session.
pub(super) type SessionGains = Vec<Vec<f64>>;

pub(super) struct Arm<'a> {
    pub robot: &'a Robot,
    pub set: &'a ParameterSet,
    pub base: &'a BaseParameters,
    start: Vec<f64>,
    /// Per session.
    pub records: &'a [Vec<Record>],
    /// Per session: all rows.
    factors: Vec<Vec<JointFactor>>,
    /// Per joint: base parameters of its friction, of shapes that are friction, and of its offset.
    pub friction: Vec<Vec<usize>>,
    pub shapes: Vec<Vec<usize>>,
    pub offset: Vec<Vec<usize>>,
    /// Base parameters that a unit of each of the tool's parameters makes.
    pub tool: Vec<Vec<f64>>,
}

/// Values of a fit.
pub(super) struct SessionFit {
    /// Base parameters of each session, its tool included.
    pub values: Vec<Vec<f64>>,
    /// Tool of each session beyond that of the first.
    pub tool: Vec<Vec<f64>>,
    pub gains: SessionGains,
    /// Noise of each joint in motion, zero where it never moves.
    pub noise: Vec<f64>,
    estimate: Estimate,
    /// By session, their columns unknowns.
    factors: Vec<(usize, JointFactor)>,
}

impl<'a> Arm<'a> {
    pub fn new(
        robot: &'a Robot,
        set: &'a ParameterSet,
        base: &'a BaseParameters,
        records: &'a [Vec<Record>],
    ) -> Self {
        let factors = |records: &Vec<Record>| {
            stacked(
                records.iter().flat_map(|record| &record.blocks).flat_map(|block| &block.factors),
            )
        };
        let of_role = |joint: usize, wanted: fn(Option<Role>) -> bool| {
            let own = set.effect_parameters_of(joint).into_iter();
            own.filter(|parameter| wanted(role_of(set, *parameter))).collect::<Vec<usize>>()
        };
        let in_base = |own: Vec<usize>| {
            (0..base.rank()).filter(|k| own.contains(&base.independent()[*k])).collect()
        };
        let is_friction = |role| !matches!(role, Some(Role::Offset | Role::RotorInertia));
        let friction = |joint: usize| in_base(of_role(joint, is_friction));
        let shapes = |joint: usize| {
            let all = set.of_state()..set.len();
            in_base(
                all.filter(|parameter| Shapes::is_friction(parameter - set.of_state(), joint))
                    .collect(),
            )
        };
        let offset = |joint: usize| in_base(of_role(joint, |role| role == Some(Role::Offset)));
        let first = set.inertial() - PARAMETERS_PER_LINK;
        let direction = |parameter: usize| {
            let unit: Vec<f64> =
                (0..set.len()).map(|k| f64::from(u8::from(k == parameter))).collect();
            base.combine(&unit)
        };
        Self {
            robot,
            set,
            base,
            start: nominal_parameters(robot, set),
            factors: records.iter().map(factors).collect(),
            records,
            friction: (0..robot.dof()).map(friction).collect(),
            shapes: (0..robot.dof()).map(shapes).collect(),
            offset: (0..robot.dof()).map(offset).collect(),
            tool: (first..first + OF_TOOL).map(direction).collect(),
        }
    }

    /// All that may differ.
    pub fn causes(&self) -> Vec<SessionCause> {
        let of_joint = |joint| {
            [
                SessionCause::Friction { joint },
                SessionCause::Offset { joint },
                SessionCause::Gain { joint },
            ]
        };
        std::iter::once(SessionCause::Tool)
            .chain((0..self.robot.dof()).flat_map(of_joint))
            .collect()
    }

    /// Gains of an arm that did not change.
    pub fn no_gains(&self) -> SessionGains {
        vec![vec![1.0; self.robot.dof()]; self.records.len()]
    }

    /// Index of a base parameter of a session among the unknowns.
    fn unknown(&self, own: &[usize], session: usize, column: usize) -> usize {
        match own.iter().position(|k| *k == column) {
            Some(place) if session > 0 => self.base.rank() + (session - 1) * own.len() + place,
            _ => column,
        }
    }

    /// Base parameters of which each session has its own.
    fn own_columns(&self, own: &Own) -> Vec<usize> {
        let of = |cause: &SessionCause| match cause {
            SessionCause::Friction { joint } => self.friction[*joint].clone(),
            SessionCause::Offset { joint } => self.offset[*joint].clone(),
            _ => vec![],
        };
        own.iter().flat_map(of).collect()
    }

    /// All parameters, of which some are those of a session each.
    pub fn fit(&self, own: &Own, gains: SessionGains) -> Result<SessionFit, RecordError> {
        let (rank, sessions) = (self.base.rank(), self.records.len());
        let columns = self.own_columns(own);
        let with_tool = own.contains(&SessionCause::Tool);
        let first_of_tool = rank + (sessions - 1) * columns.len();
        let count = first_of_tool + if with_tool { (sessions - 1) * OF_TOOL } else { 0 };
        let mut factors = Vec::new();
        for (session, all) in self.factors.iter().enumerate() {
            for factor in all {
                let mut unknowns: Vec<usize> =
                    factor.columns.iter().map(|k| self.unknown(&columns, session, *k)).collect();
                let mut added = vec![];
                if with_tool && session > 0 {
                    unknowns
                        .extend((0..OF_TOOL).map(|k| first_of_tool + (session - 1) * OF_TOOL + k));
                    added =
                        self.tool.iter().map(|direction| predicted(factor, direction)).collect();
                }
                let (width, joint) = (factor.columns.len(), factor.joint);
                let gain = gains[session][joint];
                let wide = Mat::from_fn(factor.factor.nrows(), width + added.len() + 1, |i, j| {
                    match j.checked_sub(width) {
                        None => factor.factor[(i, j)],
                        Some(k) if k < added.len() => added[k][i],
                        Some(_) => factor.factor[(i, width)] / gain,
                    }
                });
                factors.push((
                    session,
                    JointFactor {
                        columns: unknowns,
                        factor: triangle(wide.as_ref()).into(),
                        ..factor.clone()
                    },
                ));
            }
        }
        let nominal_base = self.base.combine(&self.start);
        let mut nominal = vec![0.0; count];
        nominal[..rank].copy_from_slice(&nominal_base);
        for session in 1..sessions {
            columns
                .iter()
                .for_each(|k| nominal[self.unknown(&columns, session, *k)] = nominal_base[*k]);
        }
        let plain: Vec<JointFactor> = factors.iter().map(|(_, factor)| factor.clone()).collect();
        let solver = LeastSquares::new(Method::Wls);
        let estimate = solver.solve_unknowns(&plain, &nominal).map_err(IdentifyError::from)?;
        let (values, tool) = self.values(&columns, with_tool, &estimate.values);
        let mut squares = vec![(0.0, 0usize); self.robot.dof()];
        for (session, factor) in self.moving() {
            let (sum, rows) = &mut squares[factor.joint];
            *sum += residual(factor, &values[session], gains[session][factor.joint])
                .iter()
                .map(|r| r * r)
                .sum::<f64>();
            *rows += factor.rows;
        }
        let noise =
            squares.into_iter().map(|(sum, rows)| (sum / rows.max(1) as f64).sqrt()).collect();
        Ok(SessionFit { values, tool, gains, noise, estimate, factors })
    }

    /// The same, and per factor the rows that carry as much as one independent row: the estimates
    /// stay, their spread grows.
    pub fn fit_with_memory(
        &self,
        own: &Own,
        gains: SessionGains,
    ) -> Result<(SessionFit, Vec<f64>), RecordError> {
        let mut state = self.fit(own, gains)?;
        let of_session = |session: usize| {
            let records: Vec<&Record> = self.records[session].iter().collect();
            correlation(&records, &self.factors[session], &state.values[session])
        };
        let correlation: Vec<f64> = (0..self.records.len()).flat_map(of_session).collect();
        let factors: Vec<JointFactor> =
            state.factors.iter().map(|(_, factor)| factor.clone()).collect();
        let solver = LeastSquares { method: Method::Wls, correlation: Some(correlation.clone()) };
        let nominal = state.estimate.values.clone();
        state.estimate = solver.solve_unknowns(&factors, &nominal).map_err(IdentifyError::from)?;
        Ok((state, correlation))
    }

    /// Rows in motion of all sessions.
    pub fn moving(&self) -> impl Iterator<Item = (usize, &JointFactor)> {
        let sessions = self.factors.iter().enumerate();
        let rows =
            sessions.flat_map(|(session, all)| all.iter().map(move |factor| (session, factor)));
        rows.filter(|(_, factor)| !factor.resting)
    }

    /// Base parameters of each session, and what its tool has beyond that of the first, from the
    /// unknowns.
    fn values(
        &self,
        columns: &[usize],
        with_tool: bool,
        unknowns: &[f64],
    ) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
        let (rank, sessions) = (self.base.rank(), self.records.len());
        let first_of_tool = rank + (sessions - 1) * columns.len();
        let tool = |session: usize| match (with_tool, session) {
            (true, 1..) => unknowns[first_of_tool + (session - 1) * OF_TOOL..][..OF_TOOL].to_vec(),
            _ => vec![0.0; OF_TOOL],
        };
        let tools: Vec<Vec<f64>> = (0..sessions).map(tool).collect();
        let value = |session: usize| {
            let mut values: Vec<f64> =
                (0..rank).map(|k| unknowns[self.unknown(columns, session, k)]).collect();
            for (direction, amount) in self.tool.iter().zip(&tools[session]) {
                values
                    .iter_mut()
                    .zip(direction)
                    .for_each(|(value, share)| *value += amount * share);
            }
            values
        };
        ((0..sessions).map(value).collect(), tools)
    }

    pub fn model(
        &self,
        (session, name): (usize, &str),
        own: &Own,
        state: &SessionFit,
        correlation: &[f64],
    ) -> TorqueModel {
        let (rank, columns) = (self.base.rank(), self.own_columns(own));
        let unknowns = state.estimate.values.len();
        let first_of_tool = rank + (self.records.len() - 1) * columns.len();
        let mut select = Mat::<f64>::zeros(rank, unknowns);
        for k in 0..rank {
            select[(k, self.unknown(&columns, session, k))] = 1.0;
            if own.contains(&SessionCause::Tool) && session > 0 {
                for (at, direction) in self.tool.iter().enumerate() {
                    select[(k, first_of_tool + (session - 1) * OF_TOOL + at)] = direction[k];
                }
            }
        }
        // Unknowns that no row determines have no covariance to be carried on.
        let finite = Mat::from_fn(unknowns, unknowns, |i, j| {
            Some(state.estimate.covariance[(i, j)]).filter(|v| v.is_finite()).unwrap_or(0.0)
        });
        let mut covariance = &select * finite * select.transpose();
        for k in 0..rank {
            let at = self.unknown(&columns, session, k);
            if state.estimate.covariance[(at, at)].is_infinite() {
                covariance[(k, k)] = f64::INFINITY;
            }
        }
        let of_session: Vec<usize> =
            (0..state.factors.len()).filter(|k| state.factors[*k].0 == session).collect();
        let estimate = Estimate {
            values: state.values[session].clone(),
            covariance: covariance.into(),
            noise: of_session.iter().map(|k| state.estimate.noise[*k]).collect(),
            ..state.estimate.clone()
        };
        let correlation: Vec<f64> = of_session.iter().map(|k| correlation[*k]).collect();
        let parameters = self.base.expand(&estimate.values, &self.start);
        let history = format!(
            "session {name}: its own {}, everything else common to {} sessions",
            self.told(own),
            self.records.len()
        );
        let mut model = TorqueModel::from_parameters(
            self.robot.clone(),
            self.set.clone(),
            parameters,
            vec![history],
        );
        model.fit = Some(fit(
            &estimate,
            self.base,
            &self.factors[session],
            &correlation,
            (self.robot.dof(), &Method::Wls),
        ));
        model.processing = Some(self.records[session][0].processing.clone());
        model.provenance.logs =
            self.records[session].iter().map(|record| record.source.clone()).collect();
        model
    }

    fn told(&self, own: &Own) -> String {
        let one = |cause: &SessionCause| match cause {
            SessionCause::Tool => Some("tool".to_string()),
            SessionCause::Friction { joint } => {
                Some(format!("friction of {}", self.robot.joints()[*joint].name))
            }
            SessionCause::Offset { joint } => {
                Some(format!("offset of {}", self.robot.joints()[*joint].name))
            }
            SessionCause::Gain { .. } => None,
        };
        let all: Vec<String> = own.iter().filter_map(one).collect();
        if all.is_empty() { "nothing".into() } else { all.join(", ") }
    }
}

/// What base parameters leave of the torque, which is first divided by its gain.
pub(super) fn residual(factor: &JointFactor, base: &[f64], gain: f64) -> Vec<f64> {
    let torque = factor.factor.col(factor.columns.len());
    torque
        .iter()
        .zip(predicted(factor, base))
        .map(|(torque, model)| torque / gain - model)
        .collect()
}

/// The fit of an estimate that stands for a model.
fn fit(
    estimate: &Estimate,
    base: &BaseParameters,
    factors: &[JointFactor],
    correlation: &[f64],
    (joints, method): (usize, &Method),
) -> Fit {
    let deviations = estimate.standard_deviations();
    let infinite =
        base.names().iter().zip(&deviations).filter(|(_, deviation)| deviation.is_infinite());
    let per_joint = |figures: &[f64]| -> Vec<f64> {
        let of = |joint| {
            factors
                .iter()
                .position(|factor| factor.joint == joint)
                .map_or(0.0, |index| figures[index])
        };
        (0..joints).map(of).collect()
    };
    let rows = |joint| {
        factors.iter().filter(|factor| factor.joint == joint).map(|factor| factor.rows).sum()
    };
    let rank = base.rank();
    Fit {
        method: method.name().into(),
        values: estimate.values.clone(),
        covariance: (0..rank * rank).map(|k| estimate.covariance[(k / rank, k % rank)]).collect(),
        covariance_with_terms: vec![],
        noise: per_joint(&estimate.noise),
        rows: (0..joints).map(rows).collect(),
        correlation: per_joint(correlation),
        dispersion: Dispersion::NONE.deviation,
        half_interval_95: Dispersion::NONE.half_interval_95,
        prior: Some(PriorWidth::default()),
        prior_standard_deviation: None,
        condition: estimate.excitation.condition,
        scaled_condition: estimate.excitation.scaled_condition,
        undetermined: infinite.map(|(name, _)| name.clone()).collect(),
        standard_deviations: deviations,
        consistency: None,
    }
}
