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

    /// What a sample says of the vertical component, and of the strength.
    fn rows(&self, sample: &Sample) -> [Row; 2] {
        let p = (sample.field.ut - self.mean_ut) * self.per_ut;
        let down = sample.attitude.body(Field::new(Vector3::z())).ut;
        let products = down * p.push(1.0).transpose();
        let [x, y, z] = p.into();
        [
            Row::from_iterator(products.iter().copied()),
            Row::from([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z, 1.0, 0.0, 0.0]),
        ]
    }
}

/// The place of the sample that tells least of all of these; `None` if nothing can be told.
#[inline(never)]
pub(super) fn weakest<'a>(samples: impl Iterator<Item = &'a Sample> + Clone) -> Option<usize> {
    let scale = Scale::of(samples.clone())?;
    let designs = [0, 1].map(|kind| design(samples.clone().map(|sample| scale.rows(sample)[kind])));
    let worth = |sample: &Sample| {
        let rows = scale.rows(sample);
        designs.iter().zip(&rows).map(|(design, row)| design.variance(row)).sum::<f32>()
    };
    let worths = samples.map(worth).enumerate();
    worths.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(place, _)| place)
}

/// The information of rows.
#[inline(never)]
fn design(rows: impl Iterator<Item = Row>) -> LeastSquares<UNKNOWNS, 1> {
    let mut information = [[0.0; UNKNOWNS]; UNKNOWNS];
    for (i, row) in information.iter_mut().enumerate() {
        row[i] = RIDGE;
    }
    for row in rows {
        for (i, sums) in information.iter_mut().enumerate() {
            for (sum, x) in sums[i..].iter_mut().zip(&row.as_slice()[i..]) {
                *sum += row[i] * x;
            }
        }
    }
    LeastSquares::of_normal_equations(information, [[0.0]; UNKNOWNS])
}
