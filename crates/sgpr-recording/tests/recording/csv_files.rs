//! The text of tables: rows, time, packing, writing.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;
use proptest::prelude::*;
use sgpr_recording::csv::{self, ReadOptions, Rows};
use sgpr_recording::{Channel, Recording};

use super::{csv_error, file, message, names, read_csv, read_csv_with};

fn packed(text: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(text).and_then(|()| encoder.finish()).expect("writes to memory")
}

#[test]
fn time_is_exact() {
    let log = read_csv("t,q1\n60.0040,0\n1700000000.123456789,0\n0.0000000015,0\n-1e-3,0\n");
    assert_eq!(log.time(), [60_004_000_000, 1_700_000_000_123_456_789, 2, -1_000_000]);
}

#[test]
fn ros_stamps_in_two_columns() {
    let log = read_csv("header.stamp.sec,header.stamp.nanosec,q1\n1700000000,5,0\n");
    assert_eq!(log.time(), [1_700_000_000_000_000_005]);
    assert!(log.channels().is_empty());
}

#[test]
fn large_times_without_unit_are_since_1970() {
    let log = read_csv("timestamp,q1\n1700000000123456789,0\n1700000000133456789,0\n");
    assert_eq!(log.time()[0], 1_700_000_000_123_456_789);
    assert_eq!(log.notes(), ["the column `timestamp` is taken for ns since 1970"]);
    assert_eq!(read_csv("timestamp,q1\n1700000000123,0\n").time(), [1_700_000_000_123_000_000]);
}

#[test]
fn a_log_without_time() {
    let error = csv_error("q1,q2\n0,1\n");
    assert_eq!(
        error,
        "log.csv: no time column among `q1`, `q2`; name it with `columns.time`, or give \
         `sample_rate_hz` for a log of constant rate"
    );
    let options = ReadOptions::default().with_sample_rate_hz(Some(300.0));
    let log = read_csv_with("q1\n0\n1\n2\n3\n", &options).expect("readable");
    assert_eq!(log.time(), [0, 3_333_333, 6_666_667, 10_000_000]);
    assert_eq!(log.notes(), [""; 0]);
    let log = read_csv_with("t,q1\n0,0\n7,1\n", &options).expect("readable");
    assert_eq!(log.time(), [0, 3_333_333]);
    assert_eq!(log.notes(), ["the time is counted by the rate given, not taken from `t`"]);
    let options = ReadOptions::default().with_sample_rate_hz(Some(-1.0));
    assert_eq!(
        message(read_csv_with("q1\n0\n", &options)),
        "sample_rate_hz = -1: a positive number of samples per second"
    );
}

#[test]
fn what_other_programs_write_is_named() {
    // A value that a spreadsheet lacks is no comment.
    let lacking = csv_error("t,q1\n0,1\n#N/A,\n1,1\n");
    assert!(lacking.starts_with(
        "log.csv:3: column `t`: `#N/A` is not a time in s (a spreadsheet has no value"
    ));
    let lacking = csv_error("t,q1\n0,1\n1,#DIV/0!\n");
    assert!(lacking.starts_with(
        "log.csv:3: column `q1`: `#DIV/0!` is not a number (a spreadsheet has no value"
    ));
    assert_eq!(read_csv("t,q1\n0,1\n# N/A\n#note,2\n1,1\n").len(), 2);
    let thousands = " (it has a separator of thousands: export the numbers without)";
    for (text, line) in
        [("t;q1\n0;1.234,5\n", "1.234,5"), ("t,q1\n0,\"-1'234'567.8\"\n", "-1'234'567.8")]
    {
        let error = csv_error(text);
        assert_eq!(error, format!("log.csv:2: column `q1`: `{line}` is not a number{thousands}"));
    }
    assert!(csv_error("t;q1\n10.000,5;1\n").ends_with("thousands: export the numbers without)"));
    assert!(
        csv_error("<!DOCTYPE HTML><p>Sign in</p>")
            .contains("this is a web page, not CSV: download the file")
    );
    assert!(csv_error("\n<?xml version=\"1.0\"?>").contains("this is an XML file, not CSV"));
}

#[test]
fn all_separators() {
    for text in [
        "t,q1,q2\n0,1.5,2\n",
        "t;q1;q2\n0;1,5;2\n",
        "t\tq1\tq2\n0\t1,5\t2\n",
        "t  q1 q2\n 0   1.5  2 \n",
    ] {
        assert_eq!(read_csv(text).position(), [1.5, 2.0], "{text}");
    }
}

