//! NMEA heading output as an autopilot receives it.

use log_analysis::score::wrap_180;
use simulator::module::Module as _;
use simulator::rig::Rig;

use crate::fixtures::{calibrated_rig, count_headings, full_status, received_sentences};

#[test]
fn every_sentence_is_sent_at_the_set_rate() {
    let mut rig = calibrated_rig();
    for (rate_hz, expected) in [(10, 50_usize), (1, 5), (40, 200), (80, 400)] {
        rig.send_console_line(&format!("set stream-rate {rate_hz}"));
        let received = received_sentences(&mut rig, 5.0);
        for sentence_kind in ["HCHDM", "HCHDG", "PASWH"] {
            let count = received.iter().filter(|sentence| sentence.sentence_kind == sentence_kind).count();
            // Sentences are sent at samples (80 Hz), whose rate need not be a multiple of the output rate.
            assert!(count.abs_diff(expected) <= 1 + expected / 20, "{sentence_kind} at {rate_hz} Hz: {count} in 5 s");
        }
        assert_eq!(count_headings(&received), received.len());
    }
    rig.send_console_line("set stream off");
    assert!(received_sentences(&mut rig, 2.0).is_empty());
}

/// Smooth by default; the sentence names the kind. Second differences of the smooth heading are below a third of those
/// of the raw one.
#[test]
fn the_pilot_chooses_which_heading_is_sent() {
    let mut rig = calibrated_rig();
    // The heading is smooth once the monitor has settled.
    rig.run_for_s(25.0);
    let mut bends_deg = Vec::new();
    for heading_kind in ["smooth", "raw", "smooth"] {
        rig.send_console_line(&format!("set heading {heading_kind}"));
        rig.run_for_s(0.5);
        let received = received_sentences(&mut rig, 4.0);
        let qualities: Vec<_> = received.iter().filter(|sentence| sentence.sentence_kind == "PASWH").collect();
        assert!(
            qualities.len() >= 35
                && qualities.iter().all(|sentence| sentence.heading_kind.as_deref() == Some(heading_kind)),
            "{heading_kind}"
        );
        let headings: Vec<f64> = qualities.iter().filter_map(|sentence| sentence.heading_deg).collect();
        let bend = |heading_window: &[f64]| {
            wrap_180(heading_window[2] - heading_window[1]) - wrap_180(heading_window[1] - heading_window[0])
        };
        let squares = headings.windows(3).map(|heading_window| bend(heading_window).powi(2)).sum::<f64>();
        bends_deg.push((squares / headings.len() as f64).sqrt());
    }
    assert!(bends_deg[0] < 0.33 * bends_deg[1] && bends_deg[2] < 0.33 * bends_deg[1], "{bends_deg:?}");
}

#[test]
fn variation_is_sent_when_declination_is_set() {
    let mut rig = calibrated_rig();
    let sentence = |rig: &mut Rig, sentence_kind: &str| {
        let _ = rig.instrument.receive_bytes();
        rig.run_for_s(0.3);
        let text = String::from_utf8(rig.instrument.receive_bytes()).unwrap();
        text.split("\r\n").find(|line| line.starts_with(sentence_kind)).map(str::to_owned)
    };
    let is_true = |rig: &mut Rig, declination_deg: f64| {
        let received = received_sentences(rig, 1.0);
        let heading_deg = |sentence_kind: &str| {
            received.iter().find(|sentence| sentence.sentence_kind == sentence_kind).unwrap().heading_deg.unwrap()
        };
        // Headings of one output are rounded to 0.1 deg each.
        let off_deg = heading_deg("HCHDT") - heading_deg("HCHDM") - declination_deg;
        (off_deg - 360.0 * (off_deg / 360.0).round()).abs() < 0.11
    };
    assert!(sentence(&mut rig, "$HCHDG").unwrap().contains(",,,,*"));
    assert_eq!(sentence(&mut rig, "$HCHDT"), None);
    rig.send_console_line("set declination -11.3");
    assert!(sentence(&mut rig, "$HCHDG").unwrap().contains(",,,11.3,W*"));
    assert!(is_true(&mut rig, -11.3));
    rig.send_console_line("set declination 4");
    assert!(sentence(&mut rig, "$HCHDG").unwrap().contains(",,,4.0,E*"));
    assert!(is_true(&mut rig, 4.0));
}

/// A field of 400 uT is the limit of the sensor's range, and one 20 uT stronger than the Earth's is interference. A silent
/// sensor is detected within 0.25 s, and has lost its configuration when it returns.
#[test]
fn a_fault_of_the_field_or_the_sensor_withholds_the_heading_until_its_end() {
    type Change = fn(&Rig);
    struct Case {
        reason: &'static str,
        begin: Change,
        detected_within_s: f64,
        least_sentences: usize,
        /// And the time until headings are sent again.
        end: Option<(Change, f64)>,
    }
    for Case { reason, begin, detected_within_s, least_sentences, end } in [
        Case {
            reason: "sensor-saturated",
            begin: |rig| rig.world.set_disturbance_ut([900.0, 0.0, 0.0]),
            detected_within_s: 0.2,
            least_sentences: 30,
            end: Some((|rig| rig.world.set_disturbance_ut([0.0; 3]), 0.2)),
        },
        Case {
            reason: "field-disturbed",
            begin: |rig| rig.world.set_disturbance_ut([0.0, 0.0, 25.0]),
            detected_within_s: 0.2,
            least_sentences: 30,
            end: None,
        },
        Case {
            reason: "sensor-silent",
            begin: |rig| rig.magnetometer.set_silent(true),
            detected_within_s: 0.25,
            least_sentences: 20,
            end: Some((
                |rig| {
                    rig.magnetometer.power_cycle();
                    rig.magnetometer.set_silent(false);
                },
                1.0,
            )),
        },
    ] {
        let mut rig = calibrated_rig();
        begin(&rig);
        rig.run_for_s(detected_within_s);
        let received = received_sentences(&mut rig, 2.0);
        assert!(received.len() >= least_sentences && count_headings(&received) == 0, "{reason}: {received:?}");
        assert!(full_status(&mut rig).contains(&format!("heading: none, {reason}")), "{reason}");
        let Some((end, resumed_within_s)) = end else { continue };
        end(&rig);
        rig.run_for_s(resumed_within_s);
        let received = received_sentences(&mut rig, 2.0);
        assert_eq!(count_headings(&received), received.len(), "{reason}");
        assert!(full_status(&mut rig).contains("started by power-on"), "{reason}: it did not restart");
    }
}
