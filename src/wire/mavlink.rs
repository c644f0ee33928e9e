//! MAVLink ATTITUDE in, versions 1 and 2.
//!
//! The module needs one message of the hundreds that share the line. So the receiver looks for frames that claim to be
//! ATTITUDE, checks their CRC and passes over everything else byte by byte. It never trusts the length of a frame it
//! cannot check, which is why garbage costs at most the frame it lies in.

use mavlink::dialects::common::ATTITUDE_DATA;
use mavlink::{MavlinkVersion, MessageData as _, calculate_crc};

use crate::attitude::Report;
use crate::frames::Attitude;
use crate::time::WrappingMillis;

/// Finds ATTITUDE frames in a stream of bytes.
#[derive(Debug, Default)]
pub struct Receiver {
    buffer: heapless::Vec<u8, { MAX_FRAME }>,
    /// Fewer bytes than these in the buffer tell nothing new.
    needed: usize,
    /// Frames that claimed to be ATTITUDE but failed their CRC or held impossible values; wraps.
    pub rejected: u32,
}

/// A version 2 frame: 10 bytes of header, 28 of payload, 2 of CRC, 13 of signature.
const MAX_FRAME: usize = 10 + ATTITUDE_DATA::ENCODED_LEN + 2 + 13;

/// Where a candidate frame's parts lie.
struct Layout {
    version: MavlinkVersion,
    header: usize,
    payload: usize,
    signature: usize,
}

impl Layout {
    fn frame(&self) -> usize {
        self.header + self.payload + 2 + self.signature
    }
}

/// What the bytes at the start of the buffer are.
enum Candidate {
    /// Not the start of an ATTITUDE frame.
    No,
    /// It may be one, but more bytes are needed to tell.
    Unknown,
    /// The header is that of an ATTITUDE frame.
    Yes(Layout),
}

impl Receiver {
    /// An empty receiver.
    #[must_use]
    pub const fn new() -> Self {
        Self { buffer: heapless::Vec::new(), needed: 0, rejected: 0 }
    }

    /// Takes one byte; gives a report when it completes a valid ATTITUDE frame.
    pub fn push(&mut self, byte: u8) -> Option<Report> {
        // Never full: `scan` leaves less than one frame behind.
        let _ = self.buffer.push(byte);
        if self.buffer.len() < self.needed { None } else { self.scan() }
    }

    /// Reads frames off the front of the buffer until more bytes are needed.
    fn scan(&mut self) -> Option<Report> {
        loop {
            match candidate(&self.buffer) {
                Candidate::No => self.drop_front(1),
                Candidate::Unknown => return None,
                Candidate::Yes(layout) => {
                    self.needed = layout.frame();
                    if self.buffer.len() < self.needed {
                        return None;
                    }
                    let report = decode(&self.buffer, &layout);
                    if report.is_some() {
                        self.drop_front(layout.frame());
                        return report;
                    }
                    // A true frame may start inside the false one: go on at its second byte.
                    self.rejected = self.rejected.wrapping_add(1);
                    self.drop_front(1);
                }
            }
        }
    }

    fn drop_front(&mut self, count: usize) {
        self.needed = 0;
        let count = count.min(self.buffer.len());
        self.buffer.rotate_left(count);
        self.buffer.truncate(self.buffer.len() - count);
    }
}

fn candidate(bytes: &[u8]) -> Candidate {
    const V1: u8 = 0xFE;
    const V2: u8 = 0xFD;
    const SIGNED: u8 = 0x01;
    let id = ATTITUDE_DATA::ID.to_le_bytes();
    match *bytes {
        [] | [V1 | V2] => Candidate::Unknown,
        [V1, length, ..] if usize::from(length) != ATTITUDE_DATA::ENCODED_LEN => Candidate::No,
        [V1, length, _, _, _, message, ..] if message == id[0] => Candidate::Yes(Layout {
            version: MavlinkVersion::V1,
            header: 6,
            payload: usize::from(length),
            signature: 0,
        }),
        // Version 2 cuts trailing zeros off the payload, to one byte at least.
        [V2, length, ..] if length == 0 || usize::from(length) > ATTITUDE_DATA::ENCODED_LEN => Candidate::No,
        [V2, length, incompatibility, _, _, _, _, m0, m1, m2, ..]
            if [m0, m1, m2] == id[..3] && incompatibility & !SIGNED == 0 =>
        {
            Candidate::Yes(Layout {
                version: MavlinkVersion::V2,
                header: 10,
                payload: usize::from(length),
                signature: if incompatibility & SIGNED == 0 { 0 } else { 13 },
            })
        }
        [V1, ..] if bytes.len() < 6 => Candidate::Unknown,
        [V2, ..] if bytes.len() < 10 => Candidate::Unknown,
        _ => Candidate::No,
    }
}

