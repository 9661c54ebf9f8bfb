//! Models in C99.

use std::fmt::Write;

use super::printer::{Dialect, body, head, owners, uses};
use super::program::{FormulaInput, FormulaProgram};
use sgpr_predict::internal::Node;

use crate::gp::Precision;

/// `prefix`: what the names of the file begin with.
struct C<'a> {
    prefix: &'a str,
    precision: Precision,
}

/// How numbers of a width are written.
struct Width {
    /// The type.
    number: &'static str,
    /// Of constants and functions.
    suffix: &'static str,
    largest: &'static str,
    infinity: &'static str,
}

fn of_width(precision: Precision) -> Width {
    match precision {
        Precision::Double => Width {
            number: "double",
            suffix: "",
            largest: "1.7976931348623157e308",
            infinity: "HUGE_VAL",
        },
        Precision::Single => {
            Width { number: "float", suffix: "f", largest: "3.4028235e38f", infinity: "INFINITY" }
        }
    }
}

impl Dialect for C<'_> {
    fn precision(&self) -> Precision {
        self.precision
    }

    fn constant(&self, precision: Precision, digits: Option<String>) -> String {
        let width = of_width(precision);
        digits.map_or_else(|| width.infinity.into(), |digits| digits + width.suffix)
    }

    fn narrowed(&self, time: &str) -> String {
        format!("({})({time})", of_width(self.precision).number)
    }

    fn function(&self, name: &str, of: &str) -> String {
        format!("{name}{}({of})", of_width(self.precision).suffix)
    }

    fn power(&self, of: &str, exponent: &str) -> String {
        self.function("pow", &format!("{of}, {exponent}"))
    }

    fn select(&self, number: &str, yes: &str, no: &str) -> String {
        format!("{number} > 0.0{} ? {yes} : {no}", of_width(self.precision).suffix)
    }

    fn clamp(&self, number: &str, low: &str, high: &str) -> String {
        format!("{}_clamp({number}, {low}, {high})", self.prefix)
    }

    fn sgn(&self, of: &str) -> String {
        format!("{}_sgn({of})", self.prefix)
    }

    fn input(&self, input: FormulaInput) -> String {
        match input {
            FormulaInput::Q(joint) => format!("q[{joint}]"),
            FormulaInput::Dq(joint) => format!("dq[{joint}]"),
            FormulaInput::Ddq(joint) => format!("ddq[{joint}]"),
            FormulaInput::Temperature(joint) => format!("state->temperature[{joint}]"),
            FormulaInput::Time => "time".into(),
            FormulaInput::Begun => "state->begun".into(),
            FormulaInput::Moving => "state->moving".into(),
            FormulaInput::HasLast => "state->has_last".into(),
            FormulaInput::Hidden(k) => format!("h{k}"),
        }
    }

    fn declare(&self, precision: Precision, name: &str, value: &str) -> String {
        format!("const {} {name} = {value};", of_width(precision).number)
    }
}

/// The file of a program.
pub(super) fn file(name: &str, program: &FormulaProgram, precision: Precision) -> String {
    let width = of_width(precision);
    let prefix = format!("sgpr_{name}");
    let capital = prefix.to_uppercase();
    let mut out = String::from("/*\n");
    for line in head(program, precision) {
        out.push_str(format!(" * {line}").trim_end());
        out.push('\n');
    }
    out.push_str(USAGE);
    let n = program.dof();
    let _ = write!(
        out,
        "#ifndef {capital}_H\n#define {capital}_H\n\n#include <math.h>\n\n#define {capital}_JOINTS {n}\n"
    );
    if let Some(rate_hz) = program.rate_hz {
        let _ = writeln!(out, "#define {capital}_RATE_HZ {rate_hz:?}");
    }
    let _ = writeln!(
        out,
        "\n/* What functions return. */\n#define {capital}_OK 0\n#define {capital}_NOT_FINITE 1\n\
         #define {capital}_NO_TEMPERATURE 2\n"
    );
    out.push_str(&state(program, &prefix, &width));
    out.push_str(&helpers(program, &prefix, &width));
    out.push_str(&set_up(program, &prefix, &capital, &width));
    out.push_str(&torque(program, &prefix, &capital, precision));
    out.push_str(&reset_at(program, &prefix, &capital, &width));
    let _ = writeln!(out, "#endif /* {capital}_H */");
    out
}

