//! Episodes of LeRobot data sets: Parquet files with a list of numbers per sample, and JSON that
//! names them.
//!
//! An episode is a log of its own: `FOLDER/episode_3`, the folder of a data set of one episode, or
//! a Parquet file of one. `observation.state` is the position, `observation.velocity`,
//! `observation.effort` and `observation.current` are what they say, unless the names of the motors
//! say otherwise (`elbow.vel`); other features are channels. The time is that of the frames unless
//! the stamps differ from it.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::csv::{NamedColumn, ReadOptions, Values, read_columns};
use crate::parquet::{ParquetColumn, ParquetTable, is_list, is_plain};
use crate::{Format, Reader, Recording, RecordingError};

/// LeRobot data sets.
pub static FORMAT: Format = Format {
    name: "LeRobot",
    endings: &[],
    is_at: Some(|path| Episode::at(path).is_some()),
    begins: |_, _| false,
    read: Reader::Table(|path, options| read(path, options)),
};

/// Feature and what its numbers are, unless their names say otherwise.
const QUANTITIES: [(&str, &str); 6] = [
    ("observation.state", "position"),
    ("observation.position", "position"),
    ("observation.velocity", "velocity"),
    ("observation.effort", "torque"),
    ("observation.torque", "torque"),
    ("observation.current", "current"),
];

/// Ends of names of motors that say what the number is.
const SAYING: [&str; 8] =
    ["pos", "position", "vel", "velocity", "tau", "torque", "effort", "current"];

/// Stamps that are this near to equal steps, s, are equal steps: they are kept as numbers of 32
/// bits.
const SAME_TIME: f64 = 1e-4;

/// Largest description of a data set, bytes.
const MOST_JSON: u64 = 16 << 20;

/// Folders above a Parquet file in which its data set is looked for.
const DEEPEST: usize = 4;

/// Digits of the number of an episode.
const MOST_DIGITS: usize = 9;

/// A path in a data set.
#[derive(Debug)]
struct Episode {
    /// The folder with `meta/info.json`.
    root: PathBuf,
    /// The episode, if the path says which.
    number: Option<i64>,
    /// The file that holds it, if the path is one.
    file: Option<PathBuf>,
}

/// Reads one episode through the reader of tables. What is understood is told in the
/// [module documentation](self).
///
/// # Errors
/// If the path is no episode of a data set; as [`parquet::read`](crate::parquet::read()).
///
/// # Examples
/// ```no_run
/// use sgpr_recording::{csv::ReadOptions, lerobot};
/// let recording = lerobot::read("data_set/episode_3", &ReadOptions::default())?;
/// println!("{} joints", recording.dof());
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Recording, RecordingError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let invalid = |cause: String| RecordingError::NoLog { path: name.clone(), cause };
    let found = Episode::at(path)
        .ok_or_else(|| invalid("no episode of a LeRobot data set (meta/info.json)".into()))?;
    let info = found.info()?;
    let (rows, skipped) = found.rows(&name, options.limit_bytes)?;
    let mut columns = Vec::new();
    if options.sample_rate_hz.is_none() {
        let values = Values::Numbers(time(&name, &rows, &info)?.into());
        columns.push(NamedColumn { name: "timestamp_s".into(), values });
    }
    for values in rows.iter().filter(|feature| feature.is_list) {
        for (k, joint) in names(&info, &values.name, values.width).iter().enumerate() {
            let own = values.numbers.iter().skip(k).step_by(values.width).copied().collect();
            columns.push(NamedColumn {
                name: called(&values.name, joint),
                values: Values::Numbers(own),
            });
        }
    }
    let recording = read_columns(&name, &columns, options)?;
    Ok(if skipped.is_empty() {
        recording
    } else {
        recording.with_note(format!(
            "skipped columns that hold no rows of numbers: {}",
            skipped.join(", ")
        ))
    })
}

/// The numbers of one feature in the rows of an episode.
struct Feature {
    name: String,
    is_list: bool,
    /// Numbers per row.
    width: usize,
    numbers: Vec<f64>,
}

