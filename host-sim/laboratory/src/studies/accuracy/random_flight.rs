//! One random airframe with its turns, and simulated recordings of them.

use autoswing::calibration::{AngleRates, Calibration, CollectionPart, ConsiderSigmas, Sample, Samples, Solution};
use autoswing::frames::{Field, RollPitch};
use autoswing::heading;
use autoswing::time::WrappingMillis;
use nalgebra::{Matrix3, Vector3};

use log_analysis::score::wrap_180;
use simulator::random::{RandomStream, StreamPurpose};
use simulator::world::aircraft::VehicleKind;
use simulator::world::rotation::Euler;

/// Ranges of random airframes, places and flights.
#[derive(Clone, Copy, Debug)]
pub struct RandomRanges {
    /// Largest soft iron, relative.
    pub soft_iron: f64,
    /// Largest hard iron, in units of the horizontal field.
    pub hard_iron: f64,
    /// Largest mounting error about a random axis, degrees.
    pub mounting_deg: f64,
    /// Inclination, degrees.
    pub inclination_deg: [f64; 2],
    /// Mean bank of the turns, degrees.
    pub bank_deg: [f64; 2],
    /// Standard deviation of random bank and pitch, degrees.
    pub random_attitude_deg: f64,
    /// Sensor noise relative to the total field, 1 sigma.
    pub sensor_noise: [f64; 2],
    /// Noise of reported roll and pitch, 1 sigma, degrees.
    pub attitude_noise_deg: [f64; 2],
    /// Samples per turn direction.
    pub samples_per_side: usize,
}

impl RandomRanges {
    /// Worst realistic airframes, with 16 samples a turn direction in each sector of 30 deg.
    pub const WORST_CASE: Self = Self {
        soft_iron: 0.3,
        hard_iron: 3.0,
        mounting_deg: 20.0,
        inclination_deg: [-70.0, 75.0],
        bank_deg: [15.0, 45.0],
        random_attitude_deg: 2.0,
        sensor_noise: [0.003, 0.01],
        attitude_noise_deg: [0.2, 1.0],
        samples_per_side: 192,
    };
}

/// Standard deviations of attitude errors that are constant during a flight.
#[derive(Clone, Copy, Debug)]
pub struct ConstantErrorSigmas {
    /// Roll bias and pitch bias, degrees.
    pub bias_deg: f64,
    /// Bank-angle scale error, relative.
    pub bank_scale: f64,
}

impl ConstantErrorSigmas {
    /// No constant errors.
    pub const NO_ERRORS: Self = Self { bias_deg: 0.0, bank_scale: 0.0 };

    /// The errors that a solver considers.
    #[must_use]
    pub fn from_considered(consider: ConsiderSigmas) -> Self {
        Self { bias_deg: f64::from(consider.bias_rad.to_degrees()), bank_scale: f64::from(consider.bank_scale) }
    }
}

/// Attitude source of a calibration flight and after it: its constant errors, and the random numbers of its noise.
#[derive(Clone, Debug)]
pub struct LaterMeasurementSource {
    roll_bias_rad: f64,
    pitch_bias_rad: f64,
    bank_scale: f64,
    random: RandomStream,
}

/// True state at one sample of the flight.
#[derive(Clone, Copy, Debug)]
pub struct TrueSample {
    /// True attitude; heading is not wrapped.
    pub euler: Euler,
    /// Magnitude of the acceleration that causes tilt errors, m/s^2.
    pub disturbing_acceleration_m_s2: f64,
    /// Roll, pitch and heading rates.
    pub rates: AngleRates,
    /// Sample time.
    pub time: WrappingMillis,
}

