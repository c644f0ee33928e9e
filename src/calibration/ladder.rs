//! The ladder: which method the samples support.
//!
//! | samples of | method | left to what is known beforehand |
//! |---|---|---|
//! | left and right turns | maximum likelihood, all of `A`, `b` and the inclination | nothing |
//! | turns of one side and level flight | maximum likelihood | nothing, but less sharp |
//! | level flight, where that was asked for | level ellipse | everything vertical, and the mounting |
//! | headings given by a person | compass swing | the vertical response, on level ground |
//! | whatever attitudes, tilted more than one way | maximum likelihood | nothing |
//! | tumbling without attitude | ellipsoid | the mounting |
//! | less | none | |
//!
//! Who asked for turns gets no level ellipse: its constant error, the mounting, is not in what it expects, and at
//! little bank was up to eight times that. `cal solve level` is there for who wants it.

use super::turns::MIN_SAMPLES;
use super::{Method, Part, Sample, Samples, Side, SolveError};

/// How samples were collected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Procedure {
    /// Whatever is flown: of all attitudes those that tell most.
    #[default]
    Flight,
    /// Left and right turns in flight, and the level flight between them.
    Turns,
    /// Level headings.
    Level,
    /// Headings given by a person.
    Swing,
    /// All attitudes, none of them known.
    Tumble,
}

impl Procedure {
    /// All of them, in the order in which they are told.
    pub const ALL: [Self; 5] = [Self::Flight, Self::Turns, Self::Level, Self::Swing, Self::Tumble];

    /// The word typed after `cal start`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Flight => "flight",
            Self::Turns => "turns",
            Self::Level => "level",
            Self::Swing => "swing",
            Self::Tumble => "tumble",
        }
    }

    /// The procedure of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|procedure| procedure.name() == name)
    }
}

/// Which parts of the samples are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Selection {
    left: bool,
    right: bool,
    level: bool,
}

impl Selection {
    /// Of samples to fit to. Parts too thin to show anything are left out. Level flight sharpens thin turns, but where
    /// both sides were flown it only brings in what the aircraft taxied beside.
    #[must_use]
    pub fn of(fit: Samples<'_>, procedure: Procedure) -> Self {
        let enough = |part: &[_]| part.len() >= MIN_SAMPLES;
        let (left, right) = (enough(fit.left), enough(fit.right));
        let both = procedure == Procedure::Turns && left && right;
        Self { left, right, level: enough(fit.level) && !both }
    }

    /// The selected parts, and all marks.
    #[must_use]
    pub fn from<'a>(&self, samples: Samples<'a>) -> Samples<'a> {
        let part = |selected: bool, part: &'a [Sample]| if selected { part } else { &[] };
        Samples {
            left: part(self.left, samples.left),
            right: part(self.right, samples.right),
            level: part(self.level, samples.level),
            any: samples.any,
            marks: samples.marks,
        }
    }
}

