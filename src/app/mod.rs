//! The asynchronous tasks: everything that waits. They are generic over the embedded-hal traits and run unchanged on
//! a board's executors and on the host's virtual clock.
//!
//! ```text
//! interrupt executor                                     thread executor
//! sensor ---readings---> stream ---samples------------>  compass ---notices---> console
//! attitude ---track------^   ^---active calibration---   compass <--requests--- console
//! watchdog <--heartbeats of the three, and <------------ pulse
//! ```
//!
//! What makes a heading runs above everything that may take long (a solve, an erase, a person), so none of that delays
//! a sentence. All wires between tasks are in one [`Links`]; there are no globals.

pub mod attitude;
pub mod compass;
pub mod console;
mod links;
pub mod sensor;
pub mod stream;
pub mod watchdog;

pub use links::{Counts, Links};

/// What a board can do for the tasks beyond its wires.
pub trait Platform {
    /// Restarts the module. On a board this does not return; on the host the simulator takes the tasks down at their
    /// next wait.
    fn reboot(&mut self);

    /// How much of the stack was ever in use, where that can be told.
    fn stack(&self) -> Option<StackUse> {
        None
    }
}

/// The deepest the stack has been since the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StackUse {
    /// Bytes used.
    pub used: usize,
    /// Bytes there are.
    pub size: usize,
}

/// A hardware watchdog: resets the module when [`feed`](Self::feed) stays away for longer than its period.
pub trait Watchdog {
    /// Starts the period anew.
    fn feed(&mut self);
}

/// Why the module started, as far as the hardware remembers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// Power was switched on.
    PowerOn,
    /// The reset pin, or a debugger.
    Pin,
    /// The console's `reboot`.
    Software,
    /// A task hung and the watchdog struck.
    Watchdog,
    /// The firmware panicked or faulted; what it left as its last words.
    Panic(heapless::String<96>),
}
