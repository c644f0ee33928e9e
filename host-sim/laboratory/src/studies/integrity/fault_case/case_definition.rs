//! A case: fault, onset and flight.

use std::f64::consts::TAU;
use std::rc::Rc;

use autoswing::attitude::AttitudeSource;
use nalgebra::Vector3;
use simulator::devices::lsm6dsl::InertialFault;
use simulator::faults::attitude::{
    AdditionalLatency, AttitudeFault, FilterAlignment, SourceRestart, SourceSilence, attitude_bias,
    attitude_quantisation, bank_scale_error, filter_alignment, frozen_attitude, lagging_bank_error, rate_scale_error,
    reversed_pitch, stale_attitude,
};
use simulator::faults::field::{
    AxisHysteresis, FieldFault, LaggingLinkage, MountTurnFault, OtherPlace, SoftIronHysteresis, elevator_linkage,
    hard_iron_change, hard_iron_drift, passing_object, throttle_interference,
};
use simulator::faults::inertial::{stuck_gyro_axes, turning_mount};
use simulator::faults::link_faults::{ForgedMessage, LinkFault};
use simulator::faults::sensor::{RegisterUpset, SensorFault, aliased_vibration, axis_clipping, stuck_axes};
use simulator::faults::{FaultSwitch, Faults};
use simulator::random::{RandomStream, StreamPurpose};
use simulator::routine::{CalibrationRoutine, TurnPlan};
use simulator::world::WorldConfig;
use simulator::world::aircraft::VehicleKind;
use simulator::world::attitude_source::{SenderIdentity, SenderKind};
use simulator::world::autopilot::Leg;
use simulator::world::cable_far_end::FarEnd;
use simulator::world::earth::Earth;
use simulator::world::gyro::GyroConfig;
use simulator::world::rotation::Euler;

use crate::studies::integrity::integrity_plan::AttitudeProtocol;
use crate::studies::integrity::legs_after_calibration::{self, INSTANT_IN_TURN_S};

/// Fault and the flights on which it is tested: a row of [`ALL_CASES`](super::ALL_CASES).
#[derive(Debug)]
pub struct FaultCase {
    /// Name on the command line and in JSON.
    pub case_name: &'static str,
    /// Description of the fault.
    pub description: &'static str,
    /// Changes the world, the attitude source, the routine, the onset and the flight after the calibration, and adds
    /// faults.
    pub(super) configure_case: fn(&mut RandomCase),
    /// Vehicles to which the case applies.
    pub(super) applies_to_vehicle: fn(VehicleKind) -> bool,
    /// Whether the case requires several senders or a gyro's rates, which MSP does not have.
    pub(super) needs_mavlink: bool,
    /// Largest number of flights of the case.
    pub(super) max_flights: u64,
    /// Whether hard iron changes permanently after the calibration, so that the module should estimate the change.
    pub changes_hard_iron: bool,
}

/// Time during which the fault is active.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FaultOnset {
    /// No fault.
    Never,
    /// The fault is active during the calibration and in the flight after it.
    Always,
    /// The fault is active in the flight after the calibration.
    AfterCalibration {
        /// Time from the start of that flight to the onset, seconds.
        after_s: f64,
        /// Duration of the fault, seconds; infinite for a permanent fault.
        for_s: f64,
    },
    /// The fault is active during the calibration.
    DuringCalibration {
        /// Time from the start of the calibration to the onset, seconds.
        after_s: f64,
        /// Time from the start of the calibration to the end of the fault, seconds; infinite for a permanent fault.
        until_s: f64,
    },
}

/// Draws legs for a kind of vehicle.
pub type DrawLegs = fn(VehicleKind, &mut RandomStream) -> Vec<Leg>;