/// The method that the samples support.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`] names what is missing.
pub fn choose(samples: Samples<'_>, procedure: Procedure) -> Result<Method, SolveError> {
    match procedure {
        Procedure::Level => Ok(Method::Level),
        Procedure::Swing => Ok(Method::CompassSwing),
        Procedure::Tumble => Ok(Method::Ellipsoid),
        Procedure::Flight => Ok(Method::MaximumLikelihood),
        Procedure::Turns => {
            let Selection { left, right, .. } = Selection::of(samples, procedure);
            let level = samples.level.len() >= MIN_SAMPLES;
            let missing = |side, turns: &[_]| Err(SolveError::too_few(Part::Turns(side), turns.len(), MIN_SAMPLES));
            match (left, right, level) {
                (true, true, _) | (true, false, true) | (false, true, true) => Ok(Method::MaximumLikelihood),
                (true, false, false) => missing(Side::Right, samples.right),
                (false, _, _) => missing(Side::Left, samples.left),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;
    use crate::calibration::{Mark, Rates};
    use crate::frames::{Attitude, Field, Level};
    use crate::time::WrappingMillis;

    /// Samples of a level circle; each part of a flight is told by how many it has.
    fn circle(number: usize) -> Vec<Sample> {
        (0..number)
            .map(|i| {
                let field = Field::<Level>::earth(50.0, 1.0, TAU * i as f32 / number as f32);
                Sample {
                    field: Field::new(field.ut),
                    attitude: Attitude::default(),
                    time: WrappingMillis::default(),
                    rates: Rates::NONE,
                }
            })
            .collect()
    }

    fn chosen(left: usize, right: usize, level: usize) -> Result<Method, SolveError> {
        let (left, right, level) = (circle(left), circle(right), circle(level));
        let samples = Samples { left: &left, right: &right, level: &level, ..Samples::default() };
        choose(samples, Procedure::Turns)
    }

    /// 12 samples are a side's least: with 11 it counts as not flown.
    #[test]
    fn turns_take_the_best_method_that_their_parts_support() {
        let missing = |side, have| Err(SolveError::TooFewSamples { part: Part::Turns(side), have, need: 12 });
        for (left, right, level, expected) in [
            (12, 12, 0, Ok(Method::MaximumLikelihood)),
            (12, 12, 40, Ok(Method::MaximumLikelihood)),
            (12, 0, 12, Ok(Method::MaximumLikelihood)),
            (0, 12, 12, Ok(Method::MaximumLikelihood)),
            (12, 11, 11, missing(Side::Right, 11)),
            (11, 12, 11, missing(Side::Left, 11)),
            (11, 12, 0, missing(Side::Left, 11)),
            // Level flight is no substitute, however much of it there is.
            (11, 11, 12, missing(Side::Left, 11)),
            (0, 0, 64, missing(Side::Left, 0)),
            (11, 11, 11, missing(Side::Left, 11)),
            (0, 0, 0, missing(Side::Left, 0)),
            (3, 0, 0, missing(Side::Left, 3)),
        ] {
            assert_eq!(chosen(left, right, level), expected, "{left} {right} {level}");
        }
    }

    /// On the ground the person has said what the samples are.
    #[test]
    fn every_other_procedure_has_one_method() {
        for (procedure, method) in [
            (Procedure::Flight, Method::MaximumLikelihood),
            (Procedure::Level, Method::Level),
            (Procedure::Swing, Method::CompassSwing),
            (Procedure::Tumble, Method::Ellipsoid),
        ] {
            assert_eq!(choose(Samples::default(), procedure), Ok(method));
        }
    }

    #[test]
    fn thin_parts_are_left_out_and_level_flight_beside_both_sides() {
        let parts = [0, 11, 12].map(circle);
        let marks = [Mark { sample: circle(1)[0], heading_rad: 0.0 }];
        let selected = |left: usize, right: usize, level: usize, procedure| {
            let any = [&parts[1][..], &[], &parts[2]];
            let all = Samples { left: &parts[left], right: &parts[right], level: &parts[level], marks: &marks, any };
            let selected = Selection::of(all, procedure).from(all);
            assert_eq!((selected.marks, selected.any), (&marks[..], any));
            (selected.left.len(), selected.right.len(), selected.level.len())
        };
        assert_eq!(selected(2, 2, 2, Procedure::Turns), (12, 12, 0));
        assert_eq!(selected(2, 1, 2, Procedure::Turns), (12, 0, 12));
        assert_eq!(selected(1, 2, 2, Procedure::Turns), (0, 12, 12));
        assert_eq!(selected(1, 1, 2, Procedure::Turns), (0, 0, 12));
        assert_eq!(selected(2, 0, 1, Procedure::Turns), (12, 0, 0));
        assert_eq!(selected(2, 2, 2, Procedure::Level), (12, 12, 12));
    }

    #[test]
    fn procedures_are_typed_by_name() {
        for (procedure, name) in [
            (Procedure::Flight, "flight"),
            (Procedure::Turns, "turns"),
            (Procedure::Level, "level"),
            (Procedure::Swing, "swing"),
            (Procedure::Tumble, "tumble"),
        ] {
            assert_eq!((procedure.name(), Procedure::from_name(name)), (name, Some(procedure)));
        }
        assert_eq!(Procedure::from_name("walk"), None);
        assert_eq!(Procedure::default(), Procedure::Flight);
    }
}