#[test]
fn oddities_of_loggers() {
    for text in [
        "\u{feff}t,q1\r\n0,1\r\n",
        "# made by me\n\nt,q1\n0,1\n\n",
        "# t q1\n0 1\n",
        "t,q1\n# stop\n0,1,\n",
        "\"t\",\"q1\"\n\"0\",\"1\"\n",
        "t,q1,\n0,1,\n",
        "t,q1\n0,1",
        "t,q1\r0,1\r",
        "%t,seq,q1,frame\n0,7,1,base\n",
        "# made by me\n# t,mode,q1\n0,idle,1\n",
    ] {
        assert_eq!(read_csv(text).position(), [1.0], "{text}");
    }
}

#[test]
fn missing_values_are_nan() {
    let log = read_csv("t,q1,temperature\n0,,nan\n1,NaN,40\n2,1,\n");
    assert!(log.position()[0].is_nan() && log.position()[1].is_nan());
    assert!(log.channels()[0].values[0].is_nan() && log.channels()[0].values[2].is_nan());
}

#[test]
fn text_columns_are_skipped_with_a_note() {
    let log = read_csv("t,q1,mode,on\n0,1,idle,true\n1,2,run,false\n");
    assert_eq!(log.notes(), ["skipped columns of text: `mode`"]);
    assert_eq!(log.channel("on").expect("kept").values, [1.0, 0.0]);
}

#[test]
fn text_among_numbers() {
    assert_eq!(csv_error("t,q1\n0,1\n1,abc\n"), "log.csv:3: column `q1`: `abc` is not a number");
    assert_eq!(
        csv_error("t,q1,x\n0,1,2\n\n1,1,abc\n"),
        "log.csv:4: column `x`: `abc` is not a number"
    );
    let error = csv_error("t,q1\nnow,1\n");
    assert!(error.starts_with("log.csv:2: column `t`: `now` is not a time in s"), "{error}");
    assert_eq!(csv_error("t,q1\n,1\n"), "log.csv:2: column `t`: `` is not a time in s");
    let again = "(the names of the columns come again here, as where logs were put together: read \
         the parts one by one, `rows`)";
    assert_eq!(
        csv_error("t,q1\n0,1\nt,q1\n0,1\n"),
        format!("log.csv:3: column `t`: `t` is not a time in s {again}")
    );
    assert_eq!(
        csv_error("t,q1\n0,1\n1,q1\n"),
        format!("log.csv:3: column `q1`: `q1` is not a number {again}")
    );
    let error = csv_error("t,q1\ns,rad\nx,1\n");
    assert!(
        error.starts_with(
            "log.csv:3: column `t`: `x` is not a time in s (times are numbers, ISO 8601 "
        ),
        "{error}"
    );
}

#[test]
fn titles_above_the_names() {
    for text in [
        "Aufzeichnung KR6;;\nt;q1;q2\n0;1,5;2\n",
        "Aufzeichnung KR6\nvom 3. Maerz, 14 Uhr\n\nt;q1;q2\n0;1,5;2\n",
        "sep=;\nt;q1;q2\n0;1,5;2\n",
        "robot,KR6,12\nt,q1,q2\n0,1.5,2\n",
    ] {
        let log = read_csv(text);
        assert_eq!(log.position(), [1.5, 2.0], "{text}");
        assert!(log.notes()[0].ends_with("above the names of the columns"), "{:?}", log.notes());
    }
    // What is no header nowhere is spoken of as before.
    let error = csv_error("x,y\n0,1\n1,2\n");
    assert!(error.starts_with("log.csv: no time column among `x`, `y`"), "{error}");
    let error = csv_error("title\nx,y\n0,1\n");
    assert!(error.starts_with("log.csv: no time column among `x`, `y`"), "{error}");
    let error = csv_error("Cell 4;;\nUhr;A1 Ist;A2 Ist\ns;grad;grad\n0;1,5;2,5\n");
    assert!(
        error.starts_with("log.csv: no time column among `Uhr`, `A1 Ist`, `A2 Ist`"),
        "{error}"
    );
    // Joints that the robot does not have are joints all the same: the title is not taken for the
    // names.
    let elbow = ReadOptions::default().with_joints(Some(vec!["elbow".into()]));
    let other = message(read_csv_with(
        "Cell 4; monitor\nclock_ms;Ax1 pos [deg];Ax2 pos [deg]\n0;1;2\n",
        &elbow,
    ));
    assert!(
        other.contains("Ax1") && other.contains("elbow") && !other.contains("no time column"),
        "{other}"
    );
    // Line numbers count titles.
    assert!(csv_error("title\nt,q1\n0,x\n").starts_with("log.csv:3: column `q1`"));
}

