//! Calibration: pure mathematics from samples to the twelve deviation coefficients. No I/O, no clock, no allocation.
//!
//! # From samples to a calibration
//!
//! [`Samples`] of a left and a right turn go in, and a [`Solution`] comes out, or a [`SolveError`] that says what to
//! do: its [`Calibration`] corrects a measured field, its [`Quality`] says how far the headings may be off.
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
//! [`ladder::choose`] says which method samples of another kind support. On a device that has other things to do, a
//! [`Solver`] takes one pass over the samples at a time.
//!
//! # Files
//!
//! | file | holds |
//! |---|---|
//! | `ladder.rs` | which method the samples support |
//! | `solver.rs` | any method, in steps, from samples to a judged calibration |
//! | `level.rs` | level flight: one ellipse, six coefficients |
//! | `four_ellipse.rs` | the method of Liu 2007 |
//! | `two_plane.rs` | closed form from two planes: the start of the refinement |
//! | `compass_swing.rs` | headings given by a person |
//! | `ellipsoid.rs` | tumbling without attitude |
//! | `maximum_likelihood.rs` | refinement with per-sample attitude: the method in use |
//! | `likelihood/` | how likely samples are with a set of coefficients |
//! | `least_squares.rs` | linear least squares in `f32` |
//! | `turns.rs` | what the two closed forms from turns have in common |
//! | `response.rs`, `conic.rs`, `plane.rs` | what the closed forms give and are made of |
//! | `information.rs`, `uncertainty.rs` | what the samples leave unknown, and what that means for a heading |
//! | `correlation.rs` | how alike the errors of neighbouring samples are |
//! | `unevenness.rs` | how much more dips scatter where they tell most |
//! | `roughness.rs` | how much of the norms' scatter is white |
//! | `constancy.rs` | whether the iron stayed what it was: `time_order.rs` merges the parts of a flight for it |
//! | `bank_scale.rs` | whether the attitude source reads all of the bank |
//! | `latency.rs` | how old the attitude is |
//! | `current_iron.rs` | iron that goes with the current |
//! | `rates.rs` | how fast a sample's attitude changes, and its current |
//! | `judgement.rs` | what a result is worth, by all of these |
//! | `expected_error.rs` | the heading error to expect, in degrees |
//! | `advice.rs` | what to fly to make it smaller |
//! | `verification.rs` | a candidate against the incumbent on held-back samples |
//! | `orientation.rs` | the 24 right-angle mountings |

mod advice;
mod bank_scale;
mod compass_swing;
mod conic;
mod constancy;
mod correlation;
mod current_iron;
mod ellipsoid;
mod error;
mod expected_error;
mod four_ellipse;
mod information;
mod judgement;
pub mod ladder;
mod latency;
mod least_squares;
mod level;
mod likelihood;
mod maximum_likelihood;
mod orientation;
mod plane;
mod rates;
mod response;
mod roughness;
mod solver;
mod time_order;
mod turns;
mod two_plane;
mod uncertainty;
mod unevenness;
pub mod verification;

pub use advice::{Advice, Assumed, Manoeuvre, Quarter, Towards};
pub use bank_scale::BankError;
pub use constancy::{Course, IronChange};
pub use current_iron::CurrentIron;
pub(crate) use current_iron::IS_LOOKED_FOR as CURRENT_IS_LOOKED_FOR;
pub use error::SolveError;
pub use expected_error::{Deviation, Envelope};
pub use information::Consider;
pub use judgement::{Doubt, Solution};
pub use likelihood::Prior;
pub use orientation::Orientation;
pub use rates::Rates;
pub use solver::{Progress, Solver, solve};
pub use uncertainty::{HeadingVariance, Uncertainty};
pub(crate) use {advice::NOTICEABLE, least_squares::LeastSquares, plane::Plane};
pub(crate) use {
    likelihood::{Prediction, Row, Squares},
    response::centre,
};

use core::fmt::Debug;

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::frames::{Attitude, Body, Field, Level, Sensor, wrap_pi};
use crate::time::WrappingMillis;

/// One measurement paired with the attitude at its instant: what calibration works on. 28 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Raw field in the chip's axes, microtesla.
    pub field: Field<Sensor>,
    /// Attitude interpolated to the instant of the measurement.
    pub attitude: Attitude,
    /// How fast that changes, and the current that flowed.
    pub rates: Rates,
    /// When it was measured. Only the order and differences within one turn are used.
    pub time: WrappingMillis,
}

impl Sample {
    /// The attitude so many seconds later: that at the instant of the measurement, if the source's is so much older than
    /// it was taken for.
    #[must_use]
    pub fn attitude_after(&self, latency_s: f32) -> Attitude {
        let Attitude { roll_rad, pitch_rad } = self.attitude;
        Attitude {
            roll_rad: wrap_pi(roll_rad + latency_s * self.rates.roll_rad_s()),
            pitch_rad: pitch_rad + latency_s * self.rates.pitch_rad_s(),
        }
    }
}

