//! Tests of the evaluation: each changes one property of a flown flight.

mod data_loss;
mod evaluated_compasses;
mod frozen_field;
mod parameter_export;
mod prior_inclination;
mod verdict;

use std::sync::LazyLock;

use autoswing::calibration::SolveError;
use autoswing::frames::{Field, Level, RollPitch, Sensor};
use autoswing_module::messages::Refusal;

use super::evaluation::{CompassEvaluation, EvaluationOptions, FlightEvaluation, evaluate_flight};
use super::parameter_export::ExportedCorrection;
use super::parameter_export::orientation::ExportedOrientation;
use super::*;
use crate::log::csv::FieldUnit;
use crate::log::log_writers::{FlightRecording, encode_dataflash};
use crate::log::{self, FieldCorrection, LoggedFlight};
use crate::numbers;
use crate::test_flight::record_turns;

/// A calibrating flight of turns without field latency, with wrong offsets in the autopilot, and its evaluation.
pub(crate) static FLOWN_TURNS: LazyLock<(LoggedFlight, FlightEvaluation)> = LazyLock::new(|| {
    let parameters = ["X", "Y", "Z"].map(|axis| (format!("COMPASS_OFS_{axis}"), 100.0)).to_vec();
    let recording = FlightRecording { parameters, ..record_turns(0.0) };
    let flight = log::read_flight(&mut encode_dataflash(&recording).as_slice(), FieldUnit::Milligauss).unwrap();
    let options = EvaluationOptions {
        compared_module: Some(RowSelection::Flight),
        field_latency_s: Some(0.0),
        ..EvaluationOptions::DEFAULT
    };
    let evaluation = evaluate_flight(&flight, &options);
    (flight, evaluation)
});

pub(super) fn compass_of_flown_turns() -> (LoggedFlight, CompassEvaluation) {
    let (flight, evaluation) = FLOWN_TURNS.clone();
    let compass = evaluation.compasses[0].clone();
    assert_eq!(module_of(&compass).acceptance, Ok(()));
    (flight, compass)
}

/// Result of the module that is compared.
pub(super) fn module_of(compass: &CompassEvaluation) -> &ReplayResult {
    compass.module_result.as_ref().unwrap()
}

/// The same, to be changed.
pub(crate) fn module_mut(compass: &mut CompassEvaluation) -> &mut ReplayResult {
    compass.module_result.as_mut().unwrap()
}

pub(super) fn evaluation_of_compasses(compasses: Vec<CompassEvaluation>) -> FlightEvaluation {
    FlightEvaluation { compasses, ..FLOWN_TURNS.1.clone() }
}

pub(crate) const REFUSED_SOLVE: Result<(), Refusal> = Err(Refusal::Solve(SolveError::NotConverged));

/// Horizontal part and strength of the Earth field of [`level_row`], microtesla; it points 60 deg down.
pub(super) const LEVEL_ROW_FIELD_UT: [f64; 2] = [25.0, 50.0];

/// Usable row of level flight on a heading, with an undisturbed field.
pub(super) fn level_row(t_s: f64, heading_deg: f64) -> ReplayRow {
    let field = Field::<Level>::earth_field(50.0, 60_f32.to_radians(), heading_deg.to_radians() as f32).ut;
    ReplayRow { reference_deg: Some(heading_deg), ..row_of_field(t_s, Field::new(field), RollPitch::default()) }
}

/// Usable row of a field that the autopilot does not correct.
pub(super) fn row_of_field(t_s: f64, field: Field<Sensor>, attitude: RollPitch) -> ReplayRow {
    ReplayRow {
        t_s,
        raw_field: field,
        logged_field: field,
        attitude,
        rates_rad_s: None,
        current_a: None,
        is_usable: true,
        reference_deg: None,
    }
}

/// Parameters of compass 1 with a correction in the logged mounting.
pub(super) fn export_of(correction: FieldCorrection) -> ExportedCorrection {
    ExportedCorrection {
        compass_number: 1,
        correction,
        orientation: ExportedOrientation::unchanged(),
        heading_loss_deg: [0.0; 2],
        fitted_range_s: None,
        held_back_score: None,
        rms_by_terms_deg: None,
        warnings: Vec::new(),
    }
}
