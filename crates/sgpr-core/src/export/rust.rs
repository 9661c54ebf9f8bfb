//! Models in Rust.

use std::fmt::Write;

use super::printer::{Dialect, body, head, owners, uses};
use super::program::{FormulaInput, FormulaProgram};
use sgpr_predict::internal::Node;

use crate::gp::Precision;

struct Rust {
    precision: Precision,
}

/// The type of numbers.
fn of_width(precision: Precision) -> &'static str {
    match precision {
        Precision::Double => "f64",
        Precision::Single => "f32",
    }
}

/// A formula that a method is called on.
fn receiver(of: &str) -> String {
    let simple = of.bytes().all(|c| c.is_ascii_alphanumeric() || b"_.[]".contains(&c));
    if simple { of.into() } else { format!("({of})") }
}

impl Dialect for Rust {
    fn precision(&self) -> Precision {
        self.precision
    }

    fn constant(&self, precision: Precision, digits: Option<String>) -> String {
        digits.unwrap_or_else(|| format!("{}::INFINITY", of_width(precision)))
    }

    fn narrowed(&self, time: &str) -> String {
        format!("(({time}) as {})", of_width(self.precision))
    }

    fn function(&self, name: &str, of: &str) -> String {
        let name = if name == "fabs" { "abs" } else { name };
        format!("{}.{name}()", receiver(of))
    }

    fn power(&self, of: &str, exponent: &str) -> String {
        format!("{}.powf({exponent})", receiver(of))
    }

    fn select(&self, number: &str, yes: &str, no: &str) -> String {
        format!("if {number} > 0.0 {{ {yes} }} else {{ {no} }}")
    }

    fn clamp(&self, number: &str, low: &str, high: &str) -> String {
        format!("clamp({number}, {low}, {high})")
    }

    fn sgn(&self, of: &str) -> String {
        format!("sgn({of})")
    }

    fn input(&self, input: FormulaInput) -> String {
        match input {
            FormulaInput::Q(joint) => format!("q[{joint}]"),
            FormulaInput::Dq(joint) => format!("dq[{joint}]"),
            FormulaInput::Ddq(joint) => format!("ddq[{joint}]"),
            FormulaInput::Temperature(joint) => format!("temperature[{joint}]"),
            FormulaInput::Time => "time".into(),
            FormulaInput::Begun => "self.begun".into(),
            FormulaInput::Moving => "self.moving".into(),
            FormulaInput::HasLast => "self.has_last".into(),
            FormulaInput::Hidden(k) => format!("h{k}"),
        }
    }

    fn declare(&self, _: Precision, name: &str, value: &str) -> String {
        format!("let {name} = {value};")
    }
}

/// The file of a program.
pub(super) fn file(name: &str, program: &FormulaProgram, precision: Precision) -> String {
    let number = of_width(precision);
    let mut out = String::new();
    for line in head(program, precision) {
        out.push_str(format!("// {line}").trim_end());
        out.push('\n');
    }
    out.push_str(USAGE);
    let n = program.dof();
    let _ = writeln!(
        out,
        "/// Name of the model.\n#[allow(dead_code)]\npub const NAME: &str = \"{name}\";\n"
    );
    let _ = writeln!(out, "/// Number of joints.\npub const JOINTS: usize = {n};\n");
    if let Some(rate_hz) = program.rate_hz {
        let _ = writeln!(
            out,
            "/// Calls per second.\n#[allow(dead_code)]\npub const RATE_HZ: f64 = {rate_hz:?};\n"
        );
    }
    out.push_str(FAULT);
    out.push_str(&state(program, number));
    let _ = writeln!(out, "#[allow(dead_code, clippy::all)]\nimpl State {{");
    out.push_str(&set_up(program, number));
    out.push_str(&torque(program, precision));
    out.push_str("}\n");
    if uses(program, |node| matches!(node, Node::Sgn(_))) {
        let _ = writeln!(
            out,
            "\nfn sgn(x: {number}) -> {number} {{\n    {number}::from(i8::from(x > 0.0) - i8::from(x < 0.0))\n}}"
        );
    }
    if uses(program, |node| matches!(node, Node::Clamp(..))) {
        let _ =
            writeln!(out, "\nfn clamp(x: {number}, low: {number}, high: {number}) -> {number} {{");
        out.push_str("    if x < low { low } else if x > high { high } else { x }\n}\n");
    }
    out
}

const USAGE: &str = "//
// One state per arm and thread. Functions allocate nothing. A sample with a number that is not finite is
// refused, and the state stays as it is.

";

