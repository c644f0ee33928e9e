//! Detects a change of a magnetometer in flight: its gain, the sign or gain of an axis, or its registers.
//!
//! Iron is additive; a change of the sensor is proportional to the reading. At candidate times both hypotheses are fitted
//! together with the correction, and compared by their evidence in Laplace's approximation (D. MacKay, "Bayesian
//! interpolation", 1992), with residuals that are correlated for seconds.

mod candidate_times;
mod change;
mod comparison;

pub use change::{SensorChange, SensorChangeKind};

use self::candidate_times::candidate_times_s;
use self::change::SKIPPED_S;
use self::comparison::Comparison;
use super::hard_iron_changes::LoggedHardIronChange;
use crate::log::FieldCorrection;
use crate::replay::row::ReplayRow;

/// Candidates closer than this are one, seconds.
const MAX_SAME_TIME_S: f64 = 1.0;

/// Finds the change of the sensor with the most evidence. `initial` is a correction that fits most of the rows.
#[must_use]
pub fn find_sensor_change(
    rows: &[ReplayRow],
    initial: &FieldCorrection,
    changes: &[LoggedHardIronChange],
) -> Option<SensorChange> {
    let usable: Vec<ReplayRow> = rows.iter().filter(|row| row.is_usable).copied().collect();
    let changes_s: Vec<f64> = changes.iter().map(|change| change.hard_iron_step.time_s).collect();
    let mut times_s = [changes_s.clone(), candidate_times_s(&usable, initial)].concat();
    times_s.sort_by(f64::total_cmp);
    times_s.dedup_by(|later, earlier| *later - *earlier < MAX_SAME_TIME_S);
    // A change of hard iron at another time spoils the fits: then only the rows up to that time are compared.
    decide_among(&usable, &times_s).or_else(|| {
        times_s.iter().find_map(|&time_s| {
            let part = rows_around(&usable, time_s, &changes_s);
            if part.len() < usable.len() { decide_among(part, &[time_s]) } else { None }
        })
    })
}

/// The change of the sensor at the candidate time with the best fit of any hypothesis, if that is evident.
fn decide_among(rows: &[ReplayRow], times_s: &[f64]) -> Option<SensorChange> {
    let comparisons = times_s.iter().filter_map(|&time_s| Comparison::new(rows, time_s));
    let best = comparisons.min_by(|a, b| a.mean_objective().total_cmp(&b.mean_objective()))?;
    let refined_s = best.refined_time_s(rows)?;
    if (refined_s - best.time_s).abs() < SKIPPED_S {
        return best.decide(refined_s);
    }
    Comparison::new(rows, refined_s)?.decide(refined_s)
}

/// Rows between the changes before and after a time.
fn rows_around<'rows>(rows: &'rows [ReplayRow], time_s: f64, changes_s: &[f64]) -> &'rows [ReplayRow] {
    let others = || changes_s.iter().filter(|other_s| (**other_s - time_s).abs() > 2.0 * MAX_SAME_TIME_S);
    let from_s = others().filter(|other_s| **other_s < time_s).copied().fold(f64::NEG_INFINITY, f64::max);
    let to_s = others().filter(|other_s| **other_s > time_s).copied().fold(f64::INFINITY, f64::min);
    let index = |at_s: f64| rows.partition_point(|row| row.t_s < at_s);
    &rows[index(from_s + SKIPPED_S)..index(to_s - SKIPPED_S)]
}

#[cfg(test)]
mod tests;
