//! Advice: what is weakest in a calibration, and which manoeuvre would mend it.
//!
//! Each manoeuvre is flown on paper: what its samples would say is added to what the real ones said, and the expected
//! error computed anew. The one that leaves the least is advised, of circles to an aircraft that banks into its turns, and
//! of tilts on a heading to one that tilts as it likes.

use core::f32::consts::{FRAC_PI_2, TAU};
use core::fmt;

use super::expected_error::{self, Deviation, Envelope};
use super::information::{Consider, Errors, Information};
use super::likelihood::{Likelihood, Parameters, Quantity, Vector13};
use super::uncertainty::Covariance;
use super::{Calibration, Samples, Side};
use crate::frames::Attitude;

/// Something to fly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Manoeuvre {
    /// A full circle to a side at so many degrees of bank.
    Circle(Side, u8),
    /// A full circle without bank, or straight legs at eight headings.
    Level,
    /// A turn on the spot, all round, without tilt.
    Round,
    /// A tilt of some 15 deg while heading into a quarter of the circle, or all round it.
    Tilt(Towards, Option<Quarter>),
}

/// To which side something tilts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Towards {
    /// Nose down.
    Ahead,
    /// Nose up.
    Back,
    /// Left side down.
    Left,
    /// Right side down.
    Right,
}

/// A quarter of the circle, by the cardinal point at which it begins, clockwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quarter {
    /// North to east.
    North,
    /// East to south.
    East,
    /// South to west.
    South,
    /// West to north.
    West,
}

/// A push of the stick that a person dares, and that a rough road or a wave may do, degrees.
const TILT_DEG: f32 = 15.0;

/// Circles, cheap first, so that of equals the cheaper wins.
const CIRCLES: [Manoeuvre; 7] = [
    Manoeuvre::Circle(Side::Left, 25),
    Manoeuvre::Circle(Side::Right, 25),
    Manoeuvre::Circle(Side::Left, 40),
    Manoeuvre::Circle(Side::Right, 40),
    Manoeuvre::Circle(Side::Left, 15),
    Manoeuvre::Circle(Side::Right, 15),
    Manoeuvre::Level,
];

impl Towards {
    const ALL: [Self; 4] = [Self::Ahead, Self::Back, Self::Left, Self::Right];

    /// Roll and pitch, degrees.
    fn tilted(self) -> Attitude {
        let [roll_deg, pitch_deg] = match self {
            Self::Ahead => [0.0, -TILT_DEG],
            Self::Back => [0.0, TILT_DEG],
            Self::Left => [-TILT_DEG, 0.0],
            Self::Right => [TILT_DEG, 0.0],
        };
        Attitude::from_deg(roll_deg, pitch_deg)
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Ahead => "ahead",
            Self::Back => "back",
            Self::Left => "to the left",
            Self::Right => "to the right",
        }
    }
}

impl Quarter {
    const ALL: [Self; 4] = [Self::North, Self::East, Self::South, Self::West];

    const fn name(self) -> &'static str {
        match self {
            Self::North => "north to east",
            Self::East => "east to south",
            Self::South => "south to west",
            Self::West => "west to north",
        }
    }
}

impl Manoeuvre {
    /// What is tried, by its number.
    fn nth(number: usize, moves: Moves) -> Option<Self> {
        if moves == Moves::Banks {
            return CIRCLES.get(number).copied();
        }
        let Some(number) = number.checked_sub(1) else { return Some(Self::Round) };
        if moves == Moves::TiltsSomehow {
            return Towards::ALL.get(number).map(|&towards| Self::Tilt(towards, None));
        }
        let quarters = Quarter::ALL.len();
        Some(Self::Tilt(*Towards::ALL.get(number / quarters)?, Quarter::ALL.get(number % quarters).copied()))
    }

    fn attitude(self) -> Attitude {
        match self {
            Self::Circle(Side::Left, bank_deg) => Attitude::from_deg(-f32::from(bank_deg), 0.0),
            Self::Circle(Side::Right, bank_deg) => Attitude::from_deg(f32::from(bank_deg), 0.0),
            Self::Level | Self::Round => Attitude::default(),
            Self::Tilt(towards, _) => towards.tilted(),
        }
    }

    /// Its headings on paper, evenly spread over the circle or the quarter, radians.
    fn headings_rad(self) -> impl Iterator<Item = f32> {
        let (first_rad, range_rad, samples) = match self {
            Self::Tilt(_, Some(quarter)) => (f32::from(quarter as u8) * FRAC_PI_2, FRAC_PI_2, SAMPLES / 4),
            _ => (0.0, TAU, SAMPLES),
        };
        (0..samples).map(move |i| first_rad + f32::from(i) * (range_rad / f32::from(samples)))
    }
}