const FAULT: &str = "/// Why there is no torque.
#[allow(dead_code)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A number that is not finite.
    NotFinite,
    /// No temperature was set.
    NoTemperature,
}

";

fn state(program: &FormulaProgram, number: &str) -> String {
    let n = program.dof();
    let mut out = String::from(
        "/// What is carried from sample to sample.\n#[allow(dead_code)]\n#[derive(Clone, Debug)]\npub struct State {\n",
    );
    owners(program).iter().for_each(|line| {
        let _ = writeln!(out, "    // {line}");
    });
    let _ = writeln!(out, "    hidden: [{number}; {}],", program.hidden.len());
    let _ = writeln!(out, "    temperature: Option<[{number}; {n}]>,");
    out.push_str(
        "    // Time of the session: seconds, and samples since.\n    origin: f64,\n    steps: f64,\n    runs: bool,\n",
    );
    out.push_str("    // One if there was a sample; one if hidden states start in a motion.\n");
    let _ =
        writeln!(out, "    begun: {number},\n    moving: {number},\n    has_last: {number},\n}}\n");
    out.push_str(
        "impl Default for State {\n    fn default() -> Self {\n        Self::new()\n    }\n}\n\n",
    );
    out
}

fn set_up(program: &FormulaProgram, number: &str) -> String {
    format!(
        "    /// Hidden states start at rest at the next sample.
    pub fn new() -> Self {{
        Self {{
            hidden: [0.0; {}],
            temperature: None,
            origin: 0.0,
            steps: 0.0,
            runs: false,
            begun: 0.0,
            moving: 0.0,
            has_last: 0.0,
        }}
    }}

    /// Forgets all samples.
    pub fn reset(&mut self) {{
        *self = Self {{ temperature: self.temperature, ..Self::new() }};
    }}

    /// Forgets all samples: hidden states are those after a long motion at this speed to this position.
    pub fn reset_at(&mut self, q: &[{number}; JOINTS], dq: &[{number}; JOINTS]) -> Result<(), Fault> {{
        let mut next = Self {{ temperature: self.temperature, moving: 1.0, ..Self::new() }};
        next.torque(q, dq, &[0.0; JOINTS])?;
        *self = Self {{ steps: 0.0, runs: false, moving: 0.0, has_last: 0.0, ..next }};
        Ok(())
    }}

    /// Sets the time of the session at the next sample, s.
    pub fn set_time(&mut self, time: f64) -> Result<(), Fault> {{
        if !time.is_finite() {{
            return Err(Fault::NotFinite);
        }}
        (self.origin, self.steps, self.runs) = (time, 0.0, false);
        Ok(())
    }}

    /// Sets the temperature of each joint, degrees Celsius.
    pub fn set_temperature(&mut self, celsius: &[{number}; JOINTS]) -> Result<(), Fault> {{
        if celsius.iter().any(|value| !value.is_finite()) {{
            return Err(Fault::NotFinite);
        }}
        self.temperature = Some(*celsius);
        Ok(())
    }}

",
        program.hidden.len()
    )
}

fn torque(program: &FormulaProgram, precision: Precision) -> String {
    let body = body(program, &Rust { precision });
    let number = of_width(precision);
    let mut out = format!(
        "    /// Torque at the next sample from position, velocity and acceleration of each joint.
    #[allow(unused_parens)]
    pub fn torque(
        &mut self,
        q: &[{number}; JOINTS],
        dq: &[{number}; JOINTS],
        ddq: &[{number}; JOINTS],
    ) -> Result<[{number}; JOINTS], Fault> {{
        if [q, dq, ddq].into_iter().flatten().any(|value| !value.is_finite()) {{
            return Err(Fault::NotFinite);
        }}
",
    );
    if program.needs_temperature {
        out.push_str("        let temperature = self.temperature.ok_or(Fault::NoTemperature)?;\n");
    }
    out.push_str("        if self.runs {\n            self.steps += 1.0;\n        }\n        self.runs = true;\n");
    if program.starts_from(FormulaInput::Time) {
        out.push_str("        let time = self.origin + self.steps / RATE_HZ;\n");
    }
    for (index, (number, _)) in program.hidden.iter().enumerate() {
        let _ = writeln!(out, "        let h{number} = self.hidden[{index}];");
    }
    body.statements.iter().for_each(|line| {
        let _ = writeln!(out, "        {line}");
    });
    let _ = writeln!(out, "        self.hidden = [{}];", body.hidden.join(", "));
    out.push_str("        self.begun = 1.0;\n        self.has_last = 1.0;\n");
    let _ = writeln!(out, "        Ok([{}])\n    }}", body.tau.join(", "));
    out
}
