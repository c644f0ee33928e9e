//! How old the attitude is, beyond what the attitude source is known for.
//!
//! An attitude that is `tau` too old has a roll of `phi - tau phi'` and a pitch of `theta - tau theta'`. In a steady turn
//! nothing shows it; as bank wanders, dips wander with the rates of roll and pitch. So `tau` is the fourteenth unknown
//! where samples have rates: the derivative of the dip by it is `cos theta (l_y / h) phi' - (l_x / h) theta'`, with `l` the
//! levelled field and `h` its horizontal part, and a prior of a tenth of a second keeps it where samples say nothing.
//!
//! It is not carried through the search, where most flights have none that matters. As a change of the iron is, it is
//! eliminated: `S = H_tt - H_tu H^-1 H_ut` and `U = g_t - H_tu H^-1 g_u` are what is left of its information and of its
//! gradient when the other unknowns follow (the efficient score: D. R. Cox and D. V. Hinkley, Theoretical Statistics,
//! 1974, 9.3), `tau = U / S`, and the others follow by `-H^-1 H_ut tau`. That is the step that fourteen unknowns would
//! take. Where it matters, the samples' attitudes are taken so much later, and all is sought again from there.
//!
//! Errors of neighbouring dips are alike, and where rates are, too, what they contribute to `U` is. The variance of `U` is
//! that of independent contributions times `(1 + rho) / (1 - rho)`, with the lag-1 autocorrelation `rho` of the very
//! contributions.

use super::correlation::Correlation;
use super::likelihood::Equation;
use super::{Calibration, Latency};

/// Of what is known beforehand, seconds, 1 sigma.
const PRIOR_SIGMA_S: f32 = 0.1;

/// A latency that is known no better than to this, seconds, is not used.
const MAX_SIGMA_S: f32 = 0.015;

/// Nor one of no more than so many of its sigmas.
const MIN_SIGMAS: f32 = 3.0;

/// A latency that is not yet taken out of the dips is in their scatter, and so in its sigma: one that is known to this,
/// seconds, may be known better when it has been.
const MAX_SIGMA_AT_FIRST_S: f32 = 2.0 * MAX_SIGMA_S;

/// A latency in use is sought again if it was off by more than this part of its sigma.
const SETTLED_SIGMAS: f32 = 0.5;

/// So many are tried; the second is off by what the first one bends, a few per cent.
const MAX_TRIED: u8 = 2;

/// Sums over the dips of samples.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LatencyEvidence {
    information: f32,
    gradient: f32,
    /// Of the contributions to the gradient.
    contributions: Correlation,
}

impl LatencyEvidence {
    /// Adds the dip of the next sample of a part, with its derivative by the latency.
    pub fn add(&mut self, part: usize, dip: &Equation, by_latency: f32) {
        let weighted = dip.weight * by_latency;
        self.information += weighted * by_latency;
        self.gradient -= weighted * dip.residual;
        self.contributions.add(part, [weighted * dip.residual, 0.0]);
    }

    /// The most likely latency, when samples are looked at with one of `used_s`, and its sigma. `known` is what the other
    /// unknowns explain of the information, `pulled` what of the gradient. `None` where samples have no rates, or no
    /// number comes out.
    pub fn latency(&self, used_s: f32, known: f32, pulled: f32) -> Option<Latency> {
        let prior = 1.0 / (PRIOR_SIGMA_S * PRIOR_SIGMA_S);
        let own = (self.information - known).max(0.0);
        let all = own + prior;
        let [excess, _] = self.contributions.excess();
        let found_s = used_s + (self.gradient - pulled - prior * used_s) / all;
        let sigma_s = libm::sqrtf(own * (1.0 + excess) + prior) / all;
        (self.information > 0.0 && (found_s + sigma_s).is_finite()).then_some(Latency { found_s, sigma_s })
    }
}

impl Latency {
    /// Whether it is known well enough, and is enough, to be used.
    const fn is_of_use(self) -> bool {
        self.sigma_s < MAX_SIGMA_S && self.is_certain()
    }

    const fn is_certain(self) -> bool {
        self.found_s.abs() > MIN_SIGMAS * self.sigma_s
    }

    /// What samples are to be looked at with next, seconds, after so many others and now `used_s`; none: all is well.
    /// What looks as if it could be of use is tried, and left again if it then is not.
    pub(super) fn next(self, used_s: f32, tried: u8) -> Option<f32> {
        if tried == 0 {
            return (self.sigma_s < MAX_SIGMA_AT_FIRST_S && self.is_certain()).then_some(self.found_s);
        }
        if used_s == 0.0 {
            return None;
        }
        if !self.is_of_use() {
            return Some(0.0);
        }
        let is_off = (self.found_s - used_s).abs() > SETTLED_SIGMAS * self.sigma_s;
        (is_off && tried < MAX_TRIED).then_some(self.found_s)
    }
}

