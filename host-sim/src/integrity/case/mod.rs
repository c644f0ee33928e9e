//! The cases: what is wrong, when, and on which flight.

mod list;

use std::f64::consts::TAU;
use std::rc::Rc;

use nalgebra::Vector3;

use super::Source;
use crate::faults::attitude::{Aligning, Bias, Coarse, Foreign, Frozen, Late, Lean, Rates, Spikes};
use crate::faults::field::{Drift, Elsewhere, Moved, Passing, Throttle};
use crate::faults::sensor::{Clipped, Noisy, SensorFault, Spiky, Stuck, Upset};
use crate::faults::{Faults, Switch};
use crate::random::{Purpose, Random};
use crate::routine::{Plan, Routine};
use crate::world::WorldConfig;
use crate::world::aircraft::Kind;
use crate::world::attitude_source::Kind as Sender;
use crate::world::earth::Earth;
use crate::world::rotation::Euler;

pub use list::CASES;

/// A fault and the flights it is tried on.
#[derive(Debug)]
pub struct Case {
    /// What it is called on the command line and in JSON.
    pub name: &'static str,
    /// What is wrong, in words.
    pub says: &'static str,
    what: What,
}

/// When the fault acts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Onset {
    /// There is none.
    Never,
    /// All the time.
    Always,
    /// After the calibration: so long after the beginning of its use, and for so long, seconds.
    InUse {
        /// Until it begins.
        after_s: f64,
        /// For so long; infinite: for good.
        for_s: f64,
    },
    /// During the calibration: from so long after its beginning on, until so long after it, seconds.
    Calibrating {
        /// Until it begins.
        after_s: f64,
        /// When it ends; infinite: never.
        until_s: f64,
    },
}

/// A case, drawn for a seed.
pub struct Drawn {
    /// Airframe, place, weather, attitude source.
    pub world: WorldConfig,
    /// How the calibration is flown.
    pub routine: Routine,
    /// What is wrong.
    pub faults: Faults,
    /// Turns it on.
    pub switch: Switch,
    /// When.
    pub onset: Onset,
    /// For so long it stands on the ground first, anywhere, seconds.
    pub stands_s: f64,
    /// How long the calibration is used after that, seconds.
    pub use_s: f64,
}

#[derive(Clone, Copy, Debug)]
enum What {
    Nothing,
    TenHours,
    Stuck([bool; 3]),
    SensorSpikes,
    StuckNoisy,
    SensorNoise,
    SensorClipped,
    CalibrationClipped,
    Upset { register: u8, bits: u8 },
    FrozenLevel,
    FrozenTurning,
    FrozenCoarse,
    Coarse,
    AttitudeSpikes,
    Foreign(Option<Sender>),
    Bias(f64),
    Lean(f64),
    CalibrationLean(f64),
    Late(u64),
    Rates(f64),
    Aligning,
    Moved(f64),
    CalibrationMoved(f64),
    Throttle(f64),
    Warming,
    CalibrationWarming,
    Hover,
    Pushed(f64),
    Current { ut: f64, is_told: bool },
    Passing { peak_ut: f64, for_s: f64 },
    Ferry,
    ShallowTurns,
}

/// A flight in use, seconds: the first legs are the same for all, see [`flight`](super::flight).
const USE_S: f64 = 185.0;

/// Into level flight, and into a turn.
pub(super) const LEVEL_AT_S: f64 = 25.0;
pub(super) const TURNING_AT_S: f64 = 48.0;

/// What needs no certain moment.
const SOON_S: f64 = 10.0;

/// What comes and goes.
const PASSING_AT_S: f64 = 60.0;

/// It stands for so long before it flies again, while its autopilot has restarted and aligns, as a real one did.
const STANDS_S: f64 = 60.0;
const ALIGNS_S: f64 = 10.0;

/// The earliest end of a calibration after its beginning, seconds. An aeroplane's takes four circles at 25 deg of bank to
/// one side, and as many to the other as it takes: of 60 flights it took 196 to 215 s. A copter's may be good enough when
/// it has been pushed about on two headings.
const fn calibration_s(aircraft: Kind) -> f64 {
    if aircraft.hovers() { 60.0 } else { 195.0 }
}

/// Counts of a microtesla at the range that the module sets.
const COUNTS_PER_UT: f64 = 68.42;

/// Of a LIS3MDL, counts.
const SENSOR_SIGMA: f64 = 0.32 * COUNTS_PER_UT;

/// The case of a name.
#[must_use]
pub fn named(name: &str) -> Option<&'static Case> {
    CASES.iter().find(|case| case.name == name)
}

impl Case {
    /// How many flights of it, where so many are asked for: one of ten hours is enough.
    #[must_use]
    pub fn flights(&self, asked: u64) -> u64 {
        if matches!(self.what, What::TenHours) { 1 } else { asked }
    }

    /// Whether hard iron moves in use and stays where it is then: the module is to say by how much.
    #[must_use]
    pub fn moves_iron(&self) -> bool {
        matches!(self.what, What::Moved(_))
    }