impl TrueSample {
    fn midpoint(&self, later: &Self) -> Self {
        let (from, to) = (self.euler, later.euler);
        Self {
            euler: Euler {
                roll_rad: from.roll_rad.midpoint(to.roll_rad),
                pitch_rad: from.pitch_rad.midpoint(to.pitch_rad),
                heading_rad: from.heading_rad.midpoint(to.heading_rad),
            },
            disturbing_acceleration_m_s2: self
                .disturbing_acceleration_m_s2
                .midpoint(later.disturbing_acceleration_m_s2),
            rates: self.rates,
            time: WrappingMillis::new(self.time.as_ms() + later.time.ms_since(self.time) / 2),
        }
    }
}

/// Airframe at a place, its turns, and the noise of its instruments. The unit of field is the total intensity.
#[derive(Clone, Debug)]
pub struct RandomFlight {
    seed: u64,
    /// `A` of Liu 2007 eq. 8, body axes to chip axes.
    pub field_matrix: Matrix3<f64>,
    /// `b`, in units of the total field.
    pub hard_iron: Vector3<f64>,
    /// Inclination, radians, positive down.
    pub inclination_rad: f64,
    /// Sensor noise of each axis, in units of the total field.
    pub relative_sensor_sigma: f64,
    /// Noise of roll and pitch without acceleration, radians.
    pub attitude_sigma_rad: f64,
    /// Attitudes at which headings are evaluated.
    pub envelope: StudyEnvelope,
    /// Samples of left turns.
    pub left_turns: Vec<TrueSample>,
    /// Samples of right turns.
    pub right_turns: Vec<TrueSample>,
}

/// Attitudes at which a calibration is evaluated, each at twelve headings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StudyEnvelope {
    /// Level and banked by 30 deg to either side, at pitch zero (aeroplane).
    Banked,
    /// Level and tilted by 20 deg in eight directions (multirotor).
    Tilted,
}

impl StudyEnvelope {
    const TILT_DEG: f64 = 20.0;

    /// All attitudes of the envelope.
    pub fn attitudes(self) -> impl Iterator<Item = Euler> {
        let tilts = match self {
            Self::Banked => [-30.0, 0.0, 30.0].map(|bank_deg| [bank_deg, 0.0]).to_vec(),
            Self::Tilted => std::iter::once([0.0; 2]).chain((0..8).map(tilt_toward)).collect(),
        };
        tilts.into_iter().flat_map(|[roll_deg, pitch_deg]| {
            (0..12).map(move |step| Euler::from_deg(roll_deg, pitch_deg, f64::from(step * 30)))
        })
    }
}

/// Roll and pitch of a tilt in one of eight directions, degrees.
fn tilt_toward(direction_index: u8) -> [f64; 2] {
    let (sin, cos) = libm::sincos(f64::from(direction_index) * std::f64::consts::FRAC_PI_4);
    [StudyEnvelope::TILT_DEG * sin, StudyEnvelope::TILT_DEG * cos]
}

const FIELD_STRENGTH_UT: f64 = 50.0;

/// Acceleration-induced tilt error, degrees per m/s^2, 1 sigma, as of the simulated attitude source of a copter.
/// Simulated aeroplanes fly without this acceleration.
const TILT_ERROR_DEG_PER_M_S2: f64 = VehicleKind::Copter.tilt_error_deg_per_m_s2();

impl RandomFlight {
    /// Draws airframe, place and flight.
    #[must_use]
    pub fn draw_flight(ranges: &RandomRanges, seed: u64) -> Self {
        let mut random = RandomStream::new(seed, StreamPurpose::Airframe);
        let raw = Matrix3::from_fn(|_, _| random.uniform(-1.0, 1.0));
        let symmetric = raw + raw.transpose();
        let size = random.uniform(0.0, ranges.soft_iron) / symmetric.singular_values().max();
        let mounting = random.random_rotation(ranges.mounting_deg);
        let inclination_rad = random.uniform(ranges.inclination_deg[0], ranges.inclination_deg[1]).to_radians();
        let hard_iron = random.random_direction() * random.uniform(0.0, ranges.hard_iron) * libm::cos(inclination_rad);
        let bank_deg = random.uniform(ranges.bank_deg[0], ranges.bank_deg[1]);
        let [left_turns, right_turns] =
            [-bank_deg, bank_deg].map(|bank_deg| random_turn(ranges, bank_deg, &mut random));
        Self {
            seed,
            field_matrix: mounting * (Matrix3::identity() + symmetric * size),
            hard_iron,
            inclination_rad,
            relative_sensor_sigma: random.uniform(ranges.sensor_noise[0], ranges.sensor_noise[1]),
            attitude_sigma_rad: random.uniform(ranges.attitude_noise_deg[0], ranges.attitude_noise_deg[1]).to_radians(),
            envelope: StudyEnvelope::Banked,
            left_turns,
            right_turns,
        }
    }

