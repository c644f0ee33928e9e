//! Corrected field and attitude to heading, and when not to believe it.

use nalgebra::Vector3;

use crate::calibration::{Calibration, Uncertainty};
use crate::frames::{Attitude, Field, Sensor, wrap_two_pi};
use crate::trig;

/// A heading to be trusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heading {
    /// Magnetic heading, radians, 0..2 pi.
    pub magnetic_rad: f32,
    /// Its standard deviation, radians: what is left unknown of the coefficients, and the noise of sensor and attitude
    /// at this attitude and in this field.
    pub sigma_rad: f32,
    /// The share of its variance that is the same from one reading to the next, square radians: that of the coefficients.
    pub systematic_rad2: f32,
}

impl Heading {
    /// Magnetic heading in degrees, 0..360.
    #[must_use]
    pub fn magnetic_deg(&self) -> f32 {
        self.magnetic_rad.to_degrees()
    }

    /// The heading with so many degrees added.
    #[must_use]
    pub fn turned_by(self, degrees: f32) -> Self {
        Self { magnetic_rad: wrap_two_pi(self.magnetic_rad + degrees.to_radians()), ..self }
    }

    /// The heading with this variance of what stays the same from one reading to the next, square radians, if that is more
    /// than the coefficients': both are accounts of the same errors, so the larger one counts.
    #[must_use]
    pub fn with_systematic(self, variance_rad2: f32) -> Self {
        let more_rad2 = (variance_rad2 - self.systematic_rad2).max(0.0);
        Self {
            sigma_rad: libm::sqrtf(self.sigma_rad * self.sigma_rad + more_rad2),
            systematic_rad2: self.systematic_rad2 + more_rad2,
            ..self
        }
    }

    /// The heading with so much more variance of what stays the same from one reading to the next, square radians.
    #[must_use]
    pub fn with_more(self, variance_rad2: f32) -> Self {
        self.with_systematic(self.systematic_rad2 + variance_rad2)
    }

    /// Its standard deviation in degrees.
    #[must_use]
    pub fn sigma_deg(&self) -> f32 {
        self.sigma_rad.to_degrees()
    }
}

/// Why there is no heading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoHeading {
    /// No measurement has come from the sensor yet, or not for too long.
    SensorSilent,
    /// The sensor is at the end of its range.
    SensorSaturated,
    /// An axis of the sensor ends before its range does.
    SensorClipped,
    /// An axis of the sensor repeats itself.
    SensorStuck,
    /// The reading is too far from the one before.
    SensorSpike,
    /// No attitude, or too old.
    AttitudeStale,
    /// The attitude source repeats itself.
    AttitudeFrozen,
    /// There is no calibration for this sensor and mounting.
    Uncalibrated,
    /// The corrected field is not the Earth's: iron outside the aircraft, a current, or a calibration that no longer
    /// fits.
    FieldDisturbed,
    /// Iron in the aircraft has moved since the calibration, and where it is now is not known well enough.
    FieldChanged,
    /// Attitude, body rates and field contradict each other, and the attitude is to blame.
    AttitudeContradicted,
}

impl NoHeading {
    /// Stable code, as `status` shows it.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::SensorSilent => "sensor-silent",
            Self::SensorSaturated => "sensor-saturated",
            Self::SensorClipped => "sensor-clipped",
            Self::SensorStuck => "sensor-stuck",
            Self::SensorSpike => "sensor-spike",
            Self::AttitudeStale => "attitude-stale",
            Self::AttitudeFrozen => "attitude-frozen",
            Self::Uncalibrated => "uncalibrated",
            Self::FieldDisturbed => "field-disturbed",
            Self::FieldChanged => "field-changed",
            Self::AttitudeContradicted => "attitude-contradicted",
        }
    }
}