impl Episode {
    /// What a path is in a data set: its folder, an episode, or a Parquet file of it; `None`
    /// elsewhere.
    fn at(path: &Path) -> Option<Self> {
        let is_root = |folder: &Path| folder.join("meta").join("info.json").is_file();
        if is_root(path) {
            return Some(Self { root: path.into(), number: None, file: None });
        }
        let digits = path.file_name()?.to_str()?.strip_prefix("episode_");
        let number = digits
            .filter(|digits| digits.len() <= MOST_DIGITS)
            .filter(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()))
            .and_then(|digits| digits.parse().ok());
        let parent = path.parent().unwrap_or(Path::new(""));
        if number.is_some() && !path.exists() && is_root(parent) {
            return Some(Self { root: parent.into(), number, file: None });
        }
        if path.extension()? != "parquet" || !path.is_file() {
            return None;
        }
        let whole = path.canonicalize().ok()?;
        let root = whole.ancestors().skip(1).take(DEEPEST).find(|folder| is_root(folder))?;
        Some(Self { root: root.into(), number: None, file: Some(path.into()) })
    }

    /// The description of the data set.
    fn info(&self) -> Result<Value, RecordingError> {
        let place = self.root.join("meta").join("info.json");
        let path = place.display().to_string();
        let invalid = |cause: String| RecordingError::NoLog { path: path.clone(), cause };
        let unreadable = |source| RecordingError::Unreadable { path: path.clone(), source };
        let mut text = Vec::new();
        let file = File::open(&place).map_err(unreadable)?;
        file.take(MOST_JSON + 1).read_to_end(&mut text).map_err(unreadable)?;
        if text.len() as u64 > MOST_JSON {
            return Err(invalid("larger than any description of a data set".into()));
        }
        let info: Value =
            serde_json::from_slice(&text).map_err(|error| invalid(format!("not JSON: {error}")))?;
        let features = info.get("features");
        if !info.is_object() || features.is_some_and(|features| !features.is_object()) {
            return Err(invalid("expected `features`, one entry for each column".into()));
        }
        Ok(info)
    }

    /// The numbers of one episode by feature, in the order of the file, and what was skipped.
    fn rows(&self, path: &str, limit: u64) -> Result<(Vec<Feature>, Vec<String>), RecordingError> {
        let mut places: BTreeMap<i64, PathBuf> = BTreeMap::new();
        for file in self.files()? {
            for number in episodes(&file, limit)? {
                places.insert(number, file.clone());
            }
            if self.number.is_some_and(|number| places.contains_key(&number)) {
                break;
            }
        }
        let number = self.chosen(path, &places)?;
        let table = ParquetTable::open(&places[&number], |kind| is_list(kind) || is_plain(kind))?;
        let skipped = table.skipped();
        let columns = table.columns(limit)?;
        let rows: Option<Vec<usize>> =
            columns.iter().find(|column| column.name() == EPISODE).map(|column| {
                (0..column.rows()).filter(|row| column.integer(*row) == Some(number)).collect()
            });
        let feature = |column: ParquetColumn| {
            let (name, is_list) = (column.name().to_string(), column.is_list());
            let (width, mut numbers) = column.into_rows(path)?;
            if let Some(rows) = &rows {
                let of_row = |row: &usize| &numbers[row * width..(row + 1) * width];
                numbers = rows.iter().flat_map(of_row).copied().collect();
            }
            Ok(Feature { name, is_list, width, numbers })
        };
        Ok((columns.into_iter().map(feature).collect::<Result<_, _>>()?, skipped))
    }

    /// Files that may hold the episode, the likeliest first.
    fn files(&self) -> Result<Vec<PathBuf>, RecordingError> {
        if let Some(file) = &self.file {
            return Ok(vec![file.clone()]);
        }
        let folder = self.root.join("data");
        let mut files = Vec::new();
        if folder.is_dir() {
            collect(&folder, &mut files).map_err(|source| RecordingError::Unreadable {
                path: folder.display().to_string(),
                source,
            })?;
        }
        files.sort();
        if let Some(number) = self.number {
            let own = format!("episode_{number:06}");
            files.sort_by_key(|file| file.file_stem().is_none_or(|stem| stem != own.as_str()));
        }
        Ok(files)
    }

    /// The episode that the path means.
    fn chosen(&self, path: &str, places: &BTreeMap<i64, PathBuf>) -> Result<i64, RecordingError> {
        let invalid = |cause| Err(RecordingError::NoLog { path: path.into(), cause });
        let ends = places.keys().next().zip(places.keys().next_back());
        let Some((first, last)) = ends else {
            let cause = "a LeRobot data set without Parquet files in its folder `data`";
            return invalid(cause.into());
        };
        let what = match self.number {
            Some(number) if places.contains_key(&number) => return Ok(number),
            Some(number) => format!("there is no episode {number}"),
            None if places.len() == 1 => return Ok(*first),
            None => format!("{} episodes", places.len()),
        };
        let place = |number| self.root.join(format!("episode_{number}")).display().to_string();
        let (first, last) = (place(first), place(last));
        invalid(format!("{what}; each is a log of its own, from {first} to {last}"))
    }
}

