//! A change of the sensor in flight, and its words.

use std::fmt;

use nalgebra::Vector3;

use crate::replay::change_fit::Hypothesis;

/// Largest deviation of a factor from -1 for a change of sign.
const MAX_SIGN_DEVIATION: f64 = 0.15;

/// A change of the sensor in flight. Axes are body axes: those of the sensor, if it is mounted at right angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorChange {
    /// Flight time of the change, seconds.
    pub time_s: f64,
    /// What changed.
    pub(super) hypothesis: Hypothesis,
    /// Readings after the change relative to those before it, by axis.
    pub(super) factors: Vector3<f64>,
}

impl fmt::Display for SensorChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |axis: usize| ["x", "y", "z"][axis.min(2)];
        match self.hypothesis {
            Hypothesis::AxisGain(axis) if (self.factors[axis] + 1.0).abs() < MAX_SIGN_DEVIATION => {
                write!(f, "the sign of the sensor's {} axis changed", name(axis))?;
            }
            Hypothesis::AxisGain(axis) => {
                let factor = self.factors[axis];
                write!(f, "the gain of the sensor's {} axis changed by a factor of {factor:.2}", name(axis))?;
            }
            Hypothesis::Registers => {
                f.write_str("the sensor's gains and offset changed, as by a reset of its registers,")?;
            }
            _ => write!(f, "the sensor's gain changed by a factor of {:.2}", self.factors.x)?,
        }
        write!(f, " at {:.0} s: that is the sensor, not iron; no parameters fit both", self.time_s)
    }
}
