//! Files of strangers, whole, within a limit that holds whatever their size is said to be.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// The content of a file; beyond `limit` bytes the error is how many there are at least. A device
/// or a pipe, which has no size, is read up to the limit.
///
/// # Errors
/// If it cannot be read.
pub fn read(path: &Path, limit: u64) -> io::Result<Result<Vec<u8>, u64>> {
    let file = File::open(path)?;
    let size = file.metadata()?.len();
    if size > limit {
        return Ok(Err(size));
    }
    let mut bytes = Vec::with_capacity(usize::try_from(size).unwrap_or_default());
    file.take(limit + 1).read_to_end(&mut bytes)?;
    let found = bytes.len() as u64;
    Ok(if found > limit { Err(found) } else { Ok(bytes) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_within_the_limit_is_read_and_what_has_no_end_is_not() {
        let file = tempfile::NamedTempFile::new().expect("a writable folder");
        std::fs::write(file.path(), b"abc").expect("a writable folder");
        assert_eq!(read(file.path(), 3).expect("readable"), Ok(b"abc".to_vec()));
        assert_eq!(read(file.path(), 2).expect("readable"), Err(3));
        if Path::new("/dev/zero").exists() {
            assert_eq!(read(Path::new("/dev/zero"), 1000).expect("readable"), Err(1001));
        }
    }
}
