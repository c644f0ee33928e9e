//! Smoothed heading: a two-state Kalman filter over raw heading and gyro.
//!
//! The error of a raw heading is correlated over seconds; the gyro has little short-term error but drifts. States are
//! heading `psi` and gyro bias `beta`. The turn is corrected by the monitor's estimate `e` of the gyro's errors, with
//! covariance `P` and the row `r` of the heading rate:
//!
//! ```text
//! psi  += turned - r e dt - beta dt        Q_psi = 0.2^2 deg^2/s dt + r P r^T T dt, T = 10 s
//! beta += 0                       Q_beta = 0.002^2 (deg/s)^2/s dt
//! z     = raw - psi               R = v 2 tau / dt, v = variance of the raw heading without coefficient errors
//! ```
//!
//! Noise of correlation time `tau` sampled every `dt` counts like white noise of `2 tau / dt` times its variance.
//! Outliers get a larger variance.
//!
//! The filter's own variance is not a usable accuracy: three times too large in simulation with an ideal gyro, half of
//! the actual error on recorded flights. Therefore the fraction of raw noise that remains is estimated from the
//! residuals. The coefficients' variance is added unchanged, because it is common to all readings. The gyro's errors
//! are consider states (Schmidt 1966): the derivatives `s` of the smoothed heading by them, `s <- (1 - K) (s + r dt)`,
//! add `s P s^T` to its variance.
//!
//! The smoothed heading is output only while it agrees with the raw one: a wrong gyro shows in the first turn.

mod agreement;
mod residual_noise;

use super::gyro_error::{GYRO_ERROR_COUNT, GyroErrors, HeadingRateError};
use crate::attitude::GyroHeading;
use crate::frames::{wrap_pi, wrap_two_pi};
use crate::heading::Heading;
use crate::time::Timestamp;
use crate::trig::{DEG, sqrt, square};
use agreement::{AgreementResult, AgreementTest, GyroStep};
use residual_noise::ResidualNoise;

/// Correlation time of the raw heading's error, seconds: that of an attitude source's filter.
const NOISE_CORRELATION_S: f32 = 2.0;

/// Longest gap bridged by the gyro, microseconds.
const MAX_GAP_US: u64 = 3_000_000;

/// Turn rate above which the filter stops, rad/s.
const MAX_TURN_RATE_RAD_S: f32 = core::f32::consts::TAU;

/// Heading process noise, rad^2/s: a random walk of 0.2 deg in a second. A gyro has a tenth of it; the rest covers
/// attitudes not synchronous with the body rates.
const HEADING_PROCESS_NOISE: f32 = square(0.2 * DEG);

/// Gyro-bias process noise, (rad/s)^2/s: a random walk of 0.002 deg/s in a second.
const GYRO_BIAS_PROCESS_NOISE: f32 = square(0.002 * DEG);

/// Initial variance of the gyro bias, (rad/s)^2: autopilots remove most of it.
const INITIAL_GYRO_BIAS_VARIANCE: f32 = square(0.1 * DEG);

/// Time for which an error of the gyro's rate keeps its sign, seconds: that of a turn.
const GYRO_NOISE_CORRELATION_S: f32 = 10.0;

/// Period in which the variance by the gyro's errors is computed, microseconds: that of the monitor's samples.
const GYRO_VARIANCE_PERIOD_US: u64 = 100_000;

/// Fraction of the raw variance that remains in `variance_from_noise` at the usual gain.
const NOMINAL_NOISE_FRACTION: f32 = 0.24;

/// Lower limit of a raw heading's variance, rad^2: a sigma of 0.05 deg.
const MIN_RAW_VARIANCE_RAD2: f32 = square(0.05 * DEG);
/// Upper limit of a raw heading's variance, rad^2: a sigma of 180 deg.
const MAX_RAW_VARIANCE_RAD2: f32 = square(180.0 * DEG);

/// Normalised innovation beyond which a measurement counts less.
const OUTLIER_SIGMAS: f32 = 3.0;

/// Heading smoother: filter, agreement test and residual noise. 120 bytes.
#[derive(Clone, Debug)]
pub(super) struct HeadingSmoother {
    filter_state: Option<SmootherState>,
    agreement_test: AgreementTest,
    residual_noise: ResidualNoise,
}

impl HeadingSmoother {
    pub const fn new() -> Self {
        Self { filter_state: None, agreement_test: AgreementTest::INITIAL, residual_noise: ResidualNoise::INITIAL }
    }

