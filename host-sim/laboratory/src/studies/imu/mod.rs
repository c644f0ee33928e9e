//! The attitude filter and the instrument on recorded trials of an inertial sensor.

mod score;
mod trial;

use autoswing::attitude::AttitudeSource;
use autoswing::calibration::{Calibration, HeadingUncertainty, Orientation};
use autoswing::frames::{Field, Sensor};
use autoswing::heading::Heading;
use autoswing::inertial::{AttitudeFilter, InertialAttitude, InertialSensorErrors, SensorOffsets};
use autoswing::instrument::{Correction, Instrument, InstrumentConfig};
use autoswing::reading::Reading;
use autoswing::time::Timestamp;
use nalgebra::{UnitQuaternion, Vector3};

pub use score::{TrialErrors, TrialScore};
pub use trial::{TrialRow, read_trial};

/// Period of the magnetometer's readings, seconds: that of a LIS3MDL at 80 Hz.
const READING_PERIOD_S: f64 = 0.0125;

/// Start of a trial in which the sensor is at rest and shows the place's field, seconds.
const REST_S: f64 = 1.0;

/// Age of the field in the tables, seconds: headings from the true attitude scatter least there, in all trials.
const FIELD_AGE_S: f64 = 0.014;

/// Sigma of each coefficient of the identity that calibrates the field, relative: the scatter above at slow rotation.
const COEFFICIENT_SIGMA: f32 = 0.01;

/// Score of the module's own code on a trial; `None` if no row is scored.
#[must_use]
pub fn score_trial(rows: &[TrialRow]) -> Option<TrialScore> {
    let mut filter = AttitudeFilter::new(InertialSensorErrors::CALIBRATED, SensorOffsets::UNKNOWN);
    let mut compass = TrialCompass::new();
    let mut errors = TrialErrors::default();
    let mut field_index = 0;
    for row in rows {
        let at = Timestamp::from_us(((row.t_s - rows[0].t_s) * 1e6).round() as u64);
        filter.update(at, &row.inertial, None);
        let Some(attitude) = filter.attitude() else { continue };
        while rows.get(field_index).is_some_and(|later| later.t_s - row.t_s < FIELD_AGE_S) {
            field_index += 1;
        }
        let Some(field_row) = rows.get(field_index) else { break };
        if !compass.is_reading_due(at) {
            continue;
        }
        let heading = compass.process_reading(at, field_row.field, &attitude);
        if let Some(truth) = row.truth.filter(|_| row.is_scored) {
            let roll_pitch = attitude.attitude;
            let yaw = heading.map_or(0.0, |heading| heading.magnetic_rad);
            let [roll, pitch] = [roll_pitch.roll_rad, roll_pitch.pitch_rad];
            let estimate = UnitQuaternion::from_euler_angles(roll.into(), pitch.into(), yaw.into());
            let sigmas_rad = [0, 1].map(|axis| f64::from(attitude.tilt_covariance[(axis, axis)]).sqrt());
            errors.add_row(&estimate, &truth, heading.map(|heading| heading.sigma_rad.into()), sigmas_rad);
        }
    }
    errors.score()
}

/// Instrument that reads the trial's field with the attitude of the filter.
struct TrialCompass {
    instrument: Instrument,
    /// Sum of the levelled fields at rest: horizontal and vertical component.
    field_at_rest: Vector3<f32>,
    next_reading_at: Timestamp,
    is_calibrated: bool,
}

impl TrialCompass {
    fn new() -> Self {
        Self {
            instrument: Instrument::new(InstrumentConfig::new((READING_PERIOD_S * 1e6) as u32)),
            field_at_rest: Vector3::zeros(),
            next_reading_at: Timestamp::START,
            is_calibrated: false,
        }
    }

    fn is_reading_due(&self, at: Timestamp) -> bool {
        at >= self.next_reading_at
    }

