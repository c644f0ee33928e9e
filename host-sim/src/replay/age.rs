//! How old the logged field is, from the flight itself.
//!
//! A row of a log is a mean of what was measured before it, or was sent a while ago: 50 to 90 ms, which at 30 deg/s is the
//! largest error of a quiet flight. As the aircraft rolls and pitches, attitudes of the wrong instant scatter the dips, and
//! the library's solver says which shift scatters them least (`calibration::Latency`); shifted by that, it is asked again,
//! until nothing is left.

use serde::Serialize;

use super::rows::rows;
use super::solved_of_all;
use crate::log::{Compass, Flight};

/// One that is known no better than to this, seconds, is not used.
const MAX_SIGMA_S: f64 = 0.02;

/// What cannot be, seconds: a field that is so much younger or older than its attitude.
const MIN_S: f64 = -0.2;
const MAX_S: f64 = 0.5;

/// The search ends when no more than this is left, seconds.
const SETTLED_S: f64 = 0.002;

const MAX_TRIED: usize = 4;

/// How old a field is at its own time stamp.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Age {
    /// Seconds, as it is used.
    pub used_s: f64,
    /// Its standard deviation where it was found in the flight; none where it is what is usual of the format.
    pub sigma_s: Option<f64>,
}

/// Finds it. Where the flight does not say, it is what is usual.
#[must_use]
pub fn found(flight: &Flight, compass: &Compass) -> Age {
    let usual = Age { used_s: flight.format.usual_age_s(), sigma_s: None };
    let mut age_s = usual.used_s;
    let mut known = None;
    for _ in 0..MAX_TRIED {
        let (rows, _) = rows(flight, compass, age_s, None);
        let Some(latency) = solved_of_all(&rows).and_then(|solution| solution.quality.latency) else { return usual };
        let (left_s, sigma_s) = (f64::from(latency.found_s), f64::from(latency.sigma_s));
        // The attitude of the field's instant is found so much later: the field is so much younger.
        age_s = (age_s - left_s).clamp(MIN_S, MAX_S);
        known = Some(sigma_s);
        if left_s.abs() < SETTLED_S {
            break;
        }
    }
    let is_inside = age_s > MIN_S && age_s < MAX_S;
    match known.filter(|&sigma_s| sigma_s < MAX_SIGMA_S && is_inside) {
        Some(sigma_s) => Age { used_s: age_s, sigma_s: Some(sigma_s) },
        None => usual,
    }
}

/// Of the compasses of one log, which are logged by one and the same: one that is not known by its own flight is taken from
/// those that are.
pub fn shared(ages: &mut [Age]) {
    let known: Vec<(f64, f64)> = ages.iter().filter_map(|age| Some((age.used_s, age.sigma_s?))).collect();
    let weight: f64 = known.iter().map(|(_, sigma_s)| sigma_s.powi(-2)).sum();
    if known.is_empty() || !weight.is_finite() {
        return;
    }
    let mean_s = known.iter().map(|(age_s, sigma_s)| age_s * sigma_s.powi(-2)).sum::<f64>() / weight;
    for age in ages.iter_mut().filter(|age| age.sigma_s.is_none()) {
        age.used_s = mean_s;
    }
}
