use std::cell::RefCell;
use std::rc::Rc;

use mavlink_dialect::ATTITUDE_DATA;
use nalgebra::Vector3;
use testkit::simulation::Simulation;

use super::FaultSwitch;
use super::attitude::{
    AdditionalLatency, AttitudeFault, attitude_bias, attitude_quantisation, attitude_spikes, bank_scale_error,
    frozen_attitude, lagging_bank_error, reversed_pitch,
};
use super::field::{
    AxisHysteresis, FieldFault, LaggingLinkage, SoftIronHysteresis, elevator_linkage, hard_iron_change, passing_object,
    throttle_interference,
};
use super::sensor::{
    FaultyChip, RegisterUpset, SensorFault, additional_noise, aliased_vibration, axis_clipping, measurement_spikes,
    stuck_axes,
};
use crate::devices::i2c::SimulatedI2cDevice;
use crate::world::airframe::Airframe;
use crate::world::earth::Earth;
use crate::world::{TrueState, WorldConfig};
use log_analysis::numbers::square;

/// Switch of a fault that is active from 1 s to 3 s.
fn switch_on_from_1_to_3_s() -> FaultSwitch {
    let switch = FaultSwitch::initially_off();
    switch.set_active(1_000_000, 3_000_000);
    switch
}

const BEFORE_ONSET_US: u64 = 999_999;
const WHILE_ACTIVE_US: u64 = 2_000_000;

#[test]
fn a_switch_is_on_from_its_start_until_its_end() {
    let switch = FaultSwitch::initially_off();
    assert!(!switch.is_on(0) && !switch.is_on(u64::MAX - 1));
    switch.set_active(1_000_000, 3_000_000);
    assert_eq!([999_999, 1_000_000, 2_999_999, 3_000_000].map(|at_us| switch.is_on(at_us)), [false, true, true, false]);
    assert_eq!(switch.active_for_s(2_500_000), Some(1.5));
    assert_eq!(switch.active_for_s(3_000_000), None);
    for (at_us, progress) in [(0, 0.0), (1_000_000, 0.0), (2_000_000, 0.5), (4_000_000, 1.0)] {
        assert!((switch.elapsed_fraction(at_us) - progress).abs() < 1e-9, "{at_us}");
    }
    assert!(FaultSwitch::always_on().is_on(0));
}

/// Of an exponential change 95 % within the active time, 78 % within half of it.
#[test]
fn a_change_is_linear_or_exponential_or_at_once() {
    let (linear, exponential, at_once) =
        (switch_on_from_1_to_3_s(), switch_on_from_1_to_3_s(), FaultSwitch::initially_off());
    exponential.change_exponentially();
    at_once.set_active(1_000_000, u64::MAX);
    for (switch, expected) in
        [(linear, [0.0, 0.5, 1.0, 1.0]), (exponential, [0.0, 0.777, 0.950, 1.0]), (at_once, [0.0, 1.0, 1.0, 1.0])]
    {
        for (at_us, expected) in [BEFORE_ONSET_US, WHILE_ACTIVE_US, 3_000_000, 9_000_000].into_iter().zip(expected) {
            assert!((switch.changed_fraction(at_us) - expected).abs() < 1e-3, "{switch:?} {at_us}");
        }
    }
    assert!(FaultSwitch::initially_off().changed_fraction(9_000_000) <= 0.0);
}

#[derive(Default)]
struct RegisterChip {
    registers: Vec<u8>,
    pointer: usize,
}

impl SimulatedI2cDevice for RegisterChip {
    fn acknowledges_address(&self, _address: u8) -> bool {
        true
    }

    fn write_bytes(&mut self, bytes: &[u8]) {
        self.pointer = usize::from(bytes[0] & 0x3F);
        for &byte in &bytes[1..] {
            self.registers[self.pointer] = byte;
        }
    }

    fn read_bytes(&mut self, bytes: &mut [u8]) {
        let from = self.pointer;
        bytes.copy_from_slice(&self.registers[from..from + bytes.len()]);
    }
}

