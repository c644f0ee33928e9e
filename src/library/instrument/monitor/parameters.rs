//! Parameters of the monitor: initial covariance, process noise, measurement noise, limits.
//!
//! Fields are relative to the calibrated field strength, angles in radians. Where no other reason is given, a value
//! minimises the number of wrong headings in `lab bench integrity` and the heading error on recorded flights.
//! Gates have theirs in `innovation_gate.rs`, adaptation in `adaptive_noise.rs`.

use super::innovation_gate::PerKind;
use super::measurement_model::{
    ATTITUDE_LATENCY_INDEX, BANK_SCALE_ERROR_INDEX, GYRO_HEADING_OFFSET_INDEX, GYRO_RATE_OFFSET_INDICES,
    HARD_IRON_CHANGE_INDEX, INCLINATION_CHANGE_INDEX, MOUNT_TURN_INDEX, PITCH_BIAS_INDEX, ROLL_BIAS_INDEX,
    STRENGTH_CHANGE_INDEX,
};
use crate::instrument::correction::SensorErrorSigmas;

/// Initial standard deviation of a state, and its process noise: variance per second, added while the variance is
/// below the initial one; for the gyro heading offset always.
#[derive(Clone, Copy)]
pub(super) struct StateNoise {
    pub initial_sigma: f32,
    pub process_noise_per_s: f32,
}

const fn random_walk_noise(initial_sigma: f32, process_noise_per_s: f32) -> StateNoise {
    StateNoise { initial_sigma, process_noise_per_s }
}

/// Time in which a random walk of the hard iron has the expected drift, seconds.
const HARD_IRON_DRIFT_TIME_S: f32 = 62.5;

/// Initial sigma of a gyro offset, rad/s: 0.15 deg/s, the remainder of an autopilot's offset correction.
pub(super) const GYRO_OFFSET_SIGMA_RAD_S: f32 = 0.0026;

/// Initial sigma and process noise of state `state_index` of the monitor's filter, with the symbols of
/// [`measurement_model`](super::measurement_model).
pub(super) fn state_noise(state_index: usize, errors: SensorErrorSigmas, is_own_attitude: bool) -> StateNoise {
    match state_index {
        BANK_SCALE_ERROR_INDEX if is_own_attitude => random_walk_noise(0.0, 0.0),
        // The delays of the filters of two sensors on one board differ by milliseconds, always the same.
        ATTITUDE_LATENCY_INDEX if is_own_attitude => random_walk_noise(0.002, 1e-9),
        // Hard-iron change beta: coefficient errors are as large as a minute's drift.
        HARD_IRON_CHANGE_INDEX..MOUNT_TURN_INDEX => random_walk_noise(
            errors.hard_iron_drift_per_minute,
            errors.hard_iron_drift_per_minute * errors.hard_iron_drift_per_minute / HARD_IRON_DRIFT_TIME_S,
        ),
        // Field-strength change f: half of the 10 % by which the field strength changes over 1000 km.
        STRENGTH_CHANGE_INDEX => random_walk_noise(0.06, 1e-7),
        // Inclination change i: 5.7 deg, as over 1000 km.
        INCLINATION_CHANGE_INDEX => random_walk_noise(0.1, 1e-7),
        // Roll bias a_r and pitch bias a_p: 0.23 deg, an autopilot's level trim; in a minute 0.24 deg more, by
        // centripetal acceleration.
        ROLL_BIAS_INDEX | PITCH_BIAS_INDEX => random_walk_noise(0.004, 3e-7),
        // Bank-angle scale error k: 2 % of the bank angle.
        BANK_SCALE_ERROR_INDEX => random_walk_noise(0.02, 1e-7),
        // Attitude latency tau: 0.1 s, the delay of a telemetry link; it varies with the load of the link.
        ATTITUDE_LATENCY_INDEX => random_walk_noise(0.1, 3e-5),
        // Mount turn mu: looseness of a mount; random walk of 0.3 deg in a minute.
        MOUNT_TURN_INDEX => random_walk_noise(MOUNT_TURN_INITIAL_SIGMA_RAD, 4e-7),
        // Gyro heading offset c: unknown, more than pi; random walk of the gyro 0.06 deg in a second.
        GYRO_HEADING_OFFSET_INDEX => random_walk_noise(10.0, 1e-6),
        // Gyro offsets b_y and b_z.
        _ if GYRO_RATE_OFFSET_INDICES.contains(&state_index) => random_walk_noise(GYRO_OFFSET_SIGMA_RAD_S, 1e-9),
        // Rows of y and z of the gyro's scale matrix.
        _ => random_walk_noise(errors.gyro_scale, 1e-10),
    }
}

/// Time after a detected change during which hard iron is less certain, seconds: the change may go on.
pub(super) const POST_CHANGE_S: f32 = 60.0;

