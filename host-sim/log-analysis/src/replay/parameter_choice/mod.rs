//! Chooses the parameters for a compass: scored as the autopilot applies them, on rows that were held back from the
//! fit, and given only if they improve the compass.

use std::fmt;

mod orientation_proof;

pub use orientation_proof::provable_orientation;

use autoswing::calibration::{Calibration, Solution};

use super::evaluation::{CompassEvaluation, FlightEvaluation};
use super::parameter_export::orientation::{FixedOrientation, OrientationParameters, TurnedSensor};
use super::parameter_export::{
    CorrectedTerms, ExportInputs, ExportedCorrection, HeldBackScore, ParameterFormat, field_by_exported_parameters,
    may_compensate_current,
};
use super::parameter_fit::{CompassFit, half_index_at};
use super::reading_checks::{CheckOutcome, CheckedMeaning, ReadingCheck};
use super::row_headings::{heading_scatter, rms_deg_by_scatter, score_field};
use super::row_solve::{is_determined, solved_correction};
use crate::log::{FieldCorrection, LoggedFlight};
use crate::numbers::square;
use crate::replay::reference::ReferenceHeading;
use crate::replay::row::{ReplayRow, heading_deg};
use crate::score::{BAD_COMPASS_RMS_DEG, GOOD_COMPASS_RMS_DEG};

/// Smallest number of rows since the last change for a fit: 10 s at 10 Hz.
const MIN_ROWS: usize = 100;

/// Minimum number of rows with a reference heading for a judgement of the compass.
const MIN_REFERENCE_ROWS: usize = 50;

/// Smallest improvement over the parameters in use that makes new ones worth loading, degrees RMS.
const MIN_GAIN_DEG: f64 = 0.3;
/// Smallest such improvement as a fraction of the error as logged.
const MIN_RELATIVE_GAIN: f64 = 0.2;

/// Expected error from which on the flight determines no calibration, and its residuals no cause, degrees RMS.
const UNDETERMINED_ERROR_DEG: f64 = 30.0;

/// Manoeuvre of a vehicle that does not bank into its turns, in place of a circle.
const TILTS_TEXT: &str = "tilts by 15 deg ahead, back, left and right on all headings";

/// Reason for giving no parameters; displayed as a clause.
#[derive(Clone, Debug, PartialEq)]
pub enum NoParameters {
    /// The data contradict the reading of the log, or do not confirm it.
    UnprovenReading(ReadingCheck),
    /// The log has too few usable rows; their number.
    FewRows(usize),
    /// The rows, or half of them, give no solution.
    Unsolved,
    /// The sensor is turned against its orientation, which the file does not change.
    Turned(TurnedSensor),
    /// The flight leaves the parameters too uncertain.
    Unobservable {
        /// Expected error over all headings, degrees RMS.
        expected_error_deg: f64,
        /// Manoeuvre that the flight lacks most.
        manoeuvre: Option<String>,
    },
    /// The Earth's field is so steep there that its horizontal part is weak.
    WeakHorizontalField {
        /// Inclination by the fit, degrees.
        inclination_deg: f64,
        /// Horizontal part of the field, microtesla.
        horizontal_ut: f64,
    },
    /// Residuals that the fit does not explain leave the parameters too uncertain.
    Residuals {
        /// Expected error over all headings, degrees RMS.
        expected_error_deg: f64,
        /// Quantity that the residuals depend on.
        dependence: ResidualDependence,
    },
    /// The module's verification rejects the fit, and there is no reference to judge it by.
    Unverified,
    /// The parameters in use are as good; errors on held-back rows.
    NoGain(HeldBackScore),
    /// No parameters reach a useful accuracy.
    Inaccurate {
        /// Error on held-back rows.
        held_back: HeldBackScore,
        /// Part of the expected error that the autopilot's parameters cannot express, degrees RMS.
        inexpressible_error_deg: f64,
    },
    /// The autopilot rejects offsets of this size.
    OffsetsTooLarge {
        /// Largest offset component of the parameters, milligauss.
        offset_mg: f64,
        /// Limit of the offset, milligauss.
        limit_mg: f64,
    },
}

