//! Writes the models of `exported.cpp` as C: `peer_export FOLDER`.

use sgpr_benches::{Fixture, findings, model};
use sgpr_core::export::{ExportOptions, Language};
use sgpr_core::model::TorqueModel;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("which folder?")?;
    let fixture = Fixture::new("panda_like", 1);
    let models = [
        (
            "rigid",
            TorqueModel::with_parameters(
                &fixture.robot,
                &[] as &[&str],
                fixture.robot.standard_parameters(),
            )?,
        ),
        ("found", model(&fixture).with_terms(findings(), Some(0))),
    ];
    for (name, model) in models {
        let mut options = ExportOptions::new(Language::C).with_name(Some(name.into()));
        options.stream.rate_hz = Some(1000.0);
        options.stream.keep = vec![];
        model.export_to(format!("{folder}/{name}.h"), &options)?;
    }
    Ok(())
}
