//! A port: the protocols that it can speak, and which it does.

use super::{Facts, Heard, Mavlink, Msp, Nmea, Order, Output, Protocol};
use crate::calibration::Calibration;
use crate::compass::Refusal;
use crate::settings::ProtocolKind;
use crate::time::Timestamp;

/// A far end that says nothing that is understood for so long is searched anew, microseconds.
const SILENCE_US: u64 = 10_000_000;

/// A port. Whatever it speaks, it hears MAVLink: where sentences go out, attitude may come in.
#[derive(Debug)]
pub struct Port {
    chosen: ProtocolKind,
    found: Search,
    mavlink: Mavlink,
    msp: Msp,
    nmea: Nmea,
    /// What is to be written.
    pub output: Output,
}

/// What the far end was found to speak, and when it was heard to last.
#[derive(Clone, Copy, Debug)]
struct Search {
    /// `Auto` if nothing was.
    kind: ProtocolKind,
    at: Timestamp,
    /// Whether it was heard since the module started. What was found before that is spoken as if it had been, so that who is
    /// there still has nothing to wait for; and the first who is heard is believed.
    is_heard: bool,
}

impl Search {
    /// A frame of a protocol has come, that of another changes nothing while the one that was found is heard.
    fn hear(&mut self, kind: ProtocolKind, at: Timestamp) {
        if !self.is_heard || [kind, ProtocolKind::Auto].contains(&self.at(at)) {
            *self = Self { kind, at, is_heard: true };
        }
    }

    fn at(&self, now: Timestamp) -> ProtocolKind {
        if now.us_since(self.at) <= SILENCE_US { self.kind } else { ProtocolKind::Auto }
    }
}

impl Port {
    /// A port on which nothing was heard since the start, at this instant. Before it this was found there; `Auto` if nothing
    /// was.
    #[must_use]
    pub fn new(chosen: ProtocolKind, found: ProtocolKind, start: Timestamp) -> Self {
        Self {
            chosen: chosen.in_force(),
            found: Search { kind: found.in_force(), at: start, is_heard: false },
            mavlink: Mavlink::new(),
            msp: Msp::new(),
            nmea: Nmea::new(),
            output: Output::new(),
        }
    }

    /// Speaks this from now on; of a protocol that this firmware does not have, what stands in for it
    /// ([`ProtocolKind::in_force`]).
    pub fn choose(&mut self, chosen: ProtocolKind) {
        self.chosen = chosen.in_force();
    }

    /// What is spoken at this instant: of `auto`, what was found, or `auto` while it is searched.
    #[must_use]
    pub fn spoken(&self, now: Timestamp) -> ProtocolKind {
        match self.chosen {
            ProtocolKind::Auto => self.found.at(now),
            chosen => chosen,
        }
    }

    /// Takes a byte that came at an instant.
    pub fn byte(&mut self, at: Timestamp, byte: u8) -> Option<Heard> {
        // Until somebody is heard, whoever it is may be.
        let is_sure = self.found.is_heard || self.chosen != ProtocolKind::Auto;
        let spoken = if is_sure { self.spoken(at) } else { ProtocolKind::Auto };
        let by_msp =
            if matches!(spoken, ProtocolKind::Auto | ProtocolKind::Msp) { self.msp.byte(at, byte) } else { None };
        let by_mavlink = if spoken == ProtocolKind::Msp { None } else { self.mavlink.byte(at, byte) };
        if by_msp.is_some() {
            self.found.hear(ProtocolKind::Msp, at);
        }
        if by_mavlink.is_some() {
            self.found.hear(ProtocolKind::Mavlink, at);
        }
        by_mavlink.or(by_msp)
    }

    /// Whether the autopilot at the far end is armed, if it has said so lately.
    #[must_use]
    pub fn is_armed(&self, now: Timestamp) -> Option<bool> {
        self.mavlink.is_armed(now).or_else(|| self.msp.is_armed(now))
    }

    /// Frames that were broken or impossible; wraps.
    #[must_use]
    pub fn rejected(&self) -> u32 {
        self.mavlink.rejected().wrapping_add(self.msp.rejected())
    }

    /// Whether a calibration that is in use is to be told: it is another than was told last.
    #[must_use]
    pub fn has_not_seen(&self, calibration: &Calibration) -> bool {
        self.mavlink.has_not_seen(calibration)
    }

