//! Reasons why logged body rates are not used.

use std::fmt;

/// Reason for differences of the attitude in place of logged body rates; displayed as a clause.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RatesProblem {
    /// None are logged.
    NotLogged,
    /// The rate about an axis runs against the attitude.
    WrongSign(char),
    /// The attitude's change is this many times the rates.
    WrongUnit(f64),
    /// Random walk of the heading integrated from them, deg/s^0.5.
    Inexact(f64),
}

impl fmt::Display for RatesProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotLogged => f.write_str("no body rates are logged"),
            Self::WrongSign(axis) => {
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
