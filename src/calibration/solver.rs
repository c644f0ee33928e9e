//! From samples to a calibration, by any method, in steps.

use nalgebra::Matrix3;

use super::advice::{self, Advice};
use super::expected_error::{self, Envelope};
use super::information::{self, Consider, Information};
use super::likelihood::{Config, Likelihood, Prior};
use super::maximum_likelihood::{Progress as Refining, Refinement};
use super::response::{self, Response, Start};
use super::turns::{MIN_SAMPLES, progress_rad};
use super::uncertainty::{Covariance, Uncertainty};
use super::{Axis, Calibration, Method, Orientation, Part, Quality, Sample, Samples, Side, SolveError};
use super::{compass_swing, ellipsoid, four_ellipse, level, two_plane};
use crate::frames::Attitude;

/// What came out.
#[derive(Clone, Copy, Debug)]
pub struct Solution {
    /// The coefficients.
    pub calibration: Calibration,
    /// How good they are expected to be.
    pub quality: Quality,
    /// How wrong a heading may be.
    pub uncertainty: Uncertainty,
    /// What would make them better.
    pub advice: Option<Advice>,
}

/// How far a solver is.
#[expect(clippy::large_enum_variant, reason = "there is one of it, and no heap to put it on")]
#[derive(Debug)]
pub enum Progress {
    /// Call [`Solver::step`] again.
    Continue,
    /// It has ended.
    Finished(Result<Solution, SolveError>),
}

/// A solve under way. Each [`step`](Self::step) is one pass over the samples. About 1.5 KB.
#[derive(Debug)]
pub struct Solver {
    method: Method,
    prior: Prior,
    consider: Consider,
    refinement: Refinement,
    /// Whether it began, or begins again, with the sphere, the last of the starts.
    from_sphere: bool,
}

/// A field of more than this, microtesla, is no measurement: ten thousand times the Earth's.
const MAX_FIELD_UT: f32 = 1e6;

/// Of an axis' range in turns, what counts as its end.
const END_OF_RANGE: f32 = 0.01;

/// An axis is stuck when more than one of so many samples lie at one end of its range.
const KEEPS_TO: usize = 5;

/// Headings must not run against the turns by more than this, radians: half a circle, which no noise imitates.
const AGAINST_RAD: f32 = -3.0;

impl Solver {
    /// Begins to solve. The samples must stay the same until it has ended.
    ///
    /// # Errors
    ///
    /// Samples that the method cannot begin with: too few ([`SolveError::TooFewSamples`]), at too few headings
    /// ([`SolveError::TooFewHeadings`]), not numbers ([`SolveError::NotFinite`]), of an axis that does not move
    /// ([`SolveError::AxisStuck`]), or not what the method's closed form asks for ([`SolveError::NotAnEllipse`],
    /// [`SolveError::NotDetermined`], [`SolveError::SamePlane`], [`SolveError::NotConverged`]).
    pub fn new(method: Method, samples: Samples<'_>, prior: &Prior) -> Result<Self, SolveError> {
        Self::with_consider(method, samples, prior, Consider::DEFAULT)
    }

