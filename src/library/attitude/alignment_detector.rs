//! Detects an attitude source whose filter is still converging after its start (initial alignment).
//!
//! Such a source reports tilt changes of tens of degrees at rest, which neither its body rates nor the magnetic field
//! show. A real rotation appears in the rates and, unless its axis is the field vector, in the field. Both must be
//! still, so that neither rates in a wrong unit nor a wrong calibration cause a false detection.

use nalgebra::Vector3;

use super::plausibility::MeanDirection;
use crate::attitude::report::AttitudeReport;
use crate::frames::{Field, Sensor};
use crate::time::Timestamp;
use crate::trig::VectorLength as _;

/// Time constant of the means of tilt, field and rates, seconds.
const MEAN_TIME_CONSTANT_S: f32 = 1.0;

/// Deviation of the tilt from its mean that is always allowed, radians (3 deg): noise and acceleration-induced tilt
/// error.
const MIN_TILT_DEVIATION_RAD: f32 = 0.052;

/// Safety factor on the integrated rates: a report has the rates of one instant only.
const INTEGRATED_RATE_FACTOR: f32 = 2.0;

/// The field is still if its angle from its mean is below this fraction of the tilt's deviation.
const MAX_FIELD_TO_TILT_RATIO: f32 = 0.3;

/// Hold time after the last detection, seconds: a converging filter that is half a degree off may pause for 2 s.
const DETECTION_HOLD_S: f32 = 5.0;

/// Gap between reports that restarts the means, seconds.
const MAX_GAP_S: f32 = 0.5;

/// Detector of an aligning source: exponential means and hold time.
#[derive(Clone, Copy, Debug)]
pub(super) struct InitialAlignmentDetector {
    /// Field direction in sensor axes; only angles are used.
    field_direction: MeanDirection,
    last_means: Option<RunningMeans>,
    hold_remaining_s: f32,
}

/// Exponential means, time constant 1 s, updated by each report.
#[derive(Clone, Copy, Debug)]
struct RunningMeans {
    updated_at: Timestamp,
    /// Mean down direction, body axes.
    mean_down: Vector3<f32>,
    /// Mean field direction, sensor axes.
    mean_field: Vector3<f32>,
    /// Integrated magnitude of the body rates, radians, with exponential forgetting.
    integrated_rate_rad: f32,
    /// Magnitude of the last report's body rates, radians per second.
    last_rate_rad_s: f32,
}

impl InitialAlignmentDetector {
    pub const fn new() -> Self {
        Self { field_direction: MeanDirection::UNKNOWN, last_means: None, hold_remaining_s: 0.0 }
    }

    /// Updates the field direction with an uncalibrated reading.
    pub fn update_field(&mut self, field: Field<Sensor>) {
        self.field_direction.update_mean_direction(field.ut);
    }

    /// Processes a report; returns whether the source is still aligning. Always false without a field or without body
    /// rates. Small angles are compared as chords of unit vectors.
    pub fn process_report(&mut self, at: Timestamp, report: &AttitudeReport) -> bool {
        let Some((field, rate_rad_s)) =
            self.field_direction.mean().zip(report.body_rates.map(|rates| rates.magnitude_rad_s()))
        else {
            (self.last_means, self.hold_remaining_s) = (None, 0.0);
            return false;
        };
        let current_means = RunningMeans {
            updated_at: at,
            mean_down: report.attitude.tilt_rotation().down_in_body(),
            mean_field: field,
            integrated_rate_rad: 0.0,
            last_rate_rad_s: rate_rad_s,
        };
        let Some(previous_means) = self.last_means.replace(current_means) else { return false };
        let step_s = at.us_since(previous_means.updated_at) as f32 * 1e-6;
        self.hold_remaining_s = (self.hold_remaining_s - step_s).max(0.0);
        if step_s <= MAX_GAP_S {
            let mean = previous_means.updated_means(&current_means, step_s);
            let tilted_rad = (current_means.mean_down - mean.mean_down).vector_length();
            if tilted_rad > MIN_TILT_DEVIATION_RAD + INTEGRATED_RATE_FACTOR * mean.integrated_rate_rad
                && (field - mean.mean_field).vector_length() < MAX_FIELD_TO_TILT_RATIO * tilted_rad
            {
                self.hold_remaining_s = DETECTION_HOLD_S;
            }
            // Discards NaN, which would persist in the means.
            self.last_means = tilted_rad.is_finite().then_some(mean);
        }
        self.hold_remaining_s > 0.0
    }
}

