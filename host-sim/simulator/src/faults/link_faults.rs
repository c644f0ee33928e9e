//! Faults of the link to the autopilot: an autopilot that pauses, other senders and forged messages on the same line.

use std::pin::Pin;

use embassy_time::{Duration, Timer};
use testkit::clock;

use super::attitude::attitude_bias;
use super::fault_switch::FaultSwitch;
use crate::devices::uart::HostEnd;
use crate::world::attitude_source::{SenderIdentity, SenderKind, SimulatedAttitudeSource};
use crate::world::autopilot::Leg;
use crate::world::{World, WorldConfig};

/// Interval of checks of the switches, and of forged messages, milliseconds.
const SWITCH_CHECK_INTERVAL_MS: u64 = 100;

/// Fault of the link.
#[derive(Clone, Debug)]
pub enum LinkFault {
    /// The vehicle's autopilot sends nothing while the fault is on.
    Pause(FaultSwitch),
    /// Another vehicle flies circles; its autopilot sends heartbeats and attitude with this system ID from the
    /// beginning.
    OtherVehicle(u8),
    /// Another sender reports the vehicle's attitude, with an error of the roll, degrees, from the beginning.
    SecondSender(SenderIdentity, f64),
    /// Forged messages that name the autopilot as their sender, ten a second while the switch is on.
    Forged(FaultSwitch, ForgedMessage),
}

/// Forged message that names the autopilot as its sender.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ForgedMessage {
    /// SYS_STATUS with this current, amperes.
    Current(f64),
    /// HEARTBEAT of a component that is no autopilot.
    NoAutopilot,
    /// HEARTBEAT of a disarmed autopilot.
    Disarmed,
}

impl LinkFault {
    /// Task that never returns, on the line of the autopilot of `world`.
    #[must_use]
    pub fn run_fault(self, world: World, uart: HostEnd) -> Pin<Box<dyn Future<Output = ()>>> {
        match self {
            Self::Pause(switch) => Box::pin(pause_link(switch, world)),
            Self::OtherVehicle(system_id) => Box::pin(simulate_other_vehicle(system_id, world, uart)),
            Self::SecondSender(identity, roll_error_deg) => {
                Box::pin(run_second_sender(identity, roll_error_deg, world, uart))
            }
            Self::Forged(switch, message) => {
                Box::pin(send_forged_message(switch, message, world.attitude_source(), uart))
            }
        }
    }
}

async fn pause_link(switch: FaultSwitch, world: World) {
    loop {
        let is_on = switch.is_on(clock::now_us());
        if is_on == world.sends_attitude() {
            world.set_sends_attitude(!is_on);
        }
        Timer::after(Duration::from_millis(SWITCH_CHECK_INTERVAL_MS)).await;
    }
}

/// Simulates another vehicle of the same kind, armed, that flies circles to alternating sides.
async fn simulate_other_vehicle(system_id: u8, own_world: World, uart: HostEnd) {
    /// Number of circles that the vehicle flies: more than ten hours.
    const FLIGHT_CIRCLES: usize = 4000;
    let config = own_world.world_config();
    let world = World::new(WorldConfig { seed: config.seed.wrapping_add(0x0711), ..config });
    world.set_armed(true);
    for circle in 0..FLIGHT_CIRCLES {
        let heading_change_deg = if circle % 2 == 0 { 360.0 } else { -360.0 };
        world.append_leg(Leg::Turn { bank_deg: 20.0, heading_change_deg });
    }
    let identity = SenderIdentity { system_id, component_id: 1, heartbeat_kind: Some(SenderKind::Autopilot) };
    world.attitude_source().with_identity(identity).run_source(world, uart, Vec::new()).await;
}

/// Sends attitude at the autopilot's rate and latency with independent noise.
async fn run_second_sender(identity: SenderIdentity, roll_error_deg: f64, world: World, uart: HostEnd) {
    let config = world.world_config();
    let source = SimulatedAttitudeSource::new(config.attitude_source, config.gyro, config.seed.wrapping_add(0x5EED));
    let bias = attitude_bias(FaultSwitch::always_on(), [roll_error_deg.to_radians(), 0.0, 0.0]);
    source.with_identity(identity).run_source(world, uart, vec![Box::new(bias)]).await;
}

async fn send_forged_message(
    switch: FaultSwitch,
    message: ForgedMessage,
    mut autopilot: SimulatedAttitudeSource,
    uart: HostEnd,
) {
    if message == ForgedMessage::NoAutopilot {
        autopilot = autopilot
            .with_identity(SenderIdentity { heartbeat_kind: Some(SenderKind::Other), ..SenderIdentity::AUTOPILOT });
    }
    loop {
        if switch.is_on(clock::now_us()) {
            uart.send_bytes(&match message {
                ForgedMessage::Current(amperes) => autopilot.status_message(Some(amperes)),
                ForgedMessage::NoAutopilot => autopilot.heartbeat_message(true),
                ForgedMessage::Disarmed => autopilot.heartbeat_message(false),
            });
        }
        Timer::after(Duration::from_millis(SWITCH_CHECK_INTERVAL_MS)).await;
    }
}
