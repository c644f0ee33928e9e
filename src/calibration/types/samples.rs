//! Samples of a flight, and their parts.

use core::fmt::Debug;

use super::rates::Rates;
use crate::frames::{Attitude, Field, Sensor, wrap_pi};
use crate::time::WrappingMillis;

/// A field measurement with the attitude at its time: the input of calibration. 28 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Raw field, chip axes, microtesla.
    pub field: Field<Sensor>,
    /// Attitude interpolated to the time of the measurement.
    pub attitude: Attitude,
    /// Attitude rates and motor current.
    pub rates: Rates,
    /// Time of the measurement. Only order and differences within one turn are used.
    pub time: WrappingMillis,
}

impl Sample {
    /// Attitude extrapolated by `latency_s` seconds along its rates: compensates an attitude source that lags by that
    /// time.
    #[must_use]
    pub fn latency_compensated_attitude(&self, latency_s: f32) -> Attitude {
        let Attitude { roll_rad, pitch_rad } = self.attitude;
        Attitude {
            roll_rad: wrap_pi(roll_rad + latency_s * self.rates.roll_rad_s()),
            pitch_rad: pitch_rad + latency_s * self.rates.pitch_rad_s(),
        }
    }
}

/// Direction of a turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Side {
    /// Left wing down, heading decreasing.
    Left,
    /// Right wing down, heading increasing.
    Right,
}

impl Side {
    /// Lower-case English name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// Samples of a flight. Each part is ordered by time and may be empty.
#[derive(Clone, Copy, Debug, Default)]
pub struct Samples<'a> {
    /// Samples of left turns.
    pub left: &'a [Sample],
    /// Samples of right turns.
    pub right: &'a [Sample],
    /// Samples at small bank, all headings.
    pub level: &'a [Sample],
    /// Samples of arbitrary attitude, not assigned to a turn; up to three slices.
    pub unassigned: [&'a [Sample]; 3],
    /// Samples with a given heading.
    pub marks: &'a [Mark],
}

/// A sample with a known heading (compass swing). 32 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    /// The sample.
    pub sample: Sample,
    /// Magnetic heading, radians.
    pub heading_rad: f32,
}

/// A part of the [`Samples`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SamplePart {
    /// Turns of a side.
    Turns(Side),
    /// Level flight.
    Level,
    /// Samples with given headings.
    Marks,
    /// All parts.
    All,
}

impl SamplePart {
    /// English name, plural.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Turns(Side::Left) => "left turns",
            Self::Turns(Side::Right) => "right turns",
            Self::Level => "level headings",
            Self::Marks => "marks",
            Self::All => "all attitudes",
        }
    }
}

impl<'a> Samples<'a> {
    /// Iterates over the samples without a given heading: left turns, right turns, level flight, arbitrary attitudes.
    pub fn iter(&self) -> impl Iterator<Item = &'a Sample> + Clone + Debug + use<'a> {
        let [first, second, third] = self.unassigned;
        SliceChain {
            current_slice: self.left.iter(),
            next_slices: [self.right, self.level, first, second, third],
            started_slices: 0,
        }
    }

    /// Iterates over all samples, those with given headings last.
    pub fn all(&self) -> impl Iterator<Item = &'a Sample> + Clone + Debug + use<'a> {
        self.iter().chain(self.marks.iter().map(|mark| &mark.sample))
    }

    pub(crate) fn unassigned_count(&self) -> usize {
        self.unassigned.iter().map(|piece| piece.len()).sum()
    }

    pub(crate) fn has_unassigned(&self) -> bool {
        self.unassigned_count() > 0
    }
}

/// Iterator over six slices. `Iterator::chain` would test each level of nesting for every sample.
#[derive(Clone, Debug)]
struct SliceChain<'a> {
    current_slice: core::slice::Iter<'a, Sample>,
    next_slices: [&'a [Sample]; 5],
    started_slices: usize,
}

impl<'a> SliceChain<'a> {
    fn start_next_slice(&mut self) -> Option<&'a Sample> {
        while let Some(piece) = self.next_slices.get(self.started_slices) {
            self.started_slices += 1;
            self.current_slice = piece.iter();
            if let Some(sample) = self.current_slice.next() {
                return Some(sample);
            }
        }
        None
    }
}

impl<'a> Iterator for SliceChain<'a> {
    type Item = &'a Sample;

    fn next(&mut self) -> Option<Self::Item> {
        match self.current_slice.next() {
            Some(sample) => Some(sample),
            None => self.start_next_slice(),
        }
    }
}
