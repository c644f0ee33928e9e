//! Faults: decorators at the seams between the world and the module. The devices and the world know nothing of them.
//!
//! | seam | file | decorated |
//! |---|---|---|
//! | magnetometer | `sensor.rs` | the chip on the I2C bus: what its registers read, and what befalls them |
//! | attitude source | `attitude.rs` | the messages on their way to the wire, and others that talk on it |
//! | iron of the airframe, place | `field.rs` | the field that reaches the chip |
//!
//! Each acts while its [`Switch`] is on, and is a function of its seed and of virtual time.

pub mod attitude;
pub mod field;
pub mod sensor;

use std::cell::Cell;
use std::rc::Rc;

/// When a fault acts. A handle, cloned freely: whoever flies turns it on and off, the fault looks at it.
#[derive(Clone, Debug)]
pub struct Switch(Rc<Cell<(u64, u64)>>);

impl Switch {
    /// Off for good, until somebody turns it on.
    #[must_use]
    pub fn off() -> Self {
        Self(Rc::new(Cell::new((u64::MAX, u64::MAX))))
    }

    /// On from the beginning.
    #[must_use]
    pub fn on() -> Self {
        Self(Rc::new(Cell::new((0, u64::MAX))))
    }

    /// On from an instant until another, microseconds of virtual time.
    pub fn act(&self, from_us: u64, until_us: u64) {
        self.0.set((from_us, until_us));
    }

    /// Whether the fault acts at an instant.
    #[must_use]
    pub fn is_on(&self, at_us: u64) -> bool {
        let (from_us, until_us) = self.0.get();
        (from_us..until_us).contains(&at_us)
    }

    /// Seconds since it was turned on; none while it is off.
    #[must_use]
    pub fn on_for_s(&self, at_us: u64) -> Option<f64> {
        self.is_on(at_us).then(|| (at_us - self.0.get().0) as f64 / 1e6)
    }

    /// How far it is through its time, 0..1; 1 from its end on, 0 before its beginning.
    #[must_use]
    pub fn progress(&self, at_us: u64) -> f64 {
        let (from_us, until_us) = self.0.get();
        (at_us.saturating_sub(from_us) as f64 / until_us.saturating_sub(from_us).max(1) as f64).min(1.0)
    }
}

/// What is wrong around one module. The default is nothing.
#[derive(Default)]
pub struct Faults {
    /// Of the magnetometer.
    pub sensor: Vec<Box<dyn sensor::SensorFault>>,
    /// Of the attitude source.
    pub attitude: Vec<Box<dyn attitude::AttitudeFault>>,
    /// Others that send attitude on the same line.
    pub senders: Vec<attitude::Foreign>,
    /// Of the field that reaches the chip; shared with whoever has to know the truth.
    pub field: Vec<Rc<dyn field::FieldFault>>,
}

#[cfg(test)]
mod tests;
