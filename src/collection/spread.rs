//! Which of many samples tells least: what a full buffer of whatever was flown gives up.
//!
//! Of the coefficients a sample says two things (METHOD in [`likelihood`](crate::calibration)): the corrected field has
//! one strength, and one dip. What a set of samples determines is the determinant of the information about all unknowns
//! together (D-optimality, V. V. Fedorov, "Theory of Optimal Experiments", 1972). By a sample's leverage `l = x^T M^-1 x`
//! the set is worth less by the factor `1 - l` without it, and the one whose two equations have the least goes.
//!
//! What the equations are depends on the coefficients, which are not known yet. A linear change of the unknowns, such as
//! soft iron, scales the determinant for all sets alike; what it takes is where the field points, and to some ten or twenty
//! degrees a sphere through the samples tells that.

use nalgebra::Vector3;

use crate::calibration::{LeastSquares, Prediction, Row, Sample, Samples, Squares, centre};

/// What is known of each unknown beforehand, in dips: keeps what was never flown from being infinitely dear, and above
/// what `f32` can tell from nothing in a sum over all samples.
const RIDGE: f32 = 0.01;

/// A reading is no nearer to the centre than this, microtesla: keeps its direction a number.
const MIN_UT: f32 = 1e-3;

/// What a sample says, of its strength and of its dip. By the direction of its reading, without its size: of samples that
/// are chosen by what noise makes of them all noise would lie to one side.
fn rows(centre_ut: &Vector3<f32>, sample: &Sample) -> [Row; 2] {
    let field_ut = sample.field.ut - centre_ut;
    let direction = field_ut / field_ut.norm().max(MIN_UT);
    let prediction = Prediction::new(direction, &direction, &sample.attitude.tilt());
    [prediction.norm_row(), prediction.dip_row()]
}

/// The first sample, which is new, is worth so much less than it seems. Noise makes a reading seem worth more, and of many
/// readings those would be kept that it makes so.
const NEW: f32 = 0.8;