/// In words.
impl fmt::Display for Manoeuvre {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Circle(side, bank_deg) => write!(f, "a {} circle at {bank_deg} deg of bank", side.name()),
            Self::Level => f.write_str("a level circle, or straight legs at eight headings"),
            Self::Round => f.write_str("turn once round, level"),
            Self::Tilt(towards, quarter) => {
                write!(f, "tilt {} while ", towards.name())?;
                match quarter {
                    Some(quarter) => write!(f, "heading {}", quarter.name()),
                    None => f.write_str("turning all round"),
                }
            }
        }
    }
}

/// What is weak, and what would help.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Advice {
    /// The largest part of the expected error.
    pub weakest: Deviation,
    /// Its size, degrees RMS.
    pub weakest_deg: f32,
    /// Expected error now, degrees RMS.
    pub expected_deg: f32,
    /// What to fly.
    pub manoeuvre: Manoeuvre,
    /// Expected error with that, degrees RMS.
    pub with_it_deg: f32,
    /// What more of the same samples would leave of the expected error, degrees RMS.
    pub floor_deg: f32,
    /// What the samples leave to the assumptions.
    pub assumed: Assumed,
}

impl Advice {
    /// Whether what is advised makes the error to expect noticeably smaller: by a twentieth of it, and by 0.01 deg, the
    /// last digit that is shown.
    #[must_use]
    pub fn gains(&self) -> bool {
        self.with_it_deg <= NOTICEABLE * self.expected_deg && self.expected_deg - self.with_it_deg >= 0.01
    }

    /// Whether more of the same samples would make it no smaller, but for a tenth.
    #[must_use]
    pub fn is_at_floor(&self) -> bool {
        self.expected_deg <= AT_FLOOR * self.floor_deg
    }
}

/// What is left of an error that has become noticeably smaller.
pub(crate) const NOTICEABLE: f32 = 0.95;

/// The expected error over what more of the same samples would leave, when they are not worth flying for.
const AT_FLOOR: f32 = 1.1;

/// What the samples leave to the assumptions about airframes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Assumed {
    /// Soft iron is assumed small in some direction.
    pub soft_iron: bool,
    /// The mounting is assumed to be the configured one about some axis.
    pub mounting: bool,
    /// Hard iron is assumed small along some axis.
    pub hard_iron: bool,
}

/// Samples of a circle on paper: what the collection keeps of one at 13 deg/s, less their correlation. A tilt held through
/// a quarter of it has a quarter of them.
const SAMPLES: u8 = 24;

/// With more than this, degrees RMS, headings are not known well enough to name one.
const MAX_NAMED_DEG: f32 = 3.0;

/// How something moves, and how well that is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Moves {
    /// It banks into its turns.
    Banks,
    /// It tilts as it likes.
    Tilts,
    /// The same, on headings that are not known.
    TiltsSomehow,
}

/// How much bank goes with the rate of turn, as a correlation, in what banks into its turns.
const BANKS: f32 = 0.5;

/// Whether what flies banks into its turns, as body rates show it. Who was asked for turns flies turns.
fn banks_into_turns(samples: Samples<'_>) -> bool {
    let (mut both, mut banks, mut turns) = (0.0, 0.0, 0.0);
    for sample in samples.any.into_iter().flatten() {
        let (roll_rad, rate_rad_s) = (sample.attitude.roll_rad, sample.rates.heading_rad_s());
        both += roll_rad * rate_rad_s;
        banks += roll_rad * roll_rad;
        turns += rate_rad_s * rate_rad_s;
    }
    !samples.has_any() || both > BANKS * libm::sqrtf(banks * turns)
}

