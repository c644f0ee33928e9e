//! The world as a whole: it advances the vehicle, and answers for any instant of the last two seconds.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use autoswing::frames::{Field, Sensor};
use autoswing::inertial::GRAVITY_M_S2;
use log_analysis::numbers::f32_as_f64;
use nalgebra::Vector3;
use testkit::clock;

use super::aircraft::{Aircraft, PrescribedMotion, STEP_US, VehicleKind};
use super::autopilot::Leg;
use super::config::WorldConfig;
use super::earth::Earth;
use super::fault_interfaces::FieldFault;
use super::rotation::Euler;
use super::state::TrueState;
use crate::devices::lsm6dsl::{InertialSource, InertialTruth};
use crate::devices::sensor::FieldSource;
use crate::random::{RandomStream, StreamPurpose};

/// Stored past states: 2 s. The slowest sensor setting averages over 1.6 s.
const HISTORY_STEPS: usize = 400;

/// Mean age of a reported current, microseconds: half of the reporting period of 100 ms.
const REPORTED_CURRENT_AGE_US: u64 = 50_000;

struct WorldState {
    config: WorldConfig,
    aircraft: Aircraft,
    /// Past states, one per step, newest last; never empty.
    history: VecDeque<TrueState>,
    disturbance_ut: Vector3<f64>,
    is_armed: bool,
    sends_attitude: bool,
}

/// Cloneable handle to the world. Reading a later state advances the world to that time.
#[derive(Clone)]
pub struct World(Rc<RefCell<WorldState>>);

impl World {
    /// A world that starts now, with the vehicle at its initial state.
    #[must_use]
    pub fn new(config: WorldConfig) -> Self {
        let aircraft = Aircraft::new(config.aircraft, config.weather, config.seed, clock::now_us());
        let history = VecDeque::from([*aircraft.true_state()]);
        Self(Rc::new(RefCell::new(WorldState {
            config,
            aircraft,
            history,
            disturbance_ut: Vector3::zeros(),
            is_armed: false,
            sends_attitude: true,
        })))
    }

    /// Settings of the world.
    #[must_use]
    pub fn world_config(&self) -> WorldConfig {
        self.0.borrow().config
    }

    /// True state at a time between two seconds ago and now.
    #[must_use]
    pub fn true_state(&self, at_us: u64) -> TrueState {
        self.0.borrow_mut().true_state(at_us)
    }

    /// Motor current that the autopilot reports, amperes: the mean over the last reporting period; `None` if not
    /// measured.
    #[must_use]
    pub fn reported_current_a(&self, now_us: u64) -> Option<f64> {
        let is_reported = self.world_config().reports_current;
        is_reported.then(|| self.true_state(now_us.saturating_sub(REPORTED_CURRENT_AGE_US)).current_a())
    }

    /// Outputs of the autopilot to servos and speed controllers, 0 to 1.
    #[must_use]
    pub fn outputs(&self, at_us: u64) -> [f64; 4] {
        outputs(&self.world_config(), &self.true_state(at_us))
    }

    /// Field in chip axes at a time between two seconds ago and now.
    #[must_use]
    pub fn sensor_field(&self, at_us: u64) -> Field<Sensor> {
        self.0.borrow_mut().sensor_field(at_us, None)
    }

    /// Field input of a LIS3MDL. The first fault with a field of another place replaces the Earth's field; added fields
    /// are summed.
    #[must_use]
    pub fn magnetometer_source(&self, faults: Vec<Rc<dyn FieldFault>>) -> FieldSource {
        let world = self.clone();
        Box::new(move |at_us| {
            let earth = faults.iter().find_map(|fault| fault.replacement_earth(at_us));
            let field = world.0.borrow_mut().sensor_field(at_us, earth);
            let truth = world.true_state(at_us);
            let added: Vector3<f64> = faults.iter().map(|fault| fault.added_field_ut(&truth)).sum();
            Field::new(field.ut + added.cast())
        })
    }

    /// Clears the flight plan and holds a bank and a pitch.
    pub fn hold_bank_and_pitch(&self, bank_deg: f64, pitch_deg: f64) {
        self.advanced_to_now().aircraft.autopilot_mut().hold_bank_and_pitch(bank_deg, pitch_deg);
    }

    /// Clears the flight plan; the vehicle continues wings level, or hovers.
    pub fn clear_plan(&self) {
        self.advanced_to_now().aircraft.autopilot_mut().clear_plan();
    }

    /// Appends a leg to the flight plan.
    pub fn append_leg(&self, leg: Leg) {
        self.advanced_to_now().aircraft.autopilot_mut().append_leg(leg);
    }

    /// Number of unfinished legs, the present one included.
    #[must_use]
    pub fn unfinished_leg_count(&self) -> usize {
        self.advanced_to_now().aircraft.autopilot().unfinished_leg_count()
    }

