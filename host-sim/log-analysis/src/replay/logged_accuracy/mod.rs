//! Error of a compass as it is logged, without a fit: against an accurate reference heading, else against the turn by
//! the body rates, else by the scatter of strength and inclination.

mod rate_comparison;

use std::fmt;

use serde::Serialize;

use super::evaluation::{CompassEvaluation, FlightEvaluation};
use super::flown_headings::{HeadingSectors, yaw_sectors};
use super::rows::RowCounts;
use super::{data_loss, row_headings};
use crate::log::{LogFormat, LoggedFlight};
use crate::numbers::median;
use crate::replay::reference::ReferenceHeading;
use crate::replay::row::ReplayRow;
use crate::score::BAD_COMPASS_RMS_DEG;

/// Minimum number of usable rows for a judgement: 12 s at the 2 Hz of telemetry.
const MIN_ROWS: usize = 25;

/// Error of a compass as logged, since the last change of hard iron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoggedAccuracy {
    /// Heading error less its mean, degrees RMS.
    pub rms_deg: f64,
    /// Number of 30 deg sectors of heading flown, of twelve.
    pub sector_count: usize,
    /// What the error is measured by.
    pub evidence: AccuracyEvidence,
}

/// Measure of the error as logged, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum AccuracyEvidence {
    /// An accurate reference heading.
    Reference,
    /// The turn by the body rates.
    BodyRates,
    /// The scatter of strength and inclination, which hard and soft iron cause, and so do attitude errors.
    FieldScatter,
}

/// Why the error as logged is unknown; displayed as a clause.
#[derive(Clone, Debug, PartialEq)]
pub enum UnknownError {
    /// Too few rows are usable.
    FewRows {
        /// Numbers of readings and rows, with the causes of rejection.
        row_counts: RowCounts,
        /// Interval of the attitudes, if it is too long for interpolation, seconds.
        slow_attitude_s: Option<f64>,
    },
    /// Too few headings were flown; their number, of twelve.
    FewHeadings(usize),
    /// On few headings, the field is not the Earth's at all.
    ContradictsModel {
        /// Strength as logged, by that of the field model.
        strength_ratio: f64,
        /// Inclination as logged, degrees.
        inclination_deg: f64,
        /// Inclination by the field model, degrees.
        model_inclination_deg: f64,
    },
    /// The field scatters, and neither body rates nor a reference heading show whether by iron; degrees of heading.
    FieldScatters(f64),
}

impl UnknownError {
    /// Stable code of the cause, for programs.
    #[must_use]
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::FewRows { .. } => "few-rows",
            Self::FewHeadings(_) => "few-headings",
            Self::ContradictsModel { .. } => "field-contradicts-model",
            Self::FieldScatters(_) => "no-reference",
        }
    }
}

/// Error of a compass as logged.
///
/// # Errors
///
/// The log is too short, has too few headings, or has nothing to measure the error by.
pub fn logged_accuracy(
    flight: &LoggedFlight,
    evaluation: &FlightEvaluation,
    compass: &CompassEvaluation,
) -> Result<LoggedAccuracy, UnknownError> {
    let rows: Vec<ReplayRow> = compass.parameter_fit.fitted_rows(&compass.rows).copied().collect();
    if rows.len() < MIN_ROWS {
        let interval_s = evaluation.attitude_interval_s;
        let slow_attitude_s = (interval_s > data_loss::SLOW_ATTITUDE_INTERVAL_S).then_some(interval_s);
        return Err(UnknownError::FewRows { row_counts: compass.row_counts, slow_attitude_s });
    }
    let by_heading = by_reference(evaluation, &rows).or_else(|| by_rates(flight, &rows));
    by_heading
        .map_or_else(|| by_scatter(flight, compass, &rows), Ok)
        .map_err(|unknown| contradiction_of_model(flight, evaluation, &rows).unwrap_or(unknown))
}

