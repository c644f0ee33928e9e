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
use crate::calibration::types::error::SolveError;
use crate::calibration::types::method::Method;
use crate::calibration::types::samples::{CollectionPart, SamplePart, Samples, Side};

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

    /// Parses a procedure name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL_PROCEDURES.into_iter().find(|procedure| procedure.procedure_name() == name)
    }
}

/// Parts of the samples used in a solve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SelectedParts {
    left: bool,
    right: bool,
    level: bool,
}

impl SelectedParts {
    /// Selects parts with enough samples. Omits level flight if both turns exist: it may contain samples taken near
    /// other iron while taxiing.
    #[must_use]
    pub fn new(samples: Samples<'_>, procedure: Procedure) -> Self {
        let has_enough = |part: &[_]| part.len() >= MIN_SAMPLES;
        let (left, right) =
            (has_enough(samples.samples_of_turn(Side::Left)), has_enough(samples.samples_of_turn(Side::Right)));
        let has_both_turns = procedure == Procedure::Turns && left && right;
        Self { left, right, level: has_enough(samples.samples_of_part(CollectionPart::LEVEL)) && !has_both_turns }
    }

    /// Returns the selected parts, all samples of arbitrary attitude, and all with given headings.
    #[must_use]
    pub fn select_samples<'a>(&self, samples: Samples<'a>) -> Samples<'a> {
        let parts = [
            (CollectionPart::LEFT, self.left),
            (CollectionPart::RIGHT, self.right),
            (CollectionPart::LEVEL, self.level),
        ];
        parts
            .into_iter()
            .filter(|(_, is_selected)| !is_selected)
            .fold(samples, |remaining, (part, _)| remaining.without_part(part))
    }
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
            let SelectedParts { left, right, .. } = SelectedParts::new(samples, procedure);
            let level = samples.samples_of_part(CollectionPart::LEVEL).len() >= MIN_SAMPLES;
            let missing = |side| {
                Err(SolveError::too_few(SamplePart::Turns(side), samples.samples_of_turn(side).len(), MIN_SAMPLES))
            };
            match (left, right, level) {
                (true, true, _) | (true, false, true) | (false, true, true) => Ok(Method::MaximumLikelihood),
                (true, false, false) => missing(Side::Right),
                (false, _, _) => missing(Side::Left),
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
        let missing = |side, have| Err(SolveError::TooFewSamples { part: SamplePart::Turns(side), have, need: 12 });
        for (left, right, level, expected) in [
            (12, 12, 0, Ok(Method::MaximumLikelihood)),
            (12, 12, 40, Ok(Method::MaximumLikelihood)),
            (12, 0, 12, Ok(Method::MaximumLikelihood)),
            (0, 12, 12, Ok(Method::MaximumLikelihood)),
            (12, 11, 11, missing(Side::Right, 11)),
            (11, 12, 11, missing(Side::Left, 11)),
            (11, 12, 0, missing(Side::Left, 11)),
            (11, 11, 12, missing(Side::Left, 11)),
            (0, 0, 64, missing(Side::Left, 0)),
            (11, 11, 11, missing(Side::Left, 11)),
            (0, 0, 0, missing(Side::Left, 0)),
            (3, 0, 0, missing(Side::Left, 3)),
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
    fn small_parts_and_redundant_level_flight_are_omitted() {
        let parts = [0, 11, 12].map(circle_samples);
        let marks = [HeadingMark { sample: circle_samples(1)[0], heading_rad: 0.0 }];
        let selected = |left: usize, right: usize, level: usize, procedure| {
            let [left, right, level] = [left, right, level].map(|part| &parts[part][..]);
            let all = Parts { left, right, level, free: &parts[1], marks: &marks }.samples();
            let selected = SelectedParts::new(all, procedure).select_samples(all);
            assert_eq!(selected.marks, marks);
            let [left, right, level, free] = CollectionPart::ALL_PARTS.map(|part| selected.samples_of_part(part).len());
            assert_eq!((free, selected.iter().count()), (11, left + right + level + free));
            (left, right, level)
        };
        for (left, right, level, procedure, expected) in [
            (2, 2, 2, Procedure::Turns, (12, 12, 0)),
            (2, 1, 2, Procedure::Turns, (12, 0, 12)),
            (1, 2, 2, Procedure::Turns, (0, 12, 12)),
            (1, 1, 2, Procedure::Turns, (0, 0, 12)),
            (2, 0, 1, Procedure::Turns, (12, 0, 0)),
            (2, 2, 2, Procedure::Level, (12, 12, 12)),
        ] {
            assert_eq!(selected(left, right, level, procedure), expected, "{left} {right} {level} {procedure:?}");
        }
    }

    #[test]
    fn procedure_names_round_trip() {
        for (procedure, name) in [
            (Procedure::Flight, "flight"),
            (Procedure::Turns, "turns"),
            (Procedure::Level, "level"),
            (Procedure::Swing, "swing"),
            (Procedure::Tumble, "tumble"),
        ] {
            assert_eq!((procedure.procedure_name(), Procedure::from_name(name)), (name, Some(procedure)));
        }
        assert_eq!(Procedure::from_name("walk"), None);
        assert_eq!(Procedure::default(), Procedure::Flight);
    }
}
