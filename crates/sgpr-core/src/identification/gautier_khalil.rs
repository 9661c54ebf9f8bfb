//! The regrouping rules of Gautier and Khalil, as formulas.
//!
//! Frames follow the modified Denavit-Hartenberg convention: from frame j-1 turn by alpha about x,
//! shift by d along x, turn by theta about z, shift by r along z ([`DhRow`] calls d `a` and r `d`).
//! Three parameters of a link behind a rotating joint, and six behind a sliding one, act as if they
//! were part of the link before it.
//!
//! Sources: M. Gautier, W. Khalil, Direct calculation of minimum set of inertial parameters of
//! serial robots, IEEE T-RA 6(3) (1990); W. Khalil, E. Dombre, Modeling, Identification and Control
//! of Robots (2002), section 9.4.2.

use std::fmt;

use crate::robot::DhRow;
use crate::spatial::STANDARD_PARAMETER_NAMES;

/// Where a parameter of the link behind a joint goes: factors on the parameters of the link before
/// it, and on its own.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Regrouping {
    /// The parameter that goes, an index into [`STANDARD_PARAMETER_NAMES`].
    pub source: usize,
    /// What the parameters of the link before gain for each unit of it.
    pub before: Vec<RegroupingFactor>,
    /// What its own link's parameters gain.
    pub own: Vec<RegroupingFactor>,
}

/// A factor on a parameter.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RegroupingFactor {
    /// The parameter that gains, an index into [`STANDARD_PARAMETER_NAMES`].
    pub parameter: usize,
    /// The factor as a formula: `2 r cos(alpha)`.
    pub formula: String,
    /// Its value.
    pub value: f64,
}

/// The rules of one joint of a modified Denavit-Hartenberg table.
///
/// # Examples
/// ```
/// use sgpr_core::{identification::regroupings, robot::DhRow};
/// let rules = regroupings(&DhRow::revolute(0.4, 0.0, 0.1, 0.0));
/// let mass = rules.iter().find(|rule| rule.source == 0).unwrap();
/// assert_eq!(mass.to_string(), "m(j): Ixx(j-1) + r^2, Ixy(j-1) + d r sin(alpha), Ixz(j-1) - d r cos(alpha), \
///     Iyy(j-1) + d^2 + r^2 cos(alpha)^2, Iyz(j-1) + r^2 sin(alpha) cos(alpha), Izz(j-1) + d^2 + r^2 sin(alpha)^2, \
///     mx(j-1) + d, my(j-1) - r sin(alpha), mz(j-1) + r cos(alpha), m(j-1) + 1");
/// ```
pub fn regroupings(row: &DhRow) -> Vec<Regrouping> {
    let values = [row.a, row.d, row.alpha.sin(), row.alpha.cos(), row.theta.sin(), row.theta.cos()];
    let gains = |terms: &[(usize, Polynomial)]| -> Vec<RegroupingFactor> {
        terms
            .iter()
            .map(|(parameter, factor)| RegroupingFactor {
                parameter: *parameter,
                formula: formula(factor),
                value: factor.iter().map(|monomial| value(monomial, &values)).sum(),
            })
            .collect()
    };
    if row.prismatic {
        return (XX..=ZZ)
            .map(|source| Regrouping {
                source,
                before: gains(&turned(source)),
                own: gains(&[(source, vec![(-1.0, [0; 6])])]),
            })
            .collect();
    }
    rotating()
        .into_iter()
        .map(|(source, before, own)| Regrouping {
            source,
            before: gains(&before),
            own: gains(&own),
        })
        .collect()
}

impl fmt::Display for Regrouping {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let gain = |link: &'static str| {
            move |gain: &RegroupingFactor| {
                let sign = if gain.formula.starts_with('-') { "" } else { "+ " };
                let formula = gain
                    .formula
                    .strip_prefix('-')
                    .map_or_else(|| gain.formula.clone(), |rest| format!("- {rest}"));
                format!("{}({link}) {sign}{formula}", STANDARD_PARAMETER_NAMES[gain.parameter])
            }
        };
        let own = self.own.iter().filter(|gain| gain.parameter != self.source);
        let terms: Vec<String> =
            self.before.iter().map(gain("j-1")).chain(own.map(gain("j"))).collect();
        write!(f, "{}(j): {}", STANDARD_PARAMETER_NAMES[self.source], terms.join(", "))
    }
}

