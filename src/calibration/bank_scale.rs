//! Whether the attitude source reads all of the bank.
//!
//! A source that is aided by accelerometers leans into a turn and reads, say, nine tenths of the bank. In steady turns
//! that looks like soft iron; only as bank wanders, dips wander with what is missing of it. With `k` for the relative
//! error of bank as one more unknown, linear about the solution without it, its estimate is `U / S`: `S` what is left
//! of its information, and `U` of its gradient, when all other unknowns follow (the efficient score: D. R. Cox and
//! D. V. Hinkley, Theoretical Statistics, 1974, 9.3).
//!
//! Noise of roll stands in the derivative `roll dip'(roll)` as in the residual, so that it pulls the estimate towards
//! -1 as noise in a regressor does. It is known from the scatter of the dips, and taken out of both `S` and `U`: by
//! `sigma^2 sum w dip'(roll)^2`.
//!
//! In light weather, with 330 samples of turns at 25 deg of bank, `k` comes out to 2 %: 0.009 for the 1 % that the
//! simulator's source is short by, 0.11 for 10 %. That is too little to correct by (which makes a good source's
//! headings worse: 0.12 to 0.32 deg), but enough to doubt a bad one.

use super::likelihood::{Equation, Equations, Vector13};
use super::time_order::PARTS;

/// Of the information about `k`, the noise of roll may not make up more than this share.
const MAX_NOISE_SHARE: f32 = 0.5;

/// An estimate that scatters by more tells a bad source from a good one no better than a guess, unless it is many
/// sigmas off.
const MAX_SIGMA: f32 = 0.05;

/// So many sigmas are no guess whatever they are.
const CERTAIN: f32 = 3.5;

/// Estimates whose square is below this many variances are chance: one clean flight in sixteen exceeds it.
const CHANCE: f32 = 3.0;

/// How fast an estimate beyond chance is believed: all of it at twice [`CHANCE`].
const BELIEF: f32 = 2.0;

/// Sums over the dips of samples.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct BankEvidence {
    information: f32,
    gradient: f32,
    /// What a unit of roll noise adds to both.
    of_noise: f32,
}

/// The error of bank as samples show it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BankScale {
    /// What is missing of the bank that the source reads, relative to it; negative if it reads too much.
    pub missing: f32,
    /// Its variance.
    pub variance: f32,
    /// The information that it is from.
    own: f32,
}

/// What an attitude source makes of bank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BankError {
    /// How much of the bank it reads; one is right.
    pub read: f32,
    /// By how many of its sigmas that is more or less than the allowance for good sources.
    pub sigmas: f32,
}

impl BankEvidence {
    /// Adds a dip with its derivatives by roll bias, by pitch bias, by the relative error of bank, and by a latency.
    pub fn add(&mut self, dip: &Equation, [by_roll, _, by_bank, _]: [f32; 4]) {
        self.information += dip.weight * by_bank * by_bank;
        self.gradient -= dip.weight * by_bank * dip.residual;
        self.of_noise += dip.weight * by_roll * by_roll;
    }

    /// The estimate. `known` is what the other unknowns explain of the information, `pulled` what of the gradient; the
    /// variance of errors is `inflation` times that of independent ones. `None` where it could not be told.
    pub fn scale(&self, known: f32, pulled: f32, roll_sigma_rad: f32, inflation: f32) -> Option<BankScale> {
        let all = self.information - known;
        let noise = self.of_noise * roll_sigma_rad * roll_sigma_rad;
        if all.is_nan() || noise > MAX_NOISE_SHARE * all {
            return None;
        }
        let own = all - noise;
        let missing = (self.gradient - pulled + noise) / own;
        let variance = all * inflation / (own * own);
        (missing.is_finite() && variance.is_finite()).then_some(BankScale { missing, variance, own })
    }
}

/// Samples of a part that follow each other, taken together: six seconds of a turn.
const CLUSTER: u8 = 12;

/// The scatter of what samples contribute to an estimate, whatever they have in common with their neighbours: a power
/// line that pulls for some seconds counts as one contribution, and what is alike in all as none (the cluster-robust
/// variance: K.-Y. Liang and S. L. Zeger, Biometrika 73, 1986).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Clusters {
    /// Of each part, the sum of the cluster under way and how many samples it has.
    open: [(f32, u8); PARTS],
    number: f32,
    sum: f32,
    squares: f32,
}

impl Clusters {
    /// Adds what the next sample of a part contributes to `U`, where `column` is `H^-1` times what an error of bank
    /// does to the gradient of the other unknowns.
    pub fn add(&mut self, part: usize, equations: &Equations, column: &Vector13) {
        let [_, _, by_bank, _] = equations.attitude_effects;
        let of = |equation: &Equation, by_bank: f32| {
            equation.weight * equation.residual * (by_bank - equation.row.dot(column))
        };
        let Some((sum, samples)) = self.open.get_mut(part) else { return };
        *sum += of(&equations.norm, 0.0) + equations.dip.as_ref().map_or(0.0, |dip| of(dip, by_bank));
        *samples += 1;
        if *samples == CLUSTER {
            let whole = core::mem::take(sum);
            *samples = 0;
            self.close(whole);
        }
    }

