//! Solution of a solve: quality, findings and advice for a converged fit.

use crate::calibration::advice;
use crate::calibration::advice::Advice;
use crate::calibration::hypotheses::bank_scale::BankScaleFinding;
use crate::calibration::hypotheses::hard_iron_change::{ConfirmedChange, HardIronScan};
use crate::calibration::model::{Likelihood, Vector13};
use crate::calibration::uncertainty::coefficient_covariance::CoefficientCovariance;
use crate::calibration::uncertainty::consider::ConsiderSigmas;
use crate::calibration::uncertainty::expected_error;
use crate::calibration::uncertainty::expected_error::ExpectedError;
use crate::calibration::uncertainty::heading_uncertainty::HeadingUncertainty;
use crate::calibration::uncertainty::information;
use crate::calibration::uncertainty::information::{CovarianceContent, Information};
use crate::calibration::{
    AttitudeLatency, Calibration, DetectedHardIronChange, Envelope, Method, Quality, Samples, SolveError,
};
use crate::trig::sqrt;

/// Result of a solve.
#[derive(Clone, Copy, Debug)]
pub struct Solution {
    /// The coefficients.
    pub calibration: Calibration,
    /// Expected quality of the coefficients.
    pub quality: Quality,
    /// Data for the variance of a heading.
    pub uncertainty: HeadingUncertainty,
    /// Recommended manoeuvre.
    pub advice: Option<Advice>,
    /// Finding: hard iron changed during the flight.
    pub hard_iron_change: Option<Finding<DetectedHardIronChange>>,
    /// Finding: bank-angle scale error of the attitude source.
    pub bank_scale_error: Option<Finding<BankScaleFinding>>,
}

/// A detected violation of an assumption. `quality` and `uncertainty` of the solution include its effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finding<T> {
    /// The violation.
    pub violation: T,
    /// Its share of the expected heading error, degrees RMS; adds in squares.
    pub added_error_deg: f32,
    /// Expected heading error without it, degrees RMS.
    pub expected_without_deg: f32,
}

impl<T> Finding<T> {
    fn new(of: T, with_deg: f32, without_deg: f32) -> Self {
        let squared = with_deg * with_deg - without_deg * without_deg;
        Self { violation: of, added_error_deg: sqrt(squared.max(0.0)), expected_without_deg: without_deg }
    }
}

pub(in crate::calibration) struct ConvergedFit<'a> {
    pub method: Method,
    pub likelihood: &'a Likelihood,
    pub unknowns: &'a Vector13,
    pub calibration: &'a Calibration,
    pub samples: Samples<'a>,
}

impl ConvergedFit<'_> {
    /// Computes the solution with quality, findings and advice.
    #[inline(never)]
    pub fn assess(
        &self,
        information: &mut Information,
        change: Option<ConfirmedChange>,
        latency: Option<AttitudeLatency>,
        consider: ConsiderSigmas,
        needs_advice: impl Fn(&Quality) -> bool,
    ) -> Result<Solution, SolveError> {
        let mut covariance = CoefficientCovariance::ZERO;
        let mut expected = self.expected(information, consider, &mut covariance)?;
        let (mut bank, mut iron, mut allowed) = (None, None, consider);
        // Closed forms are too far from the maximum likelihood for the linearised test.
        if self.method == Method::MaximumLikelihood
            && let Some(found) =
                information.bank_scale_score(self.likelihood, self.samples, self.unknowns, consider.bank_scale)
            && let Some(error) = found.significant_error(consider.bank_scale)
        {
            let without_deg = expected.rms_deg;
            allowed = consider.with_bank_scale(&found);
            expected = self.expected(information, allowed, &mut covariance)?;
            bank = Some(Finding::new(error, expected.rms_deg, without_deg));
        }
        if let Some(change) = change {
            let without_deg = expected.rms_deg;
            information.hard_iron_gradient = change.effect;
            expected = self.expected(information, allowed, &mut covariance)?;
            iron = Some(Finding::new(change.change, expected.rms_deg, without_deg));
        }
        let uncertainty = self.uncertainty(information, &mut covariance)?;
        let quality = Quality {
            method: self.method,
            envelope: self.envelope(),
            expected_rms_deg: expected.rms_deg,
            expected_worst_deg: expected.worst_deg,
            norm_residual: self.likelihood.noise.norm,
            inclination_residual_deg: self.likelihood.noise.inclination_sigma_rad.to_degrees(),
            samples: information.system.samples,
            latency,
        };
        let Self { likelihood, unknowns, calibration, .. } = self;
        let advice = needs_advice(&quality)
            .then(|| {
                advice::select_manoeuvre(
                    information,
                    likelihood,
                    unknowns,
                    allowed,
                    calibration,
                    (self.samples, self.envelope()),
                )
            })
            .flatten();
        Ok(Solution {
            calibration: *self.calibration,
            quality,
            uncertainty,
            advice,
            hard_iron_change: iron,
            bank_scale_error: bank,
        })
    }

    /// Heading variance without constant errors of the attitude source: they are the same in calibration and use and
    /// cancel. The monitor detects a change of them.
    #[inline(never)]
    fn uncertainty(
        &self,
        information: &Information,
        covariance: &mut CoefficientCovariance,
    ) -> Result<HeadingUncertainty, SolveError> {
        information
            .covariance(self.likelihood, self.unknowns, (CovarianceContent::All, ConsiderSigmas::ZERO), covariance)
            .and_then(|()| {
                information::heading_uncertainty(
                    self.likelihood,
                    self.unknowns,
                    covariance,
                    information.white_fraction(),
                )
            })
            .ok_or(SolveError::NotConverged)
    }

    /// Adds one pass over the samples, and tests turns for a hard-iron change; on the ground people and objects move
    /// nearby. A function of its own, to free its stack.
    #[inline(never)]
    pub fn accumulate_information(&self, information: &mut Information) -> Option<ConfirmedChange> {
        let Self { likelihood, unknowns, samples, .. } = *self;
        let is_turn_method = matches!(self.method, Method::MaximumLikelihood | Method::TwoPlane | Method::FourEllipse);
        let mut scan = is_turn_method.then(|| HardIronScan::new(samples, &information.system, unknowns)).flatten();
        information.accumulate_samples(likelihood, samples, unknowns, scan.as_mut());
        scan?.confirm_change(likelihood, samples, information, unknowns)
    }

    fn envelope(&self) -> Envelope {
        Envelope::for_samples(self.method, self.samples)
    }

    fn expected(
        &self,
        information: &Information,
        consider: ConsiderSigmas,
        covariance: &mut CoefficientCovariance,
    ) -> Result<ExpectedError, SolveError> {
        information
            .covariance(self.likelihood, self.unknowns, (CovarianceContent::All, consider), covariance)
            .and_then(|()| expected_error::expected_heading_error(self.calibration, covariance, self.envelope()))
            .ok_or(SolveError::NotConverged)
    }
}