/// Which way a turn goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// Left wing down, heading decreasing.
    Left,
    /// Right wing down, heading increasing.
    Right,
}

impl Side {
    /// The word for it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// Samples of a flight, each part in the order of time. A part may be empty.
#[derive(Clone, Copy, Debug, Default)]
pub struct Samples<'a> {
    /// Samples of left turns.
    pub left: &'a [Sample],
    /// Samples of right turns.
    pub right: &'a [Sample],
    /// Samples at little bank, at whatever headings.
    pub level: &'a [Sample],
    /// Samples of whatever attitudes, that no turn or side is known of, in any number of pieces.
    pub any: [&'a [Sample]; 3],
    /// Samples whose heading was given.
    pub marks: &'a [Mark],
}

/// A sample at a heading that somebody knows (compass swing). 32 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    /// The sample.
    pub sample: Sample,
    /// Magnetic heading, radians.
    pub heading_rad: f32,
}

/// A part of the [`Samples`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Turns of a side.
    Turns(Side),
    /// Level flight.
    Level,
    /// Headings given by a person.
    Marks,
    /// All of them.
    All,
}

impl Part {
    /// What it is a part of, in the plural.
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

    /// What is done for more of it.
    const fn verb(self) -> &'static str {
        if matches!(self, Self::Turns(_)) { "fly" } else { "take" }
    }
}

impl<'a> Samples<'a> {
    /// The samples without a given heading: left turns, right turns, level flight, any.
    pub fn iter(&self) -> impl Iterator<Item = &'a Sample> + Clone + Debug + use<'a> {
        let [first, second, third] = self.any;
        Pieces { now: self.left.iter(), others: [self.right, self.level, first, second, third], begun: 0 }
    }

    /// All samples: those without a given heading, then those of the marks.
    pub fn all(&self) -> impl Iterator<Item = &'a Sample> + Clone + Debug + use<'a> {
        self.iter().chain(self.marks.iter().map(|mark| &mark.sample))
    }

    /// How many are of whatever was flown.
    pub(crate) fn number_of_any(&self) -> usize {
        self.any.iter().map(|piece| piece.len()).sum()
    }

    /// Whether any are of whatever was flown.
    pub(crate) fn has_any(&self) -> bool {
        self.number_of_any() > 0
    }
}

/// Samples of several pieces, one after the other. A chain of iterators would be as many tests for every sample, and
/// be written out wherever samples are gone through.
#[derive(Clone, Debug)]
struct Pieces<'a> {
    now: core::slice::Iter<'a, Sample>,
    others: [&'a [Sample]; 5],
    /// How many of the others have been begun.
    begun: usize,
}

impl<'a> Pieces<'a> {
    #[inline(never)]
    fn begin_next(&mut self) -> Option<&'a Sample> {
        while let Some(piece) = self.others.get(self.begun) {
            self.begun += 1;
            self.now = piece.iter();
            if let Some(sample) = self.now.next() {
                return Some(sample);
            }
        }
        None
    }
}

impl<'a> Iterator for Pieces<'a> {
    type Item = &'a Sample;

    fn next(&mut self) -> Option<Self::Item> {
        match self.now.next() {
            Some(sample) => Some(sample),
            None => self.begin_next(),
        }
    }
}

/// The twelve deviation coefficients, with the Earth field they were found in.
///
/// Liu 2007 eq. 8 solved for the field: `h_body = W (m - b)`, `W = A^-1`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// `W`, row-major, dimensionless, normalised to determinant 1: takes the field less hard iron from the chip's axes
    /// to the body frame. Holds soft iron, scale, non-orthogonality and mounting.
    pub w: [[f32; 3]; 3],
    /// `b`, microtesla, chip axes: hard iron and zero offset, where no current flows.
    pub b_ut: [f32; 3],
    /// Inclination of the Earth field the calibration was found in, radians, positive down.
    pub inclination_rad: f32,
    /// Total intensity of the corrected field in the scale of `w`, microtesla.
    pub total_ut: f32,
    /// How much older the attitude is than the attitude source's own latency says, seconds, as far as it is used: the
    /// attitude of a field is that of so much later. Nothing where it is not used.
    pub latency_s: f32,
    /// What a current adds to the field as it is measured. The store has it behind the calibrations, which have been there
    /// longer.
    #[serde(skip)]
    pub current: CurrentIron,
}

