//! Estimates the latency of the logged field from the flight.
//!
//! A logged field is a mean over a past interval, or delayed by transmission: 50 to 90 ms, the largest error of a quiet
//! flight at 30 deg/s. In roll and pitch, attitudes of the wrong time scatter the inclination residuals; the solver
//! estimates the shift of least scatter (`calibration::Latency`). Shift and solve are repeated until convergence.

use serde::Serialize;

use super::replay_run::solve_all_rows;
use super::rows::build_rows;
use crate::log::{LoggedCompass, LoggedFlight};
use crate::numbers::square;

/// Largest standard deviation of a usable estimate, seconds: 0.6 deg at 30 deg/s.
const MAX_LATENCY_SIGMA_S: f64 = 0.02;

/// Smallest latency of the search, seconds; negative if the attitude is later than the field.
const MIN_LATENCY_S: f64 = -0.5;
/// Largest latency of the search, seconds.
const MAX_LATENCY_S: f64 = 0.5;

/// Remaining shift at which the search has converged, seconds.
const CONVERGED_SHIFT_S: f64 = 0.002;

const MAX_ITERATIONS: usize = 8;

/// Latency of a logged field, from measurement to time stamp.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FieldLatency {
    /// Latency in use, seconds.
    pub used_s: f64,
    /// Standard deviation, seconds, if estimated; none for the format's default.
    pub sigma_s: Option<f64>,
}

/// Estimates a compass's latency; the format's default if the flight does not show it.
pub fn estimate_latency(flight: &LoggedFlight, compass: &LoggedCompass) -> FieldLatency {
    let default_latency = FieldLatency { used_s: flight.log_format.default_field_latency_s(), sigma_s: None };
    let mut latency_s = default_latency.used_s;
    let mut last_sigma_s = None;
    for _ in 0..MAX_ITERATIONS {
        let (rows, _) = build_rows(flight, compass, latency_s, None);
        let Some(shift) = solve_all_rows(&rows).and_then(|solution| solution.quality.latency) else {
            return default_latency;
        };
        let (shift_s, sigma_s) = (f64::from(shift.estimate_s), f64::from(shift.sigma_s));
        // The matching attitude is `shift_s` later than assumed, so the latency is smaller by that time.
        latency_s = (latency_s - shift_s).clamp(MIN_LATENCY_S, MAX_LATENCY_S);
        last_sigma_s = Some(sigma_s);
        if shift_s.abs() < CONVERGED_SHIFT_S {
            break;
        }
    }
    last_sigma_s.and_then(|sigma_s| latency_if_precise(latency_s, sigma_s)).unwrap_or(default_latency)
}

/// A latency, seconds, with its standard deviation, if precise and not at a bound of the search.
fn latency_if_precise(latency_s: f64, sigma_s: f64) -> Option<FieldLatency> {
    let is_inside = latency_s > MIN_LATENCY_S && latency_s < MAX_LATENCY_S;
    (sigma_s < MAX_LATENCY_SIGMA_S && is_inside).then_some(FieldLatency { used_s: latency_s, sigma_s: Some(sigma_s) })
}

/// Gives compasses without an estimate the weighted mean of the others, since one logger wrote all.
pub fn fill_in_missing_latencies(latencies: &mut [FieldLatency]) {
    let estimates: Vec<(f64, f64)> =
        latencies.iter().filter_map(|latency| Some((latency.used_s, latency.sigma_s?))).collect();
    let weight_sum: f64 = estimates.iter().map(|(_, sigma_s)| square(*sigma_s).recip()).sum();
    if estimates.is_empty() || !weight_sum.is_finite() {
        return;
    }
    let mean_s =
        estimates.iter().map(|(latency_s, sigma_s)| latency_s * square(*sigma_s).recip()).sum::<f64>() / weight_sum;
    for latency in latencies.iter_mut().filter(|latency| latency.sigma_s.is_none()) {
        latency.used_s = mean_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log;
    use crate::log::csv::FieldUnit;
    use crate::log::log_writers::encode_ulog;
    use crate::test_flight::record_turns;

    /// An estimate at a bound is no minimum.
    #[test]
    fn a_field_latency_is_accepted_if_certain_and_within_bounds() {
        assert_eq!(latency_if_precise(0.1, 0.01), Some(FieldLatency { used_s: 0.1, sigma_s: Some(0.01) }));
        for (latency_s, sigma_s) in [(0.1, 0.04), (0.1, f64::NAN), (MIN_LATENCY_S, 0.001), (MAX_LATENCY_S, 0.001)] {
            assert_eq!(latency_if_precise(latency_s, sigma_s), None, "{latency_s} {sigma_s}");
        }
    }

    /// Standard deviations of 1 and 3 ms: weights 9 to 1.
    #[test]
    fn a_compass_without_an_estimate_gets_the_mean_field_latency() {
        let latency = |used_s: f64, sigma_s: Option<f64>| FieldLatency { used_s, sigma_s };
        let mut latencies = [latency(0.05, Some(0.001)), latency(0.0, None), latency(0.09, Some(0.003))];
        fill_in_missing_latencies(&mut latencies);
        assert!(
            (latencies[1].used_s - (9.0 * 0.05 + 0.09) / 10.0).abs() < 1e-9 && latencies[1].sigma_s.is_none(),
            "{latencies:?}"
        );
        assert_eq!([latencies[0], latencies[2]], [latency(0.05, Some(0.001)), latency(0.09, Some(0.003))]);
        let mut default_latencies = [latency(0.02, None); 2];
        fill_in_missing_latencies(&mut default_latencies);
        assert_eq!(default_latencies, [latency(0.02, None); 2]);
    }

    /// The first linearisation is off, so several iterations are needed.
    #[test]
    fn an_unusual_field_latency_is_estimated() {
        for latency_s in [0.25, 0.45] {
            let recording = record_turns(latency_s);
            let flight = log::read_flight(&mut encode_ulog(&recording).as_slice(), FieldUnit::Milligauss).unwrap();
            let latency = estimate_latency(&flight, &flight.compasses[0]);
            assert!((latency.used_s - latency_s).abs() < 3.0 * latency.sigma_s.unwrap(), "{latency_s}: {latency:?}");
        }
    }
}
