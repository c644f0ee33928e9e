//! Selection of the autopilot, and unsolicited messages: heartbeats, headings, poses, texts.

use nalgebra::Vector3;

use super::*;
use crate::instrument::HardIronChange;
use crate::settings::OutOfRange;

/// Prefix of a text whose end a test selects.
const BEGINNING: &str = "autoswing: refused out-of-range: ";

fn ending(end: &str) -> Notice {
    Notice::CommandRejected(Refusal::OutOfRange(OutOfRange(String::from(end).leak())))
}

#[test]
fn nothing_is_sent_before_an_autopilot_is_heard() {
    let mut bed = MavlinkBench::new();
    bed.module.queue_text(&Notice::HardIronRestored);
    bed.hear(&heartbeat(GIMBAL, false, false));
    bed.hear(&attitude(GIMBAL, 0));
    bed.hear(&command(STATION, [0, 158], 42_424, 0, [0.0; 4]));
    bed.run(5_000);
    assert_eq!(bed.sent, []);
    bed.hear(&heartbeat(AUTOPILOT, true, false));
    bed.poll();
    assert!(bed.sent.iter().all(|sent| sent.from == [1, 158]));
    assert_eq!(bed.take(0).len(), 1);
    assert_eq!(bed.texts(), [(6, "autoswing: iron-back: as calibrated again".into())]);
}

#[test]
fn a_heartbeat_a_second_tells_the_state() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    for (glance, state) in [
        (IndicatorState::Idle, 0),
        (IndicatorState::Collecting(40), 2),
        (IndicatorState::Calibrated, 4),
        (IndicatorState::Refused, 5),
    ] {
        bed.glance = glance;
        bed.run(10_000);
        let beats = bed.take(0);
        assert_eq!(beats.len(), 10);
        assert!(beats.iter().all(|beat| beat.payload[4..9] == [18, 8, 0, state, 3]), "{glance:?}");
    }
}

/// Messages of a second autopilot, a gimbal of the same system and the module itself are ignored.
#[test]
fn place_day_and_current_are_of_the_autopilot_that_is_believed() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.hear(&heartbeat(SECOND, true, true));
    for who in [SECOND, GIMBAL, [1, 158], STATION] {
        assert_eq!(bed.hear(&[place(who), time(who), current(who)].concat()), [], "{who:?}");
    }
    let heard = bed.hear(&[place(AUTOPILOT), time(AUTOPILOT), current(AUTOPILOT)].concat());
    let [ReceivedMessage::Position(here), ReceivedMessage::Date(day), ReceivedMessage::Current(12.5)] = heard[..]
    else {
        panic!("{heard:?}")
    };
    assert_eq!((here.latitude_deg, here.longitude_deg), (47.3, 8.5));
    assert_eq!(Some(day), Date::from_unix_s(1_790_000_000));
    assert_eq!(bed.hear(&frame(AUTOPILOT, 33, 104, &[1])), []);
    // Without a selected sender an autopilot's messages are ignored, too.
    assert_eq!(MavlinkBench::new().hear(&place(AUTOPILOT)), []);
}

#[test]
fn attitude_and_arming_are_of_the_sender_that_is_believed() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    assert_eq!(bed.hear(&attitude(SECOND, 0)), [ReceivedMessage::RejectedAttitude]);
    let heard = bed.hear(&attitude(AUTOPILOT, 7));
    let [ReceivedMessage::Attitude(report)] = heard[..] else { panic!("{heard:?}") };
    assert_eq!(report.attitude, Attitude { roll_rad: 0.1, pitch_rad: 0.2 });
    bed.hear(&heartbeat(SECOND, true, true));
    assert_eq!(bed.module.is_armed(bed.now()), Some(false));
    bed.hear(&heartbeat(AUTOPILOT, true, true));
    assert_eq!(bed.module.is_armed(bed.now()), Some(true));
    let mut broken = attitude(AUTOPILOT, 8);
    *broken.last_mut().unwrap() ^= 1;
    assert_eq!((bed.hear(&broken), bed.module.rejected_frames()), (vec![], 1));
}

/// The module's output is connected to its input, next to an autopilot's.
#[test]
fn its_own_messages_that_come_back_change_nothing() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.hear(&heartbeat(AUTOPILOT, true, true));
    for _ in 0..2_000 {
        let facts = Snapshot {
            now: bed.now(),
            estimate: &Estimate::EMPTY,
            settings: &Settings { sends_vision_yaw: true, ..Settings::DEFAULT },
            indicator: IndicatorState::Collecting(3),
            calibration: None,
        };
        let mut out = TransmitBuffer::new();
        bed.module.poll(&facts, &mut out);
        assert_eq!(bed.hear(out.pending()), []);
        bed.ms += 1;
    }
    assert_eq!((bed.module.is_armed(bed.now()), bed.module.rejected_frames()), (Some(true), 0));
    assert_eq!(bed.module.senders.autopilot_to_query(bed.now()), Some(SenderId::new(0x0101)));
}

