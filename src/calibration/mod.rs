//! Calibration: pure functions from samples to the twelve deviation coefficients. No I/O, no clock, no allocation.
//!
//! # From samples to a calibration
//!
//! Input: [`Samples`] of a left and a right turn. Output: a [`Solution`], whose [`Calibration`] corrects a measured
//! field and whose [`Quality`] holds the expected heading error, or a [`SolveError`].
//!
//! ```
//! use std::f32::consts::TAU;
//!
//! use autoswing::calibration::{Method, Prior, Rates, Sample, Samples, solve};
//! use autoswing::frames::{Attitude, Field, wrap_pi};
//! use autoswing::time::WrappingMillis;
//!
//! // In place of a sensor: the Earth's field of 50 uT and 60 deg of inclination, bent by the iron of an airframe.
//! let measure = |attitude: Attitude, heading_rad: f32| {
//!     let earth = Field::earth(50.0, 60_f32.to_radians(), heading_rad);
//!     let body = attitude.body(earth).ut;
//!     Field::from_ut(
//!         1.10 * body.x + 0.04 * body.y + 12.0,
//!         0.93 * body.y - 0.05 * body.z - 8.0,
//!         0.02 * body.x + 1.01 * body.z + 20.0,
//!     )
//! };
//!
//! // A full circle of 60 samples in half a minute, at 25 deg of bank to the left or to the right.
//! let circle = |bank_deg: f32| -> Vec<Sample> {
//!     (0..60)
//!         .map(|i| {
//!             let attitude = Attitude::from_deg(bank_deg, 2.0);
//!             let heading_rad = bank_deg.signum() * TAU * i as f32 / 60.0;
//!             let (field, time) = (measure(attitude, heading_rad), WrappingMillis::new(i * 500));
//!             Sample { field, attitude, rates: Rates::NONE, time }
//!         })
//!         .collect()
//! };
//! let (left, right) = (circle(-25.0), circle(25.0));
//! let samples = Samples { left: &left, right: &right, ..Samples::default() };
//!
//! let solution = solve(Method::MaximumLikelihood, samples, &Prior::default())?;
//! assert!(solution.quality.expected_rms_deg < 1.0);
//!
//! // From then on: the field of a reading, corrected, levelled by the attitude at its instant, shows the heading.
//! let (attitude, heading_rad) = (Attitude::from_deg(10.0, -3.0), 1.2);
//! let corrected = solution.calibration.apply(measure(attitude, heading_rad));
//! let error_rad = wrap_pi(attitude.level(corrected).heading_rad() - heading_rad);
//! assert!(error_rad.abs().to_degrees() < 0.1, "{error_rad} rad");
//! # Ok::<(), autoswing::calibration::SolveError>(())
//! ```
//!
//! The method-selection module chooses the method that the samples support. On a device with other work to do, a
//! [`Solver`] makes one pass over the samples at a time.
//!
//! # Files
//!
//! - samples: `rates` (attitude rates, current), `time_order`, `orientation` (the 24 right-angle mountings)
//! - closed forms, starting points: `level`, `four_ellipse`, `two_plane`, `compass_swing`, `response`; shared: `turns`,
//!   `conic`, `plane`
//! - statistical model, refinement: `likelihood/`, `maximum_likelihood`, `ellipsoid`, `least_squares`
//! - sandwich covariance: `information`, `correlation` (lag-1), `unevenness` (heteroscedasticity), `roughness` (white
//!   noise), `uncertainty` (of headings)
//! - systematic errors: `constancy` (hard-iron change), `bank_scale`, `latency`, `current_iron` (motor current)
//! - control, results: `ladder` (choice of method), `solver`, `judgement`, `expected_error`, `advice`, `verification`,
//!   `error`

mod advice;
mod attitude_latency;
mod autocorrelation;
mod bank_scale;
mod compass_swing;
mod conic;
mod ellipsoid;
mod error;
mod expected_error;
mod four_ellipse;
mod hard_iron_change;
mod heteroscedasticity;
mod information;
mod least_squares;
mod level_ellipse;
mod likelihood;
mod maximum_likelihood;
pub mod method_selection;
mod motor_current;
mod orientation;
mod principal_plane;
mod rates;
mod solution;
mod solver;
mod starting_point;
mod time_order;
mod turns;
mod two_plane;
mod uncertainty;
pub mod verification;
mod white_noise_fraction;

