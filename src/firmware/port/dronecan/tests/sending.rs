//! Field, status and texts; load of the bus.

use super::*;
use autoswing_module::messages::Message;

const FIELD_TYPE: DataType = DataType::MAGNETIC_FIELD_STRENGTH_2;

/// 0.2, -0.05 and 0.45 gauss, as pydronecan encodes them.
#[test]
fn the_field_is_sent_at_its_rate_in_gauss() {
    let mut bench = Bench::new();
    let sent = bench.sent_in_ms(FIELD_TYPE, 10_000);
    assert!(sent.len().abs_diff(500) <= 1, "{}", sent.len());
    assert!(sent.iter().all(|sent| sent.payload == [0x00, 0x66, 0x32, 0x66, 0xAA, 0x33, 0x37]));
    assert!(sent.iter().zip(sent.iter().skip(1)).all(|(one, next)| next.transfer_id == (one.transfer_id + 1) % 32));
    bench.settings.can_rate_hz = 20;
    assert!(bench.sent_in_ms(FIELD_TYPE, 10_000).len().abs_diff(200) <= 1);
}

#[test]
fn no_field_is_sent_while_it_is_not_trusted() {
    let mut bench = Bench::new();
    bench.estimate.compass_field = None;
    assert!(bench.sent_in_ms(FIELD_TYPE, 2000).is_empty());
    bench.estimate.compass_field = Some(Field::from_ut(f32::NAN, 0.0, 0.0));
    assert!(bench.sent_in_ms(FIELD_TYPE, 2000).is_empty());
    bench.estimate.compass_field = Some(BODY_FIELD);
    assert!(!bench.sent_in_ms(FIELD_TYPE, 100).is_empty());
}

/// Sigma of 0.01 rad of a horizontal field of 0.206 gauss: a variance of 4.25e-6, in steps of 6e-8.
#[test]
fn the_covariance_is_that_of_the_heading_s_sigma() {
    let mut bench = Bench::new();
    bench.settings.can_sends_covariance = true;
    let sent = bench.sent_in_ms(FIELD_TYPE, 100);
    let variances: Vec<f32> =
        sent[0].payload[7..].chunks(2).map(|pair| half::f16::from_le_bytes([pair[0], pair[1]]).to_f32()).collect();
    assert_eq!(variances.len(), 3);
    assert!(variances.iter().all(|variance| (variance - 4.25e-6).abs() < 6e-8), "{variances:?}");
    bench.estimate.heading = Err(NoHeading::AttitudeStale);
    assert!(bench.sent_in_ms(FIELD_TYPE, 100).iter().all(|sent| sent.payload.len() == 7), "unknown without a heading");
}

/// Most bits of a frame with an extended identifier: 67, interframe space included, and the data, with a stuff bit
/// after every four of the data and 54 others (ISO 11898-1).
fn max_frame_bits(frame: &CanFrame) -> usize {
    let data = 8 * frame.data().len();
    67 + data + (54 + data - 1) / 4
}

/// Limit: 3 % of 1 Mbit/s at the highest rate, with a text every second; measured: 1.5 %.
#[test]
fn the_bus_load_is_between_1_and_2_percent() {
    let mut bench = Bench::new();
    bench.settings.can_rate_hz = 80;
    let mut bits = 0;
    for _ in 0..10 * 80 {
        if bench.now_us.is_multiple_of(1_000_000) {
            bench.node.queue_text(&Message::CollectionLost);
        }
        bench.now_us += READING_PERIOD_US;
        bench.poll();
        bench.send_all_node_frames();
        bits += bench.sent_frames.drain(..).map(|frame| max_frame_bits(&frame)).sum::<usize>();
    }
    let percent = bits as f32 / 10.0 / 1e6 * 100.0;
    assert!((1.0..2.0).contains(&percent), "{percent} %");
}

fn status_fields(sent: &SentTransfer) -> (u8, u8, u16) {
    let [.., flags, low, high] = sent.payload[..] else { panic!("{sent:?}") };
    (flags >> 6, flags >> 3 & 7, u16::from_le_bytes([low, high]))
}

#[test]
fn the_status_is_ok_unless_the_sensor_is_silent() {
    let mut bench = Bench::new();
    let sent = bench.sent_in_ms(DataType::NODE_STATUS, 10_000);
    assert_eq!(sent.len(), 11, "once a second");
    assert_eq!(sent[10].payload[..4], [10, 0, 0, 0]);
    // Vendor code: calibrated, 100 percent.
    assert_eq!(status_fields(&sent[10]), (0, 0, 0x6420));
    bench.estimate = Estimate { heading: Err(NoHeading::SensorSilent), compass_field: None, ..bench.estimate };
    let sent = bench.sent_in_ms(DataType::NODE_STATUS, 15_000);
    assert_eq!(status_fields(&sent[5]), (0, 0, 0x6462), "not yet");
    assert_eq!(status_fields(&sent[14]), (2, 0, 0x6462), "error");
    bench.estimate = Estimate { heading: Ok(NORTH), compass_field: Some(BODY_FIELD), ..bench.estimate };
    assert_eq!(status_fields(&bench.sent_in_ms(DataType::NODE_STATUS, 1000)[0]), (0, 0, 0x6420));
}

