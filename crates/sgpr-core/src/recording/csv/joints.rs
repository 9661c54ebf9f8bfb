//! Columns of joints, by what their names say.

use super::header::{self, Label, Meaning, Quantity};
use super::mapping::Source;
use super::{Columns, ReadOptions};
use crate::recording::RecordingError;
use crate::recording::part::{ending_number, numbered};

/// The columns of a log and the joints they are for.
pub(super) struct JointColumns<'a> {
    pub(super) path: &'a str,
    pub(super) columns: &'a [String],
    pub(super) meanings: Vec<Option<Meaning>>,
    pub(super) joints: Vec<String>,
    /// Whether the joints are those that the caller asks for.
    given: bool,
}

impl<'a> JointColumns<'a> {
    pub(super) fn new(path: &'a str, columns: &'a [String], options: &ReadOptions) -> Result<Self, RecordingError> {
        let meanings = columns.iter().map(|name| header::meaning(name, options.joints.as_deref())).collect();
        let given = options.joints.is_some();
        let mut table = Self { path, columns, meanings, joints: Vec::new(), given };
        table.joints = match (&options.joints, &options.columns.position) {
            (Some(joints), _) => joints.clone(),
            (None, Some(columns)) => table.joints_of_option(columns),
            (None, None) => table.joints_of_header()?,
        };
        Ok(table)
    }

    pub(super) fn no_positions(&self) -> RecordingError {
        RecordingError::NoPositions { path: self.path.into(), columns: self.columns.to_vec() }
    }

    pub(super) fn incomplete(&self, quantity: Quantity, missing: Vec<String>) -> RecordingError {
        let (path, columns) = (self.path.into(), self.columns.to_vec());
        RecordingError::IncompleteColumns { path, quantity: quantity.name(), missing, columns }
    }

    /// Columns with their factors: as the caller says, else as the column says, else 1.
    pub(super) fn sources(&self, columns: Vec<usize>, unit: Option<f64>) -> Vec<Source> {
        let stated = |index: usize| self.meanings[index].as_ref().and_then(|meaning| meaning.factor);
        let factor = |index| unit.or(stated(index)).unwrap_or(1.0);
        columns.into_iter().map(|index| Source { index, factor: factor(index) }).collect()
    }

    /// Columns of `quantity` with what they say of their joint.
    pub(super) fn of(&self, quantity: Quantity) -> impl Iterator<Item = (usize, &Label)> {
        self.meanings.iter().enumerate().filter_map(move |(index, meaning)| {
            let meaning = meaning.as_ref().filter(|meaning| meaning.quantity == quantity)?;
            Some((index, &meaning.label))
        })
    }

    /// Numbers of the columns of `quantity`, in order.
    fn numbers(&self, quantity: Quantity) -> Vec<u32> {
        let number = |(_, label): (usize, &Label)| if let Label::Number(number) = label { Some(*number) } else { None };
        let mut numbers: Vec<u32> = self.of(quantity).filter_map(number).collect();
        numbers.sort_unstable();
        numbers.dedup();
        numbers
    }

    /// As many numbered joints as the caller names position columns.
    fn joints_of_option(&self, columns: &Columns) -> Vec<String> {
        let present = |pattern: &str, number| self.columns.contains(&expand(pattern, number, ""));
        let count = match columns {
            Columns::Names(names) => names.len(),
            Columns::Pattern(pattern) if pattern.contains("{}") => {
                (1..).take_while(|&number| present(pattern, number)).count()
            }
            Columns::Pattern(_) => 1,
        };
        // With none of the columns there, the search for the first one says so.
        (1..=count.max(1)).map(numbered).collect()
    }

    /// The joints as the position columns call them.
    fn joints_of_header(&self) -> Result<Vec<String>, RecordingError> {
        let numbers = self.numbers(Quantity::Position);
        if !numbers.is_empty() {
            return Ok(numbers.into_iter().map(numbered).collect());
        }
        let mut names: Vec<String> = Vec::new();
        let mut unnamed = false;
        for (_, label) in self.of(Quantity::Position) {
            match label {
                Label::Name(name) if !names.contains(name) => names.push(name.clone()),
                label => unnamed |= *label == Label::Unnamed,
            }
        }
        match (names.is_empty(), unnamed) {
            (false, _) => Ok(names),
            (true, true) => Ok(vec!["joint_1".into()]),
            (true, false) => Err(self.no_positions()),
        }
    }

