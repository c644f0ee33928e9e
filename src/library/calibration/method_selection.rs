//! Selection of the calibration method from the samples.
//!
//! | samples | method | unobservable |
//! |---|---|---|
//! | left and right turns | maximum likelihood | nothing |
//! | turns of one side and level flight | maximum likelihood, less accurate | nothing |
//! | level flight, on request | level ellipse | vertical response, mounting |
//! | given headings | compass swing | vertical response, on level ground |
//! | arbitrary attitudes | maximum likelihood | nothing |
//! | tumbling without attitude | ellipsoid | mounting |
//!
//! The turns procedure never falls back to the level ellipse, whose mounting error is not in its expected error and was
//! up to eight times as large.

use crate::calibration::closed_form::turns::MIN_SAMPLES;
use crate::calibration::types::quality::{Method, SolveError};
use crate::calibration::types::samples::{CollectionPart, Samples};

/// Procedure by which samples are collected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Procedure {
    /// Any flight: the most informative samples of all attitudes.
    #[default]
    Flight,
    /// Left and right turns, and the level flight between them.
    Turns,
    /// Level flight on several headings.
    Level,
    /// Samples on given headings.
    Swing,
    /// All attitudes, without an attitude source.
    Tumble,
}

impl Procedure {
    /// All procedures, in the order of display and of their numbers.
    pub const ALL_PROCEDURES: [Self; 5] = [Self::Flight, Self::Turns, Self::Level, Self::Swing, Self::Tumble];

    /// Name typed after `cal start`.
    #[must_use]
    pub const fn procedure_name(self) -> &'static str {
        match self {
            Self::Flight => "flight",
            Self::Turns => "turns",
            Self::Level => "level",
            Self::Swing => "swing",
            Self::Tumble => "tumble",
        }
    }
}

/// The samples used in a solve: parts with enough samples, all of arbitrary attitude and all with given headings.
#[must_use]
pub fn select_samples(samples: Samples<'_>) -> Samples<'_> {
    [CollectionPart::LEFT, CollectionPart::RIGHT, CollectionPart::LEVEL]
        .into_iter()
        .filter(|&part| !has_enough(samples, part))
        .fold(samples, Samples::without_part)
}

fn has_enough(samples: Samples<'_>, part: CollectionPart) -> bool {
    count_of_part(samples, part) >= MIN_SAMPLES
}

fn count_of_part(samples: Samples<'_>, part: CollectionPart) -> usize {
    samples.samples_of_part(part).iter().count()
}

/// Selects the method that the samples support.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`] with the missing part.
pub fn select_method(samples: Samples<'_>, procedure: Procedure) -> Result<Method, SolveError> {
    match procedure {
        Procedure::Level => Ok(Method::Level),
        Procedure::Swing => Ok(Method::CompassSwing),
        Procedure::Tumble => Ok(Method::Ellipsoid),
        Procedure::Flight => Ok(Method::MaximumLikelihood),
        Procedure::Turns => {
            let has_enough = |part| has_enough(samples, part);
            let mut missing_turns = CollectionPart::TURNS.into_iter().filter(|part| !has_enough(*part));
            match (missing_turns.next(), missing_turns.next()) {
                (Some(part), other) if other.is_some() || !has_enough(CollectionPart::LEVEL) => {
                    Err(SolveError::too_few(part, count_of_part(samples, part), MIN_SAMPLES))
                }
                _ => Ok(Method::MaximumLikelihood),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::tests::synthetic::{Airframe, Parts, exact_circle};
    use crate::calibration::{CollectionPart, HeadingMark, Sample};

    fn circle_samples(sample_count: u16) -> Vec<Sample> {
        exact_circle(&Airframe::with_hard_iron([0.0; 3]), 0.0, sample_count)
    }

    fn selected_method(left: u16, right: u16, level: u16) -> Result<Method, SolveError> {
        let (left, right, level) = (circle_samples(left), circle_samples(right), circle_samples(level));
        let samples = Parts { left: &left, right: &right, level: &level, ..Parts::default() }.samples();
        select_method(samples, Procedure::Turns)
    }

    #[test]
    fn turns_select_maximum_likelihood_or_report_missing_samples() {
        let missing = |part, have| Err(SolveError::TooFewSamples { part, have, need: 12 });
        for (left, right, level, expected) in [
            (12, 12, 0, Ok(Method::MaximumLikelihood)),
            (12, 12, 40, Ok(Method::MaximumLikelihood)),
            (12, 0, 12, Ok(Method::MaximumLikelihood)),
            (0, 12, 12, Ok(Method::MaximumLikelihood)),
            (12, 11, 11, missing(CollectionPart::RIGHT, 11)),
            (11, 12, 11, missing(CollectionPart::LEFT, 11)),
            (11, 12, 0, missing(CollectionPart::LEFT, 11)),
            (11, 11, 12, missing(CollectionPart::LEFT, 11)),
            (0, 0, 64, missing(CollectionPart::LEFT, 0)),
            (11, 11, 11, missing(CollectionPart::LEFT, 11)),
            (0, 0, 0, missing(CollectionPart::LEFT, 0)),
            (3, 0, 0, missing(CollectionPart::LEFT, 3)),
        ] {
            assert_eq!(selected_method(left, right, level), expected, "{left} {right} {level}");
        }
    }

    #[test]
    fn every_other_procedure_has_one_method() {
        for (procedure, method) in [
            (Procedure::Flight, Method::MaximumLikelihood),
            (Procedure::Level, Method::Level),
            (Procedure::Swing, Method::CompassSwing),
            (Procedure::Tumble, Method::Ellipsoid),
        ] {
            assert_eq!(select_method(Samples::default(), procedure), Ok(method));
        }
    }

    #[test]
    fn small_parts_are_omitted() {
        let parts = [0, 11, 12].map(circle_samples);
        let marks = [HeadingMark { sample: circle_samples(1)[0], heading_rad: 0.0 }];
        for (counts, expected) in
            [([2, 2, 2], [12, 12, 12]), ([2, 1, 2], [12, 0, 12]), ([1, 2, 0], [0, 12, 0]), ([2, 2, 1], [12, 12, 0])]
        {
            let [left, right, level] = counts.map(|part: usize| &parts[part][..]);
            let all = Parts { left, right, level, free: &parts[1], marks: &marks }.samples();
            let selected = select_samples(all);
            assert_eq!(selected.marks, marks);
            let [left, right, level, free] = CollectionPart::ALL_PARTS.map(|part| count_of_part(selected, part));
            assert_eq!(([left, right, level], free), (expected, 11), "{counts:?}");
            assert_eq!(selected.iter().count(), left + right + level + free);
        }
    }
}
