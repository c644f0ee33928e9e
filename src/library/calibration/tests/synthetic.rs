//! Synthetic turns: a small sensor model for unit tests, independent of the host simulator. The unit tests of
//! `autoswing-module` and `autoswing-firmware` include this file, too.

use core::f32::consts::TAU;

use nalgebra::{Matrix3, Rotation3, Vector3};
pub use testkit::random::Random;

use autoswing::calibration::{
    AngleRates, AttitudeEnvelope, Calibration, CollectionPart, HeadingMark, Method, Orientation, Quality, Sample,
    Samples, Solution,
};
use autoswing::frames::{Field, Level, RollPitch, Sensor, wrap_pi};
use autoswing::time::WrappingMillis;

/// Mounting of a sensor turned by 90 deg: sensor x is body y, sensor y is body -x.
pub const YAW_90: Matrix3<f32> = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);

pub fn random_vector(random: &mut Random, bound: f32) -> Vector3<f32> {
    Vector3::from_fn(|_, _| random.uniform(-bound, bound))
}

struct GaussMarkov {
    sigma: f32,
    correlation: f32,
    value: f32,
}

impl GaussMarkov {
    fn new(random: &mut Random, sigma: f32, tau_s: f32, step_s: f32) -> Self {
        Self { sigma, correlation: (-step_s / tau_s).exp(), value: sigma * random.normal() }
    }

    fn next_value(&mut self, random: &mut Random) -> f32 {
        self.value = self.correlation * self.value
            + self.sigma * (1.0 - self.correlation * self.correlation).sqrt() * random.normal();
        self.value
    }
}

#[derive(Clone, Copy, Debug)]
pub struct Airframe {
    pub a: Matrix3<f32>,
    pub b_ut: Vector3<f32>,
    pub total_ut: f32,
    pub inclination_rad: f32,
}

impl Airframe {
    /// Hard iron alone, in a field of 50 uT and 54 deg of inclination.
    pub fn with_hard_iron(b_ut: [f32; 3]) -> Self {
        Self { a: Matrix3::identity(), b_ut: b_ut.into(), total_ut: 50.0, inclination_rad: 0.94 }
    }

    /// Random soft iron up to `soft` (relative), hard iron up to `hard` H0, mounting error up to `mount_deg`.
    pub fn random(random: &mut Random, soft: f32, hard: f32, mount_deg: f32, inclination_deg: [f32; 2]) -> Self {
        let inclination_rad = random.uniform(inclination_deg[0], inclination_deg[1]).to_radians();
        let total_ut = random.uniform(40.0, 60.0);
        let half = Matrix3::from_fn(|_, _| random.uniform(-soft, soft));
        let axis = nalgebra::Unit::new_normalize(random_vector(random, 1.0));
        let turn = Rotation3::from_axis_angle(&axis, random.uniform(0.0, mount_deg).to_radians());
        let soft_iron = (half + half.transpose()) / 2.0;
        let h0_ut = total_ut * inclination_rad.cos();
        let direction = random_vector(random, 1.0).normalize();
        Self {
            a: turn.matrix() * (Matrix3::identity() + soft_iron),
            b_ut: direction * h0_ut * random.uniform(0.0, hard),
            total_ut,
            inclination_rad,
        }
    }

    /// Random numbers of a seed, and the [random airframe](Self::random) of the first ones.
    pub fn seeded(seed: u64, soft: f32, hard: f32, mount_deg: f32, inclination_deg: [f32; 2]) -> (Random, Self) {
        let mut random = Random(seed);
        let airframe = Self::random(&mut random, soft, hard, mount_deg, inclination_deg);
        (random, airframe)
    }

    pub fn field(&self, attitude: RollPitch, heading_rad: f32) -> Field<Sensor> {
        let level = Field::<Level>::earth_field(self.total_ut, self.inclination_rad, heading_rad);
        Field::new(self.a * attitude.to_body_frame(level).ut + self.b_ut)
    }

    /// Heading errors at exact field and attitude, degrees: twelve headings at 0, 25 and -25 deg of bank.
    pub fn errors_deg(&self, calibration: &Calibration) -> Vec<f32> {
        self.errors_at_deg(calibration, &[0.0, 25.0, -25.0])
    }

    pub fn rms_error_deg(&self, calibration: &Calibration) -> f32 {
        rms(&self.errors_deg(calibration))
    }

    /// Ratio of actual to expected heading error; ideally of RMS 1.
    pub fn error_ratio(&self, solution: &Solution) -> f32 {
        self.rms_error_deg(&solution.calibration) / solution.quality.expected_rms_deg
    }

