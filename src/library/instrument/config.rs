//! Parameters of the instrument, from the sensor's period.

use crate::{attitude, heading};

/// Parameters of an instrument.
#[derive(Clone, Copy, Debug)]
pub struct InstrumentConfig {
    /// Period of the magnetometer's readings, microseconds.
    pub reading_period_us: u32,
    /// Equal consecutive readings of an axis that indicate a stuck sensor; `None` disables the test.
    pub equal_readings_until_stuck: Option<u16>,
    /// Parameters of the attitude track, including its latency.
    pub attitude: attitude::AttitudeConfig,
    /// Acceptance limits of a heading.
    pub heading: heading::HeadingLimits,
}

/// Duration of a sample, microseconds. At 80 Hz, averaging over 0.1 s leaves a third of a reading's noise; a turn of
/// 30 deg/s covers 3 deg, which shortens the mean field by less than 0.02 %.
const SAMPLE_SPAN_US: u32 = 100_000;

/// Sensor periods without a reading until the sensor counts as silent.
const SILENT_PERIODS: u32 = 8;

/// Longest step between two averaged readings, in fifths of the sensor period: three periods plus clock tolerance.
const MAX_STEP_PERIOD_FIFTHS: u64 = 16;

impl InstrumentConfig {
    /// Default parameters for a magnetometer of this period.
    #[must_use]
    pub const fn new(reading_period_us: u32) -> Self {
        Self {
            reading_period_us,
            equal_readings_until_stuck: None,
            attitude: attitude::AttitudeConfig::DEFAULT,
            heading: heading::HeadingLimits::DEFAULT,
        }
    }

    /// Readings averaged to one sample: 10 samples per second, or one per reading of a slower sensor.
    #[must_use]
    pub const fn readings_per_sample(&self) -> u16 {
        readings_per_sample(self.reading_period_us)
    }

    /// Time without a reading until the sensor counts as silent, microseconds.
    #[must_use]
    pub const fn silence_timeout_us(&self) -> u64 {
        self.reading_period_us as u64 * SILENT_PERIODS as u64
    }

    /// Longest step between two averaged readings, microseconds.
    pub(super) const fn max_step_us(&self) -> u64 {
        self.reading_period_us as u64 * MAX_STEP_PERIOD_FIFTHS / 5
    }
}

/// Readings averaged to one sample at this sensor period, microseconds; at least one.
#[must_use]
pub const fn readings_per_sample(reading_period_us: u32) -> u16 {
    let period_us = if reading_period_us == 0 { 1 } else { reading_period_us };
    let readings = (SAMPLE_SPAN_US + period_us / 2) / period_us;
    if readings == 0 {
        1
    } else if readings > u16::MAX as u32 {
        u16::MAX
    } else {
        readings as u16
    }
}
