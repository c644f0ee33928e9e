//! Level flight: six coefficients from one ellipse, for vehicles that do not bank.
//!
//! In level flight the horizontal field at headings psi runs round a circle, `(H0 cos psi, -H0 sin psi)`, and its
//! measurement round an ellipse (Liu 2007 eq. 4). An ellipse has five coefficients (eq. 6); the sixth, by which angle
//! the circle was turned on its way to the ellipse, is set to zero by hypothesis: `A = K P` with `K = diag(Kx, Ky)` and
//! `P = [cos p, sin p; sin p, cos p]` (eq. 5). What that leaves out is mounting error about the vertical and
//! unsymmetric soft iron: a constant error of heading, which `set align` takes out where a heading is known.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::conic::conic;
use super::least_squares::LeastSquares;
use super::response::Response;
use super::{Part, Samples, SolveError};
use crate::trig;

/// Samples needed: a conic has five coefficients, and noise wants some more.
const MIN_SAMPLES: usize = 8;

/// The circle must have this radius, microtesla, to be one of headings: half the horizontal field at 75 deg of
/// inclination. Less is the noise of a heading that is held.
const MIN_RADIUS_UT: f32 = 6.0;

/// Headings needed, 30 deg apart (Liu 2007 section 1).
const MIN_HEADINGS: u8 = 5;

/// The affine map of the ellipse hypothesis (Liu 2007 eq. 5).
#[derive(Clone, Debug)]
pub(super) struct Hypothesis {
    /// `K P` times H0: takes (cos psi, -sin psi) to the measurement less `centre_ut`.
    pub map_ut: Matrix2<f32>,
    pub centre_ut: Vector2<f32>,
}

impl Hypothesis {
    /// Fits the conic and takes the map from it. With `S` the inverse of the conic's form, `S = K P P^T K`, whose
    /// diagonal is `K^2` and whose off-diagonal element over `Kx Ky` is `sin 2p`.
    ///
    /// `None` when the points are on no ellipse.
    pub fn fit(points_ut: impl Iterator<Item = Vector2<f32>> + Clone) -> Option<Self> {
        let number = points_ut.clone().count() as f32;
        let mean = points_ut.clone().sum::<Vector2<f32>>() / number;
        let scale = libm::sqrtf(points_ut.clone().map(|p| (p - mean).norm_squared()).sum::<f32>() / number);
        // Points scaled to about 1, or the normal equations would mix units of 1 and uT^4.
        let (centre, form) = conic(points_ut.map(|p| (p - mean) / scale))?;
        let s = form.try_inverse()?;
        let (kx, ky) = (libm::sqrtf(s[(0, 0)]), libm::sqrtf(s[(1, 1)]));
        let p = trig::asin(s[(0, 1)] / (kx * ky)) / 2.0;
        let (sin, cos) = trig::sin_cos(p);
        Some(Self {
            map_ut: Matrix2::new(kx * cos, kx * sin, ky * sin, ky * cos) * scale,
            centre_ut: mean + centre * scale,
        })
    }

    /// At how many headings, 30 deg apart, there are points. A straight leg may lie across the border of two sectors of
    /// 15 deg and is one heading still; a circle fills them all.
    fn headings(&self, points_ut: impl Iterator<Item = Vector2<f32>>) -> u8 {
        // A map of an ellipse has an inverse; without one no heading is counted.
        let inverse = self.map_ut.try_inverse().unwrap_or_else(Matrix2::zeros);
        let seen = points_ut.fold(0_u32, |seen, p| {
            let circle = inverse * (p - self.centre_ut);
            let turns = libm::atan2f(-circle.y, circle.x) / core::f32::consts::TAU + 0.5;
            // The cast saturates and takes NaN to 0; the remainder keeps the shift below 24.
            seen | 1 << ((turns * 24.0) as u32 % 24)
        });
        let shifted = (seen << 1 | seen >> 23) & 0x00FF_FFFF;
        let legs = (seen & !shifted).count_ones();
        legs.max(seen.count_ones() / 2) as u8
    }
}

