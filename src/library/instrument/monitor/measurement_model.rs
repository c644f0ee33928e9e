//! Measurement model of the monitor: states, predictions and Jacobian rows.
//!
//! With `h` the corrected field of a sample in body axes, in units of the calibrated field strength, `phi` and `theta`
//! the reported attitude, `phi'` and `theta'` their rates, `I` the calibrated inclination and `psi'` the turn rate:
//!
//! | state | meaning | model |
//! |---|---|---|
//! | `beta` (3) | change of hard iron since the calibration, body axes | Earth's field `W R(mu) (m - b) - beta` |
//! | `mu` | turn of the module in its mount with its iron, clockwise from above | see `beta` |
//! | `f`, `i` | change of field strength (relative) and of inclination | strength `1 + f`, inclination `I + i` |
//! | `a_r`, `a_p`, `k` | roll bias, pitch bias, bank-angle scale error | roll `phi - a_r - k phi` |
//! | `tau` | residual attitude latency | `phi + tau phi'`, `theta + tau theta'` |
//! | `c` | offset of the gyro heading | heading `integral + c + tau psi'` |
//! | gyro (8) | offsets, scale errors, cross-axis sensitivities | `c' = - row . gyro`, see `gyro_error.rs` |

use core::array;

use nalgebra::Vector3;

use super::super::gyro_error::GYRO_ERROR_COUNT;
use super::super::ud_filter::Measurement;
use super::innovation_gate::PerKind;
use crate::attitude::{EulerRates, GyroHeading};
use crate::calibration::{Calibration, FieldPrediction, multiply};
use crate::frames::{Body, Field, RollPitch, wrap_pi};
use crate::trig;
use crate::trig::VectorLength as _;

pub(super) const STATE_COUNT: usize = FIRST_GYRO_ERROR_INDEX + GYRO_ERROR_COUNT;
pub(super) const HARD_IRON_CHANGE_INDEX: usize = 0;
pub(super) const HARD_IRON_INDICES: [usize; 3] =
    [HARD_IRON_CHANGE_INDEX, HARD_IRON_CHANGE_INDEX + 1, HARD_IRON_CHANGE_INDEX + 2];
/// The mount turn is an early state, because the field strength depends only on the states up to it.
pub(super) const MOUNT_TURN_INDEX: usize = 3;
pub(super) const STRENGTH_CHANGE_INDEX: usize = 4;
pub(super) const INCLINATION_CHANGE_INDEX: usize = 5;
pub(super) const ROLL_BIAS_INDEX: usize = 6;
pub(super) const PITCH_BIAS_INDEX: usize = 7;
pub(super) const BANK_SCALE_ERROR_INDEX: usize = 8;
pub(super) const ATTITUDE_LATENCY_INDEX: usize = 9;
/// Offset of the gyro heading; propagated from the gyro's errors, so it is the state before them.
pub(super) const GYRO_HEADING_OFFSET_INDEX: usize = 10;
/// First state of the gyro's errors, which are the last states.
pub(super) const FIRST_GYRO_ERROR_INDEX: usize = 11;
/// States of the gyro offsets of the y and the z axis.
pub(super) const GYRO_RATE_OFFSET_INDICES: [usize; 2] =
    [FIRST_GYRO_ERROR_INDEX, FIRST_GYRO_ERROR_INDEX + GYRO_ERROR_COUNT / 2];

/// States whose change shows a drift of the field.
pub(super) const DRIFTING_STATES: [usize; 6] = [
    HARD_IRON_CHANGE_INDEX,
    HARD_IRON_CHANGE_INDEX + 1,
    HARD_IRON_CHANGE_INDEX + 2,
    MOUNT_TURN_INDEX,
    STRENGTH_CHANGE_INDEX,
    INCLINATION_CHANGE_INDEX,
];

pub(super) type StateVector = [f32; STATE_COUNT];

pub(super) fn hard_iron_change(states: &StateVector) -> Vector3<f32> {
    Vector3::new(states[HARD_IRON_CHANGE_INDEX], states[HARD_IRON_CHANGE_INDEX + 1], states[HARD_IRON_CHANGE_INDEX + 2])
}

/// Axis of a turn of the module in its mount: the body's z axis in the sensor's axes. Soft iron is symmetric but for
/// the mounting, and changes the mean of `W^-1 z` and `W^T z` only to second order. Not a number if `W` is
/// singular.
pub(super) fn mount_axis(calibration: &Calibration) -> Vector3<f32> {
    let [x, y, z] = calibration.w.map(Vector3::from);
    (x.cross(&y).unit_vector() + z.unit_vector()).unit_vector()
}