impl Calibration {
    /// Whether a latency beyond the attitude source's own is in use.
    #[must_use]
    pub fn uses_latency(&self) -> bool {
        self.latency_s != 0.0
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

    fn dip(weight: f32, residual: f32) -> Equation {
        let row = Row { by_field: Vector3::zeros(), x: Vector3::zeros(), by_inclination: 0.0 };
        Equation::new(row, residual, 1.0 / weight, 1e6)
    }

    /// By hand, of three dips that do not resemble each other: what the others explain is taken out, and the prior put in.
    #[test]
    fn the_latency_is_that_of_its_parts() {
        let mut evidence = LatencyEvidence::default();
        for (weight, residual, by_latency) in [(1e4, -0.02, 0.5), (2e4, 0.01, 0.4), (1e4, -0.03, -0.3)] {
            evidence.add(0, &dip(weight, residual), by_latency);
        }
        let (information, gradient) = (2500.0 + 3200.0 + 900.0, 100.0 - 80.0 - 90.0);
        for used_s in [0.0, 0.05] {
            let found = evidence.latency(used_s, 600.0, 7.0).unwrap();
            let all = information - 600.0 + 100.0;
            assert!(close(found.found_s, used_s + (gradient - 7.0 - 100.0 * used_s) / all), "{found:?}");
            assert!(close(found.sigma_s, f32::sqrt(1.0 / all)), "{found:?}");
        }
        // What is left of nothing is the prior's.
        let open = evidence.latency(0.0, 1e6, 0.0).unwrap();
        assert!(close(open.sigma_s, 0.1), "{open:?}");
    }

    /// Contributions that are alike with rho of a half are worth a third, and the prior has no neighbours.
    #[test]
    fn contributions_that_are_alike_are_worth_less() {
        let mut evidence = LatencyEvidence::default();
        for residual in [0.01, 0.01, 0.0, 0.0, 0.01, 0.01, 0.0] {
            evidence.add(1, &dip(1e4, residual), 0.5);
        }
        let own = 7.0 * 2500.0;
        let found = evidence.latency(0.0, 0.0, 0.0).unwrap();
        assert!(close(found.sigma_s, f32::sqrt(own * 3.0 + 100.0) / (own + 100.0)), "{found:?}");
    }

    /// Without rates there is nothing to be known, and what is no number is none.
    #[test]
    fn without_rates_there_is_no_latency() {
        let mut evidence = LatencyEvidence::default();
        evidence.add(0, &dip(1e4, 0.01), 0.0);
        assert_eq!(evidence.latency(0.0, 0.0, 0.0), None);
        evidence.add(0, &dip(1e4, 0.01), 0.1);
        assert!(evidence.latency(0.0, 0.0, 0.0).is_some());
        assert_eq!(evidence.latency(0.0, 0.0, f32::NAN), None);
        assert_eq!(evidence.latency(f32::INFINITY, 0.0, 0.0), None);
    }

    /// 15 ms and three sigmas, either sign. At first, 30 ms will do.
    #[test]
    fn a_latency_is_used_where_it_is_known_and_matters() {
        for sign in [1.0, -1.0] {
            for (found_s, sigma_s, at_first, then) in [
                (0.1, 0.0149, true, true),
                (0.1, 0.0151, true, false),
                (0.1, 0.0299, true, false),
                (0.1, 0.0301, false, false),
                (0.031, 0.01, true, true),
                (0.029, 0.01, false, false),
                (f32::NAN, 0.01, false, false),
            ] {
                let latency = Latency { found_s: sign * found_s, sigma_s };
                assert_eq!(latency.next(0.0, 0), at_first.then_some(sign * found_s), "{latency:?}");
                // What is of no use is left, and not tried again.
                assert_eq!(latency.next(sign * found_s, 1), (!then).then_some(0.0), "{latency:?}");
                assert_eq!((latency.next(0.0, 1), latency.next(0.0, 2)), (None, None));
            }
        }
    }

    /// Half a sigma off is sought again, once.
    #[test]
    fn a_latency_that_was_off_is_sought_again() {
        let latency = Latency { found_s: -0.04, sigma_s: 0.01 };
        for (used_s, is_off) in [(-0.0349, true), (-0.0351, false), (-0.0449, false), (-0.0451, true)] {
            assert_eq!(latency.next(used_s, 1), is_off.then_some(-0.04), "{used_s}");
            assert_eq!(latency.next(used_s, 2), None);
        }
    }
}
