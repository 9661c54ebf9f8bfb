use std::io::{self, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::{Recording, RecordingError, write_file};

/// Writes a recording as a table, packed if `path` ends in `.gz`. An existing file is replaced only
/// by the whole new one.
///
/// Columns: `t_s` (s, with all nanoseconds), `NAME_position`, `NAME_velocity`, `NAME_torque` for
/// each joint in SI units, then the channels. [`read`](super::read()) with the same joints gives
/// the recording back; channels keep their meaning if their names do not look like joints.
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: impl AsRef<Path>, recording: &Recording) -> Result<(), RecordingError> {
    let path = path.as_ref();
    write_file(path, |file| {
        if path.extension().is_some_and(|extension| extension == "gz") {
            let mut packed = GzEncoder::new(file, Compression::default());
            write_rows(&mut packed, recording)?;
            packed.finish().map(drop)
        } else {
            write_rows(file, recording)
        }
    })
}

fn write_rows(file: impl Write, recording: &Recording) -> io::Result<()> {
    let mut table = csv::Writer::from_writer(file);
    let arrays: Vec<(&str, &[f64])> = [
        ("position", Some(recording.position())),
        ("velocity", recording.velocity()),
        ("torque", recording.torque()),
    ]
    .into_iter()
    .filter_map(|(name, values)| Some((name, values?)))
    .collect();

    table.write_field("t_s")?;
    for (quantity, _) in &arrays {
        for joint in recording.joint_names() {
            table.write_field(format!("{joint}_{quantity}"))?;
        }
    }
    for channel in recording.channels() {
        table.write_field(&channel.name)?;
    }
    table.write_record(None::<&[u8]>)?;

    let n = recording.dof();
    for (sample, &time) in recording.time().iter().enumerate() {
        table.write_field(seconds(time))?;
        for (_, values) in &arrays {
            for value in &values[sample * n..(sample + 1) * n] {
                table.write_field(value.to_string())?;
            }
        }
        for channel in recording.channels() {
            table.write_field(channel.values[sample].to_string())?;
        }
        table.write_record(None::<&[u8]>)?;
    }
    table.flush()
}

/// Nanoseconds as seconds in decimal, exact.
fn seconds(nanoseconds: i64) -> String {
    let sign = if nanoseconds < 0 { "-" } else { "" };
    let magnitude = nanoseconds.unsigned_abs();
    let text = format!("{sign}{}.{:09}", magnitude / 1_000_000_000, magnitude % 1_000_000_000);
    text.trim_end_matches('0').trim_end_matches('.').to_string()
}

#[cfg(test)]
mod tests {
    use super::seconds;

    #[test]
    fn nanoseconds_are_written_exactly() {
        assert_eq!(seconds(60_004_000_000), "60.004");
        assert_eq!(seconds(-1), "-0.000000001");
        assert_eq!(seconds(0), "0");
        assert_eq!(seconds(100_000_000_000), "100");
        assert_eq!(seconds(i64::MIN), "-9223372036.854775808");
    }
}
