//! What is stored, and its bytes.

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use serde::{Deserialize, Serialize};

use super::{StoreError, v2, v3, v4, v5, v6, v7, v8};
use crate::calibration::{Calibration, CurrentIron, Latency, Orientation, Quality, Uncertainty};
use crate::magnetometer::Identity;
use crate::settings::{PORTS, ProtocolKind, Settings};

/// Version of the format. To be raised when the bytes change or their meaning does; what this version is like then goes
/// into a module of its own, as `v7` did.
pub(super) const VERSION: u8 = 9;
/// Room for version, contents and CRC. The contents take at most 784 bytes: 346 for each record, 41 for settings and
/// the count of saves, the tags of the options, 24 for what goes with the current in each calibration, and a byte of
/// what is [`Remembered`].
pub(super) const VALUE_SIZE: usize = 792;

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
        let Quality { expected_rms_deg, expected_worst_deg, norm_residual, dip_residual_deg, latency, .. } =
            self.quality;
        let Latency { found_s, sigma_s } = latency.unwrap_or(Latency { found_s: 0.0, sigma_s: 0.0 });
        self.calibration.is_finite()
            && self.uncertainty.is_finite()
            && [expected_rms_deg, expected_worst_deg, norm_residual, dip_residual_deg, found_s, sigma_s]
                .iter()
                .all(|number| number.is_finite())
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

    /// What goes with the current in each, as it stands behind both.
    pub(super) fn currents(&self) -> [CurrentIron; 2] {
        let of =
            |record: &Option<Record>| record.as_ref().map_or(CurrentIron::NONE, |record| record.calibration.current);
        [of(&self.current), of(&self.previous)]
    }

    fn take_currents(&mut self, currents: [CurrentIron; 2]) {
        for (record, current) in [&mut self.current, &mut self.previous].into_iter().zip(currents) {
            if let Some(record) = record {
                record.calibration.current = current;
            }
        }
    }
}

/// Settings and calibrations: all that the module remembers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Stored {
    /// What the user has chosen.
    pub settings: Settings,
    /// The calibration in use and the one before.
    pub generations: Generations,
    /// What nobody chose.
    #[serde(skip)]
    pub remembered: Remembered,
}

/// What the module notes for its next start. It is optional: one byte behind the contents, which firmware of the same
/// version that knows nothing of it passes over, and where there is none, nothing is remembered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Remembered {
    /// Whether samples are being collected, which would be lost with the power.
    pub is_collecting: bool,
    /// What `auto` has found on each port; `Auto` where it has found nothing.
    pub found: [ProtocolKind; PORTS],
}

impl Remembered {
    /// Nothing.
    pub const NOTHING: Self = Self { is_collecting: false, found: [ProtocolKind::Auto; PORTS] };

    /// Whether there is a collection, and two bits a port.
    fn byte(self) -> u8 {
        let [one, two] = self.found.map(|kind| kind as u8);
        u8::from(self.is_collecting) | one << 1 | two << 3
    }

    /// Of any byte: what it cannot be is nothing.
    fn from_byte(byte: u8) -> Self {
        let found = [byte >> 1, byte >> 3].map(|bits| match bits & 0b11 {
            1 => ProtocolKind::Mavlink,
            2 => ProtocolKind::Msp,
            _ => ProtocolKind::Auto,
        });
        Self { is_collecting: byte & 1 != 0, found }
    }
}

impl Default for Remembered {
    fn default() -> Self {
        Self::NOTHING
    }
}

impl Stored {
    fn is_valid(&self) -> bool {
        self.settings.is_valid() && self.generations.is_valid()
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
    /// What is remembered unasked; settings and calibrations stay.
    Remembered(Remembered),
    /// Forgets both calibrations; the settings stay. It is the one change that replaces what a later firmware stored,
    /// and begins anew with the default settings then.
    Clear,
}

/// The one value in the flash.
///
/// Its bytes are those of every version, so that each firmware can tell what it must not touch: a version byte; the
/// contents, here in postcard's format; and the CRC-32 of both (little endian). They fit into a page of the flash.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Contents {
    /// Counts the saves, wrapping: which of two copies is the newer.
    pub saves: u32,
    pub stored: Stored,
}

