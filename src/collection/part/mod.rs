//! Samples of one part of a flight, such as its left turns, in buffers of fixed capacity.
//!
//! Not more often than attitude errors change is a sample taken; every fourth is held back for verification. What it
//! adds depends on where it lies on the part's circle ([`Circle`]), and for samples of all attitudes on how far it is
//! from the others. A full buffer gives up what it has most of.

use super::buffer::Buffer;
use super::circle::{Circle, SECTORS};
use crate::calibration::{Sample, Samples};
use crate::time::WrappingMillis;

/// Fixed numbers of a part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Config {
    /// Time between two samples, milliseconds. The errors of attitude sources stay alike for about 0.5 s, so more would
    /// only look like more.
    pub spacing_ms: u32,
    /// Every so many samples one is held back.
    pub hold_back_every: u16,
    /// A sector is filled with so many samples for the fit.
    pub sector_target: u16,
    /// The part is complete when all its sectors are filled and it has so many samples for the fit.
    pub target: u16,
    /// The circle must have this radius, microtesla, for its sectors to mean headings: a third of the horizontal field
    /// at 75 deg of inclination. Less is noise of a heading that is held.
    pub min_radius_ut: f32,
    /// Only with so many samples for the fit is a circle told from the noise of a heading that is held.
    pub min_samples: u16,
}

impl Config {
    /// For turns of 5 to 30 deg/s: two passes of a sector at 13 deg/s, and about three circles.
    pub const TURNS: Self = Self {
        spacing_ms: 400,
        hold_back_every: 4,
        sector_target: 8,
        target: 132,
        min_radius_ut: 4.0,
        min_samples: 10,
    };

    /// For level flight, whose buffers are smaller: two circles.
    pub const LEVEL: Self = Self { sector_target: 4, target: 48, ..Self::TURNS };

    /// Whether a buffer of this capacity can hold what makes the part complete.
    pub const fn fits(&self, capacity: usize) -> bool {
        self.target as usize <= capacity
            && self.sector_target as usize * SECTORS <= capacity
            && self.min_samples <= self.target
    }

    /// How many samples are held back, at the fewest, when a part is complete.
    pub const fn held_back_when_complete(&self) -> u16 {
        // Of each round the last one is held back, and the last round need not be over.
        (self.target - 1) / (self.hold_back_every - 1)
    }
}

/// Fixed numbers for samples of all attitudes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Apart {
    /// Samples are so far from each other at the beginning, microtesla: a thirtieth of a circle in a weak field.
    pub distance_ut: f32,
    /// When there is no room for more of them, the distance is multiplied by so much and the crowded ones go.
    pub growth: f32,
    /// So many samples for the fit are called 100 percent.
    pub target: u16,
}

impl Apart {
    /// Numbers for a module turned by hand.
    pub const DEFAULT: Self = Self { distance_ut: 5.0, growth: 1.3, target: 66 };
}

/// How well a part is covered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Coverage {
    /// Samples kept for the fit.
    pub samples: u16,
    /// Samples held back for verification.
    pub held_back: u16,
    /// Sectors with at least one sample, of [`SECTORS`].
    pub sectors: u8,
    /// How much of what the part needs is there, 0..100 percent.
    pub percent: u8,
}

impl Coverage {
    const NONE: Self = Self { samples: 0, held_back: 0, sectors: 0, percent: 0 };

    /// The part has all the samples it needs.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.percent >= 100
    }
}

/// What a sample is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Fit,
    Verification,
}

/// The samples of a part, those to solve with and those to verify with each in the order of time.
#[derive(Debug)]
pub(super) struct PartSamples<'a> {
    fit: Buffer<'a, Sample>,
    held_back: Buffer<'a, Sample>,
    /// Time of the last sample taken.
    last: Option<WrappingMillis>,
    /// How many were taken; wraps, at a multiple of the rounds of [`Config::hold_back_every`].
    taken: u16,
    coverage: Coverage,
}

impl<'a> PartSamples<'a> {
    /// With what the memory holds of samples by its words; with none for words of nothing.
    pub fn new(fit: &'a mut [Sample], held_back: &'a mut [Sample], words: [u32; 2]) -> Self {
        let [lengths, counts] = words;
        let fit = Buffer::new(fit, usize::from(lengths as u16));
        let held_back = Buffer::new(held_back, (lengths >> 16) as usize);
        let [_, _, sectors, percent] = counts.to_le_bytes();
        let mut part = Self { fit, held_back, last: None, taken: counts as u16, coverage: Coverage::NONE };
        part.coverage = Coverage { sectors, percent, ..part.numbers() };
        part
    }

    /// Its words: all that samples do not tell.
    pub fn words(&self) -> [u32; 2] {
        let (fit, held_back) = (self.fit().len() as u32, self.held_back().len() as u32);
        let [low, high] = self.taken.to_le_bytes();
        [fit | held_back << 16, u32::from_le_bytes([low, high, self.coverage.sectors, self.coverage.percent])]
    }

    /// How many were taken; wraps.
    pub fn taken(&self) -> u16 {
        self.taken
    }

    /// Forgets all samples.
    pub fn clear(&mut self) {
        self.fit.clear();
        self.held_back.clear();
        self.last = None;
        self.taken = 0;
        self.coverage = Coverage::NONE;
    }

    /// Samples to solve with.
    pub fn fit(&self) -> &[Sample] {
        self.fit.as_slice()
    }

    /// Samples to verify with.
    pub fn held_back(&self) -> &[Sample] {
        self.held_back.as_slice()
    }

    pub fn coverage(&self) -> Coverage {
        self.coverage
    }

