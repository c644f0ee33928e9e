//! Encoding and decoding of the protocols on serial lines.

pub mod mavlink;
pub mod msp;
pub mod nmea;
