//! World Magnetic Model WMM2025: the field of the Earth's core and its secular variation.
//!
//! Equations and constants: Chulliat et al., *The US/UK World Magnetic Model for 2025-2030: Technical Report*, NOAA
//! 2024, section 1.2 (doi:10.25923/prbc-s316). Coefficients: `WMM2025.COF` of
//! <https://www.ncei.noaa.gov/products/world-magnetic-model>, a work of the U.S. Government, not subject to copyright.
//!
//! Errors by the report's error model (section 3.4), crustal field included, 1 sigma: inclination 0.20 deg, field
//! strength 0.14 uT, declination `sqrt(0.26^2 + (5.4 uT / H)^2)` deg, `H` being the horizontal field.
//!
//! The crate `world_magnetic_model` 1.2025.0 agrees to 0.0013 deg on 10,000 places, but the image grows by 16 KB with
//! it: it contains two models and quantities with units.

use crate::earth::date::Date;
use crate::earth::position::Position;
use crate::trig;
use crate::trig::sqrt;

/// Earth's magnetic field at a position and date.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarthField {
    /// Declination, degrees, east positive; `None` below 2 uT of horizontal field, the model's blackout zone around the
    /// magnetic poles.
    pub declination_deg: Option<f32>,
    /// Inclination, degrees, positive down.
    pub inclination_deg: f32,
    /// Field strength, microtesla.
    pub total_ut: f32,
}

/// Name of the model.
pub const MODEL_NAME: &str = "WMM2025";

/// Limit of the blackout zone, horizontal nanotesla.
const MIN_HORIZONTAL_NT: f32 = 2_000.0;

/// Validity of the model on a date.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelValidity {
    /// Before 2025: the clock is wrong, since the firmware is younger; the model is not used.
    TooEarly,
    /// 2025 to 2029, the model's intended period.
    Valid,
    /// 2030 to 2034. Still used, so that true heading does not disappear on a New Year's Day: WMM2020 extrapolated to
    /// 2030 differs from WMM2025 by 0.31 deg of declination RMS (95 %: 0.6 deg) where `H` is at least 6 uT, about the
    /// error of a valid model.
    Extrapolated,
    /// From 2035: the model is not used.
    TooOld,
}

impl ModelValidity {
    /// Validity on a date.
    #[must_use]
    pub const fn on_date(day: Date) -> Self {
        /// 2025-01-01, days since 1970-01-01.
        const VALID_FROM_DAY: u16 = 20_089;
        /// 2030-01-01, days since 1970-01-01.
        const OVERDUE_FROM_DAY: u16 = 21_915;
        /// 2035-01-01, days since 1970-01-01.
        const TOO_OLD_FROM_DAY: u16 = 23_741;
        match day.days_since_1970() {
            ..VALID_FROM_DAY => Self::TooEarly,
            VALID_FROM_DAY..OVERDUE_FROM_DAY => Self::Valid,
            OVERDUE_FROM_DAY..TOO_OLD_FROM_DAY => Self::Extrapolated,
            TOO_OLD_FROM_DAY.. => Self::TooOld,
        }
    }

    /// Whether the model is used.
    #[must_use]
    pub const fn is_used(self) -> bool {
        matches!(self, Self::Valid | Self::Extrapolated)
    }
}

impl EarthField {
    /// Computes the model field; `None` on a date without a usable model.
    ///
    /// The height above sea level is used as ellipsoidal height: they differ by at most 0.1 km, the field by 0.005 %.
    #[must_use]
    #[inline(never)]
    pub fn from_model(position: Position, day: Date) -> Option<Self> {
        if !ModelValidity::on_date(day).is_used() {
            return None;
        }
        let [north, east, down] = components_nt(position, years_since_epoch(day));
        let horizontal = trig::hypot(north, east);
        let has_declination = horizontal >= MIN_HORIZONTAL_NT;
        Some(Self {
            declination_deg: has_declination.then(|| libm::atan2f(east, north).to_degrees()),
            inclination_deg: libm::atan2f(down, horizontal).to_degrees(),
            total_ut: trig::hypot(horizontal, down) / 1_000.0,
        })
    }
}

/// Years since 2025.0. Ignoring leap days costs 0.003 years, in which no component changes by 0.5 nT.
fn years_since_epoch(day: Date) -> f32 {
    /// 2025-01-01, days since 1970-01-01.
    const EPOCH_DAY: f32 = 20_089.0;
    (f32::from(day.days_since_1970()) - EPOCH_DAY) / 365.25
}

/// Geocentric position (eqs. 7, 8).
struct GeocentricPosition {
    /// Reference radius 6371.2 km over the geocentric distance.
    radius_ratio: f32,
    /// Sine and cosine of the colatitude.
    sin_colatitude: f32,
    cos_colatitude: f32,
    /// Sine and cosine of geocentric minus geodetic latitude.
    latitude_difference_sin_cos: (f32, f32),
}

