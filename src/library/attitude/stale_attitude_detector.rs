//! Detects a source whose attitude stops changing, except for noise, or changes by a part, while its body rates continue.
//!
//! A vector that is fixed to the Earth changes in body axes by `v' = v x w` with the body rates `w`. The rates predict
//! the motion of two such vectors: the vertical, as the attitude reports it, and the field. If the field moves as
//! predicted and the vertical does not, the attitude is at fault. If neither does, the rates are (see
//! `rate_consistency`).

use nalgebra::Vector3;

use super::vector_motion::VectorMotion;
use crate::attitude::report::{AttitudeReport, BodyRates};
use crate::frames::{Body, Field};
use crate::time::Timestamp;
use crate::trig::VectorLength as _;

/// Time constant of the estimated gyro offset, seconds: much longer than a roll. An offset that grows by 2 deg/s in a
/// minute is followed with an error of 1 deg/s.
const GYRO_OFFSET_TIME_CONSTANT_S: f32 = 30.0;

/// Largest gyro offset on an axis, rad/s: that of the monitor.
const MAX_GYRO_OFFSET_RAD_S: f32 = 0.15;

/// What shows a stale attitude; depends on the errors of the gyro.
#[derive(Debug)]
struct MotionLimits {
    /// Error of a predicted motion, radians.
    error_rad: f32,
    /// Additional error per radian turned.
    error_per_rad: f32,
    /// Smallest ratio of the reported to the predicted motion of the vertical.
    min_motion_ratio: f32,
}

impl MotionLimits {
    /// 4 deg: a gyro offset of 1 deg/s on two axes reaches 2.8 deg, noise of the attitude 0.6 deg. Scale and cross-axis errors of 10 % on
    /// two axes are 14 %. Of planes and VTOLs with an attitude of 30 % of the bank 0.3 and 0.5 % of the headings are bad, with a ratio of
    /// 0.3 1.1 and 1.9 %.
    const AUTOPILOT_GYRO: Self = Self { error_rad: 0.07, error_per_rad: 0.15, min_motion_ratio: 0.5 };

    /// 1.5 deg: the offset is known from rest. Of VTOLs without fault 0.2 % of the headings are empty with 7 %, none with 10 %.
    const OWN_GYRO: Self = Self { error_rad: 0.026, error_per_rad: 0.1, min_motion_ratio: 0.7 };
}

/// Evidence, rad^2 s, that an axis of the vertical follows the rates: at first and at most, (1.4 deg)^2 for a second; at least, (20
/// deg)^2 for a second against it.
const FULL_EVIDENCE_RAD2_S: f32 = 6.1e-4;
const LEAST_EVIDENCE_RAD2_S: f32 = -0.12;

/// Largest ratio of opposite to predicted motion of a stale vertical: that of noise.
const MAX_OPPOSITE_MOTION_RATIO: f32 = 0.5;

/// Smallest ratio of observed to predicted motion of a vector that follows the rates.
const MIN_FOLLOWING_MOTION_RATIO: f32 = 0.5;

/// Smallest predicted motion of the field that shows whether it follows, radians (2 deg): three times its noise.
const MIN_FIELD_MOTION_RAD: f32 = 0.035;

/// Time constant of the evidence that the field follows the rates, seconds. Rates in a wrong unit agree with the
/// field's motion for moments only.
const EVIDENCE_MEMORY_S: f32 = 20.0;

/// Longest interval between reports over which rates are integrated, seconds.
const MAX_STEP_S: f32 = 0.25;

#[derive(Debug)]
pub(super) struct StaleAttitudeDetector {
    /// Direction of the last reading's field.
    field_direction: Option<Vector3<f32>>,
    /// Time and body rates of the last report.
    last_report: Option<(Timestamp, Vector3<f32>)>,
    /// Gyro offset across the vertical, rad/s.
    gyro_offset_rad_s: Vector3<f32>,
    vertical_motion: VectorMotion,
    field_motion: VectorMotion,
    /// Evidence that the vertical follows the rates, for each of its body axes, rad^2 s: a source may report pitch, and not roll.
    vertical_following_evidence: [f32; 3],
    /// Evidence that the field follows the rates, leaky, square radians times seconds.
    field_following_evidence: f32,
    /// Integrated magnitude of the body rates with exponential forgetting, radians.
    rotation_sum_rad: f32,
    is_stale: bool,
}

impl StaleAttitudeDetector {
    pub const fn new() -> Self {
        Self {
            field_direction: None,
            last_report: None,
            gyro_offset_rad_s: Vector3::new(0.0, 0.0, 0.0),
            vertical_motion: VectorMotion::new(),
            field_motion: VectorMotion::new(),
            vertical_following_evidence: [FULL_EVIDENCE_RAD2_S; 3],
            field_following_evidence: 0.0,
            rotation_sum_rad: 0.0,
            is_stale: false,
        }
    }

