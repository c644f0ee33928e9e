//! MAVLink: selection of the autopilot on a shared link.

use mavlink_dialect::{
    ATTITUDE_DATA, GPS_RAW_INT_DATA, GPS2_RAW_DATA, GpsFixType, HEARTBEAT_DATA, HIGHRES_IMU_DATA,
    HighresImuUpdatedFlags, MAVLinkV2MessageRaw, MavAutopilot, MavHeader, MavParamType, MessageData, PARAM_VALUE_DATA,
    RAW_IMU_DATA, SCALED_IMU_DATA, SCALED_IMU2_DATA, SYS_STATUS_DATA,
};

use super::*;

#[test]
fn a_second_autopilot_of_the_same_system_is_reported() {
    let selected = encode_tlog(&two_compass_recording(&ARDUPILOT_PARAMETERS));
    let log_40_s_after_boot = read_bytes(&selected).unwrap();
    assert_eq!(log_40_s_after_boot.autopilot_component_ids, [1]);
    let heartbeat = HEARTBEAT_DATA { autopilot: MavAutopilot::MAV_AUTOPILOT_PX4, ..Default::default() };
    let flight = read_bytes(&[selected, encode_frame_of((1, 2), 70_000_000, &heartbeat)].concat()).unwrap();
    assert_eq!((flight.autopilot_system_ids, flight.autopilot_component_ids), (vec![1], vec![1, 2]));
    assert_eq!(flight.autopilot, log_40_s_after_boot.autopilot);
}

#[test]
fn a_damaged_frame_is_rejected() {
    let mut frames = frames(&encode_tlog(&two_compass_recording(&ARDUPILOT_PARAMETERS)));
    let mut damaged = 0;
    // The message id of an attitude is 30.
    for frame in frames.iter_mut().filter(|frame| frame[15..18] == [30, 0, 0]).step_by(3) {
        // Damages the exponent of the roll angle.
        frame[18 + 7] ^= 0x20;
        damaged += 1;
    }
    let flight = read_bytes(&frames.concat()).unwrap();
    assert!(damaged > 50);
    assert!(flight.attitude.rows().len() <= 300 - damaged, "{} of 300, {damaged}", flight.attitude.rows().len());
}

/// Frames of a log, each with eight bytes of the receiver's clock, ten of the header, and two of the checksum.
fn frames(bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut remaining = bytes;
    let next_frame = || {
        let (frame, next) = remaining.split_at(8 + 10 + usize::from(*remaining.get(9)?) + 2);
        remaining = next;
        Some(frame.to_vec())
    };
    std::iter::from_fn(next_frame).collect()
}

fn with_system_id(bytes: &[u8], system: u8) -> Vec<u8> {
    use mavlink_dialect::Message as _;
    let renumbered = |mut frame: Vec<u8>| {
        frame.truncate(frame.len() - 2);
        frame[13] = system;
        let extra = mavlink_dialect::MavMessage::extra_crc(u32::from_le_bytes([frame[15], frame[16], frame[17], 0]));
        frame.extend(mavlink_dialect::calculate_crc(&frame[9..], extra).to_le_bytes());
        frame
    };
    frames(bytes).into_iter().flat_map(renumbered).collect()
}

/// A message of a system and component.
fn encode_frame_of<M: MessageData>((system_id, component_id): (u32, u8), at_us: u64, message: &M) -> Vec<u8> {
    let mut frame = MAVLinkV2MessageRaw::new();
    frame.serialize_message_data(MavHeader { system_id, component_id, sequence: 0 }, message);
    [&at_us.to_be_bytes(), frame.raw_bytes()].concat()
}

fn encode_logged_frame<M: MessageData>(at_us: u64, message: &M) -> Vec<u8> {
    encode_frame_of((1, 1), at_us, message)
}

/// A heartbeat, and an attitude 40 s after boot.
fn log_40_s_after_boot(autopilot: MavAutopilot) -> Vec<u8> {
    let attitude = ATTITUDE_DATA { time_boot_ms: 40_000, roll: 0.1, ..Default::default() };
    [encode_logged_frame(0, &HEARTBEAT_DATA { autopilot, ..Default::default() }), encode_logged_frame(0, &attitude)]
        .concat()
}

