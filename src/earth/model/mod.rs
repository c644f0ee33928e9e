//! The World Magnetic Model WMM2025: the field of the Earth's core, and how it changes.
//!
//! Equations and constants: Chulliat et al., *The US/UK World Magnetic Model for 2025-2030: Technical Report*, NOAA 2024,
//! section 1.2 (doi:10.25923/prbc-s316). The coefficients are the work of the U.S. Government, `WMM2025.COF` of
//! <https://www.ncei.noaa.gov/products/world-magnetic-model>, and not subject to copyright.
//!
//! By its own error model (section 3.4), which counts the rocks that it knows nothing of, it is good to 0.20 deg of
//! inclination, 0.14 uT, and `sqrt(0.26^2 + (5.4 uT / H)^2)` deg of declination where the horizontal field is `H`; 1 sigma.

use super::{Day, Place};
use crate::trig;

/// The Earth's field somewhere on some day.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EarthField {
    /// Declination, degrees, east positive; none where the horizontal field is less than 2 uT, the model's "blackout zone"
    /// around the magnetic poles.
    pub declination_deg: Option<f32>,
    /// Inclination, degrees, positive down.
    pub inclination_deg: f32,
    /// Total intensity, microtesla.
    pub total_ut: f32,
}

/// The name of the model.
pub const MODEL: &str = "WMM2025";

/// Less horizontal field than this has no declination, nanotesla.
const BLACKOUT_NT: f32 = 2_000.0;

/// What the model is worth on a day.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Validity {
    /// Before it began: the clock is wrong, since this firmware is younger. Not used.
    TooEarly,
    /// Of 2025 to 2029, as it was made for.
    Valid,
    /// Of 2030 to 2034: used, because who flies by a true heading must not lose it overnight on some New Year, and because
    /// it is little worse. WMM2020, gone on with in the same way until 2030, is off WMM2025 by 0.31 deg of declination RMS
    /// where `H` is 6 uT and more, within 0.6 deg at 95 % of all places: as much as a valid model itself is off.
    Overdue,
    /// Later. Not used.
    TooOld,
}

impl Validity {
    /// On a day.
    #[must_use]
    pub const fn on(day: Day) -> Self {
        /// 2025-01-01, 2030-01-01 and 2035-01-01, days since 1970-01-01.
        const VALID: u16 = 20_089;
        const OVERDUE: u16 = 21_915;
        const TOO_OLD: u16 = 23_741;
        match day.since_1970() {
            ..VALID => Self::TooEarly,
            VALID..OVERDUE => Self::Valid,
            OVERDUE..TOO_OLD => Self::Overdue,
            TOO_OLD.. => Self::TooOld,
        }
    }

    /// Whether the model is used.
    #[must_use]
    pub const fn is_used(self) -> bool {
        matches!(self, Self::Valid | Self::Overdue)
    }
}

impl EarthField {
    /// The field by the model; none on a day on which it is not [used](Validity::is_used), and none without the Cargo
    /// feature `wmm`.
    ///
    /// A height above the sea is taken for one above the ellipsoid: they differ by 0.1 km at most, the field by 0.005 %.
    #[must_use]
    #[inline(never)]
    pub fn of(place: Place, day: Day) -> Option<Self> {
        // Without the feature all of the model is dead code.
        if !cfg!(feature = "wmm") || !Validity::on(day).is_used() {
            return None;
        }
        let [north, east, down] = components_nt(place, years(day));
        let horizontal = trig::hypot(north, east);
        let has_declination = horizontal >= BLACKOUT_NT;
        Some(Self {
            declination_deg: has_declination.then(|| libm::atan2f(east, north).to_degrees()),
            inclination_deg: libm::atan2f(down, horizontal).to_degrees(),
            total_ut: trig::hypot(horizontal, down) / 1_000.0,
        })
    }
}

/// Years since 2025.0. A leap day moves it by 0.003, in which no component changes by 0.5 nT.
fn years(day: Day) -> f32 {
    /// 2025-01-01, days since 1970-01-01.
    const EPOCH: f32 = 20_089.0;
    (f32::from(day.since_1970()) - EPOCH) / 365.25
}

/// Where a place is, seen from the middle of the Earth (eqs. 7, 8).
struct Geocentric {
    /// The reference radius 6371.2 km over the distance.
    ratio: f32,
    /// Colatitude, its sine and cosine.
    sin: f32,
    cos: f32,
    /// Sine and cosine of the geocentric latitude less the geodetic one.
    turn: (f32, f32),
}

