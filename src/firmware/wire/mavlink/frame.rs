//! Header, address and CRC of a frame.

use crc::{CRC_16_MCRF4XX, Crc};

use autoswing::attitude::SenderId;

/// Component of a system, as sender or addressee; 0 addresses all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// System, for example an aircraft or a ground station.
    pub system_id: u8,
    /// Component of the system.
    pub component_id: u8,
}

impl Address {
    /// Address of a sender.
    #[must_use]
    pub const fn from_sender(source: SenderId) -> Self {
        let [system, component] = source.packed_number().to_be_bytes();
        Self { system_id: system, component_id: component }
    }

    /// Sender with this address.
    #[must_use]
    pub const fn sender_id(self) -> SenderId {
        SenderId::new(u16::from_be_bytes([self.system_id, self.component_id]))
    }
}

/// First byte of a frame of version 1.
pub(super) const V1_START_BYTE: u8 = 0xFE;
/// First byte of a frame of version 2.
pub(super) const V2_START_BYTE: u8 = 0xFD;

/// Length of a header of version 1, bytes.
pub(super) const V1_HEADER_LENGTH: usize = 6;
/// Length of a header of version 2, bytes.
pub(super) const V2_HEADER_LENGTH: usize = 10;

/// CRC of a frame without its first byte, and of the message's extra byte. The mavlink library's function copies a
/// table of half a kilobyte for every frame.
pub(super) fn checksum(bytes: &[u8], extra: u8) -> u16 {
    static CRC: Crc<u16> = Crc::<u16>::new(&CRC_16_MCRF4XX);
    let mut digest = CRC.digest();
    digest.update(bytes);
    digest.update(&[extra]);
    digest.finalize()
}