    pub fn reset_filter(&mut self) {
        *self = Self::new();
    }

    /// Processes a raw heading and the gyro's turn; returns the smoothed heading if trusted.
    #[inline(never)]
    pub fn smooth_heading(
        &mut self,
        at: Timestamp,
        raw_heading: Option<&Heading>,
        gyro_heading: Option<&GyroHeading>,
        rate_error: &HeadingRateError,
    ) -> Option<Heading> {
        let gyro_heading = gyro_heading?;
        if gyro_heading.euler_rates.heading_rad_s.abs() > MAX_TURN_RATE_RAD_S {
            self.filter_state = None;
        }
        let raw = raw_heading?;
        #[expect(clippy::manual_clamp, reason = "what is not a number becomes one here, and would not in a clamp")]
        let variance = (square(raw.sigma_rad) - raw.systematic_variance_rad2)
            .max(MIN_RAW_VARIANCE_RAD2)
            .min(MAX_RAW_VARIANCE_RAD2);
        let agreed = self.update_filter((at, raw.magnetic_rad, variance), gyro_heading, rate_error);
        if agreed == AgreementResult::Lost {
            self.agreement_test.restart_test();
            self.residual_noise.restart_mean();
            self.filter_state = Some(SmootherState::new_at(at, raw.magnetic_rad, variance, gyro_heading));
        }
        let state = self.filter_state.as_ref().filter(|_| agreed == AgreementResult::InAgreement)?;
        let noise = self.residual_noise.remaining_fraction() / NOMINAL_NOISE_FRACTION * state.variance_from_noise;
        // The remaining noise is estimated from innovations, which contain the gyro's errors as well.
        let noise = noise.max(state.variance_from_gyro) + self.agreement_test.excess_variance_rad2();
        Some(Heading {
            magnetic_rad: wrap_two_pi(state.heading_rad),
            sigma_rad: sqrt(noise + raw.systematic_variance_rad2),
            systematic_variance_rad2: raw.systematic_variance_rad2,
        })
    }

    /// Variance of the raw heading by its disagreement with the gyro, rad^2: whichever of the two is wrong.
    pub const fn disagreement_variance_rad2(&self) -> f32 {
        self.agreement_test.excess_variance_rad2()
    }

    /// Time and measurement update; requests a restart if the filter is lost.
    fn update_filter(
        &mut self,
        (at, raw_rad, variance): (Timestamp, f32, f32),
        gyro_heading: &GyroHeading,
        rate_error: &HeadingRateError,
    ) -> AgreementResult {
        let Some(state) = &mut self.filter_state else { return AgreementResult::Lost };
        let Some(step) = state.predict_state(at, gyro_heading, rate_error) else { return AgreementResult::Lost };
        let innovation_rad = wrap_pi(raw_rad - state.heading_rad);
        if !innovation_rad.is_finite() {
            return AgreementResult::Lost; // A NaN must not enter the state.
        }
        let innovation_variance = state.heading_variance() + variance;
        self.residual_noise.update_noise(innovation_rad, innovation_variance, step.step_s);
        let result = self.agreement_test.test_innovation(innovation_rad, innovation_variance, step);
        state.update_measurement(innovation_rad, variance, step.step_s);
        result
    }
}

/// Heading and gyro bias with covariance `[c + u u b, u b; u b, b]`, stored as factors: bias variance `b`, regression
/// `u` of heading on bias, conditional heading variance `c`. Positive semi-definite for any rounding, since `b` and `c`
/// are sums and products of non-negative terms.
#[derive(Clone, Debug)]
struct SmootherState {
    updated_at: Timestamp,
    last_gyro_heading_rad: f32,
    gyro_run_number: u8,
    heading_rad: f32,
    bias_rad_s: f32,
    bias_variance: f32,
    bias_regression_s: f32,
    conditional_heading_variance: f32,
    /// Derivatives of the smoothed heading by the gyro's errors.
    gyro_sensitivity: GyroErrors,
    /// Variance of the smoothed heading by the gyro's errors, rad^2, and the time of its computation.
    variance_from_gyro: f32,
    variance_from_gyro_at: Timestamp,
    /// Variance of the smoothed heading by noise of the raw ones of the assumed correlation time, rad^2.
    variance_from_noise: f32,
}