impl Geocentric {
    fn of(place: Place) -> Self {
        /// WGS 84: semi-major axis, metres; first eccentricity squared.
        const AXIS_M: f32 = 6_378_137.0;
        const ECCENTRICITY_SQUARED: f32 = 0.006_694_38;
        const REFERENCE_M: f32 = 6_371_200.0;
        /// At a pole itself there is no north; so near to it there is.
        const LEAST_SIN: f32 = 1e-6;
        let (sin_latitude, cos_latitude) = trig::sin_cos(place.latitude_deg.to_radians());
        let curvature_m = AXIS_M / libm::sqrtf(1.0 - ECCENTRICITY_SQUARED * sin_latitude * sin_latitude);
        let from_axis_m = (curvature_m + place.height_m) * cos_latitude;
        let from_equator_m = (curvature_m * (1.0 - ECCENTRICITY_SQUARED) + place.height_m) * sin_latitude;
        let distance_m = trig::hypot(from_axis_m, from_equator_m);
        let (sin, cos) = ((from_axis_m / distance_m).max(LEAST_SIN), from_equator_m / distance_m);
        let turn = (cos * cos_latitude - sin * sin_latitude, sin * cos_latitude + cos * sin_latitude);
        Self { ratio: REFERENCE_M / distance_m, sin, cos, turn }
    }
}

/// Schmidt's semi-normalised associated Legendre function `P` of a degree `n` and an order `m`, and its derivative by the
/// colatitude. Those of the degree before are kept, from which the next ones follow:
/// `sqrt(n^2 - m^2) P(n) = (2n-1) cos P(n-1) - sqrt((n-1)^2 - m^2) P(n-2)`.
struct Schmidt {
    p: f32,
    slope: f32,
    before: (f32, f32),
    /// `sqrt(n^2 - m^2)`.
    root: f32,
}

impl Schmidt {
    /// The first of an order, whose degree is the order: none is before it.
    const fn first((p, slope): (f32, f32)) -> Self {
        Self { p, slope, before: (0.0, 0.0), root: 0.0 }
    }

    /// On from this degree to the next.
    fn advance(&mut self, degree: f32, order: f32, (sin, cos): (f32, f32)) {
        let Self { p, slope, before: (p_before, slope_before), root } = *self;
        let next_root = libm::sqrtf((degree + 1.0) * (degree + 1.0) - order * order);
        let odd = 2.0 * degree + 1.0;
        *self = Self {
            p: (odd * cos * p - root * p_before) / next_root,
            slope: (odd * (cos * slope - sin * p) - root * slope_before) / next_root,
            before: (p, slope),
            root: next_root,
        };
    }
}

/// North, east and down (eqs. 10 to 12, 17), nanotesla; years since 2025.0.
fn components_nt(place: Place, years: f32) -> [f32; 3] {
    let Geocentric { ratio, sin, cos, turn: (sin_turn, cos_turn) } = Geocentric::of(place);
    let (sin_longitude, cos_longitude) = trig::sin_cos(place.longitude_deg.to_radians());
    let (mut north, mut east, mut down) = (0.0, 0.0, 0.0);
    let mut coefficients = COEFFICIENTS.iter();
    // Of the order `m`: its first function, the power of the ratio there, sine and cosine of `m` times the longitude.
    let (mut first, mut first_power, mut sin_m, mut cos_m) = ((1.0, 0.0), ratio * ratio, 0.0, 1.0);
    for m in 0..=DEGREE {
        let order = f32::from(m);
        if m > 0 {
            let factor = if m == 1 { 1.0 } else { libm::sqrtf(1.0 - 0.5 / order) };
            first = (factor * sin * first.0, factor * (sin * first.1 + cos * first.0));
            first_power *= ratio;
            (sin_m, cos_m) =
                (sin_m * cos_longitude + cos_m * sin_longitude, cos_m * cos_longitude - sin_m * sin_longitude);
        }
        let (mut function, mut power) = (Schmidt::first(first), first_power);
        for n in m..=DEGREE {
            let degree = f32::from(n);
            // There is no pole alone: degree 0 has no coefficients.
            if n > 0 {
                let [g, h] = at(coefficients.next().copied().unwrap_or_default(), n, m, years);
                let along = power * (g * cos_m + h * sin_m);
                north += along * function.slope;
                east += power * (g * sin_m - h * cos_m) * order * function.p / sin;
                down -= along * (degree + 1.0) * function.p;
            }
            function.advance(degree, order, (sin, cos));
            power *= ratio;
        }
    }
    [north * cos_turn - down * sin_turn, east, north * sin_turn + down * cos_turn]
}

