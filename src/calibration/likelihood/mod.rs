//! How likely samples are with a set of coefficients: the model that every method's result is judged by, and that
//! maximum likelihood refines.
//!
//! Let `w = W (m - b)` in units of the total intensity, and `C` the rotation from body to level axes that the attitude
//! of a sample gives. An error of attitude can tilt the measured vector but never stretch it, so two residuals with
//! errors of their own are used:
//!
//! - `e_norm = |w| - 1`, whose variance is the sensor's noise,
//! - `e_dip = dip(C w) - I`, whose variance is the sensor's and the attitude's.
//!
//! Where a heading was given (compass swing) there is a third, `e_heading = heading(C w) - given`. The unknowns are
//! `W`, `b` (by way of a `d`: see [`Parameters`]) and `I`.
//!
//! The variances are re-estimated from the residuals; weighting the two alike, as common attitude-aided fits do, is
//! what ruins them, because attitude errors are often ten times the sensor's. Huber's loss bounds what a gust or a
//! passing power line can do.
//!
//! | file | holds |
//! |---|---|
//! | `unknowns.rs` | the order of the unknowns and of the coefficients |
//! | `parameters.rs` | one set of unknowns |
//! | `prediction.rs` | what parameters make of a measurement |
//! | `noise.rs` | how wrong measurements are |
//! | `equations.rs` | what one sample says, linear in the unknowns |
//! | `priors.rs` | what is known before any sample |
//! | `squares.rs` | sums of squares of what samples say |
//! | `system.rs` | what all samples and the priors say together |

mod equations;
mod noise;
mod parameters;
mod prediction;
mod priors;
mod squares;
mod system;
pub(super) mod unknowns;

pub(super) use equations::{Equation, Equations, Measured};
pub(super) use noise::Noise;
pub(super) use parameters::Parameters;
pub(crate) use prediction::Prediction;
pub(super) use prediction::{heading_by_field, horizontal_squared};
pub(super) use priors::{Quantity, for_each_prior};
pub(crate) use squares::Squares;
pub(super) use system::System;
pub(crate) use unknowns::Row;
pub(super) use unknowns::Vector13;

pub(super) use equations::CLIPPED_MEAN_SQUARE;
use nalgebra::{Matrix3, Vector3};
use unknowns::UNKNOWNS;

use super::current_iron::IS_LOOKED_FOR;
use super::response::Start;
use super::{Calibration, CurrentIron, Orientation, Sample, Samples, SolveError, rows};
use crate::trig;

/// Fixed numbers of the model.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Whether the samples' attitude is used; without it only the total field is known to be the same everywhere.
    pub uses_attitude: bool,
    /// Soft iron, 1 sigma of an element of the symmetric part of `W`, relative: 30 % is a bad airframe.
    pub soft_iron_sigma: f32,
    /// Mounting, 1 sigma of an element of the skew part of `W`, radians: 20 deg.
    pub mounting_sigma: f32,
    /// Hard iron, 1 sigma, microtesla: three times the Earth's field.
    pub hard_iron_sigma_ut: f32,
    /// A known inclination, radians, 1 sigma: 1 deg. A chart is good to half of it, the ground below to the rest.
    pub known_inclination_sigma_rad: f32,
    /// A heading given by a person, radians, 1 sigma: 1 deg, a compass rose or a bearing compass.
    pub given_heading_sigma_rad: f32,
    /// What `e_norm` usually scatters by: counts as so many samples' residuals as `usual_weight` says, so that a
    /// handful of samples that fit by chance are not believed to be perfect.
    pub usual_norm_sigma: f32,
    /// The same of `e_dip`, radians.
    pub usual_dip_sigma_rad: f32,
    /// See `usual_norm_sigma`.
    pub usual_weight: f32,
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
}

impl Config {
    /// Numbers for airframes and sensors of UAVs, with attitude.
    pub const DEFAULT: Self = Self {
        uses_attitude: true,
        soft_iron_sigma: 0.3,
        mounting_sigma: 0.35,
        hard_iron_sigma_ut: 150.0,
        known_inclination_sigma_rad: 0.0175,
        given_heading_sigma_rad: 0.0175,
        usual_norm_sigma: 0.004,
        usual_dip_sigma_rad: 0.006,
        usual_weight: 4.0,
        min_norm_sigma: 0.0005,
        min_dip_sigma_rad: 0.0009,
        max_norm_sigma: 0.05,
        max_dip_sigma_rad: 0.087,
        huber: 2.0,
    };

