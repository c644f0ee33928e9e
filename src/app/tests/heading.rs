//! The way of a heading: attitude in, the instrument, an outlet.

use std::rc::Rc;

use mavlink::dialects::common::{ATTITUDE_DATA, HEARTBEAT_DATA, MavAutopilot, MavModeFlag};
use mavlink::{MAVLinkV2MessageRaw, MavHeader, MessageData};

use super::Bed;
use super::devices::{Line, Mood, Port, SENSOR};
use crate::app::links::{FoundSensor, Stamped, listen, publish, stamped};
use crate::app::{attitude, instrument, outlet};
use crate::attitude::{Report, Source};
use crate::calibration::{Calibration, Orientation, Uncertainty};
use crate::frames::{Attitude, Field};
use crate::heading::{Heading, NoHeading};
use crate::instrument::{Correction, Estimate};
use crate::magnetometer::Reading;
use crate::outlet::NmeaOutlet;
use crate::settings::Settings;
use crate::time::{Timestamp, WrappingMillis};

fn frame(roll: f32) -> Vec<u8> {
    frame_of(1, &ATTITUDE_DATA { time_boot_ms: 77, roll, ..Default::default() })
}

fn frame_of(system_id: u32, data: &impl MessageData) -> Vec<u8> {
    let mut raw = MAVLinkV2MessageRaw::new();
    raw.serialize_message_data(MavHeader { system_id, component_id: 1, sequence: 0 }, data);
    raw.raw_bytes().to_vec()
}

fn with_line() -> (Bed, Line) {
    let (mut bed, line) = (Bed::new(), Line::default());
    let rx = line.clone();
    bed.run("attitude", |links| async move { attitude::run(&links, rx).await });
    (bed, line)
}

#[test]
fn reports_are_passed_on_with_their_arrival_and_counted() {
    let (mut bed, line) = with_line();
    bed.ms(5);
    let mut broken = frame(0.2);
    broken[15] ^= 1;
    line.put(&[frame(0.1), broken, frame(0.3)].concat());
    bed.ms(1);
    let reports: Vec<Stamped<Report>> = std::iter::from_fn(|| bed.links.reports.try_receive().ok()).collect();
    let rolls: Vec<f32> = reports.iter().map(|report| report.value.attitude.roll_rad).collect();
    assert_eq!(rolls, [0.1, 0.3]);
    assert!(reports.iter().all(|report| (5_000..=6_000).contains(&report.at.as_us())), "{reports:?}");
    let counts = bed.links.counts();
    assert_eq!((counts.attitude_reports, counts.attitude_rejected, counts.attitude_line_errors), (2, 1, 0));
}

/// Two aircraft on one line; the second says that it is an autopilot.
#[test]
fn attitude_of_others_is_counted_and_not_passed_on() {
    let (mut bed, line) = with_line();
    line.put(&frame(0.1));
    bed.ms(1);
    let theirs = ATTITUDE_DATA { roll: 0.2, ..Default::default() };
    let heartbeat =
        HEARTBEAT_DATA { autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, ..HEARTBEAT_DATA::default() };
    line.put(&[frame_of(2, &theirs), frame_of(2, &heartbeat), frame(0.3), frame_of(2, &theirs)].concat());
    bed.ms(1);
    let reports: Vec<Stamped<Report>> = std::iter::from_fn(|| bed.links.reports.try_receive().ok()).collect();
    let rolls: Vec<f32> = reports.iter().map(|report| report.value.attitude.roll_rad).collect();
    assert_eq!(rolls, [0.1, 0.2]);
    let counts = bed.links.counts();
    assert_eq!((counts.attitude_reports, counts.attitude_foreign, counts.attitude_rejected), (2, 2, 0));
}

/// Told when it changes, and given up ten seconds after the last heartbeat, on a silent line too.
#[test]
fn whether_the_autopilot_is_armed_is_told() {
    let (mut bed, line) = with_line();
    let links = Rc::clone(&bed.links);
    let mut armed = listen(&links.armed);
    let heartbeat = |base_mode| HEARTBEAT_DATA { base_mode, ..HEARTBEAT_DATA::default() };
    line.put(&[frame_of(1, &heartbeat(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED)), frame(0.1)].concat());
    bed.ms(1);
    assert_eq!(armed.try_changed(), Some(Some(true)));
    bed.ms(9_950);
    assert_eq!(armed.try_changed(), None);
    bed.ms(200);
    assert_eq!(armed.try_changed(), Some(None));
    line.put(&[frame_of(1, &heartbeat(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED)), frame(0.1)].concat());
    bed.ms(1);
    assert_eq!(armed.try_changed(), Some(Some(true)));
    line.put(&frame_of(1, &heartbeat(MavModeFlag::empty())));
    bed.ms(1);
    assert_eq!(armed.try_changed(), Some(Some(false)));
}

