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

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::expected_error::{self, Consider};
use super::two_plane::{self, MIN_SAMPLES, runs_round};
use super::{Calibration, Method, Orientation, Quality, Sample, Side, SolveError, Turns, rows};
use crate::frames::Field;

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

/// The linearised problem at one set of unknowns.
#[derive(Clone, Debug)]
pub(super) struct System {
    /// Information of the norm residuals.
    pub norm: Matrix13,
    /// Information of the dip residuals.
    pub dip: Matrix13,
    /// Information of the priors.
    pub prior: Matrix13,
    /// What one radian of roll bias, pitch bias, and a relative bank error of one do to the gradient.
    pub consider: [Vector13; 3],
    gradient: Vector13,
    /// Half the weighted sum of squares.
    cost: f32,
    /// Sums of squares of the residuals over their sigma, each clipped.
    clipped: [f32; 2],
    /// Lag-1 autocorrelation sums of the dip residuals: products and squares.
    correlation: [f32; 2],
    samples: u16,
}

impl System {
    fn empty() -> Self {
        Self {
            norm: Matrix13::zeros(),
            dip: Matrix13::zeros(),
            prior: Matrix13::zeros(),
            consider: [Vector13::zeros(); 3],
            gradient: Vector13::zeros(),
            cost: 0.0,
            clipped: [0.0; 2],
            correlation: [0.0; 2],
            samples: 0,
        }
    }

    /// All information there is.
    pub fn information(&self) -> Matrix13 {
        self.norm + self.dip + self.prior
    }

    /// Lag-1 autocorrelation of the dip residuals, 0..0.8.
    pub fn autocorrelation(&self) -> f32 {
        let [products, squares] = self.correlation;
        if squares > 0.0 { (products / squares).clamp(0.0, 0.8) } else { 0.0 }
    }
}

