//! STM32: fault-tolerant wrappers of the HAL's drivers, reset cause, start from a boot loader.

#[cfg(feature = "board-holybro-rm3100")]
pub mod boot_loader;
#[cfg(feature = "board-b-l475e-iot01a")]
pub mod bxcan;
pub mod can;
#[cfg(feature = "board-holybro-rm3100")]
pub mod fdcan;
pub mod flash;
#[cfg(feature = "board-b-l475e-iot01a")]
pub mod i2c;
pub mod platform;
pub mod reset;
pub mod uart;
pub mod watchdog;
