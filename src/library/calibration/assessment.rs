//! Assessment of a converged fit: quality, findings and advice.

use crate::calibration::advice::{self, Advice};
use crate::calibration::fit::ConvergedFit;
use crate::calibration::hypotheses::attitude_error::{AttitudeErrorFinding, AttitudeErrorTestInput};
use crate::calibration::hypotheses::attitude_error_table::{
    ATTITUDE_ERROR_COUNT, ATTITUDE_ERRORS, AttitudeErrorSigmas, BANK_SCALE_INDEX, LAGGING_BANK_SCALE_INDEX,
    MIN_REPORTED_SIGMAS, ROLL_BIAS_INDEX, assumed_sigmas,
};
use crate::calibration::hypotheses::hard_iron_change::{ConfirmedChange, HardIronScan};
use crate::calibration::statistics::discrepancy::Discrepancy;
use crate::calibration::types::coefficients::Calibration;
use crate::calibration::types::quality::{
    AttitudeLatency, BankScaleFinding, ConsiderSigmas, DetectedHardIronChange, Method, Quality, SolveError,
};
use crate::calibration::uncertainty::coefficient_covariance::CoefficientCovariance;
use crate::calibration::uncertainty::expected_error::{ExpectedError, expected_heading_error};
use crate::calibration::uncertainty::heading_uncertainty::{HeadingUncertainty, heading_uncertainty};
use crate::calibration::uncertainty::information::Information;
use crate::calibration::uncertainty::sandwich_covariance::{CovarianceContent, sandwich_covariance};
use crate::trig::sqrt;

/// Result of a solve.
#[derive(Clone, Copy, Debug)]
pub struct Solution {
    /// Calibration coefficients.
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
    /// Violation that was detected: a hard-iron change or a bank-angle scale error.
    pub violation: T,
    /// Contribution of the violation to the expected heading error, degrees RMS; adds in squares.
    pub added_error_deg: f32,
    /// Expected heading error without the violation, degrees RMS.
    pub error_without_violation_deg: f32,
}

impl<T> Finding<T> {
    fn new(violation: T, error_with_deg: f32, error_without_deg: f32) -> Self {
        let squared = error_with_deg * error_with_deg - error_without_deg * error_without_deg;
        Self { violation, added_error_deg: sqrt(squared.max(0.0)), error_without_violation_deg: error_without_deg }
    }
}

/// The more significant of a constant and a lagging bank-scale error, with the effect of both on the expected error. A
/// lagging one below `MIN_REPORTED_SIGMAS` is not reported, but its effect is included.
fn more_significant_bank_scale_finding(
    constant: Option<Finding<AttitudeErrorFinding>>,
    lagging: Option<Finding<AttitudeErrorFinding>>,
    error_with_deg: f32,
) -> Option<Finding<BankScaleFinding>> {
    let error_without_deg = constant.or(lagging)?.error_without_violation_deg;
    let lagging = lagging.filter(|finding| finding.violation.significance_sigmas > MIN_REPORTED_SIGMAS);
    let findings = [constant, lagging].into_iter().flatten().map(|finding| finding.violation);
    let larger = findings.max_by(|a, b| a.significance_sigmas.total_cmp(&b.significance_sigmas))?;
    let violation = BankScaleFinding {
        reported_bank_ratio: 1.0 / (1.0 + larger.estimate),
        significance_sigmas: larger.significance_sigmas,
    };
    Some(Finding::new(violation, error_with_deg, error_without_deg))
}

