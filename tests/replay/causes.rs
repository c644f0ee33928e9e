//! Causes injected into recorded flights, and the report of each: the table in docs/your-flight.md.

use log_analysis::log::write::{FlightRecording, FlightSample, encode_dataflash};
use log_analysis::replay::evaluation::evaluate_flight;
use log_analysis::replay::parameter_export::ParameterFormat;
use log_analysis::replay::verdict::{CompassAction, Verdict};
use simulator::recording::record_turns;
use simulator::world::WorldConfig;

use crate::{ASKED, read};

/// Change of a recording; `t_s` counts from its start.
type Cause = fn(t_s: f64, sample: &mut FlightSample);

/// What is reported of a cause.
struct Reported {
    action: CompassAction,
    /// Sentence of the compass, and notes.
    text: String,
    changes: usize,
    rms_deg: Option<f64>,
}

fn report(seed: u64, cause: Cause) -> Reported {
    let parameters = vec![("COMPASS_OFS_X".to_owned(), 0.0)];
    let mut recording = FlightRecording { parameters, ..record_turns(&WorldConfig::random(seed), 0.05) };
    let first_us = recording.samples[0].time_us;
    for sample in &mut recording.samples {
        cause((sample.time_us - first_us) as f64 * 1e-6, sample);
    }
    // Yaw is recorded as the truth; a hole has no rows.
    recording.samples.retain(|sample| sample.is_armed);
    let mut flight = read(&encode_dataflash(&recording));
    flight.truth = flight.attitude.clone();
    let evaluation = evaluate_flight(&flight, &ASKED);
    let verdict = Verdict::new(&flight, &evaluation, ParameterFormat::ArduPilot);
    let notes: Vec<String> = verdict.notes.iter().map(ToString::to_string).collect();
    Reported {
        action: verdict.compasses[0].judgement.action,
        text: format!("{} {}", verdict.sentences().concat(), notes.join("; ")),
        changes: evaluation.compasses[0].changes.len(),
        rms_deg: verdict.parameters().first().map(|export| export.held_back.unwrap().rms_deg),
    }
}

/// Each cause that the samples show is named; none is named that they cannot show; and where it does not concern the
/// compass, its parameters are as good as without it, within a fifth and 0.2 deg.
#[test]
fn a_report_names_the_injected_cause_and_no_other() {
    use CompassAction::{FlyAgain, Load, Replace};
    let causes: [(&str, Cause, &[CompassAction], &str, usize); 9] = [
        ("nothing", |_, _| {}, &[Load], "", 0),
        ("rate of wrong sign", |_, sample| sample.rates_rad_s[0] *= -1.0, &[Load], "about x has the sign opposite", 0),
        (
            "rates in degrees",
            |_, sample| sample.rates_rad_s = sample.rates_rad_s.map(f64::to_degrees),
            &[Load],
            "in another unit",
            0,
        ),
        ("holes of 3 s", |t_s, sample| sample.is_armed = t_s % 20.0 > 3.0, &[Load], "", 0),
        (
            "a jump of the attitude",
            |t_s, sample| sample.attitude_rad[0] += if (100.0..100.25).contains(&t_s) { 0.5 } else { 0.0 },
            &[Load],
            "",
            0,
        ),
        (
            "iron moved by 6 uT",
            |t_s, sample| sample.field_ut[0][1] += if t_s > 118.0 { 6.0 } else { 0.0 },
            &[Load],
            "has other iron around it since 118 s, by 6.0 uT",
            1,
        ),
        (
            "a stuck axis",
            |t_s, sample| sample.field_ut[0][1] = if t_s > 118.0 { 12.0 } else { sample.field_ut[0][1] },
            &[Replace],
            "failed: its y axis is constant",
            0,
        ),
        (
            "roll of wrong sign",
            |_, sample| sample.attitude_rad[0] *= -1.0,
            &[FlyAgain, Replace],
            "about x has the sign",
            0,
        ),
        ("straight flight only", |t_s, sample| sample.is_armed = t_s < 8.0, &[FlyAgain], "too few", 0),
    ];
    for seed in [3, 5] {
        let untouched_deg = report(seed, |_, _| {}).rms_deg.unwrap();
        for (name, cause, actions, words, changes) in causes {
            let Reported { action, text, changes: found, rms_deg } = report(seed, cause);
            println!("seed {seed}: {name}: {text}");
            assert!(actions.contains(&action), "seed {seed}: {name}: {text}");
            assert!(text.contains(words), "seed {seed}: {name}: {text}");
            assert_eq!(found, changes, "seed {seed}: {name}: {text}");
            let limit_deg = 1.2 * untouched_deg + 0.2;
            assert!(rms_deg.is_none_or(|deg| deg < limit_deg), "seed {seed}: {name}: {rms_deg:?}");
            assert!(!text.contains("mounted"), "seed {seed}: {name}: {text}");
        }
    }
}