pub use advice::{Advice, HeadingQuadrant, Manoeuvre, NOTICEABLE_ERROR_RATIO, TiltDirection, UnobservableQuantities};
pub use bank_scale::BankScaleFinding;
pub use error::SolveError;
pub use expected_error::{Deviation, Envelope};
pub use hard_iron_change::{DetectedHardIronChange, HardIronTimeCourse};
pub use information::ConsiderSigmas;
pub use likelihood::Prior;
pub use motor_current::MotorCurrentInterference;
pub use orientation::Orientation;
pub use rates::Rates;
pub use solution::{Finding, Solution};
pub use solver::{SolveProgress, Solver, solve};
pub use uncertainty::{HeadingUncertainty, HeadingVariance};
pub(crate) use {least_squares::LeastSquares, principal_plane::PrincipalPlane};
pub(crate) use {
    likelihood::{FieldPrediction, InformationMatrix, JacobianRow},
    starting_point::fit_sphere,
};

use core::fmt::Debug;

use nalgebra::{Matrix3, Vector3};

use crate::frames::{Attitude, Body, Field, Level, Sensor, wrap_pi};
use crate::time::WrappingMillis;

/// A field measurement with the attitude at its time: the input of calibration. 28 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Raw field, chip axes, microtesla.
    pub field: Field<Sensor>,
    /// Attitude interpolated to the time of the measurement.
    pub attitude: Attitude,
    /// Attitude rates and motor current.
    pub rates: Rates,
    /// Time of the measurement. Only order and differences within one turn are used.
    pub time: WrappingMillis,
}

impl Sample {
    /// Attitude extrapolated by `latency_s` seconds along its rates: compensates an attitude source that lags by that
    /// time.
    #[must_use]
    pub fn latency_compensated_attitude(&self, latency_s: f32) -> Attitude {
        let Attitude { roll_rad, pitch_rad } = self.attitude;
        Attitude {
            roll_rad: wrap_pi(roll_rad + latency_s * self.rates.roll_rad_s()),
            pitch_rad: pitch_rad + latency_s * self.rates.pitch_rad_s(),
        }
    }
}

/// Direction of a turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Side {
    /// Left wing down, heading decreasing.
    Left,
    /// Right wing down, heading increasing.
    Right,
}

impl Side {
    /// Lower-case English name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// Samples of a flight. Each part is ordered by time and may be empty.
#[derive(Clone, Copy, Debug, Default)]
pub struct Samples<'a> {
    /// Samples of left turns.
    pub left: &'a [Sample],
    /// Samples of right turns.
    pub right: &'a [Sample],
    /// Samples at small bank, all headings.
    pub level: &'a [Sample],
    /// Samples of arbitrary attitude, not assigned to a turn; up to three slices.
    pub unassigned: [&'a [Sample]; 3],
    /// Samples with a given heading.
    pub marks: &'a [Mark],
}

/// A sample with a known heading (compass swing). 32 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    /// The sample.
    pub sample: Sample,
    /// Magnetic heading, radians.
    pub heading_rad: f32,
}

/// A part of the [`Samples`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SamplePart {
    /// Turns of a side.
    Turns(Side),
    /// Level flight.
    Level,
    /// Samples with given headings.
    Marks,
    /// All parts.
    All,
}

impl SamplePart {
    /// English name, plural.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Turns(Side::Left) => "left turns",
            Self::Turns(Side::Right) => "right turns",
            Self::Level => "level headings",
            Self::Marks => "marks",
            Self::All => "all attitudes",
        }
    }
}

impl<'a> Samples<'a> {
    /// Iterates over the samples without a given heading: left turns, right turns, level flight, arbitrary attitudes.
    pub fn iter(&self) -> impl Iterator<Item = &'a Sample> + Clone + Debug + use<'a> {
        let [first, second, third] = self.unassigned;
        SliceChain {
            current_slice: self.left.iter(),
            next_slices: [self.right, self.level, first, second, third],
            started_slices: 0,
        }
    }