/// factor * d^a r^b sin(alpha)^c cos(alpha)^e sin(theta)^f cos(theta)^g
type Monomial = (f64, [i32; 6]);
type Polynomial = Vec<Monomial>;

const SYMBOLS: [&str; 6] = ["d", "r", "sin(alpha)", "cos(alpha)", "sin(theta)", "cos(theta)"];

const M: usize = 0;
const MX: usize = 1;
const MY: usize = 2;
const MZ: usize = 3;
const XX: usize = 4;
const XY: usize = 5;
const YY: usize = 6;
const XZ: usize = 7;
const YZ: usize = 8;
const ZZ: usize = 9;

type Rule = (usize, Vec<(usize, Polynomial)>, Vec<(usize, Polynomial)>);

/// Iyy, mz and m of a link that turns about z (Khalil and Dombre, eq. 9.33).
fn rotating() -> Vec<Rule> {
    let one = |factor: f64, d: i32, r: i32, s: i32, c: i32| (factor, [d, r, s, c, 0, 0]);
    vec![
        (
            YY,
            vec![
                (XX, vec![one(1.0, 0, 0, 0, 0)]),
                (YY, vec![one(1.0, 0, 0, 0, 2)]),
                (YZ, vec![one(1.0, 0, 0, 1, 1)]),
                (ZZ, vec![one(1.0, 0, 0, 2, 0)]),
            ],
            vec![(XX, vec![one(-1.0, 0, 0, 0, 0)]), (YY, vec![one(-1.0, 0, 0, 0, 0)])],
        ),
        (
            MZ,
            vec![
                (XX, vec![one(2.0, 0, 1, 0, 0)]),
                (XY, vec![one(1.0, 1, 0, 1, 0)]),
                (XZ, vec![one(-1.0, 1, 0, 0, 1)]),
                (YY, vec![one(2.0, 0, 1, 0, 2)]),
                (YZ, vec![one(2.0, 0, 1, 1, 1)]),
                (ZZ, vec![one(2.0, 0, 1, 2, 0)]),
                (MY, vec![one(-1.0, 0, 0, 1, 0)]),
                (MZ, vec![one(1.0, 0, 0, 0, 1)]),
            ],
            vec![(MZ, vec![one(-1.0, 0, 0, 0, 0)])],
        ),
        (
            M,
            vec![
                (XX, vec![one(1.0, 0, 2, 0, 0)]),
                (XY, vec![one(1.0, 1, 1, 1, 0)]),
                (XZ, vec![one(-1.0, 1, 1, 0, 1)]),
                (YY, vec![one(1.0, 2, 0, 0, 0), one(1.0, 0, 2, 0, 2)]),
                (YZ, vec![one(1.0, 0, 2, 1, 1)]),
                (ZZ, vec![one(1.0, 2, 0, 0, 0), one(1.0, 0, 2, 2, 0)]),
                (MX, vec![one(1.0, 1, 0, 0, 0)]),
                (MY, vec![one(-1.0, 0, 1, 1, 0)]),
                (MZ, vec![one(1.0, 0, 1, 0, 1)]),
                (M, vec![one(1.0, 0, 0, 0, 0)]),
            ],
            vec![(M, vec![one(-1.0, 0, 0, 0, 0)])],
        ),
    ]
}

