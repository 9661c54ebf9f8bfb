//! Arrays by name, as NumPy archives, MATLAB and HDF5 files hold them: a time, and a column per
//! joint.
//!
//! | array | names | shape |
//! |---|---|---|
//! | time | `t`, `time`, `time_ns` | `(N,)` |
//! | position | `q`, `position`, `qpos` | `(N, n)` |
//! | velocity | `dq`, `velocity`, `qvel` | `(N, n)` |
//! | torque | `tau`, `torque`, `effort` | `(N, n)` |
//! | names of the joints | `joint_names` | `(n,)` |
//!
//! Other names that say the quantity and nothing else are understood, with or without a unit:
//! `q_deg`, `qd [rpm]`. Arrays that lie on their side are turned, those of one joint may be
//! vectors. Whole numbers as time are ns if no unit is told, times of 64 bits are exact. Vectors of
//! one number per sample become channels. [`ReadOptions::columns`] names arrays here: a
//! [`Columns::Pattern`] without braces is one.
//!
//! MATLAB and HDF5 files have structures and groups: `run.q` is called `q` where no other array is.
//! Where none of their arrays has a column per joint, vectors are read as the columns of a table.

#[cfg(any(feature = "hdf5", feature = "numpy"))]
mod bytes;
#[cfg(feature = "hdf5")]
mod found;
#[cfg(feature = "hdf5")]
pub mod hdf5;
mod held;
#[cfg(feature = "matlab")]
pub mod matlab;
#[cfg(feature = "numpy")]
pub mod numpy;

use crate::csv::{ColumnMap, Columns, NamedColumn, ReadOptions, quantity_of_array};
use crate::names::counted;
use crate::{Layout, Recording, RecordingError};

pub(crate) use held::{ArrayContent, NamedArray};

/// Quantities and the names of their arrays that go before others.
const QUANTITIES: [(&str, &[&str]); 4] = [
    ("time", &["t", "time", "time_ns"]),
    ("position", &["q", "position", "qpos"]),
    ("velocity", &["dq", "velocity", "qvel"]),
    ("torque", &["tau", "torque", "effort"]),
];
const TIME: usize = 0;
const POSITION: usize = 1;

const JOINT_NAMES: &str = "joint_names";

/// Most arrays of a file that are listed in a message.
const LISTED: usize = 40;

/// The arrays of a file, and what is asked for.
struct FileArrays<'a> {
    path: &'a str,
    arrays: Vec<NamedArray>,
    options: &'a ReadOptions,
}

/// A recording of a time, positions and, if logged, velocities, torques and names of joints.
pub(crate) fn recording_of(
    path: &str,
    arrays: Vec<NamedArray>,
    options: &ReadOptions,
) -> Result<Recording, RecordingError> {
    let mut arrays = FileArrays { path, arrays, options };
    let roles = arrays.roles()?;
    arrays.require(&roles)?;
    let samples = arrays.samples(&roles);
    arrays.set_upright(&roles, samples)?;
    let joints = arrays.joints(&roles)?;
    arrays.recording(&roles, joints)
}

