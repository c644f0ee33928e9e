//! From samples to a calibration, by any method, in steps.

use nalgebra::Matrix3;

use super::constancy::Change;
use super::current_iron::Found;
use super::expected_error::Envelope;
use super::information::{Consider, Information};
use super::judgement::{Judgement, Solution};
use super::likelihood::{Config, Likelihood, Noise, Prior, Vector13};
use super::maximum_likelihood::{Progress as Refining, Refinement};
use super::response::{self, Response, Start};
use super::turns::{MIN_SAMPLES, progress_by_rates_rad, progress_rad};
use super::{Axis, Calibration, Latency, Method, Orientation, Part, Quality, Sample, Samples, Side, SolveError};
use super::{compass_swing, ellipsoid, four_ellipse, level, two_plane};
use crate::frames::Attitude;

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
    /// A doubtful result of the first start, while the other is tried.
    kept: Option<Kept>,
    /// An inclination that was told, radians, while it is tried without; and what was wrong with it, if it was more
    /// than useless.
    told: Option<(f32, Option<SolveError>)>,
    /// How often another latency was taken since the start.
    latencies: u8,
    /// The same of what goes with the current.
    currents: u8,
    /// What was wrong with a result that is odd, while the other start is tried.
    odd: Option<SolveError>,
}

/// A result to come back to.
#[derive(Debug)]
struct Kept {
    start: Start,
    misfit: f32,
    /// What was in use.
    assumed: Assumed,
    noise: Noise,
}

/// What samples are looked at with.
#[derive(Clone, Copy, Debug)]
struct Assumed {
    /// By how much their attitudes are too old, seconds.
    latency_s: f32,
    /// What each ampere added to their fields, microtesla, chip axes.
    ut_per_a: [f32; 3],
}

impl Assumed {
    /// That they are as they are.
    const NOTHING: Self = Self { latency_s: 0.0, ut_per_a: [0.0; 3] };
}

/// A field of more than this, microtesla, is no measurement: ten thousand times the Earth's.
const MAX_FIELD_UT: f32 = 1e6;

/// Of an axis' range in turns, what counts as its end.
const END_OF_RANGE: f32 = 0.01;

/// An axis is stuck when more than one of so many samples lie at one end of its range.
const KEEPS_TO: usize = 5;

/// A result that expects a larger heading error than this, degrees RMS, may not be the best that the samples allow.
const DOUBTFUL_RMS_DEG: f32 = 3.0;

/// Nor one with more hard iron, microtesla: six times the Earth's field.
const DOUBTFUL_IRON_UT: f32 = 300.0;

/// An inclination that was told is wrong when the samples show one so many sigmas from it.
const CONTRADICTS: f32 = 4.0;