    /// The same airframe, place and instruments with another flight, without turn directions.
    #[must_use]
    pub fn with_flight(self, flight: Vec<TrueSample>, envelope: StudyEnvelope) -> Self {
        Self { envelope, left_turns: flight, right_turns: Vec::new(), ..self }
    }

    /// Standard deviation of roll and of pitch errors at a sample, radians.
    #[must_use]
    pub fn attitude_sigma_rad(&self, true_sample: &TrueSample) -> f64 {
        let acceleration_error_rad = TILT_ERROR_DEG_PER_M_S2.to_radians() * true_sample.disturbing_acceleration_m_s2;
        libm::hypot(self.attitude_sigma_rad, acceleration_error_rad)
    }

    /// All samples of the flight.
    pub fn true_samples(&self) -> impl Iterator<Item = &TrueSample> {
        self.left_turns.iter().chain(&self.right_turns)
    }

    /// Earth's field in body axes, in units of the total field.
    #[must_use]
    pub fn body_field(&self, euler: Euler) -> Vector3<f64> {
        euler.body_field(1.0, self.inclination_rad)
    }

    /// The `repetition`-th noise realisation: recording, and noise stream for later measurements.
    #[must_use]
    pub fn record_flight(
        &self,
        repetition: u64,
        error_sigmas: ConstantErrorSigmas,
    ) -> (Recording, LaterMeasurementSource) {
        let (seed, mut later) = self.start_recording(repetition, error_sigmas);
        let fit_samples =
            sample_turns(&self.left_turns, &self.right_turns, |true_sample| self.noisy_sample(true_sample, &mut later));
        // A separate random stream, so that held-back samples do not change the other random numbers.
        let random = RandomStream::new(seed, StreamPurpose::HeldBack);
        let mut held_back_source = LaterMeasurementSource { random, ..later };
        let [left_turns, right_turns] = [midpoints(&self.left_turns), midpoints(&self.right_turns)];
        let held_back = sample_turns(&left_turns, &right_turns, |true_sample| {
            self.noisy_sample(true_sample, &mut held_back_source)
        });
        (Recording { fit_samples, held_back }, later)
    }

    /// The `repetition`-th noise realisation of all samples, and noise stream for later measurements.
    #[must_use]
    pub fn record_all_samples(
        &self,
        repetition: u64,
        error_sigmas: ConstantErrorSigmas,
    ) -> (Vec<Sample>, LaterMeasurementSource) {
        let (_, mut source) = self.start_recording(repetition, error_sigmas);
        let samples = self.true_samples().map(|true_sample| self.noisy_sample(true_sample, &mut source)).collect();
        (samples, source)
    }

    /// Seed of a noise realisation, and its attitude source.
    fn start_recording(&self, repetition: u64, error_sigmas: ConstantErrorSigmas) -> (u64, LaterMeasurementSource) {
        let seed = self.seed.wrapping_mul(1_000_003).wrapping_add(repetition);
        let mut random = RandomStream::new(seed, StreamPurpose::Magnetometer);
        let mut draw = |sigma: f64| random.gaussian() * sigma;
        let [roll_bias_rad, pitch_bias_rad] = [0, 1].map(|_| draw(error_sigmas.bias_deg).to_radians());
        let bank_scale = draw(error_sigmas.bank_scale);
        (seed, LaterMeasurementSource { roll_bias_rad, pitch_bias_rad, bank_scale, random })
    }

