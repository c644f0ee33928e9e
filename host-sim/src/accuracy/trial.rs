//! One random airframe, the turns it flies, and what its module would record.

use autoswing::calibration::{Calibration, Consider, Rates, Sample, Samples, Solution};
use autoswing::frames::{Attitude, Field};
use autoswing::heading;
use autoswing::time::WrappingMillis;
use nalgebra::{Matrix3, Vector3};

use crate::random::{Purpose, Random};
use crate::score::wrap_180;
use crate::world::aircraft::Kind;
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

    /// Those that a solver considers.
    #[must_use]
    pub fn of(consider: Consider) -> Self {
        Self { bias_deg: f64::from(consider.bias_rad.to_degrees()), bank_scale: f64::from(consider.bank_scale) }
    }

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
    /// Size of the acceleration that an attitude source takes for tilt, metres per second squared.
    pub push_m_s2: f64,
    /// How fast roll and pitch changed, as far as the module is told.
    pub rates: Rates,
    /// When it was.
    pub time: WrappingMillis,
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
            push_m_s2: self.push_m_s2.midpoint(later.push_m_s2),
            rates: self.rates,
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
    /// Of roll and of pitch, while nothing pushes the aircraft about.
    pub attitude_sigma_rad: f64,
    /// Where its headings are looked at.
    pub envelope: Envelope,
    /// Left turns.
    pub left: Vec<Instant>,
    /// Right turns.
    pub right: Vec<Instant>,
}

/// Attitudes at which the heading of a calibration is looked at, each at twelve headings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Envelope {
    /// Level and banked by 30 deg either way, at pitch zero: what turns by its bank.
    Banked,
    /// Level and tilted by 20 deg to each of eight sides: what tilts to move.
    Tilted,
}

impl Envelope {
    /// Tilt to a side, degrees.
    const TILT_DEG: f64 = 20.0;

    /// All of it.
    pub fn attitudes(self) -> impl Iterator<Item = Euler> {
        let tilts = match self {
            Self::Banked => [-30.0, 0.0, 30.0].map(|bank_deg| [bank_deg, 0.0]).to_vec(),
            Self::Tilted => std::iter::once([0.0; 2]).chain((0..8).map(tilted_to)).collect(),
        };
        tilts.into_iter().flat_map(|[roll_deg, pitch_deg]| {
            (0..12).map(move |step| Euler::from_deg(roll_deg, pitch_deg, f64::from(step * 30)))
        })
    }
}

/// Roll and pitch of a tilt to one of eight sides, degrees.
fn tilted_to(side: u8) -> [f64; 2] {
    let (sin, cos) = (f64::from(side) * std::f64::consts::FRAC_PI_4).sin_cos();
    [Envelope::TILT_DEG * sin, Envelope::TILT_DEG * cos]
}

/// The total field in the module's units.
const TOTAL_UT: f64 = 50.0;

/// Error of roll and of pitch by an acceleration of 1 m/s^2, 1 sigma, degrees: as the simulated attitude source of a copter
/// has it. What is not pushed about does not know of it.
const PUSH_ERROR_DEG: f64 = Kind::Copter.push_error_deg();

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
            envelope: Envelope::Banked,
            left,
            right,
        }
    }

    /// The same airframe, place and instruments on another flight, of no side.
    #[must_use]
    pub fn flying(self, flight: Vec<Instant>, envelope: Envelope) -> Self {
        Self { envelope, left: flight, right: Vec::new(), ..self }
    }

    /// Of roll and of pitch at an instant.
    #[must_use]
    pub fn attitude_sigma_rad(&self, instant: &Instant) -> f64 {
        let by_push_rad = PUSH_ERROR_DEG.to_radians() * instant.push_m_s2;
        self.attitude_sigma_rad.hypot(by_push_rad)
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

    /// A sample of every instant, and the noise of what the module measures thereafter: the `repetition`-th draw.
    #[must_use]
    pub fn record_all(&self, repetition: u64, faults: Faults) -> (Vec<Sample>, Use) {
        let seed = self.seed.wrapping_mul(1_000_003).wrapping_add(repetition);
        let mut random = Random::new(seed, Purpose::Magnetometer);
        let source = faults.draw(&mut random);
        let samples = self.instants().map(|instant| self.sample(instant, source, &mut random)).collect();
        (samples, Use { source, random })
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
        let instant = Instant { euler, push_m_s2: 0.0, rates: Rates::NONE, time: WrappingMillis::default() };
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
        let sigma_rad = self.attitude_sigma_rad(instant);
        let [roll_rad, pitch_rad] = told.map(|angle| (angle + random.normal() * sigma_rad) as f32);
        Sample {
            field: Field::new((sensed * TOTAL_UT).cast()),
            attitude: Attitude { roll_rad, pitch_rad },
            time: instant.time,
            rates: instant.rates,
        }
    }

    /// Heading errors of a calibration at exact field and attitude, degrees, over the envelope.
    #[must_use]
    pub fn errors_deg(&self, calibration: &Calibration) -> Vec<f64> {
        self.envelope
            .attitudes()
            .map(|euler| {
                let sensed = (self.a * self.body(euler) + self.b) * TOTAL_UT;
                let attitude = Attitude { roll_rad: euler.roll_rad as f32, pitch_rad: euler.pitch_rad as f32 };
                let found = attitude.level(calibration.apply(Field::new(sensed.cast()))).heading_rad();
                wrap_180((f64::from(found) - euler.heading_rad).to_degrees())
            })
            .collect()
    }
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
            let (euler, time) = (Euler { roll_rad, pitch_rad, heading_rad }, WrappingMillis::new(i as u32 * 500));
            Instant { euler, push_m_s2: 0.0, rates: Rates::NONE, time }
        })
        .collect()
}

