//! The header of a table and its rows, cut into cells.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::io::{self, BufRead};

use crate::RecordingError;

/// Tables with more columns are not logs.
const MOST_COLUMNS: usize = 10_000;
/// Lines, and bytes in them, among which the line of column names is looked for.
const MOST_TITLE_LINES: usize = 50;
const MOST_TITLE_BYTES: usize = 1 << 18;

/// The lines of a table, one at a time: first the header, then the rows.
pub(super) struct Lines<R> {
    text: R,
    line: Vec<u8>,
    /// Number of the line, from 1.
    number: u64,
    /// Lines that were looked at and are still to be given, with their numbers.
    ahead: VecDeque<(u64, Vec<u8>)>,
    /// Lines taken from the text.
    taken: u64,
    delimiter: u8,
    /// The sign that ends a line: a line feed, or a carriage return where there are no line feeds.
    end: u8,
}

impl<R: BufRead> Lines<R> {
    pub(super) fn new(text: R) -> Self {
        Self {
            text,
            line: Vec::new(),
            number: 0,
            ahead: VecDeque::new(),
            taken: 0,
            delimiter: b',',
            end: b'\n',
        }
    }

    /// Looks at the beginning of the text for the sign that ends its lines.
    fn find_end(&mut self) -> io::Result<()> {
        if let [beginning @ .., _] = self.text.fill_buf()?
            && beginning.contains(&b'\r')
            && !beginning.contains(&b'\n')
        {
            self.end = b'\r';
        }
        Ok(())
    }

    /// Goes to the next line that is not empty; `false` after the last one.
    fn next_line(&mut self) -> io::Result<bool> {
        if let Some((number, line)) = self.ahead.pop_front() {
            (self.number, self.line) = (number, line);
            return Ok(true);
        }
        loop {
            self.line.clear();
            if self.text.read_until(self.end, &mut self.line)? == 0 {
                return Ok(false);
            }
            self.taken += 1;
            if !self.line.trim_ascii().is_empty() {
                self.number = self.taken;
                return Ok(true);
            }
        }
    }

    /// Gives the line again.
    fn hold(&mut self) {
        self.ahead.push_front((self.number, std::mem::take(&mut self.line)));
    }

