//! Table of all cases.

use std::f64::consts::TAU;

use simulator::faults::attitude::{attitude_spikes, rate_offset_ramp};
use simulator::faults::inertial::{SilentChip, clipped_rates, inertial_vibration, wrong_axes};
use simulator::faults::link_faults::ForgedMessage;
use simulator::faults::sensor::{additional_noise, measurement_spikes};
use simulator::world::aircraft::VehicleKind;
use simulator::world::attitude_source::SenderKind;
use simulator::world::gyro::GyroConfig;

use super::case_definition::{
    COUNTS_PER_UT, DEFAULT_ONSET_S, FLIGHT_AFTER_CALIBRATION_S, FaultCase, FaultOnset, RandomCase, SENSOR_SIGMA_COUNTS,
    SOON_AND_PERMANENT,
};
use crate::studies::integrity::legs_after_calibration::{INSTANT_IN_LEVEL_FLIGHT_S, INSTANT_IN_TURN_S};

const DEGREES_PER_RADIAN: f64 = 360.0 / TAU;

/// Changes a drawn case; see [`FaultCase`].
pub(super) type ConfigureCase = fn(&mut RandomCase);

/// Case for all vehicles and attitude sources.
pub(super) const fn define_case(
    name: &'static str,
    description: &'static str,
    configure_case: ConfigureCase,
) -> FaultCase {
    FaultCase {
        case_name: name,
        description,
        configure_case,
        applies_to_vehicle: |_| true,
        needs_mavlink: false,
        max_flights: u64::MAX,
        changes_hard_iron: false,
    }
}

/// Case for vehicles that can hover.
const fn hover_case(name: &'static str, description: &'static str, configure: ConfigureCase) -> FaultCase {
    FaultCase { applies_to_vehicle: VehicleKind::can_hover, ..define_case(name, description, configure) }
}

/// Case for vehicles that cannot hover.
const fn non_hover_case(name: &'static str, description: &'static str, configure: ConfigureCase) -> FaultCase {
    FaultCase { applies_to_vehicle: |kind| !kind.can_hover(), ..define_case(name, description, configure) }
}

/// Case for autopilots with several senders or body rates.
pub(super) const fn mavlink_case(name: &'static str, description: &'static str, configure: ConfigureCase) -> FaultCase {
    FaultCase { needs_mavlink: true, ..define_case(name, description, configure) }
}

/// Case of a permanent hard-iron change after the calibration.
const fn hard_iron_case(name: &'static str, description: &'static str, configure: ConfigureCase) -> FaultCase {
    FaultCase { changes_hard_iron: true, ..define_case(name, description, configure) }
}

/// Case of a permanent hard-iron change after the calibration, for autopilots with several senders or body rates.
const fn mavlink_hard_iron_case(name: &'static str, description: &'static str, configure: ConfigureCase) -> FaultCase {
    FaultCase { needs_mavlink: true, ..hard_iron_case(name, description, configure) }
}