const USAGE: &str = " *
 * Include the file where it is used; it needs the C standard library's mathematics. One state per arm and
 * thread: _reset it once, then call _torque for every sample. Functions allocate nothing and have no loop
 * of unknown length. A sample with a number that is not finite is refused: torque and state stay as they
 * are.
 */
";

fn state(program: &FormulaProgram, prefix: &str, width: &Width) -> String {
    let Width { number, .. } = width;
    let n = program.dof();
    let mut out = String::from("typedef struct {\n");
    let owners = owners(program);
    if !owners.is_empty() {
        out.push_str("    /* Carried from sample to sample:\n");
        owners.iter().for_each(|line| {
            let _ = writeln!(out, "     *   {line}");
        });
        let _ = writeln!(out, "     */\n    {number} hidden[{}];", program.hidden.len());
    }
    if program.needs_temperature {
        let _ = writeln!(
            out,
            "    /* Of each joint, degrees Celsius. */\n    {number} temperature[{n}];"
        );
        out.push_str("    int has_temperature;\n");
    }
    if program.starts_from(FormulaInput::Time) {
        out.push_str(
            "    /* Time of the session: seconds, and samples since. */\n    double origin;\n    double steps;\n",
        );
        out.push_str("    int runs;\n");
    }
    if program.starts_from(FormulaInput::HasLast) {
        let _ = writeln!(out, "    {number} has_last;");
    }
    let _ = writeln!(
        out,
        "    /* One if there was a sample; one if hidden states start in a motion. */\n    {number} begun;\n    \
         {number} moving;\n}} {prefix}_state;\n"
    );
    out
}

fn helpers(program: &FormulaProgram, prefix: &str, width: &Width) -> String {
    let Width { number, suffix, largest, .. } = width;
    let mut out = format!(
        "static inline int {prefix}_finite(const {number} *values)\n{{\n    int joint, finite = 1;\n    \
         for (joint = 0; joint < {n}; ++joint) {{\n        \
         if (!(fabs{suffix}(values[joint]) <= {largest})) {{\n            finite = 0;\n        }}\n    }}\n    \
         return finite;\n}}\n\n",
        n = program.dof()
    );
    if uses(program, |node| matches!(node, Node::Sgn(_))) {
        let _ = writeln!(
            out,
            "static inline {number} {prefix}_sgn({number} x)\n{{\n    \
             return ({number})((x > 0.0{suffix}) - (x < 0.0{suffix}));\n}}\n"
        );
    }
    if uses(program, |node| matches!(node, Node::Clamp(..))) {
        let _ = writeln!(
            out,
            "static inline {number} {prefix}_clamp({number} x, {number} low, {number} high)\n{{\n    \
             return x < low ? low : (x > high ? high : x);\n}}\n"
        );
    }
    out
}

fn set_up(program: &FormulaProgram, prefix: &str, capital: &str, width: &Width) -> String {
    let Width { number, suffix, .. } = width;
    let n = program.dof();
    let timed = program.starts_from(FormulaInput::Time);
    let mut out = format!(
        "/* Forgets all samples: hidden states start at rest at the next one. Call it before anything else. */\n\
         static inline void {prefix}_reset({prefix}_state *state)\n{{\n"
    );
    if !program.hidden.is_empty() {
        let _ = writeln!(
            out,
            "    int index;\n    for (index = 0; index < {}; ++index) {{\n        state->hidden[index] = 0.0{suffix};\n    }}",
            program.hidden.len()
        );
    }
    if timed {
        out.push_str("    state->origin = 0.0;\n    state->steps = 0.0;\n    state->runs = 0;\n");
    }
    if program.needs_temperature {
        out.push_str("    state->has_temperature = 0;\n");
    }
    if program.starts_from(FormulaInput::HasLast) {
        let _ = writeln!(out, "    state->has_last = 0.0{suffix};");
    }
    let _ =
        writeln!(out, "    state->begun = 0.0{suffix};\n    state->moving = 0.0{suffix};\n}}\n");
    if timed {
        let _ = writeln!(
            out,
            "/* Sets the time of the session at the next sample, s. */\n\
             static inline int {prefix}_set_time({prefix}_state *state, double time)\n{{\n    \
             if (!(fabs(time) <= 1.7976931348623157e308)) {{\n        return {capital}_NOT_FINITE;\n    }}\n    \
             state->origin = time;\n    state->steps = 0.0;\n    state->runs = 0;\n    return {capital}_OK;\n}}\n"
        );
    }
    if program.needs_temperature {
        let _ = writeln!(
            out,
            "/* Sets the temperature of each joint, degrees Celsius. */\n\
             static inline int {prefix}_set_temperature({prefix}_state *state, const {number} celsius[{n}])\n{{\n    \
             int joint;\n    if (!{prefix}_finite(celsius)) {{\n        return {capital}_NOT_FINITE;\n    }}\n    \
             for (joint = 0; joint < {n}; ++joint) {{\n        state->temperature[joint] = celsius[joint];\n    }}\n    \
             state->has_temperature = 1;\n    return {capital}_OK;\n}}\n"
        );
    }
    out
}

