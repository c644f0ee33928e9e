//! What the library's own tests and the simulator share, without the simulator: a virtual clock, an executor on it, and
//! random numbers for tests.
//!
//! | module | holds |
//! |---|---|
//! | [`clock`] | the virtual clock behind `embassy_time` |
//! | [`simulation`] | the executor: tasks, priorities, power off |
//! | [`random`] | the random numbers of all tests |
//! | [`flash`] | a NOR flash with power cuts and faults |
//!
//! It is a package of its own so that the library can be tested without building the simulator, which depends on the
//! library.

pub mod clock;
pub mod flash;
pub mod random;
pub mod simulation;

// The implementation of critical sections that `embassy-sync` links to.
use critical_section as _;
