//! Devices at the far end of a port's cable.

use std::cell::RefCell;
use std::rc::Rc;

use autoswing_firmware::wire::nmea;
use embassy_time::{Duration, Instant, Timer};
use testkit::clock;
use testkit::simulation::{ExecutorLevel, Simulation};

use super::attitude_source::{HEARTBEAT_PERIOD_US, STATUS_PERIOD_US, SenderKind, SimulatedAttitudeSource};
use super::earth::XIAN_POSITION;
use super::fault_interfaces::AttitudeFault;
use super::mavlink_autopilot::{self, AutopilotInputs, MavlinkAutopilot, START_UNIX_US};
use super::msp_autopilot::{self, AnswerFaults, AutopilotState, MspAutopilot};
use super::simulated_world::World;
use crate::devices::uart::HostEnd;

/// Selection of the far-end device.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FarEnd {
    /// No simulated device: a test or an external program uses the cable.
    #[default]
    Unconnected,
    /// Autopilot that only sends attitude and heartbeats.
    SendOnly,
    /// Satellite receiver that sends its speed by NMEA, of vehicles that move along their nose; others have none.
    SatelliteReceiver,
    /// Autopilot with bidirectional MAVLink.
    Mavlink(mavlink_autopilot::MavlinkFirmware),
    /// Autopilot that uses the module as its MSP compass, with faults in what it sends.
    Msp(msp_autopilot::MspFirmware, AnswerFaults),
}

/// Handle to the attached device, to inspect what it received.
#[derive(Clone)]
pub enum AttachedDevice {
    /// The far-end device does not record received messages.
    SendOnly,
    /// MAVLink autopilot.
    Mavlink(Rc<RefCell<MavlinkAutopilot>>),
    /// MSP autopilot.
    Msp(Rc<RefCell<MspAutopilot>>),
}

impl FarEnd {
    /// Attaches the device to a cable for the rest of the simulation. The faults modify its attitude messages.
    pub fn attach_device(
        self,
        simulation: &mut Simulation,
        world: &World,
        uart: HostEnd,
        faults: Vec<Box<dyn AttitudeFault>>,
    ) -> AttachedDevice {
        let (world, source) = (world.clone(), world.attitude_source());
        let latency_us = source.latency_us();
        match self {
            Self::Unconnected => AttachedDevice::SendOnly,
            Self::SatelliteReceiver => {
                if world.world_config().aircraft.kind.moves_along_nose() {
                    simulation.spawn(ExecutorLevel::World, "satellite receiver", run_satellite_receiver(world, uart));
                }
                AttachedDevice::SendOnly
            }
            Self::SendOnly => {
                simulation.spawn(ExecutorLevel::World, "attitude source", source.run_source(world, uart, faults));
                AttachedDevice::SendOnly
            }
            Self::Mavlink(firmware) => {
                let device = Rc::new(RefCell::new(MavlinkAutopilot::new(source, firmware, clock::now_us())));
                let task = run_mavlink(Rc::clone(&device), latency_us, world, uart, faults);
                simulation.spawn(ExecutorLevel::World, "autopilot", task);
                AttachedDevice::Mavlink(device)
            }
            Self::Msp(firmware, troubles) => {
                let device = Rc::new(RefCell::new(MspAutopilot::new(firmware, troubles, world.world_config().seed)));
                simulation.spawn(
                    ExecutorLevel::World,
                    "autopilot",
                    run_msp(Rc::clone(&device), world, uart, source, faults),
                );
                AttachedDevice::Msp(device)
            }
        }
    }
}

const POLL_INTERVAL_US: u64 = 1_000;

/// Interval of a satellite receiver's sentences, and the age of its speed, microseconds (u-blox NEO-M8 at 5 Hz).
const SPEED_INTERVAL_US: u64 = 200_000;
const SPEED_AGE_US: u64 = 100_000;

async fn run_satellite_receiver(world: World, uart: HostEnd) {
    loop {
        let truth = world.true_state(clock::now_us().saturating_sub(SPEED_AGE_US));
        let speed_m_s = libm::hypot(truth.north_m_s, truth.east_m_s);
        let body = format!("GPVTG,,T,,M,{:.3},N,{:.3},K,A", speed_m_s / 0.514_444, speed_m_s * 3.6);
        uart.send_bytes(format!("${body}*{:02X}\r\n", nmea::checksum(body.as_bytes())).as_bytes());
        Timer::after(Duration::from_micros(SPEED_INTERVAL_US)).await;
    }
}

async fn run_mavlink(
    device: Rc<RefCell<MavlinkAutopilot>>,
    latency_us: u64,
    world: World,
    uart: HostEnd,
    mut faults: Vec<Box<dyn AttitudeFault>>,
) {
    loop {
        let now_us = clock::now_us();
        {
            let mut device = device.borrow_mut();
            device.receive_bytes(now_us, &uart.receive_bytes());
            if device.due_us() <= now_us {
                let inputs = AutopilotInputs {
                    true_state: world.true_state(now_us.saturating_sub(latency_us + faults.added_latency_us(now_us))),
                    is_armed: world.is_armed(),
                    current_a: world.reported_current_a(now_us),
                };
                let bytes = device.due_messages(now_us, &inputs, |attitude| faults.modify_message(now_us, attitude));
                if world.sends_attitude() && !faults.is_silent(now_us) {
                    uart.send_bytes(&bytes);
                }
            }
        }
        Timer::after(Duration::from_micros(POLL_INTERVAL_US)).await;
    }
}