    /// The samples of a purpose.
    pub fn of(&mut self, purpose: Purpose) -> &mut Buffer<'a, Sample> {
        match purpose {
            Purpose::Fit => &mut self.fit,
            Purpose::Verification => &mut self.held_back,
        }
    }

    /// Offers a sample; keeps it if it is not too soon and there is room or it lies where there are fewer.
    pub fn push(&mut self, config: &Config, sample: Sample) {
        if !self.is_due(config, &sample) {
            return;
        }
        let circle = Circle::through(&Samples { left: self.fit(), right: self.held_back(), ..Samples::default() });
        let sector_of = |s: &Sample| circle.map_or(0, |circle| circle.sector(s));
        match self.take(config, &sample) {
            Purpose::Fit => insert(&mut self.fit, sample, sector_of),
            Purpose::Verification => insert(&mut self.held_back, sample, sector_of),
        }
        self.coverage = self.survey(config, circle);
    }

    /// Offers a sample of whatever attitude; keeps it if it is at least `distance_ut` from the others. The distance
    /// grows when there is no room.
    pub fn push_apart(&mut self, config: &Config, distance_ut: &mut f32, sample: Sample) {
        let is_near = |s: &Sample| (s.field.ut - sample.field.ut).norm() < *distance_ut;
        if !self.is_due(config, &sample) || self.fit().iter().chain(self.held_back()).any(is_near) {
            return;
        }
        if self.take(config, &sample) == Purpose::Verification && !self.held_back.is_full() {
            // There is room.
            let _ = self.held_back.push(sample);
        } else {
            if self.fit.is_full() {
                *distance_ut *= Apart::DEFAULT.growth;
                thin(&mut self.fit, *distance_ut);
            }
            // If thinning made no room, the samples are spread as they should be without this one.
            let _ = self.fit.push(sample);
        }
        let percent = percent(self.fit().len() as u16, Apart::DEFAULT.target);
        self.coverage = Coverage { percent, ..self.numbers() };
    }

    /// Whether a sample is a measurement and comes late enough after the last one.
    fn is_due(&self, config: &Config, sample: &Sample) -> bool {
        let is_late = self.last.is_none_or(|last| sample.time.since(last) >= config.spacing_ms);
        is_late && sample.field.ut.iter().all(|c| c.is_finite())
    }

    /// Counts one more that is taken.
    pub fn count(&mut self) {
        self.taken = self.taken.wrapping_add(1);
    }

    /// Notes that a sample is taken, and says what for.
    pub fn take(&mut self, config: &Config, sample: &Sample) -> Purpose {
        self.last = Some(sample.time);
        self.count();
        if self.taken.is_multiple_of(config.hold_back_every) { Purpose::Verification } else { Purpose::Fit }
    }

    /// A coverage that counts samples alone.
    fn numbers(&self) -> Coverage {
        Coverage { samples: self.fit().len() as u16, held_back: self.held_back().len() as u16, ..Coverage::NONE }
    }

    fn survey(&self, config: &Config, circle: Option<Circle>) -> Coverage {
        let numbers = self.numbers();
        let turned = circle.filter(|c| c.radius_ut >= config.min_radius_ut && numbers.samples >= config.min_samples);
        let Some(circle) = turned else { return numbers };
        let counts = count(self.fit(), |s| circle.sector(s));
        Coverage {
            sectors: counts.iter().filter(|&&n| n > 0).count() as u8,
            // A part that was complete stays so: a later sample can move the circle, and with it a sector's border past
            // another sample, but it takes nothing away.
            percent: if self.coverage.is_complete() { 100 } else { percent_of_turn(config, &counts, numbers.samples) },
            ..numbers
        }
    }
}

/// How much of a part is there, by its sectors and by their number, whichever is less.
fn percent_of_turn(config: &Config, counts: &[u16; SECTORS], samples: u16) -> u8 {
    let filled: u16 = counts.iter().map(|&n| n.min(config.sector_target)).sum();
    percent(filled, config.sector_target * SECTORS as u16).min(percent(samples, config.target))
}

/// `part` of `whole` in percent, rounded down, at most 100.
fn percent(part: u16, whole: u16) -> u8 {
    (u32::from(part) * 100 / u32::from(whole).max(1)).min(100) as u8
}

/// Samples by sector.
fn count(samples: &[Sample], sector_of: impl Fn(&Sample) -> usize) -> [u16; SECTORS] {
    let mut counts = [0; SECTORS];
    for sample in samples {
        // `Circle::sector` is below SECTORS.
        if let Some(n) = counts.get_mut(sector_of(sample)) {
            *n += 1;
        }
    }
    counts
}

/// Puts a sample in; when there is no room, the oldest of the most crowded sector makes place for it, unless its own
/// sector is that one.
fn insert(samples: &mut Buffer<'_, Sample>, sample: Sample, sector_of: impl Fn(&Sample) -> usize) {
    if samples.is_full() {
        let counts = count(samples.as_slice(), &sector_of);
        let crowded = (0..SECTORS).max_by_key(|&sector| counts[sector]).unwrap_or(0);
        if crowded == sector_of(&sample) {
            return;
        }
        if let Some(oldest) = samples.as_slice().iter().position(|s| sector_of(s) == crowded) {
            samples.remove(oldest);
        }
    }
    // There is room: the most crowded sector of a full buffer is not empty.
    let _ = samples.push(sample);
}

/// Removes every sample that is nearer than `distance_ut` to one before it.
fn thin(samples: &mut Buffer<'_, Sample>, distance_ut: f32) {
    let mut i = 0;
    while let Some(sample) = samples.as_slice().get(i).copied() {
        let is_near = |s: &Sample| (s.field.ut - sample.field.ut).norm() < distance_ut;
        if samples.as_slice().iter().take(i).any(is_near) {
            samples.remove(i);
        } else {
            i += 1;
        }
    }
}

#[cfg(test)]
mod tests;