#[test]
fn a_line_of_units_below_the_names() {
    let expected = [std::f64::consts::PI, 0.25];
    for text in [
        "t,q1,q2,tau1,tau2\nms,deg,mm,Nm,N\n1500,180,250,3,4\n",
        "t;q1;q2;tau1;tau2\n[ms];[°];[mm];[Nm];[N]\n1500;180;250;3;4\n",
        "t\tq1\tq2\ttau1\ttau2\nms\tdeg\tmm\t\t-\n1500\t180\t250\t3\t4\n",
        "t,q1_deg,q2_mm,tau1,tau2\nms,,,N.m,N\n1500,180,250,3,4\n",
    ] {
        let log = read_csv(text);
        assert_eq!(log.time(), [1_500_000_000], "{text}");
        assert_eq!(log.position(), expected, "{text}");
        assert_eq!(log.torque(), Some(&[3.0, 4.0][..]), "{text}");
    }
    assert_eq!(
        csv_error("t,q1\nms,inc\n0,1\n"),
        "log.csv: column `q1`: `inc` is no known unit of position: give the unit with \
         `units.position`"
    );
}

#[test]
fn degrees_in_every_encoding() {
    let half_turn = std::f64::consts::PI;
    for header in [
        "t,q_1 [°]".as_bytes(),
        b"t,q_1 [\xb0]",
        b"t,q_1 [\xf8]",
        "t,q_1 [Â°]".as_bytes(),
        "t,q_1 [º]".as_bytes(),
        "t,q_1 [\u{fffd}]".as_bytes(),
    ] {
        let log = read_csv([header, b"\n0,180\n"].concat());
        assert_eq!(log.position(), [half_turn], "{header:?}");
    }
    // A pattern of the caller, who sees the sign, fits the name in Latin-1.
    let position = Some(csv::Columns::Pattern("Achse {} [°]".into()));
    let columns = csv::ColumnMap::default().with_position(position);
    let options = ReadOptions::default().with_columns(columns);
    let log = read_csv_with(b"t;Achse 1 [\xb0]\n0;180\n", &options).expect("readable");
    assert_eq!(log.position(), [half_turn]);
}

#[test]
fn dates_and_times_of_day() {
    let start = 1_772_529_300_000_000_000;
    for text in [
        "time,q1\n2026-03-03T09:15:00.000+00:00,0\n2026-03-03T09:15:00.004+00:00,1\n",
        "time,q1\n2026-03-03 09:15:00.000,0\n2026-03-03 09:15:00.004,1\n",
        "time;q1\n03.03.2026 09:15:00,000;0\n03.03.2026 09:15:00,004;1\n",
        "time_s,q1\n2026-03-03T09:15:00Z,0\n2026-03-03T09:15:00.004Z,1\n",
        "time,q1\n\"2026-03-03T10:15:00,000+01:00\",0\n\"2026-03-03T10:15:00,004+01:00\",1\n",
    ] {
        let log = read_csv(text);
        assert_eq!(log.time(), [start, start + 4_000_000], "{text}");
        assert_eq!(log.position(), [0.0, 1.0]);
    }
    let log = read_csv("time,q1\n23:59:59.998,0\n00:00:00.002,1\n00:00:00.001,2\n");
    let steps: Vec<i64> = log.time().windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert_eq!(steps, [4_000_000, -1_000_000], "midnight passes, a small step back remains one");
    assert_eq!(log.layout().expect("of a table").time, "time as dates or times of day");
    let error = csv_error("time,q1\n09:15:00,0\nsoon,1\n");
    assert!(
        error.starts_with(
            "log.csv:3: column `time`: `soon` is not a time in dates and times of day"
        ),
        "{error}"
    );
    let error = csv_error("time,q1\n03/04/2026 09:15:00,0\n");
    assert!(
        error.starts_with("log.csv:2: column `time`: `03/04/2026 09:15:00` is not a time"),
        "{error}"
    );
}

#[test]
fn copies_have_one_hash() {
    let text = "t,q1,tau1\n0,1,2\n1,3,4\n";
    let hash = read_csv(text).content_hash();
    assert_eq!(read_csv(text.replace("tau1", "torque_1")).content_hash(), hash);
    for other in [
        "t,q1,tau1\n0,1,2\n1,3,5\n",
        "t,q1,tau1\n0,1,2\n2,3,4\n",
        "t,q1,dq1\n0,1,2\n1,3,4\n",
        "t,q2,tau2\n0,1,2\n1,3,4\n",
        "t,q1,tau1\n0,1,2\n",
    ] {
        assert_ne!(read_csv(other).content_hash(), hash, "{other}");
    }
}