/// Quantity that residuals of a fit depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResidualDependence {
    /// The residuals depend on time.
    Time,
    /// The residuals depend on bank.
    Bank,
}

/// Parameters of a compass, or the reason for giving none. `orientation` is that of the parameters that a file may change.
pub fn choose_parameters(
    flight: &LoggedFlight,
    evaluation: &FlightEvaluation,
    compass: &CompassEvaluation,
    format: ParameterFormat,
    orientation: Result<OrientationParameters, FixedOrientation>,
) -> Result<ExportedCorrection, NoParameters> {
    let CompassEvaluation { compass_number, parameter_fit, .. } = compass;
    let rows: Vec<ReplayRow> = parameter_fit.fitted_rows(&compass.rows).copied().collect();
    if rows.len() < MIN_ROWS {
        return Err(NoParameters::FewRows(rows.len()));
    }
    let sigma_deg = evaluation.reference.as_ref().and_then(ReferenceHeading::sigma_if_accurate_deg);
    let sigma_deg =
        sigma_deg.filter(|_| rows.iter().filter(|row| row.reference_deg.is_some()).count() >= MIN_REFERENCE_ROWS);
    let inputs = ExportInputs {
        compass_number: *compass_number,
        rows: &rows,
        total_ut: evaluation.earth_total_ut(),
        format,
        orientation,
        terms: CorrectedTerms::All,
    };
    let fit = parameter_fit.fit.as_ref().ok_or(NoParameters::Unsolved)?;
    let fit = if fit.has_motor_current() && !may_compensate_current(flight, *compass_number, format) {
        &fit.without_current(&rows).ok_or(NoParameters::Unsolved)?
    } else {
        fit
    };
    check_certainty(flight, &fit.solution)?;
    let halves = fit.fits_of_halves(&rows);
    let candidate_with = |inputs: &ExportInputs<'_>| {
        ParameterCandidate::new(flight, inputs, fit, &halves, sigma_deg.is_some()).ok_or(NoParameters::Unsolved)
    };
    let mut candidate = candidate_with(&inputs)?;
    candidate.check_usefulness(sigma_deg)?;
    let terms = evaluation.corrected_terms;
    let fewer_terms = if terms == CorrectedTerms::All { CorrectedTerms::Offsets } else { terms };
    let by_offsets = candidate_with(&ExportInputs { terms: fewer_terms, ..inputs })?;
    let rms_by_terms_deg = [&candidate, &by_offsets].map(|of| of.held_back.rms_deg);
    if terms != CorrectedTerms::All {
        candidate = by_offsets;
        if !candidate.is_improvement() {
            return Err(NoParameters::NoGain(candidate.held_back));
        }
    }
    let ParameterCandidate { mut exported, held_back, turned, .. } = candidate;
    if let Some(limit_mg) = exported.offset_limit_mg_if_exceeded(flight, format) {
        return Err(NoParameters::OffsetsTooLarge { offset_mg: exported.largest_offset_mg(), limit_mg });
    }
    exported.held_back_score = Some(held_back);
    exported.rms_by_terms_deg = Some(rms_by_terms_deg);
    exported.fitted_range_s = parameter_fit.fitted_range_s;
    exported.warnings.extend(turned.map(|turned| turned.to_string()));
    Ok(exported)
}

struct ParameterCandidate {
    solution: Solution,
    is_accepted: bool,
    exported: ExportedCorrection,
    held_back: HeldBackScore,
    /// A rotation of the sensor that the parameters do not express.
    turned: Option<TurnedSensor>,
}

