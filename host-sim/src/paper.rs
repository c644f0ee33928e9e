//! The experiment of Liu 2007 section 4 again: the aircraft of table 1 on the ground at pitch zero, tilted to either
//! side, and every method on the same samples.

use autoswing::calibration::{
    Calibration, Mark, Method, Orientation, Prior, Rates, Sample, Samples, SolveError, solve,
};
use autoswing::frames::{Attitude, Field};
use autoswing::instrument::readings_per_sample;
use autoswing::time::WrappingMillis;
use nalgebra::Vector3;
use serde::Serialize;

use crate::random::{Purpose, Random};
use crate::score::{Figures, wrap_180};
use crate::world::airframe::Airframe;
use crate::world::earth::Earth;
use crate::world::rotation::Euler;
use crate::world::table1::{BANK_DEG, Sides};

/// Headings at which errors are shown, 30 deg apart.
pub const HEADINGS: usize = 12;

/// Noise of one LIS3MDL reading on x, y and z, microtesla: ultra-high-performance mode (data sheet, table 2). A sample
/// of the module is the mean of several.
const READING_NOISE_UT: [f64; 3] = [0.32, 0.32, 0.41];

/// A LIS3MDL measures 80 times a second.
const READING_PERIOD_US: u32 = 12_500;

/// Samples and how they are measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Experiment {
    /// Samples on each side, evenly over all headings.
    pub samples: u16,
    /// Seed of the sensor's noise; none: no noise.
    pub noise: Option<u64>,
}

impl Experiment {
    /// The paper's twelve headings on each side, without noise.
    pub const NOISE_FREE: Self = Self { samples: 12, noise: None };

    /// What a long flight gives, with a LIS3MDL.
    #[must_use]
    pub const fn noisy(seed: u64) -> Self {
        Self { samples: 256, noise: Some(seed) }
    }
}

/// Errors of one compensation, degrees, at headings 0, 30, ... 330.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Column {
    /// What was compensated by.
    pub name: &'static str,
    /// Right wing down.
    pub right_deg: [f64; HEADINGS],
    /// Left wing down.
    pub left_deg: [f64; HEADINGS],
}

impl Column {
    /// The figures over both sides.
    #[must_use]
    pub fn figures(&self) -> Figures {
        Figures::of(&[self.right_deg, self.left_deg].concat())
    }

    /// One row.
    #[must_use]
    pub fn sides(&self, row: usize) -> Sides {
        Sides { right_deg: self.right_deg[row], left_deg: self.left_deg[row] }
    }
}

/// The columns of the table: uncompensated, compass swing, four ellipses, two planes, maximum likelihood.
///
/// # Errors
///
/// Why a method has no solution for these samples.
pub fn columns(experiment: Experiment) -> Result<[Column; 5], SolveError> {
    let table = Table { airframe: Airframe::table1(), earth: Earth::default() };
    let (left, right) = table.measure(experiment);
    let sides = Samples { left: &left, right: &right, ..Samples::default() };
    let marks = Table::marks(experiment, &left, &right);
    let swing = Samples { marks: &marks, ..Samples::default() };
    let solved = |name, method, samples| {
        solve(method, samples, &Prior::default()).map(|solution| table.column(name, &solution.calibration))
    };
    Ok([
        table.column("before", &Calibration::uncalibrated(Orientation::NONE)),
        solved("reference", Method::CompassSwing, swing)?,
        solved("four ellipses", Method::FourEllipse, sides)?,
        solved("two planes", Method::TwoPlane, sides)?,
        solved("maximum likelihood", Method::MaximumLikelihood, sides)?,
    ])
}

struct Table {
    airframe: Airframe,
    earth: Earth,
}

impl Table {
    fn sample(&self, roll_deg: f64, heading_rad: f64, noise_ut: Vector3<f64>) -> Sample {
        let truth = Euler { roll_rad: roll_deg.to_radians(), pitch_rad: 0.0, heading_rad };
        let field = self.airframe.measure(&self.earth.body_field_ut(truth));
        let attitude = Attitude::from_deg(roll_deg as f32, 0.0);
        Sample {
            field: Field::new(field.ut + noise_ut.cast()),
            attitude,
            time: WrappingMillis::default(),
            rates: Rates::NONE,
        }
    }

    /// Left and right, each turned the way it would fly.
    fn measure(&self, experiment: Experiment) -> (Vec<Sample>, Vec<Sample>) {
        let mut noise = experiment.noise.map(|seed| Random::new(seed, Purpose::Magnetometer));
        let mut side = |sense: f64| -> Vec<Sample> {
            (0..experiment.samples)
                .map(|i| {
                    let noise_ut = noise.as_mut().map_or_else(Vector3::zeros, |noise| {
                        noise.normal_vector().component_mul(&Vector3::from(READING_NOISE_UT))
                            / f64::from(readings_per_sample(READING_PERIOD_US)).sqrt()
                    });
                    let sample = self.sample(sense * BANK_DEG, sense * heading_rad(i, experiment.samples), noise_ut);
                    Sample { time: WrappingMillis::new(u32::from(i) * 400), ..sample }
                })
                .collect()
        };
        (side(-1.0), side(1.0))
    }

    /// The same samples with their headings, as many of them as the module holds.
    fn marks(experiment: Experiment, left: &[Sample], right: &[Sample]) -> Vec<Mark> {
        let every = usize::from(experiment.samples) / HEADINGS;
        let of = |samples: &[Sample], sense: f64| -> Vec<Mark> {
            (0..experiment.samples)
                .zip(samples)
                .step_by(every)
                .map(|(i, &sample)| {
                    let heading_rad = (sense * heading_rad(i, experiment.samples)) as f32;
                    Mark { sample, heading_rad }
                })
                .collect()
        };
        of(left, -1.0).into_iter().chain(of(right, 1.0)).collect()
    }

    /// Errors at exact field.
    fn column(&self, name: &'static str, calibration: &Calibration) -> Column {
        let error_deg = |roll_deg: f64, row: usize| {
            let heading_rad = heading_rad(row as u16, HEADINGS as u16);
            let exact = self.sample(roll_deg, heading_rad, Vector3::zeros());
            let shown_rad = exact.attitude.level(calibration.apply(exact.field)).heading_rad();
            wrap_180((f64::from(shown_rad) - heading_rad).to_degrees())
        };
        Column {
            name,
            right_deg: std::array::from_fn(|row| error_deg(BANK_DEG, row)),
            left_deg: std::array::from_fn(|row| error_deg(-BANK_DEG, row)),
        }
    }
}

/// The `i`-th of so many headings.
fn heading_rad(i: u16, number: u16) -> f64 {
    f64::from(i) / f64::from(number) * std::f64::consts::TAU
}