impl GeocentricPosition {
    fn from_position(position: Position) -> Self {
        /// Semi-major axis of the WGS 84 ellipsoid, metres.
        const SEMI_MAJOR_AXIS_M: f32 = 6_378_137.0;
        /// First eccentricity of the WGS 84 ellipsoid, squared.
        const ECCENTRICITY_SQUARED: f32 = 0.006_694_38;
        const REFERENCE_RADIUS_M: f32 = 6_371_200.0;
        /// North is undefined at the pole; this keeps the division finite.
        const MIN_SIN_COLATITUDE: f32 = 1e-6;
        let (sin_latitude, cos_latitude) = trig::sin_cos(position.latitude_deg.to_radians());
        let curvature_m = SEMI_MAJOR_AXIS_M / sqrt(1.0 - ECCENTRICITY_SQUARED * sin_latitude * sin_latitude);
        let from_axis_m = (curvature_m + position.height_m) * cos_latitude;
        let from_equator_m = (curvature_m * (1.0 - ECCENTRICITY_SQUARED) + position.height_m) * sin_latitude;
        let distance_m = trig::hypot(from_axis_m, from_equator_m);
        let (sin_colatitude, cos_colatitude) =
            ((from_axis_m / distance_m).max(MIN_SIN_COLATITUDE), from_equator_m / distance_m);
        let latitude_difference_sin_cos = (
            cos_colatitude * cos_latitude - sin_colatitude * sin_latitude,
            sin_colatitude * cos_latitude + cos_colatitude * sin_latitude,
        );
        Self {
            radius_ratio: REFERENCE_RADIUS_M / distance_m,
            sin_colatitude,
            cos_colatitude,
            latitude_difference_sin_cos,
        }
    }
}

/// Schmidt semi-normalised associated Legendre function `P` of degree `n` and order `m`, and its derivative by
/// colatitude. Recursion over degree: `sqrt(n^2 - m^2) P(n) = (2n-1) cos P(n-1) - sqrt((n-1)^2 - m^2) P(n-2)`.
struct LegendreFunction {
    value: f32,
    derivative: f32,
    previous: (f32, f32),
    /// `sqrt(n^2 - m^2)`.
    degree_order_root: f32,
}

impl LegendreFunction {
    const fn first_of_order((p, slope): (f32, f32)) -> Self {
        Self { value: p, derivative: slope, previous: (0.0, 0.0), degree_order_root: 0.0 }
    }

    fn next_degree(&mut self, degree: f32, order: f32, (sin, cos): (f32, f32)) {
        let Self { value, derivative, previous: (previous_value, previous_derivative), degree_order_root: root } =
            *self;
        let next_root = sqrt((degree + 1.0) * (degree + 1.0) - order * order);
        let double_degree = 2.0 * degree + 1.0;
        *self = Self {
            value: (double_degree * cos * value - root * previous_value) / next_root,
            derivative: (double_degree * (cos * derivative - sin * value) - root * previous_derivative) / next_root,
            previous: (value, derivative),
            degree_order_root: next_root,
        };
    }
}

/// North, east and down components (eqs. 10 to 12, 17), nanotesla.
fn components_nt(position: Position, years: f32) -> [f32; 3] {
    let GeocentricPosition {
        radius_ratio: ratio,
        sin_colatitude: sin,
        cos_colatitude: cos,
        latitude_difference_sin_cos: (sin_turn, cos_turn),
    } = GeocentricPosition::from_position(position);
    let (sin_longitude, cos_longitude) = trig::sin_cos(position.longitude_deg.to_radians());
    let (mut north, mut east, mut down) = (0.0, 0.0, 0.0);
    let mut coefficients = MODEL_COEFFICIENTS.iter();
    // For order `m`: first function, power of the ratio, sine and cosine of `m` times longitude.
    let (mut first, mut first_power, mut sin_m, mut cos_m) = ((1.0, 0.0), ratio * ratio, 0.0, 1.0);
    for m in 0..=MAX_DEGREE {
        let order = f32::from(m);
        if m > 0 {
            let factor = if m == 1 { 1.0 } else { sqrt(1.0 - 0.5 / order) };
            first = (factor * sin * first.0, factor * (sin * first.1 + cos * first.0));
            first_power *= ratio;
            (sin_m, cos_m) =
                (sin_m * cos_longitude + cos_m * sin_longitude, cos_m * cos_longitude - sin_m * sin_longitude);
        }
        let (mut function, mut power) = (LegendreFunction::first_of_order(first), first_power);
        for n in m..=MAX_DEGREE {
            let degree = f32::from(n);
            // Degree 0 (magnetic monopole) has no coefficients.
            if n > 0 {
                let [g, h] = coefficients_at(coefficients.next().copied().unwrap_or_default(), n, m, years);
                let longitude_term = power * (g * cos_m + h * sin_m);
                north += longitude_term * function.derivative;
                east += power * (g * sin_m - h * cos_m) * order * function.value / sin;
                down -= longitude_term * (degree + 1.0) * function.value;
            }
            function.next_degree(degree, order, (sin, cos));
            power *= ratio;
        }
    }
    [north * cos_turn - down * sin_turn, east, north * sin_turn + down * cos_turn]
}

