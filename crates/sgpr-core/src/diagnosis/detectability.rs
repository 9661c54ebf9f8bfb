//! What the logs could have shown: how large an effect must be to be seen, and to be told from the
//! others.
//!
//! Every effect is put into the equations by itself, on the motion and the noise of the logs, after
//! projection on what the model takes up. Expected scores follow from lengths and angles of its
//! columns; no noise is drawn.
//!
//! Source: D. Eriksson, E. Frisk, M. Krysander, A method for quantitative fault diagnosability
//! analysis of stochastic linear descriptor models, Automatica 49(6) (2013).

use rayon::prelude::*;

use super::answer::{Detectable, FoundParameter};
use super::basis::{Basis, dot, gain_of, invisible};
use super::described::{joints_of, parameters_of};
use super::fit::Fitted;
use super::problem::Column;
use super::search::{EVIDENCE, Search, material};
use crate::linalg::{dot_in_lanes, rms};
use crate::model::Term;
use crate::progress::Interrupted;

/// Log of the Bayes factor by which an effect is told from another one: twenty to one.
const CLEAR: f64 = 3.0;

/// Of two directions that are closer than this no size makes a difference: 1 - cos².
const SAME: f64 = 1e-4;

/// Whitened columns of a term, with their products with the basis of the model.
struct Projected {
    term: Term,
    white: Vec<Column>,
    shares: Vec<Vec<f64>>,
    /// Products of the columns less what the basis holds of them, row-major.
    gram: Vec<f64>,
    /// Squared lengths of the columns.
    lengths: Vec<f64>,
    /// Root mean square per joint of the first column, not whitened.
    size: Vec<f64>,
}

impl Projected {
    fn product(&self, k: usize, other: &Self, l: usize) -> f64 {
        dot(&self.white[k], &other.white[l]) - dot_in_lanes(&self.shares[k], &other.shares[l])
    }

    /// Share of the first column of `other` in the plane of the columns, and the rank of these.
    fn holds(&self, other: &Self) -> (f64, usize) {
        let along: Vec<f64> = (0..self.white.len()).map(|i| self.product(i, other, 0)).collect();
        let gain = gain_of(&self.gram, &along, &self.lengths, invisible(&self.term));
        (gain.chi2 / other.gram[0], gain.rank)
    }

    fn constants(&self) -> usize {
        if self.term.is_transform() { 0 } else { self.term.constants.len() }
    }
}

/// What logs could have shown beside what is in `fitted`, effect by effect and joint by joint.
///
/// - `left`: error per joint on blocks that were left out, N·m (N)
pub(super) fn detectable(
    search: &mut Search<'_>,
    fitted: &Fitted,
    left: &[f64],
) -> Result<Vec<Detectable>, Interrupted> {
    let (basis, _) = search.with_nuisances(fitted);
    let mut terms = search.terms_of_ranking(fitted);
    terms.retain(|term| !search.is_drowned(term.effect.as_ref(), term.site));
    let columns = search.take_columns(fitted, &terms)?;
    let pairs: Vec<(Term, Vec<Column>)> = terms.into_iter().zip(columns).collect();
    let search = &*search;
    // The columns go as they are projected.
    let all: Vec<Projected> = pairs
        .into_par_iter()
        .map(|(term, columns)| projected(search, &basis, term, &columns))
        .collect();
    // Of every effect at every site one point of the grid stands for all.
    let mut subjects: Vec<&Projected> = Vec::new();
    let mut first = 0;
    while first < all.len() {
        let same = |p: &Projected| p.term.is_like(&all[first].term);
        let count = all[first..].iter().take_while(|p| same(p)).count();
        subjects.push(&all[first + count / 2]);
        first += count;
    }
    subjects.retain(|p| p.term.effect.refines().is_none());
    Ok(subjects.par_iter().filter_map(|subject| one(search, subject, &all, left)).collect())
}

fn projected(search: &Search<'_>, basis: &Basis, term: Term, columns: &[Column]) -> Projected {
    let white: Vec<Column> =
        columns.iter().map(|column| search.noise.whiten(&search.problem, column)).collect();
    let shares = basis.shares(&white);
    let lengths = white.iter().map(|column| dot(column, column)).collect();
    let size = columns.first().map_or(vec![], |column| column.iter().map(|own| rms(own)).collect());
    let k = white.len();
    let own = Projected { term, white, shares, gram: vec![], lengths, size };
    Projected { gram: (0..k * k).map(|i| own.product(i / k, &own, i % k)).collect(), ..own }
}

fn one(
    search: &Search<'_>,
    subject: &Projected,
    all: &[Projected],
    left: &[f64],
) -> Option<Detectable> {
    let term = &subject.term;
    let robot = search.problem.nominal.robot();
    // An effect has no columns where its joint stands still.
    let first = subject.white.first()?;
    let whole = dot(first, first);
    let length = subject.gram[0];
    let visible = (length / whole).max(0.0).sqrt();
    if !(whole > 0.0 && visible > invisible(term)) {
        return None;
    }
    let (_, rank) = subject.holds(subject);
    let cost =
        |rank: usize, constants: usize| 0.5 * (rank + constants) as f64 * search.rows.max(2.0).ln();
    let own_cost = cost(rank, subject.constants());
    let size_of = |score: f64, length: f64| (2.0 * score.max(0.0) / length).sqrt();
    // (1 + fall)² = 1 + (visible torque / what is left)²
    let needed = ((1.0 + material(term)).powi(2) - 1.0).sqrt();
    let ratios = subject
        .size
        .iter()
        .zip(left)
        .map(|(size, left)| size / left.max(f64::MIN_POSITIVE))
        .enumerate();
    let (joint, ratio) = ratios.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let seen_from =
        size_of(EVIDENCE + search.units.ln() + own_cost, length).max(needed / (visible * ratio));
    let rivals = all.iter().filter(|p| !p.term.is_like(term) && !p.white.is_empty());
    let apart = rivals.map(|rival| {
        let (share, rank) = rival.holds(subject);
        // A rival with more freedom loses by that already.
        let missing = CLEAR + own_cost - cost(rank, rival.constants());
        let rest = if 1.0 - share > SAME { length * (1.0 - share) } else { 0.0 };
        (if missing > 0.0 { size_of(missing, rest) } else { 0.0 }, rival)
    });
    let nearest = apart.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(size, _)| *size > seen_from);
    let names = parameters_of(term, robot);
    let own = if term.is_transform() { 0 } else { term.constants.len() };
    let parameter = names.get(own)?;
    Some(Detectable {
        effect: term.effect.name().into(),
        joints: joints_of(term)
            .into_iter()
            .map(|joint| robot.joints()[joint].name.clone())
            .collect(),
        constants: names[..own].iter().map(|c| FoundParameter { std: None, ..c.clone() }).collect(),
        parameter: parameter.name.clone(),
        unit: parameter.unit.clone(),
        seen_from,
        torque: seen_from * subject.size[joint],
        visible,
        told_apart_from: match &nearest {
            Some((size, _)) => size.is_finite().then_some(*size),
            None => Some(seen_from),
        },
        mistaken_for: nearest.map(|(_, rival)| {
            let (name, elsewhere) = (
                rival.term.effect.name(),
                rival.term.site.joint().filter(|_| rival.term.site != term.site),
            );
            elsewhere
                .map_or(name.into(), |joint| format!("{name} at {}", robot.joints()[joint].name))
        }),
    })
}
