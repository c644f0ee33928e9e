//! Selection of the samples to store, D-optimal: a full buffer replaces the sample that contributes least information.
//!
//! Each sample contributes two equations for the coefficients, the field strength and the inclination of the corrected
//! field (see [`calibration`](crate::calibration)). The quality of a set is the determinant of its Fisher information
//! `M` (D-optimality, V. V. Fedorov, "Theory of Optimal Experiments", 1972). Removing an equation `x` of leverage `l =
//! x^T M^-1 x` multiplies the determinant by `1 - l`; the sample with the smallest sum of leverages is removed.
//!
//! The equations depend on the field's direction in the body, hence on the coefficients. A sphere through the samples
//! gives it to 10 or 20 deg, which suffices; a trial solve gives it to about 1 deg. Soft iron, being linear, scales the
//! determinants of all sets equally.
//!
//! Noise must not raise a sample's leverage: selection among thousands of samples would prefer noise of one sign and
//! bias the solution. Hence the norm is normalised, and the inclination residual of a trial solve is removed by
//! rotating the measured direction by the sensor's share of it. (An attitude error rotates the down direction in the
//! same plane and leaves the derivative's direction unchanged.) Samples are not rejected for large inclination
//! residuals: that reinforces an early wrong solution, and made one copter calibration in ten wrong instead of one in a
//! hundred.
//!
//! Level samples tell iron that follows the load factor from hard iron, which the determinant does not value: the
//! circles of a VTOL would displace all of its hover. So a quota of level samples is retained.

use nalgebra::Vector3;

use super::retained_samples::PartState;
use super::sample_buffer::{LEVEL_QUOTA, SampleBuffer, SampleUse, WHOLE_BUFFER};
use super::turn_detector::is_level;
use crate::calibration::{
    Calibration, FieldPrediction, InformationMatrix, JacobianRow, LeastSquares, Orientation, Quality, Sample, Samples,
    fit_sphere,
};
use crate::frames::{RollPitch, wrap_pi};
use crate::trig;
use crate::trig::VectorLength as _;

/// Smallest change of the field between distinct samples, microtesla: three sigma of an averaged sample.
const MIN_FIELD_CHANGE_UT: f32 = 1.0;

/// Smallest change of the attitude between distinct samples, radians (1.5 deg).
const MIN_ATTITUDE_CHANGE_RAD: f32 = 0.026;

/// Prior information on each unknown, in units of inclination equations. Keeps the matrix invertible, above `f32`
/// rounding in the sum over all samples.
const PRIOR_INFORMATION: f32 = 0.01;

/// Lower bound of the field's norm, microtesla, against division by zero.
const MIN_NORM_UT: f32 = 1e-3;

/// Largest rotation that removes sensor noise from a direction of the field, radians: five sigma of a sensor with 1 %
/// noise. Larger residuals have other causes.
const MAX_NOISE_ROTATION_RAD: f32 = 0.05;

/// What separates a sample from the last stored one.
#[derive(Clone, Copy, Debug)]
pub(super) enum SampleSpacing {
    /// Time: a vehicle that stands at a heading averages its noise.
    Interval { ms: u32 },
    /// Field or attitude. A parked aircraft adds no information, and may be near the iron of a hangar.
    Distinct,
}

/// Result of offering a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OfferedSampleResult {
    /// Dropped, because it is not finite or too near the last stored one.
    Ignored,
    /// Distinct, but not more informative than those stored.
    Rejected,
    /// The sample was stored.
    Stored,
}

#[derive(Clone, Debug)]
struct Linearisation {
    calibration: Calibration,
    /// Share of an inclination residual that is sensor noise, 0..1; the rest is attitude error.
    sensor_noise_share: f32,
    /// Factor on a new sample's leverage, below 1 because noise raises it; smaller for a sphere.
    new_sample_leverage_factor: f32,
    is_from_trial: bool,
}

impl Linearisation {
    /// No coefficients. All zeros, so that initial data need no flash.
    const NO_COEFFICIENTS: Self = Self {
        calibration: Calibration {
            w: [[0.0; 3]; 3],
            b_ut: [0.0; 3],
            inclination_rad: 0.0,
            total_ut: 0.0,
            latency_s: 0.0,
            motor_current: crate::calibration::MotorCurrentInterference::NO_INTERFERENCE,
        },
        sensor_noise_share: 0.0,
        new_sample_leverage_factor: 0.0,
        is_from_trial: false,
    };