/// A pair of coefficients so many years after 2025.0, nanotesla.
fn at(tenths: [i16; 4], degree: u8, order: u8, years: f32) -> [f32; 2] {
    let [g, h, g_rate, h_rate] = tenths.map(|tenths| f32::from(tenths) * 0.1);
    let [g_beyond, h_beyond] = match (degree, order) {
        (1, 0) => [-30_000.0, 0.0],
        (1, 1) => [0.0, 3_000.0],
        _ => [0.0; 2],
    };
    [g + g_beyond + g_rate * years, h + h_beyond + h_rate * years]
}

/// The largest degree `n`, and order `m`.
const DEGREE: u8 = 12;

/// `g`, `h` at 2025.0 and their yearly changes, in tenths of a nanotesla; by order, and within each by degree. The dipole is
/// beyond an `i16`: the first `g` is 30,000 nT less than here, the first `h` of order 1 is 3,000 nT more (see [`at`]).
#[rustfmt::skip]
const COEFFICIENTS: [[i16; 4]; 90] = [
    // m = 0
    [6_482, 0, 120, 0], [-25_566, 0, -116, 0], [13_610, 0, -13, 0], [8_950, 0, -16, 0], [-2_332, 0, 6, 0],
    [644, 0, -2, 0], [795, 0, 0, 0], [232, 0, -1, 0], [46, 0, 0, 0], [-13, 0, 1, 0], [29, 0, 0, 0], [-20, 0, 0, 0],
    // m = 1
    [-14_108, 15_454, 97, -215], [29_511, -31_336, -52, -277], [-24_041, -566, -42, 40], [7_995, 2_786, -24, -11],
    [3_689, 454, 14, -5], [638, -184, -4, 3], [-770, -489, -1, 6], [108, 71, 2, -2], [78, -248, -1, -3],
    [-64, 33, 0, 0], [-15, 0, 0, 0], [-2, -13, 0, 0],
    // m = 2
    [16_493, -8_151, -80, -121], [12_438, 2_375, 4, -3], [557, -1_339, -60, 41], [1_872, 2_202, 0, 22],
    [769, 168, 9, -16], [-88, -144, -1, 5], [-175, -126, 0, 5], [30, 122, 1, 3], [2, 0, 1, 0], [-25, 29, 0, 1],
    [3, 7, 0, 0],
    // m = 3
    [4_536, -5_495, -156, -41], [-2_811, 2_120, 56, 16], [-1_387, -1_229, 6, 4], [-1_157, 488, 12, -4],
    [593, -10, 5, -8], [20, 114, 5, -4], [-2, 83, 3, -3], [20, 24, 1, -2], [24, -6, 0, 0], [12, 10, 0, -1],
    // m = 4
    [121, -3_756, -70, -44], [-1_420, 430, 22, 17], [-409, -598, -9, 9], [158, 234, -1, 0], [-217, -97, -1, 4],
    [-25, -33, -3, 3], [-10, 53, 0, 1], [-6, 2, 0, 1], [-13, -14, 0, 1],
    // m = 5
    [209, 1_061, 9, 19], [149, 109, 3, 7], [25, -74, -8, -10], [169, 127, 3, -5], [-131, -52, 0, 2],
    [-6, -91, -3, -1], [-1, 5, -1, 0], [6, 0, 0, 0],
    // m = 6
    [-607, 727, 9, 9], [-111, -251, -8, 6], [150, 7, 2, -6], [24, 72, 3, -1], [-9, 4, 0, 1], [-6, -3, 0, 0],
    [6, 6, 1, 0],
    // m = 7
    [142, -23, 8, -2], [-168, -52, 0, 3], [86, -6, -1, -2], [15, -42, -1, 0], [-1, -12, 0, 1], [5, -1, 0, 0],
    // m = 8
    [9, 39, 2, 2], [-87, 8, 1, 4], [9, -38, -1, -1], [11, -17, -1, 0], [-1, 8, 0, 0],
    // m = 9
    [-129, 100, -1, 1], [-27, 9, 0, 2], [-10, -29, -1, 0], [-4, 1, 0, 0],
    // m = 10
    [-39, -91, 0, 0], [-2, -18, -1, 0], [-2, -10, -1, 0],
    // m = 11
    [26, -23, -1, 0], [-13, 1, 0, 0],
    // m = 12
    [-7, 2, -1, -1],
];

#[cfg(test)]
#[cfg(feature = "wmm")]
mod tests;
