use super::*;
use autoswing::calibration::method_selection::Procedure;
use autoswing::calibration::{Method, Orientation};
use autoswing_module::compass::AutopilotAction;
use autoswing_module::settings::SettingValue::{Key, Number};
use autoswing_module::settings::{SETTINGS, SettingChange};

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

/// The reply, whose lines fit a terminal of 79 columns, without the breaks between words.
fn help_reply(line: &str) -> String {
    let Some(Ok(Request::Help(topic))) = parse_request(line) else { panic!("{line}") };
    let mut text = String::new();
    write_help(&mut text, topic).unwrap();
    assert!(text.lines().all(|line| line.len() <= 79), "{text}");
    text.replace("\n  ", " ")
}

fn signing_key(passphrase: Option<&str>) -> SettingChange {
    let signing = Setting::from_parameter_name(b"SIGNING").unwrap();
    signing.change_to(Key(passphrase.map(key_from_passphrase))).unwrap()
}

#[test]
fn every_command_is_parsed() {
    let set = Command::Set;
    let examples = [
        ("cal start", Command::CalStart(Procedure::Flight)),
        ("cal start turns", Command::CalStart(Procedure::Turns)),
        ("cal start tumble", Command::CalStart(Procedure::Tumble)),
        ("cal start again", Command::CalStartNew(None)),
        ("cal start turns again", Command::CalStartNew(Some(Procedure::Turns))),
        ("cal mark 12.5", Command::CalMark(12.5)),
        ("cal stop", Command::CalStop),
        ("cal solve", Command::CalSolve(None)),
        ("cal solve four-ellipse", Command::CalSolve(Some(Method::FourEllipse))),
        ("cal advise", Command::CalAdvise),
        ("cal clear all", Command::CalClear),
        ("cal undo", Command::CalUndo),
        ("cal abort", Command::CalAbort),
        ("autopilot check", Command::Autopilot(AutopilotAction::Check)),
        ("autopilot setup", Command::Autopilot(AutopilotAction::Check)),
        ("autopilot setup yes", Command::Autopilot(AutopilotAction::Setup)),
        ("autopilot undo", Command::Autopilot(AutopilotAction::Undo)),
        ("autopilot restart", Command::Autopilot(AutopilotAction::Restart)),
        ("set align 90", Command::Align(Some(90.0))),
        ("set align none", Command::Align(None)),
        ("set align 90.5 yes", Command::AlignConfirmed(90.5)),
        ("set signing off", set(signing_key(None))),
        ("set signing 4711", set(signing_key(Some("4711")))),
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
    for row in all_commands()
        .filter(|row| matches!(row, ConsoleCommand::Own(CommandSpec { command_form: CommandForm::Request(..), .. })))
    {
        let words = row.words().join(" ");
        let mut tested_lines = examples.iter().map(|(line, _)| *line).chain(others.map(|(line, _)| line));
        assert!(tested_lines.any(|line| line.to_ascii_lowercase().starts_with(words.trim_end())), "{words}");
    }
    assert!(parse_request("").is_none() && parse_request("   ").is_none());
}

/// Every setting: its command is listed, explained and completed, and takes its words and the ends of its range.
#[test]
fn every_setting_has_a_command() {
    for setting in SETTINGS.iter().filter(|setting| !setting.command_word.is_empty()) {
        let (first, second) = ("set", setting.command_word);
        let command = find_command([first, second]).unwrap();
        assert!(help_reply(&format!("help {first}")).contains(&format!("\n{command}: ")), "{command}");
        assert!(help_reply(&format!("help {first} {second}")).contains("\nVALUE: "));
        let mut completed = Vec::new();
        complete_line(&format!("{first} {second}"), &mut |word| completed.push(word));
        assert!(completed.contains(&second), "{command}: {completed:?}");
        let ends = setting.range.map(|number| (number.to_string(), Number(Some(number))));
        let ends = ends.into_iter().filter(|_| !setting.unit.is_empty());
        let words = (0..).map_while(|index| setting.nth_word(index)).map(|(word, value)| (word.to_owned(), value));
        for (typed, value) in ends.chain(words) {
            let change = setting.change_to(value).unwrap();
            assert_eq!(parsed_command(&format!("{first} {second} {typed}")), Command::Set(change), "{command} {typed}");
        }
    }
}

/// A passphrase is not changed to lower case: ground stations derive the key from it as typed.
#[test]
fn a_passphrase_keeps_its_case() {
    for passphrase in ["aBc", "abc"] {
        let line = format!("set signing {passphrase}");
        let expected = signing_key(Some(passphrase));
        assert!(
            matches!(parse_request(&line), Some(Ok(Request::Command(Command::Set(setting)))) if setting == expected)
        );
    }
}

#[test]
fn an_error_names_the_expected_argument() {
    for (line, complaint) in [
        ("frobnicate", "unknown-command: unknown command; help lists all"),
        ("statsu", "unknown-command: unknown command; did you mean status?"),
        ("CALL start", "unknown-command: unknown command; did you mean cal?"),
        ("set atitude-error 1", "unknown-command: unknown command; did you mean set attitude-error?"),
        ("help set stream-raate", "unknown-command: unknown command; did you mean set stream-rate?"),
        ("stream off", "unknown-command: unknown command; did you mean set stream?"),
        ("set frequency 5", "unknown-command: after set expected a word that help set lists"),
        ("autopilot fast", "unknown-command: after autopilot expected check, setup, undo or restart"),
        ("AUTOPILOT", "missing-argument: after autopilot expected check, setup, undo or restart"),
        ("help autopilot fast", "unknown-command: after autopilot expected check, setup, undo or restart"),
        ("help set stream-rate 5", "unexpected-argument: too many words; it is set stream-rate VALUE"),
        ("help help me", "unexpected-argument: too many words; it is help"),
        ("version 1", "unexpected-argument: too many words; it is version"),
        ("cal start level now", "bad-value: expected again"),
        ("cal start level again now", "unexpected-argument: too many words; it is cal start [PROCEDURE] [again]"),
        ("set attitude-error default 1", "unexpected-argument: too many words; it is set attitude-error VALUE"),
        ("cal start sideways", "bad-value: expected flight, turns, level, swing, tumble or again"),
        ("set baud2 9600", "bad-value: expected 57600, 115200, 230400 or 460800"),
        ("set heading smoot", "bad-value: expected raw or smooth"),
        ("cal mark north", "bad-value: expected a number, 0 to 360 deg"),
        ("set declination default", "bad-value: expected a number, -180 to 180 deg, or none"),
        ("set gyro-error much", "bad-value: expected a number, 0.1 to 20 %, or default"),
        ("set stream-rate", "missing-argument: <VALUE> is missing; expected a whole number, 1 to 80 Hz, or default"),
        ("set stream-rate 300", "bad-value: expected a whole number, 1 to 80 Hz, or default"),
        ("set align 90 no", "bad-value: expected yes"),
        ("set align none yes", "unexpected-argument: too many words; it is set align HEADING [yes]"),
        (
            "set signing",
            "missing-argument: <VALUE> is missing; expected one word, upper and lower case differ, such as \
             Heron-4711, or off",
        ),
        ("cal clear", "needs-word: this cannot be undone; type cal clear all"),
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
fn help_explains_everything_there_is() {
    let all = help_reply("help");
    for row in all_commands() {
        let words = row.words().join(" ");
        let reply = help_reply(&format!("help {words}"));
        assert!(reply.starts_with(&format!("ok {}", words.trim_end())), "{reply}");
        assert!(reply.contains(row.help_text()), "{reply}");
        let [first, second] = row.words();
        let group = if second.is_empty() { all.clone() } else { help_reply(&format!("help {first}")) };
        assert!(group.starts_with("ok ") && group.contains(&format!("\n{row}: {}", row.help_text())), "{row}: {group}");
    }
    assert_eq!(
        help_reply("HELP Autopilot").lines().take(2).collect::<Vec<_>>(),
        [
            "ok autopilot: the autopilot's parameters, by MAVLink",
            "autopilot check: compare its compass and its parameters with what the module needs"
        ]
    );
    let mounts = help_reply("help set mount");
    assert!(Orientation::all_orientations().all(|mount| mounts.contains(mount.orientation_name())), "{mounts}");
    assert_eq!(help_reply("help heading"), help_reply("help set heading"));
    assert!(help_reply("help set inclination").ends_with("VALUE: a number, -90 to 90 deg, or none\n"));
}

#[test]
fn partial_words_are_completed() {
    for (line, rest, fit) in [
        ("", "", 7),
        ("v", "ersion", 1),
        ("VER", "sion", 1),
        ("version", "", 1),
        ("st", "atus", 1),
        ("x", "", 0),
        ("cal", "", 1),
        ("cal ", "", 9),
        ("cal so", "lve", 1),
        ("cal st", "", 2),
        ("CAL START ", "", 6),
        ("cal start turns ", "again", 1),
        ("cal solve m", "aximum-likelihood", 1),
        ("cal clear ", "all", 1),
        ("cal nonsense ", "", 0),
        ("set att", "itude", 3),
        ("set attitude-error d", "efault", 1),
        ("set attitude-error 1 d", "", 0),
        ("set mount roll180-p", "itch", 2),
        ("  set   mount   no", "ne", 1),
        ("set align 90 ", "yes", 1),
        ("help set h", "eading", 1),
        ("help set heading r", "", 0),
    ] {
        let mut offered = 0;
        let found = complete_line(line, &mut |_| offered += 1);
        assert_eq!((found, offered), (Completion { continuation: rest, match_count: fit }, fit), "{line:?}");
    }
}
