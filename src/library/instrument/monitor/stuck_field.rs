//! A field that turns with the aircraft: the sensor is stuck, and noise hides that its readings repeat.
//!
//! While an aircraft turns, the Earth's field changes in the body and not in the Earth's axes; that of a stuck sensor does the
//! opposite. Exponential mean squares measure both scatters. The Earth's axes are the level ones, turned back by the gyro's heading:
//! their direction is unknown, and constant. Explained by the monitor's states, a stuck field becomes hard iron, a gyro that turns too
//! much, or a turned mount: headings had errors of up to 180 deg, and now of up to 34, by rates in whole degrees 60.

use nalgebra::Vector3;

use crate::attitude::GyroHeading;
use crate::frames::{Field, RollPitch};
use crate::trig::{sin_cos, square};

/// Time constant of the scatters, seconds. With 3 and 10 s, errors are the same.
const SCATTER_TIME_S: f32 = 5.0;

/// RMS scatter of a turn, relative to the horizontal field: that of 6.6 deg/s. With 4.3 deg/s, a gyro whose offset grows by 2 deg/s in a
/// minute empties headings of copters.
const MIN_SCATTER: f32 = 0.5;

/// Share of its mean square below which the field is fixed to the body.
const MAX_STUCK_SHARE: f32 = 0.1;

/// Ratio of the mean squares from which the field turns with the Earth again, with changed hard iron of up to half of it.
const MIN_TURNING_RATIO: f32 = 4.0;

#[derive(Clone, Copy, Debug)]
struct Scatter {
    mean: Vector3<f32>,
    mean_square: f32,
}

impl Scatter {
    const fn around(mean: Vector3<f32>) -> Self {
        Self { mean, mean_square: 0.0 }
    }

    fn add_value(&mut self, value: &Vector3<f32>, part: f32) {
        let deviation = value - self.mean;
        self.mean += deviation * part;
        self.mean_square = (1.0 - part) * (self.mean_square + part * deviation.dot(&deviation));
    }
}

/// Scatters of the field in the axes of body and Earth within one run of the gyro's integration.
#[derive(Clone, Copy, Debug)]
struct FieldScatters {
    run_number: u8,
    in_body: Scatter,
    in_earth: Scatter,
}

/// Whether the field turns with the aircraft.
#[derive(Clone, Copy, Debug)]
pub(super) struct StuckField {
    scatters: Option<FieldScatters>,
    is_stuck: bool,
}

impl StuckField {
    pub const NOT_STUCK: Self = Self { scatters: None, is_stuck: false };

    /// Whether the field is stuck: from the first turn in which it turns with the aircraft to the first in which it does not.
    pub const fn is_stuck(&self) -> bool {
        self.is_stuck
    }

    /// Adds a field relative to its strength, `step_s` after the last one.
    pub fn add_field(
        &mut self,
        field: &Vector3<f32>,
        attitude: RollPitch,
        gyro_heading: &GyroHeading,
        cos_inclination: f32,
        step_s: f32,
    ) {
        let level = attitude.to_level_frame(Field::new(*field)).ut;
        let (sin, cos) = sin_cos(gyro_heading.relative_heading_rad);
        let in_earth = Vector3::new(cos * level.x - sin * level.y, sin * level.x + cos * level.y, level.z);
        let run_number = gyro_heading.run_number;
        let mut scatters =
            self.scatters.filter(|scatters| scatters.run_number == run_number).unwrap_or(FieldScatters {
                run_number,
                in_body: Scatter::around(*field),
                in_earth: Scatter::around(in_earth),
            });
        let part = step_s / (SCATTER_TIME_S + step_s);
        scatters.in_body.add_value(field, part);
        scatters.in_earth.add_value(&in_earth, part);
        let (body, earth) = (scatters.in_body.mean_square, scatters.in_earth.mean_square);
        let min_square = square(MIN_SCATTER * cos_inclination);
        if earth > min_square && body < MAX_STUCK_SHARE * min_square {
            self.is_stuck = true;
        } else if body > min_square.max(MIN_TURNING_RATIO * earth) {
            self.is_stuck = false;
        }
        self.scatters = Some(scatters);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::EulerRates;
    use crate::trig::DEG;

    const STEP_S: f32 = 0.1;
    const COS_INCLINATION: f32 = 0.5;

    #[derive(Clone, Copy)]
    struct Leg {
        turn_rate_deg_s: f32,
        gyro_error_deg_s: f32,
        is_sensor_stuck: bool,
        hard_iron: f32,
    }

    const STRAIGHT: Leg = Leg { turn_rate_deg_s: 0.0, gyro_error_deg_s: 0.0, is_sensor_stuck: false, hard_iron: 0.0 };
    const TURN: Leg = Leg { turn_rate_deg_s: 10.0, ..STRAIGHT };
    const STUCK_STRAIGHT: Leg = Leg { is_sensor_stuck: true, ..STRAIGHT };
    const STUCK_TURN: Leg = Leg { is_sensor_stuck: true, ..TURN };

    /// Whether the field is stuck after each of the legs of 30 s.
    fn stuck_after(legs: &[Leg]) -> Vec<bool> {
        let (mut stuck_field, mut heading_rad, mut relative_heading_rad) = (StuckField::NOT_STUCK, 0.5_f32, 0.0);
        let mut field = Vector3::new(COS_INCLINATION, 0.0, 0.87);
        let fly = |leg: &Leg| {
            for _ in 0..300 {
                heading_rad += leg.turn_rate_deg_s * DEG * STEP_S;
                relative_heading_rad += (leg.turn_rate_deg_s + leg.gyro_error_deg_s) * DEG * STEP_S;
                if !leg.is_sensor_stuck {
                    let (sin, cos) = (heading_rad.sin(), heading_rad.cos());
                    field = Vector3::new(COS_INCLINATION * cos + leg.hard_iron, -COS_INCLINATION * sin, 0.87);
                }
                let gyro_heading =
                    GyroHeading { euler_rates: EulerRates::default(), relative_heading_rad, run_number: 1 };
                stuck_field.add_field(&field, RollPitch::default(), &gyro_heading, COS_INCLINATION, STEP_S);
            }
            stuck_field.is_stuck()
        };
        legs.iter().map(fly).collect()
    }

    #[test]
    fn a_field_that_turns_with_the_aircraft_is_stuck_until_it_turns_with_the_earth() {
        for (legs, stuck) in [
            (&[STUCK_STRAIGHT, STUCK_TURN, STUCK_STRAIGHT, STRAIGHT, TURN][..], &[false, true, true, true, false][..]),
            (&[TURN, Leg { turn_rate_deg_s: 7.0, ..STUCK_TURN }], &[false, true]),
            // A slow turn with a stuck sensor is the offset of a gyro in straight flight.
            (&[Leg { turn_rate_deg_s: 5.0, ..STUCK_TURN }, Leg { gyro_error_deg_s: 5.0, ..STRAIGHT }], &[false, false]),
            // Hard iron of half the field in a turn.
            (&[Leg { hard_iron: 0.5, ..TURN }], &[false]),
            (&[STUCK_TURN, Leg { hard_iron: 0.1, ..TURN }], &[true, false]),
        ] {
            assert_eq!(stuck_after(legs), stuck);
        }
    }
}
