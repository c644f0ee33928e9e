//! Replays of simulated flights.
#![expect(clippy::unwrap_used, reason = "what a test builds upon may end it")]

mod course;
mod native;
mod rows;

use host_sim::log::csv::FieldUnit;
use host_sim::log::{self, Flight};
use host_sim::replay::evaluation::EvaluationOptions;

/// Default evaluation of a native log.
const ASKED: EvaluationOptions = EvaluationOptions::DEFAULT;

fn read(bytes: &[u8]) -> Flight {
    let mut source = bytes;
    log::read(&mut source, FieldUnit::Milligauss).unwrap()
}
