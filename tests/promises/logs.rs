//! Flawed logs: low rates, gaps, wrong units. Verdict and notes name the flaw.
#![expect(clippy::unwrap_used, reason = "what a test builds upon may end it")]

use std::fmt::Write as _;

use log_analysis::log::csv::FieldUnit;
use log_analysis::log::log_writers::{FlightRecording, encode_csv, encode_dataflash_text, encode_tlog};
use log_analysis::log::{self, Flight};
use log_analysis::replay::evaluation::{CorrectionSource, EvaluationOptions, FlightEvaluation, evaluate_flight};
use log_analysis::replay::log_warning::LogWarning;
use log_analysis::replay::verdict::FlightOutcome;
use simulator::recording::record_turns;
use simulator::world::WorldConfig;

const DEFAULT_OPTIONS: EvaluationOptions = EvaluationOptions::DEFAULT;

fn record_flight(world: &WorldConfig) -> FlightRecording {
    record_turns(world, 0.05)
}

fn read_log_text(text: &str) -> Flight {
    log::read_flight(&mut text.as_bytes(), FieldUnit::Milligauss).unwrap()
}

fn evaluate_log_text(text: &str) -> (Flight, FlightEvaluation) {
    let flight = read_log_text(text);
    let verdict = evaluate_flight(&flight, &DEFAULT_OPTIONS);
    (flight, verdict)
}