fn torque(program: &FormulaProgram, prefix: &str, capital: &str, precision: Precision) -> String {
    let Width { number, suffix, .. } = of_width(precision);
    let n = program.dof();
    let body = body(program, &C { prefix, precision });
    let mut out = format!(
        "/* Torque at the next sample from position, velocity and acceleration of each joint. */\n\
         static inline int {prefix}_torque({prefix}_state *state, const {number} q[{n}], const {number} dq[{n}],\n    \
         const {number} ddq[{n}], {number} tau[{n}])\n{{\n"
    );
    let times = if program.starts_from(FormulaInput::Time) { "    double time;\n" } else { "" };
    let _ = writeln!(
        out,
        "{times}    if (!({prefix}_finite(q) && {prefix}_finite(dq) && {prefix}_finite(ddq))) {{\n        \
         return {capital}_NOT_FINITE;\n    }}"
    );
    if program.needs_temperature {
        let _ = writeln!(
            out,
            "    if (!state->has_temperature) {{\n        return {capital}_NO_TEMPERATURE;\n    }}"
        );
    }
    if !times.is_empty() {
        let _ = writeln!(
            out,
            "    if (state->runs) {{\n        state->steps += 1.0;\n    }}\n    state->runs = 1;\n    \
             time = state->origin + state->steps / {capital}_RATE_HZ;"
        );
    }
    out.push_str("    {\n");
    for (index, (place, _)) in program.hidden.iter().enumerate() {
        let _ = writeln!(out, "    const {number} h{place} = state->hidden[{index}];");
    }
    body.statements.iter().for_each(|line| {
        let _ = writeln!(out, "    {line}");
    });
    body.hidden.iter().enumerate().for_each(|(index, value)| {
        let _ = writeln!(out, "    state->hidden[{index}] = {value};");
    });
    body.tau.iter().enumerate().for_each(|(joint, value)| {
        let _ = writeln!(out, "    tau[{joint}] = {value};");
    });
    out.push_str("    }\n");
    if program.starts_from(FormulaInput::HasLast) {
        let _ = writeln!(out, "    state->has_last = 1.0{suffix};");
    }
    let _ = writeln!(out, "    state->begun = 1.0{suffix};\n    return {capital}_OK;\n}}\n");
    out
}

fn reset_at(program: &FormulaProgram, prefix: &str, capital: &str, width: &Width) -> String {
    let Width { number, suffix, .. } = width;
    let n = program.dof();
    let mut out = format!(
        "/* Forgets all samples: hidden states are those after a long motion at this speed to this position. */\n\
         static inline int {prefix}_reset_at({prefix}_state *state, const {number} q[{n}], const {number} dq[{n}])\n{{\n    \
         const {prefix}_state before = *state;\n    const {number} at_rest[{n}] = {{ 0.0{suffix} }};\n    {number} tau[{n}];\n    \
         int code;\n    {prefix}_reset(state);\n"
    );
    if program.needs_temperature {
        let _ = writeln!(
            out,
            "    for (code = 0; code < {n}; ++code) {{\n        state->temperature[code] = before.temperature[code];\n    \
             }}\n    state->has_temperature = before.has_temperature;"
        );
    }
    let _ = writeln!(
        out,
        "    state->moving = 1.0{suffix};\n    code = {prefix}_torque(state, q, dq, at_rest, tau);\n    \
         if (code != {capital}_OK) {{\n        *state = before;\n        return code;\n    }}"
    );
    if program.starts_from(FormulaInput::Time) {
        out.push_str("    state->steps = 0.0;\n    state->runs = 0;\n");
    }
    if program.starts_from(FormulaInput::HasLast) {
        let _ = writeln!(out, "    state->has_last = 0.0{suffix};");
    }
    let _ = writeln!(out, "    state->moving = 0.0{suffix};\n    return {capital}_OK;\n}}\n");
    out
}
