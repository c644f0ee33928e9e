//! Evaluates each compass of a flight: logged correction, baseline fits, and the module's result.

use autoswing::earth::EarthField;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::baseline_fits;
use super::bending_load::{BendingLoad, find_bending_loads};
use super::field_change::{HardIronChange, SensorChange, find_changes};
use super::field_latency::{self, FieldLatency};
use super::parameter_export::CorrectedTerms;
use super::parameter_fit::ParameterFit;
use super::row_headings::score_field;
use super::sensor_failure::{SensorFailure, find_sensor_failure};
use crate::log::{FieldCorrection, LoggedCompass, LoggedFlight, mounting_parameter_changes};
use crate::replay::reference::{ReferenceHeading, ReferenceKind};
use crate::replay::replay_run::replay_rows;
use crate::replay::result::{EarthFieldPrior, HeadingScore, ReplayResult, RowSelection};
use crate::replay::row::ReplayRow;
use crate::replay::rows::{RowCounts, build_rows};

/// Options of an evaluation.
#[derive(Clone, Copy, Debug)]
pub struct EvaluationOptions {
    /// Samples of a module that is compared, with fits of a sphere and an ellipsoid; none without a comparison.
    pub compared_module: Option<RowSelection>,
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
    /// Terms that parameter files correct.
    pub corrected_terms: CorrectedTerms,
}

impl EvaluationOptions {
    /// Default options: all compasses, without a comparison.
    pub const DEFAULT: Self = Self {
        compared_module: None,
        compass_number: None,
        inclination_deg: None,
        time_window_s: [f64::NEG_INFINITY, f64::INFINITY],
        reference_kind: None,
        field_latency_s: None,
        corrected_terms: CorrectedTerms::All,
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
    /// Failure of the sensor.
    pub sensor_failure: Option<SensorFailure>,
    /// Median interval of the readings, seconds.
    pub reading_interval_s: f64,
    /// Result of the module that is compared.
    pub module_result: Option<ReplayResult>,
    /// Heading scores with the correction as logged, and with each compared correction; none without a reference.
    pub heading_scores: Vec<(CorrectionSource, Option<HeadingScore>)>,
    /// Causes of errors in flight.
    pub causes: FieldCauses,
    /// The fit, from which the autopilot's parameters are made.
    pub parameter_fit: ParameterFit,
}

/// Causes of errors in flight.
#[derive(Clone, Debug, Default)]
pub struct FieldCauses {
    /// Changes of hard iron, in order of time.
    pub hard_iron_changes: Vec<HardIronChange>,
    /// Change of the sensor; then no other causes are found, since it appears as such.
    pub sensor_change: Option<SensorChange>,
    /// Loads that bend the field.
    pub bending_loads: Vec<BendingLoad>,
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
    /// Solution of the module.
    Module,
}

impl CorrectionSource {
    /// All sources, in the order of reports.
    pub const ALL_SOURCES: [Self; 5] =
        [Self::Uncorrected, Self::Autopilot, Self::Sphere, Self::Ellipsoid, Self::Module];

    /// Name of the source in reports.
    #[must_use]
    pub const fn source_name(self) -> &'static str {
        match self {
            Self::Uncorrected => "uncorrected",
            Self::Autopilot => "as logged",
            Self::Sphere => "sphere",
            Self::Ellipsoid => "ellipsoid",
            Self::Module => "module",
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
    /// Inclination of the Earth field that the user gave, degrees.
    pub given_inclination_deg: Option<f64>,
    /// Terms that parameter files correct.
    pub corrected_terms: CorrectedTerms,
    /// Median interval of the attitudes, seconds.
    pub attitude_interval_s: f64,
}

impl FlightEvaluation {
    /// Strength of the modelled Earth field, microtesla.
    pub(super) fn earth_total_ut(&self) -> Option<f64> {
        self.earth_field.as_ref().map(|(earth, _)| f64::from(earth.total_ut))
    }

    /// Inclination of the modelled Earth field, degrees.
    pub(super) fn earth_inclination_deg(&self) -> Option<f64> {
        self.earth_field.as_ref().map(|(earth, _)| f64::from(earth.inclination_deg))
    }

    /// Declination by the field model, degrees.
    pub(crate) fn declination_deg(&self) -> Option<f64> {
        self.earth_field.as_ref().and_then(|(earth, _)| earth.declination_deg).map(f64::from)
    }
}

/// Evaluates the compasses of a flight.
#[must_use]
pub fn evaluate_flight(flight: &LoggedFlight, evaluation_options: &EvaluationOptions) -> FlightEvaluation {
    let reference = evaluation_options.reference_kind.map_or_else(
        || ReferenceHeading::best_reference(flight),
        |reference_kind| ReferenceHeading::of_kind(flight, reference_kind),
    );
    let earth = flight.earth_field();
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
    let prior = EarthFieldPrior {
        inclination_deg: evaluation_options.inclination_deg,
        place_and_day: flight.position().zip(flight.flight_date),
    };
    let inputs = SharedInputs { flight, reference: reference.as_ref(), earth_ut, evaluation_options, prior };
    let compasses: Vec<CompassEvaluation> = compasses
        .par_iter()
        .zip(latencies)
        .map(|(compass, latency)| inputs.evaluate_compass(compass, latency))
        .collect();
    FlightEvaluation {
        compasses,
        reference,
        earth_field: earth,
        given_inclination_deg: evaluation_options.inclination_deg,
        corrected_terms: evaluation_options.corrected_terms,
        attitude_interval_s: flight.attitude.median_step_s().unwrap_or(f64::NAN),
    }
}

/// Inputs of the evaluation that all compasses of a flight share.
struct SharedInputs<'a> {
    flight: &'a LoggedFlight,
    reference: Option<&'a ReferenceHeading>,
    earth_ut: Option<f64>,
    evaluation_options: &'a EvaluationOptions,
    prior: EarthFieldPrior,
}

impl SharedInputs<'_> {
    /// Rows of a compass; those outside the window are not usable.
    fn replay_rows(&self, compass: &LoggedCompass, latency: FieldLatency) -> (Vec<ReplayRow>, RowCounts) {
        let (mut rows, mut row_counts) = build_rows(self.flight, compass, latency.used_s, self.reference);
        let [from_s, to_s] = self.evaluation_options.time_window_s;
        for row in rows.iter_mut().filter(|row| row.is_usable && !(from_s..=to_s).contains(&row.t_s)) {
            row.is_usable = false;
            row_counts.used -= 1;
            row_counts.excluded += 1;
        }
        (rows, row_counts)
    }

