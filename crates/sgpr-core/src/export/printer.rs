//! Formulas as lines of code: one statement for what is used more than once or too long for its
//! place.

use super::program::{FormulaInput, FormulaProgram};
use sgpr_predict::internal::Node;

use crate::expression::Expr;
use crate::gp::Precision;

/// Longest formula that stands where it is used.
const INLINE: usize = 56;

/// What languages write in ways of their own.
pub(super) trait Dialect {
    /// Width of the numbers, times aside.
    fn precision(&self) -> Precision;

    /// A number of this width from its digits, or one that is infinite without.
    fn constant(&self, precision: Precision, digits: Option<String>) -> String;

    /// A time as a number of the file's width.
    fn narrowed(&self, time: &str) -> String;

    /// A function of one number, by its name in C.
    fn function(&self, name: &str, of: &str) -> String;

    /// A power.
    fn power(&self, of: &str, exponent: &str) -> String;

    /// `yes` where a number is above zero, else `no`.
    fn select(&self, number: &str, yes: &str, no: &str) -> String;

    /// A number within limits.
    fn clamp(&self, number: &str, low: &str, high: &str) -> String;

    /// Sign, zero at zero.
    fn sgn(&self, of: &str) -> String;

    /// A number that a formula starts from.
    fn input(&self, input: FormulaInput) -> String;

    /// A statement that gives a value of this width a name.
    fn declare(&self, precision: Precision, name: &str, value: &str) -> String;
}

/// A formula, and whether it must stand in parentheses when another is made of it.
#[derive(Clone, Debug, Default)]
struct Text {
    text: String,
    compound: bool,
}

impl Text {
    fn simple(text: String) -> Self {
        Self { text, compound: false }
    }

    fn compound(text: String) -> Self {
        Self { text, compound: true }
    }

    fn operand(&self) -> String {
        if self.compound { format!("({})", self.text) } else { self.text.clone() }
    }
}

/// The statements that compute the torque and the next hidden states, and the names of both.
#[derive(Debug)]
pub(super) struct Statements {
    pub statements: Vec<String>,
    pub tau: Vec<String>,
    pub hidden: Vec<String>,
}

/// Writes the formulas of a program.
pub(super) fn body(program: &FormulaProgram, dialect: &dyn Dialect) -> Statements {
    let tape = &program.tape;
    let times = times(program, dialect.precision());
    let mut texts = vec![Text::default(); tape.len()];
    let mut statements = Vec::new();
    for index in (0..tape.len()).filter(|index| program.uses[*index] > 0) {
        let node = tape.at(index);
        let text = Writer { texts: &texts, times: &times, program, dialect }.written(index);
        let plain = matches!(node, Node::Constant(_) | Node::Input(_));
        texts[index] = if plain || (program.uses[index] == 1 && text.text.len() <= INLINE) {
            text
        } else {
            let name = format!("t{}", statements.len());
            let precision = if times[index] { Precision::Double } else { dialect.precision() };
            statements.push(dialect.declare(precision, &name, &text.text));
            Text::simple(name)
        };
    }
    // Every value that is read has been read before one is written.
    let mut named = |prefix: &str, outputs: &mut dyn Iterator<Item = Expr>| -> Vec<String> {
        let named = outputs.enumerate().map(|(k, output)| {
            let name = format!("{prefix}{k}");
            statements.push(dialect.declare(
                dialect.precision(),
                &name,
                &texts[output.index()].text,
            ));
            name
        });
        named.collect()
    };
    let tau = named("tau", &mut program.tau.iter().copied());
    let hidden = named("next", &mut program.hidden.iter().map(|(_, hidden)| hidden.next));
    Statements { statements, tau, hidden }
}

/// Which operations make times of others, and keep 64 bits where numbers have 32.
fn times(program: &FormulaProgram, precision: Precision) -> Vec<bool> {
    let mut times = vec![false; program.tape.len()];
    for index in (0..times.len()).filter(|_| precision == Precision::Single) {
        let is_constant = |expr: Expr| matches!(program.tape.node(expr), Node::Constant(_));
        times[index] = match program.tape.at(index) {
            Node::Input(input) => program.inputs[input] == FormulaInput::Time,
            Node::Add(a, b) | Node::Sub(a, b) => {
                let time = |expr: Expr| times[expr.index()];
                (time(a) && (time(b) || is_constant(b))) || (is_constant(a) && time(b))
            }
            _ => false,
        };
    }
    times
}

/// Writes operations whose operands are written.
struct Writer<'a> {
    texts: &'a [Text],
    times: &'a [bool],
    program: &'a FormulaProgram,
    dialect: &'a dyn Dialect,
}

