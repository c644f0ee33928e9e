//! Cases of the integrity study: fault, onset and flight.

mod list;

use std::f64::consts::TAU;
use std::rc::Rc;

use nalgebra::Vector3;

use super::AttitudeProtocol;
use crate::faults::attitude::{
    AdditionalLatency, AttitudeBias, AttitudeQuantisation, AttitudeSpikes, BankScaleError, FilterAlignment,
    FrozenAttitude, RateScaleError, SecondSender,
};
use crate::faults::field::{HardIronChange, OtherPlace, PassingObject, ThrottleInterference, ZeroDrift};
use crate::faults::sensor::{AdditionalNoise, AxisClipping, MeasurementSpikes, RegisterUpset, SensorFault, StuckAxes};
use crate::faults::{Faults, Switch};
use crate::random::{Purpose, Random};
use crate::routine::{Routine, TurnPlan};
use crate::world::WorldConfig;
use crate::world::aircraft::VehicleKind;
use crate::world::attitude_source::SenderKind as Sender;
use crate::world::earth::Earth;
use crate::world::rotation::Euler;

pub use list::CASES;

/// Fault and the flights on which it is tested.
#[derive(Debug)]
pub struct Case {
    /// Name on the command line and in JSON.
    pub name: &'static str,
    /// Description of the fault.
    pub description: &'static str,
    fault: FaultKind,
}

/// Time during which the fault is active.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Onset {
    /// No fault.
    Never,
    /// During calibration and use.
    Always,
    /// During use after the calibration.
    InUse {
        /// Time from the start of use to the onset, seconds.
        after_s: f64,
        /// Duration, seconds; infinite for a permanent fault.
        for_s: f64,
    },
    /// During the calibration.
    Calibrating {
        /// Time from the start of the calibration to the onset, seconds.
        after_s: f64,
        /// Time from the start of the calibration to the end of the fault, seconds; infinite for a permanent fault.
        until_s: f64,
    },
}

/// Case with random values drawn from a seed.
pub struct DrawnCase {
    /// Airframe, place, weather, attitude source.
    pub world: WorldConfig,
    /// Calibration routine.
    pub routine: Routine,
    /// Injected faults.
    pub faults: Faults,
    /// Switch that activates the faults.
    pub switch: Switch,
    /// Time during which the fault is active.
    pub onset: Onset,
    /// Time on the ground before use, seconds.
    pub ground_time_s: f64,
    /// Duration of use, seconds.
    pub use_s: f64,
}

#[derive(Clone, Copy, Debug)]
enum FaultKind {
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
    Current { ut: f64, is_reported: bool },
    Passing { peak_ut: f64, for_s: f64 },
    Ferry,
    ShallowTurns,
}

/// Duration of a flight in use, seconds. The first legs are the same for all (see [`flight`](super::flight)).
const USE_S: f64 = 185.0;

/// Times in level flight and in a turn after the start of use, seconds.
pub(super) const LEVEL_FLIGHT_S: f64 = 25.0;
pub(super) const IN_TURN_S: f64 = 48.0;

/// Onset of faults without a special time, seconds after the start of use.
const SOON_S: f64 = 10.0;

/// Onset of passing disturbances, seconds after the start of use.
const PASSING_AT_S: f64 = 60.0;

/// Time on the ground, and alignment time of the restarted autopilot within it, as observed on a real one, seconds.
const STANDS_S: f64 = 60.0;
const ALIGNS_S: f64 = 10.0;

/// Shortest calibration, seconds. An aeroplane flies four circles at 25 deg of bank to one side and as many as
/// necessary to the other: 196 to 215 s in 60 flights. A copter's calibration may be complete after accelerations on
/// two headings.
const fn calibration_s(aircraft: VehicleKind) -> f64 {
    if aircraft.can_hover() { 60.0 } else { 195.0 }
}

const COUNTS_PER_UT: f64 = 68.42;

const SENSOR_SIGMA: f64 = 0.32 * COUNTS_PER_UT;

