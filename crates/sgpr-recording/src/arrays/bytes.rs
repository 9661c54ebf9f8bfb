//! Numbers as they lie in files.

use crate::csv::Values;

/// What the bits of a number mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum NumberKind {
    /// IEEE 754.
    Float,
    Signed,
    Unsigned,
}

/// The type of numbers that lie one behind the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct StoredNumber {
    pub(super) kind: NumberKind,
    /// Bytes.
    pub(super) size: usize,
    pub(super) big_endian: bool,
}

impl StoredNumber {
    /// Whole numbers exact, or as floats where one is beyond 63 bits; `None` of a size that is not
    /// read.
    pub(super) fn values(self, data: &[u8]) -> Option<Values<'static>> {
        let float = |values: Vec<f64>| Some(Values::Numbers(values.into()));
        let whole = |values: Vec<i64>| Some(Values::Integers(values.into()));
        let big = self.big_endian;
        match (self.kind, self.size) {
            (NumberKind::Float, 2) => {
                float(each(data, big, |b| half::f16::from_le_bytes(b).into()))
            }
            (NumberKind::Float, 4) => float(each(data, big, |b| f32::from_le_bytes(b).into())),
            (NumberKind::Float, 8) => float(each(data, big, f64::from_le_bytes)),
            (NumberKind::Signed, 1) => whole(each(data, big, |b| i8::from_le_bytes(b).into())),
            (NumberKind::Signed, 2) => whole(each(data, big, |b| i16::from_le_bytes(b).into())),
            (NumberKind::Signed, 4) => whole(each(data, big, |b| i32::from_le_bytes(b).into())),
            (NumberKind::Signed, 8) => whole(each(data, big, i64::from_le_bytes)),
            (NumberKind::Unsigned, 1) => whole(each(data, big, |b| u8::from_le_bytes(b).into())),
            (NumberKind::Unsigned, 2) => whole(each(data, big, |b| u16::from_le_bytes(b).into())),
            (NumberKind::Unsigned, 4) => whole(each(data, big, |b| u32::from_le_bytes(b).into())),
            (NumberKind::Unsigned, 8) => {
                let values = each(data, big, u64::from_le_bytes);
                let signed: Result<Vec<i64>, _> =
                    values.iter().map(|value| i64::try_from(*value)).collect();
                signed.map_or_else(
                    |_| float(values.iter().map(|value| *value as f64).collect()),
                    whole,
                )
            }
            _ => None,
        }
    }
}

/// Every `N` bytes as a value; `of` takes them with the lowest first.
pub(super) fn each<const N: usize, T>(
    data: &[u8],
    big_endian: bool,
    of: fn([u8; N]) -> T,
) -> Vec<T> {
    let value = |bytes: &[u8]| {
        let mut own = [0; N];
        own.copy_from_slice(bytes);
        if big_endian {
            own.reverse();
        }
        of(own)
    };
    data.chunks_exact(N).map(value).collect()
}
