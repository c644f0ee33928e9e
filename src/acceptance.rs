//! Acceptance: whether a candidate may replace the calibration in use. One pure function, asked by the device, by
//! replayed flights and by accuracy studies alike.
//!
//! In this order, the first that applies:
//!
//! | rejected as | because |
//! |---|---|
//! | `too-few-held-back` | nothing could be verified |
//! | `iron-changed` | its samples are of two airframes: the iron changed, and that outweighs all other errors |
//! | `attitude-contradicted` | the attitude source misreads bank, for which its expected heading error is of no use |
//! | `not-accurate` | its expected heading error is of no use |
//! | `not-better` | on held-back samples it does no better than what is in use |
//! | `thinner` | its samples show less than those behind the one in use, which they do not contradict |

use core::fmt;

use crate::calibration::verification::{self, Scores};
use crate::calibration::{BankError, Calibration, Doubt, IronChange, Orientation, Quality, Samples, Solution};
use crate::wire::decimal::Decimal;

/// Fixed numbers of the judgement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Policy {
    /// A calibration expected to be worse than this is rejected, degrees RMS: an uncalibrated compass in a clean
    /// airframe is about as good.
    pub max_expected_rms_deg: f32,
    /// A change of the iron that makes an error of more than so many times all others is not allowed for, but refused.
    pub max_iron_share: f32,
    /// An error of the attitude source is certain at so many of its sigmas.
    pub certain_sigmas: f32,
    /// Held-back samples needed of each part that was used: one for every sector but a few.
    pub min_held_back: u16,
    /// A candidate expected to be worse than the calibration in use by more than this factor is thinner.
    pub thinner_by: f32,
    /// A thinner candidate is only taken when it explains the held-back samples this many times better: then the
    /// airframe's iron has changed, and the calibration in use is wrong whatever it was expected to be.
    pub contradicted_by: f32,
}

impl Policy {
    /// Numbers for every vehicle.
    pub const DEFAULT: Self = Self {
        max_expected_rms_deg: 3.0,
        max_iron_share: 2.5,
        certain_sigmas: 3.5,
        min_held_back: 8,
        thinner_by: 1.5,
        contradicted_by: 3.0,
    };
}

/// What is judged on.
#[derive(Clone, Copy, Debug)]
pub struct Grounds<'a> {
    /// The samples that the candidate was fitted to.
    pub fitted: Samples<'a>,
    /// Samples of the same parts that it was not fitted to.
    pub held_back: Samples<'a>,
    /// Whether the samples' attitudes are known.
    pub knows_attitude: bool,
}

/// What a candidate would replace.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Incumbent {
    /// The calibration in use; without one, the mounting alone ([`Calibration::uncalibrated`]).
    pub calibration: Calibration,
    /// How good it is expected to be; none without a calibration in use.
    pub quality: Option<Quality>,
}

impl Incumbent {
    /// Of a module without a calibration: the mounting alone.
    #[must_use]
    pub fn none(mount: Orientation) -> Self {
        Self { calibration: Calibration::uncalibrated(mount), quality: None }
    }

    /// A calibration in use.
    #[must_use]
    pub const fn in_use(calibration: Calibration, quality: Quality) -> Self {
        Self { calibration, quality: Some(quality) }
    }
}

/// Why a candidate may not replace the calibration in use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rejection {
    /// Too few samples of a part were held back to verify with.
    TooFewHeldBack {
        /// How many there are, of the part with the fewest.
        have: u16,
        /// How many it takes.
        need: u16,
    },
    /// The iron changed while the samples were taken.
    IronChanged(IronChange),
    /// The attitude source reads more or less bank than there is.
    AttitudeContradicted {
        /// How much of the bank it reads; one is right.
        read: f32,
        /// Expected heading error, degrees RMS.
        expected_rms_deg: f32,
    },
    /// Solved, but not accurate enough to be of use.
    NotAccurate {
        /// Expected heading error, degrees RMS.
        expected_rms_deg: f32,
    },
    /// On held-back samples it is no better than the one in use.
    NotBetter {
        /// Score of the new one, smaller is better.
        candidate: f32,
        /// Score of the one in use.
        incumbent: f32,
    },
    /// The samples determine less than those of the calibration in use did, and do not contradict it.
    Thinner {
        /// Expected heading error, degrees RMS.
        expected_rms_deg: f32,
        /// That of the calibration in use.
        incumbent_rms_deg: f32,
    },
}

