//! ROS 2 messages in Common Data Representation (OMG CDR, XCDR version 1), and those of ROS 1,
//! which are the same without header and padding.
//!
//! Source: OMG DDS-RTPS 2.5, section 10; values are aligned to their size, counted from the end of
//! the 4-byte header. ROS 1: <https://wiki.ros.org/ROS/Technical%20Overview>, serialization.

use std::borrow::Cow;

use super::bytes::{Bytes, MessageFault};

/// A message being read.
pub(super) struct Cdr<'a> {
    bytes: Bytes<'a>,
    /// Nothing is aligned, and headers are those of ROS 1.
    ros1: bool,
}

impl<'a> Cdr<'a> {
    pub(super) fn new(message: &'a [u8]) -> Result<Self, MessageFault> {
        match message {
            [0, order @ (0 | 1), _, _, body @ ..] => {
                Ok(Self { bytes: Bytes::new(body, *order == 1), ros1: false })
            }
            [first, second, _, _, ..] => Err(format!(
                "the CDR encapsulation {first:02x} {second:02x} is not supported (plain CDR is: 00 \
                 00, 00 01)"
            )),
            _ => Err(format!(
                "a CDR message has a header of 4 bytes, this one {} bytes in all",
                message.len()
            )),
        }
    }

    /// A message of ROS 1: little-endian.
    pub(super) fn ros1(message: &'a [u8]) -> Self {
        Self { bytes: Bytes::new(message, true), ros1: true }
    }

    fn align(&mut self, size: usize) -> Result<(), MessageFault> {
        if self.ros1 {
            return Ok(());
        }
        let padding = self.bytes.at().next_multiple_of(size) - self.bytes.at();
        self.bytes.take(padding).map(drop)
    }

    fn length(&mut self, size: usize) -> Result<usize, MessageFault> {
        self.align(4)?;
        self.bytes.length(size)
    }

    pub(super) fn i32(&mut self) -> Result<i32, MessageFault> {
        self.align(4)?;
        self.bytes.i32()
    }

    pub(super) fn u32(&mut self) -> Result<u32, MessageFault> {
        self.align(4)?;
        self.bytes.u32()
    }

    pub(super) fn f32(&mut self) -> Result<f32, MessageFault> {
        self.align(4)?;
        self.bytes.f32()
    }

    pub(super) fn f64(&mut self) -> Result<f64, MessageFault> {
        self.align(8)?;
        self.bytes.f64()
    }

    pub(super) fn text(&mut self) -> Result<Cow<'a, str>, MessageFault> {
        let length = self.length(1)?;
        let bytes = self.bytes.take(length)?;
        Ok(String::from_utf8_lossy(bytes.strip_suffix(&[0]).unwrap_or(bytes)))
    }

    pub(super) fn texts(&mut self, most: usize) -> Result<Vec<Cow<'a, str>>, MessageFault> {
        let count = self.length(4)?;
        if count > most {
            return Err(format!("{count} names, at most {most} are read"));
        }
        (0..count).map(|_| self.text()).collect()
    }

    pub(super) fn f64s(&mut self) -> Result<Vec<f64>, MessageFault> {
        let count = self.length(8)?;
        (0..count).map(|_| self.f64()).collect()
    }

    /// `std_msgs/msg/Header`: the stamp in ns.
    pub(super) fn header(&mut self) -> Result<i64, MessageFault> {
        let seconds = if self.ros1 {
            self.u32()?; // counter
            i64::from(self.u32()?)
        } else {
            i64::from(self.i32()?)
        };
        let nanoseconds = self.u32()?;
        self.text()?; // frame
        Ok(seconds * 1_000_000_000 + i64::from(nanoseconds))
    }
}

/// A little-endian message being written.
pub(super) struct CdrWriter(Vec<u8>);

impl CdrWriter {
    const HEADER: [u8; 4] = [0, 1, 0, 0];

    pub(super) fn new() -> Self {
        Self(Self::HEADER.to_vec())
    }

    pub(super) fn finish(self) -> Vec<u8> {
        self.0
    }

    fn align(&mut self, size: usize) {
        let body = self.0.len() - Self::HEADER.len();
        self.0.resize(Self::HEADER.len() + body.next_multiple_of(size), 0);
    }

    pub(super) fn u32(&mut self, value: u32) {
        self.align(4);
        self.0.extend(value.to_le_bytes());
    }

    pub(super) fn f64s(&mut self, values: &[f64]) {
        self.length(values.len());
        if !values.is_empty() {
            self.align(8);
        }
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    }

    pub(super) fn text(&mut self, text: &str) {
        self.length(text.len() + 1);
        self.0.extend(text.bytes().chain([0]));
    }

    pub(super) fn texts(&mut self, texts: &[String]) {
        self.length(texts.len());
        texts.iter().for_each(|text| self.text(text));
    }

    fn length(&mut self, length: usize) {
        self.u32(u32::try_from(length).expect("names and rows of a recording are short"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let mut message = CdrWriter::new();
        message.u32(7);
        message.text("abc");
        message.texts(&["joint_1".into(), String::new()]);
        message.f64s(&[1.5, -2.5]);
        message.f64s(&[]);
        let bytes = message.finish();
        let mut cdr = Cdr::new(&bytes).expect("header");
        assert_eq!(cdr.u32(), Ok(7));
        assert_eq!(cdr.text().as_deref(), Ok("abc"));
        assert_eq!(cdr.texts(9).expect("names"), ["joint_1", ""]);
        assert_eq!(cdr.f64s(), Ok(vec![1.5, -2.5]));
        assert_eq!(cdr.f64s(), Ok(vec![]));
        assert!(cdr.u32().is_err());
    }

    #[test]
    fn both_byte_orders() {
        let little = [0, 1, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f];
        let mut cdr = Cdr::new(&little).expect("header");
        assert_eq!((cdr.u32(), cdr.f64()), (Ok(2), Ok(1.0)));
        let big = [0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0x3f, 0xf0, 0, 0, 0, 0, 0, 0];
        let mut cdr = Cdr::new(&big).expect("header");
        assert_eq!((cdr.u32(), cdr.f64()), (Ok(2), Ok(1.0)));
    }

    #[test]
    fn ros1_has_a_counter_and_no_padding() {
        let message = [9, 0, 0, 0, 0, 0, 0, 0x80, 5, 0, 0, 0, 1, 0, 0, 0, b'a', 7, 0, 0, 0];
        let mut cdr = Cdr::ros1(&message);
        assert_eq!(cdr.header(), Ok((1 << 31) * 1_000_000_000 + 5));
        assert_eq!(cdr.u32(), Ok(7));
        assert!(cdr.u32().is_err());
    }

    #[test]
    fn lengths_beyond_the_message_are_refused() {
        let huge = [0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 1, 2, 3];
        assert!(
            Cdr::new(&huge).expect("header").f64s().expect_err("too long").contains("4294967295")
        );
        assert!(Cdr::new(&huge).expect("header").text().is_err());
        assert!(Cdr::new(&huge).expect("header").texts(10).is_err());
        assert!(Cdr::new(&[0, 7, 0, 0]).err().expect("XCDR2").contains("not supported"));
        assert!(Cdr::new(&[0, 1]).is_err());
    }
}