/// Fixed numbers of this module.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Largest relative difference of the corrected total field from the one the calibration was found in. The Earth's
    /// own changes by some 10 % over 1000 km; twice that is something else.
    pub max_total_deviation: f32,
    /// Cosine of the largest difference of the inclination from the one the calibration was found in: 12 deg, again
    /// twice what 1000 km make, and more than the attitude error of a sharp manoeuvre.
    pub min_cos_of_dip_deviation: f32,
}

impl Config {
    /// Numbers for aircraft that stay within 1000 km of where they were calibrated.
    pub const DEFAULT: Self = Self { max_total_deviation: 0.2, min_cos_of_dip_deviation: 0.978_1 };

    /// Believes every field: for showing what is not sent.
    pub const ANY_FIELD: Self = Self { max_total_deviation: f32::INFINITY, min_cos_of_dip_deviation: -1.1 };

    /// Whether it is [`ANY_FIELD`](Self::ANY_FIELD).
    #[must_use]
    pub const fn believes_all(&self) -> bool {
        self.max_total_deviation == f32::INFINITY
    }

    /// The same for a calibration whose inclination is not known.
    #[must_use]
    pub const fn of_any_inclination(self) -> Self {
        Self { min_cos_of_dip_deviation: Self::ANY_FIELD.min_cos_of_dip_deviation, ..self }
    }
}

/// Heading from a raw field, the attitude at its instant and a calibration (Liu 2007 eq. 8, 7 and 3).
///
/// # Errors
///
/// [`NoHeading::FieldDisturbed`] when the corrected field is not the one the calibration was found in.
pub fn heading(
    config: Config,
    calibration: &Calibration,
    uncertainty: &Uncertainty,
    field: Field<Sensor>,
    attitude: Attitude,
) -> Result<Heading, NoHeading> {
    let tilt = attitude.tilt();
    let level = tilt.level(calibration.apply(field));
    let [x, y, z] = [level.ut.x, level.ut.y, level.ut.z].map(|ut| ut / calibration.total_ut);
    let of_total = Vector3::new(x, y, z);
    if is_disturbed(config, calibration, &of_total) {
        return Err(NoHeading::FieldDisturbed);
    }
    let variance = uncertainty.heading_variance(calibration, field, &tilt, level);
    Ok(Heading {
        magnetic_rad: level.heading_rad(),
        sigma_rad: variance.sigma_rad(),
        systematic_rad2: variance.coefficients,
    })
}

