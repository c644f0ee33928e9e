//! STM32L4: wrappers that make the HAL's drivers survive what happens on real wires, and why the chip was reset.

pub mod flash;
pub mod i2c;
pub mod reset;
pub mod uart;