/// Residuals are clipped here when their sigma is estimated, and this is the mean of the clipped square of a normal
/// variable: Huber's proposal 2, which one sample in twenty may spoil without harm.
const CLIP: f32 = 2.0;
const CLIPPED_MEAN_SQUARE: f32 = 0.9205;

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

    /// One pass over the samples.
    fn linearise(&self, turns: Turns<'_>, unknowns: &Vector13) -> System {
        let mut system = System::empty();
        let point = Point::new(unknowns);
        for side in [turns.left, turns.right] {
            let mut before = 0.0;
            for sample in side {
                let field = self.rotation * sample.field.ut / self.unit_ut;
                before = self.add(&mut system, &point.residuals(field, sample), before);
            }
        }
        self.add_priors(&mut system, unknowns);
        system
    }

    /// Adds a sample; gives its whitened dip residual, `before` being that of the sample before.
    fn add(&self, system: &mut System, residuals: &Residuals, before: f32) -> f32 {
        let norm = Whitened::new(residuals.norm, self.sigma.norm, self.config.huber);
        let dip = Whitened::new(residuals.dip, self.sigma.dip, self.config.huber);
        system.norm.ger(norm.weight, &residuals.norm_row, &residuals.norm_row, 1.0);
        system.dip.ger(dip.weight, &residuals.dip_row, &residuals.dip_row, 1.0);
        system.gradient += residuals.norm_row * (norm.weight * residuals.norm);
        system.gradient += residuals.dip_row * (dip.weight * residuals.dip);
        for (sum, effect) in system.consider.iter_mut().zip(residuals.attitude_effects) {
            *sum += residuals.dip_row * (dip.weight * effect);
        }
        system.cost += norm.loss + dip.loss;
        system.clipped[0] += norm.clipped;
        system.clipped[1] += dip.clipped;
        let bounded = dip.value.clamp(-CLIP, CLIP);
        system.correlation[0] += bounded * before;
        system.correlation[1] += bounded * bounded;
        system.samples += 1;
        bounded
    }

    /// Priors as residuals that are linear in the unknowns.
    fn add_priors(&self, system: &mut System, unknowns: &Vector13) {
        let mut add = |row: Vector13, sigma: f32| {
            let weight = 1.0 / (sigma * sigma);
            let residual = row.dot(unknowns);
            system.prior.ger(weight, &row, &row, 1.0);
            system.gradient += row * (weight * residual);
            system.cost += 0.5 * weight * residual * residual;
        };
        // Indices of W's elements in the unknowns.
        for (ij, ji) in [(1, 3), (2, 6), (5, 7)] {
            add(unit(ij, 0.5) + unit(ji, 0.5), self.config.soft_iron_sigma);
            add(unit(ij, 0.5) - unit(ji, 0.5), self.config.mounting_sigma);
        }
        let third_of_trace = unit(0, 1.0 / 3.0) + unit(4, 1.0 / 3.0) + unit(8, 1.0 / 3.0);
        for ii in [0, 4, 8] {
            add(unit(ii, 1.0) - third_of_trace, self.config.soft_iron_sigma);
        }
        for b in 9..12 {
            add(unit(b, 1.0), self.config.hard_iron_sigma_ut / self.unit_ut);
        }
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

fn unit(index: usize, value: f32) -> Vector13 {
    let mut vector = Vector13::zeros();
    vector[index] = value;
    vector
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

/// `W` and `b` in the unit of field, and the inclination.
pub(super) struct Point {
    pub w: Matrix3<f32>,
    pub b: Vector3<f32>,
    inclination_rad: f32,
}

/// The residuals of a sample and their derivatives.
struct Residuals {
    norm: f32,
    norm_row: Vector13,
    dip: f32,
    dip_row: Vector13,
    /// Change of `dip` by a radian of roll bias, of pitch bias, and by a relative bank error of one.
    attitude_effects: [f32; 3],
}

impl Point {
    fn new(unknowns: &Vector13) -> Self {
        let w = Matrix3::from_fn(|row, column| unknowns[3 * row + column]);
        Self { w, b: Vector3::new(unknowns[9], unknowns[10], unknowns[11]), inclination_rad: unknowns[12] }
    }

    /// The derivative by the unknowns of `k . w`, with `w = W x`, `x = m - b`: `k x^T` by `W`, `-W^T k` by `b`.
    pub fn row(&self, k: &Vector3<f32>, x: &Vector3<f32>) -> Vector13 {
        let by_b = -self.w.tr_mul(k);
        let mut row = Vector13::zeros();
        for i in 0..3 {
            for j in 0..3 {
                row[3 * i + j] = k[i] * x[j];
            }
            row[9 + i] = by_b[i];
        }
        row
    }

    fn residuals(&self, field: Vector3<f32>, sample: &Sample) -> Residuals {
        let x = field - self.b;
        let w = self.w * x;
        // A field of zero has no direction; the floor keeps its residual finite and large.
        let f = w.norm().max(1e-6);
        let u = w / f;
        let (sin_roll, cos_roll) = libm::sincosf(sample.attitude.roll_rad);
        let (sin_pitch, cos_pitch) = libm::sincosf(sample.attitude.pitch_rad);
        let down = Vector3::new(-sin_pitch, cos_pitch * sin_roll, cos_pitch * cos_roll);
        let sin_dip = u.dot(&down).clamp(-1.0, 1.0);
        // Near a pole the dip's derivative grows without bound; 0.05 is 3 deg from it.
        let cos_dip = libm::sqrtf(1.0 - sin_dip * sin_dip).max(0.05);
        let mut dip_row = self.row(&((down - u * sin_dip) / (f * cos_dip)), &x);
        dip_row[12] = -1.0;
        let by_roll = Vector3::new(0.0, cos_pitch * cos_roll, -cos_pitch * sin_roll).dot(&u) / cos_dip;
        let by_pitch = Vector3::new(-cos_pitch, -sin_pitch * sin_roll, -sin_pitch * cos_roll).dot(&u) / cos_dip;
        Residuals {
            norm: f - 1.0,
            norm_row: self.row(&u, &x),
            dip: libm::asinf(sin_dip) - self.inclination_rad,
            dip_row,
            attitude_effects: [by_roll, by_pitch, by_roll * sample.attitude.roll_rad],
        }
    }
}

/// A residual over its sigma, with Huber's weight and loss.
struct Whitened {
    value: f32,
    /// Weight of the squared residual, unwhitened.
    weight: f32,
    loss: f32,
    clipped: f32,
}

impl Whitened {
    fn new(residual: f32, sigma: f32, huber: f32) -> Self {
        let value = residual / sigma;
        let size = value.abs();
        let (weight, loss) =
            if size <= huber { (1.0, 0.5 * size * size) } else { (huber / size, huber * (size - 0.5 * huber)) };
        let bounded = size.min(CLIP);
        Self { value, weight: weight / (sigma * sigma), loss, clipped: bounded * bounded }
    }
}

/// Unit of field and unknowns from the closed form.
fn two_plane_start(turns: Turns<'_>, rotation: &Matrix3<f32>) -> Option<(f32, Vector13)> {
    let planes = two_plane::solve(turns, rotation).ok()?;
    // Total field in units of H0.
    let total = libm::sqrt(1.0 + planes.tan_inclination * planes.tan_inclination);
    let w = planes.response_ut.try_inverse()? / total;
    let unit_ut = 1.0 / libm::cbrt(w.determinant());
    let inclination_rad = libm::atan(planes.tan_inclination);
    start(&(w * unit_ut).cast(), &(planes.b_ut / unit_ut).cast(), inclination_rad as f32)
        .filter(|_| unit_ut.is_finite() && unit_ut > 0.0)
        .map(|unknowns| (unit_ut as f32, unknowns))
}

/// Unit of field and unknowns from a sphere through all samples: hard iron only.
fn sphere_start(turns: Turns<'_>, rotation: &Matrix3<f32>) -> Option<(f32, Vector13)> {
    let fields = || turns.left.iter().chain(turns.right).map(|s| (rotation * s.field.ut, s));
    let number = fields().count() as f32;
    let mean = fields().map(|(f, _)| f).sum::<Vector3<f32>>() / number;
    // |m|^2 = 2 m . b + (r^2 - |b|^2), linear in b and the bracket; fields from their mean, for the digits.
    let mut normal = SMatrix::<f32, 4, 4>::zeros();
    let mut right = SVector::<f32, 4>::zeros();
    for (field, _) in fields() {
        let p = field - mean;
        let row = SVector::from([2.0 * p.x, 2.0 * p.y, 2.0 * p.z, 1.0]);
        normal += row * row.transpose();
        right += row * p.norm_squared();
    }
    let solution = normal.cast::<f64>().cholesky()?.solve(&right.cast::<f64>()).cast::<f32>();
    let centre = solution.fixed_rows::<3>(0).into_owned();
    let unit_ut = libm::sqrtf((solution[3] + centre.norm_squared()).max(1.0));
    let b_ut = mean + centre;
    let sin_dip = fields()
        .map(|(field, s)| {
            let level = s.attitude.level(Field::new(field - b_ut));
            level.ut.z / level.total_ut().max(1e-6)
        })
        .sum::<f32>()
        / number;
    start(&Matrix3::identity(), &(b_ut / unit_ut), libm::asinf(sin_dip.clamp(-1.0, 1.0)))
        .map(|unknowns| (unit_ut, unknowns))
}

fn start(w: &Matrix3<f32>, b: &Vector3<f32>, inclination_rad: f32) -> Option<Vector13> {
    let mut unknowns = Vector13::zeros();
    for i in 0..3 {
        for j in 0..3 {
            unknowns[3 * i + j] = w[(i, j)];
        }
        unknowns[9 + i] = b[i];
    }
    unknowns[12] = inclination_rad;
    unknowns.iter().all(|u| u.is_finite()).then_some(unknowns)
}
