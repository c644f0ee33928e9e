//! Evaluates each compass of a flight: logged correction, baseline fits, and the module's result.

use autoswing::earth::{Date, EarthField, Position};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::baseline_fits;
use super::bending_load::{BendingLoad, find_bending_loads};
use super::field_latency::{self, FieldLatency};
use super::flown_headings::yaw_sectors;
use super::hard_iron_changes::{LoggedHardIronChange, find_changes};
use super::parameter_fit::ParameterFit;
use super::row_headings::score_rows;
use super::row_solve::solved_correction;
use super::sensor_change::{SensorChange, find_sensor_change};
use crate::log::{FieldCorrection, Gps, LoggedCompass, LoggedFlight, mounting_parameter_changes};
use crate::replay::reference::{ReferenceHeading, ReferenceKind};
use crate::replay::replay_run::replay_rows_of_flight;
use crate::replay::result::{HeadingScore, ReplayOptions, ReplayResult, RowSelection};
use crate::replay::row::{ReplayRow, heading_deg};
use crate::replay::rows::{RowCounts, build_rows};

/// Options of an evaluation.
#[derive(Clone, Copy, Debug)]
pub struct EvaluationOptions {
    /// Rows used for the module's fit.
    pub row_selection: RowSelection,
    /// Number of the only compass to evaluate.
    pub compass_number: Option<u8>,
    /// Inclination of the Earth field, degrees; default: the field model.
    pub inclination_deg: Option<f64>,
    /// Start and end of the rows used for fits and scores, seconds of the log.
    pub time_window_s: [f64; 2],
    /// Reference heading; default: the best in the log.
    pub reference_kind: Option<ReferenceKind>,
    /// Latency of the logged field, seconds; default: estimated.
    pub field_latency_s: Option<f64>,
}

impl EvaluationOptions {
    /// Default options: all compasses, evaluated with the samples that the module retains in flight.
    pub const DEFAULT: Self = Self {
        row_selection: RowSelection::Flight,
        compass_number: None,
        inclination_deg: None,
        time_window_s: [f64::NEG_INFINITY, f64::INFINITY],
        reference_kind: None,
        field_latency_s: None,
    };
}

/// Evaluation of a compass.
#[derive(Clone, Debug)]
pub struct CompassEvaluation {
    /// The autopilot's number of the compass.
    pub compass_number: u8,
    /// Whether the autopilot uses the compass for its heading, if known.
    pub is_used_for_heading: Option<bool>,
    /// Latency of the logged field.
    pub latency: FieldLatency,
    /// Rows of the compass.
    pub rows: Vec<ReplayRow>,
    /// Numbers of used and of rejected rows.
    pub row_counts: RowCounts,
    /// Median interval of the readings, seconds.
    pub reading_interval_s: f64,
    /// The module's result with the selected rows.
    pub module_result: ReplayResult,
    /// The module's result with all rows.
    pub all_rows_result: ReplayResult,
    /// Heading RMS less mean without motor-current correction, degrees; none without such a correction or a reference.
    pub rms_without_current_deg: Option<f64>,
    /// Corrections with their scores.
    pub corrections: Vec<ScoredCorrection>,
    /// Field strength by a sphere fit, microtesla; none on few headings, which determine none.
    pub sphere_radius_ut: Option<f64>,
    /// Changes of hard iron in flight, in order of time.
    pub hard_iron_changes: Vec<LoggedHardIronChange>,
    /// Change of the sensor in flight; the changes of hard iron that it appears as are removed.
    pub sensor_change: Option<SensorChange>,
    /// Loads that bend the field.
    pub bending_loads: Vec<BendingLoad>,
    /// Fits from which the autopilot's parameters are made.
    pub parameter_fit: ParameterFit,
}

/// A correction with its score.
#[derive(Clone, Debug)]
pub struct ScoredCorrection {
    /// Source of the correction.
    pub correction_source: CorrectionSource,
    /// The correction; none if its parameters changed in flight.
    pub correction: Option<FieldCorrection>,
    /// Heading score; none without a reference.
    pub score: Option<HeadingScore>,
}