/// Case with random values drawn from a seed.
pub struct RandomCase {
    /// Airframe, place, weather, errors of the attitude source.
    pub world: WorldConfig,
    /// Simulated attitude source and its protocol.
    pub far_end: FarEnd,
    /// Routine flown for the calibration.
    pub routine: CalibrationRoutine,
    /// Faults injected in the simulation.
    pub faults: Faults,
    /// Switch that activates the faults.
    pub fault_switch: FaultSwitch,
    /// Time during which the fault is active.
    pub fault_onset: FaultOnset,
    /// Mean error of roll and pitch during the calibration, radians; in use they cancel it.
    pub mean_attitude_error_rad: [f64; 2],
    /// Whether the module is switched off and on after the calibration.
    pub is_restarted: bool,
    /// Time on the ground between the calibration and the flight after it, seconds.
    pub ground_time_s: f64,
    /// Duration of the flight after the calibration, seconds.
    pub flight_after_calibration_s: f64,
    /// Draws the first legs of the flight after the calibration.
    pub first_legs: DrawLegs,
    /// Draws the legs that follow them.
    pub further_legs: DrawLegs,
    pub(super) seed: u64,
    pub(super) random_stream: RandomStream,
}

/// Duration of a flight after the calibration, seconds. Its first legs are the same for all (see
/// [`flight`](crate::studies::integrity::flight)).
pub(super) const FLIGHT_AFTER_CALIBRATION_S: f64 = 185.0;

/// Default onset of faults, seconds after the start of the flight after the calibration.
pub(super) const DEFAULT_ONSET_S: f64 = 10.0;

/// Permanent fault from then on.
pub(super) const SOON_AND_PERMANENT: FaultOnset = FaultOnset::permanent_after(DEFAULT_ONSET_S);

/// Onset of steady flight, seconds after the start of the flight after the calibration: after its first legs.
const STEADY_FLIGHT_ONSET_S: f64 = 90.0;
/// Duration of steady flight, seconds.
const STEADY_FLIGHT_DURATION_S: f64 = 600.0;

/// Onset of a passing object, seconds after the start of the flight after the calibration.
const PASSING_OBJECT_ONSET_S: f64 = 60.0;

/// Time on the ground between the calibration and the flight after it, seconds.
const TIME_ON_GROUND_S: f64 = 60.0;
/// Time in which the attitude filter of a restarted autopilot aligns, as observed on a real one, seconds.
const RESTART_ALIGNMENT_S: f64 = 10.0;

/// Silence of a restarting autopilot before its first attitude, seconds. An assumption: boot loader, then its sensors.
const RESTART_SILENCE_S: f64 = 4.0;

/// Shortest calibration, seconds. An aeroplane flies four circles at 25 deg of bank to one side and as many as
/// necessary to the other: 196 to 215 s in 60 flights. A copter's calibration may be complete after accelerations on
/// two headings.
pub(super) const fn shortest_calibration_s(aircraft: VehicleKind) -> f64 {
    if aircraft.can_hover() { 60.0 } else { 195.0 }
}

/// Counts of the LIS3MDL per microtesla at a full scale of 4 gauss.
pub(super) const COUNTS_PER_UT: f64 = 68.42;

/// Noise of a LIS3MDL measurement on x and y, counts RMS.
pub(super) const SENSOR_SIGMA_COUNTS: f64 = 0.32 * COUNTS_PER_UT;

impl FaultCase {
    /// Number of flights of this case: `requested`, up to the case's limit.
    #[must_use]
    pub fn flight_count(&self, requested: u64) -> u64 {
        requested.min(self.max_flights)
    }

    /// Whether the case applies to this vehicle.
    #[must_use]
    pub fn applies_to_vehicle(&self, aircraft: VehicleKind) -> bool {
        (self.applies_to_vehicle)(aircraft)
    }

    /// Whether the case applies to this attitude source: MSP has one sender, and gyro rates only with INAV.
    #[must_use]
    pub const fn applies_to_protocol(&self, source: AttitudeProtocol) -> bool {
        matches!(source, AttitudeProtocol::Mavlink) || !self.needs_mavlink
    }

