//! Samples of left turns, right turns and level flight, in buffers of fixed capacity, evenly spread over heading.

use super::buffer::Buffer;
use super::kept::Room;
use super::part::{Apart, Config, PartSamples, Purpose};
use super::spread::Spread;
use crate::calibration::{Calibration, Quality, Sample, Samples, Side};
use crate::frames::{Attitude, wrap_pi};
use crate::trig;

pub use super::circle::SECTORS;
pub use super::part::Coverage;

/// Samples for the fit, a side: 16 a sector. 4.6 KB.
pub const FIT_CAPACITY: usize = 16 * SECTORS;

/// Samples held back for verification, a side: 5 a sector. 1.4 KB.
pub(super) const HELD_BACK_CAPACITY: usize = 5 * SECTORS;

/// Samples of level flight for the fit: 5 a sector and some. 1.5 KB.
pub(super) const LEVEL_FIT_CAPACITY: usize = 64;

/// Samples of level flight held back. 0.5 KB.
pub(super) const LEVEL_HELD_BACK_CAPACITY: usize = 20;

/// Samples held back of a part, at the fewest, when it is complete: verification must not ask for more.
pub(crate) const HELD_BACK_WHEN_COMPLETE: u16 = Config::LEVEL.held_back_when_complete();
const _: () = assert!(HELD_BACK_WHEN_COMPLETE <= Config::TURNS.held_back_when_complete());

// A part that could not be filled would never be complete.
const _: () = assert!(Config::TURNS.fits(FIT_CAPACITY) && Config::LEVEL.fits(LEVEL_FIT_CAPACITY));
const _: () = assert!(Apart::DEFAULT.target as usize <= FIT_CAPACITY);
const _: () = assert!(Config::TURNS.held_back_when_complete() as usize <= HELD_BACK_CAPACITY);
const _: () = assert!(Config::LEVEL.held_back_when_complete() as usize <= LEVEL_HELD_BACK_CAPACITY);

/// A field that differs by less is the same, microtesla: three sigmas of a sample's noise.
const MIN_MOVE_UT: f32 = 1.0;

/// So is an attitude, radians: 1.5 deg.
const MIN_TILT_RAD: f32 = 0.026;

fn has_moved(last: &Sample, sample: &Sample) -> bool {
    let tilt_rad = trig::hypot(
        wrap_pi(sample.attitude.roll_rad - last.attitude.roll_rad),
        sample.attitude.pitch_rad - last.attitude.pitch_rad,
    );
    (sample.field.ut - last.field.ut).norm() >= MIN_MOVE_UT || tilt_rad >= MIN_TILT_RAD
}

/// The samples of both sides and of level flight, each in the order of time.
#[derive(Debug)]
pub(super) struct Dataset<'a> {
    left: PartSamples<'a>,
    right: PartSamples<'a>,
    level: PartSamples<'a>,
    /// Distance that samples of all attitudes keep now, microtesla.
    apart_ut: f32,
    /// What those to solve with told together when one was last held against all of them.
    known: Spread,
}

/// Words of a dataset: all that its samples do not tell.
pub(super) type Words = [u32; 7];

impl<'a> Dataset<'a> {
    /// With what the memory holds of samples by its words; with none for words of nothing.
    pub fn new(
        left: &'a mut Room<FIT_CAPACITY, HELD_BACK_CAPACITY>,
        right: &'a mut Room<FIT_CAPACITY, HELD_BACK_CAPACITY>,
        level: &'a mut Room<LEVEL_FIT_CAPACITY, LEVEL_HELD_BACK_CAPACITY>,
        words: Words,
    ) -> Self {
        let [of_left @ .., right_lengths, right_counts, level_lengths, level_counts, apart] = words;
        Self {
            left: PartSamples::new(&mut left.fit, &mut left.held_back, of_left),
            right: PartSamples::new(&mut right.fit, &mut right.held_back, [right_lengths, right_counts]),
            level: PartSamples::new(&mut level.fit, &mut level.held_back, [level_lengths, level_counts]),
            apart_ut: f32::from_bits(apart),
            known: Spread::NONE,
        }
    }

    /// Its words.
    pub fn words(&self) -> Words {
        let ([a, b], [c, d], [e, f]) = (self.left.words(), self.right.words(), self.level.words());
        [a, b, c, d, e, f, self.apart_ut.to_bits()]
    }

    /// All its samples.
    pub fn all(&self) -> [&[Sample]; 6] {
        let Self { left, right, level, .. } = self;
        [left.fit(), left.held_back(), right.fit(), right.held_back(), level.fit(), level.held_back()]
    }