    /// Iterates over all samples, those with given headings last.
    pub fn all(&self) -> impl Iterator<Item = &'a Sample> + Clone + Debug + use<'a> {
        self.iter().chain(self.marks.iter().map(|mark| &mark.sample))
    }

    pub(crate) fn unassigned_count(&self) -> usize {
        self.unassigned.iter().map(|piece| piece.len()).sum()
    }

    pub(crate) fn has_unassigned(&self) -> bool {
        self.unassigned_count() > 0
    }
}

/// Iterator over six slices. `Iterator::chain` would test each level of nesting for every sample.
#[derive(Clone, Debug)]
struct SliceChain<'a> {
    current_slice: core::slice::Iter<'a, Sample>,
    next_slices: [&'a [Sample]; 5],
    started_slices: usize,
}

impl<'a> SliceChain<'a> {
    fn start_next_slice(&mut self) -> Option<&'a Sample> {
        while let Some(piece) = self.next_slices.get(self.started_slices) {
            self.started_slices += 1;
            self.current_slice = piece.iter();
            if let Some(sample) = self.current_slice.next() {
                return Some(sample);
            }
        }
        None
    }
}

impl<'a> Iterator for SliceChain<'a> {
    type Item = &'a Sample;

    fn next(&mut self) -> Option<Self::Item> {
        match self.current_slice.next() {
            Some(sample) => Some(sample),
            None => self.start_next_slice(),
        }
    }
}

/// The twelve deviation coefficients and the Earth field of the fit.
///
/// Liu 2007 eq. 8 solved for the field: `h_body = W (m - b)`, `W = A^-1`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Calibration {
    /// `W`, row-major, dimensionless, determinant 1: maps the field minus hard iron from chip axes to the body frame.
    /// Contains soft iron, scale, non-orthogonality and mounting.
    pub w: [[f32; 3]; 3],
    /// `b`, microtesla, chip axes: hard iron and zero offset at zero motor current.
    pub b_ut: [f32; 3],
    /// Inclination of the Earth field of the fit, radians, positive down.
    pub inclination_rad: f32,
    /// Strength of the corrected field in the scale of `w`, microtesla.
    pub total_ut: f32,
    /// Attitude latency beyond the nominal latency of the attitude source, seconds; 0 if not applied.
    pub latency_s: f32,
    /// Motor-current interference in the measured field.
    pub motor_current: MotorCurrentInterference,
}

impl Calibration {
    /// Calibration with the mounting only: no hard iron, no soft iron.
    #[must_use]
    pub fn uncalibrated(mount: Orientation) -> Self {
        let rotation = mount.body_from_sensor();
        Self {
            w: matrix_rows(&rotation),
            b_ut: [0.0; 3],
            inclination_rad: 0.0,
            total_ut: 0.0,
            latency_s: 0.0,
            motor_current: MotorCurrentInterference::NONE,
        }
    }

    /// `W` as a matrix.
    #[must_use]
    pub fn w_matrix(&self) -> Matrix3<f32> {
        Matrix3::from_fn(|row, column| self.w[row][column])
    }

    /// `b` as a vector, microtesla.
    #[must_use]
    pub fn b_vector_ut(&self) -> Vector3<f32> {
        Vector3::from(self.b_ut)
    }

    /// Corrected field in the body frame, `W (m - b)` (Liu 2007 eq. 8), microtesla. The motor-current interference must
    /// already be removed.
    #[must_use]
    pub fn apply(&self, sensor: Field<Sensor>) -> Field<Body> {
        let from_b = sensor.ut - self.b_vector_ut();
        // Scalar expressions: on a Cortex-M4 they compile to straight-line code.
        let [x, y, z] = self.w.map(|[wx, wy, wz]| wx * from_b.x + wy * from_b.y + wz * from_b.z);
        Field::from_ut(x, y, z)
    }

    /// Corrected field of a sample in the level frame, microtesla, with attitude latency and motor current compensated.
    #[must_use]
    pub fn corrected_level_field(&self, sample: &Sample) -> Field<Level> {
        sample.latency_compensated_attitude(self.latency_s).level(self.corrected_body_field(sample))
    }

