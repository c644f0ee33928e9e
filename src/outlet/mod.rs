//! Outlets: what turns an estimate into bytes for somebody.
//!
//! An outlet is a pure value. One task for all of them (`app::outlet`) waits for estimates, asks the [`Pace`] whether a
//! message is due, and writes what the outlet made.

mod nmea;
mod pace;

pub use nmea::NmeaOutlet;
pub use pace::Pace;

use crate::instrument::Estimate;
use crate::settings::Settings;

/// The bytes of one message: four NMEA sentences of at most 50 characters are the longest.
pub type Message = heapless::Vec<u8, 256>;

/// Something that turns estimates into bytes.
pub trait Outlet {
    /// How many messages a second are wanted with these settings; none: none.
    fn rate_hz(&self, settings: &Settings) -> Option<u8>;

    /// Appends the message that tells an estimate. What does not fit is left away whole.
    fn tell(&mut self, estimate: &Estimate, settings: &Settings, message: &mut Message);
}
