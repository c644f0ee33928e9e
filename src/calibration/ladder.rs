//! The ladder: which method the samples support.
//!
//! | samples of | method | left to what is known beforehand |
//! |---|---|---|
//! | left and right turns | maximum likelihood, all of `A`, `b` and the inclination | nothing |
//! | turns of one side and level flight | maximum likelihood | nothing, but less sharp |
//! | level flight | level ellipse | everything vertical, and the mounting |
//! | headings given by a person | compass swing | the vertical response, on level ground |
//! | tumbling without attitude | ellipsoid | the mounting |
//! | less | none | |

use super::turns::MIN_SAMPLES;
use super::{Method, Part, Prior, Sample, Samples, Side, SolveError, level};

/// How samples were collected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Procedure {
    /// Left and right turns in flight, and the level flight between them.
    #[default]
    Turns,
    /// Level headings.
    Level,
    /// Headings given by a person.
    Swing,
    /// All attitudes, none of them known.
    Tumble,
}

impl Procedure {
    /// The word typed after `cal start`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Turns => "turns",
            Self::Level => "level",
            Self::Swing => "swing",
            Self::Tumble => "tumble",
        }
    }

    /// The procedure of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Turns, Self::Level, Self::Swing, Self::Tumble].into_iter().find(|procedure| procedure.name() == name)
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
            marks: samples.marks,
        }
    }
}

/// The method that the samples support.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`] names what is missing.
pub fn choose(samples: Samples<'_>, procedure: Procedure, prior: &Prior) -> Result<Method, SolveError> {
    match procedure {
        Procedure::Level => Ok(Method::Level),
        Procedure::Swing => Ok(Method::CompassSwing),
        Procedure::Tumble => Ok(Method::Ellipsoid),
        Procedure::Turns => {
            let Selection { left, right, .. } = Selection::of(samples, procedure);
            let level = samples.level.len() >= MIN_SAMPLES;
            let missing = |side, turns: &[_]| Err(SolveError::too_few(Part::Turns(side), turns.len(), MIN_SAMPLES));
            match (left, right, level) {
                (true, true, _) | (true, false, true) | (false, true, true) => Ok(Method::MaximumLikelihood),
                (false, false, true) if shows_level(samples.level, prior) => Ok(Method::Level),
                (true, false, false) => missing(Side::Right, samples.right),
                (false, _, _) => missing(Side::Left, samples.left),
            }
        }
    }
}

/// Whether level flight went through enough headings for an ellipse.
fn shows_level(samples: &[Sample], prior: &Prior) -> bool {
    let samples = Samples { level: samples, ..Samples::default() };
    level::solve(samples, &prior.mount.body_from_sensor()).is_ok()
}
