use mavlink_dialect::{MavMessage, MavlinkVersion, Message};

use super::*;
use crate::devices::uart::{SerialCable, TimedByte};
use crate::world::aircraft::VehicleKind;
use crate::world::{World, WorldConfig};
use log_analysis::numbers::square;
use testkit::clock;
use testkit::simulation::{ExecutorLevel, Simulation};

const ERROR_FREE: AttitudeSourceConfig = AttitudeSourceConfig {
    rate_hz: 50.0,
    noise_deg: 0.0,
    noise_time_s: 0.5,
    bias_deg: 0.0,
    latency_ms: 20.0,
    turn_error: 0.0,
    push_error_deg: 0.0,
    yaw: ReportedYaw::Drifting,
    yaw_offset_deg: 37.0,
    yaw_drift_deg_s: 0.1,
};

/// Bytes received at the module's end of the cable during a turn.
fn simulate_source(config: AttitudeSourceConfig, seed: u64, seconds: u64) -> (World, Vec<TimedByte>) {
    let mut simulation = Simulation::new();
    let world = World::new(WorldConfig { seed, attitude_source: config, ..WorldConfig::of_table1(seed) });
    world.hold_bank_and_pitch(25.0, 0.0);
    let cable =
        SerialCable::new(crate::devices::uart::UartConfig { receive_buffer_bytes: 1 << 20, ..Default::default() });
    let (mut receiver, _transmitter) = cable.module_ends();
    let bytes = std::rc::Rc::new(std::cell::RefCell::new(Vec::new()));
    let log = std::rc::Rc::clone(&bytes);
    simulation.spawn(ExecutorLevel::Thread, "module", async move {
        use embedded_io_async::Read;
        let mut buffer = [0; 1024];
        loop {
            let count = receiver.read(&mut buffer).await.unwrap();
            let at_us = clock::now_us();
            log.borrow_mut().extend(buffer[..count].iter().map(|&byte| TimedByte { arrives_at_us: at_us, byte }));
        }
    });
    let source = SimulatedAttitudeSource::new(config, GyroConfig::ERROR_FREE, seed);
    simulation.spawn(
        ExecutorLevel::World,
        "attitude source",
        source.run_source(world.clone(), cable.host_end(), vec![]),
    );
    simulation.run_until(seconds * 1_000_000 + 10_000);
    (world, bytes.take())
}

fn decode_messages(stream: &[TimedByte]) -> Vec<(u64, u8, MavMessage)> {
    let mut remaining = stream;
    let mut messages = Vec::new();
    while let [first, length, ..] = remaining {
        assert_eq!(first.byte, 0xFD, "MAVLink 2 begins with FD");
        let frame_length = usize::from(length.byte) + 12;
        let frame: Vec<u8> = remaining[..frame_length].iter().map(|timed_byte| timed_byte.byte).collect();
        let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
        let crc = mavlink_dialect::calculate_crc(&frame[1..frame_length - 2], MavMessage::extra_crc(id));
        assert_eq!(frame[frame_length - 2..], crc.to_le_bytes());
        let message = MavMessage::parse(MavlinkVersion::V2, id, &frame[10..frame_length - 2]).unwrap();
        messages.push((remaining[frame_length - 1].arrives_at_us, frame[4], message));
        remaining = &remaining[frame_length..];
    }
    messages
}

fn decode_attitudes(stream: &[TimedByte]) -> Vec<(u64, ATTITUDE_DATA)> {
    let attitude = |(at_us, _, message)| match message {
        MavMessage::ATTITUDE(data) => Some((at_us, data)),
        _ => None,
    };
    decode_messages(stream).into_iter().filter_map(attitude).collect()
}

#[test]
fn attitude_comes_at_50_hz_and_a_heartbeat_each_second() {
    let (_, stream) = simulate_source(AttitudeSourceConfig::default(), 1, 10);
    let messages = decode_messages(&stream);
    let heartbeats = messages.iter().filter(|(_, _, message)| matches!(message, MavMessage::HEARTBEAT(_))).count();
    assert_eq!((heartbeats, messages.len() - heartbeats), (10, 500));
    for (index, (_, sequence, _)) in messages.iter().enumerate() {
        assert_eq!(usize::from(*sequence), index % 256, "sequence numbers count all messages");
    }
}

#[test]
fn an_exact_source_reports_the_truth_after_its_latency() {
    let (world, stream) = simulate_source(ERROR_FREE, 1, 2);
    // The world stores only the last two seconds.
    for (at_us, data) in decode_attitudes(&stream).into_iter().skip(10) {
        let sent_us = u64::from(data.time_boot_ms) * 1000;
        let truth = world.true_state(sent_us - 20_000);
        assert!((f64::from(data.roll) - truth.roll_rad).abs() < 1e-6);
        assert!((f64::from(data.pitch) - truth.pitch_rad).abs() < 1e-6);
        let yaw_rate = truth.body_rates_rad_s()[2];
        assert!((f64::from(data.yawspeed) - yaw_rate).abs() < 1e-6 * (1.0 + yaw_rate.abs()));
        // 40 bytes of attitude, possibly after 21 bytes of heartbeat, plus one byte time of idle line: 87 us per byte.
        let transfer_us = at_us - sent_us;
        assert!((41 * 86..63 * 87).contains(&transfer_us), "{transfer_us} us");
    }
}

