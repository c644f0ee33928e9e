//! The instrument: readings and attitude reports in, headings and samples out. A pure value without I/O, clock or
//! executor.
//!
//! It owns the processing between sensor and heading: attitude track, active correction, time alignment of readings
//! with attitudes, averaging to samples. Its driver (a task, a replayed recording, a test) passes in timestamped events
//! and handles the results:
//!
//! ```text
//! on_attitude(at, Report) ---> track ---+
//! on_reading(at, Reading) --------------+---> Estimate
//! on_silence(at) -----------------------+
//!                                       +---> pairing ---> averager ---> next_sample()
//! ```
//!
//! An estimate is computed at once, with the attitude extrapolated to the reading if necessary. A sample waits for the
//! next report, so that its attitude is interpolated.
//!
//! ```
//! use autoswing::attitude::{AttitudeReport, SenderId};
//! use autoswing::calibration::{Calibration, HeadingUncertainty, Orientation};
//! use autoswing::frames::{Attitude, Field};
//! use autoswing::instrument::{Correction, Instrument, InstrumentConfig};
//! use autoswing::reading::Reading;
//! use autoswing::time::{Timestamp, WrappingMillis};
//!
//! // A magnetometer of 100 Hz, and an attitude source whose reports are 20 ms old when they arrive.
//! let mut instrument = Instrument::new(InstrumentConfig::new(10_000));
//! // Result of a solve: here an aircraft without iron, in a field of 50 uT at an inclination of 60 deg.
//! let calibration = Calibration {
//!     inclination_rad: 60_f32.to_radians(),
//!     total_ut: 50.0,
//!     ..Calibration::uncalibrated(Orientation::NONE)
//! };
//! let calibration = Some((calibration, HeadingUncertainty::NONE));
//! instrument.set_correction(Correction { calibration, ..Correction::NONE });
//!
//! let attitude = Attitude::from_deg(20.0, 3.0);
//! let sender_time = WrappingMillis::new(0);
//! let report = AttitudeReport { sender: SenderId::default(), sender_time, attitude, rates_rad_s: [0.0; 3] };
//! instrument.on_attitude(Timestamp::from_us(1_000_000), report);
//! let field = Field::new(attitude.body(Field::earth(50.0, 60_f32.to_radians(), 1.2)).ut);
//! let reading = Reading { field, saturated: false, overrun: false };
//! let estimate = instrument.on_reading(Timestamp::from_us(1_010_000), reading);
//! assert!((estimate.heading.unwrap().magnetic_rad - 1.2).abs() < 1e-4);
//! ```

mod averager;
mod compass_field;
mod monitor;
mod pairing;
mod sensor_check;
mod smoother;
#[cfg(test)]
mod tests;

use crate::attitude::{
    self, AttitudeHistory, AttitudeLookup, AttitudeReport, EulerRates, GyroHeading, RejectedReports,
};
use crate::calibration::{Calibration, Current, HeadingUncertainty, Orientation, Sample};
use crate::frames::{Attitude, Body, Field, Sensor};
use crate::heading::{self, Heading, NoHeading};
use crate::reading::Reading;
use crate::time::Timestamp;
use compass_field::CompassField;
pub use monitor::{HardIronChange, HardIronChangeReporter};
use monitor::{Monitor, MonitoredCalibration};
use pairing::PairingQueue;
use sensor_check::{ReadingFault, SensorCheck};
use smoother::HeadingSmoother;

