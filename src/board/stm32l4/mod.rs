//! STM32L4: fault-tolerant wrappers of the HAL's drivers, and the reset cause.

pub mod flash;
pub mod i2c;
pub mod reset;
pub mod uart;
