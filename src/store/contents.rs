//! What is stored.

use core::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::calibration::{Calibration, Orientation, Quality};
use crate::magnetometer::Identity;

/// What the user has chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Magnetic declination (variation), degrees, east positive; none if it was never entered.
    pub declination_deg: Option<f32>,
    /// Whether heading is sent on the autopilot port.
    pub stream_on: bool,
    /// Headings a second on the autopilot port.
    pub stream_rate_hz: u8,
    /// How the chip sits in the aircraft.
    pub mount: Orientation,
}

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Settings {
    /// As delivered: ten sentences a second is what autopilots expect of a compass.
    pub const DEFAULT: Self =
        Self { declination_deg: None, stream_on: true, stream_rate_hz: 10, mount: Orientation::NONE };

    /// Rates that can be chosen: up to one heading for every measurement.
    pub const STREAM_RATE_HZ: RangeInclusive<u8> = 1..=80;

    /// Whether every setting is within its range: declination -180..180 deg, rate [`Self::STREAM_RATE_HZ`].
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.declination_deg.is_none_or(|declination_deg| declination_deg.abs() <= 180.0)
            && Self::STREAM_RATE_HZ.contains(&self.stream_rate_hz)
            && self.mount.is_valid()
    }
}

/// A calibration with what is needed to judge whether it may be used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The coefficients.
    pub calibration: Calibration,
    /// How good they are expected to be.
    pub quality: Quality,
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
    pub fn push(&mut self, record: Record) {
        self.previous = self.current.replace(record);
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

/// All that is stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Contents {
    pub settings: Settings,
    pub generations: Generations,
}

impl Contents {
    pub fn is_valid(&self) -> bool {
        self.settings.is_valid() && self.generations.is_valid()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::tests::record;

    #[test]
    fn undo_twice_is_redo() {
        let mut generations = Generations::default();
        generations.push(record(1));
        generations.push(record(2));
        let before = generations;
        generations.undo();
        assert_eq!(generations.current, Some(record(1)));
        generations.undo();
        assert_eq!(generations, before);
    }
}
