//! Bytes to meaning and back: what crosses a cable.

pub mod decimal;
#[cfg(feature = "mavlink")]
pub mod mavlink;
#[cfg(feature = "msp")]
pub mod msp;
#[cfg(feature = "nmea")]
pub mod nmea;
