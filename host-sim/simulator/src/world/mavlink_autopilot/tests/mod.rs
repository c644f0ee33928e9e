//! The autopilot alone and with the module's MAVLink protocol.

mod setup;

use autoswing::frames::RollPitch;
use autoswing::heading::{Heading, NoHeading};
use autoswing::instrument::Estimate;
use autoswing::time::Timestamp;
use autoswing_firmware::port::{Mavlink, ReceivedMessage, Snapshot, TransmitBuffer};
use autoswing_module::compass::{Command, IndicatorState};
use autoswing_module::settings::Settings;

use super::*;
use crate::world::attitude_source::AttitudeSourceConfig;
use crate::world::gyro::GyroConfig;

const ATTITUDE_ID: u32 = 30;
const SYS_STATUS_ID: u32 = 1;
const POSITION_ID: u32 = 33;
const SYSTEM_TIME_ID: u32 = 2;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Request {
    Message { id: u32, rate_hz: u32 },
    Stream { rate_hz: u8 },
}

fn parse_request(frame: &MavlinkFrame) -> Option<Request> {
    const COMMAND_LONG: u32 = 76;
    const REQUEST_DATA_STREAM: u32 = 66;
    match frame.message_id {
        COMMAND_LONG => {
            Some(Request::Message { id: frame.float_at(0) as u32, rate_hz: (1e6 / frame.float_at(4)).round() as u32 })
        }
        REQUEST_DATA_STREAM => Some(Request::Stream { rate_hz: frame.byte_at(0) }),
        _ => None,
    }
}

/// Module and autopilot on a line without delay, with a clock in milliseconds.
struct Bench {
    autopilot: MavlinkAutopilot,
    module: Mavlink,
    now_ms: u64,
    received_messages: Vec<(u64, ReceivedMessage)>,
    module_frames: Vec<(u64, MavlinkFrame)>,
    inputs: AutopilotInputs,
    settings: Settings,
    /// Whether the module keeps the numbers that a setup replaces.
    can_store: bool,
    indicator_state: IndicatorState,
    heading: Result<Heading, NoHeading>,
    /// Texts for people.
    notices: Vec<String>,
}

impl Bench {
    fn new(firmware: MavlinkFirmware) -> Self {
        let source = SimulatedAttitudeSource::new(AttitudeSourceConfig::default(), GyroConfig::ERROR_FREE, 1);
        Self {
            autopilot: MavlinkAutopilot::new(source, firmware, 0),
            module: Mavlink::default(),
            now_ms: 0,
            received_messages: vec![],
            module_frames: vec![],
            inputs: AutopilotInputs::default(),
            settings: Settings::DEFAULT,
            can_store: true,
            indicator_state: IndicatorState::Idle,
            heading: Err(NoHeading::Uncalibrated),
            notices: vec![],
        }
    }

    fn run_for_s(&mut self, seconds: u64) {
        for now_ms in self.now_ms..self.now_ms + 1000 * seconds {
            self.now_ms = now_ms;
            let sent_bytes = self.autopilot.due_messages(1000 * now_ms, &self.inputs, |_| ());
            self.deliver_to_module(&sent_bytes);
            // The sensor samples at nearly 80 Hz.
            if now_ms.is_multiple_of(12) {
                self.poll_module();
            }
        }
        self.now_ms += 1;
    }

    fn deliver_to_module(&mut self, bytes: &[u8]) {
        let now = Timestamp::from_us(1000 * self.now_ms);
        for &byte in bytes {
            self.received_messages.extend(self.module.process_byte(now, byte).map(|message| (self.now_ms, message)));
        }
    }

    fn poll_module(&mut self) {
        let snapshot = Snapshot {
            now: Timestamp::from_us(1000 * self.now_ms),
            estimate: &Estimate { heading: self.heading, attitude: Some(RollPitch::default()), ..Estimate::EMPTY },
            settings: &self.settings,
            indicator_state: self.indicator_state,
            calibration: None,
            can_node: Some(125),
        };
        let mut transmit_buffer = TransmitBuffer::default();
        self.module.poll(&snapshot, &mut transmit_buffer);
        self.notices.extend(self.module.take_message(snapshot.now).map(|notice| notice.to_string()));
        if let Some(Command::KeepReplacedNumber(replaced)) = self.module.take_command()
            && self.can_store
        {
            self.settings.replaced_numbers = self.settings.replaced_numbers.with_number(replaced);
        }
        self.autopilot.receive_bytes(1000 * self.now_ms, transmit_buffer.pending_bytes());
        self.module_frames.extend(self.autopilot.take_received().into_iter().map(|frame| (self.now_ms, frame)));
    }

    fn timed_requests(&self) -> Vec<(u64, Request)> {
        self.module_frames.iter().filter_map(|(at_ms, frame)| Some((*at_ms, parse_request(frame)?))).collect()
    }

    fn request_list(&self) -> Vec<Request> {
        self.timed_requests().into_iter().map(|(_, request)| request).collect()
    }

    fn attitudes_in_the_last_second(&self) -> usize {
        let is_recent_attitude = |(at_ms, message): &&(u64, ReceivedMessage)| {
            *at_ms + 1000 >= self.now_ms && matches!(message, ReceivedMessage::Attitude(_))
        };
        self.received_messages.iter().filter(is_recent_attitude).count()
    }
}

