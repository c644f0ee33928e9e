//! Body rates of a flight: as logged, repaired by the attitude, or differences of the attitude.

use autoswing::attitude::EulerRates;
use autoswing::frames::{RollPitch, wrap_pi};

use super::flight::{LoggedFlight, RatesProblem};
use super::time_series::{Series, TimedRow};
use crate::numbers::{SIGMAS_PER_MEDIAN, mean, median};

/// Longest interval between the neighbours of a row for a difference, seconds.
const MAX_DIFFERENCE_INTERVAL_S: f64 = 1.0;

/// Largest gap for an interpolation of logged rates, seconds.
const MAX_GAP_S: f64 = 0.7;

/// Minimum number of rows for a test of the body rates: 10 s at 10 Hz.
const MIN_TESTED_ROWS: usize = 100;

/// Minimum motion about an axis for a test of its body rate, rad/s RMS (1 deg/s).
const MIN_MOTION_RAD_S: f64 = 0.017;

/// Minimum correlation of body rates and attitude change at which sign and unit of the rates are certain.
const MIN_RATE_CORRELATION: f64 = 0.6;

/// Ratio of the attitude change to the integrated body rates beyond which the rates have another unit.
const MAX_RATE_RATIO: f64 = 10.0;

/// Random walk of the heading integrated from the rates beyond which the monitor is better without rates, deg/s^0.5.
/// With noise added to the rates of the recorded flights in docs/accuracy.md, heading errors were 0.5 to 0.7 deg RMS
/// at a random walk of 0.4, 0.7 to 1.0 at 0.6 and 1.2 to 2.8 at 1.1; without rates 0.6.
const MAX_HEADING_RANDOM_WALK_DEG: f64 = 0.4;

/// Largest number of repairs: one for each axis, and one for the unit.
const MAX_REPAIRS: usize = 4;

/// Checks the logged body rates against the attitude, and repairs a wrong sign or unit. Missing or inexact rates are
/// replaced by differences of the attitude, which give no heading: those of the yaw contain the errors of its compass.
pub(super) fn check_and_repair_rates(flight: &mut LoggedFlight) {
    let differences = attitude_differences(&flight.attitude);
    for _ in 0..=MAX_REPAIRS {
        let Some(problem) = find_rates_problem(&differences, flight) else { return };
        flight.rates_problem.get_or_insert(problem);
        let Some(factors) = problem.repair_factors() else { break };
        for (sign, factor) in flight.logged_rate_signs.iter_mut().zip(factors) {
            *sign *= factor.signum();
        }
        for row in flight.body_rates.rows_mut() {
            row.row_values = std::array::from_fn(|axis| row.row_values[axis] * factors[axis]);
        }
    }
    flight.has_measured_rates = false;
    flight.body_rates = differences.into_iter().map(|row| (row.t_s, row.row_values)).collect();
}

fn find_rates_problem(differences: &[TimedRow<3>], flight: &LoggedFlight) -> Option<RatesProblem> {
    if flight.body_rates.is_empty() {
        return (!differences.is_empty()).then_some(RatesProblem::NotLogged);
    }
    let pairs: Vec<([f32; 3], [f32; 3])> = differences
        .iter()
        .filter_map(|row| Some((row.row_values, flight.body_rates.interpolate(row.t_s, MAX_GAP_S)?)))
        .collect();
    if pairs.len() < MIN_TESTED_ROWS {
        return None;
    }
    let has_yaw = flight.has_yaw();
    (0..if has_yaw { 3 } else { 2 }).find_map(|axis| sign_or_unit_problem(&pairs, axis)).or_else(|| {
        let step_s = flight.attitude.median_step_s().filter(|_| has_yaw)?;
        let yaw_rate_difference = |(difference, logged): &([f32; 3], [f32; 3])| f64::from(difference[2] - logged[2]);
        // The autopilot's filter corrects yaw slowly; such corrections are not an error of the rates.
        let white_noise_rad_s =
            median(pairs.windows(2).map(|pair| (yaw_rate_difference(&pair[1]) - yaw_rate_difference(&pair[0])).abs()))
                / std::f64::consts::SQRT_2;
        let walk_deg = (SIGMAS_PER_MEDIAN * white_noise_rad_s * step_s.sqrt()).to_degrees();
        (walk_deg > MAX_HEADING_RANDOM_WALK_DEG).then_some(RatesProblem::Inexact(walk_deg))
    })
}

fn sign_or_unit_problem(pairs: &[([f32; 3], [f32; 3])], axis: usize) -> Option<RatesProblem> {
    let mean_product = |product: &dyn Fn(f64, f64) -> f64| {
        mean(pairs.iter().map(|(difference, logged)| product(f64::from(difference[axis]), f64::from(logged[axis]))))
    };
    let [difference_power, logged_power, product_mean] = [
        mean_product(&|difference, _| difference * difference),
        mean_product(&|_, logged| logged * logged),
        mean_product(&|difference, logged| difference * logged),
    ];
    let correlation = product_mean / (difference_power * logged_power).sqrt();
    if difference_power.sqrt() < MIN_MOTION_RAD_S || correlation.is_nan() || correlation.abs() < MIN_RATE_CORRELATION {
        return None;
    }
    let ratio = (difference_power / logged_power).sqrt();
    if (1.0 / MAX_RATE_RATIO..MAX_RATE_RATIO).contains(&ratio) {
        (correlation < 0.0).then_some(RatesProblem::WrongSign(axis))
    } else {
        Some(RatesProblem::WrongUnit(ratio))
    }
}

