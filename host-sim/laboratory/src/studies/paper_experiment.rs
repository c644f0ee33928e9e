//! Reproduction of the experiment in Liu 2007 section 4: the aircraft of table 1 at pitch zero, banked to either side,
//! with all methods on the same samples.

use autoswing::calibration::{
    Calibration, CollectionPart, HeadingMark, Method, Orientation, Prior, Sample, Samples, SolveError, solve_samples,
};
use autoswing::frames::{Field, RollPitch};
use autoswing::instrument::readings_per_sample;
use autoswing::time::WrappingMillis;
use nalgebra::Vector3;

use log_analysis::score::wrap_180;
use simulator::random::{RandomStream, StreamPurpose};
use simulator::world::airframe::Airframe;
use simulator::world::earth::Earth;
use simulator::world::published_table1::{EXPERIMENT_BANK_DEG, HEADING_COUNT, MethodErrors};
use simulator::world::rotation::Euler;

/// Noise of one LIS3MDL measurement on x, y and z, microtesla: ultra-high-performance mode (data sheet, table 2). A
/// module sample averages several measurements.
const READING_NOISE_UT: [f64; 3] = [0.32, 0.32, 0.41];

/// Measurement period at 80 Hz, microseconds.
const READING_PERIOD_US: u32 = 12_500;

/// Settings of the experiment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperExperiment {
    /// Samples per side, uniform over all headings.
    pub samples_per_side: u16,
    /// Seed of the sensor noise; `None` for no noise.
    pub noise_seed: Option<u64>,
}

impl PaperExperiment {
    /// The paper's twelve headings per side, without noise.
    pub const NOISE_FREE: Self = Self { samples_per_side: 12, noise_seed: None };

    /// As many samples as a long flight provides, with the noise of a LIS3MDL.
    #[must_use]
    pub const fn noisy_experiment(seed: u64) -> Self {
        Self { samples_per_side: 256, noise_seed: Some(seed) }
    }
}

/// Table columns: uncompensated, compass swing, four ellipses, two planes, maximum likelihood.
///
/// # Errors
///
/// The error of a method without a solution.
pub fn method_errors(experiment: PaperExperiment) -> Result<[MethodErrors; 5], SolveError> {
    let table = Table1Experiment { airframe: Airframe::of_table1(), earth: Earth::default() };
    let (left_turns, right_turns) = table.measure_turns(experiment);
    let mut turns = [&left_turns[..], &right_turns].concat();
    // At equal times in an arbitrary order, so that every other sample is not of one side.
    turns.sort_by_key(|sample| (sample.time.as_ms(), sample.field.ut.x.to_bits().reverse_bits()));
    let samples_by_side = Samples::new(&turns);
    let marks = Table1Experiment::heading_marks(experiment, &left_turns, &right_turns);
    let swing = Samples::default().with_marks(&marks);
    let solved_errors = |name, method, samples| {
        solve_samples(method, samples, &Prior::default())
            .map(|solution| table.errors_column(name, &solution.calibration))
    };
    Ok([
        table.errors_column("before", &Calibration::uncalibrated(Orientation::IDENTITY_ROTATION)),
        solved_errors("reference", Method::CompassSwing, swing)?,
        solved_errors("four ellipses", Method::FourEllipse, samples_by_side)?,
        solved_errors("two planes", Method::TwoPlane, samples_by_side)?,
        solved_errors("maximum likelihood", Method::MaximumLikelihood, samples_by_side)?,
    ])
}

struct Table1Experiment {
    airframe: Airframe,
    earth: Earth,
}

impl Table1Experiment {
    fn simulated_sample(&self, roll_deg: f64, heading_rad: f64, noise_ut: Vector3<f64>) -> Sample {
        let truth = Euler { roll_rad: roll_deg.to_radians(), pitch_rad: 0.0, heading_rad };
        let field = self.airframe.measured_field(&self.earth.body_field_ut(truth));
        let attitude = RollPitch::from_deg(roll_deg as f32, 0.0);
        Sample::new(Field::new(field.ut + noise_ut.cast()), attitude)
    }

    /// Left and right turns, each in the direction of flight.
    fn measure_turns(&self, experiment: PaperExperiment) -> (Vec<Sample>, Vec<Sample>) {
        let mut noise = experiment.noise_seed.map(|seed| RandomStream::new(seed, StreamPurpose::Magnetometer));
        let mut turn_samples = |sign: f64, collection_part: CollectionPart| -> Vec<Sample> {
            (0..experiment.samples_per_side)
                .map(|i| {
                    let noise_ut = noise.as_mut().map_or_else(Vector3::zeros, |noise| {
                        noise.normal_vector().component_mul(&Vector3::from(READING_NOISE_UT))
                            / f64::from(readings_per_sample(READING_PERIOD_US)).sqrt()
                    });
                    let sample = self.simulated_sample(
                        sign * EXPERIMENT_BANK_DEG,
                        sign * heading_rad(i, experiment.samples_per_side),
                        noise_ut,
                    );
                    Sample { time: WrappingMillis::new(u32::from(i) * 400), part: collection_part, ..sample }
                })
                .collect()
        };
        (turn_samples(-1.0, CollectionPart::LEFT), turn_samples(1.0, CollectionPart::RIGHT))
    }

    /// A subset of the samples with known headings, limited to the module's capacity.
    fn heading_marks(experiment: PaperExperiment, left_turns: &[Sample], right_turns: &[Sample]) -> Vec<HeadingMark> {
        let sample_stride = usize::from(experiment.samples_per_side) / HEADING_COUNT;
        let marks_of_turn = |samples: &[Sample], turn_sign: f64| -> Vec<HeadingMark> {
            (0..experiment.samples_per_side)
                .zip(samples)
                .step_by(sample_stride)
                .map(|(i, &sample)| {
                    let heading_rad = (turn_sign * heading_rad(i, experiment.samples_per_side)) as f32;
                    HeadingMark { sample, heading_rad }
                })
                .collect()
        };
        marks_of_turn(left_turns, -1.0).into_iter().chain(marks_of_turn(right_turns, 1.0)).collect()
    }

    fn errors_column(&self, name: &'static str, calibration: &Calibration) -> MethodErrors {
        let error_deg = |roll_deg: f64, row: usize| {
            let heading_rad = heading_rad(row as u16, HEADING_COUNT as u16);
            let noise_free_sample = self.simulated_sample(roll_deg, heading_rad, Vector3::zeros());
            let indicated_heading_rad = noise_free_sample
                .attitude
                .to_level_frame(calibration.calibrated_field(noise_free_sample.field))
                .heading_rad();
            wrap_180((f64::from(indicated_heading_rad) - heading_rad).to_degrees())
        };
        MethodErrors {
            name,
            right_deg: std::array::from_fn(|row| error_deg(EXPERIMENT_BANK_DEG, row)),
            left_deg: std::array::from_fn(|row| error_deg(-EXPERIMENT_BANK_DEG, row)),
        }
    }
}

/// Heading `index` of `heading_count` equally spaced ones.
fn heading_rad(index: u16, heading_count: u16) -> f64 {
    f64::from(index) / f64::from(heading_count) * std::f64::consts::TAU
}