    /// As [`new`](Self::new), with other assumptions about the attitude source.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn with_consider(
        method: Method,
        samples: Samples<'_>,
        prior: &Prior,
        consider: Consider,
    ) -> Result<Self, SolveError> {
        check(method, samples)?;
        let rotation = prior.mount.body_from_sensor();
        let closed_form = match closed_form(method, samples, &rotation, prior.inclination_rad) {
            Ok(response) => response.start(),
            // These can do without: they begin with the sphere.
            Err(_) if matches!(method, Method::MaximumLikelihood | Method::Ellipsoid) => None,
            Err(error) => return Err(error),
        };
        if closed_form.is_none() && !method.is_refined() {
            return Err(SolveError::NotConverged);
        }
        let from_sphere = closed_form.is_none();
        let start = closed_form.or_else(|| response::sphere(samples, &rotation)).ok_or(SolveError::NotConverged)?;
        Ok(Self { method, prior: *prior, consider, refinement: begin(method, prior, samples, &start)?, from_sphere })
    }

    /// One pass over the samples, or the end. Not inlined, nor are the large parts of it, whose values would all lie on
    /// a small stack at once.
    #[inline(never)]
    pub fn step(&mut self, samples: Samples<'_>) -> Progress {
        let end = match self.refinement.step(samples) {
            Refining::Continue => return Progress::Continue,
            Refining::Settled => self.finish(samples),
            Refining::Failed => Err(SolveError::NotConverged),
        };
        match end {
            Err(SolveError::NotConverged) if self.begin_again(samples) => Progress::Continue,
            end => Progress::Finished(end),
        }
    }

    /// Solves to the end.
    ///
    /// # Errors
    ///
    /// When no coefficients explain the samples ([`SolveError::NotConverged`]), when the samples leave them open
    /// ([`SolveError::NotDetermined`]), or when those that do explain them cannot be right
    /// ([`SolveError::TurnsReversed`], [`SolveError::MountContradicted`]).
    pub fn run(mut self, samples: Samples<'_>) -> Result<Solution, SolveError> {
        // Ends, because a refinement takes a bounded number of steps, and there are at most two.
        loop {
            if let Progress::Finished(end) = self.step(samples) {
                return end;
            }
        }
    }

    /// What a bad start led astray may be found from another; false if there is none left.
    #[inline(never)]
    fn begin_again(&mut self, samples: Samples<'_>) -> bool {
        if self.from_sphere || self.method != Method::MaximumLikelihood {
            return false;
        }
        self.from_sphere = true;
        let start = response::sphere(samples, &self.prior.mount.body_from_sensor());
        let again = start.and_then(|start| begin(self.method, &self.prior, samples, &start).ok());
        match again {
            Some(refinement) => {
                self.refinement = refinement;
                true
            }
            None => false,
        }
    }

    /// Checks what was found, puts it into the module's units, and judges it.
    #[inline(never)]
    fn finish(&self, samples: Samples<'_>) -> Result<Solution, SolveError> {
        let unknowns = &self.refinement.unknowns;
        // What was only taken for known while refining is not known.
        let likelihood =
            &Likelihood { known_inclination_rad: self.prior.inclination_rad, ..self.refinement.likelihood.clone() };
        if !likelihood.explains() {
            return Err(SolveError::NotConverged);
        }
        let calibration = likelihood.calibration(unknowns)?;
        self.plausible(samples, &calibration)?;
        let mut information = Information::of_priors(likelihood, unknowns);
        information.add_samples(likelihood, samples, unknowns);
        if self.method == Method::Ellipsoid
            && !ellipsoid::is_determined(samples, &calibration, &information, likelihood, unknowns)
        {
            return Err(SolveError::NotDetermined(Part::All));
        }
        let envelope = Envelope::of(self.method, samples);
        let mut covariance = Covariance::EXACT;
        information.covariance(likelihood, unknowns, self.consider, &mut covariance).ok_or(SolveError::NotConverged)?;
        let uncertainty =
            information::uncertainty(likelihood, unknowns, &covariance).ok_or(SolveError::NotConverged)?;
        let expected = expected_error::expected(&calibration, &covariance, envelope).ok_or(SolveError::NotConverged)?;
        let quality = Quality {
            method: self.method,
            envelope,
            expected_rms_deg: expected.rms_deg,
            expected_worst_deg: expected.worst_deg,
            norm_residual: likelihood.noise.norm,
            dip_residual_deg: likelihood.noise.dip_rad.to_degrees(),
            samples: information.system.samples,
        };
        let advice = advice::advise(&information, likelihood, unknowns, &calibration, envelope, self.consider);
        Ok(Solution { calibration, quality, uncertainty, advice })
    }

    /// Headings must run with the turns, and the mounting must be the configured one.
    #[inline(never)]
    fn plausible(&self, samples: Samples<'_>, calibration: &Calibration) -> Result<(), SolveError> {
        let heading = |s: &Sample| s.attitude.level(calibration.apply(s.field)).heading_rad();
        let progress = [(Side::Left, samples.left), (Side::Right, samples.right)]
            .map(|(side, samples)| progress_rad(samples, side, heading));
        if self.method != Method::Ellipsoid && progress.iter().sum::<f32>() < AGAINST_RAD {
            return Err(SolveError::TurnsReversed);
        }
        let found = Orientation::nearest(&calibration.w_matrix());
        if found != self.prior.mount {
            return Err(SolveError::MountContradicted { found });
        }
        Ok(())
    }
}

/// Solves samples by a method, from the first check to the last judgement. On a device that has other things to do
/// meanwhile, a [`Solver`] does the same in steps.
///
/// # Errors
///
/// All that [`Solver::new`] and [`Solver::run`] refuse.
pub fn solve(method: Method, samples: Samples<'_>, prior: &Prior) -> Result<Solution, SolveError> {
    Solver::new(method, samples, prior)?.run(samples)
}