/// Parameters before the first heartbeat belong to their sender.
#[test]
fn parameters_before_the_first_heartbeat_are_read() {
    let parameter = PARAM_VALUE_DATA { param_id: "COMPASS_OFS_X".into(), param_value: 90.0, ..Default::default() };
    let other = encode_frame_of((2, 1), 0, &PARAM_VALUE_DATA { param_value: -300.0, ..parameter.clone() });
    let field = RAW_IMU_DATA { time_usec: 40_000_000, xmag: 200, zmag: 400, ..Default::default() };
    let started = log_40_s_after_boot(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA);
    let bytes = [encode_logged_frame(0, &parameter), other, started, encode_logged_frame(0, &field)].concat();
    assert_eq!(read_bytes(&bytes).unwrap().parameters.last_value("COMPASS_OFS_X"), Some(90.0));
}

/// A vehicle that is disarmed in each heartbeat was never armed: its first report is no change.
#[test]
fn the_first_report_of_an_arming_state_is_no_change() {
    let heartbeat = HEARTBEAT_DATA { autopilot: MavAutopilot::MAV_AUTOPILOT_PX4, ..Default::default() };
    let flight = read_bytes(&[started_px4_log(), encode_logged_frame(0, &heartbeat)].concat()).unwrap();
    assert_eq!([0.0, 39.0, 41.0].map(|t_s| flight.is_armed(t_s)), [Some(false); 3]);
}

/// A message with all update flags; the default has acceleration only.
const IMU_WITH_ALL_UPDATE_FLAGS: HIGHRES_IMU_DATA =
    HIGHRES_IMU_DATA { fields_updated: HighresImuUpdatedFlags::all(), ..HIGHRES_IMU_DATA::DEFAULT };

/// Log of a started PX4: heartbeat, attitude and a HIGHRES_IMU message with a field in gauss.
fn started_px4_log() -> Vec<u8> {
    let field =
        HIGHRES_IMU_DATA { time_usec: 40_000_000, xmag: 0.2, ymag: -0.05, zmag: 0.4, ..IMU_WITH_ALL_UPDATE_FLAGS };
    [log_40_s_after_boot(MavAutopilot::MAV_AUTOPILOT_PX4), encode_logged_frame(0, &field)].concat()
}

#[test]
fn highres_imu_is_in_gauss() {
    let flight = read_bytes(&started_px4_log()).unwrap();
    let [row] = flight.compasses[0].field.rows() else { panic!("{:?}", flight.compasses) };
    assert!(row.row_values.iter().zip([20.0, -5.0, 40.0]).all(|(ut, sent_ut)| (ut - sent_ut).abs() < 1e-4), "{row:?}");
}

/// A current of -1 means no measurement.
#[test]
fn zero_current_is_kept_and_unmeasured_current_dropped() {
    let current = |at_us: u64, current_battery: i16| {
        encode_logged_frame(at_us, &SYS_STATUS_DATA { current_battery, ..Default::default() })
    };
    let bytes = [started_px4_log(), current(100_000, 0), current(200_000, -1), current(300_000, 250)].concat();
    let flight = read_bytes(&bytes).unwrap();
    assert_eq!(flight.battery_current.rows().iter().map(|row| row.row_values[0]).collect::<Vec<_>>(), [0.0, 2.5]);
}

/// The receiver's clock bridges at most two seconds.
#[test]
fn messages_without_time_are_dated_by_the_receivers_clock() {
    let current =
        |at_us: u64| encode_logged_frame(at_us, &SYS_STATUS_DATA { current_battery: 100, ..Default::default() });
    for (at_us, after_s) in [(300_000, 0.3), (1_900_000, 1.9), (60_000_000, 2.0)] {
        let flight = read_bytes(&[started_px4_log(), current(at_us)].concat()).unwrap();
        let (at_s, field_s) = (flight.battery_current.rows()[0].t_s, flight.compasses[0].field.rows()[0].t_s);
        assert!((at_s - field_s - after_s).abs() < 1e-6, "{at_us} us: {at_s}, {field_s}");
    }
}

#[test]
fn unknown_gps_values_are_nan() {
    let fix = |at_us: u64, fix_type: GpsFixType, [vel, cog]: [u16; 2]| {
        encode_logged_frame(at_us, &GPS_RAW_INT_DATA { lat: 480_000_000, fix_type, vel, cog, ..Default::default() })
    };
    let bytes = [
        started_px4_log(),
        fix(100_000, GpsFixType::GPS_FIX_TYPE_2D_FIX, [900, 4500]),
        fix(300_000, GpsFixType::GPS_FIX_TYPE_3D_FIX, [900, 4500]),
        fix(500_000, GpsFixType::GPS_FIX_TYPE_RTK_FIXED, [u16::MAX; 2]),
    ];
    let flight = read_bytes(&bytes.concat()).unwrap();
    let [known, unknown] = flight.gps.rows() else { panic!("{:?}", flight.gps) };
    let [known, unknown] = [known, unknown].map(|row| Gps::from_columns(row.row_values));
    assert_eq!((known.latitude_deg, known.speed_m_s, known.course_deg), (48.0, 9.0, 45.0));
    assert!(unknown.speed_m_s.is_nan() && unknown.course_deg.is_nan(), "{unknown:?}");
}