    /// Heading error over its sigma at a random attitude; `None` if the module outputs no heading.
    #[must_use]
    pub fn normalised_heading_error(
        &self,
        solution: &Solution,
        later_measurements: &mut LaterMeasurementSource,
    ) -> Option<f64> {
        let random = &mut later_measurements.random;
        let euler = Euler {
            heading_rad: random.uniform(0.0, std::f64::consts::TAU),
            roll_rad: random.uniform(-30.0, 30.0).to_radians(),
            pitch_rad: random.uniform(-10.0, 10.0).to_radians(),
        };
        let true_sample = TrueSample {
            euler,
            disturbing_acceleration_m_s2: 0.0,
            rates: AngleRates::UNKNOWN,
            time: WrappingMillis::default(),
        };
        let Sample { field, attitude, .. } = self.noisy_sample(&true_sample, later_measurements);
        let config = heading::HeadingLimits::DEFAULT;
        let indicated_heading_rad =
            heading::compute_heading(config, &solution.calibration, &solution.uncertainty, field, attitude).ok()?;
        let error_deg = wrap_180((f64::from(indicated_heading_rad.magnetic_rad) - euler.heading_rad).to_degrees());
        Some(error_deg / f64::from(indicated_heading_rad.sigma_deg()))
    }

    fn noisy_sample(&self, true_sample: &TrueSample, source: &mut LaterMeasurementSource) -> Sample {
        let (euler, random) = (true_sample.euler, &mut source.random);
        let sensed = self.field_matrix * self.body_field(euler)
            + self.hard_iron
            + random.normal_vector() * self.relative_sensor_sigma;
        let reported_angles = [
            euler.roll_rad * (1.0 + source.bank_scale) + source.roll_bias_rad,
            euler.pitch_rad + source.pitch_bias_rad,
        ];
        let sigma_rad = self.attitude_sigma_rad(true_sample);
        let [roll_rad, pitch_rad] = reported_angles.map(|angle| (angle + random.gaussian() * sigma_rad) as f32);
        Sample {
            time: true_sample.time,
            rates: true_sample.rates,
            ..Sample::new(Field::new((sensed * FIELD_STRENGTH_UT).cast()), RollPitch { roll_rad, pitch_rad })
        }
    }

    /// Heading errors of a calibration over the envelope at exact field and attitude, degrees.
    #[must_use]
    pub fn errors_deg(&self, calibration: &Calibration) -> Vec<f64> {
        self.envelope
            .attitudes()
            .map(|euler| {
                let sensed = (self.field_matrix * self.body_field(euler) + self.hard_iron) * FIELD_STRENGTH_UT;
                let attitude = RollPitch { roll_rad: euler.roll_rad as f32, pitch_rad: euler.pitch_rad as f32 };
                let indicated_heading_rad =
                    attitude.to_level_frame(calibration.calibrated_field(Field::new(sensed.cast()))).heading_rad();
                wrap_180((f64::from(indicated_heading_rad) - euler.heading_rad).to_degrees())
            })
            .collect()
    }
}

fn midpoints(true_samples: &[TrueSample]) -> Vec<TrueSample> {
    true_samples.iter().zip(true_samples.iter().skip(1)).map(|(earlier, later)| earlier.midpoint(later)).collect()
}

