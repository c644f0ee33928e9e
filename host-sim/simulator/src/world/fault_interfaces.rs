//! Interfaces by which a fault changes field or attitude; the faults are in [`crate::faults`].

use mavlink_dialect::ATTITUDE_DATA;
use nalgebra::Vector3;

use super::earth::Earth;
use super::state::TrueState;

/// Change of the field at the chip. Queries refer to any instant of the last two seconds, in any order.
pub trait FieldFault {
    /// Additional field in chip axes, microtesla, at a state of the flight.
    fn added_field_ut(&self, _truth: &TrueState) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Additional field in a steady turn at this bank, or in steady level flight: the reference for a calibration.
    fn steady_field_ut(&self, truth: &TrueState) -> Vector3<f64> {
        self.added_field_ut(truth)
    }

    /// Earth's field at another place, if the aircraft is not at the configured one.
    fn replacement_earth(&self, _at_us: u64) -> Option<Earth> {
        None
    }
}

impl<F: Fn(&TrueState) -> Vector3<f64>> FieldFault for F {
    fn added_field_ut(&self, truth: &TrueState) -> Vector3<f64> {
        self(truth)
    }
}

/// Fault of the attitude source.
pub trait AttitudeFault {
    /// Additional age of the attitude, microseconds.
    fn added_latency_us(&self, _now_us: u64) -> u64 {
        0
    }

    /// Whether the source sends nothing.
    fn is_silent(&self, _now_us: u64) -> bool {
        false
    }

    /// Modifies an attitude message before it is sent.
    fn modify_message(&mut self, now_us: u64, message: &mut ATTITUDE_DATA);
}

/// All faults of a source; they modify each message in order.
impl AttitudeFault for Vec<Box<dyn AttitudeFault>> {
    fn added_latency_us(&self, now_us: u64) -> u64 {
        self.iter().map(|fault| fault.added_latency_us(now_us)).sum()
    }

    fn is_silent(&self, now_us: u64) -> bool {
        self.iter().any(|fault| fault.is_silent(now_us))
    }

    fn modify_message(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        for fault in self {
            fault.modify_message(now_us, message);
        }
    }
}

impl<F: FnMut(u64, &mut ATTITUDE_DATA)> AttitudeFault for F {
    fn modify_message(&mut self, now_us: u64, message: &mut ATTITUDE_DATA) {
        self(now_us, message);
    }
}
