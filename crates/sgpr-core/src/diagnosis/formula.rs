//! A formula for structure that no known effect explains: a few terms of a dictionary.
//!
//! Terms are products of at most two functions of position, speed, acceleration and load of the
//! joint and others. They are chosen one after the other by orthogonal least squares on the
//! whitened residual, projected on the complement of the model like any effect, and kept while the
//! error on left-out blocks falls.
//!
//! Source: S. Chen, S. A. Billings, W. Luo, Orthogonal least squares methods and their application
//! to non-linear system identification, Int. J. Control 50(5) (1989).

use serde::{Deserialize, Serialize};

use super::basis::{INVISIBLE, Noise, gain};
use super::fit::Fitted;
use super::left_out::Extra;
use super::problem::{Column, FOLDS, Problem};
use crate::effects::sgn;
use crate::linalg::{dot_in_lanes, solve_general};

/// One term of a formula.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct FormulaTerm {
    /// The function: `dq(joint_2) · cos q(joint_1)`.
    pub function: String,
    /// Factor.
    pub coefficient: f64,
    /// Its standard deviation.
    #[serde(rename = "standard_deviation", alias = "std")]
    pub std: f64,
    /// Its unit.
    pub unit: String,
    /// Share of the choices, each with some blocks of time left out, in which it comes first.
    pub stability: f64,
}

/// A formula for what is left of a joint's torque: a suggestion, not a finding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Formula {
    /// Joint.
    pub joint: String,
    /// Terms, most important first.
    pub terms: Vec<FormulaTerm>,
    /// All of it: `tau(joint_1) = 0.90 dq(joint_2) · cos q(joint_1)`.
    pub text: String,
    /// Share of the variance that is left in the band, on blocks of time that no fit has seen,
    /// which it explains.
    pub explained: f64,
}

/// Most terms of a formula.
const MOST_TERMS: usize = 4;

/// Log of the Bayes factor that a term must have, multiplicity taken off.
const EVIDENCE: f64 = 8.0;

/// Smallest fall of the held-out error.
const MATERIAL: f64 = 0.015;

/// Columns that are filtered at once.
const AT_ONCE: usize = 64;

/// A function of one joint's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Factor {
    Position,
    Sine(u8),
    Cosine(u8),
    Speed,
    AbsoluteSpeed,
    Direction,
    Acceleration,
    Load,
    AbsoluteLoad,
}

use Factor::{
    AbsoluteLoad, AbsoluteSpeed, Acceleration, Cosine, Direction, Load, Position, Sine, Speed,
};

/// What the torque of any joint may depend on.
const OF_EVERY_JOINT: [Factor; 9] = [
    Position,
    Sine(1),
    Cosine(1),
    Sine(2),
    Cosine(2),
    Speed,
    AbsoluteSpeed,
    Direction,
    Acceleration,
];

impl Factor {
    fn value(self, q: f64, dq: f64, ddq: f64, load: f64) -> f64 {
        match self {
            Position => q,
            Sine(k) => (f64::from(k) * q).sin(),
            Cosine(k) => (f64::from(k) * q).cos(),
            Speed => dq,
            AbsoluteSpeed => dq.abs(),
            Direction => sgn(dq),
            Acceleration => ddq,
            Load => load,
            AbsoluteLoad => load.abs(),
        }
    }

    fn text(self, joint: &str) -> String {
        match self {
            Position => format!("q({joint})"),
            Sine(1) => format!("sin q({joint})"),
            Cosine(1) => format!("cos q({joint})"),
            Sine(k) => format!("sin {k}q({joint})"),
            Cosine(k) => format!("cos {k}q({joint})"),
            Speed => format!("dq({joint})"),
            AbsoluteSpeed => format!("|dq({joint})|"),
            Direction => format!("sgn dq({joint})"),
            Acceleration => format!("ddq({joint})"),
            Load => format!("load({joint})"),
            AbsoluteLoad => format!("|load({joint})|"),
        }
    }

    /// Unit at a joint with positions in `unit`, and torques in `torque`.
    fn unit(self, unit: &str, torque: &str) -> Option<String> {
        match self {
            Position => Some(unit.into()),
            Sine(_) | Cosine(_) | Direction => None,
            Speed | AbsoluteSpeed => Some(format!("({unit}/s)")),
            Acceleration => Some(format!("({unit}/s²)")),
            Load | AbsoluteLoad => Some(torque.into()),
        }
    }
}

/// A product of factors, each of a joint.
type Product = Vec<(Factor, usize)>;

