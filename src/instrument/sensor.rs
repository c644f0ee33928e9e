//! Whether a reading can be a measurement: an axis that repeats, one that ends before its range does, a reading far
//! from the one before.

use super::Config;
use crate::frames::{Field, Sensor};
use crate::heading::NoHeading;
use crate::magnetometer::Reading;
use crate::time::Timestamp;

/// What is wrong with a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fault {
    /// The chip says so itself: an axis is at the end of its range.
    Saturated,
    /// An axis repeats the largest, or the smallest, it has ever read.
    Clipped,
    /// An axis repeats.
    Stuck,
    /// No field moves so far in so short a time.
    Spike,
}

impl From<Fault> for NoHeading {
    fn from(fault: Fault) -> Self {
        match fault {
            Fault::Saturated => Self::SensorSaturated,
            Fault::Clipped => Self::SensorClipped,
            Fault::Stuck => Self::SensorStuck,
            Fault::Spike => Self::SensorSpike,
        }
    }
}

/// An axis that has not moved by so much since the start, microtesla, has shown no end of its range: ten times a poor
/// sensor's noise.
const MIN_RANGE_UT: f32 = 5.0;

/// Readings in a row that are not believed; the next one shows that the field is another now.
const SPIKES_IN_A_ROW: u8 = 3;

/// Readings further apart than this are not compared, microseconds.
const MAX_STEP_US: u64 = 500_000;

/// From one reading to the next the field moves by no more than so many times what it usually does, beside what the
/// turning of the aircraft explains. Five times the RMS of three normal components is 7.5 sigma of the noisiest of a
/// LIS3MDL's: once in a million hours.
const SPIKE_RATIO: f32 = 5.0;

/// What it usually moves by at the least, microtesla RMS: the resolution of a coarse sensor.
const MIN_SCATTER_UT: f32 = 0.3;

/// What it is taken to move by before any reading has shown it, microtesla RMS: that of a LIS3MDL, 0.9, and some.
const FIRST_SCATTER_UT: f32 = 1.5;

/// Readings over which what is usual is averaged.
const SCATTER_READINGS: f32 = 32.0;

/// The largest field that turns with the aircraft, microtesla: the Earth's 66 in soft iron of 50 %.
const LARGEST_FIELD_UT: f32 = 100.0;

/// What the attitude source's body rates may be wrong by, or behind, radians a second.
const RATE_MARGIN_RAD_S: f32 = 0.5;

/// How fast an aircraft turns of which no rates are known, radians a second.
const FASTEST_RAD_S: f32 = 4.0;

/// One axis.
#[derive(Clone, Copy, Debug)]
struct Axis {
    last_ut: f32,
    /// Readings in a row that were the same.
    same: u16,
    lowest_ut: f32,
    highest_ut: f32,
    /// Where it is known to end.
    ends_at_ut: Option<f32>,
}

impl Axis {
    const NEW: Self = Self { last_ut: f32::NAN, same: 0, lowest_ut: f32::MAX, highest_ut: f32::MIN, ends_at_ut: None };

    fn see(&mut self, ut: f32, stuck_after: u16) -> Option<Fault> {
        // Bit by bit, for what is no number repeats as well.
        self.same = if ut.to_bits() == self.last_ut.to_bits() { self.same.saturating_add(1) } else { 1 };
        self.last_ut = ut;
        if ut < self.lowest_ut || ut > self.highest_ut {
            // It goes on beyond what was taken for its end.
            self.ends_at_ut = None;
        }
        self.lowest_ut = self.lowest_ut.min(ut);
        self.highest_ut = self.highest_ut.max(ut);
        let at_end = ut <= self.lowest_ut || ut >= self.highest_ut;
        let has_moved = self.highest_ut - self.lowest_ut >= MIN_RANGE_UT;
        // Noise does not keep to the very end of what was seen: half as many readings are enough.
        if at_end && has_moved && self.same >= stuck_after / 2 {
            self.ends_at_ut = Some(ut);
        }
        if self.ends_at_ut.is_some_and(|end_ut| end_ut.to_bits() == ut.to_bits()) {
            Some(Fault::Clipped)
        } else if self.same >= stuck_after {
            Some(Fault::Stuck)
        } else {
            None
        }
    }
}

