//! Unit tests of `sensor_check`.

use testkit::random::Random;

use super::*;

const PERIOD_US: u64 = 12_500;

struct SimulatedReadings {
    sensor_check: SensorCheck,
    reading_number: u64,
    random: Random,
}

impl SimulatedReadings {
    /// After some seconds at rest.
    fn settled() -> Self {
        let config =
            InstrumentConfig { equal_readings_until_stuck: Some(16), ..InstrumentConfig::new(PERIOD_US as u32) };
        let mut readings = Self { sensor_check: SensorCheck::new(&config), reading_number: 0, random: Random(1) };
        assert_eq!(readings.faults_at_rest(PARKED_FIELD_UT, 500), []);
        readings
    }

    fn check_with_slow_turn(&mut self, [x, y, z]: [f32; 3]) -> Option<ReadingFault> {
        self.reading_number += 1;
        let at = Timestamp::from_us(self.reading_number * PERIOD_US);
        let reading = Reading { field: Field::from_ut(x, y, z), is_saturated: false, was_overwritten: false };
        self.sensor_check.check_reading(at, &reading, Some(0.2))
    }

    /// Adds LIS3MDL noise, quantised to its counts.
    fn with_noise(&mut self, field_ut: [f32; 3]) -> [f32; 3] {
        let counts = field_ut.map(|ut| ((ut + 0.35 * self.random.normal()) * 68.42).round());
        counts.map(|counts| counts / 68.42)
    }

    fn faults_at_rest(&mut self, field_ut: [f32; 3], readings: u32) -> Vec<ReadingFault> {
        (0..readings)
            .filter_map(|_| {
                let field_ut = self.with_noise(field_ut);
                self.check_with_slow_turn(field_ut)
            })
            .collect()
    }
}

const PARKED_FIELD_UT: [f32; 3] = [20.0, -5.0, 40.0];

/// At either end of its range an axis is clipped after eight equal readings, half of a stuck one's; later at once.
#[test]
fn a_clipping_level_is_found_in_eight_readings_and_remembered() {
    for sign in [1.0, -1.0] {
        let mut axis = AxisCheck::INITIAL;
        for i in 0_u8..40 {
            assert_eq!(axis.check_axis_value(sign * f32::from(i) * 0.5, 16), None);
        }
        let end_ut = sign * 20.0;
        let faults: Vec<_> = (0..10).map(|_| axis.check_axis_value(end_ut, 16)).collect();
        assert_eq!(faults.iter().position(Option::is_some), Some(7), "{faults:?}");
        assert_eq!(faults[7], Some(ReadingFault::Clipped));
        assert_eq!(axis.check_axis_value(sign * 10.0, 16), None);
        let first_at_end = axis.check_axis_value(end_ut, 16);
        assert_eq!(first_at_end, Some(ReadingFault::Clipped), "the end of the range is known");
        // A larger value revokes the clipping level.
        assert_eq!(axis.check_axis_value(sign * 20.1, 16), None);
        assert_eq!(axis.check_axis_value(end_ut, 16), None);
    }
}

#[test]
fn an_axis_that_moved_under_5_ut_is_not_clipped() {
    for (range_ut, expected) in [(4.0, None), (6.0, Some(ReadingFault::Clipped))] {
        let mut axis = AxisCheck::INITIAL;
        axis.check_axis_value(0.0, 16);
        assert_eq!((0..8).find_map(|_| axis.check_axis_value(range_ut, 16)), expected, "{range_ut}");
    }
    let mut axis = AxisCheck::INITIAL;
    axis.check_axis_value(0.0, 16);
    axis.check_axis_value(20.0, 16);
    assert_eq!((0..15).find_map(|_| axis.check_axis_value(10.0, 16)), None);
}

/// RMS step of the reference sensor 0.9 uT, times 5 = 4.4 uT, plus 0.9 uT for 0.2 + 0.5 rad/s.
#[test]
fn a_single_distant_reading_is_a_spike_and_the_next_one_is_accepted() {
    for (height_ut, expected) in [(3.0, None), (8.0, Some(ReadingFault::Spike)), (300.0, Some(ReadingFault::Spike))] {
        for axis in 0..3 {
            let mut readings = SimulatedReadings::settled();
            let mut field_ut = readings.with_noise(PARKED_FIELD_UT);
            field_ut[axis] += height_ut;
            assert_eq!(readings.check_with_slow_turn(field_ut), expected, "{height_ut}");
            assert_eq!(readings.faults_at_rest(PARKED_FIELD_UT, 500), []);
        }
    }
    let mut readings = SimulatedReadings::settled();
    assert_eq!(readings.check_with_slow_turn([f32::NAN, 0.0, 0.0]), Some(ReadingFault::Spike));
}

#[test]
fn a_lasting_field_step_is_accepted_at_the_fourth_reading() {
    let mut readings = SimulatedReadings::settled();
    let field_after_step = [335.0, -5.0, 40.0];
    assert_eq!(readings.faults_at_rest(field_after_step, 3), [ReadingFault::Spike; 3]);
    assert_eq!(readings.faults_at_rest(field_after_step, 500), []);
}

#[test]
fn the_spike_limit_adapts_to_noise_within_1_s() {
    let mut readings = SimulatedReadings::settled();
    let mut spikes = [0; 2];
    for second in &mut spikes {
        for _ in 0..80 {
            let field_ut = PARKED_FIELD_UT.map(|ut| ut + 1.75 * readings.random.normal());
            *second += usize::from(readings.check_with_slow_turn(field_ut).is_some());
        }
    }
    assert!(spikes[0] < 40 && spikes[1] == 0, "{spikes:?}");
    // The spike limit decreases as fast as it grows.
    readings.faults_at_rest(PARKED_FIELD_UT, 160);
    assert_eq!(readings.check_with_slow_turn([28.0, -5.0, 40.0]), Some(ReadingFault::Spike));
}
