//! Consider states: errors that are not estimated, with their variance included in the covariance.

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
    /// Standard deviations of the attitude errors of a good autopilot.
    pub const DEFAULT: Self = Self { bias_rad: 0.0035, bank_scale: 0.01 };

    /// Error-free attitude source.
    pub const ZERO: Self = Self { bias_rad: 0.0, bank_scale: 0.0 };
}