/// Looks at every reading.
#[derive(Debug)]
pub(super) struct SensorCheck {
    /// After so many equal readings an axis is stuck; none: recordings, whose resolution is not known.
    stuck_after: Option<u16>,
    axes: [Axis; 3],
    /// The last reading that was believed.
    last: Option<(Timestamp, Field<Sensor>)>,
    /// Mean square of the steps between readings.
    scatter_ut2: f32,
    /// Readings in a row that were not believed.
    spikes: u8,
}

impl SensorCheck {
    /// Nothing seen yet.
    pub const fn new(config: &Config) -> Self {
        Self {
            stuck_after: config.stuck_after,
            axes: [Axis::NEW; 3],
            last: None,
            scatter_ut2: FIRST_SCATTER_UT * FIRST_SCATTER_UT,
            spikes: 0,
        }
    }

    /// What is wrong with the reading of an instant; `turning_rad_s` is how fast the aircraft turns about any axis,
    /// where that is known.
    pub fn see(&mut self, at: Timestamp, reading: &Reading, turning_rad_s: Option<f32>) -> Option<Fault> {
        if reading.saturated {
            return Some(Fault::Saturated);
        }
        if self.is_spike(at, reading.field, turning_rad_s) {
            // It shows neither an end of the range nor a value that is kept.
            return Some(Fault::Spike);
        }
        let stuck_after = self.stuck_after?;
        let [x, y, z] = &mut self.axes;
        let field = reading.field.ut;
        let faults = [x.see(field.x, stuck_after), y.see(field.y, stuck_after), z.see(field.z, stuck_after)];
        faults.into_iter().flatten().next()
    }

    fn is_spike(&mut self, at: Timestamp, field: Field<Sensor>, turning_rad_s: Option<f32>) -> bool {
        let Some((before, last)) = self.last.filter(|(before, _)| at.us_since(*before) <= MAX_STEP_US) else {
            self.believe(at, field);
            return false;
        };
        let step_ut = (field.ut - last.ut).norm();
        let turning_rad_s = turning_rad_s.map_or(FASTEST_RAD_S, |rate_rad_s| rate_rad_s + RATE_MARGIN_RAD_S);
        let turned_ut = turning_rad_s * LARGEST_FIELD_UT * at.us_since(before) as f32 * 1e-6;
        let usual_ut = libm::sqrtf(self.scatter_ut2).max(MIN_SCATTER_UT);
        let limit_ut = SPIKE_RATIO * usual_ut + turned_ut;
        // What is no number is not within the limit.
        let is_near = step_ut <= limit_ut;
        let counted_ut = if is_near { step_ut } else { limit_ut };
        self.scatter_ut2 += (counted_ut * counted_ut - self.scatter_ut2) / SCATTER_READINGS;
        if is_near || self.spikes >= SPIKES_IN_A_ROW {
            self.believe(at, field);
            return false;
        }
        self.spikes += 1;
        true
    }

    fn believe(&mut self, at: Timestamp, field: Field<Sensor>) {
        self.last = Some((at, field));
        self.spikes = 0;
    }
}

#[cfg(test)]
mod tests {
    use testkit::random::Random;

    use super::*;

    const PERIOD_US: u64 = 12_500;
    const STUCK_AFTER: u16 = 16;

    fn check() -> SensorCheck {
        SensorCheck::new(&Config { stuck_after: Some(STUCK_AFTER), ..Config::new(PERIOD_US as u32) })
    }

    /// Readings of a check in time, one a period.
    struct Readings {
        check: SensorCheck,
        number: u64,
        random: Random,
    }

    impl Readings {
        fn new() -> Self {
            Self { check: check(), number: 0, random: Random(1) }
        }

        fn see(&mut self, field_ut: [f32; 3]) -> Option<Fault> {
            self.see_turning(field_ut, Some(0.2))
        }

        fn see_turning(&mut self, [x, y, z]: [f32; 3], turning_rad_s: Option<f32>) -> Option<Fault> {
            self.number += 1;
            let reading = Reading { field: Field::from_ut(x, y, z), saturated: false, overrun: false };
            self.check.see(Timestamp::from_us(self.number * PERIOD_US), &reading, turning_rad_s)
        }