/// Checks CRC and values of a complete frame.
fn decode(frame: &[u8], layout: &Layout) -> Option<Report> {
    let crc_at = layout.header + layout.payload;
    let checked = frame.get(1..crc_at)?;
    let crc = frame.get(crc_at..crc_at + 2)?;
    if calculate_crc(checked, ATTITUDE_DATA::EXTRA_CRC).to_le_bytes() != crc {
        return None;
    }
    let data = ATTITUDE_DATA::deser(layout.version, frame.get(layout.header..crc_at)?).ok()?;
    let rate = |rad_s: f32| if rad_s.is_finite() { rad_s } else { 0.0 };
    let possible = data.roll.abs() <= MAX_ROLL_RAD && data.pitch.abs() <= MAX_PITCH_RAD;
    possible.then(|| Report {
        sender_time: WrappingMillis::new(data.time_boot_ms),
        attitude: Attitude { roll_rad: data.roll, pitch_rad: data.pitch },
        rates_rad_s: [rate(data.rollspeed), rate(data.pitchspeed), rate(data.yawspeed)],
    })
}

/// Angles beyond these (with room for rounding) are not roll and pitch; the comparison refuses NaN too.
const MAX_ROLL_RAD: f32 = core::f32::consts::PI + 0.001;
const MAX_PITCH_RAD: f32 = core::f32::consts::FRAC_PI_2 + 0.001;

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::{MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader};
    use testkit::random::Random;

    fn data(roll: f32) -> ATTITUDE_DATA {
        ATTITUDE_DATA { time_boot_ms: 1234, roll, pitch: -0.1, yaw: f32::NAN, ..Default::default() }
    }

    fn v2(data: &ATTITUDE_DATA) -> Vec<u8> {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message_data(MavHeader { system_id: 1, component_id: 1, sequence: 7 }, data);
        raw.raw_bytes().to_vec()
    }

    fn v1(data: &ATTITUDE_DATA) -> Vec<u8> {
        let mut raw = MAVLinkV1MessageRaw::new();
        raw.serialize_message_data(MavHeader { system_id: 1, component_id: 1, sequence: 7 }, data);
        raw.raw_bytes().to_vec()
    }

    fn receive(bytes: &[u8]) -> (Vec<Report>, u32) {
        let mut receiver = Receiver::new();
        let reports = bytes.iter().filter_map(|&byte| receiver.push(byte)).collect();
        (reports, receiver.rejected)
    }

    #[test]
    fn both_versions_are_read_and_yaw_is_not_needed() {
        let bytes = [v1(&data(0.25)), v2(&data(-0.5))].concat();
        let (reports, rejected) = receive(&bytes);
        let rolls: Vec<f32> = reports.iter().map(|r| r.attitude.roll_rad).collect();
        assert_eq!(rolls, [0.25, -0.5]);
        assert_eq!((reports[0].sender_time.count(), rejected), (1234, 0));
    }

    #[test]
    fn a_false_start_costs_no_true_frame() {
        // A cut frame, then a whole one: the receiver must find the second although it lies where the first claims to be.
        let whole = v2(&data(0.3));
        for cut in 0..whole.len() {
            let (reports, _) = receive(&[&whole[..cut], &whole[..]].concat());
            assert_eq!(reports.len(), 1, "cut at {cut}");
        }
    }

    #[test]
    fn a_flipped_bit_anywhere_is_never_believed() {
        let whole = v2(&data(0.3));
        for bit in 0..whole.len() * 8 {
            let mut broken = whole.clone();
            broken[bit / 8] ^= 1 << (bit % 8);
            let (reports, _) = receive(&[&broken[..], &whole[..]].concat());
            assert!(reports.iter().all(|r| (r.attitude.roll_rad - 0.3).abs() < 1e-6), "bit {bit}");
            assert!(!reports.is_empty(), "bit {bit} cost the next frame");
        }
    }

    #[test]
    fn impossible_angles_are_refused() {
        for roll in [f32::NAN, f32::INFINITY, 4.0] {
            let (reports, rejected) = receive(&v2(&data(roll)));
            assert!(reports.is_empty());
            assert_eq!(rejected, 1);
        }
    }

    #[test]
    fn random_bytes_never_panic_and_frames_between_them_are_found() {
        let mut random = Random(1);
        let mut receiver = Receiver::new();
        let mut found = 0;
        for _ in 0..2000 {
            for _ in 0..50 {
                // Every fourth byte starts a frame of either version: far worse than noise.
                let byte = random.byte();
                receiver.push(if byte < 0x40 { 0xFD + byte % 2 } else { random.byte() });
            }
            for byte in v2(&data(0.3)) {
                found += usize::from(receiver.push(byte).is_some());
            }
        }
        // A false header that runs into the frame can only delay it until enough bytes have come to refute it.
        assert!(found >= 1990, "{found} of 2000");
    }
}
