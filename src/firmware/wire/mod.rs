//! Encoding and decoding of the protocols on serial lines and on the CAN bus.

pub mod dronecan;
pub mod mavlink;
pub mod msp;
pub mod nmea;
