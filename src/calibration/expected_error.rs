//! Expected heading error, in degrees, over all headings: the quality figure of a calibration.
//!
//! Not the residual of the fit but this is the quality: a norm residual of 0.3 % can hide a heading error of 5 deg in a
//! direction that the samples do not show.

use core::f32::consts::FRAC_PI_6;
use core::fmt;

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use super::likelihood::heading_by_field;
use super::likelihood::unknowns::{Vector12, coefficients_row};
use super::uncertainty::Covariance;
use super::{Calibration, Method, Sample, Samples, inverse};
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

impl Envelope {
    /// Samples all of which have less bank than this, radians, show level headings alone; a turn begins at it. Of whatever
    /// is flown, those that have less pitch, too: who pushes ahead before he pushes aside will bank.
    pub const MIN_BANK_RAD: f32 = 10_f32.to_radians();

    /// Where a method's result from these samples is meant to be used.
    pub(super) fn of(method: Method, samples: Samples<'_>) -> Self {
        let has_any = samples.has_any();
        let is_level = |&Sample { attitude: Attitude { roll_rad, pitch_rad }, .. }: &Sample| {
            roll_rad.abs() < Self::MIN_BANK_RAD && (!has_any || pitch_rad.abs() < Self::MIN_BANK_RAD)
        };
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
    let at = Attitudes::new(calibration)?;
    let (rms_deg, worst_deg) = at.rms_and_worst_deg(covariance, envelope)?;
    let size = |part: Deviation| degrees(part_variance(part, covariance, &|bank_deg, step| at.row(bank_deg, step)));
    let weakest = Deviation::ALL
        .into_iter()
        .filter(|&part| part != Deviation::Heeling || envelope == Envelope::Banked)
        .map(|part| (part, size(part)))
        .fold((Deviation::Constant, 0.0), |a, b| if b.1 > a.1 { b } else { a });
    Some(Expected { rms_deg, worst_deg, weakest })
}

/// Its RMS alone, degrees.
pub(super) fn expected_rms_deg(calibration: &Calibration, covariance: &Covariance, envelope: Envelope) -> Option<f32> {
    Attitudes::new(calibration)?.rms_and_worst_deg(covariance, envelope).map(|(rms_deg, _)| rms_deg)
}

/// What a calibration measures at the attitudes of an envelope.
struct Attitudes {
    field_from_body: Matrix3<f32>,
    inclination_rad: f32,
}

impl Attitudes {
    /// `None` if the calibration has no inverse.
    fn new(calibration: &Calibration) -> Option<Self> {
        let field_from_body = inverse(&calibration.w_matrix())?;
        Some(Self { field_from_body, inclination_rad: calibration.inclination_rad })
    }

    /// Derivative of the heading by the coefficients, at a bank and a twelfth of the circle.
    fn row(&self, bank_deg: f32, step: u8) -> Vector12 {
        let tilt = Attitude::from_deg(bank_deg, 0.0).tilt();
        let level = Field::<Level>::earth(1.0, self.inclination_rad, f32::from(step) * FRAC_PI_6);
        let x = self.field_from_body * tilt.body(level).ut;
        coefficients_row(&heading_by_field(&tilt, &level.ut), &x)
    }