/// Solves samples of level flight, fields rotated by `rotation` first.
///
/// What level flight does not show is chosen so that it does not matter there: the vertical field leaks into no other
/// axis, there is no hard iron along the vertical one, its scale is that of the horizontal ones, and the inclination is
/// what follows.
///
/// # Errors
///
/// [`SolveError::TooFewSamples`], [`SolveError::TooFewHeadings`] where they are not spread round, and
/// [`SolveError::NotAnEllipse`] of [`Part::Level`] where there is no circle of a horizontal field.
pub(super) fn solve(samples: Samples<'_>, rotation: &Matrix3<f32>) -> Result<Response, SolveError> {
    let fields = samples.all().map(|s| rotation * s.field.ut);
    SolveError::require(Part::Level, fields.clone().count(), MIN_SAMPLES)?;
    let found = Hypothesis::fit(fields.clone().map(|f| f.xy())).ok_or(SolveError::NotAnEllipse(Part::Level))?;
    let vertical_ut = libm::sqrtf(found.map_ut.determinant().abs());
    if vertical_ut.is_nan() || vertical_ut < MIN_RADIUS_UT {
        return Err(SolveError::NotAnEllipse(Part::Level));
    }
    let headings = found.headings(fields.clone().map(|f| f.xy()));
    if headings < MIN_HEADINGS {
        return Err(SolveError::TooFewHeadings { have: headings, need: MIN_HEADINGS });
    }
    let vertical = Vertical::fit(&found, fields, vertical_ut).ok_or(SolveError::NotAnEllipse(Part::Level))?;
    let map = found.map_ut;
    let [x, y] = vertical.of_horizontal_ut;
    #[rustfmt::skip]
    let a_ut = Matrix3::new(
        map[(0, 0)], map[(0, 1)], 0.0,
        map[(1, 0)], map[(1, 1)], 0.0,
        x,           y,           vertical_ut,
    );
    let b_ut = Vector3::new(found.centre_ut.x, found.centre_ut.y, 0.0);
    Ok(Response { a_ut, b_ut, tan_inclination: vertical.mean_ut / vertical_ut })
}

/// What the vertical axis measures in level flight: a constant, and what leaks in from the horizontal field.
struct Vertical {
    mean_ut: f32,
    of_horizontal_ut: [f32; 2],
}