const fn attitude_request(rate_hz: u32) -> Request {
    Request::Message { id: ATTITUDE_ID, rate_hz }
}

const STATUS_POSITION_TIME_REQUESTS: [Request; 3] = [
    Request::Message { id: SYS_STATUS_ID, rate_hz: 10 },
    Request::Message { id: POSITION_ID, rate_hz: 1 },
    Request::Message { id: SYSTEM_TIME_ID, rate_hz: 1 },
];

fn assert_requests_a_second_apart(bench: &Bench) {
    for pair in bench.timed_requests().windows(2) {
        assert!(pair[1].0 - pair[0].0 >= 1000, "{pair:?}");
    }
}

/// ArduPilot denies 50 Hz to an aeroplane, so the module requests 40 Hz. The module listens for one second and waits
/// one second per request.
#[test]
fn ardupilot_accepts_an_attitude_rate_of_40_hz_at_once() {
    let mut bench = Bench::new(MavlinkFirmware::ArduPilot);
    bench.run_for_s(2);
    assert!(bench.timed_requests()[0].0 <= 1_100, "{:?}", bench.timed_requests());
    bench.run_for_s(60);
    let request_list = [&[attitude_request(40)][..], &STATUS_POSITION_TIME_REQUESTS].concat();
    assert_eq!(bench.request_list(), request_list, "and nothing more");
    assert_eq!(bench.autopilot.denied_request_count(), 0);
    assert!(bench.attitudes_in_the_last_second().abs_diff(40) <= 1);
    assert_requests_a_second_apart(&bench);
    assert_eq!((bench.autopilot.invalid_byte_count(), bench.module.rejected_frame_count()), (0, 0));
}

#[test]
fn an_autopilot_with_streams_only_gets_a_stream_request() {
    let mut bench = Bench::new(MavlinkFirmware::StreamsOnly);
    bench.run_for_s(60);
    let mut expected: Vec<Request> = [40, 25, 20].into_iter().flat_map(|rate| [attitude_request(rate); 2]).collect();
    expected.push(Request::Stream { rate_hz: 25 });
    // The firmware does not provide these messages; the module requests each twice.
    expected.extend(STATUS_POSITION_TIME_REQUESTS.into_iter().flat_map(|request| [request; 2]));
    assert_eq!(bench.request_list(), expected);
    assert!(bench.attitudes_in_the_last_second().abs_diff(25) <= 1);
    assert_requests_a_second_apart(&bench);
}

/// After each arming, where the heading is known then or later. An older PX4 is asked once, ArduPilot never.
#[test]
fn px4_s_yaw_is_reset_once_in_a_flight() {
    for (firmware, knows_yaw_estimates, counts) in [
        (MavlinkFirmware::Px4, true, [0, 1, 1, 2]),
        (MavlinkFirmware::Px4, false, [0, 1, 1, 1]),
        (MavlinkFirmware::ArduPilot, false, [0, 0, 0, 0]),
    ] {
        let mut bench = Bench::new(firmware);
        bench.autopilot.knows_yaw_estimates = knows_yaw_estimates;
        bench.settings.sends_vision_yaw = true;
        bench.settings.declination_deg = Some(-10.0);
        bench.inputs.is_armed = true;
        let mut commands = [(false, 10), (true, 10), (true, 20), (true, 10)].into_iter().enumerate();
        let sent = [(); 4].map(|()| {
            let (step, (has_heading, seconds)) = commands.next().unwrap();
            if has_heading {
                bench.heading = Ok(Heading { magnetic_rad: 0.1, sigma_rad: 0.02, systematic_variance_rad2: 0.0 });
            }
            if step == 3 {
                bench.inputs.is_armed = false;
                bench.run_for_s(5);
                bench.inputs.is_armed = true;
            }
            bench.run_for_s(seconds);
            bench.autopilot.yaw_estimates_deg.len()
        });
        assert_eq!(sent, counts, "{firmware:?}");
        for [yaw_deg, sigma_deg] in &bench.autopilot.yaw_estimates_deg {
            assert!((yaw_deg - 355.73).abs() < 0.01 && (sigma_deg - 1.146).abs() < 0.01, "{yaw_deg} {sigma_deg}");
        }
    }
}

/// Frames cut at any byte, with noise between them.
#[test]
fn the_reader_finds_every_frame() {
    let frame = MavlinkFrame { system_id: 1, component_id: 158, message_id: 191, payload: vec![7; 17] };
    let frame_bytes = testkit::frames::mavlink_v2_frame([1, 158], 191, 92, &frame.payload);
    let bytes = [&[0xFD, 2, 3][..], &frame_bytes, b"noise", &frame_bytes].concat();
    for cut in 0..bytes.len() {
        let mut reader = FrameReader::default();
        let mut found_frames = reader.read_frames(&bytes[..cut]);
        found_frames.extend(reader.read_frames(&bytes[cut..]));
        assert_eq!((found_frames, reader.invalid_byte_count()), (vec![frame.clone(), frame.clone()], 8), "{cut}");
    }
}
