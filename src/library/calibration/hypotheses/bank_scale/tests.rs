use nalgebra::Vector1;

use super::*;
use crate::calibration::hypotheses::score_test::ScoreTest;
use crate::calibration::tests::{constant_equation, is_close};

/// Inclination residuals with their derivatives by roll and by the bank-angle scale error. The nuisance
/// parameters explain a part of information and gradient, which is subtracted.
fn estimate(
    evidence: &[(ResidualEquation, [f32; 2])],
    explained_information: f32,
    explained_gradient: f32,
    roll_sigma_rad: f32,
    inflation: f32,
) -> Option<BankScaleEstimate> {
    let [mut roll, mut bank] = [(); 2].map(|()| ScoreTest::zero());
    for (equation, [by_roll, by_bank]) in evidence {
        roll.add_weighted_equation(equation, &Vector1::new(*by_roll), 1.0);
        bank.add_weighted_equation(equation, &Vector1::new(*by_bank), 1.0);
    }
    let score = EfficientScore {
        nuisance_columns: [Vector13::zeros()],
        information: bank.information.add_scalar(-explained_information),
        gradient: bank.gradient.add_scalar(-explained_gradient),
    };
    BankScaleEstimate::new(&score, roll.information.x * roll_sigma_rad * roll_sigma_rad, inflation)
}

#[test]
fn estimate_equals_hand_calculation() {
    let evidence = [(constant_equation(100.0, -0.3), [0.5, 2.0]), (constant_equation(50.0, 0.2), [-1.0, -3.0])];
    let (information, gradient) = (100.0 * 4.0 + 50.0 * 9.0, 100.0 * 2.0 * 0.3 + 50.0 * 3.0 * 0.2);
    let noise = (100.0 * 0.25 + 50.0) * 0.04;
    let found = estimate(&evidence, 150.0, 7.0, 0.2, 1.5).unwrap();
    let bank_information = information - 150.0 - noise;
    assert!(is_close(found.missing_bank_share, (gradient - 7.0 + noise) / bank_information), "{found:?}");
    assert!(is_close(found.variance, (information - 150.0) * 1.5 / (bank_information * bank_information)), "{found:?}");
    assert!(is_close(found.finding(0.0).unwrap().estimate, found.missing_bank_share));
}

#[test]
fn an_estimate_mainly_from_noise_is_rejected() {
    let evidence = [(constant_equation(1e6, 0.0), [1.0, 1.0])];
    assert!(estimate(&evidence, 0.0, 0.0, 0.3, 1.0).is_some());
    assert!(estimate(&evidence, 0.0, 0.0, 0.9, 1.0).is_none());
    assert!(estimate(&evidence, f32::NAN, 0.0, 0.1, 1.0).is_none());
    assert!(estimate(&evidence, 0.0, f32::NAN, 0.1, 1.0).is_none());
    assert!(estimate(&[], 0.0, 0.0, 0.1, 1.0).is_none());
}

fn estimate_with_sigma(missing: f32, sigma: f32) -> BankScaleEstimate {
    BankScaleEstimate { missing_bank_share: missing, variance: sigma * sigma, score_information: 1e4 }
}

/// Estimate and allowance together have a sigma of 2.2 %. Good sources show twice that by chance; the allowance grows
/// gradually, so that little evidence is no jump.
#[test]
fn a_significant_bank_scale_error_is_allowed_for() {
    for (missing, least, most) in [(0.02_f32, 0.0, 0.0), (0.04, 1e-6, 0.04 * 0.04), (0.1, 0.01 - 1e-6, 0.01 + 1e-6)] {
        for missing in [missing, -missing] {
            let found = estimate_with_sigma(missing, 0.02);
            assert!((least..=most).contains(&found.excess_square(0.01)), "{missing}: {}", found.excess_square(0.01));
            let Some(finding) = found.finding(0.01) else {
                assert!(most == 0.0, "{missing}");
                continue;
            };
            assert!(most > 0.0 && is_close(finding.estimate, missing), "{finding:?}");
            assert!(is_close(finding.significance_sigmas, missing.abs() / 5e-4_f32.sqrt()), "{finding:?}");
        }
    }
}

#[test]
fn an_uncertain_estimate_is_rejected() {
    for (missing, sigma, is_accepted) in [(0.1, 0.03, true), (0.1, 0.08, false), (0.25, 0.1, false), (0.5, 0.1, true)] {
        for missing in [missing, -missing] {
            let found = estimate_with_sigma(missing, sigma).with_cluster_variance(ClusterVariance::default());
            assert_eq!(found.is_some(), is_accepted, "{missing} {sigma}");
        }
    }
}

fn clusters(contributions: impl Iterator<Item = (usize, f32)>) -> ClusterVariance {
    let mut clusters = ClusterVariance::default();
    let column = Vector13::zeros();
    for (part, contribution) in contributions {
        let norm = constant_equation(1.0, 5.0);
        let inclination = Some(constant_equation(1.0, contribution));
        let equations = SampleEquations {
            norm_equation: norm,
            inclination_equation: inclination,
            heading_equation: None,
            inclination_derivatives_by_attitude: [7.0, 7.0],
        };
        clusters.add_sample_score(part, &equations, 1.0, &column);
    }
    clusters
}

#[test]
fn the_larger_of_cluster_and_estimate_variance_is_used() {
    let scattered = clusters((0..48).map(|i| (0, if i / 12 % 2 == 0 { 1.0 } else { -1.0 })));
    let expected = scattered.variance() / 1e8;
    assert!(is_close(estimate_with_sigma(0.1, 1e-4).with_cluster_variance(scattered).unwrap().variance, expected));
    assert!(is_close(estimate_with_sigma(0.1, 0.01).with_cluster_variance(scattered).unwrap().variance, 1e-4));
}
