//! ARM firmware in QEMU's `mps2-an386` (Cortex-M4F with QEMU's magnetometer), coupled to the simulated world.
//!
//! Machine and world run in lockstep: the machine stops every 2 ms, before every sensor access and after every write to
//! the instrument port, sends its time, and continues when the world has reached that time. Host time has no influence.

mod elf_header;
mod emulated_machine;
mod emulated_module;
mod error;
pub(crate) mod instruction_budget;
mod qmp;

use std::path::PathBuf;

pub use self::emulated_machine::BenchTest;
pub use self::emulated_module::Emulator;
pub use self::error::EmulatorError;

/// Path of the image that `scripts/build-firmware` builds, from the repository's root.
#[must_use]
pub fn default_image() -> PathBuf {
    PathBuf::from("target/firmware/mps2-an386.elf")
}

/// Path of the bench image that `scripts/build-firmware` builds, for budget and crash tests.
#[must_use]
pub fn default_bench_image() -> PathBuf {
    default_image().with_file_name("mps2-an386-bench.elf")
}