    /// For data that cannot show the mounting: it is taken to be as configured, to half a degree.
    pub const ALIGNED: Self = Self { mounting_sigma: 0.009, ..Self::DEFAULT };

    /// For tumbling on a bench, where no attitude is known.
    pub const NO_ATTITUDE: Self = Self { uses_attitude: false, ..Self::ALIGNED };
}

/// What is known beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// How the sensor is mounted.
    pub mount: Orientation,
    /// Inclination of the Earth field here, radians, positive down, where it is known.
    pub inclination_rad: Option<f32>,
    /// How many readings of the sensor were averaged to each sample; 1: samples are single readings.
    pub readings_per_sample: u16,
}

/// The sensor sits as the autopilot does, nothing is known of the field, and samples are single readings.
impl Default for Prior {
    fn default() -> Self {
        Self { mount: Orientation::NONE, inclination_rad: None, readings_per_sample: 1 }
    }
}

/// The model with its noise and its units.
#[derive(Clone, Debug)]
pub(super) struct Likelihood {
    pub config: Config,
    /// Inclination of the Earth field, radians, positive down, where it is known.
    pub known_inclination_rad: Option<f32>,
    /// How many readings were averaged to each sample.
    pub readings_per_sample: u16,
    /// Chip to body axes as configured: the model works in body axes as far as they are known.
    pub rotation: Matrix3<f32>,
    /// Unit of field, microtesla.
    pub unit_ut: f32,
    /// Mean of all samples in mount axes and the unit of field.
    pub mean: Vector3<f32>,
    pub noise: Noise,
    /// Whether the noise has been estimated: see [`Equations::new`].
    pub refined: bool,
    /// By how much the samples' attitudes are too old, seconds.
    pub latency_s: f32,
    /// What the samples' currents added to their fields.
    pub current: CurrentIron,
    /// Every so many samples one is looked at: while a bad start is left behind, a part of many will do.
    pub stride: usize,
    /// Whether equations are summed up instead of rotated into a triangle: while many samples are sought through.
    pub sums_up: bool,
}

/// Samples that are enough to leave a bad start behind. As few are rotated into the triangle at once.
const ENOUGH_TO_START: usize = 128;

impl Likelihood {
    /// The model of samples in a unit of field, nothing known of the noise.
    pub fn new(prior: &Prior, config: Config, samples: Samples<'_>, unit_ut: f32) -> Self {
        let rotation = prior.mount.body_from_sensor();
        let sum_ut = samples.all().map(|s| s.field.ut).sum::<Vector3<f32>>();
        let number = samples.all().count();
        Self {
            config,
            known_inclination_rad: prior.inclination_rad,
            readings_per_sample: prior.readings_per_sample,
            rotation,
            unit_ut,
            mean: rotation * sum_ut / (number.max(1) as f32 * unit_ut),
            noise: Noise::INITIAL,
            refined: false,
            latency_s: 0.0,
            current: CurrentIron::of(samples),
            stride: (number / ENOUGH_TO_START).max(1),
            sums_up: number > ENOUGH_TO_START,
        }
    }

    /// The equations of every sample, one after the other.
    pub fn for_each_sample(&self, samples: Samples<'_>, parameters: &Parameters, each: &mut dyn FnMut(&Equations)) {
        let mut one =
            |sample: &Sample, heading_rad: Option<f32>| each(&self.equations(sample, heading_rad, parameters));
        samples.iter().step_by(self.stride).for_each(|sample| one(sample, None));
        samples.marks.iter().for_each(|mark| one(&mark.sample, Some(mark.heading_rad)));
    }