impl SmootherState {
    fn new_at(at: Timestamp, heading_rad: f32, variance: f32, gyro_heading: &GyroHeading) -> Self {
        Self {
            updated_at: at,
            last_gyro_heading_rad: gyro_heading.relative_heading_rad,
            gyro_run_number: gyro_heading.run_number,
            heading_rad: wrap_pi(heading_rad),
            bias_rad_s: 0.0,
            bias_variance: INITIAL_GYRO_BIAS_VARIANCE,
            bias_regression_s: 0.0,
            conditional_heading_variance: variance,
            gyro_sensitivity: [0.0; GYRO_ERROR_COUNT],
            variance_from_gyro: 0.0,
            variance_from_gyro_at: at,
            variance_from_noise: NOMINAL_NOISE_FRACTION * variance,
        }
    }

    fn heading_variance(&self) -> f32 {
        self.conditional_heading_variance + square(self.bias_regression_s) * self.bias_variance
    }

    /// Time update. `None` after a gap or a restart of the gyro's integration.
    fn predict_state(
        &mut self,
        at: Timestamp,
        gyro_heading: &GyroHeading,
        rate_error: &HeadingRateError,
    ) -> Option<GyroStep> {
        let step_us = at.us_since(self.updated_at);
        if gyro_heading.run_number != self.gyro_run_number || step_us > MAX_GAP_US {
            return None;
        }
        let step_s = step_us as f32 * 1e-6;
        let turned_rad = wrap_pi(
            gyro_heading.relative_heading_rad - self.last_gyro_heading_rad - rate_error.rate_error_rad_s * step_s,
        );
        (self.updated_at, self.last_gyro_heading_rad) = (at, gyro_heading.relative_heading_rad);
        self.heading_rad = wrap_pi(self.heading_rad + turned_rad - self.bias_rad_s * step_s);
        self.bias_regression_s -= step_s;
        for (sensitivity, d) in self.gyro_sensitivity.iter_mut().zip(rate_error.derivative_row) {
            *sensitivity += d * step_s;
        }
        if at.us_since(self.variance_from_gyro_at) >= GYRO_VARIANCE_PERIOD_US {
            (self.variance_from_gyro, self.variance_from_gyro_at) =
                (rate_error.gyro_errors.projected_variance(&self.gyro_sensitivity), at);
        }
        self.conditional_heading_variance +=
            (HEADING_PROCESS_NOISE + GYRO_NOISE_CORRELATION_S * rate_error.variance) * step_s;
        // Bias process noise weakens the regression of heading on bias.
        let added_variance = GYRO_BIAS_PROCESS_NOISE * step_s;
        let bias_variance = self.bias_variance + added_variance;
        self.conditional_heading_variance +=
            square(self.bias_regression_s) * self.bias_variance * added_variance / bias_variance;
        self.bias_regression_s *= self.bias_variance / bias_variance;
        self.bias_variance = bias_variance;
        Some(GyroStep { step_s, turned_rad })
    }

    /// Measurement update with an innovation `innovation_rad`, `step_s` after the last one.
    fn update_measurement(&mut self, innovation_rad: f32, variance: f32, step_s: f32) {
        if step_s <= 0.0 {
            return; // A repeated time adds no information.
        }
        let innovation_variance = self.heading_variance() + variance;
        let outlier_factor = (square(innovation_rad) / (square(OUTLIER_SIGMAS) * innovation_variance)).max(1.0);
        let noise = outlier_factor * variance * (2.0 * NOISE_CORRELATION_S / step_s);
        let conditional_variance = self.conditional_heading_variance;
        let heading_by_bias = self.bias_regression_s * self.bias_variance;
        let sum = conditional_variance + self.bias_regression_s * heading_by_bias + noise;
        let gain = (conditional_variance + self.bias_regression_s * heading_by_bias) / sum;
        self.heading_rad = wrap_pi(self.heading_rad + innovation_rad * gain);
        self.variance_from_noise = square(1.0 - gain) * self.variance_from_noise + square(gain) * noise;
        for sensitivity in &mut self.gyro_sensitivity {
            *sensitivity *= 1.0 - gain;
        }
        self.bias_rad_s += innovation_rad * heading_by_bias / sum;
        // UD measurement update for two states (Bierman 1977).
        let remaining_share = noise / (conditional_variance + noise);
        self.bias_variance *= (conditional_variance + noise) / sum;
        self.bias_regression_s *= remaining_share;
        self.conditional_heading_variance *= remaining_share;
    }
}

#[cfg(test)]
mod tests;
