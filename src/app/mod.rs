//! The asynchronous tasks: everything that waits. They are generic over the embedded-hal traits and run unchanged on
//! a board's executors and on the host's virtual clock.
//!
//! ```text
//! interrupt executor                                                    thread executor
//! sensor ----readings---> instrument ---samples------------------------> compass ---notices---> console
//! port   ----reports----> instrument <--correction---------------------- compass <--requests--- console
//!        <---estimates--- instrument
//!        ----armed, orders---------------------------------------------> compass
//!        <---settings, answers------------------------------------------ compass
//!        <---texts-------------------------------------------------------------------------- console
//! panel  <---glance, estimates------------------------------------------ compass
//!        ----pressed---------------------------------------------------> compass
//! watchdog <-signs of life of those, and <------------------------------ pulse
//! ```
//!
//! What makes a heading runs above everything that may take long (a solve, an erase, a person), so none of that delays
//! a sentence. All wires between tasks are in one [`Links`]; there are no globals.

pub mod compass;
pub mod console;
pub mod instrument;
mod links;
pub mod panel;
pub mod port;
pub mod sensor;
#[cfg(test)]
mod tests;
pub mod watchdog;

pub use links::Links;
pub use panel::Panel;
pub use port::SetBaud;

use crate::health::StackUse;

/// What a board can do for the tasks beyond its wires.
pub trait Platform {
    /// Restarts the module. On a board this does not return; on the host the simulator takes the tasks down at their
    /// next wait.
    fn reboot(&mut self);

    /// How much of the stack was ever in use, where that is known.
    fn stack(&self) -> Option<StackUse> {
        None
    }
}

/// A hardware watchdog: resets the module when [`feed`](Self::feed) stays away for longer than its period.
pub trait Watchdog {
    /// Starts the period anew.
    fn feed(&mut self);
}