/// Effect of a turn of the module and its iron on its corrected field: with the axis `a` and the measured field less
/// hard iron `m - b`, `W R(mu) (m - b) = h + sin mu p + (1 - cos mu) q`. Iron of the airframe, which stays, changes the
/// hard iron besides.
#[derive(Clone, Copy, Debug)]
pub(super) struct MountTurnEffect {
    /// Field change `p` by the sine of the mount's turn: `W (a x (m - b))`.
    change_by_sine: Vector3<f32>,
    /// Field change `q` by one minus the cosine of the mount's turn: `W (a x (a x (m - b)))`.
    change_by_one_minus_cosine: Vector3<f32>,
}

impl MountTurnEffect {
    /// The effect on a measured field less hard iron, sensor axes, relative to the calibrated field strength.
    pub fn new(calibration: &Calibration, normalised_field: &Vector3<f32>) -> Self {
        let (w, axis) = (calibration.w_matrix(), mount_axis(calibration));
        let across = axis.cross(normalised_field);
        Self { change_by_sine: multiply(&w, &across), change_by_one_minus_cosine: multiply(&w, &axis.cross(&across)) }
    }

    /// Change of the field by a turn, relative to the field strength, and its derivative by the turn.
    pub fn field_change_and_derivative(&self, turn_rad: f32) -> [Vector3<f32>; 2] {
        let (sin, cos) = trig::sin_cos(turn_rad);
        [
            self.change_by_sine * sin + self.change_by_one_minus_cosine * (1.0 - cos),
            self.change_by_sine * cos + self.change_by_one_minus_cosine * sin,
        ]
    }
}

/// The Earth's field in body axes, by a sample and the states; and its derivative by the turn of the mount.
pub(super) fn body_field(sample: &MonitorSample, states: &StateVector) -> (Field<Body>, Vector3<f32>) {
    let [change, by_mount_turn] = sample
        .mount_turn_effect
        .map_or_else(Default::default, |effect| effect.field_change_and_derivative(states[MOUNT_TURN_INDEX]));
    (Field::new(sample.field + change - hard_iron_change(states)), by_mount_turn)
}

