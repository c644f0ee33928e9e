//! Plausibility checks of readings: saturated, clipped, stuck, spike.

use super::config::InstrumentConfig;
use crate::frames::{Field, Sensor};
use crate::heading::NoHeading;
use crate::reading::Reading;
use crate::time::Timestamp;
use crate::trig::{VectorLength as _, sqrt};

/// Reason for rejecting a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ReadingFault {
    /// The chip reports that an axis is at the end of its range.
    Saturated,
    /// An axis repeats its largest or smallest value so far.
    Clipped,
    /// An axis repeats a value.
    Stuck,
    /// The step from the previous reading is implausibly large.
    Spike,
}

impl From<ReadingFault> for NoHeading {
    fn from(fault: ReadingFault) -> Self {
        match fault {
            ReadingFault::Saturated => Self::SensorSaturated,
            ReadingFault::Clipped => Self::SensorClipped,
            ReadingFault::Stuck => Self::SensorStuck,
            ReadingFault::Spike => Self::SensorSpike,
        }
    }
}

/// Range an axis must have covered before it can be clipped, microtesla: ten times the noise of a poor sensor.
const MIN_RANGE_FOR_CLIPPING_UT: f32 = 5.0;

/// Consecutive spikes rejected; the next reading is accepted as a changed field.
const MAX_CONSECUTIVE_SPIKES: u8 = 3;

/// Longest interval over which readings are compared, microseconds.
const MAX_COMPARED_INTERVAL_US: u64 = 500_000;

/// Spike limit relative to the RMS step between readings, beyond the step explained by rotation. Five times the RMS of
/// three normal components is 7.5 sigma of a LIS3MDL's noisiest axis: once in a million hours.
const SPIKE_RATIO: f32 = 5.0;

/// Lower limit of the RMS step, microtesla: resolution of a coarse sensor.
const MIN_RMS_STEP_UT: f32 = 0.3;

/// Initial RMS step, microtesla: 0.9 of a LIS3MDL plus margin.
const INITIAL_RMS_STEP_UT: f32 = 1.5;

const AVERAGED_STEPS: f32 = 32.0;

/// Largest field that rotates with the aircraft, microtesla: the Earth's 66 with 50 % soft iron.
const MAX_FIELD_UT: f32 = 100.0;

/// Error and delay of the body rates, rad/s.
const RATE_MARGIN_RAD_S: f32 = 0.5;

/// Assumed rotation rate without body rates, rad/s.
const ASSUMED_RATE_RAD_S: f32 = 4.0;

#[derive(Clone, Copy, Debug)]
struct AxisCheck {
    last_ut: f32,
    repeat_count: u16,
    lowest_ut: f32,
    highest_ut: f32,
    clip_level_ut: Option<f32>,
}

impl AxisCheck {
    const INITIAL: Self =
        Self { last_ut: f32::NAN, repeat_count: 0, lowest_ut: f32::MAX, highest_ut: f32::MIN, clip_level_ut: None };

    fn check_axis_value(&mut self, ut: f32, equal_readings_until_stuck: u16) -> Option<ReadingFault> {
        // Compares bits, so that NaN equals itself.
        self.repeat_count =
            if ut.to_bits() == self.last_ut.to_bits() { self.repeat_count.saturating_add(1) } else { 1 };
        self.last_ut = ut;
        if ut < self.lowest_ut || ut > self.highest_ut {
            // The axis exceeds the assumed clipping level.
            self.clip_level_ut = None;
        }
        self.lowest_ut = self.lowest_ut.min(ut);
        self.highest_ut = self.highest_ut.max(ut);
        let is_extreme = ut <= self.lowest_ut || ut >= self.highest_ut;
        let has_range = self.highest_ut - self.lowest_ut >= MIN_RANGE_FOR_CLIPPING_UT;
        // Noise rarely repeats an extreme value: half the count suffices.
        if is_extreme && has_range && self.repeat_count >= equal_readings_until_stuck / 2 {
            self.clip_level_ut = Some(ut);
        }
        if self.clip_level_ut.is_some_and(|level_ut| level_ut.to_bits() == ut.to_bits()) {
            Some(ReadingFault::Clipped)
        } else if self.repeat_count >= equal_readings_until_stuck {
            Some(ReadingFault::Stuck)
        } else {
            None
        }
    }
}

