//! Replays of simulated flights.

mod causes;
mod course;
mod judgement;
mod logs;
mod native;
mod orientation;
mod reading;
mod record;
mod rows;

use log_analysis::log::csv::FieldUnit;
use log_analysis::log::{self, LoggedFlight};
use log_analysis::replay::HeadingScore;
use log_analysis::replay::evaluation::{
    CompassEvaluation, CorrectionSource, EvaluationOptions, FlightEvaluation, evaluate_flight,
};
use log_analysis::replay::log_warning::LogWarning;
use simulator::world::WorldConfig;

const DEFAULT_OPTIONS: EvaluationOptions = EvaluationOptions::DEFAULT;

fn read_flight(bytes: &[u8]) -> LoggedFlight {
    let mut source = bytes;
    log::read_flight(&mut source, FieldUnit::Milligauss).unwrap()
}

fn evaluate_log(bytes: &[u8]) -> (LoggedFlight, FlightEvaluation) {
    let flight = read_flight(bytes);
    let evaluation = evaluate_flight(&flight, &DEFAULT_OPTIONS);
    (flight, evaluation)
}

/// Headings by the module's calibration.
fn module_score(compass: &CompassEvaluation) -> HeadingScore {
    compass.correction_from(CorrectionSource::Module).unwrap().score.unwrap()
}

/// Largest error of a good calibration, degrees RMS: attitude noise of 0.3 deg at the inclination.
fn max_rms_deg(world: &WorldConfig) -> f64 {
    0.5 + 0.45 * world.earth.inclination_deg.to_radians().tan().abs()
}

fn warnings_text(flight: &LoggedFlight, evaluation: &FlightEvaluation) -> String {
    LogWarning::warnings_of_flight(flight, evaluation).iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}
