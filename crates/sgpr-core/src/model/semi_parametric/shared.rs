//! One kernel for all joints: what they leave over is learned together, over the points at which all of them move.

use super::rest::{
    Alone, Candidate, FEWEST, Found, GAIN, LeftOut, Rest, Rows, calibration, errors_left_out, loss_of, process,
};
use super::{Inputs, SemiParametricOptions};
use crate::gp::{Compute, Data, GaussianProcess, GpError};
use crate::progress::Progress;

/// Selections that are the same for every joint.
pub(super) const SELECTIONS: [Inputs; 4] =
    [Inputs::Velocities, Inputs::Positions, Inputs::PositionsAndVelocities, Inputs::All];

/// The processes of all joints. The residuals, each in units of its own root mean square, are outputs of one process: the
/// search factors one matrix for all of them. Each joint then gets its process, over the same points and with the same
/// kernel in its own units, if that predicts parts left out better than the physics alone.
pub(super) fn fit_shared(
    rows: &[Rows],
    left_out: &[Vec<LeftOut>],
    options: &SemiParametricOptions,
    compute: &Compute,
    progress: &dyn Progress,
) -> Result<Vec<Rest>, GpError> {
    let n = rows.len();
    let width = 3 * n + 1;
    let mut alone: Vec<Alone> = rows.iter().zip(left_out).map(|(rows, left_out)| Alone::new(rows, left_out)).collect();
    let places = common(rows);
    let scales: Vec<f64> = alone.iter().map(|alone| alone.mean_square.sqrt()).collect();
    if places.len() < FEWEST || scales.contains(&0.0) {
        return Ok(alone.into_iter().map(|alone| Rest::without(alone.report, alone.mean_square)).collect());
    }
    let first = |place: &Vec<usize>| place[0] * width..(place[0] + 1) * width;
    let x: Vec<f64> = places.iter().flat_map(|place| &rows[0].x[first(place)]).copied().collect();
    let in_units = |place: &Vec<usize>| -> Vec<f64> {
        (0..n).map(|joint| rows[joint].residual[place[joint]] / scales[joint]).collect()
    };
    let data = Data::new(x, width, places.iter().flat_map(in_units).collect(), n)?;

    let mut best: Option<(f64, Inputs, Vec<Learned>)> = None;
    let selections = options.inputs.map_or_else(|| SELECTIONS.to_vec(), |inputs| vec![inputs]);
    for inputs in selections {
        // A selection is tried for all joints at once.
        for _ in 0..n {
            if progress.step("rest", alone[0].report.candidates.len(), SELECTIONS.len()).is_err() {
                return Ok(chosen(alone, best, left_out, options));
            }
        }
        let found = process(inputs.columns(0, n), &data, None, 1.0, options, compute, progress)?;
        let learned = of_joints(&found, &places, &scales, rows, left_out, compute)?;
        let mut sum = 0.0;
        for (alone, learned) in alone.iter_mut().zip(&learned) {
            let loss = loss_of(&learned.errors);
            sum += (loss / alone.physics_loss).min(1.0);
            alone.report.candidates.push(Candidate {
                inputs,
                rmse: loss.sqrt(),
                log_marginal_likelihood: learned.gp.log_marginal_likelihood(),
                status: found.status,
            });
        }
        if best.as_ref().is_none_or(|(least, _, _)| sum < *least) {
            best = Some((sum, inputs, learned));
        }
    }
    Ok(chosen(alone, best, left_out, options))
}

/// The process of one joint, the rows that are its points, and its errors and variances on parts left out.
struct Learned {
    gp: GaussianProcess,
    points: Vec<usize>,
    errors: Vec<(f64, f64)>,
}

fn of_joints(
    found: &Found,
    places: &[Vec<usize>],
    scales: &[f64],
    rows: &[Rows],
    left_out: &[Vec<LeftOut>],
    compute: &Compute,
) -> Result<Vec<Learned>, GpError> {
    let of_joint = |joint: usize| {
        let points: Vec<usize> = found.points.iter().map(|&k| places[k][joint]).collect();
        let y = points.iter().map(|&row| rows[joint].residual[row]).collect();
        let data = Data::new(found.gp.data().x().to_vec(), found.gp.data().inputs(), y, 1)?;
        let covariance = found.gp.covariance().clone().in_units_of(scales[joint]);
        let gp = GaussianProcess::fit(data, covariance, compute)?;
        let errors = errors_left_out(&gp, &points, &rows[joint], &left_out[joint], compute)?;
        Ok(Learned { gp, points, errors })
    };
    (0..rows.len()).map(of_joint).collect()
}

/// The processes that are good enough.
fn chosen(
    alone: Vec<Alone>,
    best: Option<(f64, Inputs, Vec<Learned>)>,
    left_out: &[Vec<LeftOut>],
    options: &SemiParametricOptions,
) -> Vec<Rest> {
    let Some((_, inputs, learned)) = best else {
        return alone.into_iter().map(|alone| Rest::without(alone.report, alone.mean_square)).collect();
    };
    let joints = alone.into_iter().zip(learned).zip(left_out);
    let joints = joints.map(|((alone, learned), left_out)| {
        let Alone { mut report, mean_square, physics_loss } = alone;
        if options.inputs.is_none() && loss_of(&learned.errors) >= (1.0 - GAIN) * physics_loss {
            return Rest::without(report, mean_square);
        }
        report.chosen = Some(inputs);
        (report.calibration, report.calibration_95) = calibration(&learned.errors, left_out.len());
        Rest::with(learned.gp, learned.points, report)
    });
    joints.collect()
}

/// The samples that are rows of every joint: for each the row of each joint.
fn common(rows: &[Rows]) -> Vec<Vec<usize>> {
    let row_of = |rows: &Rows, source: &(usize, usize)| rows.source.binary_search(source).ok();
    let place = |source| rows.iter().map(|rows| row_of(rows, source)).collect::<Option<Vec<usize>>>();
    rows[0].source.iter().filter_map(place).collect()
}