/// Parameters of an instrument.
#[derive(Clone, Copy, Debug)]
pub struct InstrumentConfig {
    /// Sensor period, microseconds.
    pub reading_period_us: u32,
    /// Equal consecutive readings of an axis that indicate a stuck sensor; `None` disables the test.
    pub stuck_after: Option<u16>,
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
const MAX_STEP_FIFTHS: u64 = 16;

impl InstrumentConfig {
    /// Default parameters for a magnetometer of this period.
    #[must_use]
    pub const fn new(reading_period_us: u32) -> Self {
        Self {
            reading_period_us,
            stuck_after: None,
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
    pub const fn silence_us(&self) -> u64 {
        self.reading_period_us as u64 * SILENT_PERIODS as u64
    }

    const fn max_step_us(&self) -> u64 {
        self.reading_period_us as u64 * MAX_STEP_FIFTHS / 5
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

/// Corrections to apply, replaced as a whole so that a heading never mixes two calibrations.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// Active calibration and its uncertainty.
    pub calibration: Option<(Calibration, HeadingUncertainty)>,
    /// Whether the calibration's inclination is valid; without it inclination is not monitored.
    pub has_valid_inclination: bool,
    /// Heading offset, degrees.
    pub align_deg: f32,
    /// Source of the samples' attitude.
    pub sample_attitude: SampleAttitude,
    /// Mounting rotation, once the chip is known. Before the first calibration the compass field is the rotated raw
    /// field.
    pub mount: Option<Orientation>,
    /// Strength of the Earth's field, microtesla, if known.
    pub total_ut: Option<f32>,
    /// Whether the autopilot is armed, if reported.
    pub is_armed: Option<bool>,
}

impl Correction {
    /// No calibration.
    pub const NONE: Self = Self {
        calibration: None,
        has_valid_inclination: true,
        align_deg: 0.0,
        sample_attitude: SampleAttitude::Interpolated,
        mount: None,
        total_ut: None,
        is_armed: None,
    };

    /// Whether both produce the same headings.
    fn gives_same_headings(&self, other: &Self) -> bool {
        self.calibration == other.calibration
            && self.has_valid_inclination == other.has_valid_inclination
            && self.align_deg.to_bits() == other.align_deg.to_bits()
    }
}

/// Source of the samples' attitude.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleAttitude {
    /// Attitude reports, interpolated to the time of each reading.
    Interpolated,
    /// None: samples contain the field only, with level attitude.
    Unknown,
}

/// Results at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Time of the reading, or of the silence.
    pub at: Timestamp,
    /// Corrected field in body axes, in the sensor's microtesla, without alignment. `None` without a calibration, and
    /// if the sensor is silent or faulty. Needs no attitude.
    pub body_field: Option<Field<Body>>,
    /// Field for an autopilot's compass, body axes, microtesla: corrected by calibration and monitor, with alignment,
    /// scaled to the true field strength if known. `None` while not trusted. Needs no attitude. Before the first
    /// calibration it is the raw field.
    pub compass_field: Option<Field<Body>>,
    /// Heading with alignment, or the reason for its absence.
    pub heading: Result<Heading, NoHeading>,
    /// Heading smoothed with the body rates; `None` without a heading, and while the rates are missing, new or
    /// inconsistent with it.
    pub smoothed_heading: Option<Heading>,
    /// Attitude at that time, if reports are recent.
    pub attitude: Option<Attitude>,
    /// Change of hard iron since the calibration, once significant.
    pub hard_iron_change: Option<HardIronChange>,
    /// Motor current, amperes, if reported recently.
    pub current_a: Option<f32>,
}

impl Estimate {
    /// State before the first reading.
    pub const EMPTY: Self = Self {
        at: Timestamp::START,
        body_field: None,
        compass_field: None,
        heading: Err(NoHeading::SensorSilent),
        smoothed_heading: None,
        attitude: None,
        hard_iron_change: None,
        current_a: None,
    };
}

/// Rejected inputs by reason; each counter wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RejectionCounts {
    /// Readings without an attitude.
    pub unpaired: u32,
    /// Readings at the chip's range limit.
    pub saturated: u32,
    /// Readings with an axis limited below the chip's range.
    pub clipped: u32,
    /// Readings with an axis that repeats.
    pub stuck: u32,
    /// Readings too far from the previous one.
    pub spikes: u32,
    /// Rejected attitude reports.
    pub attitude: RejectedReports,
}

impl RejectionCounts {
    /// No rejections.
    pub const NONE: Self =
        Self { unpaired: 0, saturated: 0, clipped: 0, stuck: 0, spikes: 0, attitude: RejectedReports::NONE };
}

/// Instrument state, about 4 KB. Larger methods are not inlined, to limit the stack.
#[derive(Debug)]
pub struct Instrument {
    config: InstrumentConfig,
    correction: Correction,
    track: AttitudeHistory,
    sensor_check: SensorCheck,
    pairing: PairingQueue,
    smoother: HeadingSmoother,
    rejections: RejectionCounts,
    monitor: Monitor,
    pending_sample: Option<(Timestamp, Sample)>,
    monitored_calibration: Option<(Calibration, HeadingUncertainty)>,
    compass_field: CompassField,
    /// Whether the compass field has yet to switch to the present correction.
    is_compass_update_pending: bool,
    monitored_at: Timestamp,
    consecutive_rejected_rates: u8,
    /// Last reported motor current, amperes, and its time.
    motor_current: Option<(Timestamp, f32)>,
}

/// Consecutive reports with inconsistent body rates that restart the monitor: 0.2 s at 50 Hz.
const MAX_REJECTED_RATES: u8 = 10;

/// Validity of a reported current, microseconds. Autopilots report it at 1 Hz or faster.
const CURRENT_VALIDITY_US: u64 = 3_000_000;

/// Without an attitude the monitor is not updated; time for which its last verdict of a disturbed field holds,
/// microseconds.
const DISTURBANCE_HOLD_US: u64 = 10_000_000;

impl Instrument {
    /// An instrument without a calibration.
    #[must_use]
    #[inline(never)]
    pub fn new(config: InstrumentConfig) -> Self {
        Self {
            config,
            correction: Correction::NONE,
            track: AttitudeHistory::new(config.attitude),
            sensor_check: SensorCheck::new(&config),
            pairing: PairingQueue::new(config.readings_per_sample(), config.max_step_us()),
            smoother: HeadingSmoother::new(),
            rejections: RejectionCounts::NONE,
            monitor: Monitor::new(monitor::MonitorConfig::DEFAULT),
            pending_sample: None,
            monitored_calibration: None,
            compass_field: CompassField::INITIAL,
            is_compass_update_pending: false,
            monitored_at: Timestamp::START,
            consecutive_rejected_rates: 0,
            motor_current: None,
        }
    }

