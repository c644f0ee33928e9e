//! Sample buffers of one part of a flight.
//!
//! A full buffer replaces samples in its most crowded heading sector; for samples of all attitudes it keeps a minimum
//! distance in field space instead.

use super::buffer::BorrowedBuffer;
use super::circle::{SECTORS, TurnCircle};
use crate::calibration::{Sample, Samples};
use crate::time::WrappingMillis;
use crate::trig::Length as _;

#[derive(Clone, Copy, Debug)]
pub(super) struct PartConfig {
    /// Sample interval, milliseconds: attitude errors are correlated over about 0.5 s.
    pub sample_interval_ms: u32,
    /// One in this number of samples is held back.
    pub hold_back_cycle: u16,
    /// Fit samples that fill a sector.
    pub sector_samples: u16,
    /// Fit samples of a complete part.
    pub target: u16,
    /// Smallest radius of a circle of headings, microtesla: a third of the horizontal field at 75 deg of inclination.
    /// Noise at a constant heading gives less.
    pub min_radius_ut: f32,
    /// Fewest fit samples that distinguish a circle from noise.
    pub min_samples: u16,
}

impl PartConfig {
    /// For turns of 5 to 30 deg/s: two passes of a sector at 13 deg/s, about three circles.
    pub const TURNS: Self = Self {
        sample_interval_ms: 400,
        hold_back_cycle: 4,
        sector_samples: 8,
        target: 132,
        min_radius_ut: 4.0,
        min_samples: 10,
    };

    /// For level flight, with smaller buffers: two circles.
    pub const LEVEL: Self = Self { sector_samples: 4, target: 48, ..Self::TURNS };

    /// Whether the buffer capacity suffices for a complete part.
    pub const fn fits_capacity(&self, capacity: usize) -> bool {
        self.target as usize <= capacity
            && self.sector_samples as usize * SECTORS <= capacity
            && self.min_samples <= self.target
    }

    /// Fewest held-back samples of a complete part.
    pub const fn min_held_back_when_complete(&self) -> u16 {
        // The last sample of each cycle is held back, and the last cycle may be incomplete.
        (self.target - 1) / (self.hold_back_cycle - 1)
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct TumbleConfig {
    /// Initial minimum distance between samples, microtesla: a thirtieth of a circle in a weak field.
    pub initial_distance_ut: f32,
    /// Factor on the distance when the buffer is full.
    pub distance_growth: f32,
    /// Fit samples that count as 100 percent.
    pub target: u16,
}

impl TumbleConfig {
    pub const DEFAULT: Self = Self { initial_distance_ut: 5.0, distance_growth: 1.3, target: 66 };
}

/// Coverage of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Coverage {
    /// Number of fit samples.
    pub samples: u16,
    /// Number of held-back samples.
    pub held_back: u16,
    /// Sectors with at least one sample, of [`SECTORS`].
    pub sectors: u8,
    /// Completeness, 0..100 percent.
    pub percent: u8,
}

impl Coverage {
    const NONE: Self = Self { samples: 0, held_back: 0, sectors: 0, percent: 0 };

    /// Whether all required samples are stored.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.percent >= 100
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SampleUse {
    Fit,
    Verification,
}

#[derive(Debug)]
pub(super) struct PartSamples<'a> {
    fit: BorrowedBuffer<'a, Sample>,
    held_back: BorrowedBuffer<'a, Sample>,
    last_taken_at: Option<WrappingMillis>,
    /// Samples taken; wraps at a multiple of the hold-back cycle.
    taken_count: u16,
    coverage: Coverage,
}

impl<'a> PartSamples<'a> {
    /// Restores a part from memory; all-zero words give an empty one.
    pub fn new(fit: &'a mut [Sample], held_back: &'a mut [Sample], words: [u32; 2]) -> Self {
        let [lengths, counts] = words;
        let fit = BorrowedBuffer::new(fit, usize::from(lengths as u16));
        let held_back = BorrowedBuffer::new(held_back, (lengths >> 16) as usize);
        let [_, _, sectors, percent] = counts.to_le_bytes();
        let mut part =
            Self { fit, held_back, last_taken_at: None, taken_count: counts as u16, coverage: Coverage::NONE };
        part.coverage = Coverage { sectors, percent, ..part.sample_counts() };
        part
    }

    /// State in retained memory: lengths, counter, coverage.
    pub fn encode(&self) -> [u32; 2] {
        let (fit, held_back) = (self.fit().len() as u32, self.held_back().len() as u32);
        let [low, high] = self.taken_count.to_le_bytes();
        [fit | held_back << 16, u32::from_le_bytes([low, high, self.coverage.sectors, self.coverage.percent])]
    }

    pub fn taken_count(&self) -> u16 {
        self.taken_count
    }

    pub fn clear(&mut self) {
        self.fit.clear();
        self.held_back.clear();
        self.last_taken_at = None;
        self.taken_count = 0;
        self.coverage = Coverage::NONE;
    }

    pub fn fit(&self) -> &[Sample] {
        self.fit.as_slice()
    }

    pub fn held_back(&self) -> &[Sample] {
        self.held_back.as_slice()
    }

    pub fn coverage(&self) -> Coverage {
        self.coverage
    }

    pub fn buffer_mut(&mut self, purpose: SampleUse) -> &mut BorrowedBuffer<'a, Sample> {
        match purpose {
            SampleUse::Fit => &mut self.fit,
            SampleUse::Verification => &mut self.held_back,
        }
    }