    /// Whether it is one for such an aircraft: nothing hovers for ten hours or calibrates by its bank, and an aeroplane is
    /// not pushed about.
    #[must_use]
    pub const fn is_for(&self, aircraft: Kind) -> bool {
        match self.what {
            What::TenHours | What::ShallowTurns => !aircraft.hovers(),
            What::Hover | What::Pushed(_) | What::Current { .. } => aircraft.hovers(),
            _ => true,
        }
    }

    /// Whether it is one of such a source: MSP has one sender and no rates.
    #[must_use]
    pub const fn is_of(&self, source: Source) -> bool {
        matches!(source, Source::Mavlink) || !matches!(self.what, What::Foreign(_) | What::Rates(_) | What::Aligning)
    }

    /// What happens on the flight of a seed.
    #[must_use]
    pub fn draw(&self, seed: u64, aircraft: Kind) -> Drawn {
        let mut random = Random::new(seed, Purpose::Case);
        let switch = Switch::off();
        let mut drawn = Drawn {
            world: WorldConfig::random(seed).carried_by(aircraft),
            routine: Routine::of(aircraft, Plan::default(), 0.0),
            faults: Faults::default(),
            switch: switch.clone(),
            onset: Onset::Never,
            stands_s: 0.0,
            use_s: USE_S,
        };
        match self.what {
            What::Nothing
            | What::TenHours
            | What::ShallowTurns
            | What::Coarse
            | What::FrozenCoarse
            | What::Hover
            | What::Pushed(_)
            | What::Current { .. } => self.flight(&mut drawn),
            What::Stuck(_)
            | What::StuckNoisy
            | What::SensorSpikes
            | What::SensorNoise
            | What::SensorClipped
            | What::CalibrationClipped
            | What::Upset { .. } => self.sensor(&mut drawn, &mut random, seed),
            What::FrozenLevel
            | What::FrozenTurning
            | What::AttitudeSpikes
            | What::Foreign(_)
            | What::Bias(_)
            | What::Lean(_)
            | What::CalibrationLean(_)
            | What::Late(_)
            | What::Aligning
            | What::Rates(_) => self.attitude(&mut drawn, &mut random, seed),
            _ => self.field(&mut drawn, &mut random, seed),
        }
        drawn
    }

    fn flight(&self, drawn: &mut Drawn) {
        match self.what {
            What::TenHours => drawn.use_s = 36_000.0,
            What::ShallowTurns => {
                let plan = Plan { bank_deg: 5.0, ..Plan::default() };
                (drawn.routine, drawn.onset) = (Routine::of(Kind::Plane, plan, 0.0), Onset::Always);
            }
            What::Hover => {
                drawn.onset = Onset::Always;
                // Its first part, as long as the whole.
                drawn.routine.parts.truncate(1);
                for part in &mut drawn.routine.parts {
                    part.legs = part.legs.repeat(4);
                }
            }
            What::Pushed(times) => {
                drawn.onset = Onset::Always;
                drawn.world.attitude_source.push_error_deg *= times;
            }
            What::Current { ut, is_told } => {
                drawn.onset = Onset::Always;
                drawn.world = WorldConfig { tells_current: is_told, ..drawn.world.with_current(ut) };
            }
            What::FrozenCoarse => {
                drawn.onset = for_good(TURNING_AT_S);
                drawn.faults.attitude.push(Box::new(Coarse { step_deg: 0.1 }));
                drawn.faults.attitude.push(Box::new(Frozen::new(drawn.switch.clone())));
            }
            What::Coarse => drawn.faults.attitude.push(Box::new(Coarse { step_deg: 0.1 })),
            _ => {}
        }
    }

    fn sensor(&self, drawn: &mut Drawn, random: &mut Random, seed: u64) {
        let switch = drawn.switch.clone();
        drawn.onset = for_good(SOON_S);
        let fault: Box<dyn SensorFault> = match self.what {
            What::Stuck(axes) => {
                drawn.onset = for_good(random.uniform(SOON_S, TURNING_AT_S));
                Box::new(Stuck::new(switch, axes))
            }
            What::StuckNoisy => {
                drawn.onset = for_good(random.uniform(SOON_S, TURNING_AT_S));
                drawn.faults.sensor.push(Box::new(Stuck::new(switch.clone(), [true; 3])));
                Box::new(Noisy::new(switch, SENSOR_SIGMA, seed))
            }
            What::SensorSpikes => Box::new(Spiky::new(switch, 0.01, 30.0 * COUNTS_PER_UT, seed)),
            What::SensorNoise => Box::new(Noisy::new(switch, 24_f64.sqrt() * SENSOR_SIGMA, seed)),
            What::Upset { register, bits } => Box::new(Upset { switch, register, bits, done: false }),
            _ => {
                if matches!(self.what, What::CalibrationClipped) {
                    drawn.onset = Onset::Always;
                }
                let axis = (random.uniform(0.0, 3.0) as usize).min(2);
                let limit = clip_at(&drawn.world, axis, random.uniform(0.3, 0.95));
                Box::new(Clipped { switch, axis, limit })
            }
        };
        drawn.faults.sensor.push(fault);
    }

