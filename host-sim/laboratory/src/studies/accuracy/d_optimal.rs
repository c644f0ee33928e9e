//! D-optimal selection of samples, given the whole flight and the true parameters.
//!
//! The criterion is the determinant of the Fisher information of the thirteen common parameters (V. V. Fedorov, "Theory
//! of Optimal Experiments", 1972). Samples are added one by one, each with the largest gain. The gain in
//! log-determinant is submodular, so the greedy selection is within `1 - 1/e` of the optimum, and a sample whose last
//! known gain is smaller than another's present gain need not be evaluated again (M. Minoux, "Accelerated greedy
//! algorithms", 1978).

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::Matrix2;

use super::cramer_rao::{self, FisherInformation, InformationRoot};
use super::random_flight::{RandomFlight, TrueSample};

/// Prior standard deviations: soft-iron elements (relative), hard iron (in units of the field), inclination (rad). They
/// affect only the first dozen samples, until the parameters are observable.
const PRIOR_SIGMAS: [f64; 3] = [0.3, 3.0, 1.0];

/// Sample with its last computed gain.
struct SampleCandidate {
    gain: f64,
    sample_index: usize,
    /// Number of selected samples when the gain was computed.
    selected_count_at_evaluation: usize,
}

impl PartialEq for SampleCandidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for SampleCandidate {}

impl PartialOrd for SampleCandidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Ordered by gain; equal gains by earlier sample.
impl Ord for SampleCandidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.gain.total_cmp(&other.gain).then(other.sample_index.cmp(&self.sample_index))
    }
}

/// The `sample_count` most informative samples of a flight, or all if there are fewer, in the order of selection.
#[must_use]
pub fn select_samples(trial: &RandomFlight, sample_count: usize) -> Vec<TrueSample> {
    let true_samples: Vec<&TrueSample> = trial.true_samples().collect();
    let rows: Vec<InformationRoot> =
        true_samples.iter().map(|true_sample| cramer_rao::information_root(trial, true_sample)).collect();
    let mut covariance = prior_covariance();
    let gain = |covariance: &FisherInformation, sample_index: usize| {
        libm::log(information_gain_matrix(covariance, &rows[sample_index]).determinant())
    };
    let candidate = |sample_index| SampleCandidate {
        gain: gain(&covariance, sample_index),
        sample_index,
        selected_count_at_evaluation: 0,
    };
    let mut candidates: BinaryHeap<SampleCandidate> = (0..rows.len()).map(candidate).collect();
    let mut chosen = Vec::new();
    while chosen.len() < sample_count
        && let Some(best_candidate) = candidates.pop()
    {
        if best_candidate.selected_count_at_evaluation < chosen.len() {
            candidates.push(SampleCandidate {
                gain: gain(&covariance, best_candidate.sample_index),
                selected_count_at_evaluation: chosen.len(),
                ..best_candidate
            });
            continue;
        }
        covariance = covariance_with_sample(&covariance, &rows[best_candidate.sample_index]);
        chosen.push(*true_samples[best_candidate.sample_index]);
    }
    chosen
}

/// Cramér-Rao bound of the RMS heading error for a selection of `sample_count` samples, degrees.
#[must_use]
pub fn bound_rms_deg(trial: &RandomFlight, sample_count: usize) -> Option<f64> {
    cramer_rao::bound_deg_of_samples(trial, select_samples(trial, sample_count).iter())
}

fn prior_covariance() -> FisherInformation {
    let [soft, hard, inclination] = PRIOR_SIGMAS;
    let sigma = |unknown| match unknown {
        0..9 => soft,
        9..12 => hard,
        _ => inclination,
    };
    FisherInformation::from_fn(|row, column| if row == column { sigma(row) * sigma(row) } else { 0.0 })
}

/// `1 + R C R^T`; its determinant is the factor by which the sample increases the determinant of the information.
fn information_gain_matrix(covariance: &FisherInformation, rows: &InformationRoot) -> Matrix2<f64> {
    Matrix2::identity() + rows * covariance * rows.transpose()
}

/// Covariance after adding a sample: `C - C R^T (1 + R C R^T)^-1 R C` (Woodbury identity).
fn covariance_with_sample(covariance: &FisherInformation, rows: &InformationRoot) -> FisherInformation {
    let to_rows = rows * covariance;
    // Positive definite, so the inverse exists.
    let inverse = information_gain_matrix(covariance, rows).try_inverse().unwrap_or_else(Matrix2::zeros);
    let reduced = covariance - to_rows.tr_mul(&(inverse * to_rows));
    (reduced + reduced.transpose()) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::studies::accuracy::flight::{FlightPattern, StudyFlight};
    use crate::studies::accuracy::random_flight::{RandomRanges, StudyEnvelope};
    use simulator::world::aircraft::VehicleKind;

    fn random_flight_with_samples(samples: usize) -> RandomFlight {
        RandomFlight::draw_flight(&RandomRanges { samples_per_side: samples, ..RandomRanges::WORST_CASE }, 3)
    }

    /// Reference: evaluates every sample in every step and inverts the whole matrix.
    #[test]
    fn lazy_selection_equals_exhaustive_selection() {
        let trial = random_flight_with_samples(30);
        let rows: Vec<InformationRoot> =
            trial.true_samples().map(|true_sample| cramer_rao::information_root(&trial, true_sample)).collect();
        let mut information = prior_covariance().try_inverse().unwrap();
        let mut remaining: Vec<usize> = (0..rows.len()).collect();
        let mut exhaustive = Vec::new();
        for _ in 0..20 {
            let information_with_sample =
                |sample_index: usize| information + rows[sample_index].tr_mul(&rows[sample_index]);
            let determinant = |sample_index: &usize| information_with_sample(*sample_index).determinant();
            let best = *remaining.iter().max_by(|a, b| determinant(a).total_cmp(&determinant(b))).unwrap();
            information = information_with_sample(best);
            remaining.retain(|&sample_index| sample_index != best);
            exhaustive.push(trial.true_samples().nth(best).unwrap().time.as_ms());
        }
        let lazy: Vec<u32> = select_samples(&trial, 20).iter().map(|true_sample| true_sample.time.as_ms()).collect();
        assert_eq!(lazy, exhaustive);
    }

    #[test]
    fn selected_samples_have_a_lower_bound_than_evenly_thinned_ones() {
        let flight =
            StudyFlight { kind: VehicleKind::Copter, flight_pattern: FlightPattern::Routine, duration_minutes: 3.0 }
                .true_flight(&RandomRanges::WORST_CASE, 3);
        let trial = random_flight_with_samples(1).with_flight(flight, StudyEnvelope::Tilted);
        let thinned = cramer_rao::bound_deg_of_samples(&trial, trial.true_samples().step_by(9)).unwrap();
        let chosen = bound_rms_deg(&trial, 200).unwrap();
        assert!(chosen < 0.9 * thinned, "{chosen} {thinned}");
        assert!(bound_rms_deg(&trial, 400).unwrap() < chosen);
        assert_eq!(select_samples(&trial, 10_000).len(), 1800);
        let all_samples_deg = bound_rms_deg(&trial, 10_000).unwrap();
        assert!((all_samples_deg / cramer_rao::bound_rms_deg(&trial).unwrap() - 1.0).abs() < 1e-9);
    }
}
