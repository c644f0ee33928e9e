//! Replays of simulated flights.
#![expect(clippy::unwrap_used, reason = "what a test builds upon may end it")]

mod causes;
mod course;
mod judgement;
mod native;
mod rows;

use log_analysis::log::csv::FieldUnit;
use log_analysis::log::{self, Flight};
use log_analysis::replay::evaluation::EvaluationOptions;

const DEFAULT_OPTIONS: EvaluationOptions = EvaluationOptions::DEFAULT;

fn read_flight(bytes: &[u8]) -> Flight {
    let mut source = bytes;
    log::read_flight(&mut source, FieldUnit::Milligauss).unwrap()
}