/// A line in error, or one that has ended, is left alone for 0.2 ms, so that it does not take all the time there is.
#[test]
fn a_line_in_error_is_counted_and_gets_a_pause() {
    let (mut bed, line) = with_line();
    line.mood.set(Mood::Ends);
    bed.ms(10);
    let ended = bed.links.counts().attitude_line_errors;
    assert!((45..=55).contains(&ended), "{ended}");
    line.mood.set(Mood::Fails);
    bed.ms(10);
    let errors = bed.links.counts().attitude_line_errors;
    assert!((90..=110).contains(&errors), "{errors}");
    assert!(bed.links.heartbeats.snapshot()[1] >= errors - 1, "it lives");
    line.mood.set(Mood::Works);
    line.put(&frame(0.1));
    bed.ms(1);
    assert_eq!(bed.links.counts().attitude_reports, 1);
}

/// Ten signs of life a second on a line that says nothing.
#[test]
fn a_silent_line_is_no_dead_task() {
    let (mut bed, _) = with_line();
    bed.ms(1_050);
    assert_eq!(bed.links.heartbeats.snapshot()[1], 10);
}

fn calibration() -> Calibration {
    Calibration { inclination_rad: 1.0, total_ut: 50.0, ..Calibration::uncalibrated(Orientation::NONE) }
}

fn correction() -> Correction {
    Correction { calibration: Some((calibration(), Uncertainty::NONE)), ..Correction::NONE }
}

fn with_instrument() -> Bed {
    let mut bed = Bed::new();
    bed.run("instrument", |links| async move { instrument::run(&links).await });
    bed
}

/// A reading of now at a heading, level.
fn read(bed: &Bed, heading_rad: f32) {
    let field = Field::new(Attitude::default().body(Field::earth(50.0, 1.0, heading_rad)).ut);
    bed.links.offer(&bed.links.readings, stamped(Reading { field, saturated: false, overrun: false }));
}

fn report(bed: &Bed) {
    let report = Report {
        source: Source::default(),
        sender_time: WrappingMillis::default(),
        attitude: Attitude::default(),
        rates_rad_s: [0.0; 3],
    };
    bed.links.offer(&bed.links.reports, stamped(report));
}

fn estimate(bed: &Bed) -> Estimate {
    bed.links.estimates.try_get().unwrap_or(Estimate::NOTHING)
}

#[test]
fn readings_become_estimates_and_a_correction_counts_from_the_next_one_on() {
    let mut bed = with_instrument();
    bed.ms(20);
    report(&bed);
    read(&bed, 0.5);
    bed.ms(1);
    assert_eq!(estimate(&bed).heading, Err(NoHeading::Uncalibrated));
    assert_eq!(estimate(&bed).at, Timestamp::from_us(20_000));
    publish(&bed.links.correction, correction());
    bed.ms(10);
    assert_eq!(estimate(&bed).heading, Err(NoHeading::Uncalibrated), "of the reading before");
    // The report of the same instant is taken first, though it came later.
    read(&bed, 0.5);
    report(&bed);
    bed.ms(1);
    let heading = estimate(&bed).heading.unwrap();
    assert!((heading.magnetic_rad - 0.5).abs() < 1e-3, "{heading:?}");
}

/// 100 ms after the last reading of the reference sensor, and again every 100 ms, so that outlets keep their pace.
#[test]
fn a_silent_sensor_is_told_to_the_outlets() {
    let mut bed = with_instrument();
    let links = Rc::clone(&bed.links);
    let mut estimates = listen(&links.estimates);
    bed.ms(50);
    read(&bed, 0.5);
    bed.ms(99);
    assert_eq!(estimates.try_changed().unwrap().heading, Err(NoHeading::Uncalibrated));
    assert!(estimates.try_changed().is_none());
    for silence_ms in [150, 250, 350] {
        bed.ms(if silence_ms == 150 { 1 } else { 100 });
        let estimate = estimates.try_changed().unwrap();
        let expected = (Err(NoHeading::SensorSilent), Timestamp::from_us(silence_ms * 1000));
        assert_eq!((estimate.heading, estimate.at), expected);
    }
    assert_eq!(bed.links.heartbeats.snapshot()[2], 4);
}