/// Coefficients `g`, `h` at `years` after 2025.0, nanotesla.
fn coefficients_at(tenths: [i16; 4], degree: u8, order: u8, years: f32) -> [f32; 2] {
    let [g, h, g_rate, h_rate] = tenths.map(|tenths| f32::from(tenths) * 0.1);
    let [g_beyond, h_beyond] = match (degree, order) {
        (1, 0) => [-30_000.0, 0.0],
        (1, 1) => [0.0, 3_000.0],
        _ => [0.0; 2],
    };
    [g + g_beyond + g_rate * years, h + h_beyond + h_rate * years]
}

/// Largest degree `n` and order `m`.
const MAX_DEGREE: u8 = 12;

/// `g`, `h` at 2025.0 and their yearly changes, tenths of a nanotesla, by order and then degree. The dipole exceeds
/// `i16`: 30,000 nT are added to the first `g`, 3,000 nT subtracted from the first `h` of order 1.
#[rustfmt::skip]
const MODEL_COEFFICIENTS: [[i16; 4]; 90] = [
    // Coefficients of order m = 0.
    [6_482, 0, 120, 0], [-25_566, 0, -116, 0], [13_610, 0, -13, 0], [8_950, 0, -16, 0], [-2_332, 0, 6, 0],
    [644, 0, -2, 0], [795, 0, 0, 0], [232, 0, -1, 0], [46, 0, 0, 0], [-13, 0, 1, 0], [29, 0, 0, 0], [-20, 0, 0, 0],
    // Coefficients of order m = 1.
    [-14_108, 15_454, 97, -215], [29_511, -31_336, -52, -277], [-24_041, -566, -42, 40], [7_995, 2_786, -24, -11],
    [3_689, 454, 14, -5], [638, -184, -4, 3], [-770, -489, -1, 6], [108, 71, 2, -2], [78, -248, -1, -3],
    [-64, 33, 0, 0], [-15, 0, 0, 0], [-2, -13, 0, 0],
    // Coefficients of order m = 2.
    [16_493, -8_151, -80, -121], [12_438, 2_375, 4, -3], [557, -1_339, -60, 41], [1_872, 2_202, 0, 22],
    [769, 168, 9, -16], [-88, -144, -1, 5], [-175, -126, 0, 5], [30, 122, 1, 3], [2, 0, 1, 0], [-25, 29, 0, 1],
    [3, 7, 0, 0],
    // Coefficients of order m = 3.
    [4_536, -5_495, -156, -41], [-2_811, 2_120, 56, 16], [-1_387, -1_229, 6, 4], [-1_157, 488, 12, -4],
    [593, -10, 5, -8], [20, 114, 5, -4], [-2, 83, 3, -3], [20, 24, 1, -2], [24, -6, 0, 0], [12, 10, 0, -1],
    // Coefficients of order m = 4.
    [121, -3_756, -70, -44], [-1_420, 430, 22, 17], [-409, -598, -9, 9], [158, 234, -1, 0], [-217, -97, -1, 4],
    [-25, -33, -3, 3], [-10, 53, 0, 1], [-6, 2, 0, 1], [-13, -14, 0, 1],
    // Coefficients of order m = 5.
    [209, 1_061, 9, 19], [149, 109, 3, 7], [25, -74, -8, -10], [169, 127, 3, -5], [-131, -52, 0, 2],
    [-6, -91, -3, -1], [-1, 5, -1, 0], [6, 0, 0, 0],
    // Coefficients of order m = 6.
    [-607, 727, 9, 9], [-111, -251, -8, 6], [150, 7, 2, -6], [24, 72, 3, -1], [-9, 4, 0, 1], [-6, -3, 0, 0],
    [6, 6, 1, 0],
    // Coefficients of order m = 7.
    [142, -23, 8, -2], [-168, -52, 0, 3], [86, -6, -1, -2], [15, -42, -1, 0], [-1, -12, 0, 1], [5, -1, 0, 0],
    // Coefficients of order m = 8.
    [9, 39, 2, 2], [-87, 8, 1, 4], [9, -38, -1, -1], [11, -17, -1, 0], [-1, 8, 0, 0],
    // Coefficients of order m = 9.
    [-129, 100, -1, 1], [-27, 9, 0, 2], [-10, -29, -1, 0], [-4, 1, 0, 0],
    // Coefficients of order m = 10.
    [-39, -91, 0, 0], [-2, -18, -1, 0], [-2, -10, -1, 0],
    // Coefficients of order m = 11.
    [26, -23, -1, 0], [-13, 1, 0, 0],
    // Coefficients of order m = 12.
    [-7, 2, -1, -1],
];

#[cfg(test)]
mod tests;