    /// Draws the flight of a seed.
    #[must_use]
    pub fn draw_case(&self, seed: u64, aircraft: VehicleKind, source: AttitudeProtocol) -> RandomCase {
        self.draw_prepared(seed, aircraft, source, &|_| {})
    }

    /// Draws the flight of a seed; `prepare` changes it before the case does.
    pub(super) fn draw_prepared(
        &self,
        seed: u64,
        aircraft: VehicleKind,
        source: AttitudeProtocol,
        prepare: &dyn Fn(&mut RandomCase),
    ) -> RandomCase {
        let mut drawn_case = RandomCase {
            world: WorldConfig::random_world(seed).with_vehicle_kind(aircraft),
            far_end: source.far_end(),
            routine: CalibrationRoutine::for_vehicle(aircraft, TurnPlan::default(), 0.0),
            faults: Faults::default(),
            fault_switch: FaultSwitch::initially_off(),
            fault_onset: FaultOnset::Never,
            mean_attitude_error_rad: [0.0; 2],
            is_restarted: false,
            ground_time_s: 0.0,
            flight_after_calibration_s: FLIGHT_AFTER_CALIBRATION_S,
            first_legs: legs_after_calibration::first_legs,
            further_legs: legs_after_calibration::further_legs,
            seed,
            random_stream: RandomStream::new(seed, StreamPurpose::FaultCase),
        };
        prepare(&mut drawn_case);
        (self.configure_case)(&mut drawn_case);
        drawn_case
    }
}

impl RandomCase {
    /// Handle for a fault that is active from the onset on.
    pub(super) fn case_switch(&self) -> FaultSwitch {
        self.fault_switch.clone()
    }

    pub(super) fn add_sensor_fault(&mut self, onset: FaultOnset, fault: impl SensorFault + 'static) {
        self.fault_onset = onset;
        self.faults.sensor_faults.push(Box::new(fault));
    }

    /// Adds a fault of the module's own gyro and accelerometer, whose body rates are used beside the autopilot's attitude.
    pub(super) fn add_inertial_fault(&mut self, onset: FaultOnset, fault: impl InertialFault + 'static) {
        self.fault_onset = onset;
        self.world.attitude = AttitudeSource::Automatic;
        self.faults.inertial_faults.push(Box::new(fault));
    }

    pub(super) fn add_attitude_fault(&mut self, onset: FaultOnset, fault: impl AttitudeFault + 'static) {
        self.fault_onset = onset;
        self.faults.attitude_faults.push(Box::new(fault));
    }

    pub(super) fn add_field_fault(&mut self, onset: FaultOnset, fault: impl FieldFault + 'static) {
        self.fault_onset = onset;
        self.faults.field_faults.push(Rc::new(fault));
    }

    /// Random direction with this magnitude, microtesla, chip axes.
    pub(super) fn random_field_ut(&mut self, magnitude_ut: f64) -> Vector3<f64> {
        self.random_stream.random_direction() * magnitude_ut
    }

    /// Onset at a random time of the straight leg or the turn at the start of the flight after the calibration.
    pub(super) fn random_onset(&mut self) -> FaultOnset {
        FaultOnset::permanent_after(self.random_stream.uniform(DEFAULT_ONSET_S, INSTANT_IN_TURN_S))
    }

    pub(super) fn stick_axes(&mut self, axes: [bool; 3]) {
        let onset = self.random_onset();
        self.add_sensor_fault(onset, stuck_axes(self.case_switch(), axes));
    }

    pub(super) fn stick_gyro_axes(&mut self, axes: [bool; 3], is_accelerometer_stuck: bool) {
        self.add_inertial_fault(SOON_AND_PERMANENT, stuck_gyro_axes(self.case_switch(), axes, is_accelerometer_stuck));
    }

    /// Upset of register bits, of a magnetometer or an inertial sensor.
    pub(super) fn register_upset(&self, register: u8, bits: u8) -> RegisterUpset {
        RegisterUpset { fault_switch: self.case_switch(), register_bits: (register, bits), has_occurred: false }
    }