#[test]
fn frames_are_counted_and_those_that_do_not_fit_are_not() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.estimate.heading = Ok(heading(10.0, 1.0));
    bed.run(30_000);
    bed.room = Some(0);
    bed.run(2_000);
    bed.room = None;
    bed.run(30_000);
    assert!(bed.sent.len() > 512, "it wraps");
    for (number, sent) in bed.sent.iter().enumerate() {
        assert_eq!(usize::from(sent.sequence), number % 256);
    }
}

fn values(bed: &mut MavlinkBench, name: &str) -> Vec<f32> {
    let mut values = vec![];
    for sent in bed.sent.iter().filter(|sent| sent.id == 251) {
        if sent.payload[8..18].starts_with(name.as_bytes()) {
            assert_eq!(sent.payload[..4], (sent.ms as u32).to_le_bytes());
            values.push(sent.float(4));
        }
    }
    values
}

/// Five headings of the set kind and one percentage each second.
#[test]
fn headings_are_told_as_named_values() {
    for (stream_heading, has_smooth, expected_deg) in
        [(HeadingKind::Smooth, true, 20.0), (HeadingKind::Smooth, false, 10.0), (HeadingKind::Raw, true, 10.0)]
    {
        let mut bed = MavlinkBench::beside_an_autopilot();
        bed.settings.stream_heading = stream_heading;
        bed.estimate.heading = Ok(heading(10.0, 1.0));
        bed.estimate.smoothed_heading = has_smooth.then(|| heading(20.0, 1.0));
        bed.run(2_000);
        let [headings, sigmas] = ["hdg_mag", "hdg_sigma"].map(|name| values(&mut bed, name));
        assert_eq!((headings.len(), sigmas.len()), (10, 10));
        assert!(headings.iter().all(|deg| (deg - expected_deg).abs() < 1e-4), "{headings:?}");
        assert!(sigmas.iter().all(|deg| (deg - 1.0).abs() < 1e-5));
        assert_eq!(values(&mut bed, "cal_pct"), [0.0, 0.0]);
    }
}

#[test]
fn what_is_no_heading_or_not_to_be_sent_is_not_told() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.estimate.heading = Err(NoHeading::FieldDisturbed);
    bed.run(2_000);
    bed.estimate.heading = Ok(heading(10.0, 1.0));
    bed.settings.stream_on = false;
    bed.run(2_000);
    assert_eq!(values(&mut bed, "hdg"), []);
}

#[test]
fn the_percentage_is_that_of_the_calibration() {
    for (glance, percent) in [
        (IndicatorState::Idle, 0.0),
        (IndicatorState::Collecting(37), 37.0),
        (IndicatorState::Calibrated, 100.0),
        (IndicatorState::Refused, 0.0),
    ] {
        let mut bed = MavlinkBench::beside_an_autopilot();
        bed.glance = glance;
        bed.run(100);
        assert_eq!(values(&mut bed, "cal_pct"), [percent]);
    }
}

fn seeing() -> MavlinkBench {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.settings.sends_vision_yaw = true;
    bed.settings.declination_deg = Some(-20.0);
    bed.estimate.at = Timestamp::from_us(3_599_990_000);
    bed.estimate.heading = Ok(heading(10.0, 2.0));
    bed.estimate.smoothed_heading = Some(heading(99.0, 9.0));
    bed.estimate.attitude = Some(Attitude { roll_rad: 0.3, pitch_rad: -0.1 });
    bed
}

/// True heading: 10 deg magnetic, variation 20 deg west. 50 Hz from estimates at 100 Hz.
#[test]
fn a_pose_is_the_raw_true_heading_and_the_attitude_of_its_instant() {
    let mut bed = seeing();
    bed.run(1_000);
    let poses = bed.take(102);
    assert_eq!(poses.len(), 50);
    for pose in poses {
        assert_eq!(pose.payload[..8], 3_599_990_000_u64.to_le_bytes());
        assert_eq!(pose.payload[8..20], [0; 12]);
        assert_eq!((pose.float(20), pose.float(24)), (0.3, -0.1));
        assert!((pose.float(28).to_degrees() + 10.0).abs() < 1e-4, "{}", pose.float(28));
        assert!(pose.float(32).is_nan());
        assert!((pose.float(32 + 4 * 20) - 2_f32.to_radians().powi(2)).abs() < 1e-7);
        assert_eq!(pose.payload[116], 0);
    }
    bed.estimate.heading = Ok(heading(350.0, 2.0));
    bed.run(100);
    assert!((bed.take(102)[0].float(28).to_degrees() + 30.0).abs() < 1e-3);
}

