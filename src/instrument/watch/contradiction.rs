//! When measurements contradict each other, as a value: deviations in, jumps and silence out.
//!
//! ```text
//!                    deviation beyond 4 sigma twice in a row,
//!                    or beyond 2 sigma six times in a row
//!   quiet ---------------------------------------------------> silent for 4 s <--+
//!     ^                                                          |  |  again     |
//!     +----------------------------------------------------------+  +------------+
//! ```
//!
//! What is off by so much that no heading would be told of it anyway may be over soon: a sensor that is being mended, a
//! steel hall. It is silenced and waited for, longer than the second in which a sensor is mended, before it changes
//! anything.

/// What is held against the rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// The field's strength.
    Strength,
    /// Its inclination.
    Inclination,
    /// Its heading, against the gyro's.
    Heading,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Strength, Self::Inclination, Self::Heading];
}

/// A value for each kind.
pub(super) type PerKind<T> = [T; Kind::ALL.len()];

/// How far a measurement is off.
#[derive(Clone, Copy, Debug)]
pub(super) struct Deviation {
    /// Measured less predicted.
    pub residual: f32,
    /// Variance of that, if nothing has changed.
    pub variance: f32,
}

/// Fixed numbers of this module.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// A deviation of more sigmas than this is large...
    pub large_sigmas: f32,
    /// ... and contradicts when so many in a row are.
    pub large_in_a_row: u8,
    /// A deviation of more sigmas than this is odd...
    pub odd_sigmas: f32,
    /// ... and contradicts when so many in a row are.
    pub odd_in_a_row: u8,
    /// Residuals of strength and dip that are larger than this, in parts and radians, are gross...
    pub gross: f32,
    /// ... and contradict when so many samples in a row are.
    pub gross_in_a_row: u8,
    /// After a contradiction nothing is told for so long, seconds.
    pub silence_s: f32,
}

impl Config {
    /// Numbers for ten samples a second.
    pub const DEFAULT: Self = Self {
        large_sigmas: 4.0,
        large_in_a_row: 2,
        odd_sigmas: 2.0,
        odd_in_a_row: 6,
        gross: 0.2,
        gross_in_a_row: 13,
        silence_s: 4.0,
    };
}

/// What a sample's deviations mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// All fits; but what is large, for the first time, is not to be learnt from.
    Fits {
        /// Of each kind, whether it may be learnt from.
        learn: PerKind<bool>,
    },
    /// Something has changed.
    Changed {
        /// By how much each kind shows it: the size of its residual, nothing of a kind that fits.
        sizes: PerKind<f32>,
    },
}

/// The state.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Contradiction {
    large: PerKind<u8>,
    odd: PerKind<u8>,
    gross: u8,
    silent_s: f32,
}

impl Contradiction {
    /// Nothing contradicts.
    pub const NONE: Self = Self { large: [0; 3], odd: [0; 3], gross: 0, silent_s: 0.0 };

    /// Takes the deviations of a sample, `step_s` after the one before; none of what was not measured.
    pub fn see(&mut self, config: &Config, deviations: PerKind<Option<Deviation>>, step_s: f32) -> Verdict {
        self.silent_s = (self.silent_s - step_s).max(0.0);
        if self.is_waiting(config, &deviations) {
            return Verdict::Fits { learn: [false; 3] };
        }
        let mut learn = [true; 3];
        let mut sizes = [0.0; 3];
        let mut has_changed = false;
        for (i, deviation) in deviations.into_iter().enumerate() {
            // What is not measured neither fits nor does not.
            let Some(Deviation { residual, variance }) = deviation else { continue };
            let beyond = |sigmas: f32| residual * residual > sigmas * sigmas * variance;
            let (is_large, is_odd) = (beyond(config.large_sigmas), beyond(config.odd_sigmas));
            self.large[i] = if is_large { self.large[i].saturating_add(1) } else { 0 };
            self.odd[i] = if is_odd { self.odd[i].saturating_add(1) } else { 0 };
            has_changed |= self.large[i] >= config.large_in_a_row || self.odd[i] >= config.odd_in_a_row;
            learn[i] = !is_large;
            // Once something has changed, all that is odd shows it.
            sizes[i] = if is_odd { residual.abs() } else { 0.0 };
        }
        if has_changed {
            self.silent_s = config.silence_s;
            Verdict::Changed { sizes }
        } else {
            Verdict::Fits { learn }
        }
    }

    /// Whether something is grossly off that may be over soon.
    fn is_waiting(&mut self, config: &Config, deviations: &PerKind<Option<Deviation>>) -> bool {
        let [strength, inclination, _] = deviations;
        let is_gross = [strength, inclination].into_iter().flatten().any(|d| d.residual.abs() > config.gross);
        self.gross = if is_gross { self.gross.saturating_add(1) } else { 0 };
        let is_waiting = is_gross && self.gross < config.gross_in_a_row;
        if is_waiting {
            // The samples before and after it are partly of it, and do not make a row.
            (self.large, self.odd) = ([0; 3], [0; 3]);
        }
        is_waiting
    }