impl Calibration {
    /// No iron at all, only a mounting: what an uncalibrated module would show.
    #[must_use]
    pub fn uncalibrated(mount: Orientation) -> Self {
        let rotation = mount.body_from_sensor();
        Self {
            w: rows(&rotation),
            b_ut: [0.0; 3],
            inclination_rad: 0.0,
            total_ut: 0.0,
            latency_s: 0.0,
            current: CurrentIron::NONE,
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

    /// The corrected field in the body frame, `W (m - b)` (Liu 2007 eq. 8), microtesla, where no current flows: see
    /// [`without_current`](Self::without_current).
    #[must_use]
    pub fn apply(&self, sensor: Field<Sensor>) -> Field<Body> {
        let from_b = sensor.ut - self.b_vector_ut();
        // Row by row, which a small processor's compiler makes straight code of.
        let [x, y, z] = self.w.map(|[wx, wy, wz]| wx * from_b.x + wy * from_b.y + wz * from_b.z);
        Field::from_ut(x, y, z)
    }

    /// The corrected field of a sample in the level frame, microtesla: by its attitude as it is with this calibration's
    /// latency, without what its current added.
    #[must_use]
    pub fn level(&self, sample: &Sample) -> Field<Level> {
        sample.attitude_after(self.latency_s).level(self.body(sample))
    }

    /// Whether the inclination is known: tumbling without one that was told leaves it at nothing, which is what a solver
    /// assumes before any sample.
    #[must_use]
    pub fn knows_inclination(&self, method: Method) -> bool {
        /// What rounding leaves of nothing, and less than any inclination that is told.
        const NOTHING_RAD: f32 = 1e-6;
        method != Method::Ellipsoid || self.inclination_rad.abs() > NOTHING_RAD
    }

    /// Whether every coefficient is a finite number: asked of whatever comes out of flash or of a solver.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.w.as_flattened().iter().chain(&self.b_ut).all(|c| c.is_finite())
            && [self.inclination_rad, self.total_ut, self.latency_s].iter().all(|number| number.is_finite())
            && self.current.is_finite()
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
    /// Its letter.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
        }
    }
}

/// How a calibration was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Method {
    /// One ellipse, from level flight.
    Level,
    /// The method of Liu 2007, from a left and a right turn.
    FourEllipse,
    /// Closed form from the planes of a left and a right turn.
    TwoPlane,
    /// Maximum likelihood with per-sample attitude.
    MaximumLikelihood,
    /// Headings given by a person.
    CompassSwing,
    /// Tumbling without attitude.
    Ellipsoid,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 6] =
        [Self::Level, Self::FourEllipse, Self::TwoPlane, Self::MaximumLikelihood, Self::CompassSwing, Self::Ellipsoid];

    /// The name shown to people and in JSON, and typed after `cal solve`.
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

    /// The method of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name)
    }

    /// Whether its closed form, if it has one, only starts a refinement.
    const fn is_refined(self) -> bool {
        matches!(self, Self::MaximumLikelihood | Self::CompassSwing | Self::Ellipsoid)
    }
}

/// How good a calibration is expected to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// How it was found.
    pub method: Method,
    /// Where it is meant to be used, and its error expected.
    pub envelope: Envelope,
    /// Expected heading error, RMS over the envelope, degrees (1 sigma).
    pub expected_rms_deg: f32,
    /// Expected heading error (1 sigma) at the worst heading and bank of the envelope, degrees.
    pub expected_worst_deg: f32,
    /// Robust scale of `|h| / F - 1` over the samples of the fit, dimensionless.
    pub norm_residual: f32,
    /// Robust scale of the inclination residual over the samples of the fit, degrees.
    pub dip_residual_deg: f32,
    /// Samples of the fit.
    pub samples: u16,
    /// How old the samples show the attitude to be; none where they say nothing of it.
    pub latency: Option<Latency>,
}

/// How much older the attitude is than the attitude source's own latency says, as samples show it. Negative: it is
/// younger, or the field older.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Latency {
    /// The most likely one, seconds.
    pub found_s: f32,
    /// Its standard deviation, seconds.
    pub sigma_s: f32,
}

impl Quality {
    /// Whether all twelve coefficients were found, mounting included, and not only what shows at some attitudes.
    #[must_use]
    pub fn is_of_everything(&self) -> bool {
        self.envelope == Envelope::Banked && self.method != Method::Ellipsoid
    }
}

/// The inverse of a matrix, if it has one. One place for all of them: each of its own would be half a kilobyte of flash.
#[inline(never)]
pub(crate) fn inverse(m: &Matrix3<f32>) -> Option<Matrix3<f32>> {
    m.try_inverse()
}

/// A matrix as an array of rows.
pub(crate) fn rows(m: &Matrix3<f32>) -> [[f32; 3]; 3] {
    core::array::from_fn(|row| core::array::from_fn(|column| m[(row, column)]))
}

#[cfg(test)]
pub(crate) mod tests;
