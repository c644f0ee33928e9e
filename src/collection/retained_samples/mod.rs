//! Sample memory that survives a reset (`.uninit` RAM); arbitrary at power-on.
//!
//! All fields are `u32` or `f32`, so every bit pattern is valid. A checksum over header, samples and marks, updated
//! after each change, identifies a stored collection; a reset during a change leaves a mixture that the checksum
//! rejects. It takes 0.25 ms for full buffers, two or three times a second.
//!
//! The collection's clock continues after a restart; the module's clock, which restarts at zero, is added to it.

#[cfg(test)]
mod tests;

use super::MARKS_CAPACITY;
use super::dataset::{FIT_CAPACITY, HELD_BACK_CAPACITY, LEVEL_FIT_CAPACITY, LEVEL_HELD_BACK_CAPACITY};
use crate::calibration::{Mark, Rates, Sample};
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

/// Layout version; increment when the meaning of header words or samples changes.
const LAYOUT_VERSION: u32 = 1;

/// Checksum seed from layout and firmware version, which rejects memory of other firmware.
const FIRMWARE_SEED: u32 = {
    let version = env!("CARGO_PKG_VERSION").as_bytes();
    let mut sum = Checksum(LAYOUT_VERSION);
    let mut at = 0;
    while at < version.len() {
        sum.add(version[at] as u32);
        at += 1;
    }
    sum.0
};

/// Unexpected restarts in a row, without a completed solve, after which the samples are discarded as a possible cause.
const MAX_RESTARTS: u32 = 3;

const ZERO_SAMPLE: Sample = Sample::decode([0; 7]);

/// Sample memory of one collection, 15.6 KB.
#[derive(Clone, Debug)]
pub struct RetainedSamples {
    pub(super) header: MemoryHeader,
    pub(super) left: PartMemory<FIT_CAPACITY, HELD_BACK_CAPACITY>,
    pub(super) right: PartMemory<FIT_CAPACITY, HELD_BACK_CAPACITY>,
    pub(super) level: PartMemory<LEVEL_FIT_CAPACITY, LEVEL_HELD_BACK_CAPACITY>,
    pub(super) marks: [Mark; MARKS_CAPACITY],
}

#[derive(Clone, Debug)]
pub(super) struct PartMemory<const FIT: usize, const HELD: usize> {
    pub fit: [Sample; FIT],
    pub held_back: [Sample; HELD],
}

impl<const FIT: usize, const HELD: usize> PartMemory<FIT, HELD> {
    const EMPTY: Self = Self { fit: [ZERO_SAMPLE; FIT], held_back: [ZERO_SAMPLE; HELD] };
}

impl RetainedSamples {
    /// No collection.
    pub const EMPTY: Self = Self {
        header: MemoryHeader { checksum: 0, unexpected_restarts: 0, words: [0; HEADER_WORDS] },
        left: PartMemory::EMPTY,
        right: PartMemory::EMPTY,
        level: PartMemory::EMPTY,
        marks: [Mark { sample: ZERO_SAMPLE, heading_rad: 0.0 }; MARKS_CAPACITY],
    };

    /// Transforms every word, to simulate memory contents.
    pub fn transform_words(&mut self, mut word: impl FnMut(u32) -> u32) {
        let Self {
            header: MemoryHeader { checksum: sum, unexpected_restarts: restarts, words },
            left,
            right,
            level,
            marks,
        } = self;
        [sum, restarts].into_iter().chain(words).for_each(|it| *it = word(*it));
        let parts = [&mut left.fit[..], &mut left.held_back, &mut right.fit, &mut right.held_back];
        let parts = parts.into_iter().chain([&mut level.fit[..], &mut level.held_back]).flatten();
        for sample in parts.chain(marks.iter_mut().map(|mark| &mut mark.sample)) {
            *sample = Sample::decode(sample.encode().map(&mut word));
        }
        for mark in marks {
            mark.heading_rad = f32::from_bits(word(mark.heading_rad.to_bits()));
        }
    }
}

pub(super) const HEADER_WORDS: usize = 17;

#[derive(Clone, Debug)]
pub(super) struct MemoryHeader {
    checksum: u32,
    /// Unexpected restarts in a row. Excluded from the checksum: it can be written on its own.
    unexpected_restarts: u32,
    words: [u32; HEADER_WORDS],
}

impl MemoryHeader {
    /// Whether the checksum matches header, samples and marks, and restarts are below the limit.
    pub fn matches(&self, samples: [&[Sample]; 6], marks: &[Mark]) -> bool {
        self.checksum == compute_checksum(FIRMWARE_SEED, &self.words, samples, marks)
            && self.unexpected_restarts < MAX_RESTARTS
    }

    pub const fn words(&self) -> &[u32; HEADER_WORDS] {
        &self.words
    }

    pub fn seal(&mut self, words: [u32; HEADER_WORDS], samples: [&[Sample]; 6], marks: &[Mark]) {
        self.checksum = compute_checksum(FIRMWARE_SEED, &words, samples, marks);
        self.words = words;
    }

    pub fn count_unexpected_restart(&mut self) {
        self.unexpected_restarts = self.unexpected_restarts.saturating_add(1);
    }

    pub fn reset_restart_count(&mut self) {
        self.unexpected_restarts = 0;
    }
}

fn compute_checksum(firmware: u32, words: &[u32; HEADER_WORDS], samples: [&[Sample]; 6], marks: &[Mark]) -> u32 {
    let mut sum = Checksum(firmware);
    for &word in words {
        sum.add(word);
    }
    let marked = marks.iter().map(|mark| &mark.sample);
    for sample in samples.into_iter().flatten().chain(marked) {
        for word in sample.encode() {
            sum.add(word);
        }
    }
    for mark in marks {
        sum.add(mark.heading_rad.to_bits());
    }
    sum.0
}

/// Order-dependent checksum. Each step is invertible, so any change of a single word changes it; other content collides
/// at a rate of 2^-32. FNV (Fowler, Noll, Vo) with a rotation that feeds high bits into low ones.
struct Checksum(u32);

impl Checksum {
    const fn add(&mut self, word: u32) {
        self.0 = (self.0.rotate_left(5) ^ word).wrapping_mul(0x9E37_79B9);
    }
}

impl Sample {
    const fn encode(&self) -> [u32; 7] {
        let Self { field, attitude: Attitude { roll_rad, pitch_rad }, rates, time } = self;
        let [[x, y, z]] = field.ut.data.0;
        [x.to_bits(), y.to_bits(), z.to_bits(), roll_rad.to_bits(), pitch_rad.to_bits(), rates.to_bits(), time.as_ms()]
    }

    const fn decode([x, y, z, roll, pitch, rates, time]: [u32; 7]) -> Self {
        Self {
            field: Field::from_ut(f32::from_bits(x), f32::from_bits(y), f32::from_bits(z)),
            attitude: Attitude { roll_rad: f32::from_bits(roll), pitch_rad: f32::from_bits(pitch) },
            rates: Rates::from_bits(rates),
            time: WrappingMillis::new(time),
        }
    }
}