impl RunningMeans {
    /// Means updated with the report `latest`, `step_s` later.
    fn updated_means(&self, latest: &Self, step_s: f32) -> Self {
        let weight = step_s / MEAN_TIME_CONSTANT_S;
        let rate_rad_s = latest.last_rate_rad_s.max(self.last_rate_rad_s);
        Self {
            updated_at: latest.updated_at,
            mean_down: self.mean_down + (latest.mean_down - self.mean_down) * weight,
            mean_field: self.mean_field + (latest.mean_field - self.mean_field) * weight,
            integrated_rate_rad: (1.0 - weight) * self.integrated_rate_rad + rate_rad_s * step_s,
            last_rate_rad_s: latest.last_rate_rad_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{report, report_time};
    use super::*;
    use crate::frames::RollPitch;

    /// Simulated source and field, after ten seconds of rest.
    #[derive(Clone, Copy)]
    struct SimulatedSource {
        /// Tilt by time, degrees; in pitch or in roll.
        tilt_deg: fn(f32) -> f32,
        is_pitch: bool,
        /// Fractions of the tilt change that appear in the rates and in the field.
        tilt_fraction_in_rates: f32,
        tilt_fraction_in_field: f32,
    }

    /// Simulated tilt: a ramp of 20 deg/s for two seconds, and back.
    fn tilt_ramp_deg(t_s: f32) -> f32 {
        20.0 * t_s.clamp(0.0, 2.0) - 20.0 * (t_s - 2.0).clamp(0.0, 2.0)
    }

    const UNEXPLAINED_RAMP: SimulatedSource = SimulatedSource {
        tilt_deg: tilt_ramp_deg,
        is_pitch: false,
        tilt_fraction_in_rates: 0.0,
        tilt_fraction_in_field: 0.0,
    };

    /// Times of the first and last report classified as aligning, seconds.
    fn aligning_period_s(source: SimulatedSource) -> Option<[f32; 2]> {
        let SimulatedSource { tilt_deg, is_pitch, tilt_fraction_in_rates: by_rates, tilt_fraction_in_field: by_field } =
            source;
        let mut aligning = InitialAlignmentDetector::new();
        let mut found: Option<[f32; 2]> = None;
        for i in 0..1000_u16 {
            let t_s = f32::from(i) * 0.02 - 10.0;
            let rate_deg_s = (tilt_deg(t_s + 0.01) - tilt_deg(t_s - 0.01)) / 0.02;
            // A real gyro at rest never reads exactly zero.
            let rate = (by_rates * rate_deg_s).to_radians() + 1e-4;
            let (attitude, rates_rad_s) = if is_pitch {
                (RollPitch::from_deg(20.0, tilt_deg(t_s)), [0.0, rate, 0.0])
            } else {
                (RollPitch::from_deg(tilt_deg(t_s), -10.0), [rate, 0.0, 0.0])
            };
            let angle = (by_field * tilt_deg(t_s)).to_radians();
            (0..40).for_each(|_| aligning.update_field(Field::from_ut(48.0 * angle.cos(), 48.0 * angle.sin(), 0.0)));
            if aligning.process_report(report_time(i), &report(attitude, rates_rad_s)) {
                found = Some([found.map_or(t_s, |[from_s, _]| from_s), t_s]);
            }
        }
        found
    }

    /// The limit is 3 deg.
    #[test]
    fn an_unexplained_tilt_change_is_alignment() {
        for is_pitch in [false, true] {
            let period = |tilt_deg| aligning_period_s(SimulatedSource { tilt_deg, is_pitch, ..UNEXPLAINED_RAMP });
            assert_eq!(period(|t_s| if t_s >= 0.0 { 2.5 } else { 0.0 }), None);
            let [from_s, to_s] = period(|t_s| if t_s >= 0.0 { 3.2 } else { 0.0 }).unwrap();
            // Detected for a twentieth of a second, plus 5 s of hold time.
            assert!(from_s.abs() < 0.01 && (to_s - 5.0).abs() < 0.1, "{from_s} {to_s}");
        }
        // Detected during the whole ramp, plus 5 s.
        let [from_s, to_s] = aligning_period_s(UNEXPLAINED_RAMP).unwrap();
        assert!((0.1..0.3).contains(&from_s) && (8.8..10.0).contains(&to_s), "{from_s} {to_s}");
    }

    /// At 20 deg/s the tilt is up to 20 deg off its mean. Rates count twice, so half of the motion must appear in them.
    #[test]
    fn motion_seen_by_the_rates_is_not_alignment() {
        let by_rates =
            |tilt_fraction_in_rates| aligning_period_s(SimulatedSource { tilt_fraction_in_rates, ..UNEXPLAINED_RAMP });
        assert!(by_rates(0.3).is_some() && by_rates(-0.3).is_some());
        assert_eq!((by_rates(0.5), by_rates(-1.0), by_rates(1.0)), (None, None, None));
    }

    /// Rates in degrees read as radians, so that the motion appears in the field alone.
    #[test]
    fn motion_seen_by_the_field_is_not_alignment() {
        let tilt_fraction_in_rates = 0.017;
        let by_field = |tilt_fraction_in_field| {
            let source = SimulatedSource { tilt_fraction_in_rates, tilt_fraction_in_field, ..UNEXPLAINED_RAMP };
            aligning_period_s(source)
        };
        assert!(by_field(0.25).is_some() && by_field(-0.25).is_some());
        assert_eq!((by_field(0.4), by_field(-0.4), by_field(1.0)), (None, None, None));
    }
}
