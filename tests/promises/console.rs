//! Console commands and line editing over the simulated cable.

use autoswing_module::settings::SETTINGS;
use simulator::module::Module as _;
use simulator::rig::Rig;
use simulator::world::WorldConfig;
use simulator::world::aircraft::PrescribedMotion;
use simulator::world::autopilot::Leg;
use testkit::documents;
use testkit::frames::mavlink_attitude;

use crate::fixtures::{full_status, started_rig};

fn table1_rig() -> Rig {
    started_rig(&WorldConfig::of_table1(1))
}

/// The answer without the echo and the prompt.
fn answer(rig: &mut Rig, line: &str) -> String {
    rig.take_console_output();
    let text = rig.send_console_line(line);
    let lines = text.strip_suffix("\r\n> ").unwrap_or_else(|| panic!("{text:?} ends with a prompt"));
    lines.split("\r\n").skip(1).collect::<Vec<_>>().join("\n")
}

#[test]
fn the_console_prints_version_and_reset_cause_at_start() {
    let rig = table1_rig();
    assert_eq!(rig.take_console_output(), "autoswing 0.1.0, started by power-on; help lists the commands\r\n> ");
}

/// The parser's errors are tested beside it.
#[test]
fn every_command_answers_ok_or_error_with_a_code() {
    let mut rig = table1_rig();
    rig.take_console_output();
    for (line, expected_answer) in [
        ("version", "ok autoswing 0.1.0"),
        ("status", "ok uncalibrated"),
        ("cal start", "ok collecting"),
        ("cal stop", "ok uncalibrated"),
        ("cal start turns again", "ok collecting"),
        ("cal mark 90", "error not-swinging: "),
        ("cal start level again", "ok collecting"),
        ("cal start tumble again", "ok collecting"),
        ("cal start swing again", "ok collecting"),
        ("cal mark 361", "error out-of-range: a magnetic heading is 0 to 360"),
        ("set auto off", "ok auto off"),
        ("set auto on", "ok auto on"),
        ("cal abort", "ok uncalibrated"),
        ("cal stop", "error not-collecting: "),
        ("cal solve", "error no-samples: "),
        ("cal advise", "error not-solved: "),
        ("cal show", "error no-calibration: "),
        ("cal clear", "error needs-word: this cannot be undone; type cal clear all"),
        ("cal clear all", "ok uncalibrated"),
        ("cal undo", "error nothing-to-undo: "),
        ("cal abort", "ok uncalibrated"),
        ("set stream off", "ok stream off, 10 Hz, heading smooth"),
        ("set stream on", "ok stream on, 10 Hz, heading smooth"),
        ("set stream-rate 20", "ok stream on, 20 Hz, heading smooth"),
        ("set stream-rate 0", "error out-of-range: stream-rate is 1 to 80 Hz"),
        ("set heading raw", "ok stream on, 20 Hz, heading raw"),
        ("set heading smooth", "ok stream on, 20 Hz, heading smooth"),
        ("set declination 3.5", "ok declination 3.5 deg"),
        ("set declination -11.25", "ok declination -11.25 deg"),
        ("set declination 181", "error out-of-range: declination is -180 to 180 deg"),
        ("set declination none", "ok declination not set"),
        ("set inclination 54.125", "ok inclination 54.125 deg"),
        ("set inclination none", "ok inclination not set"),
        ("set align 90", "error no-calibration: "),
        ("set align 400", "error out-of-range: a magnetic heading is 0 to 360"),
        ("set align none", "ok align 0.0 deg, added to every heading"),
        ("set attitude-error 0.5", "ok attitude-error 0.5 deg, 1.0 % of bank"),
        ("set bank-error 2", "ok attitude-error 0.5 deg, 2.0 % of bank"),
        ("set iron-drift 1", "ok iron-drift 1.0 % of the field a minute"),
        ("set attitude-error 5.1", "error out-of-range: attitude-error is 0 to 5 deg"),
        ("set attitude-error default", "ok attitude-error 0.2 deg, 2.0 % of bank"),
        ("set mount Roll180-YAW90", "ok mount roll180-yaw90, align 0.0 deg; uncalibrated"),
        ("frobnicate", "error unknown-command: "),
        ("reboot", "ok restarting"),
    ] {
        let text = rig.send_console_line(line);
        let lines: Vec<&str> = text.split("\r\n").collect();
        assert_eq!(lines[0], line, "the line is echoed");
        assert!(lines[1].starts_with(expected_answer), "{line}: {text:?}");
    }
}

#[test]
fn status_shows_what_is_connected() {
    let mut rig = table1_rig();
    let status = full_status(&mut rig);
    assert!(status.contains("sensor: LIS3MDL at 1e"), "{status}");
    assert!(status.contains("attitude: roll "), "{status}");
    assert!(status.contains("heading: none, uncalibrated"), "{status}");
    rig.magnetometer.set_silent(true);
    rig.autopilot.send_bytes(&[0; 4000]);
    rig.run_for_s(0.3);
    let status = full_status(&mut rig);
    // 4000 zero bytes occupy the line for a third of a second, so the next attitude is stale.
    assert!(status.contains("attitude: none"), "{status}");
    assert!(status.contains("heading: none, sensor-silent"), "{status}");
}

