//! Sample buffers for left turns, right turns and level flight, spread over heading.

use super::buffer::BorrowedBuffer;
use super::d_optimal_selection::DOptimalSelection;
use super::part::{PartConfig, PartSamples, SampleUse, TumbleConfig};
use super::retained_samples::PartMemory;
use crate::calibration::{Calibration, Quality, Sample, Samples, Side};
use crate::frames::{Attitude, wrap_pi};
use crate::trig;
use crate::trig::Length as _;

pub use super::circle::SECTORS;
pub use super::part::Coverage;

/// Fit samples per turn side: 16 per sector. 4.6 KB.
pub const FIT_CAPACITY: usize = 16 * SECTORS;

/// Verification samples per turn side: 5 per sector. 1.4 KB.
pub(super) const HELD_BACK_CAPACITY: usize = 5 * SECTORS;

/// Fit samples of level flight: 5 per sector, rounded up. 1.5 KB.
pub(super) const LEVEL_FIT_CAPACITY: usize = 64;

/// Verification samples of level flight. 0.5 KB.
pub(super) const LEVEL_HELD_BACK_CAPACITY: usize = 20;

/// Smallest number of held-back samples in a complete part; verification must not require more.
pub(crate) const MIN_HELD_BACK_WHEN_COMPLETE: u16 = PartConfig::LEVEL.min_held_back_when_complete();
const _: () = assert!(MIN_HELD_BACK_WHEN_COMPLETE <= PartConfig::TURNS.min_held_back_when_complete());

// Every part must be able to become complete.
const _: () =
    assert!(PartConfig::TURNS.fits_capacity(FIT_CAPACITY) && PartConfig::LEVEL.fits_capacity(LEVEL_FIT_CAPACITY));
const _: () = assert!(TumbleConfig::DEFAULT.target as usize <= FIT_CAPACITY);
const _: () = assert!(PartConfig::TURNS.min_held_back_when_complete() as usize <= HELD_BACK_CAPACITY);
const _: () = assert!(PartConfig::LEVEL.min_held_back_when_complete() as usize <= LEVEL_HELD_BACK_CAPACITY);

/// Smallest change of the field between distinct samples, microtesla: three sigma of an averaged sample.
const MIN_FIELD_CHANGE_UT: f32 = 1.0;

/// Smallest change of the attitude between distinct samples, radians (1.5 deg).
const MIN_ATTITUDE_CHANGE_RAD: f32 = 0.026;

fn is_distinct(last: &Sample, sample: &Sample) -> bool {
    let tilt_rad = trig::hypot(
        wrap_pi(sample.attitude.roll_rad - last.attitude.roll_rad),
        sample.attitude.pitch_rad - last.attitude.pitch_rad,
    );
    (sample.field.ut - last.field.ut).length() >= MIN_FIELD_CHANGE_UT || tilt_rad >= MIN_ATTITUDE_CHANGE_RAD
}

#[derive(Debug)]
pub(super) struct Dataset<'a> {
    left: PartSamples<'a>,
    right: PartSamples<'a>,
    level: PartSamples<'a>,
    /// Minimum distance between samples of all attitudes, microtesla; grows when the buffer is full.
    min_distance_ut: f32,
    /// Information of the free-flight fit samples.
    selection: DOptimalSelection,
}

pub(super) type DatasetWords = [u32; 7];

impl<'a> Dataset<'a> {
    pub fn new(
        left: &'a mut PartMemory<FIT_CAPACITY, HELD_BACK_CAPACITY>,
        right: &'a mut PartMemory<FIT_CAPACITY, HELD_BACK_CAPACITY>,
        level: &'a mut PartMemory<LEVEL_FIT_CAPACITY, LEVEL_HELD_BACK_CAPACITY>,
        words: DatasetWords,
    ) -> Self {
        let [left_words @ .., right_lengths, right_counts, level_lengths, level_counts, apart] = words;
        Self {
            left: PartSamples::new(&mut left.fit, &mut left.held_back, left_words),
            right: PartSamples::new(&mut right.fit, &mut right.held_back, [right_lengths, right_counts]),
            level: PartSamples::new(&mut level.fit, &mut level.held_back, [level_lengths, level_counts]),
            min_distance_ut: f32::from_bits(apart),
            selection: DOptimalSelection::NONE,
        }
    }

    pub fn encode(&self) -> DatasetWords {
        let ([a, b], [c, d], [e, f]) = (self.left.encode(), self.right.encode(), self.level.encode());
        [a, b, c, d, e, f, self.min_distance_ut.to_bits()]
    }

    pub fn all_buffers(&self) -> [&[Sample]; 6] {
        let Self { left, right, level, .. } = self;
        [left.fit(), left.held_back(), right.fit(), right.held_back(), level.fit(), level.held_back()]
    }

    pub fn taken_count(&self) -> u16 {
        self.left.taken_count().wrapping_add(self.right.taken_count()).wrapping_add(self.level.taken_count())
    }

    pub fn push_turn(&mut self, side: Side, sample: Sample) {
        match side {
            Side::Left => self.left.push_by_sector(&PartConfig::TURNS, sample),
            Side::Right => self.right.push_by_sector(&PartConfig::TURNS, sample),
        }
    }

