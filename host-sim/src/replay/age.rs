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
    known.and_then(|sigma_s| believed(age_s, sigma_s)).unwrap_or(usual)
}

/// What was found, if it is known well enough and did not end where the search does.
fn believed(age_s: f64, sigma_s: f64) -> Option<Age> {
    let is_inside = age_s > MIN_S && age_s < MAX_S;
    (sigma_s < MAX_SIGMA_S && is_inside).then_some(Age { used_s: age_s, sigma_s: Some(sigma_s) })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log;
    use crate::log::csv::Unit;
    use crate::log::write::{turns, ulog};
    use crate::world::WorldConfig;

    /// To 20 ms, which at 30 deg/s is 0.6 deg; and an age at an end of the search is that of no minimum.
    #[test]
    fn an_age_is_believed_that_is_known_and_can_be() {
        assert_eq!(believed(0.1, 0.019), Some(Age { used_s: 0.1, sigma_s: Some(0.019) }));
        for (age_s, sigma_s) in [(0.1, 0.021), (0.1, f64::NAN), (MIN_S, 0.001), (MAX_S, 0.001)] {
            assert_eq!(believed(age_s, sigma_s), None, "{age_s} {sigma_s}");
        }
    }

    /// Weighed by how well each is known: of 1 and 3 ms of sigma the first counts nine times. Those that are known stay.
    #[test]
    fn a_compass_that_does_not_show_its_age_has_that_of_the_others() {
        let of = |used_s: f64, sigma_s: Option<f64>| Age { used_s, sigma_s };
        let mut ages = [of(0.05, Some(0.001)), of(0.0, None), of(0.09, Some(0.003))];
        shared(&mut ages);
        assert!((ages[1].used_s - (9.0 * 0.05 + 0.09) / 10.0).abs() < 1e-9 && ages[1].sigma_s.is_none(), "{ages:?}");
        assert_eq!([ages[0], ages[2]], [of(0.05, Some(0.001)), of(0.09, Some(0.003))]);
        let mut usual = [of(0.02, None); 2];
        shared(&mut usual);
        assert_eq!(usual, [of(0.02, None); 2]);
    }

    /// A field that is far from as old as is usual is as old as it is: the first attitudes are of other instants by a quarter
    /// of a second, in which the aircraft does not roll on straight lines, so it is asked again until two milliseconds are left.
    #[test]
    fn an_age_far_from_the_usual_is_found() {
        let recording = turns(&WorldConfig::table1(1), 0.25);
        let flight = log::read(&mut ulog(&recording).as_slice(), Unit::Milligauss).unwrap();
        let age = found(&flight, &flight.compasses[0]);
        assert!((age.used_s - 0.25).abs() < 3.0 * age.sigma_s.unwrap(), "{age:?}");
    }
}