/// Source of a correction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CorrectionSource {
    /// Uncorrected field.
    Uncorrected,
    /// Parameters of the autopilot.
    Autopilot,
    /// Sphere fit.
    Sphere,
    /// Ellipsoid fit.
    Ellipsoid,
    /// Solution of the module, with the selected rows.
    Module,
    /// Solution of the module, with all rows.
    ModuleAllRows,
}

impl CorrectionSource {
    /// All sources, in the order of reports.
    pub const ALL_SOURCES: [Self; 6] =
        [Self::Uncorrected, Self::Autopilot, Self::Sphere, Self::Ellipsoid, Self::Module, Self::ModuleAllRows];

    /// Name of the source in reports.
    #[must_use]
    pub const fn source_name(self) -> &'static str {
        match self {
            Self::Uncorrected => "uncorrected",
            Self::Autopilot => "as logged",
            Self::Sphere => "sphere",
            Self::Ellipsoid => "ellipsoid",
            Self::Module => "module",
            Self::ModuleAllRows => "module, all rows",
        }
    }
}

/// Evaluation of a flight.
#[derive(Clone, Debug)]
pub struct FlightEvaluation {
    /// Results of the compasses.
    pub compasses: Vec<CompassEvaluation>,
    /// Reference heading of the flight, if the log has one.
    pub reference: Option<ReferenceHeading>,
    /// Modelled Earth field, and whether the model is valid on that day.
    pub earth_field: Option<(EarthField, bool)>,
    /// Median interval of the attitudes, seconds.
    pub attitude_interval_s: f64,
}

/// Evaluates the compasses of a flight.
#[must_use]
pub fn evaluate_flight(flight: &LoggedFlight, evaluation_options: &EvaluationOptions) -> FlightEvaluation {
    let reference = evaluation_options.reference_kind.map_or_else(
        || ReferenceHeading::best_reference(flight),
        |reference_kind| ReferenceHeading::of_kind(flight, reference_kind),
    );
    let earth = earth_of_flight(flight);
    let earth_ut = earth.as_ref().map(|(earth, _)| f64::from(earth.total_ut));
    let compasses: Vec<&LoggedCompass> = flight
        .compasses
        .iter()
        .filter(|compass| {
            evaluation_options.compass_number.is_none_or(|compass_number| compass.compass_number == compass_number)
        })
        .collect();
    let configured_latency = |used_s: f64| FieldLatency { used_s, sigma_s: None };
    let mut latencies: Vec<FieldLatency> = compasses
        .par_iter()
        .map(|compass| {
            evaluation_options
                .field_latency_s
                .map_or_else(|| field_latency::estimate_latency(flight, compass), configured_latency)
        })
        .collect();
    field_latency::fill_in_missing_latencies(&mut latencies);
    let options = ReplayOptions {
        row_selection: evaluation_options.row_selection,
        inclination_deg: evaluation_options.inclination_deg,
        place_and_day: flight_position(flight).zip(flight.flight_date),
    };
    let inputs =
        SharedInputs { flight, reference: reference.as_ref(), earth_ut, window_s: evaluation_options.time_window_s };
    let compasses: Vec<CompassEvaluation> = compasses
        .par_iter()
        .zip(latencies)
        .map(|(compass, latency)| evaluate_compass(&inputs, compass, latency, &options))
        .collect();
    FlightEvaluation {
        compasses,
        reference,
        earth_field: earth,
        attitude_interval_s: flight.attitude.median_step_s().unwrap_or(f64::NAN),
    }
}

/// Inputs of the evaluation that all compasses of a flight share.
struct SharedInputs<'a> {
    flight: &'a LoggedFlight,
    reference: Option<&'a ReferenceHeading>,
    earth_ut: Option<f64>,
    window_s: [f64; 2],
}

impl SharedInputs<'_> {
    /// Rows of a compass; those outside the window are not usable.
    fn replay_rows(&self, compass: &LoggedCompass, latency: FieldLatency) -> (Vec<ReplayRow>, RowCounts) {
        let (mut rows, mut row_counts) = build_rows(self.flight, compass, latency.used_s, self.reference);
        let [from_s, to_s] = self.window_s;
        for row in rows.iter_mut().filter(|row| row.is_usable && !(from_s..=to_s).contains(&row.t_s)) {
            row.is_usable = false;
            row_counts.used -= 1;
            row_counts.excluded += 1;
        }
        (rows, row_counts)
    }
}

