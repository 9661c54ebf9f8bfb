//! The pages of `docs/effects/` are what the registry says. `SGPR_WRITE_DOCS=1` writes them.
#![allow(missing_docs)]

use std::fmt::Write as _;
use std::path::Path;

use sgpr_core::effects::{Effect, Entry, Origin, Streamed, registry};

fn page(effect: &dyn Effect) -> String {
    let about = effect.about();
    let mut text = format!("# {}\n\n{}\n\n", effect.name(), effect.summary());
    let mut line = |name: &str, value: &str| {
        if !value.is_empty() {
            writeln!(text, "- {name}: {value}").expect("a string");
        }
    };
    let code = |text: &str| if text.is_empty() { String::new() } else { format!("`{text}`") };
    line("Torque", &code(about.formula));
    line("Class", &format!("{} ({})", about.class.letter(), about.class));
    line("Source", about.source);
    line("Signature", about.signature);
    let links = |names: &[&str]| {
        names.iter().map(|n| format!("[{n}]({n}.md)")).collect::<Vec<_>>().join(", ")
    };
    line("Looks like", &links(about.confusable));
    line("Told apart by", about.experiment);
    line("Needs", about.excitation);
    if let Some(alias) = about.alias_of {
        line(
            "Alias",
            &format!("joint data cannot tell it from {}, which stands for both", links(&[alias])),
        );
    }
    if !effect.parameters().is_empty() || !effect.constants().is_empty() {
        text += "\n| symbol | unit (rotating joint) | unit (sliding joint) | enters |\n|---|---|---|---|\n";
        for p in effect.parameters() {
            let sign = if p.non_negative { "linear, not negative" } else { "linear" };
            writeln!(text, "| {} | {} | {} | {sign} |", p.symbol, p.unit, p.sliding_unit)
                .expect("a string");
        }
        for c in effect.constants() {
            let bounds = if c.low.is_finite() {
                format!("{} to {}", c.low, c.high)
            } else {
                "a time of the logs".into()
            };
            writeln!(
                text,
                "| {} | {} | {} | constant, {bounds} |",
                c.symbol, c.unit, c.sliding_unit
            )
            .expect("a string");
        }
    }
    let how = match effect.entry() {
        Entry::State => "It is a function of the present motion of the joint.",
        Entry::Trajectory => "It is a function of the trajectory.",
        Entry::Transform => {
            "It changes robot, motion or torque, and is ranked by its tangent, applied exactly \
             once accepted."
        }
        Entry::Gate => "It is found by the checks of the log, before any physics.",
    };
    let mut streamed: String = match effect.streamed() {
        Streamed::Exactly => "one sample after the other it is the same as along a log".into(),
        Streamed::Nearly(instead) => {
            format!("one sample after the other it is nearly the same as along a log: {instead}")
        }
        Streamed::Not(reason) => format!("it is not streamed: {reason}"),
    };
    let held = match about.origin {
        Origin::Arm => "a feed-forward torque holds it",
        Origin::Measurement | Origin::Temporary => "a feed-forward torque leaves it out",
    };
    let mut text = text + "\n" + how + "\n\n";
    writeln!(
        text,
        "In a controller it is a property of {}, and {held}: {}.",
        about.origin, about.origin_reason
    )
    .expect("a string");
    if effect.entry() != Entry::Gate {
        let first = streamed.remove(0).to_uppercase().to_string();
        writeln!(text, "{first}{streamed}.").expect("a string");
    }
    text
}

#[test]
fn every_effect_has_its_page() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/effects");
    let write = std::env::var_os("SGPR_WRITE_DOCS").is_some();
    if write {
        std::fs::create_dir_all(&folder).expect("writable");
    }
    for effect in registry() {
        let path = folder.join(format!("{}.md", effect.name()));
        let expected = page(effect.as_ref());
        if write {
            std::fs::write(&path, &expected).expect("writable");
        }
        let found = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            found == expected,
            "{} is not what the registry says: SGPR_WRITE_DOCS=1 writes it",
            path.display()
        );
    }
}