/// Hard-iron process noise within `POST_CHANGE_S` of a detected change: 0.4 uT of 50 in a minute.
pub(super) const POST_CHANGE_HARD_IRON_NOISE: StateNoise = random_walk_noise(0.01, 1e-6);

/// Time in which a slow or continued change moves the hard iron by its innovation, seconds: a third of it in a sample.
/// With 1 s, errors are the same.
pub(super) const UNEXPLAINED_CHANGE_TIME_S: f32 = 0.3;

/// Probability that hard iron has changed and not the other cause that explains the same field. With a quarter, one and a
/// half times as many headings are bad; with a half, the sigma is twice the RMS error when the gyro's offset grows by 2
/// deg/s in a minute.
pub(super) const HARD_IRON_PROBABILITY: f32 = 0.4;

/// Inflation of the heading variance at a detected change (dimensionless): the states may not model the change. It ends
/// within `POST_CHANGE_S` if the field is as calibrated again.
pub(super) const POST_CHANGE_VARIANCE_INFLATION: f32 = 3.0;

/// Hard-iron norm below which the estimate decays: 1.5 uT of 50. A larger one is a change, and persists.
pub(super) const MAX_DECAYING_HARD_IRON: f32 = 0.03;

/// Time constant of the decay of states that a flight does not observe, seconds.
pub(super) const UNOBSERVED_DECAY_TIME_S: f32 = 1000.0;

/// Longest interval between samples, seconds; a longer one is a gap.
pub(in crate::instrument) const MAX_SAMPLE_GAP_S: f32 = 3.0;

/// Longest gap over which the gyro heading's offset is kept, seconds: an offset of 0.15 deg/s turns it by 9 deg.
pub(super) const MAX_GYRO_HEADING_GAP_S: f32 = 60.0;

/// Longest interval between two samples over which rates are integrated, seconds: three usual ones. In a longer one they may
/// be those of another movement.
pub(super) const MAX_INTEGRATED_STEP_S: f32 = 0.3;

/// Time in which the own gyro measures the offset of the gyro in use to its sigma, seconds: the error lasts.
pub(super) const GYRO_OFFSET_TIME_S: f32 = 60.0;

/// Assumed interval before the first sample, seconds: the usual one.
pub(super) const INITIAL_STEP_S: f32 = 0.1;

/// Variance of an unknown angle, square radians: more than pi^2.
pub(super) const UNKNOWN_ANGLE_VARIANCE_RAD2: f32 = 10.0;

/// Factor on the sample variance of each measurement. Strength: its noise includes slow errors, of which only part is
/// in the running mean. Heading: part of the tilt noise is common to both sides.
pub(super) const SAMPLE_VARIANCE_FACTORS: PerKind<f32> = [4.0, 1.0, 0.75];

/// Variance of errors without a model, added to each measurement: 0.3 % of strength, 0.17 deg of inclination, 0.7 deg
/// of heading.
pub(super) const VARIANCE_FLOORS: PerKind<f32> = [9e-6, 9e-6, 1.44e-4];

/// Factor on the variance due to coefficient errors, which are constant at one attitude, hence do not average out.
pub(super) const COEFFICIENT_CORRELATION_FACTOR: f32 = 8.0;

/// Time for which errors of the attitude last, seconds: the gyro's heading turns by them while the aircraft pitches, or turns in a
/// climb. Without them the smoothed heading of a recorded aeroplane in aerobatics is 5.4 deg RMS; with 0.2 to 0.6, 4.5; with 2,
/// 4.8.
pub(super) const ATTITUDE_ERROR_TIME_S: f32 = 0.5;

/// Attitude timing jitter, seconds: tilt error per rotation rate. Half a period of 50 Hz.
pub(super) const ATTITUDE_JITTER_S: f32 = 0.01;

/// Limit of an innovation in the covariance inflation after a change: half the field.
pub(super) const MAX_INFLATING_INNOVATION: f32 = 0.5;

/// Limit of a tilt error in the covariance inflation after a change, radians: 17 deg.
pub(super) const MAX_INFLATING_TILT_RAD: f32 = 0.3;

/// Share of a detected change attributed to the attitude.
pub(super) const ATTITUDE_SHARE_OF_CHANGE: f32 = 0.5;

/// Share of a detected change of the field attributed to the Earth's field, which does not change suddenly. A larger
/// share explains iron that passes by another place, and none does not follow a module that was carried there.
pub(super) const EARTH_FIELD_SHARE_OF_CHANGE: f32 = 0.3;

/// Lower limit of the sine of the inclination in the share attributed to the attitude, for the magnetic equator.
pub(super) const MIN_SIN_INCLINATION: f32 = 0.3;

