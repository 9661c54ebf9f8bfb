//! A record as a text and numbers, for files and other processes.

use std::collections::BTreeMap;

use faer::Mat;
use serde::{Deserialize, Serialize};

use super::{Record, RecordBlock, RecordError, RecordMemory};
use crate::identification::JointFactor;
use crate::motion::Processing;

const FORMAT: &str = "sgpr record";
const VERSION: u32 = 1;

/// More columns have no equations of an arm.
const MOST_COLUMNS: usize = 10_000;

/// Everything but the numbers of the factors.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    format: String,
    version: u32,
    library_version: String,
    robot: String,
    joints: Vec<String>,
    effects: Vec<String>,
    processing: Processing,
    source: String,
    content_hash: String,
    counted: Option<[i64; 2]>,
    time: [i64; 2],
    samples: usize,
    findings: Vec<String>,
    labels: BTreeMap<String, String>,
    memory: Vec<RecordMemory>,
    blocks: Vec<BlockHead>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BlockHead {
    time: [i64; 2],
    channels: BTreeMap<String, f64>,
    factors: Vec<FactorHead>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FactorHead {
    joint: usize,
    resting: bool,
    columns: Vec<usize>,
    rows: usize,
}

impl Record {
    /// The record as JSON and the upper triangles of its factors, row by row, one after the other.
    pub fn to_parts(&self) -> (String, Vec<f64>) {
        let factor = |factor: &JointFactor| {
            let JointFactor { joint, resting, columns, rows, .. } = factor.clone();
            FactorHead { joint, resting, columns, rows }
        };
        let block = |block: &RecordBlock| BlockHead {
            time: block.time,
            channels: block.channels.clone(),
            factors: block.factors.iter().map(factor).collect(),
        };
        let record = self.clone();
        let head = Head {
            format: FORMAT.into(),
            version: VERSION,
            library_version: record.library_version,
            robot: record.robot,
            joints: record.joints,
            effects: record.effects,
            processing: record.processing,
            source: record.source,
            content_hash: record.content_hash,
            counted: record.counted,
            time: record.time,
            samples: record.samples,
            findings: record.findings,
            labels: record.labels,
            memory: record.memory,
            blocks: self.blocks.iter().map(block).collect(),
        };
        let mut numbers = Vec::new();
        for factor in self.blocks.iter().flat_map(|block| &block.factors) {
            let width = factor.factor.ncols();
            numbers.extend((0..width).flat_map(|i| (i..width).map(move |j| factor.factor[(i, j)])));
        }
        (serde_json::to_string(&head).expect("plain data"), numbers)
    }

    /// A record from its parts. Safe with those of strangers: every length is checked before memory is taken.
    ///
    /// # Errors
    /// If they are no record, damaged, or of a later version.
    pub fn from_parts(head: &str, numbers: &[f64]) -> Result<Self, RecordError> {
        let wrong = |message: String| RecordError::Malformed { message };
        let head: Head = serde_json::from_str(head).map_err(|error| wrong(format!("its head: {error}")))?;
        if head.format != FORMAT {
            return Err(wrong(format!("its head says `{}`, not `{FORMAT}`", head.format)));
        }
        if head.version > VERSION {
            return Err(wrong(format!(
                "it has version {}, this library reads up to {VERSION}: update it",
                head.version
            )));
        }
        head.check()?;
        let mut rest = numbers;
        let mut blocks = Vec::with_capacity(head.blocks.len());
        for block in head.blocks {
            let factors =
                block.factors.into_iter().map(|factor| factor.with_numbers(&mut rest)).collect::<Result<_, _>>();
            blocks.push(RecordBlock { time: block.time, channels: block.channels, factors: factors.map_err(wrong)? });
        }
        if !rest.is_empty() {
            return Err(wrong(format!("{} numbers are left over", rest.len())));
        }
        Ok(Self {
            robot: head.robot,
            joints: head.joints,
            effects: head.effects,
            processing: head.processing,
            source: head.source,
            content_hash: head.content_hash,
            counted: head.counted,
            time: head.time,
            samples: head.samples,
            findings: head.findings,
            labels: head.labels,
            library_version: head.library_version,
            memory: head.memory,
            blocks,
        })
    }
}

impl Head {
    fn check(&self) -> Result<(), RecordError> {
        let wrong = |message: &str| Err(RecordError::Malformed { message: message.into() });
        self.processing
            .check(self.joints.len())
            .map_err(|error| RecordError::Malformed { message: error.to_string() })?;
        if self.blocks.is_empty() {
            return wrong("it has no block");
        }
        let finite = |memory: &RecordMemory| memory.sums.iter().all(|sum| sum.is_finite());
        if !self.memory.iter().all(|memory| memory.sums.len() == memory.counts.len() && finite(memory)) {
            return wrong("its memory has not one finite sum for each number of products");
        }
        // Sums over many records must not overflow.
        let counts = self.memory.iter().flat_map(|memory| &memory.counts);
        let rows = self.blocks.iter().flat_map(|block| &block.factors).map(|factor| &factor.rows);
        if counts.chain(rows).any(|count| *count > 1 << 48) || self.samples > 1 << 48 {
            return wrong("it counts more rows than any log has");
        }
        Ok(())
    }
}

impl FactorHead {
    fn with_numbers(self, rest: &mut &[f64]) -> Result<JointFactor, String> {
        let Self { joint, resting, columns, rows } = self;
        let width = columns.len() + 1;
        if width > MOST_COLUMNS {
            return Err(format!("a factor of {width} columns"));
        }
        if !columns.is_sorted_by(|a, b| a < b) {
            return Err("the columns of a factor are not in order".into());
        }
        let size = width * (width + 1) / 2;
        let Some((own, others)) = rest.split_at_checked(size) else {
            return Err(format!("numbers of a factor are missing: {} of {size} are there", rest.len()));
        };
        if own.iter().any(|value| !value.is_finite()) {
            return Err("a number of a factor is not finite".into());
        }
        *rest = others;
        let place = |i: usize, j: usize| i * width - i * (i + 1) / 2 + j;
        let factor = Mat::from_fn(width, width, |i, j| if i <= j { own[place(i, j)] } else { 0.0 });
        Ok(JointFactor { joint, resting, columns, factor, rows })
    }
}
