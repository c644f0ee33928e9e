use super::*;
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{Method, Orientation};
use autoswing_module::compass::Command;
use autoswing_module::settings::{AttitudeError, HeadingKind, SensorError, SettingChange};
use autoswing_module::settings::{BaudRate, PortNumber, ProtocolKind};

fn parsed_command(line: &str) -> Command {
    match parse_request(line) {
        Some(Ok(Request::Command(command))) => command,
        other => panic!("{line}: {other:?}"),
    }
}

fn rejection_text(line: &str) -> String {
    match parse_request(line) {
        Some(Err(error)) => format!("{}: {error}", error.stable_code()),
        other => panic!("{line}: {other:?}"),
    }
}

fn help_reply(line: &str) -> String {
    let Some(Ok(Request::Help(topic))) = parse_request(line) else { panic!("{line}") };
    let mut text = String::new();
    write_help(&mut text, topic).unwrap();
    text
}

#[test]
fn every_command_is_parsed() {
    let yaw90 = Orientation::from_name("yaw90").unwrap();
    let error = |bias_deg, bank_percent| SettingChange::AttitudeError(AttitudeError { bias_deg, bank_percent });
    let set = Command::Set;
    let examples = [
        ("cal start", Command::CalStart(Procedure::Flight)),
        ("cal start turns", Command::CalStart(Procedure::Turns)),
        ("cal start tumble", Command::CalStart(Procedure::Tumble)),
        ("cal start again", Command::CalStartNew(None)),
        ("cal start turns again", Command::CalStartNew(Some(Procedure::Turns))),
        ("cal auto on", set(SettingChange::Auto(true))),
        ("cal auto off", set(SettingChange::Auto(false))),
        ("cal mark 12.5", Command::CalMark(12.5)),
        ("cal stop", Command::CalStop),
        ("cal solve", Command::CalSolve(None)),
        ("cal solve two-plane", Command::CalSolve(Some(Method::TwoPlane))),
        ("cal advise", Command::CalAdvise),
        ("cal clear all", Command::CalClear),
        ("cal undo", Command::CalUndo),
        ("cal abort", Command::CalAbort),
        ("stream on", set(SettingChange::StreamOn(true))),
        ("stream off", set(SettingChange::StreamOn(false))),
        ("stream rate 25", set(SettingChange::StreamRateHz(25))),
        ("stream heading raw", set(SettingChange::StreamHeading(HeadingKind::Raw))),
        ("set declination -3.5", set(SettingChange::Declination(Some(-3.5)))),
        ("set declination none", set(SettingChange::Declination(None))),
        ("set mount yaw90", set(SettingChange::Mount(yaw90))),
        ("set inclination 61", set(SettingChange::Inclination(Some(61.0)))),
        ("set inclination none", set(SettingChange::Inclination(None))),
        ("set align 90", Command::Align(Some(90.0))),
        ("set align none", Command::Align(None)),
        ("set align 90.5 yes", Command::AlignConfirmed(90.5)),
        ("set attitude-error 0.5 2", set(error(0.5, 2.0))),
        ("set accuracy 0.7", set(SettingChange::Accuracy(0.7))),
        ("set port1 mavlink", set(SettingChange::Protocol(PortNumber::One, ProtocolKind::Mavlink))),
        ("set port2 msp", set(SettingChange::Protocol(PortNumber::Two, ProtocolKind::Msp))),
        ("set baud1 460800", set(SettingChange::Baud(PortNumber::One, BaudRate::B460800))),
        ("set baud2 57600", set(SettingChange::Baud(PortNumber::Two, BaudRate::B57600))),
        ("set vision on", set(SettingChange::Vision(true))),
        ("set vision off", set(SettingChange::Vision(false))),
        ("set attitude-rate 50", set(SettingChange::AttitudeRateHz(50))),
        ("set can-node 42", set(SettingChange::CanNode(42))),
        ("set can-rate 20", set(SettingChange::CanRateHz(20))),
        ("set can-covariance on", set(SettingChange::CanCovariance(true))),
        ("set can-termination on", set(SettingChange::CanTermination(true))),
        ("set signing off", set(SettingChange::Signing(None))),
        ("set signing 4711", set(SettingChange::Signing(Some(key_from_passphrase("4711"))))),
        (
            "set sensor-error 5 0.5",
            set(SettingChange::SensorError(SensorError { gyro_percent: 5.0, drift_percent: 0.5 })),
        ),
        ("set sensor-error default", set(SettingChange::SensorError(SensorError::DEFAULT))),
        ("set attitude-error default", set(SettingChange::AttitudeError(AttitudeError::DEFAULT))),
    ];
    for (line, meaning) in examples {
        assert_eq!(parsed_command(line), meaning, "{line}");
        // Commands are accepted in upper case and with extra spaces.
        assert_eq!(parsed_command(&line.to_ascii_uppercase()), meaning, "{line}");
        assert_eq!(parsed_command(&format!("  {}  ", line.replace(' ', "   "))), meaning, "{line}");
    }
    let others = [
        ("version", "Version"),
        ("STATUS", "Command(Status)"),
        ("status all", "Command(StatusAll)"),
        ("Cal Show", "Command(CalShow)"),
        ("reboot", "Command(Restart)"),
        ("help", "Help"),
    ];
    for (line, name) in others {
        let Some(Ok(request)) = parse_request(line) else { panic!("{line}") };
        assert!(format!("{request:?}").starts_with(name), "{request:?}");
    }
    for row in COMMANDS.iter().filter(|row| row.request_constructor.is_some()) {
        let words = row.command_words.join(" ");
        let mut tested_lines = examples.iter().map(|(line, _)| *line).chain(others.map(|(line, _)| line));
        assert!(tested_lines.any(|line| line.to_ascii_lowercase().starts_with(words.trim_end())), "{words}");
    }
    assert!(parse_request("").is_none() && parse_request("   ").is_none());
}

