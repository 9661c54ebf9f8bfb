//! Data that are not part of the repository.

use std::io::Write;
use std::path::PathBuf;

/// The folder `name` below the one that `SGPR_DATA` names, which holds `real` and `hidden_effects`;
/// for `real/...` that may be the folder of the robots itself. Nothing outside of the repository is
/// read without it.
///
/// - returns none, with a word about it that is seen though the test passes, where the folder is
///   not
pub fn outside(name: &str) -> Option<PathBuf> {
    let skipped = |why: String| {
        let test = std::thread::current().name().unwrap_or("a test").to_string();
        // Past what the test harness keeps to itself.
        let _ = writeln!(std::io::stderr(), "\nskipped: {test}: {why}");
        None
    };
    let Some(folder) =
        std::env::var_os("SGPR_DATA").filter(|value| !value.is_empty()).map(PathBuf::from)
    else {
        return skipped(format!("SGPR_DATA does not name the folder that holds {name}"));
    };
    let places = [folder.join(name), folder.join(name.strip_prefix("real/").unwrap_or(name))];
    match places.into_iter().find(|place| place.is_dir()) {
        Some(place) => Some(place),
        None => skipped(format!("there is no {name} in {}", folder.display())),
    }
}
