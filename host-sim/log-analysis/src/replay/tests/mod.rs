//! Tests of the evaluation: each changes one property of a flown flight.

mod data_loss;
mod frozen_field;
mod parameter_export;
mod prior_inclination;
mod verdict;

use std::sync::LazyLock;

use autoswing::calibration::SolveError;
use autoswing::messages::Refusal;

use super::evaluation::{CompassEvaluation, EvaluationOptions, FlightEvaluation, evaluate_flight};
use super::*;
use crate::log::csv::FieldUnit;
use crate::log::log_writers::encode_dataflash;
use crate::log::{self, Flight};
use crate::test_flight::record_turns;

/// A calibrating flight of turns without field latency, and its evaluation.
static FLOWN_TURNS: LazyLock<(Flight, FlightEvaluation)> = LazyLock::new(|| {
    let recording = record_turns(0.0);
    let flight = log::read_flight(&mut encode_dataflash(&recording).as_slice(), FieldUnit::Milligauss).unwrap();
    let options = EvaluationOptions { field_latency_s: Some(0.0), ..EvaluationOptions::DEFAULT };
    let verdict = evaluate_flight(&flight, &options);
    (flight, verdict)
});

fn compass_of_flown_turns() -> (Flight, CompassEvaluation) {
    let (flight, verdict) = FLOWN_TURNS.clone();
    let compass = verdict.compasses[0].clone();
    assert_eq!(compass.module_result.acceptance, Ok(()));
    (flight, compass)
}

fn evaluation_of_compasses(compasses: Vec<CompassEvaluation>) -> FlightEvaluation {
    FlightEvaluation { compasses, ..FLOWN_TURNS.1.clone() }
}

const REFUSED_SOLVE: Result<(), Refusal> = Err(Refusal::Solve(SolveError::NotConverged));