    /// Updates the field direction with a corrected reading.
    pub fn update_field(&mut self, field: Field<Body>) {
        let strength_ut = field.ut.vector_length();
        self.field_direction = (strength_ut > 0.0).then(|| field.ut / strength_ut);
    }

    /// Direction of the last corrected field in body axes.
    pub const fn field_direction(&self) -> Option<Vector3<f32>> {
        self.field_direction
    }

    /// Processes a report, with its body rates or own ones; returns whether the attitude is stale. Always false without a field or
    /// without body rates. A detected attitude is stale until it follows the rates, or the field contradicts them.
    pub fn process_report(&mut self, at: Timestamp, report: &AttitudeReport, own_rates: Option<BodyRates>) -> bool {
        let Some((field, body_rates)) = self.field_direction.zip(own_rates.or(report.body_rates)) else {
            *self = Self::new();
            return false;
        };
        let limits = if own_rates.is_some() { &MotionLimits::OWN_GYRO } else { &MotionLimits::AUTOPILOT_GYRO };
        let rates = Vector3::from(body_rates.rad_s());
        let (last_at, last_rates) = self.last_report.replace((at, rates)).unwrap_or((at, rates));
        let step_s = at.us_since(last_at) as f32 * 1e-6;
        let turn = ((last_rates + rates) * 0.5 - self.gyro_offset_rad_s) * step_s;
        self.rotation_sum_rad = VectorMotion::decay_factor(step_s) * self.rotation_sum_rad + turn.vector_length();
        if step_s > MAX_STEP_S || !self.rotation_sum_rad.is_finite() {
            // Forgets the motion before a gap.
            self.vertical_motion = VectorMotion::new();
            self.field_motion = VectorMotion::new();
            (self.field_following_evidence, self.rotation_sum_rad) = (0.0, 0.0);
            return self.is_stale;
        }
        let down = report.attitude.tilt_rotation().down_in_body();
        let missing_motion = self.vertical_motion.accumulate_motion(down, turn, step_s);
        if !self.is_stale {
            let gyro_offset_rad_s = self.gyro_offset_rad_s + missing_motion.cross(&down) / GYRO_OFFSET_TIME_CONSTANT_S;
            self.gyro_offset_rad_s =
                gyro_offset_rad_s.map(|rad_s| rad_s.clamp(-MAX_GYRO_OFFSET_RAD_S, MAX_GYRO_OFFSET_RAD_S));
        }
        self.field_motion.accumulate_motion(field, turn, step_s);
        let VectorMotion { observed, predicted, .. } = &self.field_motion;
        self.field_following_evidence *= 1.0 - step_s / EVIDENCE_MEMORY_S;
        self.field_following_evidence += step_s * (observed - predicted * MIN_FOLLOWING_MOTION_RATIO).dot(predicted);
        self.update_vertical_evidence(limits, step_s);
        let [x, y, z] = self.vertical_following_evidence;
        let least = x.min(y).min(z);
        let is_stale = if self.is_stale {
            least < FULL_EVIDENCE_RAD2_S
        } else {
            least < 0.0 && self.has_field_moved_as_predicted()
        };
        self.is_stale = is_stale && self.field_following_evidence > 0.0;
        self.is_stale
    }

    /// Whether the field has moved as predicted, by an angle that shows it.
    fn has_field_moved_as_predicted(&self) -> bool {
        let predicted_rad = self.field_motion.predicted.vector_length();
        predicted_rad > MIN_FIELD_MOTION_RAD
            && self.field_motion.error_rad() < (1.0 - MIN_FOLLOWING_MOTION_RATIO) * predicted_rad
    }

