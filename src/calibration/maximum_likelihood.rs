//! Maximum likelihood with per-sample attitude: the method in use.
//!
//! Real turns are not flown at constant attitude, so the closed form only starts the refinement. Let `w = W (m - b)`,
//! `f = |w|`, and `d` the down direction in body axes, which the attitude of the sample gives. An error of attitude can
//! tilt the measured vector but never stretch it, so two residuals with errors of their own are used:
//!
//! - `e_norm = f - 1`, whose variance is the sensor's noise (unit of field: the total intensity F),
//! - `e_dip = asin(d . w / f) - I`, whose variance is the sensor's and the attitude's.
//!
//! Unknowns: `W` (9), `b` (3), `I`. Their variances are re-estimated from the residuals between iterations; weighting
//! the two alike, as common attitude-aided fits do, is what ruins them, because attitude errors are often ten times the
//! sensor's. Huber's loss bounds what a gust or a passing power line can do. Weak priors on soft iron (symmetric part of
//! `W`) and mounting (skew part) let thin data shrink towards no correction.
//!
//! Everything done per sample is in `f32`; the 13 x 13 system is solved in `f64`.

mod point;
mod start;
mod system;

use nalgebra::{Matrix3, SMatrix, SVector};

pub(super) use self::point::Point;
use self::point::Residuals;
use self::start::{sphere_start, two_plane_start};
use self::system::CLIPPED_MEAN_SQUARE;
pub(super) use self::system::System;
use super::expected_error::{self, Consider};
use super::two_plane::{MIN_SAMPLES, runs_round};
use super::{Calibration, Method, Orientation, Quality, Sample, Side, SolveError, Turns, rows};

/// Number of unknowns: `W` row by row, `b`, `I`.
pub(super) const UNKNOWNS: usize = 13;
pub(super) type Vector13 = SVector<f32, UNKNOWNS>;
pub(super) type Matrix13 = SMatrix<f32, UNKNOWNS, UNKNOWNS>;

/// Fixed numbers of the method.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Soft iron, 1 sigma of an element of the symmetric part of `W`, relative: 30 % is a bad airframe.
    pub soft_iron_sigma: f32,
    /// Mounting, 1 sigma of an element of the skew part of `W`, radians: 20 deg.
    pub mounting_sigma: f32,
    /// Hard iron, 1 sigma, microtesla: three times the Earth's field.
    pub hard_iron_sigma_ut: f32,
    /// `e_norm` is not believed to be better than this: quantisation and the chip's linearity.
    pub min_norm_sigma: f32,
    /// `e_dip` is not believed to be better than this, radians: 0.05 deg.
    pub min_dip_sigma_rad: f32,
    /// A fit whose `e_norm` scatters by more does not explain the samples: ten times a poor sensor.
    pub max_norm_sigma: f32,
    /// A fit whose `e_dip` scatters by more does not explain the samples, radians: 5 deg.
    pub max_dip_sigma_rad: f32,
    /// Residuals beyond so many sigma count linearly (Huber).
    pub huber: f32,
    /// Iterations for one start; the worst case seen takes a third of it.
    pub max_iterations: u16,
    /// What the attitude source may get wrong in ways that turns do not show.
    pub consider: Consider,
}

impl Config {
    /// Numbers for airframes and sensors of UAVs.
    pub const DEFAULT: Self = Self {
        soft_iron_sigma: 0.3,
        mounting_sigma: 0.35,
        hard_iron_sigma_ut: 150.0,
        min_norm_sigma: 0.0005,
        min_dip_sigma_rad: 0.0009,
        max_norm_sigma: 0.05,
        max_dip_sigma_rad: 0.087,
        huber: 2.0,
        max_iterations: 100,
        consider: Consider::DEFAULT,
    };
}

/// What is known beforehand.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Prior {
    /// How the sensor is mounted.
    pub mount: Orientation,
}

/// What came out.
#[derive(Clone, Copy, Debug)]
pub struct Solution {
    /// The coefficients.
    pub calibration: Calibration,
    /// How good they are expected to be.
    pub quality: Quality,
}

/// How far a refinement is.
#[derive(Debug)]
pub enum Progress {
    /// Call [`Refinement::step`] again.
    Continue,
    /// It has ended.
    Finished(Result<Solution, SolveError>),
}

/// Where a refinement begins, in the order in which they are tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Start {
    /// The closed form.
    TwoPlane,
    /// A sphere through all samples, no soft iron.
    Sphere,
}

