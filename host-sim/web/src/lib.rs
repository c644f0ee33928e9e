//! The judgement of a log, and an example flight, in a browser.
//!
//! | module | holds |
//! |---|---|
//! | [`loaded_log`] | a log that was read, and its judgement with the options of the page |
//! | [`example_flight`] | the example aircraft, observed while it calibrates itself |
//! | `page_exports` | the functions that the worker calls, on WebAssembly only |
//!
//! `page/` has the page and its worker, `scripts/build-web` puts all into one HTML file. Requests and answers are JSON
//! in buffers of this module's memory, so that no generated code is needed between Rust and JavaScript.

#![warn(clippy::disallowed_methods, clippy::disallowed_types)]

pub mod example_flight;
pub mod loaded_log;
#[cfg(target_arch = "wasm32")]
mod page_exports;