/// The case with this name, if any.
#[must_use]
pub fn find_by_name(name: &str) -> Option<&'static Case> {
    CASES.iter().find(|case| case.name == name)
}

impl Case {
    /// Number of flights; the ten-hour case has one.
    #[must_use]
    pub fn flights(&self, asked: u64) -> u64 {
        if matches!(self.fault, FaultKind::TenHours) { 1 } else { asked }
    }

    /// Whether hard iron changes permanently in use, so that the module should estimate the change.
    #[must_use]
    pub fn changes_hard_iron(&self) -> bool {
        matches!(self.fault, FaultKind::Moved(_))
    }

    /// Whether the case applies to this vehicle.
    #[must_use]
    pub const fn applies_to_vehicle(&self, aircraft: VehicleKind) -> bool {
        match self.fault {
            FaultKind::TenHours | FaultKind::ShallowTurns => !aircraft.can_hover(),
            FaultKind::Hover | FaultKind::Pushed(_) | FaultKind::Current { .. } => aircraft.can_hover(),
            _ => true,
        }
    }

    /// Whether the case applies to this attitude source: MSP has one sender and no body rates.
    #[must_use]
    pub const fn applies_to_protocol(&self, source: AttitudeProtocol) -> bool {
        matches!(source, AttitudeProtocol::Mavlink)
            || !matches!(self.fault, FaultKind::Foreign(_) | FaultKind::Rates(_) | FaultKind::Aligning)
    }

    /// Draws the flight of a seed.
    #[must_use]
    pub fn draw(&self, seed: u64, aircraft: VehicleKind) -> DrawnCase {
        let mut random = Random::new(seed, Purpose::Case);
        let switch = Switch::off();
        let mut drawn = DrawnCase {
            world: WorldConfig::random(seed).with_vehicle_kind(aircraft),
            routine: Routine::for_vehicle(aircraft, TurnPlan::default(), 0.0),
            faults: Faults::default(),
            switch: switch.clone(),
            onset: Onset::Never,
            ground_time_s: 0.0,
            use_s: USE_S,
        };
        match self.fault {
            FaultKind::Nothing
            | FaultKind::TenHours
            | FaultKind::ShallowTurns
            | FaultKind::Coarse
            | FaultKind::FrozenCoarse
            | FaultKind::Hover
            | FaultKind::Pushed(_)
            | FaultKind::Current { .. } => self.flight(&mut drawn),
            FaultKind::Stuck(_)
            | FaultKind::StuckNoisy
            | FaultKind::SensorSpikes
            | FaultKind::SensorNoise
            | FaultKind::SensorClipped
            | FaultKind::CalibrationClipped
            | FaultKind::Upset { .. } => self.sensor(&mut drawn, &mut random, seed),
            FaultKind::FrozenLevel
            | FaultKind::FrozenTurning
            | FaultKind::AttitudeSpikes
            | FaultKind::Foreign(_)
            | FaultKind::Bias(_)
            | FaultKind::Lean(_)
            | FaultKind::CalibrationLean(_)
            | FaultKind::Late(_)
            | FaultKind::Aligning
            | FaultKind::Rates(_) => self.attitude(&mut drawn, &mut random, seed),
            _ => self.field(&mut drawn, &mut random, seed),
        }
        drawn
    }