/// Bytes read from a chip with a fault whose registers contain their addresses.
fn read_faulty_chip(
    fault: impl SensorFault + 'static,
    pointer: u8,
    length: usize,
) -> (Vec<u8>, Rc<RefCell<RegisterChip>>) {
    // Starts the simulation clock at zero, when the fault's switch is on.
    let _simulation = Simulation::new();
    let chip = Rc::new(RefCell::new(RegisterChip { registers: (0..64).collect(), pointer: 0 }));
    let faulty = FaultyChip::new(chip.clone(), vec![Box::new(fault)]);
    faulty.borrow_mut().write_bytes(&[pointer]);
    let mut bytes = vec![0; length];
    faulty.borrow_mut().read_bytes(&mut bytes);
    (bytes, chip)
}

/// The output registers contain 0x2928, 0x2B2A, 0x2D2C.
#[test]
fn a_sensor_fault_changes_output_registers_only() {
    let clipped = || axis_clipping(FaultSwitch::always_on(), 1, 0x0100);
    assert_eq!(read_faulty_chip(clipped(), 0xA8, 6).0, [0x28, 0x29, 0x00, 0x01, 0x2C, 0x2D]);
    assert_eq!(read_faulty_chip(clipped(), 0x28, 6).0, [0x28, 0x29, 0x2A, 0x2B, 0x2C, 0x2D], "without counting up");
    assert_eq!(read_faulty_chip(clipped(), 0xA0, 5).0, [0x20, 0x21, 0x22, 0x23, 0x24]);
    assert_eq!(read_faulty_chip(clipped(), 0x80, 6).0, [0, 1, 2, 3, 4, 5]);
}

/// The flip precedes the next transfer, which is otherwise unaffected.
#[test]
fn an_upset_flips_the_bits_of_a_register_once() {
    let upset =
        RegisterUpset { fault_switch: FaultSwitch::always_on(), register_bits: (0x21, 0x60), has_occurred: false };
    let (bytes, chip) = read_faulty_chip(upset, 0xA0, 5);
    assert_eq!(bytes, [0x20, 0x41, 0x22, 0x23, 0x24]);
    assert_eq!(chip.borrow().registers[0x21], 0x41);
    let mut upset =
        RegisterUpset { fault_switch: switch_on_from_1_to_3_s(), register_bits: (0x21, 0x60), has_occurred: false };
    assert_eq!(upset.register_upset(BEFORE_ONSET_US), None);
    assert_eq!(
        (upset.register_upset(WHILE_ACTIVE_US), upset.register_upset(WHILE_ACTIVE_US)),
        (Some((0x21, 0x60)), None)
    );
}

fn apply_sensor_fault(fault: &mut impl SensorFault, at_us: u64, counts: [i16; 3]) -> [i16; 3] {
    let mut counts = counts;
    fault.modify_counts(at_us, &mut counts);
    counts
}

#[test]
fn a_stuck_axis_repeats_what_it_read_last() {
    let mut stuck = stuck_axes(switch_on_from_1_to_3_s(), [false, true, false]);
    assert_eq!(apply_sensor_fault(&mut stuck, BEFORE_ONSET_US, [1, 2, 3]), [1, 2, 3]);
    assert_eq!(apply_sensor_fault(&mut stuck, WHILE_ACTIVE_US, [4, 5, 6]), [4, 2, 6]);
    assert_eq!(apply_sensor_fault(&mut stuck, WHILE_ACTIVE_US, [7, 8, 9]), [7, 2, 9]);
    assert_eq!(apply_sensor_fault(&mut stuck, 3_000_000, [7, 8, 9]), [7, 8, 9]);
}

