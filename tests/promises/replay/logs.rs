//! Flawed logs: low rates, gaps, wrong units. Verdict and warnings name the flaw.

use log_analysis::log;
use log_analysis::log::csv::FieldUnit;
use log_analysis::log::log_writers::{
    FlightRecording, encode_blackbox, encode_csv, encode_dataflash, encode_dataflash_text, encode_tlog, encode_ulog,
};
use log_analysis::replay::evaluation::evaluate_flight;
use log_analysis::replay::parameter_export::ParameterFormat;
use log_analysis::replay::verdict::{CompassAction, Verdict};
use simulator::recording::record_turns;
use simulator::world::WorldConfig;
use testkit::random::Random;

use super::{
    DEFAULT_OPTIONS, compare_with_module, evaluate_log, max_rms_deg, module_result, module_score, verdict_sentences,
    warnings_text,
};
use crate::fixtures::share_of_flights;

fn record_flight(world: &WorldConfig) -> FlightRecording {
    record_turns(world, 0.05)
}

/// A recorded flight as a text log of ArduPilot.
fn dataflash_text(world: &WorldConfig) -> String {
    String::from_utf8(encode_dataflash_text(&record_flight(world))).unwrap()
}

/// The log with changed lines; empty ones are removed.
fn change_lines(text: &str, mut change: impl FnMut(&str) -> String) -> String {
    text.lines().map(|line| change(line) + "\n").filter(|line| line.len() > 1).collect()
}

fn keep_every_nth_message(text: &str, name: &str, stride: usize) -> String {
    let mut line_count = 0;
    change_lines(text, |line| {
        let is_message = line.strip_prefix(name).is_some_and(|after_name| after_name.starts_with(','));
        line_count += usize::from(is_message);
        if is_message && line_count % stride != 0 { String::new() } else { line.to_owned() }
    })
}

/// Field at 2.5 Hz and 1 Hz with attitude at 10 Hz. The monitor does not run, which a warning states.
#[test]
fn a_field_logged_at_1_hz_gives_the_same_headings() {
    for seed in [3, 5, 8] {
        let world = WorldConfig::random_world(seed);
        let text = dataflash_text(&world);
        for stride in [1, 4, 10] {
            let (flight, evaluation) = compare_with_module(keep_every_nth_message(&text, "MAG", stride).as_bytes());
            let module_result = module_result(&evaluation.compasses[0]);
            let (score, smoothed_score) =
                (module_score(&evaluation.compasses[0]), module_result.smoothed_score.unwrap());
            let about = format!("seed {seed}, 1 of {stride}: {score:?} {smoothed_score:?}");
            assert_eq!(module_result.outcome.acceptance, Ok(()), "{about}");
            assert!(score.rms_deg < max_rms_deg(&world), "{about}");
            // Smoothing integrates the rates between rows; a gyro of class `gyro-1` may cost a tenth of a degree.
            assert!(smoothed_score.rms_deg < score.rms_deg + 0.1, "{about}");
            let warnings = warnings_text(&flight, &evaluation);
            assert_eq!(warnings.contains("too slowly for the monitor"), stride > 1, "{warnings}");
        }
    }
}

/// Attitude at 2 Hz cannot be interpolated reliably; at 0.5 Hz not at all.
#[test]
fn a_verdict_reports_attitude_below_3_hz() {
    let text = dataflash_text(&WorldConfig::random_world(3));
    for (stride, expected_text) in [(1, ""), (5, "2.0 times a second"), (20, "0.5 times a second")] {
        let (flight, evaluation) = evaluate_log(keep_every_nth_message(&text, "ATT", stride).as_bytes());
        let warnings = warnings_text(&flight, &evaluation);
        assert!(warnings.contains(expected_text), "1 of {stride}: {warnings}");
        assert_eq!(warnings.contains("below 3 Hz"), stride > 1, "1 of {stride}: {warnings}");
        let verdict_text = verdict_sentences(&flight, &evaluation);
        assert_eq!(verdict_text.contains("without an attitude near it"), stride == 20, "{verdict_text}");
    }
}