/// Beyond this inclination, radians, 4 deg from the vertical, is no result but a trap: dips are told there by the floor of
/// [`Prediction`](super::Prediction), which all samples agree on, however little was flown. Of ten minutes straight ahead
/// in 40 to 72 deg, headings were off by 100 deg, and 4 were expected. A compass is of no use there either.
const MAX_INCLINATION_RAD: f32 = 1.5;

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
        let (start, from_sphere) = first_start(method, samples, prior)?;
        let refinement = begin(method, prior, samples, &start, Assumed::NOTHING)?;
        Ok(Self {
            method,
            prior: *prior,
            consider,
            refinement,
            from_sphere,
            kept: None,
            told: None,
            latencies: 0,
            currents: 0,
            odd: None,
        })
    }

    /// One pass over the samples, or the end. Not inlined, nor are the large parts of it, whose values would all lie on
    /// a small stack at once.
    #[inline(never)]
    pub fn step(&mut self, samples: Samples<'_>) -> Progress {
        let end = match self.refinement.step(samples) {
            Refining::Continue => return Progress::Continue,
            Refining::Settled => match self.finish(samples) {
                Some(end) => end,
                None => return Progress::Continue,
            },
            Refining::Failed => Err(SolveError::NotConverged),
        };
        if self.method == Method::MaximumLikelihood
            && (self.tries_other(&end, samples) || self.tries_untold(&end, samples))
        {
            return Progress::Continue;
        }
        // An inclination that is not contradicted is not what was wrong.
        let end = match (end, self.told) {
            (Err(contradicted @ SolveError::InclinationContradicted { .. }), _) => Err(contradicted),
            (_, Some((_, Some(error)))) => Err(error),
            (end, _) => end,
        };
        let end = end.map_err(|error| self.odd.unwrap_or(error));
        Progress::Finished(end)
    }

    /// Solves to the end.
    ///
    /// # Errors
    ///
    /// When no coefficients explain the samples ([`SolveError::NotConverged`]), for which a change of the iron may be
    /// the reason ([`SolveError::IronChanged`]), when the samples leave them open ([`SolveError::NotDetermined`]), or
    /// when those that do explain them cannot be right ([`SolveError::TurnsReversed`],
    /// [`SolveError::InclinationContradicted`], [`SolveError::MountContradicted`]).
    pub fn run(mut self, samples: Samples<'_>) -> Result<Solution, SolveError> {
        // Ends, because a refinement takes a bounded number of steps, and there are at most 54: from two starts and back
        // to the first, with what was told of the inclination and without, each with up to four latencies, and five times
        // what goes with the current.
        loop {
            if let Progress::Finished(end) = self.step(samples) {
                return end;
            }
        }
    }

    /// What a bad start led astray may be found from another, and what looks strange may look better: whether there is
    /// another to try. Of two results the one that fits better is taken, and sought again.
    #[inline(never)]
    fn tries_other(&mut self, end: &Result<Solution, SolveError>, samples: Samples<'_>) -> bool {
        if let Some(Kept { start, misfit, assumed, noise }) = self.kept.take() {
            // Not a number is no better either.
            let is_better = end.as_ref().is_ok_and(|solution| self.misfit(&solution.calibration) < misfit);
            let goes_back = !is_better && self.begin(samples, &start, assumed);
            if goes_back {
                self.refinement.with_noise(samples, noise);
            }
            return goes_back;
        }
        if self.from_sphere {
            return false;
        }
        // From the vertical alone the start is a guess where the field is nearly level.
        self.odd = end.as_ref().err().copied().filter(|error| is_odd(error) && samples.has_any());
        if self.odd.is_none() && !is_doubtful(end) {
            return false;
        }
        let start = response::sphere(samples, &self.prior.mount.body_from_sensor());
        let kept = end.as_ref().ok().and_then(|solution| self.keep(solution));
        self.from_sphere = start.is_some_and(|start| self.begin(samples, &start, Assumed::NOTHING));
        self.kept = kept.filter(|_| self.from_sphere);
        self.from_sphere
    }

    /// Whether it is tried without the inclination that was told.
    #[inline(never)]
    fn tries_untold(&mut self, end: &Result<Solution, SolveError>, samples: Samples<'_>) -> bool {
        let error = match end {
            Ok(solution) if is_accurate(&solution.quality) => return false,
            Ok(_) => None,
            Err(error) => Some(*error),
        };
        let Some(told_rad) = self.prior.inclination_rad.take() else { return false };
        self.told = Some((told_rad, error));
        let Ok((start, from_sphere)) = first_start(self.method, samples, &self.prior) else { return false };
        self.from_sphere = from_sphere;
        self.begin(samples, &start, Assumed::NOTHING)
    }

    /// Begins again, with what had been in use; whether that is possible.
    fn begin(&mut self, samples: Samples<'_>, start: &Start, assumed: Assumed) -> bool {
        let Ok(refinement) = begin(self.method, &self.prior, samples, start, assumed) else { return false };
        self.refinement = refinement;
        self.latencies = u8::from(assumed.latency_s != 0.0);
        self.currents = u8::from(self.refinement.likelihood.current.is_used());
        true
    }

    /// A result as a start.
    fn keep(&self, solution: &Solution) -> Option<Kept> {
        let (likelihood, unknowns) = (&self.refinement.likelihood, &self.refinement.unknowns);
        let misfit = self.misfit(&solution.calibration);
        let assumed = Assumed { latency_s: likelihood.latency_s, ut_per_a: likelihood.current.ut_per_a };
        Some(Kept { start: likelihood.start(unknowns)?, misfit, assumed, noise: likelihood.noise.clone() })
    }

    /// What is less of the more likely of two results: of `N` samples the likelihood is `-N ln` of this, the product of
    /// both residuals' sigmas, and in microtesla, so that a larger field does not look like a better fit.
    fn misfit(&self, calibration: &Calibration) -> f32 {
        let noise = &self.refinement.likelihood.noise;
        noise.norm * calibration.total_ut * noise.dip_rad
    }

    /// Looks at what was found with all that the samples say; `None` where it is to be sought again with another latency.
    #[inline(never)]
    fn finish(&mut self, samples: Samples<'_>) -> Option<Result<Solution, SolveError>> {
        // What was only taken for known while refining is not known.
        let likelihood =
            &Likelihood { known_inclination_rad: self.prior.inclination_rad, ..self.refinement.likelihood.clone() };
        let unknowns = &self.refinement.unknowns.clone();
        let mut calibration = match likelihood.calibration(unknowns) {
            Ok(calibration) => calibration,
            Err(error) => return Some(Err(error)),
        };
        if self.method == Method::MaximumLikelihood && libm::fabsf(calibration.inclination_rad) > MAX_INCLINATION_RAD {
            return Some(Err(SolveError::NotDetermined(Part::All)));
        }
        // What fits worse than what is kept is not taken, whatever else is wrong with it.
        if self.kept.as_ref().is_some_and(|kept| self.misfit(&calibration) >= kept.misfit) {
            return Some(Err(SolveError::NotConverged));
        }
        let mut information = self.information(likelihood, samples);
        let look = Judgement { method: self.method, likelihood, unknowns, calibration: &calibration, samples };
        let change = look.look(&mut information);
        if self.method == Method::MaximumLikelihood
            && let Some(found) = information.current(likelihood)
        {
            if self.takes_current(samples, &information, &found) {
                return None;
            }
            calibration.current.sigma_ut_per_a = found.sigma() * likelihood.unit_ut;
        }
        let judgement = Judgement { method: self.method, likelihood, unknowns, calibration: &calibration, samples };
        let latency = if self.method == Method::MaximumLikelihood {
            let found = information.latency(likelihood.latency_s);
            if self.takes_latency(samples, found.as_ref()) {
                return None;
            }
            found.map(|(latency, _)| latency)
        } else {
            None
        };
        Some(self.judge(&judgement, &mut information, change, latency))
    }

    /// Whether the samples show another latency than they were looked at with, which is taken from now on.
    fn takes_latency(&mut self, samples: Samples<'_>, found: Option<&(Latency, Vector13)>) -> bool {
        let used_s = self.refinement.likelihood.latency_s;
        let Some((latency, follows)) = found else { return false };
        let Some(latency_s) = latency.next(used_s, self.latencies) else { return false };
        self.latencies += 1;
        self.refinement.with_latency(samples, latency_s, &(follows * (latency_s - used_s)));
        true
    }

    /// Whether the samples show that more or less of their fields went with the current than they were looked at with, which
    /// is taken from now on.
    #[inline(never)]
    fn takes_current(&mut self, samples: Samples<'_>, information: &Information, found: &Found) -> bool {
        let likelihood = &self.refinement.likelihood;
        let used = likelihood.k();
        let spread = likelihood.current.spread_a * likelihood.unit_ut;
        let Some(k) = found.next(&used, self.currents, spread) else { return false };
        let more = k - used;
        let Some(follow) = information.following(&more) else { return false };
        self.currents += 1;
        self.refinement.with_current(samples, &more, &follow);
        true
    }

    /// Checks what was found, puts it into the module's units, and judges it.
    #[inline(never)]
    fn judge(
        &self,
        judgement: &Judgement<'_>,
        information: &mut Information,
        change: Option<Change>,
        latency: Option<Latency>,
    ) -> Result<Solution, SolveError> {
        let &Judgement { likelihood, unknowns, calibration, samples, .. } = judgement;
        let sound =
            if likelihood.explains() { self.plausible(samples, calibration) } else { Err(SolveError::NotConverged) };
        // What is wrong for such a reason is not wrong for another.
        sound.map_err(|error| change.as_ref().map_or(error, |change| SolveError::IronChanged(change.iron)))?;
        if self.method == Method::MaximumLikelihood {
            self.contradicted(information, likelihood)?;
        }
        if self.method == Method::Ellipsoid
            && !ellipsoid::is_determined(samples, calibration, information, likelihood, unknowns)
        {
            return Err(SolveError::NotDetermined(Part::All));
        }
        // What is doubtful is tried from another start first.
        let is_asked = |quality: &Quality| {
            self.from_sphere || self.method != Method::MaximumLikelihood || is_good(quality, calibration)
        };
        judgement.pass(information, change, latency, self.consider, is_asked)
    }

    /// What the samples say near the result, as far as their equations say it: what the refinement ended with, unless
    /// that took more for known than is.
    #[inline(never)]
    fn information(&self, likelihood: &Likelihood, samples: Samples<'_>) -> Information {
        if likelihood.known_inclination_rad == self.refinement.likelihood.known_inclination_rad {
            Information::new(self.refinement.system())
        } else {
            Information::new(&likelihood.linearise(samples, &self.refinement.unknowns))
        }
    }

    /// That the samples show another inclination than was told.
    #[inline(never)]
    fn contradicted(&self, information: &Information, likelihood: &Likelihood) -> Result<(), SolveError> {
        let Some(told_rad) = self.prior.inclination_rad.or(self.told.map(|(told_rad, _)| told_rad)) else {
            return Ok(());
        };
        let own = information.own_inclination(likelihood, &self.refinement.unknowns, self.consider);
        let sigma_rad = likelihood.config.known_inclination_sigma_rad;
        match own {
            Some([own_rad, variance])
                if libm::fabsf(own_rad - told_rad) > CONTRADICTS * libm::sqrtf(variance + sigma_rad * sigma_rad) =>
            {
                let found_deg = libm::roundf(own_rad.to_degrees()).clamp(-90.0, 90.0) as i8;
                Err(SolveError::InclinationContradicted { found_deg })
            }
            _ => Ok(()),
        }
    }

    /// Headings must run with the turns, and the mounting must be the configured one.
    #[inline(never)]
    fn plausible(&self, samples: Samples<'_>, calibration: &Calibration) -> Result<(), SolveError> {
        let heading = |s: &Sample| calibration.level(s).heading_rad();
        // The gyro knows; without one it is the bank, which turns an aeroplane.
        let by_bank = || {
            let sides = [(Side::Left, samples.left), (Side::Right, samples.right)];
            sides.into_iter().map(|(side, samples)| progress_rad(samples, side, heading)).sum::<f32>()
        };
        let progress = || progress_by_rates_rad(samples, heading).unwrap_or_else(by_bank);
        if self.method != Method::Ellipsoid && progress() < AGAINST_RAD {
            return Err(SolveError::TurnsReversed);
        }
        let found = Orientation::nearest(&calibration.w_matrix());
        if found != self.prior.mount {
            return Err(SolveError::MountContradicted { found });
        }
        Ok(())
    }
}