#[test]
fn rows_of_other_length() {
    let remedy = "mend the line, or read the rows before or behind it alone (`rows`)";
    let expected =
        |cells| format!("log.csv:3: {cells} cells, but the header names 2 columns: {remedy}");
    assert_eq!(csv_error("t,q1\n0,1\n1\n"), expected(1));
    assert_eq!(csv_error("# a\nt,q1\n0,1,2\n"), expected(3));
}

#[test]
fn files_without_data() {
    assert_eq!(csv_error(""), "log.csv: the file is empty");
    assert_eq!(csv_error("\n\n"), "log.csv: the file is empty");
    assert_eq!(csv_error("t,q1\n"), "log.csv: there are column names but no data rows");
    assert_eq!(
        csv_error("0,1.5,2\n1,2,3\n"),
        "log.csv:1: the first line holds numbers (0,1.5,2): begin with a line of column names, \
         e.g. t,q_1,dq_1,tau_1"
    );
    assert!(
        message(csv::read("no/such/log.csv", &ReadOptions::default())).contains("No such file")
    );
}

#[test]
fn files_of_another_kind() {
    for (start, kind) in [
        (&b"\x89MCAP0\r\n"[..], "an MCAP file"),
        (b"PK\x03\x04", "a zip archive"),
        (b"SQLite format 3\0", "an SQLite data base, not CSV: `read` reads a bag of ROS 2"),
        (b"#ROSBAG V2.0\n", "a ROS 1 bag, not CSV: `read` reads it if its name ends in .bag"),
        (b"\x7fELF\0\0", "a binary file"),
    ] {
        let error = csv_error(start);
        assert!(error.starts_with("log.csv: this is") && error.contains(kind), "{error}");
    }
}

/// As a spreadsheet writes "Unicode text": either order of bytes, signs of two units across blocks.
#[test]
fn utf_16() {
    let name = "\u{1f44d}".repeat(20_001);
    let text = format!("t\tq_1 [°]\tx{name}\r\n0,5\t1,5\t1\r\n0,6\t2,5\t2\r\n");
    let encoded = |bytes: fn(u16) -> [u8; 2], mark: [u8; 2]| {
        mark.into_iter().chain(text.encode_utf16().flat_map(bytes)).collect::<Vec<u8>>()
    };
    let little = encoded(u16::to_le_bytes, [0xff, 0xfe]);
    for bytes in [&little, &encoded(u16::to_be_bytes, [0xfe, 0xff]), &packed(&little)] {
        let (_folder, path) = file(if bytes[0] == 0x1f { "log.csv.gz" } else { "log.csv" }, bytes);
        let log = csv::read(&path, &ReadOptions::default()).expect("UTF-16");
        assert_eq!(log.position(), [1.5_f64.to_radians(), 2.5_f64.to_radians()]);
        assert_eq!(log.channels()[0].name, format!("x{name}"));
    }
    // Half a unit at the end is no number.
    assert!(csv_error(&little[..little.len() - 5]).starts_with("log.csv:3: "));
}

#[test]
fn parts_of_a_log() {
    let text = "t,q1\n10,1\n10.5,2\n11,3\n11.5,4\n";
    let part = |rows| read_csv_with(text, &ReadOptions::default().with_rows(Some(rows)));
    assert_eq!(part(Rows::Numbers(2..=3)).expect("there").position(), [2.0, 3.0]);
    assert_eq!(part(Rows::Seconds(0.5..=1.0)).expect("there").position(), [2.0, 3.0]);
    assert_eq!(
        message(part(Rows::Numbers(7..=9))),
        "log.csv: no sample lies within the chosen rows 7 to 9; the log has 4 rows"
    );
    assert_eq!(
        message(part(Rows::Seconds(7.0..=9.0))),
        "log.csv: no sample lies within the chosen seconds 7 to 9; the log has 4 rows and lasts \
         1.5 s"
    );
    // Rows that are left out may hold anything.
    let text = "t,q1\n0,1\n1,2\nt,q1\n0,3\n1,4\nend of log\n";
    let part =
        |rows| read_csv_with(text, &ReadOptions::default().with_rows(Some(Rows::Numbers(rows))));
    assert_eq!(part(1..=2).expect("there").position(), [1.0, 2.0]);
    assert_eq!(part(4..=5).expect("there").position(), [3.0, 4.0]);
    assert!(message(part(4..=6)).starts_with("log.csv:7: 1 cells"));
}

