use autoswing::compass::Glance;
use autoswing::frames::Field;
use autoswing::instrument::Estimate;
use autoswing::port::{Facts, Heard, Msp, Output, Protocol};
use autoswing::settings::Settings;
use autoswing::time::Timestamp;
use autoswing::wire::msp::{self, Firmware as Told, Function, Message, Receiver};

use super::frame::crc_8_dvb_s2;
use super::*;

const KNOWN: Known = Known {
    roll_rad: 0.2,
    pitch_rad: 0.1,
    yaw_rad: -0.1,
    is_armed: true,
    place: Some((-33.9, 151.2, 20.0)),
    // 2026-11-22, noon.
    unix_s: Some(1_795_348_800),
    current_a: Some(12.34),
};

const NONE: Troubles = Troubles { dropped: 0.0, refused: 0.0, cut: 0.0, joined: 0.0 };

fn ask(autopilot: &mut MspAutopilot, at_us: u64, bytes: &[u8]) {
    for &byte in bytes {
        autopilot.take(at_us, byte);
    }
}

/// What the library understands of the answer to a request.
fn answered(autopilot: &mut MspAutopilot, function: Function, known: &Known) -> Option<Message> {
    ask(autopilot, 0, &msp::request(function));
    let mut receiver = Receiver::new();
    let messages: Vec<_> = autopilot.send(u64::MAX, known).into_iter().filter_map(|byte| receiver.push(byte)).collect();
    assert!(messages.len() <= 1 && receiver.rejected == 0);
    messages.first().copied()
}

/// Both firmwares, through the library: what it knows arrives, pitch up in both.
#[test]
fn the_library_understands_both_firmwares() {
    assert_eq!(crc_8_dvb_s2(b"123456789"), 0xBC);
    for (firmware, told) in [(Firmware::ArduPilot, Told::ArduPilot), (Firmware::Inav, Told::Inav)] {
        let mut autopilot = MspAutopilot::new(firmware, NONE, 1);
        assert_eq!(answered(&mut autopilot, Function::FcVariant, &KNOWN), Some(Message::FcVariant(told)));
        for is_armed in [true, false] {
            let known = Known { is_armed, ..KNOWN };
            assert_eq!(answered(&mut autopilot, Function::Status, &known), Some(Message::Armed(is_armed)));
        }
        let Some(Message::Attitude(angles)) = answered(&mut autopilot, Function::Attitude, &KNOWN) else { panic!() };
        let attitude = told.attitude(angles).unwrap();
        // Tenths of a degree.
        assert!((attitude.roll_rad - 0.2).abs() < 0.0018, "{firmware:?} {attitude:?}");
        assert!((attitude.pitch_rad - 0.1).abs() < 0.0018, "{firmware:?} {attitude:?}");
        let Some(Message::RawGps(Some(place))) = answered(&mut autopilot, Function::RawGps, &KNOWN) else { panic!() };
        assert!((place.latitude_deg + 33.9).abs() < 1e-5 && (place.longitude_deg - 151.2).abs() < 2e-5);
        assert!((place.height_m - 20.0).abs() < 1e-6);
        let Some(Message::Current(amperes)) = answered(&mut autopilot, Function::Analog, &KNOWN) else { panic!() };
        assert!((amperes - 12.34).abs() < 1e-5);
        for unix_s in [1_795_348_800, 1_709_164_800, 1_735_689_599, 4_107_542_400_u64] {
            let known = Known { unix_s: Some(unix_s), ..KNOWN };
            let Some(Message::Rtc(Some(day))) = answered(&mut autopilot, Function::Rtc, &known) else { panic!() };
            assert_eq!(u64::from(day.since_1970()), unix_s / 86_400);
        }
        let lost = Known { place: None, unix_s: None, ..KNOWN };
        assert_eq!(answered(&mut autopilot, Function::RawGps, &lost), Some(Message::RawGps(None)));
        assert_eq!(answered(&mut autopilot, Function::Rtc, &lost), Some(Message::Rtc(None)));
    }
}

/// What it does not know: ArduPilot acknowledges with nothing, INAV refuses.
#[test]
fn what_is_not_known_is_answered_too() {
    // MSP_MOTOR.
    let request = [b'$', b'X', b'<', 0, 104, 0, 0, 0, crc_8_dvb_s2(&[0, 104, 0, 0, 0])];
    for (firmware, direction) in [(Firmware::ArduPilot, b'>'), (Firmware::Inav, b'!')] {
        let mut autopilot = MspAutopilot::new(firmware, NONE, 1);
        ask(&mut autopilot, 0, &request);
        let answer = autopilot.send(u64::MAX, &KNOWN);
        assert_eq!((answer.len(), answer[2], answer[4]), (9, direction, 104));
    }
}