    /// Saturates a random axis within its range on a level circle.
    pub(super) fn clip_axis(&mut self, onset: FaultOnset) {
        let axis = (self.random_stream.uniform(0.0, 3.0) as usize).min(2);
        let limit_counts = axis_limit_counts(&self.world, axis, self.random_stream.uniform(0.3, 0.95));
        self.add_sensor_fault(onset, axis_clipping(self.case_switch(), axis, limit_counts));
    }

    pub(super) fn quantise_attitude(&mut self) {
        self.faults.attitude_faults.push(Box::new(attitude_quantisation(0.1)));
    }

    pub(super) fn freeze_attitude(&mut self, after_s: f64) {
        self.add_attitude_fault(FaultOnset::permanent_after(after_s), frozen_attitude(self.case_switch()));
    }

    /// Adds a sender with a roll error of 5 deg, present from the beginning; only the flight after the calibration is
    /// evaluated.
    pub(super) fn add_second_sender(&mut self, heartbeat_kind: Option<SenderKind>) {
        self.fault_onset = FaultOnset::Always;
        let identity = SenderIdentity { system_id: 1, component_id: 154, heartbeat_kind };
        self.faults.link_faults.push(LinkFault::SecondSender(identity, 5.0));
    }

    /// The autopilot pauses for 12 s, longer than a sender's selection is kept on the ground, while another vehicle's
    /// autopilot goes on. Flown for 300 s, of which the pause itself is 4 %.
    pub(super) fn pause_beside_other_vehicle(&mut self) {
        self.flight_after_calibration_s = 300.0;
        self.fault_onset = FaultOnset::AfterCalibration { after_s: DEFAULT_ONSET_S, for_s: 12.0 };
        self.faults.link_faults = vec![LinkFault::Pause(self.case_switch()), LinkFault::OtherVehicle(2)];
    }

    /// Adds forged messages in the autopilot's name, among its own, permanently from soon after the start of the flight
    /// after the calibration.
    pub(super) fn send_forged_messages(&mut self, message: ForgedMessage) {
        self.fault_onset = SOON_AND_PERMANENT;
        self.faults.link_faults.push(LinkFault::Forged(self.case_switch(), message));
    }

    /// Adds an attitude bias in a random direction; returns its roll and pitch, radians.
    pub(super) fn bias_attitude(&mut self, onset: FaultOnset, degrees: f64) -> [f64; 2] {
        let direction_rad = self.random_stream.uniform(0.0, TAU);
        let [roll_rad, pitch_rad] =
            [libm::cos(direction_rad), libm::sin(direction_rad)].map(|component| degrees.to_radians() * component);
        self.add_attitude_fault(onset, attitude_bias(self.case_switch(), [roll_rad, pitch_rad, 0.0]));
        [roll_rad, pitch_rad]
    }

    /// The autopilot's attitude filter aligns on the ground.
    pub(super) fn add_filter_alignment(&mut self) {
        self.ground_time_s = TIME_ON_GROUND_S;
        let fault = filter_alignment(self.case_switch(), self.random_alignment());
        self.add_attitude_fault(
            FaultOnset::AfterCalibration { after_s: DEFAULT_ONSET_S, for_s: RESTART_ALIGNMENT_S },
            fault,
        );
    }

    fn random_alignment(&mut self) -> FilterAlignment {
        let [amplitude_deg, roll_s, pitch_s] =
            [(3.0, 40.0), (1.5, 6.0), (1.5, 6.0)].map(|(a, b)| self.random_stream.uniform(a, b));
        FilterAlignment { amplitude_deg, periods_s: [roll_s, pitch_s], duration_s: RESTART_ALIGNMENT_S }
    }

    pub(super) fn make_attitude_stale(&mut self) {
        let onset = self.random_onset();
        self.add_attitude_fault(onset, stale_attitude(self.case_switch(), &self.world.attitude_source, self.seed));
    }

