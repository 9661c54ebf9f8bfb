//! The header of a table and its rows, cut into cells.

use std::borrow::Cow;
use std::io::{self, BufRead};

use crate::recording::RecordingError;

/// Tables with more columns are not logs.
const MOST_COLUMNS: usize = 10_000;

/// The lines of a table, one at a time: first the header, then the rows.
pub(super) struct Lines<R> {
    text: R,
    line: Vec<u8>,
    /// Number of the line, from 1.
    number: u64,
    /// Whether the line is to be given again.
    held: bool,
    delimiter: u8,
}

impl<R: BufRead> Lines<R> {
    pub(super) fn new(text: R) -> Self {
        Self { text, line: Vec::new(), number: 0, held: false, delimiter: b',' }
    }

    /// Goes to the next line that is not empty; `false` after the last one.
    fn next_line(&mut self) -> io::Result<bool> {
        if std::mem::take(&mut self.held) {
            return Ok(true);
        }
        loop {
            self.line.clear();
            if self.text.read_until(b'\n', &mut self.line)? == 0 {
                return Ok(false);
            }
            self.number += 1;
            if !self.line.trim_ascii().is_empty() {
                return Ok(true);
            }
        }
    }

    /// Goes to the next row; `false` after the last one.
    pub(super) fn next_row(&mut self) -> io::Result<bool> {
        while self.next_line()? {
            if !self.line.trim_ascii_start().starts_with(b"#") {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The header: the first line that is no comment, or, above numbers, the last comment.
    pub(super) fn header(&mut self) -> io::Result<Header> {
        let mut comment: Option<Vec<u8>> = None;
        while self.next_line()? {
            let line = self.line.trim_ascii();
            if let [b'#' | b'%', names @ ..] = line {
                comment = Some(names.trim_ascii().to_vec());
                continue;
            }
            let above = comment.take().filter(|_| is_numeric(line));
            self.held = above.is_some();
            return Ok(self.header_of(above.unwrap_or_else(|| line.to_vec())));
        }
        Ok(self.header_of(comment.unwrap_or_default()))
    }

    fn header_of(&mut self, line: Vec<u8>) -> Header {
        self.delimiter = delimiter_of(&line);
        Header { line, delimiter: self.delimiter }
    }

    /// Number of the line, from 1.
    pub(super) fn number(&self) -> u64 {
        self.number
    }

    /// The cells of the row.
    pub(super) fn cells(&self) -> Vec<Cow<'_, [u8]>> {
        cells(&self.line, self.delimiter)
    }

    /// Whether a comma in a number stands for a point.
    pub(super) fn has_decimal_comma(&self) -> bool {
        self.delimiter != b','
    }
}

/// The line of column names.
pub(super) struct Header {
    line: Vec<u8>,
    delimiter: u8,
}

impl Header {
    pub(super) fn columns(&self, path: &str) -> Result<Vec<String>, RecordingError> {
        if self.line.is_empty() {
            return Err(RecordingError::Empty { path: path.into() });
        }
        if is_numeric(&self.line) {
            let first_line: String = String::from_utf8_lossy(&self.line).chars().take(40).collect();
            return Err(RecordingError::NoHeader { path: path.into(), first_line });
        }
        let names = cells(&self.line, self.delimiter);
        if names.len() > MOST_COLUMNS {
            let (path, found) = (path.into(), names.len());
            return Err(RecordingError::TooManyColumns { path, found, limit: MOST_COLUMNS });
        }
        Ok(names.iter().map(|name| String::from_utf8_lossy(name).trim().to_string()).collect())
    }
}

/// Whether all cells are numbers.
fn is_numeric(line: &[u8]) -> bool {
    let line = String::from_utf8_lossy(line);
    let mut cells = line.split([',', ';', '\t', ' ']).map(str::trim).filter(|cell| !cell.is_empty()).peekable();
    cells.peek().is_some() && cells.all(|cell| cell.parse::<f64>().is_ok())
}

/// The separator of a header line: the most frequent one, or else blanks.
fn delimiter_of(header: &[u8]) -> u8 {
    let count = |delimiter: u8| header.iter().filter(|&&byte| byte == delimiter).count();
    let best = [b'\t', b';', b','].into_iter().max_by_key(|&delimiter| count(delimiter)).expect("three candidates");
    if count(best) > 0 { best } else { b' ' }
}

/// The cells of a line without the blanks around them; several blanks in a row separate once. Within quotes nothing
/// separates, and two quotes stand for one.
fn cells(line: &[u8], delimiter: u8) -> Vec<Cow<'_, [u8]>> {
    let mut cells = Vec::new();
    let mut quoted = false;
    let separates = |&byte: &u8| {
        quoted ^= byte == b'"';
        byte == delimiter && !quoted
    };
    let line = line.strip_suffix(b"\n").unwrap_or(line);
    for cell in line.split(separates).map(<[u8]>::trim_ascii) {
        if delimiter == b' ' && cell.is_empty() {
            continue;
        }
        cells.push(match cell {
            [b'"', inner @ .., b'"'] => unquoted(inner),
            cell => Cow::Borrowed(cell),
        });
    }
    cells
}

fn unquoted(inner: &[u8]) -> Cow<'_, [u8]> {
    if !inner.contains(&b'"') {
        return Cow::Borrowed(inner);
    }
    let mut text = Vec::with_capacity(inner.len());
    let mut former_is_quote = false;
    for &byte in inner {
        let doubled = byte == b'"' && former_is_quote;
        if !doubled {
            text.push(byte);
        }
        former_is_quote = byte == b'"' && !doubled;
    }
    Cow::Owned(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(line: &str, delimiter: u8) -> Vec<String> {
        let cells = cells(line.as_bytes(), delimiter);
        cells.iter().map(|cell| String::from_utf8_lossy(cell).into_owned()).collect()
    }

    #[test]
    fn lines_are_cut_into_cells() {
        assert_eq!(texts("a, b ,,c\r\n", b','), ["a", "b", "", "c"]);
        assert_eq!(texts("a,b,\n", b','), ["a", "b", ""]);
        assert_eq!(texts("\"a,b\",\"say \"\"x\"\"\"", b','), ["a,b", "say \"x\""]);
        assert_eq!(texts("  a   b \n", b' '), ["a", "b"]);
        assert_eq!(texts("a\tb\t\n", b'\t'), ["a", "b", ""]);
        assert_eq!(texts("\ta\n", b'\t'), ["", "a"]);
    }
}
