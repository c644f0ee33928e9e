//! One random airframe, the turns it flies, and what its module would record.

use autoswing::calibration::{Calibration, Rates, Sample, Samples, Solution};
use autoswing::frames::{Attitude, Field};
use autoswing::heading;
use autoswing::time::WrappingMillis;
use nalgebra::{Matrix3, Vector3};

use crate::random::{Purpose, Random};
use crate::score::wrap_180;
use crate::world::rotation::Euler;

/// Ranges that airframes, places and flights are drawn from.
#[derive(Clone, Copy, Debug)]
pub struct Ranges {
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
    /// Wander of bank and pitch, 1 sigma, degrees.
    pub wander_deg: f64,
    /// Noise of the sensor, relative to the total field.
    pub sensor_noise: [f64; 2],
    /// Noise of roll and pitch as told, 1 sigma, degrees.
    pub attitude_noise_deg: [f64; 2],
    /// Samples in the turns of one side.
    pub samples: usize,
}

impl Ranges {
    /// The worst airframes there are, with what the module's buffers hold.
    pub const HARSH: Self = Self {
        soft_iron: 0.3,
        hard_iron: 3.0,
        mounting_deg: 20.0,
        inclination_deg: [-70.0, 75.0],
        bank_deg: [15.0, 45.0],
        wander_deg: 2.0,
        sensor_noise: [0.003, 0.01],
        attitude_noise_deg: [0.2, 1.0],
        samples: autoswing::collection::dataset::FIT_CAPACITY,
    };
}

/// Errors of an attitude source that stay the same for a flight, 1 sigma of each.
#[derive(Clone, Copy, Debug)]
pub struct Faults {
    /// Of roll and of pitch, degrees.
    pub bias_deg: f64,
    /// Of bank, relative.
    pub bank_scale: f64,
}

impl Faults {
    /// None: noise alone.
    pub const NONE: Self = Self { bias_deg: 0.0, bank_scale: 0.0 };

    fn draw(self, random: &mut Random) -> Source {
        Source {
            roll_bias_rad: (random.normal() * self.bias_deg).to_radians(),
            pitch_bias_rad: (random.normal() * self.bias_deg).to_radians(),
            bank_scale: random.normal() * self.bank_scale,
        }
    }
}

/// An attitude source with the errors it happens to have.
#[derive(Clone, Copy, Debug)]
struct Source {
    roll_bias_rad: f64,
    pitch_bias_rad: f64,
    bank_scale: f64,
}

/// The module in use after a flight: the same source, fresh noise.
#[derive(Clone, Debug)]
pub struct Use {
    source: Source,
    random: Random,
}

/// An instant of the flight, as it truly was.
#[derive(Clone, Copy, Debug)]
pub struct Instant {
    /// How the aircraft lay; the heading counts whole turns.
    pub euler: Euler,
    time: WrappingMillis,
}

impl Instant {
    /// Half-way to a later one.
    fn midway(&self, later: &Self) -> Self {
        let (from, to) = (self.euler, later.euler);
        Self {
            euler: Euler {
                roll_rad: from.roll_rad.midpoint(to.roll_rad),
                pitch_rad: from.pitch_rad.midpoint(to.pitch_rad),
                heading_rad: from.heading_rad.midpoint(to.heading_rad),
            },
            time: WrappingMillis::new(self.time.count() + later.time.since(self.time) / 2),
        }
    }
}

/// An airframe at a place, its turns, and the noise of its instruments. The unit of field is the total intensity.
#[derive(Clone, Debug)]
pub struct Trial {
    seed: u64,
    /// `A` of Liu 2007 eq. 8: body axes to chip axes.
    pub a: Matrix3<f64>,
    /// `b`, in units of the total field.
    pub b: Vector3<f64>,
    /// Radians, positive down.
    pub inclination_rad: f64,
    /// Of each axis of the sensor, in units of the total field.
    pub sensor_sigma: f64,
    /// Of roll and of pitch.
    pub attitude_sigma_rad: f64,
    /// Left turns.
    pub left: Vec<Instant>,
    /// Right turns.
    pub right: Vec<Instant>,
}

/// The total field in the module's units.
const TOTAL_UT: f64 = 50.0;