/// Largest heading sigma by the filter, radians: 8 deg. Beyond it headings are withheld.
pub(super) const MAX_HEADING_SIGMA_RAD: f32 = 0.14;

/// Largest heading sigma that is sent, radians: 11 deg. It is inflated after a change.
pub(in crate::instrument) const MAX_SENT_SIGMA_RAD: f32 = 0.2;

/// Largest change of hard iron, relative to the field strength: beyond it, the sensor's range and the linear model end.
pub(super) const MAX_HARD_IRON_CHANGE: f32 = 0.6;

/// Initial sigma of the mount's turn, radians: 0.17 deg. A larger one would explain errors of straight flight.
const MOUNT_TURN_INITIAL_SIGMA_RAD: f32 = 0.003;

/// Variance of the mount's turn, square radians, above which a drift has inflated it.
pub(super) const MIN_DRIFTING_MOUNT_VARIANCE: f32 = 2.0 * MOUNT_TURN_INITIAL_SIGMA_RAD * MOUNT_TURN_INITIAL_SIGMA_RAD;

/// Turn of the mount below which its estimate decays, radians: 2.3 deg. A larger one persists.
pub(super) const MAX_DECAYING_MOUNT_TURN_RAD: f32 = 0.04;

/// Largest turn of the mount, radians: 34 deg.
pub(super) const MAX_MOUNT_TURN_RAD: f32 = 0.6;

/// Withheld time, seconds, up to which a change may be a turn of the mount: a module turns once; a field that changes
/// repeatedly is disturbed.
pub(super) const MAX_WITHHELD_FOR_MOUNT_TURN_S: f32 = 5.0;

/// Largest bank of level flight, radians: 10 deg. Beyond it a change may be an error of the attitude in proportion to
/// the bank, which resembles a turn of the mount.
pub(super) const MAX_LEVEL_BANK_RAD: f32 = 0.17;

/// Largest change of field strength: that of 2000 km.
pub(super) const MAX_STRENGTH_CHANGE: f32 = 0.2;

/// Largest change of inclination, radians: 11 deg, that of 2000 km.
pub(super) const MAX_INCLINATION_CHANGE_RAD: f32 = 0.2;

/// Largest roll or pitch bias, radians: 9 deg.
pub(super) const MAX_ATTITUDE_BIAS_RAD: f32 = 0.15;

/// Largest bank-angle scale error.
pub(super) const MAX_BANK_SCALE_ERROR: f32 = 0.5;

/// Gate of a single reading's heading against the gyro heading, sigmas.
pub(super) const READING_GATE_SIGMAS: f32 = 4.5;

/// Time over which a drift of the field is measured, seconds.
pub(super) const FIELD_DRIFT_TIME_S: f32 = 60.0;
/// The same after a detected change, seconds. Without that drift iron that passes within 30 s made 0.5 to 1 % of planes' headings bad, and
/// iron that follows a copter's throttle 4 %; now 0 and 0.9 %. With 5 s the sigma after a step is 1.5 times as large.
pub(super) const POST_CHANGE_DRIFT_TIME_S: f32 = 2.0;
/// Angle by which hard iron turns the heading at most while such a drift inflates it, radians: 29 deg. Without the limit two of 308 planes
/// had headings 130 and 180 deg off after a step of iron.
pub(super) const MAX_DRIFTING_IRON_RAD: f32 = 0.5;
/// Smallest drift of the field within that time that inflates the covariance, relative to the field strength.
pub(super) const MIN_FIELD_DRIFT: f32 = 0.004;
/// Factor on the squared drift of the field in the inflated variance.
pub(super) const FIELD_DRIFT_INFLATION_FACTOR: f32 = 2.0;
/// Variance of the mount's turn by that of the field's drift: a turn moves the horizontal field alone. With 4, the RMS is one
/// and a half times as large when the gyro's offset grows by 2 deg/s in a minute.
pub(super) const MOUNT_TURN_VARIANCE_FACTOR: f32 = 2.0;

/// Growth of the sigma of a gyro offset while the heading alone changes, rad/s^2: 3.6 deg/s in a minute. With half of it, two
/// and a half times as many headings are bad after a gyro's offset has changed; with two and a half times, hard iron that
/// changes by 10 uT within 10 s turns the yaw of ArduPilot's filter by 10 deg at most, in place of 7.6.
pub(super) const GYRO_OFFSET_GROWTH_RAD_S2: f32 = 0.001;

/// Largest variance to which that of a gyro offset is inflated, (1 deg/s)^2.
pub(super) const MAX_GYRO_OFFSET_VARIANCE: f32 = 0.0175 * 0.0175;

/// Longest wait for the first report of the motor current, samples: 3 s, three periods of the slowest autopilot.
pub(super) const MAX_SAMPLES_AWAITING_CURRENT: u8 = 30;