#[test]
fn gzip() {
    let (_folder, path) = file("log.csv", packed(b"t,q1\n0,1\n"));
    assert_eq!(csv::read(&path, &ReadOptions::default()).expect("readable").position(), [1.0]);

    let rows: String = (0..1000).map(|k| format!("{k},{}\n", (k * 7919) % 1009)).collect();
    let whole = packed(format!("t,q1\n{rows}").as_bytes());
    let error = csv_error(&whole[..whole.len() / 2]);
    assert!(error.contains("the gzip data are truncated or damaged"), "{error}");
}

#[test]
fn more_than_the_limit() {
    let options = ReadOptions::default().with_limit_bytes(1 << 20);
    // Sixteen megabytes in some kilobytes.
    let bomb = packed(&[b"t,q1\n".to_vec(), b"0,1\n".repeat(4 << 20)].concat());
    let error = message(read_csv_with(&bomb, &options));
    assert!(
        error.starts_with("log.csv: more than 1048576 bytes of unpacked data; if that is right"),
        "{error}"
    );
    // Empty cells take more memory as numbers than as text.
    let header: Vec<String> = (1..=1000).map(|joint| format!("q{joint}")).collect();
    let rows =
        format!("t,{}\n", header.join(",")) + &format!("0{}\n", ",".repeat(1000)).repeat(900);
    assert!(message(read_csv_with(rows, &options)).contains("more than 1048576 bytes"));
}

#[test]
fn no_log_has_such_lines() {
    assert!(
        csv_error("t,q1\n".to_string() + &"1".repeat(2 << 20))
            .starts_with("log.csv:2: the line is longer than")
    );
    let header: Vec<String> = (1..=10_001).map(|joint| format!("q{joint}")).collect();
    assert!(
        csv_error(header.join(",")).starts_with("log.csv: 10001 columns (at most 10000 are read)")
    );
}

#[test]
fn writing_replaces_the_whole_file_or_nothing() {
    let log = read_csv("t,q1\n0,1\n");
    let (folder, path) = file("log.csv", "old");
    csv::write(&path, &log).expect("writable");
    assert_eq!(std::fs::read_to_string(&path).expect("readable"), "t_s,joint_1_position\n0,1\n");
    assert_eq!(std::fs::read_dir(folder.path()).expect("readable").count(), 1);
    let error = message(csv::write("no/such/folder/new.csv", &log));
    assert!(error.starts_with("no/such/folder/new.csv: cannot write:"), "{error}");
}

prop_compose! {
    fn any_recording()(
        joints in 1usize..4, samples in 1usize..20, velocity: bool, torque: bool, channel: bool, seed: u64,
    ) -> Recording {
        // Any bit pattern is a value; NaN payloads do not survive text.
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state ^ (state >> 29)
        };
        let mut values = |count: usize| -> Vec<f64> {
            (0..count).map(|_| f64::from_bits(next())).map(|v| if v.is_nan() { 0.5 } else { v }).collect()
        };
        let position = values(joints * samples);
        let velocity = velocity.then(|| values(joints * samples));
        let torque = torque.then(|| values(joints * samples));
        let channels = channel.then(|| Channel { name: "drive temperature".into(), values: values(samples) });
        let joints = (1..=joints).map(|joint| format!("arm/joint_{joint}")).collect();
        let time = (0..samples).map(|_| next() as i64).collect();
        Recording::new("any", joints, time, position, velocity, torque, channels.into_iter().collect())
            .expect("lengths fit")
    }
}

proptest! {
    #[test]
    fn what_is_written_is_read(log in any_recording(), gz: bool) {
        let (_folder, path) = file(if gz { "log.csv.gz" } else { "log.csv" }, "");
        csv::write(&path, &log).expect("writable");
        let options = ReadOptions::default().with_joints(Some(log.joint_names().to_vec()));
        let back = csv::read(&path, &options).expect("readable");
        prop_assert_eq!(back.joint_names(), log.joint_names());
        prop_assert_eq!(back.time(), log.time());
        prop_assert_eq!(back.position(), log.position());
        prop_assert_eq!(back.velocity(), log.velocity());
        prop_assert_eq!(back.torque(), log.torque());
        prop_assert_eq!(back.channels(), log.channels());
    }
}

#[test]
fn names_survive_writing() {
    let joints = names(&["shoulder_pan_joint", "elbow_joint"]);
    let log = Recording::new(
        "any",
        joints.clone(),
        vec![0],
        vec![1.0, 2.0],
        None,
        Some(vec![3.0, 4.0]),
        vec![],
    );
    let (_folder, path) = file("log.csv", "");
    csv::write(&path, &log.expect("lengths fit")).expect("writable");
    let back = csv::read(&path, &ReadOptions::default()).expect("readable");
    assert_eq!(
        (back.joint_names(), back.torque().expect("written")),
        (&joints[..], &[3.0, 4.0][..])
    );
}
