//! Columns of joints, by what their names say.

use std::cell::Cell;

use super::header;
use super::quantity::{Label, Meaning, Quantity, StatedUnit};
use super::{Columns, ReadOptions};
use crate::part::{ending_number, numbered, numbers_with_gaps, places_of_numbers};
use crate::{IssueKind, RecordingError};

/// A column and what one of its units is in SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ColumnSource {
    pub(super) index: usize,
    /// The unit that somebody stated.
    pub(super) unit: Option<StatedUnit>,
    /// What a number of the column is multiplied by.
    pub(super) factor: f64,
    /// N·m per A, in the factor already.
    pub(super) constant: Option<f64>,
}

/// The columns of a log and the joints they are for.
pub(super) struct JointColumns<'a> {
    pub(super) path: &'a str,
    pub(super) columns: &'a [String],
    pub(super) meanings: Vec<Option<Meaning>>,
    pub(super) joints: Vec<String>,
    /// Cells of the line of units, one per column; empty if there is none.
    units: &'a [String],
    /// Whether the joints are those that the caller asks for.
    given: bool,
    /// Whether the caller has said that joints are numbered in their order.
    order_is_known: bool,
    /// Whether joints were given columns in the order of their numbers.
    pub(super) by_order: Cell<bool>,
}

/// The columns of a quantity.
pub(super) struct QuantityColumns {
    pub(super) columns: Vec<usize>,
    /// Numbers that the columns carry, if they are told apart by them.
    pub(super) numbers: Option<Vec<u32>>,
}

impl<'a> JointColumns<'a> {
    pub(super) fn new(
        path: &'a str,
        columns: &'a [String],
        units: &'a [String],
        options: &ReadOptions,
    ) -> Result<Self, RecordingError> {
        let meanings =
            columns.iter().map(|name| header::meaning(name, options.joints.as_deref())).collect();
        let given = options.joints.is_some();
        let map = &options.columns;
        let numbers_joints = |columns: &Option<Columns>| matches!(columns, Some(Columns::Pattern(pattern)) if pattern.contains("{}"));
        let order_is_known = options.accept.contains(&IssueKind::JointsByOrder)
            || [&map.position, &map.velocity, &map.torque].into_iter().any(numbers_joints);
        let (joints, by_order) = (Vec::new(), Cell::new(false));
        let mut table =
            Self { path, columns, meanings, joints, units, given, order_is_known, by_order };
        table.joints = match (&options.joints, &options.columns.position) {
            (Some(joints), _) => joints.clone(),
            (None, Some(columns)) => table.joints_of_option(columns),
            (None, None) => table.joints_of_header()?,
        };
        Ok(table)
    }

    /// There are no positions; if the log has joints of other names, they are told.
    pub(super) fn no_positions(&self) -> RecordingError {
        let of_others = |name: &String| {
            let meaning = header::meaning(name, None)
                .filter(|meaning| meaning.quantity == Quantity::Position)?;
            Some((meaning.label, name.clone()))
        };
        let (labels, columns): (Vec<Label>, Vec<String>) =
            self.columns.iter().filter_map(of_others).unzip();
        if !self.given || columns.is_empty() {
            let unknown = |name: &&String| header::meaning(name, None).is_none();
            return RecordingError::NoPositions {
                path: self.path.into(),
                columns: self.columns.to_vec(),
                unknown: self.columns.iter().filter(unknown).cloned().collect(),
            };
        }
        let found = labels.into_iter().map(|label| match label {
            Label::Name(name) => name,
            Label::Number(number) => numbered(number),
            Label::Unnamed => "one without name".into(),
        });
        let (path, joints) = (self.path.into(), self.joints.clone());
        RecordingError::OtherJoints { path, joints, found: found.collect(), columns }
    }

    pub(super) fn incomplete(&self, quantity: Quantity, missing: Vec<String>) -> RecordingError {
        let (path, columns) = (self.path.into(), self.columns.to_vec());
        RecordingError::IncompleteColumns { path, quantity: quantity.name(), missing, columns }
    }