    fn flight(&self, drawn: &mut DrawnCase) {
        match self.fault {
            FaultKind::TenHours => drawn.use_s = 36_000.0,
            FaultKind::ShallowTurns => {
                let plan = TurnPlan { bank_deg: 5.0, ..TurnPlan::default() };
                (drawn.routine, drawn.onset) = (Routine::for_vehicle(VehicleKind::Plane, plan, 0.0), Onset::Always);
            }
            FaultKind::Hover => {
                drawn.onset = Onset::Always;
                // Repeats the routine's first part (yaw turns) up to the duration of the whole routine.
                drawn.routine.parts.truncate(1);
                for part in &mut drawn.routine.parts {
                    part.legs = part.legs.repeat(4);
                }
            }
            FaultKind::Pushed(times) => {
                drawn.onset = Onset::Always;
                drawn.world.attitude_source.push_error_deg *= times;
            }
            FaultKind::Current { ut, is_reported: is_told } => {
                drawn.onset = Onset::Always;
                drawn.world = WorldConfig { reports_current: is_told, ..drawn.world.with_current_interference(ut) };
            }
            FaultKind::FrozenCoarse => {
                drawn.onset = for_good(IN_TURN_S);
                drawn.faults.attitude.push(Box::new(AttitudeQuantisation { resolution_deg: 0.1 }));
                drawn.faults.attitude.push(Box::new(FrozenAttitude::new(drawn.switch.clone())));
            }
            FaultKind::Coarse => drawn.faults.attitude.push(Box::new(AttitudeQuantisation { resolution_deg: 0.1 })),
            _ => {}
        }
    }

    fn sensor(&self, drawn: &mut DrawnCase, random: &mut Random, seed: u64) {
        let switch = drawn.switch.clone();
        drawn.onset = for_good(SOON_S);
        let fault: Box<dyn SensorFault> = match self.fault {
            FaultKind::Stuck(axes) => {
                drawn.onset = for_good(random.uniform(SOON_S, IN_TURN_S));
                Box::new(StuckAxes::new(switch, axes))
            }
            FaultKind::StuckNoisy => {
                drawn.onset = for_good(random.uniform(SOON_S, IN_TURN_S));
                drawn.faults.sensor.push(Box::new(StuckAxes::new(switch.clone(), [true; 3])));
                Box::new(AdditionalNoise::new(switch, SENSOR_SIGMA, seed))
            }
            FaultKind::SensorSpikes => Box::new(MeasurementSpikes::new(switch, 0.01, 30.0 * COUNTS_PER_UT, seed)),
            FaultKind::SensorNoise => Box::new(AdditionalNoise::new(switch, 24_f64.sqrt() * SENSOR_SIGMA, seed)),
            FaultKind::Upset { register, bits } => {
                Box::new(RegisterUpset { switch, register, bits, has_occurred: false })
            }
            _ => {
                if matches!(self.fault, FaultKind::CalibrationClipped) {
                    drawn.onset = Onset::Always;
                }
                let axis = (random.uniform(0.0, 3.0) as usize).min(2);
                let limit = clip_at(&drawn.world, axis, random.uniform(0.3, 0.95));
                Box::new(AxisClipping { switch, axis, limit_counts: limit })
            }
        };
        drawn.faults.sensor.push(fault);
    }

    fn attitude(&self, drawn: &mut DrawnCase, random: &mut Random, seed: u64) {
        let switch = drawn.switch.clone();
        drawn.onset = for_good(SOON_S);
        let faults = &mut drawn.faults;
        match self.fault {
            FaultKind::FrozenLevel => {
                drawn.onset = for_good(LEVEL_FLIGHT_S);
                faults.attitude.push(Box::new(FrozenAttitude::new(switch)));
            }
            FaultKind::FrozenTurning => {
                drawn.onset = for_good(IN_TURN_S);
                faults.attitude.push(Box::new(FrozenAttitude::new(switch)));
            }
            FaultKind::AttitudeSpikes => faults.attitude.push(Box::new(AttitudeSpikes::new(switch, 0.01, seed))),
            FaultKind::Foreign(heartbeats) => {
                // Present from the beginning; only use is evaluated.
                drawn.onset = Onset::Always;
                faults.senders.push(SecondSender {
                    system_id: 1,
                    component_id: 154,
                    heartbeat_kind: heartbeats,
                    roll_error_deg: 5.0,
                });
            }
            FaultKind::Bias(degrees) => {
                let direction_rad = random.uniform(0.0, TAU);
                let bias_rad = [direction_rad.cos(), direction_rad.sin()].map(|part| degrees.to_radians() * part);
                faults.attitude.push(Box::new(AttitudeBias { switch, bias_rad }));
            }
            FaultKind::Late(ms) => faults.attitude.push(Box::new(AdditionalLatency { switch, latency_us: ms * 1000 })),
            FaultKind::Rates(factor) => faults.attitude.push(Box::new(RateScaleError { switch, factor })),
            FaultKind::Aligning => {
                drawn.ground_time_s = STANDS_S;
                drawn.onset = Onset::InUse { after_s: SOON_S, for_s: ALIGNS_S };
                let [swing_deg, roll_s, pitch_s] =
                    [(3.0, 40.0), (1.5, 6.0), (1.5, 6.0)].map(|(a, b)| random.uniform(a, b));
                faults.attitude.push(Box::new(FilterAlignment {
                    switch,
                    amplitude_deg: swing_deg,
                    periods_s: [roll_s, pitch_s],
                }));
            }
            FaultKind::Lean(told) => faults.attitude.push(Box::new(BankScaleError { switch, reported_ratio: told })),
            FaultKind::CalibrationLean(told) => {
                drawn.onset = Onset::Always;
                faults.attitude.push(Box::new(BankScaleError { switch, reported_ratio: told }));
            }
            _ => {}
        }
    }

