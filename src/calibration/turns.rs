//! What the closed forms of a left and a right turn, [two planes](super::two_plane) and [four
//! ellipses](super::four_ellipse), have in common: how many samples they take, the banks of the turns, what their
//! centres say, and which way they run.

use nalgebra::Vector3;

use super::time_order::InTime;
use super::{Sample, Samples, Side, SolveError};
use crate::frames::wrap_pi;
use crate::trig;

/// Samples a side must have: five determine a conic, and each sector of 30 deg should have one.
pub(super) const MIN_SAMPLES: usize = 12;

/// Samples further apart in time than this say nothing about the way a turn runs, milliseconds: in 3 s even a sharp
/// turn of 30 deg/s stays below half a circle.
const MAX_STEP_MS: u32 = 3000;

/// The bank must differ by so much between the sides, as a sine: 10 deg.
const MIN_SINE_BETWEEN: f32 = 0.17;

/// The mean bank of a turn.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bank {
    /// Its sine, right wing down positive.
    pub sin: f32,
    /// Its cosine.
    pub cos: f32,
}

impl Bank {
    /// Of the samples of a turn; none without samples.
    pub fn mean_of(samples: &[Sample]) -> Self {
        let mean_rad = samples.iter().map(|s| s.attitude.roll_rad).sum::<f32>() / samples.len().max(1) as f32;
        let (sin, cos) = trig::sin_cos(mean_rad);
        Self { sin, cos }
    }

    /// Sine of the angle from this bank to another, by which the equations of the two turns are divided.
    ///
    /// # Errors
    ///
    /// [`SolveError::SamePlane`] when the banks are less than 10 deg apart.
    pub fn sine_to(self, other: Self) -> Result<f32, SolveError> {
        let sine = other.sin * self.cos - other.cos * self.sin;
        if sine.abs() < MIN_SINE_BETWEEN { Err(SolveError::SamePlane) } else { Ok(sine) }
    }
}

/// The centres of a left and a right turn: `c = r V + b` each (Liu 2007 eq. 14), with `V` the vertical field in units
/// of the horizontal one and `r` what the sensor measures, at the bank of that turn, of a vertical field of H0.
/// Microtesla.
#[derive(Clone, Copy, Debug)]
pub(super) struct Centres {
    /// `c` of the left and of the right turn.
    pub centres_ut: [Vector3<f32>; 2],
    /// `r` of the left and of the right turn.
    pub by_vertical_ut: [Vector3<f32>; 2],
}

impl Centres {
    /// `V`, from the difference of the centres, in which `b` cancels: least squares of three equations.
    pub fn vertical(&self) -> f32 {
        let [left, right] = self.by_vertical_ut;
        let [centre_left, centre_right] = self.centres_ut;
        let between = right - left;
        between.dot(&(centre_right - centre_left)) / between.norm_squared()
    }

    /// `b`, from the sum of the centres, microtesla.
    pub fn hard_iron_ut(&self, vertical: f32) -> Vector3<f32> {
        let [left, right] = self.by_vertical_ut;
        let [centre_left, centre_right] = self.centres_ut;
        (centre_left + centre_right - (left + right) * vertical) / 2.0
    }
}

/// By how much an angle of the samples runs the way heading does in a turn of this side, up to the right, down to the
/// left: radians, positive if it runs the right way, 0 if the samples are too far apart to say.
pub(super) fn progress_rad(samples: &[Sample], side: Side, angle_rad: impl Fn(&Sample) -> f32) -> f32 {
    let progress_rad: f32 = samples
        .array_windows()
        .filter(|[a, b]| b.time.since(a.time) <= MAX_STEP_MS)
        .map(|[a, b]| wrap_pi(angle_rad(b) - angle_rad(a)))
        .sum();
    match side {
        Side::Left => -progress_rad,
        Side::Right => progress_rad,
    }
}

/// Neighbours further apart in time say nothing about which way the gyro says that they turn, milliseconds: who yaws to
/// and fro does it no faster.
const MAX_STEP_OF_RATES_MS: u32 = 1200;

/// Of less turning than this, radians, nothing is said: half a circle.
const MIN_TURNED_RAD: f32 = 3.1;