fn by_reference(evaluation: &FlightEvaluation, rows: &[ReplayRow]) -> Option<LoggedAccuracy> {
    evaluation.reference.as_ref().and_then(ReferenceHeading::sigma_if_accurate_deg)?;
    let sectors: HeadingSectors = rows.iter().filter_map(|row| row.reference_deg).collect();
    let score = row_headings::score_field(rows, ReplayRow::logged_ut).filter(|_| sectors.are_judged())?;
    let sector_count = sectors.flown_count();
    Some(LoggedAccuracy { rms_deg: score.rms_deg, sector_count, evidence: AccuracyEvidence::Reference })
}

fn by_rates(flight: &LoggedFlight, rows: &[ReplayRow]) -> Option<LoggedAccuracy> {
    let (rms_deg, sectors) = rate_comparison::error_by_rates(flight, rows)?;
    Some(LoggedAccuracy { rms_deg, sector_count: sectors.flown_count(), evidence: AccuracyEvidence::BodyRates })
}

fn by_scatter(
    flight: &LoggedFlight,
    compass: &CompassEvaluation,
    rows: &[ReplayRow],
) -> Result<LoggedAccuracy, UnknownError> {
    let sectors = yaw_sectors(flight, rows);
    if !sectors.suffice() {
        return Err(UnknownError::FewHeadings(sectors.flown_count()));
    }
    let rms_deg = row_headings::rms_deg_by_scatter(rows, &ReplayRow::logged_ut);
    let is_explained = || {
        compass.parameter_fit.correction().is_some_and(|correction| {
            row_headings::rms_deg_by_scatter(rows, &|row| row.corrected_field(&correction)) < 0.5 * rms_deg
        })
    };
    if rms_deg > BAD_COMPASS_RMS_DEG && !is_explained() {
        return Err(UnknownError::FieldScatters(rms_deg));
    }
    Ok(LoggedAccuracy { rms_deg, sector_count: sectors.flown_count(), evidence: AccuracyEvidence::FieldScatter })
}

/// Strength and inclination as logged that no good compass has at the place; iron of a fair one turns the field less.
fn contradiction_of_model(
    flight: &LoggedFlight,
    evaluation: &FlightEvaluation,
    rows: &[ReplayRow],
) -> Option<UnknownError> {
    /// Strengths by the model's beyond which more than the gain is wrong.
    const STRENGTH_RATIOS: std::ops::Range<f64> = 0.4..2.0;
    const MAX_INCLINATION_DIFFERENCE_DEG: f64 = 30.0;
    // A simulator may have its field from elsewhere, and a table may have another unit.
    let (earth, _) = evaluation.earth_field.as_ref().filter(|_| flight.true_attitude.is_empty())?;
    let strength_ut = median(rows.iter().map(|row| row.logged_ut().norm()));
    let down_ut = median(rows.iter().map(|row| row.down_in_body().dot(&row.logged_ut())));
    let strength_ratio = strength_ut / f64::from(earth.total_ut);
    let inclination_deg = libm::asin((down_ut / strength_ut).clamp(-1.0, 1.0)).to_degrees();
    let model_inclination_deg = f64::from(earth.inclination_deg);
    let is_contradicted = (inclination_deg - model_inclination_deg).abs() > MAX_INCLINATION_DIFFERENCE_DEG
        || flight.log_format != LogFormat::Csv && !STRENGTH_RATIOS.contains(&strength_ratio);
    is_contradicted.then_some(UnknownError::ContradictsModel { strength_ratio, inclination_deg, model_inclination_deg })
}

impl fmt::Display for LoggedAccuracy {
    /// "1.3 deg RMS on 7 of 12 headings by the body rates".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rms_deg, sector_count, .. } = self;
        write!(f, "{rms_deg:.1} deg RMS")?;
        match sector_count {
            0 | 1 => f.write_str(" while the aircraft hardly turned,")?,
            _ => write!(f, " on {sector_count} of 12 headings")?,
        }
        match self.evidence {
            AccuracyEvidence::Reference => Ok(()),
            AccuracyEvidence::BodyRates => f.write_str(" by the body rates"),
            AccuracyEvidence::FieldScatter => f.write_str(" by the scatter of the field"),
        }
    }
}

