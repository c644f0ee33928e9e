//! Expected heading error, in degrees, over all headings: the quality figure of a calibration.
//!
//! Not the residual of the fit but this is the quality: a norm residual of 0.3 % can hide a heading error of 5 deg in a
//! direction that the samples do not show.

use core::f32::consts::FRAC_PI_6;
use core::fmt;

use serde::{Deserialize, Serialize};

use super::likelihood::heading_by_field;
use super::likelihood::unknowns::{Vector12, coefficients_row};
use super::uncertainty::Covariance;
use super::{Calibration, Method, Sample, Samples};
use crate::frames::{Attitude, Field, Level};
use crate::trig;

/// Attitudes for which an error is expected: at each of these banks twelve headings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Envelope {
    /// Bank -30, 0, 30 deg.
    Banked,
    /// Level.
    Level,
}

/// Samples all of which have less bank than this, radians, show level headings alone: 10 deg.
const LEVEL_ROLL_RAD: f32 = 0.175;

impl Envelope {
    /// Where a method's result from these samples is meant to be used.
    pub(super) fn of(method: Method, samples: Samples<'_>) -> Self {
        let is_level = |s: &Sample| s.attitude.roll_rad.abs() < LEVEL_ROLL_RAD;
        match method {
            Method::Level => Self::Level,
            // Its samples have no attitude.
            Method::Ellipsoid => Self::Banked,
            _ if samples.all().all(is_level) => Self::Level,
            _ => Self::Banked,
        }
    }

    const fn banks_deg(self) -> &'static [f32] {
        match self {
            Self::Banked => &[-30.0, 0.0, 30.0],
            Self::Level => &[0.0],
        }
    }
}

/// Headings of the envelope.
const HEADINGS: u8 = 12;

/// Expected heading error of a calibration, 1 sigma, without the noise of a single reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Expected {
    /// RMS over the envelope, degrees.
    pub rms_deg: f32,
    /// At the worst heading and bank of the envelope, degrees.
    pub worst_deg: f32,
    /// Which part of it is the largest, and how large, degrees RMS.
    pub weakest: (Deviation, f32),
}

/// The parts of a deviation, by the names of compass adjusters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Deviation {
    /// Coefficient A: the same at all headings.
    Constant,
    /// Coefficients B and C: once round the circle.
    Semicircular,
    /// Coefficients D and E: twice round the circle.
    Quadrantal,
    /// What changes with bank.
    Heeling,
}

impl Deviation {
    const ALL: [Self; 4] = [Self::Constant, Self::Semicircular, Self::Quadrantal, Self::Heeling];

    /// Stable name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Semicircular => "semicircular",
            Self::Quadrantal => "quadrantal",
            Self::Heeling => "heeling",
        }
    }
}

/// In a pilot's words.
impl fmt::Display for Deviation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Constant => "the same error at all headings",
            Self::Semicircular => "an error that changes once round the circle, opposite on opposite headings",
            Self::Quadrantal => "an error that changes twice round the circle, alike on opposite headings",
            Self::Heeling => "an error in turns that level flight does not have",
        })
    }
}

/// The heading error to expect of a calibration over an envelope.
pub(super) fn expected(calibration: &Calibration, covariance: &Covariance, envelope: Envelope) -> Option<Expected> {
    let field_from_body = calibration.w_matrix().try_inverse()?;
    let row = |bank_deg: f32, step: u8| {
        let attitude = Attitude::from_deg(bank_deg, 0.0);
        let level = Field::<Level>::earth(1.0, calibration.inclination_rad, f32::from(step) * FRAC_PI_6);
        let tilt = attitude.tilt();
        let x = field_from_body * tilt.body(level).ut;
        coefficients_row(&heading_by_field(&tilt, &level.ut), &x)
    };
    let mut sum = 0.0;
    let mut worst: f32 = 0.0;
    for &bank_deg in envelope.banks_deg() {
        for step in 0..HEADINGS {
            let variance = covariance.variance(&row(bank_deg, step));
            sum += variance;
            worst = worst.max(variance);
        }
    }
    let mean = sum / (usize::from(HEADINGS) * envelope.banks_deg().len()) as f32;
    let degrees = |variance: f32| libm::sqrtf(variance).to_degrees();
    let size = |part: Deviation| degrees(part_variance(part, covariance, &row));
    let weakest = Deviation::ALL
        .into_iter()
        .filter(|&part| part != Deviation::Heeling || envelope == Envelope::Banked)
        .map(|part| (part, size(part)))
        .fold((Deviation::Constant, 0.0), |a, b| if b.1 > a.1 { b } else { a });
    mean.is_finite().then(|| Expected { rms_deg: degrees(mean), worst_deg: degrees(worst), weakest })
}

/// Mean square of a part of the deviation.
fn part_variance(part: Deviation, covariance: &Covariance, row: &impl Fn(f32, u8) -> Vector12) -> f32 {
    let number = f32::from(HEADINGS);
    match part {
        Deviation::Constant => {
            covariance.variance(&((0..HEADINGS).map(|step| row(0.0, step)).sum::<Vector12>() / number))
        }
        Deviation::Semicircular => harmonic(1.0, covariance, row),
        Deviation::Quadrantal => harmonic(2.0, covariance, row),
        Deviation::Heeling => {
            let differences = (0..HEADINGS).map(|step| (row(30.0, step) - row(-30.0, step)) / 2.0);
            differences.map(|difference| covariance.variance(&difference)).sum::<f32>() / number
        }
    }
}

/// Mean square of the part of the level deviation that goes so many times round the circle.
fn harmonic(times: f32, covariance: &Covariance, row: &impl Fn(f32, u8) -> Vector12) -> f32 {
    let coefficient = |weight: fn(f32) -> f32| {
        let weighted = (0..HEADINGS).map(|step| row(0.0, step) * weight(times * f32::from(step) * FRAC_PI_6));
        covariance.variance(&(weighted.sum::<Vector12>() * (2.0 / f32::from(HEADINGS))))
    };
    // A sine of amplitude c has a mean square of c^2 / 2.
    coefficient(|angle_rad| trig::sin_cos(angle_rad).0).midpoint(coefficient(|angle_rad| trig::sin_cos(angle_rad).1))
}
