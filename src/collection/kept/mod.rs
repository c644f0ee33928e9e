//! The memory of a collection, which a board keeps over a restart: it is lent by whoever has it, and may hold anything at a
//! start.
//!
//! What it holds is made of `u32` and `f32` alone, so that every content is one. Which is a collection's is told by a sum
//! over all that counts, made anew after each change ([`Header::seal`]). A restart in the midst of a change leaves some words
//! of before and some of after it, whose sum is neither's: nothing else has to mark a change. A sum takes a quarter of a
//! millisecond where all buffers are full, two or three times a second.
//!
//! Times are left as they are: the clock of a collection goes on where it stood ([`Collector`](super::Collector)), and that
//! of the module, which begins anew, is added to it.

#[cfg(test)]
mod tests;

use super::MARKS_CAPACITY;
use super::dataset::{FIT_CAPACITY, HELD_BACK_CAPACITY, LEVEL_FIT_CAPACITY, LEVEL_HELD_BACK_CAPACITY};
use crate::calibration::{Mark, Rates, Sample};
use crate::frames::{Attitude, Field};
use crate::time::WrappingMillis;

/// Raised when the words below mean something else, or a sample's do.
const LAYOUT: u32 = 1;

/// Where a sum begins: another firmware, which may mean something else by the same words, has other sums.
const FIRMWARE: u32 = {
    let version = env!("CARGO_PKG_VERSION").as_bytes();
    let mut sum = Sum(LAYOUT);
    let mut at = 0;
    while at < version.len() {
        sum.add(version[at] as u32);
        at += 1;
    }
    sum.0
};

/// Restarts in a row that nobody asked for, with no solve ended between them: what was collected may be why, and goes.
const MAX_RESTARTS: u32 = 3;

const NOTHING: Sample = Sample::from_words([0; 7]);

/// So much memory of a collection: 15.6 KB.
#[derive(Clone, Debug)]
pub struct Kept {
    pub(super) header: Header,
    pub(super) left: Room<FIT_CAPACITY, HELD_BACK_CAPACITY>,
    pub(super) right: Room<FIT_CAPACITY, HELD_BACK_CAPACITY>,
    pub(super) level: Room<LEVEL_FIT_CAPACITY, LEVEL_HELD_BACK_CAPACITY>,
    pub(super) marks: [Mark; MARKS_CAPACITY],
}

/// Room for the samples of a part.
#[derive(Clone, Debug)]
pub(super) struct Room<const FIT: usize, const HELD: usize> {
    pub fit: [Sample; FIT],
    pub held_back: [Sample; HELD],
}

impl<const FIT: usize, const HELD: usize> Room<FIT, HELD> {
    const EMPTY: Self = Self { fit: [NOTHING; FIT], held_back: [NOTHING; HELD] };
}

impl Kept {
    /// With nothing in it.
    pub const EMPTY: Self = Self {
        header: Header { sum: 0, restarts: 0, words: [0; WORDS] },
        left: Room::EMPTY,
        right: Room::EMPTY,
        level: Room::EMPTY,
        marks: [Mark { sample: NOTHING, heading_rad: 0.0 }; MARKS_CAPACITY],
    };

    /// Changes every word of it: for whoever simulates memory, which may hold anything.
    pub fn change(&mut self, mut word: impl FnMut(u32) -> u32) {
        let Self { header: Header { sum, restarts, words }, left, right, level, marks } = self;
        [sum, restarts].into_iter().chain(words).for_each(|it| *it = word(*it));
        let parts = [&mut left.fit[..], &mut left.held_back, &mut right.fit, &mut right.held_back];
        let parts = parts.into_iter().chain([&mut level.fit[..], &mut level.held_back]).flatten();
        for sample in parts.chain(marks.iter_mut().map(|mark| &mut mark.sample)) {
            *sample = Sample::from_words(sample.words().map(&mut word));
        }
        for mark in marks {
            mark.heading_rad = f32::from_bits(word(mark.heading_rad.to_bits()));
        }
    }
}

/// Numbers of a collection beside its samples.
pub(super) const WORDS: usize = 17;

/// What tells whether the memory holds a collection, and which.
#[derive(Clone, Debug)]
pub(super) struct Header {
    sum: u32,
    /// Not in the sum: a wrong number keeps or drops what is right.
    restarts: u32,
    words: [u32; WORDS],
}

impl Header {
    /// Whether the words and these samples and marks, as many as the words say that there are, are what was sealed.
    pub fn is_of(&self, samples: [&[Sample]; 6], marks: &[Mark]) -> bool {
        self.sum == sum(FIRMWARE, &self.words, samples, marks) && self.restarts < MAX_RESTARTS
    }

    /// What was sealed, or anything.
    pub const fn words(&self) -> &[u32; WORDS] {
        &self.words
    }

    /// Says that these words and samples and marks belong together.
    pub fn seal(&mut self, words: [u32; WORDS], samples: [&[Sample]; 6], marks: &[Mark]) {
        self.sum = sum(FIRMWARE, &words, samples, marks);
        self.words = words;
    }

    /// The module has started again.
    pub fn count_restart(&mut self) {
        self.restarts = self.restarts.saturating_add(1);
    }

    /// Restarts before this are no sign of anything.
    pub fn forgive_restarts(&mut self) {
        self.restarts = 0;
    }
}

#[inline(never)]
fn sum(firmware: u32, words: &[u32; WORDS], samples: [&[Sample]; 6], marks: &[Mark]) -> u32 {
    let mut sum = Sum(firmware);
    for &word in words {
        sum.add(word);
    }
    let marked = marks.iter().map(|mark| &mark.sample);
    for sample in samples.into_iter().flatten().chain(marked) {
        for word in sample.words() {
            sum.add(word);
        }
    }
    for mark in marks {
        sum.add(mark.heading_rad.to_bits());
    }
    sum.0
}

/// A sum of words that their order counts in, which a change of any one of them changes: a step can be undone (Fowler, Noll
/// and Vo's hash, with a turn so that high bits reach low ones). Of other contents one in 2^32 has the same.
struct Sum(u32);

impl Sum {
    const fn add(&mut self, word: u32) {
        self.0 = (self.0.rotate_left(5) ^ word).wrapping_mul(0x9E37_79B9);
    }
}

impl Sample {
    /// All of it, as words.
    const fn words(&self) -> [u32; 7] {
        let Self { field, attitude: Attitude { roll_rad, pitch_rad }, rates, time } = self;
        let [[x, y, z]] = field.ut.data.0;
        [x.to_bits(), y.to_bits(), z.to_bits(), roll_rad.to_bits(), pitch_rad.to_bits(), rates.word(), time.count()]
    }

    /// The sample of these words.
    const fn from_words([x, y, z, roll, pitch, rates, time]: [u32; 7]) -> Self {
        Self {
            field: Field::from_ut(f32::from_bits(x), f32::from_bits(y), f32::from_bits(z)),
            attitude: Attitude { roll_rad: f32::from_bits(roll), pitch_rad: f32::from_bits(pitch) },
            rates: Rates::from_word(rates),
            time: WrappingMillis::new(time),
        }
    }
}
