//! Families of changes that are flown over all durations and times of begin: `sweep-...`.

use simulator::faults::attitude::{AdditionalLatency, attitude_bias, rate_offset};
use simulator::faults::field::hard_iron_change;
use simulator::world::earth::Earth;

use super::case_definition::{DrawLegs, FaultCase, FaultOnset, RandomCase};
use super::case_list::{define_case, mavlink_case};
use crate::studies::integrity::integrity_plan::AttitudeProtocol;
use crate::studies::integrity::legs_after_calibration as legs;
use simulator::world::aircraft::VehicleKind;

/// Change at which a family is flown; size, course, motion and place are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Time from the start of the flight to the begin of the change, seconds.
    pub begin_s: f64,
    /// Duration of the change, seconds.
    pub duration_s: f64,
    /// Whether the flight follows a power-on and a rest on the ground, instead of the calibration.
    pub follows_power_on: bool,
}

/// Time on the ground after a power-on, seconds.
const REST_S: f64 = 30.0;

/// Time that is flown after a change, seconds.
const FLIGHT_AFTER_CHANGE_S: f64 = 60.0;

/// Largest inclination, degrees; its sign is drawn.
const MAX_INCLINATION_DEG: f64 = 85.0;

/// Motions of the flight, one of which is drawn; a vehicle that cannot hover flies straight instead.
const MOTIONS: [DrawLegs; 5] = [legs::straight_leg, legs::steady_leg, legs::slow_turn, legs::circles, legs::survey];

/// All families; the onset of their fault is that of a [`Change`].
pub static SWEEP_FAMILIES: &[FaultCase] = &[
    define_case("sweep-iron", "hard iron changes by 2 to 20 uT", |flight| {
        let size_ut = flight.random_stream.uniform(2.0, 20.0);
        let change_ut = flight.random_field_ut(size_ut);
        flight.add_field_fault(flight.fault_onset, hard_iron_change(flight.case_switch(), change_ut));
    }),
    mavlink_case("sweep-mount", "the module turns by 2 to 20 deg, none, half or all of the iron with it", |flight| {
        let turn_deg = flight.random_sign() * flight.random_stream.uniform(2.0, 20.0);
        let turning_iron_share = flight.random_stream.uniform(0.0, 3.0).floor() / 2.0;
        flight.add_mount_turn(flight.fault_onset, turn_deg, turning_iron_share);
    }),
    define_case("sweep-attitude", "attitude bias that changes by 0.5 to 5 deg", |flight| {
        let size_deg = flight.random_stream.uniform(0.5, 5.0);
        flight.bias_attitude(flight.fault_onset, size_deg);
    }),
    mavlink_case("sweep-gyro", "gyro offset that changes by 0.1 to 2 deg/s", |flight| {
        let size_rad_s = flight.random_stream.uniform(0.1, 2.0).to_radians();
        let offset_rad_s = flight.random_stream.random_direction() * size_rad_s;
        flight.add_attitude_fault(flight.fault_onset, rate_offset(flight.case_switch(), offset_rad_s.into()));
    }),
    define_case("sweep-latency", "attitude that becomes 50 to 500 ms later", |flight| {
        let latency_us = (1e3 * flight.random_stream.uniform(50.0, 500.0)) as u64;
        let fault = AdditionalLatency { fault_switch: flight.case_switch(), latency_us };
        flight.add_attitude_fault(flight.fault_onset, fault);
    }),
    define_case("sweep-source", "the source's heading moves by 2 to 20 deg, its attitude by up to 3 deg", |flight| {
        let heading_deg = flight.random_sign() * flight.random_stream.uniform(2.0, 20.0);
        let [roll_deg, pitch_deg] = [(); 2].map(|()| flight.random_stream.uniform(-3.0, 3.0) / 2_f64.sqrt());
        let change_rad = [roll_deg, pitch_deg, heading_deg].map(f64::to_radians);
        flight.add_attitude_fault(flight.fault_onset, attitude_bias(flight.case_switch(), change_rad));
    }),
];

impl FaultCase {
    /// Draws the flight of a seed in which the family's fault has this change.
    #[must_use]
    pub fn draw_change(
        &self,
        change: Change,
        seed: u64,
        aircraft: VehicleKind,
        source: AttitudeProtocol,
    ) -> RandomCase {
        self.draw_prepared(seed, aircraft, source, &|flight| flight.prepare_change(change))
    }
}

impl RandomCase {
    /// Sets the onset and draws course, place and motion of a change.
    fn prepare_change(&mut self, Change { begin_s, duration_s, follows_power_on }: Change) {
        if self.random_sign() > 0.0 {
            self.fault_switch.change_exponentially();
        }
        let inclination_deg = self.random_stream.uniform(-MAX_INCLINATION_DEG, MAX_INCLINATION_DEG);
        self.world.earth = Earth { inclination_deg, ..self.world.earth };
        let motion = MOTIONS[self.random_stream.uniform(0.0, MOTIONS.len() as f64) as usize % MOTIONS.len()];
        (self.first_legs, self.further_legs) = (motion, motion);
        self.is_restarted = follows_power_on;
        self.ground_time_s = if follows_power_on { REST_S } else { 0.0 };
        self.fault_onset = FaultOnset::AfterCalibration { after_s: self.ground_time_s + begin_s, for_s: duration_s };
        self.flight_after_calibration_s = begin_s + duration_s + FLIGHT_AFTER_CHANGE_S;
    }
}
