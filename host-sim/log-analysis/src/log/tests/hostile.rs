//! Fuzz tests and memory bounds.

use super::*;

/// Rows of a table next to the damaged one.
const MAX_INTACT_ROWS: usize = 300;

/// A part of a small log with bytes changed, removed, repeated; or random bytes.
fn random_damage(random: &mut Random, log_bytes: &[u8]) -> Vec<u8> {
    let mut random_below = |limit: usize| (random.bits() % limit.max(1) as u64) as usize;
    if random_below(10) == 0 {
        return (0..random_below(600)).map(|_| random_below(256) as u8).collect();
    }
    let from = if random_below(2) == 0 { 0 } else { random_below(log_bytes.len()) };
    let mut bytes = log_bytes[from..(from + 200 + random_below(3000)).min(log_bytes.len())].to_vec();
    for _ in 0..random_below(12) {
        if bytes.is_empty() {
            break;
        }
        let offset = random_below(bytes.len());
        match random_below(4) {
            0 => bytes[offset] = random_below(256) as u8,
            1 => bytes[offset] = [0, 255, b'[', b';', b',', b'\n', 0xFD, 0xA3][random_below(8)],
            2 => drop(bytes.drain(offset..(offset + random_below(20)).min(bytes.len()))),
            _ => {
                let repeated = bytes[offset..(offset + random_below(60)).min(bytes.len())].to_vec();
                bytes.splice(offset..offset, repeated);
            }
        }
    }
    bytes
}

/// Reads random inputs of each format and builds rows from those accepted.
fn fuzz_readers(input_count: usize) {
    for (format, bytes, _) in log_in_each_format() {
        fuzz_reader(format.format_name(), &bytes, &read_bytes, input_count);
    }
    for bytes in decoded::logs_in_each_syntax() {
        fuzz_reader("decoded", &bytes, &read_bytes, input_count);
    }
    for bytes in archive::small_archives() {
        fuzz_reader("archive", &bytes, &read_bytes, input_count);
    }
    for tables in table_set::tables_of_each_recorder() {
        for (index, (name, text)) in tables.iter().enumerate() {
            let read_damaged = |damaged: &[u8]| {
                let texts = tables.iter().map(|(name, text)| (name.as_str(), text.as_bytes()));
                let mut files: Vec<(&str, &[u8])> = texts.collect();
                files[index].1 = damaged;
                table_set::read_tables(&files)
            };
            fuzz_reader(name, text.as_bytes(), &read_damaged, input_count);
        }
    }
}

fn fuzz_reader(what: &str, bytes: &[u8], read: &dyn Fn(&[u8]) -> Result<LoggedFlight, LogError>, input_count: usize) {
    let mut random = Random(1);
    let mut accepted_count = 0;
    for _ in 0..input_count {
        let input = random_damage(&mut random, bytes);
        if let Ok(flight) = read(&input) {
            accepted_count += 1;
            let rows = flight.compasses.iter().map(|compass| compass.field.rows().len()).sum::<usize>();
            assert!(rows <= input.len().max(MAX_INTACT_ROWS), "{what}");
            let rows = crate::replay::build_rows(&flight, &flight.compasses[0], 0.05, None).0;
            assert!(rows.iter().all(|row| row.t_s.is_finite()), "{what}");
        }
    }
    println!("{what}: {accepted_count} of {input_count} damaged inputs were read");
    assert!(accepted_count > input_count / 50, "{what}: only {accepted_count} of {input_count} were read at all");
}

#[test]
fn damaged_and_random_logs_make_no_reader_panic() {
    fuzz_readers(400);
}

/// Run by `cargo test --release -p log-analysis --lib log::tests::hostile::a_million -- --ignored`.
#[test]
#[ignore = "minutes, in a release build"]
fn a_million_inputs_make_no_reader_panic() {
    fuzz_readers(1_000_000);
}

#[test]
#[ignore = "reads 2 GB, in a release build"]
fn two_gigabytes_are_read_in_bounded_memory() {
    /// One message again and again, with time stamps 1 ms apart.
    struct RepeatedMessage {
        message: Vec<u8>,
        offset: usize,
        time_us: u64,
    }
    impl Read for RepeatedMessage {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            for byte in &mut *into {
                if self.offset == 0 {
                    self.time_us += 1_000;
                    self.message[3..11].copy_from_slice(&self.time_us.to_le_bytes());
                }
                *byte = self.message[self.offset];
                self.offset = (self.offset + 1) % self.message.len();
            }
            Ok(into.len())
        }
    }
    let head = encode_dataflash(&two_compass_recording(&ARDUPILOT_PARAMETERS));
    let read_offset = head.windows(3).position(|bytes| bytes == [0xA3, 0x95, 67]).unwrap();
    let length = 3 + 8 + 1 + 18 + 1 + 4;
    let message = head[read_offset..read_offset + length].to_vec();
    let repeated = RepeatedMessage { message, offset: 0, time_us: 70_000_000 };
    let mut source = head.as_slice().chain(repeated.take(2_000_000_000));
    let flight = read_flight(&mut source, FieldUnit::Milligauss).unwrap();
    assert!(flight.compasses[0].field.rows().len() <= 1 << 20);
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak_kb =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().split(' ').next()?.parse::<u64>().ok());
    assert!(peak_kb.is_none_or(|kb| kb < 500_000), "{peak_kb:?} kB");
}
