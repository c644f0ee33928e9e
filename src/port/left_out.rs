//! A protocol that this firmware was built without.

use super::{Facts, Heard, Output, Protocol};
use crate::calibration::Calibration;
use crate::time::Timestamp;

/// Stands where a protocol is that was left out: says nothing and hears nothing.
#[derive(Debug, Default)]
pub struct LeftOut;

impl LeftOut {
    /// Nothing.
    #[must_use]
    pub const fn new() -> Self {
        Self
    }

    /// None that would be told.
    #[must_use]
    pub const fn has_not_seen(&self, _calibration: &Calibration) -> bool {
        false
    }
}

impl Protocol for LeftOut {
    fn byte(&mut self, _at: Timestamp, _byte: u8) -> Option<Heard> {
        None
    }

    fn is_armed(&self, _now: Timestamp) -> Option<bool> {
        None
    }

    fn rejected(&self) -> u32 {
        0
    }

    fn poll(&mut self, _facts: &Facts<'_>, _out: &mut Output) {}
}

/// Of whichever protocols this firmware was built with: .ci/run builds and tests it with one of them alone, too.
#[cfg(test)]
mod tests {
    use crate::frames::Field;
    use crate::instrument::Estimate;
    use crate::port::{Port, tests::facts};
    use crate::settings::{ProtocolKind, Settings};
    use crate::time::Timestamp;

    /// HEARTBEAT of an ArduPilot of system 1, and the answer of an INAV to MSP_FC_VARIANT.
    const MAVLINK: &[u8] = &[0xFD, 9, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 2, 3, 81, 4, 3, 0xE7, 0x1E];
    const MSP: &[u8] = b"$X>\x00\x02\x00\x04\x00INAV\x94";

    /// What is said in two seconds on a port that hears nothing.
    fn said(port: &mut Port, from_ms: u64) -> Vec<u8> {
        let mut said = Vec::new();
        for ms in (from_ms..from_ms + 2_000).step_by(12) {
            let estimate = Estimate {
                at: Timestamp::from_us(ms * 1_000),
                compass: Some(Field::from_ut(20.0, 0.0, 40.0)),
                ..Estimate::NOTHING
            };
            port.poll(&facts(&estimate, &Settings::DEFAULT));
            said.extend_from_slice(port.output.pending());
            port.output.written(usize::MAX);
        }
        said
    }

    fn contains(said: &[u8], part: &[u8]) -> bool {
        said.windows(part.len()).any(|window| window == part)
    }

    /// Whatever was chosen, only what is there is spoken, and found; what is there is as ever.
    #[test]
    fn a_port_speaks_what_there_is() {
        for chosen in ProtocolKind::ALL {
            let mut port = Port::new(ProtocolKind::Nmea, ProtocolKind::Auto, Timestamp::START);
            port.choose(chosen);
            let in_force = port.spoken(Timestamp::START);
            assert!(
                in_force.is_here()
                    && in_force == Port::new(chosen, ProtocolKind::Auto, Timestamp::START).spoken(Timestamp::START),
                "{chosen:?}"
            );
            assert_eq!(in_force == chosen, chosen.is_here(), "{chosen:?}");
            let searches = in_force == ProtocolKind::Auto;
            for (kind, frame) in [(ProtocolKind::Mavlink, MAVLINK), (ProtocolKind::Msp, MSP)] {
                let mut port = Port::new(chosen, ProtocolKind::Auto, Timestamp::START);
                for &byte in frame {
                    let _ = port.byte(Timestamp::from_us(1), byte);
                }
                let found = if searches && kind.is_here() { kind } else { in_force };
                assert_eq!(port.spoken(Timestamp::from_us(1)), found, "{chosen:?}");
                let said = said(&mut port, 1);
                assert_eq!(
                    contains(&said, b"$X<"),
                    matches!(found, ProtocolKind::Msp | ProtocolKind::Auto) && ProtocolKind::Msp.is_here()
                );
                assert_eq!(contains(&said, b"$HCHDM"), found == ProtocolKind::Nmea);
                // The heartbeat of a component beside the autopilot.
                let speaks_mavlink = found == ProtocolKind::Mavlink && kind == ProtocolKind::Mavlink;
                assert_eq!(contains(&said, &[1, 158, 0, 0, 0]), speaks_mavlink, "{chosen:?} {kind:?}");
            }
        }
    }

    /// It is as it is delivered in what there is: nobody's first `status` is of what is not there.
    #[test]
    fn what_is_delivered_is_there() {
        for port in crate::settings::PortNumber::ALL {
            assert!(Settings::DEFAULT.ports.of(port).protocol.is_here());
        }
    }
}