    fn close(&mut self, sum: f32) {
        self.number += 1.0;
        self.sum += sum;
        self.squares += sum * sum;
    }

    /// The variance of `U`; not finite of fewer than two clusters.
    fn variance(mut self) -> f32 {
        for (sum, samples) in self.open {
            if samples > 0 {
                self.close(sum);
            }
        }
        (self.squares - self.sum * self.sum / self.number) * self.number / (self.number - 1.0)
    }
}

impl BankScale {
    /// The same, with the variance that clusters of samples show, if that is more. `None` if it tells nothing.
    pub fn with(self, clusters: Clusters) -> Option<Self> {
        let variance = self.variance.max(clusters.variance() / (self.own * self.own));
        let is_told = variance <= MAX_SIGMA * MAX_SIGMA || self.missing * self.missing > CERTAIN * CERTAIN * variance;
        is_told.then_some(Self { variance, ..self })
    }

    /// What the source reads, then, if by more or less than an allowance made anyway, 1 sigma of relative bank, and
    /// chance.
    pub fn error(&self, allowance: f32) -> Option<BankError> {
        let sigmas = libm::sqrtf(self.missing * self.missing / self.usual(allowance));
        let read = 1.0 / (1.0 + self.missing);
        (self.beyond(allowance) > 0.0).then_some(BankError { read, sigmas })
    }

    /// The square of the error that is to be allowed for beyond an allowance.
    pub fn beyond(&self, allowance: f32) -> f32 {
        let square = self.missing * self.missing;
        // Not a clamp, whose panic on what is not a number would bring the formatting of floats with it, 8 KB.
        let believed = BELIEF * (square - CHANCE * self.usual(allowance));
        if believed > 0.0 { believed.min(square) } else { 0.0 }
    }

