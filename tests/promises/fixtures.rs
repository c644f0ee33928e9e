//! Vehicles, flights and replies that several subjects use.

use std::sync::OnceLock;

use log_analysis::score::wrap_180;
use simulator::module::{Module as _, ModuleRunEnd};
use simulator::nmea::{HeadingSentence, SentenceReader};
use simulator::rig::Rig;
use simulator::routine::{CalibrationRoutine, TurnPlan};
use simulator::transcript::{self, Refusal, ShownCalibration};
use simulator::world::aircraft::{VehicleConfig, VehicleKind};
use simulator::world::autopilot::Leg;
use simulator::world::cable_far_end::FarEnd;
use simulator::world::mavlink_autopilot::MavlinkFirmware;
use simulator::world::msp_autopilot::{AnswerFaults, MspFirmware};
use simulator::world::{World, WorldConfig};

/// How many of `all` flights a test flies: all in an optimised build, as the gate runs it, and a third in another one.
pub const fn share_of_flights(all: u64) -> u64 {
    if cfg!(debug_assertions) { all.div_ceil(3) } else { all }
}

pub const MAVLINK_ARDUPILOT: FarEnd = FarEnd::Mavlink(MavlinkFirmware::ArduPilot);
pub const MSP_ARDUPILOT: FarEnd = FarEnd::Msp(MspFirmware::ArduPilot, AnswerFaults::NO_FAULTS);

/// Bound of a single heading error, degrees: calibration error of 1.0 (README), and three sigmas of attitude error (0.2
/// of bias, 0.3 of noise) times the tangent of the inclination, 54 deg.
pub const HEADING_ERROR_BOUND_DEG: f64 = 2.5;

pub fn world_with_vehicle(vehicle_kind: VehicleKind) -> WorldConfig {
    let world = WorldConfig::of_table1(7);
    WorldConfig { aircraft: VehicleConfig { kind: vehicle_kind, ..world.aircraft }, ..world }
}

/// A module one second after power-on.
pub fn started_rig(world: &WorldConfig) -> Rig {
    let mut rig = Rig::new(*world);
    run_for_s(&mut rig, 1.0);
    rig
}

pub fn run_for_s(rig: &mut Rig, seconds: f64) {
    assert_eq!(rig.run_for_s(seconds), ModuleRunEnd::Time);
}

pub fn run_until_legs_end(rig: &mut Rig) {
    while rig.world.unfinished_leg_count() > 0 {
        run_for_s(rig, 1.0);
    }
}

pub fn full_status(rig: &mut Rig) -> String {
    rig.send_console_line("status all")
}

/// The rest of the line of `status all` that starts with `label`.
pub fn status_line(rig: &mut Rig, label: &str) -> String {
    let status = full_status(rig);
    let line =
        status.lines().find_map(|line| line.strip_prefix(label)).unwrap_or_else(|| panic!("{label} in {status}"));
    line.to_owned()
}

/// Queues the vehicle's calibration routine at its first heading.
pub fn append_routine(world: &World) {
    let aircraft = world.world_config().aircraft;
    let routine = CalibrationRoutine::for_vehicle(aircraft.kind, TurnPlan::default(), aircraft.heading_deg);
    routine.legs().into_iter().for_each(|leg| world.append_leg(leg));
}

/// Arms, and flies the vehicle's calibration routine.
pub fn fly_routine(rig: &mut Rig) {
    rig.world.set_armed(true);
    append_routine(&rig.world);
    run_for_s(rig, 240.0);
}

pub fn append_turns(world: &World) {
    for heading_change_deg in [1440.0, -1440.0] {
        world.append_leg(Leg::Turn { bank_deg: 25.0, heading_change_deg });
    }
}

/// Collects in turns both ways; returns the result of the solve, `None` if the power was cut.
pub fn fly_turns(rig: &mut Rig) -> Option<Result<(), Refusal>> {
    rig.send_console_line("cal start turns");
    append_turns(&rig.world);
    let mut session = String::new();
    for _ in 0..300 {
        if rig.run_for_s(1.0) == ModuleRunEnd::PowerCut {
            return None;
        }
        session.push_str(&rig.take_console_output());
        if let Some(notice) = transcript::parse_solve_notice(&session) {
            return Some(notice);
        }
    }
    panic!("no outcome: {session}");
}

pub fn shown_calibration(rig: &mut Rig) -> Option<ShownCalibration> {
    transcript::parse_shown_calibration(&rig.send_console_line("cal show"))
}

/// The paper's aircraft with the calibration of one flight, which all tests share; it flies straight on.
pub fn calibrated_rig() -> Rig {
    static CALIBRATED_FLASH: OnceLock<Vec<u8>> = OnceLock::new();
    let flash = CALIBRATED_FLASH.get_or_init(|| {
        let mut rig = started_rig(&WorldConfig::of_table1(3));
        assert_eq!(fly_turns(&mut rig), Some(Ok(())));
        rig.flash.flash_contents()
    });
    let mut rig = Rig::new(WorldConfig::of_table1(3));
    assert!(rig.load_flash(flash));
    run_for_s(&mut rig, 1.0);
    rig.take_console_output();
    rig
}

/// Sentences of some seconds, of which the first may be cut.
pub fn received_sentences(rig: &mut Rig, seconds: f64) -> Vec<HeadingSentence> {
    let _ = rig.instrument.receive_bytes();
    run_for_s(rig, seconds);
    parse_sentences(&rig.instrument.receive_bytes())
}

/// Sentences of a line, of which the first may be cut.
pub fn parse_sentences(bytes: &[u8]) -> Vec<HeadingSentence> {
    let mut reader = SentenceReader::default();
    let sentences = bytes.iter().filter_map(|&byte| reader.push_byte(byte)).collect();
    assert!(reader.invalid_lines <= 1, "{} broken lines", reader.invalid_lines);
    sentences
}

pub fn count_headings(sentences: &[HeadingSentence]) -> usize {
    sentences.iter().filter(|sentence| sentence.heading_deg.is_some()).count()
}

/// Largest distance of headings from one, degrees.
pub fn max_error_deg(headings_deg: impl IntoIterator<Item = f64>, true_deg: f64) -> f64 {
    headings_deg.into_iter().map(|heading_deg| wrap_180(heading_deg - true_deg).abs()).fold(0.0, f64::max)
}

/// Commands of the program `host-sim`.
#[cfg(unix)]
pub mod program {
    use std::process::{Child, Command, Stdio};

    use rustix::process::{Pid, Signal, kill_process};
    use testkit::documents::repository_root;

    /// `host-sim` with arguments, in the root.
    pub fn host_sim_command<'a>(arguments: impl IntoIterator<Item = &'a str>) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lab"));
        command.args(arguments).current_dir(repository_root());
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// Sends Ctrl-C; returns the exit code.
    pub fn interrupt_for_exit_code(child: &mut Child) -> Option<i32> {
        kill_process(Pid::from_child(child), Signal::INT).unwrap();
        child.wait().unwrap().code()
    }
}