/// 10,000 measurements determine both statistics to a few per cent.
#[test]
fn noise_and_spikes_have_the_configured_size_and_rate() {
    let (mut noisy, mut spiky) = (
        additional_noise(switch_on_from_1_to_3_s(), 100.0, 1),
        measurement_spikes(switch_on_from_1_to_3_s(), 0.01, 2000.0, 1),
    );
    assert_eq!(apply_sensor_fault(&mut noisy, BEFORE_ONSET_US, [0; 3]), [0; 3]);
    assert_eq!(apply_sensor_fault(&mut spiky, BEFORE_ONSET_US, [0; 3]), [0; 3]);
    let squares: f64 =
        (0..10_000).map(|_| square(f64::from(apply_sensor_fault(&mut noisy, WHILE_ACTIVE_US, [0; 3])[2]))).sum::<f64>()
            / 10_000.0;
    assert!((squares.sqrt() - 100.0).abs() < 4.0, "{}", squares.sqrt());
    let spikes: Vec<[i16; 3]> = (0..10_000)
        .map(|_| apply_sensor_fault(&mut spiky, WHILE_ACTIVE_US, [0; 3]))
        .filter(|counts| *counts != [0; 3])
        .collect();
    assert!((60..=140).contains(&spikes.len()), "{}", spikes.len());
    assert!(spikes.iter().all(|counts| counts.iter().map(|count| count.unsigned_abs()).sum::<u16>() == 2000));
}

fn apply_attitude_fault(fault: &mut impl AttitudeFault, at_us: u64, roll: f32) -> ATTITUDE_DATA {
    let mut message =
        ATTITUDE_DATA { roll, pitch: 0.1, rollspeed: roll, time_boot_ms: (at_us / 1000) as u32, ..Default::default() };
    fault.modify_message(at_us, &mut message);
    message
}

#[test]
fn a_frozen_source_repeats_everything_but_its_time() {
    let mut frozen = frozen_attitude(switch_on_from_1_to_3_s());
    apply_attitude_fault(&mut frozen, BEFORE_ONSET_US, 0.2);
    let message = apply_attitude_fault(&mut frozen, WHILE_ACTIVE_US, 0.5);
    assert_eq!((message.roll.to_bits(), message.rollspeed.to_bits()), (0.2_f32.to_bits(), 0.2_f32.to_bits()));
    assert_eq!(message.time_boot_ms, 2000);
    assert_eq!(apply_attitude_fault(&mut frozen, 3_000_000, 0.5).roll.to_bits(), 0.5_f32.to_bits());
}

#[test]
fn each_attitude_fault_has_its_named_effect() {
    let roll = |fault: &mut dyn AttitudeFault, at_us| {
        let mut message = ATTITUDE_DATA { roll: 0.4, ..Default::default() };
        fault.modify_message(at_us, &mut message);
        message.roll
    };
    let mut bank_scale = bank_scale_error(switch_on_from_1_to_3_s(), 0.7);
    let mut bias = attitude_bias(switch_on_from_1_to_3_s(), [0.2, 0.1, 0.0]);
    for (fault, expected) in [(&mut bank_scale as &mut dyn AttitudeFault, 0.28), (&mut bias, 0.5)] {
        assert!(
            (roll(fault, BEFORE_ONSET_US) - 0.4).abs() < 1e-6 && (roll(fault, WHILE_ACTIVE_US) - expected).abs() < 1e-6
        );
    }
    let mut reversed = reversed_pitch(FaultSwitch::always_on());
    assert!((apply_attitude_fault(&mut reversed, 0, 0.4).pitch + 0.1).abs() < 1e-6);
    let latency_fault = AdditionalLatency { fault_switch: switch_on_from_1_to_3_s(), latency_us: 200_000 };
    assert_eq!([BEFORE_ONSET_US, WHILE_ACTIVE_US].map(|at_us| latency_fault.added_latency_us(at_us)), [0, 100_000]);
    let coarse = roll(&mut attitude_quantisation(0.1), 0).to_degrees();
    assert!((coarse - 22.9).abs() < 1e-4, "0.4 rad are 22.918 deg: {coarse}");
    let mut spikes = attitude_spikes(switch_on_from_1_to_3_s(), 0.01, 1);
    let wrong: Vec<f32> = (0..10_000)
        .map(|_| apply_attitude_fault(&mut spikes, WHILE_ACTIVE_US, 0.0).roll)
        .filter(|roll_rad| *roll_rad != 0.0)
        .collect();
    assert!((60..=140).contains(&wrong.len()), "{}", wrong.len());
    assert!(wrong.iter().all(|roll| (roll.abs().to_degrees() - 45.0).abs() < 1e-3));
}