/// A refinement under way. Each [`step`](Self::step) is one pass over the samples. About 3 KB.
#[derive(Debug)]
pub struct Refinement {
    config: Config,
    /// Chip to body axes as configured: the refinement works in body axes as far as they are known.
    rotation: Matrix3<f32>,
    start: Start,
    /// Unit of field, microtesla.
    unit_ut: f32,
    unknowns: Vector13,
    sigma: Sigma,
    system: System,
    damping: f32,
    /// Rounds of weights since the unknowns last settled.
    rounds: u8,
    iterations: u16,
}

/// Standard deviations of the two residuals.
#[derive(Clone, Copy, Debug)]
struct Sigma {
    norm: f32,
    dip: f32,
}

impl Sigma {
    /// Before anything is known: wide enough for a bad start.
    const INITIAL: Self = Self { norm: 0.05, dip: 0.1 };
}

/// The unknowns have settled when a step promises to lower the cost by less than this, in units of half a sigma
/// squared: 0.03 sigma of the worst direction.
const SETTLED: f32 = 5e-4;

/// Rounds of re-weighting; sigma changes by less than 1 % after the third.
const ROUNDS: u8 = 5;

impl Refinement {
    /// Begins a refinement.
    pub fn new(turns: Turns<'_>, prior: &Prior, config: &Config) -> Result<Self, SolveError> {
        check(turns)?;
        let rotation = prior.mount.body_from_sensor();
        let mut refinement = Self {
            config: *config,
            rotation,
            start: Start::TwoPlane,
            unit_ut: 1.0,
            unknowns: Vector13::zeros(),
            sigma: Sigma::INITIAL,
            system: System::empty(),
            damping: 0.0,
            rounds: 0,
            iterations: 0,
        };
        if let Some((unit_ut, unknowns)) = two_plane_start(turns, &rotation) {
            refinement.begin(turns, Start::TwoPlane, unit_ut, unknowns);
        } else {
            let (unit_ut, unknowns) = sphere_start(turns, &rotation).ok_or(SolveError::NotConverged)?;
            refinement.begin(turns, Start::Sphere, unit_ut, unknowns);
        }
        Ok(refinement)
    }

    fn begin(&mut self, turns: Turns<'_>, start: Start, unit_ut: f32, unknowns: Vector13) {
        self.start = start;
        self.unit_ut = unit_ut;
        self.unknowns = unknowns;
        self.sigma = Sigma::INITIAL;
        self.damping = 1e-3;
        self.rounds = 0;
        self.iterations = 0;
        self.system = self.linearise(turns, &unknowns);
    }

    /// One Levenberg-Marquardt step, or the end. `turns` must be those it began with.
    pub fn step(&mut self, turns: Turns<'_>) -> Progress {
        self.iterations += 1;
        if self.iterations > self.config.max_iterations {
            return self.give_up(turns);
        }
        let Some(change) = damped_step(&self.system, self.damping) else { return self.give_up(turns) };
        let trial = self.unknowns + change;
        let system = self.linearise(turns, &trial);
        let improved = system.cost <= self.system.cost;
        let promised = -0.5 * change.dot(&self.system.gradient);
        if improved {
            self.unknowns = trial;
            self.system = system;
            self.damping = (self.damping * 0.1).max(1e-9);
        } else {
            self.damping *= 10.0;
        }
        if promised.abs() > SETTLED && self.damping < 1e6 {
            return Progress::Continue;
        }
        if self.rounds < ROUNDS {
            self.rounds += 1;
            self.reweight(turns);
            return Progress::Continue;
        }
        match self.finish(turns) {
            Err(SolveError::NotConverged) => self.give_up(turns),
            end => Progress::Finished(end),
        }
    }

    /// The next start, or the end.
    fn give_up(&mut self, turns: Turns<'_>) -> Progress {
        match sphere_start(turns, &self.rotation) {
            Some((unit_ut, unknowns)) if self.start == Start::TwoPlane => {
                self.begin(turns, Start::Sphere, unit_ut, unknowns);
                Progress::Continue
            }
            _ => Progress::Finished(Err(SolveError::NotConverged)),
        }
    }