        /// A LIS3MDL's noise, in its counts, on a field.
        fn noisy(&mut self, field_ut: [f32; 3]) -> [f32; 3] {
            let counts = field_ut.map(|ut| ((ut + 0.35 * self.random.normal()) * 68.42).round());
            counts.map(|counts| counts / 68.42)
        }

        /// So many readings of a parked vehicle; the faults seen.
        fn park(&mut self, field_ut: [f32; 3], readings: u32) -> Vec<Fault> {
            (0..readings)
                .filter_map(|_| {
                    let field_ut = self.noisy(field_ut);
                    self.see(field_ut)
                })
                .collect()
        }
    }

    const PARKED: [f32; 3] = [20.0, -5.0, 40.0];

    /// The sixteenth equal reading of any axis; the others go on.
    #[test]
    fn an_axis_that_repeats_is_stuck_at_the_sixteenth_reading() {
        for axis in 0..3 {
            let mut readings = Readings::new();
            readings.park(PARKED, 100);
            let stuck_at = PARKED[axis];
            let faults: Vec<_> = (0..20)
                .map(|_| {
                    let mut field_ut = readings.noisy(PARKED);
                    field_ut[axis] = stuck_at;
                    readings.see(field_ut)
                })
                .collect();
            assert_eq!(faults.iter().position(Option::is_some), Some(15), "axis {axis}: {faults:?}");
            assert!(faults[15..].iter().all(|fault| *fault == Some(Fault::Stuck)));
            // It moves again.
            assert_eq!(readings.park(PARKED, 10), []);
        }
    }

    /// Its noise makes two readings of an axis in a row equal once in eighty. A day is tested in tests/integrity.rs; an
    /// hour shows a limit that is wrong.
    #[test]
    fn a_parked_lis3mdl_is_neither_stuck_nor_spiky() {
        let mut readings = Readings::new();
        assert_eq!(readings.park(PARKED, 80 * 3600), []);
    }

    #[test]
    fn what_repeats_bit_by_bit_repeats_though_it_is_no_number() {
        let mut axis = Axis::NEW;
        let faults: Vec<_> = (0..16).map(|_| axis.see(f32::NAN, 16)).collect();
        assert_eq!(faults[15], Some(Fault::Stuck));
        // Nothing and minus nothing are not the same reading.
        let mut axis = Axis::NEW;
        assert!((0..32).all(|i| axis.see(if i % 2 == 0 { 0.0 } else { -0.0 }, 16).is_none()));
    }

    /// Half of sixteen at the end of what the axis has shown, from both ends; then at once.
    #[test]
    fn an_axis_that_ends_is_clipped_at_the_eighth_reading_and_known_from_then_on() {
        for sign in [1.0, -1.0] {
            let mut axis = Axis::NEW;
            for i in 0_u8..40 {
                assert_eq!(axis.see(sign * f32::from(i) * 0.5, 16), None);
            }
            let end_ut = sign * 20.0;
            let faults: Vec<_> = (0..10).map(|_| axis.see(end_ut, 16)).collect();
            assert_eq!(faults.iter().position(Option::is_some), Some(7), "{faults:?}");
            assert_eq!(faults[7], Some(Fault::Clipped));
            assert_eq!(axis.see(sign * 10.0, 16), None);
            assert_eq!(axis.see(end_ut, 16), Some(Fault::Clipped), "the first reading at the end that is known");
            // It goes beyond: that was no end.
            assert_eq!(axis.see(sign * 20.1, 16), None);
            assert_eq!(axis.see(end_ut, 16), None);
        }
    }

    /// 5 uT: less is a vehicle that stands still.
    #[test]
    fn an_axis_that_has_not_moved_has_shown_no_end() {
        for (range_ut, expected) in [(4.9, None), (5.1, Some(Fault::Clipped))] {
            let mut axis = Axis::NEW;
            axis.see(0.0, 16);
            assert_eq!((0..8).find_map(|_| axis.see(range_ut, 16)), expected, "{range_ut}");
        }
        // In the middle of the range eight readings are chance.
        let mut axis = Axis::NEW;
        axis.see(0.0, 16);
        axis.see(20.0, 16);
        assert_eq!((0..15).find_map(|_| axis.see(10.0, 16)), None);
    }

    #[test]
    fn a_recording_s_axes_may_repeat() {
        let mut check = SensorCheck::new(&Config::new(100_000));
        let reading = Reading { field: Field::from_ut(20.0, 0.0, 40.0), saturated: false, overrun: false };
        assert!((1..100).all(|i| check.see(Timestamp::from_us(i * 100_000), &reading, None).is_none()));
    }

