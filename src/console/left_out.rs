//! What the console says of protocols that this firmware was built without. The tests hold for any choice of them; .ci/run
//! has them in a firmware with one alone, too.

use super::language::{complete, help, parse};
use super::words::ROWS;
use super::{LineError, Request};
use crate::compass::Command;
use crate::settings::{PortNumber, ProtocolKind, Setting};

/// Everything that is only of one protocol: commands with words after them.
const OF_ONE: [(&str, ProtocolKind); 2] =
    [("set vision on", ProtocolKind::Mavlink), ("stream rate 5", ProtocolKind::Nmea)];

fn words_after(line: &str) -> Vec<&'static str> {
    let mut words = Vec::new();
    complete(line, &mut |word| words.push(word));
    words
}

fn assert_left_out(line: &str, kind: ProtocolKind) {
    let Some(Err(error @ LineError::LeftOut(of))) = parse(line) else { panic!("{line}") };
    assert_eq!((of, error.code()), (kind, "not-in-firmware"), "{line}");
    assert_eq!(error.to_string(), format!("this firmware was built without {}", kind.name()));
}

#[test]
fn a_port_is_set_to_what_there_is() {
    for kind in ProtocolKind::ALL {
        let line = format!("set port1 {}", kind.name().to_uppercase());
        assert_eq!(words_after("set port1 ").contains(&kind.name()), kind.is_here(), "{line}");
        if kind.is_here() {
            let Some(Ok(Request::Compass(Command::Set(setting)))) = parse(&line) else { panic!("{line}") };
            assert_eq!(setting, Setting::Protocol(PortNumber::One, kind));
        } else {
            assert_left_out(&line, kind);
        }
    }
    // What is no protocol is a mistake of another kind.
    assert!(matches!(parse("set port1 can"), Some(Err(LineError::BadValue(_)))));
    assert!(matches!(
        parse("stream heading msp"),
        Some(Err(LineError::BadValue(_) | LineError::LeftOut(ProtocolKind::Nmea)))
    ));
}

#[test]
fn a_setting_of_a_protocol_is_there_with_it() {
    for (line, kind) in OF_ONE {
        let (command, _) = line.rsplit_once(' ').unwrap();
        let (first, second) = command.split_once(' ').unwrap();
        let mut all = String::new();
        let group = ROWS.iter().find(|row| row.words == [first, ""]).unwrap();
        help(&mut all, Some(group)).unwrap();
        assert_eq!(words_after(&format!("{first} ")).contains(&second), kind.is_here(), "{line}");
        assert_eq!(all.contains(&format!("\n{command} ")), kind.is_here(), "{all}");
        if kind.is_here() {
            assert!(matches!(parse(line), Some(Ok(_))), "{line}");
        } else {
            assert_left_out(line, kind);
            assert!(words_after(&format!("{command} ")).is_empty());
            // Who knows neither heading in sentences nor MAVLink's named values has no stream at all.
            if kind == ProtocolKind::Mavlink || ProtocolKind::Mavlink.is_here() {
                assert_left_out(&format!("help {command}"), kind);
            }
        }
    }
    let streams = ProtocolKind::Mavlink.is_here() || ProtocolKind::Nmea.is_here();
    for line in ["stream on", "stream off", "stream heading raw", "help stream"] {
        assert_eq!(matches!(parse(line), Some(Ok(_))), streams, "{line}");
    }
    assert_eq!(words_after("").contains(&"stream"), streams);
    assert!(matches!(parse("help"), Some(Ok(Request::Help(None)))));
}
