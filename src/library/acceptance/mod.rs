//! Acceptance test: whether a candidate calibration may replace the active one. A pure function, shared by firmware,
//! replay and accuracy studies.
//!
//! The first rejection that applies, in this order:
//!
//! | code | reason |
//! |---|---|
//! | `too-few-held-back` | too few held-back samples for verification |
//! | `iron-changed` | hard iron changed during the collection, and dominates the expected error |
//! | `attitude-contradicted` | bank-angle scale error of the attitude source, expected heading error too large |
//! | `not-accurate` | expected heading error too large |
//! | `unobservable` | free flight without tilt, or too little of it |
//! | `not-better` | no better than the active calibration on held-back samples |
//! | `thinner` | less information than behind the active calibration, which the samples do not contradict |

use core::fmt;

use crate::calibration::verification::{self, HeldBackScores};
use crate::calibration::{
    BankScaleFinding, Calibration, CollectionPart, DetectedHardIronChange, Finding, Method, Orientation, Quality,
    Samples, Solution, UnobservableQuantities,
};
use crate::decimal::Decimal;

/// Largest expected heading error, degrees RMS: about that of an uncalibrated compass in a clean airframe.
const MAX_EXPECTED_RMS_DEG: f32 = 3.0;

/// Largest ratio of the error from a hard-iron change to all other errors.
const MAX_HARD_IRON_ERROR_RATIO: f32 = 2.5;

/// Significance from which a bank-angle scale error is certain, sigma.
const CERTAIN_BANK_SCALE_SIGMAS: f32 = 3.5;

/// Minimum number of held-back samples in each part of the collection that is verified: one in most heading sectors.
pub const MIN_HELD_BACK_SAMPLES: u16 = 8;

/// Factor on the active calibration's expected error, above which a candidate is less informative.
const MAX_EXPECTED_ERROR_RATIO: f32 = 1.5;

/// Ratio of scores above which a less informative candidate is accepted: the airframe's iron has then changed, and the
/// active calibration is wrong.
const CONTRADICTING_SCORE_RATIO: f32 = 3.0;

/// Samples on which the decision is based.
#[derive(Clone, Copy, Debug)]
pub struct AcceptanceSamples<'a> {
    /// Samples used by the fit.
    pub fit_samples: Samples<'a>,
    /// Held-back samples of the same parts.
    pub held_back_samples: Samples<'a>,
    /// Whether the samples' attitudes are known.
    pub is_attitude_known: bool,
}

/// Calibration that a candidate would replace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Incumbent {
    /// Active calibration, or the mounting rotation alone ([`Calibration::uncalibrated`]).
    pub calibration: Calibration,
    /// Quality of the active calibration, if there is one.
    pub quality: Option<Quality>,
}

impl Incumbent {
    /// No active calibration: the mounting rotation alone.
    #[must_use]
    pub fn uncalibrated(mount: Orientation) -> Self {
        Self { calibration: Calibration::uncalibrated(mount), quality: None }
    }
}

/// Reason to reject a candidate calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rejection {
    /// Too few held-back samples of a part.
    TooFewHeldBack {
        /// Held-back samples of the part with the fewest.
        have: u16,
        /// Required number of held-back samples.
        need: u16,
    },
    /// Hard iron changed during the collection.
    IronChanged(DetectedHardIronChange),
    /// The attitude source has a bank-angle scale error.
    AttitudeContradicted {
        /// Ratio of reported to actual bank.
        reported_bank_ratio: f32,
        /// Expected heading error, degrees RMS.
        expected_rms_deg: f32,
    },
    /// The expected heading error is too large.
    NotAccurate {
        /// Expected heading error, degrees RMS.
        expected_rms_deg: f32,
    },
    /// The vehicle tilted too little to determine the coefficients.
    Unobservable,
    /// No better than the active calibration on held-back samples.
    NotBetter {
        /// Score of the candidate; smaller is better.
        candidate_score: f32,
        /// Score of the active calibration.
        incumbent_score: f32,
    },
    /// Less information than the active calibration, without contradicting it.
    LessInformative {
        /// Expected heading error of the candidate, degrees RMS.
        expected_rms_deg: f32,
        /// Expected heading error of the active calibration, degrees RMS.
        incumbent_rms_deg: f32,
    },
}