    pub fn push_level(&mut self, sample: Sample) {
        self.level.push_by_sector(&PartConfig::LEVEL, sample);
    }

    /// Stores a sample of any attitude if it is far from the others, in the left-turn buffer.
    pub fn push_tumbled(&mut self, sample: Sample) {
        self.left.push_by_distance(&PartConfig::TURNS, &mut self.min_distance_ut, sample);
    }

    /// Stores a free-flight sample in place of the least informative one, in any buffer. Returns whether it is finite
    /// and distinct.
    pub fn push_free_flight(&mut self, sample: Sample) -> bool {
        let is_news = self.is_new_measurement(&sample);
        if is_news {
            self.replace_weakest(sample);
        }
        is_news
    }

    /// Number of free-flight samples stored, including replacements; wraps. Counted in the right-turn part.
    pub fn stored_free_flight(&self) -> u16 {
        self.right.taken_count()
    }

    pub fn use_trial_solution(&mut self, calibration: &Calibration, quality: &Quality) {
        self.selection.use_trial_solution(calibration, quality);
    }

    pub fn uses_trial_solution(&self) -> bool {
        self.selection.uses_trial_solution()
    }

    fn replace_weakest(&mut self, sample: Sample) {
        // The left-turn part counts free-flight samples for the hold-back cycle.
        let purpose = self.left.assign_use(&PartConfig::TURNS, &sample);
        if self.buffers(purpose).into_iter().any(|buffer| buffer.push(sample)) {
            self.right.count_sample();
            return;
        }
        if purpose == SampleUse::Fit && !self.selection.may_exceed_weakest(&sample) {
            return;
        }
        let Self { left, right, level, selection: known, .. } = self;
        let any = match purpose {
            SampleUse::Fit => [left.fit(), right.fit(), level.fit()],
            SampleUse::Verification => [left.held_back(), right.held_back(), level.held_back()],
        };
        let lengths = any.map(<[_]>::len);
        let samples = Samples { left: core::slice::from_ref(&sample), unassigned: any, ..Samples::default() };
        let mut verification_terms = known.for_other_set();
        let known = if purpose == SampleUse::Fit { known } else { &mut verification_terms };
        let weakest = known.find_weakest(samples);
        let Some(mut place) = weakest.and_then(|place| place.checked_sub(1)) else { return };
        self.right.count_sample();
        for (buffer, length) in self.buffers(purpose).into_iter().zip(lengths) {
            if place < length {
                return buffer.remove_and_push(place, sample);
            }
            place -= length;
        }
    }

    fn buffers(&mut self, purpose: SampleUse) -> [&mut BorrowedBuffer<'a, Sample>; 3] {
        [self.left.buffer_mut(purpose), self.right.buffer_mut(purpose), self.level.buffer_mut(purpose)]
    }

    /// Whether a sample is finite and differs from the last stored one. A parked aircraft adds no information, and may
    /// be near the iron of a hangar.
    fn is_new_measurement(&self, sample: &Sample) -> bool {
        let buffers_with_sample =
            [self.free_flight_fit(), self.free_flight_held_back()].into_iter().flat_map(|samples| samples.unassigned);
        let last = buffers_with_sample.filter_map(<[_]>::last).min_by_key(|last| sample.time.ms_since(last.time));
        let Attitude { roll_rad, pitch_rad } = sample.attitude;
        let is_measurement = sample.field.ut.iter().chain(&[roll_rad, pitch_rad]).all(|c| c.is_finite());
        is_measurement && last.is_none_or(|last| is_distinct(last, sample))
    }

    pub fn free_flight_fit(&self) -> Samples<'_> {
        Samples { unassigned: [self.left.fit(), self.right.fit(), self.level.fit()], ..Samples::default() }
    }

    pub fn free_flight_held_back(&self) -> Samples<'_> {
        let any = [self.left.held_back(), self.right.held_back(), self.level.held_back()];
        Samples { unassigned: any, ..Samples::default() }
    }

    pub fn free_flight_coverage(&self) -> Coverage {
        let number = |samples: Samples<'_>| samples.unassigned_count() as u16;
        let (samples, held_back) = (number(self.free_flight_fit()), number(self.free_flight_held_back()));
        Coverage { samples, held_back, ..Coverage::default() }
    }

    pub fn clear(&mut self) {
        self.left.clear();
        self.right.clear();
        self.level.clear();
        self.min_distance_ut = TumbleConfig::DEFAULT.initial_distance_ut;
        self.selection.reset();
    }

    pub fn fit(&self) -> Samples<'_> {
        Samples { left: self.left.fit(), right: self.right.fit(), level: self.level.fit(), ..Samples::default() }
    }

    pub fn held_back(&self) -> Samples<'_> {
        Samples {
            left: self.left.held_back(),
            right: self.right.held_back(),
            level: self.level.held_back(),
            ..Samples::default()
        }
    }

    /// Samples of all attitudes count as left turns.
    pub fn turn_coverage(&self, side: Side) -> Coverage {
        match side {
            Side::Left => self.left.coverage(),
            Side::Right => self.right.coverage(),
        }
    }

    pub fn level_coverage(&self) -> Coverage {
        self.level.coverage()
    }
}

#[cfg(test)]
mod tests;
