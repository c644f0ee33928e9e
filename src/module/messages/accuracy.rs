//! Expected accuracy of a calibration, as text.

use core::fmt::{self, Display};

use autoswing::calibration::{AttitudeEnvelope, Calibration, Quality};
use autoswing::decimal::Decimal;
use autoswing::trig;

/// Expected accuracy of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExpectedAccuracy {
    /// Quality of the calibration.
    pub quality: Quality,
    /// Heading error per degree of attitude error in level flight, at the worst heading (dimensionless). `None` if the
    /// inclination is unknown, as after tumbling.
    pub heading_deg_per_attitude_deg: Option<f32>,
}

impl ExpectedAccuracy {
    /// The accuracy of a calibration of that quality.
    ///
    /// A tilt about magnetic north rotates the vertical field into the horizontal one: `d psi = tan(inclination) d
    /// phi`, from Liu 2007 eq. 3.
    #[must_use]
    pub fn new(quality: Quality, calibration: &Calibration) -> Self {
        let (sin, cos) = trig::sin_cos(calibration.inclination_rad);
        let attitude_cost = quality.knows_inclination.then_some((sin / cos).abs());
        Self { quality, heading_deg_per_attitude_deg: attitude_cost }
    }
}

impl Display for ExpectedAccuracy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        ExpectedErrorText(&self.quality).fmt(f)?;
        match self.heading_deg_per_attitude_deg {
            Some(cost) => write!(f, "; a degree of attitude error costs {} deg", Decimal::<2>(cost)),
            None => Ok(()),
        }
    }
}

/// Expected heading error as text, degrees.
#[derive(Clone, Copy, Debug)]
pub struct ExpectedErrorText<'a>(pub &'a Quality);

impl Display for ExpectedErrorText<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (rms, worst) = (Decimal::<2>(self.0.expected_rms_deg), Decimal::<2>(self.0.expected_worst_deg));
        let envelope = match self.0.envelope {
            AttitudeEnvelope::Banked => "",
            AttitudeEnvelope::Level => ", level only",
        };
        write!(f, "expected error {rms} deg rms, sigma {worst} deg at the worst heading{envelope}")
    }
}
