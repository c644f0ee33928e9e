//! Advice: the weakest part of a calibration and the manoeuvre that improves it most.
//!
//! Hypothetical samples of each candidate are added to the information; the smallest expected heading error wins.
//! Candidates are circles for aircraft that bank into turns, otherwise tilts on given headings.

use core::f32::consts::{FRAC_PI_2, TAU};
use core::fmt;

use crate::calibration::fit::ConvergedFit;
use crate::calibration::hypotheses::attitude_error_table::AttitudeErrorSigmas;
use crate::calibration::model::ModelParameters;
use crate::calibration::types::quality::{Method, UnobservableQuantities};
use crate::calibration::types::samples::{CollectionPart, Samples};
use crate::calibration::uncertainty::coefficient_covariance::CoefficientCovariance;
use crate::calibration::uncertainty::expected_error::{self, Deviation};
use crate::calibration::uncertainty::information::Information;
use crate::calibration::uncertainty::observability::unobservable_quantities;
use crate::calibration::uncertainty::sandwich_covariance::{CovarianceContent, sandwich_covariance};
use crate::frames::RollPitch;
use crate::trig::sqrt;

/// Recommended manoeuvre.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Manoeuvre {
    /// Full circle at a bank in degrees, positive to the right.
    Circle(i8),
    /// Full circle without bank, or straight legs on eight headings.
    Level,
    /// Full turn on the spot without tilt.
    YawTurn,
    /// Tilt by about 15 deg on the headings of a quadrant, or on all headings.
    Tilt(TiltDirection, Option<HeadingQuadrant>),
}

/// Direction of a tilt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TiltDirection {
    /// Tilt with the nose down.
    Ahead,
    /// Tilt with the nose up.
    Back,
    /// Tilt with the left side down.
    Left,
    /// Tilt with the right side down.
    Right,
}

/// Quadrant of headings, named after its first cardinal point, clockwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeadingQuadrant {
    /// Headings from north to east.
    North,
    /// Headings from east to south.
    East,
    /// Headings from south to west.
    South,
    /// Headings from west to north.
    West,
}

/// Tilt of a recommended manoeuvre, degrees; rough roads or waves cause as much.
const RECOMMENDED_TILT_DEG: f32 = 15.0;

/// Circle manoeuvres, the cheapest first, because the first of equals is recommended.
const CIRCLE_MANOEUVRES: [Manoeuvre; 7] = [
    Manoeuvre::Circle(-25),
    Manoeuvre::Circle(25),
    Manoeuvre::Circle(-40),
    Manoeuvre::Circle(40),
    Manoeuvre::Circle(-15),
    Manoeuvre::Circle(15),
    Manoeuvre::Level,
];

impl TiltDirection {
    const ALL_DIRECTIONS: [Self; 4] = [Self::Ahead, Self::Back, Self::Left, Self::Right];

    fn tilt_attitude(self) -> RollPitch {
        let [roll_deg, pitch_deg] = match self {
            Self::Ahead => [0.0, -RECOMMENDED_TILT_DEG],
            Self::Back => [0.0, RECOMMENDED_TILT_DEG],
            Self::Left => [-RECOMMENDED_TILT_DEG, 0.0],
            Self::Right => [RECOMMENDED_TILT_DEG, 0.0],
        };
        RollPitch::from_deg(roll_deg, pitch_deg)
    }

    const fn direction_name(self) -> &'static str {
        match self {
            Self::Ahead => "ahead",
            Self::Back => "back",
            Self::Left => "to the left",
            Self::Right => "to the right",
        }
    }
}

impl HeadingQuadrant {
    const NAMED_QUADRANTS: [Option<Self>; 4] =
        [Some(Self::North), Some(Self::East), Some(Self::South), Some(Self::West)];

    const fn quadrant_name(self) -> &'static str {
        match self {
            Self::North => "north to east",
            Self::East => "east to south",
            Self::South => "south to west",
            Self::West => "west to north",
        }
    }
}

impl Manoeuvre {
    /// Candidates for a vehicle: circles if it banks into its turns, otherwise a turn and tilts, in the quadrants that its
    /// heading is accurate enough to name.
    fn candidates(is_banking: bool, names_quadrants: bool) -> impl Iterator<Item = Self> {
        let (circles, on_the_spot): (&[Self], _) =
            if is_banking { (&CIRCLE_MANOEUVRES, None) } else { (&[], Some(Self::YawTurn)) };
        let directions: &[TiltDirection] = if is_banking { &[] } else { &TiltDirection::ALL_DIRECTIONS };
        let quadrants: &[_] = if names_quadrants { &HeadingQuadrant::NAMED_QUADRANTS } else { &[None] };
        let tilts =
            directions.iter().flat_map(|&towards| quadrants.iter().map(move |&quadrant| Self::Tilt(towards, quadrant)));
        circles.iter().copied().chain(on_the_spot).chain(tilts)
    }