    /// Heading of a reading with the attitude of its instant, if the instrument sends one.
    fn process_reading(&mut self, at: Timestamp, field: Field<Sensor>, attitude: &InertialAttitude) -> Option<Heading> {
        if !self.is_calibrated {
            self.calibrate_at_rest(at, field, attitude);
        }
        self.next_reading_at = at.plus_us((READING_PERIOD_S * 1e6) as u64);
        self.instrument.on_inertial_attitude(at, attitude);
        let reading = Reading { field, is_saturated: false, was_overwritten: false };
        let estimate = self.instrument.on_reading(at, reading);
        while self.instrument.next_sample().is_some() {}
        self.instrument.update_monitor();
        estimate.smoothed_heading.or(estimate.heading.ok())
    }

    /// Sets the identity as calibration, with inclination and strength of the field at rest.
    fn calibrate_at_rest(&mut self, at: Timestamp, field: Field<Sensor>, attitude: &InertialAttitude) {
        let level = attitude.attitude.to_level_frame(Field::new(field.ut));
        self.field_at_rest += Vector3::new(libm::hypotf(level.ut.x, level.ut.y), level.ut.z, 1.0);
        if at.as_us() as f64 * 1e-6 < REST_S {
            return;
        }
        let [horizontal_ut, down_ut] = [0, 1].map(|axis| self.field_at_rest[axis] / self.field_at_rest.z);
        let calibration = Calibration {
            inclination_rad: libm::atan2f(down_ut, horizontal_ut),
            total_ut: libm::hypotf(horizontal_ut, down_ut),
            ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION)
        };
        self.instrument.set_correction(Correction {
            calibration: Some((calibration, identity_uncertainty())),
            attitude_source: AttitudeSource::Own,
            ..Correction::UNCALIBRATED
        });
        self.is_calibrated = true;
    }
}

/// Uncertainty of the identity: equal and independent sigmas of all coefficients.
fn identity_uncertainty() -> HeadingUncertainty {
    /// Positions of squares in the upper triangles of three and of four rows.
    const SQUARES_OF_3: [usize; 3] = [0, 3, 5];
    const SQUARES_OF_4: [usize; 4] = [0, 4, 7, 9];
    let mut uncertainty = HeadingUncertainty {
        relative_sensor_sigma: COEFFICIENT_SIGMA,
        attitude_sigma_rad: COEFFICIENT_SIGMA,
        ..HeadingUncertainty::NO_UNCERTAINTY
    };
    for row in SQUARES_OF_3 {
        for column in SQUARES_OF_4 {
            uncertainty.reduced_covariance[row][column] = COEFFICIENT_SIGMA * COEFFICIENT_SIGMA;
        }
    }
    uncertainty
}

#[cfg(test)]
mod tests {
    use autoswing::inertial::{GRAVITY_M_S2, InertialSample};

    use super::*;

    /// A sensor on a table that is turned about the vertical, in a field of 50 uT: truth, and rows at 250 Hz.
    fn turned_table(duration_s: u32) -> Vec<TrialRow> {
        (0..duration_s * 250)
            .map(|i| {
                let t_s = f64::from(i) / 250.0;
                let turning_s = (t_s - 3.0).max(0.0);
                let truth = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.4 + 0.2 * turning_s);
                let in_body = |reference: [f64; 3]| (truth.inverse() * Vector3::from(reference)).cast::<f32>();
                TrialRow {
                    t_s,
                    inertial: InertialSample {
                        rates_rad_s: in_body([0.0, 0.0, if turning_s > 0.0 { 0.2 } else { 0.0 }]),
                        specific_force_m_s2: in_body([0.0, 0.0, -f64::from(GRAVITY_M_S2)]),
                    },
                    field: Field::new(in_body([25.0, 0.0, 43.3])),
                    truth: Some(truth),
                    is_scored: t_s > 4.0,
                }
            })
            .collect()
    }

    #[test]
    fn an_exact_sensor_has_no_errors() {
        let score = score_trial(&turned_table(20)).unwrap();
        assert!(score.inclination_deg < 0.1 && score.heading_deg.unwrap() < 0.5, "{score:?}");
        assert!(score.heading_percent > 99.0, "{score:?}");
    }
}
