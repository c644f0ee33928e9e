//! Nobody types anything: the module calibrates in flight, and its lamp says so.

use host_sim::mission::Plan;
use host_sim::module::{Module as _, Ran};
use host_sim::rig::Rig;
use host_sim::routine::Routine;
use host_sim::transcript::{self, Notice};
use host_sim::world::WorldConfig;
use host_sim::world::aircraft::{Config, Kind};

fn world(kind: Kind) -> WorldConfig {
    let world = WorldConfig::table1(7);
    WorldConfig { aircraft: Config { kind, ..world.aircraft }, ..world }
}

/// Share of two seconds in which the lamp is lit, percent.
fn lit_percent(rig: &mut Rig) -> u32 {
    let mut lit = 0;
    for _ in 0..200 {
        assert_eq!(rig.run_for_s(0.01), Ran::Time);
        lit += u32::from(rig.panel.is_lit());
    }
    lit / 2
}

/// Flies a kind's routine, armed; what the module told by itself, and the lamp half way.
fn fly(rig: &mut Rig, kind: Kind) -> (Option<Notice>, u32) {
    rig.world.set_armed(true);
    let legs = Routine::of(kind, Plan::default(), rig.world.config().aircraft.heading_deg).legs();
    for leg in legs {
        rig.world.fly(leg);
    }
    let (mut printed, mut lamp) = (String::new(), 0);
    for second in 0..240 {
        assert_eq!(rig.run_for_s(1.0), Ran::Time);
        printed.push_str(&rig.printed());
        if second == 25 {
            lamp = lit_percent(rig);
        }
    }
    (transcript::notice(&printed), lamp)
}

/// From the bench to a heading: an aeroplane and a copter. Before it is armed a short flash, while it collects more, and
/// when it is calibrated the lamp is lit but for a break.
#[test]
fn who_takes_off_comes_back_calibrated() {
    for kind in [Kind::Plane, Kind::Copter] {
        let mut rig = Rig::new(world(kind));
        rig.run_for_s(8.0);
        assert!(lit_percent(&mut rig) < 8, "{kind:?}: waiting");
        let status = rig.type_line("status");
        assert!(status.contains("\r\narmed: no\r\n"), "{status}");
        assert!(status.contains("\r\ncollection: flight, when the autopilot arms\r\n"), "{status}");
        let (notice, lamp) = fly(&mut rig, kind);
        assert!(matches!(notice, Some(Notice::Calibrated(_))), "{kind:?}: {notice:?}");
        assert!((9..=92).contains(&lamp), "{kind:?}: {lamp}");
        assert!(lit_percent(&mut rig) > 90, "{kind:?}: calibrated");
        assert!(rig.type_line("status").contains("ok calibrated"));
    }
}

/// Switched off, only who holds the button, or types, begins; the choice is kept over a restart.
#[test]
fn it_waits_for_whom_it_is_told_to_wait() {
    let mut rig = Rig::new(world(Kind::Copter));
    rig.run_for_s(2.0);
    assert!(rig.type_line("cal auto off").contains("ok auto off"));
    rig.type_line("reboot");
    rig.world.set_armed(true);
    rig.run_for_s(20.0);
    let status = rig.type_line("status");
    assert!(status.contains("ok uncalibrated") && status.contains("\r\nauto: off, "), "{status}");
    rig.panel.press(true);
    rig.run_for_s(2.5);
    rig.panel.press(false);
    let status = rig.type_line("status");
    assert!(status.contains("ok collecting") && !status.contains("by itself\r"), "{status}");
}

/// On the ground, disarmed, it collects nothing however it is carried about.
#[test]
fn carried_about_it_collects_nothing() {
    let mut rig = Rig::new(world(Kind::Copter));
    let legs = Routine::of(Kind::Copter, Plan::default(), 0.0).legs();
    for leg in legs {
        rig.world.fly(leg);
    }
    rig.run_for_s(120.0);
    let status = rig.type_line("status");
    assert!(status.contains("ok uncalibrated") && status.contains("attitudes: 0 samples"), "{status}");
}