    /// Whether only a vehicle that banks into its turns can fly it.
    #[must_use]
    pub const fn needs_bank(self) -> bool {
        matches!(self, Self::Circle(..))
    }

    fn attitude(self) -> RollPitch {
        match self {
            Self::Circle(bank_deg) => RollPitch::from_deg(f32::from(bank_deg), 0.0),
            Self::Level | Self::YawTurn => RollPitch::default(),
            Self::Tilt(towards, _) => towards.tilt_attitude(),
        }
    }

    fn headings_rad(self) -> impl Iterator<Item = f32> {
        let (first_rad, range_rad, samples) = match self {
            Self::Tilt(_, Some(quarter)) => {
                (f32::from(quarter as u8) * FRAC_PI_2, FRAC_PI_2, CIRCLE_EFFECTIVE_SAMPLES / 4)
            }
            _ => (0.0, TAU, CIRCLE_EFFECTIVE_SAMPLES),
        };
        (0..samples).map(move |i| first_rad + f32::from(i) * (range_rad / f32::from(samples)))
    }
}

impl fmt::Display for Manoeuvre {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Circle(bank_deg) => {
                let side = if *bank_deg < 0 { "left" } else { "right" };
                write!(f, "a {side} circle at {} deg of bank", bank_deg.unsigned_abs())
            }
            Self::Level => f.write_str("a level circle, or straight legs at eight headings"),
            Self::YawTurn => f.write_str("turn once round, level"),
            Self::Tilt(towards, quarter) => {
                write!(f, "tilt {} while ", towards.direction_name())?;
                match quarter {
                    Some(quarter) => write!(f, "heading {}", quarter.quadrant_name()),
                    None => f.write_str("turning all round"),
                }
            }
        }
    }
}

/// Weakest part of a calibration and recommended manoeuvre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advice {
    /// Largest part of the expected error.
    pub weakest_deviation: Deviation,
    /// Size of the largest part, degrees RMS.
    pub weakest_deviation_deg: f32,
    /// Expected error, degrees RMS.
    pub expected_deg: f32,
    /// Recommended manoeuvre.
    pub manoeuvre: Manoeuvre,
    /// Expected error after the manoeuvre, degrees RMS.
    pub expected_after_deg: f32,
    /// Expected error with unlimited samples of the same kind, degrees RMS.
    pub error_floor_deg: f32,
    /// Unobservable quantities, which the priors determine.
    pub unobservable: UnobservableQuantities,
}

impl Advice {
    /// Whether the manoeuvre reduces the expected error noticeably: by 5 %, and by 0.01 deg, the last digit shown.
    #[must_use]
    pub fn is_worthwhile(&self) -> bool {
        self.expected_after_deg <= NOTICEABLE_ERROR_RATIO * self.expected_deg
            && self.expected_deg - self.expected_after_deg >= 0.01
    }

    /// Whether more of the same samples would reduce the expected error by less than a tenth.
    #[must_use]
    pub fn is_at_floor(&self) -> bool {
        self.expected_deg <= AT_FLOOR_ERROR_RATIO * self.error_floor_deg
    }
}

/// Ratio of a noticeably smaller error to the previous one.
pub const NOTICEABLE_ERROR_RATIO: f32 = 0.95;

/// Expected error over its floor, below which more samples of the same kind are not worth the flight.
const AT_FLOOR_ERROR_RATIO: f32 = 1.1;

/// Effective sample size of a full circle: 54 samples at 13 deg/s, corrected for autocorrelation; a quarter of them per
/// quadrant.
const CIRCLE_EFFECTIVE_SAMPLES: u8 = 24;

/// Expected error above which headings are too uncertain to name a quadrant, degrees RMS.
const MAX_ERROR_TO_NAME_QUADRANT_DEG: f32 = 3.0;

/// Correlation of bank and heading rate: 1 in coordinated turns, about 0.5 for a VTOL that hovered before them.
const MIN_BANK_TO_TURN_RATE_CORRELATION: f32 = 0.45;