    /// Starts a prescribed motion: on level ground, at a heading, on a bench.
    pub fn set_prescribed_motion(&self, prescribed_motion: PrescribedMotion) {
        self.advanced_to_now().aircraft.set_prescribed_motion(prescribed_motion);
    }

    /// Stands still at the present attitude and heading, until [`end_prescribed_motion`](Self::end_prescribed_motion).
    pub fn hold_still(&self) {
        let now = *self.advanced_to_now().aircraft.true_state();
        // The heading not wrapped, so that it does not jump.
        let [roll_deg, pitch_deg, heading_deg] = [now.roll_rad, now.pitch_rad, now.heading_rad].map(f64::to_degrees);
        self.set_prescribed_motion(PrescribedMotion {
            roll_deg,
            pitch_deg,
            heading_deg,
            ..PrescribedMotion::default()
        });
    }

    /// Ends a prescribed motion; the vehicle model continues at the present position.
    pub fn end_prescribed_motion(&self) {
        self.advanced_to_now().aircraft.end_prescribed_motion();
    }

    /// Moves toward an attitude received now from an external simulator.
    pub fn follow_attitude(&self, received: Euler) {
        self.advanced_to_now().aircraft.follow_attitude(received);
    }

    /// Enables or disables sending of attitude. Initially enabled.
    pub fn set_sends_attitude(&self, sends: bool) {
        self.0.borrow_mut().sends_attitude = sends;
    }

    /// Whether sending of attitude is enabled.
    #[must_use]
    pub fn sends_attitude(&self) -> bool {
        self.0.borrow().sends_attitude
    }

    /// Sets a disturbing field in chip axes, microtesla; zero removes it. A few hundred microtesla saturate the chip.
    pub fn set_disturbance_ut(&self, field_ut: [f64; 3]) {
        self.advanced_to_now().disturbance_ut = field_ut.into();
    }

    /// Sets the motor-current interference in chip axes at cruise or hover current, microtesla; proportional to the
    /// current.
    pub fn set_current_interference_ut(&self, current_ut: [f64; 3]) {
        self.advanced_to_now().config.current_interference_ut = current_ut;
    }

    /// Enables or disables reporting of the motor current.
    pub fn set_reports_current(&self, is_reported: bool) {
        self.advanced_to_now().config.reports_current = is_reported;
    }

    /// Arms or disarms the autopilot, reported by the next heartbeat. Initially disarmed.
    pub fn set_armed(&self, is_armed: bool) {
        self.0.borrow_mut().is_armed = is_armed;
    }

    /// Whether the autopilot is armed.
    #[must_use]
    pub fn is_armed(&self) -> bool {
        self.0.borrow().is_armed
    }

    /// The state advanced to now, so that commands do not affect the past.
    fn advanced_to_now(&self) -> std::cell::RefMut<'_, WorldState> {
        let mut inner = self.0.borrow_mut();
        inner.advance_to(clock::now_us());
        inner
    }
}

impl WorldState {
    fn advance_to(&mut self, to_us: u64) {
        while self.aircraft.true_state().time_us < to_us {
            self.aircraft.advance_step();
            if self.history.len() == HISTORY_STEPS {
                self.history.pop_front();
            }
            self.history.push_back(*self.aircraft.true_state());
        }
    }

    fn true_state(&mut self, at_us: u64) -> TrueState {
        self.advance_to(at_us);
        let oldest_us = self.history[0].time_us;
        let elapsed_us = at_us.saturating_sub(oldest_us);
        let index = (elapsed_us / STEP_US) as usize;
        let earlier = &self.history[index];
        match self.history.get(index + 1) {
            Some(later) if at_us > earlier.time_us => earlier.interpolate(later, at_us),
            _ => *earlier,
        }
    }

    /// Field in chip axes; `other_earth` replaces the configured Earth's field.
    fn sensor_field(&mut self, at_us: u64, other_earth: Option<Earth>) -> Field<Sensor> {
        let truth = self.true_state(at_us);
        let body_ut = other_earth.unwrap_or(self.config.earth).body_field_ut(truth.euler_angles());
        let measured = self.config.airframe.measured_field(&body_ut);
        let current_ut = Vector3::from(self.config.current_interference_ut) * truth.relative_current;
        Field::new(measured.ut + (self.disturbance_ut + current_ut).cast())
    }
}

/// Temperature of a board in use, degrees Celsius.
const BOARD_TEMPERATURE_C: f64 = 30.0;

impl World {
    /// Input of an inertial sensor whose axes are those of the body.
    #[must_use]
    pub fn inertial_source(&self) -> InertialSource {
        let world = self.clone();
        Box::new(move |at_us| {
            let before = world.true_state(at_us.saturating_sub(STEP_US));
            inertial_truth(&before, &world.true_state(at_us), BOARD_TEMPERATURE_C)
        })
    }
}

