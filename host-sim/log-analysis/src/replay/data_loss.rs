//! Detects rows lost by a link or a slow card.

use crate::log::time_series::Series;
use crate::log::{HeadingIntegral, LoggedFlight};

/// Shortest gap in the body rates, in median steps.
const MIN_GAP_IN_MEDIAN_STEPS: f64 = 1.5;
/// Shortest gap in the body rates, seconds: in less time rates hardly change.
const MIN_RATE_GAP_S: f64 = 0.15;

/// Largest interpolation gap of attitudes, in median steps: one lost row.
const MAX_INTERPOLATION_STEPS: f64 = 2.5;
/// Interpolation gap of attitudes that is allowed at any rate, seconds.
const MIN_INTERPOLATION_LIMIT_S: f64 = 0.25;

/// Smallest mean number of steps per gap in the rates; rates with more gaps are unusable for integration.
const MIN_STEPS_PER_GAP: usize = 25;

/// Interval of the attitude from which on interpolation is unreliable, seconds: 3 Hz with a margin for jitter.
pub(super) const SLOW_ATTITUDE_INTERVAL_S: f64 = 0.34;

/// Whether a heading can be integrated from the rates of a flight.
pub(super) fn has_integrable_rates(flight: &LoggedFlight) -> bool {
    let is_slow = flight.attitude.median_step_s().is_some_and(|step_s| step_s > SLOW_ATTITUDE_INTERVAL_S);
    flight.has_measured_rates && !is_slow && excessive_rate_loss(flight).is_none()
}

/// Largest interpolation gap of attitudes, seconds, at most `limit_s`.
pub(super) fn attitude_gap_limit_s(flight: &LoggedFlight, limit_s: f64) -> f64 {
    flight
        .attitude
        .median_step_s()
        .map_or(limit_s, |step_s| (MAX_INTERPOLATION_STEPS * step_s).clamp(MIN_INTERPOLATION_LIMIT_S, limit_s))
}

/// Fraction of gaps in the logged rates, if they are unusable. Differences of the attitude are means over their gaps.
pub(super) fn excessive_rate_loss(flight: &LoggedFlight) -> Option<f64> {
    if !flight.has_measured_rates {
        return None;
    }
    let (gaps, step_count) = count_gaps(&flight.body_rates);
    (gaps * MIN_STEPS_PER_GAP > step_count).then(|| gaps as f64 / step_count as f64)
}

fn count_gaps(series: &Series<3>) -> (usize, usize) {
    let Some(step_s) = series.median_step_s() else { return (0, 0) };
    let rows = series.rows();
    let is_long = |pair: &&[crate::log::time_series::TimedRow<3>]| {
        pair[1].t_s - pair[0].t_s > MIN_RATE_GAP_S.max(MIN_GAP_IN_MEDIAN_STEPS * step_s)
    };
    (rows.windows(2).filter(is_long).count(), rows.len() - 1)
}

/// Longest gap of the rates that is integrated across, seconds.
const MAX_GAP_S: f64 = 0.5;

/// Integral of the measured body rates; empty if they are logged too slowly, or were not measured.
pub(super) fn measured_turns(flight: &LoggedFlight) -> HeadingIntegral {
    let is_slow = flight.attitude.median_step_s().is_some_and(|step_s| step_s > SLOW_ATTITUDE_INTERVAL_S);
    if flight.has_measured_rates && !is_slow {
        HeadingIntegral::new(flight, MAX_GAP_S)
    } else {
        HeadingIntegral::default()
    }
}