/// Judges a candidate; its scores on the held-back samples if it may replace the incumbent.
///
/// # Errors
///
/// The first [`Rejection`] that applies, in the order of their declaration.
pub fn judge(
    policy: &Policy,
    candidate: &Solution,
    grounds: Grounds<'_>,
    incumbent: &Incumbent,
) -> Result<Scores, Rejection> {
    enough_held_back(policy, &grounds)?;
    of_one_airframe(policy, candidate)?;
    accurate_enough(policy, candidate)?;
    let scores = better(candidate, &grounds, incumbent)?;
    if let Some(quality) = &incumbent.quality {
        not_thinner(policy, &candidate.quality, quality, scores)?;
    }
    Ok(scores)
}

fn enough_held_back(policy: &Policy, grounds: &Grounds<'_>) -> Result<(), Rejection> {
    let (have, need) = (fewest_held_back(grounds), policy.min_held_back);
    if have < need { Err(Rejection::TooFewHeldBack { have, need }) } else { Ok(()) }
}

/// How many samples were held back of the part with the fewest, of those that were fitted to. Marks have none of their
/// own: what was seen between them is held back.
fn fewest_held_back(grounds: &Grounds<'_>) -> u16 {
    let Grounds { fitted, held_back, .. } = grounds;
    [
        (fitted.left.len(), held_back.left.len()),
        (fitted.right.len(), held_back.right.len()),
        (fitted.level.len(), held_back.level.len()),
        (fitted.number_of_any(), held_back.number_of_any()),
    ]
    .iter()
    .filter(|(fitted, _)| *fitted > 0)
    .map(|&(_, held_back)| u16::try_from(held_back).unwrap_or(u16::MAX))
    .min()
    .unwrap_or(0)
}

/// A small change of the iron is allowed for in what is expected; one that outweighs all other errors, or is in a
/// result of no use, is for the pilot to mend. What is expected without it is no excuse: the misfit is in that, too.
fn of_one_airframe(policy: &Policy, candidate: &Solution) -> Result<(), Rejection> {
    let Some(Doubt { of: change, error_deg, without_deg }) = candidate.iron else { return Ok(()) };
    let outweighs = error_deg > policy.max_iron_share * without_deg;
    if outweighs || accurate_enough(policy, candidate).is_err() {
        return Err(Rejection::IronChanged(change));
    }
    Ok(())
}

/// Whether its expected error is of use. A wrong bank is allowed for in that; one that makes it useless is the reason,
/// if it is certain, and counts for nothing here, if it is only suspected: of good sources some look bad by chance.
fn accurate_enough(policy: &Policy, candidate: &Solution) -> Result<(), Rejection> {
    let expected_rms_deg = candidate.quality.expected_rms_deg;
    match (accurate(policy, expected_rms_deg), &candidate.bank) {
        (Err(_), Some(Doubt { of: BankError { read, sigmas }, without_deg, .. })) => {
            accurate(policy, *without_deg)?;
            if *sigmas > policy.certain_sigmas {
                return Err(Rejection::AttitudeContradicted { read: *read, expected_rms_deg });
            }
            Ok(())
        }
        (judgement, _) => judgement,
    }
}

fn accurate(policy: &Policy, expected_rms_deg: f32) -> Result<(), Rejection> {
    // What is not a number is not accurate either.
    if expected_rms_deg <= policy.max_expected_rms_deg {
        Ok(())
    } else {
        Err(Rejection::NotAccurate { expected_rms_deg })
    }
}

fn better(candidate: &Solution, grounds: &Grounds<'_>, incumbent: &Incumbent) -> Result<Scores, Rejection> {
    let scores =
        verification::verify(grounds.held_back, grounds.knows_attitude, &candidate.calibration, &incumbent.calibration);
    if scores.candidate < scores.incumbent {
        Ok(scores)
    } else {
        Err(Rejection::NotBetter { candidate: scores.candidate, incumbent: scores.incumbent })
    }
}