/// Whether the vehicle banks into its turns; true for samples of the turns procedure.
fn banks_into_turns(samples: Samples<'_>) -> bool {
    let (mut product_sum, mut bank_squares, mut rate_squares) = (0.0, 0.0, 0.0);
    for sample in samples.samples_of_part(CollectionPart::FREE).iter() {
        let (roll_rad, rate_rad_s) = (sample.attitude.roll_rad, sample.rates.heading_rad_s());
        product_sum += roll_rad * rate_rad_s;
        bank_squares += roll_rad * roll_rad;
        rate_squares += rate_rad_s * rate_rad_s;
    }
    !samples.has_free_flight_samples()
        || product_sum > MIN_BANK_TO_TURN_RATE_CORRELATION * sqrt(bank_squares * rate_squares)
}

/// Tilt of a vehicle that lists steadily, which it keeps when it turns on the spot; else level.
fn steady_list(samples: Samples<'_>) -> RollPitch {
    /// Mean tilt that is a list, radians (5 deg): more than a trim or a mounting is off.
    const MIN_LIST_RAD: f32 = 0.087;
    let (mut sum_rad, mut count) = ([0.0_f32; 2], 0.0_f32);
    for sample in samples.samples_of_part(CollectionPart::FREE).iter() {
        sum_rad = [sum_rad[0] + sample.attitude.roll_rad, sum_rad[1] + sample.attitude.pitch_rad];
        count += 1.0;
    }
    let [roll_rad, pitch_rad] = sum_rad.map(|sum| sum / count.max(1.0));
    let is_listing = roll_rad * roll_rad + pitch_rad * pitch_rad > MIN_LIST_RAD * MIN_LIST_RAD;
    if is_listing { RollPitch { roll_rad, pitch_rad } } else { RollPitch::default() }
}