#[test]
fn each_field_fault_has_its_named_effect() {
    let ut = Vector3::new(3.0, 0.0, 4.0);
    let added =
        |fault: &dyn FieldFault, time_us| fault.added_field_ut(&TrueState { time_us, ..TrueState::default() }).norm();
    let changed_iron = hard_iron_change(switch_on_from_1_to_3_s(), ut);
    let passing = passing_object(switch_on_from_1_to_3_s(), ut);
    for (fault, expected_ut) in
        [(&changed_iron as &dyn FieldFault, [0.0, 1.25, 2.5, 5.0]), (&passing, [0.0, 2.5, 5.0, 0.0])]
    {
        for (at_us, expected_ut) in
            [BEFORE_ONSET_US, 1_500_000, WHILE_ACTIVE_US, 4_000_000].into_iter().zip(expected_ut)
        {
            assert!((added(fault, at_us) - expected_ut).abs() < 1e-9, "{at_us}: {}", added(fault, at_us));
        }
    }
    let throttle = throttle_interference(FaultSwitch::always_on(), ut, 1);
    let values: Vec<f64> = (0..600).map(|tenth_second| added(&throttle, tenth_second * 100_000)).collect();
    assert!(values[..30].iter().all(|ut| *ut == 0.0), "cruise for three seconds");
    assert!(values.iter().fold(0.0_f64, |maximum, ut| maximum.max(*ut)) > 2.0 && values.iter().all(|ut| *ut <= 5.0));
    assert!(values.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 2.1), "it follows in half a second");
}

#[test]
fn an_elevator_linkage_adds_field_in_turns_to_either_side() {
    let linkage = elevator_linkage(Vector3::new(0.0, 3.0, 0.0));
    for (bank_deg, expected_ut) in [(0.0_f64, 0.0), (25.0, 3.0), (-25.0, 3.0), (40.0, 3.0), (12.0, 0.646)] {
        let state = TrueState { roll_rad: bank_deg.to_radians(), ..TrueState::default() };
        let added_field_ut = linkage.added_field_ut(&state).y;
        assert!((added_field_ut - expected_ut).abs() < 0.01, "{bank_deg}: {added_field_ut}");
    }
}

/// After a turn the magnetisation stays behind by the play, on the side that the turn came from.
#[test]
fn hysteresis_depends_on_the_side_of_the_last_turn() {
    let WorldConfig { airframe, earth, .. } = WorldConfig::random_world(3);
    let iron = SoftIronHysteresis::new(&airframe, earth, 15.0);
    let state_at = |heading_deg: f64| TrueState { heading_rad: heading_deg.to_radians(), ..TrueState::default() };
    let fly = |from: i32, to: i32| {
        let step = (to - from).signum();
        (0..=(to - from).abs())
            .fold(Vector3::zeros(), |_, step_count| iron.added_field_ut(&state_at(f64::from(from + step * step_count))))
    };
    let lag_ut = |heading_deg: f64, of_deg: f64| iron.lag_field_ut(&state_at(heading_deg), of_deg.to_radians());
    assert!((fly(0, 90) - lag_ut(90.0, 75.0)).norm() < 1e-9);
    assert!((fly(90, 100) - lag_ut(100.0, 85.0)).norm() < 1e-9);
    assert!((fly(100, 20) - lag_ut(20.0, 35.0)).norm() < 1e-9);
    assert!((fly(20, 25) - lag_ut(25.0, 35.0)).norm() < 1e-9, "within the play nothing moves");
    let banked = |bank_deg: f64| TrueState { roll_rad: bank_deg.to_radians(), ..state_at(90.0) };
    assert!(
        (iron.steady_field_ut(&banked(25.0)) - iron.lag_field_ut(&banked(25.0), 75_f64.to_radians())).norm() < 1e-9
    );
    assert!(iron.steady_field_ut(&banked(0.0)).norm() < 1e-9 && lag_ut(90.0, 75.0).norm() > 0.1);
    let hysteresis_without_iron = SoftIronHysteresis::new(&Airframe::default(), Earth::default(), 15.0);
    assert!(hysteresis_without_iron.steady_field_ut(&banked(25.0)).norm() < 1e-9);
}