    /// Replaces the corrections.
    #[inline(never)]
    pub fn set_correction(&mut self, correction: Correction) {
        if correction.sample_attitude != self.correction.sample_attitude {
            // A sample must not mix readings with and without attitude.
            self.pairing.reset();
        }
        let is_another = correction.calibration != self.correction.calibration;
        if !correction.gives_same_headings(&self.correction) {
            self.smoother.reset();
        }
        self.correction = correction;
        if is_another {
            self.restart_monitor();
        } else {
            self.is_compass_update_pending = true;
        }
    }

    /// Restarts the monitor after a change of calibration or wrong body rates.
    #[inline(never)]
    fn restart_monitor(&mut self) {
        self.monitor = Monitor::new(monitor::MonitorConfig::DEFAULT);
        self.pending_sample = None;
        self.monitored_calibration = self.correction.calibration;
        self.is_compass_update_pending = true;
    }

    /// Replaces the sensor parameters: period in microseconds, and equal consecutive readings that indicate a stuck
    /// axis.
    pub fn set_sensor(&mut self, period_us: u32, stuck_after: Option<u16>) {
        self.config.reading_period_us = period_us;
        self.config.stuck_after = stuck_after;
        self.sensor_check = SensorCheck::new(&self.config);
        self.pairing.set_sensor_parameters(self.config.readings_per_sample(), self.config.max_step_us());
    }

    /// Processes an attitude report whose last byte arrived at `at`. It may complete samples.
    #[inline(never)]
    pub fn on_attitude(&mut self, at: Timestamp, report: AttitudeReport) {
        let before = self.track.rejected().contradicting_rates;
        self.track.push(at, report);
        self.compass_field.update_attitude(at, report.attitude);
        let is_contradicted = self.track.rejected().contradicting_rates != before;
        self.consecutive_rejected_rates =
            if is_contradicted { self.consecutive_rejected_rates.saturating_add(1) } else { 0 };
        if self.consecutive_rejected_rates == MAX_REJECTED_RATES {
            self.restart_monitor();
        }
    }

    /// Stores the motor current, amperes, reported at `at`.
    pub const fn on_current(&mut self, at: Timestamp, amperes: f32) {
        self.motor_current = Some((at, amperes));
    }

    fn current_a(&self, at: Timestamp) -> Option<f32> {
        self.motor_current
            .filter(|&(reported_at, _)| at.us_since(reported_at) <= CURRENT_VALIDITY_US)
            .map(|(_, amperes)| amperes)
    }