    /// Whether nothing may be told now.
    pub fn is_silent(&self) -> bool {
        self.silent_s > 0.0 || self.gross > 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: Config = Config::DEFAULT;

    /// Deviations of so many sigmas of 0.01 each; none where it is not a number.
    fn sigmas(each: [f32; 3]) -> PerKind<Option<Deviation>> {
        each.map(|n| (!n.is_nan()).then_some(Deviation { residual: 0.01 * n, variance: 1e-4 }))
    }

    /// After how many equal samples something has changed, of forty.
    fn changed_after(each: [f32; 3]) -> Option<usize> {
        let mut contradiction = Contradiction::NONE;
        (1..=40).find(|_| matches!(contradiction.see(&CONFIG, sigmas(each), 0.1), Verdict::Changed { .. }))
    }

    #[test]
    fn two_large_or_six_odd_ones_in_a_row_contradict() {
        for i in 0..3 {
            let alone = |n: f32| core::array::from_fn(|k| if k == i { n } else { 0.0 });
            for (n, expected) in [(4.1, Some(2)), (-4.1, Some(2)), (3.9, Some(6)), (2.1, Some(6)), (-2.1, Some(6))] {
                assert_eq!(changed_after(alone(n)), expected, "{n} of {:?}", Kind::ALL[i]);
            }
            assert_eq!(changed_after(alone(1.9)), None);
        }
        // Two kinds that take turns are not in a row.
        let mut contradiction = Contradiction::NONE;
        for i in 0..20 {
            let each = if i % 2 == 0 { [5.0, 0.0, 0.0] } else { [0.0, 5.0, 0.0] };
            assert!(matches!(contradiction.see(&CONFIG, sigmas(each), 0.1), Verdict::Fits { .. }), "{i}");
        }
    }

    #[test]
    fn the_first_large_one_is_not_learnt_from() {
        let mut contradiction = Contradiction::NONE;
        let verdict = contradiction.see(&CONFIG, sigmas([4.1, 3.9, -4.1]), 0.1);
        assert_eq!(verdict, Verdict::Fits { learn: [false, true, false] });
        assert!(!contradiction.is_silent());
    }

    /// The sizes are those of what is odd, however much contradicts.
    #[test]
    fn a_change_is_as_large_as_what_is_odd() {
        let mut contradiction = Contradiction::NONE;
        contradiction.see(&CONFIG, sigmas([-5.0, 2.5, 1.9]), 0.1);
        let Verdict::Changed { sizes } = contradiction.see(&CONFIG, sigmas([-5.0, 2.5, 1.9]), 0.1) else { panic!() };
        for (size, expected) in sizes.into_iter().zip([0.05, 0.025, 0.0]) {
            assert!((size - expected).abs() < 1e-7, "{sizes:?}");
        }
    }

    #[test]
    fn four_seconds_of_silence_follow_the_last_contradiction() {
        let mut contradiction = Contradiction::NONE;
        for _ in 0..7 {
            contradiction.see(&CONFIG, sigmas([5.0, 0.0, 0.0]), 0.1);
        }
        let silent = (1..100).take_while(|_| {
            contradiction.see(&CONFIG, sigmas([0.0; 3]), 0.1);
            contradiction.is_silent()
        });
        // To a sample, for a tenth is none in binary.
        assert!((39..=41).contains(&silent.count()));
    }

    /// A fifth of the field, or 11 deg of dip: nothing is told meanwhile, nothing is learnt, and when it is over nothing
    /// has changed; after thirteen samples it has.
    #[test]
    fn what_is_grossly_off_is_waited_for() {
        let off = |residual: f32, kind: usize| {
            core::array::from_fn(|k| (k == kind).then_some(Deviation { residual, variance: 1e-4 }))
        };
        for kind in [0, 1] {
            let mut contradiction = Contradiction::NONE;
            for residual in [0.21, -0.21].into_iter().cycle().take(12) {
                let verdict = contradiction.see(&CONFIG, off(residual, kind), 0.1);
                assert_eq!(verdict, Verdict::Fits { learn: [false; 3] });
                assert!(contradiction.is_silent());
            }
            let mut over = contradiction;
            // The last sample of it is partly of what comes after.
            assert!(matches!(over.see(&CONFIG, off(0.1, kind), 0.1), Verdict::Fits { .. }));
            assert_eq!(over.see(&CONFIG, off(0.0, kind), 0.1), Verdict::Fits { learn: [true; 3] });
            assert!(!over.is_silent());
            // Two contradict, as of any that are large.
            contradiction.see(&CONFIG, off(0.21, kind), 0.1);
            assert!(matches!(contradiction.see(&CONFIG, off(0.21, kind), 0.1), Verdict::Changed { .. }));
        }
        let mut contradiction = Contradiction::NONE;
        contradiction.see(&CONFIG, off(0.19, 0), 0.1);
        assert!(matches!(contradiction.see(&CONFIG, off(0.19, 0), 0.1), Verdict::Changed { .. }));
        // A heading may be anywhere.
        let mut contradiction = Contradiction::NONE;
        contradiction.see(&CONFIG, off(2.0, 2), 0.1);
        assert!(matches!(contradiction.see(&CONFIG, off(2.0, 2), 0.1), Verdict::Changed { .. }));
    }

    /// What is not measured does not break a row, and does not make one.
    #[test]
    fn what_is_not_measured_says_nothing() {
        let mut contradiction = Contradiction::NONE;
        contradiction.see(&CONFIG, sigmas([0.0, 0.0, 5.0]), 0.1);
        contradiction.see(&CONFIG, sigmas([0.0, 0.0, f32::NAN]), 0.1);
        assert!(matches!(contradiction.see(&CONFIG, sigmas([0.0, 0.0, 5.0]), 0.1), Verdict::Changed { .. }));
        assert_eq!(changed_after([f32::NAN; 3]), None);
    }

    /// Days of contradiction do not overflow the counts.
    #[test]
    fn counts_saturate() {
        assert_eq!(changed_after([9.0; 3]), Some(2));
        let mut contradiction = Contradiction::NONE;
        for _ in 0..1000 {
            contradiction.see(&CONFIG, sigmas([9.0; 3]), 0.1);
        }
        assert!(contradiction.is_silent());
    }
}