    /// Columns with their units: as the caller says, else as the column says, else the line of
    /// units, else SI.
    pub(super) fn sources(
        &self,
        quantity: Quantity,
        columns: Vec<usize>,
        given: Option<StatedUnit>,
    ) -> Result<Vec<ColumnSource>, RecordingError> {
        let source = |index| {
            let unit =
                given.map_or_else(|| self.stated_unit(quantity, index), |unit| Ok(Some(unit)))?;
            Ok(ColumnSource {
                index,
                unit,
                factor: unit.map_or(1.0, |unit| unit.factor),
                constant: None,
            })
        };
        columns.into_iter().map(source).collect()
    }

    fn stated_unit(
        &self,
        quantity: Quantity,
        index: usize,
    ) -> Result<Option<StatedUnit>, RecordingError> {
        let name = &self.columns[index];
        let understood =
            self.meanings[index].as_ref().filter(|meaning| meaning.quantity == quantity);
        let of_name = understood
            .and_then(|meaning| meaning.unit)
            .or_else(|| header::unit_at_end(name, quantity));
        if of_name.is_some() {
            return Ok(of_name);
        }
        let cell = self.units.get(index).map(|cell| header::bracketed(cell).unwrap_or(cell));
        let of_line = cell.and_then(|cell| quantity.unit(cell));
        let unknown = |unit: &str| RecordingError::ColumnUnit {
            path: self.path.into(),
            column: name.clone(),
            quantity: quantity.name(),
            unit: unit.into(),
        };
        // Currents are multiplied by a constant, whatever they are in.
        if let Some(sign) = header::ratio(name).filter(|_| quantity != Quantity::Current) {
            return Err(unknown(sign));
        }
        match (of_line, cell, header::bracketed(name).filter(|_| name.ends_with(']'))) {
            (Some(unit), ..) => Ok(Some(unit)),
            (None, Some(cell), _) if !cell.is_empty() && cell != "-" => Err(unknown(cell)),
            (None, _, Some(text)) if understood.is_none() && !header::says_nothing(text) => {
                Err(unknown(text))
            }
            _ => Ok(None),
        }
    }

