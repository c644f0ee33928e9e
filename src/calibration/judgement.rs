//! What was found, judged: how good it is expected to be, and whether the samples contradict what it rests on.

use super::advice::{self, Advice};
use super::bank_scale::BankError;
use super::constancy::{Change, IronChange, Scan};
use super::expected_error::{self, Envelope, Expected};
use super::information::{self, Consider, Errors, Information};
use super::likelihood::{Likelihood, Vector13};
use super::uncertainty::{Covariance, Uncertainty};
use super::{Calibration, Latency, Method, Quality, Samples, SolveError};

/// What came out.
#[derive(Clone, Copy, Debug)]
pub struct Solution {
    /// The coefficients.
    pub calibration: Calibration,
    /// How good they are expected to be.
    pub quality: Quality,
    /// How wrong a heading may be.
    pub uncertainty: Uncertainty,
    /// What would make them better.
    pub advice: Option<Advice>,
    /// That the iron changed while the samples were taken.
    pub iron: Option<Doubt<IronChange>>,
    /// That the attitude source reads more or less bank than there is.
    pub bank: Option<Doubt<BankError>>,
}

/// Something that the samples show to be otherwise than assumed. `quality` and `uncertainty` of a solution allow for
/// it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Doubt<T> {
    /// What.
    pub of: T,
    /// What it adds to the heading error to expect, degrees RMS, to be summed up as squares.
    pub error_deg: f32,
    /// The heading error to expect without it, degrees RMS.
    pub without_deg: f32,
}

impl<T> Doubt<T> {
    fn new(of: T, with_deg: f32, without_deg: f32) -> Self {
        let squared = with_deg * with_deg - without_deg * without_deg;
        Self { of, error_deg: libm::sqrtf(squared.max(0.0)), without_deg }
    }
}

/// A result that has settled, with the samples it is of.
pub(super) struct Judgement<'a> {
    pub method: Method,
    pub likelihood: &'a Likelihood,
    pub unknowns: &'a Vector13,
    pub calibration: &'a Calibration,
    pub samples: Samples<'a>,
}

impl Judgement<'_> {
    /// Judges it, with all that the samples say.
    ///
    /// # Errors
    ///
    /// [`SolveError::NotConverged`] when its errors are no numbers.
    #[inline(never)]
    pub fn pass(
        &self,
        information: &mut Information,
        change: Option<Change>,
        latency: Option<Latency>,
        consider: Consider,
        is_asked_for_advice: impl Fn(&Quality) -> bool,
    ) -> Result<Solution, SolveError> {
        let mut covariance = Covariance::EXACT;
        let mut expected = self.expected(information, consider, &mut covariance)?;
        let (mut bank, mut iron, mut allowed) = (None, None, consider);
        // About a closed form the problem is not linear enough to tell.
        if self.method == Method::MaximumLikelihood
            && let Some(found) = information.bank(self.likelihood, self.samples, self.unknowns, consider.bank_scale)
            && let Some(error) = found.error(consider.bank_scale)
        {
            let without_deg = expected.rms_deg;
            allowed = consider.with(&found);
            expected = self.expected(information, allowed, &mut covariance)?;
            bank = Some(Doubt::new(error, expected.rms_deg, without_deg));
        }
        if let Some(change) = change {
            let without_deg = expected.rms_deg;
            information.changed = change.effect;
            expected = self.expected(information, allowed, &mut covariance)?;
            iron = Some(Doubt::new(change.iron, expected.rms_deg, without_deg));
        }
        let uncertainty = self.uncertainty(information, &mut covariance)?;
        let quality = Quality {
            method: self.method,
            envelope: self.envelope(),
            expected_rms_deg: expected.rms_deg,
            expected_worst_deg: expected.worst_deg,
            norm_residual: self.likelihood.noise.norm,
            dip_residual_deg: self.likelihood.noise.dip_rad.to_degrees(),
            samples: information.system.samples,
            latency,
        };
        let Self { likelihood, unknowns, calibration, .. } = self;
        let advice = is_asked_for_advice(&quality)
            .then(|| {
                advice::advise(information, likelihood, unknowns, allowed, calibration, (self.samples, self.envelope()))
            })
            .flatten();
        Ok(Solution { calibration: *self.calibration, quality, uncertainty, advice, iron, bank })
    }

    /// What a heading's sigma is made of. Errors of the attitude source that stay the same are left out of it: the
    /// coefficients that were found with them take them out again in use, and the watch sees a change of them.
    #[inline(never)]
    fn uncertainty(&self, information: &Information, covariance: &mut Covariance) -> Result<Uncertainty, SolveError> {
        information
            .covariance(self.likelihood, self.unknowns, (Errors::All, Consider::NOTHING), covariance)
            .and_then(|()| {
                information::uncertainty(self.likelihood, self.unknowns, covariance, information.white_share())
            })
            .ok_or(SolveError::NotConverged)
    }

    /// Adds to the information what the samples say besides their equations, and looks for a change of the iron.
    /// Turns are looked at: who stands on the ground turns about what he moves. In a function of its own, whose sums
    /// leave the stack before the rest.
    #[inline(never)]
    pub fn look(&self, information: &mut Information) -> Option<Change> {
        let Self { likelihood, unknowns, samples, .. } = *self;
        let is_of_turns = matches!(self.method, Method::MaximumLikelihood | Method::TwoPlane | Method::FourEllipse);
        let mut scan = is_of_turns.then(|| Scan::new(samples, &information.system, unknowns)).flatten();
        information.look(likelihood, samples, unknowns, scan.as_mut());
        scan?.change(likelihood, samples, information, unknowns)
    }

    fn envelope(&self) -> Envelope {
        Envelope::of(self.method, self.samples)
    }

    fn expected(
        &self,
        information: &Information,
        consider: Consider,
        covariance: &mut Covariance,
    ) -> Result<Expected, SolveError> {
        information
            .covariance(self.likelihood, self.unknowns, (Errors::All, consider), covariance)
            .and_then(|()| expected_error::expected(self.calibration, covariance, self.envelope()))
            .ok_or(SolveError::NotConverged)
    }
}
