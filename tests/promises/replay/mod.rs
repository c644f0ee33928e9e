//! Replays of simulated flights.

mod causes;
mod course;
mod inertial;
mod judgement;
mod logs;
mod native;
mod orientation;
mod reading;
mod record;
mod rows;

use log_analysis::log::csv::FieldUnit;
use log_analysis::log::{self, LoggedFlight};
use log_analysis::replay::evaluation::{CompassEvaluation, EvaluationOptions, FlightEvaluation, evaluate_flight};
use log_analysis::replay::log_warning::warnings_of_flight;
use log_analysis::replay::parameter_export::ParameterFormat;
use log_analysis::replay::verdict::Verdict;
use log_analysis::replay::{HeadingScore, ReplayResult, RowSelection};
use simulator::world::WorldConfig;

const DEFAULT_OPTIONS: EvaluationOptions = EvaluationOptions::DEFAULT;

/// Options of the program, with a module.
const WITH_MODULE: EvaluationOptions =
    EvaluationOptions { compared_module: Some(RowSelection::Flight), ..EvaluationOptions::DEFAULT };

fn read_flight(bytes: &[u8]) -> LoggedFlight {
    let mut source = bytes;
    log::read_flight(&mut source, FieldUnit::Milligauss).unwrap()
}

fn evaluate_log(bytes: &[u8]) -> (LoggedFlight, FlightEvaluation) {
    let flight = read_flight(bytes);
    let evaluation = evaluate_flight(&flight, &DEFAULT_OPTIONS);
    (flight, evaluation)
}

fn compare_with_module(bytes: &[u8]) -> (LoggedFlight, FlightEvaluation) {
    let flight = read_flight(bytes);
    let evaluation = evaluate_flight(&flight, &WITH_MODULE);
    (flight, evaluation)
}

/// The module's result.
fn module_result(compass: &CompassEvaluation) -> &ReplayResult {
    compass.module_result.as_ref().unwrap()
}

/// Headings by the module's calibration.
fn module_score(compass: &CompassEvaluation) -> HeadingScore {
    module_result(compass).score.unwrap()
}

/// Largest error of a good calibration, degrees RMS: attitude noise of 0.3 deg at the inclination.
fn max_rms_deg(world: &WorldConfig) -> f64 {
    0.5 + 0.45 * world.earth.inclination_deg.to_radians().tan().abs()
}

fn verdict_sentences(flight: &LoggedFlight, evaluation: &FlightEvaluation) -> String {
    Verdict::new(flight, evaluation, ParameterFormat::ArduPilot).summary_sentences().join(" ")
}

fn warnings_text(flight: &LoggedFlight, evaluation: &FlightEvaluation) -> String {
    warnings_of_flight(flight, evaluation).join("; ")
}