/// Whether the level field, in units of the total field, is not that of the calibration; what is not finite counts as
/// disturbed.
fn is_disturbed(config: Config, calibration: &Calibration, field: &Vector3<f32>) -> bool {
    let horizontal_squared = field.x * field.x + field.y * field.y;
    let total_squared = horizontal_squared + field.z * field.z;
    // The cosine of the angle between the two inclinations, times the total field.
    let (sin, cos) = trig::sin_cos(calibration.inclination_rad);
    let along = cos * libm::sqrtf(horizontal_squared) + sin * field.z;
    // Squares with their signs, which saves a root.
    let (least, most) = ((1.0 - config.max_total_deviation).max(0.0), 1.0 + config.max_total_deviation);
    let min_cos = config.min_cos_of_dip_deviation;
    let as_calibrated = total_squared >= least * least
        && total_squared <= most * most
        && along * along.abs() >= min_cos * min_cos.abs() * total_squared;
    !as_calibrated
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Orientation;
    use crate::frames::wrap_pi;

    fn clean() -> Calibration {
        Calibration { inclination_rad: 1.0, total_ut: 50.0, ..Calibration::uncalibrated(Orientation::NONE) }
    }

    fn measured(total_ut: f32, inclination_rad: f32, heading_rad: f32, attitude: Attitude) -> Field<Sensor> {
        Field::new(attitude.body(Field::earth(total_ut, inclination_rad, heading_rad)).ut)
    }

    /// f32 carries 7 digits, so a heading at any attitude comes back to a few 1e-5 deg; 0.001 leaves room.
    #[test]
    fn heading_is_exact_at_any_attitude() {
        for heading_deg in (0_u16..360).step_by(15) {
            for (roll_deg, pitch_deg) in [(0.0, 0.0), (25.0, 3.0), (-60.0, -20.0), (170.0, 10.0), (10.0, 80.0)] {
                let attitude = Attitude::from_deg(roll_deg, pitch_deg);
                let field = measured(50.0, 1.0, f32::from(heading_deg).to_radians(), attitude);
                let found = heading(Config::DEFAULT, &clean(), &Uncertainty::NONE, field, attitude).unwrap();
                let error = wrap_pi(found.magnetic_rad - f32::from(heading_deg).to_radians()).to_degrees();
                assert!(error.abs() < 0.001, "heading {heading_deg} roll {roll_deg} pitch {pitch_deg}: {error}");
            }
        }
    }

    /// What the sensor sees of this field at a heading of 0.5 rad, and whether that is a heading.
    fn believed(config: Config, total_ut: f32, inclination_rad: f32, attitude: Attitude) -> bool {
        let field = measured(total_ut, inclination_rad, 0.5, attitude);
        match heading(config, &clean(), &Uncertainty::NONE, field, attitude) {
            Ok(_) => true,
            Err(why) => {
                assert_eq!(why, NoHeading::FieldDisturbed);
                false
            }
        }
    }

    const ATTITUDES_DEG: [(f32, f32); 3] = [(0.0, 0.0), (40.0, 5.0), (-30.0, -15.0)];

    /// 20 % either way of the calibration's 50 microtesla.
    #[test]
    fn a_field_of_another_strength_is_not_believed() {
        for (total_ut, expected) in [(50.0, true), (59.9, true), (60.1, false), (40.1, true), (39.9, false)] {
            for (roll_deg, pitch_deg) in ATTITUDES_DEG {
                let attitude = Attitude::from_deg(roll_deg, pitch_deg);
                assert_eq!(believed(Config::DEFAULT, total_ut, 1.0, attitude), expected, "{total_ut} uT {attitude:?}");
            }
        }
    }

    /// 12 deg either way of the calibration's inclination.
    #[test]
    fn a_field_of_another_inclination_is_not_believed() {
        for (off_deg, expected) in [(0.0, true), (11.9, true), (12.1, false), (-11.9, true), (-12.1, false)] {
            for (roll_deg, pitch_deg) in ATTITUDES_DEG {
                let attitude = Attitude::from_deg(roll_deg, pitch_deg);
                let inclination_rad = 1.0 + f32::to_radians(off_deg);
                let found = believed(Config::DEFAULT, 50.0, inclination_rad, attitude);
                assert_eq!(found, expected, "{off_deg} deg {attitude:?}");
            }
        }
        // The same inclination on the other side of the equator is another field.
        assert!(!believed(Config::DEFAULT, 50.0, -1.0, Attitude::default()));
    }

    #[test]
    fn what_is_not_finite_is_disturbed() {
        for (total_ut, inclination_rad) in [(f32::NAN, 1.0), (f32::INFINITY, 1.0), (50.0, f32::NAN)] {
            assert!(!believed(Config::DEFAULT, total_ut, inclination_rad, Attitude::default()));
        }
        let nowhere = Attitude { roll_rad: f32::NAN, pitch_rad: 0.0 };
        let field = measured(50.0, 1.0, 0.5, Attitude::default());
        let found = heading(Config::DEFAULT, &clean(), &Uncertainty::NONE, field, nowhere);
        assert_eq!(found, Err(NoHeading::FieldDisturbed));
    }

    /// Where the inclination is not known, the strength still is.
    #[test]
    fn a_field_of_any_inclination_can_be_believed() {
        let config = Config::DEFAULT.of_any_inclination();
        for inclination_rad in [1.0, -1.0, 0.0, 1.5] {
            assert!(believed(config, 50.0, inclination_rad, Attitude::default()), "{inclination_rad}");
        }
        assert!(!believed(config, 60.1, 1.0, Attitude::default()) && !believed(config, 39.9, 1.0, Attitude::default()));
    }

    /// A limit that is larger than the whole is no limit below.
    #[test]
    fn every_field_can_be_believed() {
        for (total_ut, inclination_rad) in [(5.0, 1.0), (500.0, 1.0), (50.0, -1.0), (50.0, 0.0)] {
            assert!(believed(Config::ANY_FIELD, total_ut, inclination_rad, Attitude::default()));
        }
        let lenient = Config { max_total_deviation: 1.5, ..Config::DEFAULT };
        assert!(believed(lenient, 1.0, 1.0, Attitude::default()));
        assert!(!believed(lenient, 126.0, 1.0, Attitude::default()));
    }

    /// An attitude that is wrong by 0.5 deg, and a sensor that is not: a tilt error turns the heading by tan(dip) of
    /// it.
    #[test]
    fn sigma_is_that_of_this_attitude_and_field() {
        let mut uncertainty = Uncertainty::NONE;
        uncertainty.attitude_sigma_rad = 0.5_f32.to_radians();
        let field = measured(50.0, 1.0, 0.5, Attitude::default());
        let found = heading(Config::DEFAULT, &clean(), &uncertainty, field, Attitude::default()).unwrap();
        let expected_deg = 0.5 * 1.0_f32.tan();
        assert!((found.sigma_deg() - expected_deg).abs() < 1e-3, "{} {expected_deg}", found.sigma_deg());
        // A reading's noise of 1 % of the total field is 1 % over the horizontal part of it in heading.
        let mut uncertainty = Uncertainty::NONE;
        uncertainty.sensor_sigma = 0.01;
        let found = heading(Config::DEFAULT, &clean(), &uncertainty, field, Attitude::default()).unwrap();
        let expected_deg = (0.01 / 1.0_f32.cos()).to_degrees();
        assert!((found.sigma_deg() - expected_deg).abs() < 1e-3, "{} {expected_deg}", found.sigma_deg());
    }

    #[test]
    fn a_heading_turns_round_the_circle_with_its_sigma() {
        let heading = Heading { magnetic_rad: 350_f32.to_radians(), sigma_rad: 0.01, systematic_rad2: 5e-5 };
        for (by_deg, to_deg) in [(20.0, 10.0), (-20.0, 330.0), (0.0, 350.0), (-355.0, 355.0)] {
            let turned = heading.turned_by(by_deg);
            assert!((turned.magnetic_deg() - to_deg).abs() < 1e-3, "{by_deg}: {turned:?}");
            assert!((turned.sigma_deg() - 0.572_96).abs() < 1e-4);
            assert_eq!(turned.systematic_rad2.to_bits(), 5e-5_f32.to_bits());
        }
    }

    /// Whoever reads the sentences relies on these.
    #[test]
    fn every_want_of_a_heading_has_its_code() {
        let codes = [
            NoHeading::SensorSilent,
            NoHeading::SensorSaturated,
            NoHeading::SensorClipped,
            NoHeading::SensorStuck,
            NoHeading::SensorSpike,
            NoHeading::AttitudeStale,
            NoHeading::AttitudeFrozen,
            NoHeading::Uncalibrated,
            NoHeading::FieldDisturbed,
            NoHeading::FieldChanged,
            NoHeading::AttitudeContradicted,
        ]
        .map(NoHeading::code);
        let expected = [
            "sensor-silent",
            "sensor-saturated",
            "sensor-clipped",
            "sensor-stuck",
            "sensor-spike",
            "attitude-stale",
            "attitude-frozen",
            "uncalibrated",
            "field-disturbed",
            "field-changed",
            "attitude-contradicted",
        ];
        assert_eq!(codes, expected);
    }
}