    /// One column per joint; `None` if the log has none of this quantity.
    pub(super) fn by_name(&self, quantity: Quantity) -> Result<Option<Vec<usize>>, RecordingError> {
        let Some(labels) = self.labels(quantity)? else { return Ok(None) };
        let mut found = Vec::with_capacity(labels.len());
        let mut missing = Vec::new();
        for (joint, label) in self.joints.iter().zip(&labels) {
            let fits = self.of(quantity).filter(|(_, other)| *other == label);
            let candidates: Vec<usize> = fits.map(|(index, _)| index).collect();
            match candidates[..] {
                [] => missing.push(joint.clone()),
                [index] => found.push(index),
                _ => {
                    let candidates = candidates.iter().map(|&index| self.columns[index].clone()).collect();
                    let (path, quantity, joint) = (self.path.into(), quantity.name(), joint.clone());
                    return Err(RecordingError::AmbiguousColumn { path, quantity, joint, candidates });
                }
            }
        }
        if missing.is_empty() { Ok(Some(found)) } else { Err(self.incomplete(quantity, missing)) }
    }

    /// How the columns of `quantity` call the joints: by their names, else by number, else (one joint) not at all.
    /// If some joints have no column, the result names them all the same.
    fn labels(&self, quantity: Quantity) -> Result<Option<Vec<Label>>, RecordingError> {
        let has = |wanted: &Label| self.of(quantity).any(|(_, label)| label == wanted);
        let names: Vec<Label> = self.joints.iter().cloned().map(Label::Name).collect();
        if names.iter().all(has) {
            return Ok(Some(names));
        }
        let numbers = self.numbers(quantity);
        if let Some(chosen) = self.choose(&numbers, quantity)? {
            return Ok(Some(chosen.into_iter().map(Label::Number).collect()));
        }
        if self.joints.len() == 1 && has(&Label::Unnamed) {
            return Ok(Some(vec![Label::Unnamed]));
        }
        if names.iter().any(has) {
            return Ok(Some(names));
        }
        let in_order = |index: usize| numbers.get(index).map_or(Label::Unnamed, |number| Label::Number(*number));
        Ok((!numbers.is_empty()).then(|| (0..self.joints.len()).map(in_order).collect()))
    }

    /// The number of each joint: the one its name ends in, else its place; `None` if there are too few numbers.
    fn choose(&self, numbers: &[u32], quantity: Quantity) -> Result<Option<Vec<u32>>, RecordingError> {
        let own: Vec<u32> = self.joints.iter().filter_map(|joint| ending_number(joint)).collect();
        let wanted = self.joints.len();
        let from_zero = numbers.first() == Some(&0) && !own.contains(&0);
        if self.given && from_zero && numbers.len() > wanted {
            let is_numbered = |(index, label): (usize, &Label)| {
                matches!(label, Label::Number(_)).then(|| self.columns[index].clone())
            };
            return Err(RecordingError::AmbiguousNumbers {
                path: self.path.into(),
                quantity: quantity.name(),
                joints: self.joints.clone(),
                candidates: self.of(quantity).filter_map(is_numbered).collect(),
            });
        }
        let mut distinct = own.clone();
        distinct.sort_unstable();
        distinct.dedup();
        if distinct.len() == wanted && distinct.iter().all(|number| numbers.binary_search(number).is_ok()) {
            return Ok(Some(own));
        }
        Ok((self.given && numbers.len() >= wanted).then(|| numbers[..wanted].to_vec()))
    }
}

/// The column of one joint.
pub(super) fn expand(pattern: &str, number: usize, name: &str) -> String {
    pattern.replace("{name}", name).replace("{}", &number.to_string())
}
