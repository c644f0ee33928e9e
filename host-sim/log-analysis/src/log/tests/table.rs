use super::*;

#[test]
fn a_csv_table_is_read_in_any_row_order_and_time_base() {
    let text = String::from_utf8(encode_csv(&two_compass_recording(&[]))).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let rows: Vec<&str> = rows.lines().collect();
    let change_lines = |change: &dyn Fn(usize, Vec<String>) -> Vec<String>| {
        let changed =
            rows.iter().enumerate().map(|(i, row)| change(i, row.split(',').map(str::to_owned).collect()).join(","));
        format!("{header}\n{}", changed.collect::<Vec<_>>().join("\n"))
    };
    let sorted_by = |key: &dyn Fn(&str) -> i64| {
        let mut rows = rows.clone();
        rows.sort_by_key(|row| key(row));
        format!("{header}\n{}", rows.join("\n"))
    };
    let unix = change_lines(&|_, mut row| {
        row[0] = format!("{:.3}", row[0].parse::<f64>().unwrap() + 1.7e9);
        row
    });
    let without = change_lines(&|i, mut row| {
        if i % 2 == 1 {
            row[6] = "NaN".to_owned();
        }
        row
    });
    let by_field = sorted_by(&|row| (row.split(',').nth(1).unwrap().parse::<f64>().unwrap() * 10.0) as i64);
    let from_the_end = sorted_by(&|row| -(row.split(',').next().unwrap().parse::<f64>().unwrap() * 1000.0) as i64);
    let expected = read_bytes(text.as_bytes()).unwrap();
    let capitals = text.replace(header, &header.to_uppercase());
    for (shape, table) in [
        ("capitals", capitals),
        ("separator", format!("sep=,\n{text}")),
        ("from 1970", unix),
        ("half a reference", without),
        ("by the field", by_field),
        ("from the end", from_the_end),
    ] {
        let flight = read_bytes(table.as_bytes()).unwrap();
        assert_eq!(flight.skipped_counts, SkippedCounts::default(), "{shape}");
        let [found, expected_summary] = [&flight, &expected].map(|flight| {
            let rows = flight.compasses[0].field.rows();
            rows.iter()
                .map(|row| ((row.t_s - rows[0].t_s) * 1e3).round() as i64)
                .zip(rows.iter().map(|row| row.row_values))
                .collect::<Vec<_>>()
        });
        assert!(found == expected_summary, "{shape}");
        let references = flight.reference_heading.rows().len();
        assert_eq!(references, if shape == "half a reference" { 150 } else { 300 }, "{shape}");
        assert_eq!(flight.is_armed(flight.time_range_s()[1]), Some(true), "{shape}");
    }
    // An impossible time is counted as bad; a zero field is rejected.
    let with_impossible_time = read_bytes(format!("{text}1e9,1,2,3,0,0\n").as_bytes()).unwrap();
    assert_eq!(with_impossible_time.skipped_counts.bad_times, 1);
    let zero_field = read_bytes(b"t_s,mx,my,mz,roll_deg,pitch_deg\n0,0,0,0,1,2\n").unwrap_err();
    assert!(matches!(zero_field, LogError::NoMagnetometer(LogFormat::Csv, 1)), "{zero_field}");
}

/// A source that returns three bytes at a time.
struct OddReads<'a>(&'a [u8]);

impl Read for OddReads<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let length = into.len().min(3);
        self.0.read(&mut into[..length])
    }
}

/// A spreadsheet saves Unicode text in UTF-16; the comment has a character of two units.
#[test]
fn a_table_in_utf_16_is_read() {
    let table = encode_csv(&two_compass_recording(&[]));
    let expected = read_bytes(&table).unwrap();
    let text = format!("\u{feff}# \u{1f6e9}\n{}", String::from_utf8(table).unwrap());
    let little: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
    let big: Vec<u8> = text.encode_utf16().flat_map(u16::to_be_bytes).collect();
    for bytes in [little, big] {
        let flight = read_flight(&mut OddReads(&bytes), FieldUnit::Milligauss).unwrap();
        assert_eq!(flight.compasses[0].field.rows(), expected.compasses[0].field.rows());
        assert_eq!(flight.skipped_counts, SkippedCounts::default());
    }
    assert!(matches!(read_bytes(&[0xFF, 0xFE, b'x', 0, 0xD8]), Err(LogError::UnknownFormat)));
}