    /// Interrupts the link in turns of 45 deg of bank, for gaps within the two seconds over which body rates are
    /// integrated.
    pub(super) fn interrupt_link(&mut self) {
        self.further_legs = legs_after_calibration::steep_turns;
        let switch = self.case_switch();
        self.add_attitude_fault(
            SOON_AND_PERMANENT,
            SourceSilence { fault_switch: switch, silent_s: 1.5, period_s: 10.0, stops_clock: false },
        );
    }

    /// The source stalls once for 1.4 s in a turn, as a simulated autopilot on a busy computer did: it is silent, with
    /// time stamps that go on or stop meanwhile, or it repeats its last message with new time stamps.
    pub(super) fn stall_source(&mut self) {
        const SOURCE_STALL_S: f64 = 1.4;
        let after_s = self.random_stream.uniform(INSTANT_IN_TURN_S - 5.0, INSTANT_IN_TURN_S + 5.0);
        let switch = self.case_switch();
        let stall_kind = self.random_stream.uniform(0.0, 3.0);
        if stall_kind < 1.0 {
            self.add_attitude_fault(
                FaultOnset::AfterCalibration { after_s, for_s: SOURCE_STALL_S },
                frozen_attitude(switch),
            );
        } else {
            let stops_clock = stall_kind < 2.0;
            let fault =
                SourceSilence { fault_switch: switch, silent_s: SOURCE_STALL_S, period_s: f64::INFINITY, stops_clock };
            self.add_attitude_fault(FaultOnset::permanent_after(after_s), fault);
        }
    }

    /// The autopilot restarts, on the ground or in the air: silence, then time stamps from zero and an attitude that
    /// aligns.
    pub(super) fn restart_autopilot(&mut self) {
        let mut after_s = self.random_stream.uniform(DEFAULT_ONSET_S, INSTANT_IN_TURN_S);
        if self.random_stream.uniform(0.0, 1.0) < 0.5 {
            self.ground_time_s = TIME_ON_GROUND_S;
            after_s = DEFAULT_ONSET_S;
        }
        let (switch, alignment) = (self.case_switch(), self.random_alignment());
        self.add_attitude_fault(
            FaultOnset::permanent_after(after_s),
            SourceRestart { fault_switch: switch, silent_s: RESTART_SILENCE_S, alignment },
        );
    }

    pub(super) fn scale_bank(&mut self, onset: FaultOnset, reported_ratio: f64) {
        self.add_attitude_fault(onset, bank_scale_error(self.case_switch(), reported_ratio));
    }

    pub(super) fn lag_bank_in_turns(&mut self) {
        self.add_attitude_fault(FaultOnset::Always, lagging_bank_error(self.case_switch(), 0.12, 10.0));
    }

    pub(super) fn level_attitude_wrongly(&mut self, degrees: f64) {
        self.mean_attitude_error_rad = self.bias_attitude(FaultOnset::Always, degrees);
    }

    /// The level of the attitude source drifts by `degrees` during the calibration.
    pub(super) fn drift_attitude_level(&mut self, degrees: f64) {
        let onset = FaultOnset::during_calibration(self.world.aircraft.kind);
        self.mean_attitude_error_rad = self.bias_attitude(onset, degrees).map(|bias_rad| bias_rad / 2.0);
    }

    pub(super) fn reverse_pitch(&mut self) {
        self.add_attitude_fault(FaultOnset::Always, reversed_pitch(self.case_switch()));
    }

    pub(super) fn add_linkage(&mut self, in_turns_ut: f64) {
        let full_ut = self.random_field_ut(in_turns_ut);
        self.add_field_fault(FaultOnset::Always, elevator_linkage(full_ut));
    }

    pub(super) fn add_lagging_linkage(&mut self, in_turns_ut: f64, time_constant_s: f64) {
        let full_ut = self.random_field_ut(in_turns_ut);
        self.add_field_fault(FaultOnset::Always, LaggingLinkage::new(full_ut, time_constant_s));
    }