/// What the method's closed form makes of samples whose fields are rotated by `rotation` first.
fn closed_form(
    method: Method,
    samples: Samples<'_>,
    rotation: &Matrix3<f32>,
    inclination_rad: Option<f32>,
) -> Result<Response, SolveError> {
    match method {
        Method::Level => level::solve(samples, rotation),
        Method::FourEllipse => four_ellipse::solve(samples, rotation, inclination_rad),
        Method::TwoPlane | Method::MaximumLikelihood => two_plane::solve(samples, rotation),
        Method::CompassSwing => compass_swing::solve(samples.marks, rotation, inclination_rad),
        Method::Ellipsoid => Err(SolveError::NotDetermined(Part::All)),
    }
}

/// A refinement, or only an estimate of the noise, from a start.
fn begin(method: Method, prior: &Prior, samples: Samples<'_>, start: &Start) -> Result<Refinement, SolveError> {
    let config = match method {
        Method::Level => Config::ALIGNED,
        Method::Ellipsoid => Config::NO_ATTITUDE,
        Method::FourEllipse | Method::TwoPlane | Method::MaximumLikelihood | Method::CompassSwing => Config::DEFAULT,
    };
    let mut likelihood = Likelihood::new(prior, config, samples, start.unit_ut);
    if method == Method::CompassSwing && Envelope::of(method, samples) == Envelope::Level {
        // On level ground the vertical stays open; while the rest is refined, it is what the start took it for.
        likelihood.known_inclination_rad = Some(start.inclination_rad);
    }
    let unknowns = likelihood.unknowns(start).ok_or(SolveError::NotConverged)?;
    Ok(Refinement::new(likelihood, samples, unknowns, method.is_refined()))
}

/// Whether the samples can be worked with at all.
fn check(method: Method, samples: Samples<'_>) -> Result<(), SolveError> {
    let part = if method == Method::Level { Part::Level } else { Part::All };
    let need = if samples.marks.is_empty() { MIN_SAMPLES } else { 1 };
    SolveError::require(part, samples.all().count(), need)?;
    let headings = samples.marks.iter().all(|mark| mark.heading_rad.is_finite());
    if !(headings && samples.all().all(is_finite)) {
        return Err(SolveError::NotFinite);
    }
    stuck_axis(samples).map_or(Ok(()), |axis| Err(SolveError::AxisStuck { axis }))
}

/// Whether a sample is made of numbers, and of such that their fourth powers are still numbers.
fn is_finite(sample: &Sample) -> bool {
    let Attitude { roll_rad, pitch_rad } = sample.attitude;
    sample.field.ut.iter().all(|ut| ut.abs() < MAX_FIELD_UT) && roll_rad.is_finite() && pitch_rad.is_finite()
}