impl fmt::Display for UnknownError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FewRows { row_counts, slow_attitude_s } => {
                let RowCounts { readings, used, .. } = row_counts;
                write!(f, "of {readings} readings {used} are usable")?;
                row_counts.rejection_texts().iter().try_for_each(|text| write!(f, ", {text}"))?;
                slow_attitude_s.map_or(Ok(()), |interval_s| {
                    write!(
                        f,
                        "; its attitude is logged {:.1} times a second: raise the stream rate to 5 Hz or more, or take the \
                         log of the SD card",
                        1.0 / interval_s
                    )
                })
            }
            Self::FewHeadings(sector_count) => {
                write!(f, "it was flown on {sector_count} of 12 headings: turn all the way round")
            }
            Self::ContradictsModel { strength_ratio, inclination_deg, model_inclination_deg } => write!(
                f,
                "as logged its field is {strength_ratio:.1} times as strong as the Earth's and dips by {inclination_deg:.0} deg, \
                 by the field model {model_inclination_deg:.0}: correct its orientation, then calibrate it"
            ),
            Self::FieldScatters(deg) => write!(
                f,
                "its field scatters by {deg:.0} deg of heading, and no body rates or reference heading tell whether by iron \
                 or by attitude errors: log at 10 Hz or more"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use autoswing::earth::{Date, EarthField, Position};
    use nalgebra::Vector3;

    use super::*;
    use crate::replay::tests::{compass_of_flown_turns, evaluation_of_compasses};

    /// Nine seconds of straight flight determine no error; a field that is not the Earth's is wrong on any heading. Gain
    /// alone turns no heading, and a table may have another unit.
    #[test]
    fn on_one_heading_only_a_field_unlike_the_earths_is_judged() {
        for (name, log_format, factors, code) in [
            ("as flown", LogFormat::DataFlash, [1.0_f32, 1.0, 1.0], "few-headings"),
            ("upside down", LogFormat::DataFlash, [1.0, -1.0, -1.0], "field-contradicts-model"),
            ("a gain of 1.2", LogFormat::DataFlash, [1.2, 1.2, 1.2], "few-headings"),
            ("a gain of 2.5", LogFormat::DataFlash, [2.5, 2.5, 2.5], "field-contradicts-model"),
            ("another unit", LogFormat::Csv, [2.5, 2.5, 2.5], "few-headings"),
        ] {
            let (mut flight, mut compass) = compass_of_flown_turns();
            flight.log_format = log_format;
            for (index, row) in compass.rows.iter_mut().enumerate() {
                row.is_usable &= index < 90;
                row.logged_field.ut.component_mul_assign(&Vector3::from(factors));
            }
            let place = Position::new(48.0, 11.3, 500.0).unwrap();
            let earth = EarthField::from_model(place, Date::from_unix_s(1_767_484_800).unwrap()).unwrap();
            let evaluation =
                FlightEvaluation { earth_field: Some((earth, true)), ..evaluation_of_compasses(vec![compass]) };
            let unknown = logged_accuracy(&flight, &evaluation, &evaluation.compasses[0]).unwrap_err();
            assert_eq!(unknown.stable_code(), code, "{name}: {unknown}");
        }
    }

    /// The rate and what to do.
    #[test]
    fn a_slow_attitude_is_the_reason_of_too_few_rows() {
        let row_counts = RowCounts { readings: 59, without_attitude: 59, ..RowCounts::default() };
        let text = UnknownError::FewRows { row_counts, slow_attitude_s: Some(1.0) }.to_string();
        let expected = "of 59 readings 0 are usable, 59 without an attitude near it; its attitude is logged 1.0 times a second: \
                        raise the stream rate to 5 Hz or more, or take the log of the SD card";
        assert_eq!(text, expected);
    }
}