impl ParameterCandidate {
    /// Exports a fit, and scores its halves with an orientation of the same kind.
    fn new(
        flight: &LoggedFlight,
        inputs: &ExportInputs<'_>,
        fit: &CompassFit,
        halves: &[Option<Solution>; 2],
        has_reference: bool,
    ) -> Option<Self> {
        let solution = fit.solution;
        let (kind, exported) = inputs.export_simplest(&solution.calibration)?;
        let halves = [halves[0].as_ref()?, halves[1].as_ref()?];
        let [Some(first), Some(second)] = halves.map(|half| inputs.export_correction(&half.calibration, kind)) else {
            return None;
        };
        let full_corrections = halves.map(solved_correction);
        let held_back = score_held_back(flight, inputs, &[first, second], &full_corrections, has_reference)?;
        let turned = inputs.lost_rotation(&solution.calibration, kind, &exported);
        Some(Self { solution, is_accepted: fit.is_accepted, exported, held_back, turned })
    }

    /// Checks the usefulness; a rotation that causes most of the error, or that no heading can be meant with, is the reason.
    fn check_usefulness(&self, reference_sigma_deg: Option<f64>) -> Result<(), NoParameters> {
        /// A symmetric matrix imitates no rotation beyond it.
        const MAX_ROTATION_LOSS_DEG: f64 = 20.0;
        let accuracy = self.check_accuracy(reference_sigma_deg);
        let is_bad = match accuracy {
            Err(NoParameters::NoGain(_)) => self.held_back.as_logged_rms_deg > BAD_COMPASS_RMS_DEG,
            Err(NoParameters::Inaccurate { .. }) => true,
            _ => false,
        };
        let is_cause = is_bad && is_mostly_inexpressible(self.held_back.rms_deg, self.exported.heading_loss_deg[0]);
        let turned =
            self.turned.as_ref().filter(|_| is_cause || self.exported.total_loss_deg() > MAX_ROTATION_LOSS_DEG);
        turned.map_or(accuracy, |turned| Err(NoParameters::Turned(turned.clone())))
    }

    /// Whether the error is smaller than that as logged by enough to be worth loading.
    fn is_improvement(&self) -> bool {
        let HeldBackScore { rms_deg, as_logged_rms_deg, .. } = self.held_back;
        as_logged_rms_deg - rms_deg >= MIN_GAIN_DEG && rms_deg <= (1.0 - MIN_RELATIVE_GAIN) * as_logged_rms_deg
    }

    fn check_accuracy(&self, reference_sigma_deg: Option<f64>) -> Result<(), NoParameters> {
        let rms_deg = self.held_back.rms_deg;
        let unexplained_deg = (square(rms_deg) - square(self.exported.heading_loss_deg[0])).max(0.0).sqrt();
        let weak_field = weak_horizontal_field(&self.solution.calibration);
        if let Some(weak_field) = weak_field.filter(|_| rms_deg > GOOD_COMPASS_RMS_DEG) {
            Err(weak_field)
        } else if !self.is_improvement() {
            Err(NoParameters::NoGain(self.held_back))
        } else if rms_deg > GOOD_COMPASS_RMS_DEG
            && (rms_deg > BAD_COMPASS_RMS_DEG || unexplained_deg > GOOD_COMPASS_RMS_DEG)
        {
            Err(NoParameters::Inaccurate {
                held_back: self.held_back,
                inexpressible_error_deg: self.exported.heading_loss_deg[0],
            })
        } else if reference_sigma_deg.is_none() && !self.is_accepted {
            Err(NoParameters::Unverified)
        } else {
            Ok(())
        }
    }
}