    /// Processes a reading taken at `at`. It may complete a sample.
    #[inline(never)]
    pub fn on_reading(&mut self, at: Timestamp, reading: Reading) -> Estimate {
        let fault = self.sensor_check.check(at, &reading, self.track.body_rate_rad_s());
        if let Some(fault) = fault {
            self.count_rejection(fault);
            // Earlier readings still time out while waiting for an attitude.
            self.pairing.advance_time(at);
        } else {
            self.pairing.push(at, reading.field);
            self.track.update_raw_field(reading.field);
        }
        let current_a = self.current_a(at);
        let calibration = self.correction.calibration.as_ref().map(|(calibration, _)| calibration);
        let field = calibration.map_or(reading.field, |in_use| in_use.remove_motor_current(reading.field, current_a));
        let body = calibration.filter(|_| fault.is_none()).map(|calibration| calibration.apply(field));
        if let Some(body) = body {
            self.track.update_field(body);
        }
        let attitude = self.attitude_at(at);
        let turning = self.track.gyro_heading_at(self.attitude_lookup_time(at));
        let heading = fault.map_or_else(
            || self.compute_heading(field, current_a, attitude, turning.as_ref()),
            |fault| Err(fault.into()),
        );
        let smooth = self.smoother.smooth_heading(at, heading.as_ref().ok(), turning);
        let compass =
            self.compass_field.output_field(at, field).filter(|_| self.is_compass_field_valid(at, field, &heading));
        Estimate {
            at,
            body_field: body,
            compass_field: compass,
            heading,
            smoothed_heading: smooth,
            attitude: attitude.ok(),
            hard_iron_change: self.hard_iron_change(),
            current_a,
        }
    }

    /// Estimate for a silent sensor, once the time without a reading exceeds the configured limit.
    #[must_use]
    pub fn on_silence(&self, at: Timestamp) -> Estimate {
        let (attitude, current_a) = (self.attitude_at(at).ok(), self.current_a(at));
        Estimate { at, attitude, hard_iron_change: self.hard_iron_change(), current_a, ..Estimate::EMPTY }
    }

    /// The next complete sample. Call until `None` after each reading and report; one report can complete several
    /// samples.
    #[inline(never)]
    pub fn next_sample(&mut self) -> Option<Sample> {
        match self.correction.sample_attitude {
            SampleAttitude::Interpolated => {
                let motion_at =
                    |at| self.track.gyro_heading_at(at).map_or_else(EulerRates::default, |turning| turning.euler_rates);
                let (at, mut sample) = self.pairing.next_sample(|at| self.track.attitude_at(at), motion_at)?;
                sample.current = Current::from_a(self.current_a(at));
                self.pending_sample = Some((at, sample));
                Some(sample)
            }
            SampleAttitude::Unknown => {
                let at_rest = |_| EulerRates::default();
                let (at, mut sample) =
                    self.pairing.next_sample(|_| AttitudeLookup::Interpolated(Attitude::default()), at_rest)?;
                sample.current = Current::from_a(self.current_a(at));
                Some(sample)
            }
        }
    }

    /// Whether a monitor update is due.
    #[must_use]
    pub const fn is_monitor_update_due(&self) -> bool {
        self.pending_sample.is_some() || self.is_compass_update_pending
    }

    /// Updates the monitor with the last sample, and the compass field with a new correction. Slow: call it after
    /// sending the heading. The monitor needs a calibration with a valid inclination.
    #[inline(never)]
    pub fn update_monitor(&mut self) {
        if core::mem::take(&mut self.is_compass_update_pending) {
            self.compass_field.set_correction(&self.correction, self.monitored_calibration.as_ref());
        }
        let Some((at, sample)) = self.pending_sample.take() else { return };
        let Some((calibration, uncertainty)) = &self.correction.calibration else { return };
        if !self.correction.has_valid_inclination {
            return;
        }
        // A sample's time is the middle of its readings.
        let ahead_s = at.wrapping_millis().signed_ms_since(sample.time) as f32 * 1e-3;
        let turning =
            self.track.gyro_heading_at(self.attitude_lookup_time(at)).map(|turning| turning.extrapolated_back(ahead_s));
        let readings_per_sample = self.config.readings_per_sample();
        let monitored = MonitoredCalibration { calibration, uncertainty, readings_per_sample };
        self.monitor.update(&monitored, at, &sample, turning);
        self.monitored_calibration = Some(self.monitor.output().correct_calibration(&monitored));
        self.monitored_at = at;
        self.compass_field.apply_adjustment(&self.correction, self.monitored_calibration.as_ref());
    }

    /// Change of hard iron since the calibration, once significant.
    #[must_use]
    pub const fn hard_iron_change(&self) -> Option<HardIronChange> {
        self.monitor.output().hard_iron_change
    }

    /// Rejected inputs so far.
    #[must_use]
    pub const fn rejections(&self) -> RejectionCounts {
        RejectionCounts { unpaired: self.pairing.unpaired(), attitude: self.track.rejected(), ..self.rejections }
    }

    /// The parameters.
    #[must_use]
    pub const fn config(&self) -> &InstrumentConfig {
        &self.config
    }

