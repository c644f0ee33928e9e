//! Prints the decoded messages of both ports during two simulated flights, one line a message, for `scripts/golden`.
//!
//! A copter with ArduPilot on both ports (MAVLink, MSP), then an aeroplane with PX4 (MAVLink) and an NMEA listener. A
//! line holds the time in milliseconds (10 ms resolution), the port, the message, and its numbers. A STATUSTEXT is
//! reduced to its severity: its text may change without a change of behaviour.

use simulator::faults::Faults;
use simulator::mission::TurnPlan;
use simulator::module::Module as _;
use simulator::rig::Rig;
use simulator::routine::CalibrationRoutine;
use simulator::world::WorldConfig;
use simulator::world::aircraft::VehicleKind;
use simulator::world::cable_far_end::{AttachedDevice, FarEnd};
use simulator::world::mavlink_autopilot::MavlinkFirmware;
use simulator::world::msp_autopilot::{self, AnswerFaults};

const STATUSTEXT: u32 = 253;
const STEP_S: f64 = 0.01;
const FLIGHT_S: f64 = 300.0;

fn main() {
    let no_troubles = AnswerFaults {
        drop_probability: 0.0,
        rejection_probability: 0.0,
        truncation_probability: 0.0,
        delay_probability: 0.0,
    };
    let msp = FarEnd::Msp(msp_autopilot::MspFirmware::ArduPilot, no_troubles);
    print_flight(VehicleKind::Copter, [FarEnd::Mavlink(MavlinkFirmware::ArduPilot), msp], "set port2 msp");
    print_flight(VehicleKind::Plane, [FarEnd::Mavlink(MavlinkFirmware::Px4), FarEnd::Unconnected], "set vision on");
}

fn print_flight(vehicle_kind: VehicleKind, port_devices: [FarEnd; 2], setting: &str) {
    println!("{} {setting}", vehicle_kind.vehicle_name());
    let mut rig = Rig::with_port_devices(
        WorldConfig::of_table1(7).with_vehicle_kind(vehicle_kind),
        Faults::default(),
        port_devices,
    );
    let _ = rig.send_console_line(setting);
    let _ = rig.run_for_s(12.0);
    rig.world.set_armed(true);
    for leg in CalibrationRoutine::for_vehicle(
        vehicle_kind,
        TurnPlan::default(),
        rig.world.world_config().aircraft.heading_deg,
    )
    .legs()
    {
        rig.world.append_leg(leg);
    }
    let end_us = rig.now_us() + (FLIGHT_S * 1e6) as u64;
    while rig.now_us() < end_us {
        let _ = rig.run_for_s(STEP_S);
        print_messages(&rig);
    }
}

fn print_messages(rig: &Rig) {
    let now_ms = rig.now_us() / 1000;
    for (port, far_end) in rig.port_devices.iter().enumerate() {
        match far_end {
            AttachedDevice::Mavlink(autopilot) => {
                for frame in autopilot.borrow_mut().take_received() {
                    let is_text = frame.message_id == STATUSTEXT;
                    let payload = if is_text { &frame.payload[..1] } else { &frame.payload[..] };
                    // Of a STATUSTEXT in several frames only the first frame is printed: the number of frames depends
                    // on the text.
                    if !is_text || frame.byte_at(53) == 0 {
                        println!(
                            "{now_ms} {port} {} {}/{} {payload:02x?}",
                            frame.message_id, frame.system_id, frame.component_id
                        );
                    }
                }
            }
            AttachedDevice::Msp(autopilot) => {
                for reading in autopilot.borrow_mut().take_compass_samples() {
                    println!("{now_ms} {port} compass {} {:?}", reading.time_ms, reading.field_mg);
                }
            }
            AttachedDevice::SendOnly => {}
        }
    }
    for sentence in String::from_utf8_lossy(&rig.instrument_cable().receive_bytes()).lines() {
        println!("{now_ms} nmea {sentence}");
    }
}