/// Tests a candidate; returns the scores on held-back samples if it is accepted.
///
/// # Errors
///
/// The first [`Rejection`] that applies, in the order of declaration.
pub fn evaluate_candidate(
    candidate: &Solution,
    samples: AcceptanceSamples<'_>,
    incumbent: &Incumbent,
) -> Result<HeldBackScores, Rejection> {
    check_held_back_count(&samples)?;
    check_iron_change(candidate)?;
    check_accuracy(candidate)?;
    check_observability(candidate, &samples)?;
    let scores = check_held_back_scores(candidate, &samples, incumbent)?;
    if let Some(quality) = &incumbent.quality {
        check_information(candidate, quality, scores)?;
    }
    Ok(scores)
}

fn check_held_back_count(samples: &AcceptanceSamples<'_>) -> Result<(), Rejection> {
    let (have, need) = (fewest_held_back(samples), MIN_HELD_BACK_SAMPLES);
    if have < need { Err(Rejection::TooFewHeldBack { have, need }) } else { Ok(()) }
}

/// Smallest number of held-back samples among the parts used, but for level flight beside turns to both sides, whose
/// length is free. Marks of a compass swing are never held back; samples between marks are.
fn fewest_held_back(samples: &AcceptanceSamples<'_>) -> u16 {
    let AcceptanceSamples { fit_samples, held_back_samples, .. } = samples;
    let is_used = |part: CollectionPart| fit_samples.samples_of_part(part).iter().next().is_some();
    let has_both_turns = CollectionPart::TURNS.into_iter().all(is_used);
    CollectionPart::ALL_PARTS
        .into_iter()
        .filter(|&part| is_used(part) && !(has_both_turns && part == CollectionPart::LEVEL))
        .map(|part| u16::try_from(held_back_samples.samples_of_part(part).iter().count()).unwrap_or(u16::MAX))
        .min()
        .unwrap_or(0)
}

/// Small hard-iron changes are included in the expected error. Rejects a change that dominates it, or that comes with
/// too large an expected error.
fn check_iron_change(candidate: &Solution) -> Result<(), Rejection> {
    let Some(Finding { violation: change, added_error_deg: error_deg, error_without_violation_deg: error_without_deg }) =
        candidate.hard_iron_change
    else {
        return Ok(());
    };
    let is_dominant = error_deg > MAX_HARD_IRON_ERROR_RATIO * error_without_deg;
    if is_dominant || check_accuracy(candidate).is_err() {
        return Err(Rejection::IronChanged(change));
    }
    Ok(())
}

/// Rejects free flight without tilt: of calibrations from yaw turns in hover, whose tilt keeps its direction over the
/// ground, 30 % had more than three times the expected error. Ground procedures have no free samples.
fn check_observability(candidate: &Solution, samples: &AcceptanceSamples<'_>) -> Result<(), Rejection> {
    let rests_on_priors =
        candidate.advice.as_ref().is_some_and(|advice| advice.unobservable != UnobservableQuantities::default());
    let is_undetermined = rests_on_priors || !candidate.quality.determines_all_coefficients();
    let is_free_flight =
        candidate.quality.method == Method::MaximumLikelihood && samples.fit_samples.has_free_flight_samples();
    if is_free_flight && is_undetermined { Err(Rejection::Unobservable) } else { Ok(()) }
}

