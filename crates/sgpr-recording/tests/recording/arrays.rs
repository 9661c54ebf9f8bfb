//! Files of arrays, which `data/recording/arrays/make_arrays.py` wrote with NumPy, SciPy and h5py.

use std::path::PathBuf;

use sgpr_recording::csv::{self, ReadOptions};
use sgpr_recording::{Format, Reader, Recording, RecordingError, read};

use super::{file, message};

fn path(name: &str) -> PathBuf {
    super::fixture("arrays").join(name)
}

fn bytes(name: &str) -> Vec<u8> {
    std::fs::read(path(name)).expect("a fixture")
}

/// What a file holds must be what is in a table, to the last bit.
fn same(name: &str, table: &str, joints: [&str; 2]) -> Recording {
    let found = read(path(name), None).unwrap_or_else(|error| panic!("{error}"));
    let expected = csv::read(path(table), &ReadOptions::default()).expect("a table");
    assert_eq!(found.joint_names(), joints, "{name}");
    assert_eq!(found.time(), expected.time(), "{name}");
    assert_eq!(found.position(), expected.position(), "{name}");
    assert_eq!(found.velocity(), expected.velocity(), "{name}");
    assert_eq!(found.torque(), expected.torque(), "{name}");
    found
}

const NAMED: [&str; 2] = ["shoulder", "elbow_2"];
const NUMBERED: [&str; 2] = ["joint_1", "joint_2"];

fn read_with(
    name: &str,
    content: &[u8],
    options: &ReadOptions,
) -> Result<Recording, RecordingError> {
    let (_folder, path) = file(name, content);
    match Format::of(&path)?.read {
        Reader::Table(read) => read(&path, options),
        Reader::Topics(_) => panic!("{name} holds arrays"),
    }
}

/// How a damaged file is refused.
fn refusal(name: &str, content: &[u8]) -> String {
    message(read_with(name, content, &ReadOptions::default()))
}

fn refuses_more_than(name: &str, content: &[u8], limit: u64) {
    let options = ReadOptions::default().with_limit_bytes(limit);
    let error = read_with(name, content, &options).expect_err("a file that is too large");
    assert!(
        matches!(error, RecordingError::TooLarge { limit: told, .. } if told == limit),
        "{error}"
    );
}

#[cfg(feature = "numpy")]
mod numpy {
    use super::*;

    #[test]
    fn archives() {
        for name in ["stored.npz", "packed.npz"] {
            same(name, "log.csv", NAMED);
        }
        let turned = same("fortran.npz", "log.csv", NUMBERED);
        assert_eq!(turned.notes(), ["skipped arrays: extra"]);
        same("narrow.npz", "coarse.csv", NUMBERED);
        same("dates.npz", "coarse.csv", NUMBERED);
    }

    #[test]
    fn damaged_archives() {
        let whole = bytes("packed.npz");
        for length in [10, 100, whole.len() / 2, whole.len() - 5] {
            let said = refusal("log.npz", &whole[..length]);
            assert!(said.contains("not a NumPy archive, or damaged"), "{length}: {said}");
        }
        refuses_more_than("log.npz", &whole, 1000);
    }

    /// No byte of data, and as many values as the header likes.
    #[test]
    fn lengths_of_nothing() {
        for (kind, shape) in
            [("<U0", "(1099511627776,)"), ("<f8", "(1099511627776, 1099511627776, 0)")]
        {
            let header =
                format!("{{'descr': '{kind}', 'fortran_order': True, 'shape': {shape}}}\n");
            let length = u16::try_from(header.len()).expect("a short header").to_le_bytes();
            let array = [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes()].concat();
            let said = refusal("log.npz", &stored("q.npy", &array));
            assert!(said.contains("no array `t`"), "{said}");
        }
    }

    /// An archive of one member as it is.
    fn stored(name: &str, content: &[u8]) -> Vec<u8> {
        let mut checksum = flate2::Crc::new();
        checksum.update(content);
        let length = u32::try_from(content.len()).expect("a short file").to_le_bytes();
        let name_length = u16::try_from(name.len()).expect("a short name").to_le_bytes();
        let about =
            [&[0; 8][..], &checksum.sum().to_le_bytes(), &length, &length, &name_length, &[0; 2]]
                .concat();
        let local = [b"PK\x03\x04\x14\x00", &about[..], name.as_bytes(), content].concat();
        let central =
            [b"PK\x01\x02\x14\x00\x14\x00", &about[..], &[0; 14], name.as_bytes()].concat();
        let size = u32::try_from(central.len()).expect("short").to_le_bytes();
        let place = u32::try_from(local.len()).expect("short").to_le_bytes();
        let end =
            [b"PK\x05\x06\x00\x00\x00\x00\x01\x00\x01\x00", &size[..], &place, &[0; 2]].concat();
        [local, central, end].concat()
    }
}

