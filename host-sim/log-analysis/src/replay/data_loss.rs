//! Detects rows lost by a link or a slow card.

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
    has_rates_for_turns(flight) && excessive_rate_loss(flight).is_none()
}

/// Whether the rates were measured, and the attitude that relates them to the heading is fast enough.
fn has_rates_for_turns(flight: &LoggedFlight) -> bool {
    let is_slow = flight.attitude.median_step_s().is_some_and(|step_s| step_s > SLOW_ATTITUDE_INTERVAL_S);
    flight.has_measured_rates && !is_slow
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
    let step_s = flight.body_rates.median_step_s().filter(|_| flight.has_measured_rates)?;
    let min_gap_s = MIN_RATE_GAP_S.max(MIN_GAP_IN_MEDIAN_STEPS * step_s);
    let rows = flight.body_rates.rows();
    let gaps = rows.windows(2).filter(|pair| pair[1].t_s - pair[0].t_s > min_gap_s).count();
    let step_count = rows.len() - 1;
    (gaps * MIN_STEPS_PER_GAP > step_count).then(|| gaps as f64 / step_count as f64)
}

/// Longest gap of the rates that is integrated across, seconds.
const MAX_GAP_S: f64 = 0.5;

/// Integral of the measured body rates; empty if they are logged too slowly, or were not measured.
pub(super) fn measured_turns(flight: &LoggedFlight) -> HeadingIntegral {
    if has_rates_for_turns(flight) { HeadingIntegral::new(flight, MAX_GAP_S) } else { HeadingIntegral::default() }
}