/// Checks that the flight determines the fit.
fn check_certainty(flight: &LoggedFlight, solution: &Solution) -> Result<(), NoParameters> {
    if is_determined(solution) {
        return Ok(());
    }
    let expected_error_deg = f64::from(solution.quality.expected_rms_deg);
    let cause = || {
        let residuals = |dependence| NoParameters::Residuals { expected_error_deg, dependence };
        weak_horizontal_field(&solution.calibration).or_else(|| residual_dependence(solution).map(residuals))
    };
    let cause = if expected_error_deg < UNDETERMINED_ERROR_DEG { cause() } else { None };
    Err(cause.unwrap_or_else(|| NoParameters::Unobservable {
        expected_error_deg,
        manoeuvre: solution.advice.map(|advice| match advice.manoeuvre {
            manoeuvre if manoeuvre.needs_bank() && !flight.banks_into_turns() => TILTS_TEXT.to_owned(),
            manoeuvre => manoeuvre.to_string(),
        }),
    }))
}

/// Names a horizontal field of less than a sixth of the field, where an error of the field of 1 % bends headings by over 3
/// deg.
fn weak_horizontal_field(calibration: &Calibration) -> Option<NoParameters> {
    const MIN_WEAK_INCLINATION_DEG: f64 = 80.0;
    let inclination_deg = f64::from(calibration.inclination_rad.to_degrees());
    let horizontal_ut = f64::from(calibration.total_ut) * libm::cos(inclination_deg.to_radians());
    (inclination_deg.abs() > MIN_WEAK_INCLINATION_DEG)
        .then_some(NoParameters::WeakHorizontalField { inclination_deg, horizontal_ut })
}

/// Quantity on which residuals depend that make up most of the expected error.
fn residual_dependence(solution: &Solution) -> Option<ResidualDependence> {
    let expected_error_deg = f64::from(solution.quality.expected_rms_deg);
    let is_major_part = |added_deg: f32| square(added_deg.into()) > 0.5 * square(expected_error_deg);
    let by_time = solution.hard_iron_change.filter(|finding| is_major_part(finding.added_error_deg));
    let by_bank = solution.bank_scale_error.filter(|finding| is_major_part(finding.added_error_deg));
    by_time.map(|_| ResidualDependence::Time).or(by_bank.map(|_| ResidualDependence::Bank))
}

/// Heading error of each half with the parameters fitted to the other half. Without a reference, it is the scatter with
/// the full correction, to which the heading difference between parameters and full correction is added in squares.
fn score_held_back(
    flight: &LoggedFlight,
    inputs: &ExportInputs<'_>,
    halves: &[ExportedCorrection; 2],
    full_corrections: &[FieldCorrection; 2],
    has_reference: bool,
) -> Option<HeldBackScore> {
    let ExportInputs { rows, format, .. } = *inputs;
    let [first, second] = halves.each_ref().map(|half| field_by_exported_parameters(flight, half, format));
    let full_field = |row: &ReplayRow| row.corrected_field(&full_corrections[1 - half_index_at(row.t_s)]);
    let field = |row: &ReplayRow| if half_index_at(row.t_s) == 0 { second(row) } else { first(row) };
    let logged = ReplayRow::logged_ut;
    let [rms_deg, as_logged_rms_deg] = if has_reference {
        [score_field(rows, field)?.rms_deg, score_field(rows, logged)?.rms_deg]
    } else {
        let lost_rows: Vec<ReplayRow> = rows
            .iter()
            .map(|row| ReplayRow { reference_deg: Some(heading_deg(row, full_field(row))), ..*row })
            .collect();
        let inexpressible_error_deg = score_field(&lost_rows, field)?.rms_deg;
        [libm::hypot(rms_deg_by_scatter(rows, &full_field), inexpressible_error_deg), rms_deg_by_scatter(rows, &logged)]
    };
    let [field_scatter_deg, _] = heading_scatter(rows, &full_field);
    let is_estimate = !has_reference;
    rms_deg.is_finite().then_some(HeldBackScore { rms_deg, as_logged_rms_deg, is_estimate, field_scatter_deg })
}

/// Whether the autopilot's parameters cannot express more than half of an error's mean square.
pub(super) fn is_mostly_inexpressible(rms_deg: f64, inexpressible_error_deg: f64) -> bool {
    square(inexpressible_error_deg) > 0.5 * square(rms_deg)
}

