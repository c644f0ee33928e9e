//! The best set of readings that could have been chosen afterwards, with the whole flight and the truth at hand.
//!
//! Best is D-optimal: the largest determinant of the information on the thirteen common unknowns (V. V. Fedorov, "Theory
//! of Optimal Experiments", 1972). Readings are added one by one, each the one that adds most. What a reading adds to the
//! logarithm of the determinant shrinks with every other that is there (it is submodular), so the greedy choice is within
//! `1 - 1/e` of the best there is, and a reading need not be looked at again while another's gain, as of now, is above its
//! last known one (M. Minoux, "Accelerated greedy algorithms", 1978).

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::Matrix2;

use super::bound::{self, Matrix13, Rows};
use super::trial::{Instant, Trial};

/// What is known beforehand, 1 sigma: each element of soft iron to 30 %, hard iron to three times the field, inclination
/// to 1 rad. It decides on the first dozen readings, until they determine the unknowns themselves.
const PRIOR_SIGMAS: [f64; 3] = [0.3, 3.0, 1.0];

/// A reading with what it would have added when that was last looked at.
struct Candidate {
    gain: f64,
    index: usize,
    /// How many had been chosen then.
    as_of: usize,
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// By gain; of two alike the earlier reading.
impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        self.gain.total_cmp(&other.gain).then(other.index.cmp(&self.index))
    }
}

/// Chooses so many instants of a flight, or all if there are fewer, the most informative first.
#[must_use]
pub fn choose(trial: &Trial, number: usize) -> Vec<Instant> {
    let instants: Vec<&Instant> = trial.instants().collect();
    let rows: Vec<Rows> = instants.iter().map(|instant| bound::rows(trial, instant)).collect();
    let mut covariance = prior();
    let gain = |covariance: &Matrix13, index: usize| added(covariance, &rows[index]).determinant().ln();
    let candidate = |index| Candidate { gain: gain(&covariance, index), index, as_of: 0 };
    let mut candidates: BinaryHeap<Candidate> = (0..rows.len()).map(candidate).collect();
    let mut chosen = Vec::new();
    while chosen.len() < number
        && let Some(best) = candidates.pop()
    {
        if best.as_of < chosen.len() {
            candidates.push(Candidate { gain: gain(&covariance, best.index), as_of: chosen.len(), ..best });
            continue;
        }
        covariance = with(&covariance, &rows[best.index]);
        chosen.push(*instants[best.index]);
    }
    chosen
}

/// RMS heading error of the bound with so many readings chosen in this way, degrees.
#[must_use]
pub fn rms_deg(trial: &Trial, number: usize) -> Option<f64> {
    bound::rms_deg_of(trial, choose(trial, number).iter())
}

fn prior() -> Matrix13 {
    let [soft, hard, inclination] = PRIOR_SIGMAS;
    let sigma = |unknown| match unknown {
        0..9 => soft,
        9..12 => hard,
        _ => inclination,
    };
    Matrix13::from_fn(|row, column| if row == column { sigma(row) * sigma(row) } else { 0.0 })
}

/// `1 + R C R^T`: its determinant is by how much the reading multiplies that of the information.
fn added(covariance: &Matrix13, rows: &Rows) -> Matrix2<f64> {
    Matrix2::identity() + rows * covariance * rows.transpose()
}

/// The covariance with one more reading: `C - C R^T (1 + R C R^T)^-1 R C` (Sherman, Morrison, Woodbury).
fn with(covariance: &Matrix13, rows: &Rows) -> Matrix13 {
    let to_rows = rows * covariance;
    // One plus something positive: it has an inverse.
    let inverse = added(covariance, rows).try_inverse().unwrap_or_else(Matrix2::zeros);
    let less = covariance - to_rows.tr_mul(&(inverse * to_rows));
    (less + less.transpose()) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::flight::{Flight, Pattern};
    use crate::accuracy::trial::{Envelope, Ranges};
    use crate::world::aircraft::Kind;

    fn trial(samples: usize) -> Trial {
        Trial::draw(&Ranges { samples, ..Ranges::HARSH }, 3)
    }

    /// Against the plain way, which looks at every reading for every choice, and inverts the whole matrix.
    #[test]
    fn the_lazy_choice_is_the_plain_one() {
        let trial = trial(30);
        let rows: Vec<Rows> = trial.instants().map(|instant| bound::rows(&trial, instant)).collect();
        let mut information = prior().try_inverse().unwrap();
        let mut left: Vec<usize> = (0..rows.len()).collect();
        let mut plain = Vec::new();
        for _ in 0..20 {
            let with = |index: usize| information + rows[index].tr_mul(&rows[index]);
            let determinant = |index: &usize| with(*index).determinant();
            let best = *left.iter().max_by(|a, b| determinant(a).total_cmp(&determinant(b))).unwrap();
            information = with(best);
            left.retain(|&index| index != best);
            plain.push(trial.instants().nth(best).unwrap().time.count());
        }
        let lazy: Vec<u32> = choose(&trial, 20).iter().map(|instant| instant.time.count()).collect();
        assert_eq!(lazy, plain);
    }

    /// Of a copter's routine in a flight of three minutes; and there are never more than there are.
    #[test]
    fn chosen_readings_say_more_than_thinned_ones() {
        let flight = Flight { kind: Kind::Copter, pattern: Pattern::Routine, minutes: 3.0 }.fly(&Ranges::HARSH, 3);
        let trial = trial(1).flying(flight, Envelope::Tilted);
        let thinned = bound::rms_deg_of(&trial, trial.instants().step_by(9)).unwrap();
        let chosen = rms_deg(&trial, 200).unwrap();
        assert!(chosen < 0.9 * thinned, "{chosen} {thinned}");
        assert!(rms_deg(&trial, 400).unwrap() < chosen);
        assert_eq!(choose(&trial, 10_000).len(), 1800);
        let all = rms_deg(&trial, 10_000).unwrap();
        assert!((all / bound::rms_deg(&trial).unwrap() - 1.0).abs() < 1e-9);
    }
}
