//! Writing a file so that readers see the old one or the new one, never a half.

use std::fs::OpenOptions;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use tempfile::NamedTempFile;

/// Lets `fill` write a new file beside `path`, then renames it to `path`. A link stays one: what it
/// leads to is written. A device or a pipe, which must not be replaced by a file, is written to
/// once the content is whole.
pub fn write(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut NamedTempFile>) -> io::Result<()>,
) -> io::Result<()> {
    let resolved = std::fs::canonicalize(path);
    let path = resolved.as_deref().unwrap_or(path);
    if std::fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir()) {
        let whole = filled(new_file(&std::env::temp_dir())?, fill)?;
        let mut content = whole.reopen()?;
        let mut stream = OpenOptions::new().write(true).open(path)?;
        io::copy(&mut content, &mut stream)?;
        return stream.flush();
    }
    let folder =
        path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = filled(new_file(folder)?, fill)?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

fn filled(
    mut file: NamedTempFile,
    fill: impl FnOnce(&mut BufWriter<&mut NamedTempFile>) -> io::Result<()>,
) -> io::Result<NamedTempFile> {
    let mut writer = BufWriter::new(&mut file);
    fill(&mut writer)?;
    writer.flush()?;
    drop(writer);
    Ok(file)
}

fn new_file(folder: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".sgpr-").suffix(".part");
    #[cfg(unix)]
    {
        // Temporary files are private by default; these are as readable as any other new file.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

#[cfg(all(test, unix))]
mod tests {
    use std::io::Read;
    use std::os::unix::fs::{FileTypeExt, symlink};

    use super::*;

    #[test]
    fn devices_pipes_and_links_stay_what_they_are() {
        let folder = tempfile::tempdir().expect("a folder");
        let device = folder.path().join("null");
        symlink("/dev/null", &device).expect("a link");
        write(&device, |file| file.write_all(b"whole")).expect("a device takes everything");
        assert!(std::fs::metadata(&device).expect("there").file_type().is_char_device());

        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        std::fs::write(&file, "old").expect("written");
        symlink(&file, &link).expect("a link");
        write(&link, |file| file.write_all(b"new")).expect("written");
        assert!(std::fs::symlink_metadata(&link).expect("there").is_symlink());
        assert_eq!(std::fs::read(&file).expect("there"), b"new");

        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if !made.is_ok_and(|status| status.success()) {
            println!("skipped: no mkfifo");
            return;
        }
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || {
                let mut text = String::new();
                std::fs::File::open(pipe).expect("a pipe").read_to_string(&mut text).expect("text");
                text
            }
        });
        write(&pipe, |file| file.write_all(b"through")).expect("read at the other end");
        assert_eq!(reader.join().expect("read"), "through");
        assert!(std::fs::metadata(&pipe).expect("there").file_type().is_fifo());
    }
}