impl ConvergedFit<'_> {
    /// Computes the solution with quality, findings and advice.
    #[inline(never)]
    pub fn assess(
        &self,
        information: &mut Information,
        hard_iron_change: Option<ConfirmedChange>,
        latency: Option<AttitudeLatency>,
        consider_sigmas: ConsiderSigmas,
        needs_advice: impl Fn(&Quality) -> bool,
    ) -> Result<Solution, SolveError> {
        let mut sigmas = assumed_sigmas(consider_sigmas, latency);
        let mut covariance = CoefficientCovariance::ZERO;
        let mut expected = self.expected_error(information, &sigmas, &mut covariance)?;
        let (mut attitude_errors, mut iron_finding) = ([None; ATTITUDE_ERROR_COUNT], None);
        for (index, error) in ATTITUDE_ERRORS.iter().enumerate() {
            // Closed forms are too far from the maximum likelihood for the linearised test.
            let Some(test) = error.significance_test.filter(|_| self.method == Method::MaximumLikelihood) else {
                continue;
            };
            let assumed_sigma = sigmas[index];
            let Information { linear_system, residuals, attitude_error_sums: sums, .. } = &*information;
            let (roll_information, sums) = (sums[ROLL_BIAS_INDEX].information.x, &sums[index]);
            let input = AttitudeErrorTestInput {
                score_sums: sums,
                roll_information,
                linear_system,
                residuals,
                fit: self,
                assumed_sigma,
            };
            let Some(finding) = test(&input) else { continue };
            let error_without_deg = expected.rms_deg;
            sigmas[index] = finding.allowed_sigma(assumed_sigma);
            expected = self.expected_error(information, &sigmas, &mut covariance)?;
            attitude_errors[index] = Some(Finding::new(finding, expected.rms_deg, error_without_deg));
        }
        let bank_scale_error = more_significant_bank_scale_finding(
            attitude_errors[BANK_SCALE_INDEX],
            attitude_errors[LAGGING_BANK_SCALE_INDEX],
            expected.rms_deg,
        );
        if let Some(change) = hard_iron_change {
            let error_without_deg = expected.rms_deg;
            information.hard_iron_change = change.effect;
            expected = self.expected_error(information, &sigmas, &mut covariance)?;
            iron_finding = Some(Finding::new(change.detected_change, expected.rms_deg, error_without_deg));
        }
        let uncertainty = self.uncertainty(information, latency, &mut covariance)?;
        let quality = Quality {
            method: self.method,
            envelope: self.envelope(),
            expected_rms_deg: expected.rms_deg,
            expected_worst_deg: expected.worst_deg,
            norm_residual: self.likelihood.noise.norm_sigma,
            inclination_residual_deg: self.likelihood.noise.inclination_sigma_rad.to_degrees(),
            samples: information.linear_system.sample_count,
            latency,
            knows_inclination: self.method != Method::Ellipsoid || self.likelihood.known_inclination_rad.is_some(),
        };
        let advice = needs_advice(&quality).then(|| advice::select_manoeuvre(information, self, &sigmas)).flatten();
        Ok(Solution {
            calibration: *self.calibration,
            quality,
            uncertainty,
            advice,
            hard_iron_change: iron_finding,
            bank_scale_error,
        })
    }

    /// Heading variance without constant errors of the attitude source: they are the same in calibration and use and
    /// cancel. The monitor detects a change of them.
    #[inline(never)]
    fn uncertainty(
        &self,
        information: &Information,
        latency: Option<AttitudeLatency>,
        covariance: &mut CoefficientCovariance,
    ) -> Result<HeadingUncertainty, SolveError> {
        self.covariance(information, &assumed_sigmas(ConsiderSigmas::ZERO, latency), covariance)
            .and_then(|()| {
                let white_fraction = information.residuals.white_noise.white_noise_fraction();
                heading_uncertainty(self.likelihood, self.unknowns, covariance, white_fraction)
            })
            .ok_or(SolveError::NotConverged)
    }

    /// Adds one pass over the samples to the information. Tests turns for a hard-iron change, but no ground procedure,
    /// where people and objects move nearby. A separate function, so that its stack is free afterwards.
    #[inline(never)]
    pub fn accumulate_information(&self, information: &mut Information) -> Option<ConfirmedChange> {
        let Self { likelihood, unknowns, samples, .. } = *self;
        let is_turn_method = matches!(self.method, Method::MaximumLikelihood | Method::TwoPlane | Method::FourEllipse);
        let mut scan =
            is_turn_method.then(|| HardIronScan::new(samples, &information.linear_system, unknowns)).flatten();
        information.accumulate_samples(likelihood, samples, unknowns, scan.as_mut());
        if self.method != Method::MaximumLikelihood {
            // The error of a closed form is in its residuals, and in the remaining step.
            information.residuals.discrepancy = Discrepancy::default();
        }
        scan?.confirm_change(self, &information.linear_system, &information.residuals)
    }

    fn covariance(
        &self,
        information: &Information,
        sigmas: &AttitudeErrorSigmas,
        covariance: &mut CoefficientCovariance,
    ) -> Option<()> {
        sandwich_covariance(information, self.likelihood, self.unknowns, (CovarianceContent::All, sigmas), covariance)
    }

    fn expected_error(
        &self,
        information: &Information,
        sigmas: &AttitudeErrorSigmas,
        covariance: &mut CoefficientCovariance,
    ) -> Result<ExpectedError, SolveError> {
        self.covariance(information, sigmas, covariance)
            .and_then(|()| expected_heading_error(self.calibration, covariance, self.envelope()))
            .ok_or(SolveError::NotConverged)
    }
}