/// The pilot sees that the straight flight between the turns counts: a sample in 0.4 s.
#[test]
fn status_counts_level_samples_after_a_turn() {
    let mut rig = table1_rig();
    assert_eq!(answer(&mut rig, "cal start turns"), "ok collecting");
    let mut level_samples = || -> u32 {
        let status = answer(&mut rig, "status");
        let (_, count) = status.strip_suffix(" level samples").and_then(|rest| rest.rsplit_once(", ")).expect(&status);
        rig.world.append_leg(Leg::Turn { bank_deg: 25.0, heading_change_deg: 90.0 });
        rig.run_for_s(30.0);
        count.parse().unwrap()
    };
    assert_eq!(level_samples(), 0, "none before the first turn: the aircraft may be parked");
    let samples = level_samples();
    assert!((20..=60).contains(&samples), "{samples} in 30 s with a quarter of a circle");
}

#[test]
fn status_counts_attitude_of_other_senders() {
    let mut rig = table1_rig();
    for tick in 0..100 {
        rig.autopilot.send_bytes(&mavlink_attitude([2, 1], 20 * tick, [-0.8, 0.0, 0.0, 0.0, 0.0, 0.0]));
        rig.run_for_s(0.02);
        if tick % 10 == 0 {
            let status = full_status(&mut rig);
            assert!(!status.contains("attitude: roll -4"), "{status}");
            assert!(status.contains(&format!(" {} from others, 0 rejected", tick + 1)), "{status}");
        }
    }
}

#[test]
fn tab_completes_up_recalls_backspace_deletes() {
    let mut rig = table1_rig();
    rig.take_console_output();
    assert!(rig.send_console_line("vers\t").contains("ok autoswing"));
    assert!(rig.send_console_line("\x1b[A").contains("ok autoswing"), "arrow up brings the last line back");
    assert!(rig.send_console_line("versionx\x7f").contains("ok autoswing"), "DEL deletes");
    assert!(rig.send_console_line("set inc\tn\t").contains("ok inclination not set"), "every word is completed");
    assert!(rig.send_console_line("ersion\x1b[Hv").contains("ok autoswing"), "Home is the beginning");
    assert!(rig.send_console_line("reboot\x15version").contains("ok autoswing"), "Ctrl-U takes the line away");
    assert!(rig.send_console_line("reboot\x03version").contains("^C\r\n> version\r\nok autoswing"), "so does Ctrl-C");
    // Tab prints the candidates and repeats the line.
    rig.console.send_bytes(b"autopilot \t");
    rig.run_for_s(0.1);
    let printed = rig.take_console_output();
    assert!(
        printed.contains("\r\ncheck  setup  undo  restart  \r\n") && printed.ends_with("> autopilot "),
        "{printed:?}"
    );
    assert!(rig.send_console_line("check").contains("ok asking the autopilot"));
}

#[test]
fn settings_last_over_a_restart() {
    let mut rig = table1_rig();
    rig.send_console_line("set declination -11.27");
    assert!(full_status(&mut rig).contains("stream: on, 10 Hz, heading smooth"));
    rig.send_console_line("set stream-rate 5");
    rig.send_console_line("set heading raw");
    rig.send_console_line("set inclination 61.125");
    rig.send_console_line("set mount yaw180");
    rig.send_console_line("set attitude-error 1.25");
    rig.send_console_line("set bank-error 3.125");
    assert!(rig.send_console_line("reboot").contains("started by reboot"));
    let status = full_status(&mut rig);
    for line in [
        "stream: on, 5 Hz, heading raw",
        "declination: -11.27 deg",
        "inclination: 61.125 deg",
        "mount: yaw180",
        "attitude-error: 1.25 deg, 3.125 % of bank",
    ] {
        assert!(status.contains(line), "{line} in {status}");
    }
    rig.send_console_line("set attitude-error default");
    let status = full_status(&mut rig);
    assert!(status.contains("attitude-error: 0.2 deg, 3.125 % of bank"), "{status}");
}

