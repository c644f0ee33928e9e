//! Simulated module for external programs, in simulation time and through real sockets and pseudo-terminals.

use std::fs;
use std::io::{BufRead as _, BufReader, Read, Write};
use std::net::{TcpStream, UdpSocket};
use std::path::Path;
use std::process::{Child, ChildStdout, Output};
use std::sync::LazyLock;
use std::time::Duration;

use laboratory::serve::{
    AUTOPILOT_PORT, AttitudeProvider, CONSOLE_PORT, FlashImage, INSTRUMENT_PORT, PilotPattern, ServeOptions,
    ServedModule,
};
use log_analysis::score::wrap_180;
use serde_json::Value;
use simulator::rig::STORE_BYTES;
use simulator::world::WorldConfig;
use simulator::world::aircraft::VehicleKind;
use testkit::frames::mavlink_attitude;
use testkit::random::Random;

use crate::fixtures::program::{host_sim_command, interrupt_for_exit_code};
use crate::fixtures::{HEADING_ERROR_BOUND_DEG, max_error_deg, parse_sentences};

const SECOND_US: u64 = 1_000_000;

fn served_module(options: ServeOptions, image: Option<&FlashImage>) -> ServedModule {
    let mut served_module = ServedModule::new(WorldConfig::of_table1(1), options, image);
    served_module.advance_time(SECOND_US);
    served_module
}

fn send_typed_command(served_module: &mut ServedModule, line: &str) -> String {
    drop(served_module.receive_bytes(CONSOLE_PORT));
    served_module.send_bytes(CONSOLE_PORT, format!("{line}\r").as_bytes());
    served_module.advance_time(SECOND_US / 2);
    String::from_utf8(served_module.receive_bytes(CONSOLE_PORT)).unwrap()
}

/// Headings output in some seconds; `None` for an empty field.
fn received_headings(served_module: &mut ServedModule, seconds: u64) -> Vec<Option<f64>> {
    drop(served_module.receive_bytes(INSTRUMENT_PORT));
    served_module.advance_time(seconds * SECOND_US);
    parse_headings(&served_module.receive_bytes(INSTRUMENT_PORT))
}

fn parse_headings(bytes: &[u8]) -> Vec<Option<f64>> {
    let magnetic = parse_sentences(bytes).into_iter().filter(|sentence| sentence.sentence_kind == "HCHDM");
    magnetic.map(|sentence| sentence.heading_deg).collect()
}

/// Flash contents after a calibration by `cal start turns`.
static CALIBRATED_FLASH: LazyLock<FlashImage> = LazyLock::new(|| {
    let mut served_module = served_module(ServeOptions::default(), None);
    assert!(send_typed_command(&mut served_module, "cal start turns").contains("ok collecting"));
    let mut session = String::new();
    // Four circles to each side at 12 deg/s take 240 s.
    for _ in 0..300 {
        served_module.advance_time(SECOND_US);
        session.push_str(&String::from_utf8(served_module.receive_bytes(CONSOLE_PORT)).unwrap());
        if session.contains("note calibrated: expected error") {
            return served_module.flash_image();
        }
    }
    panic!("it did not calibrate: {session}");
});

#[test]
fn console_commands_are_answered_and_flash_survives_a_restart() {
    let mut first = served_module(ServeOptions::default(), None);
    assert!(send_typed_command(&mut first, "status all").contains("calibration: none"));
    assert!(send_typed_command(&mut first, "frobnicate").contains("error unknown-command: "));
    assert!(received_headings(&mut first, 1).iter().all(Option::is_none));
    drop(first);
    let mut restarted = served_module(ServeOptions::default(), Some(&CALIBRATED_FLASH));
    assert!(send_typed_command(&mut restarted, "status all").contains("ok calibrated"));
    let headings = received_headings(&mut restarted, 3);
    assert!(headings.len() >= 29 && headings.iter().all(Option::is_some), "{headings:?}");
}

