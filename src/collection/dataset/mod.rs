//! Samples of left turns, right turns and level flight, in buffers of fixed capacity, evenly spread over heading.

use super::part::{Apart, Config, PartSamples};
use crate::calibration::{Sample, Samples, Side};

pub use super::circle::SECTORS;
pub use super::part::Coverage;

/// Samples for the fit, a side: 16 a sector. 4.6 KB.
pub const FIT_CAPACITY: usize = 16 * SECTORS;

/// Samples held back for verification, a side: 5 a sector. 1.4 KB.
const HELD_BACK_CAPACITY: usize = 5 * SECTORS;

/// Samples of level flight for the fit: 5 a sector and some. 1.5 KB.
const LEVEL_FIT_CAPACITY: usize = 64;

/// Samples of level flight held back. 0.5 KB.
const LEVEL_HELD_BACK_CAPACITY: usize = 20;

/// Samples held back of a part, at the fewest, when it is complete: verification must not ask for more.
pub(crate) const HELD_BACK_WHEN_COMPLETE: u16 = Config::LEVEL.held_back_when_complete();
const _: () = assert!(HELD_BACK_WHEN_COMPLETE <= Config::TURNS.held_back_when_complete());

// A part that could not be filled would never be complete.
const _: () = assert!(Config::TURNS.fits(FIT_CAPACITY) && Config::LEVEL.fits(LEVEL_FIT_CAPACITY));
const _: () = assert!(Apart::DEFAULT.target as usize <= FIT_CAPACITY);
const _: () = assert!(Config::TURNS.held_back_when_complete() as usize <= HELD_BACK_CAPACITY);
const _: () = assert!(Config::LEVEL.held_back_when_complete() as usize <= LEVEL_HELD_BACK_CAPACITY);

/// The samples of both sides and of level flight, each in the order of time.
#[derive(Debug)]
pub(super) struct Dataset {
    left: PartSamples<FIT_CAPACITY, HELD_BACK_CAPACITY>,
    right: PartSamples<FIT_CAPACITY, HELD_BACK_CAPACITY>,
    level: PartSamples<LEVEL_FIT_CAPACITY, LEVEL_HELD_BACK_CAPACITY>,
    /// Distance that samples of all attitudes keep now, microtesla.
    apart_ut: f32,
}

impl Dataset {
    /// No samples.
    pub const fn new() -> Self {
        Self {
            left: PartSamples::new(),
            right: PartSamples::new(),
            level: PartSamples::new(),
            apart_ut: Apart::DEFAULT.distance_ut,
        }
    }

    /// Offers a sample of a turn; keeps it if it adds something.
    pub fn push_turn(&mut self, side: Side, sample: Sample) {
        match side {
            Side::Left => self.left.push(&Config::TURNS, sample),
            Side::Right => self.right.push(&Config::TURNS, sample),
        }
    }

    /// Offers a sample of level flight; keeps it if it adds something.
    pub fn push_level(&mut self, sample: Sample) {
        self.level.push(&Config::LEVEL, sample);
    }

    /// Offers a sample of whatever attitude; keeps it if it is far from the others. They lie where left turns would, of
    /// which there are none then.
    pub fn push_any(&mut self, sample: Sample) {
        self.left.push_apart(&Config::TURNS, &mut self.apart_ut, sample);
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.left.clear();
        self.right.clear();
        self.level.clear();
        self.apart_ut = Apart::DEFAULT.distance_ut;
    }

    /// Samples to solve with, without marks.
    pub fn fit(&self) -> Samples<'_> {
        Samples { left: self.left.fit(), right: self.right.fit(), level: self.level.fit(), marks: &[] }
    }

    /// Samples to verify with; none of them is among those of [`fit`](Self::fit).
    pub fn held_back(&self) -> Samples<'_> {
        Samples {
            left: self.left.held_back(),
            right: self.right.held_back(),
            level: self.level.held_back(),
            marks: &[],
        }
    }

    /// How well the turns of a side are covered; samples of all attitudes count as left turns.
    pub fn turns(&self, side: Side) -> Coverage {
        match side {
            Side::Left => self.left.coverage(),
            Side::Right => self.right.coverage(),
        }
    }

    /// How well level flight is covered.
    pub fn level(&self) -> Coverage {
        self.level.coverage()
    }
}

#[cfg(test)]
mod tests;
