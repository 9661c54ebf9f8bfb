//! Reading numbers and strings from bytes that may be anything.

/// What is wrong with a message, in words.
pub(crate) type MessageFault = String;

/// A place in bytes, and the byte order.
#[derive(Clone)]
pub(crate) struct Bytes<'a> {
    bytes: &'a [u8],
    at: usize,
    little_endian: bool,
}

macro_rules! number {
    ($name:ident, $type:ty) => {
        pub(crate) fn $name(&mut self) -> Result<$type, MessageFault> {
            let bytes =
                self.take(size_of::<$type>())?.try_into().expect("as many bytes as were taken");
            Ok(if self.little_endian {
                <$type>::from_le_bytes(bytes)
            } else {
                <$type>::from_be_bytes(bytes)
            })
        }
    };
}

impl<'a> Bytes<'a> {
    pub(crate) fn new(bytes: &'a [u8], little_endian: bool) -> Self {
        Self { bytes, at: 0, little_endian }
    }

    number!(u16, u16);
    number!(u32, u32);
    number!(u64, u64);
    number!(i32, i32);
    number!(f32, f32);
    number!(f64, f64);

    pub(crate) fn at(&self) -> usize {
        self.at
    }

    pub(crate) fn left(&self) -> usize {
        self.bytes.len() - self.at
    }

    pub(crate) fn rest(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    pub(crate) fn take(&mut self, count: usize) -> Result<&'a [u8], MessageFault> {
        if count > self.left() {
            return Err(format!(
                "{count} bytes are needed at byte {}, but {} are left",
                self.at,
                self.left()
            ));
        }
        self.at += count;
        Ok(&self.bytes[self.at - count..self.at])
    }

    /// A length that as many elements of at least `size` bytes must still follow.
    pub(crate) fn length(&mut self, size: usize) -> Result<usize, MessageFault> {
        let at = self.at;
        let count = self.u32()? as usize;
        if count.saturating_mul(size) > self.left() {
            return Err(format!(
                "a length of {count} at byte {at}, but only {} bytes follow",
                self.left()
            ));
        }
        Ok(count)
    }

    /// Text after its length.
    pub(crate) fn text(&mut self) -> Result<std::borrow::Cow<'a, str>, MessageFault> {
        let length = self.length(1)?;
        self.take(length).map(String::from_utf8_lossy)
    }
}