    /// Goes to the next row; `false` after the last one.
    pub(super) fn next_row(&mut self) -> io::Result<bool> {
        while self.next_line()? {
            if !is_comment(self.line.trim_ascii_start()) {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// The header: the first line that is no comment, or, above numbers, the last comment, or a
    /// comment that names columns of a log right above a row that does not. If that names no
    /// columns of a log but a line below it and above the numbers does, it is that one, and what
    /// stands above is a title.
    ///
    /// - `names_columns`: whether cells are column names of a log
    pub(super) fn header(
        &mut self,
        names_columns: impl Fn(&[String]) -> bool,
    ) -> io::Result<Header> {
        self.find_end()?;
        let first = self.first_header(&names_columns)?;
        if is_numeric(&first.line) || names_columns(&first.names()) {
            return Ok(first);
        }
        let mut below: VecDeque<(u64, Vec<u8>)> = VecDeque::new();
        let mut bytes = 0;
        let mut found = None;
        let mut numbers = None;
        while below.len() < MOST_TITLE_LINES && bytes < MOST_TITLE_BYTES && self.next_row()? {
            let line = self.line.trim_ascii().to_vec();
            bytes += line.len();
            let candidate =
                Header { delimiter: delimiter_of(&line), line, titles: 1 + below.len() };
            if is_numeric(&candidate.line) {
                numbers = Some(candidate.line);
                self.hold();
                break;
            }
            if names_columns(&candidate.names()) {
                found = Some(candidate);
                break;
            }
            below.push_back((self.number, std::mem::take(&mut self.line)));
        }
        let header = found.unwrap_or_else(|| {
            let (header, mut rest) = widest(first, below, numbers.as_deref());
            rest.append(&mut self.ahead);
            self.ahead = rest;
            header
        });
        self.delimiter = header.delimiter;
        Ok(header)
    }

    fn first_header(&mut self, names_columns: impl Fn(&[String]) -> bool) -> io::Result<Header> {
        let mut comment: Option<Vec<u8>> = None;
        while self.next_line()? {
            let line = self.line.trim_ascii();
            if let [b'#' | b'%', names @ ..] = line
                && !is_of_spreadsheet(line)
            {
                comment = Some(names.trim_ascii().to_vec());
                continue;
            }
            let own = line.to_vec();
            let is_row_of = |names: &[u8]| {
                let (names, row) =
                    (Header::of(names.to_vec()).names(), Header::of(own.clone()).names());
                names.len() == row.len() && names_columns(&names) && !names_columns(&row)
            };
            let above = comment.take().filter(|names| is_numeric(&own) || is_row_of(names));
            if above.is_some() {
                self.hold();
            }
            return Ok(self.header_of(above.unwrap_or(own)));
        }
        Ok(self.header_of(comment.unwrap_or_default()))
    }

    fn header_of(&mut self, line: Vec<u8>) -> Header {
        let header = Header::of(line);
        self.delimiter = header.delimiter;
        header
    }

    /// The cells of the next line if they are units of the columns, which `are_units` tells; else
    /// that line is still to come.
    pub(super) fn units(
        &mut self,
        are_units: impl Fn(&[String]) -> bool,
    ) -> io::Result<Option<Vec<String>>> {
        if !self.next_row()? {
            return Ok(None);
        }
        let units: Vec<String> =
            self.cells().iter().map(|cell| decoded(cell).trim().to_string()).collect();
        if are_units(&units) {
            return Ok(Some(units));
        }
        self.hold();
        Ok(None)
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

/// Of lines that name no columns that are understood, the first with as many cells as the numbers
/// have, none of them empty, so that a message speaks of names and not of a title; else the first
/// of all. And the lines below it.
fn widest(
    first: Header,
    mut below: VecDeque<(u64, Vec<u8>)>,
    numbers: Option<&[u8]>,
) -> (Header, VecDeque<(u64, Vec<u8>)>) {
    let fits = |line: &[u8]| {
        let delimiter = delimiter_of(line);
        let names = cells(line, delimiter);
        let is_full = names.len() > 1 && names.iter().all(|name| !name.is_empty());
        is_full && numbers.is_some_and(|numbers| cells(numbers, delimiter).len() == names.len())
    };
    let place =
        below.iter().position(|(_, line)| fits(line.trim_ascii())).filter(|_| !fits(&first.line));
    let Some(place) = place else { return (first, below) };
    let rest = below.split_off(place + 1);
    let line = below.pop_back().map(|(_, line)| line.trim_ascii().to_vec()).unwrap_or_default();
    (Header { delimiter: delimiter_of(&line), line, titles: 1 + place }, rest)
}

/// The line of column names.
pub(super) struct Header {
    line: Vec<u8>,
    delimiter: u8,
    /// Lines above it that are no comments.
    pub(super) titles: usize,
}

impl Header {
    fn of(line: Vec<u8>) -> Self {
        Self { delimiter: delimiter_of(&line), line, titles: 0 }
    }

    fn names(&self) -> Vec<String> {
        let cells = cells(&self.line, self.delimiter);
        cells.iter().take(MOST_COLUMNS + 1).map(|name| decoded(name).trim().to_string()).collect()
    }

    pub(super) fn columns(&self, path: &str) -> Result<Vec<String>, RecordingError> {
        require_names_in(path, &self.line, cells(&self.line, self.delimiter).len())?;
        Ok(self.names())
    }
}

/// Refuses what names no columns: nothing, numbers, or more than a log has.
pub(super) fn require_names(path: &str, names: &[String]) -> Result<(), RecordingError> {
    require_names_in(path, names.join(",").as_bytes(), names.len())
}

fn require_names_in(path: &str, line: &[u8], found: usize) -> Result<(), RecordingError> {
    if line.is_empty() {
        return Err(RecordingError::Empty { path: path.into() });
    }
    if is_numeric(line) {
        let first_line: String = String::from_utf8_lossy(line).chars().take(40).collect();
        return Err(RecordingError::NoHeader { path: path.into(), first_line });
    }
    if found > MOST_COLUMNS {
        return Err(RecordingError::TooManyColumns {
            path: path.into(),
            found,
            limit: MOST_COLUMNS,
        });
    }
    Ok(())
}

/// Text in UTF-8, else in Latin-1; signs that were UTF-8 and were written again as if they were
/// Latin-1 are mended.
pub(super) fn decoded(text: &[u8]) -> Cow<'_, str> {
    let text: Cow<'_, str> = match std::str::from_utf8(text) {
        Ok(text) => text.into(),
        Err(_) => text.iter().map(|&byte| char::from(byte)).collect::<String>().into(),
    };
    let twice = ["Â°", "Âº", "Â·", "Âµ", "Â²"];
    if twice.iter().any(|signs| text.contains(signs)) {
        text.replace('Â', "").into()
    } else {
        text
    }
}

/// Whether all cells are numbers.
fn is_numeric(line: &[u8]) -> bool {
    let line = String::from_utf8_lossy(line);
    let mut cells =
        line.split([',', ';', '\t', ' ']).map(str::trim).filter(|cell| !cell.is_empty()).peekable();
    cells.peek().is_some() && cells.all(|cell| cell.parse::<f64>().is_ok())
}

/// The separator of a header line: the most frequent one, or else blanks.
fn delimiter_of(header: &[u8]) -> u8 {
    let count = |delimiter: u8| header.iter().filter(|&&byte| byte == delimiter).count();
    let best = [b'\t', b';', b',']
        .into_iter()
        .max_by_key(|&delimiter| count(delimiter))
        .expect("three candidates");
    if count(best) > 0 { best } else { b' ' }
}

/// The cells of a line without the blanks around them; several blanks in a row separate once.
/// Within quotes nothing separates, and two quotes stand for one.
fn cells(line: &[u8], delimiter: u8) -> Vec<Cow<'_, [u8]>> {
    let mut cells = Vec::new();
    let mut quoted = false;
    let separates = |&byte: &u8| {
        quoted ^= byte == b'"';
        byte == delimiter && !quoted
    };
    let line = line.strip_suffix(b"\n").or(line.strip_suffix(b"\r")).unwrap_or(line);
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

/// What spreadsheets write where a cell has no value; a comment begins like it.
const SPREADSHEET_FAULTS: [&[u8]; 8] =
    [b"#N/A", b"#NV", b"#DIV/0!", b"#VALUE!", b"#REF!", b"#NUM!", b"#NAME?", b"#NULL!"];

fn is_of_spreadsheet(line: &[u8]) -> bool {
    SPREADSHEET_FAULTS.iter().any(|fault| {
        let after = line.strip_prefix(*fault).map(|rest| rest.trim_ascii_start().first());
        matches!(after, Some(None | Some(b',' | b';' | b'\t' | b'"')))
    })
}

fn is_comment(line: &[u8]) -> bool {
    line.starts_with(b"#") && !is_of_spreadsheet(line)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(line: &str, delimiter: u8) -> Vec<String> {
        let cells = cells(line.as_bytes(), delimiter);
        cells.iter().map(|cell| String::from_utf8_lossy(cell).into_owned()).collect()
    }

    #[test]
    fn text_of_several_encodings() {
        assert_eq!(decoded("q_1 [°]".as_bytes()), "q_1 [°]");
        assert_eq!(decoded(b"q_1 [\xb0]"), "q_1 [°]");
        assert_eq!(decoded("q_1 [Â°]".as_bytes()), "q_1 [°]");
        assert_eq!(decoded(b"tau [N\xb7m]"), "tau [N·m]");
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
