//! Parquet files: columns of numbers, understood by their names as those of [`csv`](crate::csv), or
//! lists of one length, one per sample, understood as [`arrays`](crate::arrays).
//!
//! Every bit is kept: times are whole ns, decimals and integers exact as far as 64 bits are.

mod column;

use std::fs::File;
use std::path::{Path, PathBuf};

use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};

use crate::arrays::recording_of_vectors;
use crate::csv::{NamedColumn, ReadOptions, read_columns};
use crate::guarded::guarded;
use crate::{Format, Reader, Recording, RecordingError};
use column::is_number;
pub(crate) use column::{ParquetColumn, is_list, is_plain};

/// Parquet files.
pub static FORMAT: Format = Format {
    name: "Parquet",
    endings: &[".parquet"],
    is_at: None,
    begins: |_, start| start.starts_with(b"PAR1"),
    read: Reader::Table(|path, options| read(path, options)),
};

/// What messages call a file.
const A_FILE: &str = "a Parquet file";

/// Rows that are unpacked at once.
const ROWS: usize = 8192;

/// Reads a Parquet file. How columns are understood is told in the [module documentation](self).
///
/// # Errors
/// If the file is unreadable, damaged or too large; as [`read_columns`].
///
/// # Examples
/// ```no_run
/// use sgpr_recording::{csv::ReadOptions, parquet};
/// let recording = parquet::read("log.parquet", &ReadOptions::default())?;
/// println!("{} joints", recording.dof());
/// # Ok::<(), sgpr_recording::RecordingError>(())
/// ```
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Recording, RecordingError> {
    let path = path.as_ref();
    let name = path.display().to_string();
    let table = ParquetTable::open(path, |kind| is_number(kind) || is_list(kind))?;
    let notes = table.notes();
    let columns = table.columns(options.limit_bytes)?;
    let recording = if columns.iter().any(ParquetColumn::is_list) {
        let arrays = columns.into_iter().map(|column| column.into_array(&name));
        recording_of_vectors(&name, arrays.collect::<Result<_, _>>()?, options)?
    } else {
        let columns: Vec<NamedColumn<'static>> =
            columns.into_iter().map(ParquetColumn::into_named).collect();
        read_columns(&name, &columns, options)?
    };
    Ok(notes.into_iter().fold(recording, Recording::with_note))
}

/// Reads the rows of a Parquet file in pieces of `samples`, of which one is in memory at a time. Its
/// columns are numbers, not lists.
///
/// # Errors
/// If the file is unreadable or damaged, or holds lists; each piece as [`read()`].
pub fn pieces(
    path: &Path,
    samples: usize,
    options: &ReadOptions,
) -> Result<impl Iterator<Item = Result<Recording, RecordingError>> + Send + use<>, RecordingError>
{
    let table = ParquetTable::open(path, |kind| is_number(kind) || is_list(kind))?;
    let lists: Vec<&str> =
        table.kinds().filter(|(_, kind)| is_list(kind)).map(|(n, _)| n).collect();
    if !lists.is_empty() {
        return Err(RecordingError::NoLog {
            path: table.path.clone(),
            cause: format!("holds lists ({}), which are read whole", lists.join(", ")),
        });
    }
    let (name, options) = (table.path.clone(), options.clone());
    Ok(table.batches(samples.max(1))?.map(move |columns| {
        let columns: Vec<NamedColumn<'static>> =
            columns?.into_iter().map(ParquetColumn::into_named).collect();
        read_columns(&name, &columns, &options)
    }))
}

fn damaged(path: &str, error: &dyn std::fmt::Display) -> RecordingError {
    RecordingError::Broken { path: path.into(), format: A_FILE, cause: error.to_string() }
}

/// The crate checks what pages say of themselves, but not in all places.
fn checked<T>(
    path: &str,
    read: impl FnOnce() -> Result<T, RecordingError>,
) -> Result<T, RecordingError> {
    guarded(path, A_FILE, read)
}

/// An open file and those of its columns that are wanted.
pub(crate) struct ParquetTable {
    place: PathBuf,
    path: String,
    builder: ParquetRecordBatchReaderBuilder<File>,
    wanted: Vec<usize>,
}

impl ParquetTable {
    /// - `is_wanted`: whether columns of this type are read
    pub(crate) fn open(
        path: &Path,
        is_wanted: impl Fn(&arrow_schema::DataType) -> bool,
    ) -> Result<Self, RecordingError> {
        let name = path.display().to_string();
        let file = File::open(path)
            .map_err(|source| RecordingError::Unreadable { path: name.clone(), source })?;
        let builder = checked(&name, || {
            ParquetRecordBatchReaderBuilder::try_new(file).map_err(|error| damaged(&name, &error))
        })?;
        let fields = builder.schema().fields();
        let wanted =
            (0..fields.len()).filter(|place| is_wanted(fields[*place].data_type())).collect();
        Ok(Self { place: path.into(), path: name, builder, wanted })
    }

