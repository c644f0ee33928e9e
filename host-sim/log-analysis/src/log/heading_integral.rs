//! Heading by the body rates, from an arbitrary north.

use autoswing::attitude::{BodyRates, EulerRates};
use autoswing::frames::RollPitch;

use super::flight::LoggedFlight;

/// Times of the attitudes, seconds, and integrated heading rates, radians; none where rates are missing.
pub(crate) fn integrate_heading(flight: &LoggedFlight, max_gap_s: f64) -> Vec<(f64, f64)> {
    let mut heading_by_time: Vec<(f64, f64)> = Vec::new();
    let mut last: Option<(f64, f64, f64)> = None;
    for row in flight.attitude.rows() {
        let [roll_rad, pitch_rad, _] = row.row_values;
        let rates_rad_s = flight.body_rates.interpolate(row.t_s, max_gap_s);
        let Some(body_rates) = rates_rad_s.and_then(BodyRates::from_rad_s) else { continue };
        let rate = f64::from(EulerRates::from_body_rates(body_rates, RollPitch { roll_rad, pitch_rad }).heading_rad_s);
        let heading_rad =
            last.map_or(0.0, |(t_s, heading_rad, before)| heading_rad + rate.midpoint(before) * (row.t_s - t_s));
        heading_by_time.push((row.t_s, heading_rad));
        last = Some((row.t_s, heading_rad, rate));
    }
    heading_by_time
}

/// Integrated heading at a time, radians; none in a gap.
pub(crate) fn integral_at(heading_by_time: &[(f64, f64)], t_s: f64, max_gap_s: f64) -> Option<f64> {
    let after = heading_by_time.partition_point(|(at_s, _)| *at_s <= t_s);
    let (&(from_s, from), &(to_s, to)) = (heading_by_time.get(after.checked_sub(1)?)?, heading_by_time.get(after)?);
    (to_s - from_s < max_gap_s).then(|| from + (to - from) * (t_s - from_s) / (to_s - from_s))
}