/// A chip of another rate: silence and samples follow it. At 50 ms a reading, two make a sample.
#[test]
fn the_instrument_follows_the_sensor_that_was_found() {
    let mut bed = with_instrument();
    publish(&bed.links.sensor, FoundSensor { identity: SENSOR, period_us: 50_000, stuck_after: 7 });
    bed.ms(20);
    for _ in 0..4 {
        report(&bed);
        read(&bed, 0.5);
        bed.ms(50);
    }
    report(&bed);
    bed.ms(1);
    assert_eq!(bed.links.samples.len(), 2);
    let links = Rc::clone(&bed.links);
    let mut estimates = listen(&links.estimates);
    let _ = estimates.try_changed();
    bed.ms(300);
    assert!(estimates.try_changed().is_none(), "0.35 s are not yet eight periods");
    bed.ms(50);
    assert_eq!(estimates.try_changed().unwrap().heading, Err(NoHeading::SensorSilent));
}

#[test]
fn readings_without_attitude_are_counted() {
    let mut bed = with_instrument();
    for _ in 0..40 {
        bed.ms(12);
        read(&bed, 0.5);
        bed.ms(1);
    }
    // Those of the last 0.3 s still wait.
    assert_eq!(bed.links.counts().unpaired, 40 - 24);
}

fn with_outlet() -> (Bed, Port) {
    let (mut bed, port) = (Bed::new(), Port::default());
    let tx = port.clone();
    bed.run("outlet", |links| async move { outlet::run(&links, NmeaOutlet, tx).await });
    bed.ms(1);
    (bed, port)
}

/// Estimates every 12.5 ms for so long.
fn stream(bed: &mut Bed, heading: Result<Heading, NoHeading>, ms: u64) {
    let until = bed.simulation.now_us() + ms * 1000;
    while bed.simulation.now_us() < until {
        let at = Timestamp::from_us(bed.simulation.now_us());
        bed.links.estimates.sender().send(Estimate { at, heading, ..Estimate::NOTHING });
        bed.simulation.run_for(12_500);
    }
}

const NORTH: Result<Heading, NoHeading> = Ok(Heading { magnetic_rad: 0.0, sigma_rad: 0.01, systematic_rad2: 0.0 });

#[test]
fn an_outlet_writes_at_its_rate_and_counts() {
    let (mut bed, port) = with_outlet();
    stream(&mut bed, NORTH, 1_000);
    let text = port.text();
    assert_eq!(text.matches("$HCHDM,000.0,M").count(), 10, "{text}");
    assert_eq!(text.matches("\r\n").count(), 30, "{text}");
    let counts = bed.links.counts();
    assert_eq!((counts.messages, counts.messages_empty, counts.write_errors), (10, 0, 0));
    stream(&mut bed, Err(NoHeading::Uncalibrated), 1_000);
    let counts = bed.links.counts();
    assert_eq!((counts.messages, counts.messages_empty), (20, 10));
    assert_eq!(port.text().matches("$PASWH,,,uncalibrated").count(), 10);
    assert_eq!(bed.links.heartbeats.snapshot()[4], 161, "one for each estimate, and for its beginning");
}

#[test]
fn an_outlet_follows_its_settings() {
    let (mut bed, port) = with_outlet();
    publish(&bed.links.settings, Settings { stream_rate_hz: 40, ..Settings::DEFAULT });
    stream(&mut bed, NORTH, 1_000);
    assert_eq!(port.text().matches("$HCHDM").count(), 40);
    publish(&bed.links.settings, Settings { stream_on: false, ..Settings::DEFAULT });
    stream(&mut bed, NORTH, 1_000);
    assert_eq!(port.text(), "");
    publish(&bed.links.settings, Settings { declination_deg: Some(2.0), ..Settings::DEFAULT });
    stream(&mut bed, NORTH, 200);
    assert!(port.text().contains("$HCHDG,000.0,,,2.0,E"));
}

/// A port that refuses, and one that takes nothing for 0.1 s: counted, and the outlet goes on.
#[test]
fn a_broken_port_is_counted_and_does_not_stop_the_outlet() {
    let (mut bed, port) = with_outlet();
    port.mood.set(Mood::Fails);
    stream(&mut bed, NORTH, 1_000);
    assert_eq!((bed.links.counts().messages, bed.links.counts().write_errors), (10, 10));
    port.mood.set(Mood::Hangs);
    stream(&mut bed, NORTH, 1_000);
    let errors = bed.links.counts().write_errors - 10;
    assert!((4..=10).contains(&errors), "{errors}");
    port.mood.set(Mood::Works);
    bed.ms(200);
    let _ = port.text();
    stream(&mut bed, NORTH, 1_000);
    assert_eq!(port.text().matches("$HCHDM").count(), 10);
}