/// Estimates attitude at the rate and latency of the attitude source.
async fn run_msp(
    device: Rc<RefCell<MspAutopilot>>,
    world: World,
    uart: HostEnd,
    mut source: SimulatedAttitudeSource,
    mut faults: Vec<Box<dyn AttitudeFault>>,
) {
    let latency_us = source.latency_us();
    let period_us = (1e6 / world.world_config().attitude_source.rate_hz) as u64;
    let mut autopilot_state = AutopilotState::default();
    let mut estimated_us = 0;
    loop {
        let now_us = clock::now_us();
        if now_us >= estimated_us {
            estimated_us += period_us;
            let truth = world.true_state(now_us.saturating_sub(latency_us + faults.added_latency_us(now_us)));
            // Attitude faults operate on MAVLink messages.
            let mut attitude = source.attitude_message(&truth, now_us);
            faults.modify_message(now_us, &mut attitude);
            autopilot_state = AutopilotState {
                roll_rad: f64::from(attitude.roll),
                pitch_rad: f64::from(attitude.pitch),
                yaw_rad: f64::from(attitude.yaw),
                body_rates_rad_s: [attitude.rollspeed, attitude.pitchspeed, attitude.yawspeed].map(f64::from),
                is_armed: world.is_armed(),
                position: Some((XIAN_POSITION.latitude_deg, XIAN_POSITION.longitude_deg, XIAN_POSITION.height_m)),
                unix_s: Some((START_UNIX_US + now_us) / 1_000_000),
                current_a: world.reported_current_a(now_us),
            };
        }
        {
            let mut device = device.borrow_mut();
            for timed_byte in uart.receive_timed() {
                device.receive_byte(timed_byte.arrives_at_us, timed_byte.byte);
            }
            let bytes = device.due_reply_bytes(now_us, &autopilot_state);
            if world.sends_attitude() && !faults.is_silent(now_us) {
                uart.send_bytes(&bytes);
            }
        }
        Timer::after(Duration::from_micros(POLL_INTERVAL_US)).await;
    }
}

impl World {
    /// Attitude source of this world; spawn its [`run_source`](SimulatedAttitudeSource::run_source) as a task.
    #[must_use]
    pub fn attitude_source(&self) -> SimulatedAttitudeSource {
        let config = self.world_config();
        SimulatedAttitudeSource::new(config.attitude_source, config.gyro, config.seed)
            .with_vehicle_kind(config.aircraft.kind)
    }
}

impl SimulatedAttitudeSource {
    /// Sends attitude, heartbeats (1 Hz) and, as far as reported, position and date (1 Hz) and current (10 Hz) while
    /// the [world enables sending](World::set_sends_attitude); never returns. Faults modify each attitude message in
    /// order.
    pub async fn run_source(mut self, world: World, uart: HostEnd, mut faults: Vec<Box<dyn AttitudeFault>>) {
        let period_us = 1e6 / self.config.rate_hz;
        let latency_us = self.latency_us();
        let began_us = clock::now_us();
        let mut heartbeat_us = began_us + period_us as u64;
        let mut status_us = began_us;
        for tick in 1_u64.. {
            let now_us = began_us + (tick as f64 * period_us).round() as u64;
            Timer::at(Instant::from_micros(now_us)).await;
            let sends = world.sends_attitude() && !faults.is_silent(now_us);
            if now_us >= heartbeat_us && self.identity.heartbeat_kind.is_some() {
                heartbeat_us += HEARTBEAT_PERIOD_US;
                let heartbeat = self.heartbeat_message(world.is_armed());
                if sends {
                    uart.send_bytes(&heartbeat);
                }
                if world.world_config().reports_position && sends {
                    let truth = world.true_state(now_us);
                    let place = XIAN_POSITION.displaced([truth.north_m, truth.east_m]);
                    uart.send_bytes(&self.position_message(Some(place), now_us));
                    uart.send_bytes(&self.time_message(now_us, now_us));
                }
            }
            if now_us >= status_us && self.identity.heartbeat_kind == Some(SenderKind::Autopilot) {
                status_us += STATUS_PERIOD_US;
                if let Some(amperes) = world.reported_current_a(now_us).filter(|_| sends) {
                    uart.send_bytes(&self.status_message(Some(amperes)));
                }
            }
            let truth = world.true_state(now_us.saturating_sub(latency_us + faults.added_latency_us(now_us)));
            let mut message = self.attitude_message(&truth, now_us);
            faults.modify_message(now_us, &mut message);
            // Noise advances also while sending is disabled, so it depends only on time.
            let frame = self.encode_message(&message);
            if sends {
                uart.send_bytes(&frame);
            }
        }
    }
}