    /// Stores a sample if it is due and its sector is not the most crowded of a full buffer.
    pub fn push_by_sector(&mut self, config: &PartConfig, sample: Sample) {
        if !self.is_due(config, &sample) {
            return;
        }
        let circle = TurnCircle::fit_to(&Samples { left: self.fit(), right: self.held_back(), ..Samples::default() });
        let sector_of = |s: &Sample| circle.map_or(0, |circle| circle.sector_of(s));
        match self.assign_use(config, &sample) {
            SampleUse::Fit => insert_balanced(&mut self.fit, sample, sector_of),
            SampleUse::Verification => insert_balanced(&mut self.held_back, sample, sector_of),
        }
        self.coverage = self.compute_coverage(config, circle);
    }

    /// Stores a sample of any attitude if it is due and at least `distance_ut` from the others; increases the distance
    /// when the buffer is full.
    pub fn push_by_distance(&mut self, config: &PartConfig, distance_ut: &mut f32, sample: Sample) {
        let is_near = |s: &Sample| (s.field.ut - sample.field.ut).length() < *distance_ut;
        if !self.is_due(config, &sample) || self.fit().iter().chain(self.held_back()).any(is_near) {
            return;
        }
        if self.assign_use(config, &sample) == SampleUse::Verification && !self.held_back.is_full() {
            // Infallible: not full.
            let _ = self.held_back.push(sample);
        } else {
            if self.fit.is_full() {
                *distance_ut *= TumbleConfig::DEFAULT.distance_growth;
                remove_close_samples(&mut self.fit, *distance_ut);
            }
            // Fails if thinning removed nothing; drops the sample.
            let _ = self.fit.push(sample);
        }
        let percent = percent(self.fit().len() as u16, TumbleConfig::DEFAULT.target);
        self.coverage = Coverage { percent, ..self.sample_counts() };
    }

    /// Whether a sample is finite and at least one sample interval after the last.
    fn is_due(&self, config: &PartConfig, sample: &Sample) -> bool {
        let is_late = self.last_taken_at.is_none_or(|last| sample.time.ms_since(last) >= config.sample_interval_ms);
        is_late && sample.field.ut.iter().all(|c| c.is_finite())
    }

    pub fn count_sample(&mut self) {
        self.taken_count = self.taken_count.wrapping_add(1);
    }

    /// Counts a sample and returns its use.
    pub fn assign_use(&mut self, config: &PartConfig, sample: &Sample) -> SampleUse {
        self.last_taken_at = Some(sample.time);
        self.count_sample();
        if self.taken_count.is_multiple_of(config.hold_back_cycle) { SampleUse::Verification } else { SampleUse::Fit }
    }

    fn sample_counts(&self) -> Coverage {
        Coverage { samples: self.fit().len() as u16, held_back: self.held_back().len() as u16, ..Coverage::NONE }
    }

    fn compute_coverage(&self, config: &PartConfig, circle: Option<TurnCircle>) -> Coverage {
        let numbers = self.sample_counts();
        let turned = circle.filter(|c| c.radius_ut >= config.min_radius_ut && numbers.samples >= config.min_samples);
        let Some(circle) = turned else { return numbers };
        let counts = count_by_sector(self.fit(), |s| circle.sector_of(s));
        Coverage {
            sectors: counts.iter().filter(|&&n| n > 0).count() as u8,
            // Latched: a later sample can shift the circle and its sector borders, but removes no information.
            percent: if self.coverage.is_complete() { 100 } else { percent_of_turn(config, &counts, numbers.samples) },
            ..numbers
        }
    }
}

/// Lesser of sector filling and sample number, percent.
fn percent_of_turn(config: &PartConfig, counts: &[u16; SECTORS], samples: u16) -> u8 {
    let filled: u16 = counts.iter().map(|&n| n.min(config.sector_samples)).sum();
    percent(filled, config.sector_samples * SECTORS as u16).min(percent(samples, config.target))
}

fn percent(part: u16, whole: u16) -> u8 {
    (u32::from(part) * 100 / u32::from(whole).max(1)).min(100) as u8
}

fn count_by_sector(samples: &[Sample], sector_of: impl Fn(&Sample) -> usize) -> [u16; SECTORS] {
    let mut counts = [0; SECTORS];
    for sample in samples {
        if let Some(n) = counts.get_mut(sector_of(sample)) {
            *n += 1;
        }
    }
    counts
}

/// Adds a sample. A full buffer drops the oldest sample of the most crowded sector, or the new sample if it belongs
/// there.
fn insert_balanced(samples: &mut BorrowedBuffer<'_, Sample>, sample: Sample, sector_of: impl Fn(&Sample) -> usize) {
    if samples.is_full() {
        let counts = count_by_sector(samples.as_slice(), &sector_of);
        let crowded = (0..SECTORS).max_by_key(|&sector| counts[sector]).unwrap_or(0);
        if crowded == sector_of(&sample) {
            return;
        }
        if let Some(oldest) = samples.as_slice().iter().position(|s| sector_of(s) == crowded) {
            samples.remove_at(oldest);
        }
    }
    // Infallible: the most crowded sector of a full buffer is not empty.
    let _ = samples.push(sample);
}

/// Removes every sample nearer than `distance_ut` to an earlier one.
fn remove_close_samples(samples: &mut BorrowedBuffer<'_, Sample>, distance_ut: f32) {
    let mut i = 0;
    while let Some(sample) = samples.as_slice().get(i).copied() {
        let is_near = |s: &Sample| (s.field.ut - sample.field.ut).length() < distance_ut;
        if samples.as_slice().iter().take(i).any(is_near) {
            samples.remove_at(i);
        } else {
            i += 1;
        }
    }
}

#[cfg(test)]
mod tests;
