//! A record as a text and numbers, for files and other processes.

use std::collections::BTreeMap;

use faer::Mat;
use serde::{Deserialize, Serialize};

use super::{JointExtent, Record, RecordBlock, RecordError, RecordFinding, RecordMemory, Suspect};
use crate::identification::{JointFactor, lag_groups};
use crate::linalg::Matrix;
use crate::motion::Processing;
use crate::recording::Severity;

const FORMAT: &str = "sgpr record";
const VERSION: u32 = 3;

/// More columns have no equations of an arm.
const MOST_COLUMNS: usize = 10_000;

/// Everything but the numbers of the factors and products.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RecordHead {
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
    findings: Vec<FindingHead>,
    labels: BTreeMap<String, String>,
    /// Since version 2.
    #[serde(default)]
    extents: Vec<JointExtent>,
    #[serde(default)]
    key: [f64; 2],
    #[serde(default)]
    suspects: Vec<Suspect>,
    center: Vec<f64>,
    memory: Vec<MemoryHead>,
    blocks: Vec<BlockHead>,
}

/// Until version 2 a sentence alone.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum FindingHead {
    Whole(RecordFinding),
    Sentence(String),
}

impl From<FindingHead> for RecordFinding {
    fn from(head: FindingHead) -> Self {
        match head {
            FindingHead::Whole(finding) => finding,
            FindingHead::Sentence(message) => Self {
                kind: "unnamed".into(),
                rank: Severity::Note.rank().into(),
                subject: None,
                message,
            },
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MemoryHead {
    joint: usize,
    resting: bool,
    /// Columns, that of the residual included.
    width: usize,
    counts: Vec<usize>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BlockHead {
    time: [i64; 2],
    channels: BTreeMap<String, f64>,
    factors: Vec<FactorHead>,
    #[serde(default)]
    suspected: Vec<FactorHead>,
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
    /// The record as JSON and the upper triangles of its factors, then of its products, row by row,
    /// one after the other.
    pub fn to_parts(&self) -> (String, Vec<f64>) {
        let factor = |factor: &JointFactor| {
            let JointFactor { joint, resting, columns, rows, .. } = factor.clone();
            FactorHead { joint, resting, columns, rows }
        };
        let block = |block: &RecordBlock| BlockHead {
            time: block.time,
            channels: block.channels.clone(),
            factors: block.factors.iter().map(factor).collect(),
            suspected: block.suspected.iter().map(factor).collect(),
        };
        let memory = |memory: &RecordMemory| {
            let RecordMemory { joint, resting, ref counts, .. } = *memory;
            MemoryHead {
                joint,
                resting,
                width: memory.sums.first().map_or(0, Matrix::ncols),
                counts: counts.clone(),
            }
        };
        let record = self.clone();
        let head = RecordHead {
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
            findings: record.findings.into_iter().map(FindingHead::Whole).collect(),
            labels: record.labels,
            extents: record.extents,
            key: record.key,
            suspects: record.suspects,
            center: record.center,
            memory: self.memory.iter().map(memory).collect(),
            blocks: self.blocks.iter().map(block).collect(),
        };
        let of_blocks =
            self.blocks.iter().flat_map(|block| block.factors.iter().chain(&block.suspected));
        let factors = of_blocks.map(|factor| &factor.factor);
        let products = self.memory.iter().flat_map(|memory| &memory.sums);
        let numbers = factors.chain(products).flat_map(|matrix| upper_triangle(matrix)).collect();
        (serde_json::to_string(&head).expect("plain data"), numbers)
    }

    /// A record from its parts. Safe with those of strangers: every length is checked before memory
    /// is taken.
    ///
    /// # Errors
    /// If they are no record, damaged, or of a later version.
    pub fn from_parts(head: &str, numbers: &[f64]) -> Result<Self, RecordError> {
        let wrong = |message: String| RecordError::Malformed { message };
        let head: RecordHead =
            serde_json::from_str(head).map_err(|error| wrong(format!("its head: {error}")))?;
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
            let mut of = |heads: Vec<FactorHead>| {
                let factors = heads.into_iter().map(|factor| factor.with_numbers(&mut rest));
                factors.collect::<Result<_, _>>().map_err(wrong)
            };
            let (factors, suspected) = (of(block.factors)?, of(block.suspected)?);
            blocks.push(RecordBlock {
                time: block.time,
                channels: block.channels,
                factors,
                suspected,
            });
        }
        let memory = head
            .memory
            .into_iter()
            .map(|memory| memory.with_numbers(&mut rest))
            .collect::<Result<_, _>>();
        let memory = memory.map_err(wrong)?;
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
            findings: head.findings.into_iter().map(RecordFinding::from).collect(),
            labels: head.labels,
            extents: head.extents,
            key: head.key,
            suspects: head.suspects,
            library_version: head.library_version,
            center: head.center,
            memory,
            blocks,
        })
    }
}

impl RecordHead {
    fn check(&self) -> Result<(), RecordError> {
        let wrong = |message: &str| Err(RecordError::Malformed { message: message.into() });
        self.processing
            .check(self.joints.len())
            .map_err(|error| RecordError::Malformed { message: error.to_string() })?;
        if self.blocks.is_empty() {
            return wrong("it has no block");
        }
        if !self.center.iter().all(|value| value.is_finite()) {
            return wrong("a base parameter is not finite");
        }
        // Earlier versions did not say it.
        if !self.extents.is_empty() && self.extents.len() != self.joints.len() {
            return wrong("it does not say what each of its joints did");
        }
        if !self
            .suspects
            .iter()
            .flat_map(|suspect| &suspect.constants)
            .all(|constant| constant.is_finite())
        {
            return wrong("a constant of a suspect is not finite");
        }
        let numbers = self
            .extents
            .iter()
            .flat_map(|one| [one.position[0], one.position[1], one.speed, one.acceleration]);
        if !numbers.chain(self.key).all(f64::is_finite) {
            return wrong("what a joint did is not finite");
        }
        if self.memory.iter().any(|memory| memory.counts.len() != lag_groups().count()) {
            return wrong("its memory has not one number of products for each group of lags");
        }
        // Sums over many records must not overflow.
        let counts = self.memory.iter().flat_map(|memory| &memory.counts);
        let rows = self
            .blocks
            .iter()
            .flat_map(|block| block.factors.iter().chain(&block.suspected))
            .map(|factor| &factor.rows);
        if counts.chain(rows).any(|count| *count > 1 << 48) || self.samples > 1 << 48 {
            return wrong("it counts more rows than any log has");
        }
        Ok(())
    }
}

impl FactorHead {
    fn with_numbers(self, rest: &mut &[f64]) -> Result<JointFactor, String> {
        let Self { joint, resting, columns, rows } = self;
        if !columns.is_sorted_by(|a, b| a < b) {
            return Err("the columns of a factor are not in order".into());
        }
        let own = triangle_of(columns.len() + 1, rest)?;
        let factor =
            Mat::from_fn(own.nrows(), own.ncols(), |i, j| if i <= j { own[(i, j)] } else { 0.0 });
        Ok(JointFactor { joint, resting, columns, factor: factor.into(), rows, least_noise: 0.0 })
    }
}

impl MemoryHead {
    fn with_numbers(self, rest: &mut &[f64]) -> Result<RecordMemory, String> {
        let Self { joint, resting, width, counts } = self;
        let sums = counts
            .iter()
            .map(|_| triangle_of(width, rest).map(Matrix::from))
            .collect::<Result<_, _>>()?;
        Ok(RecordMemory { joint, resting, sums, counts })
    }
}

fn upper_triangle(matrix: &Mat<f64>) -> impl Iterator<Item = f64> {
    let width = matrix.ncols();
    (0..width).flat_map(move |i| (i..width).map(move |j| matrix[(i, j)]))
}

/// The symmetric matrix whose upper triangle comes first in `rest`, which is moved on.
fn triangle_of(width: usize, rest: &mut &[f64]) -> Result<Mat<f64>, String> {
    if width > MOST_COLUMNS {
        return Err(format!("a factor of {width} columns"));
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
    Ok(Mat::from_fn(width, width, |i, j| own[place(i.min(j), i.max(j))]))
}
