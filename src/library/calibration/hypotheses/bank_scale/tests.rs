use nalgebra::{Vector1, Vector3};

use super::*;
use crate::calibration::hypotheses::score_test::ScoreTest;
use crate::calibration::model::JacobianRow;
use crate::calibration::tests::{ZERO_ROW, constant_equation, is_close};

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
fn the_estimate_adds_to_the_assumed_sigma_in_quadrature() {
    // Information 1e4: an estimate of 0.1 with variance 1e-4.
    let found = estimate(&[(constant_equation(1e4, -0.1), [0.0, 1.0])], 0.0, 0.0, 0.0, 1.0).unwrap();
    let allowed = found.finding(0.01).unwrap().allowed_sigma(0.01);
    assert!((allowed - (0.01_f32.powi(2) + 0.1_f32.powi(2)).sqrt()).abs() < 1e-5);
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

/// The incomplete last cluster of a part counts, too.
#[test]
fn twelve_samples_form_a_cluster() {
    // Cluster sums of the scores: 12, -12, 12 and 12 in the first part, 6 in the second.
    let first = (0..48).map(|i| (0, if (12..24).contains(&i) { -1.0 } else { 1.0 }));
    let second = (0..6).map(|_| (1, 1.0));
    let interleaved = first.zip(second.map(Some).chain(core::iter::repeat(None)));
    let found = clusters(interleaved.flat_map(|(a, b)| core::iter::once(a).chain(b))).variance();
    let sums = [12.0, -12.0, 12.0, 12.0, 6.0_f32];
    let mean = sums.iter().sum::<f32>() / 5.0;
    let expected = sums.iter().map(|s| (s - mean) * (s - mean)).sum::<f32>() * 5.0 / 4.0;
    assert!(is_close(found, expected), "{found} {expected}");
    assert!(!clusters((0..5).map(|_| (0, 1.0))).variance().is_finite());
}

#[test]
fn score_contributions_exclude_the_nuisance_parameters() {
    let row = JacobianRow { derivative_by_field: Vector3::x() * 3.0, centred_field: Vector3::z(), ..ZERO_ROW };
    let column = Vector13::ith(2, 0.5);
    let equations = SampleEquations {
        norm_equation: ResidualEquation::new(row, 0.1, 1.0 / 10.0, 1e6),
        inclination_equation: Some(ResidualEquation::new(row, -0.2, 1.0 / 4.0, 1e6)),
        heading_equation: None,
        inclination_derivatives_by_attitude: [0.0, 0.0],
    };
    let mut clusters = ClusterVariance::default();
    clusters.add_sample_score(0, &equations, 2.0, &column);
    let (sum, samples) = clusters.open_clusters[0];
    assert!(is_close(sum, 10.0 * 0.1 * -1.5 + 4.0 * -0.2 * (2.0 - 1.5)) && samples == 1, "{sum}");
    clusters.add_sample_score(PART_COUNT, &equations, 2.0, &column);
    assert_eq!(clusters.open_clusters.iter().map(|open| open.1).sum::<u8>(), 1);
}

#[test]
fn the_larger_of_cluster_and_estimate_variance_is_used() {
    let scattered = clusters((0..48).map(|i| (0, if i / 12 % 2 == 0 { 1.0 } else { -1.0 })));
    let expected = scattered.variance() / 1e8;
    assert!(is_close(estimate_with_sigma(0.1, 1e-4).with_cluster_variance(scattered).unwrap().variance, expected));
    assert!(is_close(estimate_with_sigma(0.1, 0.01).with_cluster_variance(scattered).unwrap().variance, 1e-4));
}