    #[test]
    fn the_chip_s_own_word_comes_first() {
        let reading = Reading { field: Field::from_ut(20.0, 0.0, 40.0), saturated: true, overrun: false };
        assert_eq!(check().see(Timestamp::from_us(1), &reading, None), Some(Fault::Saturated));
    }

    /// Steps of the reference sensor are 0.9 uT RMS: five times that is 4.4, and a turn of 0.2 + 0.5 rad/s adds 0.9.
    /// What is below is noise, what is above none.
    #[test]
    fn a_reading_far_from_the_one_before_is_a_spike_and_the_next_one_is_none() {
        for (height_ut, expected) in [(3.0, None), (8.0, Some(Fault::Spike)), (300.0, Some(Fault::Spike))] {
            for axis in 0..3 {
                let mut readings = Readings::new();
                assert_eq!(readings.park(PARKED, 500), []);
                let mut field_ut = readings.noisy(PARKED);
                field_ut[axis] += height_ut;
                assert_eq!(readings.see(field_ut), expected, "{height_ut}");
                assert_eq!(readings.park(PARKED, 500), []);
            }
        }
        let mut readings = Readings::new();
        readings.park(PARKED, 500);
        assert_eq!(readings.see([f32::NAN, 0.0, 0.0]), Some(Fault::Spike));
    }

    /// With a scatter of 1.5 uT the limit is 7.5 uT, and what a turn adds in one period: at 2 rad/s, and half a radian
    /// more, 3.1 uT; where no rates are known 5.
    #[test]
    fn an_aircraft_that_turns_moves_the_field() {
        for (turning_rad_s, limit_ut) in [(Some(0.0), 8.125), (Some(2.0), 10.625), (None, 12.5)] {
            for (step_ut, expected) in [(limit_ut - 0.1, None), (limit_ut + 0.1, Some(Fault::Spike))] {
                let mut readings = Readings::new();
                readings.see([0.0; 3]);
                assert_eq!(readings.see_turning([step_ut, 0.0, 0.0], turning_rad_s), expected, "{turning_rad_s:?}");
            }
        }
    }

    /// Iron that has moved for good: three readings are doubted, the fourth is believed, and those after it.
    #[test]
    fn a_field_that_stays_elsewhere_is_believed_at_the_fourth_reading() {
        let mut readings = Readings::new();
        readings.park(PARKED, 500);
        let moved = [35.0, -5.0, 40.0];
        assert_eq!(readings.park(moved, 3), [Fault::Spike; 3]);
        assert_eq!(readings.park(moved, 500), []);
    }

    /// Half a second without a reading: nothing to compare with. 0.4 s of a fast turn explain much, but not 100 uT.
    #[test]
    fn readings_far_apart_are_not_compared() {
        for (gap_us, expected) in [(490_000, Some(Fault::Spike)), (510_000, None)] {
            let mut check = check();
            let reading = |x: f32| Reading { field: Field::from_ut(x, 0.0, 0.0), saturated: false, overrun: false };
            check.see(Timestamp::from_us(1), &reading(0.0), Some(0.0));
            let fault = check.see(Timestamp::from_us(1 + gap_us), &reading(100.0), Some(0.0));
            assert_eq!(fault, expected, "{gap_us}");
        }
    }

    /// A sensor with five times the noise is noisy, not spiky: within a second it is known to be.
    #[test]
    fn noise_is_got_used_to() {
        let mut readings = Readings::new();
        readings.park(PARKED, 500);
        let mut spikes = [0; 2];
        for second in &mut spikes {
            for _ in 0..80 {
                let noise = [(); 3].map(|()| 1.75 * readings.random.normal());
                let field_ut = [PARKED[0] + noise[0], PARKED[1] + noise[1], PARKED[2] + noise[2]];
                *second += usize::from(readings.see(field_ut).is_some());
            }
        }
        assert!(spikes[0] < 40 && spikes[1] == 0, "{spikes:?}");
        // And forgotten as fast.
        readings.park(PARKED, 160);
        assert_eq!(readings.see([28.0, -5.0, 40.0]), Some(Fault::Spike));
    }
}
