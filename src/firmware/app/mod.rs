//! The asynchronous tasks. They are generic over the embedded-hal traits and run unchanged on a board's executors and
//! on the host's virtual clock.
//!
//! ```text
//! interrupt executor                                                    thread executor
//! sensor ----readings---> instrument ---samples------------------------> compass ---notices---> console
//! port, can --reports---> instrument <--correction---------------------- compass <--commands--- console
//!        <---estimates--- instrument
//!        ----armed, commands-------------------------------------------> compass
//!        <---settings, answers------------------------------------------ compass
//!        <---texts-------------------------------------------------------------------------- console
//! panel  <---indicator state, estimates--------------------------------- compass
//!        ----commands--------------------------------------------------> compass
//! watchdog <--heartbeats of those, and <-------------------------------- compass
//! ```
//!
//! Tasks that make headings preempt the slow ones (solve, flash erase, console), which therefore never delay a
//! sentence. All connections between tasks are in one [`TaskLinks`]; there are no globals.

pub mod can;
mod chip;
pub mod compass;
pub mod console;
pub mod inertial;
pub mod instrument;
mod line;
pub mod panel;
pub mod port;
pub mod safe_mode;
pub mod sensor;
mod task_links;
pub mod watchdog;

pub use console::Platform;
pub use panel::Panel;
pub use port::SetBaud;
pub use task_links::TaskLinks;
pub use watchdog::Watchdog;

#[cfg(test)]
mod tests;