fn evaluate_compass(
    inputs: &SharedInputs<'_>,
    compass: &LoggedCompass,
    latency: FieldLatency,
    options: &ReplayOptions,
) -> CompassEvaluation {
    let &SharedInputs { flight, earth_ut, .. } = inputs;
    let (rows, row_counts) = inputs.replay_rows(compass, latency);
    let module = replay_rows_of_flight(&rows, Some(flight), options);
    let all_rows = if options.row_selection == RowSelection::All {
        module.clone()
    } else {
        replay_rows_of_flight(&rows, Some(flight), &ReplayOptions { row_selection: RowSelection::All, ..*options })
    };
    let rms_without_current_deg = rms_without_current_deg(&rows, flight, &module, options);
    let fields: Vec<Vector3<f64>> =
        rows.iter().filter(|row| row.is_usable).map(|row| row.raw_field.ut.map(f64::from)).collect();
    let sphere = baseline_fits::fit_sphere(&fields);
    let scored = |correction_source, correction_found: Option<FieldCorrection>| ScoredCorrection {
        correction_source,
        correction: correction_found,
        score: correction_found.and_then(|correction_found| score_correction(&rows, &correction_found)),
    };
    let logged = ScoredCorrection {
        correction_source: CorrectionSource::Autopilot,
        correction: compass.correction,
        score: score_rows(&rows, |row| Some((row.logged_heading_deg(), f64::NAN))),
    };
    let mut corrections = vec![scored(CorrectionSource::Uncorrected, Some(FieldCorrection::identity()))];
    corrections.extend(compass.correction.is_some().then_some(logged));
    corrections.push(scored(CorrectionSource::Sphere, sphere.map(|(correction_found, _)| correction_found)));
    corrections.push(scored(
        CorrectionSource::Ellipsoid,
        baseline_fits::fit_ellipsoid(&fields).map(|(correction_found, _)| correction_found),
    ));
    let score_result = |correction_source, replay_result: &ReplayResult| ScoredCorrection {
        correction_source,
        correction: replay_result.solution.as_ref().map(solved_correction),
        score: replay_result.score,
    };
    corrections.push(score_result(CorrectionSource::Module, &module));
    if options.row_selection != RowSelection::All {
        corrections.push(score_result(CorrectionSource::ModuleAllRows, &all_rows));
    }
    let sphere_radius_ut =
        sphere.map(|(_, sphere_radius_ut)| sphere_radius_ut).filter(|_| yaw_sectors(flight, &rows).suffice());
    let solved = [&all_rows, &module].into_iter().find_map(|result| result.solution.as_ref().map(solved_correction));
    let initial = solved.or(sphere.map(|(correction_found, _)| correction_found));
    let total_ut = earth_ut.or(sphere_radius_ut).unwrap_or(f64::INFINITY);
    let mut changes = initial.map_or_else(Vec::new, |initial| find_changes(&rows, flight, &initial, total_ut));
    let sensor_change = initial.and_then(|initial| find_sensor_change(&rows, &initial, &changes));
    if sensor_change.is_some() {
        // A changed sensor appears as iron, not only at its time: no fit of both parts is right.
        changes.clear();
    }
    // Without a fit, a load bends the field as logged.
    let applied = solved.or(compass.correction).unwrap_or_else(FieldCorrection::identity);
    let bending_loads =
        if sensor_change.is_some() { Vec::new() } else { find_bending_loads(&rows, flight, &applied, &changes) };
    let remounted_s = mounting_parameter_changes(flight, compass.compass_number).into_iter().map(|(_, at_s)| at_s);
    let last_change_s = changes
        .iter()
        .map(|change| change.hard_iron_step.time_s)
        .chain(sensor_change.map(|change| change.time_s))
        .chain(remounted_s)
        .reduce(f64::max);
    let parameter_fit = ParameterFit::new(&rows, last_change_s, options);
    let reading_interval_s = compass.field.median_step_s().unwrap_or(f64::NAN);
    let LoggedCompass { compass_number, is_used_for_heading, .. } = *compass;
    CompassEvaluation {
        compass_number,
        is_used_for_heading,
        latency,
        rows,
        row_counts,
        reading_interval_s,
        module_result: module,
        all_rows_result: all_rows,
        rms_without_current_deg,
        corrections,
        sphere_radius_ut,
        hard_iron_changes: changes,
        sensor_change,
        bending_loads,
        parameter_fit,
    }
}