/// Of NodeStatus only the health keeps an autopilot from arming. Before the first reading the node is initialising.
#[test]
fn calibration_and_reasons_are_in_the_vendor_s_code() {
    for (indicator, heading, mode, code) in [
        (IndicatorState::Idle, Err(NoHeading::Uncalibrated), 0, 0x0001),
        (IndicatorState::Collecting(40), Err(NoHeading::Uncalibrated), 0, 0x2811),
        (IndicatorState::Refused, Err(NoHeading::Uncalibrated), 0, 0x0031),
        (IndicatorState::Calibrated, Err(NoHeading::FieldChanged), 0, 0x642B),
        (IndicatorState::Calibrated, Err(NoHeading::SensorSilent), 1, 0x6422),
        (IndicatorState::Calibrated, Ok(NORTH), 0, 0x6420),
    ] {
        let mut bench = Bench::new();
        (bench.indicator, bench.estimate.heading) = (indicator, heading);
        assert_eq!(status_fields(&bench.sent_in_ms(DataType::NODE_STATUS, 100)[0]), (0, mode, code), "{heading:?}");
    }
}

fn log_texts(sent: &[SentTransfer]) -> Vec<String> {
    let logs = sent.iter().filter(|sent| has_data_type(sent, DataType::LOG_MESSAGE));
    logs.map(|sent| {
        let source = usize::from(sent.payload[0] & 0x1F);
        let text = String::from_utf8(sent.payload[1 + source..].to_vec()).unwrap();
        format!("{} {text}", sent.payload[0] >> 5)
    })
    .collect()
}

/// Level 1 is information, 2 a warning; a longer text has further messages.
#[test]
fn messages_and_state_changes_are_sent_as_texts() {
    let mut bench = Bench::new();
    assert_eq!(log_texts(&bench.run_ms(3000)), ["1 calibrated"]);
    bench.node.queue_text(&Message::InstallationRestored);
    bench.node.queue_text(&Message::CollectionLost);
    let sent = log_texts(&bench.run_ms(1000));
    assert_eq!(sent[0], format!("1 {}", Message::InstallationRestored));
    let long: String = sent[1..].iter().map(|text| text.trim_start_matches("2 ")).collect();
    assert_eq!((sent.len() > 2, long), (true, Message::CollectionLost.to_string()));
    bench.estimate = Estimate { heading: Err(NoHeading::SensorStuck), compass_field: None, ..bench.estimate };
    assert_eq!(log_texts(&bench.run_ms(10_000)), ["2 calibrated; no field: sensor-stuck"]);
    bench.estimate.attitude = None;
    assert_eq!(log_texts(&bench.run_ms(3000)), [] as [&str; 0], "on the ground nobody needs it");
    bench.deliver_transfer(PEER_NODE, &transfer_from_peer(DataType::ARMING_STATUS, 0, &[255]));
    let sent: String = log_texts(&bench.run_ms(3000)).iter().map(|text| text.trim_start_matches("2 ")).collect();
    assert!(sent.starts_with("armed, and no attitude arrives: "), "{sent}");
    bench.estimate.attitude = Some(RollPitch::default());
    assert_eq!(log_texts(&bench.run_ms(3000)), ["2 calibrated; no field: sensor-stuck"]);
    // A state of less than two seconds is not reported.
    bench.indicator = IndicatorState::Collecting(1);
    assert_eq!(log_texts(&bench.run_ms(1900)), [] as [&str; 0]);
    bench.indicator = IndicatorState::Calibrated;
    assert_eq!(log_texts(&bench.run_ms(3000)), [] as [&str; 0]);
}

/// A frame that waited longer than a second is out of date; a new field replaces a waiting one.
#[test]
fn frames_that_the_bus_does_not_accept_are_dropped() {
    let mut bench = Bench::new();
    bench.run_ms(100);
    for _ in 0..400 {
        bench.now_us += READING_PERIOD_US;
        bench.poll();
    }
    bench.send_all_node_frames();
    let sent = reassemble(&std::mem::take(&mut bench.sent_frames));
    assert!(sent.iter().filter(|sent| has_data_type(sent, FIELD_TYPE)).count() <= 1, "{sent:?}");
    assert!(sent.len() <= 4, "{sent:?}");
    assert!(bench.sent_in_ms(FIELD_TYPE, 1000).len() >= 49);
}

/// Polls between the frames of a field.
#[test]
fn a_field_in_transmission_is_not_replaced() {
    let mut bench = Bench::new();
    bench.settings.can_sends_covariance = true;
    for _ in 0..10 {
        bench.now_us += 20_000;
        bench.poll();
        assert!(bench.send_node_frame());
        bench.now_us += 20_000;
        bench.poll();
        bench.send_all_node_frames();
    }
    let sent = reassemble(&bench.sent_frames);
    assert_eq!(sent.iter().filter(|sent| has_data_type(sent, FIELD_TYPE)).count(), 10);
}

/// Transfers of nine frames: the queue has room for 48.
#[test]
fn a_transfer_without_room_is_not_queued_and_not_numbered() {
    fn send(outbox: &mut FrameOutbox) -> bool {
        let payload = Payload::from_slice(&[7; 60]).unwrap();
        outbox.queue_message(Timestamp::START, Some(node_id(OWN_NODE)), DataType::TARGETTED, 20, payload)
    }
    let mut outbox = FrameOutbox::default();
    let mut frames = Vec::new();
    for _ in 0..2 {
        let is_queued = [(); 7].map(|()| send(&mut outbox));
        assert_eq!(is_queued, [true, true, true, true, true, false, false]);
        while let Some(frame) = outbox.first_frame().cloned() {
            outbox.pop_frame(Timestamp::START);
            frames.push(frame);
        }
    }
    let sent = reassemble(&frames);
    assert!(sent.iter().map(|sent| usize::from(sent.transfer_id)).eq(0..10), "{sent:?}");
    assert!(sent.iter().all(|sent| sent.payload.len() == 60), "{sent:?}");
}