/// The same, or a recording of vectors with one value per sample, named as columns of tables, where
/// no array has a column per joint. Names are without the structures or groups around them where no
/// other array is then called the same.
#[cfg(any(feature = "hdf5", feature = "matlab", feature = "parquet"))]
pub(crate) fn recording_of_vectors(
    path: &str,
    arrays: Vec<NamedArray>,
    options: &ReadOptions,
) -> Result<Recording, RecordingError> {
    // A number alone is a setting.
    let arrays = FileArrays {
        path,
        arrays: held::with_short_names(
            arrays.into_iter().filter(|array| array.len() > 1 || array.is_text()).collect(),
        ),
        options,
    };
    let roles = arrays.roles()?;
    if let Some(position) = roles[POSITION] {
        let counted = options.sample_rate_hz.is_some() || roles[TIME].is_some();
        if arrays.arrays[position].shape.len() == 2 || counted {
            return recording_of(path, arrays.arrays, options);
        }
    }
    let FileArrays { arrays, .. } = arrays;
    let vectors = || arrays.iter().filter(|array| array.is_number() && array.shape.len() == 1);
    let count = |length: usize| vectors().filter(|array| array.len() == length).count();
    // The first of the commonest lengths.
    let samples =
        vectors().map(NamedArray::len).rev().max_by_key(|length| count(*length)).unwrap_or(0);
    let tables = arrays.iter().filter(|array| array.is_number() && array.shape.len() == 2);
    let longest = tables.filter_map(|array| array.shape.iter().max()).max();
    // Vectors beside longer tables are settings: one value per joint, not per sample.
    if samples < longest.copied().unwrap_or(0).max(2) {
        return Err(invalid(
            path,
            format!(
                "no time and positions among the arrays {}: name them `t` and `q`, or say which \
                 they are with `columns.time` and `columns.position`",
                listed(&arrays)
            ),
        ));
    }
    let columns: Vec<NamedColumn<'static>> = arrays
        .into_iter()
        .filter(|array| array.is_number() && array.shape == [samples])
        .filter_map(NamedArray::into_column)
        .collect();
    crate::csv::read_columns(path, &columns, options)
}

fn invalid(path: &str, cause: String) -> RecordingError {
    RecordingError::NoLog { path: path.into(), cause }
}

/// Arrays with their shapes, the largest first.
fn listed(arrays: &[NamedArray]) -> String {
    let mut by_size: Vec<&NamedArray> = arrays.iter().collect();
    by_size.sort_by_key(|array| std::cmp::Reverse(array.len()));
    let shown: Vec<String> = by_size
        .iter()
        .take(LISTED)
        .map(|array| format!("`{}` {}", array.name, array.shape_text()))
        .collect();
    if shown.is_empty() { "none".into() } else { shown.join(", ") }
}

/// What messages call a column of an array; it ends like the array, whose name may end in a unit.
fn called(name: &str, k: usize) -> String {
    format!("{} of {name}", k + 1)
}