    /// New sigmas from the residuals.
    fn reweight(&mut self, turns: Turns<'_>) {
        // Thirteen unknowns take their share of the scatter, here half from each kind of residual.
        let samples = f32::from(self.system.samples);
        let freedom = (samples - UNKNOWNS as f32 / 2.0).max(1.0) * CLIPPED_MEAN_SQUARE;
        let factor = self.system.clipped.map(|sum| libm::sqrtf(sum / freedom));
        self.sigma.norm = (self.sigma.norm * factor[0]).max(self.config.min_norm_sigma);
        self.sigma.dip = (self.sigma.dip * factor[1]).max(self.config.min_dip_sigma_rad);
        self.damping = 1e-6;
        self.system = self.linearise(turns, &self.unknowns);
    }

    /// Checks what was found and puts it into the module's units.
    fn finish(&self, turns: Turns<'_>) -> Result<Solution, SolveError> {
        let explained =
            self.sigma.norm <= self.config.max_norm_sigma && self.sigma.dip <= self.config.max_dip_sigma_rad;
        let point = Point::new(&self.unknowns);
        let determinant = point.w.determinant();
        if !explained || !determinant.is_finite() || determinant <= 0.0 {
            return Err(SolveError::NotConverged);
        }
        // W in units of 1/F to a determinant of one: the corrected field is then in microtesla.
        let per_unit = 1.0 / libm::cbrtf(determinant);
        let w = point.w * per_unit * self.rotation;
        let calibration = Calibration {
            w: rows(&w),
            b_ut: (self.rotation.tr_mul(&point.b) * self.unit_ut).into(),
            inclination_rad: self.unknowns[12],
            total_ut: self.unit_ut * per_unit,
        };
        plausible(turns, &calibration, &w, &point.w)?;
        let expected = expected_error::expected(&self.system, &point, self.unknowns[12], self.config.consider)
            .ok_or(SolveError::NotConverged)?;
        let quality = Quality {
            method: Method::MaximumLikelihood,
            expected_rms_deg: expected.rms_deg,
            expected_worst_deg: expected.worst_deg,
            norm_residual: self.sigma.norm,
            dip_residual_deg: self.sigma.dip.to_degrees(),
            samples: self.system.samples,
        };
        Ok(Solution { calibration, quality })
    }
}

/// Refines to the end.
pub fn solve(turns: Turns<'_>, prior: &Prior, config: &Config) -> Result<Solution, SolveError> {
    let mut refinement = Refinement::new(turns, prior, config)?;
    // Ends, because both starts together take at most twice `max_iterations` steps.
    loop {
        if let Progress::Finished(end) = refinement.step(turns) {
            return end;
        }
    }
}

/// Whether the samples can be worked with at all.
fn check(turns: Turns<'_>) -> Result<(), SolveError> {
    for (side, samples) in [(Side::Left, turns.left), (Side::Right, turns.right)] {
        if samples.len() < MIN_SAMPLES {
            return Err(SolveError::TooFewSamples { side, have: samples.len() as u16, need: MIN_SAMPLES as u16 });
        }
        let finite = |s: &Sample| {
            s.field.ut.iter().all(|c| c.abs() < 1e6)
                && s.attitude.roll_rad.is_finite()
                && s.attitude.pitch_rad.is_finite()
        };
        if !samples.iter().all(finite) {
            return Err(SolveError::NotFinite);
        }
    }
    Ok(())
}

/// Headings must run with the turns, and the mounting must be the configured one.
fn plausible(
    turns: Turns<'_>,
    calibration: &Calibration,
    w: &Matrix3<f32>,
    in_mount: &Matrix3<f32>,
) -> Result<(), SolveError> {
    let heading = |s: &Sample| s.attitude.level(calibration.apply(s.field)).heading_rad();
    let right_way = [(Side::Left, turns.left), (Side::Right, turns.right)]
        .map(|(side, samples)| runs_round(samples, side, heading));
    if right_way != [true, true] {
        return Err(SolveError::TurnsReversed);
    }
    if Orientation::nearest(in_mount) != Orientation::NONE {
        return Err(SolveError::MountContradicted { found: Orientation::nearest(w) });
    }
    Ok(())
}

/// Solves `(H + damping diag H) change = -gradient` in `f64`.
fn damped_step(system: &System, damping: f32) -> Option<Vector13> {
    let mut information = system.information().cast::<f64>();
    for i in 0..UNKNOWNS {
        information[(i, i)] *= 1.0 + f64::from(damping);
    }
    let change = information.cholesky()?.solve(&(-system.gradient.cast::<f64>()));
    change.iter().all(|c| c.is_finite()).then(|| change.cast::<f32>())
}