    fn count_rejection(&mut self, fault: ReadingFault) {
        let counter = match fault {
            ReadingFault::Saturated => &mut self.rejections.saturated,
            ReadingFault::Clipped => &mut self.rejections.clipped,
            ReadingFault::Stuck => &mut self.rejections.stuck,
            ReadingFault::Spike => &mut self.rejections.spikes,
        };
        *counter = counter.wrapping_add(1);
    }

    /// Lookup time of the attitude: `at` plus the calibration's attitude latency.
    fn attitude_lookup_time(&self, at: Timestamp) -> Timestamp {
        let latency_s = self.correction.calibration.as_ref().map_or(0.0, |(calibration, _)| calibration.latency_s);
        // The cast saturates and maps NaN to 0.
        at.plus_signed_us((latency_s * 1e6) as i32)
    }

    fn attitude_at(&self, at: Timestamp) -> Result<Attitude, NoHeading> {
        match self.track.attitude_at(self.attitude_lookup_time(at)) {
            AttitudeLookup::Interpolated(attitude) | AttitudeLookup::Extrapolated(attitude) => Ok(attitude),
            AttitudeLookup::Frozen => Err(NoHeading::AttitudeFrozen),
            AttitudeLookup::Aligning => Err(NoHeading::AttitudeContradicted),
            AttitudeLookup::Missing | AttitudeLookup::Stale => Err(NoHeading::AttitudeStale),
        }
    }

    /// Whether to output a reading's compass field, given its heading. Without a usable attitude only the field
    /// strength is checked.
    fn is_compass_field_valid(
        &self,
        at: Timestamp,
        field: Field<Sensor>,
        heading: &Result<Heading, NoHeading>,
    ) -> bool {
        match heading {
            // Raw field while uncalibrated, but never after a calibrated field.
            Ok(_) | Err(NoHeading::Uncalibrated) => true,
            Err(NoHeading::AttitudeStale | NoHeading::AttitudeFrozen | NoHeading::AttitudeContradicted) => {
                !self.is_field_error_detected(at) && self.has_calibrated_strength(field)
            }
            Err(_) => false,
        }
    }

    fn is_field_error_detected(&self, at: Timestamp) -> bool {
        match self.monitor.output().validity {
            Err(NoHeading::FieldChanged) => true,
            Err(NoHeading::FieldDisturbed) => at.us_since(self.monitored_at) <= DISTURBANCE_HOLD_US,
            _ => false,
        }
    }

    fn has_calibrated_strength(&self, field: Field<Sensor>) -> bool {
        let most = self.config.heading.max_strength_deviation;
        let strength_ratio = |calibration: &Calibration| calibration.apply(field).total_ut() / calibration.total_ut;
        self.monitored_calibration
            .as_ref()
            .is_some_and(|(calibration, _)| (strength_ratio(calibration) - 1.0).abs() <= most)
    }

    #[inline(never)]
    fn compute_heading(
        &self,
        field: Field<Sensor>,
        current_a: Option<f32>,
        attitude: Result<Attitude, NoHeading>,
        turning: Option<&GyroHeading>,
    ) -> Result<Heading, NoHeading> {
        let mut active = self.monitored_calibration.as_ref();
        let mut adjustment = self.monitor.output();
        if self.config.heading.accepts_any_field() && adjustment.validity.is_err() {
            // Limits are disabled: ignore the monitor.
            (active, adjustment) = (self.correction.calibration.as_ref(), &monitor::MonitorOutput::INITIAL);
        }
        let (calibration, uncertainty) = active.ok_or(NoHeading::Uncalibrated)?;
        let motion = turning.map_or_else(EulerRates::default, |turning| turning.euler_rates);
        let attitude = adjustment.correct_attitude(attitude?, &motion);
        let config = self.config.heading;
        let accepts_any_field = config.accepts_any_field();
        let config = if self.correction.has_valid_inclination { config } else { config.without_inclination_limit() };
        adjustment.validity?;
        let heading = heading::compute_heading(config, calibration, uncertainty, field, attitude)?
            .with_min_systematic_variance(adjustment.heading_variance_rad2)
            .with_added_systematic_variance(calibration.motor_current_heading_variance_rad2(current_a));
        if accepts_any_field || adjustment.passes_reading_gate(self.monitor.config(), heading, turning) {
            Ok(heading.rotated_by_deg(self.correction.align_deg))
        } else {
            Err(NoHeading::FieldDisturbed)
        }
    }
}
