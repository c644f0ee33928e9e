//! Analysis of flights: logs of autopilots, the module's judgement of them, and its report.
//!
//! | module | holds |
//! |---|---|
//! | [`log`] | reader of autopilot logs, and writer of small ones |
//! | [`replay`] | logged flights through the module's collector and solver; parameters for the autopilot |
//! | [`report`] | self-contained page of a log or of a simulated flight |
//! | [`score`] | statistics of heading errors; acceptance by an uncalibrated module |
//! | [`numbers`] | numbers as text and in JSON |
//!
//! The crate needs no operating system: it reads from any [`std::io::Read`], returns text and bytes, and knows neither
//! files nor clocks, so that it also runs in a browser. The same input gives the same result on every computer.

#![warn(clippy::disallowed_methods, clippy::disallowed_types)]

mod least_squares;
pub mod log;
pub mod numbers;
pub mod replay;
pub mod report;
pub mod score;
#[cfg(test)]
mod test_flight;