fn warnings_text(flight: &Flight, evaluation: &FlightEvaluation) -> String {
    LogWarning::warnings_of_flight(flight, evaluation).iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

fn keep_every_nth_message(text: &str, name: &str, stride: usize) -> String {
    let mut line_count = 0;
    let is_kept = |line: &&str| {
        let is_of = line.strip_prefix(name).is_some_and(|after_name| after_name.starts_with(','));
        line_count += usize::from(is_of);
        !is_of || line_count % stride == 0
    };
    text.lines().filter(is_kept).flat_map(|line| [line, "\n"]).collect()
}

/// Field at 2.5 Hz and 1 Hz with attitude at 10 Hz. The error limit is that of `replay/native.rs`; the monitor does not
/// run, which a note states.
#[test]
fn a_field_logged_at_1_hz_gives_the_same_headings() {
    for seed in [3, 5, 8] {
        let world = WorldConfig::random_world(seed);
        let noise_deg = 0.45 * world.earth.inclination_deg.to_radians().tan().abs();
        let text = String::from_utf8(encode_dataflash_text(&record_flight(&world))).unwrap();
        for stride in [1, 4, 10] {
            let (flight, verdict) = evaluate_log_text(&keep_every_nth_message(&text, "MAG", stride));
            let compass = &verdict.compasses[0];
            assert_eq!(compass.module_result.acceptance, Ok(()), "seed {seed}, 1 of {stride}");
            let (module_score, smoothed_score) = (
                compass.correction_from(CorrectionSource::Module).unwrap().score.unwrap(),
                compass.module_result.smoothed_score.unwrap(),
            );
            assert!(module_score.rms_deg < 0.5 + noise_deg, "seed {seed}, 1 of {stride}: {module_score:?}");
            // Smoothing integrates the rates between rows; a gyro of class `gyro-1` may cost a tenth of a degree.
            assert!(
                smoothed_score.rms_deg < module_score.rms_deg + 0.1,
                "seed {seed}, 1 of {stride}: {smoothed_score:?} {module_score:?}"
            );
            let notes = warnings_text(&flight, &verdict);
            assert_eq!(notes.contains("too slowly for the monitor"), stride > 1, "{notes}");
        }
    }
}

/// Attitude at 2 Hz cannot be interpolated reliably; at 0.5 Hz not at all.
#[test]
fn a_verdict_reports_attitude_below_3_hz() {
    let text = String::from_utf8(encode_dataflash_text(&record_flight(&WorldConfig::random_world(3)))).unwrap();
    for (stride, expected_text) in [(1, ""), (5, "2.0 times a second"), (20, "0.5 times a second")] {
        let (_, verdict) = evaluate_log_text(&keep_every_nth_message(&text, "ATT", stride));
        let verdict_text = FlightOutcome::new(&verdict).to_string();
        assert!(
            verdict_text.contains(expected_text) && verdict_text.contains("below 3 Hz") == (stride > 1),
            "1 of {stride}: {verdict_text}"
        );
        assert_eq!(verdict_text.contains("without an attitude near it"), stride == 20, "{verdict_text}");
    }
}

#[test]
fn a_verdict_reports_a_log_without_flight() {
    let mut recording = record_flight(&WorldConfig::random_world(3));
    for (i, sample) in recording.samples.iter_mut().enumerate() {
        sample.is_armed = i >= 2370;
    }
    let text = String::from_utf8(encode_csv(&recording)).unwrap();
    let verdict_text = FlightOutcome::new(&evaluate_log_text(&text).1).to_string();
    assert!(verdict_text.contains("10 are usable") && verdict_text.contains("are disarmed"), "{verdict_text}");
}

/// Both compasses are refused after 30 s: the better has a noise of 1 uT, the other of 50 uT.
#[test]
fn a_verdict_reports_the_refusal_of_the_better_compass() {
    for worse in [0, 1] {
        let mut recording = record_flight(&WorldConfig::random_world(3));
        recording.samples.truncate(300);
        let mut random = testkit::random::Random(7);
        for sample in &mut recording.samples {
            let better_field_ut = sample.field_ut[0].map(|axis| axis + 1.0 * f64::from(random.normal()));
            let noise = better_field_ut.map(|_| 50.0 * f64::from(random.normal()));
            sample.field_ut = if worse == 0 { vec![noise, better_field_ut] } else { vec![better_field_ut, noise] };
        }
        let text = String::from_utf8(encode_dataflash_text(&recording)).unwrap();
        let (_, verdict) = evaluate_log_text(&text);
        let verdict_text = FlightOutcome::new(&verdict).to_string();
        let subject = format!("the module would have refused each of 2 compasses; number {} came nearest: ", 2 - worse);
        assert!(verdict_text.starts_with(&subject), "{worse}: {verdict_text}");
    }
}

#[test]
fn a_mounting_change_within_the_log_is_reported() {
    let text = String::from_utf8(encode_dataflash_text(&record_flight(&WorldConfig::random_world(3)))).unwrap();
    let middle_line = text.lines().count() / 2;
    for (name, is_noted) in [("COMPASS_ORIENT", true), ("AHRS_ORIENTATION", true), ("COMPASS_ORIENT3", false)] {
        let change = |(i, line): (usize, &str)| {
            let time_stamp = line.split(", ").nth(1).filter(|_| i == 20 || i == middle_line);
            let parameter_line =
                time_stamp.map_or_else(String::new, |time_stamp| format!("PARM, {time_stamp}, {name}, {}\n", i / 100));
            format!("{line}\n{parameter_line}")
        };
        let (flight, verdict) = evaluate_log_text(&text.lines().enumerate().map(change).collect::<String>());
        let notes = warnings_text(&flight, &verdict);
        assert_eq!(notes.contains(&format!("mountings were changed in the log: {name} at ")), is_noted, "{notes}");
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
    let notes = |text: &str| {
        let (flight, verdict) = evaluate_log_text(text);
        warnings_text(&flight, &verdict)
    };
    assert_eq!(notes(&text), "");
    for (factor, expected_texts) in [
        (0.1, "microtesla read as milligauss"),
        (0.001, "gauss read as milligauss"),
        (100.0, "nanotesla read as milligauss"),
        (10.0, "milligauss read as microtesla"),
    ] {
        let notes = notes(&scaled(1..4, factor));
        assert!(notes.contains(expected_texts), "{factor}: {notes}");
    }
    let notes = notes(&scaled(7..10, 1.0_f64.to_radians()));
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
    let [with_times, without_times] = [with_times, without_times].map(|bytes| {
        let flight = log::read_flight(&mut bytes.as_slice(), FieldUnit::Milligauss).unwrap();
        let verdict = evaluate_flight(&flight, &DEFAULT_OPTIONS);
        (flight, verdict)
    });
    assert!(without_times.0.attitude.rows().len() > 2000);
    assert_eq!(with_times.0.attitude.rows(), without_times.0.attitude.rows());
    assert_eq!(with_times.0.compasses[0].field.rows(), without_times.0.compasses[0].field.rows());
    assert_eq!(without_times.0.skipped_counts.garbage, 0);
    // Currents shift by milliseconds, so other samples are retained; the error limit is that of `replay/native.rs`.
    for (_, verdict) in [with_times, without_times] {
        let score = verdict.compasses[0].correction_from(CorrectionSource::Module).unwrap().score.unwrap();
        assert!(score.rms_deg < 0.5, "{score:?}");
    }
}

/// Times count from the log's start, 2 s after the clock's.
#[test]
fn a_compass_that_fails_in_flight_is_reported() {
    let text = String::from_utf8(encode_dataflash_text(&record_flight(&WorldConfig::random_world(3)))).unwrap();
    let second = |dead: fn(&str) -> String| {
        let mut last = String::new();
        let mut log = String::new();
        for line in text.lines() {
            let _ = writeln!(log, "{line}");
            let Some((time_stamp, values)) = line.strip_prefix("MAG, ").and_then(|values| values.split_once(", 0, "))
            else {
                continue;
            };
            if time_stamp.parse::<u64>().unwrap() < 120_000_000 {
                values.clone_into(&mut last);
            }
            let values = if time_stamp.parse::<u64>().unwrap() < 120_000_000 { values.to_owned() } else { dead(&last) };
            if !values.is_empty() {
                let _ = writeln!(log, "MAG, {time_stamp}, 1, {values}");
            }
        }
        let (flight, verdict) = evaluate_log_text(&log);
        let notes = LogWarning::warnings_of_flight(&flight, &verdict);
        let notes = notes.iter().map(ToString::to_string).filter(|note| note.starts_with("compass "));
        (notes.collect::<Vec<_>>(), verdict)
    };
    let (frozen_log, verdict) = second(str::to_owned);
    assert!(
        frozen_log.len() == 1
            && frozen_log[0]
                .starts_with("compass 2: its field is constant while the aircraft moves, from 120 to 240 s"),
        "{frozen_log:?}"
    );
    // Half of the second compass's rows are rejected; the others are as good as those of the first.
    let [alive, dead] = verdict.compasses.as_slice() else { panic!("two compasses") };
    assert!(
        (1190..=1210).contains(&dead.row_counts.frozen_field) && alive.row_counts.frozen_field == 0,
        "{:?}",
        dead.row_counts
    );
    assert!(
        dead.correction_from(CorrectionSource::Module).unwrap().score.unwrap().rms_deg < 0.5,
        "the bound of `replay/native.rs`"
    );
    let (ending_log, _) = second(|_| String::new());
    assert!(
        ending_log.len() == 1 && ending_log[0].starts_with("compass 2: its field ends at 120 s, the log at 240 s"),
        "{ending_log:?}"
    );
}

/// The log with changed lines; empty ones are removed.
fn change_lines(text: &str, mut change: impl FnMut(&str) -> String) -> String {
    text.lines().map(|line| change(line) + "\n").filter(|line| line.len() > 1).collect()
}

/// `LOG_BITMASK` may disable `ATT`.
#[test]
fn the_filters_attitude_gives_the_same_headings() {
    let text = String::from_utf8(encode_dataflash_text(&record_flight(&WorldConfig::random_world(3)))).unwrap();
    let without = text.replace("\nATT, ", "\nXKF1, ").replace(", ATT, ", ", XKF1, ");
    let [(_, from_attitude), (flight, other)] = [evaluate_log_text(&text), evaluate_log_text(&without)];
    let score = |verdict: &FlightEvaluation| {
        verdict.compasses[0].correction_from(CorrectionSource::Module).unwrap().score.unwrap()
    };
    assert_eq!(score(&from_attitude), score(&other));
    assert!(warnings_text(&flight, &other).contains("that of XKF1 is used"));
}

/// Until 2014 field and attitude had no time; they get the stamp before, 0.1 s earlier, while the rates have their own,
/// which adds to the error of `replay/native.rs`.
#[test]
fn rows_without_time_get_the_time_of_their_neighbours() {
    let text = String::from_utf8(encode_dataflash_text(&record_flight(&WorldConfig::random_world(3)))).unwrap();
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
    let (flight, verdict) = evaluate_log_text(&strip(&["MAG", "ATT"], &text));
    let score = verdict.compasses[0].correction_from(CorrectionSource::Module).unwrap().score.unwrap();
    assert!(score.rms_deg < 1.0, "{score:?}");
    assert!(warnings_text(&flight, &verdict).contains("carry no time"));
    let without_columns = strip(&["MAG", "ATT", "IMU", "BAT", "GPS", "MSG", "PARM"], &text);
    let refused = log::read_flight(&mut without_columns.as_bytes(), FieldUnit::Milligauss).unwrap_err();
    assert!(refused.to_string().contains("carry no time"), "{refused}");
}

/// Three in ten rows of field, attitude and rates are lost. The error limit is that of `replay/native.rs`; headings are
/// not smoothed, which a note states.
#[test]
fn a_log_with_lost_rows_gives_the_same_accuracy() {
    for seed in [3, 5, 8] {
        let world = WorldConfig::random_world(seed);
        let noise_deg = 0.45 * world.earth.inclination_deg.to_radians().tan().abs();
        let text = String::from_utf8(encode_dataflash_text(&record_flight(&world))).unwrap();
        let mut random_state = seed;
        let holes = change_lines(&text, |line| {
            let is_row = ["MAG, ", "ATT, ", "IMU, "].iter().any(|prefix| line.starts_with(prefix));
            // Knuth's linear congruential generator; its upper bits are random enough.
            random_state = random_state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            if is_row && (random_state >> 33) % 10 < 3 { String::new() } else { line.to_owned() }
        });
        let (flight, verdict) = evaluate_log_text(&holes);
        let compass = &verdict.compasses[0];
        let module_score = compass.correction_from(CorrectionSource::Module).unwrap().score.unwrap();
        assert!(module_score.rms_deg < 0.5 + noise_deg, "seed {seed}: {module_score:?}");
        assert_eq!(compass.module_result.smoothed_score, Some(module_score), "seed {seed}");
        let notes = warnings_text(&flight, &verdict);
        assert!(notes.contains("of the body rates are lost"), "{notes}");
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
    let (flight, verdict) = evaluate_log_text(&String::from_utf8(encode_dataflash_text(&recording)).unwrap());
    assert_eq!(verdict.compasses[0].sphere_radius_ut, None);
    let notes = warnings_text(&flight, &verdict);
    assert!(!notes.contains("taken for") && !notes.contains("radians"), "{notes}");
}