/// Hundredths of a degree; 0 and 65535 are no heading, 36000 is north.
#[test]
fn the_heading_of_either_receiver_is_read() {
    let fix_type = GpsFixType::GPS_FIX_TYPE_RTK_FIXED;
    let first = |at_us, yaw| encode_logged_frame(at_us, &GPS_RAW_INT_DATA { fix_type, yaw, ..Default::default() });
    let second = |at_us, yaw| encode_logged_frame(at_us, &GPS2_RAW_DATA { fix_type, yaw, ..Default::default() });
    let messages = [
        started_px4_log(),
        first(100_000, 9_000),
        first(300_000, 0),
        first(500_000, u16::MAX),
        first(700_000, 36_000),
        second(1_000_000, 12_000),
        first(1_100_000, 0),
        second(1_200_000, 14_000),
        first(1_300_000, 0),
    ];
    let flight = read_bytes(&messages.concat()).unwrap();
    let yaws: Vec<f32> = flight.gps.rows().iter().map(|row| row.row_values[5].round()).collect();
    assert_eq!(format!("{yaws:?}"), "[90.0, NaN, NaN, 360.0, 130.0, NaN]");
}

/// ArduPilot sends its first compass in RAW_IMU in milligauss; PX4 sends it in SCALED_IMU, and RAW_IMU in undefined
/// units. An absent compass is zero.
#[test]
fn the_first_compass_is_raw_imu_for_ardupilot_and_scaled_imu_for_px4() {
    let (raw, scaled) = (
        RAW_IMU_DATA { time_usec: 40_000_000, xmag: 100, ..Default::default() },
        SCALED_IMU_DATA { time_boot_ms: 40_000, xmag: 300, ..Default::default() },
    );
    let zero_field = [
        encode_logged_frame(0, &RAW_IMU_DATA { time_usec: 41_000_000, ..Default::default() }),
        encode_logged_frame(0, &SCALED_IMU_DATA { time_boot_ms: 41_000, ..Default::default() }),
    ];
    for (autopilot, ut) in [(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, 10.0), (MavAutopilot::MAV_AUTOPILOT_PX4, 30.0)]
    {
        let bytes = [
            log_40_s_after_boot(autopilot),
            encode_logged_frame(0, &raw),
            encode_logged_frame(0, &scaled),
            px4_integer_parameter("CAL_MAG0_ID", 396_809),
            zero_field.concat(),
        ]
        .concat();
        let flight = read_bytes(&bytes).unwrap();
        let [row] = flight.compasses[0].field.rows() else { panic!("{:?}", flight.compasses) };
        assert!((row.row_values[0] - ut).abs() < 1e-4, "{row:?}");
        assert_eq!(flight.skipped_counts.rejected_readings, 0);
    }
}

fn px4_integer_parameter(name: &str, value: i32) -> Vec<u8> {
    let (param_value, param_type) = (f32::from_bits(value.cast_unsigned()), MavParamType::MAV_PARAM_TYPE_INT32);
    encode_logged_frame(0, &PARAM_VALUE_DATA { param_id: name.into(), param_value, param_type, ..Default::default() })
}

/// `SCALED_IMU` and `SCALED_IMU2` are the sensors' own fields, in any order; `HIGHRES_IMU` is corrected.
#[test]
fn px4s_sensor_fields_are_used_only_if_their_parameters_are_known() {
    let scaled = encode_logged_frame(0, &SCALED_IMU_DATA { time_boot_ms: 40_000, xmag: 300, ..Default::default() });
    let second = encode_logged_frame(0, &SCALED_IMU2_DATA { time_boot_ms: 40_000, ymag: 200, ..Default::default() });
    let ids = [("CAL_MAG0_ID", 396_809), ("CAL_MAG1_ID", 592_905), ("CAL_MAG1_ROT", 4)]
        .map(|(name, value)| px4_integer_parameter(name, value));
    let autopilot = log_40_s_after_boot(MavAutopilot::MAV_AUTOPILOT_PX4);
    let both = read_bytes(&[started_px4_log(), ids.concat(), scaled.clone(), second.clone()].concat()).unwrap();
    let [primary] = &both.compasses[..] else { panic!("{:?}", both.compasses) };
    assert_eq!(primary.slot, Err(UnknownSlot::PrimaryLessBias));
    assert_eq!((primary.correction, both.skipped_counts.unassigned_fields), (None, 2));
    let [row] = primary.field.rows() else { panic!("{primary:?}") };
    assert_eq!(raw_ut(row), logged_ut(row));
    let unassigned = read_bytes(&[autopilot.clone(), ids.concat(), scaled].concat());
    assert!(matches!(unassigned, Err(LogError::UnassignedFields(LogFormat::TLog))), "{unassigned:?}");
    // The only calibration, of a sensor turned by 180 deg.
    let one = read_bytes(&[started_px4_log(), ids[1..].concat(), second].concat()).unwrap();
    let [compass] = &one.compasses[..] else { panic!("{:?}", one.compasses) };
    assert_eq!(compass.slot, Ok(1));
    assert!((raw_ut(&compass.field.rows()[0]).y + 20.0).abs() < 1e-4, "{compass:?}");
}

