//! Calibration methods.

/// Calibration method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Method {
    /// One ellipse, fitted to level flight.
    Level,
    /// The method of Liu 2007 from a left and a right turn.
    FourEllipse,
    /// Closed form from the planes of a left and a right turn.
    TwoPlane,
    /// Maximum likelihood with per-sample attitude.
    MaximumLikelihood,
    /// Regression on given headings.
    CompassSwing,
    /// Tumbling without attitude.
    Ellipsoid,
}

impl Method {
    /// Name shown to users, in JSON and in `cal solve`.
    #[must_use]
    pub const fn method_name(self) -> &'static str {
        match self {
            Self::Level => "level",
            Self::FourEllipse => "four-ellipse",
            Self::TwoPlane => "two-plane",
            Self::MaximumLikelihood => "maximum-likelihood",
            Self::CompassSwing => "compass-swing",
            Self::Ellipsoid => "ellipsoid",
        }
    }

    /// Whether an iterative refinement follows the closed form.
    pub(in crate::calibration) const fn is_refined(self) -> bool {
        matches!(self, Self::MaximumLikelihood | Self::CompassSwing | Self::Ellipsoid)
    }
}
