//! STM32L4: wrappers that make the HAL's drivers survive what happens on real wires, and what is left after a crash.

pub mod flash;
pub mod i2c;
pub mod last_words;
pub mod uart;