/// Without a place the limits are the Earth's 22 to 67 uT. Rates in radians reject most of a turn.
#[test]
fn implausible_units_are_reported_without_a_position() {
    // Field strength: 48 uT.
    let text = String::from_utf8(encode_csv(&record_flight(&WorldConfig::of_table1(1)))).unwrap();
    let scaled = |columns: std::ops::Range<usize>, factor: f64| {
        let scale = |(column, value): (usize, &str)| match value.parse::<f64>() {
            Ok(number) if columns.contains(&column) => format!("{}", number * factor),
            _ => value.to_owned(),
        };
        let line = |line: &str| line.split(',').enumerate().map(scale).collect::<Vec<_>>().join(",") + "\n";
        text.lines().map(line).collect::<String>()
    };
    let texts = |text: &str| {
        let (flight, evaluation) = evaluate_log(text.as_bytes());
        [verdict_sentences(&flight, &evaluation), warnings_text(&flight, &evaluation)]
    };
    assert_eq!(texts(&text)[1], "");
    for (factor, expected) in [(0.1, "microtesla read as milligauss"), (100.0, "nanotesla read as milligauss")] {
        let [verdict, _] = texts(&scaled(1..4, factor));
        assert!(verdict.contains(expected), "{factor}: {verdict}");
    }
    let [_, notes] = texts(&scaled(7..10, 1.0_f64.to_radians()));
    assert!(notes.contains("body rates"), "{notes}");
}

/// Messages without a sender's clock get the time of the message before, a few milliseconds earlier.
#[test]
fn mavlink_without_receiver_times_gives_the_same_flight() {
    let with_times = encode_tlog(&record_flight(&WorldConfig::random_world(3)));
    let mut without_times = Vec::new();
    let mut remaining = with_times.as_slice();
    while let [_, _, _, _, _, _, _, _, frame @ ..] = remaining {
        // MAVLink 2 without signature: ten header bytes, two checksum bytes.
        assert_eq!(frame[0], 0xFD);
        let (current_frame, after_frame) = frame.split_at(12 + usize::from(frame[1]));
        without_times.extend_from_slice(current_frame);
        remaining = after_frame;
    }
    let [with_times, without_times] = [with_times, without_times].map(|bytes| compare_with_module(&bytes));
    assert!(without_times.0.attitude.rows().len() > 2000);
    assert_eq!(with_times.0.attitude.rows(), without_times.0.attitude.rows());
    assert_eq!(with_times.0.compasses[0].field.rows(), without_times.0.compasses[0].field.rows());
    assert_eq!(without_times.0.skipped_counts.garbage, 0);
    // Currents shift by milliseconds, so other samples are retained.
    for (_, evaluation) in [with_times, without_times] {
        assert!(module_score(&evaluation.compasses[0]).rms_deg < 0.5, "{:?}", module_score(&evaluation.compasses[0]));
    }
}

/// Until 2014 field and attitude had no time; they get the stamp before, 0.1 s earlier, while the rates have their own,
/// which adds to the error of `replay/native.rs`.
#[test]
fn rows_without_time_get_the_time_of_their_neighbours() {
    let text = dataflash_text(&WorldConfig::random_world(3));
    let strip = |names: &[&str], text: &str| {
        change_lines(text, |line| {
            let values: Vec<&str> = line.split(", ").collect();
            match values.as_slice() {
                ["FMT", number, length, name, letters, columns] if names.contains(name) => {
                    let (letters, columns) = (&letters[1..], columns.replacen("TimeUS,", "", 1));
                    format!("FMT, {number}, {length}, {name}, {letters}, {columns}")
                }
                [name, _, rest @ ..] if names.contains(name) => format!("{name}, {}", rest.join(", ")),
                _ => line.to_owned(),
            }
        })
    };
    let (flight, evaluation) = compare_with_module(strip(&["MAG", "ATT"], &text).as_bytes());
    assert!(module_score(&evaluation.compasses[0]).rms_deg < 1.0, "{:?}", module_score(&evaluation.compasses[0]));
    assert!(warnings_text(&flight, &evaluation).contains("carry no time"));
    let without_columns = strip(&["MAG", "ATT", "IMU", "BAT", "GPS", "RCOU", "MSG", "MODE", "PARM"], &text);
    let refused = log::read_flight(&mut without_columns.as_bytes(), FieldUnit::Milligauss).unwrap_err();
    assert!(refused.to_string().contains("carry no time"), "{refused}");
}

