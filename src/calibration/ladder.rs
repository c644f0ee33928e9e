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

use super::two_plane::MIN_SAMPLES;
use super::{Method, Part, Samples, Side, SolveError};

/// How samples were collected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Manner {
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

/// What a method needs of the samples: level flight sharpens thin turns, but where both sides were flown it only brings
/// in what the aircraft stood or taxied beside.
#[must_use]
pub fn used(samples: Samples<'_>, manner: Manner) -> Samples<'_> {
    let both = samples.left.len() >= MIN_SAMPLES && samples.right.len() >= MIN_SAMPLES;
    if manner == Manner::Turns && both { Samples { level: &[], ..samples } } else { samples }
}

/// The method that the samples support.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`] names what is missing.
pub fn choose(samples: Samples<'_>, manner: Manner) -> Result<Method, SolveError> {
    match manner {
        Manner::Level => Ok(Method::Level),
        Manner::Swing => Ok(Method::CompassSwing),
        Manner::Tumble => Ok(Method::Ellipsoid),
        Manner::Turns => {
            let enough = |part: &[_]| part.len() >= MIN_SAMPLES;
            match (enough(samples.left), enough(samples.right), enough(samples.level)) {
                (true, true, _) | (true, false, true) | (false, true, true) => Ok(Method::MaximumLikelihood),
                (false, false, true) => Ok(Method::Level),
                (left, _, _) => {
                    let (side, part) = if left { (Side::Right, samples.right) } else { (Side::Left, samples.left) };
                    let (have, need) = (part.len() as u16, MIN_SAMPLES as u16);
                    Err(SolveError::TooFewSamples { part: Part::Turns(side), have, need })
                }
            }
        }
    }
}
