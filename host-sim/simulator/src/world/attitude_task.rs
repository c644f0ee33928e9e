//! Attitude source of a world, and its task.

use embassy_time::{Instant, Timer};
use testkit::clock;

use super::attitude_source::{HEARTBEAT_PERIOD_US, STATUS_PERIOD_US, SenderKind, SimulatedAttitudeSource};
use super::fault_interfaces::{AttitudeFault, is_silent};
use super::flight_place::XIAN_POSITION;
use super::simulated_world::World;
use crate::devices::uart::HostEnd;

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
            let sends = world.sends_attitude() && !is_silent(&faults, now_us);
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
            let added_latency_us: u64 = faults.iter().map(|fault| fault.added_latency_us(now_us)).sum();
            let truth = world.true_state(now_us.saturating_sub(latency_us + added_latency_us));
            let mut message = self.attitude_message(&truth, now_us);
            for fault in &mut faults {
                fault.modify_message(now_us, &mut message);
            }
            // Noise advances also while sending is disabled, so it depends only on time.
            let frame = self.encode_message(&message);
            if sends {
                uart.send_bytes(&frame);
            }
        }
    }
}