pub(super) fn correct_attitude(reported: RollPitch, euler_rates: &EulerRates, states: &StateVector) -> RollPitch {
    let RollPitch { roll_rad, pitch_rad } = reported;
    let tau = states[ATTITUDE_LATENCY_INDEX];
    RollPitch {
        roll_rad: roll_rad - states[ROLL_BIAS_INDEX] - states[BANK_SCALE_ERROR_INDEX] * roll_rad
            + tau * euler_rates.roll_rad_s,
        pitch_rad: pitch_rad - states[PITCH_BIAS_INDEX] + tau * euler_rates.pitch_rad_s,
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct MonitorSample {
    /// Field in body axes, relative to the calibrated field strength.
    pub field: Vector3<f32>,
    /// `None` if the mount cannot turn.
    pub mount_turn_effect: Option<MountTurnEffect>,
    pub attitude: RollPitch,
    /// Euler-angle rates at the last reading, by which the attitude of a late source has gone on; zero without body rates.
    pub euler_rates: EulerRates,
}

impl MonitorSample {
    pub fn is_finite(&self) -> bool {
        let Self { field, mount_turn_effect, attitude, euler_rates } = self;
        let EulerRates { roll_rad_s, pitch_rad_s, heading_rad_s } = *euler_rates;
        let angles = attitude.roll_rad + attitude.pitch_rad + roll_rad_s + pitch_rad_s + heading_rad_s;
        // A sum with infinity or NaN is not finite.
        let change = mount_turn_effect.map_or(0.0, |effect| effect.change_by_one_minus_cosine.sum());
        (field.sum() + change + angles).is_finite()
    }
}

/// Predicted Earth's field; strength relative to the calibration's.
#[derive(Clone, Copy, Debug)]
pub(super) struct PredictedField {
    pub strength: f32,
    pub inclination_rad: f32,
    /// Gyro heading, radians; `None` without body rates.
    pub heading_rad: Option<f32>,
}

impl PredictedField {
    /// Prediction from the states, the calibrated inclination and the gyro's integral: `psi = integral + c + tau psi'`.
    pub fn new(states: &StateVector, inclination_rad: f32, gyro_heading: Option<&GyroHeading>) -> Self {
        let by_gyro = |turning: &GyroHeading| {
            turning.relative_heading_rad
                + states[GYRO_HEADING_OFFSET_INDEX]
                + states[ATTITUDE_LATENCY_INDEX] * turning.euler_rates.heading_rad_s
        };
        Self {
            strength: 1.0 + states[STRENGTH_CHANGE_INDEX],
            inclination_rad: inclination_rad + states[INCLINATION_CHANGE_INDEX],
            heading_rad: gyro_heading.map(by_gyro),
        }
    }
}

/// Sample corrected by the states, with Jacobian rows.
#[derive(Clone, Debug)]
pub(super) struct MeasurementModel {
    pub strength: f32,
    pub inclination_rad: f32,
    pub heading_rad: f32,
    pub tan_inclination: f32,
    /// Measured field, corrected as calibrated, less the predicted one, body axes.
    pub calibrated_field_residual: Vector3<f32>,
    pub strength_jacobian: StateVector,
    pub inclination_jacobian: StateVector,
    pub heading_jacobian: StateVector,
}

impl MeasurementModel {
    /// Evaluates the model. The Jacobian is taken at the predicted field, not at the measured one: noise common to a
    /// residual and its derivative does not average out and would make the hard-iron estimate grow along the field.
    #[inline(never)]
    pub fn new(sample: &MonitorSample, states: &StateVector, predicted: &PredictedField) -> Self {
        let tilt = correct_attitude(sample.attitude, &sample.euler_rates, states).tilt_rotation();
        let (field, by_mount_turn) = body_field(sample, states);
        let measured = tilt.to_level_frame(field);
        let heading_rad = measured.heading_rad();
        let level = Field::earth_field(
            predicted.strength,
            predicted.inclination_rad,
            predicted.heading_rad.unwrap_or(heading_rad),
        );
        let earth = tilt.to_body_frame(level).ut;
        let prediction = FieldPrediction::new(earth, &earth, &tilt);
        let inclination_by_tilt = prediction.inclination_derivatives_by_attitude(&tilt);
        let heading_by_tilt = prediction.heading_derivatives_by_attitude(&tilt);
        let row = |by_field: &Vector3<f32>, by_tilt| jacobian_row(sample, &by_mount_turn, by_field, by_tilt);
        Self {
            strength: measured.total_ut(),
            inclination_rad: measured.inclination_rad(),
            heading_rad,
            tan_inclination: prediction.level_field.z / prediction.cos_inclination,
            calibrated_field_residual: sample.field - earth,
            strength_jacobian: row(&prediction.field_direction, [0.0; 2]),
            inclination_jacobian: row(&prediction.inclination_derivative_by_field, inclination_by_tilt),
            heading_jacobian: row(&prediction.heading_derivative_by_field(&tilt), heading_by_tilt),
        }
    }

    pub fn cos_inclination(&self) -> f32 {
        1.0 / trig::hypot(1.0, self.tan_inclination)
    }

    pub fn field_jacobians(&self) -> [Vector3<f32>; 3] {
        // The model subtracts `beta` from the field; hence the sign.
        [self.strength_jacobian, self.inclination_jacobian, self.heading_jacobian].map(|row| -hard_iron_change(&row))
    }

    /// The measurements with their noise variances; heading only with a gyro heading.
    ///
    /// Strength `|h - beta| = 1 + f`, inclination `inclination(h - beta) = I + i`, heading
    /// `psi = integral + c + tau psi'`.
    pub fn measurements(
        &self,
        predicted: &PredictedField,
        sample: &MonitorSample,
        variances: PerKind<f32>,
    ) -> PerKind<Option<Measurement<STATE_COUNT>>> {
        let residuals = [
            Some(self.strength - predicted.strength),
            Some(self.inclination_rad - predicted.inclination_rad),
            predicted.heading_rad.map(|heading_rad| wrap_pi(self.heading_rad - heading_rad)),
        ];
        let mut jacobians =
            [self.strength_jacobian, self.inclination_jacobian, self.heading_jacobian].map(|row| row.map(|d| -d));
        jacobians[0][STRENGTH_CHANGE_INDEX] += 1.0;
        jacobians[1][INCLINATION_CHANGE_INDEX] += 1.0;
        jacobians[2][GYRO_HEADING_OFFSET_INDEX] += 1.0;
        jacobians[2][ATTITUDE_LATENCY_INDEX] += sample.euler_rates.heading_rad_s;
        array::from_fn(|kind| {
            let (jacobian, variance) = (jacobians[kind], variances[kind]);
            residuals[kind].map(|residual| Measurement { jacobian, residual, variance })
        })
    }
}

/// Jacobian row by the chain rule, from derivatives of the field by the turn of the mount, and with respect to the
/// field and to roll and pitch.
fn jacobian_row(
    sample: &MonitorSample,
    by_mount_turn: &Vector3<f32>,
    by_field: &Vector3<f32>,
    [by_roll, by_pitch]: [f32; 2],
) -> StateVector {
    let MonitorSample { attitude, euler_rates, .. } = sample;
    let mut row = [0.0; STATE_COUNT];
    for axis in 0..3 {
        row[HARD_IRON_CHANGE_INDEX + axis] = -by_field[axis];
    }
    row[MOUNT_TURN_INDEX] = by_field.dot(by_mount_turn);
    row[ROLL_BIAS_INDEX] = -by_roll;
    row[PITCH_BIAS_INDEX] = -by_pitch;
    row[BANK_SCALE_ERROR_INDEX] = -by_roll * attitude.roll_rad;
    row[ATTITUDE_LATENCY_INDEX] = by_roll * euler_rates.roll_rad_s + by_pitch * euler_rates.pitch_rad_s;
    row
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::*;
    use crate::calibration::tests::derivatives::assert_derivative;

    fn random_sample(random: &mut Random) -> MonitorSample {
        let mut number = |size: f32| random.uniform(-size, size);
        let attitude = RollPitch { roll_rad: number(0.8), pitch_rad: number(0.4) };
        let level = Field::earth_field(1.0 + number(0.1), 0.8 + number(0.2), number(3.0));
        MonitorSample {
            field: attitude.to_body_frame(level).ut,
            mount_turn_effect: Some(MountTurnEffect {
                change_by_sine: Vector3::from_fn(|_, _| number(1.0)),
                change_by_one_minus_cosine: Vector3::from_fn(|_, _| number(1.0)),
            }),
            attitude,
            euler_rates: EulerRates { roll_rad_s: number(1.0), pitch_rad_s: number(0.5), heading_rad_s: number(0.6) },
        }
    }

    #[test]
    fn jacobian_rows_equal_numerical_derivatives() {
        let mut random = Random(1);
        for _ in 0..20 {
            let monitor_sample = random_sample(&mut random);
            let at: StateVector = random_states(&mut random, 0.05);
            let reference_field = PredictedField { strength: 1.0, inclination_rad: 0.0, heading_rad: None };
            let found = MeasurementModel::new(&monitor_sample, &at, &reference_field);
            let monitor_sample = MonitorSample {
                field: monitor_sample.field
                    + body_field(&monitor_sample, &at).0.ut
                        * ((1.0 + at[STRENGTH_CHANGE_INDEX]) / found.strength - 1.0),
                ..monitor_sample
            };
            let by_gyro_rad = found.heading_rad
                - at[GYRO_HEADING_OFFSET_INDEX]
                - at[ATTITUDE_LATENCY_INDEX] * monitor_sample.euler_rates.heading_rad_s;
            let turning = GyroHeading {
                euler_rates: monitor_sample.euler_rates,
                relative_heading_rad: by_gyro_rad,
                run_number: 0,
            };
            let measured = |states: &StateVector| {
                let predicted_field =
                    PredictedField::new(states, found.inclination_rad - at[INCLINATION_CHANGE_INDEX], Some(&turning));
                let model = MeasurementModel::new(&monitor_sample, states, &predicted_field);
                model.measurements(&predicted_field, &monitor_sample, [1.0; 3]).map(Option::unwrap)
            };
            let here = measured(&at);
            for (kind, measurement) in here.iter().enumerate() {
                for i in 0..STATE_COUNT {
                    let moved = |step: f32| {
                        let mut states = at;
                        states[i] += step;
                        wrap_pi(measurement.residual - measured(&states)[kind].residual)
                    };
                    assert_derivative(measurement.jacobian[i], moved, &format!("measurement {kind} by unknown {i}"));
                }
            }
        }
    }

    fn random_states(random: &mut Random, size: f32) -> StateVector {
        array::from_fn(|_| random.uniform(-size, size))
    }
}
