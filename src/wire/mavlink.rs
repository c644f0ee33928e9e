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
        // A cut frame, then a whole one: the receiver must find the second although it lies where the first claims to
        // be.
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

    /// CRC-16/MCRF4XX over everything but the magic byte, with the message's extra byte (39 for ATTITUDE): by the
    /// definition in MAVLink's guide, and not by the library that the receiver uses.
    fn crc(bytes: &[u8], extra: u8) -> [u8; 2] {
        let mut crc = 0xFFFF_u16;
        for byte in bytes.iter().chain([&extra]) {
            let mut mixed = byte ^ crc as u8;
            mixed ^= mixed << 4;
            let mixed = u16::from(mixed);
            crc = (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4);
        }
        crc.to_le_bytes()
    }

    fn with_crc(mut frame: Vec<u8>) -> Vec<u8> {
        frame.extend(crc(&frame[1..], 39));
        frame
    }

    /// The payload of ATTITUDE: time, roll, pitch, yaw and the three rates, little endian.
    fn payload(numbers: [f32; 6]) -> Vec<u8> {
        let mut payload = 4321_u32.to_le_bytes().to_vec();
        payload.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        payload
    }

    fn frame_v1(id: u8, payload: &[u8]) -> Vec<u8> {
        with_crc([&[0xFE, payload.len() as u8, 0, 1, 1, id], payload].concat())
    }

    fn frame_v2(incompatibility: u8, id: [u8; 3], payload: &[u8]) -> Vec<u8> {
        let header = [0xFD, payload.len() as u8, incompatibility, 0, 0, 1, 1];
        with_crc([&header, &id[..], payload].concat())
    }

    const ID: [u8; 3] = [30, 0, 0];
    const NUMBERS: [f32; 6] = [0.1, -0.2, 3.0, 0.4, -0.5, 0.6];

    /// A frame of each version whose report has this roll.
    fn good_frames(roll: f32) -> [Vec<u8>; 2] {
        let payload = payload([roll, -0.2, 3.0, 0.4, -0.5, 0.6]);
        [frame_v1(30, &payload), frame_v2(0, ID, &payload)]
    }

    fn assert_ignored(frame: &[u8], rejected: u32, what: &str) {
        assert_eq!(receive(frame), (vec![], rejected), "{what}");
        // And the frame after it is found.
        for good in good_frames(0.7) {
            let (reports, _) = receive(&[frame, &good[..]].concat());
            assert_eq!(reports.iter().map(|r| r.attitude.roll_rad).collect::<Vec<_>>(), [0.7], "{what}");
        }
    }

    #[test]
    fn every_number_of_the_message_is_where_it_belongs() {
        let expected = Report {
            sender_time: WrappingMillis::new(4321),
            attitude: Attitude { roll_rad: 0.1, pitch_rad: -0.2 },
            rates_rad_s: [0.4, -0.5, 0.6],
        };
        for frame in [frame_v1(30, &payload(NUMBERS)), frame_v2(0, ID, &payload(NUMBERS))] {
            assert_eq!(receive(&frame), (vec![expected], 0));
        }
    }

    /// Signature: 13 bytes more, of any content; the report comes with the last of them, and the next frame is found.
    #[test]
    fn a_report_comes_with_the_last_byte_of_its_frame() {
        let signed = [&frame_v2(1, ID, &payload(NUMBERS))[..], &[0xFD; 13]].concat();
        let [v1, v2] = good_frames(0.1);
        for frame in [v1, v2, signed.clone()] {
            let mut receiver = Receiver::new();
            for _ in 0..3 {
                let (last, rest) = frame.split_last().unwrap();
                assert!(rest.iter().all(|&byte| receiver.push(byte).is_none()));
                assert!(receiver.push(*last).is_some());
            }
            assert_eq!(receiver.rejected, 0);
        }
        assert_eq!(signed.len(), Receiver::new().buffer.capacity(), "the longest frame");
    }

    /// A flag that this receiver does not know may change what the bytes mean (MAVLink guide, incompatibility flags).
    #[test]
    fn unknown_incompatibility_flags_are_refused() {
        for flags in [0x02, 0x03, 0x40, 0x80, 0xFE, 0xFF] {
            assert_ignored(&frame_v2(flags, ID, &payload(NUMBERS)), 0, "flags");
        }
    }

    /// Compatibility flags do not: byte 3 of the header.
    #[test]
    fn compatibility_flags_are_no_matter() {
        let mut frame = frame_v2(0, ID, &payload(NUMBERS));
        frame.truncate(10 + 28);
        frame[3] = 0xFF;
        assert_eq!(receive(&with_crc(frame)).0.len(), 1);
    }

    #[test]
    fn other_messages_are_passed_over() {
        for id in [[31, 0, 0], [29, 0, 0], [30, 1, 0], [30, 0, 1], [0, 0, 30]] {
            assert_ignored(&frame_v2(0, id, &payload(NUMBERS)), 0, "id");
        }
        for id in [29, 31, 0, 255] {
            assert_ignored(&frame_v1(id, &payload(NUMBERS)), 0, "id");
        }
    }

    /// Version 2 cuts zeros off, to one byte at least; nothing is shorter than that or longer than the message.
    #[test]
    fn version_2_is_trimmed_and_version_1_is_not() {
        let whole = payload(NUMBERS);
        for length in 1..=28 {
            let mut filled = whole[..length].to_vec();
            let frame = frame_v2(0, ID, &filled);
            filled.resize(28, 0);
            let (reports, rejected) = receive(&frame);
            let (expected, _) = receive(&frame_v1(30, &filled));
            assert_eq!((reports.len(), rejected), (1, 0), "{length}");
            assert_eq!(reports, expected, "{length}");
        }
        assert_ignored(&frame_v2(0, ID, &[]), 0, "length 0");
        assert_ignored(&frame_v2(0, ID, &[&whole[..], &[0]].concat()), 0, "length 29");
        assert_ignored(&frame_v1(30, &whole[..27]), 0, "version 1, length 27");
        assert_ignored(&frame_v1(30, &[&whole[..], &[0]].concat()), 0, "version 1, length 29");
    }

    /// Rounding of half a circle and a quarter is let through: 0.001 rad.
    #[test]
    fn roll_and_pitch_end_where_angles_end() {
        use core::f32::consts::{FRAC_PI_2, PI};
        for sign in [1.0, -1.0] {
            for (roll, pitch, possible) in [
                (PI + 0.000_95, 0.0, true),
                (PI + 0.001_05, 0.0, false),
                (0.0, FRAC_PI_2 + 0.000_95, true),
                (0.0, FRAC_PI_2 + 0.001_05, false),
                (0.0, 2.0, false),
                (2.0, 0.0, true),
                (0.0, f32::NAN, false),
                (f32::NAN, 0.0, false),
                (0.0, f32::INFINITY, false),
            ] {
                let payload = payload([sign * roll, sign * pitch, 0.0, 0.0, 0.0, 0.0]);
                for frame in [frame_v1(30, &payload), frame_v2(0, ID, &payload)] {
                    let (reports, rejected) = receive(&frame);
                    let expected = if possible { (1, 0) } else { (0, 1) };
                    assert_eq!((reports.len(), rejected), expected, "{sign} {roll} {pitch}");
                }
            }
        }
    }

    #[test]
    fn a_rate_that_is_no_number_is_zero_and_the_others_stay() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for axis in 0..3 {
                let mut numbers = NUMBERS;
                numbers[3 + axis] = bad;
                let mut expected: [f32; 3] = [0.4, -0.5, 0.6];
                expected[axis] = 0.0;
                let (reports, _) = receive(&frame_v2(0, ID, &payload(numbers)));
                assert_eq!(reports[0].rates_rad_s.map(f32::to_bits), expected.map(f32::to_bits));
            }
        }
    }

    /// Each bit of the CRC counts, and the extra byte that tells ATTITUDE from a message of the same shape.
    #[test]
    fn a_wrong_crc_is_refused_and_counted() {
        for frame in good_frames(0.3) {
            for bit in 0..16 {
                let mut broken = frame.clone();
                let at = broken.len() - 2 + bit / 8;
                broken[at] ^= 1 << (bit % 8);
                assert_ignored(&broken, 1, "bit");
            }
            let mut other = frame[..frame.len() - 2].to_vec();
            other.extend(crc(&frame[1..frame.len() - 2], 38));
            assert_ignored(&other, 1, "extra byte");
        }
    }

    #[test]
    fn the_count_of_rejected_frames_wraps() {
        let mut receiver = Receiver { rejected: u32::MAX - 1, ..Receiver::new() };
        let mut broken = frame_v1(30, &payload(NUMBERS));
        *broken.last_mut().unwrap() ^= 1;
        let mut counts = Vec::new();
        for _ in 0..3 {
            for &byte in &broken {
                assert_eq!(receiver.push(byte), None);
            }
            counts.push(receiver.rejected);
        }
        assert_eq!(counts, [u32::MAX, 0, 1]);
    }

    /// Whatever lies before a frame: magic bytes, headers cut anywhere, frames of other messages, text. The frame is
    /// found at the latest when the longest false one that began before it is over.
    #[test]
    fn the_frame_after_every_kind_of_garbage_is_found() {
        let whole = payload(NUMBERS);
        let mut garbage: Vec<Vec<u8>> = vec![vec![0xFD], vec![0xFE], vec![0xFD, 0xFE], vec![0xFE; 7], vec![0xFD; 11]];
        for frame in
            [frame_v1(30, &whole), frame_v2(0, ID, &whole), frame_v2(1, ID, &whole), frame_v2(0, [76, 0, 0], &[7; 33])]
        {
            garbage.extend((1..frame.len()).map(|cut| frame[..cut].to_vec()));
            garbage.extend((1..frame.len()).map(|cut| frame[cut..].to_vec()));
        }
        garbage.push(b"$GPHDT,123.4,T*31\r\n".to_vec());
        let flush = [0; 53];
        for before in &garbage {
            for good in good_frames(0.7) {
                let (reports, _) = receive(&[&before[..], &good, &flush].concat());
                let found = reports.iter().filter(|report| (report.attitude.roll_rad - 0.7).abs() < 1e-6).count();
                assert_eq!(found, 1, "{before:02X?}");
            }
        }
    }
}