/// A passphrase is not changed to lower case: ground stations derive the key from it as typed.
#[test]
fn a_passphrase_keeps_its_case() {
    for passphrase in ["aBc", "abc"] {
        let line = format!("set signing {passphrase}");
        let expected = SettingChange::Signing(Some(key_from_passphrase(passphrase)));
        assert!(
            matches!(parse_request(&line), Some(Ok(Request::Command(Command::Set(setting)))) if setting == expected)
        );
    }
}

#[test]
fn an_error_names_the_expected_argument() {
    for (line, complaint) in [
        ("frobnicate", "unknown-command: unknown command; help lists all"),
        ("stream fast", "unknown-command: after stream expected on, off, rate or heading"),
        ("STREAM", "missing-argument: after stream expected on, off, rate or heading"),
        ("help frobnicate", "unknown-command: unknown command; help lists all"),
        ("help stream fast", "unknown-command: after stream expected on, off, rate or heading"),
        ("help stream rate 5", "unexpected-argument: too many words; it is stream rate HZ"),
        ("help help me", "unexpected-argument: too many words; it is help"),
        ("help version 1", "unexpected-argument: too many words; it is version"),
        ("version 1", "unexpected-argument: too many words; it is version"),
        ("cal start level now", "bad-value: expected again"),
        ("cal start level again now", "unexpected-argument: too many words; it is cal start [PROCEDURE] [again]"),
        ("set attitude-error default 1", "unexpected-argument: too many words; it is set attitude-error DEG PERCENT"),
        ("cal start sideways", "bad-value: expected flight, turns, level, swing, tumble or again"),
        ("set port1 can", "bad-value: expected auto, mavlink, msp or nmea"),
        ("set baud2 9600", "bad-value: expected 57600, 115200, 230400 or 460800"),
        ("cal auto maybe", "bad-value: expected on or off"),
        ("stream heading smoothed", "bad-value: expected raw or smooth"),
        ("stream heading smoot", "bad-value: expected raw or smooth"),
        ("cal mark north", "bad-value: expected a number, 0 to 360 deg"),
        ("cal mark 1e2", "bad-value: expected a number, 0 to 360 deg"),
        ("set declination east", "bad-value: expected a number, -180 to 180 deg, or none"),
        ("set declination default", "bad-value: expected a number, -180 to 180 deg, or none"),
        ("set inclination x", "bad-value: expected a number, -90 to 90 deg, or none"),
        ("set attitude-error much 1", "bad-value: expected a number, 0 to 5 deg, or default"),
        ("set attitude-error 1 much", "bad-value: expected a number, 0 to 20 %"),
        ("set attitude-error 1", "missing-argument: <PERCENT> is missing; expected a number, 0 to 20 %"),
        ("set sensor-error much 1", "bad-value: expected a number, 0.1 to 20 %, or default"),
        ("set sensor-error 1", "missing-argument: <DRIFT> is missing; expected a number, 0.05 to 5 % of the field"),
        ("stream rate", "missing-argument: <HZ> is missing; expected a whole number, 1 to 80 a second"),
        ("stream rate 300", "bad-value: expected a whole number, 1 to 80 a second"),
        ("stream rate 2.5", "bad-value: expected a whole number, 1 to 80 a second"),
        ("stream rate -1", "bad-value: expected a whole number, 1 to 80 a second"),
        ("set align 90 no", "bad-value: expected yes"),
        ("set align none yes", "unexpected-argument: too many words; it is set align HEADING [yes]"),
        (
            "set signing",
            "missing-argument: <PASSPHRASE> is missing; expected one word, upper and lower case differ, such as \
             Heron-4711, or off",
        ),
        ("status twice", "bad-value: expected all"),
        ("cal clear", "needs-word: this cannot be undone; type cal clear all"),
        ("cal clear everything", "needs-word: this cannot be undone; type cal clear all"),
    ] {
        assert_eq!(rejection_text(line), complaint, "{line}");
    }
    assert_eq!(LineError::TooLong.to_string(), "a line holds 64 characters");
    assert_eq!(LineError::TooLong.stable_code(), "line-too-long");
    let mounts = rejection_text("set mount sideways");
    assert!(
        mounts.starts_with("bad-value: expected none, yaw90, ") && mounts.ends_with(" or roll90-yaw270"),
        "{mounts}"
    );
    assert!(Orientation::all_orientations().all(|mount| mounts.contains(mount.orientation_name())), "{mounts}");
}