    fn attitude(&self, drawn: &mut Drawn, random: &mut Random, seed: u64) {
        let switch = drawn.switch.clone();
        drawn.onset = for_good(SOON_S);
        let faults = &mut drawn.faults;
        match self.what {
            What::FrozenLevel => {
                drawn.onset = for_good(LEVEL_AT_S);
                faults.attitude.push(Box::new(Frozen::new(switch)));
            }
            What::FrozenTurning => {
                drawn.onset = for_good(TURNING_AT_S);
                faults.attitude.push(Box::new(Frozen::new(switch)));
            }
            What::AttitudeSpikes => faults.attitude.push(Box::new(Spikes::new(switch, 0.01, seed))),
            What::Foreign(heartbeats) => {
                // It is there from the beginning; what is counted is the use.
                drawn.onset = Onset::Always;
                faults.senders.push(Foreign { system_id: 1, component_id: 154, heartbeats, roll_deg: 5.0 });
            }
            What::Bias(degrees) => {
                let direction_rad = random.uniform(0.0, TAU);
                let bias_rad = [direction_rad.cos(), direction_rad.sin()].map(|part| degrees.to_radians() * part);
                faults.attitude.push(Box::new(Bias { switch, bias_rad }));
            }
            What::Late(ms) => faults.attitude.push(Box::new(Late { switch, by_us: ms * 1000 })),
            What::Rates(factor) => faults.attitude.push(Box::new(Rates { switch, factor })),
            What::Aligning => {
                drawn.stands_s = STANDS_S;
                drawn.onset = Onset::InUse { after_s: SOON_S, for_s: ALIGNS_S };
                let [swing_deg, roll_s, pitch_s] =
                    [(3.0, 40.0), (1.5, 6.0), (1.5, 6.0)].map(|(a, b)| random.uniform(a, b));
                faults.attitude.push(Box::new(Aligning { switch, swing_deg, periods_s: [roll_s, pitch_s] }));
            }
            What::Lean(told) => faults.attitude.push(Box::new(Lean { switch, told })),
            What::CalibrationLean(told) => {
                drawn.onset = Onset::Always;
                faults.attitude.push(Box::new(Lean { switch, told }));
            }
            _ => {}
        }
    }

    fn field(&self, drawn: &mut Drawn, random: &mut Random, seed: u64) {
        let switch = drawn.switch.clone();
        let calibration_s = calibration_s(drawn.world.aircraft.kind);
        let mut by = |ut: f64| -> Vector3<f64> { random.direction() * ut };
        drawn.onset = for_good(SOON_S);
        drawn.faults.field.push(match self.what {
            What::Moved(ut) => Rc::new(Moved { switch, change_ut: by(ut) }),
            What::CalibrationMoved(ut) => {
                let change_ut = by(ut);
                let after_s = random.uniform(0.0, calibration_s);
                drawn.onset = Onset::Calibrating { after_s, until_s: f64::INFINITY };
                Rc::new(Moved { switch, change_ut })
            }
            What::Throttle(ut) => Rc::new(Throttle::new(switch, by(ut), seed)),
            What::Warming => {
                drawn.onset = Onset::InUse { after_s: SOON_S, for_s: USE_S - SOON_S };
                Rc::new(Drift { switch, change_ut: by(10.0) })
            }
            What::CalibrationWarming => {
                drawn.onset = Onset::Calibrating { after_s: 0.0, until_s: calibration_s };
                Rc::new(Drift { switch, change_ut: by(10.0) })
            }
            What::Passing { peak_ut, for_s } => {
                drawn.onset = Onset::InUse { after_s: PASSING_AT_S, for_s };
                Rc::new(Passing { switch, peak_ut: by(peak_ut) })
            }
            _ => {
                drawn.world.earth = Earth { total_ut: 50.0, inclination_deg: 60.0 };
                let earth = Earth { total_ut: random.uniform(45.0, 55.0), inclination_deg: random.uniform(50.0, 70.0) };
                Rc::new(Elsewhere { switch, earth })
            }
        });
    }
}

fn for_good(after_s: f64) -> Onset {
    Onset::InUse { after_s, for_s: f64::INFINITY }
}

/// Where an axis ends that is to be cut off within a level circle: a part of the way from its middle to its end.
fn clip_at(world: &WorldConfig, axis: usize, part: f64) -> i16 {
    let measured = |step: u8| {
        let euler = Euler { heading_rad: f64::from(step) / 36.0 * TAU, ..Euler::from_deg(0.0, 0.0, 0.0) };
        f64::from(world.airframe.measure(&world.earth.body_field_ut(euler)).ut[axis])
    };
    let mean = (0..36).map(measured).sum::<f64>() / 36.0;
    let most = (0..36).map(measured).fold(f64::MIN, f64::max);
    ((mean + (most - mean) * part) * COUNTS_PER_UT).round() as i16
}

#[cfg(test)]
mod tests;
