//! Selection of the autopilot, and unsolicited messages: heartbeats, headings, poses, texts.

use super::*;
use autoswing_module::settings::{HeadingKind, OutOfRange};

/// Start of a text; tests append the rest.
const TEXT_BEGINNING: &str = "autoswing: refused out-of-range: ";

fn long_message(end: &str) -> Notice {
    Notice::CommandRejected(Refusal::OutOfRange(OutOfRange(String::from(end).leak())))
}

#[test]
fn nothing_is_sent_before_an_autopilot_s_heartbeat() {
    let mut bench = MavlinkBench::new();
    bench.mavlink.queue_text(&Notice::InstallationRestored);
    bench.receive(&mavlink_heartbeat(GIMBAL, false, false));
    bench.receive(&attitude_frame(GIMBAL, 0));
    bench.receive(&mavlink_command(GROUND_STATION, [0, 158], 42_424, 0, [0.0; 4]));
    bench.run_ms(5_000);
    assert_eq!(bench.sent_messages, []);
    bench.receive(&mavlink_heartbeat(AUTOPILOT, true, false));
    bench.poll();
    assert!(bench.sent_messages.iter().all(|sent| sent.sender == [1, 158]));
    assert_eq!(bench.take_messages(0).len(), 1);
    assert_eq!(bench.take_texts(), [(6, "autoswing: iron-back: as calibrated again".into())]);
}

#[test]
fn sequence_numbers_count_sent_frames_only() {
    let mut bench = MavlinkBench::with_autopilot();
    bench.estimate.heading = Ok(heading(10.0, 1.0));
    bench.run_ms(30_000);
    bench.free_output_bytes = Some(0);
    bench.run_ms(2_000);
    bench.free_output_bytes = None;
    bench.run_ms(30_000);
    assert!(bench.sent_messages.len() > 512, "it wraps");
    for (number, sent) in bench.sent_messages.iter().enumerate() {
        assert_eq!(usize::from(sent.sequence), number % 256);
    }
}

fn named_values(bench: &MavlinkBench, name: &str) -> Vec<f32> {
    let mut values = vec![];
    for sent in bench.sent_messages.iter().filter(|sent| sent.message_id == 251) {
        if sent.payload[8..18].starts_with(name.as_bytes()) {
            assert_eq!(sent.payload[..4], (sent.sent_at_ms as u32).to_le_bytes());
            values.push(sent.float_at(4));
        }
    }
    values
}

/// Five headings of the set kind and their sigmas each second.
#[test]
fn headings_are_sent_as_named_values() {
    for (stream_heading, has_smooth, expected_deg) in
        [(HeadingKind::Smooth, true, 20.0), (HeadingKind::Smooth, false, 10.0), (HeadingKind::Raw, true, 10.0)]
    {
        let mut bench = MavlinkBench::with_autopilot();
        bench.settings.stream_heading = stream_heading;
        bench.estimate.heading = Ok(heading(10.0, 1.0));
        bench.estimate.smoothed_heading = has_smooth.then(|| heading(20.0, 1.0));
        bench.run_ms(2_000);
        let [headings, sigmas] = ["hdg_mag", "hdg_sigma"].map(|name| named_values(&bench, name));
        assert_eq!((headings.len(), sigmas.len()), (10, 10));
        assert!(headings.iter().all(|deg| (deg - expected_deg).abs() < 1e-4), "{headings:?}");
        assert!(sigmas.iter().all(|deg| (deg - 1.0).abs() < 1e-5));
    }
}

fn bench_with_heading() -> MavlinkBench {
    let mut bench = MavlinkBench::with_autopilot();
    bench.settings.sends_vision_yaw = true;
    bench.settings.declination_deg = Some(-20.0);
    bench.estimate.timestamp = Timestamp::from_us(3_599_990_000);
    bench.estimate.heading = Ok(heading(99.0, 9.0));
    bench.estimate.smoothed_heading = Some(heading(10.0, 2.0));
    bench.estimate.attitude = Some(RollPitch { roll_rad: 0.3, pitch_rad: -0.1 });
    bench
}

/// True heading: 99 deg magnetic, variation 20 deg west. 10 Hz from estimates at 100 Hz.
#[test]
fn a_pose_contains_the_raw_true_heading_and_attitude() {
    let mut bench = bench_with_heading();
    bench.run_ms(1_000);
    let poses = bench.take_messages(102);
    assert_eq!(poses.len(), 10);
    for pose in poses {
        assert_eq!(pose.payload[..8], 3_599_990_000_u64.to_le_bytes());
        assert_eq!(pose.payload[8..20], [0; 12]);
        assert_eq!((pose.float_at(20), pose.float_at(24)), (0.3, -0.1));
        assert!((pose.float_at(28).to_degrees() - 79.0).abs() < 1e-4, "{}", pose.float_at(28));
        // ArduPilot reads the covariance only if its first element is a number, and takes the root of the sum of the
        // angles' variances (GCS_Common.cpp, handle_common_vision_position_estimate_data).
        let variance = |index: usize| pose.float_at(32 + 4 * index);
        assert!(variance(0) > 1e5, "the position is unknown");
        let angle_error_deg = (variance(15) + variance(18) + variance(20)).sqrt().to_degrees();
        assert!((angle_error_deg - 9.0).abs() < 1e-4, "{angle_error_deg}");
        assert_eq!(pose.payload[116], 0);
    }
}

/// A ground station joins the chunks, of which only the last one is not full; others show each as a line.
#[test]
fn the_chunks_of_a_text_end_with_words() {
    let mut bench = MavlinkBench::with_autopilot();
    bench.mavlink.queue_text(&Notice::CollectionLost);
    bench.run_ms(1_000);
    let chunks: Vec<String> = (bench.take_messages(253).iter())
        .map(|sent| sent.payload[1..51].iter().take_while(|byte| **byte != 0).map(|byte| char::from(*byte)).collect())
        .collect();
    let (last, full) = chunks.split_last().unwrap();
    assert!(full.len() == 2 && full.iter().all(|chunk| chunk.len() == 50 && chunk.ends_with(' ')), "{chunks:?}");
    let lines = chunks.iter().map(|chunk| chunk.trim_end()).collect::<Vec<_>>().join(" ");
    assert_eq!(lines, format!("autoswing: {}", Notice::CollectionLost));
    assert!(last.len() < 50, "{chunks:?}");
}

#[test]
fn a_full_text_queue_keeps_the_newest_and_the_begun_text() {
    let mut bench = MavlinkBench::new();
    for percent in 0..5 {
        bench.mavlink.queue_text(&Notice::Collecting(percent));
    }
    bench.receive(&mavlink_heartbeat(AUTOPILOT, true, false));
    bench.run_ms(1_000);
    let texts = |bench: &mut MavlinkBench| bench.take_texts().into_iter().map(|(_, text)| text).collect::<Vec<_>>();
    assert_eq!(texts(&mut bench), [2, 3, 4].map(|percent| format!("autoswing: collecting: {percent} %")));
    let long = "x".repeat(120);
    bench.mavlink.queue_text(&long_message(&long));
    bench.run_ms(10);
    for percent in 0..5 {
        bench.mavlink.queue_text(&Notice::Collecting(percent));
    }
    bench.run_ms(2_000);
    let newest = [3, 4].map(|percent| format!("autoswing: collecting: {percent} %"));
    assert_eq!(texts(&mut bench), [&[format!("{TEXT_BEGINNING}{long}")][..], &newest].concat());
}
