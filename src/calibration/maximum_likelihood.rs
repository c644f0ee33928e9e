//! Maximum likelihood: the method in use. Seeks the coefficients under which all samples together are most likely, by
//! the model of [`likelihood`](super::likelihood).
//!
//! Real turns are not flown at constant attitude, so a closed form only starts the search. Levenberg-Marquardt on the
//! thirteen unknowns, the noise re-estimated whenever they have settled. It sits at the Cramer-Rao bound: the RMS
//! heading error over the bound's is 1.00 at the median of 500 harsh airframes and 1.08 at the worst decile
//! (`host-sim bench accuracy --airframes 500`).
//!
//! # Numbers
//!
//! All in `f32`, with the equations rotated into a triangle instead of summed up
//! ([`least_squares`](super::least_squares)). What else was tried:
//!
//! | | error over the bound | thin data |
//! |---|---|---|
//! | normal equations summed in `f32`, solved in `f64` | 1.00 | as here |
//! | normal equations in `f32` | 1.00 | not positive definite in some compass swings |
//! | triangle in `f32` (in use) | 1.00 | as with `f64` |
//!
//! The closed forms, too, give the same to four digits in `f32`, and without them in `f64` the image is 33 KB smaller
//! (of 233 KB). A product in `f64` takes a hundred instructions on a Cortex-M4. A solve of 2 x 256 samples takes 2.5 ms
//! on a PC (`host-sim bench speed`), 33 million instructions on the chip, of which 11 million are rotations (`host-sim
//! bench budget`), and with all that is beneath it 12 KB of stack.
//!
//! The samples are centred on their mean before anything is summed up; that, not the width of the numbers, is what
//! keeps the digits.

use super::Samples;
use super::likelihood::{Likelihood, System, Vector13};

/// Steps between two rounds; turns to both sides take three. Thin data can make a long, bent valley of unknowns that
/// hardly matter to the heading: then this ends it, and what is left of the way is carried as uncertainty.
const MAX_STEPS: u8 = 40;

/// The unknowns have settled when a step promises to lower the cost by less than this, in units of half a sigma
/// squared: 0.03 sigma of the worst direction.
const SETTLED: f32 = 5e-4;

/// Once measurements are corrected by their own residuals, the gradient is no longer exactly that of the cost: a step
/// towards its zero may raise the cost by a little, in the same units.
const REFINED_TOLERANCE: f32 = 1.0;

/// Rounds of re-weighting; sigma changes by less than 1 % after these.
const ROUNDS: u8 = 3;

/// How far a refinement is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    /// Call [`Refinement::step`] again.
    Continue,
    /// Unknowns and noise have settled.
    Settled,
    /// They never will.
    Failed,
}

/// By how much a step is shortened (Levenberg-Marquardt): the part of the information's diagonal that is added to it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Damping {
    value: f32,
    /// By what a step that fails multiplies it.
    growth: f32,
}

impl Damping {
    /// Growth after a first failed step.
    const FIRST_GROWTH: f32 = 4.0;
    /// Steps so short that nothing moves any more.
    const MAX: f32 = 1e6;
    /// No damping to `f32`.
    const MIN: f32 = 1e-9;

    /// For a start that may be far off.
    const START: Self = Self { value: 1e-3, growth: Self::FIRST_GROWTH };
    /// For new weights around unknowns that had settled with the old ones.
    const REWEIGHTED: f32 = 1e-6;

    /// After a step that brought a share of the gain it had promised: a tenth if all of it came true, more if half did
    /// not (H. B. Nielsen, "Damping parameter in Marquardt's method", IMM-REP-1999-05).
    fn after_success(self, share: f32) -> Self {
        let excess = 2.0 * share.clamp(0.0, 1.0) - 1.0;
        let value = (self.value * (1.0 - excess * excess * excess).max(0.1)).max(Self::MIN);
        Self { value, growth: Self::FIRST_GROWTH }
    }

    /// After a step that made things worse: the more, the oftener in a row.
    fn after_failure(self) -> Self {
        Self { value: self.value * self.growth, growth: 2.0 * self.growth }
    }
}

/// A refinement under way. Each [`step`](Self::step) is one pass over the samples. About 1 KB.
#[derive(Debug)]
pub(super) struct Refinement {
    pub likelihood: Likelihood,
    pub unknowns: Vector13,
    /// Whether the unknowns may move; if not, only the noise is estimated.
    moves: bool,
    system: System,
    damping: Damping,
    /// Rounds of weights so far.
    rounds: u8,
    /// Steps since the last.
    steps: u8,
}

impl Refinement {
    /// Begins at a start. With `moves` false the unknowns stay, and only the noise around them is found.
    pub fn new(likelihood: Likelihood, samples: Samples<'_>, unknowns: Vector13, moves: bool) -> Self {
        let system = likelihood.linearise(samples, &unknowns);
        Self { likelihood, unknowns, moves, system, damping: Damping::START, rounds: 0, steps: 0 }
    }

    /// One pass over the samples, which must be those it began with. Not inlined, which bounds the solver's stack.
    #[inline(never)]
    pub fn step(&mut self, samples: Samples<'_>) -> Progress {
        if self.moves {
            match self.descend(samples) {
                Progress::Settled => {}
                other => return other,
            }
        }
        if self.rounds == ROUNDS {
            return Progress::Settled;
        }
        self.rounds += 1;
        self.steps = 0;
        self.likelihood.reweight(&self.system, &self.unknowns);
        self.system = self.likelihood.linearise(samples, &self.unknowns);
        self.damping.value = Damping::REWEIGHTED;
        Progress::Continue
    }

    /// One Levenberg-Marquardt step.
    fn descend(&mut self, samples: Samples<'_>) -> Progress {
        self.steps += 1;
        let Some((change, promised)) = self.system.step(self.damping.value) else { return Progress::Failed };
        let trial = self.unknowns + change;
        let system = self.likelihood.linearise(samples, &trial);
        let tolerance = if self.likelihood.refined { REFINED_TOLERANCE } else { f32::MIN_POSITIVE };
        let gained = self.system.cost - system.cost;
        if gained >= -tolerance {
            self.unknowns = trial;
            self.system = system;
            // A gain within the tolerance says nothing.
            self.damping = self.damping.after_success(if promised > tolerance { gained / promised } else { 1.0 });
        } else {
            self.damping = self.damping.after_failure();
        }
        let goes_on = promised.abs() > SETTLED && self.damping.value < Damping::MAX && self.steps < MAX_STEPS;
        if goes_on { Progress::Continue } else { Progress::Settled }
    }
}