    /// The mean square of the estimate for sources that are as good as is allowed for.
    fn usual(&self, allowance: f32) -> f32 {
        self.variance + allowance * allowance
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::super::likelihood::Row;
    use super::*;

    fn close(found: f32, expected: f32) -> bool {
        (found - expected).abs() <= 1e-4 * expected.abs()
    }

    const NOWHERE: Row =
        Row { by_field: Vector3::new(0.0, 0.0, 0.0), x: Vector3::new(0.0, 0.0, 0.0), by_inclination: 0.0 };

    fn dip(weight: f32, residual: f32, row: Row) -> Equation {
        let equation = Equation::new(row, residual, 1.0 / weight, 1e6);
        assert!(close(equation.weight, weight));
        equation
    }

    /// The sums, the estimate and its variance by hand: of two dips, less what the others explain, and less the noise.
    #[test]
    fn the_estimate_is_that_of_its_parts() {
        let mut evidence = BankEvidence::default();
        evidence.add(&dip(100.0, -0.3, NOWHERE), [0.5, 9.0, 2.0, 9.0]);
        evidence.add(&dip(50.0, 0.2, NOWHERE), [-1.0, 9.0, -3.0, 9.0]);
        let (information, gradient) = (100.0 * 4.0 + 50.0 * 9.0, 100.0 * 2.0 * 0.3 + 50.0 * 3.0 * 0.2);
        let noise = (100.0 * 0.25 + 50.0) * 0.04;
        let found = evidence.scale(150.0, 7.0, 0.2, 1.5).unwrap();
        let own = information - 150.0 - noise;
        assert!(close(found.missing, (gradient - 7.0 + noise) / own), "{found:?}");
        assert!(close(found.variance, (information - 150.0) * 1.5 / (own * own)), "{found:?}");
        assert!(close(found.error(0.0).unwrap().read, 1.0 / (1.0 + found.missing)));
    }

    /// Half of the information may be the noise's own.
    #[test]
    fn noise_alone_says_nothing() {
        let mut evidence = BankEvidence::default();
        evidence.add(&dip(1e6, 0.0, NOWHERE), [1.0, 0.0, 1.0, 0.0]);
        assert!(evidence.scale(0.0, 0.0, 0.49_f32.sqrt(), 1.0).is_some());
        assert!(evidence.scale(0.0, 0.0, 0.51_f32.sqrt(), 1.0).is_none());
        assert!(evidence.scale(f32::NAN, 0.0, 0.1, 1.0).is_none());
        assert!(evidence.scale(0.0, f32::NAN, 0.1, 1.0).is_none());
        assert!(BankEvidence::default().scale(0.0, 0.0, 0.1, 1.0).is_none());
    }

    fn scale(missing: f32, sigma: f32) -> BankScale {
        BankScale { missing, variance: sigma * sigma, own: 1e4 }
    }

    /// Three variances, the source's own included, are chance; of what is beyond twice is allowed for, up to all of it.
    #[test]
    fn an_error_is_allowed_for_beyond_chance() {
        // Of 0.02 and an allowance of 0.01: a variance of 5e-4.
        for (square, beyond) in [(14.9e-4, 0.0), (15.1e-4, 0.2e-4), (20e-4, 10e-4), (29e-4, 28e-4), (31e-4, 31e-4)] {
            for missing in [f32::sqrt(square), -f32::sqrt(square)] {
                let found = scale(missing, 0.02);
                assert!((found.beyond(0.01) - beyond).abs() < 1e-7, "{missing}: {}", found.beyond(0.01));
                let error = found.error(0.01);
                assert_eq!(error.is_some(), beyond > 0.0, "{missing}");
                if let Some(BankError { read, sigmas }) = error {
                    assert!(close(read, 1.0 / (1.0 + missing)) && close(sigmas, (square / 5e-4).sqrt()));
                }
            }
        }
    }

    /// Five percent of scatter are too many, unless what is found is 3.5 times as much.
    #[test]
    fn a_guess_is_no_finding() {
        let of = |missing, sigma| scale(missing, sigma).with(Clusters::default()).is_some();
        assert!(of(0.1, 0.049) && !of(0.1, 0.051) && !of(-0.1, 0.051));
        assert!(!of(0.34, 0.1) && of(0.36, 0.1) && of(-0.36, 0.1));
    }

    /// Contributions of so many samples, one for each.
    fn clusters(contributions: impl Iterator<Item = (usize, f32)>) -> Clusters {
        let mut clusters = Clusters::default();
        let column = Vector13::zeros();
        for (part, contribution) in contributions {
            let norm = dip(1.0, 5.0, NOWHERE);
            let dip = Some(dip(1.0, contribution, NOWHERE));
            let equations = Equations { norm, dip, heading: None, attitude_effects: [7.0, 7.0, 1.0, 7.0] };
            clusters.add(part, &equations, &column);
        }
        clusters
    }

    /// Twelve of a part make a cluster, whatever is between them; the rest makes one of its own.
    #[test]
    fn samples_count_by_the_dozen() {
        // Sums of 12, -12 and 24 of the first part, 6 of the second.
        let first = (0..48).map(|i| {
            (
                0,
                if i < 12 {
                    1.0
                } else if i < 24 {
                    -1.0
                } else {
                    1.0
                },
            )
        });
        let second = (0..6).map(|_| (1, 1.0));
        let interleaved = first.zip(second.map(Some).chain(core::iter::repeat(None)));
        let found = clusters(interleaved.flat_map(|(a, b)| core::iter::once(a).chain(b))).variance();
        let sums = [12.0, -12.0, 12.0, 12.0, 6.0_f32];
        let mean = sums.iter().sum::<f32>() / 5.0;
        let expected = sums.iter().map(|s| (s - mean) * (s - mean)).sum::<f32>() * 5.0 / 4.0;
        assert!(close(found, expected), "{found} {expected}");
        assert!(!clusters((0..5).map(|_| (0, 1.0))).variance().is_finite());
    }

    /// What all other unknowns explain is no contribution; the norm contributes by these alone.
    #[test]
    fn a_contribution_is_what_is_left_of_it() {
        let row = Row { by_field: Vector3::x() * 3.0, x: Vector3::z(), ..NOWHERE };
        let column = Vector13::ith(2, 0.5);
        let equations = Equations {
            norm: dip(10.0, 0.1, row),
            dip: Some(dip(4.0, -0.2, row)),
            heading: None,
            attitude_effects: [0.0, 0.0, 2.0, 0.0],
        };
        let mut clusters = Clusters::default();
        clusters.add(0, &equations, &column);
        let (sum, samples) = clusters.open[0];
        assert!(close(sum, 10.0 * 0.1 * -1.5 + 4.0 * -0.2 * (2.0 - 1.5)) && samples == 1, "{sum}");
        clusters.add(PARTS, &equations, &column);
        assert_eq!(clusters.open.iter().map(|open| open.1).sum::<u8>(), 1);
    }

    /// The variance is that of the clusters if that is more, in units of what the estimate is from.
    #[test]
    fn clusters_can_only_add_doubt() {
        let scattered = clusters((0..48).map(|i| (0, if i / 12 % 2 == 0 { 1.0 } else { -1.0 })));
        let expected = scattered.variance() / 1e8;
        assert!(close(scale(0.1, 1e-4).with(scattered).unwrap().variance, expected));
        assert!(close(scale(0.1, 0.01).with(scattered).unwrap().variance, 1e-4));
    }
}