#[test]
fn a_range_is_shown_with_all_its_digits() {
    let kind = ArgumentKind::Number { range: 0.25..=7.5, unit: "deg", alternative: None };
    let slot = ArgumentSpec { argument_name: "DEG", argument_kind: kind, is_optional: false };
    assert_eq!(slot.to_string(), "a number, 0.25 to 7.5 deg");
}

#[test]
fn help_explains_everything_there_is() {
    let all = help_reply("help");
    for row in COMMANDS {
        let words = row.command_words.join(" ");
        let reply = help_reply(&format!("help {words}"));
        assert!(reply.starts_with(&format!("ok {}", words.trim_end())), "{reply}");
        assert!(reply.contains(row.help_text), "{reply}");
        let [first, second] = row.command_words;
        let group = if second.is_empty() { all.clone() } else { help_reply(&format!("help {first}")) };
        assert!(group.starts_with("ok ") && group.contains(&format!("\n{row}: {}", row.help_text)), "{row}: {group}");
    }
    assert_eq!(
        help_reply("HELP Stream"),
        "ok stream: heading sentences: on, off, rate, heading\n\
         stream on: send them\n\
         stream off: do not send them\n\
         stream rate HZ: sentences per second\n\
         stream heading KIND: heading sent: smoothed by the body rates, or raw for an autopilot with its own filter\n"
    );
    let mounts = help_reply("help set mount");
    assert!(Orientation::all_orientations().all(|mount| mounts.contains(mount.orientation_name())), "{mounts}");
    assert!(help_reply("help set inclination").ends_with("DEG: a number, -90 to 90 deg, or none\n"));
}

#[test]
fn partial_words_are_completed() {
    for (line, rest, fit) in [
        ("", "", 7),
        ("v", "ersion", 1),
        ("VER", "sion", 1),
        ("version", "", 1),
        ("version ", "", 0),
        ("s", "", 3),
        ("st", "", 2),
        ("sta", "tus", 1),
        ("x", "", 0),
        ("cal", "", 1),
        ("cal ", "", 10),
        ("cal so", "lve", 1),
        ("cal s", "", 4),
        ("cal st", "", 2),
        ("CAL START ", "", 6),
        ("cal auto o", "", 2),
        ("cal start tu", "", 2),
        ("cal start tur", "ns", 1),
        ("cal start turns ", "again", 1),
        ("cal solve m", "aximum-likelihood", 1),
        ("cal clear ", "all", 1),
        ("cal nonsense ", "", 0),
        ("stream heading s", "mooth", 1),
        ("set att", "itude-", 2),
        ("set attitude-error d", "efault", 1),
        ("set attitude-error 1 d", "", 0),
        ("set declination n", "one", 1),
        ("set mount roll180-p", "itch", 2),
        ("set mount roll27", "0", 5),
        ("  set   mount   no", "ne", 1),
        ("set align 90 ", "yes", 1),
        ("help s", "", 3),
        ("help str", "eam", 1),
        ("help stream h", "eading", 1),
        ("help stream heading r", "", 0),
        ("stream rate ", "", 0),
    ] {
        let mut offered = 0;
        let found = complete_line(line, &mut |_| offered += 1);
        assert_eq!((found, offered), (Completion { continuation: rest, match_count: fit }, fit), "{line:?}");
    }
}

/// Random lines: no panic, and each error is one line of printable characters.
#[test]
fn no_line_stops_the_parser() {
    let mut random = testkit::random::Random(5);
    let words: Vec<&str> = COMMANDS
        .iter()
        .flat_map(|row| row.command_words)
        .chain(["none", "default", "all", "-1", "360.5", "", "\u{e9}"])
        .collect();
    for _ in 0..20_000 {
        let mut line = String::new();
        for _ in 0..random.byte() % 5 {
            let mut word = words[usize::from(random.byte()) % words.len()].to_owned();
            if random.byte() < 60 {
                word.push(char::from(random.byte()));
            }
            line += &word;
            line.push(' ');
        }
        line.truncate(
            (0..=line.len() - usize::from(random.byte() % 3).min(line.len()))
                .rfind(|&n| line.is_char_boundary(n))
                .unwrap(),
        );
        complete_line(&line, &mut |_| {});
        if let Some(Err(error)) = parse_request(&line) {
            let text = error.to_string();
            assert!(!text.is_empty() && text.bytes().all(|byte| (b' '..=b'~').contains(&byte)), "{text:?}");
        }
    }
}
