//! Encoding and decoding of the protocols on serial lines and on the CAN bus.

pub mod dronecan;
mod frame_buffer;
pub mod mavlink;
pub mod msp;
pub mod nmea;