/// An entry of the inertia of a link that slides, turned into the frame before: R I Rᵀ (Khalil and
/// Dombre, eq. 9.34).
fn turned(source: usize) -> Vec<(usize, Polynomial)> {
    let zero: Monomial = (0.0, [0; 6]);
    let one = |factor: f64, powers: [i32; 4]| {
        (factor, [0, 0, powers[0], powers[1], powers[2], powers[3]])
    };
    // sin and cos of alpha, then of theta.
    let rotation = [
        [one(1.0, [0, 0, 0, 1]), one(-1.0, [0, 0, 1, 0]), zero],
        [one(1.0, [0, 1, 1, 0]), one(1.0, [0, 1, 0, 1]), one(-1.0, [1, 0, 0, 0])],
        [one(1.0, [1, 0, 1, 0]), one(1.0, [1, 0, 0, 1]), one(1.0, [0, 1, 0, 0])],
    ];
    const PLACES: [(usize, usize, usize); 6] =
        [(XX, 0, 0), (XY, 0, 1), (XZ, 0, 2), (YY, 1, 1), (YZ, 1, 2), (ZZ, 2, 2)];
    let (_, row, column) =
        PLACES.into_iter().find(|place| place.0 == source).expect("an entry of the inertia");
    let product = |a: Monomial, b: Monomial| (a.0 * b.0, std::array::from_fn(|k| a.1[k] + b.1[k]));
    let entry = |(target, i, j): (usize, usize, usize)| {
        let mut sum: Polynomial = vec![product(rotation[i][row], rotation[j][column])];
        if row != column {
            sum.push(product(rotation[i][column], rotation[j][row]));
        }
        if let [(a, powers), (b, others)] = sum[..]
            && powers == others
        {
            sum = vec![(a + b, powers)];
        }
        sum.retain(|(factor, _)| *factor != 0.0);
        (target, sum)
    };
    PLACES.into_iter().map(entry).filter(|(_, sum)| !sum.is_empty()).collect()
}

fn value((factor, powers): &Monomial, symbols: &[f64; 6]) -> f64 {
    factor * symbols.iter().zip(powers).map(|(symbol, power)| symbol.powi(*power)).product::<f64>()
}

fn formula(terms: &Polynomial) -> String {
    let mut text = String::new();
    for (factor, powers) in terms {
        let mut parts: Vec<String> = Vec::new();
        if factor.abs() != 1.0 || powers.iter().all(|power| *power == 0) {
            parts.push(factor.abs().to_string());
        }
        for (symbol, power) in SYMBOLS.iter().zip(powers).filter(|(_, power)| **power > 0) {
            parts.push(if *power == 1 { (*symbol).into() } else { format!("{symbol}^{power}") });
        }
        match (text.is_empty(), *factor < 0.0) {
            (true, false) => {}
            (true, true) => text.push('-'),
            (false, minus) => text += if minus { " - " } else { " + " },
        }
        text += &parts.join(" ");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::{LinkInertia, Matrix3, PARAMETERS_PER_LINK, Pose, Vector3};

    /// What a unit of `parameter` of the link behind is in the frame before, the joint at
    /// `position`.
    fn moved(
        row: &DhRow,
        position: f64,
        parameters: &[f64; PARAMETERS_PER_LINK],
    ) -> [f64; PARAMETERS_PER_LINK] {
        let (theta, r) = if row.prismatic {
            (row.theta, row.d + position)
        } else {
            (row.theta + position, row.d)
        };
        let [x, z] = [Vector3::new(1.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 1.0)];
        let pose = Pose::new(Matrix3::rotation(x, row.alpha), x * row.a)
            * Pose::new(Matrix3::rotation(z, theta), z * r);
        LinkInertia::from_standard_parameters(parameters).expressed_in(&pose).standard_parameters()
    }

    #[test]
    fn what_goes_to_the_link_before_is_the_same_body_wherever_the_joint_stands() {
        for row in [
            DhRow::revolute(0.43, 0.7, 0.15, 0.4),
            DhRow::revolute(-0.02, -1.9, -0.1, 0.0),
            DhRow::prismatic(0.3, 1.1, 0.2, -0.6),
        ] {
            let rules = regroupings(&row);
            assert_eq!(rules.len(), if row.prismatic { 6 } else { 3 });
            for rule in rules {
                // What leaves its own link is what comes to the link before.
                let mut leaves = [0.0; PARAMETERS_PER_LINK];
                rule.own.iter().for_each(|gain| leaves[gain.parameter] -= gain.value);
                // About z, Iyy goes with as much of Ixx.
                let mut expected = [0.0; PARAMETERS_PER_LINK];
                rule.before.iter().for_each(|gain| expected[gain.parameter] += gain.value);
                for position in [0.0, 0.5, -1.3] {
                    for (a, b) in moved(&row, position, &leaves).iter().zip(expected) {
                        assert!((a - b).abs() < 1e-12, "{rule}: {a} {b}");
                    }
                }
            }
        }
    }
}
