//! Automatic calibration without console commands, indicated by the lamp.

use simulator::module::Module as _;
use simulator::rig::Rig;
use simulator::transcript::{self, Refusal};
use simulator::world::aircraft::VehicleKind;

use crate::fixtures::{append_routine, full_status, run_for_s, world_with_vehicle};

fn lamp_lit_percent(rig: &mut Rig) -> u32 {
    let mut lit_count = 0;
    for _ in 0..200 {
        run_for_s(rig, 0.01);
        lit_count += u32::from(rig.panel.is_lit());
    }
    lit_count / 2
}

/// Flies a routine, armed; returns the module's unsolicited result and the lamp's duty cycle during collection.
fn fly_armed_routine(rig: &mut Rig) -> (Option<Result<(), Refusal>>, u32) {
    rig.world.set_armed(true);
    append_routine(&rig.world);
    let (mut printed, mut lamp) = (String::new(), 0);
    for second in 0..240 {
        run_for_s(rig, 1.0);
        printed.push_str(&rig.take_console_output());
        if second == 25 {
            lamp = lamp_lit_percent(rig);
        }
    }
    (transcript::parse_solve_notice(&printed), lamp)
}

/// The lamp flashes briefly before arming, longer during collection, and is almost continuously lit when calibrated.
#[test]
fn a_flight_calibrates_without_commands() {
    for vehicle_kind in [VehicleKind::Plane, VehicleKind::Copter] {
        let mut rig = Rig::new(world_with_vehicle(vehicle_kind));
        rig.run_for_s(8.0);
        assert!(lamp_lit_percent(&mut rig) < 8, "{vehicle_kind:?}: waiting");
        let status = full_status(&mut rig);
        assert!(status.contains("\r\narmed: no\r\n"), "{status}");
        assert!(status.contains("\r\ncollection: flight, when the autopilot arms\r\n"), "{status}");
        let (notice, lamp) = fly_armed_routine(&mut rig);
        assert_eq!(notice, Some(Ok(())), "{vehicle_kind:?}");
        assert!((9..=92).contains(&lamp), "{vehicle_kind:?}: {lamp}");
        assert!(lamp_lit_percent(&mut rig) > 90, "{vehicle_kind:?}: calibrated");
        assert!(full_status(&mut rig).contains("ok calibrated"));
    }
}

#[test]
fn auto_off_leaves_the_start_to_the_pilot() {
    let mut rig = Rig::new(world_with_vehicle(VehicleKind::Copter));
    rig.run_for_s(2.0);
    assert!(rig.send_console_line("set auto off").contains("ok auto off"));
    rig.send_console_line("reboot");
    rig.world.set_armed(true);
    rig.run_for_s(20.0);
    let status = full_status(&mut rig);
    assert!(status.contains("ok uncalibrated") && status.contains("\r\nauto: off\r\n"), "{status}");
    rig.panel.set_button(true);
    rig.run_for_s(2.5);
    rig.panel.set_button(false);
    let status = full_status(&mut rig);
    assert!(status.contains("ok collecting") && !status.contains("automatic\r"), "{status}");
}

#[test]
fn motion_while_disarmed_collects_nothing() {
    let mut rig = Rig::new(world_with_vehicle(VehicleKind::Copter));
    append_routine(&rig.world);
    rig.run_for_s(120.0);
    let status = full_status(&mut rig);
    assert!(status.contains("ok uncalibrated") && status.contains("attitudes: 0 samples"), "{status}");
}
