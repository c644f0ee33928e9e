//! Expected quality of a calibration.

use super::method::Method;
use super::samples::{Sample, Samples};
use crate::frames::RollPitch;

/// Expected quality of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Quality {
    /// Method of the solution.
    pub method: Method,
    /// Attitudes for which the error is expected.
    pub envelope: AttitudeEnvelope,
    /// Expected heading error (1 sigma), RMS over the envelope, degrees.
    pub expected_rms_deg: f32,
    /// Expected heading error (1 sigma) at the worst heading and bank of the envelope, degrees.
    pub expected_worst_deg: f32,
    /// Robust scale of the norm residual `|h| / F - 1`, dimensionless.
    pub norm_residual: f32,
    /// Robust scale of the inclination residual, degrees.
    pub inclination_residual_deg: f32,
    /// Number of samples in the fit.
    pub samples: u16,
    /// Estimated attitude latency; `None` if unobservable.
    pub latency: Option<AttitudeLatency>,
    /// Whether the inclination is known: determined by the samples, or configured. The ellipsoid method determines
    /// none.
    pub knows_inclination: bool,
}

/// Estimated attitude latency beyond the nominal latency of the attitude source. Negative: the attitude is newer than
/// assumed, or the field older.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AttitudeLatency {
    /// Maximum-likelihood estimate of the latency, seconds.
    pub estimate_s: f32,
    /// Standard deviation of the latency, seconds.
    pub sigma_s: f32,
}

impl Quality {
    /// Whether all twelve coefficients, mounting included, were determined.
    #[must_use]
    pub fn determines_all_coefficients(&self) -> bool {
        self.envelope == AttitudeEnvelope::Banked && self.method != Method::Ellipsoid
    }
}

/// Attitudes of the expected error: twelve headings at each bank.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum AttitudeEnvelope {
    /// Bank -30, 0 and 30 deg.
    Banked,
    /// Zero bank.
    Level,
}

impl AttitudeEnvelope {
    /// Bank above which a sample belongs to a turn, radians. A calibration without such samples is for level headings
    /// only. Samples of arbitrary attitude are also tested in pitch, because a vehicle that pitches to accelerate also
    /// banks.
    pub const MIN_BANK_RAD: f32 = 10_f32.to_radians();

    pub(in crate::calibration) fn for_samples(method: Method, samples: Samples<'_>) -> Self {
        let has_free_flight_samples = samples.has_free_flight_samples();
        let is_level = |&Sample { attitude: RollPitch { roll_rad, pitch_rad }, .. }: &Sample| {
            roll_rad.abs() < Self::MIN_BANK_RAD && (!has_free_flight_samples || pitch_rad.abs() < Self::MIN_BANK_RAD)
        };
        match method {
            Method::Level => Self::Level,
            // Samples of the ellipsoid method have no attitude to test.
            Method::Ellipsoid => Self::Banked,
            _ if samples.all_samples().all(is_level) => Self::Level,
            _ => Self::Banked,
        }
    }

    pub(in crate::calibration) const fn banks_deg(self) -> &'static [f32] {
        match self {
            Self::Banked => &[-30.0, 0.0, 30.0],
            Self::Level => &[0.0],
        }
    }
}