    /// Asserts that the heading error is within three times the expected error, as promised for every solution.
    #[track_caller]
    pub fn assert_expected_error_is_honest(&self, solution: &Solution, label: impl core::fmt::Display) {
        let (ratio, expected_deg) = (self.error_ratio(solution), solution.quality.expected_rms_deg);
        assert!(ratio < 3.0, "{label}: {ratio} times the expected error of {expected_deg} deg");
    }

    pub fn errors_at_deg(&self, calibration: &Calibration, banks_deg: &[f32]) -> Vec<f32> {
        let mut errors = Vec::new();
        for &bank_deg in banks_deg {
            for step in 0..12_u8 {
                let heading_rad = f32::from(step) * core::f32::consts::FRAC_PI_6;
                let attitude = RollPitch::from_deg(bank_deg, 0.0);
                let found = attitude
                    .to_level_frame(calibration.calibrated_field(self.field(attitude, heading_rad)))
                    .heading_rad();
                errors.push(wrap_pi(found - heading_rad).to_degrees());
            }
        }
        errors
    }
}

pub fn measured_sample(
    airframe: &Airframe,
    attitude: RollPitch,
    heading_rad: f32,
    noise_ut: f32,
    random: &mut Random,
) -> Sample {
    let noise = Vector3::from_fn(|_, _| random.normal() * noise_ut);
    Sample::new(Field::new(airframe.field(attitude, heading_rad).ut + noise), attitude)
}

/// Full circle at constant bank and zero pitch without noise, as the paper assumes: turns follow the bank, 0.5 s apart.
pub fn exact_circle(airframe: &Airframe, bank_deg: f32, sample_count: u16) -> Vec<Sample> {
    let step_rad = TAU.copysign(bank_deg) / f32::from(sample_count);
    exact_turn(airframe, bank_deg, step_rad, sample_count)
}

/// Samples without noise 0.5 s apart, with the heading changed by a step after each.
pub fn exact_turn(airframe: &Airframe, bank_deg: f32, step_rad: f32, sample_count: u16) -> Vec<Sample> {
    let attitude = RollPitch::from_deg(bank_deg, 0.0);
    (0..sample_count)
        .map(|i| {
            let sample = measured_sample(airframe, attitude, f32::from(i) * step_rad, 0.0, &mut Random(0));
            Sample { time: WrappingMillis::new(u32::from(i) * 500), ..sample }
        })
        .collect()
}

/// Marks of a compass swing at evenly spaced headings, one round for each bank, with 0.05 uT of sensor noise. Each
/// heading is known to 0.5 deg.
pub fn swing_marks(
    airframe: &Airframe,
    marks_per_round: u8,
    banks_deg: &[f32],
    random: &mut Random,
) -> Vec<HeadingMark> {
    let mut mark = |bank_deg: f32, i: u8| {
        let heading_rad = f32::from(i) / f32::from(marks_per_round) * TAU;
        let sample = measured_sample(airframe, RollPitch::from_deg(bank_deg, 0.0), heading_rad, 0.05, random);
        HeadingMark { sample, heading_rad: heading_rad + (random.normal() * 0.5).to_radians() }
    };
    let mut marks = Vec::new();
    for &bank_deg in banks_deg {
        marks.extend((0..marks_per_round).map(|i| mark(bank_deg, i)));
    }
    marks
}

/// Samples of a sensor turned to all sides on a bench, without attitude.
pub fn tumbled_samples(airframe: &Airframe, noise_ut: f32, random: &mut Random) -> Vec<Sample> {
    (0..160)
        .map(|_| {
            // Attitudes uniform over the sphere.
            let (roll_rad, pitch_rad) = (random.uniform(-3.1, 3.1), random.uniform(-1.0, 1.0).asin());
            let heading_rad = random.uniform(0.0, TAU);
            let measured = measured_sample(airframe, RollPitch { roll_rad, pitch_rad }, heading_rad, noise_ut, random);
            Sample { attitude: RollPitch::default(), ..measured }
        })
        .collect()
}

/// Level circle of a multirotor or boat, with typical noise.
pub fn level_circle(airframe: &Airframe, sample_count: u16, random: &mut Random) -> Vec<Sample> {
    (0..sample_count)
        .map(|i| {
            let true_attitude = RollPitch::from_deg(random.normal() * 0.5, random.normal() * 0.5);
            let heading_rad = f32::from(i) / f32::from(sample_count) * TAU;
            let measured = measured_sample(airframe, true_attitude, heading_rad, 0.12, random);
            let [roll_rad, pitch_rad] = [true_attitude.roll_rad, true_attitude.pitch_rad]
                .map(|angle| angle + (random.normal() * 0.3).to_radians());
            Sample {
                attitude: RollPitch { roll_rad, pitch_rad },
                time: WrappingMillis::new(u32::from(i) * 400),
                ..measured
            }
        })
        .collect()
}

