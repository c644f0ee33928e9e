//! A change of the sensor, and what both search and comparison leave out around it.

use std::fmt;

/// A change of the sensor in flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorChange {
    /// Flight time of the change, seconds.
    pub time_s: f64,
    /// What changed.
    pub kind: SensorChangeKind,
}

/// Changed property of a sensor. Axes are body axes: those of the sensor, if it is mounted at right angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorChangeKind {
    /// Gain of all axes: readings after the change relative to those before it.
    Gain {
        /// Ratio of the readings.
        factor: f64,
    },
    /// Sign of an axis, 0 to 2.
    AxisSign {
        /// Axis, 0 to 2.
        axis: usize,
    },
    /// Gain of an axis.
    AxisGain {
        /// Axis, 0 to 2.
        axis: usize,
        /// Ratio of the readings.
        factor: f64,
    },
    /// Gain per axis and offset, as by a reset of the registers.
    Registers,
}

impl fmt::Display for SensorChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = |axis: usize| ["x", "y", "z"][axis.min(2)];
        match self.kind {
            SensorChangeKind::Gain { factor } => write!(f, "the sensor's gain changed by a factor of {factor:.2}")?,
            SensorChangeKind::AxisSign { axis } => write!(f, "the sign of the sensor's {} axis changed", name(axis))?,
            SensorChangeKind::AxisGain { axis, factor } => {
                write!(f, "the gain of the sensor's {} axis changed by a factor of {factor:.2}", name(axis))?;
            }
            SensorChangeKind::Registers => {
                f.write_str("the sensor's gains and offset changed, as by a reset of its registers,")?;
            }
        }
        write!(f, " at {:.0} s: that is the sensor, not iron; no parameters fit both", self.time_s)
    }
}

/// Largest number of rows in a fit.
pub(super) const MAX_FITTED_ROWS: usize = 1200;
/// Least number of rows on a side.
pub(super) const MIN_ROWS_PER_SIDE: usize = 100;
/// Time on either side of a change that is not fitted, seconds: the rows are averages, and the time is uncertain.
pub(super) const SKIPPED_S: f64 = 0.5;