    /// The column of this name alone, if it is wanted.
    pub(crate) fn only(mut self, name: &str) -> Self {
        let fields = self.builder.schema().fields();
        self.wanted.retain(|place| fields[*place].name() == name);
        self
    }

    /// Names and types of all columns.
    fn kinds(&self) -> impl Iterator<Item = (&str, &arrow_schema::DataType)> {
        self.builder
            .schema()
            .fields()
            .iter()
            .map(|field| (field.name().as_str(), field.data_type()))
    }

    fn notes(&self) -> Option<String> {
        let skipped = self.skipped();
        (!skipped.is_empty())
            .then(|| format!("skipped columns that hold no numbers: {}", skipped.join(", ")))
    }

    /// Names of the columns that are not read.
    pub(crate) fn skipped(&self) -> Vec<String> {
        let all = self.kinds().enumerate();
        all.filter(|(place, _)| !self.wanted.contains(place))
            .map(|(_, (name, _))| name.to_string())
            .collect()
    }

    /// The wanted columns, whole, within a limit of bytes.
    pub(crate) fn columns(self, limit: u64) -> Result<Vec<ParquetColumn>, RecordingError> {
        let path = self.path.clone();
        let metadata = self.builder.metadata();
        let numbers = |value: i64| u64::try_from(value).unwrap_or(u64::MAX);
        let of_rows = numbers(metadata.file_metadata().num_rows())
            .saturating_mul(8 * self.wanted.len() as u64);
        let unpacked = metadata
            .row_groups()
            .iter()
            .fold(0_u64, |sum, group| sum.saturating_add(numbers(group.total_byte_size())));
        let too_large = || RecordingError::TooLarge { path: path.clone(), limit };
        let of_lists = self.listed()?.saturating_mul(8);
        if of_rows.max(unpacked).max(of_lists) > limit {
            return Err(too_large());
        }
        let mut whole: Vec<ParquetColumn> = Vec::new();
        for batch in self.batches(ROWS)? {
            let batch = batch?;
            if whole.is_empty() {
                whole = batch;
            } else {
                whole.iter_mut().zip(batch).for_each(|(column, more)| column.append(more));
            }
            if whole.iter().map(ParquetColumn::bytes).sum::<u64>() > limit {
                return Err(too_large());
            }
        }
        Ok(whole)
    }

    /// Numbers in the wanted lists, as their pages say: a page of some bytes may hold any number of
    /// equal ones, and a list is unpacked whole.
    fn listed(&self) -> Result<u64, RecordingError> {
        let schema = self.builder.parquet_schema();
        let fields = self.builder.schema().fields();
        let is_listed = |leaf: &usize| {
            let root = schema.get_column_root_idx(*leaf);
            self.wanted.contains(&root) && is_list(fields[root].data_type())
        };
        let leaves: Vec<usize> = (0..schema.num_columns()).filter(is_listed).collect();
        if leaves.is_empty() {
            return Ok(0);
        }
        let unreadable = |source| RecordingError::Unreadable { path: self.path.clone(), source };
        let file = File::open(&self.place).map_err(unreadable)?;
        checked(&self.path, || {
            let count = || {
                let reader = SerializedFileReader::new(file)?;
                let mut numbers = 0_u64;
                for group in 0..reader.num_row_groups() {
                    let group = reader.get_row_group(group)?;
                    for leaf in &leaves {
                        let mut pages = group.get_column_page_reader(*leaf)?;
                        while let Some(page) = pages.peek_next_page()? {
                            numbers = numbers.saturating_add(page.num_levels.unwrap_or(0) as u64);
                            pages.skip_next_page()?;
                        }
                    }
                }
                Ok(numbers)
            };
            count().map_err(|error: ParquetError| damaged(&self.path, &error))
        })
    }

    /// The wanted columns, so many rows at a time.
    fn batches(
        self,
        rows: usize,
    ) -> Result<
        impl Iterator<Item = Result<Vec<ParquetColumn>, RecordingError>> + Send + use<>,
        RecordingError,
    > {
        let path = self.path;
        let mask = ProjectionMask::roots(self.builder.parquet_schema(), self.wanted);
        let builder = self.builder.with_projection(mask).with_batch_size(rows);
        let mut reader =
            checked(&path, || builder.build().map_err(|error| damaged(&path, &error)))?;
        let mut next = move || {
            checked(&path, || {
                let Some(batch) = reader.next() else { return Ok(None) };
                let columns = batch.and_then(|batch| {
                    let schema = batch.schema();
                    let columns = schema.fields().iter().zip(batch.columns());
                    columns
                        .map(|(field, values)| ParquetColumn::new(field.name(), values))
                        .collect()
                });
                columns.map(Some).map_err(|error| damaged(&path, &error))
            })
        };
        // After an error nothing comes.
        let mut ended = false;
        Ok(std::iter::from_fn(move || {
            if ended {
                return None;
            }
            let batch = next();
            ended = batch.is_err();
            batch.transpose()
        }))
    }
}