    fn field(&self, drawn: &mut DrawnCase, random: &mut Random, seed: u64) {
        let switch = drawn.switch.clone();
        let calibration_s = calibration_s(drawn.world.aircraft.kind);
        let mut by = |ut: f64| -> Vector3<f64> { random.direction() * ut };
        drawn.onset = for_good(SOON_S);
        drawn.faults.field.push(match self.fault {
            FaultKind::Moved(ut) => Rc::new(HardIronChange { switch, change_ut: by(ut) }),
            FaultKind::CalibrationMoved(ut) => {
                let change_ut = by(ut);
                let after_s = random.uniform(0.0, calibration_s);
                drawn.onset = Onset::Calibrating { after_s, until_s: f64::INFINITY };
                Rc::new(HardIronChange { switch, change_ut })
            }
            FaultKind::Throttle(ut) => Rc::new(ThrottleInterference::new(switch, by(ut), seed)),
            FaultKind::Warming => {
                drawn.onset = Onset::InUse { after_s: SOON_S, for_s: USE_S - SOON_S };
                Rc::new(ZeroDrift { switch, change_ut: by(10.0) })
            }
            FaultKind::CalibrationWarming => {
                drawn.onset = Onset::Calibrating { after_s: 0.0, until_s: calibration_s };
                Rc::new(ZeroDrift { switch, change_ut: by(10.0) })
            }
            FaultKind::Passing { peak_ut, for_s } => {
                drawn.onset = Onset::InUse { after_s: PASSING_AT_S, for_s };
                Rc::new(PassingObject { switch, peak_ut: by(peak_ut) })
            }
            _ => {
                drawn.world.earth = Earth { total_ut: 50.0, inclination_deg: 60.0 };
                let earth = Earth { total_ut: random.uniform(45.0, 55.0), inclination_deg: random.uniform(50.0, 70.0) };
                Rc::new(OtherPlace { switch, earth })
            }
        });
    }
}

fn for_good(after_s: f64) -> Onset {
    Onset::InUse { after_s, for_s: f64::INFINITY }
}

/// Saturation limit of an axis within its range on a level circle, at a fraction of the way from its mean to its
/// maximum, counts.
fn clip_at(world: &WorldConfig, axis: usize, part: f64) -> i16 {
    let measured = |step: u8| {
        let euler = Euler { heading_rad: f64::from(step) / 36.0 * TAU, ..Euler::from_deg(0.0, 0.0, 0.0) };
        f64::from(world.airframe.measured_field(&world.earth.body_field_ut(euler)).ut[axis])
    };
    let mean = (0..36).map(measured).sum::<f64>() / 36.0;
    let most = (0..36).map(measured).fold(f64::MIN, f64::max);
    ((mean + (most - mean) * part) * COUNTS_PER_UT).round() as i16
}

#[cfg(test)]
mod tests;