/// The place of the sample that tells least of all of these, of which the first is new; `None` if nothing can be told.
#[inline(never)]
pub(super) fn weakest(samples: Samples<'_>) -> Option<usize> {
    let centre_ut = centre(samples).map(|(centre_ut, _)| centre_ut).filter(|ut| ut.iter().all(|c| c.is_finite()))?;
    let mut squares = Squares::none();
    for sample in samples.all() {
        let [strength, dip] = rows(&centre_ut, sample);
        // One as much as the other: a sensor may be the better one, or an attitude.
        squares.add_two([&strength, &dip], [1.0; 2]);
    }
    let mut information = squares.triangle();
    for (i, row) in information.iter_mut().enumerate() {
        row[i] += RIDGE;
    }
    let design = LeastSquares::<_, 1>::of_normal_equations(information, [[0.0]; _]);
    let worth = |sample: &Sample| rows(&centre_ut, sample).map(|row| design.variance(&row.dense())).iter().sum::<f32>();
    let certain = core::iter::once(NEW).chain(core::iter::repeat(1.0));
    let worths = samples.all().zip(certain).map(|(sample, certain)| certain * worth(sample)).enumerate();
    worths.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(place, _)| place)
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use nalgebra::Matrix3;
    use testkit::random::Random;

    use super::super::testing::sample;
    use super::*;
    use crate::frames::{Attitude, Field, Level};

    /// At a tilt, in an aircraft of some iron.
    fn at(heading_rad: f32, roll_deg: f32, pitch_deg: f32, iron: &Matrix3<f32>) -> Sample {
        let attitude = Attitude::from_deg(roll_deg, pitch_deg);
        let body = attitude.body(Field::<Level>::earth(50.0, 1.1, heading_rad)).ut;
        let field = iron * body + Vector3::new(60.0, -45.0, 80.0);
        Sample { attitude, ..sample(field.into(), 0) }
    }

    /// Sixty samples all round, tilted by up to 20 deg to all sides.
    fn varied(iron: &Matrix3<f32>) -> Vec<Sample> {
        let mut random = Random(3);
        (0..60)
            .map(|_| {
                let heading_rad = random.uniform(0.0, TAU);
                at(heading_rad, random.uniform(-20.0, 20.0), random.uniform(-20.0, 20.0), iron)
            })
            .collect()
    }

    fn weakest_of(samples: &[Sample]) -> Option<usize> {
        weakest(Samples { left: samples, ..Samples::default() })
    }

    /// One of many alike, wherever they are.
    #[test]
    fn what_is_there_many_times_tells_least() {
        for first in [0, 20, 60] {
            let mut samples = varied(&Matrix3::identity());
            samples.splice(first..first, vec![at(1.0, 0.0, 0.0, &Matrix3::identity()); 40]);
            let place = weakest_of(&samples).unwrap();
            assert!((first..first + 40).contains(&place), "{first} {place}");
        }
    }

    /// Neither the one that is tilted the most, of the others level, nor the one at another heading.
    #[test]
    fn what_is_there_once_stays() {
        let level = |i: u8| at(f32::from(i) / 40.0 * TAU, 0.0, 0.0, &Matrix3::identity());
        for rare in [at(0.3, 15.0, 0.0, &Matrix3::identity()), at(0.3, 0.0, -15.0, &Matrix3::identity())] {
            let mut samples: Vec<Sample> = (0..40).map(level).collect();
            samples.insert(7, rare);
            while samples.len() > 13 {
                let place = weakest_of(&samples).unwrap();
                assert_ne!(samples.remove(place), rare, "of {}", samples.len());
            }
        }
    }

    /// Iron that bends the readings by up to 20 deg and a third: most of what is kept is the same.
    #[test]
    fn iron_changes_little_of_what_a_sample_is_worth() {
        let bent = Matrix3::new(1.3, 0.2, -0.1, 0.05, 0.7, 0.15, -0.2, 0.1, 1.1);
        let kept = [Matrix3::identity(), bent].map(|iron| {
            let mut samples: Vec<(usize, Sample)> = varied(&iron).into_iter().enumerate().collect();
            while samples.len() > 20 {
                let bare: Vec<Sample> = samples.iter().map(|&(_, sample)| sample).collect();
                samples.remove(weakest_of(&bare).unwrap());
            }
            samples.into_iter().map(|(number, _)| number).collect::<Vec<_>>()
        });
        let both = kept[0].iter().filter(|number| kept[1].contains(number)).count();
        // By chance it would be 7.
        assert!(both >= 12, "{both} of 20");
    }

    /// The same reading at another attitude says something else of the dip; one that is the stronger by noise alone says
    /// nothing else: among its like it goes as they do.
    #[test]
    fn another_attitude_counts_and_noise_of_the_strength_does_not() {
        let level: Vec<Sample> =
            (0..40).map(|i: u8| at(f32::from(i) / 40.0 * TAU, 0.0, 0.0, &Matrix3::identity())).collect();
        let tilted = Sample { attitude: Attitude::from_deg(8.0, 0.0), ..level[3] };
        let mut samples = level;
        samples.push(tilted);
        for _ in 0..20 {
            let place = weakest_of(&samples).unwrap();
            assert_ne!(samples.remove(place), tilted);
        }
        // Twice each of a varied flight, the second 2 % stronger: they go as often as the others do, not less.
        let samples = varied(&Matrix3::identity());
        let centre_ut = Vector3::new(60.0, -45.0, 80.0);
        let stronger = |s: &Sample| Sample { field: Field::new(centre_ut + (s.field.ut - centre_ut) * 1.02), ..*s };
        let mut both: Vec<(bool, Sample)> = samples.iter().flat_map(|s| [(false, *s), (true, stronger(s))]).collect();
        while both.len() > 60 {
            let bare: Vec<Sample> = both.iter().map(|&(_, sample)| sample).collect();
            both.remove(weakest_of(&bare).unwrap());
        }
        let kept = both.iter().filter(|(is_stronger, _)| *is_stronger).count();
        assert!((22..=38).contains(&kept), "{kept} of 60");
    }

    /// Of samples that are all as good as each other all round, the new one goes, and not by the order of its place alone:
    /// with a tenth more tilt it seems worth more by a fifth at most, with twice as much it is.
    #[test]
    fn what_is_new_must_be_clearly_worth_more() {
        let ring = |tilt_deg: f32| (0..40_u8).map(move |i| (f32::from(i) / 40.0 * TAU, tilt_deg));
        let others = ring(10.0).chain(ring(-10.0)).map(|(heading, roll)| at(heading, roll, 0.0, &Matrix3::identity()));
        let others: Vec<Sample> = others.collect();
        for (roll_deg, goes) in [(10.0, true), (10.6, true), (20.0, false)] {
            let new = at(0.05, roll_deg, 0.0, &Matrix3::identity());
            let samples: Vec<Sample> = core::iter::once(new).chain(others.iter().copied()).collect();
            assert_eq!(weakest_of(&samples) == Some(0), goes, "{roll_deg}");
        }
    }

    #[test]
    fn of_readings_that_are_all_alike_nothing_can_be_told() {
        assert_eq!(weakest_of(&[]), None);
        assert_eq!(weakest_of(&vec![sample([20.0, 0.0, 40.0], 0); 30]), None);
    }
}
