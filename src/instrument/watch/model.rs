//! What the unknowns of the watch do to what is measured.
//!
//! With `h` the corrected field of a sample in body axes and units of the calibration's total field, `phi`, `theta` its
//! reported attitude, and `phi'`, `theta'` their rates,
//!
//! | unknown | of | acts as |
//! |---|---|---|
//! | `beta` (3) | hard iron that has changed since the calibration, body axes | `h - beta` is the Earth's field |
//! | `f`, `i` | the Earth's field: relative strength, inclination | it is `1 + f` strong and dips by `I + i` |
//! | `c`, `g` | the gyro's heading: offset, and its growth | the heading is `integral + c` |
//! | `a_r`, `a_p`, `k` | the attitude: bias of roll, of pitch; share of the bank that is told too much | `phi - a_r - k phi` |
//! | `tau` | the attitude's further latency | `phi + tau phi'`, `theta + tau theta'` |

use nalgebra::Vector3;

use super::factored::Measurement;
use crate::attitude::{Motion, Turning};
use crate::calibration::Prediction;
use crate::frames::{Attitude, Field, wrap_pi};

/// Number of unknowns.
pub(super) const UNKNOWNS: usize = 11;
/// Index of the first component of `beta`.
pub(super) const BETA: usize = 0;
/// Index of `f`.
pub(super) const STRENGTH: usize = 3;
/// Index of `i`.
pub(super) const INCLINATION: usize = 4;
/// Index of `c`.
pub(super) const OFFSET: usize = 5;
/// Index of `g`.
pub(super) const DRIFT: usize = 6;
/// Index of `a_r`.
pub(super) const ROLL: usize = 7;
/// Index of `a_p`.
pub(super) const PITCH: usize = 8;
/// Index of `k`.
pub(super) const BANK: usize = 9;
/// Index of `tau`.
pub(super) const LATENCY: usize = 10;

/// A value or a derivative for each unknown.
pub(super) type Unknowns = [f32; UNKNOWNS];

/// The hard iron that has changed, of the unknowns.
pub(super) fn beta(unknowns: &Unknowns) -> Vector3<f32> {
    Vector3::new(unknowns[BETA], unknowns[BETA + 1], unknowns[BETA + 2])
}

/// The attitude as it is by the unknowns.
pub(super) fn attitude(reported: Attitude, motion: &Motion, unknowns: &Unknowns) -> Attitude {
    let Attitude { roll_rad, pitch_rad } = reported;
    let tau = unknowns[LATENCY];
    Attitude {
        roll_rad: roll_rad - unknowns[ROLL] - unknowns[BANK] * roll_rad + tau * motion.roll_rad_s,
        pitch_rad: pitch_rad - unknowns[PITCH] + tau * motion.pitch_rad_s,
    }
}

/// An averaged sample, as far as the watch looks at it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// The corrected field, body axes, units of the calibration's total field.
    pub field: Vector3<f32>,
    /// As reported.
    pub attitude: Attitude,
    /// By the reported rates; nothing where there are none.
    pub motion: Motion,
}

impl Seen {
    /// Whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        let Self { field, attitude, motion } = self;
        let Motion { roll_rad_s, pitch_rad_s, heading_rad_s } = *motion;
        let numbers = [attitude.roll_rad, attitude.pitch_rad, roll_rad_s, pitch_rad_s, heading_rad_s];
        field.iter().chain(&numbers).all(|number| number.is_finite())
    }
}

/// The Earth's field as it is expected.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    /// Its strength, relative to the calibration's.
    pub strength: f32,
    /// Its inclination, radians.
    pub inclination_rad: f32,
    /// Its heading, radians, where the gyro says.
    pub heading_rad: Option<f32>,
}

impl Expected {
    /// By the unknowns and the calibration's inclination; with the gyro's integral, both as late as the attitude:
    /// `psi = integral + c + tau psi'`.
    pub fn new(unknowns: &Unknowns, inclination_rad: f32, turning: Option<&Turning>) -> Self {
        let by_gyro = |turning: &Turning| {
            turning.turned_rad + unknowns[OFFSET] + unknowns[LATENCY] * turning.motion.heading_rad_s
        };
        Self {
            strength: 1.0 + unknowns[STRENGTH],
            inclination_rad: inclination_rad + unknowns[INCLINATION],
            heading_rad: turning.map(by_gyro),
        }
    }
}

