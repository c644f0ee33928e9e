//! Limits of the attitude history.

/// Limits of the attitude history.
#[derive(Clone, Copy, Debug)]
pub struct AttitudeConfig {
    /// Attitude latency: age of the attitude when the report's last byte arrives, microseconds. Autopilots need about
    /// 20 ms to estimate, schedule and send. An error of 10 ms is 0.3 deg of roll at 30 deg/s. Negative if the field is
    /// older, as with an averaged field.
    pub latency_us: i32,
    /// Longest extrapolation, microseconds: one lost report of a 10 Hz source. A roll of 30 deg/s that starts at the
    /// last report gives an error of 6 deg.
    pub max_extrapolation_us: u32,
    /// Longest interval between reports for interpolation, microseconds.
    pub max_gap_us: u32,
    /// Largest deviation between arrival and sender clock, microseconds; beyond it, the sender rebooted or has no
    /// clock.
    pub max_clock_deviation_us: u32,
    /// Growth of the clock-offset estimate, microseconds per report. 50 reports per second track 500 ppm of drift, ten
    /// times that of two poor crystals.
    pub clock_offset_growth_us_per_report: u32,
    /// Longest interval between reports over which rates are integrated, microseconds. Over 1.5 s in turns of 45 deg of
    /// bank they cost a heading error of up to 6 deg, which no sigma includes.
    pub max_integrated_gap_us: u32,
    /// Longest silence of a sender without a clock that is no restart, microseconds. Autopilots take three seconds or
    /// more to boot; loaded links stall for less.
    pub restart_silence_us: u32,
}

impl AttitudeConfig {
    /// Limits for MAVLink autopilots.
    pub const DEFAULT: Self = Self {
        latency_us: 20_000,
        max_extrapolation_us: 200_000,
        max_gap_us: 250_000,
        max_clock_deviation_us: 100_000,
        clock_offset_growth_us_per_report: 10,
        max_integrated_gap_us: 500_000,
        restart_silence_us: 2_500_000,
    };
}