#[test]
fn the_output_does_not_depend_on_the_time_steps() {
    let output_of_pieces = |pieces_us: &[u64]| {
        let options = ServeOptions { flight_pattern: PilotPattern::Wandering, ..ServeOptions::default() };
        let mut served_module = ServedModule::new(WorldConfig::of_table1(3), options, Some(&CALIBRATED_FLASH));
        let mut time_steps = pieces_us.iter().cycle();
        for typed_command in [&b"status all\r"[..], b"cal start\r", b"status all\r"] {
            let until_us = served_module.now_us() + 20 * SECOND_US;
            served_module.send_bytes(CONSOLE_PORT, typed_command);
            while served_module.now_us() < until_us {
                served_module.advance_time((*time_steps.next().unwrap()).min(until_us - served_module.now_us()));
            }
        }
        (served_module.receive_bytes(CONSOLE_PORT), served_module.receive_bytes(INSTRUMENT_PORT))
    };
    let output_in_one_step = output_of_pieces(&[20 * SECOND_US]);
    assert!(output_in_one_step.0.len() > 1000 && output_in_one_step.1.len() > 10_000);
    assert!(output_in_one_step == output_of_pieces(&[7_300, 1, 250_000, 99_999]), "other bytes");
}

/// A bank of 25 deg at 22 m/s turns by 11.9 deg/s: 30 s per circle. A command cancels the pattern.
#[test]
fn the_pilot_flies_the_commanded_legs() {
    let mut served_module = served_module(ServeOptions::default(), None);
    assert_eq!(served_module.execute_pilot_line("turn 25 -360").unwrap(), "ok flies as ordered");
    served_module.execute_pilot_line("heading 90 30").unwrap();
    let mut banks = Vec::new();
    for _ in 0..30 {
        served_module.advance_time(SECOND_US);
        banks.push(number_after(&served_module.execute_pilot_line("status").unwrap(), "roll "));
    }
    let [shortest, longest] = [banks.iter().copied().fold(0.0, f64::max), banks.iter().copied().fold(0.0, f64::min)];
    assert!(longest < -20.0 && shortest < 5.0, "to the left only: {banks:?}");
    served_module.advance_time(30 * SECOND_US);
    let heading_deg = number_after(&served_module.execute_pilot_line("status").unwrap(), "magnetic heading ");
    assert!(wrap_180(heading_deg - 90.0).abs() < 10.0, "{heading_deg}");

    assert!(send_typed_command(&mut served_module, "reboot").contains("error armed: "));
    assert_eq!(served_module.execute_pilot_line("land").unwrap(), "ok lands");
    // Five seconds to level out, one until the next heartbeat, five of rest until a disarmed state counts.
    served_module.advance_time(13 * SECOND_US);
    assert_eq!(served_module.execute_pilot_line("turn 25 90").unwrap_err().stable_code(), "landed");
    assert!(served_module.execute_pilot_line("status").unwrap().contains("stands on the ground: roll 0.0, pitch 0.0"));
    assert!(send_typed_command(&mut served_module, "reboot").contains("started by reboot"));
    served_module.execute_pilot_line("takeoff").unwrap();
    served_module.advance_time(2 * SECOND_US);
    assert!(send_typed_command(&mut served_module, "reboot").contains("error armed: "));
    assert_eq!(served_module.execute_pilot_line("loop 3").unwrap_err().stable_code(), "unknown-order");
}

fn number_after(text: &str, label: &str) -> f64 {
    let after_label = text.split_once(label).unwrap_or_else(|| panic!("{label} in {text}")).1;
    after_label.split([',', ' ', ';']).next().unwrap().parse().unwrap()
}

const WITH_EXTERNAL_SIMULATOR: ServeOptions = ServeOptions {
    flight_pattern: PilotPattern::Routine,
    attitude: AttitudeProvider::Auto,
    has_external_simulator: true,
    has_can: false,
};

/// Another simulator sends a heading at 20 Hz.
fn follow_heading(served_module: &mut ServedModule, heading_deg: f64, seconds: u64) {
    for _ in 0..20 * seconds {
        served_module.follow_datagram(format!("0 0 {heading_deg}").as_bytes()).unwrap();
        served_module.advance_time(SECOND_US / 20);
    }
}

#[test]
fn attitudes_of_another_simulator_turn_the_heading() {
    let mut served_module = served_module(WITH_EXTERNAL_SIMULATOR, Some(&CALIBRATED_FLASH));
    for heading_deg in [90.0, 200.0, 345.0] {
        follow_heading(&mut served_module, heading_deg, 3);
        let headings = received_headings(&mut served_module, 2);
        let largest = max_error_deg(headings.iter().map(|heading| heading.expect("a heading")), heading_deg);
        assert!(headings.len() >= 19 && largest < HEADING_ERROR_BOUND_DEG, "{heading_deg}: {headings:?}");
    }
    assert_eq!(served_module.execute_pilot_line("turn 25 90").unwrap_err().stable_code(), "flown-by-another");
}