/// Some senders use Unix time in some messages.
#[test]
fn unix_times_are_not_used_as_time_since_boot() {
    let field = HIGHRES_IMU_DATA { time_usec: 1_767_484_800_000_000, xmag: 0.2, ..IMU_WITH_ALL_UPDATE_FLAGS };
    let bytes = [log_40_s_after_boot(MavAutopilot::MAV_AUTOPILOT_PX4), encode_logged_frame(500_000, &field)].concat();
    let flight = read_bytes(&bytes).unwrap();
    let (row, attitude) = (flight.compasses[0].field.rows()[0], flight.attitude.rows()[0]);
    assert!((row.t_s - attitude.t_s - 0.5).abs() < 1e-6, "{row:?} {attitude:?}");
    assert_eq!((flight.skipped_counts.restarts, flight.skipped_counts.bad_times), (0, 0));
}

/// Two vehicles on one link, preceded by a ground station that reports a generic autopilot.
#[test]
fn the_requested_vehicle_is_read() {
    let mut other_recording = two_compass_recording(&[]);
    other_recording.samples.iter_mut().for_each(|sample| sample.field_ut[0] = [1.0, 2.0, 3.0]);
    let [one, two] =
        [encode_tlog(&two_compass_recording(&ARDUPILOT_PARAMETERS)), with_system_id(&encode_tlog(&other_recording), 2)]
            .map(|bytes| frames(&bytes));
    let mut station = one[0].clone();
    // Ground station (6) with a generic autopilot (0); payload after 8 clock and 10 header bytes.
    (station[8 + 10 + 4], station[8 + 10 + 5]) = (6, 0);
    let mut link = with_system_id(&station, 255);
    // The logs differ in length by their parameters.
    for i in 0..one.len().max(two.len()) {
        link.extend([one.get(i), two.get(i)].into_iter().flatten().flatten());
    }
    let read_system = |mut bytes: &[u8], system| {
        only_flight(&mut |visit| visit_flights(&mut bytes, FieldUnit::Milligauss, system, visit))
    };
    for (requested, systems, x_ut) in [(None, [1, 2], None), (Some(1), [1, 2], None), (Some(2), [2, 1], Some(1.0))] {
        let flight = read_system(&link, requested).unwrap();
        assert_eq!(flight.autopilot_system_ids, systems, "{requested:?}");
        assert!(flight.skipped_counts.other_system_messages > 600, "{requested:?}: {:?}", flight.skipped_counts);
        let rows = flight.compasses[0].field.rows();
        assert!(rows.len() >= 299, "{requested:?}: {}", rows.len());
        let is_the_other = rows.iter().all(|row| (row.row_values[0] - 1.0).abs() < 0.01);
        assert_eq!(is_the_other, x_ut.is_some(), "{requested:?}");
    }
    let missing_system = read_system(&link, Some(7)).unwrap_err();
    assert_eq!(missing_system.to_string(), "there is no vehicle of system 7; there is 1, 2");
    let table = read_system(&encode_csv(&two_compass_recording(&[])), Some(1)).unwrap_err();
    assert_eq!(table.to_string(), "no system 1: no vehicle of the log has this number");
}

/// A gimbal may report itself as an autopilot.
#[test]
fn a_gimbal_is_not_a_second_vehicle() {
    let heartbeat = HEARTBEAT_DATA { autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC, ..Default::default() };
    let flight = read_bytes(&[started_px4_log(), encode_frame_of((1, 154), 0, &heartbeat)].concat()).unwrap();
    assert_eq!((flight.autopilot_system_ids, flight.skipped_counts.other_system_messages), (vec![1], 1));
}
