//! Whose component it is, whom it believes, and what it tells by itself: heartbeats, headings, poses, texts.

use super::*;

#[test]
fn nothing_is_sent_before_an_autopilot_is_heard() {
    let mut bed = Bed::new();
    bed.module.note("calibrated: well");
    bed.hear(&heartbeat(GIMBAL, false, false));
    bed.hear(&attitude(GIMBAL, 0));
    bed.hear(&command(STATION, [0, 158], 42_424, 0, [0.0; 4]));
    bed.run(5_000);
    assert_eq!(bed.sent, []);
    bed.hear(&heartbeat(AUTOPILOT, true, false));
    bed.poll();
    assert!(bed.sent.iter().all(|sent| sent.from == [1, 158]));
    assert_eq!(bed.take(0).len(), 1);
    assert_eq!(bed.texts(), [(6, "autoswing: calibrated: well".into())]);
}

#[test]
fn a_heartbeat_a_second_tells_the_state() {
    let mut bed = Bed::beside_an_autopilot();
    for (glance, state) in
        [(Glance::Waiting, 0), (Glance::Collecting(40), 2), (Glance::Calibrated, 4), (Glance::Refused, 5)]
    {
        bed.glance = glance;
        bed.run(10_000);
        // It keeps its place, but somebody has to be heard of at all.
        let beats = bed.take(0);
        assert_eq!(beats.len(), 10);
        assert!(beats.iter().all(|beat| beat.payload[4..9] == [18, 8, 0, state, 3]), "{glance:?}");
    }
}

/// Of each kind what others say changes nothing: a second autopilot, a gimbal of the same system, the module itself.
#[test]
fn place_day_and_current_are_of_the_autopilot_that_is_believed() {
    let mut bed = Bed::beside_an_autopilot();
    bed.hear(&heartbeat(SECOND, true, true));
    for who in [SECOND, GIMBAL, [1, 158], STATION] {
        assert_eq!(bed.hear(&[place(who), time(who), current(who)].concat()), [], "{who:?}");
    }
    let heard = bed.hear(&[place(AUTOPILOT), time(AUTOPILOT), current(AUTOPILOT)].concat());
    let [Heard::Place(here), Heard::Day(day), Heard::Current(12.5)] = heard[..] else { panic!("{heard:?}") };
    assert_eq!((here.latitude_deg, here.longitude_deg), (47.3, 8.5));
    assert_eq!(Some(day), Day::from_unix_s(1_790_000_000));
    // Without a fix.
    assert_eq!(bed.hear(&frame(AUTOPILOT, 33, 104, &[1])), []);
    // Nobody is believed: not even an autopilot's.
    assert_eq!(Bed::new().hear(&place(AUTOPILOT)), []);
}

#[test]
fn attitude_and_arming_are_of_the_sender_that_is_believed() {
    let mut bed = Bed::beside_an_autopilot();
    assert_eq!(bed.hear(&attitude(SECOND, 0)), [Heard::Foreign]);
    let heard = bed.hear(&attitude(AUTOPILOT, 7));
    let [Heard::Attitude(report)] = heard[..] else { panic!("{heard:?}") };
    assert_eq!(report.attitude, Attitude { roll_rad: 0.1, pitch_rad: 0.2 });
    bed.hear(&heartbeat(SECOND, true, true));
    assert_eq!(bed.module.is_armed(bed.now()), Some(false));
    bed.hear(&heartbeat(AUTOPILOT, true, true));
    assert_eq!(bed.module.is_armed(bed.now()), Some(true));
    let mut broken = attitude(AUTOPILOT, 8);
    *broken.last_mut().unwrap() ^= 1;
    assert_eq!((bed.hear(&broken), bed.module.rejected()), (vec![], 1));
}

/// A wire from the module's output to its input, beside an autopilot's.
#[test]
fn its_own_messages_that_come_back_change_nothing() {
    let mut bed = Bed::beside_an_autopilot();
    bed.hear(&heartbeat(AUTOPILOT, true, true));
    for _ in 0..2_000 {
        let facts = Facts {
            now: bed.now(),
            estimate: &Estimate::NOTHING,
            settings: &Settings { tells_vision: true, ..Settings::DEFAULT },
            glance: Glance::Collecting(3),
            calibration: None,
        };
        let mut out = Output::new();
        bed.module.poll(&facts, &mut out);
        assert_eq!(bed.hear(out.pending()), []);
        bed.ms += 1;
    }
    assert_eq!((bed.module.is_armed(bed.now()), bed.module.rejected()), (Some(true), 0));
    assert_eq!(bed.module.senders.autopilot(bed.now()), Some(Source::new(0x0101)));
}

