//! What is said of an array beside it.

use hdf5_reader::messages::datatype::{StringPadding, StringSize, VarLenKind};
use hdf5_reader::{Dataset, Datatype, RawAttribute};

use super::text_of;
use crate::arrays::held::count;

/// Longest text of an attribute that is read.
const LONGEST: usize = 1000;

/// The attributes of an array that are understood.
#[derive(Default)]
pub(super) struct Attributes {
    pub(super) unit: Option<String>,
    /// Written by MATLAB.
    pub(super) is_of_matlab: bool,
    /// Letters of MATLAB.
    pub(super) is_text: bool,
    /// An empty array of MATLAB, which holds its shape instead.
    pub(super) is_empty: bool,
}

impl Attributes {
    /// Attributes are read raw, because the crate would follow all references of all of them,
    /// without limit: of 3000 that lead to one text of 1 MB it makes 3 GB.
    pub(super) fn of(dataset: &Dataset) -> Self {
        let attributes = dataset.raw_attributes().unwrap_or_default();
        let named = |name: &str| attributes.iter().find(|attribute| attribute.name() == name);
        let text = |name: &str| named(name).and_then(|attribute| text(dataset, attribute));
        Self {
            unit: text("units").or_else(|| text("unit")),
            is_of_matlab: named("MATLAB_class").is_some(),
            is_text: text("MATLAB_class").is_some_and(|class| class == "char"),
            is_empty: named("MATLAB_empty").is_some(),
        }
    }

    /// How many texts an array of letters of MATLAB holds, which lie columns first: each row in the
    /// file is a column.
    pub(super) fn texts(&self, shape: &[usize]) -> Option<usize> {
        match shape {
            [columns, rows] if self.is_text => Some((*rows).min(count(&[*columns, *rows]))),
            _ => None,
        }
    }
}

/// An attribute that is one text.
fn text(dataset: &Dataset, attribute: &RawAttribute) -> Option<String> {
    let message = attribute.message();
    let data = &message.raw_data;
    match &message.datatype {
        Datatype::String { size: StringSize::Fixed(width), padding, .. }
            if data.len() == *width as usize && data.len() <= LONGEST =>
        {
            Some(text_of(data, *padding))
        }
        Datatype::String { size: StringSize::Variable, .. }
        | Datatype::VarLen { kind: VarLenKind::String, .. }
            if data.len() == dataset.vlen_reference_size()
                && length_of_text(data) as usize <= LONGEST =>
        {
            let bytes = dataset.resolve_vlen_reference_bytes(data, 1).ok()?;
            Some(text_of(&bytes, StringPadding::NullTerminate))
        }
        _ => None,
    }
}

/// The length of the text that a reference leads to, which stands first in it.
pub(super) fn length_of_text(reference: &[u8]) -> u32 {
    reference.first_chunk().map_or(0, |length| u32::from_le_bytes(*length))
}