/// The samples of a flight.
#[derive(Clone, Debug)]
pub struct Recorded {
    fit: Sides,
    held_back: Sides,
}

/// Samples of left and right turns, and of no side.
#[derive(Clone, Debug)]
struct Sides {
    left: Vec<Sample>,
    right: Vec<Sample>,
    any: Vec<Sample>,
}

impl Recorded {
    /// Samples of no side: to solve with, and to verify with.
    #[must_use]
    pub fn of_no_side(fit: Vec<Sample>, held_back: Vec<Sample>) -> Self {
        let [fit, held_back] = [fit, held_back].map(|any| Sides { left: Vec::new(), right: Vec::new(), any });
        Self { fit, held_back }
    }

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
        let [left, right] = [left, right].map(|side| side.iter().map(&mut sample).collect());
        Self { left, right, any: Vec::new() }
    }

    fn samples(&self) -> Samples<'_> {
        Samples { left: &self.left, right: &self.right, any: [&self.any, &[], &[]], ..Samples::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All attitudes of an envelope are what it says: 20 deg from the vertical, whichever the side.
    #[test]
    fn a_tilt_is_the_same_to_all_sides() {
        let mut directions = std::collections::BTreeSet::new();
        for euler in Envelope::Tilted.attitudes().skip(12) {
            let tilt_deg = (euler.roll_rad.cos() * euler.pitch_rad.cos()).acos().to_degrees();
            assert!((tilt_deg - 20.0).abs() < 0.2, "{tilt_deg}");
            directions.insert(euler.roll_rad.atan2(euler.pitch_rad).to_degrees().round() as i32);
        }
        assert_eq!(directions.len(), 8);
        assert_eq!(Envelope::Tilted.attitudes().count(), 108);
        assert!(Envelope::Banked.attitudes().all(|euler| euler.pitch_rad.abs() < 1e-9));
    }

    /// 2.6 m/s^2 make 1.04 deg, which add to the noise of 0.2 to 1 deg as squares do; 2,000 samples know it to 2 %.
    #[test]
    fn attitude_is_worse_while_it_is_pushed_about() {
        let instant = |push_m_s2| Instant {
            euler: Euler::from_deg(3.0, -4.0, 100.0),
            push_m_s2,
            rates: Rates::from_rad_s([0.1, -0.2, 0.3]),
            time: WrappingMillis::new(7),
        };
        let trial = Trial::draw(&Ranges::HARSH, 3);
        for (push_m_s2, by_push_deg) in [(0.0, 0.0), (2.6, 1.04)] {
            let trial = trial.clone().flying(vec![instant(push_m_s2); 2000], Envelope::Tilted);
            let (samples, _) = trial.record_all(0, Faults::NONE);
            let squares = samples.iter().map(|s| f64::from(s.attitude.roll_rad.to_degrees() - 3.0).powi(2));
            let sigma_deg = (squares.sum::<f64>() / 2000.0).sqrt();
            let expected_deg = trial.attitude_sigma_rad.to_degrees().hypot(by_push_deg);
            assert!((sigma_deg / expected_deg - 1.0).abs() < 0.06, "{sigma_deg} for {expected_deg}");
            assert!(samples.iter().all(|s| s.rates == Rates::from_rad_s([0.1, -0.2, 0.3]) && s.time.count() == 7));
        }
    }

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
