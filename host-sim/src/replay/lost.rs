//! What a log has lost: to a link, or to a card that was too slow for it.

use crate::log::Flight;
use crate::log::series::Series;

/// Rows further apart than most by this factor have lost one between them, unless they are no further apart than this, seconds,
/// in which no aircraft turns otherwise than its rates say.
const FURTHER: f64 = 1.5;
const NEAR_S: f64 = 0.15;

/// Where one attitude is lost body rates tell what was between; where two are, they no longer do, unless that was soon.
const TWO_LOST: f64 = 2.5;
const SOON_S: f64 = 0.25;

/// If more of the body rates are lost than one in so many, what is integrated over all of them is no turn that was flown.
const ONE_IN: usize = 25;

/// Attitudes further apart than this are not interpolated between, seconds, `most_s` at most.
pub(super) fn longest_gap_s(flight: &Flight, most_s: f64) -> f64 {
    flight.attitude.median_step_s().map_or(most_s, |step_s| (TWO_LOST * step_s).clamp(SOON_S, most_s))
}

/// The share of the body rates that is lost, if that is too much to integrate them as the module does; it is told of all.
pub(super) fn of_the_rates(flight: &Flight) -> Option<f64> {
    let (gaps, steps) = gaps(&flight.rates);
    (gaps * ONE_IN > steps).then(|| gaps as f64 / steps as f64)
}

/// How many steps from one row to the next are too long, and how many there are.
fn gaps(series: &Series<3>) -> (usize, usize) {
    let Some(step_s) = series.median_step_s() else { return (0, 0) };
    let rows = series.rows();
    let is_long = |pair: &&[crate::log::series::Stamped<3>]| pair[1].t_s - pair[0].t_s > NEAR_S.max(FURTHER * step_s);
    (rows.windows(2).filter(is_long).count(), rows.len() - 1)
}