    /// How many samples were taken, or looked at more closely than that they come too soon; wraps.
    pub fn taken(&self) -> u16 {
        self.left.taken().wrapping_add(self.right.taken()).wrapping_add(self.level.taken())
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

    /// Offers a sample of whatever is flown; keeps it if it tells more than one of those that are there. They lie where
    /// those of turns and level flight would, of which there are none then. Whether it is another measurement than the
    /// last, kept or not.
    pub fn push_spread(&mut self, sample: Sample) -> bool {
        let is_news = self.is_news(&sample);
        if is_news {
            self.exchange(sample);
        }
        is_news
    }

    /// How many of whatever was flown were kept, at first or in place of others; wraps. Counted with the right piece,
    /// whichever they lie in.
    pub fn kept(&self) -> u16 {
        self.right.taken()
    }

    /// From now on samples of whatever is flown are chosen by coefficients that fit as well as this.
    pub fn learn(&mut self, calibration: &Calibration, quality: &Quality) {
        self.known.learn(calibration, quality);
    }

    /// Whether they are.
    #[cfg(test)]
    pub fn has_learnt(&self) -> bool {
        self.known.has_learnt()
    }

    fn exchange(&mut self, sample: Sample) {
        // Counted with the left piece, whichever it will lie in.
        let purpose = self.left.take(&Config::TURNS, &sample);
        if self.pieces(purpose).into_iter().any(|piece| piece.push(sample)) {
            self.right.count();
            return;
        }
        if purpose == Purpose::Fit && !self.known.may_gain(&sample) {
            return;
        }
        let Self { left, right, level, known, .. } = self;
        let any = match purpose {
            Purpose::Fit => [left.fit(), right.fit(), level.fit()],
            Purpose::Verification => [left.held_back(), right.held_back(), level.held_back()],
        };
        let lengths = any.map(<[_]>::len);
        let samples = Samples { left: core::slice::from_ref(&sample), any, ..Samples::default() };
        let mut of_verification = known.of_others();
        let known = if purpose == Purpose::Fit { known } else { &mut of_verification };
        let weakest = known.weakest(samples);
        // The first is the new one.
        let Some(mut place) = weakest.and_then(|place| place.checked_sub(1)) else { return };
        self.right.count();
        for (piece, length) in self.pieces(purpose).into_iter().zip(lengths) {
            if place < length {
                return piece.replace(place, sample);
            }
            place -= length;
        }
    }

    fn pieces(&mut self, purpose: Purpose) -> [&mut Buffer<'a, Sample>; 3] {
        [self.left.of(purpose), self.right.of(purpose), self.level.of(purpose)]
    }

    /// Whether a sample is a measurement, and another than the last one: who stands tells nothing twice, and may stand
    /// beside a hangar.
    fn is_news(&self, sample: &Sample) -> bool {
        let kept = [self.spread(), self.spread_held_back()].into_iter().flat_map(|samples| samples.any);
        let last = kept.filter_map(<[_]>::last).min_by_key(|last| sample.time.since(last.time));
        let Attitude { roll_rad, pitch_rad } = sample.attitude;
        let is_measurement = sample.field.ut.iter().chain(&[roll_rad, pitch_rad]).all(|c| c.is_finite());
        is_measurement && last.is_none_or(|last| has_moved(last, sample))
    }

    /// Samples of whatever was flown to solve with.
    pub fn spread(&self) -> Samples<'_> {
        Samples { any: [self.left.fit(), self.right.fit(), self.level.fit()], ..Samples::default() }
    }

    /// The same to verify with.
    pub fn spread_held_back(&self) -> Samples<'_> {
        let any = [self.left.held_back(), self.right.held_back(), self.level.held_back()];
        Samples { any, ..Samples::default() }
    }

    /// How many there are of whatever was flown. What they are worth is not in their number.
    pub fn spread_coverage(&self) -> Coverage {
        let number = |samples: Samples<'_>| samples.number_of_any() as u16;
        let (samples, held_back) = (number(self.spread()), number(self.spread_held_back()));
        Coverage { samples, held_back, ..Coverage::default() }
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.left.clear();
        self.right.clear();
        self.level.clear();
        self.apart_ut = Apart::DEFAULT.distance_ut;
        self.known.forget();
    }

    /// Samples to solve with, without marks.
    pub fn fit(&self) -> Samples<'_> {
        Samples { left: self.left.fit(), right: self.right.fit(), level: self.level.fit(), ..Samples::default() }
    }

    /// Samples to verify with; none of them is among those of [`fit`](Self::fit).
    pub fn held_back(&self) -> Samples<'_> {
        Samples {
            left: self.left.held_back(),
            right: self.right.held_back(),
            level: self.level.held_back(),
            ..Samples::default()
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
