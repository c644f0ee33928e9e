//! Changes of the field's readings in a flight: of hard iron, which is additive, or of the sensor, which is proportional.
//!
//! At candidate times both are fitted together with the correction, and compared with the fit without a change. The most
//! evident change divides the rows, and both parts are searched again. A jump of the field is a measurement of the change
//! of hard iron, with the components that strength and vertical component hardly show near the ends and on a single
//! heading.

mod candidates;
mod comparison;
mod hard_iron_change;
mod jump;
mod sensor_change;
mod turn_confirmation;

pub use hard_iron_change::{HardIronChange, temporary_change_start_s};
pub(super) use hard_iron_change::{MIN_HEADING_EFFECT_DEG, heading_effect_deg};
pub use sensor_change::SensorChange;

use super::data_loss::{self, measured_turns};
use super::flown_headings::yaw_sectors;
use super::row::{ReplayRow, split_at_time};
use super::row_headings::is_monitored;
use super::rows;
use crate::log::{FieldCorrection, LoggedFlight};
use candidates::{Candidate, find_candidates};
use comparison::{Comparison, FoundChange, SKIPPED_S};
use turn_confirmation::is_change_possible;

/// Largest number of changes reported.
const MAX_CHANGES: usize = 8;

/// Shortest duration of a temporary change, seconds: shorter ones affect few rows and are not of the aircraft's iron.
const MIN_TEMPORARY_CHANGE_S: f64 = 5.0;

/// Finds the changes of hard iron, in order of time. `initial` is a correction that fits most of the rows; `total_ut` the
/// strength of the Earth's field.
///
/// # Errors
///
/// The sensor changed, which appears as changes of hard iron, not only at its time.
pub fn find_changes(
    rows: &[ReplayRow],
    flight: &LoggedFlight,
    initial: &FieldCorrection,
    total_ut: f64,
) -> Result<Vec<HardIronChange>, SensorChange> {
    let usable: Vec<ReplayRow> = rows.iter().filter(|row| row.is_usable).copied().collect();
    let is_fast = rows::median_step_s(&usable).is_some_and(is_monitored);
    let search = ChangeSearch { flight, total_ut, has_turns: is_fast && data_loss::has_integrable_rates(flight) };
    let mut found = Vec::new();
    search.divide(&usable, initial, None, &mut found)?;
    if found.is_empty() {
        return Ok(Vec::new());
    }
    found.sort_by(|a, b| a.change.time_s.total_cmp(&b.change.time_s));
    let found = search.refit_between_neighbours(&usable, found);
    let turns = measured_turns(flight);
    let is_possible = |(index, found_change): &(usize, &FoundChange)| {
        let [from_s, to_s] = neighbour_times_s(&found, *index);
        let around = &split_at_time(split_at_time(&usable, from_s)[1], to_s)[0];
        is_change_possible(flight, around, &turns, found_change)
    };
    Ok(found.iter().enumerate().filter(is_possible).map(|(_, found)| found.change).collect())
}

/// Search for changes in the usable rows of a flight.
struct ChangeSearch<'a> {
    flight: &'a LoggedFlight,
    /// Strength of the Earth's field, microtesla.
    total_ut: f64,
    /// Whether the heading can be integrated from the body rates.
    has_turns: bool,
}