    /// Whether the inclination is known. The ellipsoid method without a configured inclination leaves it at the start
    /// value of 0.
    #[must_use]
    pub fn knows_inclination(&self, method: Method) -> bool {
        /// Bound on the rounding error of an inclination of 0; smaller than any configured inclination.
        const ZERO_TOLERANCE_RAD: f32 = 1e-6;
        method != Method::Ellipsoid || self.inclination_rad.abs() > ZERO_TOLERANCE_RAD
    }

    /// Whether all coefficients are finite: check for data from flash or from a solver.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.w.as_flattened().iter().chain(&self.b_ut).all(|c| c.is_finite())
            && [self.inclination_rad, self.total_ut, self.latency_s].iter().all(|number| number.is_finite())
            && self.motor_current.is_finite()
    }
}

/// An axis of the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// x.
    X,
    /// y.
    Y,
    /// z.
    Z,
}

impl Axis {
    /// Lower-case letter of the axis.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
        }
    }
}

/// Calibration method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Method {
    /// One ellipse from level flight.
    Level,
    /// The method of Liu 2007 from a left and a right turn.
    FourEllipse,
    /// Closed form from the planes of a left and a right turn.
    TwoPlane,
    /// Maximum likelihood with per-sample attitude.
    MaximumLikelihood,
    /// Regression on given headings.
    CompassSwing,
    /// Tumbling without attitude.
    Ellipsoid,
}

impl Method {
    /// All methods.
    pub const ALL: [Self; 6] =
        [Self::Level, Self::FourEllipse, Self::TwoPlane, Self::MaximumLikelihood, Self::CompassSwing, Self::Ellipsoid];

    /// Name shown to users, in JSON and in `cal solve`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Level => "level",
            Self::FourEllipse => "four-ellipse",
            Self::TwoPlane => "two-plane",
            Self::MaximumLikelihood => "maximum-likelihood",
            Self::CompassSwing => "compass-swing",
            Self::Ellipsoid => "ellipsoid",
        }
    }

    /// Parses a method name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name)
    }

    /// Whether an iterative refinement follows the closed form.
    const fn is_refined(self) -> bool {
        matches!(self, Self::MaximumLikelihood | Self::CompassSwing | Self::Ellipsoid)
    }
}

/// Expected quality of a calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Quality {
    /// Method of the solution.
    pub method: Method,
    /// Attitudes for which the error is expected.
    pub envelope: Envelope,
    /// Expected heading error (1 sigma), RMS over the envelope, degrees.
    pub expected_rms_deg: f32,
    /// Expected heading error (1 sigma) at the worst heading and bank of the envelope, degrees.
    pub expected_worst_deg: f32,
    /// Robust scale of the norm residual `|h| / F - 1`, dimensionless.
    pub norm_residual: f32,
    /// Robust scale of the inclination residual, degrees.
    pub inclination_residual_deg: f32,
    /// Number of samples in the fit.
    pub samples: u16,
    /// Estimated attitude latency; `None` if unobservable.
    pub latency: Option<AttitudeLatency>,
}

/// Estimated attitude latency beyond the nominal latency of the attitude source. Negative: the attitude is newer than
/// assumed, or the field older.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct AttitudeLatency {
    /// Maximum-likelihood estimate, seconds.
    pub estimate_s: f32,
    /// Standard deviation, seconds.
    pub sigma_s: f32,
}

impl Quality {
    /// Whether all twelve coefficients, mounting included, were determined.
    #[must_use]
    pub fn determines_all_coefficients(&self) -> bool {
        self.envelope == Envelope::Banked && self.method != Method::Ellipsoid
    }
}

/// Inverse of a 3x3 matrix, if it is regular.
pub(crate) fn inverse(m: &Matrix3<f32>) -> Option<Matrix3<f32>> {
    m.try_inverse()
}

pub(crate) fn matrix_rows(m: &Matrix3<f32>) -> [[f32; 3]; 3] {
    core::array::from_fn(|row| core::array::from_fn(|column| m[(row, column)]))
}

#[cfg(test)]
pub(crate) mod tests;
