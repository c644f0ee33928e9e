//! Whether the iron stayed what it was: a calibration is of one airframe.
//!
//! A payload that moves in mid-flight, or a sensor whose zero drifts with temperature, changes the hard iron `b`. The
//! coefficients then fit neither what was nor what is, and the residuals, which take the misfit for noise, do not say
//! by how much. So a change `beta` of `b` is tried as three more unknowns, linear about the solution without it: before
//! some instant the hard iron was `b + beta` (a step, at each of some thirty instants), or it went from `b + beta` to
//! `b` evenly over the flight (a drift).
//!
//! With sums over the samples before the instant, in the order of time, of the information and the gradient of `beta`,
//! and `H` the information of the thirteen unknowns,
//! `S = H_bb - H_bu H^-1 H_ub` and `U = g_b - H_bu H^-1 g_u`
//! are what is left of them when the thirteen follow; `beta = S^-1 U` is its estimate, and `U S^-1 U` its significance,
//! chi-squared with three degrees of freedom if errors were independent and their sigma known (the efficient score:
//! D. R. Cox and D. V. Hinkley, Theoretical Statistics, 1974, 9.3).
//!
//! Neither is so: the misfit itself is in the sigma and in the correlation of neighbours. Both are taken anew from the
//! residuals that a change leaves, in a second pass that only a suspicious flight needs.
//!
//! # Thresholds
//!
//! Measured on flights of four circles each way in the simulator, 1,500 of them clean, in still to rough air at 12 to
//! 45 deg of bank: the largest significance of an instant exceeds 20 in one of a hundred, and after the second pass none
//! exceeds 25. With a payload moved by 2 uT at any instant it is 50 or more in 95 of a hundred, and thousands in most;
//! with a drift of 2 uT 200 and more. What escapes happened in the last seconds.
//!
//! Attitude errors of real flights last longer than the simulator's: a lean of some samples at the end of one recorded
//! flight had a significance of 43. Of norms alone it had ten, as it must; moved payloads have 30 and more.

use core::fmt;

use nalgebra::{Matrix3, Vector3};

use super::correlation::Correlation;
use super::information::Information;
use super::likelihood::unknowns::Vector13;
use super::likelihood::{Equation, Equations, Likelihood, Parameters, System};
use super::time_order::InTime;
use super::{Samples, inverse};
use crate::time::WrappingMillis;

/// Instants at which a step is tried.
const INSTANTS: usize = 32;

/// A change of less significance, by sigmas that have the misfit in them, is not looked at again.
const SUSPICIOUS: f32 = 20.0;

/// A change of this significance is one.
const SIGNIFICANT: f32 = 30.0;

/// And this much by norms alone, which no error of the attitude source reaches: a lean that lasts for some samples can
/// look like a change of the iron in their dips.
const SIGNIFICANT_OF_NORMS: f32 = 16.0;

/// Of the information about `beta`, what `f32` cannot tell from nothing.
const DIGITS: f32 = 1e-5;

/// How the iron changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Course {
    /// At once, so many seconds after the first sample.
    Step {
        /// Seconds.
        after_s: u16,
    },
    /// Evenly, from the first sample to the last.
    Drift,
}

/// A change of the iron while samples were taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IronChange {
    /// Its size, microtesla.
    pub ut: f32,
    /// How it came.
    pub course: Course,
    /// From the first sample to the last, seconds.
    pub of_s: u16,
}

/// What to do about it, in words.
impl fmt::Display for IronChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // The cast saturates, and takes what is no number to nothing.
        let (tenths, of_s) = ((self.ut * 10.0 + 0.5) as u32, self.of_s);
        let (whole, tenth) = (tenths / 10, tenths % 10);
        match self.course {
            Course::Step { after_s } => {
                write!(f, "iron changed by {whole}.{tenth} uT after {after_s} of {of_s} s")?;
                f.write_str("; fix what moved and fly again")
            }
            Course::Drift => {
                write!(f, "iron drifted by {whole}.{tenth} uT in {of_s} s")?;
                f.write_str("; wait until temperatures settle and fly again")
            }
        }
    }
}

/// A part of a flight, in time from the first sample.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    /// Up to and with these milliseconds.
    Step(u32),
    /// All of it, less and less.
    Drift,
}