    fn from_centre(centre_ut: Vector3<f32>) -> Self {
        let calibration =
            Calibration { b_ut: centre_ut.into(), ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION) };
        Self { calibration, sensor_noise_share: 0.0, new_sample_leverage_factor: 0.8, is_from_trial: false }
    }

    /// Coefficients of a trial solve, with the residuals of its quality.
    fn from_trial(calibration: &Calibration, quality: &Quality) -> Self {
        let norm_noise_ratio = quality.norm_residual / quality.inclination_residual_deg.to_radians();
        // `min` maps NaN, if both residuals are zero, to 1.
        Self {
            calibration: *calibration,
            sensor_noise_share: (norm_noise_ratio * norm_noise_ratio).min(1.0),
            new_sample_leverage_factor: 0.9,
            is_from_trial: true,
        }
    }

    /// Jacobian rows of norm and inclination at the noise-corrected unit direction.
    fn jacobian_rows(&self, sample: &Sample) -> [JacobianRow; 2] {
        let field_ut = self.calibration.corrected_body_field(sample).ut;
        let direction = field_ut / field_ut.vector_length().max(MIN_NORM_UT);
        let latency_s = self.calibration.latency_s;
        let attitude = if latency_s == 0.0 { sample.attitude } else { sample.latency_compensated_attitude(latency_s) };
        let prediction = FieldPrediction::new(direction, &direction, &attitude.tilt_rotation());
        if !self.is_from_trial {
            return [prediction.norm_row(), prediction.inclination_row()];
        }
        let noise_rotation_rad =
            self.sensor_noise_share * (prediction.inclination_rad - self.calibration.inclination_rad);
        let noise_rotation_rad = noise_rotation_rad.clamp(-MAX_NOISE_ROTATION_RAD, MAX_NOISE_ROTATION_RAD);
        // Small rotation in the plane of field and vertical.
        let direction = prediction.field_direction - prediction.inclination_derivative_by_field * noise_rotation_rad;
        let rotation_direction =
            prediction.inclination_derivative_by_field + prediction.field_direction * noise_rotation_rad;
        let corrected_prediction = FieldPrediction {
            centred_field: direction,
            field_direction: direction,
            inclination_derivative_by_field: rotation_direction,
            ..prediction
        };
        [corrected_prediction.norm_row(), corrected_prediction.inclination_row()]
    }
}

/// Factor on the smallest leverage that a new sample must exceed: its information lowers the leverage of all others.
const MIN_NEW_SAMPLE_LEVERAGE_RATIO: f32 = 0.9;

#[derive(Debug)]
pub(super) struct DOptimalSelection {
    linearisation: Linearisation,
    information: LeastSquares<13, 1>,
    smallest_leverage: f32,
    /// Whether the last full evaluation found no more level samples than their quota.
    retains_level: bool,
}

impl DOptimalSelection {
    pub const NO_SELECTION: Self = Self {
        linearisation: Linearisation::NO_COEFFICIENTS,
        information: LeastSquares::new(),
        smallest_leverage: 0.0,
        retains_level: false,
    };

    fn with_reset_leverages(&self) -> Self {
        Self { linearisation: self.linearisation.clone(), ..Self::NO_SELECTION }
    }

    pub fn reset_selection(&mut self) {
        self.set_linearisation(Linearisation::NO_COEFFICIENTS);
    }

    /// Evaluates samples with the coefficients of a trial solve from now on.
    pub fn use_trial_solution(&mut self, calibration: &Calibration, quality: &Quality) {
        self.set_linearisation(Linearisation::from_trial(calibration, quality));
    }

    fn set_linearisation(&mut self, linearisation: Linearisation) {
        // The leverages of earlier coefficients do not apply; zero accepts every sample until the next full evaluation.
        self.linearisation = linearisation;
        self.smallest_leverage = 0.0;
    }

    /// Whether the trial solution replaces the linearisation at the first samples.
    #[must_use]
    pub fn uses_trial_solution(&self) -> bool {
        self.linearisation.is_from_trial
    }

    /// Stores a sample if it is due, in place of the least informative one if the buffer is full.
    pub fn push_sample(
        &mut self,
        buffer: &mut SampleBuffer,
        state: &mut PartState,
        sample: Sample,
        spacing: SampleSpacing,
    ) -> OfferedSampleResult {
        if !is_due(buffer, &sample, spacing) {
            return OfferedSampleResult::Ignored;
        }
        let sample_use = state.count_and_assign_use();
        let stored = buffer.samples_of_use(sample_use);
        if stored.len() < WHOLE_BUFFER.of_use(sample_use) {
            buffer.insert_sample(sample_use, sample);
            return OfferedSampleResult::Stored;
        }
        let level_quota = LEVEL_QUOTA.of_use(sample_use);
        let weakest = match sample_use {
            SampleUse::Fit if !self.may_exceed_weakest(&sample) => None,
            SampleUse::Fit => self.find_least_informative_sample(&sample, stored, level_quota),
            SampleUse::Verification => {
                self.with_reset_leverages().find_least_informative_sample(&sample, stored, level_quota)
            }
        };
        let Some(position) = weakest.and_then(|weakest| weakest.checked_sub(1)) else {
            return OfferedSampleResult::Rejected;
        };
        buffer.replace_sample(sample_use, position, sample);
        OfferedSampleResult::Stored
    }