impl FileArrays<'_> {
    /// What the caller calls the array of a quantity: a name, or what is none.
    fn named(&self, quantity: usize) -> Option<Result<&str, String>> {
        let ColumnMap { time, position, velocity, torque } = &self.options.columns;
        let columns = match quantity {
            TIME => return time.as_deref().map(Ok),
            POSITION => position,
            2 => velocity,
            _ => torque,
        };
        Some(match columns.as_ref()? {
            Columns::Pattern(name) => Ok(name),
            Columns::Names(names) => Err(names.join(", ")),
        })
    }

    /// The array of each quantity: the one that the caller names, else one whose name says so.
    fn roles(&self) -> Result<[Option<usize>; 4], RecordingError> {
        let mut roles = [None; 4];
        for (quantity, (what, names)) in QUANTITIES.into_iter().enumerate() {
            roles[quantity] = match self.named(quantity) {
                Some(Ok(name)) => self.place(name),
                Some(Err(_)) => None,
                None => self.by_name(what, names)?,
            };
        }
        Ok(roles)
    }

    fn by_name(&self, what: &str, names: &[&str]) -> Result<Option<usize>, RecordingError> {
        let place = |name: &&str| self.arrays.iter().position(|array| array.name == *name);
        let exact: Vec<usize> = names.iter().filter_map(place).collect();
        if exact.len() > 1 {
            let names: Vec<&str> = exact.iter().map(|k| self.arrays[*k].name.as_str()).collect();
            let cause = format!("the arrays {} mean the same: leave one", names.join(" and "));
            return Err(invalid(self.path, cause));
        }
        // A unit that is not known is told when the numbers are read.
        let says_so = |array: &NamedArray| {
            let own = array.name.split(" [").next().unwrap_or_default();
            quantity_of_array(own) == Some(what)
        };
        let mut stated = (0..self.arrays.len()).filter(|k| says_so(&self.arrays[*k]));
        Ok(match (exact.first(), stated.next(), stated.next()) {
            (Some(place), ..) => Some(*place),
            (None, only, None) => only,
            _ => None,
        })
    }

    /// An array by its name, with or without the unit.
    fn place(&self, name: &str) -> Option<usize> {
        let with_unit = format!("{name} [");
        self.arrays
            .iter()
            .position(|array| array.name == name || array.name.starts_with(&with_unit))
    }

    /// Refuses names of arrays that are not there, and arrays without time or positions.
    fn require(&self, roles: &[Option<usize>; 4]) -> Result<(), RecordingError> {
        let found = || listed(&self.arrays);
        let missing = || (0..QUANTITIES.len()).filter(|quantity| roles[*quantity].is_none());
        for quantity in missing() {
            let Some(given) = self.named(quantity) else { continue };
            let name = given.map_or_else(|names| names, str::to_string);
            let cause = format!(
                "there is no array `{name}` for {}; the arrays are {}",
                QUANTITIES[quantity].0,
                found()
            );
            return Err(invalid(self.path, cause));
        }
        for quantity in missing().take_while(|quantity| *quantity <= POSITION) {
            let is_time = quantity == TIME;
            if is_time && self.options.sample_rate_hz.is_some() {
                continue;
            }
            let (what, names) = QUANTITIES[quantity];
            let names: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
            let (shape, more) =
                if is_time { ("(N,)", ", or give `sample_rate_hz`") } else { ("(N, n)", "") };
            let cause = format!(
                "no array {} of shape {shape}; the arrays are {}: name it with \
                 `columns.{what}`{more}",
                names.join(" or "),
                found()
            );
            return Err(invalid(self.path, cause));
        }
        Ok(())
    }

    fn samples(&self, roles: &[Option<usize>; 4]) -> usize {
        let longest = |place: usize| self.arrays[place].shape.iter().copied().max().unwrap_or(0);
        match roles[TIME] {
            Some(time) => self.arrays[time].len(),
            None => roles[POSITION].map_or(0, longest),
        }
    }

    /// Samples as rows, those of an array that lies on its side, too.
    fn set_upright(
        &mut self,
        roles: &[Option<usize>; 4],
        samples: usize,
    ) -> Result<(), RecordingError> {
        let mut dof = None;
        for (quantity, place) in roles.iter().enumerate() {
            let Some(place) = *place else { continue };
            let array = &mut self.arrays[place];
            if !(array.is_number() || (quantity == TIME && array.is_time())) {
                let cause = format!("`{}` holds {}, expected numbers", array.name, array.kind());
                return Err(invalid(self.path, cause));
            }
            if quantity == TIME {
                array.squeeze();
                if array.shape.len() > 1 {
                    let (name, shape) = (&array.name, array.shape_text());
                    return Err(invalid(self.path, format!("{name}: got {shape}, expected (N,)")));
                }
                if self.options.units.time.is_none() {
                    array.integers_are_nanoseconds();
                }
                continue;
            }
            match array.shape[..] {
                // Of an arm of one joint.
                [rows] if rows == samples => array.shape.push(1),
                [rows, columns] if rows != samples && columns == samples => array.transpose(),
                _ => {}
            }
            let n = dof.map_or_else(|| "n".to_string(), |n: usize| n.to_string());
            match array.shape[..] {
                [rows, columns] if rows == samples && dof.unwrap_or(columns) == columns => {
                    dof = Some(columns);
                }
                _ => {
                    let (name, shape) = (&array.name, array.shape_text());
                    let cause = format!("{name}: got {shape}, expected ({samples}, {n})");
                    return Err(invalid(self.path, cause));
                }
            }
        }
        Ok(())
    }

    /// The names of the joints in the file; else those that are asked for, if there are as many.
    fn joints(&self, roles: &[Option<usize>; 4]) -> Result<Vec<String>, RecordingError> {
        let count = roles[POSITION].map_or(0, |place| self.arrays[place].shape[1]);
        if let Some(array) = self.arrays.iter().find(|array| array.name == JOINT_NAMES) {
            let (kind, shape) = (array.kind(), array.shape_text());
            let Some(names) = array.texts().filter(|_| array.shape.len() <= 1) else {
                return Err(invalid(
                    self.path,
                    format!("{JOINT_NAMES}: got {kind} of shape {shape}, expected text (n,)"),
                ));
            };
            if names.len() != count {
                let (got, columns) = (counted(names.len(), "name"), counted(count, "column"));
                return Err(invalid(
                    self.path,
                    format!("{JOINT_NAMES}: got {got} for {columns} of positions"),
                ));
            }
            return Ok(names.to_vec());
        }
        match &self.options.joints {
            None => Ok((1..=count).map(|number| format!("joint_{number}")).collect()),
            Some(joints) if joints.len() == count => Ok(joints.clone()),
            Some(joints) => Err(invalid(
                self.path,
                format!(
                    "the positions have {} without names, the robot has {}: add an array \
                     `{JOINT_NAMES}`, or name the joints with `joints`",
                    counted(count, "column"),
                    counted(joints.len(), "joint")
                ),
            )),
        }
    }

    /// By the rules of tables.
    fn recording(
        self,
        roles: &[Option<usize>; 4],
        joints: Vec<String>,
    ) -> Result<Recording, RecordingError> {
        let Self { path, arrays, options } = self;
        let samples = roles[POSITION].map_or(0, |place| arrays[place].shape[0]);
        let mut columns = Vec::new();
        let mut map = ColumnMap::default();
        let mut channels = Vec::new();
        let mut skipped = Vec::new();
        for (place, array) in arrays.into_iter().enumerate() {
            match roles.iter().position(|role| *role == Some(place)) {
                Some(TIME) => {
                    map.time = Some(array.name.clone());
                    columns.extend(array.into_column());
                }
                Some(quantity) => {
                    let names = (0..joints.len()).map(|k| called(&array.name, k)).collect();
                    *match quantity {
                        POSITION => &mut map.position,
                        2 => &mut map.velocity,
                        _ => &mut map.torque,
                    } = Some(Columns::Names(names));
                    columns.extend((0..joints.len()).filter_map(|k| array.column(k)));
                }
                None if array.name == JOINT_NAMES => {}
                None if array.is_number() && array.shape == [samples] => {
                    // A name without a meaning: the caller's arrays are chosen.
                    let name = format!("channel {}", channels.len() + 1);
                    channels.push((name.clone(), array.name.clone()));
                    columns
                        .extend(array.into_column().map(|column| NamedColumn { name, ..column }));
                }
                None => skipped.push(array.name),
            }
        }
        let wanted = options.joints.clone();
        let own = options.clone().with_joints(Some(joints)).with_columns(map);
        let mut recording = crate::csv::read_columns(path, &columns, &own)?;
        recording.rename_channels(&channels);
        // Arrays have no names for their columns: their order is that of the joints.
        let layout = recording.layout().map(|layout| Layout { by_order: true, ..layout.clone() });
        recording = recording.with_layout(layout);
        if !skipped.is_empty() {
            recording = recording.with_note(format!("skipped arrays: {}", skipped.join(", ")));
        }
        match wanted {
            Some(joints) => recording.select(&joints),
            None => Ok(recording),
        }
    }
}

/// The name of an array with the unit that its file says beside it, as columns of tables say it:
/// `q [deg]`.
#[cfg(feature = "hdf5")]
fn with_unit(name: String, unit: Option<&str>) -> String {
    let own = name.rsplit('.').next().unwrap_or_default();
    match unit.map(str::trim) {
        Some(unit) if !["", "1", "-"].contains(&unit) && quantity_of_array(own).is_some() => {
            format!("{name} [{unit}]")
        }
        _ => name,
    }
}