/// The first datagram moves the aircraft at once, without body rates. When attitudes were sent before it, the module
/// interpreted the jump to 301 deg as a change of iron, and headings were 3 deg off; when those from before it were sent
/// after it, which are 0.05 s old, the monitor started with a mean of both headings, which were 4 to 9 deg off.
#[test]
fn the_first_attitude_of_another_simulator_is_no_change_of_iron() {
    for (first_at_us, deg) in [(3 * SECOND_US, 0.0), (3 * SECOND_US, 100.0), (3 * SECOND_US, 301.0), (21_370, 301.0)] {
        let mut served_module =
            ServedModule::new(WorldConfig::of_table1(1), WITH_EXTERNAL_SIMULATOR, Some(&CALIBRATED_FLASH));
        served_module.advance_time(first_at_us);
        let headings = parse_headings(&served_module.receive_bytes(INSTRUMENT_PORT));
        assert!(headings.iter().all(Option::is_none), "{deg}");
        assert!(served_module.execute_pilot_line("status").unwrap().contains("attitude from nobody yet"));
        if first_at_us > SECOND_US {
            let status = send_typed_command(&mut served_module, "status all");
            assert!(status.contains("reports: 0,"), "none from power-on: {status}");
        }
        follow_heading(&mut served_module, deg, 8);
        let headings = received_headings(&mut served_module, 2).into_iter().map(|heading| heading.expect("a heading"));
        assert!(max_error_deg(headings, deg) < HEADING_ERROR_BOUND_DEG, "{deg} from {first_at_us} us");
    }
}

#[test]
fn malformed_attitudes_are_counted_and_ignored() {
    let mut served_module = served_module(WITH_EXTERNAL_SIMULATOR, None);
    served_module.follow_datagram(b"10 5 90").unwrap();
    served_module.advance_time(SECOND_US);
    let before = served_module.execute_pilot_line("status").unwrap();
    let mut random = Random(7);
    for (datagram_index, datagram) in
        [&b"10 5"[..], b"", b"90 0 nan", b"\xff\xff", &random.bytes(200)].into_iter().enumerate()
    {
        let code = served_module.follow_datagram(datagram).unwrap_err().stable_code();
        assert_eq!(code, if datagram_index == 2 { "datagram-out-of-range" } else { "bad-datagram" });
    }
    served_module.advance_time(SECOND_US);
    let after = served_module.execute_pilot_line("status").unwrap();
    let followed_attitude =
        |status: &str| status.split_once("follows: ").unwrap().1.split_once(';').unwrap().0.to_owned();
    assert_eq!(followed_attitude(&after), followed_attitude(&before));
    assert!(followed_attitude(&after).contains("roll 10.0, pitch 5.0, magnetic heading 90.0 deg"), "{after}");
    assert!(after.ends_with("1 attitudes received, 5 malformed"), "{after}");
}

/// ATTITUDE of another autopilot with a characteristic roll.
fn peer_attitude_frame(tick: u32) -> Vec<u8> {
    mavlink_attitude([9, 1], 20 * tick, [0.7 + 0.001 * (tick % 7) as f32, 0.0, 0.0, 0.01, 0.0, 0.0])
}

/// The simulator stops sending while another autopilot sends, and resumes three seconds after its last message. The
/// module accepts another sender after ten seconds without its own (README).
#[test]
fn an_attached_autopilot_replaces_the_simulated_attitude() {
    for (attitude, is_believed, expected_counts) in [
        // Accepted reports at 50 Hz: 1.5 s of the simulator, then 2 s of the other autopilot, ten seconds after its
        // first report.
        (AttitudeProvider::Auto, true, 515.0..535.0),
        // Reports of the simulator during 14 s.
        (AttitudeProvider::Simulator, false, 1020.0..1060.0),
        // All reports of the other autopilot.
        (AttitudeProvider::Peer, true, 600.0..602.0),
    ] {
        let options = ServeOptions { attitude, flight_pattern: PilotPattern::Level, ..ServeOptions::default() };
        let mut served_module = served_module(options, None);
        // Landed, since the module changes its autopilot only when disarmed. Seven more seconds of own reports.
        let _ = served_module.execute_pilot_line("land");
        served_module.advance_time(7 * SECOND_US);
        let has_own = attitude != AttitudeProvider::Peer;
        assert_eq!(
            send_typed_command(&mut served_module, "status all").contains("attitude: none"),
            !has_own,
            "{attitude:?}"
        );
        for tick in 0..600 {
            served_module.send_bytes(AUTOPILOT_PORT, &peer_attitude_frame(tick));
            served_module.advance_time(SECOND_US / 50);
        }
        served_module.send_bytes(AUTOPILOT_PORT, &peer_attitude_frame(600));
        let status = send_typed_command(&mut served_module, "status all");
        assert_eq!(status.contains("attitude: roll 40."), is_believed, "{attitude:?}: {status}");
        assert!(expected_counts.contains(&number_after(&status, "reports: ")), "{attitude:?}: {status}");
        served_module.advance_time(12 * SECOND_US);
        let status = send_typed_command(&mut served_module, "status all");
        assert_eq!(status.contains("attitude: none"), !has_own, "{attitude:?}: {status}");
        assert!(!status.contains("attitude: roll 40."), "{status}");
    }
}

