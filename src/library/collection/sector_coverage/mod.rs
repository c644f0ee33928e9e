//! Coverage of heading sectors by the samples of turns and of level flight, which ends these procedures.
//!
//! Hard iron several times the horizontal field hides the heading. A turn at constant bank is a plane ellipse in sensor
//! space: samples are projected on their principal plane, a circle is fitted there, and the angle about its centre gives
//! the sector. The configured mounting has no influence.

use core::f32::consts::TAU;

use nalgebra::{Matrix3, Vector2};

use super::progress::{SECTOR_COUNT, percent};
use super::retained_samples::{HOLD_BACK_CYCLE, PartState};
use super::sample_buffer::{LEVEL_QUOTA, WHOLE_BUFFER};
use crate::calibration::{CollectionPart, LeastSquares, PrincipalPlane, Sample, Samples};
use crate::trig::sqrt;

/// What makes the samples of a part complete.
#[derive(Clone, Copy, Debug)]
pub(super) struct SectorCoverage {
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
pub const MIN_HELD_BACK_WHEN_COMPLETE: u16 = SectorCoverage::LEVEL.min_held_back_when_complete();
const _: () = assert!(MIN_HELD_BACK_WHEN_COMPLETE <= SectorCoverage::TURNS.min_held_back_when_complete());

// Both sides and level flight must be able to become complete.
const _: () = assert!(
    2 * SectorCoverage::TURNS.complete_fit_samples as usize + LEVEL_QUOTA.fit_samples <= WHOLE_BUFFER.fit_samples
        && SectorCoverage::LEVEL.complete_fit_samples as usize <= LEVEL_QUOTA.fit_samples
);

impl SectorCoverage {
    /// For turns of 5 to 30 deg/s; at 13 deg/s a sector needs two passes, the part about three circles.
    const TURNS: Self =
        Self { samples_per_full_sector: 8, complete_fit_samples: 132, min_radius_ut: 4.0, min_samples: 10 };

    /// For level flight: the part needs two circles.
    const LEVEL: Self = Self { samples_per_full_sector: 4, complete_fit_samples: 48, ..Self::TURNS };

    /// Coverage of a part; `None` for samples of arbitrary attitude.
    pub const fn of_part(part: CollectionPart) -> Option<Self> {
        match part {
            CollectionPart::LEFT | CollectionPart::RIGHT => Some(Self::TURNS),
            CollectionPart::LEVEL => Some(Self::LEVEL),
            _ => None,
        }
    }

    /// Fewest held-back samples of a complete part.
    const fn min_held_back_when_complete(&self) -> u16 {
        // The last sample of each cycle is held back, and the last cycle may be incomplete.
        (self.complete_fit_samples - 1) / (HOLD_BACK_CYCLE - 1)
    }

    /// Updates the coverage by the part's fit samples, and by all of its samples, which determine the circle.
    pub fn update_coverage(&self, [fit_samples, all_samples]: [Samples<'_>; 2], state: &mut PartState) {
        let sample_count = fit_samples.iter().count() as u16;
        let turn_circle = TurnCircle::fit_circle(all_samples)
            .filter(|circle| circle.radius_ut >= self.min_radius_ut && sample_count >= self.min_samples);
        let (sectors, percent) = turn_circle.map_or((0, 0), |circle| {
            let counts = count_by_sector(fit_samples, &circle);
            // Completeness is latched: a later sample can shift the circle and its sector borders, but removes no
            // information.
            let percent = if state.percent >= 100 { 100 } else { self.balance_percent(&counts, sample_count) };
            (counts.iter().filter(|&&n| n > 0).count() as u8, percent)
        });
        (state.covered_sector_count, state.percent) = (sectors, percent);
    }

    /// Lesser of sector filling and sample number, percent.
    fn balance_percent(&self, counts: &[u16; SECTOR_COUNT], sample_count: u16) -> u8 {
        let filled: u16 = counts.iter().map(|&n| n.min(self.samples_per_full_sector)).sum();
        percent(filled, self.samples_per_full_sector * SECTOR_COUNT as u16)
            .min(percent(sample_count, self.complete_fit_samples))
    }
}

fn count_by_sector(samples: Samples<'_>, circle: &TurnCircle) -> [u16; SECTOR_COUNT] {
    let mut counts = [0; SECTOR_COUNT];
    for sample in samples.iter() {
        if let Some(n) = counts.get_mut(circle.sector_of(sample)) {
            *n += 1;
        }
    }
    counts
}

const MIN_CIRCLE_POINTS: usize = 3;

#[derive(Clone, Copy, Debug)]
pub(super) struct TurnCircle {
    plane: PrincipalPlane,
    centre_ut: Vector2<f32>,
    pub radius_ut: f32,
}

impl TurnCircle {
    /// Least-squares fit of `x^2 + y^2 = a x + b y + c` (I. Kasa, "A circle fitting procedure and its error analysis",
    /// IEEE Trans. Instrum. Meas. 25(1), 1976) in the plane of the two largest principal axes. An arc is enough; `None`
    /// if the fit is singular.
    pub fn fit_circle(samples: Samples<'_>) -> Option<Self> {
        if samples.iter().count() < MIN_CIRCLE_POINTS {
            return None;
        }
        let plane = PrincipalPlane::fit_plane(samples, &Matrix3::identity())?;
        let mut least_squares = LeastSquares::<3, 1>::new();
        for sample in samples.iter() {
            let p = plane.plane_coordinates(&sample.field.ut);
            least_squares.add_weighted_row(&p.push(1.0), [p.norm_squared()], 1.0);
        }
        let solution = least_squares.solve()?;
        let centre_ut = solution.xy() / 2.0;
        let radius_ut = sqrt((centre_ut.norm_squared() + solution.z).max(0.0));
        radius_ut.is_finite().then_some(Self { plane, centre_ut, radius_ut })
    }

    /// Heading sector of a sample, 0..[`SECTOR_COUNT`].
    pub fn sector_of(&self, sample: &Sample) -> usize {
        sector_of_direction(self.plane.plane_coordinates(&sample.field.ut) - self.centre_ut)
    }
}

fn sector_of_direction(direction: Vector2<f32>) -> usize {
    let turns = libm::atan2f(direction.y, direction.x) / TAU + 0.5;
    // The cast saturates and maps NaN to 0.
    ((turns * SECTOR_COUNT as f32) as usize).min(SECTOR_COUNT - 1)
}

#[cfg(test)]
mod tests;