#[cfg(feature = "matlab")]
mod matlab {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::ZlibEncoder;
    use sgpr_recording::csv::{ColumnMap, Columns};

    use super::*;

    #[test]
    fn versions() {
        for name in ["version_4.mat", "plain.mat", "packed.mat", "version_7_3.mat"] {
            assert!(same(name, "log.csv", NAMED).notes().is_empty(), "{name}");
        }
    }

    #[test]
    fn what_stands_in_a_structure_and_beside_it() {
        let log = same("structure.mat", "log.csv", NAMED);
        let notes = log.notes().join("; ");
        for told in [
            "skipped arrays: gains",
            "`para.rates` (complex numbers)",
            "`some` (a cell)",
            "`map` (a sparse matrix)",
            "`rec2` (an object)",
        ] {
            assert!(notes.contains(told), "{told}: {notes}");
        }
    }

    #[test]
    fn whole_numbers_are_seconds_where_they_are_floats() {
        let log = read(path("big_endian.mat"), None).expect("a log");
        let expected = csv::read(path("coarse.csv"), &ReadOptions::default()).expect("a table");
        assert_eq!(log.time()[..3], [0, 1_000_000_000, 2_000_000_000]);
        assert_eq!(log.position(), expected.position());
        assert_eq!(log.torque(), expected.torque());
    }

    #[test]
    fn the_content_tells_the_format_and_the_version() {
        let (_folder, path) = file("log", bytes("packed.mat"));
        assert_eq!(Format::of(path).expect("known").name, "MATLAB");
        let (_folder, path) = file("log", bytes("version_7_3.mat"));
        assert_eq!(Format::of(path).expect("known").name, "MATLAB");
    }

    #[test]
    fn damaged_files() {
        for name in ["plain.mat", "packed.mat", "structure.mat", "version_4.mat"] {
            let whole = bytes(name);
            let lengths = [0, 3, 60, 131, 400, whole.len() / 2, whole.len() - 1];
            for length in lengths {
                let said = refusal("log.mat", &whole[..length]);
                assert!(said.contains("not a MATLAB file, or damaged"), "{name} {length}: {said}");
            }
        }
    }

    #[test]
    fn a_missing_file_and_a_folder_are_no_damage() {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["none.mat", "none.h5"] {
            let error = read(folder.path().join(name), None).expect_err("no file");
            assert!(matches!(error, RecordingError::Unreadable { .. }), "{error}");
            let path = folder.path().join(format!("folder_{name}"));
            std::fs::create_dir(&path).expect("a writable folder");
            let error = read(&path, None).expect_err("a folder");
            assert!(matches!(error, RecordingError::UnknownFolder { .. }), "{error}");
        }
    }

    fn element(kind: u32, data: &[u8]) -> Vec<u8> {
        let length = u32::try_from(data.len()).expect("a short element");
        let mut bytes = [kind.to_le_bytes(), length.to_le_bytes()].concat();
        bytes.extend_from_slice(data);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    }

    fn variable(class: u8, rows: i32, columns: i32, values: &[u8]) -> Vec<u8> {
        let shape = [rows.to_le_bytes(), columns.to_le_bytes()].concat();
        let head =
            [element(6, &[class, 0, 0, 0, 0, 0, 0, 0]), element(5, &shape), element(1, b"q")];
        element(14, &[head.concat(), values.to_vec()].concat())
    }

    fn with_header(variables: &[u8]) -> Vec<u8> {
        let mut bytes = b"MATLAB 5.0 MAT-file".to_vec();
        bytes.resize(124, b' ');
        [&bytes, &[0, 1][..], b"IM", variables].concat()
    }

    fn packed(variable: &[u8]) -> Vec<u8> {
        let mut packer = ZlibEncoder::new(Vec::new(), Compression::best());
        packer.write_all(variable).expect("memory");
        let packed = packer.finish().expect("memory");
        let length = u32::try_from(packed.len()).expect("a short element");
        [&15_u32.to_le_bytes()[..], &length.to_le_bytes(), &packed].concat()
    }