/// A boat without an autopilot: roll and pitch of the module's gyro and accelerometer, in waves that roll it by 8 deg.
#[test]
fn a_served_module_has_an_attitude_of_its_own() {
    let options = ServeOptions { attitude: AttitudeProvider::Own, ..ServeOptions::default() };
    let boat = WorldConfig::of_table1(1).with_vehicle_kind(VehicleKind::Boat);
    let mut served_module = ServedModule::new(boat, options, None);
    served_module.advance_time(SECOND_US);
    assert!(send_typed_command(&mut served_module, "status").contains("attitude: none"));
    assert!(send_typed_command(&mut served_module, "set attitude own").contains("ok attitude-source own"));
    served_module.advance_time(10 * SECOND_US);
    let status = send_typed_command(&mut served_module, "status");
    let truth = served_module.execute_pilot_line("status").unwrap();
    for angle in ["roll ", "pitch "] {
        let error_deg = number_after(&status, angle) - number_after(&truth, angle);
        assert!(error_deg.abs() < 6.0, "{angle}{error_deg}: {status}{truth}");
    }
}

/// A navigation program finds a true heading without a command; a field that is not that of Xi'an has no place.
#[test]
fn a_served_module_knows_declination_and_current() {
    for (world, declination) in [
        (WorldConfig::of_table1(1), "declination: -4.2 deg, by the field model"),
        (WorldConfig::random_world(1), "declination: not set"),
    ] {
        let mut served_module = ServedModule::new(world, ServeOptions::default(), None);
        served_module.advance_time(5 * SECOND_US);
        let status = send_typed_command(&mut served_module, "status all");
        assert!(status.contains(declination) && number_after(&status, "current: ") > 1.0, "{status}");
    }
}

/// Random bytes at all ports, bounded by what a real line carries.
#[test]
fn random_bytes_do_not_stop_the_served_module() {
    let mut served_module = served_module(ServeOptions::default(), None);
    let mut random = Random(5);
    for _ in 0..200 {
        for port in [CONSOLE_PORT, AUTOPILOT_PORT, INSTRUMENT_PORT, 3, usize::MAX] {
            let mut bytes = random.bytes(served_module.free_bytes(port).min(300));
            // Without letters, so that no random line is a command.
            bytes.retain(|byte| !byte.is_ascii_alphabetic());
            served_module.send_bytes(port, &bytes);
        }
        served_module.advance_time(SECOND_US / 100);
    }
    assert!(served_module.free_bytes(AUTOPILOT_PORT) < 1152 && served_module.free_bytes(3) == 0);
    served_module.advance_time(2 * SECOND_US);
    // All random bytes are delivered; only the simulator's latest messages (200 bytes) may be in transmission.
    assert!(served_module.free_bytes(AUTOPILOT_PORT) >= 1152 - 200);
    send_typed_command(&mut served_module, "");
    assert!(send_typed_command(&mut served_module, "version").contains("ok autoswing"));
}

/// Running `host-sim` process, killed on drop. Reads wait for bytes, not for time.
struct ServeProgram {
    child: Child,
    stdout_reader: BufReader<ChildStdout>,
    port_addresses: Value,
}

impl ServeProgram {
    fn start_serve(arguments: &[&str]) -> Self {
        let mut child = host_sim_command([&["serve", "--json"], arguments].concat()).spawn().unwrap();
        let mut stdout_reader = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        stdout_reader.read_line(&mut line).unwrap();
        let port_addresses = serde_json::from_str(&line).unwrap();
        Self { child, stdout_reader, port_addresses }
    }