/// Three in ten rows of field, attitude and rates are lost; headings are not smoothed, which a warning states.
#[test]
fn a_log_with_lost_rows_gives_the_same_accuracy() {
    for seed in [3, 5, 8] {
        let world = WorldConfig::random_world(seed);
        let mut random = Random(seed);
        let with_losses = change_lines(&dataflash_text(&world), |line| {
            let is_row = ["MAG, ", "ATT, ", "IMU, "].iter().any(|prefix| line.starts_with(prefix));
            if is_row && random.bits() % 10 < 3 { String::new() } else { line.to_owned() }
        });
        let (flight, evaluation) = compare_with_module(with_losses.as_bytes());
        let score = module_score(&evaluation.compasses[0]);
        assert!(score.rms_deg < max_rms_deg(&world), "seed {seed}: {score:?}");
        assert_eq!(module_result(&evaluation.compasses[0]).smoothed_score, Some(score), "seed {seed}");
        let warnings = warnings_text(&flight, &evaluation);
        assert!(warnings.contains("of the body rates are lost"), "{warnings}");
    }
}

#[test]
fn a_log_at_rest_gives_no_field_strength() {
    let mut recording = record_flight(&WorldConfig::of_table1(1));
    let first = recording.samples[0].clone();
    for (i, sample) in recording.samples.iter_mut().enumerate() {
        *sample = first.clone();
        sample.time_us += i as u64 * 100_000;
        sample.field_ut[0][i % 3] += if i % 2 == 0 { 0.5 } else { -0.5 };
    }
    let (flight, evaluation) = evaluate_log(&encode_dataflash_text(&recording));
    assert_eq!(evaluation.compasses[0].parameter_fit.strength_ut(), None);
    let text = verdict_sentences(&flight, &evaluation) + &warnings_text(&flight, &evaluation);
    assert!(!text.contains("read as") && !text.contains("radians"), "{text}");
}

/// A good compass in each format, with 1 to 10 changed bits in 10 kB: a changed number must not look like iron.
#[test]
fn changed_bits_never_turn_leave_into_load() {
    let recording = with_good_compass(record_flight(&WorldConfig::random_world(3)));
    for write in [encode_dataflash, encode_dataflash_text, encode_tlog, encode_ulog, encode_csv, encode_blackbox] {
        let bytes = write(&recording);
        assert_eq!(judged_action(&bytes), Some(CompassAction::LeaveUnchanged));
        for (bits_in_10_kb, seed) in
            [1, 10].into_iter().flat_map(|bits| (0..share_of_flights(3)).map(move |n| (bits, n)))
        {
            let action = judged_action(&with_changed_bits(&bytes, bits_in_10_kb, seed));
            assert_ne!(action, Some(CompassAction::LoadParameters), "{} bytes, {bits_in_10_kb}, {seed}", bytes.len());
        }
    }
}

/// The flight with its field as its own fit corrects it.
fn with_good_compass(mut recording: FlightRecording) -> FlightRecording {
    let (_, evaluation) = evaluate_log(&encode_csv(&recording));
    let correction = evaluation.compasses[0].parameter_fit.correction().unwrap();
    for sample in &mut recording.samples {
        sample.field_ut[0] = correction.correct_field(sample.field_ut[0].into(), sample.current_a).into();
    }
    recording
}

fn with_changed_bits(bytes: &[u8], bits_in_10_kb: usize, seed: u64) -> Vec<u8> {
    let (mut random, mut changed) = (Random(seed + 1), bytes.to_vec());
    for _ in 0..bytes.len() * bits_in_10_kb / 10_000 {
        let offset = random.bits() as usize % bytes.len();
        changed[offset] ^= 1 << (random.bits() % 8);
    }
    changed
}

/// What is advised; `None` if the log cannot be read.
fn judged_action(bytes: &[u8]) -> Option<CompassAction> {
    let mut source = bytes;
    let flight = log::read_flight(&mut source, FieldUnit::Milligauss).ok()?;
    let evaluation = evaluate_flight(&flight, &DEFAULT_OPTIONS);
    let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::for_autopilot(flight.autopilot));
    Some(verdict.compasses.first()?.judgement.recommended_action)
}