    fn evaluate_compass(&self, compass: &LoggedCompass, latency: FieldLatency) -> CompassEvaluation {
        let (rows, row_counts) = self.replay_rows(compass, latency);
        let whole_fit = ParameterFit::new(&rows, None, &self.prior);
        let causes = self.find_causes(compass, &rows, &whole_fit);
        let remounted = mounting_parameter_changes(self.flight, compass.compass_number);
        let last_change_s = causes
            .hard_iron_changes
            .iter()
            .map(|change| change.time_s)
            .chain(causes.sensor_change.map(|change| change.time_s))
            .chain(remounted.into_iter().map(|(_, at_s)| at_s))
            .reduce(f64::max);
        let parameter_fit = match last_change_s {
            Some(_) => ParameterFit::new(&rows, last_change_s, &self.prior),
            None => whole_fit,
        };
        let module_result = self
            .evaluation_options
            .compared_module
            .map(|selection| replay_rows(&rows, Some(self.flight), selection, &self.prior));
        CompassEvaluation {
            compass_number: compass.compass_number,
            is_used_for_heading: compass.is_used_for_heading,
            latency,
            row_counts,
            sensor_failure: find_sensor_failure(self.flight, compass, &rows),
            reading_interval_s: compass.field.median_step_s().unwrap_or(f64::NAN),
            heading_scores: heading_scores(compass, &rows, module_result.as_ref()),
            rows,
            module_result,
            causes,
            parameter_fit,
        }
    }

    /// Changes in flight, and loads, from a fit to all rows; without one, from the correction as logged.
    fn find_causes(&self, compass: &LoggedCompass, rows: &[ReplayRow], whole_fit: &ParameterFit) -> FieldCauses {
        let initial = whole_fit.correction().or(compass.correction).unwrap_or_else(FieldCorrection::identity);
        let total_ut = self.earth_ut.or(whole_fit.strength_ut()).unwrap_or(f64::INFINITY);
        let hard_iron_changes = match find_changes(rows, self.flight, &initial, total_ut) {
            Ok(changes) => changes,
            Err(change) => return FieldCauses { sensor_change: Some(change), ..FieldCauses::default() },
        };
        let bending_loads = find_bending_loads(rows, self.flight, &initial, &hard_iron_changes);
        FieldCauses { hard_iron_changes, sensor_change: None, bending_loads }
    }
}

/// Scores of the corrections as logged, and in a comparison with a module those of other fits.
fn heading_scores(
    compass: &LoggedCompass,
    rows: &[ReplayRow],
    module_result: Option<&ReplayResult>,
) -> Vec<(CorrectionSource, Option<HeadingScore>)> {
    let by = |correction: Option<FieldCorrection>| score_correction(rows, &correction?);
    let mut scores = vec![(CorrectionSource::Uncorrected, by(Some(FieldCorrection::identity())))];
    if compass.correction.is_some() {
        scores.push((CorrectionSource::Autopilot, score_field(rows, ReplayRow::logged_ut)));
    }
    if let Some(module_result) = module_result {
        let usable = rows.iter().filter(|row| row.is_usable);
        let fields: Vec<Vector3<f64>> = usable.map(|row| row.raw_field.ut.map(f64::from)).collect();
        scores.push((CorrectionSource::Sphere, by(baseline_fits::fit_sphere(&fields))));
        scores.push((CorrectionSource::Ellipsoid, by(baseline_fits::fit_ellipsoid(&fields))));
        scores.push((CorrectionSource::Module, module_result.score));
    }
    scores
}

/// Heading score of a correction.
#[must_use]
pub fn score_correction(rows: &[ReplayRow], correction: &FieldCorrection) -> Option<HeadingScore> {
    score_field(rows, |row| row.corrected_field(correction))
}

impl CompassEvaluation {
    /// Time of the module's calibration on the log's clock, seconds; none if its collection did not end automatically.
    #[must_use]
    pub fn calibration_time_s(&self) -> Option<f64> {
        Some(self.module_result.as_ref()?.outcome.collection_end_s? + self.rows.first()?.t_s)
    }

    /// The score with the correction from one source.
    #[must_use]
    pub fn score_by(&self, source: CorrectionSource) -> Option<HeadingScore> {
        self.heading_scores.iter().find(|(correction_source, _)| *correction_source == source)?.1
    }
}

#[cfg(test)]
mod tests {
    use autoswing::earth::{Date, Position};

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
            let (earth_field, is_model_valid) = flight_to_north(day).earth_field().unwrap();
            assert_eq!(is_model_valid, is_valid);
            let numbers = |field: EarthField| [field.total_ut, field.inclination_deg].map(f32::to_bits);
            assert_eq!(numbers(earth_field), numbers(expected));
        }
        assert!(LoggedFlight::new(LogFormat::Csv).earth_field().is_none());
    }
}