/// At the time constant 63 % of the steady field; a query of an earlier instant changes nothing.
#[test]
fn a_lagging_linkage_follows_the_elevator() {
    let linkage = LaggingLinkage::new(Vector3::new(0.0, 3.0, 0.0), 5.0);
    let in_turn = |time_us| TrueState { time_us, roll_rad: 25_f64.to_radians(), ..TrueState::default() };
    let added_ut = [0, 1_000_000, 5_000_000, 2_000_000, 60_000_000].map(|us| linkage.added_field_ut(&in_turn(us)).y);
    for (added_ut, expected_ut) in added_ut.into_iter().zip([0.0, 0.544, 1.896, 1.896, 3.0]) {
        assert!((added_ut - expected_ut).abs() < 0.01, "{added_ut} {expected_ut}");
    }
    assert!((linkage.steady_field_ut(&in_turn(0)).y - 3.0).abs() < 1e-9);
}

/// Level, in a horizontal field of 20 uT: after circles to the right, heading north, each axis is behind by the play.
#[test]
fn hysteresis_of_an_axis_keeps_the_field_of_before_by_its_play() {
    let earth = Earth { total_ut: 25.0, inclination_deg: 36.87 };
    let iron = AxisHysteresis::new(&Airframe::default(), earth, 0.1, 5.0);
    let heading = |heading_deg: f64| TrueState { heading_rad: heading_deg.to_radians(), ..TrueState::default() };
    for heading_deg in 0..=720 {
        iron.added_field_ut(&heading(f64::from(heading_deg)));
    }
    let flown_ut = iron.added_field_ut(&heading(720.0));
    assert!((flown_ut - Vector3::new(1.5, 0.5, 1.0)).norm() < 0.01, "{flown_ut}");
    let steady_ut = iron.steady_field_ut(&heading(0.0));
    assert!((steady_ut - flown_ut).norm() < 0.01, "{steady_ut}");
    let left = TrueState { roll_rad: -0.01, ..heading(0.0) };
    assert!((iron.steady_field_ut(&left).y + 0.5).abs() < 0.05, "{}", iron.steady_field_ut(&left));
}

#[test]
fn a_lagging_bank_error_grows_with_its_time_constant() {
    let mut lean = lagging_bank_error(FaultSwitch::always_on(), 0.12, 10.0);
    let mut message = ATTITUDE_DATA::default();
    for step in 0..=500 {
        message = ATTITUDE_DATA { roll: 0.5, ..ATTITUDE_DATA::default() };
        lean.modify_message(step * 20_000, &mut message);
    }
    let expected = 0.5 * (1.0 - 0.12 * (1.0 - libm::expf(-1.0)));
    assert!((message.roll - expected).abs() < 1e-4, "{}", message.roll);
}

#[test]
fn an_alias_of_a_vibration_is_slow() {
    let mut vibration = aliased_vibration(FaultSwitch::always_on(), Vector3::new(100.0, 0.0, -200.0), 0.1);
    assert_eq!(apply_sensor_fault(&mut vibration, 2_500_000, [1, 2, 3]), [101, 2, -197]);
    assert_eq!(apply_sensor_fault(&mut vibration, 5_000_000, [1, 2, 3]), [1, 2, 3]);
}