/// Multirotor at 4 Hz: yaws once each way in hover, then yaws slowly with tilts of 15 deg to all sides, independent of
/// the yaw.
pub fn multirotor_samples(airframe: &Airframe, noise_deg: f32, random: &mut Random) -> Vec<Sample> {
    const STEP_S: f32 = 0.25;
    let mut heading_rad = random.uniform(0.0, TAU);
    (0..400_u16)
        .map(|i| {
            let t_s = f32::from(i) * STEP_S;
            let rate_rad_s = if t_s < 20.0 {
                0.35
            } else if t_s < 40.0 {
                -0.35
            } else {
                0.2
            };
            heading_rad += STEP_S * rate_rad_s;
            let tilt_deg = if t_s < 40.0 { 1.0 } else { 15.0 };
            let true_attitude = RollPitch::from_deg(tilt_deg * (t_s / 1.7).sin(), tilt_deg * (t_s / 2.3).cos());
            let measured = measured_sample(airframe, true_attitude, heading_rad, 0.4 * noise_deg, random);
            let [roll_rad, pitch_rad] = [true_attitude.roll_rad, true_attitude.pitch_rad]
                .map(|angle| angle + (random.normal() * noise_deg).to_radians());
            Sample {
                attitude: RollPitch { roll_rad, pitch_rad },
                rates: AngleRates::from_rad_s([0.0, 0.0, rate_rad_s]),
                time: WrappingMillis::new((t_s * 1000.0) as u32),
                ..measured
            }
        })
        .collect()
}

#[derive(Clone, Copy, Debug)]
pub struct Flight {
    pub bank_deg: f32,
    pub samples_per_side: u16,
    /// Bank and pitch wander, 1 sigma, correlated over 1.5 s.
    pub wander_deg: f32,
    pub sensor_noise_ut: f32,
    /// Attitude noise, 1 sigma, correlated over 0.5 s.
    pub attitude_noise_deg: f32,
    pub attitude_bias_deg: f32,
    pub bank_scale: f32,
}

impl Flight {
    pub const NOISE_FREE: Self = Self {
        bank_deg: 25.0,
        samples_per_side: 150,
        wander_deg: 0.0,
        sensor_noise_ut: 0.0,
        attitude_noise_deg: 0.0,
        attitude_bias_deg: 0.0,
        bank_scale: 0.0,
    };

    /// Light weather, good autopilot, LIS3MDL readings averaged by eight.
    pub const TYPICAL: Self = Self {
        wander_deg: 2.0,
        sensor_noise_ut: 0.12,
        attitude_noise_deg: 0.3,
        attitude_bias_deg: 0.2,
        bank_scale: 0.01,
        ..Self::NOISE_FREE
    };

    pub fn fly(&self, airframe: &Airframe, random: &mut Random) -> RecordedTurns {
        let bias =
            RollPitch::from_deg(random.normal() * self.attitude_bias_deg, random.normal() * self.attitude_bias_deg);
        RecordedTurns { left: self.turn(airframe, random, -1.0, bias), right: self.turn(airframe, random, 1.0, bias) }
    }

    fn turn(&self, airframe: &Airframe, random: &mut Random, sign: f32, bias: RollPitch) -> Vec<Sample> {
        const STEP_S: f32 = 0.5;
        let mut attitude_noise = [0, 1].map(|_| GaussMarkov::new(random, self.wander_deg, 1.5, STEP_S));
        let mut noise = [0, 1].map(|_| GaussMarkov::new(random, self.attitude_noise_deg, 0.5, STEP_S));
        let mut heading_rad = random.uniform(0.0, TAU);
        (0..self.samples_per_side)
            .map(|i| {
                let roll_deg = sign * self.bank_deg + attitude_noise[0].next_value(random);
                let pitch_deg = 2.0 + attitude_noise[1].next_value(random);
                let true_attitude = RollPitch::from_deg(roll_deg, pitch_deg);
                heading_rad += STEP_S * 9.81 * true_attitude.roll_rad.tan() / 22.0;
                let error_deg = noise.each_mut().map(|n| n.next_value(random));
                let reported =
                    RollPitch::from_deg(roll_deg * (1.0 + self.bank_scale) + error_deg[0], pitch_deg + error_deg[1]);
                let sensor_noise = Vector3::from_fn(|_, _| random.normal() * self.sensor_noise_ut);
                Sample {
                    time: WrappingMillis::new(u32::from(i) * 500),
                    ..Sample::new(
                        Field::new(airframe.field(true_attitude, heading_rad).ut + sensor_noise),
                        RollPitch {
                            roll_rad: reported.roll_rad + bias.roll_rad,
                            pitch_rad: reported.pitch_rad + bias.pitch_rad,
                        },
                    )
                }
            })
            .collect()
    }
}