    /// Whether a sample outside the set may exceed the smallest leverage, or is level while those are retained;
    /// conservative, at a thousandth of the cost of a full evaluation.
    fn may_exceed_weakest(&self, sample: &Sample) -> bool {
        if self.retains_level && is_level(sample) {
            return true;
        }
        // Leverage after inclusion in the set.
        let leverage_sum: f32 = self.leverages(sample).into_iter().map(|leverage| leverage / (1.0 + leverage)).sum();
        // NaN is left to the full evaluation, as is every sample without coefficients.
        leverage_sum.is_nan()
            || self.linearisation.new_sample_leverage_factor * leverage_sum
                >= MIN_NEW_SAMPLE_LEVERAGE_RATIO * self.smallest_leverage
    }

    #[inline]
    fn leverages(&self, sample: &Sample) -> [f32; 2] {
        let [norm, inclination] = self.linearisation.jacobian_rows(sample);
        self.information.variance_pair([&norm.as_vector(), &inclination.as_vector()])
    }

    /// Index of the sample with the least leverage, the new one being the first; `None` if there is no sphere through
    /// the samples. Up to `level_quota` level samples are retained whatever their leverage.
    #[inline(never)]
    fn find_least_informative_sample(
        &mut self,
        new_sample: &Sample,
        samples: &[Sample],
        level_quota: usize,
    ) -> Option<usize> {
        self.information = LeastSquares::new();
        if !self.linearisation.is_from_trial {
            let (centre_ut, _) = fit_sphere(Some(new_sample), Samples::new(samples))
                .filter(|(ut, _)| ut.iter().all(|component| component.is_finite()))?;
            self.linearisation = Linearisation::from_centre(centre_ut);
        }
        let candidates = || core::iter::once(new_sample).chain(samples);
        let mut squares = InformationMatrix::zero();
        let mut level_count = 0;
        for sample in candidates() {
            let [strength, inclination_row] = self.linearisation.jacobian_rows(sample);
            // Equal weights: either the sensor or the attitude may be the more accurate.
            squares.add_row_pair([&strength, &inclination_row], [1.0; 2]);
            level_count += usize::from(is_level(sample));
        }
        let mut information = squares.upper_triangle();
        for (i, row) in information.iter_mut().enumerate() {
            row[i] += PRIOR_INFORMATION;
        }
        self.information = LeastSquares::from_normal_equations(information, [[0.0]; _]);
        self.retains_level = level_count <= level_quota;
        let leverage_of = |sample: &Sample| {
            let is_retained = self.retains_level && is_level(sample);
            if is_retained { f32::INFINITY } else { self.leverages(sample).iter().sum() }
        };
        let new_leverage = self.linearisation.new_sample_leverage_factor * leverage_of(new_sample);
        let leverages = core::iter::once(new_leverage).chain(samples.iter().map(leverage_of)).enumerate();
        let (position, least_leverage) = leverages.min_by(|a, b| a.1.total_cmp(&b.1))?;
        self.smallest_leverage = least_leverage;
        Some(position)
    }
}

/// Whether a sample is finite and far enough from the last stored one.
fn is_due(buffer: &SampleBuffer, sample: &Sample, spacing: SampleSpacing) -> bool {
    let last_of_use = |sample_use| buffer.samples_of_use(sample_use).last();
    let lasts = [SampleUse::Fit, SampleUse::Verification].into_iter().filter_map(last_of_use);
    let last = lasts.min_by_key(|last| sample.time.ms_since(last.time));
    let RollPitch { roll_rad, pitch_rad } = sample.attitude;
    let is_measurement = sample.field.ut.iter().chain(&[roll_rad, pitch_rad]).all(|component| component.is_finite());
    is_measurement
        && last.is_none_or(|last| match spacing {
            SampleSpacing::Interval { ms } => sample.time.ms_since(last.time) >= ms,
            SampleSpacing::Distinct => is_distinct(last, sample),
        })
}

fn is_distinct(last_stored: &Sample, sample: &Sample) -> bool {
    let tilt_rad = trig::hypot(
        wrap_pi(sample.attitude.roll_rad - last_stored.attitude.roll_rad),
        sample.attitude.pitch_rad - last_stored.attitude.pitch_rad,
    );
    (sample.field.ut - last_stored.field.ut).vector_length() >= MIN_FIELD_CHANGE_UT
        || tilt_rad >= MIN_ATTITUDE_CHANGE_RAD
}

#[cfg(test)]
mod tests;