impl Trial {
    /// Draws airframe, place and flight.
    #[must_use]
    pub fn draw(ranges: &Ranges, seed: u64) -> Self {
        let mut random = Random::new(seed, Purpose::Airframe);
        let raw = Matrix3::from_fn(|_, _| random.uniform(-1.0, 1.0));
        let symmetric = raw + raw.transpose();
        let size = random.uniform(0.0, ranges.soft_iron) / symmetric.singular_values().max();
        let mounting = random.rotation(ranges.mounting_deg);
        let inclination_rad = random.uniform(ranges.inclination_deg[0], ranges.inclination_deg[1]).to_radians();
        let hard_iron = random.direction() * random.uniform(0.0, ranges.hard_iron) * inclination_rad.cos();
        let bank_deg = random.uniform(ranges.bank_deg[0], ranges.bank_deg[1]);
        let [left, right] = [-bank_deg, bank_deg].map(|bank_deg| turn(ranges, bank_deg, &mut random));
        Self {
            seed,
            a: mounting * (Matrix3::identity() + symmetric * size),
            b: hard_iron,
            inclination_rad,
            sensor_sigma: random.uniform(ranges.sensor_noise[0], ranges.sensor_noise[1]),
            attitude_sigma_rad: random.uniform(ranges.attitude_noise_deg[0], ranges.attitude_noise_deg[1]).to_radians(),
            left,
            right,
        }
    }

    /// Every instant of the flight.
    pub fn instants(&self) -> impl Iterator<Item = &Instant> {
        self.left.iter().chain(&self.right)
    }

    /// The Earth field in the body frame, in units of the total field.
    #[must_use]
    pub fn body(&self, euler: Euler) -> Vector3<f64> {
        euler.field(1.0, self.inclination_rad)
    }

    /// What the module would record, and the noise of what it measures thereafter: the `repetition`-th draw.
    #[must_use]
    pub fn record(&self, repetition: u64, faults: Faults) -> (Recorded, Use) {
        let seed = self.seed.wrapping_mul(1_000_003).wrapping_add(repetition);
        let mut random = Random::new(seed, Purpose::Magnetometer);
        let source = faults.draw(&mut random);
        let fit = Sides::of(&self.left, &self.right, |instant| self.sample(instant, source, &mut random));
        // A stream of their own: with or without them, all else is drawn as it is.
        let mut fresh = Random::new(seed, Purpose::HeldBack);
        let [left, right] = [midways(&self.left), midways(&self.right)];
        let held_back = Sides::of(&left, &right, |instant| self.sample(instant, source, &mut fresh));
        (Recorded { fit, held_back }, Use { source, random })
    }

    /// A heading at a random attitude, as the module would show it with a solution: its error over its sigma. `None`
    /// where it would show none.
    #[must_use]
    pub fn error_over_sigma(&self, solution: &Solution, used: &mut Use) -> Option<f64> {
        let random = &mut used.random;
        let euler = Euler {
            heading_rad: random.uniform(0.0, std::f64::consts::TAU),
            roll_rad: random.uniform(-30.0, 30.0).to_radians(),
            pitch_rad: random.uniform(-10.0, 10.0).to_radians(),
        };
        let instant = Instant { euler, time: WrappingMillis::default() };
        let Sample { field, attitude, .. } = self.sample(&instant, used.source, random);
        let config = heading::Config::DEFAULT;
        let shown = heading::heading(config, &solution.calibration, &solution.uncertainty, field, attitude).ok()?;
        let error_deg = wrap_180((f64::from(shown.magnetic_rad) - euler.heading_rad).to_degrees());
        Some(error_deg / f64::from(shown.sigma_deg()))
    }

    fn sample(&self, instant: &Instant, source: Source, random: &mut Random) -> Sample {
        let euler = instant.euler;
        let sensed = self.a * self.body(euler) + self.b + random.normal_vector() * self.sensor_sigma;
        let told = [
            euler.roll_rad * (1.0 + source.bank_scale) + source.roll_bias_rad,
            euler.pitch_rad + source.pitch_bias_rad,
        ];
        let [roll_rad, pitch_rad] = told.map(|angle| (angle + random.normal() * self.attitude_sigma_rad) as f32);
        Sample {
            field: Field::new((sensed * TOTAL_UT).cast()),
            attitude: Attitude { roll_rad, pitch_rad },
            time: instant.time,
            rates: Rates::NONE,
        }
    }

    /// Heading errors of a calibration at exact field and attitude, degrees, over the envelope.
    #[must_use]
    pub fn errors_deg(&self, calibration: &Calibration) -> Vec<f64> {
        envelope()
            .map(|euler| {
                let sensed = (self.a * self.body(euler) + self.b) * TOTAL_UT;
                let attitude = Attitude { roll_rad: euler.roll_rad as f32, pitch_rad: euler.pitch_rad as f32 };
                let found = attitude.level(calibration.apply(Field::new(sensed.cast()))).heading_rad();
                wrap_180((f64::from(found) - euler.heading_rad).to_degrees())
            })
            .collect()
    }
}

/// The envelope: twelve headings at each of three banks, at pitch zero.
pub fn envelope() -> impl Iterator<Item = Euler> {
    [-30.0, 0.0, 30.0]
        .into_iter()
        .flat_map(|bank_deg| (0..12).map(move |step| Euler::from_deg(bank_deg, 0.0, f64::from(step * 30))))
}