impl ChangeSearch<'_> {
    /// Divides rows at the most evident change of hard iron, and both parts again. `initial` is a correction that fits most of
    /// the rows, `known` the correction at one of their ends, if a change there has shown it.
    fn divide(
        &self,
        rows: &[ReplayRow],
        initial: &FieldCorrection,
        known: Option<&FieldCorrection>,
        found: &mut Vec<FoundChange>,
    ) -> Result<(), SensorChange> {
        if found.len() >= MAX_CHANGES {
            return Ok(());
        }
        let mut candidates = find_candidates(rows, initial, self.has_turns);
        // Iron that changes within seconds is one change.
        candidates.retain(|candidate| {
            found.iter().all(|other| (other.change.time_s - candidate.time_s).abs() >= MIN_TEMPORARY_CHANGE_S)
        });
        let Some(change) = self.most_evident_change(rows, candidates, known)? else { return Ok(()) };
        let (parts, corrections) = (split_at_time(rows, change.change.time_s), change.corrections);
        found.push(change);
        let mut parts = parts.into_iter().zip(&corrections);
        parts.try_for_each(|(part, correction)| self.divide(part, correction, Some(correction), found))
    }

    fn most_evident_change(
        &self,
        rows: &[ReplayRow],
        candidates: Vec<Candidate>,
        known: Option<&FieldCorrection>,
    ) -> Result<Option<FoundChange>, SensorChange> {
        if let Some(change) = self.decide_among(rows, &candidates, known)? {
            return Ok(Some(change));
        }
        // Another change spoils the fits: then only the rows between the jumps before and after are compared.
        let jumps: Vec<Candidate> = candidates.into_iter().filter(|candidate| candidate.jump.is_some()).collect();
        for jump in &jumps {
            let apart_s = |other: &Candidate| other.time_s - jump.time_s;
            let before_s = jumps.iter().map(apart_s).filter(|s| *s < -MIN_TEMPORARY_CHANGE_S);
            let after_s = jumps.iter().map(apart_s).filter(|s| *s > MIN_TEMPORARY_CHANGE_S);
            let from_s = jump.time_s + before_s.fold(f64::NEG_INFINITY, f64::max);
            let to_s = jump.time_s + after_s.fold(f64::INFINITY, f64::min);
            let part = rows_between(rows, [from_s, to_s]);
            if part.len() < rows.len()
                && let Some(change) = self.decide_among(part, &[*jump], known)?
            {
                return Ok(Some(change));
            }
        }
        Ok(None)
    }

    /// The change of the sensor at the candidate time with the best fit, if it is evident; else the evident change of hard iron
    /// with the best fit.
    fn decide_among(
        &self,
        rows: &[ReplayRow],
        candidates: &[Candidate],
        known: Option<&FieldCorrection>,
    ) -> Result<Option<FoundChange>, SensorChange> {
        let comparisons = candidates.iter().filter_map(|candidate| Comparison::new(rows, *candidate, known));
        let mut comparisons: Vec<Comparison> = comparisons.collect();
        comparisons.sort_by(|a, b| a.mean_objective().total_cmp(&b.mean_objective()));
        let mut refined: Vec<Comparison> = Vec::new();
        for comparison in comparisons {
            let is_compared = |time_s| refined.iter().any(|other| other.is_of_step_at(time_s));
            refined.extend(comparison.refined(rows, known, is_compared));
        }
        let Some(best) = refined.first() else { return Ok(None) };
        // On few headings, iron explains what a changed gain does.
        let may_be_sensor = || {
            let mut parts = split_at_time(rows, best.candidate.time_s).into_iter();
            parts.all(|part| yaw_sectors(self.flight, part).suffice())
        };
        if let Some(change) = best.sensor_change().filter(|_| may_be_sensor()) {
            return Err(change);
        }
        let found = refined.iter().filter_map(Comparison::hard_iron_change);
        let found = found.filter(|found| found.change.step_ut.norm() < self.total_ut);
        Ok(found.min_by(|a, b| a.misfit.total_cmp(&b.misfit)))
    }

    /// The changes that are evident between the changes before and after them, fitted to the rows there.
    fn refit_between_neighbours(&self, rows: &[ReplayRow], found: Vec<FoundChange>) -> Vec<FoundChange> {
        if found.len() < 2 {
            return found;
        }
        let refitted = found.iter().enumerate().filter_map(|(index, FoundChange { candidate, corrections, .. })| {
            let part = rows_between(rows, neighbour_times_s(&found, index));
            self.decide_among(part, &[*candidate], Some(&corrections[0])).ok()?
        });
        refitted.collect()
    }
}

/// Times of the changes before and after one, seconds; infinite at the ends.
fn neighbour_times_s(found: &[FoundChange], index: usize) -> [f64; 2] {
    let time_s = |index: usize| found.get(index).map(|found| found.change.time_s);
    [index.checked_sub(1).and_then(time_s).unwrap_or(f64::NEG_INFINITY), time_s(index + 1).unwrap_or(f64::INFINITY)]
}

/// Rows between two changes, without those next to them; none if the changes are too close.
fn rows_between(rows: &[ReplayRow], [from_s, to_s]: [f64; 2]) -> &[ReplayRow] {
    let index = |at_s: f64| rows.partition_point(|row| row.t_s < at_s);
    rows.get(index(from_s + SKIPPED_S)..index(to_s - SKIPPED_S)).unwrap_or_default()
}

#[cfg(test)]
mod tests;