#[derive(Debug)]
pub(super) struct SensorCheck {
    /// Equal consecutive readings of a stuck axis; `None` for recordings of unknown resolution.
    equal_readings_until_stuck: Option<u16>,
    axis_checks: [AxisCheck; 3],
    last_accepted: Option<(Timestamp, Field<Sensor>)>,
    mean_square_step_ut2: f32,
    consecutive_spikes: u8,
}

impl SensorCheck {
    pub const fn new(config: &InstrumentConfig) -> Self {
        Self {
            equal_readings_until_stuck: config.equal_readings_until_stuck,
            axis_checks: [AxisCheck::INITIAL; 3],
            last_accepted: None,
            mean_square_step_ut2: INITIAL_RMS_STEP_UT * INITIAL_RMS_STEP_UT,
            consecutive_spikes: 0,
        }
    }

    /// Checks a reading. `turning_rad_s` is the total rotation rate, if known.
    pub fn check_reading(
        &mut self,
        at: Timestamp,
        reading: &Reading,
        turning_rad_s: Option<f32>,
    ) -> Option<ReadingFault> {
        if reading.is_saturated {
            return Some(ReadingFault::Saturated);
        }
        if self.is_spike(at, reading.field, turning_rad_s) {
            return Some(ReadingFault::Spike);
        }
        let equal_readings_until_stuck = self.equal_readings_until_stuck?;
        let [x, y, z] = &mut self.axis_checks;
        let field = reading.field.ut;
        let faults = [
            x.check_axis_value(field.x, equal_readings_until_stuck),
            y.check_axis_value(field.y, equal_readings_until_stuck),
            z.check_axis_value(field.z, equal_readings_until_stuck),
        ];
        faults.into_iter().flatten().next()
    }

    fn is_spike(&mut self, at: Timestamp, field: Field<Sensor>, turning_rad_s: Option<f32>) -> bool {
        let Some((last_at, last_field)) =
            self.last_accepted.filter(|(last_at, _)| at.us_since(*last_at) <= MAX_COMPARED_INTERVAL_US)
        else {
            self.accept_reading(at, field);
            return false;
        };
        let step_ut = (field.ut - last_field.ut).vector_length();
        let turning_rad_s = turning_rad_s.map_or(ASSUMED_RATE_RAD_S, |rate_rad_s| rate_rad_s + RATE_MARGIN_RAD_S);
        let turned_ut = turning_rad_s * MAX_FIELD_UT * at.us_since(last_at) as f32 * 1e-6;
        let rms_step_ut = sqrt(self.mean_square_step_ut2).max(MIN_RMS_STEP_UT);
        let limit_ut = SPIKE_RATIO * rms_step_ut + turned_ut;
        // A NaN step is not within the limit.
        let is_near = step_ut <= limit_ut;
        let limited_step_ut = if is_near { step_ut } else { limit_ut };
        self.mean_square_step_ut2 += (limited_step_ut * limited_step_ut - self.mean_square_step_ut2) / AVERAGED_STEPS;
        if is_near || self.consecutive_spikes >= MAX_CONSECUTIVE_SPIKES {
            self.accept_reading(at, field);
            return false;
        }
        self.consecutive_spikes += 1;
        true
    }

    fn accept_reading(&mut self, at: Timestamp, field: Field<Sensor>) {
        self.last_accepted = Some((at, field));
        self.consecutive_spikes = 0;
    }
}

#[cfg(test)]
mod tests;
