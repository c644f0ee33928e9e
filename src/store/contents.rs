//! What is stored, and its bytes.

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use serde::{Deserialize, Serialize};

use super::StoreError;
use crate::calibration::{Calibration, Orientation, Quality, Uncertainty};
use crate::magnetometer::Identity;
use crate::settings::Settings;

/// Version of the format. To be raised when the meaning of the bytes changes.
const VERSION: u8 = 2;
/// Room for version, contents and CRC. The contents take at most 690 bytes: 333 for each record, 22 for settings and the
/// count of saves, and the tags of the options.
pub(super) const VALUE_SIZE: usize = 704;

/// Without a table of 1 KB: a save waits for the flash, not for this.
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);
const CRC_SIZE: usize = 4;

/// A calibration with what is needed to judge whether it may be used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The coefficients.
    pub calibration: Calibration,
    /// How good they are expected to be.
    pub quality: Quality,
    /// How wrong a heading may be.
    pub uncertainty: Uncertainty,
    /// The sensor they were found with.
    pub sensor: Identity,
    /// How that sensor was mounted.
    pub mount: Orientation,
    /// Counts the calibrations this module has accepted.
    pub serial: u32,
}

impl Record {
    /// Whether every number is finite and the mounting one of the 24.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let Quality { expected_rms_deg, expected_worst_deg, norm_residual, dip_residual_deg, .. } = self.quality;
        self.calibration.is_finite()
            && self.uncertainty.is_finite()
            && [expected_rms_deg, expected_worst_deg, norm_residual, dip_residual_deg].iter().all(|n| n.is_finite())
            && self.mount.is_valid()
    }
}

/// The calibration in use and the one before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Generations {
    /// In use; none if the module is not calibrated.
    pub current: Option<Record>,
    /// What [`undo`](Self::undo) brings back.
    pub previous: Option<Record>,
}

impl Generations {
    /// Takes a new calibration into use; the one in use becomes the previous one.
    pub fn push(&mut self, record: &Record) {
        self.previous = self.current;
        self.current = Some(*record);
    }

    /// Swaps the two, so that a second `undo` undoes the first. When there is no previous calibration the module is
    /// uncalibrated afterwards.
    pub fn undo(&mut self) {
        core::mem::swap(&mut self.current, &mut self.previous);
    }

    /// Forgets both.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    fn is_valid(&self) -> bool {
        [&self.current, &self.previous].into_iter().flatten().all(Record::is_valid)
    }
}

/// What of the contents a save changes.
#[derive(Clone, Copy, Debug)]
pub enum Change<'a> {
    /// The settings; the calibrations stay.
    Settings(&'a Settings),
    /// The calibrations; the settings stay.
    Generations {
        /// The one in use from now on.
        current: Option<&'a Record>,
        /// The one before.
        previous: Option<&'a Record>,
    },
}

/// The one value in the flash: version byte, postcard, CRC-32 of both (little endian).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Contents {
    /// Counts the saves, wrapping: which of two copies is the newer.
    pub saves: u32,
    pub settings: Settings,
    pub generations: Generations,
}

impl Contents {
    /// Puts a change into place.
    pub fn change(&mut self, change: Change<'_>) {
        match change {
            Change::Settings(settings) => self.settings = *settings,
            Change::Generations { current, previous } => {
                self.generations.current = current.copied();
                self.generations.previous = previous.copied();
            }
        }
    }

    fn is_valid(&self) -> bool {
        self.settings.is_valid() && self.generations.is_valid()
    }

    /// The bytes to store.
    pub fn encode<'a>(&self, buffer: &'a mut [u8; VALUE_SIZE]) -> Result<&'a [u8], StoreError> {
        if !self.is_valid() {
            return Err(StoreError::Invalid);
        }
        let [version, rest @ ..] = buffer;
        *version = VERSION;
        let payload_size = postcard::to_slice(self, rest).map_err(|_| StoreError::Full)?.len();
        let (checked, rest) = buffer.split_at_mut_checked(1 + payload_size).ok_or(StoreError::Full)?;
        let crc = rest.first_chunk_mut::<CRC_SIZE>().ok_or(StoreError::Full)?;
        *crc = CRC.checksum(checked).to_le_bytes();
        buffer.get(..1 + payload_size + CRC_SIZE).ok_or(StoreError::Full)
    }

    /// Takes the contents from stored bytes; they stay as they are if there is something wrong with those. Not inlined:
    /// the contents are large, and what they are made of lies on the stack while it is.
    #[inline(never)]
    pub fn decode(&mut self, value: &[u8]) -> Result<(), StoreError> {
        let (checked, crc) = value.split_last_chunk::<CRC_SIZE>().ok_or(StoreError::Corrupt)?;
        if CRC.checksum(checked) != u32::from_le_bytes(*crc) {
            return Err(StoreError::Corrupt);
        }
        match checked {
            [VERSION, payload @ ..] => match postcard::from_bytes::<Self>(payload) {
                Ok(contents) if contents.is_valid() => {
                    *self = contents;
                    Ok(())
                }
                _ => Err(StoreError::Corrupt),
            },
            [version, ..] => Err(StoreError::UnknownVersion(*version)),
            [] => Err(StoreError::Corrupt),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::tests::record;

    fn contents() -> Contents {
        let settings = Settings { declination_deg: Some(-3.5), ..Settings::default() };
        Contents {
            saves: u32::MAX,
            settings,
            generations: Generations { current: Some(record(2)), previous: Some(record(u32::MAX)) },
        }
    }

    fn decoded(value: &[u8]) -> Result<Contents, StoreError> {
        let mut contents = Contents::default();
        contents.decode(value).map(|()| contents)
    }

    #[test]
    fn the_largest_contents_fit_and_come_back() {
        let mut buffer = [0; VALUE_SIZE];
        let value = contents().encode(&mut buffer).unwrap();
        assert_eq!(decoded(value), Ok(contents()));
    }

    /// CRC-32 finds every single-bit error, wherever it is.
    #[test]
    fn a_flipped_bit_is_never_taken_for_contents() {
        let mut buffer = [0; VALUE_SIZE];
        let value = contents().encode(&mut buffer).unwrap().to_vec();
        for bit in 0..value.len() * 8 {
            let mut damaged = value.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(decoded(&damaged), Err(StoreError::Corrupt), "bit {bit}");
        }
    }

    #[test]
    fn another_version_is_named() {
        let mut value = std::vec![9, 1, 2, 3];
        value.extend(CRC.checksum(&value).to_le_bytes());
        assert_eq!(decoded(&value), Err(StoreError::UnknownVersion(9)));
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
            assert_eq!(bad.encode(&mut [0; VALUE_SIZE]), Err(StoreError::Invalid));
            let mut value = std::vec![VERSION];
            value.extend(postcard::to_slice(&bad, &mut [0; VALUE_SIZE]).unwrap().iter());
            value.extend(CRC.checksum(&value).to_le_bytes());
            assert_eq!(decoded(&value), Err(StoreError::Corrupt));
        }
    }

    #[test]
    fn undo_twice_is_redo() {
        let mut generations = Generations::default();
        generations.push(&record(1));
        generations.push(&record(2));
        let before = generations;
        generations.undo();
        assert_eq!(generations.current, Some(record(1)));
        generations.undo();
        assert_eq!(generations, before);
    }
}