#[test]
fn an_armed_module_refuses_ground_commands() {
    let mut rig = table1_rig();
    rig.take_console_output();
    rig.world.set_armed(true);
    // Heartbeats are 1 s apart.
    rig.run_for_s(1.1);
    assert!(full_status(&mut rig).contains("armed: yes"));
    for line in ["reboot", "cal clear all", "cal undo", "set mount yaw90", "cal start swing", "cal mark 90"] {
        let reply = answer(&mut rig, line);
        assert!(reply.starts_with("error armed: the autopilot is armed"), "{line}: {reply}");
    }
    for (line, expected_answer) in [
        ("cal start level", "ok collecting"),
        (
            "cal start tumble",
            "error collecting: a collection of level is in progress; to discard it: cal start tumble again",
        ),
        ("cal start tumble again", "ok collecting"),
        ("cal stop", "ok uncalibrated"),
        ("cal solve", "error "),
        ("cal abort", "ok uncalibrated"),
        ("set stream-rate 20", "ok "),
        ("set declination 3.5", "ok "),
        ("set align none", "ok "),
    ] {
        let reply = answer(&mut rig, line);
        assert!(reply.starts_with(expected_answer) && !reply.contains("armed"), "{line}: {reply}");
    }
    rig.world.set_armed(false);
    rig.run_for_s(1.1);
    assert!(full_status(&mut rig).contains("armed: no"));
    assert!(answer(&mut rig, "cal start swing").starts_with("ok "));
    assert!(answer(&mut rig, "reboot").starts_with("error armed: "), "in flight");
    rig.world.set_prescribed_motion(PrescribedMotion::default());
    rig.run_for_s(7.0);
    assert!(rig.send_console_line("reboot").contains("ok restarting"));
}

#[test]
fn an_overlong_line_is_refused_and_not_cut() {
    let mut rig = table1_rig();
    // Truncated after 64 characters, this is a valid, destructive command.
    let line = format!("cal clear all{}oops", " ".repeat(60));
    assert!(rig.send_console_line(&line).contains("error line-too-long: a line holds 64 characters"));
    assert!(rig.send_console_line("version").contains("ok autoswing"));
}

/// Example commands in the documents are valid, and replies that need no previous flight match; `...` matches any text.
#[test]
fn documented_examples_match_the_output() {
    const DOCUMENTS: [&str; 3] = ["README.md", "docs/manual.md", "docs/autopilots.md"];
    // Commands whose documented answers need a previous flight; these answers are not compared.
    const COMMANDS_AFTER_A_FLIGHT: [&str; 2] = ["cal show", "cal advise"];
    let mut typed = 0;
    for name in DOCUMENTS {
        let document = documents::document_text(name);
        let mut rig = table1_rig();
        rig.take_console_output();
        for block in document.split("```text\n").skip(1).map(|after_fence| after_fence.split("```").next().unwrap()) {
            let mut lines = block.lines().peekable();
            while let Some(line) = lines.next() {
                let Some(command) = line.strip_prefix("> ") else { continue };
                let reply_text = answer(&mut rig, command);
                let expected_lines: Vec<&str> =
                    std::iter::from_fn(|| lines.next_if(|line| !line.starts_with("> "))).collect();
                typed += 1;
                if COMMANDS_AFTER_A_FLIGHT.contains(&command) {
                    assert!(
                        ["error no-", "error not-"].iter().any(|code| reply_text.starts_with(code)),
                        "{name}: {command}: {reply_text}"
                    );
                    continue;
                }
                for line in expected_lines {
                    let documented_start = line.split("...").next().unwrap();
                    assert!(
                        reply_text.lines().any(|reply_text| reply_text.starts_with(documented_start)),
                        "{name}: {command}: {line}: {reply_text}"
                    );
                }
            }
        }
    }
    assert!(typed >= 6, "{typed}");
}

/// Each parameter is in the document on the CAN bus.
#[test]
fn every_parameter_is_documented() {
    let dronecan = documents::document_text("docs/dronecan.md");
    for name in SETTINGS.iter().map(|setting| setting.parameter_name) {
        assert!(name.is_empty() || dronecan.contains(&format!("`{name}`")), "{name}");
    }
}

/// First word, or first two words, of each command in a help text.
fn helped_commands(help: &str, word_count: usize) -> Vec<String> {
    let is_word = |word: &&str| word.starts_with(|letter: char| letter.is_ascii_lowercase());
    let words_of =
        |line: &str| line.split([' ', ':']).take_while(is_word).take(word_count).collect::<Vec<_>>().join(" ");
    help.lines().skip(1).map(words_of).filter(|words| !words.is_empty()).collect()
}

/// docs/commands.txt has the help of every command, and the settings as they leave the factory.
#[test]
fn the_list_of_commands_is_the_help_of_the_console() {
    let mut rig = table1_rig();
    let mut help_of = |topic: &str| answer(&mut rig, &format!("help {topic}"));
    let mut text = "> help COMMAND\n".to_owned();
    for first_word in helped_commands(&help_of(""), 1) {
        let below = helped_commands(&help_of(&first_word), 2).into_iter();
        let below: Vec<_> = below.filter(|command| command.starts_with(&format!("{first_word} "))).collect();
        for command in if below.is_empty() { vec![first_word] } else { below } {
            text.push_str(help_of(&command).strip_prefix("ok ").unwrap().replace('\n', "\n    ").as_str());
            text.push('\n');
        }
    }
    text.push_str("\n> status all\n...\n");
    let status = full_status(&mut rig);
    let settings = status.lines().skip_while(|line| !line.starts_with("stream: "));
    for line in settings.take_while(|line| !line.starts_with("field model: ")) {
        text.push_str(line);
        text.push('\n');
    }
    documents::assert_document_is("docs/commands.txt", &text);
}