/// What the unknowns make of a sample.
#[derive(Clone, Debug)]
pub(super) struct Predicted {
    /// The strength of what is left of the field.
    pub total: f32,
    /// Its dip, radians.
    pub dip_rad: f32,
    /// Its heading, radians.
    pub heading_rad: f32,
    /// Tangent of the dip that is expected.
    pub tan_dip: f32,
    /// Derivatives of the three by the unknowns.
    pub total_row: Unknowns,
    pub dip_row: Unknowns,
    pub heading_row: Unknowns,
}

impl Predicted {
    /// Of a sample. The derivatives are those at the field that is expected, not at the one that is measured: noise that
    /// is in both a residual and its derivative does not cancel, and hard iron would grow along the field for ever.
    #[inline(never)]
    pub fn new(seen: &Seen, unknowns: &Unknowns, expected: &Expected) -> Self {
        let tilt = attitude(seen.attitude, &seen.motion, unknowns).tilt();
        let measured = tilt.level(Field::new(seen.field - beta(unknowns)));
        let heading_rad = measured.heading_rad();
        let level =
            Field::earth(expected.strength, expected.inclination_rad, expected.heading_rad.unwrap_or(heading_rad));
        let earth = tilt.body(level).ut;
        let prediction = Prediction::new(earth, &earth, &tilt);
        let dip_by_tilt = prediction.dip_by_attitude(&tilt);
        let heading_by_tilt = prediction.heading_by_attitude(&tilt);
        Self {
            total: measured.total_ut(),
            dip_rad: measured.inclination_rad(),
            heading_rad,
            tan_dip: prediction.level.z / prediction.horizontal,
            total_row: row(seen, &prediction.direction, [0.0; 2]),
            dip_row: row(seen, &prediction.towards_down, dip_by_tilt),
            heading_row: row(seen, &prediction.heading_by_field(&tilt), heading_by_tilt),
        }
    }

    /// Derivatives of strength, dip and heading by the corrected field.
    pub fn by_field(&self) -> [Vector3<f32>; 3] {
        // The unknown is taken from the field.
        [self.total_row, self.dip_row, self.heading_row].map(|row| -beta(&row))
    }

    /// The field is as strong as it is here: `|h - beta| = 1 + f`.
    pub fn strength(&self, expected: &Expected, variance: f32) -> Measurement<UNKNOWNS> {
        let mut row = self.total_row.map(|d| -d);
        row[STRENGTH] += 1.0;
        Measurement { row, residual: self.total - expected.strength, variance }
    }

    /// It dips as it does here: `dip = I + i`.
    pub fn inclination(&self, expected: &Expected, variance: f32) -> Measurement<UNKNOWNS> {
        let mut row = self.dip_row.map(|d| -d);
        row[INCLINATION] += 1.0;
        Measurement { row, residual: self.dip_rad - expected.inclination_rad, variance }
    }

    /// It turns as the gyro does, if that is known: `psi = integral + c + tau psi'`.
    pub fn heading(&self, expected: &Expected, seen: &Seen, variance: f32) -> Option<Measurement<UNKNOWNS>> {
        let mut row = self.heading_row.map(|d| -d);
        row[OFFSET] += 1.0;
        row[LATENCY] += seen.motion.heading_rad_s;
        let residual = wrap_pi(self.heading_rad - expected.heading_rad?);
        Some(Measurement { row, residual, variance })
    }
}

