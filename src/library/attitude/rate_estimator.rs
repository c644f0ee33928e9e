//! Body rates of an attitude source that sends angles only, from their differences.
//!
//! The angles have steps of 0.1 deg, the heading of 1 deg. A tracking filter of each angle (critically damped g-h
//! filter; Brookner 1998, section 1.2) smooths the steps. A rate is the change of a smoothed angle since the last
//! report, so that the integrated rates follow the angle: in a steady turn without lag.

use core::array::from_fn;

use crate::attitude::euler_rates::EulerRates;
use crate::frames::{RollPitch, wrap_pi};
use crate::time::Timestamp;

/// Time constant of the filter, seconds: shorter than a roll into a turn, longer than a step of 1 deg at the slowest
/// turn of interest, 4 deg/s.
const TIME_CONSTANT_S: f32 = 0.15;

/// Longest interval between reports, seconds.
const MAX_STEP_S: f32 = 0.3;

/// Largest deviation from the predicted angle, radians: 17 deg, a roll at 800 deg/s between two reports.
const MAX_RESIDUAL_RAD: f32 = 0.3;

/// Deviation of a single heading that is a jump, radians: 8 deg. A source that stalls in a turn goes on with one, which the aircraft has
/// not turned since.
const MIN_HEADING_JUMP_RAD: f32 = 0.14;

/// Number of consecutive deviations after which the filter restarts.
const MAX_CONSECUTIVE_OUTLIERS: u8 = 3;

/// Roll, pitch and heading, radians.
type Angles = [f32; 3];

/// Smoothed angles and their rates.
#[derive(Clone, Copy, Debug)]
struct SmoothedAngles {
    updated_at: Timestamp,
    angles_rad: Angles,
    rates_rad_s: Angles,
    consecutive_outliers: u8,
    has_heading_jumped: bool,
}

/// Tracking filter of roll, pitch and heading.
#[derive(Debug, Default)]
pub struct RateEstimator(Option<SmoothedAngles>);

impl RateEstimator {
    /// Estimator without angles.
    #[must_use]
    pub const fn new() -> Self {
        Self(None)
    }