impl NoParameters {
    /// Stable code of the reason, for programs.
    pub const fn stable_code(&self) -> &'static str {
        match self {
            Self::UnprovenReading(check) => match check.outcome {
                CheckOutcome::Unchecked(_) if matches!(check.meaning, CheckedMeaning::Slot) => "slot-unknown",
                CheckOutcome::Unchecked(_) => "reading-unproven",
                _ => "reading-contradicted",
            },
            Self::FewRows(_) => "few-rows",
            Self::Unsolved => "unsolved",
            Self::Turned(_) => "turned",
            Self::Unobservable { .. } => "unobservable",
            Self::WeakHorizontalField { .. } => "weak-horizontal-field",
            Self::Residuals { .. } => "residuals",
            Self::Unverified => "unverified",
            Self::NoGain(_) => "no-gain",
            Self::Inaccurate { .. } => "inaccurate",
            Self::OffsetsTooLarge { .. } => "offsets-too-large",
        }
    }
}

impl fmt::Display for NoParameters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::UnprovenReading(check) => match check.outcome.finding() {
                Some(finding) => f.write_str(finding),
                None => Ok(()),
            },
            Self::FewRows(rows) => write!(f, "{rows} usable rows are too few for a fit"),
            Self::Unsolved => f.write_str("no fit of these rows converges"),
            Self::Turned(turned) => turned.fmt(f),
            Self::Unobservable { expected_error_deg, manoeuvre } => {
                if *expected_error_deg < UNDETERMINED_ERROR_DEG {
                    write!(f, "the attitudes flown leave an error of {expected_error_deg:.1} deg over all headings")?;
                } else {
                    f.write_str("the attitudes flown determine no calibration")?;
                }
                manoeuvre.as_ref().map_or(Ok(()), |manoeuvre| write!(f, "; missing most: {manoeuvre}"))
            }
            Self::WeakHorizontalField { inclination_deg, horizontal_ut } => write!(
                f,
                "the horizontal field is only {horizontal_ut:.1} uT there, at an inclination of {inclination_deg:.0} deg: errors \
                 of the field and of the attitude bend headings too much"
            ),
            Self::Unverified => f.write_str("the fit fails the module's verification, and no reference confirms it"),
            Self::NoGain(HeldBackScore { as_logged_rms_deg, is_estimate: true, .. }) => {
                write!(f, "its field is consistent to {as_logged_rms_deg:.1} deg as logged, and no fit is better")
            }
            Self::NoGain(HeldBackScore { rms_deg, .. }) => {
                write!(f, "a fit is no better: {rms_deg:.1} deg RMS")
            }
            Self::Inaccurate { held_back: HeldBackScore { rms_deg, .. }, inexpressible_error_deg } => {
                write!(
                    f,
                    "the best parameters leave {rms_deg:.1} deg RMS, too much to be loaded \
                     ({GOOD_COMPASS_RMS_DEG:.0} deg)"
                )?;
                if is_mostly_inexpressible(*rms_deg, *inexpressible_error_deg) {
                    write!(f, ", {inexpressible_error_deg:.1} of it because the autopilot's matrix is symmetric")?;
                }
                Ok(())
            }
            Self::Residuals { expected_error_deg, dependence } => {
                let depends = match dependence {
                    ResidualDependence::Time => {
                        "the field late in the flight does not fit that early in it, as when iron moves"
                    }
                    ResidualDependence::Bank => {
                        "the field in steep banks does not fit that in shallow ones, as when the logged bank is wrong or iron moves with it"
                    }
                };
                write!(f, "{depends}, which leaves an error of {expected_error_deg:.1} deg over all headings")
            }
            Self::OffsetsTooLarge { offset_mg, limit_mg } => {
                write!(f, "an offset of {offset_mg:.0} mG exceeds COMPASS_OFFS_MAX, {limit_mg:.0}")
            }
        }
    }
}

#[cfg(test)]
mod tests;