/// The axis that keeps to one end of its range in turns: it is saturated or frozen. A field that turns through a circle
/// is within a hundredth of either end for one sample in sixteen.
fn stuck_axis(samples: Samples<'_>) -> Option<Axis> {
    let turns = || samples.left.iter().chain(samples.right);
    let number = turns().count();
    [Axis::X, Axis::Y, Axis::Z].into_iter().find(|&axis| {
        let values = || turns().map(|s| s.field.ut[axis as usize]);
        let (low, high) = values().fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)));
        let near = END_OF_RANGE * (high - low);
        let keeps_to = |end: f32| values().filter(|v| (v - end).abs() <= near).count() * KEEPS_TO > number;
        number >= MIN_SAMPLES && (keeps_to(low) || keeps_to(high))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Mark;
    use crate::frames::Field;
    use crate::time::WrappingMillis;

    /// Fields that run up and down all three axes.
    fn varied(number: u8) -> Vec<Sample> {
        let field = |i: u8| Field::from_ut(f32::from(i), 100.0 - f32::from(i), 3.0 * f32::from(i % 10));
        let sample = |i| Sample { field: field(i), attitude: Attitude::default(), time: WrappingMillis::default() };
        (0..number).map(sample).collect()
    }

    /// Of sixty samples so many have this in an axis, and the others run from 10 to 50.
    fn stuck(axis: usize, number: usize, value_ut: f32) -> Option<Axis> {
        let mut samples = varied(60);
        for (i, sample) in samples.iter_mut().enumerate() {
            let running_ut = 10.0 + 40.0 * (i - i.min(number)) as f32 / (59 - number) as f32;
            sample.field.ut[axis] = if i < number { value_ut } else { running_ut };
        }
        let (left, right) = samples.split_at(30);
        stuck_axis(Samples { left, right, ..Samples::default() })
    }

    /// A fifth of sixty is twelve. Of the running samples, 0.85 uT or more apart, one lies at each end of the range.
    #[test]
    fn an_axis_is_stuck_when_more_than_a_fifth_lies_at_one_end() {
        for (index, axis) in [Axis::X, Axis::Y, Axis::Z].into_iter().enumerate() {
            for end_ut in [50.0, 10.0] {
                assert_eq!(stuck(index, 11, end_ut), None, "{axis:?} {end_ut}");
                assert_eq!(stuck(index, 12, end_ut), Some(axis), "{axis:?} {end_ut}");
                // Either end by itself: a field that runs to both is a turn.
                assert_eq!(stuck(index, 20, 30.0), None, "{axis:?} in the middle");
            }
            // The end is a hundredth of the range: 0.4 uT.
            for (near_ut, far_ut) in [(49.65, 49.55), (10.35, 10.45)] {
                assert_eq!(stuck(index, 15, near_ut), Some(axis), "{axis:?} {near_ut}");
                assert_eq!(stuck(index, 15, far_ut), None, "{axis:?} {far_ut}");
            }
        }
    }

    /// A few samples of turns are at one end by chance; level flight on one heading does not move any axis.
    #[test]
    fn only_turns_show_that_an_axis_is_stuck() {
        let still = vec![varied(1)[0]; 40];
        assert_eq!(stuck_axis(Samples { level: &still, ..Samples::default() }), None);
        assert_eq!(stuck_axis(Samples { left: &still[..11], ..Samples::default() }), None);
        assert_eq!(stuck_axis(Samples { left: &still[..6], right: &still[..6], ..Samples::default() }), Some(Axis::X));
    }

    #[test]
    fn twelve_samples_are_looked_at_or_a_single_mark() {
        let samples = varied(12);
        let missing = |part, have, need| Err(SolveError::TooFewSamples { part, have, need });
        let of = |level| Samples { level, ..Samples::default() };
        assert_eq!(check(Method::MaximumLikelihood, of(&samples)), Ok(()));
        assert_eq!(check(Method::MaximumLikelihood, of(&samples[..11])), missing(Part::All, 11, 12));
        assert_eq!(check(Method::Level, of(&samples[..11])), missing(Part::Level, 11, 12));
        assert_eq!(check(Method::CompassSwing, of(&[])), missing(Part::All, 0, 12));
        let mark = [Mark { sample: samples[0], heading_rad: 1.0 }];
        assert_eq!(check(Method::CompassSwing, Samples { marks: &mark, ..Samples::default() }), Ok(()));
    }

    /// Fields of a tesla and more, attitudes and headings that are not numbers, wherever they are; before an axis is
    /// called stuck because all others lie at one end.
    #[test]
    fn what_is_not_finite_is_named_as_that() {
        type Change = fn(&mut Sample);
        let refused: [Change; 7] = [
            |s| s.field.ut.x = 1.1e6,
            |s| s.field.ut.y = -1.1e6,
            |s| s.field.ut.z = f32::INFINITY,
            |s| s.field.ut.z = f32::NAN,
            |s| s.attitude.roll_rad = f32::NAN,
            |s| s.attitude.pitch_rad = f32::INFINITY,
            |s| s.attitude.pitch_rad = f32::NAN,
        ];
        for change in refused {
            let good = varied(20);
            let mut bad = good.clone();
            change(&mut bad[7]);
            let marks = [Mark { sample: bad[7], heading_rad: 0.0 }];
            for samples in [
                Samples { left: &bad, right: &good, ..Samples::default() },
                Samples { left: &good, right: &bad, ..Samples::default() },
                Samples { level: &bad, ..Samples::default() },
                Samples { marks: &marks, ..Samples::default() },
            ] {
                assert_eq!(check(Method::MaximumLikelihood, samples), Err(SolveError::NotFinite), "{:?}", bad[7]);
            }
        }
        let mut large = varied(20);
        large[3].field.ut.x = -0.9e6;
        assert_eq!(check(Method::Level, Samples { level: &large, ..Samples::default() }), Ok(()));
        let marks = [Mark { sample: varied(1)[0], heading_rad: f32::NAN }];
        let nowhere = check(Method::CompassSwing, Samples { marks: &marks, ..Samples::default() });
        assert_eq!(nowhere, Err(SolveError::NotFinite));
    }
}