    fn rms_and_worst_deg(&self, covariance: &Covariance, envelope: Envelope) -> Option<(f32, f32)> {
        let mut sum = 0.0;
        let mut worst: f32 = 0.0;
        for &bank_deg in envelope.banks_deg() {
            for step in 0..HEADINGS {
                let variance = covariance.variance(&self.row(bank_deg, step));
                sum += variance;
                worst = worst.max(variance);
            }
        }
        let mean = sum / (usize::from(HEADINGS) * envelope.banks_deg().len()) as f32;
        mean.is_finite().then(|| (degrees(mean), degrees(worst)))
    }
}

/// A variance in square radians as a standard deviation in degrees.
fn degrees(variance: f32) -> f32 {
    libm::sqrtf(variance).to_degrees()
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

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::super::likelihood::unknowns::{beta, w};
    use super::super::tests::synthetic::{largest, mean, rms};
    use super::super::{Orientation, rows};
    use super::*;
    use crate::calibration::Rates;
    use crate::frames::wrap_pi;
    use crate::time::WrappingMillis;

    fn clean() -> Calibration {
        Calibration { inclination_rad: 0.9, total_ut: 1.0, ..Calibration::uncalibrated(Orientation::NONE) }
    }

    /// What is expected when coefficients are wrong together, 1 sigma each.
    fn expected_of(wrong: &[(usize, f32)], envelope: Envelope) -> Expected {
        let mut direction = Vector12::zeros();
        for &(index, size) in wrong {
            direction[index] = size;
        }
        let mut covariance = Covariance::EXACT;
        covariance.add_square(&direction, 1.0);
        expected(&clean(), &covariance, envelope).unwrap()
    }

    /// Heading errors of a calibration that is wrong by so much, degrees, at twelve headings of each bank.
    fn errors_deg(w: Matrix3<f32>, beta: [f32; 3], banks_deg: &[f32]) -> Vec<f32> {
        let wrong = Calibration { w: rows(&(Matrix3::identity() + w)), b_ut: beta, ..clean() };
        let error = |bank_deg: f32, step: u8| {
            let heading_rad = f32::from(step) * FRAC_PI_6;
            let attitude = Attitude::from_deg(bank_deg, 0.0);
            let field = Field::new(attitude.body(Field::earth(1.0, 0.9, heading_rad)).ut);
            wrap_pi(attitude.level(wrong.apply(field)).heading_rad() - heading_rad).to_degrees()
        };
        banks_deg.iter().flat_map(|&bank_deg| (0..12).map(move |step| error(bank_deg, step))).collect()
    }

    /// The parts by what makes them, as an adjuster knows them: a sensor turned about the vertical, hard iron in the
    /// horizontal, soft iron there, and the vertical response, which only shows in a bank.
    #[test]
    fn the_weakest_part_is_that_of_its_cause() {
        let turned = [(w(0, 1), -0.02), (w(1, 0), 0.02)];
        let constant = expected_of(&turned, Envelope::Banked).weakest;
        assert_eq!(constant.0, Deviation::Constant);
        assert!((constant.1 - 0.02_f32.to_degrees()).abs() < 0.01, "{constant:?}");
        for axis in [0, 1] {
            let semicircular = expected_of(&[(beta(axis), 0.02)], Envelope::Banked).weakest;
            assert_eq!(semicircular.0, Deviation::Semicircular);
            // A sine of 0.02 over the horizontal field.
            let amplitude_deg = (0.02 / 0.9_f32.cos()).to_degrees();
            assert!((semicircular.1 - amplitude_deg / 2_f32.sqrt()).abs() < 0.01, "{semicircular:?}");
        }
        for wrong in [&[(w(0, 0), 0.02), (w(1, 1), -0.02)], &[(w(0, 1), 0.02), (w(1, 0), 0.02)]] {
            let quadrantal = expected_of(wrong, Envelope::Level).weakest;
            assert_eq!(quadrantal.0, Deviation::Quadrantal);
            assert!((quadrantal.1 - 0.02_f32.to_degrees() / 2_f32.sqrt()).abs() < 0.01, "{quadrantal:?}");
        }
        let heeling = expected_of(&[(beta(2), 0.02)], Envelope::Banked).weakest;
        assert_eq!(heeling.0, Deviation::Heeling);
        let [right, left] = [30.0, -30.0].map(|bank_deg| errors_deg(Matrix3::zeros(), [0.0, 0.0, 0.02], &[bank_deg]));
        let halves: Vec<f32> = right.iter().zip(left).map(|(right, left)| (right - left) / 2.0).collect();
        assert!((heeling.1 - rms(&halves)).abs() < 0.02 * rms(&halves), "{heeling:?} {}", rms(&halves));
        // A vehicle that does not bank has none of it.
        assert_ne!(expected_of(&[(beta(2), 0.02)], Envelope::Level).weakest.0, Deviation::Heeling);
    }

    /// RMS and worst are those of calibrations that are wrong by as much, at the attitudes of the envelope.
    #[test]
    fn the_expected_error_is_that_of_wrong_calibrations() {
        for (envelope, banks_deg) in [(Envelope::Banked, &[-30.0, 0.0, 30.0][..]), (Envelope::Level, &[0.0])] {
            let beta_z = expected_of(&[(beta(2), 0.01), (w(0, 2), 0.01)], envelope);
            let mut change = Matrix3::zeros();
            change[(0, 2)] = 0.01;
            let errors = errors_deg(change, [0.0, 0.0, 0.01], banks_deg);
            assert!(mean(&errors).abs() < rms(&errors));
            // First order: 1 % of the field leaves a few per cent of itself.
            assert!((beta_z.rms_deg / rms(&errors) - 1.0).abs() < 0.03, "{beta_z:?} {}", rms(&errors));
            assert!((beta_z.worst_deg / largest(&errors) - 1.0).abs() < 0.05, "{beta_z:?} {}", largest(&errors));
        }
    }

    #[test]
    fn what_is_no_number_is_no_expectation() {
        let flat = Calibration { w: [[0.0; 3]; 3], ..clean() };
        assert_eq!(expected(&flat, &Covariance::EXACT, Envelope::Level), None);
        let mut covariance = Covariance::EXACT;
        covariance.fill(|_, _| 1e38);
        assert_eq!(expected(&clean(), &covariance, Envelope::Level), None);
        let nothing = expected(&clean(), &Covariance::EXACT, Envelope::Level).unwrap();
        assert_eq!([nothing.rms_deg.to_bits(), nothing.worst_deg.to_bits(), nothing.weakest.1.to_bits()], [0; 3]);
    }

    /// Ten degrees of bank make a turn, in whichever part; a single sample will do.
    #[test]
    fn what_was_banked_is_for_banking() {
        let sample = |roll_deg: f32| Sample {
            field: Field::from_ut(1.0, 0.0, 0.0),
            attitude: Attitude::from_deg(roll_deg, 0.0),
            time: WrappingMillis::default(),
            rates: Rates::NONE,
        };
        let of = |method, rolls_deg: &[f32]| {
            let level: Vec<Sample> = rolls_deg.iter().map(|&roll_deg| sample(roll_deg)).collect();
            Envelope::of(method, Samples { level: &level, ..Samples::default() })
        };
        assert_eq!(of(Method::CompassSwing, &[9.9, -9.9, 0.0]), Envelope::Level);
        assert_eq!(of(Method::CompassSwing, &[0.0, 10.1]), Envelope::Banked);
        assert_eq!(of(Method::MaximumLikelihood, &[-10.1, 0.0]), Envelope::Banked);
        // A level calibration is for level headings whatever gusts there were; a tumble has no attitudes.
        assert_eq!(of(Method::Level, &[20.0, -20.0]), Envelope::Level);
        assert_eq!(of(Method::Ellipsoid, &[0.0]), Envelope::Banked);
    }

    /// `cal advise` shows both: the name is stable, the words are for a pilot.
    #[test]
    fn parts_have_names_and_words() {
        let all = Deviation::ALL.map(|part| (part.name(), part.to_string()));
        assert_eq!(all.each_ref().map(|(name, _)| *name), ["constant", "semicircular", "quadrantal", "heeling"]);
        let words = ["at all headings", "once round", "twice round", "in turns"];
        assert!(all.iter().zip(words).all(|((_, said), word)| said.contains(word)), "{all:?}");
    }
}
