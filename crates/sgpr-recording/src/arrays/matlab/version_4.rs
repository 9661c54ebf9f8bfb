//! MATLAB files of version 4: matrices one behind the other, and no header.

use super::element::{excess, letter, name_of};
use super::{add, rows_of};
use crate::arrays::bytes::{NumberKind, StoredNumber, each};
use crate::arrays::found::{ArrayFault, Found, OWN_BYTES};
use crate::csv::Values;

/// Bytes in front of a matrix: type, rows, columns, whether it is complex, length of its name.
const HEAD: usize = 20;

/// Largest type that there is; on a machine of the other byte order it is larger.
const LARGEST_TYPE: u32 = 4052;

/// Last digit of the type.
const TEXT: u32 = 1;
const SPARSE: u32 = 2;

/// Adds the matrices of a file.
pub(super) fn variables(found: &mut Found, mut rest: &[u8]) -> Result<(), ArrayFault> {
    let first = rest.first_chunk().ok_or_else(|| ArrayFault::damaged("it ends early"))?;
    let big_endian = u32::from_le_bytes(*first) > LARGEST_TYPE;
    while !rest.is_empty() {
        let head = VariableHead::new(taken(&mut rest, Some(HEAD))?, big_endian)?;
        let name = name_of(taken(&mut rest, Some(head.name_length))?);
        let bytes = head.count()?.checked_mul(head.number.size);
        let data = taken(&mut rest, bytes)?;
        if head.is_complex {
            taken(&mut rest, bytes)?;
            found.skip(&name, "complex numbers");
        } else if head.content == SPARSE {
            found.skip(&name, "a sparse matrix");
        } else {
            matrix(found, name, &head, data)?;
        }
    }
    Ok(())
}

/// So many bytes, which `rest` then lacks.
fn taken<'a>(rest: &mut &'a [u8], count: Option<usize>) -> Result<&'a [u8], ArrayFault> {
    let split = count.and_then(|count| rest.split_at_checked(count));
    let (data, behind) = split.ok_or_else(|| ArrayFault::damaged("it ends early"))?;
    *rest = behind;
    Ok(data)
}

fn matrix(
    found: &mut Found,
    name: String,
    head: &VariableHead,
    data: &[u8],
) -> Result<(), ArrayFault> {
    found.pay(excess(data.len(), head.number.size))?;
    let values = match head.number.values(data) {
        Some(Values::Numbers(values)) => values,
        // All numbers of MATLAB 4 are floats, however they are packed.
        Some(Values::Integers(values)) => values.iter().map(|value| *value as f64).collect(),
        _ => return Err(ArrayFault::damaged("numbers of no known type")),
    };
    if head.content == TEXT {
        let letters: Vec<char> = values.iter().map(|value| letter(*value as u32)).collect();
        found.pay((head.rows.min(letters.len()) as u64).saturating_mul(OWN_BYTES))?;
        let texts = rows_of(&letters, head.rows);
        return add(found, name, vec![texts.len()], Values::Texts(texts));
    }
    add(found, name, vec![head.rows, head.columns], Values::Numbers(values))
}

/// What stands in front of a matrix.
struct VariableHead {
    number: StoredNumber,
    content: u32,
    rows: usize,
    columns: usize,
    is_complex: bool,
    name_length: usize,
}

impl VariableHead {
    fn new(bytes: &[u8], big_endian: bool) -> Result<Self, ArrayFault> {
        let words = each(bytes, big_endian, u32::from_le_bytes);
        let [kind, rows, columns, complex, name_length] = words[..] else {
            return Err(ArrayFault::damaged("it ends early"));
        };
        // Thousands: the machine; tens: the numbers; ones: what they are.
        let (kind_of_number, size) = match kind / 10 % 10 {
            0 => (NumberKind::Float, 8),
            1 => (NumberKind::Float, 4),
            2 => (NumberKind::Signed, 4),
            3 => (NumberKind::Signed, 2),
            4 => (NumberKind::Unsigned, 2),
            _ => (NumberKind::Unsigned, 1),
        };
        let is_known = kind / 100 == 10 * u32::from(big_endian)
            && kind / 10 % 10 <= 5
            && kind % 10 <= SPARSE
            && complex <= 1;
        if !is_known {
            return Err(ArrayFault::damaged("it begins as no known version does"));
        }
        Ok(Self {
            number: StoredNumber { kind: kind_of_number, size, big_endian },
            content: kind % 10,
            rows: rows as usize,
            columns: columns as usize,
            is_complex: complex == 1,
            name_length: name_length as usize,
        })
    }

    fn count(&self) -> Result<usize, ArrayFault> {
        let count = self.rows.checked_mul(self.columns);
        count.ok_or_else(|| ArrayFault::damaged("a matrix larger than any file"))
    }
}
