//! The simulated world: an aircraft in its weather, the Earth's field, the airframe's iron, the autopilot's attitude.
//!
//! | file | holds |
//! |---|---|
//! | `config.rs` | all settings, the airframe file |
//! | `aircraft/`, `autopilot.rs`, `weather.rs` | how it flies, who flies it, what the air does |
//! | `state.rs` | the truth at one instant |
//! | `rotation.rs` | from north, east, down to body axes: the world's own mathematics |
//! | `earth.rs`, `airframe.rs` | the field, and what the iron makes of it |
//! | `table1.rs` | the airframe of Liu 2007 table 1 and the published errors |
//! | `attitude_source/` | MAVLink attitude with the errors of a real source |
//! | `msp_autopilot/` | an autopilot that answers MSP requests and takes a compass's readings |
//! | `mavlink_autopilot/` | an autopilot that is asked for it, and answers |
//! | `far_end.rs` | which of them is at a port |
//! | `gauss_markov.rs` | coloured noise |

pub mod aircraft;
pub mod airframe;
pub mod attitude_source;
pub mod autopilot;
mod config;
pub mod earth;
pub mod far_end;
pub mod gauss_markov;
pub mod mavlink_autopilot;
pub mod msp_autopilot;
pub mod rotation;
mod state;
pub mod table1;
pub mod weather;

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use autoswing::frames::{Field, Sensor};
use nalgebra::Vector3;

use self::aircraft::{Aircraft, Carried, STEP_US};
use self::attitude_source::AttitudeSource;
use self::autopilot::Leg;
pub use self::config::{ConfigError, WorldConfig};
use self::earth::Earth;
use self::rotation::Euler;
pub use self::state::{CRUISE_A, TrueState};
use crate::clock;
use crate::devices::lis3mdl::FieldSource;
use crate::faults::field::FieldFault;

/// How far back the truth can be asked for, in steps: 2 s. The slowest sensor looks back 1.6 s.
const HISTORY_STEPS: usize = 400;

/// Age of a current that is told, microseconds: half the tenth of a second from one to the next.
const CURRENT_AGE_US: u64 = 50_000;

struct Inner {
    config: WorldConfig,
    aircraft: Aircraft,
    /// Past states, one a step, the newest last; never empty.
    history: VecDeque<TrueState>,
    disturbance_ut: Vector3<f64>,
    is_armed: bool,
    sends_attitude: bool,
}

/// The world: a handle, cloned freely. It moves on when somebody asks for a time that it has not reached, so asking
/// costs nothing twice and the flight does not depend on who asks how often.
#[derive(Clone)]
pub struct World(Rc<RefCell<Inner>>);

impl World {
    /// A world that begins now, with the aircraft straight and level.
    #[must_use]
    pub fn new(config: WorldConfig) -> Self {
        let aircraft = Aircraft::new(config.aircraft, config.weather, config.seed, clock::now_us());
        let history = VecDeque::from([*aircraft.state()]);
        Self(Rc::new(RefCell::new(Inner {
            config,
            aircraft,
            history,
            disturbance_ut: Vector3::zeros(),
            is_armed: false,
            sends_attitude: true,
        })))
    }

    /// The settings it was made from.
    #[must_use]
    pub fn config(&self) -> WorldConfig {
        self.0.borrow().config
    }

    /// The truth at a time: now, or up to two seconds ago.
    #[must_use]
    pub fn true_state(&self, at_us: u64) -> TrueState {
        self.0.borrow_mut().true_state(at_us)
    }

    /// The current that the autopilot tells now, amperes: the mean of what it has measured since it told the last; none if it
    /// measures none.
    #[must_use]
    pub fn told_current_a(&self, now_us: u64) -> Option<f64> {
        let tells = self.config().tells_current;
        tells.then(|| self.true_state(now_us.saturating_sub(CURRENT_AGE_US)).current_a())
    }

    /// The field in the chip's axes at a time: now, or up to two seconds ago.
    #[must_use]
    pub fn sensor_field(&self, at_us: u64) -> Field<Sensor> {
        self.0.borrow_mut().sensor_field(at_us, None)
    }

    /// What a [`Lis3mdl`](crate::devices::lis3mdl::Lis3mdl) in this world measures. Of the faults that say where the
    /// aircraft is the first counts; what they add is added up.
    #[must_use]
    pub fn magnetometer_source(&self, faults: Vec<Rc<dyn FieldFault>>) -> FieldSource {
        let world = self.clone();
        Box::new(move |at_us| {
            let earth = faults.iter().find_map(|fault| fault.earth(at_us));
            let field = world.0.borrow_mut().sensor_field(at_us, earth);
            let added: Vector3<f64> = faults.iter().map(|fault| fault.added_ut(at_us)).sum();
            Field::new(field.ut + added.cast())
        })
    }