/// Coordinated turns with random bank and pitch (correlation time 1.5 s), sampled every 0.5 s.
fn random_turn(ranges: &RandomRanges, bank_deg: f64, random: &mut RandomStream) -> Vec<TrueSample> {
    const STEP_S: f64 = 0.5;
    let decay = libm::exp(-STEP_S / 1.5_f64);
    let innovation_sigma = (1.0 - decay * decay).sqrt() * ranges.random_attitude_deg;
    let mut attitude_noise =
        [random.gaussian() * ranges.random_attitude_deg, random.gaussian() * ranges.random_attitude_deg];
    let mut heading_rad = random.uniform(0.0, std::f64::consts::TAU);
    (0..ranges.samples_per_side)
        .map(|i| {
            attitude_noise = attitude_noise.map(|value| decay * value + innovation_sigma * random.gaussian());
            let roll_rad = (bank_deg + attitude_noise[0]).to_radians();
            // Coordinated turn at 22 m/s, as of a small UAV.
            heading_rad += STEP_S * 9.81 * libm::tan(roll_rad) / 22.0;
            let pitch_rad = (2.0 + attitude_noise[1]).to_radians();
            let (euler, time) = (Euler { roll_rad, pitch_rad, heading_rad }, WrappingMillis::new(i as u32 * 500));
            TrueSample { euler, disturbing_acceleration_m_s2: 0.0, rates: AngleRates::UNKNOWN, time }
        })
        .collect()
}

/// Recorded samples of a flight, in order of time: for the fit, and held back.
#[derive(Clone, Debug)]
pub struct Recording {
    pub(super) fit_samples: Vec<Sample>,
    pub(super) held_back: Vec<Sample>,
}

impl Recording {
    /// Samples for the fit.
    #[must_use]
    pub fn fit_samples(&self) -> Samples<'_> {
        Samples::new(&self.fit_samples)
    }

    /// Held-back samples: midpoints of the same flight with independent noise.
    #[must_use]
    pub fn held_back(&self) -> Samples<'_> {
        Samples::new(&self.held_back)
    }
}

/// The left turns are sampled before the right turns; the result is in order of time, at equal
/// times in an arbitrary order.
fn sample_turns(
    left_turns: &[TrueSample],
    right_turns: &[TrueSample],
    mut sample: impl FnMut(&TrueSample) -> Sample,
) -> Vec<Sample> {
    let true_samples = left_turns
        .iter()
        .map(|true_sample| (true_sample, CollectionPart::LEFT))
        .chain(right_turns.iter().map(|true_sample| (true_sample, CollectionPart::RIGHT)));
    let mut samples: Vec<Sample> =
        true_samples.map(|(true_sample, part)| Sample { part, ..sample(true_sample) }).collect();
    samples.sort_by_key(|sample| (sample.time.as_ms(), sample.field.ut.x.to_bits().reverse_bits()));
    samples
}

#[cfg(test)]
mod tests {
    use log_analysis::numbers::square;

    use super::*;

    #[test]
    fn the_tilted_envelope_has_20_deg_of_tilt_to_eight_sides() {
        let mut directions = std::collections::BTreeSet::new();
        for euler in StudyEnvelope::Tilted.attitudes().skip(12) {
            let tilt_deg = libm::acos(libm::cos(euler.roll_rad) * libm::cos(euler.pitch_rad)).to_degrees();
            assert!((tilt_deg - 20.0).abs() < 0.2, "{tilt_deg}");
            directions.insert(libm::atan2(euler.roll_rad, euler.pitch_rad).to_degrees().round() as i32);
        }
        assert_eq!(directions.len(), 8);
        assert_eq!(StudyEnvelope::Tilted.attitudes().count(), 108);
        assert!(StudyEnvelope::Banked.attitudes().all(|euler| euler.pitch_rad.abs() < 1e-9));
    }