/// Looks for the manoeuvre that would help most. `None` when nothing could be computed.
#[inline(never)]
pub(super) fn advise(
    information: &Information,
    likelihood: &Likelihood,
    unknowns: &Vector13,
    consider: Consider,
    calibration: &Calibration,
    (samples, envelope): (Samples<'_>, Envelope),
) -> Option<Advice> {
    let covariance = |information: &Information, errors: Errors| {
        let mut covariance = Covariance::EXACT;
        information.covariance(likelihood, unknowns, (errors, consider), &mut covariance).map(|()| covariance)
    };
    let rms_deg = |information: &Information, errors: Errors| {
        expected_error::expected_rms_deg(calibration, &covariance(information, errors)?, envelope)
    };
    let now = expected_error::expected(calibration, &covariance(information, Errors::All)?, envelope)?;
    let parameters = Parameters::new(unknowns);
    let moves = match (banks_into_turns(samples), now.rms_deg <= MAX_NAMED_DEG) {
        (true, _) => Moves::Banks,
        (false, true) => Moves::Tilts,
        (false, false) => Moves::TiltsSomehow,
    };
    let (manoeuvre, with_it_deg) = (0..)
        .map_while(|number| Manoeuvre::nth(number, moves))
        .filter_map(|manoeuvre| {
            let mut supposed = information.clone();
            for heading_rad in manoeuvre.headings_rad() {
                supposed.suppose(likelihood, &parameters, manoeuvre.attitude(), heading_rad);
            }
            Some((manoeuvre, rms_deg(&supposed, Errors::All)?))
        })
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(Advice {
        weakest: now.weakest.0,
        weakest_deg: now.weakest.1,
        expected_deg: now.rms_deg,
        manoeuvre,
        with_it_deg,
        floor_deg: rms_deg(information, Errors::Lasting)?,
        assumed: assumed(information.left_to_priors(likelihood, unknowns).into_iter().flatten()),
    })
}

/// What rests on priors, in the words of an advice. Of the inclination it says nothing, for nobody can fly it.
fn assumed(left_to_priors: impl Iterator<Item = Quantity>) -> Assumed {
    let mut assumed = Assumed::default();
    for quantity in left_to_priors {
        match quantity {
            Quantity::SoftIron => assumed.soft_iron = true,
            Quantity::Mounting => assumed.mounting = true,
            Quantity::HardIron => assumed.hard_iron = true,
            Quantity::Inclination => {}
        }
    }
    assumed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Rates, Sample};
    use crate::frames::Field;
    use crate::time::WrappingMillis;

    #[test]
    fn manoeuvres_have_words_and_banks() {
        let said = |manoeuvre: Manoeuvre| {
            let Attitude { roll_rad, pitch_rad } = manoeuvre.attitude();
            (manoeuvre.to_string(), [roll_rad, pitch_rad].map(|rad| rad.to_degrees().round() as i8))
        };
        assert_eq!(said(Manoeuvre::Circle(Side::Left, 25)), ("a left circle at 25 deg of bank".into(), [-25, 0]));
        assert_eq!(said(Manoeuvre::Circle(Side::Right, 40)), ("a right circle at 40 deg of bank".into(), [40, 0]));
        assert_eq!(said(Manoeuvre::Level), ("a level circle, or straight legs at eight headings".into(), [0, 0]));
        assert_eq!(said(Manoeuvre::Round), ("turn once round, level".into(), [0, 0]));
        for (towards, quarter, words, deg) in [
            (Towards::Left, Quarter::East, "tilt to the left while heading east to south", [-15, 0]),
            (Towards::Right, Quarter::North, "tilt to the right while heading north to east", [15, 0]),
            (Towards::Ahead, Quarter::South, "tilt ahead while heading south to west", [0, -15]),
            (Towards::Back, Quarter::West, "tilt back while heading west to north", [0, 15]),
        ] {
            assert_eq!(said(Manoeuvre::Tilt(towards, Some(quarter))), (words.into(), deg));
        }
        let all_round = Manoeuvre::Tilt(Towards::Back, None);
        assert_eq!(said(all_round), ("tilt back while turning all round".into(), [0, 15]));
    }

    /// Seven circles; or a turn and each of sixteen tilts; or of four, where headings are not known.
    #[test]
    fn what_is_tried_is_what_it_can_fly() {
        let tried = |moves| (0..).map_while(|number| Manoeuvre::nth(number, moves)).collect::<Vec<_>>();
        assert_eq!(tried(Moves::Banks), CIRCLES);
        for (moves, number, is_named) in [(Moves::Tilts, 17, true), (Moves::TiltsSomehow, 5, false)] {
            let others = tried(moves);
            assert_eq!((others.len(), others[0]), (number, Manoeuvre::Round));
            for (i, tilt) in others.iter().enumerate().skip(1) {
                assert!(!others[..i].contains(tilt), "{others:?}");
                assert!(matches!(tilt, Manoeuvre::Tilt(_, quarter) if quarter.is_some() == is_named), "{others:?}");
            }
        }
    }

    /// Bank that goes with the rate of turn is a turn of an aeroplane; against it, or by chance, it is none, nor is any
    /// where no rates are known.
    #[test]
    fn bank_that_goes_with_the_turn_is_that_of_an_aeroplane() {
        let flown = |bank_deg: &dyn Fn(f32) -> f32, rate_deg_s: &dyn Fn(f32) -> f32| {
            let samples: Vec<Sample> = (0..100)
                .map(|i: u8| {
                    let attitude = Attitude::from_deg(bank_deg(f32::from(i) * 0.1), 0.0);
                    let rates = Rates::from_rad_s([0.0, 0.0, rate_deg_s(f32::from(i) * 0.1).to_radians()]);
                    Sample { field: Field::from_ut(20.0, 0.0, 40.0), attitude, time: WrappingMillis::default(), rates }
                })
                .collect();
            banks_into_turns(Samples { any: [&samples[..30], &[], &samples[30..]], ..Samples::default() })
        };
        assert!(flown(&|t| 25.0 * t.sin(), &|t| 12.0 * t.sin()));
        assert!(!flown(&|t| 25.0 * t.sin(), &|t| -12.0 * t.sin()));
        assert!(!flown(&|t| 25.0 * t.sin(), &|_| 0.0));
        // A correlation of the cosine of the angle between the two: 60 deg are half.
        assert!(flown(&|t| 25.0 * t.sin(), &|t| 12.0 * (t + 0.9).sin()));
        assert!(!flown(&|t| 25.0 * t.sin(), &|t| 12.0 * (t + 1.2).sin()));
        assert!(banks_into_turns(Samples::default()), "who was asked for turns");
    }

    /// A twentieth of 0.4 deg is 0.02; of 0.1 deg only 0.005, which would not be seen.
    #[test]
    fn advice_that_gains_nothing_is_none() {
        let gains = |expected_deg, with_it_deg| {
            let advice = Advice {
                weakest: Deviation::Constant,
                weakest_deg: 0.1,
                expected_deg,
                manoeuvre: Manoeuvre::Level,
                with_it_deg,
                floor_deg: 0.0,
                assumed: Assumed::default(),
            };
            advice.gains()
        };
        assert!(!gains(0.4, 0.4) && !gains(0.4, 0.381) && gains(0.4, 0.379));
        assert!(!gains(0.1, 0.091) && gains(0.1, 0.089));
        assert!(!gains(0.4, f32::NAN) && !gains(f32::NAN, 0.4));
    }

    /// A circle at 13 deg/s takes 27 s and gives 54 samples, two a second, of which correlation leaves 24.
    #[test]
    fn a_circle_on_paper_goes_round_once() {
        let headings: Vec<f32> = Manoeuvre::Circle(Side::Left, 25).headings_rad().collect();
        assert_eq!((headings.len(), headings[0].to_bits()), (24, 0));
        let are_even = |headings: &[f32]| headings.windows(2).all(|pair| (pair[1] - pair[0] - TAU / 24.0).abs() < 1e-5);
        assert!(are_even(&headings));
        for (quarter, first_deg) in Quarter::ALL.into_iter().zip([0.0_f32, 90.0, 180.0, 270.0]) {
            let headings: Vec<f32> = Manoeuvre::Tilt(Towards::Back, Some(quarter)).headings_rad().collect();
            assert!(are_even(&headings) && headings.len() == 6 && (headings[0] - first_deg.to_radians()).abs() < 1e-5);
        }
        assert_eq!(Manoeuvre::Tilt(Towards::Back, None).headings_rad().count(), 24);
    }

    /// A tenth above what more of the same would leave.
    #[test]
    fn the_floor_is_reached_within_a_tenth() {
        let is_at_floor = |expected_deg, floor_deg| {
            let advice = Advice {
                weakest: Deviation::Constant,
                weakest_deg: 0.1,
                expected_deg,
                manoeuvre: Manoeuvre::Round,
                with_it_deg: 0.0,
                floor_deg,
                assumed: Assumed::default(),
            };
            advice.is_at_floor()
        };
        assert!(is_at_floor(1.09, 1.0) && !is_at_floor(1.11, 1.0) && !is_at_floor(1.0, f32::NAN));
    }

    #[test]
    fn each_assumption_is_said() {
        let said = |quantity| assumed([quantity].into_iter());
        let nothing = Assumed::default();
        assert_eq!(said(Quantity::SoftIron), Assumed { soft_iron: true, ..nothing });
        assert_eq!(said(Quantity::Mounting), Assumed { mounting: true, ..nothing });
        assert_eq!(said(Quantity::HardIron), Assumed { hard_iron: true, ..nothing });
        assert_eq!(said(Quantity::Inclination), nothing);
    }
}