    /// The attitude source of this world; its [`run`](AttitudeSource::run) is the task to spawn.
    #[must_use]
    pub fn attitude_source(&self) -> AttitudeSource {
        let config = self.config();
        AttitudeSource::new(config.attitude_source, config.seed).carried_by(config.aircraft.kind)
    }

    /// Drops the flight plan and holds a bank and a pitch from now on.
    pub fn command(&self, bank_deg: f64, pitch_deg: f64) {
        self.up_to_now().aircraft.autopilot_mut().command(bank_deg, pitch_deg);
    }

    /// Drops the flight plan: the aircraft goes on wings level, or hovers.
    pub fn rest(&self) {
        self.up_to_now().aircraft.autopilot_mut().rest();
    }

    /// Appends a leg to the flight plan.
    pub fn fly(&self, leg: Leg) {
        self.up_to_now().aircraft.autopilot_mut().fly(leg);
    }

    /// Legs that are not finished, the one under way included.
    #[must_use]
    pub fn legs_left(&self) -> usize {
        self.up_to_now().aircraft.autopilot().legs_left()
    }

    /// Carries the aircraft from now on: on level ground, at a heading, on a bench.
    pub fn carry(&self, how: Carried) {
        self.up_to_now().aircraft.carry(how);
    }

    /// Lets the aircraft move by itself again, from where it was when that ended.
    pub fn let_go(&self) {
        self.up_to_now().aircraft.let_go();
    }

    /// Brings the aircraft to an attitude that somebody else says it has now; see `aircraft/followed.rs`.
    pub fn follow(&self, told: Euler) {
        self.up_to_now().aircraft.follow(told);
    }

    /// Lets the attitude source send, as it does from the beginning, or be silent: somebody else has the line.
    pub fn set_sends_attitude(&self, sends: bool) {
        self.0.borrow_mut().sends_attitude = sends;
    }

    /// Whether the attitude source sends.
    #[must_use]
    pub fn sends_attitude(&self) -> bool {
        self.0.borrow().sends_attitude
    }

    /// Fault: adds a field in the chip's axes, microtesla, from now on, as a switched-on motor or a passing ferry
    /// does. Zero takes it away; a few hundred microtesla saturate the chip.
    pub fn disturb(&self, field_ut: [f64; 3]) {
        self.up_to_now().disturbance_ut = field_ut.into();
    }

    /// Switches iron by current on, or with zeros off: what the motors add from now on in the chip's axes in level flight,
    /// in hover, or on the flat, microtesla. It follows their current.
    pub fn set_current_ut(&self, current_ut: [f64; 3]) {
        self.up_to_now().config.current_ut = current_ut;
    }

    /// Lets the autopilot measure the motors' current and tell it, or not.
    pub fn set_tells_current(&self, tells: bool) {
        self.up_to_now().config.tells_current = tells;
    }

    /// Arms or disarms the autopilot, which says so with its next heartbeat, within a second. It begins disarmed, as on
    /// the ground, and flies either way.
    pub fn set_armed(&self, is_armed: bool) {
        self.0.borrow_mut().is_armed = is_armed;
    }

    /// Whether the autopilot is armed.
    #[must_use]
    pub fn is_armed(&self) -> bool {
        self.0.borrow().is_armed
    }

    /// What was flown until now was flown under the old orders.
    fn up_to_now(&self) -> std::cell::RefMut<'_, Inner> {
        let mut inner = self.0.borrow_mut();
        inner.advance(clock::now_us());
        inner
    }
}

impl Inner {
    fn advance(&mut self, to_us: u64) {
        while self.aircraft.state().time_us < to_us {
            self.aircraft.step();
            if self.history.len() == HISTORY_STEPS {
                self.history.pop_front();
            }
            self.history.push_back(*self.aircraft.state());
        }
    }

    fn true_state(&mut self, at_us: u64) -> TrueState {
        self.advance(at_us);
        let oldest_us = self.history[0].time_us;
        let passed_us = at_us.saturating_sub(oldest_us);
        let index = (passed_us / STEP_US) as usize;
        let earlier = &self.history[index];
        match self.history.get(index + 1) {
            Some(later) if at_us > earlier.time_us => earlier.interpolate(later, at_us),
            _ => *earlier,
        }
    }

    /// At another place than that of the settings, if one is given.
    fn sensor_field(&mut self, at_us: u64, elsewhere: Option<Earth>) -> Field<Sensor> {
        let truth = self.true_state(at_us);
        let body_ut = elsewhere.unwrap_or(self.config.earth).body_field_ut(truth.euler());
        let measured = self.config.airframe.measure(&body_ut);
        let current_ut = Vector3::from(self.config.current_ut) * truth.current;
        Field::new(measured.ut + (self.disturbance_ut + current_ut).cast())
    }
}

#[cfg(test)]
mod tests;
