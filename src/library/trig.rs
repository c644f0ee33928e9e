//! Trigonometric functions in `f32`.
//!
//! Those of `libm` use `f64`, which a Cortex-M4 emulates: 2,200 instructions for sine and cosine, 50 here at the same
//! accuracy.

use core::f32::consts::FRAC_2_PI;

pub use autoswing_fpu::sqrt;
use nalgebra::{Const, SVector, Storage, Vector};

/// One degree, radians.
pub const DEG: f32 = core::f32::consts::PI / 180.0;

/// Square of a number.
#[must_use]
pub const fn square(x: f32) -> f32 {
    x * x
}

/// Sine and cosine, accurate to 1e-7 for angles up to 8000 rad. NaN for an infinite or NaN angle.
///
/// Range reduction by pi/2 in three parts, and the polynomials of S. L. Moshier's Cephes library (`sinf.c`).
#[must_use]
pub fn sin_cos(angle_rad: f32) -> (f32, f32) {
    // pi/2 in parts whose products with small integers are exact.
    const QUARTER_TURN_PARTS: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];
    let quarters = angle_rad * FRAC_2_PI;
    // The cast saturates for non-finite values; the remainder is then NaN.
    let quarters = (quarters + 0.5_f32.copysign(quarters)) as i32;
    let quarters_f32 = quarters as f32;
    let x = angle_rad
        - quarters_f32 * QUARTER_TURN_PARTS[0]
        - quarters_f32 * QUARTER_TURN_PARTS[1]
        - quarters_f32 * QUARTER_TURN_PARTS[2];
    let z = x * x;
    let sin = ((-1.951_529_6e-4 * z + 8.332_161e-3) * z - 1.666_665_5e-1) * z * x + x;
    let cos = ((2.443_315_7e-5 * z - 1.388_731_6e-3) * z + 4.166_664_6e-2) * z * z - 0.5 * z + 1.0;
    match quarters & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Arc sine, -pi/2..pi/2; the argument is clamped to 1.
#[must_use]
pub fn asin(sin: f32) -> f32 {
    libm::atan2f(sin, sqrt((1.0 - sin * sin).max(0.0)))
}

/// Hypotenuse. Squares must neither overflow nor underflow.
#[must_use]
pub fn hypot(a: f32, b: f32) -> f32 {
    sqrt(a * a + b * b)
}

/// Lengths of vectors by the FPU's square root; nalgebra's own call `libm`'s.
pub trait VectorLength {
    /// Vector of the same direction with length 1.
    type Unit;

    /// Euclidean length.
    fn vector_length(&self) -> f32;

    /// Unit vector of the same direction; not numbers for a zero vector.
    fn unit_vector(&self) -> Self::Unit;
}

impl<const N: usize, S: Storage<f32, Const<N>>> VectorLength for Vector<f32, Const<N>, S> {
    type Unit = SVector<f32, N>;

    fn vector_length(&self) -> f32 {
        sqrt(self.norm_squared())
    }

    fn unit_vector(&self) -> Self::Unit {
        self / self.vector_length()
    }
}

/// Reciprocal cube root of a positive number, accurate to two units in the last place.
///
/// Newton's method for `y^-3 = x`, starting from a third of the exponent.
#[must_use]
pub fn reciprocal_cbrt(x: f32) -> f32 {
    /// Subtrahend of the float's bits that limits the error of the initial value to 4 %.
    const INVERSE_CUBE_ROOT_GUESS: u32 = 0x54A2_1D2A;
    let guess = f32::from_bits(INVERSE_CUBE_ROOT_GUESS.saturating_sub(x.to_bits() / 3));
    (0..4).fold(guess, |y, _| y * (4.0 - x * y * y * y) / 3.0)
}

#[cfg(test)]
mod tests {
    use core::f32::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn hypot_of_right_triangles() {
        for (a, b, c) in [(3.0, 4.0, 5.0), (-3e-3, 4e-3, 5e-3), (0.0, -2.0, 2.0), (0.0, 0.0, 0.0)] {
            assert!((hypot(a, b) - c).abs() <= 1e-7 * c, "{a} {b}");
        }
        assert!(hypot(f32::NAN, 1.0).is_nan());
    }

    /// 1e-7 is one unit in the last place at 1.
    #[test]
    fn sine_and_cosine_match_f64() {
        for i in -200_000_i32..=200_000 {
            let angle_rad = i as f32 * 7.3e-5;
            let (sin, cos) = sin_cos(angle_rad);
            let exact = f64::from(angle_rad).sin_cos();
            let error = (f64::from(sin) - exact.0).abs().max((f64::from(cos) - exact.1).abs());
            assert!(error < 1.2e-7, "{angle_rad}: {error:e}");
        }
        for angle_rad in [100.0_f32, -1000.0, 8000.0] {
            let error = (f64::from(sin_cos(angle_rad).0) - f64::from(angle_rad).sin()).abs();
            assert!(error < 1e-6, "{angle_rad}: {error:e}");
        }
    }

    #[test]
    fn non_finite_angles_have_no_sine() {
        for angle_rad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let (sin, cos) = sin_cos(angle_rad);
            assert!(!sin.is_finite() && !cos.is_finite(), "{angle_rad}: {sin} {cos}");
        }
    }

    #[test]
    fn arc_sine_matches_f64() {
        for i in -1000_i32..=1000 {
            let sin = i as f32 / 1000.0;
            let error = f64::from(asin(sin)) - f64::from(sin).asin();
            assert!(error.abs() < 5e-7, "{sin}: {error:e}");
        }
        assert!([1.5, -1.5].iter().all(|sin| (asin(*sin) - FRAC_PI_2.copysign(*sin)).abs() < 1e-6));
    }

    #[test]
    fn reciprocal_cube_root_matches_f64() {
        for exponent in -30..=30 {
            for part in 0_i16..50 {
                let x = (1.0 + f32::from(part) / 50.0) * 2_f32.powi(exponent);
                let error = f64::from(reciprocal_cbrt(x)) * f64::from(x).cbrt() - 1.0;
                assert!(error.abs() < 3e-7, "{x:e}: {error:e}");
            }
        }
    }
}
