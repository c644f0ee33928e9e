//! Fuzz test of the console.

use autoswing_firmware::console::reply;
use autoswing_firmware::console::session::Session;
use autoswing_firmware::console::{Request, write_help};
use autoswing_module::settings::SETTINGS;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::{Index, select};

use crate::{PropertyResult, check_costly_property};

/// Output buffer of a session, bytes.
const OUTPUT_CAPACITY: usize = 2048;

/// Commands that are not of settings.
const COMMANDS: &[&str] = &[
    "help",
    "help cal",
    "help set port1",
    "version",
    "status",
    "cal",
    "cal start",
    "cal mark",
    "cal stop",
    "cal solve",
    "cal advise",
    "cal show",
    "cal clear",
    "cal undo",
    "cal abort",
    "stream",
    "set stream on",
    "set stream off",
    "set",
    "set align",
    "reboot",
];

/// Arguments that are not of settings, and numbers at and beyond ranges.
const ARGUMENTS: &[&str] = &[
    "flight",
    "turns",
    "level",
    "swing",
    "tumble",
    "again",
    "all",
    "yes",
    "four-ellipse",
    "12.5",
    "-3",
    "1e9",
    "255",
    "256",
    "-0.0000000000001",
];

/// Keys, and beginnings and ends of key sequences.
const KEYS: &[&str] = &[
    " ",
    " ",
    "\r",
    "\r\n",
    "\n",
    "\t",
    "\t\t",
    "\x08",
    "\x7f",
    "\x1b[A",
    "\x1b[B",
    "\x1b[C",
    "\x1b[D",
    "\x1b[H",
    "\x1bOF",
    "\x1b[3~",
    "\x1b[99999;5~",
    "\x1b[",
    "\x1b",
    "\x01",
    "\x05",
    "\x15",
    "\x03",
    "\u{e9}",
    "\0",
];

/// A command with up to three words or numbers that commands take, fitting or not.
fn typed_command() -> impl Strategy<Value = String> {
    let of_settings = SETTINGS.iter().map(|setting| format!("set {}", setting.command_word));
    let commands: Vec<String> = COMMANDS.iter().map(|words| (*words).to_owned()).chain(of_settings).collect();
    let words = SETTINGS.iter().flat_map(|setting| (0..).map_while(|index| setting.nth_word(index)));
    let arguments: Vec<&str> = words.map(|(word, _)| word).chain(ARGUMENTS.iter().copied()).collect();
    (select(commands), vec(select(arguments), 0..4))
        .prop_map(|(command, arguments)| format!("{command} {}", arguments.join(" ")))
}

/// Typed parts, and whether the output is sent after each.
fn typed_parts() -> impl Strategy<Value = Vec<(Vec<u8>, bool)>> {
    let line = typed_command().prop_map(|command| format!("{command}\r").into_bytes());
    let beginning = (typed_command(), any::<Index>(), any::<bool>()).prop_map(|(command, length, is_upper)| {
        let beginning = &command[..length.index(command.len())];
        if is_upper { beginning.to_ascii_uppercase().into_bytes() } else { beginning.as_bytes().to_vec() }
    });
    let key = select(KEYS).prop_map(|key| key.as_bytes().to_vec());
    let noise = vec(any::<u8>(), 0..12);
    let typed_part = prop_oneof![3 => line, 3 => beginning, 8 => key, 1 => noise];
    vec((typed_part, any::<bool>()), 0..40)
}

/// Feeds bytes to a session and returns the last request.
fn feed_bytes(session: &mut Session, bytes: &[u8]) -> Result<Option<Request>, TestCaseError> {
    let mut last = None;
    for &byte in bytes {
        match session.process_byte(byte) {
            Some(Ok(request)) => {
                if let Request::Help(help_topic) = request {
                    session.write_reply(|reply| write_help(reply, help_topic));
                } else {
                    session.write_reply(reply::write_version);
                }
                last = Some(request);
            }
            Some(Err(error)) => {
                let text = error.to_string();
                prop_assert!(!text.is_empty() && text.bytes().all(|byte| (b' '..=b'~').contains(&byte)), "{text:?}");
                session.write_reply(|reply| reply::write_line_error(reply, &error));
            }
            None => {}
        }
        prop_assert!(session.pending_output().len() <= OUTPUT_CAPACITY);
    }
    Ok(last)
}

/// Output consists of printable characters, line ends, backspaces and erase sequences. After two Ctrl-C, of which the
/// first may end a key sequence, a command is understood.
#[test]
fn the_console_accepts_any_input() {
    check_costly_property(typed_parts(), |parts| -> PropertyResult {
        let mut session = Session::new(reply::write_version);
        for (typed_part, is_sent) in &parts {
            let _ = feed_bytes(&mut session, typed_part)?;
            if *is_sent {
                let strange = |byte: &&u8| !matches!(byte, b' '..=b'~' | b'\r' | b'\n' | 0x08 | 0x1B);
                prop_assert_eq!(session.pending_output().iter().find(strange), None);
                session.clear_output();
            }
        }
        let last = feed_bytes(&mut session, b"\x03\x03version\r")?;
        prop_assert!(matches!(last, Some(Request::Version)), "{last:?}");
        Ok(())
    });
}
