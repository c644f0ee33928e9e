//! The calibration of `examples/headings` as a `no_std` library; .ci/run type-checks it for a Cortex-M4.
#![no_std]

#[path = "headings/calibrate.rs"]
pub mod calibrate;