/// The column that tells the episode of a row.
const EPISODE: &str = "episode_index";

/// Parquet files of a folder and those in it; links to folders are not followed.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let path = entry.path();
        if entry.file_type()?.is_dir() {
            collect(&path, files)?;
        } else if path.extension().is_some_and(|ending| ending == "parquet") {
            files.push(path);
        }
    }
    Ok(())
}

/// The episodes of a file, by their column or by its name.
fn episodes(file: &Path, limit: u64) -> Result<Vec<i64>, RecordingError> {
    let table = ParquetTable::open(file, is_plain)?.only(EPISODE);
    let Some(column) = table.columns(limit)?.pop() else {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let digits = stem.len() - stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
        return Ok(vec![stem[stem.len() - digits..].parse().unwrap_or(0)]);
    };
    let mut numbers: Vec<i64> = (0..column.rows()).filter_map(|row| column.integer(row)).collect();
    numbers.sort_unstable();
    numbers.dedup();
    Ok(numbers)
}

/// s
fn time(path: &str, rows: &[Feature], info: &Value) -> Result<Vec<f64>, RecordingError> {
    let feature = |name: &str| rows.iter().find(|feature| feature.name == name);
    let rate = info.get("fps").and_then(Value::as_f64).filter(|rate| *rate > 0.0);
    let frames = feature("frame_index").filter(|frames| !frames.is_list);
    let even: Option<Vec<f64>> = frames
        .zip(rate)
        .map(|(frames, rate)| frames.numbers.iter().map(|frame| frame / rate).collect());
    let stamps = feature("timestamp").filter(|stamps| stamps.width > 0);
    let stamps: Option<Vec<f64>> =
        stamps.map(|stamps| stamps.numbers.iter().step_by(stamps.width).copied().collect());
    match (stamps, even) {
        (Some(stamps), Some(even)) => {
            let start = stamps.first().zip(even.first()).map_or(0.0, |(own, even)| own - even);
            let differ =
                stamps.iter().zip(&even).any(|(own, even)| (own - even - start).abs() > SAME_TIME);
            Ok(if differ { stamps } else { even })
        }
        (Some(time), None) | (None, Some(time)) => Ok(time),
        (None, None) => Err(RecordingError::NoLog {
            path: path.into(),
            cause: "neither `timestamp` nor `frame_index` with `fps`; give `sample_rate_hz`".into(),
        }),
    }
}

/// The names of the numbers of a feature: a list, the only list in a table, or a table that numbers
/// them; else numbers.
fn names(info: &Value, feature: &str, count: usize) -> Vec<String> {
    let found = info.get("features").and_then(|features| features.get(feature));
    let texts = |values: &[Value]| -> Option<Vec<String>> {
        values.iter().map(|value| value.as_str().map(str::to_string)).collect()
    };
    let names = match found.and_then(|found| found.get("names")) {
        Some(Value::Array(names)) => texts(names),
        Some(Value::Object(table)) if table.len() == 1 => {
            table.values().next().and_then(Value::as_array).and_then(|names| texts(names))
        }
        Some(Value::Object(table)) => in_order(table),
        _ => None,
    };
    match names.filter(|names| names.len() == count) {
        Some(names) if (1..count).all(|k| !names[..k].contains(&names[k])) => names,
        Some(names) => {
            names.iter().enumerate().map(|(k, name)| format!("{name} {}", k + 1)).collect()
        }
        None => (1..=count).map(|number| number.to_string()).collect(),
    }
}

/// The names of a table that numbers them from 0.
fn in_order(table: &serde_json::Map<String, Value>) -> Option<Vec<String>> {
    let mut numbered: Vec<(u64, &String)> =
        table.iter().map(|(name, number)| Some((number.as_u64()?, name))).collect::<Option<_>>()?;
    numbered.sort_unstable();
    let counts = numbered.iter().map(|(number, _)| *number).eq(0..numbered.len() as u64);
    counts.then(|| numbered.into_iter().map(|(_, name)| name.clone()).collect())
}

/// What a table would call it: `shoulder_pan.pos` as it is, `shoulder_pan` with what the feature
/// holds.
fn called(feature: &str, name: &str) -> String {
    let Some((_, quantity)) = QUANTITIES.iter().find(|(known, _)| *known == feature) else {
        return format!("{feature} command {name}");
    };
    let says = SAYING
        .iter()
        .any(|word| name.strip_suffix(word).is_some_and(|rest| rest.ends_with(['.', '_', '/'])));
    if says { name.to_string() } else { format!("{name}_{quantity}") }
}