/// Products of at most two factors; at least one of the joint itself, or both of one other joint.
fn dictionary(joint: usize, dof: usize) -> Vec<Product> {
    let own: Vec<(Factor, usize)> =
        OF_EVERY_JOINT.iter().chain(&[Load, AbsoluteLoad]).map(|factor| (*factor, joint)).collect();
    let other = |j: usize| OF_EVERY_JOINT.iter().map(move |factor| (*factor, j));
    let mut products: Vec<Product> = own.iter().map(|factor| vec![*factor]).collect();
    let pairs = |factors: &[(Factor, usize)]| -> Vec<Product> {
        let same = |(k, a): (usize, &(Factor, usize))| {
            factors[k..]
                .iter()
                .filter(|b| a != *b || matches!(a.0, Position | Speed | Acceleration))
                .map(|b| vec![*a, *b])
                .collect::<Vec<_>>()
        };
        factors.iter().enumerate().flat_map(same).collect()
    };
    products.extend(pairs(&own));
    for j in (0..dof).filter(|j| *j != joint) {
        let others: Vec<(Factor, usize)> = other(j).collect();
        products.extend(others.iter().map(|factor| vec![*factor]));
        products.extend(pairs(&others));
        products.extend(own.iter().flat_map(|a| others.iter().map(|b| vec![*a, *b])));
    }
    products
}

/// Products on the rows of a joint, whitened.
struct Whitened {
    /// Hundreds of columns, kept in 32 bits; what is not whitened is made again for the few that
    /// are chosen.
    columns: Vec<Vec<f32>>,
    /// Along the columns of the model.
    shares: Vec<Vec<f64>>,
    /// Squared lengths.
    whole: Vec<f64>,
    /// Products with the residual by block, the last entry their sum.
    along: Vec<[f64; FOLDS + 1]>,
}

impl Whitened {
    fn new(
        problem: &Problem,
        fitted: &Fitted,
        noise: &Noise,
        joint: usize,
        products: &[Product],
    ) -> Self {
        let (y, fold) = (&fitted.white[joint], &problem.fold[joint]);
        let mut all = Self { columns: vec![], shares: vec![], whole: vec![], along: vec![] };
        for some in products.chunks(AT_ONCE) {
            let columns = raw(problem, fitted, joint, some);
            let columns: Vec<Column> =
                columns.iter().map(|column| noise.whiten(problem, column)).collect();
            all.shares.extend(fitted.basis.shares(&columns));
            for z in columns.iter().map(|column| &column[joint]) {
                let mut sums = [0.0; FOLDS + 1];
                z.iter().zip(y).zip(fold).for_each(|((z, y), fold)| sums[*fold] += z * y);
                sums[FOLDS] = sums[..FOLDS].iter().sum();
                all.along.push(sums);
                all.whole.push(dot_in_lanes(z, z));
                all.columns.push(z.iter().map(|z| *z as f32).collect());
            }
        }
        all
    }
}

/// A formula for what `fitted` leaves at `joint`, if one helps on blocks of time that no fit has
/// seen.
pub(super) fn formula(
    problem: &Problem,
    fitted: &Fitted,
    noise: &Noise,
    joint: usize,
) -> Option<Formula> {
    let products = dictionary(joint, problem.dof());
    let Whitened { columns: white, shares, whole, mut along } =
        Whitened::new(problem, fitted, noise, joint, &products);
    // Squared lengths after projection.
    let mut length: Vec<f64> =
        whole.iter().zip(&shares).map(|(z, s)| z - dot_in_lanes(s, s)).collect();
    let rows = fitted.white[joint].len().max(2) as f64;
    let invisible = |k: usize, length: f64| length <= 0.02 * whole[k].max(f64::MIN_POSITIVE);
    let mut chosen: Vec<usize> = Vec::new();
    let mut columns: Vec<Column> = Vec::new();
    let mut stability: Vec<f64> = Vec::new();
    // Of each chosen column: its products with all columns, those chosen before it taken out, over
    // its length.
    let mut before: Vec<Vec<f64>> = Vec::new();
    let fits = fitted.folds(problem, noise);
    let mut error = fits.errors().mean_square(joint).sqrt();
    while chosen.len() < MOST_TERMS {
        let best_without = |skip: Option<usize>| {
            let left = |k: usize| along[k][FOLDS] - skip.map_or(0.0, |fold| along[k][fold]);
            (0..products.len())
                .filter(|&k| !chosen.contains(&k) && !invisible(k, length[k]))
                .max_by(|&a, &b| {
                    (left(a).powi(2) / length[a]).total_cmp(&(left(b).powi(2) / length[b]))
                })
        };
        let Some(best) = best_without(None) else { break };
        let score = 0.5 * along[best][FOLDS].powi(2) / length[best]
            - 0.5 * rows.ln()
            - (products.len() as f64).ln();
        if score < EVIDENCE {
            break;
        }
        columns.extend(raw(problem, fitted, joint, &products[best..=best]));
        let with = fits
            .errors_with(&Extra { columns: &columns, precision: &[] }, &[joint])
            .mean_square(joint)
            .sqrt();
        if with > (1.0 - MATERIAL) * error {
            break;
        }
        error = with;
        let same = (0..FOLDS).filter(|fold| best_without(Some(*fold)) == Some(best)).count();
        stability.push(same as f64 / FOLDS as f64);
        let wide = |k: usize| -> Vec<f64> { white[k].iter().map(|z| f64::from(*z)).collect() };
        let own_column = wide(best);
        let products_with: Vec<f64> = (0..products.len())
            .map(|k| {
                let plain =
                    dot_in_lanes(&wide(k), &own_column) - dot_in_lanes(&shares[k], &shares[best]);
                plain - before.iter().map(|row| row[k] * row[best]).sum::<f64>()
            })
            .collect();
        let size = length[best].sqrt();
        let row: Vec<f64> = products_with.iter().map(|product| product / size).collect();
        let own = along[best].map(|value| value / size);
        for k in 0..products.len() {
            along[k].iter_mut().zip(own).for_each(|(value, own)| *value -= row[k] * own);
            length[k] -= row[k] * row[k];
        }
        before.push(row);
        chosen.push(best);
    }
    let terms: Vec<Chosen<'_>> = chosen
        .iter()
        .zip(&columns)
        .zip(stability)
        .map(|((k, column), stability)| Chosen { product: &products[*k], column, stability })
        .collect();
    (!terms.is_empty()).then(|| written(problem, fitted, noise, joint, &terms, error))
}