fn rms_without_current_deg(
    rows: &[ReplayRow],
    flight: &LoggedFlight,
    module: &ReplayResult,
    options: &ReplayOptions,
) -> Option<f64> {
    let is_motor_current_applied =
        module.solution.as_ref().is_some_and(|solution| solution.calibration.motor_current.is_applied());
    if !is_motor_current_applied {
        return None;
    }
    let rows_without_current: Vec<ReplayRow> = rows.iter().map(|row| ReplayRow { current_a: None, ..*row }).collect();
    Some(replay_rows_of_flight(&rows_without_current, Some(flight), options).score?.rms_deg)
}

/// Heading score of a correction.
#[must_use]
pub fn score_correction(rows: &[ReplayRow], correction: &FieldCorrection) -> Option<HeadingScore> {
    score_rows(rows, |row| Some((heading_deg(row, row.corrected_field(correction)), f64::NAN)))
}

fn flight_position(flight: &LoggedFlight) -> Option<Position> {
    let rows = flight.gps.rows();
    let gps = Gps::from_columns(rows.get(rows.len() / 2)?.row_values);
    Position::new(gps.latitude_deg, gps.longitude_deg, gps.height_m)
}

/// Modelled Earth field at the middle of the flight, and whether the model is valid on that day; otherwise that of its
/// first day.
fn earth_of_flight(flight: &LoggedFlight) -> Option<(EarthField, bool)> {
    /// 2025-01-01, the model's first day.
    const MODEL_BEGINS_UNIX_S: u64 = 1_735_689_600;
    let position = flight_position(flight)?;
    let today = flight.flight_date.and_then(|day| EarthField::from_model(position, day)).map(|field| (field, true));
    today.or_else(|| {
        EarthField::from_model(position, Date::from_unix_s(MODEL_BEGINS_UNIX_S)?).map(|field| (field, false))
    })
}

impl CompassEvaluation {
    /// Time of the calibration on the log's clock, seconds; none if the collection did not end automatically.
    #[must_use]
    pub fn calibration_time_s(&self) -> Option<f64> {
        let first_s = self.rows.first()?.t_s;
        Some(self.module_result.collection_end_s? + first_s)
    }

    /// The correction from one source.
    #[must_use]
    pub fn correction_from(&self, source: CorrectionSource) -> Option<&ScoredCorrection> {
        self.corrections.iter().find(|correction| correction.correction_source == source)
    }

    /// The module's result, or that of all rows if the module had no solution.
    #[must_use]
    pub const fn result_for_report(&self) -> &ReplayResult {
        if self.module_result.solution.is_some() { &self.module_result } else { &self.all_rows_result }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::LogFormat;

    /// A flight from the equator to 60 N.
    fn flight_to_north(day: Option<Date>) -> LoggedFlight {
        let mut flight = LoggedFlight::new(LogFormat::Csv);
        flight.flight_date = day;
        for i in 0..7_u8 {
            flight.gps.push_row(f64::from(i), [10.0 * f32::from(i), 11.3, 500.0, 0.0, 0.0, f32::NAN]);
        }
        flight
    }

    #[test]
    fn the_field_model_is_evaluated_at_the_middle_of_the_flight() {
        let day = |unix_s: u64| Date::from_unix_s(unix_s).unwrap();
        let middle_position = Position::new(30.0, 11.3, 500.0).unwrap();
        let (of_2026, first) = (day(1_767_484_800), day(1_735_689_600));
        for (day, expected, is_valid) in
            [(Some(of_2026), of_2026, true), (None, first, false), (Some(day(1_640_995_200)), first, false)]
        {
            let expected = EarthField::from_model(middle_position, expected).unwrap();
            let (earth_field, is_model_valid) = earth_of_flight(&flight_to_north(day)).unwrap();
            assert_eq!(is_model_valid, is_valid);
            let numbers = |field: EarthField| [field.total_ut, field.inclination_deg].map(f32::to_bits);
            assert_eq!(numbers(earth_field), numbers(expected));
        }
        assert!(earth_of_flight(&LoggedFlight::new(LogFormat::Csv)).is_none());
    }
}