/// Tests the expected error, which includes a detected bank-angle scale error. If only that makes it too large, a
/// certain scale error is the rejection reason, and a suspected one is ignored: good sources show it by chance.
fn check_accuracy(candidate: &Solution) -> Result<(), Rejection> {
    let expected_rms_deg = candidate.quality.expected_rms_deg;
    match (check_expected_error(expected_rms_deg), &candidate.bank_scale_error) {
        (
            Err(_),
            Some(Finding {
                violation: BankScaleFinding { reported_bank_ratio: read, significance_sigmas: sigmas },
                error_without_violation_deg: error_without_deg,
                ..
            }),
        ) => {
            check_expected_error(*error_without_deg)?;
            if *sigmas > CERTAIN_BANK_SCALE_SIGMAS {
                return Err(Rejection::AttitudeContradicted { reported_bank_ratio: *read, expected_rms_deg });
            }
            Ok(())
        }
        (judgement, _) => judgement,
    }
}

fn check_expected_error(expected_rms_deg: f32) -> Result<(), Rejection> {
    // The comparison rejects NaN.
    if expected_rms_deg <= MAX_EXPECTED_RMS_DEG { Ok(()) } else { Err(Rejection::NotAccurate { expected_rms_deg }) }
}

fn check_held_back_scores(
    candidate: &Solution,
    samples: &AcceptanceSamples<'_>,
    incumbent: &Incumbent,
) -> Result<HeldBackScores, Rejection> {
    let scores = verification::score_held_back(
        samples.held_back_samples,
        samples.is_attitude_known,
        &candidate.calibration,
        &incumbent.calibration,
    );
    if scores.candidate_score < scores.active_score {
        Ok(scores)
    } else {
        Err(Rejection::NotBetter { candidate_score: scores.candidate_score, incumbent_score: scores.active_score })
    }
}

/// Rejects a candidate with less information than the active calibration, unless the held-back samples contradict the
/// latter. An attitude source with a bank-angle scale error contradicts it without cause.
fn check_information(
    candidate: &Solution,
    incumbent_quality: &Quality,
    scores: HeldBackScores,
) -> Result<(), Rejection> {
    let candidate_quality = &candidate.quality;
    let thinner = candidate_quality.expected_rms_deg > MAX_EXPECTED_ERROR_RATIO * incumbent_quality.expected_rms_deg
        || (incumbent_quality.determines_all_coefficients() && !candidate_quality.determines_all_coefficients());
    let contradicted = scores.active_score > CONTRADICTING_SCORE_RATIO * scores.candidate_score
        && candidate.bank_scale_error.is_none();
    if thinner && !contradicted {
        let (expected_rms_deg, incumbent_rms_deg) =
            (candidate_quality.expected_rms_deg, incumbent_quality.expected_rms_deg);
        return Err(Rejection::LessInformative { expected_rms_deg, incumbent_rms_deg });
    }
    Ok(())
}

/// One clause, for people.
impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::TooFewHeldBack { have, need } => {
                write!(f, "{have} of {need} samples to verify with on the side with fewer")
            }
            Self::IronChanged(change) => change.fmt(f),
            Self::Unobservable => f.write_str("turns without tilt do not determine a calibration"),
            Self::AttitudeContradicted { reported_bank_ratio: read, expected_rms_deg } => {
                let (percent, expected) = (Decimal::<0>(100.0 * read), Decimal::<1>(expected_rms_deg));
                write!(f, "the attitude source seems to read {percent} % of the bank, which costs {expected} deg")
            }
            Self::NotAccurate { expected_rms_deg } => {
                write!(f, "expected error {} deg", Decimal::<1>(expected_rms_deg))
            }
            Self::NotBetter { candidate_score: candidate, incumbent_score: incumbent } => {
                let (candidate, incumbent) = (Decimal::<2>(candidate), Decimal::<2>(incumbent));
                write!(f, "score {candidate} against {incumbent} of the active calibration")
            }
            Self::LessInformative { expected_rms_deg, incumbent_rms_deg } => {
                let (candidate_deg, incumbent_deg) = (Decimal::<1>(expected_rms_deg), Decimal::<1>(incumbent_rms_deg));
                write!(f, "expected error {candidate_deg} deg against {incumbent_deg} deg of the active calibration")
            }
        }
    }
}

impl core::error::Error for Rejection {}

#[cfg(test)]
mod tests;