/// When the samples were taken.
#[derive(Clone, Copy, Debug)]
struct Span {
    start: WrappingMillis,
    ms: u32,
}

impl Span {
    fn of(samples: Samples<'_>) -> Option<Self> {
        let (_, first) = InTime::new(samples).next()?;
        let pieces = [samples.left, samples.right, samples.level].into_iter().chain(samples.any);
        let ms = pieces.filter_map(<[_]>::last).map(|last| last.time.since(first.time)).max()?;
        Some(Self { start: first.time, ms })
    }

    /// How much of `beta` there was at a time.
    fn share(self, form: Form, time: WrappingMillis) -> f32 {
        let ms = time.since(self.start);
        match form {
            Form::Step(until_ms) => f32::from(u8::from(ms <= until_ms)),
            Form::Drift => 1.0 - ms as f32 / self.ms as f32,
        }
    }
}

/// Sums of what samples say of `beta`, in mount axes and the unit of field.
#[derive(Clone, Debug)]
pub(super) struct Sums {
    /// `H_bu`, a row for each axis.
    pub with_unknowns: [Vector13; 3],
    information: Matrix3<f32>,
    gradient: Vector3<f32>,
}

impl Sums {
    pub fn none() -> Self {
        Self { with_unknowns: [Vector13::zeros(); 3], information: Matrix3::zeros(), gradient: Vector3::zeros() }
    }

    /// Adds an equation whose residual changes by `by_beta` with `beta`, of which the sample has a share.
    pub fn add(&mut self, equation: &Equation, by_beta: &Vector3<f32>, share: f32) {
        let weighted = by_beta * (equation.weight * share);
        for (sum, of_axis) in self.with_unknowns.iter_mut().zip(&weighted) {
            equation.row.add_to(sum, *of_axis);
        }
        self.information.ger(share, &weighted, by_beta, 1.0);
        self.gradient.axpy(-equation.residual, &weighted, 1.0);
    }

    /// Adds sums of samples that have a share more, with the square of the share more by `squared`.
    fn add_sums(&mut self, sums: &Self, share: f32, squared: f32) {
        for (sum, with) in self.with_unknowns.iter_mut().zip(&sums.with_unknowns) {
            sum.axpy(share, with, 1.0);
        }
        self.information += sums.information * squared;
        self.gradient.axpy(share, &sums.gradient, 1.0);
    }

    /// `beta` with its significance, were errors independent and their sigma known.
    fn estimate(&self, system: &System, to_likeliest: &Vector13) -> Option<(Vector3<f32>, f32)> {
        let (information, gradient) = self.left(system, to_likeliest)?;
        let beta = inverse(&(information + self.digits()))? * gradient;
        let significance = beta.dot(&gradient);
        significance.is_finite().then_some((beta, significance))
    }

    /// `S` and `U`: what is left of information and gradient when the other unknowns follow.
    pub fn left(&self, system: &System, to_likeliest: &Vector13) -> Option<(Matrix3<f32>, Vector3<f32>)> {
        let (mut information, mut gradient) = (self.information, self.gradient);
        for (axis, with) in self.with_unknowns.iter().enumerate() {
            let column = system.covariance_times(with)?;
            for (other, with) in self.with_unknowns.iter().enumerate() {
                information[(axis, other)] -= column.dot(with);
            }
            gradient[axis] -= with.dot(to_likeliest);
        }
        Some((information, gradient))
    }

    /// The significance of `beta` by these sums, if they are of norms alone, whose errors have a variance of `norm`
    /// times what they were taken for. Dips only have their part in what is known of the other unknowns; how alike
    /// their errors are is judged from what is left without a change, which is more if there was one.
    fn significance(&self, information: &Information, to_likeliest: &Vector13, norm: f32) -> Option<f32> {
        let (mut variance, mut gradient) = (self.information * norm, self.gradient);
        let mut columns = [Vector13::zeros(); 3];
        for (column, with) in columns.iter_mut().zip(&self.with_unknowns) {
            *column = information.system.covariance_times(with)?;
        }
        for (axis, column) in columns.iter().enumerate() {
            let dips = information.dips_times(column, norm);
            for (other, with) in self.with_unknowns.iter().enumerate() {
                variance[(axis, other)] += columns[other].dot(&dips) - column.dot(with) * norm;
            }
            gradient[axis] -= self.with_unknowns[axis].dot(to_likeliest);
        }
        Some(gradient.dot(&(inverse(&(variance + self.digits()))? * gradient)))
    }