/// The instants half-way between each of these and the next.
fn midways(instants: &[Instant]) -> Vec<Instant> {
    instants.iter().zip(instants.iter().skip(1)).map(|(earlier, later)| earlier.midway(later)).collect()
}

/// Turns with bank and pitch that wander with a time constant of 1.5 s, a sample every half second.
fn turn(ranges: &Ranges, bank_deg: f64, random: &mut Random) -> Vec<Instant> {
    const STEP_S: f64 = 0.5;
    let keep = (-STEP_S / 1.5_f64).exp();
    let fresh = (1.0 - keep * keep).sqrt() * ranges.wander_deg;
    let mut wander = [random.normal() * ranges.wander_deg, random.normal() * ranges.wander_deg];
    let mut heading_rad = random.uniform(0.0, std::f64::consts::TAU);
    (0..ranges.samples)
        .map(|i| {
            wander = wander.map(|w| keep * w + fresh * random.normal());
            let roll_rad = (bank_deg + wander[0]).to_radians();
            // A coordinated turn at 22 m/s, as a small UAV flies.
            heading_rad += STEP_S * 9.81 * roll_rad.tan() / 22.0;
            let pitch_rad = (2.0 + wander[1]).to_radians();
            Instant { euler: Euler { roll_rad, pitch_rad, heading_rad }, time: WrappingMillis::new(i as u32 * 500) }
        })
        .collect()
}

/// The samples of a flight.
#[derive(Clone, Debug)]
pub struct Recorded {
    fit: Sides,
    held_back: Sides,
}

/// Samples of left and right turns.
#[derive(Clone, Debug)]
struct Sides {
    left: Vec<Sample>,
    right: Vec<Sample>,
}

impl Recorded {
    /// Those to solve with.
    #[must_use]
    pub fn samples(&self) -> Samples<'_> {
        self.fit.samples()
    }

    /// Those to verify with: of the same flight and attitude source, half-way between the others, with noise of their
    /// own.
    #[must_use]
    pub fn held_back(&self) -> Samples<'_> {
        self.held_back.samples()
    }
}

impl Sides {
    /// Samples left turns first.
    fn of(left: &[Instant], right: &[Instant], mut sample: impl FnMut(&Instant) -> Sample) -> Self {
        Self { left: left.iter().map(&mut sample).collect(), right: right.iter().map(&mut sample).collect() }
    }

    fn samples(&self) -> Samples<'_> {
        Samples { left: &self.left, right: &self.right, ..Samples::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Not fitted, of the same flight: in time half-way between those of the fit, and of the field what noise of 1 % of
    /// 50 uT and half a second of a turn (at 45 deg of bank 13 deg of heading) leave.
    #[test]
    fn held_back_samples_are_of_the_same_flight_and_not_of_the_fit() {
        for seed in 0..20 {
            let trial = Trial::draw(&Ranges::HARSH, seed);
            let (recorded, _) = trial.record(3, Faults::NONE);
            let (fit, held_back) = (recorded.samples(), recorded.held_back());
            for (fit, held_back) in [(fit.left, held_back.left), (fit.right, held_back.right)] {
                assert_eq!(held_back.len(), fit.len() - 1);
                for (pair, held) in fit.windows(2).zip(held_back) {
                    assert_eq!((held.time.since(pair[0].time), pair[1].time.since(held.time)), (250, 250));
                    let mean_ut = (pair[0].field.ut + pair[1].field.ut) / 2.0;
                    assert!((held.field.ut - mean_ut).norm() < 5.0, "seed {seed}: {held:?} between {pair:?}");
                    assert!(held.field != pair[0].field && held.field != pair[1].field);
                }
            }
        }
    }

    /// Noise of their own, the same source: its bias of 10 deg is in both, the noise of at most 1 deg is in neither
    /// mean.
    #[test]
    fn held_back_samples_have_noise_of_their_own_and_the_source_s_bias() {
        let mean_deg = |samples: Samples<'_>| {
            let rolls = samples.iter().map(|s| f64::from(s.attitude.roll_rad.to_degrees()));
            rolls.sum::<f64>() / samples.iter().count() as f64
        };
        let trial = Trial::draw(&Ranges::HARSH, 5);
        let [first, second] = [0, 1].map(|draw| trial.record(draw, Faults { bias_deg: 10.0, bank_scale: 0.0 }).0);
        for recorded in [&first, &second] {
            let difference_deg = mean_deg(recorded.samples()) - mean_deg(recorded.held_back());
            assert!(difference_deg.abs() < 0.5, "{difference_deg}");
        }
        assert!((mean_deg(first.held_back()) - mean_deg(second.held_back())).abs() > 1.0, "draws differ in their bias");
        assert_ne!(first.held_back().left[0].field, second.held_back().left[0].field);
    }
}
