//! Which of many samples tells least: what a full buffer of whatever was flown gives up.
//!
//! Of the coefficients a sample says two things (METHOD in [`likelihood`](crate::calibration)): the corrected field has
//! one strength, and one component along the vertical `u`. With `p`, the reading in any affine coordinates, the second is
//! linear in `u (p, 1)^T`, twelve products, and the first in the ten monomials of `p` up to the second degree. What a set
//! of samples determines is the determinant of the information about either (D-optimality, V. V. Fedorov, "Theory of
//! Optimal Experiments", 1972), and a linear change of the unknowns, such as another calibration, scales it for all sets
//! alike. So no calibration is needed to tell what a sample is worth: by its leverage `l = x^T M^-1 x` the set is worth
//! less by the factor `1 - l` without it, and the one with the least of both leverages goes.

use nalgebra::{SVector, Vector3};

use crate::calibration::{LeastSquares, Sample};
use crate::frames::Field;

/// Unknowns of the vertical component; those of the strength are two fewer.
const UNKNOWNS: usize = 12;

/// What is known of each unknown beforehand, in samples: keeps what was never flown from being infinitely dear.
const RIDGE: f32 = 1e-3;

type Row = SVector<f32, UNKNOWNS>;

/// Coordinates in which readings are of the order of one.
struct Scale {
    mean_ut: Vector3<f32>,
    per_ut: f32,
}

impl Scale {
    fn of<'a>(samples: impl Iterator<Item = &'a Sample> + Clone) -> Option<Self> {
        let number = samples.clone().count().max(1) as f32;
        let mean_ut = samples.clone().map(|s| s.field.ut).sum::<Vector3<f32>>() / number;
        let spread = samples.map(|s| (s.field.ut - mean_ut).norm_squared()).sum::<f32>() / number;
        let per_ut = 1.0 / libm::sqrtf(spread);
        per_ut.is_finite().then_some(Self { mean_ut, per_ut })
    }

    fn of_one(&self, sample: &Sample) -> Vector3<f32> {
        (sample.field.ut - self.mean_ut) * self.per_ut
    }

    /// What a sample says of the vertical component.
    fn vertical(&self, sample: &Sample) -> Row {
        let down = sample.attitude.body(Field::new(Vector3::z())).ut;
        let products = down * self.of_one(sample).push(1.0).transpose();
        Row::from_iterator(products.iter().copied())
    }

    /// What it says of the strength.
    fn strength(&self, sample: &Sample) -> Row {
        let [x, y, z] = self.of_one(sample).into();
        Row::from([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z, 1.0, 0.0, 0.0])
    }
}

/// The place of the sample that tells least of all of these; `None` if nothing can be told.
#[inline(never)]
pub(super) fn weakest<'a>(samples: impl Iterator<Item = &'a Sample> + Clone) -> Option<usize> {
    let scale = Scale::of(samples.clone())?;
    let says = [Scale::vertical, Scale::strength];
    let design = |row: fn(&Scale, &Sample) -> Row| {
        LeastSquares::<UNKNOWNS, 1>::of_rows(samples.clone().map(|sample| row(&scale, sample)), [0.0], RIDGE)
    };
    let designs = says.map(design);
    let worth = |sample: &Sample| {
        designs.iter().zip(says).map(|(design, row)| design.variance(&row(&scale, sample))).sum::<f32>()
    };
    let worths = samples.map(worth).enumerate();
    worths.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(place, _)| place)
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use nalgebra::Matrix3;
    use testkit::random::Random;

    use super::super::testing::sample;
    use super::*;
    use crate::frames::{Attitude, Level};

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
        weakest(samples.iter())
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

    /// Whatever iron bends the readings: they tell the same.
    #[test]
    fn iron_changes_nothing_of_what_a_sample_is_worth() {
        let bent = Matrix3::new(1.3, 0.2, -0.1, 0.05, 0.7, 0.15, -0.2, 0.1, 1.1);
        let kept = [Matrix3::identity(), bent].map(|iron| {
            let mut samples: Vec<(usize, Sample)> = varied(&iron).into_iter().enumerate().collect();
            while samples.len() > 20 {
                let place = weakest(samples.iter().map(|(_, sample)| sample)).unwrap();
                samples.remove(place);
            }
            samples.into_iter().map(|(number, _)| number).collect::<Vec<_>>()
        });
        let both = kept[0].iter().filter(|number| kept[1].contains(number)).count();
        // But for rounding and what little is taken for known beforehand.
        assert!(both >= 18, "{both} of 20");
    }

    /// Of one of two designs alone the choice would be another: a sample that only the strength tells from the others, and
    /// one that only the vertical does.
    #[test]
    fn both_the_vertical_and_the_strength_count() {
        let level: Vec<Sample> =
            (0..40).map(|i: u8| at(f32::from(i) / 40.0 * TAU, 0.0, 0.0, &Matrix3::identity())).collect();
        // Another reading at the same attitude; the same reading at another attitude.
        let stronger = Sample { field: Field::new(level[3].field.ut * 1.4), ..level[3] };
        let tilted = Sample { attitude: Attitude::from_deg(8.0, 0.0), ..level[3] };
        for rare in [stronger, tilted] {
            let mut samples = level.clone();
            samples.push(rare);
            for _ in 0..20 {
                let place = weakest_of(&samples).unwrap();
                assert_ne!(samples.remove(place), rare);
            }
        }
    }

    #[test]
    fn of_readings_that_are_all_alike_nothing_can_be_told() {
        assert_eq!(weakest_of(&[]), None);
        assert_eq!(weakest_of(&vec![sample([20.0, 0.0, 40.0], 0); 30]), None);
    }
}
