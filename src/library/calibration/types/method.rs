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
    /// All methods.
    pub const ALL_METHODS: [Self; 6] =
        [Self::Level, Self::FourEllipse, Self::TwoPlane, Self::MaximumLikelihood, Self::CompassSwing, Self::Ellipsoid];

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

    /// Parses a method name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL_METHODS.into_iter().find(|method| method.method_name() == name)
    }

    /// Whether an iterative refinement follows the closed form.
    pub(in crate::calibration) const fn is_refined(self) -> bool {
        matches!(self, Self::MaximumLikelihood | Self::CompassSwing | Self::Ellipsoid)
    }
}