    /// Adds what the motion of the vertical shows, beyond the error of the prediction. Motion in the other direction shows a wrong sign
    /// of the rates.
    fn update_vertical_evidence(&mut self, limits: &MotionLimits, step_s: f32) {
        let VectorMotion { observed, predicted, .. } = &self.vertical_motion;
        let error_rad = limits.error_rad + limits.error_per_rad * self.rotation_sum_rad;
        for ((evidence, observed), predicted) in
            self.vertical_following_evidence.iter_mut().zip(observed).zip(predicted)
        {
            let product = (observed - limits.min_motion_ratio * predicted) * predicted;
            let motion_rad = if product < 0.0 { predicted - observed } else { *predicted };
            let is_opposite = observed * predicted < -MAX_OPPOSITE_MOTION_RATIO * predicted * predicted;
            if motion_rad.abs() > error_rad && !is_opposite {
                *evidence = (*evidence + step_s * product).clamp(LEAST_EVIDENCE_RAD2_S, FULL_EVIDENCE_RAD2_S);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::super::testing::{heading_and_roll_in_turns_deg, report, report_time};
    use super::*;
    use crate::frames::{Field, RollPitch};

    /// Errors of the simulated sensors.
    #[derive(Clone, Copy, Default)]
    struct SensorErrors {
        /// Times at which roll and pitch stop changing, and follow again, seconds.
        stale_s: Option<[f32; 2]>,
        gyro_scale_error: f32,
        gyro_cross_axis: f32,
        gyro_offset_deg_s: f32,
        /// Growth of the offsets, deg/s in a second.
        offset_growth_deg_s2: [f32; 3],
        /// Factor on the reported rates, for a wrong unit.
        rate_factor: Option<f32>,
        is_field_stale: bool,
        /// Part of the bank that the source reports.
        reported_roll: Option<f32>,
    }

    /// Times at which the detection begins and ends, seconds, of 100 s at 50 Hz with 0.3 deg of noise each of attitude
    /// and rates.
    fn detection_changes_s(errors: SensorErrors, seed: u64) -> Vec<f32> {
        let (mut random, mut detector, mut changes, mut was_stale) =
            (Random(seed), StaleAttitudeDetector::new(), Vec::new(), false);
        for i in 0..5000_u16 {
            let t_s = f32::from(i) / 50.0;
            let [heading_deg, roll_deg] = heading_and_roll_in_turns_deg(t_s);
            let [heading_before_deg, roll_before_deg] = heading_and_roll_in_turns_deg(t_s - 0.02);
            let heading_rate_deg_s = (heading_deg - heading_before_deg).max(0.0) * 50.0;
            let mut noise_deg = || 0.3 * random.normal();
            let stale_since_s =
                errors.stale_s.filter(|[from_s, to_s]| (*from_s..*to_s).contains(&t_s)).map(|[from_s, _]| from_s);
            let attitude = RollPitch::from_deg(
                errors.reported_roll.unwrap_or(1.0) * heading_and_roll_in_turns_deg(stale_since_s.unwrap_or(t_s))[1]
                    + noise_deg(),
                noise_deg(),
            );
            let (sin_roll, cos_roll) = roll_deg.to_radians().sin_cos();
            let true_deg_s =
                [(roll_deg - roll_before_deg) * 50.0, heading_rate_deg_s * sin_roll, heading_rate_deg_s * cos_roll];
            let offset_deg_s =
                errors.offset_growth_deg_s2.map(|growth_deg_s2| errors.gyro_offset_deg_s + growth_deg_s2 * t_s);
            let sum_deg_s = true_deg_s.iter().sum::<f32>();
            let rates_rad_s = [0, 1, 2].map(|axis| {
                let (rate, offset_deg_s) = (true_deg_s[axis], offset_deg_s[axis]);
                let with_errors = rate * (1.0 + errors.gyro_scale_error) + (sum_deg_s - rate) * errors.gyro_cross_axis;
                (errors.rate_factor.unwrap_or(1.0) * (with_errors + offset_deg_s + noise_deg())).to_radians()
            });
            let field_at = if errors.is_field_stale { [0.0; 2] } else { [heading_deg, roll_deg] };
            let earth = Field::earth_field(50.0, 1.1, field_at[0].to_radians() + 0.3);
            let field = RollPitch::from_deg(field_at[1], 0.0).to_body_frame(Field::new(earth.ut));
            detector.update_field(Field::new(field.ut.map(|ut| ut + 0.3 * random.normal())));
            let own_rates = errors.reported_roll.and_then(|_| BodyRates::from_rad_s(rates_rad_s));
            let is_stale = detector.process_report(report_time(i), &report(attitude, rates_rad_s), own_rates);
            if is_stale != was_stale {
                changes.push(t_s);
                was_stale = is_stale;
            }
        }
        changes
    }

    /// An attitude that becomes stale in level flight is detected in the next roll, from 29 s; in a turn, in the roll
    /// back to level, from 39 s. Gyro errors of 10 % and 1 deg/s delay this by up to 9 s.
    #[test]
    fn a_stale_attitude_is_detected_in_the_next_roll() {
        for seed in 0..20 {
            for (from_s, roll_from_s) in [(25.0, 29.0), (33.0, 39.0)] {
                for (gyro_scale_error, gyro_cross_axis, gyro_offset_deg_s, within_s) in
                    [(0.0, 0.0, 0.0, 1.0), (0.1, 0.1, 1.0, 10.0), (-0.1, -0.1, -1.0, 10.0)]
                {
                    let stale_s = Some([from_s, f32::INFINITY]);
                    let errors = SensorErrors {
                        stale_s,
                        gyro_scale_error,
                        gyro_cross_axis,
                        gyro_offset_deg_s,
                        ..SensorErrors::default()
                    };
                    let found = detection_changes_s(errors, seed);
                    assert!(
                        matches!(found[..], [at_s] if (from_s..roll_from_s + within_s).contains(&at_s)),
                        "{found:?}"
                    );
                }
            }
        }
    }

    /// With own rates, the first roll, from 9 to 10 s, shows a source that reports at most 60 % of the bank, and it stays stale. A source
    /// that reports 80 % is never stale.
    #[test]
    fn a_part_of_the_bank_is_detected_by_the_own_gyro() {
        for seed in 0..20 {
            for (reported_roll, is_detected) in [(0.3, true), (0.5, true), (0.6, true), (0.8, false), (1.0, false)] {
                let errors = SensorErrors {
                    gyro_scale_error: 0.02,
                    gyro_cross_axis: 0.02,
                    gyro_offset_deg_s: 0.1,
                    reported_roll: Some(reported_roll),
                    ..SensorErrors::default()
                };
                let found = detection_changes_s(errors, seed);
                let is_right = if is_detected {
                    matches!(found[..], [at_s] if (9.0..11.0).contains(&at_s))
                } else {
                    found.is_empty()
                };
                assert!(is_right, "{reported_roll} {seed}: {found:?}");
            }
        }
    }

    /// The reported attitude stays level. A slow roll shows that it is stale; after a minute without motion, rates of
    /// the wrong sign contradict the field, and nothing is known about the attitude.
    #[test]
    fn a_slow_roll_is_enough_and_a_contradicting_field_ends_the_detection() {
        let (mut detector, mut step, mut roll_deg, mut is_stale) = (StaleAttitudeDetector::new(), 0_u64, 0.0, false);
        for (seconds, rate_deg_s, rate_factor, expected) in
            [(1, 0.0, 1.0, false), (3, 8.0, 1.0, true), (60, 0.0, 1.0, true), (2, -12.0, -1.0, false)]
        {
            for _ in 0..50 * seconds {
                step += 1;
                roll_deg += rate_deg_s / 50.0;
                let earth = Field::earth_field(50.0, 1.1, 0.3);
                detector.update_field(RollPitch::from_deg(roll_deg, 0.0).to_body_frame(earth));
                let rates_rad_s = [rate_factor * rate_deg_s, 0.0, 1e-6].map(f32::to_radians);
                is_stale = detector.process_report(report_time(step), &report(RollPitch::default(), rates_rad_s), None);
            }
            assert_eq!(is_stale, expected, "{rate_deg_s}");
        }
    }

    /// Gyro errors of 10 % and 1 deg/s, offsets that grow by 4 deg/s in a minute, a wrong unit or sign of the rates,
    /// and a field that does not move.
    #[test]
    fn other_faults_are_no_stale_attitude() {
        for seed in 0..20 {
            for (gyro_scale_error, gyro_cross_axis, gyro_offset_deg_s) in
                [(0.1, 0.1, 1.0), (-0.1, 0.1, -1.0), (0.1, -0.1, 1.0)]
            {
                let errors =
                    SensorErrors { gyro_scale_error, gyro_cross_axis, gyro_offset_deg_s, ..SensorErrors::default() };
                assert_eq!(detection_changes_s(errors, seed), []);
            }
            for direction in [[0.0, 1.0, 0.0], [1.0, -1.0, 1.0], [-1.0, -1.0, 1.0]] {
                let offset_growth_deg_s2 = direction.map(|axis| axis * 4.0 / 60.0);
                let errors = SensorErrors { offset_growth_deg_s2, ..SensorErrors::default() };
                assert_eq!(detection_changes_s(errors, seed), [], "{direction:?}");
            }
            for rate_factor in [57.3, 1.0 / 57.3, -1.0] {
                let errors = SensorErrors { rate_factor: Some(rate_factor), ..SensorErrors::default() };
                assert_eq!(detection_changes_s(errors, seed), [], "{rate_factor}");
            }
            let still_field =
                SensorErrors { stale_s: Some([25.0, f32::INFINITY]), is_field_stale: true, ..SensorErrors::default() };
            assert_eq!(detection_changes_s(still_field, seed), []);
        }
    }

    #[test]
    fn infinite_rates_are_discarded() {
        let mut detector = StaleAttitudeDetector::new();
        detector.update_field(Field::from_ut(20.0, 0.0, 43.0));
        for (i, rate_rad_s) in [(0_u8, f32::INFINITY), (1, 0.1), (2, 0.1)] {
            detector.process_report(report_time(i), &report(RollPitch::default(), [rate_rad_s, 0.0, 0.0]), None);
        }
        // The infinite rate of the first report also enters the mean of the second step.
        assert!(detector.rotation_sum_rad.is_finite() && detector.vertical_motion.predicted.vector_length() < 0.01);
    }

    #[test]
    fn a_field_of_zero_has_no_direction() {
        let mut detector = StaleAttitudeDetector::new();
        detector.update_field(Field::from_ut(0.0, 0.0, 0.0));
        assert_eq!(detector.field_direction, None);
    }
}