    /// Adds soft iron of this susceptibility with a play of 10 to 15 uT along each body axis.
    pub(super) fn add_axis_hysteresis(&mut self, susceptibility: f64) {
        let WorldConfig { airframe, earth, .. } = self.world;
        let play_ut = self.random_stream.uniform(10.0, 15.0);
        self.add_field_fault(FaultOnset::Always, AxisHysteresis::new(&airframe, earth, susceptibility, play_ut));
    }

    pub(super) fn add_hysteresis(&mut self, play_deg: f64) {
        let WorldConfig { airframe, earth, .. } = self.world;
        self.add_field_fault(FaultOnset::Always, SoftIronHysteresis::new(&airframe, earth, play_deg));
    }

    /// Adds vibration near the sample rate, whose alias no average removes. `peak_ut`: amplitude, microtesla.
    pub(super) fn add_vibration(&mut self, peak_ut: f64, [lowest_hz, highest_hz]: [f64; 2]) {
        let peak_counts = self.random_field_ut(peak_ut) * COUNTS_PER_UT;
        let alias_hz = self.random_stream.uniform(lowest_hz, highest_hz);
        self.add_sensor_fault(FaultOnset::Always, aliased_vibration(self.case_switch(), peak_counts, alias_hz));
    }

    pub(super) fn delay_attitude(&mut self, latency_ms: u64) {
        let fault = AdditionalLatency { fault_switch: self.case_switch(), latency_us: latency_ms * 1000 };
        self.add_attitude_fault(SOON_AND_PERMANENT, fault);
    }

    pub(super) fn scale_rates(&mut self, factor: f64) {
        self.add_attitude_fault(SOON_AND_PERMANENT, rate_scale_error(self.case_switch(), factor));
    }

    /// Gives the gyro scale errors and cross-axis sensitivities of exactly this size, always.
    pub(super) fn scale_gyro(&mut self, scale_percent: f64) {
        self.fault_onset = FaultOnset::Always;
        self.world.gyro = GyroConfig { scale_percent, exact: true, ..GyroConfig::default() };
    }

    pub(super) fn change_hard_iron(&mut self, magnitude_ut: f64) {
        let change_ut = self.random_field_ut(magnitude_ut);
        self.add_field_fault(SOON_AND_PERMANENT, hard_iron_change(self.case_switch(), change_ut));
    }

    pub(super) fn change_hard_iron_while_calibrating(&mut self, magnitude_ut: f64) {
        let change_ut = self.random_field_ut(magnitude_ut);
        let after_s = self.random_stream.uniform(0.0, shortest_calibration_s(self.world.aircraft.kind));
        let onset = FaultOnset::DuringCalibration { after_s, until_s: f64::INFINITY };
        self.add_field_fault(onset, hard_iron_change(self.case_switch(), change_ut));
    }

    pub(super) fn add_throttle_interference(&mut self, full_ut: f64) {
        let full_ut = self.random_field_ut(full_ut);
        self.add_field_fault(SOON_AND_PERMANENT, throttle_interference(self.case_switch(), full_ut, self.seed));
    }

    pub(super) fn drift_zero(&mut self, onset: FaultOnset) {
        let change_ut = self.random_field_ut(10.0);
        self.add_field_fault(onset, hard_iron_change(self.case_switch(), change_ut));
    }

    /// Adds straight flight or hover for ten minutes after the first legs, in which hard iron drifts.
    pub(super) fn drift_hard_iron(&mut self, time_constant_s: f64) {
        self.flight_after_calibration_s = STEADY_FLIGHT_ONSET_S + STEADY_FLIGHT_DURATION_S;
        self.further_legs = legs_after_calibration::steady_leg;
        let change_ut = self.random_field_ut(10.0);
        let onset = FaultOnset::permanent_after(STEADY_FLIGHT_ONSET_S);
        self.add_field_fault(onset, hard_iron_drift(self.case_switch(), change_ut, time_constant_s));
    }