    /// The equations of a sample, and of its heading in radians where that was given.
    pub fn equations(&self, sample: &Sample, heading_rad: Option<f32>, parameters: &Parameters) -> Equations {
        let attitude = sample.attitude_after(self.latency_s);
        // As if all were of the mean current, whose field is the mean.
        let added_ut = if IS_LOOKED_FOR {
            Vector3::from(self.current.ut_per_a) * self.current.share_a(sample)
        } else {
            Vector3::zeros()
        };
        let measured = Measured {
            x: self.rotation * (sample.field.ut - added_ut) / self.unit_ut - self.mean,
            tilt: attitude.tilt(),
            roll_rad: attitude.roll_rad,
            rates: sample.rates,
            heading_rad,
        };
        Equations::new(parameters, &measured, &self.noise, &self.config, self.refined)
    }

    /// The unknowns of a start.
    pub fn unknowns(&self, start: &Start) -> Option<Vector13> {
        Parameters { w: start.w, d: start.w * (self.mean - start.b), inclination_rad: start.inclination_rad }.unknowns()
    }

    /// The start that has these unknowns. `None` when their `W` has no inverse.
    pub fn start(&self, unknowns: &Vector13) -> Option<Start> {
        let parameters = Parameters::new(unknowns);
        let b = self.mean - parameters.mean_from_b()?;
        Some(Start { unit_ut: self.unit_ut, w: parameters.w, b, inclination_rad: parameters.inclination_rad })
    }

    /// One pass over the samples.
    pub fn linearise(&self, samples: Samples<'_>, unknowns: &Vector13) -> System {
        System::of(self, samples, unknowns)
    }

    /// What the samples' currents are taken to have added, mount axes and the unit of field per ampere.
    pub fn k(&self) -> Vector3<f32> {
        self.rotation * Vector3::from(self.current.ut_per_a) / self.unit_ut
    }

    /// New sigmas from the residuals.
    pub fn reweight(&mut self, system: &System, unknowns: &Vector13) {
        // Thirteen unknowns take their share of the scatter, here half from each kind of residual.
        let freedom = (f32::from(system.samples) - UNKNOWNS as f32 / 2.0).max(1.0);
        let Config { usual_norm_sigma, usual_dip_sigma_rad, usual_weight, .. } = self.config;
        let estimate = |sum: f32, before: f32, usual: f32| {
            let squares = sum / CLIPPED_MEAN_SQUARE * before * before + usual_weight * usual * usual;
            libm::sqrtf(squares / (freedom + usual_weight))
        };
        let [norm, dip] = system.clipped_squares;
        let norm = estimate(norm, self.noise.norm, usual_norm_sigma);
        let dip = estimate(dip, self.noise.dip_rad, usual_dip_sigma_rad);
        self.noise = Noise::new(
            norm.max(self.config.min_norm_sigma),
            dip.max(self.config.min_dip_sigma_rad),
            Parameters::new(unknowns).w,
        );
        // The first round of weights may do with half of very many.
        self.stride = if self.refined { 1 } else { (self.stride / 2).clamp(1, 2) };
        self.refined = true;
    }

    /// Whether the residuals are small enough for the coefficients to explain the samples.
    pub fn explains(&self) -> bool {
        self.noise.norm <= self.config.max_norm_sigma && self.noise.dip_rad <= self.config.max_dip_sigma_rad
    }

    /// The unknowns in the module's units: `W` to a determinant of one, so that the corrected field is in microtesla.
    pub fn calibration(&self, unknowns: &Vector13) -> Result<Calibration, SolveError> {
        let parameters = Parameters::new(unknowns);
        let determinant = parameters.w.determinant();
        if !determinant.is_finite() || determinant <= 0.0 {
            return Err(SolveError::NotConverged);
        }
        let b = self.mean - parameters.mean_from_b().ok_or(SolveError::NotConverged)?;
        let per_unit = trig::reciprocal_cbrt(determinant);
        Ok(Calibration {
            w: rows(&(parameters.w * per_unit * self.rotation)),
            b_ut: (self.rotation.tr_mul(&b) * self.unit_ut - self.current.ut(None)).into(),
            inclination_rad: parameters.inclination_rad,
            total_ut: self.unit_ut * per_unit,
            latency_s: self.latency_s,
            current: self.current,
        })
    }
}
