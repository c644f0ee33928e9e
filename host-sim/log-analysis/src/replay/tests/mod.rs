//! Tests of the evaluation: each changes one property of a flown flight.

mod parameter_export;
mod verdict;

use std::sync::LazyLock;

use autoswing::calibration::SolveError;
use autoswing::earth::{Date, EarthField, Position};
use autoswing::frames::{Field, Level, RollPitch};
use autoswing_module::messages::Refusal;

use super::evaluation::{CompassEvaluation, EvaluationOptions, FlightEvaluation, evaluate_flight};
use super::parameter_export::orientation::{ExportedOrientation, FixedOrientation};
use super::parameter_export::{CorrectedTerms, ExportInputs, ExportedCorrection, ParameterFormat};
use super::*;
use crate::log::{self, FieldCorrection, LoggedFlight};
use crate::numbers;
use crate::replay::data_loss;
use crate::replay::evaluation::CorrectionSource;
use crate::replay::sensor_failure::{SensorFailure, find_sensor_failure};
use crate::test_flight::{flight_of_motion, logged_flight, record_turns};

/// A calibrating flight of turns without field latency, with wrong offsets in the autopilot, and its evaluation.
pub(crate) static FLOWN_TURNS: LazyLock<(LoggedFlight, FlightEvaluation)> = LazyLock::new(|| {
    let offsets = [("COMPASS_OFS_X", 100.0), ("COMPASS_OFS_Y", 100.0), ("COMPASS_OFS_Z", 100.0)];
    let flight = logged_flight(&record_turns(0.0).with_parameters(&offsets));
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
    assert_eq!(module_of(&compass).outcome.acceptance, Ok(()));
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
    ReplayRow { reference_deg: Some(heading_deg), ..ReplayRow::of_field(t_s, Field::new(field), RollPitch::default()) }
}

/// Inputs of an export of compass 1 with all terms, whose orientation is not in the log.
pub(super) const fn export_inputs(rows: &[ReplayRow], format: ParameterFormat) -> ExportInputs<'_> {
    ExportInputs {
        compass_number: 1,
        rows,
        total_ut: None,
        format,
        orientation: Err(FixedOrientation::NotLogged),
        terms: CorrectedTerms::All,
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

/// 100 s of measured rates at 10 Hz, of which one in `loss_stride` is lost, with an attitude at a rate in Hz.
fn flight_with_lost_rates(loss_stride: usize, attitude_rate_hz: f64) -> LoggedFlight {
    let still = |_| ([0.0; 3], [0.0; 3]);
    let mut body_rates = flight_of_motion(10.0, 1000, still).body_rates;
    body_rates.retain_rows(|i, _| i % loss_stride != 1);
    let whole = flight_of_motion(attitude_rate_hz, (100.0 * attitude_rate_hz) as u16, still);
    LoggedFlight { body_rates, has_measured_rates: true, ..whole }
}

/// Rates are differences of the attitude if they are not measured. Of a slow attitude, and of a tenth of lost rates,
/// headings cannot be integrated; a fiftieth is harmless.
#[test]
fn a_heading_is_integrated_only_from_measured_and_complete_rates_with_a_fast_attitude() {
    for (has_measured_rates, attitude_rate_hz, loss_stride, is_integrable) in
        [(true, 5.0, 50, true), (false, 5.0, 50, false), (true, 2.0, 50, false), (true, 5.0, 10, false)]
    {
        let mut flight = flight_with_lost_rates(loss_stride, attitude_rate_hz);
        flight.has_measured_rates = has_measured_rates;
        assert_eq!(
            data_loss::has_integrable_rates(&flight),
            is_integrable,
            "{attitude_rate_hz} Hz, 1 in {loss_stride}"
        );
        let lost = data_loss::excessive_rate_loss(&flight);
        assert_eq!(lost.is_some(), has_measured_rates && loss_stride == 10, "{lost:?}");
        assert!(lost.is_none_or(|lost| (lost - 0.11).abs() < 0.01), "100 gaps in 900 rows: {lost:?}");
    }
}

/// Turns with a motor current of 10 to 30 A that interferes by 0.36 uT/A, and a second compass like the first.
fn flight_with_current() -> LoggedFlight {
    let mut recording = record_turns(0.0);
    for (i, sample) in recording.samples.iter_mut().enumerate() {
        sample.current_a = 20.0 + 10.0 * libm::sin(i as f64 / 70.0);
        sample.field_ut[0][0] += 0.3 * sample.current_a;
        sample.field_ut[0][1] -= 0.2 * sample.current_a;
        sample.field_ut = vec![sample.field_ut[0]; 2];
    }
    logged_flight(&recording)
}

#[test]
fn a_chosen_compass_is_evaluated_in_the_time_window() {
    let options = EvaluationOptions {
        compared_module: Some(RowSelection::All),
        compass_number: Some(2),
        time_window_s: [20.0, 220.0],
        field_latency_s: Some(0.0),
        ..EvaluationOptions::DEFAULT
    };
    let evaluation = evaluate_flight(&flight_with_current(), &options);
    let [compass] = &evaluation.compasses[..] else { panic!("{} compasses", evaluation.compasses.len()) };
    assert_eq!(compass.compass_number, 2);
    let (used, unused): (Vec<&ReplayRow>, Vec<&ReplayRow>) = compass.rows.iter().partition(|row| row.is_usable);
    assert!(used.iter().all(|row| (20.0..=220.0).contains(&row.t_s)));
    assert!(unused.iter().all(|row| !(20.0..=220.0).contains(&row.t_s)));
    assert_eq!((compass.row_counts.used, compass.row_counts.excluded), (used.len(), unused.len()));
    // 200 s at 10 Hz; the record lasts from 2 s to 240 s.
    assert!(used.len().abs_diff(2000) <= 2 && unused.len().abs_diff(380) <= 3, "{:?}", compass.row_counts);
}

#[test]
fn the_longest_frozen_field_is_reported() {
    for spans in [[(20, 32), (60, 90)], [(20, 50), (60, 72)]] {
        let (flight, mut compass) = compass_of_flown_turns();
        for (from_s, to_s) in spans {
            for (i, row) in compass.rows.iter_mut().enumerate() {
                if (from_s * 10..=to_s * 10).contains(&i) {
                    row.raw_field = Field::from_ut(20.0, 0.0, 40.0);
                    row.attitude = RollPitch::from_deg(if i % 2 == 0 { 10.0 } else { -10.0 }, 0.0);
                }
            }
        }
        let (from_s, to_s) = if spans[0].1 - spans[0].0 > 20 { spans[0] } else { spans[1] };
        let note = find_sensor_failure(&flight, &flight.compasses[0], &compass.rows).unwrap().to_string();
        let [from_s, to_s] = [from_s, to_s].map(|time_s| compass.rows[time_s * 10].t_s.round());
        assert!(note.contains(&format!("from {from_s} to {to_s} s")), "{note}");
    }
}

/// Gaps up to 10 s occur with slow cards. A field that ends before it begins has no readings.
#[test]
fn a_field_ending_over_10_s_before_the_log_is_reported() {
    for (early_s, is_reported, has_readings) in [(5.0, false, true), (15.0, true, true), (1e9, true, false)] {
        let (mut flight, compass) = compass_of_flown_turns();
        let end_s = flight.attitude.rows().last().unwrap().t_s;
        flight.compasses[0].field.retain_rows(|_, reading| reading.t_s <= end_s - early_s);
        let failure = find_sensor_failure(&flight, &flight.compasses[0], &compass.rows);
        assert_eq!(failure.is_some(), is_reported, "{early_s}");
        assert_eq!(failure != Some(SensorFailure::NoReadings), has_readings, "{early_s}");
    }
}

/// Inclination of the flown turns, degrees.
fn flown_inclination_deg(compass: &CompassEvaluation) -> f64 {
    f64::from(compass.parameter_fit.solution().unwrap().calibration.inclination_rad.to_degrees())
}

/// The prior has a standard deviation of 1 deg; samples contradict it beyond 4. A contradicted prior fails every trial
/// solve.
#[test]
fn a_configured_inclination_is_used_by_the_solver_and_its_trial_solves() {
    let (_, compass) = compass_of_flown_turns();
    for selected in [RowSelection::All, RowSelection::Turns, RowSelection::Flight] {
        for (off_deg, is_accepted) in [(-12.0, false), (-2.0, true), (0.0, true), (2.0, true), (12.0, false)] {
            let inclination_deg = Some(flown_inclination_deg(&compass) + off_deg);
            let prior = EarthFieldPrior { inclination_deg, place_and_day: None };
            let result = replay_rows(&compass.rows, None, selected, &prior);
            assert_eq!(result.outcome.acceptance.is_ok(), is_accepted, "{selected:?} {off_deg}");
            let is_ended_by_module = selected == RowSelection::Flight && result.outcome.collection_end_s.is_some();
            assert_eq!(is_ended_by_module, selected == RowSelection::Flight && is_accepted, "{selected:?} {off_deg}");
        }
    }
}

/// A place on the Greenwich meridian with a modelled inclination, within 0.5 deg.
fn place_with_inclination(inclination_deg: f64) -> (Position, Date) {
    let day = Date::from_unix_s(1_767_225_600).unwrap();
    let is_there = |position: &Position| {
        let field = EarthField::from_model(*position, day).unwrap();
        (f64::from(field.inclination_deg) - inclination_deg).abs() < 0.5
    };
    let position =
        (-160..160).filter_map(|half_deg: i16| Position::new(f32::from(half_deg) / 2.0, 0.0, 100.0)).find(is_there);
    (position.unwrap(), day)
}

/// A modelled inclination is dropped if contradicted; a configured one is not, and takes precedence.
#[test]
fn a_contradicted_model_inclination_is_dropped() {
    let (_, compass) = compass_of_flown_turns();
    let found_deg = flown_inclination_deg(&compass);
    for selected in [RowSelection::All, RowSelection::Turns, RowSelection::Flight] {
        let without_place = EarthFieldPrior::default();
        let run_replay = |prior: EarthFieldPrior| replay_rows(&compass.rows, None, selected, &prior);
        let expected_deg =
            |replay_result: &ReplayResult| replay_result.outcome.solution.unwrap().quality.expected_rms_deg;
        let [there, elsewhere] = [0.0, 12.0].map(|off_deg| EarthFieldPrior {
            place_and_day: Some(place_with_inclination(found_deg + off_deg)),
            ..without_place
        });
        assert!(
            expected_deg(&run_replay(there)) < expected_deg(&run_replay(without_place)),
            "{selected:?}: it is one unknown less"
        );
        let (with, without) = (run_replay(elsewhere), run_replay(without_place));
        assert_eq!(
            (with.outcome.acceptance.clone(), with.outcome.collection_end_s, expected_deg(&with)),
            (Ok(()), without.outcome.collection_end_s, expected_deg(&without)),
            "{selected:?}"
        );
        let by_person = run_replay(EarthFieldPrior { inclination_deg: Some(found_deg + 12.0), ..there });
        assert!(by_person.outcome.acceptance.is_err(), "{selected:?}");
    }
}
