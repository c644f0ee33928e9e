//! Sample memory that survives a reset (`.uninit` RAM); arbitrary at power-on.
//!
//! All fields are integers or `f32`, so every bit pattern is valid. A checksum over header, samples and marks, updated
//! after each change, identifies a stored collection; a reset during a change leaves a mixture that the checksum
//! rejects. It takes 0.3 ms for a full buffer, two or three times a second.
//!
//! The collection's clock continues after a restart; the module's clock, which restarts at zero, is added to it.

mod header;
mod memory_words;

pub use header::{CollectionContext, CollectionState};
pub(super) use header::{CollectionHeader, HOLD_BACK_CYCLE, PartState};

use super::sample_buffer::{SampleBuffer, UNUSED_SAMPLE};
use crate::calibration::HeadingMark;
use memory_words::{Checksum, MemoryWords, words};

/// Capacity for compass-swing marks: one every 10 deg. 1.4 KB.
pub const MARKS_CAPACITY: usize = 36;

/// Layout version; increment when the meaning of header or samples changes.
const LAYOUT_VERSION: u32 = 5;

/// Checksum seed from layout and firmware version, which rejects memory of other firmware.
const FIRMWARE_SEED: u32 = {
    let version = env!("CARGO_PKG_VERSION").as_bytes();
    let mut sum = Checksum(LAYOUT_VERSION);
    let mut at = 0;
    while at < version.len() {
        sum.add_word(version[at] as u32);
        at += 1;
    }
    sum.0
};

/// Unexpected restarts in a row, without a completed solve, after which the samples are discarded as a possible cause.
const MAX_UNEXPECTED_RESTARTS: u32 = 3;

/// Sample memory of one collection, 23 KB.
#[derive(Clone, Debug)]
pub struct RetainedSamples {
    checksum: u32,
    /// Unexpected restarts in a row. Excluded from the checksum: it can be written on its own.
    unexpected_restart_count: u32,
    header: CollectionHeader,
    pub(super) samples: SampleBuffer,
    pub(super) marks: [HeadingMark; MARKS_CAPACITY],
}

words!(SampleBuffer { samples, fit_count, held_back_count });
words!(RetainedSamples { checksum, unexpected_restart_count, header, samples, marks });

impl RetainedSamples {
    /// Memory without a collection.
    pub const EMPTY: Self = Self {
        checksum: 0,
        unexpected_restart_count: 0,
        header: CollectionHeader::EMPTY,
        samples: SampleBuffer::EMPTY,
        marks: [HeadingMark { sample: UNUSED_SAMPLE, heading_rad: 0.0 }; MARKS_CAPACITY],
    };

    /// Transforms every word, to simulate memory contents.
    pub fn transform_words(&mut self, mut transform: impl FnMut(u32) -> u32) {
        self.visit_words(&mut |it| *it = transform(*it));
    }

    /// Whether the checksum matches header, samples and marks, and restarts are below the limit.
    pub(super) fn is_valid(&self) -> bool {
        self.checksum == self.compute_checksum(FIRMWARE_SEED) && self.unexpected_restart_count < MAX_UNEXPECTED_RESTARTS
    }

    /// Header as of the last update.
    pub(super) const fn header(&self) -> &CollectionHeader {
        &self.header
    }

    /// Stores a header that fits the samples and marks, and the checksum of all.
    pub(super) fn write_header_and_checksum(&mut self, header: CollectionHeader) {
        self.header = header;
        self.checksum = self.compute_checksum(FIRMWARE_SEED);
    }

    /// The first `number` marks, at most the capacity.
    pub(super) fn stored_marks(&self, number: u16) -> &[HeadingMark] {
        self.marks.get(..number.into()).unwrap_or_default()
    }

    pub(super) fn count_unexpected_restart(&mut self) {
        self.unexpected_restart_count = self.unexpected_restart_count.saturating_add(1);
    }

    pub(super) fn reset_restart_count(&mut self) {
        self.unexpected_restart_count = 0;
    }

    fn compute_checksum(&self, firmware_seed: u32) -> u32 {
        let mut sum = Checksum(firmware_seed);
        sum.add_words(&self.header);
        // The samples of an inactive collection stay for another solve, until a restart.
        if self.header.state() != CollectionState::Inactive {
            sum.add_words(&[self.samples.fit_count, self.samples.held_back_count]);
            for sample in self.samples.all_samples() {
                sum.add_words(sample);
            }
            for mark in self.stored_marks(self.header.mark_count) {
                sum.add_words(mark);
            }
        }
        sum.0
    }
}

#[cfg(test)]
mod tests;