/// A product that was chosen, its column, and how stable the choice is.
struct Chosen<'a> {
    product: &'a Product,
    column: &'a Column,
    stability: f64,
}

/// Columns of products in the band.
fn raw(problem: &Problem, fitted: &Fitted, joint: usize, products: &[Product]) -> Vec<Column> {
    let n = problem.dof();
    problem.feature_columns(joint, products.len(), |stretch, k, row| {
        let load = &fitted.rigid[stretch].torque;
        let motion = &problem.stretches[stretch].motion;
        for (out, product) in row.iter_mut().zip(products) {
            let value = |(factor, j): &(Factor, usize)| {
                let at = k * n + j;
                factor.value(motion.q[at], motion.dq[at], motion.ddq[at], load[at])
            };
            *out = product.iter().map(value).product();
        }
    })
}

/// The formula in words; `after` is the held-out error with it.
fn written(
    problem: &Problem,
    fitted: &Fitted,
    noise: &Noise,
    joint: usize,
    chosen: &[Chosen<'_>],
    after: f64,
) -> Formula {
    let robot = problem.nominal.robot();
    let own = &robot.joints()[joint];
    let white: Vec<Column> = chosen.iter().map(|term| noise.whiten(problem, term.column)).collect();
    let coefficients = gain(&fitted.basis, &fitted.white, &white, INVISIBLE).coefficients;
    let deviations = deviations(fitted, joint, &white);
    let terms: Vec<FormulaTerm> = chosen
        .iter()
        .enumerate()
        .map(|(k, term)| {
            let factors = term.product;
            let text = factors.iter().map(|(factor, j)| factor.text(&robot.joints()[*j].name));
            let unit = |(factor, j): &(Factor, usize)| {
                let other = robot.joints()[*j].kind;
                factor.unit(other.position_unit(), other.torque_unit())
            };
            let units: Vec<String> = factors.iter().filter_map(unit).collect();
            FormulaTerm {
                function: text.collect::<Vec<_>>().join(" · "),
                coefficient: coefficients[k],
                std: deviations[k],
                unit: std::iter::once(own.kind.torque_unit().to_string())
                    .chain(units)
                    .collect::<Vec<_>>()
                    .join("/"),
                stability: term.stability,
            }
        })
        .collect();
    let mut text = format!("tau({}) =", own.name);
    for (k, term) in terms.iter().enumerate() {
        let sign = if term.coefficient < 0.0 {
            " -"
        } else if k > 0 {
            " +"
        } else {
            ""
        };
        text += &format!("{sign} {:.4} {}", term.coefficient.abs(), term.function);
    }
    let before = fitted.folds(problem, noise).errors().mean_square(joint).sqrt();
    let explained = 1.0 - (after / before.max(1e-300)).powi(2);
    Formula { joint: own.name.clone(), terms, text, explained }
}

/// Standard deviations of the coefficients of whitened columns beside the model's.
fn deviations(fitted: &Fitted, joint: usize, columns: &[Column]) -> Vec<f64> {
    let k = columns.len();
    let z: Vec<&Vec<f64>> = columns.iter().map(|column| &column[joint]).collect();
    let shares = fitted.basis.shares(columns);
    let gram = faer::Mat::from_fn(k, k, |a, b| {
        dot_in_lanes(z[a], z[b]) - dot_in_lanes(&shares[a], &shares[b])
    });
    let unit = faer::Mat::from_fn(k, k, |a, b| if a == b { 1.0 } else { 0.0 });
    solve_general(&gram, &unit).map_or_else(
        || vec![f64::INFINITY; k],
        |inverse| (0..k).map(|a| inverse[(a, a)].max(0.0).sqrt()).collect(),
    )
}