#[inline(never)]
pub(in crate::calibration) fn select_manoeuvre(
    information: &Information,
    fit: &ConvergedFit<'_>,
    sigmas: &AttitudeErrorSigmas,
) -> Option<Advice> {
    let &ConvergedFit { likelihood, unknowns, calibration, .. } = fit;
    let envelope = fit.envelope();
    // One covariance for all candidates: the solver's stack is deepest here.
    let mut covariance = CoefficientCovariance::ZERO;
    sandwich_covariance(information, likelihood, unknowns, (CovarianceContent::All, sigmas), &mut covariance)?;
    let current_error = expected_error::expected_heading_error(calibration, &covariance, envelope)?;
    let mut rms_deg = |information: &Information, errors: CovarianceContent| {
        sandwich_covariance(information, likelihood, unknowns, (errors, sigmas), &mut covariance)?;
        expected_error::expected_rms_deg(calibration, &covariance, envelope)
    };
    let parameters = ModelParameters::from_unknowns(unknowns);
    // Samples without attitude show no motion.
    let is_banking = fit.method == Method::Ellipsoid || banks_into_turns(fit.samples);
    // Only vehicles that do not bank into their turns turn on the spot.
    let rest_attitude = if is_banking { RollPitch::default() } else { steady_list(fit.samples) };
    let names_quadrants = current_error.rms_deg <= MAX_ERROR_TO_NAME_QUADRANT_DEG;
    let (manoeuvre, error_after_deg) = Manoeuvre::candidates(is_banking, names_quadrants)
        .filter_map(|manoeuvre| {
            let mut hypothetical = information.clone();
            let attitude = if manoeuvre == Manoeuvre::YawTurn { rest_attitude } else { manoeuvre.attitude() };
            for heading_rad in manoeuvre.headings_rad() {
                hypothetical.add_hypothetical_sample(likelihood, &parameters, attitude, heading_rad);
            }
            Some((manoeuvre, rms_deg(&hypothetical, CovarianceContent::All)?))
        })
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(Advice {
        weakest_deviation: current_error.weakest_deviation.0,
        weakest_deviation_deg: current_error.weakest_deviation.1,
        expected_deg: current_error.rms_deg,
        manoeuvre,
        expected_after_deg: error_after_deg,
        error_floor_deg: rms_deg(information, CovarianceContent::WithoutNoise)?,
        unobservable: unobservable_quantities(&information.linear_system, likelihood, unknowns).unwrap_or_default(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::tests::synthetic::free_samples;
    use crate::calibration::{AngleRates, Sample};
    use crate::frames::Field;

    #[test]
    fn each_manoeuvre_has_a_text_and_an_attitude() {
        use {HeadingQuadrant as Quadrant, Manoeuvre::Tilt, TiltDirection as Towards};
        for (manoeuvre, text, roll_pitch_deg) in [
            (Manoeuvre::Circle(-25), "a left circle at 25 deg of bank", [-25.0, 0.0]),
            (Manoeuvre::Circle(40), "a right circle at 40 deg of bank", [40.0, 0.0]),
            (Manoeuvre::Level, "a level circle, or straight legs at eight headings", [0.0; 2]),
            (Manoeuvre::YawTurn, "turn once round, level", [0.0; 2]),
            (Tilt(Towards::Left, Some(Quadrant::East)), "tilt to the left while heading east to south", [-15.0, 0.0]),
            (Tilt(Towards::Right, Some(Quadrant::North)), "tilt to the right while heading north to east", [15.0, 0.0]),
            (Tilt(Towards::Ahead, Some(Quadrant::South)), "tilt ahead while heading south to west", [0.0, -15.0]),
            (Tilt(Towards::Back, Some(Quadrant::West)), "tilt back while heading west to north", [0.0, 15.0]),
            (Tilt(Towards::Back, None), "tilt back while turning all round", [0.0, 15.0]),
        ] {
            let RollPitch { roll_rad, pitch_rad } = manoeuvre.attitude();
            let found_deg = [roll_rad, pitch_rad].map(|rad| rad.to_degrees().round());
            assert_eq!((manoeuvre.to_string(), found_deg), (text.into(), roll_pitch_deg));
        }
    }

    #[test]
    fn candidates_match_the_vehicle_motion() {
        for (number, is_named) in [(17, true), (5, false)] {
            assert_eq!(Manoeuvre::candidates(true, is_named).collect::<Vec<_>>(), CIRCLE_MANOEUVRES);
            let others: Vec<_> = Manoeuvre::candidates(false, is_named).collect();
            assert_eq!((others.len(), others[0]), (number, Manoeuvre::YawTurn));
            for (i, tilt) in others.iter().enumerate().skip(1) {
                assert!(!others[..i].contains(tilt), "{others:?}");
                assert!(matches!(tilt, Manoeuvre::Tilt(_, quarter) if quarter.is_some() == is_named), "{others:?}");
            }
        }
    }

    /// An angle, or its rate, at a time.
    type Angle<'a> = &'a dyn Fn(f32) -> f32;

    #[test]
    fn correlated_bank_and_turn_rate_indicate_banked_turns() {
        // Correlation is the cosine of the phase difference: 0.62 and 0.36.
        let swing = |t: f32| 25.0 * t.sin();
        let cases: [(&str, Angle, Angle, bool); 6] = [
            ("into the turns", &swing, &|t| 12.0 * t.sin(), true),
            ("out of the turns", &swing, &|t| -12.0 * t.sin(), false),
            ("a circle to the left", &|_| -25.0, &|_| -12.0, true),
            ("no turns", &swing, &|_| 0.0, false),
            ("turns somewhat late", &swing, &|t| 12.0 * (t + 0.9).sin(), true),
            ("turns at other times", &swing, &|t| 12.0 * (t + 1.2).sin(), false),
        ];
        for (name, bank_deg, rate_deg_s, expected) in cases {
            let sample = |i: u8| {
                let attitude = RollPitch::from_deg(bank_deg(f32::from(i) * 0.1), 0.0);
                let rates = AngleRates::from_rad_s([0.0, 0.0, rate_deg_s(f32::from(i) * 0.1).to_radians()]);
                Sample { rates, ..Sample::new(Field::from_ut(20.0, 0.0, 40.0), attitude) }
            };
            let samples: Vec<Sample> = (0..100).map(sample).collect();
            assert_eq!(banks_into_turns(free_samples(&samples)), expected, "{name}");
        }
        assert!(banks_into_turns(Samples::default()), "turns were asked for");
    }

    /// A boat that lists by 8 deg in waves of 4 deg keeps the list; waves alone, and a trim of 3 deg, are no list.
    #[test]
    fn a_listing_vehicle_is_not_expected_to_turn_level() {
        for (list_deg, expected_deg) in [(8.0, 8.0), (-8.0, -8.0), (3.0, 0.0), (0.0, 0.0)] {
            let sample = |i: u8| {
                let roll_deg = list_deg + 4.0 * (f32::from(i) * TAU / 20.0).sin();
                Sample::new(Field::from_ut(20.0, 0.0, 40.0), RollPitch::from_deg(roll_deg, 0.0))
            };
            let samples: Vec<Sample> = (0..100).map(sample).collect();
            let found_deg = steady_list(free_samples(&samples)).roll_rad.to_degrees();
            assert!((found_deg - expected_deg).abs() < 0.1, "{list_deg}: {found_deg}");
        }
    }
}