    fn pty_path(&self, port: usize) -> String {
        self.port_addresses["ports"][port]["pty"].as_str().unwrap().to_owned()
    }

    fn connect_tcp(&self, port: usize) -> TcpStream {
        let port_number = self.port_addresses["ports"][port]["tcp"].as_u64().unwrap() as u16;
        let stream = TcpStream::connect(("127.0.0.1", port_number)).unwrap();
        // Ends this test if the module stays silent.
        stream.set_read_timeout(Some(Duration::from_mins(2))).unwrap();
        stream
    }

    fn send_order(&mut self, line: &str) -> String {
        writeln!(self.child.stdin.as_mut().unwrap(), "{line}").unwrap();
        let mut answer = String::new();
        self.stdout_reader.read_line(&mut answer).unwrap();
        answer
    }

    fn interrupt_for_exit_code(&mut self) -> Option<i32> {
        interrupt_for_exit_code(&mut self.child)
    }
}

impl Drop for ServeProgram {
    fn drop(&mut self) {
        // The process has ended unless the test failed.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Limit of bytes to read: twenty seconds of headings at five times real time.
const MAX_READ_BYTES: usize = 80_000;

fn read_until(source: &mut impl Read, is_complete: impl Fn(&[u8]) -> bool) -> Vec<u8> {
    let mut received = Vec::new();
    while !is_complete(&received) {
        let mut bytes = [0; 1024];
        let read_count = source.read(&mut bytes).unwrap();
        assert!(read_count > 0 && received.len() < MAX_READ_BYTES, "not in {:?}", String::from_utf8_lossy(&received));
        received.extend(&bytes[..read_count]);
    }
    received
}

fn contains_text(text: &str) -> impl Fn(&[u8]) -> bool + '_ {
    move |received| String::from_utf8_lossy(received).contains(text)
}

#[test]
fn serve_over_tcp_answers_streams_follows_and_ends() {
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("flash.bin");
    CALIBRATED_FLASH.write_file(&flash).unwrap();
    let mut program =
        ServeProgram::start_serve(&["--tcp", "0", "--world", "0", "--speed", "5", "--flash", flash.to_str().unwrap()]);
    let mut console = program.connect_tcp(CONSOLE_PORT);
    console.write_all(b"version\r").unwrap();
    read_until(&mut console, contains_text("ok autoswing 0.1.0\r\n> "));
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    let world = program.port_addresses["world"].as_u64().unwrap() as u16;
    udp.send_to(b"east", ("127.0.0.1", world)).unwrap();
    udp.send_to(b"0 0 90", ("127.0.0.1", world)).unwrap();
    // Both connections receive the same output, long enough to observe the turn.
    for mut listener in [program.connect_tcp(INSTRUMENT_PORT), program.connect_tcp(INSTRUMENT_PORT)] {
        let is_east = |read: &[u8]| {
            parse_headings(read)
                .iter()
                .flatten()
                .any(|heading_deg| wrap_180(heading_deg - 90.0).abs() < HEADING_ERROR_BOUND_DEG)
        };
        read_until(&mut listener, is_east);
    }
    assert!(program.send_order("status").contains("1 attitudes received, 1 malformed"));
    assert!(program.send_order("land").starts_with("error flown-by-another: "));
    console.write_all(b"set declination 7\r").unwrap();
    read_until(&mut console, contains_text("ok declination 7.0 deg"));
    // A simulator that drives the clock: the module goes on by its steps, however long the computer takes between them.
    udp.set_read_timeout(Some(Duration::from_mins(2))).unwrap();
    let step = || {
        let mut answer = [0; 64];
        udp.send_to(b"0 0 90 0.5", ("127.0.0.1", world)).unwrap();
        let length = udp.recv(&mut answer).unwrap();
        str::from_utf8(&answer[..length]).unwrap().parse::<f64>().unwrap()
    };
    let times_s = [step(), step(), step()];
    assert!(times_s.windows(2).all(|pair| (pair[1] - pair[0] - 0.5).abs() < 1e-9), "{times_s:?}");
    assert_eq!(program.interrupt_for_exit_code(), Some(130));
    drop(program);
    let (_, image) = FlashImage::lock_and_read(&flash).unwrap().unwrap();
    assert!(image != *CALIBRATED_FLASH, "what was set is kept");
    let mut restarted = served_module(ServeOptions::default(), Some(&image));
    let status = send_typed_command(&mut restarted, "status all");
    assert!(status.contains("ok calibrated") && status.contains("declination: 7.0 deg"), "{status}");
}

/// With a real pseudo-terminal, opened twice.
#[test]
fn serve_over_a_pseudo_terminal_answers_and_removes_it() {
    let mut program = ServeProgram::start_serve(&["--speed", "5"]);
    let path = program.pty_path(CONSOLE_PORT);
    for _ in 0..2 {
        let mut terminal = fs::File::options().read(true).write(true).open(&path).unwrap();
        terminal.write_all(b"\rstatus all\r").unwrap();
        read_until(&mut terminal, contains_text("calibration: none"));
    }
    let mut nmea = fs::File::open(program.pty_path(INSTRUMENT_PORT)).unwrap();
    read_until(&mut nmea, contains_text("$HCHDM,,M*07\r\n"));
    assert_eq!(program.interrupt_for_exit_code(), Some(130));
    drop(nmea);
    assert!(!Path::new(&path).exists());
}

#[test]
fn attaching_programs_are_reported_and_a_flash_file_has_one_user() {
    let folder = tempfile::tempdir().unwrap();
    let flash = folder.path().join("flash.bin");
    let flash = flash.to_str().unwrap();
    let mut program = ServeProgram::start_serve(&["--tcp", "0", "--flash", flash]);
    let Output { status, stderr, .. } = host_sim_command(["serve", "--flash", flash]).output().unwrap();
    let stderr_text = String::from_utf8(stderr).unwrap();
    assert!(status.code() == Some(2) && stderr_text.contains("flash-in-use: "), "{stderr_text}");
    let port_number = program.port_addresses["ports"][INSTRUMENT_PORT]["tcp"].to_string();
    let nmea = fs::File::open(program.pty_path(INSTRUMENT_PORT)).unwrap();
    let mut stderr = program.child.stderr.take().unwrap();
    read_until(
        &mut stderr,
        contains_text(&format!("port 2: a program attached to {}", program.pty_path(INSTRUMENT_PORT))),
    );
    let client = program.connect_tcp(INSTRUMENT_PORT);
    read_until(&mut stderr, contains_text(&format!(" attached to TCP port {port_number}")));
    drop((client, nmea));
    read_until(&mut stderr, contains_text(&format!("a program detached from TCP port {port_number}")));
    assert_eq!(program.interrupt_for_exit_code(), Some(130));
}

#[test]
fn serve_errors_are_reported_with_code_and_cause() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let flash = file("short.bin", &vec![0xFF; STORE_BYTES - 1]);
    let garbage = file("garbage.toml", b"\xff\xfe[[");
    let format = file("format.toml", b"[airframe]\nsoft_iron = 1\n");
    let range = file(
        "range.toml",
        b"[airframe]\nsoft_iron = [[9,0,0],[0,9,0],[0,0,9]]\nhard_iron_ut = [0,0,0]\nmounting_deg = [0,0,0]\n",
    );
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let tcp = listener.local_addr().unwrap().port().to_string();
    let taken_world = UdpSocket::bind("127.0.0.1:0").unwrap();
    let udp = taken_world.local_addr().unwrap().port().to_string();
    drop(listener.incoming());
    for (arguments, code, about) in [
        (["serve", "--flash", &flash], "flash-size", "16383"),
        (["serve", "--flash", "/nowhere/flash.bin"], "flash-unwritable", "/nowhere/flash.bin"),
        (["serve", "--airframe", "/nowhere/a.toml"], "airframe-unreadable", "/nowhere/a.toml"),
        (["serve", "--airframe", &garbage], "airframe-unreadable", &garbage),
        (["serve", "--airframe", &format], "airframe-format", &format),
        (["serve", "--airframe", &range], "airframe-out-of-range", &range),
        (["serve", "--tcp", &tcp], "tcp-unavailable", &tcp),
        (["serve", "--world", &udp], "world-unavailable", &udp),
        (["serve", "--pattern", "eights"], "invalid value 'eights'", "routine, circles, wandering, level"),
    ] {
        let Output { status, stderr, .. } = host_sim_command(arguments).output().unwrap();
        let stderr_text = String::from_utf8(stderr).unwrap();
        assert_eq!(status.code(), Some(2), "{arguments:?}: {stderr_text}");
        assert!(stderr_text.contains(code) && stderr_text.contains(about), "{arguments:?}: {stderr_text}");
    }
}