    /// Turns the module in its mount within `for_s` seconds.
    pub(super) fn turn_mount(&mut self, turn_deg: f64, for_s: f64) {
        let turn_deg = self.random_sign() * turn_deg;
        self.add_mount_turn(FaultOnset::AfterCalibration { after_s: DEFAULT_ONSET_S, for_s }, turn_deg, 0.0);
    }

    pub(super) fn add_mount_turn(&mut self, onset: FaultOnset, turn_deg: f64, turning_iron_share: f64) {
        let WorldConfig { airframe, earth, .. } = self.world;
        let fault_switch = self.case_switch();
        self.add_field_fault(onset, MountTurnFault { fault_switch, airframe, turning_iron_share, earth, turn_deg });
        self.faults.inertial_faults.push(Box::new(turning_mount(self.case_switch(), turn_deg)));
    }

    pub(super) fn random_sign(&mut self) -> f64 {
        if self.random_stream.uniform(-1.0, 1.0) < 0.0 { -1.0 } else { 1.0 }
    }

    pub(super) fn pass_object(&mut self, peak_ut: f64, for_s: f64) {
        let peak_ut = self.random_field_ut(peak_ut);
        let onset = FaultOnset::AfterCalibration { after_s: PASSING_OBJECT_ONSET_S, for_s };
        self.add_field_fault(onset, passing_object(self.case_switch(), peak_ut));
    }

    pub(super) fn move_to_other_place(&mut self) {
        self.world.earth = Earth { total_ut: 50.0, inclination_deg: 60.0 };
        let total_ut = self.random_stream.uniform(45.0, 55.0);
        let earth = Earth { total_ut, inclination_deg: self.random_stream.uniform(50.0, 70.0) };
        self.add_field_fault(SOON_AND_PERMANENT, OtherPlace { fault_switch: self.case_switch(), earth });
    }

    pub(super) fn calibrate_at_bank(&mut self, bank_deg: f64) {
        self.fault_onset = FaultOnset::Always;
        let plan = TurnPlan { bank_deg, ..TurnPlan::default() };
        self.routine = CalibrationRoutine::for_vehicle(VehicleKind::Plane, plan, 0.0);
    }

    /// Repeats the routine's first part (yaw turns) up to the duration of the whole routine.
    pub(super) fn calibrate_in_hover(&mut self) {
        self.fault_onset = FaultOnset::Always;
        self.routine.routine_parts.truncate(1);
        for routine_part in &mut self.routine.routine_parts {
            routine_part.legs = routine_part.legs.repeat(4);
        }
    }

    pub(super) fn add_current_interference(&mut self, in_hover_ut: f64, reports_current: bool) {
        self.fault_onset = FaultOnset::Always;
        self.world = WorldConfig { reports_current, ..self.world.with_current_interference(in_hover_ut) };
    }
}

impl FaultOnset {
    /// Permanent fault from `after_s` seconds after the start of the flight after the calibration.
    pub(super) const fn permanent_after(after_s: f64) -> Self {
        Self::AfterCalibration { after_s, for_s: f64::INFINITY }
    }

    /// Fault from the start of the calibration for the shortest calibration of this kind of vehicle.
    pub(super) const fn during_calibration(aircraft: VehicleKind) -> Self {
        Self::DuringCalibration { after_s: 0.0, until_s: shortest_calibration_s(aircraft) }
    }
}

/// Saturation limit of an axis within its range on a level circle, at a fraction of the way from its mean to its
/// maximum, counts.
fn axis_limit_counts(world: &WorldConfig, axis: usize, range_fraction: f64) -> i16 {
    let measured = |step: u8| {
        let euler = Euler { heading_rad: f64::from(step) / 36.0 * TAU, ..Euler::from_deg(0.0, 0.0, 0.0) };
        f64::from(world.airframe.measured_field(&world.earth.body_field_ut(euler)).ut[axis])
    };
    let mean = (0..36).map(measured).sum::<f64>() / 36.0;
    let max_measured = (0..36).map(measured).fold(f64::MIN, f64::max);
    ((mean + (max_measured - mean) * range_fraction) * COUNTS_PER_UT).round() as i16
}
