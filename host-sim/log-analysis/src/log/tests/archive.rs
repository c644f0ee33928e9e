//! Logs in a .zip.

use std::io::Write as _;

use flate2::Compression;
use flate2::write::{DeflateEncoder, GzEncoder};

use super::*;

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Packing {
    Stored,
    Deflated,
    /// Deflated, with the sizes after the content, as macOS writes.
    SizesFollow,
}

/// An archive of files without its directory, which a stream does not need.
pub(super) fn archive(files: &[(&str, &[u8])], packing: Packing) -> Vec<u8> {
    let mut bytes = Vec::new();
    for (name, content) in files {
        let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(content).unwrap();
        let packed = if packing == Packing::Stored { content.to_vec() } else { encoder.finish().unwrap() };
        let (method, flags) =
            (u16::from(packing != Packing::Stored) * 8, u16::from(packing == Packing::SizesFollow) * 8);
        let sizes = [packed.len(), content.len()].map(|size| if flags == 0 { size as u32 } else { 0 });
        bytes.extend(b"PK\x03\x04\x14\0");
        bytes.extend([flags, method, 0, 0].map(u16::to_le_bytes).concat());
        bytes.extend([0, sizes[0], sizes[1]].map(u32::to_le_bytes).concat());
        bytes.extend([name.len() as u16, 0].map(u16::to_le_bytes).concat());
        bytes.extend(name.as_bytes());
        bytes.extend(packed);
        bytes.extend(if flags == 0 { &[][..] } else { b"PK\x07\x08cccc\0\0\0\0\0\0\0\0" });
    }
    bytes.extend(b"PK\x05\x06");
    bytes
}

fn gzip(content: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(content).unwrap();
    encoder.finish().unwrap()
}

/// The first seconds of a table in each packing.
pub(super) fn small_archives() -> [Vec<u8>; 4] {
    let table = &encode_csv(&two_compass_recording(&[]))[..2_500];
    let [stored, deflated, sizes_follow] = [Packing::Stored, Packing::Deflated, Packing::SizesFollow]
        .map(|packing| archive(&[("flight.csv", table)], packing));
    [stored, deflated, sizes_follow, gzip(table)]
}

#[test]
fn the_only_log_of_an_archive_is_read() {
    let table = encode_csv(&two_compass_recording(&[]));
    let expected = read_bytes(&table).unwrap();
    let files: [(&str, &[u8]); 3] = [("logs/", b""), ("notes.txt", b"windy"), ("logs/flight.csv", &table)];
    for packing in [Packing::Stored, Packing::Deflated, Packing::SizesFollow] {
        let flight = read_bytes(&archive(&files, packing)).unwrap();
        assert_eq!(flight.compasses[0].field.rows(), expected.compasses[0].field.rows());
        assert_eq!(flight.skipped_counts, SkippedCounts::default());
    }
}

/// An archive of a log that was packed by itself, a log decoded by `mavlogdump`, a blackbox of two flights, and another
/// archive.
#[test]
fn each_log_of_an_archive_is_visited() {
    let table = encode_csv(&two_compass_recording(&[]));
    let blackbox = encode_blackbox(&two_compass_recording(&[]));
    let inner = archive(&[("flight.csv", &table)], Packing::Deflated);
    let [json, ..] = decoded::logs_in_each_syntax();
    let files: [(&str, &[u8]); 5] = [
        ("a.csv.gz", &gzip(&table)),
        ("b.json", &json),
        ("LOG1.TXT", &[&blackbox[..], &blackbox].concat()),
        ("day.zip", &inner),
        ("notes.txt", b"windy"),
    ];
    let (mut names, archive) = (Vec::new(), archive(&files, Packing::SizesFollow));
    visit_unchecked(&mut archive.as_slice(), (FieldUnit::Milligauss, None), &mut |name, flight| {
        names.push(name.to_owned());
        assert_eq!(flight.unwrap().skipped_counts.garbage, 0, "{name}");
    })
    .unwrap();
    assert_eq!(names, ["a.csv.gz", "b.json", "LOG1.TXT/flight 1", "LOG1.TXT/flight 2", "day.zip/flight.csv"]);
}

#[test]
fn an_archive_with_another_number_of_logs_is_rejected_with_the_names() {
    let table = encode_csv(&two_compass_recording(&[]));
    let text = |files: &[(&str, &[u8])]| {
        let error = read_bytes(&archive(files, Packing::Deflated)).unwrap_err();
        format!("{}: {error}", error.stable_code())
    };
    let names: Vec<String> = (0..10).map(|number| format!("{number}.jpg")).collect();
    let pictures: Vec<(&str, &[u8])> = names.iter().map(|name| (name.as_str(), &b"\xFF\xD8"[..])).collect();
    assert_eq!(text(&[]), "archive-without-log: the archive is empty");
    assert_eq!(
        text(&pictures),
        "archive-without-log: the archive has no log; it has 0.jpg, 1.jpg, 2.jpg, 3.jpg, 4.jpg, 5.jpg, 6.jpg, 7.jpg and 2 more"
    );
    assert_eq!(
        text(&[("a.csv", &table), ("b.txt", b"-"), ("c.csv", &table)]),
        "several-logs: these are several logs, of which one is judged at a time: a.csv, c.csv"
    );
}

#[test]
fn a_damaged_or_encrypted_archive_is_an_error() {
    let table = encode_csv(&two_compass_recording(&[]));
    for packing in [Packing::Stored, Packing::Deflated] {
        let whole = archive(&[("flight.csv", &table)], packing);
        let mut encrypted = whole.clone();
        encrypted[6] |= 1;
        let error = read_bytes(&encrypted).unwrap_err();
        assert_eq!(error.to_string(), "the archive is encrypted");
        // No length of a damaged archive makes a reader panic.
        for length in (4..whole.len()).step_by(97) {
            let _ = read_bytes(&whole[..length]);
        }
        assert!(matches!(read_bytes(&whole[..20]), Err(LogError::Io(_))));
    }
}