    #[test]
    fn lengths_that_are_not_true() {
        let numbers = element(9, &[0; 80]);
        for (rows, columns) in [(10, 2), (i32::MAX, i32::MAX), (-1, 10), (0, i32::MAX)] {
            let said = refusal("log.mat", &with_header(&variable(6, rows, columns, &numbers)));
            assert!(said.contains("not a MATLAB file, or damaged"), "{rows}: {said}");
        }
        let cell = with_header(&variable(1, i32::MAX, i32::MAX, &[]));
        assert!(refusal("log.mat", &cell).contains("it ends early"));
        let mut deep = element(9, &[0; 8]);
        for _ in 0..2000 {
            deep = variable(
                2,
                1,
                1,
                &[element(5, &2_u32.to_le_bytes()), element(1, b"a\0"), deep].concat(),
            );
        }
        assert!(refusal("log.mat", &with_header(&deep)).contains("too deep"));
    }

    #[test]
    fn what_is_packed_must_fit() {
        let bomb = packed(&variable(6, 1, 1 << 21, &element(9, &vec![0; 8 << 21])));
        assert!(bomb.len() < 20_000);
        refuses_more_than("log.mat", &with_header(&bomb), 1_000_000);
        // Each number takes eight bytes, whatever it takes in the file.
        let bytes = variable(9, 1, 200_000, &element(2, &[0; 200_000]));
        refuses_more_than("log.mat", &with_header(&bytes), 1_000_000);
        refuses_more_than("log.mat", &super::bytes("plain.mat"), 100);
    }

    #[test]
    fn arrays_under_other_names() {
        let map = ColumnMap::default().with_position(Some(Columns::Pattern("tau".into())));
        let options = ReadOptions::default().with_columns(map);
        let log =
            sgpr_recording::arrays::matlab::read(path("packed.mat"), &options).expect("a log");
        let expected = csv::read(path("log.csv"), &ReadOptions::default()).expect("a table");
        assert_eq!(Some(log.position()), expected.torque());
    }
}

#[cfg(feature = "hdf5")]
mod hdf5 {
    use super::*;

    #[test]
    fn versions_and_filters() {
        for name in ["earliest.h5", "latest.h5", "packed.h5"] {
            same(name, "log.csv", NAMED);
        }
        same("lzf.h5", "log.csv", NUMBERED);
        let log = same("narrow.h5", "coarse.csv", NUMBERED);
        assert_eq!(log.channel("moving").expect("truth values").values[2..5], [0.0, 0.0, 1.0]);
        let notes = log.notes().join("; ");
        assert!(notes.contains("`record` (neither numbers nor text)"), "{notes}");
        assert!(notes.contains("`grown` (chunks of an array that could grow"), "{notes}");
    }

    /// As HDF5 1.6 and MATLAB 7.4 wrote it, which `hdf5-reader` takes for damage.
    #[test]
    fn an_array_described_in_an_old_way() {
        let mut content = bytes("earliest.h5");
        let size = (8 * 30_u64).to_le_bytes();
        let is_layout = |bytes: &[u8]| bytes.starts_with(&[3, 1]) && bytes[10..] == size;
        let at = content.windows(18).position(is_layout).expect("the layout of `t`");
        let address = content[at + 2..at + 10].to_vec();
        content[at..at + 8].copy_from_slice(&[2, 2, 1, 0, 0, 0, 0, 0]);
        content[at + 8..at + 16].copy_from_slice(&address);
        content[at + 16..at + 20].copy_from_slice(&30_u32.to_le_bytes());
        content[at + 20..at + 24].copy_from_slice(&8_u32.to_le_bytes());
        let log = read_with("log.h5", &content, &ReadOptions::default()).expect("a log");
        assert_eq!(log.time(), read(path("earliest.h5"), None).expect("a log").time());
    }

    #[test]
    fn units_stand_beside_arrays() {
        let log = same("units.h5", "coarse.csv", NUMBERED);
        let layout = log.layout().expect("read as a table");
        assert!(format!("{layout:?}").contains("Nm"), "{layout:?}");
    }

    #[test]
    fn damaged_files() {
        for name in ["earliest.h5", "latest.h5", "packed.h5", "lzf.h5"] {
            let whole = bytes(name);
            for length in [8, 60, 600, whole.len() / 2, whole.len() - 1] {
                let said = refusal("log.h5", &whole[..length]);
                assert!(said.contains("not an HDF5 file, or damaged"), "{name} {length}: {said}");
            }
        }
        let said = refusal("log.h5", b"no such file at all");
        assert!(said.contains("not an HDF5 file, or damaged"), "{said}");
    }

    #[test]
    fn what_is_packed_must_fit() {
        refuses_more_than("log.h5", &bytes("packed.h5"), 1000);
        refuses_more_than("log.h5", &bytes("lzf.h5"), 8000);
    }
}
