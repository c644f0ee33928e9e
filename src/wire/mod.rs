//! Bytes to meaning and back: what crosses a cable.

pub mod decimal;
pub mod mavlink;
pub mod msp;
pub mod nmea;