    fn digits(&self) -> Matrix3<f32> {
        Matrix3::from_diagonal_element(DIGITS * self.information.trace())
    }
}

/// A change that explains the samples better.
#[derive(Clone, Copy, Debug)]
struct Found {
    form: Form,
    beta: Vector3<f32>,
    significance: f32,
}

/// A change that samples show.
#[derive(Clone, Debug)]
pub(super) struct Change {
    pub iron: IronChange,
    /// What it did to the gradient of the unknowns, `H_ub beta`.
    pub effect: Vector13,
}

/// A search for a change of the iron, while the samples are looked at in the order of time. About 700 bytes.
#[derive(Debug)]
pub(super) struct Scan {
    span: Span,
    /// `W`, by which a change of the hard iron moves the corrected field.
    w: Matrix3<f32>,
    /// From the unknowns to the most likely ones, without a change.
    to_likeliest: Vector13,
    so_far: Sums,
    /// Of a drift in steps from instant to instant, which differ from it by what a constant makes up for.
    drifting: Sums,
    /// The drift's share at the last instant.
    share: f32,
    seen: usize,
    number: usize,
    found: Option<Found>,
    /// `H_ub beta` of what was found.
    effect: Vector13,
}

impl Scan {
    /// Of samples, and the problem that they make linearised at some unknowns. `None` if they are of one instant.
    #[inline(never)]
    pub fn new(samples: Samples<'_>, system: &System, unknowns: &Vector13) -> Option<Self> {
        Some(Self {
            span: Span::of(samples).filter(|span| span.ms > 0)?,
            w: Parameters::new(unknowns).w,
            to_likeliest: system.change()?,
            so_far: Sums::none(),
            drifting: Sums::none(),
            share: 1.0,
            seen: 0,
            number: samples.iter().count(),
            found: None,
            effect: Vector13::zeros(),
        })
    }

    /// Adds the next sample in time.
    pub fn add(&mut self, system: &System, time: WrappingMillis, equations: &Equations) {
        for equation in kinds(equations) {
            self.so_far.add(equation, &by_beta(&self.w, equation), 1.0);
        }
        self.seen += 1;
        if self.seen.is_multiple_of(self.number.div_ceil(INSTANTS)) && self.seen < self.number {
            self.consider(system, Form::Step(time.since(self.span.start)));
            self.drift_to(self.span.share(Form::Drift, time));
        }
    }

    /// Takes what has been seen since the instant before as having had the share of then, until now that this is left.
    fn drift_to(&mut self, share: f32) {
        let before = core::mem::replace(&mut self.share, share);
        self.drifting.add_sums(&self.so_far, before - share, before * before - share * share);
    }

    /// Tries a change of this form, of which the sums are complete.
    fn consider(&mut self, system: &System, form: Form) {
        let sums = if form == Form::Drift { &self.drifting } else { &self.so_far };
        let Some((beta, significance)) = sums.estimate(system, &self.to_likeliest) else { return };
        if self.found.is_none_or(|found| significance > found.significance) {
            self.effect = sums.with_unknowns.iter().zip(&beta).map(|(with, beta)| with * *beta).sum();
            self.found = Some(Found { form, beta, significance });
        }
    }

    /// The change that all samples show, if they do: by a second pass over them where the first was suspicious.
    #[inline(never)]
    pub fn change(
        &mut self,
        likelihood: &Likelihood,
        samples: Samples<'_>,
        information: &Information,
        unknowns: &Vector13,
    ) -> Option<Change> {
        self.drift_to(0.0);
        self.consider(&information.system, Form::Drift);
        let found = self.found.filter(|found| found.significance > SUSPICIOUS)?;
        let course = match found.form {
            Form::Step(until_ms) => Course::Step { after_s: seconds(until_ms) },
            Form::Drift => Course::Drift,
        };
        let iron = IronChange { ut: found.beta.norm() * likelihood.unit_ut, course, of_s: seconds(self.span.ms) };
        is_change(self.significance(&found, likelihood, samples, information, unknowns)?)
            .then_some(Change { iron, effect: self.effect })
    }