#[test]
fn frames_are_counted_and_those_that_do_not_fit_are_not() {
    let mut bed = Bed::beside_an_autopilot();
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

fn values(bed: &mut Bed, name: &str) -> Vec<f32> {
    let mut values = vec![];
    for sent in bed.sent.iter().filter(|sent| sent.id == 251) {
        if sent.payload[8..18].starts_with(name.as_bytes()) {
            assert_eq!(sent.payload[..4], (sent.ms as u32).to_le_bytes());
            values.push(sent.float(4));
        }
    }
    values
}

/// Five headings a second, of the kind that is set, and one percentage.
#[test]
fn headings_are_told_as_named_values() {
    for (stream_heading, has_smooth, expected_deg) in
        [(HeadingKind::Smooth, true, 20.0), (HeadingKind::Smooth, false, 10.0), (HeadingKind::Raw, true, 10.0)]
    {
        let mut bed = Bed::beside_an_autopilot();
        bed.settings.stream_heading = stream_heading;
        bed.estimate.heading = Ok(heading(10.0, 1.0));
        bed.estimate.smooth = has_smooth.then(|| heading(20.0, 1.0));
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
    let mut bed = Bed::beside_an_autopilot();
    bed.estimate.heading = Err(NoHeading::FieldDisturbed);
    bed.run(2_000);
    bed.estimate.heading = Ok(heading(10.0, 1.0));
    bed.settings.stream_on = false;
    bed.run(2_000);
    assert_eq!(values(&mut bed, "hdg"), []);
}

#[test]
fn the_percentage_is_that_of_the_calibration() {
    for (glance, percent) in
        [(Glance::Waiting, 0.0), (Glance::Collecting(37), 37.0), (Glance::Calibrated, 100.0), (Glance::Refused, 0.0)]
    {
        let mut bed = Bed::beside_an_autopilot();
        bed.glance = glance;
        bed.run(100);
        assert_eq!(values(&mut bed, "cal_pct"), [percent]);
    }
}

fn seeing() -> Bed {
    let mut bed = Bed::beside_an_autopilot();
    bed.settings.tells_vision = true;
    bed.settings.declination_deg = Some(-20.0);
    bed.estimate.at = Timestamp::from_us(3_599_990_000);
    bed.estimate.heading = Ok(heading(10.0, 2.0));
    bed.estimate.smooth = Some(heading(99.0, 9.0));
    bed.estimate.attitude = Some(Attitude { roll_rad: 0.3, pitch_rad: -0.1 });
    bed
}

/// True heading: 10 deg magnetic and 20 deg of variation to the west. Fifty a second of a hundred estimates.
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
    let without: [fn(&mut Bed); 4] = [
        |bed| bed.settings.tells_vision = false,
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

#[test]
fn texts_warn_of_what_went_wrong() {
    let mut bed = Bed::beside_an_autopilot();
    bed.module.note("refused armed: land\r\n");
    bed.module.note("iron-moved: 3 uT");
    bed.module.note("iron-back: as calibrated, nothing refused");
    bed.run(1_000);
    let expected = [
        (4, "autoswing: refused armed: land"),
        (4, "autoswing: iron-moved: 3 uT"),
        (6, "autoswing: iron-back: as calibrated, nothing refused"),
    ];
    assert_eq!(bed.texts(), expected.map(|(severity, text)| (severity, text.to_owned())));
}

/// Lengths about those of whole pieces, of which the last is to be one with room.
#[test]
fn a_long_text_comes_in_pieces() {
    for length in [49, 50, 51, 99, 100, 101, 150, 239, 240, 241, 500] {
        let mut bed = Bed::beside_an_autopilot();
        let text: String = ('a'..='z').cycle().take(length - 11).collect();
        bed.module.note(&text);
        bed.run(2_000);
        let pieces = bed.sent.iter().filter(|sent| sent.id == 253);
        let sequences: Vec<u8> = pieces.clone().map(|sent| sent.payload[53]).collect();
        let told = length.min(240);
        let number = if told > 50 { told / 50 + 1 } else { 1 };
        assert_eq!(sequences, (0..number as u8).collect::<Vec<_>>(), "{length}");
        let ids: Vec<[u8; 2]> = pieces.clone().map(|sent| [sent.payload[51], sent.payload[52]]).collect();
        assert!(ids.iter().all(|&id| (id != [0, 0]) == (told > 50) && id == ids[0]), "{ids:?}");
        // Ten pieces a second at most.
        let times: Vec<u64> = pieces.map(|sent| sent.ms).collect();
        assert!(times.windows(2).all(|pair| pair[1] - pair[0] >= 100), "{times:?}");
        let whole = format!("autoswing: {text}");
        assert_eq!(bed.texts(), [(6, whole[..told].to_owned())]);
    }
}

/// Two long ones after each other are not put together.
#[test]
fn each_long_text_has_a_number_of_its_own() {
    let mut bed = Bed::beside_an_autopilot();
    for text in ["a".repeat(60), "b".repeat(60)] {
        bed.module.note(&text);
    }
    bed.run(2_000);
    let ids: Vec<u8> = bed.sent.iter().filter(|sent| sent.id == 253).map(|sent| sent.payload[51]).collect();
    assert_eq!(ids, [1, 1, 2, 2]);
}

#[test]
fn of_too_many_texts_the_newest_stay_and_the_one_that_was_begun() {
    let mut bed = Bed::new();
    for number in 0..5 {
        bed.module.note(&format!("text {number}"));
    }
    bed.hear(&heartbeat(AUTOPILOT, true, false));
    bed.run(1_000);
    let texts = |bed: &mut Bed| bed.texts().into_iter().map(|(_, text)| text).collect::<Vec<_>>();
    assert_eq!(texts(&mut bed), [2, 3, 4].map(|number| format!("autoswing: text {number}")));
    let long = "x".repeat(120);
    bed.module.note(&long);
    bed.run(10);
    for number in 0..5 {
        bed.module.note(&format!("text {number}"));
    }
    bed.run(2_000);
    let expected = [format!("autoswing: {long}"), "autoswing: text 3".into(), "autoswing: text 4".into()];
    assert_eq!(texts(&mut bed), expected);
}

#[test]
fn a_text_waits_for_room() {
    let mut bed = Bed::beside_an_autopilot();
    bed.module.note("one");
    bed.room = Some(20);
    bed.run(1_000);
    assert_eq!(bed.texts(), []);
    bed.room = None;
    bed.run(200);
    assert_eq!(bed.texts(), [(6, "autoswing: one".to_owned())]);
}
