//! Consider states: errors that are not estimated, with their variance included in the covariance.

use crate::calibration::hypotheses::bank_scale::BankScaleEstimate;
use crate::trig::sqrt;

/// Constant errors of the attitude source, 1 sigma: consider states. Turns do not reveal them, because a bias acts like
/// a mounting error and a bank-angle scale error like soft iron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConsiderSigmas {
    /// Constant roll and pitch bias, radians; 0.2 deg for a carefully levelled autopilot.
    pub bias_rad: f32,
    /// Bank-angle scale error in turns, dimensionless; 1 % for an attitude filter that uses airspeed.
    pub bank_scale: f32,
}

impl ConsiderSigmas {
    /// Values for a good autopilot.
    pub const DEFAULT: Self = Self { bias_rad: 0.0035, bank_scale: 0.01 };

    /// Error-free attitude source.
    pub const ZERO: Self = Self { bias_rad: 0.0, bank_scale: 0.0 };

    /// Sigmas of roll bias, pitch bias, bank-angle scale error and attitude latency.
    pub(super) const fn sigmas(self, latency_s: f32) -> [f32; 4] {
        [self.bias_rad, self.bias_rad, self.bank_scale, latency_s]
    }

    /// Adds, in quadrature, the estimated bank-angle scale error beyond the assumed one.
    pub(in crate::calibration) fn with_bank_scale(self, bank: &BankScaleEstimate) -> Self {
        let square = self.bank_scale * self.bank_scale + bank.excess_square(self.bank_scale);
        Self { bank_scale: sqrt(square), ..self }
    }
}