    /// The significance of a change by the scatter that it leaves: of norms and dips, and of norms alone.
    fn significance(
        &mut self,
        found: &Found,
        likelihood: &Likelihood,
        samples: Samples<'_>,
        information: &Information,
        unknowns: &Vector13,
    ) -> Option<[f32; 2]> {
        let move_unknowns = self.to_likeliest - information.system.covariance_times(&self.effect)?;
        let parameters = Parameters::new(unknowns);
        let mut left = Correlation::default();
        let norms = &mut self.so_far;
        *norms = Sums::none();
        for (part, sample) in InTime::new(samples) {
            let share = self.span.share(found.form, sample.time);
            let residual = |equation: &Equation| {
                let by_change = by_beta(&self.w, equation).dot(&found.beta) * share;
                let residual = equation.residual + equation.row.dot(&move_unknowns) + by_change;
                residual * libm::sqrtf(equation.weight)
            };
            let equations = likelihood.equations(sample, None, &parameters);
            left.add(part, [residual(&equations.norm), equations.dip.as_ref().map_or(0.0, residual)]);
            norms.add(&equations.norm, &by_beta(&self.w, &equations.norm), share);
        }
        // Sixteen unknowns take their share of the scatter, half of it from each kind of residual.
        let freedom = (self.number as f32 - 8.0).max(1.0);
        let [of_norm, of_dip] = left.excess();
        let [norm, dip] = left.squares();
        let [norm, dip] = [norm * (1.0 + of_norm) / freedom, dip * (1.0 + of_dip) / freedom];
        let of_norms = norms.significance(information, &self.to_likeliest, norm)?;
        Some([found.significance / norm.max(dip), of_norms])
    }
}

/// Whether so much significance, of norms and dips and of norms alone, is no chance.
fn is_change([of_both, of_norms]: [f32; 2]) -> bool {
    of_both > SIGNIFICANT && of_norms > SIGNIFICANT_OF_NORMS
}

/// Whole seconds.
fn seconds(ms: u32) -> u16 {
    u16::try_from(ms / 1000).unwrap_or(u16::MAX)
}

/// The equations that a change of the iron is seen in.
pub(super) fn kinds(equations: &Equations) -> impl Iterator<Item = &Equation> {
    core::iter::once(&equations.norm).chain(&equations.dip)
}

