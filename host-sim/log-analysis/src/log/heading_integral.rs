//! Heading by the body rates, from an arbitrary north: no compass has a part in it.

use autoswing::frames::wrap_pi;

use super::flight::{Gps, LoggedFlight};
use super::time_series::{Series, pairs_apart};
use crate::numbers::{mean, square};

/// Longest gap of attitude that is interpolated, seconds.
const MAX_ATTITUDE_GAP_S: f64 = 0.7;

/// Pitch beyond which roll and heading are singular, as of a tailsitter in hover, radians (75 deg): errors of heading are
/// four times those of the attitude, and more.
pub(crate) const MAX_PITCH_RAD: f32 = 1.3;

/// Integral of the heading's rate by the body rates, in the attitude that is logged.
#[derive(Clone, Debug, Default)]
pub(crate) struct HeadingIntegral {
    rows: Vec<IntegralRow>,
}

#[derive(Clone, Debug)]
struct IntegralRow {
    t_s: f64,
    heading_rad: f64,
    /// Number of the part of the flight without a gap.
    part: usize,
}

impl HeadingIntegral {
    /// Integrates the body rates of a flight in parts between gaps of more than `max_gap_s`.
    pub(crate) fn new(flight: &LoggedFlight, max_gap_s: f64) -> Self {
        let mut rows: Vec<IntegralRow> = Vec::with_capacity(flight.body_rates.rows().len());
        let mut last_rate_rad_s = 0.0;
        for row in flight.body_rates.rows() {
            let attitude = flight.attitude.interpolate_angles(row.t_s, MAX_ATTITUDE_GAP_S);
            let Some([roll_rad, pitch_rad, _]) = attitude else { continue };
            if pitch_rad.abs() > MAX_PITCH_RAD {
                continue;
            }
            let [_, q, r] = row.row_values;
            let (sin_roll, cos_roll) = libm::sincosf(roll_rad);
            let rate_rad_s = f64::from((q * sin_roll + r * cos_roll) / libm::cosf(pitch_rad));
            let (heading_rad, part) = rows.last().map_or((0.0, 0), |last| {
                let step_s = row.t_s - last.t_s;
                let heading_rad = last.heading_rad + step_s * rate_rad_s.midpoint(last_rate_rad_s);
                (heading_rad, last.part + usize::from(step_s > max_gap_s))
            });
            rows.push(IntegralRow { t_s: row.t_s, heading_rad, part });
            last_rate_rad_s = rate_rad_s;
        }
        Self { rows }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Part of the flight without a gap, and the heading in it, radians; none outside the rates and in gaps.
    pub(crate) fn part_and_heading_rad(&self, t_s: f64) -> Option<(usize, f64)> {
        let after = self.rows.partition_point(|row| row.t_s <= t_s);
        let (from, to) = (self.rows.get(after.checked_sub(1)?)?, self.rows.get(after)?);
        let weight = (t_s - from.t_s) / (to.t_s - from.t_s);
        let heading_rad = from.heading_rad + weight * (to.heading_rad - from.heading_rad);
        (from.part == to.part).then_some((from.part, heading_rad))
    }

    /// Heading, radians; none outside the rates and in gaps.
    pub(crate) fn heading_rad(&self, t_s: f64) -> Option<f64> {
        self.part_and_heading_rad(t_s).map(|(_, heading_rad)| heading_rad)
    }
}

/// Longest gap between body rates, seconds.
const MAX_GAP_S: f64 = 0.7;

/// Longest interval of headings that is interpolated, seconds.
const MAX_HEADING_GAP_S: f64 = 0.5;

/// Latencies of the search, seconds, and its step.
const SEARCHED_S: [f64; 2] = [-0.3, 1.0];
const SEARCH_STEP_S: f64 = 0.02;

/// Shortest and longest time over which turns are compared, seconds: the gyro's offset adds little, and errors of the
/// heading half.
const TURN_TIME_S: [f64; 2] = [3.0, 6.0];

/// Fewest turns that are compared.
const MIN_TURNS: usize = 100;

/// Largest standard deviation of a latency that is removed, seconds; and smallest latency, that of the clocks.
const MAX_SIGMA_S: f64 = 0.03;
const MIN_LATENCY_S: f64 = 0.04;
/// Smallest latency that is removed, standard deviations.
const MIN_LATENCY_SIGMAS: f64 = 4.0;

/// Largest difference between turns, radians RMS (6 deg): a heading of the wrong sense has no latency.
const MAX_DIFFERENCE_RAD: f64 = 0.1;

/// Estimates the latencies of GPS yaw and of a table's reference, and removes them.
pub(super) fn remove_heading_latencies(flight: &mut LoggedFlight) {
    if !flight.has_measured_rates {
        return;
    }
    let integral = HeadingIntegral::new(flight, MAX_GAP_S);
    let yaws_deg = flight.gps.rows().iter().map(|row| (row.t_s, Gps::from_columns(row.row_values).yaw_deg));
    let yaws_deg = yaws_deg.filter(|(_, yaw_deg)| yaw_deg.is_finite());
    let gps_yaw: Series<1> = yaws_deg.map(|(t_s, yaw_deg)| (t_s, [yaw_deg.to_radians()])).collect();
    if let Some(latency_s) = heading_latency_s(&gps_yaw, &integral) {
        flight.heading_latencies.push(("GPS yaw", latency_s));
        for row in flight.gps.rows_mut() {
            let yaw = gps_yaw.interpolate_angles(row.t_s + latency_s, MAX_HEADING_GAP_S);
            let yaw_deg = yaw.map_or(f32::NAN, |[yaw_rad]| yaw_rad.to_degrees().rem_euclid(360.0));
            row.row_values = Gps { yaw_deg, ..Gps::from_columns(row.row_values) }.columns();
        }
    }
    if let Some(latency_s) = heading_latency_s(&flight.reference_heading, &integral) {
        flight.heading_latencies.push(("yaw_ref_deg", latency_s));
        for row in flight.reference_heading.rows_mut() {
            row.t_s -= latency_s;
        }
    }
}

/// Latency at which the turns of a heading are those of the body rates; none if it is not significant.
fn heading_latency_s(heading: &Series<1>, integral: &HeadingIntegral) -> Option<f64> {
    let turns = turns(heading);
    let step_count = ((SEARCHED_S[1] - SEARCHED_S[0]) / SEARCH_STEP_S).round() as u32;
    let difference = |latency_s: f64| mean_square_difference(&turns, integral, latency_s);
    let differences: Vec<(f64, f64)> = (0..=step_count)
        .map(|step| SEARCHED_S[0] + f64::from(step) * SEARCH_STEP_S)
        .filter_map(|latency_s| Some((latency_s, difference(latency_s)?)))
        .collect();
    let best = (0..differences.len()).min_by(|a, b| differences[*a].1.total_cmp(&differences[*b].1))?;
    let [(_, before), (best_s, least), (_, after)] = *differences.get(best.checked_sub(1)?..best + 2)? else {
        return None;
    };
    let curvature = before - 2.0 * least + after;
    let latency_s = best_s + SEARCH_STEP_S * (before - after) / (2.0 * curvature);
    // Turns that overlap share errors.
    let independent = turns.len() as f64 * heading.median_step_s()? / TURN_TIME_S[0];
    let sigma_s = SEARCH_STEP_S * (2.0 * least / (curvature * independent)).sqrt();
    let is_certain = sigma_s < MAX_SIGMA_S && latency_s.abs() > MIN_LATENCY_S.max(MIN_LATENCY_SIGMAS * sigma_s);
    (is_certain && least < square(MAX_DIFFERENCE_RAD)).then_some(latency_s)
}

/// Start and end of each turn, seconds, and its angle, radians.
fn turns(heading: &Series<1>) -> Vec<([f64; 2], f64)> {
    let rows = heading.rows();
    let turn = |(first, last): (usize, usize)| {
        let turn_rad = f64::from(rows[last].row_values[0]) - f64::from(rows[first].row_values[0]);
        ([rows[first].t_s, rows[last].t_s], turn_rad)
    };
    pairs_apart(rows, |row| row.t_s, TURN_TIME_S).map(turn).collect()
}

/// Mean square of the difference between turns and those of the body rates a latency earlier, each clipped at three
/// limits; none if too few are compared.
fn mean_square_difference(turns: &[([f64; 2], f64)], integral: &HeadingIntegral, latency_s: f64) -> Option<f64> {
    let at = |t_s: f64| integral.heading_rad(t_s - latency_s);
    let squares: Vec<f64> = turns
        .iter()
        .filter_map(|([from_s, to_s], turn_rad)| {
            let difference = f64::from(wrap_pi((turn_rad - (at(*to_s)? - at(*from_s)?)) as f32));
            Some(square(difference).min(square(3.0 * MAX_DIFFERENCE_RAD)))
        })
        .collect();
    (squares.len() >= MIN_TURNS).then(|| mean(squares))
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use crate::log::LogFormat;
    use crate::log::rates::check_and_repair_rates;

    use super::*;

    /// Yaw of a flight that turns to and fro, with a period of 40 s, by a receiver with noise of half a degree.
    fn flight_with_late_yaw(latency_s: f64, sign: f64) -> LoggedFlight {
        let mut flight = LoggedFlight::new(LogFormat::DataFlash);
        let mut random = Random(3);
        let yaw_rad = |t_s: f64| 3.0 * libm::sin(t_s * 0.157);
        for i in 0..2400_u32 {
            let t_s = f64::from(i) / 10.0;
            flight.attitude.push_row(t_s, [0.0, 0.0, wrap_pi(yaw_rad(t_s) as f32)]);
            flight.body_rates.push_row(t_s, [0.0, 0.0, (3.0 * 0.157 * libm::cos(t_s * 0.157)) as f32]);
            let noise_rad = 0.009 * f64::from(random.normal());
            let yaw_deg = (sign * (yaw_rad(t_s - latency_s) + noise_rad)).to_degrees().rem_euclid(360.0) as f32;
            if i % 2 == 0 {
                flight.gps.push_row(t_s, [48.0, 11.3, 500.0, 0.0, 0.0, yaw_deg]);
            }
        }
        check_and_repair_rates(&mut flight);
        flight
    }

    #[test]
    fn the_latency_of_a_heading_is_found_by_the_body_rates_and_removed() {
        for (latency_s, sign, is_removed) in [(0.2, 1.0, true), (0.6, 1.0, true), (0.0, 1.0, false), (0.2, -1.0, false)]
        {
            let mut flight = flight_with_late_yaw(latency_s, sign);
            remove_heading_latencies(&mut flight);
            assert_eq!(flight.heading_latencies.len(), usize::from(is_removed), "{latency_s} s, sign {sign}");
            let Some((_, found_s)) = flight.heading_latencies.first() else { continue };
            assert!((found_s - latency_s).abs() < 0.02, "{latency_s}: {found_s}");
            let rows = flight.gps.rows();
            let error_deg = |i: usize| {
                let true_rad = 3.0 * libm::sin(rows[i].t_s * 0.157);
                f64::from(wrap_pi(rows[i].row_values[5].to_radians() - true_rad as f32)).to_degrees()
            };
            assert!((100..1000).all(|i| error_deg(i).abs() < 2.5), "{latency_s}");
        }
    }
}
