//! One kernel for all joints: what they leave over is learned together, over the points at which
//! all of them move.

use std::cell::OnceCell;

use super::joint_process::{
    Alone, FEWEST, FoundProcess, JointProcess, Learned, inducing_points, process,
};
use super::rows::{ResidualRows, Unseen, longest_memory};
use super::{Inputs, SemiParametricOptions};
use crate::gp::{Compute, Data, GaussianProcess, GpError, Kernel};
use crate::progress::Progress;

/// Selections that are the same for every joint.
pub(super) const SELECTIONS: [Inputs; 4] =
    [Inputs::Velocities, Inputs::Positions, Inputs::PositionsAndVelocities, Inputs::All];

/// The processes of all joints. The residuals, each in units of its own root mean square, are
/// outputs of one process: the search factors one matrix for all of them. Each joint then gets its
/// process, over the same points and with the same kernel in its own units, if that predicts parts
/// left out better than the physics alone.
pub(super) fn fit_shared(
    rows: &[ResidualRows],
    unseen: &[Unseen],
    options: &SemiParametricOptions,
    compute: &Compute,
    progress: &dyn Progress,
) -> Result<Vec<JointProcess>, GpError> {
    let n = rows.len();
    let width = 3 * n + 1;
    let mut alone: Vec<Alone> =
        rows.iter().zip(unseen).map(|(rows, unseen)| Alone::new(rows, unseen)).collect();
    let places = common(rows);
    let scales: Vec<f64> = alone.iter().map(|alone| alone.mean_square.sqrt()).collect();
    if places.len() < FEWEST || scales.contains(&0.0) {
        return Ok(alone
            .into_iter()
            .map(|alone| JointProcess::without(alone.report, alone.mean_square))
            .collect());
    }
    let first = |place: &Vec<usize>| place[0] * width..(place[0] + 1) * width;
    let x: Vec<f64> = places.iter().flat_map(|place| &rows[0].x[first(place)]).copied().collect();
    let in_units = |place: &Vec<usize>| -> Vec<f64> {
        (0..n).map(|joint| rows[joint].residual[place[joint]] / scales[joint]).collect()
    };
    let data = Data::new(x, width, places.iter().flat_map(in_units).collect(), n)?;

    let longest_memory = rows
        .iter()
        .zip(unseen)
        .map(|(rows, unseen)| longest_memory(rows, &unseen.parts))
        .fold(f64::INFINITY, f64::min);
    let mut best: Option<(f64, Vec<Learned>)> = None;
    let selections = options.inputs.map_or_else(|| SELECTIONS.to_vec(), |inputs| vec![inputs]);
    for inputs in selections {
        // A selection is tried for all joints at once.
        for _ in 0..n {
            if progress
                .step("residual", alone[0].report.candidates.len(), SELECTIONS.len())
                .is_err()
            {
                return chosen(alone, best, rows, unseen, options, compute);
            }
        }
        let found =
            process(inputs.columns(0, n), &data, None, longest_memory, options, compute, progress)?;
        let learned = of_joints(&found, inputs, &places, &scales, rows, unseen, compute)?;
        let mut sum = 0.0;
        for (alone, learned) in alone.iter_mut().zip(&learned) {
            sum += learned.nearby.gain.max(0.0);
            alone.report.candidates.push(learned.candidate.clone());
        }
        if best.as_ref().is_none_or(|(most, _)| sum > *most) {
            best = Some((sum, learned));
        }
    }
    if let Some((_, learned)) = &mut best {
        // The same for all joints: their kernels differ by a factor.
        let points = OnceCell::new();
        let inducing = |signal: &Kernel| -> Vec<f64> {
            points.get_or_init(|| inducing_points(signal, &data, options.points)).clone()
        };
        let mut of_all = Vec::with_capacity(n);
        for (joint, own) in std::mem::take(learned).into_iter().enumerate() {
            let (rows, unseen, report) = (&rows[joint], &unseen[joint], &mut alone[joint].report);
            of_all.push(own.or_of_all_rows(inducing, rows, unseen, options, report, compute)?);
        }
        *learned = of_all;
    }
    chosen(alone, best, rows, unseen, options, compute)
}

/// The process of every joint.
fn of_joints(
    found: &FoundProcess,
    inputs: Inputs,
    places: &[Vec<usize>],
    scales: &[f64],
    rows: &[ResidualRows],
    unseen: &[Unseen],
    compute: &Compute,
) -> Result<Vec<Learned>, GpError> {
    let of_joint = |joint: usize| {
        let points: Vec<usize> = found.points.iter().map(|&k| places[k][joint]).collect();
        let y = points.iter().map(|&row| rows[joint].residual[row]).collect();
        let data = Data::new(found.gp.data().x().to_vec(), found.gp.data().inputs(), y, 1)?;
        let covariance = found.gp.covariance().clone().in_units_of(scales[joint]);
        let gp = GaussianProcess::fit(data, covariance, compute)?;
        Learned::new(gp, points, &rows[joint], &unseen[joint], (inputs, found.status), compute)
    };
    (0..rows.len()).map(of_joint).collect()
}

/// The processes that are good enough.
fn chosen(
    alone: Vec<Alone>,
    best: Option<(f64, Vec<Learned>)>,
    rows: &[ResidualRows],
    unseen: &[Unseen],
    options: &SemiParametricOptions,
    compute: &Compute,
) -> Result<Vec<JointProcess>, GpError> {
    let Some((_, learned)) = best else {
        return Ok(alone
            .into_iter()
            .map(|alone| JointProcess::without(alone.report, alone.mean_square))
            .collect());
    };
    let joints = alone.into_iter().zip(learned).zip(rows.iter().zip(unseen));
    let joints = joints.map(|((alone, learned), (rows, unseen))| {
        let Alone { report, mean_square } = alone;
        if options.inputs.is_none() && !learned.saves() {
            return Ok(JointProcess::without(report, mean_square));
        }
        JointProcess::with(learned, report, rows, unseen, compute)
    });
    joints.collect()
}

/// The samples that are rows of every joint: for each the row of each joint.
fn common(rows: &[ResidualRows]) -> Vec<Vec<usize>> {
    let row_of =
        |rows: &ResidualRows, source: &(usize, usize)| rows.source.binary_search(source).ok();
    let place =
        |source| rows.iter().map(|rows| row_of(rows, source)).collect::<Option<Vec<usize>>>();
    rows[0].source.iter().filter_map(place).collect()
}
