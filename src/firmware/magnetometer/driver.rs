//! Interface of the drivers.

use crate::chip::MeasuringChip;
use autoswing::reading::{Identity, Reading};

/// Three-axis magnetometer.
pub trait Magnetometer: MeasuringChip<Identity = Identity, Measurement = Reading> {
    /// Number of equal consecutive readings of an axis that indicates a stuck axis: more than noise produces in a day
    /// at rest.
    fn equal_readings_until_stuck(&self) -> u16;
}