/// All cases in the order of the report.
pub static ALL_CASES: &[FaultCase] = &[
    define_case("clean", "nothing", |_| {}),
    FaultCase {
        max_flights: 1,
        ..non_hover_case("ten-hours", "nothing, one flight of ten hours", |flight| {
            flight.flight_after_calibration_s = 36_000.0;
        })
    },
    mavlink_case("gyro-perfect", "a gyro without errors", |flight| flight.world.gyro = GyroConfig::ERROR_FREE),
    mavlink_case("gyro-1", "scale and cross-axis errors of the gyro of exactly 1 %", |flight| flight.scale_gyro(1.0)),
    mavlink_case("gyro-3", "scale and cross-axis errors of the gyro of exactly 3 %", |flight| flight.scale_gyro(3.0)),
    mavlink_case("gyro-5", "scale and cross-axis errors of the gyro of exactly 5 %", |flight| flight.scale_gyro(5.0)),
    mavlink_case("gyro-10", "scale and cross-axis errors of the gyro of exactly 10 %", |flight| {
        flight.scale_gyro(10.0);
    }),
    mavlink_case("gyro-offset-1", "gyro offsets of exactly 1 deg/s", |flight| {
        flight.fault_onset = FaultOnset::Always;
        flight.world.gyro = GyroConfig { offset_deg_s: 1.0, exact: true, ..GyroConfig::default() };
    }),
    mavlink_case("gyro-ramp", "a gyro offset that grows by 2 deg/s in a minute", |flight| {
        let growth_deg_s2 = flight.random_stream.random_direction() * (2.0 / 60.0);
        flight.add_attitude_fault(SOON_AND_PERMANENT, rate_offset_ramp(flight.case_switch(), growth_deg_s2.into()));
    }),
    mavlink_hard_iron_case("gyro-1-moved-5", "as gyro-1, and hard iron moved by 5 uT", |flight| {
        flight.scale_gyro(1.0);
        flight.change_hard_iron(5.0);
    }),
    mavlink_hard_iron_case("gyro-5-moved-5", "as gyro-5, and hard iron moved by 5 uT", |flight| {
        flight.scale_gyro(5.0);
        flight.change_hard_iron(5.0);
    }),
    mavlink_hard_iron_case("gyro-10-moved-5", "as gyro-10, and hard iron moved by 5 uT", |flight| {
        flight.scale_gyro(10.0);
        flight.change_hard_iron(5.0);
    }),
    define_case("imu-stuck-x", "the x axis of the module's own gyro repeats", |flight| {
        flight.stick_gyro_axes([true, false, false], false);
    }),
    define_case("imu-stuck-y", "the y axis of the module's own gyro repeats", |flight| {
        flight.stick_gyro_axes([false, true, false], false);
    }),
    define_case("imu-stuck-z", "the z axis of the module's own gyro repeats", |flight| {
        flight.stick_gyro_axes([false, false, true], false);
    }),
    define_case("imu-frozen", "the module's own gyro and accelerometer repeat", |flight| {
        flight.stick_gyro_axes([true; 3], true);
    }),
    define_case("imu-clipped", "the module's own gyro is clipped at 8 deg/s", |flight| {
        flight.add_inertial_fault(SOON_AND_PERMANENT, clipped_rates(flight.case_switch(), 8_f64.to_radians()));
    }),
    define_case("imu-upset", "a bit of the range of the module's own gyro flips", |flight| {
        flight.add_inertial_fault(SOON_AND_PERMANENT, flight.register_upset(0x11, 0x08));
    }),
    define_case("imu-vibration", "vibration of the module of 5 deg/s and 1 g, aliased", |flight| {
        let alias_hz = flight.random_stream.uniform(0.01, 20.0);
        let fault = inertial_vibration(flight.case_switch(), 5_f64.to_radians(), 9.8, alias_hz);
        flight.add_inertial_fault(FaultOnset::Always, fault);
    }),
    define_case("imu-silent", "the module's own gyro does not answer", |flight| {
        flight.add_inertial_fault(SOON_AND_PERMANENT, SilentChip(flight.case_switch()));
    }),
    define_case("imu-axes-wrong", "the module's own gyro is turned by 90 deg about the vertical", |flight| {
        flight.add_inertial_fault(FaultOnset::Always, wrong_axes(flight.case_switch()));
    }),
    define_case("stuck-x", "the sensor's x axis repeats", |flight| flight.stick_axes([true, false, false])),
    define_case("stuck-y", "the sensor's y axis repeats", |flight| flight.stick_axes([false, true, false])),
    define_case("stuck-z", "the sensor's z axis repeats", |flight| flight.stick_axes([false, false, true])),
    define_case("stuck-all", "all axes of the sensor repeat", |flight| flight.stick_axes([true; 3])),
    define_case("stuck-noisy", "all axes of the sensor repeat, with noise added", |flight| {
        flight.stick_axes([true; 3]);
        flight.add_sensor_fault(
            flight.fault_onset,
            additional_noise(flight.case_switch(), SENSOR_SIGMA_COUNTS, flight.seed),
        );
    }),
    define_case("sensor-spikes", "1 % of readings off by 30 uT", |flight| {
        let fault = measurement_spikes(flight.case_switch(), 0.01, 30.0 * COUNTS_PER_UT, flight.seed);
        flight.add_sensor_fault(SOON_AND_PERMANENT, fault);
    }),
    define_case("sensor-noise", "five times the sensor's noise", |flight| {
        let fault = additional_noise(flight.case_switch(), 24_f64.sqrt() * SENSOR_SIGMA_COUNTS, flight.seed);
        flight.add_sensor_fault(SOON_AND_PERMANENT, fault);
    }),
    define_case("sensor-clipped", "an axis saturates within the circle", |flight| {
        flight.clip_axis(SOON_AND_PERMANENT);
    }),
    define_case("upset-scale", "a full-scale bit flips", |flight| {
        flight.add_sensor_fault(SOON_AND_PERMANENT, flight.register_upset(0x21, 0x20));
    }),
    define_case("upset-self-test", "the self-test bit flips", |flight| {
        flight.add_sensor_fault(SOON_AND_PERMANENT, flight.register_upset(0x20, 0x01));
    }),
    define_case("upset-byte-order", "the byte-order bit flips", |flight| {
        flight.add_sensor_fault(SOON_AND_PERMANENT, flight.register_upset(0x23, 0x02));
    }),
    define_case("frozen-level", "attitude repeats from level flight on", |flight| {
        flight.freeze_attitude(INSTANT_IN_LEVEL_FLIGHT_S);
    }),
    define_case("frozen-turn", "attitude repeats from a turn on", |flight| flight.freeze_attitude(INSTANT_IN_TURN_S)),
    define_case("frozen-coarse", "attitude in tenths of a degree repeats from a turn on", |flight| {
        flight.quantise_attitude();
        flight.freeze_attitude(INSTANT_IN_TURN_S);
    }),
    mavlink_case(
        "attitude-hangs",
        "roll and pitch stay but for noise, body rates go on",
        RandomCase::make_attitude_stale,
    ),
    non_hover_case("link-gaps", "attitude gaps of 1.5 s in turns at 45 deg of bank", RandomCase::interrupt_link),
    define_case("source-stalls", "the attitude source stalls for 1.4 s in a turn", RandomCase::stall_source),
    define_case(
        "autopilot-restarts",
        "the autopilot restarts on the ground or in the air",
        RandomCase::restart_autopilot,
    ),
    define_case("coarse", "attitude in tenths of a degree, without fault", RandomCase::quantise_attitude),
    define_case("spikes", "1 % of attitude messages wrong by 45 deg", |flight| {
        flight.add_attitude_fault(SOON_AND_PERMANENT, attitude_spikes(flight.case_switch(), 0.01, flight.seed));
    }),
    mavlink_case("foreign", "a gimbal also sends attitude, 5 deg off", |flight| {
        flight.add_second_sender(Some(SenderKind::Other));
    }),
    mavlink_case("foreign-silent", "another sender of attitude without a heartbeat, 5 deg off", |flight| {
        flight.add_second_sender(None);
    }),
    mavlink_case(
        "second-vehicle",
        "the autopilot pauses for 12 s, another vehicle's goes on",
        RandomCase::pause_beside_other_vehicle,
    ),
    mavlink_case("no-autopilot", "forged heartbeats of no autopilot", |flight| {
        flight.send_forged_messages(ForgedMessage::NoAutopilot);
    }),
    mavlink_case("disarm-forged", "forged heartbeats of a disarmed autopilot", |flight| {
        flight.send_forged_messages(ForgedMessage::Disarmed);
    }),
    mavlink_case("current-forged", "current reported, forged reports of 300 A among them", |flight| {
        flight.add_current_interference(5.0, true);
        flight.send_forged_messages(ForgedMessage::Current(300.0));
    }),
    mavlink_case("current-forged-60", "current reported, forged reports of 60 A among them", |flight| {
        flight.add_current_interference(5.0, true);
        flight.send_forged_messages(ForgedMessage::Current(60.0));
    }),
    define_case("bias-2", "attitude bias of 2 deg", |flight| {
        flight.bias_attitude(SOON_AND_PERMANENT, 2.0);
    }),
    define_case("bias-5", "attitude bias of 5 deg", |flight| {
        flight.bias_attitude(SOON_AND_PERMANENT, 5.0);
    }),
    mavlink_case("aligning", "the attitude filter aligns on the ground", RandomCase::add_filter_alignment),
    define_case("lean-70", "attitude reads 70 % of the bank", |flight| {
        flight.scale_bank(SOON_AND_PERMANENT, 0.7);
    }),
    define_case("lean-30", "attitude reads 30 % of the bank", |flight| {
        flight.scale_bank(SOON_AND_PERMANENT, 0.3);
    }),
    define_case("late-200", "attitude 200 ms later", |flight| flight.delay_attitude(200)),
    define_case("late-300", "attitude 300 ms later", |flight| flight.delay_attitude(300)),
    define_case("late-500", "attitude 500 ms later", |flight| flight.delay_attitude(500)),
    mavlink_case("rates-zero", "body rates are sent as zero", |flight| flight.scale_rates(0.0)),
    mavlink_case("rates-small", "body rates 57 times too small", |flight| flight.scale_rates(1.0 / DEGREES_PER_RADIAN)),
    mavlink_case("rates-degrees", "body rates in degrees, 57 times too large", |flight| {
        flight.scale_rates(DEGREES_PER_RADIAN);
    }),
    mavlink_case("rates-sign", "body rates with the wrong sign", |flight| flight.scale_rates(-1.0)),
    hard_iron_case("moved-2", "hard iron changes by 2 uT", |flight| flight.change_hard_iron(2.0)),
    hard_iron_case("moved-3", "hard iron changes by 3 uT", |flight| flight.change_hard_iron(3.0)),
    hard_iron_case("moved-5", "hard iron changes by 5 uT", |flight| flight.change_hard_iron(5.0)),
    hard_iron_case("moved-10", "hard iron changes by 10 uT", |flight| flight.change_hard_iron(10.0)),
    mavlink_case("mount-turned-5", "the module turns by 5 deg in its mount", |flight| flight.turn_mount(5.0, 0.5)),
    mavlink_case("mount-turned-10", "the module turns by 10 deg in its mount", |flight| flight.turn_mount(10.0, 0.5)),
    mavlink_case("mount-turned-20", "the module turns by 20 deg in its mount", |flight| flight.turn_mount(20.0, 0.5)),
    mavlink_case("mount-turned-10-slow", "the module turns by 10 deg in its mount within 200 s", |flight| {
        flight.turn_mount(10.0, 200.0);
    }),
    non_hover_case("drift-straight-60", "hard iron drifts by 10 uT within 60 s in straight flight", |flight| {
        flight.drift_hard_iron(60.0);
    }),
    non_hover_case("drift-straight-300", "hard iron drifts by 10 uT within 300 s in straight flight", |flight| {
        flight.drift_hard_iron(300.0);
    }),
    hover_case("drift-hover-300", "hard iron drifts by 10 uT within 300 s in hover", |flight| {
        flight.drift_hard_iron(300.0);
    }),
    non_hover_case("steady", "nothing, ten minutes of straight flight", |flight| {
        flight.drift_hard_iron(f64::INFINITY);
    }),
    hover_case("steady-hover", "nothing, ten minutes of hover", |flight| {
        flight.drift_hard_iron(f64::INFINITY);
    }),
    define_case("throttle-5", "interference of 5 uT follows the throttle", |flight| {
        flight.add_throttle_interference(5.0);
    }),
    define_case("throttle-10", "interference of 10 uT follows the throttle", |flight| {
        flight.add_throttle_interference(10.0);
    }),
    define_case("warming", "the sensor's zero drifts from 0 to 10 uT", |flight| {
        flight.drift_zero(FaultOnset::AfterCalibration {
            after_s: DEFAULT_ONSET_S,
            for_s: FLIGHT_AFTER_CALIBRATION_S - DEFAULT_ONSET_S,
        });
    }),
    define_case("passing-10-1s", "iron of 10 uT passes within 1 s", |flight| flight.pass_object(10.0, 1.0)),
    define_case("passing-10-5s", "iron of 10 uT passes within 5 s", |flight| flight.pass_object(10.0, 5.0)),
    define_case("passing-10-30s", "iron of 10 uT passes within 30 s", |flight| flight.pass_object(10.0, 30.0)),
    define_case("passing-50-30s", "iron of 50 uT passes within 30 s", |flight| flight.pass_object(50.0, 30.0)),
    define_case("ferry", "used 1,000 km away", RandomCase::move_to_other_place),
    define_case("cal-moved-2", "hard iron changes by 2 uT during the calibration", |flight| {
        flight.change_hard_iron_while_calibrating(2.0);
    }),
    define_case("cal-moved-5", "hard iron changes by 5 uT during the calibration", |flight| {
        flight.change_hard_iron_while_calibrating(5.0);
    }),
    define_case("cal-moved-10", "hard iron changes by 10 uT during the calibration", |flight| {
        flight.change_hard_iron_while_calibrating(10.0);
    }),
    define_case("cal-warming", "the zero drifts from 0 to 10 uT during the calibration", |flight| {
        flight.drift_zero(FaultOnset::during_calibration(flight.world.aircraft.kind));
    }),
    non_hover_case("cal-bank-5", "calibration turns at 5 deg of bank", |flight| flight.calibrate_at_bank(5.0)),
    define_case("cal-clipped", "an axis saturates within the circles, always", |flight| {
        flight.clip_axis(FaultOnset::Always);
    }),
    define_case("cal-lean-90", "attitude always reads 90 % of the bank", |flight| {
        flight.scale_bank(FaultOnset::Always, 0.9);
    }),
    define_case(
        "cal-lean-lag",
        "attitude loses 12 % of the bank in turns, within 10 s, always",
        RandomCase::lag_bank_in_turns,
    ),
    define_case("cal-level-3", "attitude levelled 3 deg off, always", |flight| flight.level_attitude_wrongly(3.0)),
    FaultCase {
        applies_to_vehicle: |kind| matches!(kind, VehicleKind::Plane | VehicleKind::Vtol),
        ..define_case("cal-linkage-3", "elevator linkage: 3 uT in turns only, always", |flight| flight.add_linkage(3.0))
    },
    FaultCase {
        applies_to_vehicle: |kind| matches!(kind, VehicleKind::Plane | VehicleKind::Vtol),
        ..define_case("cal-linkage-lag", "elevator linkage: 3 uT in turns, within 5 s, always", |flight| {
            flight.add_lagging_linkage(3.0, 5.0);
        })
    },
    define_case("cal-hysteresis-15", "soft iron follows turns with a play of 15 deg, always", |flight| {
        flight.add_hysteresis(15.0);
    }),
    define_case("cal-hysteresis-axes-7", "soft iron of 7 % with a play along each axis, always", |flight| {
        flight.add_axis_hysteresis(0.07);
    }),
    define_case("cal-hysteresis-axes-15", "soft iron of 15 % with a play along each axis, always", |flight| {
        flight.add_axis_hysteresis(0.15);
    }),
    define_case("cal-hysteresis-axes-30", "soft iron of 30 % with a play along each axis, always", |flight| {
        flight.add_axis_hysteresis(0.30);
    }),
    define_case("cal-vibration-3", "aliased vibration of 3 uT, 0.01 to 0.5 Hz, always", |flight| {
        flight.add_vibration(3.0, [0.01, 0.5]);
    }),
    define_case("cal-vibration-slow", "aliased vibration of 3 uT, 0.002 to 0.05 Hz, always", |flight| {
        flight.add_vibration(3.0, [0.002, 0.05]);
    }),
    define_case("cal-level-ramp-3", "the level of the attitude drifts by 3 deg during the calibration", |flight| {
        flight.drift_attitude_level(3.0);
    }),
    define_case("cal-pitch-reversed", "attitude with the wrong sign of pitch, always", RandomCase::reverse_pitch),
    hover_case("cal-yaw-only", "calibration by yaw turns in hover alone", RandomCase::calibrate_in_hover),
    hover_case("pushed", "acceleration-induced tilt error always doubled", |flight| {
        flight.fault_onset = FaultOnset::Always;
        flight.world.attitude_source.push_error_deg *= 2.0;
    }),
    hover_case("cal-current-unreported", "motor current of 5 uT in hover, not reported", |flight| {
        flight.add_current_interference(5.0, false);
    }),
    hover_case("cal-current-unreported-20", "motor current of 20 uT in hover, not reported", |flight| {
        flight.add_current_interference(20.0, false);
    }),
    hover_case("cal-current-reported", "motor current of 5 uT in hover, reported", |flight| {
        flight.add_current_interference(5.0, true);
    }),
    hover_case("cal-current-reported-20", "motor current of 20 uT in hover, reported", |flight| {
        flight.add_current_interference(20.0, true);
    }),
];
