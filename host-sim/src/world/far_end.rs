//! Who is at the far end of a port's cable.

use std::cell::RefCell;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use mavlink::dialects::common::ATTITUDE_DATA;

use super::World;
use super::attitude_source::{AttitudeSource, Reported};
use super::mavlink_autopilot::{self, BEGAN_UNIX_US, MavlinkAutopilot, Seen, XIAN};
use super::msp_autopilot::{self, Known, MspAutopilot, Troubles};
use crate::clock;
use crate::devices::uart::HostEnd;
use crate::faults::attitude::AttitudeFault;
use crate::simulation::{Level, Simulation};

/// Who is to be there.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FarEnd {
    /// Nobody; or a test, or somebody outside.
    #[default]
    Nobody,
    /// An autopilot that sends attitude and heartbeats and hears nothing.
    Talker,
    /// One that speaks MAVLink both ways.
    Mavlink(mavlink_autopilot::Firmware),
    /// One that has the module for a compass, by MSP.
    Msp(msp_autopilot::Firmware, Troubles),
}

/// Who is there: what it has heard can be asked of it.
#[derive(Clone)]
pub enum Somebody {
    /// Nobody, or somebody who hears nothing.
    Deaf,
    /// An autopilot with MAVLink.
    Mavlink(Rc<RefCell<MavlinkAutopilot>>),
    /// An autopilot with MSP.
    Msp(Rc<RefCell<MspAutopilot>>),
}

impl FarEnd {
    /// Puts it at a cable, for as long as the simulation lasts. What it sends of the attitude goes through the faults.
    pub fn attach(
        self,
        simulation: &mut Simulation,
        world: &World,
        uart: HostEnd,
        faults: Vec<Box<dyn AttitudeFault>>,
    ) -> Somebody {
        let (world, source) = (world.clone(), world.attitude_source());
        let latency_us = source.latency_us();
        match self {
            Self::Nobody => Somebody::Deaf,
            Self::Talker => {
                simulation.spawn(Level::World, "attitude source", source.run(world, uart, faults));
                Somebody::Deaf
            }
            Self::Mavlink(firmware) => {
                let device = Rc::new(RefCell::new(MavlinkAutopilot::new(source, firmware, clock::now_us())));
                let task = mavlink(Rc::clone(&device), latency_us, world, uart, faults);
                simulation.spawn(Level::World, "autopilot", task);
                Somebody::Mavlink(device)
            }
            Self::Msp(firmware, troubles) => {
                let device = Rc::new(RefCell::new(MspAutopilot::new(firmware, troubles, world.config().seed)));
                simulation.spawn(Level::World, "autopilot", msp(Rc::clone(&device), world, uart, source, faults));
                Somebody::Msp(device)
            }
        }
    }
}

/// Cables are looked at so often, microseconds.
const LOOK_US: u64 = 1_000;

async fn mavlink(
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
            device.receive(now_us, &uart.receive());
            if device.due_us() <= now_us {
                let late_us: u64 = faults.iter().map(|fault| fault.late_us(now_us)).sum();
                let truth = world.true_state(now_us.saturating_sub(latency_us + late_us));
                let tamper = |attitude: &mut ATTITUDE_DATA| {
                    for fault in &mut faults {
                        fault.tamper(now_us, attitude);
                    }
                };
                let (is_armed, current_a) = (world.is_armed(), world.told_current_a(now_us));
                let bytes = device.send(now_us, &Seen { truth, is_armed, current_a }, tamper);
                if world.sends_attitude() {
                    uart.send(&bytes);
                }
            }
        }
        Timer::after(Duration::from_micros(LOOK_US)).await;
    }
}

/// Its estimate of the attitude is as old as a MAVLink autopilot's when it is sent, and is made as often.
async fn msp(
    device: Rc<RefCell<MspAutopilot>>,
    world: World,
    uart: HostEnd,
    mut source: AttitudeSource,
    mut faults: Vec<Box<dyn AttitudeFault>>,
) {
    let latency_us = source.latency_us();
    let period_us = (1e6 / world.config().attitude_source.rate_hz) as u64;
    let mut known = Known::default();
    let mut estimated_us = 0;
    loop {
        let now_us = clock::now_us();
        if now_us >= estimated_us {
            estimated_us += period_us;
            let late_us: u64 = faults.iter().map(|fault| fault.late_us(now_us)).sum();
            let truth = world.true_state(now_us.saturating_sub(latency_us + late_us));
            let Reported { roll_rad, pitch_rad, yaw_rad } = source.report(&truth);
            // Faults know the other protocol's message; of its rates nothing is told.
            let [roll, pitch, yaw] = [roll_rad, pitch_rad, yaw_rad].map(|rad| rad as f32);
            let mut attitude = ATTITUDE_DATA { roll, pitch, yaw, ..ATTITUDE_DATA::default() };
            for fault in &mut faults {
                fault.tamper(now_us, &mut attitude);
            }
            known = Known {
                roll_rad: f64::from(attitude.roll),
                pitch_rad: f64::from(attitude.pitch),
                yaw_rad: f64::from(attitude.yaw),
                is_armed: world.is_armed(),
                place: Some((XIAN.latitude_deg, XIAN.longitude_deg, XIAN.height_m)),
                unix_s: Some((BEGAN_UNIX_US + now_us) / 1_000_000),
                current_a: world.told_current_a(now_us),
            };
        }
        {
            let mut device = device.borrow_mut();
            for timed in uart.receive_timed() {
                device.take(timed.at_us, timed.byte);
            }
            let bytes = device.send(now_us, &known);
            if world.sends_attitude() {
                uart.send(&bytes);
            }
        }
        Timer::after(Duration::from_micros(LOOK_US)).await;
    }
}
