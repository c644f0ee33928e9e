//! Vertical of an autopilot's reports, carried by the own gyro between them.
//!
//! It follows the reports with a short time constant, and the rotation at once. So neither the interval nor the jitter of the
//! reports' times is an error in a fast roll. The autopilot's filter smooths its attitude itself; a longer time constant only adds
//! the own gyro's errors.

use nalgebra::Vector3;

use super::gyro_frame::GyroFrame;
use crate::frames::RollPitch;
use crate::inertial::roll_and_pitch_of_down;
use crate::time::Timestamp;
use crate::trig::{DEG, VectorLength as _};

/// Time constant, seconds. RMS of the heading of planes, copters and VTOLs with 0.2 s 0.26, 0.85, 0.55 deg, with 0.3 s 0.26, 0.77,
/// 0.61 deg, with 1 s 0.31, 0.76, 0.67 deg; without the own gyro 0.26, 0.94, 0.64 deg.
const TIME_CONSTANT_S: f32 = 0.3;

/// Largest difference of a report that is followed, rad; a larger one starts again. A roll at 40 deg/s with a latency of 0.1 s is
/// 4 deg. Which of the two is at fault, the detector of a stale attitude decides.
const MAX_DIFFERENCE_RAD: f32 = 5.0 * DEG;

/// Reports after the start until it is used.
const MIN_REPORTS: u8 = 10;

/// Longest interval between two reports, seconds.
const MAX_STEP_S: f32 = 1.0;

/// Vertical in the gyro's frame.
#[derive(Debug)]
pub(super) struct CarriedVertical {
    /// Instant of the last report and the vertical; `None` before the first one.
    vertical: Option<(Timestamp, Vector3<f32>)>,
    report_count: u8,
}

impl CarriedVertical {
    pub const fn new() -> Self {
        Self { vertical: None, report_count: 0 }
    }

    /// Follows a report of the attitude at an instant.
    pub fn push_report(&mut self, frame: &GyroFrame, at: Timestamp, attitude: RollPitch) {
        let Some(rotation) = frame.rotation_at(at) else {
            *self = Self::new();
            return;
        };
        let reported = rotation * attitude.tilt_rotation().down_in_body();
        let followed = self.vertical.and_then(|(last_at, vertical)| {
            let (step_s, difference) = (at.us_since(last_at) as f32 * 1e-6, reported - vertical);
            let is_near = step_s <= MAX_STEP_S && difference.norm_squared() <= MAX_DIFFERENCE_RAD * MAX_DIFFERENCE_RAD;
            is_near.then(|| vertical + difference * (step_s / TIME_CONSTANT_S).min(1.0))
        });
        self.report_count = if followed.is_some() { self.report_count.saturating_add(1) } else { 0 };
        self.vertical = Some((at, followed.map_or(reported, |vertical| vertical.unit_vector())));
    }

    /// The vertical in body axes at an instant; `None` soon after the start.
    pub fn down_in_body_at(&self, frame: &GyroFrame, at: Timestamp) -> Option<Vector3<f32>> {
        let (_, vertical) = self.vertical.filter(|_| self.report_count >= MIN_REPORTS)?;
        Some(frame.rotation_at(at)?.inverse() * vertical)
    }

    /// Attitude at an instant; `None` soon after the start.
    pub fn attitude_at(&self, frame: &GyroFrame, at: Timestamp) -> Option<RollPitch> {
        Some(roll_and_pitch_of_down(&self.down_in_body_at(frame, at)?))
    }
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::super::testing::heading_and_roll_in_turns_deg;
    use super::*;

    /// Largest error of the roll, degrees, over 100 s of turns, with own rates at 50 Hz and reports at 10 Hz of this part of the bank.
    fn worst_error_deg(reported_roll: f32) -> f32 {
        let (mut frame, mut carried, mut random, mut worst_deg) =
            (GyroFrame::new(), CarriedVertical::new(), Random(1), 0.0_f32);
        for i in 0..5000_u16 {
            let (at, t_s) = (Timestamp::from_us(1_000_000 + u64::from(i) * 20_000), f32::from(i) * 0.02);
            let [roll_deg, before_deg, after_deg] =
                [t_s, t_s - 0.01, t_s + 0.01].map(|t_s| heading_and_roll_in_turns_deg(t_s)[1]);
            frame.push_rates(at, Some(Vector3::new(((after_deg - before_deg) / 0.02).to_radians(), 0.0, 0.0)));
            if i % 5 == 0 {
                let reported_deg = reported_roll * roll_deg + 0.3 * random.normal();
                carried.push_report(&frame, at, RollPitch::from_deg(reported_deg, 0.0));
            }
            // Between two reports, 0.03 s after the rates.
            if let Some(attitude) = carried.attitude_at(&frame, at.plus_us(10_000)) {
                let true_deg = heading_and_roll_in_turns_deg(t_s + 0.01)[1];
                worst_deg = worst_deg.max((attitude.roll_rad.to_degrees() - true_deg).abs());
            }
        }
        worst_deg
    }

    /// Rolls at 25 deg/s: four sigmas of smoothed noise are 0.5 deg, and the extrapolation of a rate that changes at once is 0.3 deg.
    /// Reports of 90 % of the bank of 25 deg are followed, and those of 30 %, whose difference starts again.
    #[test]
    fn the_attitude_between_reports_is_that_of_the_rotation() {
        for (reported_roll, least_deg, largest_deg) in [(1.0, 0.0, 0.8), (0.9, 2.3, 3.3), (0.3, 17.0, 20.0)] {
            let worst_deg = worst_error_deg(reported_roll);
            assert!((least_deg..largest_deg).contains(&worst_deg), "{reported_roll}: {worst_deg}");
        }
    }
}
