//! Whether the heading jumped with a change of hard iron, by a reference or by the turn of the body rates: on a single
//! heading, strength and inclination leave the horizontal part of a change free along a circle.

use nalgebra::Vector5;

use super::comparison::FoundChange;
use crate::least_squares::LeastSquares;
use crate::log::{FieldCorrection, HeadingIntegral, LoggedFlight};
use crate::numbers::square;
use crate::replay::flown_headings::{HeadingSectors, yaw_sectors};
use crate::replay::row::{ReplayRow, heading_deg, split_at_time};
use crate::score::wrap_180;

/// Time before and after a change in which the jump is searched, seconds.
const SEARCHED_S: f64 = 20.0;
/// Smallest jump that a heading shows, degrees RMS.
const MIN_JUMP_DEG: f64 = 3.0;
/// Least fraction of the expected jump that confirms it.
const MIN_JUMP_FRACTION: f64 = 0.5;
/// Standard deviation of the rates' offset, deg/s.
const RATE_OFFSET_DEG_S: f64 = 0.2;
/// Standard deviation of the deviation that a correction leaves, degrees.
const DEVIATION_DEG: f64 = 15.0;
/// Minimum number of rows on a side.
const MIN_ROWS: usize = 20;

/// Whether the headings flown on both sides determine a change, or the heading jumped with it as far as that is seen.
/// `rows` are those between the changes before and after it.
pub(super) fn is_change_possible(
    flight: &LoggedFlight,
    rows: &[ReplayRow],
    turns: &HeadingIntegral,
    FoundChange { change, corrections: [before, after], .. }: &FoundChange,
) -> bool {
    let sectors = split_at_time(rows, change.time_s).map(|side| yaw_sectors(flight, side));
    if sectors.iter().all(HeadingSectors::suffice) {
        return true;
    }
    let near = rows.iter().filter(|row| (row.t_s - change.time_s).abs() < SEARCHED_S);
    let differences = near.filter_map(|row| {
        let heading = |correction: &FieldCorrection| heading_deg(row, row.corrected_field(correction));
        let t_s = row.t_s - change.time_s;
        let jump_deg = if t_s >= 0.0 { wrap_180(heading(before) - heading(after)) } else { 0.0 };
        let (part, turn_deg) = match row.reference_deg {
            Some(reference_deg) => (usize::MAX, reference_deg),
            None => turns.part_and_heading_rad(row.t_s).map(|(part, rad)| (part, rad.to_degrees()))?,
        };
        let heading_deg = heading(before);
        Some(Difference { t_s, part, heading_deg, deg: heading_deg - turn_deg, jump_deg })
    });
    let differences: Vec<Difference> = differences.collect();
    let sides = [false, true].map(|is_after| differences.iter().filter(|row| (row.t_s >= 0.0) == is_after).count());
    let is_one_part = differences.windows(2).all(|pair| pair[0].part == pair[1].part);
    if sides.iter().any(|count| *count < MIN_ROWS) || !is_one_part {
        return sectors.iter().all(HeadingSectors::are_judged);
    }
    let jump_squares: f64 = differences.iter().map(|row| square(row.jump_deg)).sum();
    let is_visible = (jump_squares / sides[1] as f64).sqrt() > MIN_JUMP_DEG;
    !is_visible || jump_fraction(&differences).is_none_or(|fraction| fraction > MIN_JUMP_FRACTION)
}

/// Heading without the change, less the turn.
struct Difference {
    /// Time after the change, seconds.
    t_s: f64,
    part: usize,
    heading_deg: f64,
    deg: f64,
    /// Expected jump of the heading, degrees.
    jump_deg: f64,
}

/// Least-squares fraction of the expected jump, with a constant, an offset of the rates and the deviation that the
/// correction leaves.
fn jump_fraction(differences: &[Difference]) -> Option<f64> {
    let first_deg = differences.first()?.deg;
    let weight = 10.0 / differences.len() as f64;
    let prior_sigmas = [f64::INFINITY, RATE_OFFSET_DEG_S, DEVIATION_DEG, DEVIATION_DEG, f64::INFINITY];
    let mut fit = LeastSquares::with_prior_sigmas(prior_sigmas);
    for row in differences {
        let (sin, cos) = libm::sincos(row.heading_deg.to_radians());
        let by_unknowns = Vector5::new(1.0, row.t_s, sin, cos, row.jump_deg);
        fit.add_row(&by_unknowns, wrap_180(row.deg - first_deg), weight);
    }
    Some(fit.solve()?[4])
}