/// Whether another start may lead to a better result.
fn is_doubtful(end: &Result<Solution, SolveError>) -> bool {
    match end {
        Ok(solution) => !is_good(&solution.quality, &solution.calibration),
        Err(SolveError::NotConverged | SolveError::IronChanged(_)) => true,
        Err(_) => false,
    }
}

/// Whether a result is of another mounting than this sensor's, or of a source that tells its angles the wrong way round, or
/// none at all, next to a pole.
const fn is_odd(error: &SolveError) -> bool {
    matches!(error, SolveError::MountContradicted { .. } | SolveError::TurnsReversed | SolveError::NotDetermined(_))
}

/// What is not a number is not good either.
fn is_good(quality: &Quality, calibration: &Calibration) -> bool {
    is_accurate(quality) && calibration.b_vector_ut().norm() <= DOUBTFUL_IRON_UT
}

fn is_accurate(quality: &Quality) -> bool {
    quality.expected_rms_deg <= DOUBTFUL_RMS_DEG
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

/// Where a method begins, and whether that is the sphere.
#[inline(never)]
fn first_start(method: Method, samples: Samples<'_>, prior: &Prior) -> Result<(Start, bool), SolveError> {
    let rotation = prior.mount.body_from_sensor();
    let is_mounted_so = |start: &Start| Orientation::nearest(&start.w) == Orientation::NONE;
    if samples.has_any()
        && let Some(start) = response::tilted(samples, &rotation)
    {
        return Ok((start, false));
    }
    let closed_form = match closed_form(method, samples, &rotation, prior.inclination_rad) {
        Ok(response) => response.start(),
        // These can do without: they begin with the sphere.
        Err(_) if matches!(method, Method::MaximumLikelihood | Method::Ellipsoid) => None,
        Err(error) => return Err(error),
    };
    match closed_form {
        Some(start) if method == Method::MaximumLikelihood && !is_mounted_so(&start) => {
            // Two planes go by the sense of the turns, which not everything that flies banks into.
            let tilted = response::tilted(samples, &rotation).filter(is_mounted_so);
            Ok((tilted.unwrap_or(start), false))
        }
        Some(start) => Ok((start, false)),
        None if method.is_refined() => {
            Ok((response::sphere(samples, &rotation).ok_or(SolveError::NotConverged)?, true))
        }
        None => Err(SolveError::NotConverged),
    }
}

/// A refinement, or only an estimate of the noise, from a start.
fn begin(
    method: Method,
    prior: &Prior,
    samples: Samples<'_>,
    start: &Start,
    assumed: Assumed,
) -> Result<Refinement, SolveError> {
    let config = match method {
        Method::Level => Config::ALIGNED,
        Method::Ellipsoid => Config::NO_ATTITUDE,
        Method::FourEllipse | Method::TwoPlane | Method::MaximumLikelihood | Method::CompassSwing => Config::DEFAULT,
    };
    let mut likelihood =
        Likelihood { latency_s: assumed.latency_s, ..Likelihood::new(prior, config, samples, start.unit_ut) };
    likelihood.current.ut_per_a = assumed.ut_per_a;
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
    let turns = || samples.left.iter().chain(samples.right).chain(samples.any.into_iter().flatten());
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
    use crate::calibration::tests::synthetic::{Airframe, Flight, Random, Recorded, rms};
    use crate::calibration::{Course, IronChange, Mark, Rates};
    use crate::frames::Field;
    use crate::time::WrappingMillis;

    /// Fields that run up and down all three axes.
    fn varied(number: u8) -> Vec<Sample> {
        let field = |i: u8| Field::from_ut(f32::from(i), 100.0 - f32::from(i), 3.0 * f32::from(i % 10));
        let sample = |i| Sample {
            field: field(i),
            attitude: Attitude::default(),
            time: WrappingMillis::default(),
            rates: Rates::NONE,
        };
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

    /// A solution that expects so much, with so much hard iron along an axis.
    fn found(expected_rms_deg: f32, b_ut: f32) -> Solution {
        let (_, recorded) = flown();
        let mut solution = solve(Method::MaximumLikelihood, recorded.turns(), &Prior::default()).unwrap();
        solution.quality.expected_rms_deg = expected_rms_deg;
        solution.calibration.b_ut = [0.0, b_ut, 0.0];
        solution
    }

    fn flown() -> (Airframe, Recorded) {
        let mut random = Random(31);
        let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [55.0, 55.0]);
        let recorded = Flight::REAL.fly(&airframe, &mut random);
        (airframe, recorded)
    }

    /// 3 deg, 300 uT, and what is no number; of errors those that another start may mend.
    #[test]
    fn what_looks_strange_is_doubtful() {
        for (expected_rms_deg, b_ut, doubtful) in
            [(2.99, 299.0, false), (3.01, 0.0, true), (0.5, 301.0, true), (0.5, -301.0, true), (f32::NAN, 0.0, true)]
        {
            assert_eq!(is_doubtful(&Ok(found(expected_rms_deg, b_ut))), doubtful, "{expected_rms_deg} {b_ut}");
        }
        let change = IronChange { ut: 9.0, course: Course::Drift, of_s: 200 };
        assert!(is_doubtful(&Err(SolveError::NotConverged)) && is_doubtful(&Err(SolveError::IronChanged(change))));
        assert!(!is_doubtful(&Err(SolveError::TurnsReversed)));
    }

    /// Solves to the end, a step at a time; how often it began.
    fn run(mut solver: Solver, samples: Samples<'_>) -> (Result<Solution, SolveError>, usize) {
        let mut began = 1;
        loop {
            let before = (solver.from_sphere, solver.kept.is_some(), solver.told.is_some());
            match solver.step(samples) {
                Progress::Continue => {}
                Progress::Finished(end) => return (end, began),
            }
            let after = (solver.from_sphere, solver.kept.is_some(), solver.told.is_some());
            began += usize::from(before != after);
        }
    }

    /// A good flight is solved once. One whose first result is doubtful is solved from the sphere as well; where that
    /// fits better, it is taken, and where it does not, the first is found again.
    #[test]
    fn of_two_results_the_better_fit_is_taken() {
        let (airframe, recorded) = flown();
        let samples = recorded.turns();
        let new = || Solver::new(Method::MaximumLikelihood, samples, &Prior::default()).unwrap();
        let (plain, began) = run(new(), samples);
        let plain = plain.unwrap();
        assert_eq!(began, 1);
        let error = |solution: &Solution| rms(&airframe.errors_deg(&solution.calibration));
        // As if the first had been doubtful, and fitted so well.
        for (misfit, is_found_again) in [(f32::INFINITY, false), (0.0, true)] {
            let mut solver = new();
            while !matches!(solver.refinement.step(samples), Refining::Settled) {}
            let Kept { start, noise, .. } = solver.keep(&plain).unwrap();
            let sphere = response::sphere(samples, &Matrix3::identity()).unwrap();
            assert!(solver.begin(samples, &sphere, Assumed::NOTHING));
            (solver.from_sphere, solver.kept) = (true, Some(Kept { start, misfit, assumed: Assumed::NOTHING, noise }));
            let (again, began) = run(solver, samples);
            assert_eq!(began, if is_found_again { 2 } else { 1 });
            let again = again.unwrap();
            assert!((error(&again) - error(&plain)).abs() < 0.05 && again.iron.is_none());
        }
    }

    /// The misfit is of both residuals, and of the field in microtesla: twice the field is twice the misfit.
    #[test]
    fn the_misfit_is_in_microtesla() {
        let (_, recorded) = flown();
        let solver = Solver::new(Method::MaximumLikelihood, recorded.turns(), &Prior::default()).unwrap();
        let mut solution = found(0.5, 0.0);
        let misfit = solver.misfit(&solution.calibration);
        let noise = &solver.refinement.likelihood.noise;
        assert!((misfit / (noise.norm * noise.dip_rad * solution.calibration.total_ut) - 1.0).abs() < 1e-5);
        solution.calibration.total_ut *= 2.0;
        assert!((solver.misfit(&solution.calibration) / misfit - 2.0).abs() < 1e-5);
    }

    /// What is kept is a start that has the very unknowns, with what was in use: who goes back to it looks at samples as before.
    #[test]
    fn what_is_kept_is_where_it_was() {
        let (_, recorded) = flown();
        let mut solver = Solver::new(Method::MaximumLikelihood, recorded.turns(), &Prior::default()).unwrap();
        solver.refinement.likelihood.latency_s = 0.04;
        solver.refinement.likelihood.current.ut_per_a = [0.3, -0.2, 0.1];
        let Refinement { likelihood, unknowns, .. } = &solver.refinement;
        let kept = solver.keep(&found(0.5, 0.0)).unwrap();
        let again = likelihood.unknowns(&kept.start).unwrap();
        assert!((again - unknowns).norm() < 1e-5 * unknowns.norm(), "{again} {unknowns}");
        assert!(solver.begin(recorded.turns(), &kept.start, kept.assumed));
        let Likelihood { latency_s, current, .. } = &solver.refinement.likelihood;
        assert_eq!((*latency_s, current.ut_per_a), (0.04, [0.3, -0.2, 0.1]));
        assert_eq!((solver.latencies, solver.currents), (1, 1), "each was tried once at least");
    }

    /// Iron that goes with the current stays in use while it is known to half a microtesla at the current's spread, whatever the
    /// unit of the search is.
    #[test]
    fn the_current_s_spread_is_in_microtesla() {
        let (_, recorded) = flown();
        let samples = recorded.turns();
        for (sigma_ut, stays) in [(0.45, true), (0.55, false)] {
            let mut solver = Solver::new(Method::MaximumLikelihood, samples, &Prior::default()).unwrap();
            let likelihood = &mut solver.refinement.likelihood;
            (likelihood.current.spread_a, likelihood.current.ut_per_a) = (10.0, [0.3, 0.0, 0.0]);
            let (k, sigma) = (likelihood.k(), sigma_ut / 10.0 / likelihood.unit_ut);
            let covariance = Matrix3::from_diagonal_element(sigma * sigma);
            let found = Found { k, covariance, significance: [99.0; 2] };
            solver.currents = 2;
            let information = solver.information(&solver.refinement.likelihood, samples);
            assert_eq!(solver.takes_current(samples, &information, &found), !stays, "{sigma_ut} uT");
            assert_eq!(solver.refinement.likelihood.current.is_used(), stays);
        }
    }

    /// An inclination is left out when what came of it is an error, or of no use; and only if one was told.
    #[test]
    fn what_was_told_is_left_out_when_it_may_be_the_reason() {
        let (_, recorded) = flown();
        let samples = recorded.turns();
        let told = Prior { inclination_rad: Some(0.9), ..Prior::default() };
        for (prior, end, is_left_out) in [
            (told, Ok(found(2.9, 0.0)), false),
            (told, Ok(found(3.1, 0.0)), true),
            (told, Err(SolveError::TurnsReversed), true),
            (Prior::default(), Err(SolveError::TurnsReversed), false),
        ] {
            let mut solver = Solver::new(Method::MaximumLikelihood, samples, &prior).unwrap();
            assert_eq!(solver.tries_untold(&end, samples), is_left_out);
            assert_eq!(solver.told.is_some(), is_left_out);
            assert_eq!(solver.prior.inclination_rad.is_some(), prior.inclination_rad.is_some() && !is_left_out);
            // Once.
            assert!(!is_left_out || !solver.tries_untold(&end, samples));
        }
    }
}