/// Derivative of a residual by what the hard iron was more: the corrected field was less by `W beta`, and `d` is added
/// to the corrected field.
pub(super) fn by_beta(w: &Matrix3<f32>, equation: &Equation) -> Vector3<f32> {
    -w.tr_mul(&equation.row.by_field)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, SVector};

    use super::super::least_squares::LeastSquares;
    use super::super::likelihood::{Config, Noise, Prior, Row};
    use super::super::tests::derivatives::assert_derivative;
    use super::super::tests::synthetic::{Airframe, Flight, Random, Recorded};
    use super::super::{Sample, response};
    use super::*;
    use crate::calibration::Rates;
    use crate::frames::Field;

    /// An ordinary flight with iron that was more by `beta_ut` before an instant; its likelihood, whose noise is known,
    /// and unknowns near the likeliest.
    struct Case {
        recorded: Recorded,
        likelihood: Likelihood,
        unknowns: Vector13,
    }

    impl Case {
        fn new(beta_ut: Vector3<f32>, before_ms: u32) -> Self {
            let mut random = Random(77);
            let airframe = Airframe::random(&mut random, 0.1, 1.0, 5.0, [50.0, 60.0]);
            let mut recorded = Flight::REAL.fly(&airframe, &mut random);
            for sample in &mut recorded.right {
                sample.time = WrappingMillis::new(sample.time.count() + 75_000);
            }
            for sample in recorded.left.iter_mut().chain(&mut recorded.right) {
                sample.field.ut += if sample.time.count() < before_ms { beta_ut } else { Vector3::zeros() };
            }
            let start = response::sphere(recorded.turns(), &Matrix3::identity()).unwrap();
            let mut likelihood =
                Likelihood::new(&Prior::default(), Config::DEFAULT, recorded.turns(), airframe.total_ut);
            let unknowns = likelihood.unknowns(&response::Start { unit_ut: airframe.total_ut, ..start }).unwrap();
            likelihood.noise = Noise::new(0.003, 0.006, Matrix3::identity());
            // Huber's weights would hang on where it is linearised.
            likelihood.config.huber = 1e3;
            let mut case = Self { recorded, likelihood, unknowns };
            for _ in 0..6 {
                case.unknowns += case.system().change().unwrap();
            }
            case
        }

        fn system(&self) -> System {
            let mut likelihood = self.likelihood.clone();
            (likelihood.stride, likelihood.sums_up) = (1, false);
            likelihood.linearise(self.recorded.turns(), &self.unknowns)
        }

        fn information(&self, scan: Option<&mut Scan>) -> Information {
            let mut information = Information::new(&self.system());
            information.look(&self.likelihood, self.recorded.turns(), &self.unknowns, scan);
            information
        }

        fn scanned(&self) -> (Scan, Information) {
            let mut scan = Scan::new(self.recorded.turns(), &self.system(), &self.unknowns).unwrap();
            let information = self.information(Some(&mut scan));
            (scan, information)
        }

        /// Every equation with its derivative by `beta` and what share of it the sample has.
        fn equations(&self, form: Form) -> Vec<(Equation, Vector3<f32>, bool)> {
            let span = Span::of(self.recorded.turns()).unwrap();
            let (parameters, w) = (Parameters::new(&self.unknowns), Parameters::new(&self.unknowns).w);
            let mut all = Vec::new();
            for (_, sample) in InTime::new(self.recorded.turns()) {
                let equations = self.likelihood.equations(sample, None, &parameters);
                let share = span.share(form, sample.time);
                for (equation, is_norm) in kinds(&equations).zip([true, false]) {
                    all.push((equation.clone(), by_beta(&w, equation) * share, is_norm));
                }
            }
            all
        }
    }

    const MOVED_UT: Vector3<f32> = Vector3::new(0.8, -0.5, 0.6);

    /// More hard iron is a field that has more, which to take away moves the residuals.
    #[test]
    fn the_residuals_by_hard_iron() {
        let mut case = Case::new(Vector3::zeros(), 0);
        case.likelihood.unit_ut = 40.0;
        let parameters = Parameters::new(&case.unknowns);
        for sample in case.recorded.left.iter().step_by(20) {
            let of = |beta: Vector3<f32>| {
                let field = Field::new(sample.field.ut - beta * case.likelihood.unit_ut);
                case.likelihood.equations(&Sample { field, ..*sample }, None, &parameters)
            };
            let here = of(Vector3::zeros());
            for axis in 0..3 {
                let moved = |step: f32| of(Vector3::ith(axis, step));
                let by = |equation: &Equation| by_beta(&parameters.w, equation)[axis];
                assert_derivative(by(&here.norm), |step| moved(step).norm.residual, "norm by hard iron");
                let dip = here.dip.as_ref().unwrap();
                assert_derivative(by(dip), |step| moved(step).dip.unwrap().residual, "dip by hard iron");
            }
        }
    }

    /// Least squares of all sixteen unknowns at once, in `f32` as well; what `f32` cannot tell pulls by a hundredth.
    #[test]
    fn a_change_is_what_sixteen_unknowns_would_make_of_it() {
        let case = Case::new(MOVED_UT, 60_000);
        for form in [Form::Step(59_500), Form::Drift] {
            let mut joint = LeastSquares::<16, 1>::new();
            let mut sums = Sums::none();
            for (equation, by_beta, _) in case.equations(form) {
                let row =
                    SVector::<f32, 16>::from_fn(|i, _| if i < 13 { equation.row.dense()[i] } else { by_beta[i - 13] });
                joint.add(&row, [-equation.residual], equation.weight);
                sums.add(&equation, &by_beta, 1.0);
            }
            super::super::likelihood::for_each_prior(
                &case.likelihood,
                &Parameters::new(&case.unknowns),
                &mut |prior| {
                    let row = SVector::<f32, 16>::from_fn(|i, _| if i < 13 { prior.row[i] } else { 0.0 });
                    joint.add(&row, [-prior.residual], 1.0 / (prior.sigma * prior.sigma));
                },
            );
            let system = case.system();
            let (beta, significance) = sums.estimate(&system, &system.change().unwrap()).unwrap();
            let expected = joint.solve().unwrap().fixed_rows::<3>(13).into_owned();
            assert!((beta - expected).norm() < 0.02 * expected.norm(), "{beta} {expected}");
            // Three unknowns more lower the sum of squares by as much.
            let mut covariance = Matrix3::zeros();
            for axis in 0..3 {
                let column = joint.covariance_times(&SVector::<f32, 16>::ith(13 + axis, 1.0)).unwrap();
                covariance.set_column(axis, &column.fixed_rows::<3>(13));
            }
            let lower = expected.dot(&(covariance.try_inverse().unwrap() * expected));
            assert!((significance / lower - 1.0).abs() < 0.02, "{significance} {lower}");
        }
    }

    /// The most significant instant is the one at which it happened, where that is among those tried: every tenth of
    /// 300 samples. A drift is a form of its own, and nothing is found in nothing.
    #[test]
    fn the_scan_finds_form_and_size() {
        let (mut scan, information) = Case::new(MOVED_UT, 65_000).scanned();
        scan.drift_to(0.0);
        scan.consider(&information.system, Form::Drift);
        let found = scan.found.unwrap();
        assert_eq!(found.form, Form::Step(64_500));
        let unit_ut = Case::new(MOVED_UT, 65_000).likelihood.unit_ut;
        assert!((found.beta * unit_ut - MOVED_UT).norm() < 0.4, "{}", found.beta * unit_ut);
        assert!(found.significance > 100.0);
        let nothing = Case::new(Vector3::zeros(), 0).scanned().0.found.unwrap();
        assert!(nothing.significance < SUSPICIOUS, "{nothing:?}");
    }

    /// The sums of a drift are made of those of the instants: its information about `beta` is that of the drift itself
    /// to a hundredth, and so is its estimate.
    #[test]
    fn a_drift_is_made_of_steps() {
        let case = Case::new(MOVED_UT, 65_000);
        let (mut scan, information) = case.scanned();
        scan.drift_to(0.0);
        let mut exact = Sums::none();
        for (equation, by_beta, _) in case.equations(Form::Drift) {
            exact.add(&equation, &by_beta, 1.0);
        }
        let of = |sums: &Sums| sums.estimate(&information.system, &scan.to_likeliest).unwrap();
        let ((found, significance), (beta, expected)) = (of(&scan.drifting), of(&exact));
        assert!((found - beta).norm() < 0.03 * beta.norm(), "{found} {beta}");
        assert!((significance / expected - 1.0).abs() < 0.03, "{significance} {expected}");
    }

    /// What was found says what it did to the gradient of the other unknowns.
    #[test]
    fn the_effect_is_that_of_what_was_found() {
        let case = Case::new(MOVED_UT, 60_000);
        let scan = case.scanned().0;
        let found = scan.found.unwrap();
        let effect = case.equations(found.form).iter().fold(Vector13::zeros(), |sum, (equation, by_beta, _)| {
            sum + equation.row.dense() * (equation.weight * by_beta.dot(&found.beta))
        });
        assert!((scan.effect - effect).norm() < 1e-3 * effect.norm());
    }

    /// By norms alone: the variance of their gradient with all that is in it, from the very samples.
    #[test]
    fn the_significance_of_norms_is_that_of_their_gradient() {
        let case = Case::new(MOVED_UT, 60_000);
        let form = Form::Step(59_500);
        let information = case.information(None);
        let mut sums = Sums::none();
        for (equation, by_beta, is_norm) in case.equations(form) {
            if is_norm {
                sums.add(&equation, &by_beta, 1.0);
            }
        }
        let to_likeliest = information.system.change().unwrap();
        let columns = sums.with_unknowns.map(|with| information.system.covariance_times(&with).unwrap());
        // Of the same norms less what follows of them, of dips only that.
        let left = |row: &Row, by_beta: Vector3<f32>| by_beta - Vector3::from_fn(|axis, _| row.dot(&columns[axis]));
        // The dips' own inflation, from what it makes of the information that they have of the inclination.
        let of_inclination = |(equation, _, is_norm): (Equation, Vector3<f32>, bool)| {
            if is_norm { 0.0 } else { equation.weight * equation.row.by_inclination.powi(2) }
        };
        let dips: f32 = case.equations(form).into_iter().map(of_inclination).sum();
        let of_dip = information.dips_times(&Vector13::ith(12, 1.0), 0.0)[12] / dips;
        let norm = 1.3;
        let mut variance = Matrix3::zeros();
        for (equation, by_beta, is_norm) in case.equations(form) {
            let left = left(&equation.row, if is_norm { by_beta } else { Vector3::zeros() });
            variance += left * left.transpose() * (equation.weight * if is_norm { norm } else { of_dip.max(norm) });
        }
        let gradient = sums.gradient - Vector3::from_fn(|axis, _| sums.with_unknowns[axis].dot(&to_likeliest));
        let expected = gradient.dot(&(variance.try_inverse().unwrap() * gradient));
        let found = sums.significance(&information, &to_likeliest, norm).unwrap();
        assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
        assert!(of_dip > 1.5, "{of_dip}");
    }

    /// Thirty, and sixteen of norms; less than twenty at first sight is not looked at again.
    #[test]
    fn it_takes_both_significances() {
        assert!(is_change([30.1, 16.1]));
        assert!(!is_change([29.9, 1e3]) && !is_change([1e3, 15.9]) && !is_change([f32::NAN, 1e3]));
        // Sigmas with a misfit in them: a change leaves a small part of what they expect.
        let mut case = Case::new(MOVED_UT * 4.0, 60_000);
        case.likelihood.noise = Noise::new(0.012, 0.024, Matrix3::identity());
        for (significance, is_found) in [(20.1, true), (19.9, false)] {
            let (mut scan, information) = case.scanned();
            // The drift is not asked for again.
            (scan.drifting, scan.share) = (Sums::none(), 0.0);
            scan.found.as_mut().unwrap().significance = significance;
            let found = scan.change(&case.likelihood, case.recorded.turns(), &information, &case.unknowns);
            assert_eq!(found.is_some(), is_found, "{significance}");
        }
    }

    /// The share of a change that a sample has: all up to and with the instant, nothing after; or less and less.
    #[test]
    fn a_sample_has_its_share() {
        let span = Span { start: WrappingMillis::new(u32::MAX - 999), ms: 4_000 };
        let at = |ms: u32| WrappingMillis::new((u32::MAX - 999).wrapping_add(ms));
        for (ms, step, drift) in [(0, 1.0, 1.0), (1_000, 1.0, 0.75), (1_001, 0.0, 0.749_75), (4_000, 0.0, 0.0)] {
            assert!((span.share(Form::Step(1_000), at(ms)) - step).abs() < 1e-6, "{ms}");
            assert!((span.share(Form::Drift, at(ms)) - drift).abs() < 1e-6, "{ms}");
        }
        assert_eq!((seconds(999), seconds(31_999), seconds(u32::MAX)), (0, 31, 65_535));
    }

    /// From the first sample of any part to the last of any.
    #[test]
    fn a_span_is_of_all_parts() {
        let at = |millis| Sample {
            field: Field::from_ut(0.0, 0.0, 0.0),
            attitude: crate::frames::Attitude::default(),
            time: WrappingMillis::new(millis),
            rates: Rates::NONE,
        };
        let (left, right, level) = ([at(50), at(900)], [at(20), at(300)], [at(400), at(700)]);
        let of = |left, right, level| Span::of(Samples { left, right, level, ..Samples::default() });
        let span = of(&left, &right, &level).unwrap();
        assert_eq!((span.start.count(), span.ms), (20, 880));
        assert_eq!(of(&[], &[], &level).unwrap().ms, 300);
        let any = Samples { any: [&level, &left, &[]], ..Samples::default() };
        assert_eq!(Span::of(any).map(|span| (span.start.count(), span.ms)), Some((50, 850)));
        assert!(of(&[], &[], &[]).is_none());
    }
}
