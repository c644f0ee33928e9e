//! Texts of the advice on a calibration: what to fly, and what kind of error remains.

use core::fmt;

use crate::calibration::{Deviation, Manoeuvre};

impl fmt::Display for Manoeuvre {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Circle(side, bank_deg) => write!(f, "a {} circle at {bank_deg} deg of bank", side.side_name()),
            Self::Level => f.write_str("a level circle, or straight legs at eight headings"),
            Self::YawTurn => f.write_str("turn once round, level"),
            Self::Tilt(towards, quarter) => {
                write!(f, "tilt {} while ", towards.direction_name())?;
                match quarter {
                    Some(quarter) => write!(f, "heading {}", quarter.quadrant_name()),
                    None => f.write_str("turning all round"),
                }
            }
        }
    }
}

impl fmt::Display for Deviation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Constant => "the same error at all headings",
            Self::Semicircular => "an error with one period per circle, opposite on opposite headings",
            Self::Quadrantal => "an error with two periods per circle, equal on opposite headings",
            Self::Heeling => "an error in turns that level flight does not have",
        })
    }
}