impl Contents {
    /// What the next save writes: these contents with the change.
    pub fn changed(mut self, change: Change<'_>) -> Self {
        self.saves = self.saves.wrapping_add(1);
        match change {
            Change::Settings(settings) => self.stored.settings = *settings,
            Change::Generations { current, previous } => {
                self.stored.generations = Generations { current: current.copied(), previous: previous.copied() };
            }
            Change::Remembered(remembered) => self.stored.remembered = remembered,
            Change::Clear => self.stored.generations.clear(),
        }
        // A calibration ends a collection, and one that goes on all the same is noted anew.
        self.stored.remembered.is_collecting &= matches!(change, Change::Settings(_) | Change::Remembered(_));
        self
    }

    /// The bytes to store.
    pub fn encode<'a>(&self, buffer: &'a mut [u8]) -> Result<&'a [u8], StoreError> {
        if !self.stored.is_valid() {
            return Err(StoreError::Invalid);
        }
        let (version, rest) = buffer.split_first_mut().ok_or(StoreError::Full)?;
        *version = VERSION;
        let whole = (self, self.stored.generations.currents());
        let mut payload_size = postcard::to_slice(&whole, rest).map_err(|_| StoreError::Full)?.len();
        let remembered = self.stored.remembered.byte();
        if remembered != 0 {
            *rest.get_mut(payload_size).ok_or(StoreError::Full)? = remembered;
            payload_size += 1;
        }
        let (checked, rest) = buffer.split_at_mut_checked(1 + payload_size).ok_or(StoreError::Full)?;
        let crc = rest.first_chunk_mut::<CRC_SIZE>().ok_or(StoreError::Full)?;
        *crc = CRC.checksum(checked).to_le_bytes();
        buffer.get(..1 + payload_size + CRC_SIZE).ok_or(StoreError::Full)
    }

    /// The contents of stored bytes, of this version or converted from one before. The contents are large, and what they
    /// are made of lies on the stack while it is: so none of the ways to read them is inlined, and only one is there.
    #[inline(never)]
    pub fn decode(value: &[u8]) -> Result<Self, StoreError> {
        let (checked, crc) = value.split_last_chunk::<CRC_SIZE>().ok_or(StoreError::Corrupt)?;
        if CRC.checksum(checked) != u32::from_le_bytes(*crc) {
            return Err(StoreError::Corrupt);
        }
        let (&version, payload) = checked.split_first().ok_or(StoreError::Corrupt)?;
        let contents = match version {
            VERSION | v8::VERSION => Self::read(version, payload),
            v7::VERSION => v7::read(payload),
            v6::VERSION => v6::read(payload),
            v5::VERSION => v5::read(payload),
            v4::VERSION => v4::read(payload),
            v2::VERSION | v3::VERSION => Self::read_before(version, payload),
            _ => return Err(StoreError::UnknownVersion(version)),
        };
        contents.filter(|contents: &Self| contents.stored.is_valid()).ok_or(StoreError::Corrupt)
    }

    #[inline(never)]
    fn read(version: u8, payload: &[u8]) -> Option<Self> {
        let (mut contents, mut rest): (Self, _) = postcard::take_from_bytes(payload).ok()?;
        if version > v8::VERSION {
            let currents: [CurrentIron; 2];
            (currents, rest) = postcard::take_from_bytes(rest).ok()?;
            contents.stored.generations.take_currents(currents);
        }
        contents.stored.remembered = rest.first().copied().map(Remembered::from_byte).unwrap_or_default();
        Some(contents)
    }

    /// Version 2 or 3.
    #[inline(never)]
    fn read_before(version: u8, payload: &[u8]) -> Option<Self> {
        let mut contents = v3::Contents::read(payload)?;
        if version == v2::VERSION {
            v2::convert(&mut contents);
        }
        contents.convert()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Envelope, Method};
    use crate::magnetometer::Model;
    use crate::settings::{AttitudeError, HeadingKind};
    use crate::settings::{Baud, PortNumber, ProtocolKind};
    use crate::store::tests::{present, record, sealed, settings};

    fn contents() -> Contents {
        let mut generations = Generations { current: Some(record(u32::MAX)), previous: Some(record(u32::MAX - 1)) };
        let iron = CurrentIron { ut_per_a: [0.5, -0.25, 0.125], sigma_ut_per_a: 0.01, mean_a: 12.0, spread_a: 4.0 };
        generations.take_currents([iron, CurrentIron { mean_a: -3.0, ..iron }]);
        let mut settings = Settings { inclination_deg: Some(-60.0), ..settings() };
        // Whatever this firmware was built with.
        settings.ports.of_mut(PortNumber::Two).protocol = ProtocolKind::Nmea;
        Contents { saves: u32::MAX, stored: Stored { settings, generations, ..Stored::default() } }
    }

    fn encoded(contents: &Contents) -> Result<Vec<u8>, StoreError> {
        contents.encode(&mut [0; VALUE_SIZE]).map(<[u8]>::to_vec)
    }

    #[test]
    fn the_largest_contents_fit_and_come_back() {
        let value = encoded(&contents()).unwrap();
        assert_eq!(Contents::decode(&value), Ok(contents()));
        assert_eq!(encoded(&Contents::default()).and_then(|value| Contents::decode(&value)), Ok(Contents::default()));
        let mut largest = contents();
        largest.stored.remembered.is_collecting = true;
        let value = encoded(&largest).unwrap();
        // Contents as stated at `VALUE_SIZE`, version and CRC.
        assert_eq!(value.len(), 784 + 1 + CRC_SIZE);
    }

    /// If this fails, the layout of what is stored has changed: raise `VERSION`, and keep the layout before as `v8` is.
    #[test]
    fn the_bytes_of_this_version_stay_what_they_are() {
        let value = encoded(&contents()).unwrap();
        let (version, crc) = (value[0], &value[value.len() - CRC_SIZE..]);
        assert_eq!((version, value.len(), crc), (9, 788, &[198, 71, 171, 133][..]));
    }

    /// A variant that is put between others moves those behind it, which no record with the first of them shows.
    #[test]
    fn variants_keep_their_numbers() {
        fn assert_numbers<T: Serialize>(variants: &[T]) {
            for (number, variant) in (0..).zip(variants) {
                assert_eq!(postcard::to_slice(variant, &mut [0; 8]).map(|bytes| bytes.to_vec()), Ok(vec![number]));
            }
        }
        assert_numbers(&[Model::Lis3mdl, Model::Lsm303dlhc]);
        assert_numbers(&[Envelope::Banked, Envelope::Level]);
        assert_numbers(&[HeadingKind::Raw, HeadingKind::Smooth]);
        assert_numbers(&ProtocolKind::ALL);
        assert_numbers(&Baud::ALL);
        assert_numbers(&[
            Method::Level,
            Method::FourEllipse,
            Method::TwoPlane,
            Method::MaximumLikelihood,
            Method::CompassSwing,
            Method::Ellipsoid,
        ]);
    }

    #[test]
    fn what_has_no_room_is_refused() {
        let size = encoded(&contents()).unwrap().len();
        for room in 0..size {
            assert_eq!(contents().encode(&mut vec![0; room]), Err(StoreError::Full), "{room}");
        }
        assert!(contents().encode(&mut vec![0; size]).is_ok());
    }

    /// CRC-32 finds every single-bit error, wherever it is.
    #[test]
    fn a_flipped_bit_is_never_taken_for_contents() {
        let value = encoded(&contents()).unwrap();
        for bit in 0..value.len() * 8 {
            let mut damaged = value.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Contents::decode(&damaged), Err(StoreError::Corrupt), "bit {bit}");
        }
    }

    #[test]
    fn what_is_cut_short_is_never_taken_for_contents() {
        let value = encoded(&contents()).unwrap();
        for length in 0..value.len() {
            assert_eq!(Contents::decode(&value[..length]), Err(StoreError::Corrupt), "{length}");
        }
        for length in 1..value.len() - CRC_SIZE {
            assert_eq!(Contents::decode(&sealed(value[..length].to_vec())), Err(StoreError::Corrupt), "{length}");
        }
        assert_eq!(Contents::decode(&sealed(vec![])), Err(StoreError::Corrupt));
    }

    #[test]
    fn another_version_is_named() {
        for version in [0, 1, VERSION + 1, VERSION + 2, 255] {
            let value = sealed(vec![version, 1, 2, 3]);
            assert_eq!(Contents::decode(&value), Err(StoreError::UnknownVersion(version)));
        }
    }

    /// Neither stored nor believed, or both.
    #[expect(clippy::large_types_passed_by_value, reason = "each call makes one of its own")]
    fn assert_valid(stored: Stored, valid: bool, what: &str) {
        let contents = Contents { saves: 1, stored };
        let value = present(&contents);
        if valid {
            assert_eq!(encoded(&contents).as_deref(), Ok(&value[..]), "{what}");
            assert_eq!(Contents::decode(&value), Ok(contents), "{what}");
        } else {
            assert_eq!(encoded(&contents), Err(StoreError::Invalid), "{what}");
            assert_eq!(Contents::decode(&value), Err(StoreError::Corrupt), "{what}");
        }
    }

    /// An orientation as flash may hold it.
    fn mount(number: u8) -> Orientation {
        postcard::from_bytes(&[number]).unwrap()
    }

    #[test]
    fn settings_are_kept_up_to_the_ends_of_their_ranges() {
        let good = contents().stored;
        let check = |settings: Settings, valid, what: &str| assert_valid(Stored { settings, ..good }, valid, what);
        for (size, valid) in
            [(0.0, true), (179.9, true), (180.0, true), (180.1, false), (f32::INFINITY, false), (f32::NAN, false)]
        {
            for deg in [size, -size] {
                check(Settings { declination_deg: Some(deg), ..good.settings }, valid, "declination");
                check(Settings { align_deg: deg, ..good.settings }, valid, "align");
            }
        }
        for (size, valid) in [(89.9, true), (90.0, true), (90.1, false), (f32::NAN, false)] {
            for deg in [size, -size] {
                check(Settings { inclination_deg: Some(deg), ..good.settings }, valid, "inclination");
            }
        }
        for (stream_rate_hz, valid) in [(0, false), (1, true), (80, true), (81, false)] {
            check(Settings { stream_rate_hz, ..good.settings }, valid, "rate");
        }
        for (bias_deg, valid) in
            [(-0.1, false), (0.0, true), (5.0, true), (5.1, false), (f32::INFINITY, false), (f32::NAN, false)]
        {
            let attitude_error = AttitudeError { bias_deg, ..AttitudeError::DEFAULT };
            check(Settings { attitude_error, ..good.settings }, valid, "attitude bias");
            let attitude_error = AttitudeError { bank_percent: 4.0 * bias_deg, ..AttitudeError::DEFAULT };
            check(Settings { attitude_error, ..good.settings }, valid, "bank error");
        }
        for (accuracy_deg, valid) in
            [(0.19, false), (0.2, true), (3.0, true), (3.1, false), (-1.0, false), (f32::NAN, false)]
        {
            check(Settings { accuracy_deg, ..good.settings }, valid, "accuracy");
        }
        for (number, valid) in [(23, true), (24, false), (255, false)] {
            check(Settings { mount: mount(number), ..good.settings }, valid, "mount");
        }
    }

    /// A change of a number of a record.
    type Set = fn(&mut Record, f32);

    #[test]
    fn records_are_kept_if_every_number_is_finite() {
        let numbers: [(&str, Set); 18] = [
            ("w", |record, n| record.calibration.w[2][1] = n),
            ("b", |record, n| record.calibration.b_ut[1] = n),
            ("inclination", |record, n| record.calibration.inclination_rad = n),
            ("total", |record, n| record.calibration.total_ut = n),
            ("latency", |record, n| record.calibration.latency_s = n),
            ("by current", |record, n| record.calibration.current.ut_per_a[2] = n),
            ("sigma of that", |record, n| record.calibration.current.sigma_ut_per_a = n),
            ("mean current", |record, n| record.calibration.current.mean_a = n),
            ("its spread", |record, n| record.calibration.current.spread_a = n),
            ("latency found", |record, n| record.quality.latency = Some(Latency { found_s: n, sigma_s: 0.01 })),
            ("its sigma", |record, n| record.quality.latency = Some(Latency { found_s: 0.01, sigma_s: n })),
            ("expected", |record, n| record.quality.expected_rms_deg = n),
            ("worst", |record, n| record.quality.expected_worst_deg = n),
            ("norm", |record, n| record.quality.norm_residual = n),
            ("dip", |record, n| record.quality.dip_residual_deg = n),
            ("products", |record, n| record.uncertainty.products[5][9] = n),
            ("sensor sigma", |record, n| record.uncertainty.sensor_sigma = n),
            ("attitude sigma", |record, n| record.uncertainty.attitude_sigma_rad = n),
        ];
        for (what, set) in numbers {
            for (number, valid) in
                [(0.5, true), (f32::MAX, true), (f32::INFINITY, false), (-f32::INFINITY, false), (f32::NAN, false)]
            {
                assert_either_generation(|record| set(record, number), valid, what);
            }
        }
        for (number, valid) in [(23, true), (24, false)] {
            assert_either_generation(|record| record.mount = mount(number), valid, "mount");
        }
    }

    fn assert_either_generation(set: impl Fn(&mut Record), valid: bool, what: &str) {
        let mut record = record(1);
        set(&mut record);
        let good = contents().stored;
        let current = Generations { current: Some(record), ..good.generations };
        let previous = Generations { previous: Some(record), ..good.generations };
        assert_valid(Stored { generations: current, ..good }, valid, what);
        assert_valid(Stored { generations: previous, ..good }, valid, what);
    }

    /// A byte behind the contents, which firmware that knows nothing of it reads as the contents that they are; every byte
    /// is something, and what cannot be is nothing.
    #[test]
    fn what_is_remembered_is_an_optional_byte() {
        let plain = encoded(&contents()).unwrap();
        for byte in 0..=u8::MAX {
            let remembered = Remembered::from_byte(byte);
            let mut contents = contents();
            contents.stored.remembered = remembered;
            let value = encoded(&contents).unwrap();
            assert_eq!(Contents::decode(&value), Ok(contents));
            let is_there = remembered != Remembered::NOTHING;
            assert_eq!(value.len(), plain.len() + usize::from(is_there), "{byte}");
            assert_eq!(value[..plain.len() - CRC_SIZE], plain[..plain.len() - CRC_SIZE], "what is before it stays");
            // As such firmware reads it.
            let [payload @ .., _, _, _, _] = &value[1..] else { panic!() };
            let before: Contents = postcard::from_bytes(payload).unwrap();
            assert_eq!((before.saves, before.stored.settings), (contents.saves, contents.stored.settings));
            let mut sealed_so = plain[..plain.len() - CRC_SIZE].to_vec();
            sealed_so.push(byte);
            assert_eq!(Contents::decode(&sealed(sealed_so)), Ok(contents), "{byte}");
        }
        let all = Remembered { is_collecting: true, found: [ProtocolKind::Msp, ProtocolKind::Mavlink] };
        assert_eq!((all.byte(), Remembered::from_byte(all.byte())), (0b01101, all));
        assert_eq!(Remembered::from_byte(0b11110), Remembered::NOTHING, "sentences are not found");
    }

    /// A calibration ends a collection, a setting does not; neither touches what ports have found.
    #[test]
    fn a_calibration_is_the_end_of_a_collection() {
        let remembered = Remembered { is_collecting: true, found: [ProtocolKind::Msp, ProtocolKind::Auto] };
        let collecting = Contents::default().changed(Change::Remembered(remembered));
        assert_eq!(collecting.stored.remembered, remembered);
        let none = Change::Generations { current: None, previous: None };
        for (change, is_collecting) in [(Change::Settings(&settings()), true), (none, false), (Change::Clear, false)] {
            assert_eq!(collecting.changed(change).stored.remembered, Remembered { is_collecting, ..remembered });
        }
    }

    #[test]
    fn undo_twice_is_redo() {
        let mut generations = Generations::default();
        generations.push(&record(1));
        generations.push(&record(2));
        let before = generations;
        generations.undo();
        assert_eq!(generations, Generations { current: Some(record(1)), previous: Some(record(2)) });
        generations.undo();
        assert_eq!(generations, before);
        generations.clear();
        assert_eq!(generations, Generations::default());
    }
}