    /// Appends what is due to the output. While the far end is searched, MSP is spoken: an autopilot of that kind says
    /// nothing unless it is asked, and looks for its compass while it starts; one that speaks MAVLink passes it over. A
    /// firmware without MSP waits.
    pub fn poll(&mut self, facts: &Facts<'_>) {
        match self.spoken(facts.now) {
            ProtocolKind::Mavlink => self.mavlink.poll(facts, &mut self.output),
            ProtocolKind::Nmea => self.nmea.poll(facts, &mut self.output),
            ProtocolKind::Auto | ProtocolKind::Msp => self.msp.poll(facts, &mut self.output),
        }
    }

    /// What became of an order that came here.
    pub fn answer(&mut self, order: Order, result: Result<(), &Refusal>) {
        self.mavlink.answer(order, result);
    }

    /// Whether what it is set to speak may have a place for notes.
    #[must_use]
    pub fn has_notes(&self) -> bool {
        matches!(self.chosen, ProtocolKind::Auto | ProtocolKind::Mavlink)
    }

    /// A line for whoever looks at a ground station.
    pub fn note(&mut self, text: &str) {
        self.mavlink.note(text);
    }
}

#[cfg(all(feature = "mavlink", feature = "msp", feature = "nmea"))]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Source;
    use crate::instrument::Estimate;
    use crate::port::tests::facts;
    use crate::settings::Settings;
    use ::mavlink::dialects::common::{ATTITUDE_DATA, HEARTBEAT_DATA, MavAutopilot};
    use ::mavlink::{MAVLinkV2MessageRaw, MavHeader, MessageData};
    use crc::{CRC_8_DVB_S2, Crc};

    fn mavlink_frame(data: &impl MessageData) -> Vec<u8> {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message_data(MavHeader { system_id: 1, component_id: 1, sequence: 0 }, data);
        raw.raw_bytes().to_vec()
    }

    fn heartbeat_frame() -> Vec<u8> {
        mavlink_frame(&HEARTBEAT_DATA {
            autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            ..HEARTBEAT_DATA::default()
        })
    }

    /// The answer to MSP_FC_VARIANT.
    fn variant_frame(name: [u8; 4]) -> Vec<u8> {
        let checked = [&[0, 2, 0, 4, 0], &name[..]].concat();
        let crc = Crc::<u8>::new(&CRC_8_DVB_S2).checksum(&checked);
        [&b"$X>"[..], &checked, &[crc]].concat()
    }

    const fn at(ms: u64) -> Timestamp {
        Timestamp::from_us(ms * 1000)
    }

    fn hear(port: &mut Port, ms: u64, bytes: &[u8]) {
        for &byte in bytes {
            let _ = port.byte(at(ms), byte);
        }
    }

    /// What is sent at an instant.
    fn said(port: &mut Port, ms: u64) -> Vec<u8> {
        let estimate = Estimate { at: at(ms), ..Estimate::NOTHING };
        port.poll(&facts(&estimate, &Settings::DEFAULT));
        let said = port.output.pending().to_vec();
        port.output.written(usize::MAX);
        said
    }

    /// From both sides of ten seconds.
    #[test]
    fn auto_speaks_what_it_hears_until_it_hears_nothing() {
        for (frame, kind) in [(heartbeat_frame(), ProtocolKind::Mavlink), (variant_frame(*b"ARDU"), ProtocolKind::Msp)]
        {
            let mut port = Port::new(ProtocolKind::Auto, ProtocolKind::Auto, at(0));
            assert_eq!(port.spoken(at(0)), ProtocolKind::Auto);
            hear(&mut port, 5, &frame[..frame.len() - 1]);
            assert_eq!(port.spoken(at(5)), ProtocolKind::Auto, "half a frame is none");
            hear(&mut port, 6, &frame[frame.len() - 1..]);
            assert_eq!(port.spoken(at(6)), kind);
            assert_eq!(port.spoken(at(10_006)), kind);
            assert_eq!(port.spoken(at(10_007)), ProtocolKind::Auto);
            hear(&mut port, 20_000, &frame);
            assert_eq!(port.spoken(at(20_000)), kind);
        }
    }

    /// Frames of the other protocol on the line, a repeater's say, change nothing while the autopilot is heard; when it
    /// has fallen silent they do.
    #[test]
    fn what_was_found_stays_while_it_is_heard() {
        let (mavlink, msp) = (heartbeat_frame(), variant_frame(*b"INAV"));
        let mut port = Port::new(ProtocolKind::Auto, ProtocolKind::Auto, at(0));
        hear(&mut port, 0, &mavlink);
        for ms in (0..20_000).step_by(1000) {
            hear(&mut port, ms, &mavlink);
            hear(&mut port, ms + 1, &msp);
            assert_eq!(port.spoken(at(ms + 1)), ProtocolKind::Mavlink);
        }
        for ms in (20_000..30_001).step_by(1000) {
            hear(&mut port, ms, &msp);
        }
        assert_eq!(port.spoken(at(30_001)), ProtocolKind::Msp);
    }

    /// What was found before the restart is spoken from the first instant; to both sides of ten seconds without a word, then
    /// it is searched. Who is there is heard at once whoever it is, and silence counts from then on as ever.
    #[test]
    fn auto_begins_with_what_it_found_before() {
        let remembering = || Port::new(ProtocolKind::Auto, ProtocolKind::Mavlink, at(100));
        let mut port = remembering();
        assert!(!said(&mut port, 100).starts_with(b"$X<"), "no MSP to one that speaks MAVLink");
        assert_eq!(port.spoken(at(10_100)), ProtocolKind::Mavlink);
        assert_eq!(port.spoken(at(10_101)), ProtocolKind::Auto);
        assert!(said(&mut port, 10_101).starts_with(b"$X<"));
        for (frame, kind) in [(heartbeat_frame(), ProtocolKind::Mavlink), (variant_frame(*b"INAV"), ProtocolKind::Msp)]
        {
            let mut port = remembering();
            hear(&mut port, 4000, &frame);
            assert_eq!(port.spoken(at(4000)), kind);
            assert_eq!((port.spoken(at(14_000)), port.spoken(at(14_001))), (kind, ProtocolKind::Auto));
        }
        // Once somebody is heard, another changes nothing.
        let mut port = remembering();
        hear(&mut port, 4000, &heartbeat_frame());
        hear(&mut port, 4001, &variant_frame(*b"INAV"));
        assert_eq!(port.spoken(at(4001)), ProtocolKind::Mavlink);
        // What was chosen is spoken, whatever was found.
        let port = Port::new(ProtocolKind::Nmea, ProtocolKind::Mavlink, at(0));
        assert_eq!(port.spoken(at(1)), ProtocolKind::Nmea);
    }

    /// It asks in MSP while it searches, and no more once it has heard MAVLink.
    #[test]
    fn a_search_is_in_msp() {
        let mut port = Port::new(ProtocolKind::Auto, ProtocolKind::Auto, at(0));
        assert!(said(&mut port, 0).starts_with(b"$X<"));
        hear(&mut port, 1, &heartbeat_frame());
        assert!((1..2_000).step_by(12).all(|ms| !said(&mut port, ms).starts_with(b"$X<")));
    }

    /// Whatever comes: a port that is set to a protocol speaks it.
    #[test]
    fn what_is_chosen_is_spoken() {
        for kind in [ProtocolKind::Mavlink, ProtocolKind::Msp, ProtocolKind::Nmea] {
            let mut port = Port::new(kind, ProtocolKind::Auto, at(0));
            hear(&mut port, 0, &heartbeat_frame());
            hear(&mut port, 1, &variant_frame(*b"ARDU"));
            assert_eq!(port.spoken(at(2)), kind);
            port.choose(ProtocolKind::Auto);
            assert_eq!(port.spoken(at(2)) == ProtocolKind::Msp, kind == ProtocolKind::Msp);
        }
    }

    /// Attitude by MAVLink is heard beside sentences.
    #[test]
    fn sentences_and_attitude_share_a_line() {
        let mut port = Port::new(ProtocolKind::Nmea, ProtocolKind::Auto, at(0));
        assert!(said(&mut port, 0).starts_with(b"$HCHDM"));
        let frame = mavlink_frame(&ATTITUDE_DATA { roll: 0.1, ..ATTITUDE_DATA::default() });
        let heard = frame.iter().find_map(|&byte| port.byte(at(1), byte));
        assert!(matches!(heard, Some(Heard::Attitude(report)) if report.source != Source::default()), "{heard:?}");
    }
}
