//! Advice: what is weakest in a calibration, and which manoeuvre would mend it.
//!
//! Each manoeuvre is flown on paper: what its samples would say is added to what the real ones said, and the expected
//! error computed anew. The one that leaves the least is advised.

use core::f32::consts::TAU;
use core::fmt;

use super::expected_error::{self, Deviation, Envelope};
use super::information::{Consider, Information};
use super::likelihood::{Likelihood, Parameters, Quantity, Vector13};
use super::uncertainty::Covariance;
use super::{Calibration, Side};
use crate::frames::Attitude;

/// Something to fly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Manoeuvre {
    /// A full circle to a side at so many degrees of bank.
    Circle(Side, u8),
    /// A full circle without bank, or straight legs at eight headings.
    Level,
}

impl Manoeuvre {
    /// What is tried: cheap first, so that of equals the cheaper wins.
    const ALL: [Self; 7] = [
        Self::Circle(Side::Left, 25),
        Self::Circle(Side::Right, 25),
        Self::Circle(Side::Left, 40),
        Self::Circle(Side::Right, 40),
        Self::Circle(Side::Left, 15),
        Self::Circle(Side::Right, 15),
        Self::Level,
    ];

    fn roll_deg(self) -> f32 {
        match self {
            Self::Circle(Side::Left, bank_deg) => -f32::from(bank_deg),
            Self::Circle(Side::Right, bank_deg) => f32::from(bank_deg),
            Self::Level => 0.0,
        }
    }
}

/// In words.
impl fmt::Display for Manoeuvre {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Circle(side, bank_deg) => write!(f, "a {} circle at {bank_deg} deg of bank", side.name()),
            Self::Level => f.write_str("a level circle, or straight legs at eight headings"),
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
}

/// What is left of an error that has become noticeably smaller.
const NOTICEABLE: f32 = 0.95;

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

/// Samples of a circle on paper: what the collection keeps of one at 13 deg/s, less their correlation.
const SAMPLES: u8 = 24;

/// Looks for the manoeuvre that would help most. `None` when nothing could be computed.
#[inline(never)]
pub(super) fn advise(
    information: &Information,
    likelihood: &Likelihood,
    unknowns: &Vector13,
    consider: Consider,
    calibration: &Calibration,
    envelope: Envelope,
) -> Option<Advice> {
    let covariance = |information: &Information| {
        let mut covariance = Covariance::EXACT;
        information.covariance(likelihood, unknowns, consider, &mut covariance).map(|()| covariance)
    };
    let now = expected_error::expected(calibration, &covariance(information)?, envelope)?;
    let parameters = Parameters::new(unknowns);
    let (manoeuvre, with_it_deg) = Manoeuvre::ALL
        .into_iter()
        .filter_map(|manoeuvre| {
            let mut supposed = information.clone();
            let attitude = Attitude::from_deg(manoeuvre.roll_deg(), 0.0);
            for heading_rad in headings_rad() {
                supposed.suppose(likelihood, &parameters, attitude, heading_rad);
            }
            let rms_deg = expected_error::expected_rms_deg(calibration, &covariance(&supposed)?, envelope)?;
            Some((manoeuvre, rms_deg))
        })
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(Advice {
        weakest: now.weakest.0,
        weakest_deg: now.weakest.1,
        expected_deg: now.rms_deg,
        manoeuvre,
        with_it_deg,
        assumed: assumed(information.left_to_priors(likelihood, unknowns).into_iter().flatten()),
    })
}

/// Headings of a circle on paper, evenly round it, radians.
fn headings_rad() -> impl Iterator<Item = f32> {
    (0..SAMPLES).map(|i| f32::from(i) * (TAU / f32::from(SAMPLES)))
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

    #[test]
    fn manoeuvres_have_words_and_banks() {
        let said = |manoeuvre: Manoeuvre| (manoeuvre.to_string(), manoeuvre.roll_deg());
        assert_eq!(said(Manoeuvre::Circle(Side::Left, 25)), ("a left circle at 25 deg of bank".into(), -25.0));
        assert_eq!(said(Manoeuvre::Circle(Side::Right, 40)), ("a right circle at 40 deg of bank".into(), 40.0));
        assert_eq!(said(Manoeuvre::Level), ("a level circle, or straight legs at eight headings".into(), 0.0));
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
        let headings: Vec<f32> = headings_rad().collect();
        assert_eq!((headings.len(), headings[0].to_bits()), (24, 0));
        assert!(headings.windows(2).all(|pair| (pair[1] - pair[0] - TAU / 24.0).abs() < 1e-5));
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