/// By how much an angle of the samples runs the way the gyro says that the heading does, radians, positive if it runs the
/// right way; `None` where samples have no rates, or hardly turn.
pub(super) fn progress_by_rates_rad(samples: Samples<'_>, angle_rad: impl Fn(&Sample) -> f32) -> Option<f32> {
    let (mut progress_rad, mut turned_rad) = (0.0, 0.0);
    let mut before: Option<&Sample> = None;
    for (_, sample) in InTime::new(samples) {
        if let Some(before) = before.replace(sample)
            && sample.time.since(before.time) <= MAX_STEP_OF_RATES_MS
        {
            let step_s = sample.time.since(before.time) as f32 * 1e-3;
            let by_gyro_rad = step_s * before.rates.heading_rad_s().midpoint(sample.rates.heading_rad_s());
            turned_rad += by_gyro_rad.abs();
            progress_rad += wrap_pi(angle_rad(sample) - angle_rad(before)) * by_gyro_rad.signum();
        }
    }
    (turned_rad >= MIN_TURNED_RAD).then_some(progress_rad)
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;
    use crate::calibration::Rates;
    use crate::frames::{Attitude, Field};
    use crate::time::WrappingMillis;

    fn sample(roll_deg: f32, x_ut: f32, millis: u32) -> Sample {
        let field = Field::from_ut(x_ut, 0.0, 0.0);
        Sample {
            field,
            attitude: Attitude::from_deg(roll_deg, 3.0),
            time: WrappingMillis::new(millis),
            rates: Rates::NONE,
        }
    }

    #[test]
    fn the_bank_of_a_turn_is_the_mean() {
        let bank = Bank::mean_of(&[sample(20.0, 0.0, 0), sample(40.0, 0.0, 0), sample(30.0, 0.0, 0)]);
        assert!((bank.sin - 0.5).abs() < 1e-6 && (bank.cos - 0.866_025_4).abs() < 1e-6, "{bank:?}");
        let none = Bank::mean_of(&[]);
        assert!(none.sin.abs() < 1e-6 && (none.cos - 1.0).abs() < 1e-6, "{none:?}");
    }

    /// 0.17 is the sine of 9.79 deg, whatever the two banks are.
    #[test]
    fn banks_less_than_ten_degrees_apart_are_one_plane() {
        let bank = |roll_deg| Bank::mean_of(&[sample(roll_deg, 0.0, 0)]);
        for left_deg in [-4.9, 0.0, 20.0] {
            let to = |right_deg| bank(left_deg).sine_to(bank(right_deg));
            assert_eq!(to(left_deg + 9.7), Err(SolveError::SamePlane), "{left_deg}");
            assert_eq!(to(left_deg - 9.7), Err(SolveError::SamePlane), "{left_deg}");
            assert!((to(left_deg + 9.9).unwrap() - 0.171_93).abs() < 1e-4, "{left_deg}");
            assert!((to(left_deg - 9.9).unwrap() + 0.171_93).abs() < 1e-4, "{left_deg}");
        }
        // Both a right angle, not next to each other: 90 deg apart.
        assert!((bank(-50.0).sine_to(bank(40.0)).unwrap() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn centres_hold_hard_iron_and_the_vertical_field() {
        let b_ut = Vector3::new(10.0, -20.0, 5.0);
        let by_vertical_ut = [Vector3::new(1.0, -9.0, 20.0), Vector3::new(-2.0, 8.0, 22.0)];
        for vertical in [-1.5, 0.0, 0.7, 3.0] {
            let centres = Centres { centres_ut: by_vertical_ut.map(|r| r * vertical + b_ut), by_vertical_ut };
            assert!((centres.vertical() - vertical).abs() < 1e-5, "{vertical}");
            assert!((centres.hard_iron_ut(vertical) - b_ut).norm() < 1e-4, "{vertical}");
        }
    }

    fn progress(side: Side, samples: &[(u32, f32)]) -> f32 {
        let samples: Vec<Sample> = samples.iter().map(|&(millis, x_ut)| sample(0.0, x_ut, millis)).collect();
        progress_rad(&samples, side, |s| s.field.ut.x)
    }

    #[test]
    fn heading_goes_up_to_the_right_and_down_to_the_left() {
        let up = [(0, 1.0), (500, 1.5), (1000, 2.75)];
        assert!((progress(Side::Right, &up) - 1.75).abs() < 1e-6);
        assert!((progress(Side::Left, &up) + 1.75).abs() < 1e-6);
        // Across the border of the circle it goes on.
        assert!((progress(Side::Right, &[(0, 3.0), (500, -3.0)]) - 0.283_185).abs() < 1e-5);
        for side in [Side::Left, Side::Right] {
            assert!(progress(side, &[]).abs() < 1e-9 && progress(side, &[(0, 1.0)]).abs() < 1e-9);
        }
    }

    /// 3 s are near enough; what is further apart, or in the past, says nothing.
    /// Samples of a circle, so many milliseconds apart, that the gyro says runs at so many degrees a second; the progress of
    /// one that really runs at 20.
    fn by_rates(deg_s: f32, every_ms: u32, seconds: u32) -> Option<f32> {
        let circle: Vec<Sample> = (0..=seconds * 1000 / every_ms)
            .map(|i| {
                let heading_rad = wrap_pi((20.0 * (i * every_ms) as f32 * 1e-3).to_radians());
                let rates = Rates::from_rad_s([0.0, 0.0, deg_s.to_radians()]);
                Sample { rates, ..sample(0.0, heading_rad, i * every_ms) }
            })
            .collect();
        let (first, rest) = circle.split_at(circle.len() / 2);
        progress_by_rates_rad(Samples { level: first, any: [rest, &[], &[]], ..Samples::default() }, |s| s.field.ut.x)
    }

    #[test]
    fn headings_run_with_the_gyro_or_against_it() {
        let circle = Some(TAU);
        for (deg_s, expected) in [(20.0, circle), (-20.0, circle.map(|rad| -rad)), (15.0, circle), (0.0, None)] {
            let found = by_rates(deg_s, 500, 18);
            assert!(
                found.zip(expected).map_or(found == expected, |(found, expected)| (found - expected).abs() < 0.05),
                "{deg_s}: {found:?}"
            );
        }
    }

    /// Half a circle by the gyro, and neighbours within 1.2 s.
    #[test]
    fn little_turning_and_samples_far_apart_say_nothing() {
        assert!(by_rates(20.0, 500, 8).is_none() && by_rates(20.0, 500, 10).is_some());
        assert!(by_rates(20.0, 1300, 30).is_none() && by_rates(20.0, 1200, 30).is_some());
    }

    #[test]
    fn samples_far_apart_in_time_say_nothing_of_the_way() {
        assert!((progress(Side::Right, &[(100, 1.0), (3100, 2.0)]) - 1.0).abs() < 1e-6);
        assert!(progress(Side::Right, &[(100, 1.0), (3101, 2.0)]).abs() < 1e-9);
        assert!(progress(Side::Right, &[(3101, 1.0), (100, 2.0)]).abs() < 1e-9);
        assert!((progress(Side::Right, &[(0, 0.0), (9000, 1.0), (9500, 1.25)]) - 0.25).abs() < 1e-6);
    }
}
