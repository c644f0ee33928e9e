//! Fuzz test of the console.

use autoswing_firmware::console::reply;
use autoswing_firmware::console::session::Session;
use autoswing_firmware::console::{Request, write_help};
use proptest::collection::vec;
use proptest::prelude::*;

use crate::{PropertyResult, check_property};

/// Output buffer of a session, bytes.
const OUTPUT_CAPACITY: usize = 2048;

/// Words of the command language, keys, and beginnings and ends of key sequences.
const TYPED_TEXTS: &[&str] = &[
    "help",
    "version",
    "status",
    "cal",
    "start",
    "auto",
    "mark",
    "stop",
    "solve",
    "advise",
    "show",
    "clear",
    "all",
    "undo",
    "stream",
    "on",
    "off",
    "rate",
    "heading",
    "raw",
    "set",
    "declination",
    "mount",
    "yaw90",
    "inclination",
    "align",
    "none",
    "yes",
    "attitude-error",
    "default",
    "accuracy",
    "port1",
    "msp",
    "baud2",
    "57600",
    "vision",
    "reboot",
    "again",
    " ",
    " ",
    " ",
    " ",
    " ",
    "12.5",
    "-3",
    "1e9",
    "255",
    "256",
    "-0.0000000000001",
    "\r",
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

/// Typed parts, and whether the output is sent after each.
fn typed_parts() -> impl Strategy<Value = Vec<(Vec<u8>, bool)>> {
    let word = proptest::sample::select(TYPED_TEXTS).prop_map(|word| word.as_bytes().to_vec());
    let upper = proptest::sample::select(TYPED_TEXTS).prop_map(|word| word.to_ascii_uppercase().into_bytes());
    let noise = vec(any::<u8>(), 0..12);
    let typed_part = prop_oneof![12 => word, 2 => upper, 1 => noise];
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
    check_property(typed_parts(), |parts| -> PropertyResult {
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