impl Vertical {
    fn fit(found: &Hypothesis, fields: impl Iterator<Item = Vector3<f32>>, scale_ut: f32) -> Option<Self> {
        let inverse = found.map_ut.try_inverse()?;
        let mut system = LeastSquares::<3, 1>::new();
        for field in fields {
            system.add(&(inverse * (field.xy() - found.centre_ut)).push(1.0), [field.z], 1.0);
        }
        let solution = system.solve()?;
        let is_sound = solution.iter().all(|c| c.abs() < 1e3 * scale_ut);
        is_sound.then(|| Self { mean_ut: solution.z, of_horizontal_ut: [solution.x, solution.y] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Mark, Rates, Sample};
    use crate::frames::{Attitude, Field};
    use crate::time::WrappingMillis;

    /// Of the hypothesis' kind: `K P` with `K = (30, 20)` and `p` of 0.1.
    fn map_ut() -> Matrix2<f32> {
        let (sin, cos) = 0.1_f32.sin_cos();
        Matrix2::new(30.0 * cos, 30.0 * sin, 20.0 * sin, 20.0 * cos)
    }

    /// Level samples at headings, of a sensor whose vertical axis shows 40 uT, and a tenth and a twentieth of H0
    /// besides.
    fn at(headings_deg: &[f32], scale: f32) -> Vec<Sample> {
        headings_deg
            .iter()
            .map(|heading_deg| {
                let (sin, cos) = heading_deg.to_radians().sin_cos();
                let flat = (map_ut() * Vector2::new(cos, -sin) + Vector2::new(12.0, -30.0)) * scale;
                let field = Field::from_ut(flat.x, flat.y, 40.0 + 3.0 * cos - 1.5 * -sin);
                Sample { field, attitude: Attitude::default(), time: WrappingMillis::default(), rates: Rates::NONE }
            })
            .collect()
    }

    fn round(number: u8) -> Vec<f32> {
        (0..number).map(|i| f32::from(i) * 360.0 / f32::from(number) + 7.0).collect()
    }

    fn solved(samples: &[Sample]) -> Result<Response, SolveError> {
        solve(Samples { level: samples, ..Samples::default() }, &Matrix3::identity())
    }

    #[test]
    fn the_map_of_the_hypothesis_comes_back() {
        let found = solved(&at(&round(24), 1.0)).unwrap();
        let map = map_ut();
        // The root of Kx Ky cos 2p.
        let vertical_ut = map.determinant().sqrt();
        let expected =
            Matrix3::new(map[(0, 0)], map[(0, 1)], 0.0, map[(1, 0)], map[(1, 1)], 0.0, 3.0, -1.5, vertical_ut);
        assert!((found.a_ut - expected).norm() < 2e-3, "{} {expected}", found.a_ut);
        assert!((found.b_ut - Vector3::new(12.0, -30.0, 0.0)).norm() < 1e-3, "{}", found.b_ut);
        assert!((found.tan_inclination - 40.0 / vertical_ut).abs() < 1e-4, "{}", found.tan_inclination);
    }

    /// Marks are samples, too, and a mounting is turned first.
    #[test]
    fn all_parts_count_and_are_rotated() {
        let samples = at(&round(24), 1.0);
        let marks: Vec<Mark> = samples[12..].iter().map(|&sample| Mark { sample, heading_rad: 0.0 }).collect();
        let about_z = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
        let parts =
            Samples { left: &samples[..6], right: &samples[6..12], level: &[], marks: &marks, ..Samples::default() };
        let found = solve(parts, &about_z).unwrap();
        assert!((found.b_ut - Vector3::new(30.0, 12.0, 0.0)).norm() < 1e-3, "{}", found.b_ut);
    }

    #[test]
    fn eight_samples_are_enough_and_seven_are_not() {
        assert!(solved(&at(&round(8), 1.0)).is_ok());
        let missing = SolveError::TooFewSamples { part: Part::Level, have: 7, need: 8 };
        assert_eq!(solved(&at(&round(7), 1.0)).map(|_| ()), Err(missing));
    }

    /// The mean radius of this ellipse, sqrt(Kx Ky cos 2p), is 24.25 uT; it takes 6.
    #[test]
    fn a_circle_of_less_than_six_microtesla_is_a_heading_held() {
        assert!(solved(&at(&round(24), 6.1 / 24.25)).is_ok());
        let refused = solved(&at(&round(24), 5.9 / 24.25)).map(|_| ());
        assert_eq!(refused, Err(SolveError::NotAnEllipse(Part::Level)));
        let held = solved(&at(&[30.0; 24], 1.0)).map(|_| ());
        assert_eq!(held, Err(SolveError::NotAnEllipse(Part::Level)));
    }

    #[test]
    fn five_headings_are_enough_and_four_are_not() {
        let legs = |headings_deg: &[f32]| -> Vec<f32> {
            headings_deg.iter().flat_map(|heading| [-2.0, 0.0, 2.0].map(|off| heading + off)).collect()
        };
        assert!(solved(&at(&legs(&[7.0, 80.0, 150.0, 220.0, 295.0]), 1.0)).is_ok());
        let missing = |have| Err(SolveError::TooFewHeadings { have, need: 5 });
        assert_eq!(solved(&at(&legs(&[7.0, 97.0, 187.0, 277.0]), 1.0)).map(|_| ()), missing(4));
        // An arc of three hours of the clock is an ellipse still, but four headings.
        let arc: Vec<f32> = (0..60_u8).map(|i| 1.0 + f32::from(i) * 2.0).collect();
        assert_eq!(solved(&at(&arc, 1.0)).map(|_| ()), missing(4));
    }

    fn counted(headings_deg: &[f32]) -> u8 {
        let hypothesis = Hypothesis { map_ut: map_ut(), centre_ut: Vector2::new(12.0, -30.0) };
        hypothesis.headings(at(headings_deg, 1.0).iter().map(|s| s.field.ut.xy()))
    }

    /// Sectors begin at multiples of 15 deg.
    #[test]
    fn a_leg_across_a_border_is_one_heading_and_a_circle_is_twelve() {
        assert_eq!(counted(&[]), 0);
        assert_eq!(counted(&[7.0]), 1);
        assert_eq!(counted(&[13.0, 17.0]), 1, "across a border");
        assert_eq!(counted(&[-3.0, 3.0]), 1, "across north");
        assert_eq!(counted(&[177.0, 183.0]), 1, "across south");
        assert_eq!(counted(&[7.0, 37.0]), 2);
        assert_eq!(counted(&[13.0, 17.0, 88.0, 92.0, 178.0, 182.0, 268.0, 272.0]), 4);
        assert_eq!(counted(&round(72)), 12);
        // A half circle: twelve sectors in one run, and the borders.
        let half: Vec<f32> = (0..36_u8).map(|i| 2.0 + f32::from(i) * 5.0).collect();
        assert_eq!(counted(&half), 6);
    }

    /// A leak a thousand times the field is no leak but an axis that is not there.
    #[test]
    fn a_vertical_axis_beyond_reason_is_refused() {
        let with = |z: f32| -> Vec<Sample> {
            let shifted = |s: Sample| Sample { field: Field::from_ut(s.field.ut.x, s.field.ut.y, z), ..s };
            at(&round(24), 1.0).into_iter().map(shifted).collect()
        };
        // 24.25 uT of radius times a thousand.
        assert!(solved(&with(24_000.0)).is_ok());
        assert_eq!(solved(&with(24_500.0)).map(|_| ()), Err(SolveError::NotAnEllipse(Part::Level)));
    }
}