#[test]
fn without_declination_heading_attitude_or_leave_there_is_no_pose() {
    let without: [fn(&mut MavlinkBench); 4] = [
        |bed| bed.settings.sends_vision_yaw = false,
        |bed| bed.settings.declination_deg = None,
        |bed| bed.estimate.heading = Err(NoHeading::FieldDisturbed),
        |bed| bed.estimate.attitude = None,
    ];
    for change in without {
        let mut bed = seeing();
        change(&mut bed);
        bed.run(1_000);
        assert_eq!(bed.take(102), []);
    }
}

/// MAV_SEVERITY_WARNING is 4, MAV_SEVERITY_INFO 6.
#[test]
fn a_text_has_the_severity_of_its_message() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    let moved = Notice::HardIronChanged(HardIronChange { change_ut: Vector3::new(3.0, 0.0, 0.0), sigma_ut: 0.4 });
    for message in [&Notice::CommandRejected(Refusal::NoSensor), &moved, &Notice::HardIronRestored] {
        bed.module.queue_text(message);
    }
    bed.run(2_000);
    let expected = [
        (4, format!("autoswing: {}", Notice::CommandRejected(Refusal::NoSensor))),
        (4, format!("autoswing: {moved}")),
        (6, "autoswing: iron-back: as calibrated again".to_owned()),
    ];
    assert_eq!(bed.texts(), expected);
}

/// Lengths around multiples of a chunk; the last chunk must not be full.
#[test]
fn a_long_text_comes_in_chunks() {
    for length in [49, 50, 51, 99, 100, 101, 150, 239, 240, 241, 500] {
        let mut bed = MavlinkBench::beside_an_autopilot();
        let end: String = ('a'..='z').cycle().take(length - BEGINNING.len()).collect();
        bed.module.queue_text(&ending(&end));
        bed.run(2_000);
        let chunks = bed.sent.iter().filter(|sent| sent.id == 253);
        let sequences: Vec<u8> = chunks.clone().map(|sent| sent.payload[53]).collect();
        let sent = length.min(240);
        let number = if sent > 50 { sent / 50 + 1 } else { 1 };
        assert_eq!(sequences, (0..number as u8).collect::<Vec<_>>(), "{length}");
        let ids: Vec<[u8; 2]> = chunks.clone().map(|sent| [sent.payload[51], sent.payload[52]]).collect();
        assert!(ids.iter().all(|&id| (id != [0, 0]) == (sent > 50) && id == ids[0]), "{ids:?}");
        let times: Vec<u64> = chunks.map(|sent| sent.ms).collect();
        assert!(times.windows(2).all(|pair| pair[1] - pair[0] >= 100), "{times:?}");
        let whole = format!("{BEGINNING}{end}");
        assert_eq!(bed.texts(), [(4, whole[..sent].to_owned())]);
    }
}

/// Consecutive long texts must not be joined.
#[test]
fn each_long_text_has_a_number_of_its_own() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    for end in ["a".repeat(60), "b".repeat(60)] {
        bed.module.queue_text(&ending(&end));
    }
    bed.run(2_000);
    let ids: Vec<u8> = bed.sent.iter().filter(|sent| sent.id == 253).map(|sent| sent.payload[51]).collect();
    assert_eq!(ids, [1, 1, 2, 2]);
}

#[test]
fn of_too_many_texts_the_newest_stay_and_the_one_that_was_begun() {
    let mut bed = MavlinkBench::new();
    for percent in 0..5 {
        bed.module.queue_text(&Notice::Collecting(percent));
    }
    bed.hear(&heartbeat(AUTOPILOT, true, false));
    bed.run(1_000);
    let texts = |bed: &mut MavlinkBench| bed.texts().into_iter().map(|(_, text)| text).collect::<Vec<_>>();
    assert_eq!(texts(&mut bed), [2, 3, 4].map(|percent| format!("autoswing: collecting: {percent} %")));
    let long = "x".repeat(120);
    bed.module.queue_text(&ending(&long));
    bed.run(10);
    for percent in 0..5 {
        bed.module.queue_text(&Notice::Collecting(percent));
    }
    bed.run(2_000);
    let newest = [3, 4].map(|percent| format!("autoswing: collecting: {percent} %"));
    assert_eq!(texts(&mut bed), [&[format!("{BEGINNING}{long}")][..], &newest].concat());
}

#[test]
fn a_text_waits_for_room() {
    let mut bed = MavlinkBench::beside_an_autopilot();
    bed.module.queue_text(&Notice::Collecting(10));
    bed.room = Some(20);
    bed.run(1_000);
    assert_eq!(bed.texts(), []);
    bed.room = None;
    bed.run(200);
    assert_eq!(bed.texts(), [(6, "autoswing: collecting: 10 %".to_owned())]);
}
