//! The bytes of one copy of the contents.
//!
//! | bytes | hold |
//! |---|---|
//! | 0..4 | serial number, one more for every save (little endian, as all below) |
//! | 4 | version of the format |
//! | 5..220 | contents (postcard), zeros up to the end |
//! | 220..224 | CRC-32 of all before |
//!
//! A later version may change the contents only.

use crc::{CRC_32_ISO_HDLC, Crc};

use super::StoreError;
use super::contents::Contents;

/// Version of the format. To be raised when the meaning of the contents changes.
const VERSION: u8 = 1;
/// A multiple of every flash's word. The contents take at most 186 bytes: 84 for each record, 14 for the settings, and
/// the tags of the options.
pub(super) const SNAPSHOT_SIZE: usize = 224;

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A copy of the contents whose CRC is right.
pub(super) struct Snapshot([u8; SNAPSHOT_SIZE]);

impl Snapshot {
    /// The copy to be stored.
    pub fn new(serial: u32, contents: &Contents) -> Result<Self, StoreError> {
        if !contents.is_valid() {
            return Err(StoreError::Invalid);
        }
        let mut bytes = [0; SNAPSHOT_SIZE];
        let [s0, s1, s2, s3, version, payload @ .., _, _, _, _] = &mut bytes;
        [*s0, *s1, *s2, *s3] = serial.to_le_bytes();
        *version = VERSION;
        postcard::to_slice(contents, payload).map_err(|_| StoreError::Full)?;
        let [checked @ .., c0, c1, c2, c3] = &mut bytes;
        [*c0, *c1, *c2, *c3] = CRC.checksum(checked).to_le_bytes();
        Ok(Self(bytes))
    }

    /// The copy in these bytes, if there is one.
    pub fn from_bytes(bytes: [u8; SNAPSHOT_SIZE]) -> Option<Self> {
        let [checked @ .., c0, c1, c2, c3] = &bytes;
        let right = CRC.checksum(checked) == u32::from_le_bytes([*c0, *c1, *c2, *c3]);
        right.then_some(Self(bytes))
    }

    /// The bytes to be stored.
    pub fn bytes(&self) -> &[u8; SNAPSHOT_SIZE] {
        &self.0
    }

    /// Counts the saves.
    pub fn serial(&self) -> u32 {
        let [s0, s1, s2, s3, ..] = self.0;
        u32::from_le_bytes([s0, s1, s2, s3])
    }

    /// Whether this was saved after another one of the same store; serial numbers wrap.
    pub fn is_newer_than(&self, other: &Self) -> bool {
        self.serial().wrapping_sub(other.serial()).cast_signed() > 0
    }

    /// What it holds.
    pub fn contents(&self) -> Result<Contents, StoreError> {
        let [_, _, _, _, version, payload @ .., _, _, _, _] = &self.0;
        if *version != VERSION {
            return Err(StoreError::UnknownVersion(*version));
        }
        postcard::from_bytes(payload).ok().filter(Contents::is_valid).ok_or(StoreError::Corrupt)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::tests::record;
    use crate::store::{Generations, Settings};

    fn contents() -> Contents {
        let settings = Settings { declination_deg: Some(-3.5), ..Settings::default() };
        Contents { settings, generations: Generations { current: Some(record(2)), previous: Some(record(u32::MAX)) } }
    }

    /// The bytes of contents that `Snapshot::new` may refuse, with the right CRC.
    fn forged(version: u8, contents: &Contents) -> [u8; SNAPSHOT_SIZE] {
        let mut bytes = [0; SNAPSHOT_SIZE];
        bytes[4] = version;
        postcard::to_slice(contents, &mut bytes[5..220]).unwrap();
        let crc = CRC.checksum(&bytes[..220]);
        bytes[220..].copy_from_slice(&crc.to_le_bytes());
        bytes
    }

    #[test]
    fn the_largest_contents_fit_and_come_back() {
        let snapshot = Snapshot::new(7, &contents()).unwrap();
        let read = Snapshot::from_bytes(*snapshot.bytes()).unwrap();
        assert_eq!((read.serial(), read.contents()), (7, Ok(contents())));
    }

    /// CRC-32 finds every single-bit error, wherever it is.
    #[test]
    fn a_flipped_bit_is_never_taken_for_a_copy() {
        let snapshot = Snapshot::new(7, &contents()).unwrap();
        for bit in 0..SNAPSHOT_SIZE * 8 {
            let mut damaged = *snapshot.bytes();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(Snapshot::from_bytes(damaged).is_none(), "bit {bit}");
        }
    }

    #[test]
    fn another_version_is_named() {
        let snapshot = Snapshot::from_bytes(forged(9, &contents())).unwrap();
        assert_eq!(snapshot.contents(), Err(StoreError::UnknownVersion(9)));
    }

    #[test]
    fn values_out_of_range_are_neither_stored_nor_believed() {
        let good = contents();
        let declination = Settings { declination_deg: Some(f32::NAN), ..good.settings };
        let rate = Settings { stream_rate_hz: 0, ..good.settings };
        let mut infinite = record(1);
        infinite.calibration.b_ut[1] = f32::INFINITY;
        let current = Generations { current: Some(infinite), ..good.generations };
        for bad in [
            Contents { settings: declination, ..good },
            Contents { settings: rate, ..good },
            Contents { generations: current, ..good },
        ] {
            assert!(matches!(Snapshot::new(1, &bad), Err(StoreError::Invalid)));
            let snapshot = Snapshot::from_bytes(forged(VERSION, &bad)).unwrap();
            assert_eq!(snapshot.contents(), Err(StoreError::Corrupt));
        }
    }

    #[test]
    fn serial_numbers_wrap() {
        let [old, new] = [u32::MAX, 0].map(|serial| Snapshot::new(serial, &contents()).unwrap());
        assert!(new.is_newer_than(&old) && !old.is_newer_than(&new) && !new.is_newer_than(&new));
    }
}