    /// Whether columns named by the caller as torques are motor currents by their units.
    pub(super) fn are_currents(&self, columns: &[usize]) -> bool {
        let is_current = |&index: &usize| {
            let unit = |quantity| self.stated_unit(quantity, index).ok().flatten();
            let named = self.meanings[index].as_ref().map(|meaning| meaning.quantity);
            named == Some(Quantity::Current)
                || unit(Quantity::Torque).is_none() && unit(Quantity::Current).is_some()
        };
        !columns.is_empty() && columns.iter().all(is_current)
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
        let number = |(_, label): (usize, &Label)| {
            if let Label::Number(number) = label { Some(*number) } else { None }
        };
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
    ///
    /// - `agreed`: the numbers that the positions of the joints carry, if they carry any
    pub(super) fn by_name(
        &self,
        quantity: Quantity,
        agreed: Option<&[u32]>,
    ) -> Result<Option<QuantityColumns>, RecordingError> {
        let Some(labels) = self.labels(quantity, agreed)? else { return Ok(None) };
        let mut found = Vec::with_capacity(labels.len());
        let mut missing = Vec::new();
        for (joint, label) in self.joints.iter().zip(&labels) {
            let fits = self.of(quantity).filter(|(_, other)| *other == label);
            let candidates: Vec<usize> = fits.map(|(index, _)| index).collect();
            match candidates[..] {
                [] => missing.push(joint.clone()),
                [index] => found.push(index),
                _ => {
                    let candidates =
                        candidates.iter().map(|&index| self.columns[index].clone()).collect();
                    let (path, quantity, joint) =
                        (self.path.into(), quantity.name(), joint.clone());
                    return Err(RecordingError::AmbiguousColumn {
                        path,
                        quantity,
                        joint,
                        candidates,
                    });
                }
            }
        }
        if !missing.is_empty() {
            return Err(self.incomplete(quantity, missing));
        }
        let number =
            |label: &Label| if let Label::Number(number) = label { Some(*number) } else { None };
        Ok(Some(QuantityColumns { columns: found, numbers: labels.iter().map(number).collect() }))
    }

    /// How the columns of `quantity` call the joints: by their names, else by number, else (one
    /// joint) not at all. If some joints have no column, the result names them all the same.
    fn labels(
        &self,
        quantity: Quantity,
        agreed: Option<&[u32]>,
    ) -> Result<Option<Vec<Label>>, RecordingError> {
        let has = |wanted: &Label| self.of(quantity).any(|(_, label)| label == wanted);
        let names: Vec<Label> = self.joints.iter().cloned().map(Label::Name).collect();
        if names.iter().all(has) {
            return Ok(Some(names));
        }
        let numbers = self.numbers(quantity);
        let labelled = |numbers: &[u32]| numbers.iter().copied().map(Label::Number).collect();
        match agreed {
            Some(agreed) if !numbers.is_empty() => {
                self.require_agreement(quantity, &numbers)?;
                return Ok(Some(labelled(agreed)));
            }
            _ => {}
        }
        if let Some(chosen) = self.choose(&numbers, quantity)? {
            return Ok(Some(labelled(&chosen)));
        }
        if self.joints.len() == 1 && has(&Label::Unnamed) {
            return Ok(Some(vec![Label::Unnamed]));
        }
        if names.iter().any(has) {
            return Ok(Some(names));
        }
        if numbers.is_empty() {
            return Ok(None);
        }
        let own: Option<Vec<u32>> = self.joints.iter().map(|joint| ending_number(joint)).collect();
        let in_place = numbers_with_gaps(own.as_deref(), &numbers, self.joints.len());
        in_place.map(|all| Some(labelled(&all))).ok_or_else(|| RecordingError::FewerColumns {
            path: self.path.into(),
            quantity: quantity.name(),
            columns: self.numbered_columns(quantity),
            joints: self.joints.clone(),
        })
    }

    /// Refuses a quantity with numbers that no position has: its columns are counted otherwise.
    fn require_agreement(&self, quantity: Quantity, numbers: &[u32]) -> Result<(), RecordingError> {
        let of_positions = self.numbers(Quantity::Position);
        if of_positions.is_empty() || numbers.iter().all(|number| of_positions.contains(number)) {
            return Ok(());
        }
        Err(RecordingError::NumbersDiffer {
            path: self.path.into(),
            quantity: quantity.name(),
            columns: self.numbered_columns(quantity),
            positions: self.numbered_columns(Quantity::Position),
        })
    }

    fn numbered_columns(&self, quantity: Quantity) -> Vec<String> {
        let numbered = self.of(quantity).filter(|(_, label)| matches!(label, Label::Number(_)));
        numbered.map(|(index, _)| self.columns[index].clone()).collect()
    }

    /// The number of each joint: the one its name ends in, else its place; `None` if there are too
    /// few numbers.
    fn choose(
        &self,
        numbers: &[u32],
        quantity: Quantity,
    ) -> Result<Option<Vec<u32>>, RecordingError> {
        let wanted = self.joints.len();
        let own: Option<Vec<u32>> = self.joints.iter().map(|joint| ending_number(joint)).collect();
        if let Some(chosen) = own.as_deref().and_then(|own| places_of_numbers(own, numbers)) {
            return Ok(Some(chosen));
        }
        if numbers.len() < wanted {
            return Ok(None);
        }
        let candidates = || self.numbered_columns(quantity);
        let own = own.unwrap_or_default();
        if numbers.first() == Some(&0) && !own.contains(&0) && numbers.len() > wanted {
            return Err(RecordingError::AmbiguousNumbers {
                path: self.path.into(),
                quantity: quantity.name(),
                joints: self.joints.clone(),
                candidates: candidates(),
            });
        }
        let only_one = wanted == 1 && numbers.len() == 1;
        if !self.order_is_known && !only_one {
            return Err(RecordingError::JointsByOrder {
                recording: self.path.into(),
                joints: self.joints.clone(),
                columns: candidates(),
            });
        }
        self.by_order.set(!only_one);
        Ok(Some(numbers[..wanted].to_vec()))
    }
}

/// The column of one joint.
pub(super) fn expand(pattern: &str, number: usize, name: &str) -> String {
    pattern.replace("{name}", name).replace("{}", &number.to_string())
}