/// Mean motion between two states, in body axes. The vehicle keeps its height.
#[must_use]
pub fn inertial_truth(before: &TrueState, after: &TrueState, temperature_c: f64) -> InertialTruth {
    let step_s = after.time_us.saturating_sub(before.time_us).max(1) as f64 * 1e-6;
    let gained = Vector3::new(after.north_m_s - before.north_m_s, after.east_m_s - before.east_m_s, 0.0);
    let force = gained / step_s - Vector3::new(0.0, 0.0, f32_as_f64(GRAVITY_M_S2));
    InertialTruth {
        rates_rad_s: after.body_rates_rad_s().into(),
        specific_force_m_s2: after.euler_angles().body_from_earth() * force,
        temperature_c,
    }
}

/// Throttle in cruise or hover.
const CRUISE_THROTTLE: f64 = 0.4;

/// Throttle by which the outputs answer gusts, root mean square.
const GUST_THROTTLE: f64 = 0.06;

/// Intervals between the gusts that are interpolated, microseconds.
const GUST_INTERVALS_US: [u64; 2] = [700_000, 5_000_000];

/// Deflection per body rate, of the range per rad/s.
const DEFLECTION_PER_RATE: f64 = 0.3;

/// Deflection of the elevator per load factor above one, of the range.
const ELEVATOR_PER_LOAD: f64 = 0.3;

/// Directions in which each motor of an X frame lifts, of roll, pitch and yaw: front right, rear left, front left, rear
/// right.
const MIX: [[f64; 3]; 4] = [[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]];

/// Outputs at a time, 0 to 1: four motors of a copter; aileron, elevator, throttle and rudder of others, as ArduPilot
/// numbers them.
#[must_use]
pub(super) fn outputs(config: &WorldConfig, truth: &TrueState) -> [f64; 4] {
    let gusts: [f64; 4] = std::array::from_fn(|control| gust(config.seed, control as u64, truth.time_us));
    // Propellers draw a power of the throttle: 1.5 after the momentum theory of a hovering rotor.
    let throttle = CRUISE_THROTTLE * libm::pow(truth.relative_current, 1.0 / 1.5) + GUST_THROTTLE * gusts[0];
    let rates = truth.body_rates_rad_s();
    let controls: [f64; 3] =
        std::array::from_fn(|axis| DEFLECTION_PER_RATE * rates[axis] + GUST_THROTTLE * gusts[axis + 1]);
    let outputs = if config.aircraft.kind == VehicleKind::Copter {
        MIX.map(|mix| throttle + 0.3 * (0..3).map(|axis| mix[axis] * controls[axis]).sum::<f64>())
    } else {
        let load = libm::cos(truth.roll_rad).max(0.2).recip() - 1.0;
        [0.5 + controls[0], 0.5 - ELEVATOR_PER_LOAD * load + controls[1], throttle, 0.5 + controls[2]]
    };
    outputs.map(|output| output.clamp(0.0, 1.0))
}

/// Answer of a control to gusts, of unit variance: random numbers at fixed times, interpolated.
fn gust(seed: u64, control: u64, time_us: u64) -> f64 {
    GUST_INTERVALS_US
        .iter()
        .map(|interval_us| {
            let knot = time_us / interval_us;
            let number = |knot: u64| {
                let seed =
                    seed.wrapping_mul(0x9E37_79B9).wrapping_add(knot * 8 + control).wrapping_add(interval_us << 20);
                RandomStream::new(seed, StreamPurpose::Throttle).gaussian()
            };
            let weight = (time_us % interval_us) as f64 / *interval_us as f64;
            number(knot) * (1.0 - weight) + number(knot + 1) * weight
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: an acceleration of 1 g to the right at a bank of 45 deg is a coordinated turn, with sqrt(2) g along the
    /// body's z axis.
    #[test]
    fn a_coordinated_turn_has_its_force_along_the_z_axis() {
        let before = TrueState { heading_rad: 0.7, roll_rad: std::f64::consts::FRAC_PI_4, ..TrueState::default() };
        let gained_m_s = 9.806_65 * 0.01;
        let after = TrueState {
            time_us: 10_000,
            north_m_s: -libm::sin(0.7) * gained_m_s,
            east_m_s: libm::cos(0.7) * gained_m_s,
            heading_rate_rad_s: 0.4,
            ..before
        };
        let truth = inertial_truth(&before, &after, 20.0);
        let expected = Vector3::new(0.0, 0.0, -9.806_65 * 2_f64.sqrt());
        assert!((truth.specific_force_m_s2 - expected).norm() < 1e-5, "{}", truth.specific_force_m_s2);
        assert!((truth.rates_rad_s - Vector3::new(0.0, 0.4, 0.4) / 2_f64.sqrt()).norm() < 1e-12);
    }
}