/// 600 s are 1200 correlation times of the noise: sigma is accurate to 2 %, the mean to 0.3 deg / sqrt(600) = 0.012
/// deg.
#[test]
fn attitude_errors_have_the_configured_statistics() {
    let config = AttitudeSourceConfig { latency_ms: 0.0, ..AttitudeSourceConfig::default() };
    let mut source = SimulatedAttitudeSource::new(config, GyroConfig::ERROR_FREE, 4);
    let bank_rad = 25_f64.to_radians();
    let truth = TrueState { roll_rad: bank_rad, ..TrueState::default() };
    let reports: Vec<ReportedAttitude> = (0..30_000).map(|_| source.next_report(&truth)).collect();
    let statistics_deg = |error: fn(&ReportedAttitude, f64) -> f64| {
        let errors: Vec<f64> = reports.iter().map(|report| error(report, bank_rad).to_degrees()).collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let variance = errors.iter().map(|error_deg| square(error_deg - mean)).sum::<f64>() / errors.len() as f64;
        (mean, variance.sqrt())
    };
    let (roll_mean, roll_sigma) = statistics_deg(|report, bank| report.roll_rad - bank);
    let (pitch_mean, pitch_sigma) = statistics_deg(|report, _| report.pitch_rad);
    assert!((roll_sigma - 0.3).abs() < 0.03 && (pitch_sigma - 0.3).abs() < 0.03, "{roll_sigma} {pitch_sigma}");
    // The mean contains the bank-angle scale error, 1 % of 25 degrees, and the bias.
    let bias_deg = libm::hypot(roll_mean + 0.25, pitch_mean);
    assert!((bias_deg - 0.2).abs() < 0.06, "{bias_deg}");
}

/// 2.6 m/s^2 (15 deg of copter tilt) cause 1.04 deg, 1 sigma, with a correlation time of 2 s. 4000 s are 1000 correlation
/// times: sigma is accurate to 3 %, the correlation to 0.03.
#[test]
fn disturbing_acceleration_causes_a_slow_tilt_error() {
    let config = AttitudeSourceConfig {
        noise_deg: 0.0,
        bias_deg: 0.0,
        ..WorldConfig::of_table1(4).with_vehicle_kind(VehicleKind::Copter).attitude_source
    };
    let mut source = SimulatedAttitudeSource::new(config, GyroConfig::ERROR_FREE, 4);
    let mut tilt_errors_deg = |push_m_s2: f64| -> [Vec<f64>; 2] {
        let truth = TrueState { disturbing_acceleration_m_s2: push_m_s2, ..TrueState::default() };
        let reports: Vec<ReportedAttitude> = (0..200_000).map(|_| source.next_report(&truth)).collect();
        [|report: &ReportedAttitude| report.roll_rad, |report: &ReportedAttitude| report.pitch_rad]
            .map(|angle_rad| reports.iter().map(|report| angle_rad(report).to_degrees()).collect())
    };
    let covariance = |errors: &[f64], lag: usize| {
        errors.iter().zip(&errors[lag..]).map(|(a, b)| a * b).sum::<f64>() / (errors.len() - lag) as f64
    };
    for errors_deg in tilt_errors_deg(2.6) {
        let sigma_deg = covariance(&errors_deg, 0).sqrt();
        assert!((sigma_deg - 1.04).abs() < 0.12, "{sigma_deg}");
        // Reports are 20 ms apart.
        let correlation = covariance(&errors_deg, 100) / covariance(&errors_deg, 0);
        assert!((correlation - 0.37).abs() < 0.07, "{correlation}");
    }
    assert!(tilt_errors_deg(0.0).iter().flatten().all(|error_deg| error_deg.abs() < 1e-12));
    let plane = WorldConfig::of_table1(4).with_vehicle_kind(VehicleKind::Plane).attitude_source;
    assert_eq!(plane.push_error_deg.to_bits(), 0);
}

#[test]
fn the_heartbeat_contains_vehicle_kind_and_armed_state() {
    for (vehicle_kind, expected) in [
        (VehicleKind::Plane, MavType::MAV_TYPE_FIXED_WING),
        (VehicleKind::Copter, MavType::MAV_TYPE_QUADROTOR),
        (VehicleKind::Vtol, MavType::MAV_TYPE_VTOL_FIXEDROTOR),
        (VehicleKind::Rover, MavType::MAV_TYPE_GROUND_ROVER),
        (VehicleKind::Boat, MavType::MAV_TYPE_SURFACE_BOAT),
    ] {
        let mut source = World::new(WorldConfig::of_table1(1).with_vehicle_kind(vehicle_kind)).attitude_source();
        for is_armed in [false, true] {
            let frame = source.heartbeat_message(is_armed).into_iter();
            let stream: Vec<TimedByte> = frame.map(|byte| TimedByte { arrives_at_us: 0, byte }).collect();
            let MavMessage::HEARTBEAT(data) = &decode_messages(&stream)[0].2 else { panic!("no heartbeat") };
            assert_eq!((data.mavtype, data.autopilot), (expected, MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA));
            assert_eq!(data.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED), is_armed, "{vehicle_kind:?}");
        }
    }
}

#[test]
fn yaw_is_never_the_heading() {
    let (world, stream) = simulate_source(ERROR_FREE, 1, 2);
    let (_, last) = &decode_attitudes(&stream)[99];
    let truth = world.true_state(1_980_000);
    let error_deg = (f64::from(last.yaw) - truth.heading_rad).to_degrees().rem_euclid(360.0);
    assert!((error_deg - 37.2).abs() < 0.01, "{error_deg}");
    let (_, stream) = simulate_source(AttitudeSourceConfig { yaw: ReportedYaw::Absent, ..ERROR_FREE }, 1, 1);
    assert!(decode_attitudes(&stream).iter().all(|(_, data)| data.yaw.is_nan()));
}