#[derive(Clone, Debug)]
pub struct RecordedTurns {
    pub left: Vec<Sample>,
    pub right: Vec<Sample>,
}

/// Slices of samples by part; [`samples`](Self::samples) makes a view of them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Parts<'a> {
    pub left: &'a [Sample],
    pub right: &'a [Sample],
    pub level: &'a [Sample],
    pub free: &'a [Sample],
    pub marks: &'a [HeadingMark],
}

impl Parts<'_> {
    /// View of leaked copies of the samples, in order of time. At equal times in an arbitrary order, so that every other
    /// sample is not of one side.
    pub fn samples(self) -> Samples<'static> {
        let parts = CollectionPart::ALL_PARTS.into_iter().zip([self.left, self.right, self.level, self.free]);
        let mut ordered: Vec<Sample> =
            parts.flat_map(|(part, samples)| samples.iter().map(move |sample| Sample { part, ..*sample })).collect();
        if let Some(first) = ordered.first().map(|sample| sample.time) {
            ordered.sort_by_key(|sample| {
                (sample.time.signed_ms_since(first), sample.attitude.pitch_rad.to_bits().reverse_bits())
            });
        }
        Samples::new(ordered.leak()).with_marks(self.marks.to_vec().leak())
    }
}

/// Quality of turns to both sides.
pub fn typical_quality(expected_rms_deg: f32) -> Quality {
    Quality {
        method: Method::MaximumLikelihood,
        envelope: AttitudeEnvelope::Banked,
        expected_rms_deg,
        expected_worst_deg: 2.0 * expected_rms_deg,
        norm_residual: 0.004,
        inclination_residual_deg: 0.4,
        samples: 300,
        latency: None,
        knows_inclination: true,
    }
}

pub fn turn_samples(left: &[Sample], right: &[Sample]) -> Samples<'static> {
    Parts { left, right, ..Parts::default() }.samples()
}

pub fn level_samples(level: &[Sample]) -> Samples<'static> {
    Parts { level, ..Parts::default() }.samples()
}

pub fn free_samples(free: &[Sample]) -> Samples<'static> {
    Parts { free, ..Parts::default() }.samples()
}

pub fn marked_samples(marks: &[HeadingMark]) -> Samples<'static> {
    Parts { marks, ..Parts::default() }.samples()
}

/// The sample as measured by a sensor in another mounting.
pub fn in_mount(sample: &Sample, mount: Orientation) -> Sample {
    Sample { field: Field::new(mount.body_from_sensor().tr_mul(&sample.field.ut)), ..*sample }
}

/// The samples as measured by a sensor in another mounting.
pub fn samples_in_mount(samples: Samples<'_>, mount: Orientation) -> Samples<'static> {
    let turn_mark = |mark: &HeadingMark| HeadingMark { sample: in_mount(&mark.sample, mount), ..*mark };
    let marks: Vec<HeadingMark> = samples.marks.iter().map(turn_mark).collect();
    let turned: Vec<Sample> = samples.iter().map(|sample| in_mount(sample, mount)).collect();
    Samples::new(turned.leak()).with_marks(marks.leak())
}

impl RecordedTurns {
    pub fn turns(&self) -> Samples<'static> {
        turn_samples(&self.left, &self.right)
    }

    pub fn samples_mut(&mut self) -> impl Iterator<Item = &mut Sample> {
        self.left.iter_mut().chain(&mut self.right)
    }

    pub fn map_samples(&self, change: impl Fn(&Sample) -> Sample) -> Self {
        Self { left: self.left.iter().map(&change).collect(), right: self.right.iter().map(&change).collect() }
    }

    /// The right turns 75 s later, after 75 s of left turns.
    pub fn left_then_right(mut self) -> Self {
        for sample in &mut self.right {
            sample.time = WrappingMillis::new(sample.time.as_ms() + 75_000);
        }
        self
    }
}

pub fn rms(values: &[f32]) -> f32 {
    (values.iter().map(|v| v * v).sum::<f32>() / values.len() as f32).sqrt()
}

pub fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len() as f32
}

pub fn max_abs(values: &[f32]) -> f32 {
    values.iter().fold(0.0, |largest, v| largest.max(v.abs()))
}

pub fn quantile(values: &[f32], fraction: f32) -> f32 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f32::total_cmp);
    sorted[((sorted.len() - 1) as f32 * fraction).round() as usize]
}