    /// 2.6 m/s^2 cause 1.04 deg, added in quadrature to the noise of 0.2 to 1 deg; 2,000 samples determine sigma to 2
    /// %.
    #[test]
    fn attitude_noise_grows_with_disturbing_acceleration() {
        let true_sample = |push_m_s2| TrueSample {
            euler: Euler::from_deg(3.0, -4.0, 100.0),
            disturbing_acceleration_m_s2: push_m_s2,
            rates: AngleRates::from_rad_s([0.1, -0.2, 0.3]),
            time: WrappingMillis::new(7),
        };
        let trial = RandomFlight::draw_flight(&RandomRanges::WORST_CASE, 3);
        for (push_m_s2, by_push_deg) in [(0.0, 0.0), (2.6, 1.04)] {
            let trial = trial.clone().with_flight(vec![true_sample(push_m_s2); 2000], StudyEnvelope::Tilted);
            let (samples, _) = trial.record_all_samples(0, ConstantErrorSigmas::NO_ERRORS);
            let squares = samples.iter().map(|sample| square(f64::from(sample.attitude.roll_rad.to_degrees() - 3.0)));
            let sigma_deg = (squares.sum::<f64>() / 2000.0).sqrt();
            let expected_deg = libm::hypot(trial.attitude_sigma_rad.to_degrees(), by_push_deg);
            assert!((sigma_deg / expected_deg - 1.0).abs() < 0.06, "{sigma_deg} for {expected_deg}");
            assert!(
                samples
                    .iter()
                    .all(|sample| sample.rates == AngleRates::from_rad_s([0.1, -0.2, 0.3]) && sample.time.as_ms() == 7)
            );
        }
    }

    /// Held-back times are midpoints; the field differs from the mean of its neighbours by noise of 1 % of 50 uT and by
    /// half a second of turn (13 deg of heading at 45 deg of bank).
    #[test]
    fn held_back_samples_lie_between_those_of_the_fit() {
        for seed in 0..20 {
            let trial = RandomFlight::draw_flight(&RandomRanges::WORST_CASE, seed);
            let (recording, _) = trial.record_flight(3, ConstantErrorSigmas::NO_ERRORS);
            let (fit_samples, held_back) = (recording.fit_samples(), recording.held_back());
            let turns = |samples: Samples<'_>, part| samples.samples_of_part(part).iter().copied().collect::<Vec<_>>();
            for (fit_samples, held_back) in
                CollectionPart::TURNS.map(|part| (turns(fit_samples, part), turns(held_back, part)))
            {
                assert_eq!(held_back.len(), fit_samples.len() - 1);
                for (pair, held_back_sample) in fit_samples.windows(2).zip(&held_back) {
                    assert_eq!(
                        (held_back_sample.time.ms_since(pair[0].time), pair[1].time.ms_since(held_back_sample.time)),
                        (250, 250)
                    );
                    let mean_ut = (pair[0].field.ut + pair[1].field.ut) / 2.0;
                    assert!(
                        (held_back_sample.field.ut - mean_ut).norm() < 5.0,
                        "seed {seed}: {held_back_sample:?} between {pair:?}"
                    );
                    assert!(held_back_sample.field != pair[0].field && held_back_sample.field != pair[1].field);
                }
            }
        }
    }

    #[test]
    fn held_back_samples_have_noise_of_their_own_and_the_source_s_bias() {
        let mean_deg = |samples: Samples<'_>| {
            let rolls = samples.iter().map(|sample| f64::from(sample.attitude.roll_rad.to_degrees()));
            rolls.sum::<f64>() / samples.iter().count() as f64
        };
        let trial = RandomFlight::draw_flight(&RandomRanges::WORST_CASE, 5);
        let [first, second] =
            [0, 1].map(|draw| trial.record_flight(draw, ConstantErrorSigmas { bias_deg: 10.0, bank_scale: 0.0 }).0);
        for recording in [&first, &second] {
            let difference_deg = mean_deg(recording.fit_samples()) - mean_deg(recording.held_back());
            assert!(difference_deg.abs() < 0.5, "{difference_deg}");
        }
        assert!((mean_deg(first.held_back()) - mean_deg(second.held_back())).abs() > 1.0, "draws differ in their bias");
        assert_ne!(first.held_back().iter().next().unwrap().field, second.held_back().iter().next().unwrap().field);
    }
}