impl Writer<'_> {
    fn written(&self, index: usize) -> Text {
        let dialect = self.dialect;
        let part = |expr: Expr| self.part(expr, self.times[index]);
        let operand = |expr: Expr| part(expr).operand();
        let whole = |expr: Expr| part(expr).text;
        let pair = |a: Expr, sign: &str, b: Expr| {
            Text::compound(format!("{} {sign} {}", operand(a), operand(b)))
        };
        let function = |name: &str, of: Expr| Text::simple(dialect.function(name, &whole(of)));
        match self.program.tape.at(index) {
            Node::Constant(value) => constant(value, dialect.precision(), dialect),
            Node::Input(index) => Text::simple(dialect.input(self.program.inputs[index])),
            Node::Add(a, b) => pair(a, "+", b),
            Node::Sub(a, b) => pair(a, "-", b),
            Node::Mul(a, b) => pair(a, "*", b),
            Node::Div(a, b) => pair(a, "/", b),
            Node::Neg(a) => Text::compound(format!("-{}", operand(a))),
            Node::Sin(a) => function("sin", a),
            Node::Cos(a) => function("cos", a),
            Node::Exp(a) => function("exp", a),
            Node::Tanh(a) => function("tanh", a),
            Node::Sqrt(a) => function("sqrt", a),
            Node::Abs(a) => function("fabs", a),
            Node::Sgn(a) => Text::simple(dialect.sgn(&whole(a))),
            Node::Power(a, exponent) => {
                let exponent = constant(exponent, dialect.precision(), dialect);
                Text::simple(dialect.power(&whole(a), &exponent.text))
            }
            Node::Select(a, yes, no) => {
                Text::compound(dialect.select(&operand(a), &operand(yes), &operand(no)))
            }
            Node::Clamp(a, low, high) => {
                Text::simple(dialect.clamp(&whole(a), &whole(low), &whole(high)))
            }
        }
    }

    /// An operand of an operation that makes a time, or of another.
    fn part(&self, expr: Expr, of_time: bool) -> Text {
        let text = &self.texts[expr.index()];
        match self.program.tape.node(expr) {
            Node::Constant(value) if of_time => constant(value, Precision::Double, self.dialect),
            _ if self.times[expr.index()] && !of_time => {
                Text::simple(self.dialect.narrowed(&text.text))
            }
            _ => text.clone(),
        }
    }
}

/// The shortest decimal number that is read back to the bit.
fn constant(value: f64, precision: Precision, dialect: &dyn Dialect) -> Text {
    let digits = match precision {
        Precision::Single => {
            let size = value.abs() as f32;
            size.is_finite().then(|| format!("{size:?}"))
        }
        Precision::Double => value.is_finite().then(|| format!("{:?}", value.abs())),
    };
    let size = dialect.constant(precision, digits);
    if value.is_sign_negative() { Text::compound(format!("-{size}")) } else { Text::simple(size) }
}

/// Whether an operation of a kind is among those that are needed.
pub(super) fn uses(program: &FormulaProgram, kind: impl Fn(&Node) -> bool) -> bool {
    (0..program.tape.len()).any(|index| program.uses[index] > 0 && kind(&program.tape.at(index)))
}

/// What a reader of a file wants to know, one line each.
pub(super) fn head(program: &FormulaProgram, precision: Precision) -> Vec<String> {
    let clean = super::text::comment;
    let mut lines = vec![
        format!(
            "Torque of the robot arm {}: {}.",
            clean(&program.robot),
            match program.purpose {
                crate::model::Purpose::FeedForward => "what the arm needs (feed_forward)",
                crate::model::Purpose::ExpectedMeasurement =>
                    "what a log would show (expected_measurement)",
            }
        ),
        String::new(),
        format!(
            "Made by sgpr {} from a model of sgpr {}. Do not edit: export the model again.",
            env!("CARGO_PKG_VERSION"),
            clean(&program.provenance.library_version)
        ),
    ];
    lines.push(match precision {
        Precision::Double => "Numbers of 64 bits.".into(),
        Precision::Single => "Numbers of 32 bits, times of 64.".into(),
    });
    lines.extend(
        program
            .provenance
            .logs
            .iter()
            .take(20)
            .map(|log| format!("Identified from {}", clean(log))),
    );
    lines.extend([
        String::new(),
        "Joints, in the order of all arrays, with units of position and torque:".into(),
    ]);
    for (index, (name, rotates)) in program.joints.iter().enumerate() {
        let units = if *rotates { "rad, rad/s, rad/s^2, N m" } else { "m, m/s, m/s^2, N" };
        lines.push(format!("  {index}  {}  ({units})", clean(name)));
    }
    lines.push(match program.rate_hz {
        Some(rate_hz) => format!("Call it once per period, {rate_hz:?} times per second."),
        None => "Nothing in it depends on the time between calls.".into(),
    });
    let effects: Vec<String> = program.effects.iter().map(|effect| clean(effect)).collect();
    let effects = if effects.is_empty() { vec!["none".into()] } else { effects };
    lines.push("Effects beside the rigid body:".into());
    lines.extend(effects.iter().map(|effect| format!("  {effect}")));
    lines
}

/// Which hidden states belong to what, in runs of one owner: `0 to 1`,
/// `presliding_friction@joint_2`.
pub(super) fn owners(program: &FormulaProgram) -> Vec<String> {
    let mut runs: Vec<(usize, usize, &str)> = Vec::new();
    for (index, (_, hidden)) in program.hidden.iter().enumerate() {
        match runs.last_mut() {
            Some((_, last, carrier)) if *carrier == hidden.carrier => *last = index,
            _ => runs.push((index, index, &hidden.carrier)),
        }
    }
    let line = |(first, last, carrier): (usize, usize, &str)| {
        let range = if first == last { format!("{first}") } else { format!("{first} to {last}") };
        format!("{range}: {}", super::text::comment(carrier))
    };
    runs.into_iter().map(line).collect()
}