/// A reading of the compass is taken and not answered; a broken one is counted.
#[test]
fn readings_are_taken() {
    let mut autopilot = MspAutopilot::new(Firmware::Inav, NONE, 1);
    let mut reading = msp::compass(0, 123_456, Field::from_ut(20.0, -5.1, 44.2));
    ask(&mut autopilot, 7, b"$X noise");
    ask(&mut autopilot, 7, &reading);
    let expected = CompassReading { at_us: 7, instance: 0, time_ms: 123_456, field_mg: [200, -51, 442] };
    assert_eq!(autopilot.compass_readings(), [expected]);
    assert_eq!((autopilot.next_us(), autopilot.broken_frames()), (None, 0));
    reading[15] ^= 1;
    ask(&mut autopilot, 8, &reading);
    assert_eq!((autopilot.compass_readings().len(), autopilot.broken_frames()), (0, 1));
}

/// 3.5 to 18 ms later, both ends seen in a thousand, in the order of the requests, and the same from the same seed.
#[test]
fn answers_take_their_time() {
    let delays = |seed| -> Vec<u64> {
        let mut autopilot = MspAutopilot::new(Firmware::ArduPilot, NONE, seed);
        (0..1_000_u64)
            .map(|i| {
                let at_us = i * 20_000;
                ask(&mut autopilot, at_us, &msp::request(Function::Attitude));
                let due_us = autopilot.next_us().unwrap();
                assert!(autopilot.send(due_us - 1, &KNOWN).is_empty());
                assert!(!autopilot.send(due_us, &KNOWN).is_empty());
                due_us - at_us
            })
            .collect()
    };
    let delays_us = delays(3);
    let (least, most) = (*delays_us.iter().min().unwrap(), *delays_us.iter().max().unwrap());
    assert!((3_500..3_600).contains(&least) && (17_900..18_000).contains(&most), "{least} {most}");
    assert_eq!(delays(3), delays_us);
    assert_ne!(delays(4), delays_us);
    let mut autopilot = MspAutopilot::new(Firmware::ArduPilot, NONE, 3);
    let functions = [Function::Attitude, Function::Status, Function::Attitude, Function::Rtc, Function::FcVariant];
    for (us, function) in (0..).zip(functions) {
        ask(&mut autopilot, us, &msp::request(function));
    }
    let answers = autopilot.send(u64::MAX, &KNOWN);
    let mut rest = answers.as_slice();
    let mut answers = Vec::new();
    while let [_, _, _, _, function, _, length, ..] = rest {
        answers.push(*function);
        rest = &rest[9 + usize::from(*length)..];
    }
    assert_eq!(answers, functions.map(|function| function as u8));
}

/// How often each of the messages and of the bytes of a thousand answers comes.
fn with(troubles: Troubles) -> (Vec<Message>, usize, u32) {
    let mut autopilot = MspAutopilot::new(Firmware::ArduPilot, troubles, 5);
    let mut bytes = Vec::new();
    for i in 0..1_000_u64 {
        ask(&mut autopilot, i * 20_000, &msp::request(Function::Attitude));
        bytes.extend(autopilot.send((i + 1) * 20_000, &KNOWN));
    }
    let number = bytes.len();
    let mut receiver = Receiver::new();
    bytes.extend([0; 128]);
    let messages = bytes.into_iter().filter_map(|byte| receiver.push(byte)).collect();
    (messages, number, receiver.rejected)
}

/// A tenth of the answers each, to four sigmas; what is not befallen arrives, whatever is beside it.
#[test]
fn troubles_befall_as_many_as_they_say() {
    let tenth = 62..=138;
    let whole = 15_000;
    let (messages, number, _) = with(Troubles { dropped: 0.1, ..NONE });
    assert!(tenth.contains(&(1_000 - messages.len())) && number == messages.len() * 15);
    let (messages, number, _) = with(Troubles { refused: 0.1, ..NONE });
    let refused = messages.iter().filter(|message| matches!(message, Message::Refused(Function::Attitude))).count();
    assert!(tenth.contains(&refused) && messages.len() == 1_000 && number == whole - refused * 6);
    let (messages, number, _) = with(Troubles { cut: 0.1, ..NONE });
    assert!(tenth.contains(&(1_000 - messages.len())), "{} of 1,000", messages.len());
    assert!((14_000..whole).contains(&number));
    // Joined answers lose nothing but the last, which nothing follows.
    let (messages, _, rejected) = with(Troubles { joined: 0.5, ..NONE });
    assert!(messages.len() >= 990 && rejected == 0, "{}", messages.len());
    assert_eq!(with(NONE).0.len(), 1_000);
}