    /// Processes an attitude and a heading of any reference received at `at`; returns the body rates, rad/s, zero if
    /// unknown.
    pub fn update_rates(&mut self, at: Timestamp, attitude: RollPitch, heading_rad: f32) -> [f32; 3] {
        let measured = [attitude.roll_rad, attitude.pitch_rad, heading_rad];
        let started = SmoothedAngles {
            updated_at: at,
            angles_rad: measured,
            rates_rad_s: [0.0; 3],
            consecutive_outliers: 0,
            has_heading_jumped: false,
        };
        let Some(last_angles) = self.0.replace(started) else { return [0.0; 3] };
        let step_s = at.us_since(last_angles.updated_at) as f32 * 1e-6;
        if !(0.0..=MAX_STEP_S).contains(&step_s) {
            return [0.0; 3];
        }
        let mut predicted: Angles = from_fn(|i| last_angles.angles_rad[i] + last_angles.rates_rad_s[i] * step_s);
        let mut residuals: Angles = from_fn(|i| wrap_pi(measured[i] - predicted[i]));
        let has_heading_jumped = residuals[2].abs() > MIN_HEADING_JUMP_RAD && !last_angles.has_heading_jumped;
        if has_heading_jumped {
            (predicted[2], residuals[2]) = (heading_rad, 0.0);
        }
        let is_outlier = residuals.iter().any(|residual| residual.abs() > MAX_RESIDUAL_RAD);
        let outliers = if is_outlier { last_angles.consecutive_outliers + 1 } else { 0 };
        if outliers > MAX_CONSECUTIVE_OUTLIERS || step_s == 0.0 {
            return [0.0; 3];
        }
        if is_outlier {
            residuals = [0.0; 3];
        }
        // First-order approximation of exp(-step / time constant).
        let memory = 1.0 / (1.0 + step_s / TIME_CONSTANT_S);
        let (angle_gain, rate_gain) = (1.0 - memory * memory, (1.0 - memory) * (1.0 - memory) / step_s);
        self.0 = Some(SmoothedAngles {
            updated_at: at,
            angles_rad: from_fn(|i| wrap_pi(predicted[i] + angle_gain * residuals[i])),
            rates_rad_s: from_fn(|i| last_angles.rates_rad_s[i] + rate_gain * residuals[i]),
            consecutive_outliers: outliers,
            has_heading_jumped,
        });
        let [roll_rad_s, pitch_rad_s, heading_rad_s] =
            from_fn(|i| last_angles.rates_rad_s[i] + angle_gain * residuals[i] / step_s);
        EulerRates { roll_rad_s, pitch_rad_s, heading_rad_s }.to_body_rates(attitude)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_US: u64 = 20_000;

    /// Body rates after each report of 20 s, of angles in degrees as MSP sends them: steps of 0.1 and 1 deg, truncated.
    fn body_rates_rad_s(angles_deg: impl Fn(f32) -> Angles) -> Vec<[f32; 3]> {
        let mut estimator = RateEstimator::new();
        let report = |step: u64| {
            let [roll_deg, pitch_deg, heading_deg] = angles_deg(step as f32 * 0.02);
            let attitude = RollPitch::from_deg((roll_deg * 10.0).trunc() / 10.0, (pitch_deg * 10.0).trunc() / 10.0);
            let heading_deg = heading_deg.rem_euclid(360.0).trunc();
            estimator.update_rates(Timestamp::from_us(step * STEP_US), attitude, heading_deg.to_radians())
        };
        (0..1000).map(report).collect()
    }

    fn mean_deg_s(rates_rad_s: &[[f32; 3]]) -> [f32; 3] {
        from_fn(|i| rates_rad_s.iter().map(|rates| rates[i].to_degrees()).sum::<f32>() / rates_rad_s.len() as f32)
    }

    /// A turn of 18.7 deg/s through north at 25 deg of bank and 5 deg of pitch. After ten time constants the mean of
    /// two seconds is exact to the angles' steps; a step of the heading by 1 deg changes the rate by 6 deg/s.
    #[test]
    fn a_steady_turn_has_its_body_rates() {
        let euler_rates = EulerRates { roll_rad_s: 0.0, pitch_rad_s: 0.0, heading_rad_s: 18.7_f32.to_radians() };
        let expected = euler_rates.to_body_rates(RollPitch::from_deg(25.0, 5.0)).map(f32::to_degrees);
        let rates_rad_s = &body_rates_rad_s(|t_s| [25.0, 5.0, 300.0 + 18.7 * t_s])[125..225];
        for (found, expected) in mean_deg_s(rates_rad_s).into_iter().zip(expected) {
            assert!((found - expected).abs() < 0.3, "{found} {expected}");
        }
        assert!(rates_rad_s.iter().all(|[.., r]| (r.to_degrees() - expected[2]).abs() < 7.0));
    }

    /// The integrated roll follows a steady roll of 20 deg/s without lag, and at its end to 2 deg: acceleration times
    /// the square of the time constant.
    #[test]
    fn integrated_rates_follow_the_angles() {
        let rates_rad_s = body_rates_rad_s(|t_s| [20.0 * (t_s - 10.0).clamp(0.0, 2.0), 0.0, 90.5]);
        let rolled_deg = |until: usize| rates_rad_s[..until].iter().map(|[p, ..]| p.to_degrees() * 0.02).sum::<f32>();
        assert!(rolled_deg(500).abs() < 0.2, "{}", rolled_deg(500));
        assert!((rolled_deg(596) - 38.0).abs() < 0.3, "{}", rolled_deg(596));
        assert!((rolled_deg(601) - 40.0).abs() < 2.0, "{}", rolled_deg(601));
        assert!((rolled_deg(1000) - 40.0).abs() < 0.2, "{}", rolled_deg(1000));
    }

    /// Three wrong angles do not interrupt the rates of a turn of 18.7 deg/s; more are a changed attitude, after which
    /// the filter starts again.
    #[test]
    fn a_lasting_change_of_angles_is_accepted() {
        let turns = |rates: &[f32; 3]| rates[1].hypot(rates[2]) > 8.0_f32.to_radians();
        let roll_deg = |is_changed: bool| if is_changed { 55.0 } else { 10.0 };
        let spike = body_rates_rad_s(|t_s| [roll_deg((5.0..5.05).contains(&t_s)), 0.0, 18.7 * t_s]);
        assert!(spike[150..].iter().all(turns));
        let step = body_rates_rad_s(|t_s| [roll_deg(t_s >= 5.0), 0.0, 18.7 * (t_s - 8.0).max(0.0)]);
        assert!(step[500..].iter().all(turns));
    }

    #[test]
    fn body_rates_and_angle_rates_are_inverse() {
        let attitude = RollPitch::from_deg(40.0, -30.0);
        let rates_rad_s = [0.1, -0.2, 0.3];
        let body_rates = super::super::BodyRates::from_rad_s(rates_rad_s).unwrap();
        let found = EulerRates::from_body_rates(body_rates, attitude).to_body_rates(attitude);
        assert!(found.iter().zip(rates_rad_s).all(|(found, expected)| (found - expected).abs() < 1e-5), "{found:?}");
    }
}