/// Derivative by the unknowns of what has these derivatives by the field and by roll and pitch.
#[inline(never)]
fn row(seen: &Seen, by_field: &Vector3<f32>, [by_roll, by_pitch]: [f32; 2]) -> Unknowns {
    let Seen { attitude, motion, .. } = seen;
    let mut row = [0.0; UNKNOWNS];
    for axis in 0..3 {
        row[BETA + axis] = -by_field[axis];
    }
    row[ROLL] = -by_roll;
    row[PITCH] = -by_pitch;
    row[BANK] = -by_roll * attitude.roll_rad;
    row[LATENCY] = by_roll * motion.roll_rad_s + by_pitch * motion.pitch_rad_s;
    row
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::*;
    use crate::calibration::tests::derivatives::assert_derivative;

    /// A field some 40 deg from the vertical, at whatever bank.
    fn seen(random: &mut Random) -> Seen {
        let mut number = |size: f32| random.uniform(-size, size);
        let attitude = Attitude { roll_rad: number(0.8), pitch_rad: number(0.4) };
        let level = Field::earth(1.0 + number(0.1), 0.8 + number(0.2), number(3.0));
        Seen {
            field: attitude.body(level).ut,
            attitude,
            motion: Motion { roll_rad_s: number(1.0), pitch_rad_s: number(0.5), heading_rad_s: number(0.6) },
        }
    }

    /// Every measurement's row is the change of its prediction, by differences: away from zero, where all of them act.
    #[test]
    fn the_rows_are_the_changes_of_what_is_predicted() {
        let mut random = Random(1);
        for _ in 0..20 {
            let seen = seen(&mut random);
            let at: Unknowns = array_of(&mut random, 0.05);
            // A calibration, and a gyro, by which all that is measured is expected.
            let nowhere = Expected { strength: 1.0, inclination_rad: 0.0, heading_rad: None };
            let found = Predicted::new(&seen, &at, &nowhere);
            let seen =
                Seen { field: beta(&at) + (seen.field - beta(&at)) * (1.0 + at[STRENGTH]) / found.total, ..seen };
            let by_gyro_rad = found.heading_rad - at[OFFSET] - at[LATENCY] * seen.motion.heading_rad_s;
            let turning = Turning { motion: seen.motion, turned_rad: by_gyro_rad, run: 0 };
            let measured = |unknowns: &Unknowns| {
                let expected = Expected::new(unknowns, found.dip_rad - at[INCLINATION], Some(&turning));
                let predicted = Predicted::new(&seen, unknowns, &expected);
                [
                    predicted.strength(&expected, 1.0),
                    predicted.inclination(&expected, 1.0),
                    predicted.heading(&expected, &seen, 1.0).unwrap(),
                ]
            };
            let here = measured(&at);
            for (kind, measurement) in here.iter().enumerate() {
                for i in 0..UNKNOWNS {
                    let moved = |step: f32| {
                        let mut unknowns = at;
                        unknowns[i] += step;
                        // A residual is measured less predicted.
                        wrap_pi(measurement.residual - measured(&unknowns)[kind].residual)
                    };
                    assert_derivative(measurement.row[i], moved, &format!("measurement {kind} by unknown {i}"));
                }
            }
        }
    }

    fn array_of(random: &mut Random, size: f32) -> Unknowns {
        core::array::from_fn(|_| random.uniform(-size, size))
    }

    /// What the field and attitude of a place and a heading are, predicted with nothing wrong, is just these.
    #[test]
    fn a_true_field_is_predicted_as_it_is() {
        let attitude = Attitude::from_deg(-30.0, 8.0);
        let body = attitude.body(Field::earth(1.0, 1.1, 2.0)).ut;
        let seen = Seen { field: body, attitude, motion: Motion::default() };
        let expected = Expected::new(&[0.0; UNKNOWNS], 1.1, None);
        let predicted = Predicted::new(&seen, &[0.0; UNKNOWNS], &expected);
        assert!((predicted.total - 1.0).abs() < 1e-6 && (predicted.dip_rad - 1.1).abs() < 1e-5);
        assert!((predicted.heading_rad - 2.0).abs() < 1e-5);
        assert!((predicted.tan_dip / 1.1_f32.tan() - 1.0).abs() < 1e-4);
    }

    /// Each unknown, taken out where it acts.
    #[test]
    fn an_attitude_is_put_right() {
        let motion = Motion { roll_rad_s: 0.5, pitch_rad_s: -0.2, heading_rad_s: 0.0 };
        let reported = Attitude { roll_rad: 0.4, pitch_rad: 0.1 };
        for (index, value, roll_rad, pitch_rad) in [
            (ROLL, 0.01, 0.39, 0.1),
            (PITCH, 0.01, 0.4, 0.09),
            (BANK, 0.1, 0.36, 0.1),
            (LATENCY, 0.1, 0.45, 0.08),
            (OFFSET, 1.0, 0.4, 0.1),
        ] {
            let mut unknowns = [0.0; UNKNOWNS];
            unknowns[index] = value;
            let found = attitude(reported, &motion, &unknowns);
            let off = (found.roll_rad - roll_rad).abs() + (found.pitch_rad - pitch_rad).abs();
            assert!(off < 1e-6, "{index}: {found:?}");
        }
    }
}
