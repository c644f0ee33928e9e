//! CAN frames in datagrams, as ArduPilot's simulator and pydronecan exchange them (`mcast:0`).

use autoswing_firmware::wire::dronecan::CanFrame;
use crc::{CRC_16_IBM_3740, Crc};

const DATAGRAM_MAGIC: u16 = 0x2934;

/// Length of a datagram's header, bytes: magic number, CRC of everything after it, flags, identifier.
const HEADER_LENGTH: usize = 10;

const EXTENDED_IDENTIFIER_FLAG: u32 = 1 << 31;

/// Largest datagram: a frame of CAN FD, which is dropped.
pub const MAX_DATAGRAM_SIZE: usize = HEADER_LENGTH + 64;

const CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_IBM_3740);

/// Encodes a CAN frame as a UDP datagram.
#[must_use]
pub fn to_datagram(frame: &CanFrame) -> Vec<u8> {
    const DATAGRAM_FLAGS: u16 = 0;
    let id = frame.frame_id() | EXTENDED_IDENTIFIER_FLAG;
    let checked = [&DATAGRAM_FLAGS.to_le_bytes(), &id.to_le_bytes()[..], frame.data()].concat();
    [&DATAGRAM_MAGIC.to_le_bytes(), &CRC.checksum(&checked).to_le_bytes(), &checked[..]].concat()
}

/// Frame of a datagram; `None` for anything but an intact classic frame with an extended identifier.
#[must_use]
pub fn from_datagram(datagram: &[u8]) -> Option<CanFrame> {
    let ([magic_low, magic_high, crc_low, crc_high], checked) = datagram.split_first_chunk()?;
    let (&[flags_low, flags_high, id_byte_0, id_byte_1, id_byte_2, id_byte_3], data) = checked.split_first_chunk()?;
    let id = u32::from_le_bytes([id_byte_0, id_byte_1, id_byte_2, id_byte_3]);
    let is_intact = u16::from_le_bytes([*magic_low, *magic_high]) == DATAGRAM_MAGIC
        && u16::from_le_bytes([*crc_low, *crc_high]) == CRC.checksum(checked);
    let is_classic = [flags_low, flags_high] == [0, 0] && id & EXTENDED_IDENTIFIER_FLAG != 0;
    CanFrame::new(id & !EXTENDED_IDENTIFIER_FLAG, data).filter(|_| is_intact && is_classic)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sent by pydronecan 1.0.27: ArmingStatus of node 10.
    #[test]
    fn a_datagram_is_that_of_pydronecan() {
        let frame = CanFrame::new(0x1804_4C0A, &[0xFF, 0xC0]).unwrap();
        let datagram = to_datagram(&frame);
        assert_eq!(datagram, PYDRONECAN_DATAGRAM);
        assert_eq!(from_datagram(&datagram), Some(frame));
    }

    const PYDRONECAN_DATAGRAM: &[u8] = &[0x34, 0x29, 0xA5, 0xEC, 0x00, 0x00, 0x0A, 0x4C, 0x04, 0x98, 0xFF, 0xC0];

    #[test]
    fn damaged_and_foreign_datagrams_are_dropped() {
        for length in 0..PYDRONECAN_DATAGRAM.len() {
            assert_eq!(from_datagram(&PYDRONECAN_DATAGRAM[..length]), None);
        }
        for bit in 0..PYDRONECAN_DATAGRAM.len() * 8 {
            let mut damaged = PYDRONECAN_DATAGRAM.to_vec();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(from_datagram(&damaged), None, "bit {bit}");
        }
        assert_eq!(from_datagram(&[0; MAX_DATAGRAM_SIZE]), None);
    }
}
