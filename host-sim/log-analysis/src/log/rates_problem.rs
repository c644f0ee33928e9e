//! Reasons why body rates are not used as logged.

use std::fmt;

/// Reason why body rates are not used as logged; displayed as a clause.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RatesProblem {
    /// The log has no body rates.
    NotLogged,
    /// The body rate about this axis (0 to 2) has the opposite sign of the attitude's change.
    WrongSign(usize),
    /// Wrong unit: ratio of the attitude's change to the integrated body rates.
    WrongUnit(f64),
    /// Random walk of the heading integrated from the body rates, deg/s^0.5.
    Inexact(f64),
}

/// Largest relative deviation of a rate ratio from that of degrees to radians: noise of rates and attitude.
const MAX_RATIO_ERROR: f64 = 0.5;

impl RatesProblem {
    /// Factors by axis that correct the body rates; `None` if they must be replaced.
    pub(super) fn repair_factors(self) -> Option<[f32; 3]> {
        match self {
            Self::WrongSign(wrong) => Some(std::array::from_fn(|axis| if axis == wrong { -1.0 } else { 1.0 })),
            Self::WrongUnit(ratio) => [1_f64.to_degrees(), 1_f64.to_radians()]
                .into_iter()
                .find(|factor| (ratio / factor - 1.0).abs() < MAX_RATIO_ERROR)
                .map(|factor| [factor as f32; 3]),
            Self::NotLogged | Self::Inexact(_) => None,
        }
    }
}

impl fmt::Display for RatesProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotLogged => f.write_str("no body rates are logged"),
            Self::WrongSign(axis) => {
                let axis = ["x", "y", "z"][*axis];
                write!(f, "the body rate about {axis} has the sign opposite to the attitude's change")
            }
            Self::WrongUnit(ratio) => write!(
                f,
                "the attitude changes {ratio:.3} times as fast as the body rates, which are in another unit (degrees or \
                 radians)"
            ),
            Self::Inexact(walk_deg) => write!(
                f,
                "the body rates are sampled too coarsely (integrated, the heading drifts by {walk_deg:.1} deg in a second)"
            ),
        }
    }
}