#[test]
fn a_joined_answer_comes_with_the_next() {
    let mut autopilot = MspAutopilot::new(Firmware::ArduPilot, Troubles { joined: 1.0, ..NONE }, 5);
    ask(&mut autopilot, 0, &msp::request(Function::Attitude));
    assert!(autopilot.send(20_000, &KNOWN).is_empty());
    autopilot.troubles = NONE;
    ask(&mut autopilot, 20_000, &msp::request(Function::Status));
    assert_eq!(autopilot.send(40_000, &KNOWN).len(), 15 + 31);
}

/// What came of a talk between the port and the autopilot.
struct Talk {
    attitudes: usize,
    /// The longest time without an attitude, microseconds, after the first second.
    gap_us: u64,
    places: usize,
    days: usize,
    is_armed: Option<bool>,
    readings: Vec<CompassReading>,
}

/// So many seconds of it, with an estimate every 12.5 ms.
fn talk(firmware: Firmware, troubles: Troubles, seconds: u64) -> Talk {
    let (mut port, mut output) = (Msp::new(), Output::new());
    let mut autopilot = MspAutopilot::new(firmware, troubles, 11);
    let settings = Settings::DEFAULT;
    let mut talk = Talk { attitudes: 0, gap_us: 0, places: 0, days: 0, is_armed: None, readings: Vec::new() };
    let mut heard_us = 1_000_000;
    for us in (0..seconds * 1_000_000).step_by(500) {
        let now = Timestamp::from_us(us);
        for byte in autopilot.send(us, &KNOWN) {
            match port.byte(now, byte) {
                Some(Heard::Attitude(report)) => {
                    talk.attitudes += 1;
                    talk.gap_us = talk.gap_us.max(us.saturating_sub(heard_us));
                    heard_us = heard_us.max(us);
                    assert!((report.attitude.pitch_rad - 0.1).abs() < 0.0018, "{report:?}");
                }
                Some(Heard::Place(_)) => talk.places += 1,
                Some(Heard::Day(_)) => talk.days += 1,
                _ => {}
            }
        }
        if us % 12_500 == 0 {
            let estimate = Estimate { at: now, compass: Some(Field::from_ut(20.0, -5.1, 44.2)), ..Estimate::NOTHING };
            port.poll(
                &Facts { now, estimate: &estimate, settings: &settings, glance: Glance::Waiting, calibration: None },
                &mut output,
            );
            ask(&mut autopilot, us, output.pending());
            output.written(usize::MAX);
        }
    }
    talk.is_armed = port.is_armed(Timestamp::from_us(seconds * 1_000_000));
    talk.readings = autopilot.compass_readings();
    talk
}

/// The port and the autopilot together: 50 readings of the compass a second from the first instant, an attitude nearly as
/// often as it may be asked for, the rest about once a second.
#[test]
fn the_port_and_the_autopilot_talk() {
    for firmware in [Firmware::ArduPilot, Firmware::Inav] {
        let talk = talk(firmware, NONE, 60);
        assert!((2_990..=3_010).contains(&talk.readings.len()), "{}", talk.readings.len());
        assert!(talk.readings[0].at_us == 0 && talk.readings.iter().all(|r| r.field_mg == [200, -51, 442]));
        // Some wait for an estimate more, and some for the answer to another request.
        assert!((2_300..=3_000).contains(&talk.attitudes), "{}", talk.attitudes);
        assert!(talk.gap_us < 60_000, "{} us", talk.gap_us);
        assert!((58..=61).contains(&talk.places) && (58..=61).contains(&talk.days));
        assert_eq!(talk.is_armed, Some(true));
    }
}

/// Two answers of five are lost, refused, cut or late: fewer attitudes, and no silence.
#[test]
fn trouble_does_not_stop_the_talk() {
    let troubles = Troubles { dropped: 0.1, refused: 0.1, cut: 0.1, joined: 0.1 };
    let talk = talk(Firmware::Inav, troubles, 60);
    assert!((2_990..=3_010).contains(&talk.readings.len()));
    assert!((1_000..2_600).contains(&talk.attitudes), "{}", talk.attitudes);
    // Half a dozen in a row at 50 ms each is once in a thousand.
    assert!(talk.gap_us < 500_000, "{} us", talk.gap_us);
    assert!(talk.places > 30 && talk.days > 30 && talk.is_armed == Some(true));
}