/// Body rates by central differences of the attitude; a missing yaw counts as constant.
fn attitude_differences(attitude: &Series<3>) -> Vec<TimedRow<3>> {
    let rate_at = |three: &[TimedRow<3>]| {
        let [before, at, after] = three else { return None };
        let span_s = after.t_s - before.t_s;
        let [roll_rad_s, pitch_rad_s, yaw_rad_s] =
            std::array::from_fn(|i| wrap_pi(after.row_values[i] - before.row_values[i]) / span_s as f32);
        let heading_rad_s = if yaw_rad_s.is_finite() { yaw_rad_s } else { 0.0 };
        let [roll_rad, pitch_rad, _] = at.row_values;
        let rates = EulerRates { roll_rad_s, pitch_rad_s, heading_rad_s };
        let row_values = rates.to_body_rates(RollPitch { roll_rad, pitch_rad });
        (span_s <= MAX_DIFFERENCE_INTERVAL_S).then_some(TimedRow { t_s: at.t_s, row_values })
    };
    attitude.rows().windows(3).filter_map(rate_at).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::test_flight::flight_of_motion;

    /// A minute of banked turns to both sides at 10 Hz, with its body rates.
    fn turning_flight(change_rates: impl Fn(usize, &mut [f32; 3])) -> LoggedFlight {
        flight_of_motion(10.0, 600, |t_s| {
            let (sin, cos) = libm::sincosf(0.6 * t_s as f32);
            let (roll, roll_rate, yaw, yaw_rate) = (0.5 * sin, 0.3 * cos, -0.5 * cos, 0.3 * sin);
            let mut rates = [roll_rate, yaw_rate * libm::sinf(roll), yaw_rate * libm::cosf(roll)];
            change_rates((t_s * 10.0).round() as usize, &mut rates);
            ([roll, 0.0, yaw], rates)
        })
    }

    fn with_checked_rates(mut flight: LoggedFlight) -> LoggedFlight {
        check_and_repair_rates(&mut flight);
        flight
    }

    fn largest_difference(one: &TimedRow<3>, other: &TimedRow<3>) -> f32 {
        (Vector3::from(one.row_values) - Vector3::from(other.row_values)).amax()
    }

    #[test]
    fn rates_of_wrong_sign_or_unit_are_named_and_repaired() {
        let good = turning_flight(|_, _| {});
        assert_eq!(with_checked_rates(good.clone()).rates_problem, None);
        for (changed, expected) in [
            (turning_flight(|_, rates| rates[0] = -rates[0]), "about x has the sign opposite"),
            (turning_flight(|_, rates| rates[2] = -rates[2]), "about z has the sign opposite"),
            (turning_flight(|_, rates| *rates = rates.map(f32::to_degrees)), "0.017 times as fast"),
            (turning_flight(|_, rates| *rates = rates.map(f32::to_radians)), "57."),
            (turning_flight(|_, rates| *rates = rates.map(|rate| -rate.to_degrees())), "0.017 times as fast"),
        ] {
            let changed = with_checked_rates(changed);
            let problem = changed.rates_problem.unwrap().to_string();
            assert!(problem.contains(expected), "{expected}: {problem}");
            assert!(changed.has_measured_rates);
            for (row, truth) in changed.body_rates.rows().iter().zip(good.body_rates.rows()) {
                assert!(largest_difference(row, truth) < 1e-5, "{row:?} {truth:?}");
            }
        }
    }

    /// Differences of the yaw are no measurement of the turn, since a compass made it.
    #[test]
    fn missing_or_inexact_rates_are_replaced_by_differences_that_give_no_heading() {
        let good = turning_flight(|_, _| {});
        let missing = LoggedFlight { body_rates: Series::new(), ..good.clone() };
        // Vibration of 6 deg/s, sampled at 10 Hz: a random walk of 6 sqrt(0.1) = 1.9 deg in a second.
        let inexact = turning_flight(|i, rates| rates[2] += if i % 2 == 0 { 0.1 } else { -0.1 });
        let unknown_unit = turning_flight(|_, rates| *rates = rates.map(|rate| rate * 1000.0));
        for (changed, expected) in
            [(missing, "no body rates"), (inexact, "sampled too coarsely"), (unknown_unit, "0.001 times as fast")]
        {
            let changed = with_checked_rates(changed);
            let problem = changed.rates_problem.unwrap().to_string();
            assert!(problem.contains(expected) && !changed.has_measured_rates, "{expected}: {problem}");
            assert!(changed.body_rates.rows().len() > 590);
            // Tolerance of central differences over 0.2 s, in a motion with a period of 10 s.
            for (row, truth) in changed.body_rates.rows().iter().zip(&good.body_rates.rows()[1..]) {
                assert!(largest_difference(row, truth) < 0.01, "{row:?} {truth:?}");
            }
        }
    }
}