/// Thin data never make the heading worse than the calibration in use: held-back samples of a thin flight show no more
/// than those it was fitted to.
fn not_thinner(policy: &Policy, new: &Quality, old: &Quality, scores: Scores) -> Result<(), Rejection> {
    let thinner = new.expected_rms_deg > policy.thinner_by * old.expected_rms_deg
        || (old.is_of_everything() && !new.is_of_everything());
    let contradicted = scores.incumbent > policy.contradicted_by * scores.candidate;
    if thinner && !contradicted {
        let (expected_rms_deg, incumbent_rms_deg) = (new.expected_rms_deg, old.expected_rms_deg);
        return Err(Rejection::Thinner { expected_rms_deg, incumbent_rms_deg });
    }
    Ok(())
}

impl Rejection {
    /// Stable code, kebab-case.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::TooFewHeldBack { .. } => "too-few-held-back",
            Self::IronChanged(_) => "iron-changed",
            Self::AttitudeContradicted { .. } => "attitude-contradicted",
            Self::NotAccurate { .. } => "not-accurate",
            Self::NotBetter { .. } => "not-better",
            Self::Thinner { .. } => "thinner",
        }
    }
}

/// What to do about it, in words.
impl fmt::Display for Rejection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::TooFewHeldBack { have, need } => {
                write!(f, "{have} of {need} samples to verify with on the thinner side; fly longer turns each way")
            }
            Self::IronChanged(change) => change.fmt(f),
            Self::AttitudeContradicted { read, expected_rms_deg } => {
                let (percent, expected) = (Decimal::<0>(100.0 * read), Decimal::<1>(expected_rms_deg));
                write!(f, "the attitude source seems to read {percent} % of the bank, which costs {expected} deg")?;
                f.write_str("; calibrate it and fly again")
            }
            Self::NotAccurate { expected_rms_deg } => {
                let expected = Decimal::<1>(expected_rms_deg);
                write!(f, "expected error {expected} deg; cal advise tells what to fly")
            }
            Self::NotBetter { candidate, incumbent } => {
                let (candidate, incumbent) = (Decimal::<2>(candidate), Decimal::<2>(incumbent));
                write!(f, "score {candidate} against {incumbent} of the one in use, which stays")
            }
            Self::Thinner { expected_rms_deg, incumbent_rms_deg } => {
                let (new, old) = (Decimal::<1>(expected_rms_deg), Decimal::<1>(incumbent_rms_deg));
                write!(f, "expected error {new} deg, {old} deg of the one in use, which stays; see cal advise")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::{Course, Envelope, Method, Rates, Sample, Uncertainty};
    use crate::frames::{Attitude, Field};
    use crate::time::WrappingMillis;

    const POLICY: Policy = Policy::DEFAULT;

    fn quality(expected_rms_deg: f32) -> Quality {
        Quality {
            method: Method::MaximumLikelihood,
            envelope: Envelope::Banked,
            expected_rms_deg,
            expected_worst_deg: 2.0 * expected_rms_deg,
            norm_residual: 0.004,
            dip_residual_deg: 0.4,
            samples: 300,
            latency: None,
        }
    }

    /// A calibration that is wrong by so much hard iron along x.
    fn wrong_by(b_ut: f32) -> Calibration {
        Calibration {
            b_ut: [b_ut, 0.0, 0.0],
            inclination_rad: 1.0,
            total_ut: 50.0,
            ..Calibration::uncalibrated(Orientation::NONE)
        }
    }

    fn candidate(b_ut: f32, quality: Quality) -> Solution {
        Solution {
            calibration: wrong_by(b_ut),
            quality,
            uncertainty: Uncertainty::NONE,
            advice: None,
            iron: None,
            bank: None,
        }
    }

    fn in_use(b_ut: f32, expected_rms_deg: f32) -> Incumbent {
        Incumbent { calibration: wrong_by(b_ut), quality: Some(quality(expected_rms_deg)) }
    }

    const NOT_CALIBRATED: Incumbent = Incumbent {
        calibration: Calibration {
            w: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            b_ut: [9.0, 0.0, 0.0],
            inclination_rad: 0.0,
            total_ut: 0.0,
            latency_s: 0.0,
            current: crate::calibration::CurrentIron::NONE,
        },
        quality: None,
    };

    /// What a sensor without iron sees on a circle at this bank. A calibration wrong by b changes the total field by
    /// up to b cos(dip) / F, so that scores are proportional to b.
    fn circle(roll_deg: f32, samples: u16) -> Vec<Sample> {
        (0..samples)
            .map(|i| {
                let attitude = Attitude::from_deg(roll_deg, 0.0);
                let heading_rad = f32::from(i) / f32::from(samples) * core::f32::consts::TAU;
                let field = Field::new(attitude.body(Field::earth(50.0, 1.0, heading_rad)).ut);
                Sample { field, attitude, time: WrappingMillis::new(u32::from(i) * 400), rates: Rates::NONE }
            })
            .collect()
    }

    /// Judges with so many samples of left turns, right turns and level flight held back; of each part some were
    /// fitted.
    fn judged(held_back: [u16; 3], candidate: &Solution, incumbent: &Incumbent) -> Result<Scores, Rejection> {
        let fitted = [-25.0, 25.0, 0.0].map(|roll_deg| circle(roll_deg, 24));
        let [l, r, v] = [(-25.0, held_back[0]), (25.0, held_back[1]), (0.0, held_back[2])]
            .map(|(roll_deg, samples)| circle(roll_deg, samples));
        let level_used = held_back[2] > 0;
        let grounds = Grounds {
            fitted: Samples {
                left: &fitted[0],
                right: &fitted[1],
                level: if level_used { &fitted[2] } else { &[] },
                ..Samples::default()
            },
            held_back: Samples { left: &l, right: &r, level: &v, ..Samples::default() },
            knows_attitude: true,
        };
        judge(&POLICY, candidate, grounds, incumbent)
    }

    const ENOUGH: [u16; 3] = [24, 24, 0];

    #[test]
    fn a_good_candidate_replaces_no_calibration_and_a_worse_one() {
        for incumbent in [NOT_CALIBRATED, in_use(2.0, 0.5)] {
            let scores = judged(ENOUGH, &candidate(0.1, quality(0.5)), &incumbent).unwrap();
            assert!(scores.candidate < scores.incumbent, "{scores:?}");
        }
    }

    /// Eight of each part that was fitted to, and it is the part with the fewest that counts.
    #[test]
    fn every_part_needs_its_samples_held_back() {
        let good = candidate(0.1, quality(0.5));
        let rejected = |have| Err(Rejection::TooFewHeldBack { have, need: 8 });
        for (held_back, expected) in [
            ([8, 8, 0], None),
            ([7, 30, 0], Some(7)),
            ([30, 7, 0], Some(7)),
            ([30, 30, 7], Some(7)),
            ([30, 30, 8], None),
            ([0, 30, 0], Some(0)),
        ] {
            let found = judged(held_back, &good, &NOT_CALIBRATED);
            match expected {
                Some(have) => assert_eq!(found, rejected(have), "{held_back:?}"),
                None => assert!(found.is_ok(), "{held_back:?}: {found:?}"),
            }
        }
    }

    /// Marks are fitted to and have nothing of their own held back: without samples of other parts nothing is verified.
    #[test]
    fn nothing_held_back_is_too_few() {
        let grounds = Grounds { fitted: Samples::default(), held_back: Samples::default(), knows_attitude: true };
        let found = judge(&POLICY, &candidate(0.1, quality(0.5)), grounds, &NOT_CALIBRATED);
        assert_eq!(found, Err(Rejection::TooFewHeldBack { have: 0, need: 8 }));
    }

    /// 3 deg RMS; what is not a number is refused, however well it scores.
    #[test]
    fn an_expected_error_beyond_use_is_refused() {
        let of = |expected_rms_deg| judged(ENOUGH, &candidate(0.1, quality(expected_rms_deg)), &NOT_CALIBRATED);
        assert!(of(3.0).is_ok());
        assert_eq!(of(3.01), Err(Rejection::NotAccurate { expected_rms_deg: 3.01 }));
        assert!(matches!(of(f32::NAN), Err(Rejection::NotAccurate { .. })));
        assert!(matches!(of(f32::INFINITY), Err(Rejection::NotAccurate { .. })));
    }

    /// A candidate that expects 0.5 deg but for a change of the iron.
    fn of_two_airframes(error_deg: f32, expected_rms_deg: f32) -> Solution {
        let change = IronChange { ut: 4.2, course: Course::Step { after_s: 31 }, of_s: 230 };
        let iron = Some(Doubt { of: change, error_deg, without_deg: 0.5 });
        Solution { iron, ..candidate(0.1, quality(expected_rms_deg)) }
    }

    /// One that makes up to 2.5 times the error of all else is allowed for in that; none in a result of no use is.
    #[test]
    fn a_change_of_the_iron_is_allowed_for_or_refused() {
        let of = |error_deg, expected_rms_deg| {
            judged(ENOUGH, &of_two_airframes(error_deg, expected_rms_deg), &NOT_CALIBRATED)
        };
        assert!(of(1.24, 1.34).is_ok());
        let Err(refused @ Rejection::IronChanged(change)) = of(1.26, 1.35) else { panic!() };
        assert_eq!((refused.code(), change.of_s), ("iron-changed", 230));
        assert_eq!(refused.to_string(), change.to_string());
        assert!(of(0.1, 2.99).is_ok());
        assert_eq!(of(0.1, 3.01), Err(refused));
        assert_eq!(of(0.1, f32::NAN), Err(refused));
        // What was not verified is not judged.
        let nothing = judged([7, 24, 0], &of_two_airframes(9.0, 9.0), &NOT_CALIBRATED);
        assert_eq!(nothing, Err(Rejection::TooFewHeldBack { have: 7, need: 8 }));
    }

    /// A candidate that expects so much without an error of bank, and so much with it.
    fn misread(sigmas: f32, without_deg: f32, expected_rms_deg: f32) -> Solution {
        let bank = Some(Doubt { of: BankError { read: 0.91, sigmas }, error_deg: 1.0, without_deg });
        Solution { bank, ..candidate(0.1, quality(expected_rms_deg)) }
    }

    /// What is expected with it counts; but of good sources a few look bad by chance, and that is no reason.
    #[test]
    fn a_bank_that_is_misread_is_the_reason_only_if_it_is_certain() {
        let of = |candidate: &Solution| judged(ENOUGH, candidate, &NOT_CALIBRATED);
        for sigmas in [2.0, 3.4, 3.6, 9.0] {
            assert!(of(&misread(sigmas, 0.5, 2.99)).is_ok(), "{sigmas}");
            // With or without, it is of no use.
            let useless = of(&misread(sigmas, 3.01, 3.5));
            assert_eq!(useless, Err(Rejection::NotAccurate { expected_rms_deg: 3.01 }), "{sigmas}");
        }
        assert!(of(&misread(3.4, 2.99, 3.01)).is_ok());
        let refused = of(&misread(3.6, 2.99, 3.01)).unwrap_err();
        assert_eq!(refused, Rejection::AttitudeContradicted { read: 0.91, expected_rms_deg: 3.01 });
        assert_eq!(refused.code(), "attitude-contradicted");
        let words =
            "the attitude source seems to read 91 % of the bank, which costs 3.0 deg; calibrate it and fly again";
        assert_eq!(refused.to_string(), words);
        // Iron that changed is named first, and a suspicion does not make it worse.
        let both = |sigmas| {
            let iron = of_two_airframes(0.1, 3.5).iron;
            of(&Solution { iron, ..misread(sigmas, 0.5, 3.5) })
        };
        assert!(matches!(both(3.6), Err(Rejection::IronChanged(_))) && both(3.4).is_ok());
    }

    /// The held-back samples decide, by however little, and a draw changes nothing.
    #[test]
    fn only_a_better_one_replaces() {
        let of = |b_ut| judged(ENOUGH, &candidate(b_ut, quality(0.5)), &in_use(1.0, 0.5));
        assert!(of(0.99).is_ok());
        for worse in [1.0, 1.01, f32::NAN] {
            let Err(Rejection::NotBetter { candidate, incumbent }) = of(worse) else { panic!("{worse}") };
            assert!(candidate.is_nan() || candidate >= incumbent, "{candidate} {incumbent}");
        }
    }

    /// 1.5 times the expected error of the one in use.
    #[test]
    fn a_thinner_flight_does_not_replace_a_fuller_one() {
        let of = |expected_rms_deg| judged(ENOUGH, &candidate(0.9, quality(expected_rms_deg)), &in_use(1.0, 1.0));
        assert!(of(1.5).is_ok());
        assert_eq!(of(1.51), Err(Rejection::Thinner { expected_rms_deg: 1.51, incumbent_rms_deg: 1.0 }));
        // Without a calibration in use there is nothing fuller.
        assert!(judged(ENOUGH, &candidate(0.9, quality(1.51)), &NOT_CALIBRATED).is_ok());
    }

    /// A calibration that shows only level headings, or not the mounting, is thinner than one of everything whatever it
    /// expects.
    #[test]
    fn one_of_less_does_not_replace_one_of_everything() {
        let level = Quality { envelope: Envelope::Level, ..quality(0.2) };
        let tumbled = Quality { method: Method::Ellipsoid, ..quality(0.2) };
        for less in [level, tumbled] {
            let found = judged(ENOUGH, &candidate(0.9, less), &in_use(1.0, 1.0));
            assert_eq!(found, Err(Rejection::Thinner { expected_rms_deg: 0.2, incumbent_rms_deg: 1.0 }));
            let incumbent = Incumbent { quality: Some(less), ..in_use(1.0, 1.0) };
            assert!(judged(ENOUGH, &candidate(0.9, less), &incumbent).is_ok(), "both are of the same");
            assert!(judged(ENOUGH, &candidate(0.9, quality(0.2)), &incumbent).is_ok(), "this one is of more");
        }
    }

    /// Three times better on the held-back samples: the iron has changed, and the one in use is wrong.
    #[test]
    fn a_thinner_flight_that_contradicts_replaces() {
        let of = |b_ut| judged(ENOUGH, &candidate(b_ut, quality(2.0)), &in_use(3.0, 1.0));
        assert!(matches!(of(1.05), Err(Rejection::Thinner { .. })), "{:?}", of(1.05));
        assert!(of(0.95).is_ok(), "{:?}", of(0.95));
    }

    /// Without attitude the samples' inclinations mean nothing and take no part.
    #[test]
    fn attitude_that_is_not_known_is_not_used() {
        let mut samples = circle(0.0, 24);
        for (i, sample) in samples.iter_mut().enumerate() {
            sample.attitude = Attitude::from_deg(40.0 * (i as f32).sin(), 30.0);
        }
        let score = |knows_attitude| {
            let parts = Samples { left: &samples, ..Samples::default() };
            let grounds = Grounds { fitted: parts, held_back: parts, knows_attitude };
            judge(&POLICY, &candidate(0.1, quality(0.5)), grounds, &NOT_CALIBRATED).map(|scores| scores.candidate)
        };
        assert!(score(false).unwrap() < 1.0, "{:?}", score(false));
        assert!(score(true).is_err() || score(true).unwrap() > 10.0, "{:?}", score(true));
    }

    /// Scripts rely on the codes, people on the words.
    #[test]
    fn rejections_have_codes_and_say_what_to_do() {
        for (rejection, code, words) in [
            (Rejection::TooFewHeldBack { have: 5, need: 8 }, "too-few-held-back", "5 of 8 samples to verify with"),
            (Rejection::NotAccurate { expected_rms_deg: 4.26 }, "not-accurate", "expected error 4.3 deg; cal advise"),
            (Rejection::NotBetter { candidate: 1.5, incumbent: 1.25 }, "not-better", "score 1.50 against 1.25 of"),
            (
                Rejection::Thinner { expected_rms_deg: 2.0, incumbent_rms_deg: 0.5 },
                "thinner",
                "expected error 2.0 deg, 0.5 deg of the one in use, which stays",
            ),
        ] {
            assert_eq!(rejection.code(), code);
            assert!(rejection.to_string().starts_with(words), "{rejection}");
        }
    }
}
