//! Policy of turns, level flight and a compass swing: even coverage of heading sectors.
//!
//! A full part replaces samples in its most crowded sector.

use super::part_view::{HOLD_BACK_CYCLE, PartView};
use super::progress::percent;
use super::quota::{SampleQuota, SampleUse};
use super::turn_circle::{SECTOR_COUNT, TurnCircle};
use crate::calibration::Sample;

#[derive(Clone, Copy, Debug)]
pub(super) struct SectorBalance {
    /// Capacity of the part, samples.
    quota: SampleQuota,
    /// Fit samples that fill a sector.
    samples_per_full_sector: u16,
    /// Fit samples of a complete part.
    complete_fit_samples: u16,
    /// Smallest radius of a circle of headings, microtesla: a third of the horizontal field at 75 deg of inclination.
    /// Noise at a constant heading gives less.
    min_radius_ut: f32,
    /// Fewest fit samples that distinguish a circle from noise.
    min_samples: u16,
}

/// Smallest number of held-back samples in a complete part; verification must not require more.
pub const MIN_HELD_BACK_WHEN_COMPLETE: u16 = SectorBalance::LEVEL.min_held_back_when_complete();
const _: () = assert!(MIN_HELD_BACK_WHEN_COMPLETE <= SectorBalance::TURNS.min_held_back_when_complete());

// Every part must be able to become complete.
const _: () = assert!(SectorBalance::TURNS.is_quota_sufficient() && SectorBalance::LEVEL.is_quota_sufficient());

impl SectorBalance {
    /// For turns of 5 to 30 deg/s; at 13 deg/s a sector needs two passes, the part about three circles.
    pub const TURNS: Self = Self {
        quota: SampleQuota::TURN,
        samples_per_full_sector: 8,
        complete_fit_samples: 132,
        min_radius_ut: 4.0,
        min_samples: 10,
    };

    /// For level flight, with a smaller quota: the part needs two circles.
    pub const LEVEL: Self =
        Self { quota: SampleQuota::LEVEL, samples_per_full_sector: 4, complete_fit_samples: 48, ..Self::TURNS };

    /// Whether the quota suffices for a complete part.
    const fn is_quota_sufficient(&self) -> bool {
        self.complete_fit_samples as usize <= self.quota.fit_quota
            && self.samples_per_full_sector as usize * SECTOR_COUNT <= self.quota.fit_quota
            && self.min_samples <= self.complete_fit_samples
            && self.min_held_back_when_complete() as usize <= self.quota.held_back_quota
    }

    /// Fewest held-back samples of a complete part.
    const fn min_held_back_when_complete(&self) -> u16 {
        // The last sample of each cycle is held back, and the last cycle may be incomplete.
        (self.complete_fit_samples - 1) / (HOLD_BACK_CYCLE - 1)
    }

    /// Stores a sample if it is due and its sector is not the most crowded of a full part. Returns whether it is due.
    pub fn push_sample(&self, mut part_view: PartView<'_>, sample: Sample) -> bool {
        let is_due = part_view.is_due(&sample);
        if is_due {
            let circle = TurnCircle::fit_circle(&part_view.fit_then_held_back());
            let sector_of = |s: &Sample| circle.map_or(0, |circle| circle.sector_of(s));
            let sample_use = part_view.count_and_assign_use(&sample);
            insert_balanced(&mut part_view, sample_use, self.quota, sample, sector_of);
            self.update_coverage(&mut part_view, circle);
        }
        is_due
    }

    fn update_coverage(&self, part_view: &mut PartView<'_>, circle: Option<TurnCircle>) {
        let samples = part_view.samples_of_use(SampleUse::Fit);
        let sample_count = samples.len() as u16;
        let turn_circle = circle.filter(|c| c.radius_ut >= self.min_radius_ut && sample_count >= self.min_samples);
        let (sectors, percent) = turn_circle.map_or((0, 0), |circle| {
            let counts = count_by_sector(samples, |s| circle.sector_of(s));
            // Completeness is latched: a later sample can shift the circle and its sector borders, but removes no
            // information.
            let is_complete = part_view.coverage().is_complete();
            let percent = if is_complete { 100 } else { self.balance_percent(&counts, sample_count) };
            (counts.iter().filter(|&&n| n > 0).count() as u8, percent)
        });
        (part_view.part_state.covered_sector_count, part_view.part_state.percent) = (sectors, percent);
    }

    /// Lesser of sector filling and sample number, percent.
    fn balance_percent(&self, counts: &[u16; SECTOR_COUNT], sample_count: u16) -> u8 {
        let filled: u16 = counts.iter().map(|&n| n.min(self.samples_per_full_sector)).sum();
        percent(filled, self.samples_per_full_sector * SECTOR_COUNT as u16)
            .min(percent(sample_count, self.complete_fit_samples))
    }
}

fn count_by_sector(samples: &[Sample], sector_of: impl Fn(&Sample) -> usize) -> [u16; SECTOR_COUNT] {
    let mut counts = [0; SECTOR_COUNT];
    for sample in samples {
        if let Some(n) = counts.get_mut(sector_of(sample)) {
            *n += 1;
        }
    }
    counts
}

/// Stores a sample. A full part drops the oldest sample of the most crowded sector, or the new sample if it belongs
/// there.
fn insert_balanced(
    part_view: &mut PartView<'_>,
    sample_use: SampleUse,
    quota: SampleQuota,
    sample: Sample,
    sector_of: impl Fn(&Sample) -> usize,
) {
    if !part_view.is_full(sample_use, quota) {
        return part_view.insert_sample(sample_use, sample);
    }
    let counts = count_by_sector(part_view.samples_of_use(sample_use), &sector_of);
    let crowded = (0..SECTOR_COUNT).max_by_key(|&sector| counts[sector]).unwrap_or(0);
    if crowded != sector_of(&sample)
        && let Some(oldest) = part_view.samples_of_use(sample_use).iter().position(|s| sector_of(s) == crowded)
    {
        part_view.replace_sample(sample_use, oldest, sample);
    }
}

#[cfg(test)]
mod tests;
