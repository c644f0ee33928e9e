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
//! use autoswing::frames::{RollPitch, Field};
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
//!     ..Calibration::uncalibrated(Orientation::IDENTITY_ROTATION)
//! };
//! let calibration = Some((calibration, HeadingUncertainty::NO_UNCERTAINTY));
//! instrument.set_correction(Correction { calibration, ..Correction::UNCALIBRATED });
//!
//! let attitude = RollPitch::from_deg(20.0, 3.0);
//! let sender_clock_at_sending = WrappingMillis::new(0);
//! let report = AttitudeReport { sender: SenderId::default(), sender_clock_at_sending, attitude, body_rates: None };
//! instrument.on_attitude(Timestamp::from_us(1_000_000), report);
//! let field = Field::new(attitude.to_body_frame(Field::earth_field(50.0, 60_f32.to_radians(), 1.2)).ut);
//! let reading = Reading { field, is_saturated: false, was_overwritten: false };
//! let estimate = instrument.on_reading(Timestamp::from_us(1_010_000), reading);
//! assert!((estimate.heading.unwrap().magnetic_rad - 1.2).abs() < 1e-4);
//! ```

mod active_calibration;
mod attitude_pairing;
mod averager;
mod compass_field;
mod config;
mod correction;
mod estimate;
mod gyro_error;
mod monitor;
mod output_map;
mod sensor_check;
mod smoother;
mod turn_request;
mod ud_filter;

use crate::attitude::{AttitudeLookup, AttitudeReport, AttitudeTrack, EulerRates, GyroHeading};
use crate::calibration::{MotorCurrent, Sample};
use crate::frames::{Body, Field, RollPitch, Sensor};
use crate::heading::{self, Heading, NoHeading};
use crate::inertial::{GYRO_CROSS_AXIS, InertialAttitude};
use crate::reading::Reading;
use crate::time::Timestamp;
use crate::trig::{self, sqrt, square};
use active_calibration::ActiveCalibration;
use attitude_pairing::PairingQueue;
use averager::{AveragedSample, CorrectedReading};
use compass_field::CompassField;
pub use config::{InstrumentConfig, readings_per_sample};
pub use correction::{Correction, SampleAttitude, SensorErrorSigmas};
pub use estimate::{Estimate, RejectionCounts};
pub use monitor::{ChangeReporter, HardIronChange, InstallationChange, MountTurn};
use monitor::{MAX_SENT_SIGMA_RAD, Monitor, MonitorOutput, MonitoredAttitude, MonitoredCalibration};
use sensor_check::{ReadingFault, SensorCheck};
use smoother::HeadingSmoother;
pub use turn_request::TurnRequest;

/// Instrument state, 7.8 KB with an own gyro. Larger methods are not inlined, to limit the stack.
#[derive(Debug)]
pub struct Instrument {
    config: InstrumentConfig,
    active_calibration: ActiveCalibration,
    attitude_track: AttitudeTrack,
    sensor_check: SensorCheck,
    pairing_queue: PairingQueue,
    smoother: HeadingSmoother,
    rejection_counts: RejectionCounts,
    monitor: Monitor,
    /// Last sample, which the monitor has yet to process, and the time of its last reading.
    pending_sample: Option<(Timestamp, AveragedSample)>,
    compass_field: CompassField,
    consecutive_rejected_rates: u8,
    /// Last reported motor current, amperes, and its time.
    motor_current: Option<(Timestamp, f32)>,
}

/// Consecutive reports with inconsistent body rates that restart the monitor: 0.2 s at 50 Hz.
const MAX_CONSECUTIVE_REJECTED_RATES: u8 = 10;

/// Validity of a reported current, microseconds. Autopilots report it at 1 Hz or faster.
const CURRENT_VALIDITY_US: u64 = 3_000_000;

/// Without an attitude the monitor is not updated; time for which its last verdict of a disturbed field holds,
/// microseconds.
const VERDICT_HOLD_US: u64 = 10_000_000;

impl Instrument {
    /// An instrument without a calibration.
    #[must_use]
    #[inline(never)]
    pub fn new(config: InstrumentConfig) -> Self {
        Self {
            config,
            active_calibration: ActiveCalibration::new(Correction::UNCALIBRATED),
            attitude_track: AttitudeTrack::new(config.attitude),
            sensor_check: SensorCheck::new(&config),
            pairing_queue: PairingQueue::new(config.readings_per_sample(), config.max_step_us()),
            smoother: HeadingSmoother::new(),
            rejection_counts: RejectionCounts::NO_REJECTIONS,
            monitor: Monitor::new(SensorErrorSigmas::DEFAULT),
            pending_sample: None,
            compass_field: CompassField::INITIAL,
            consecutive_rejected_rates: 0,
            motor_current: None,
        }
    }

    /// Replaces the correction. Slow: call it after sending a heading.
    #[inline(never)]
    pub fn set_correction(&mut self, correction: Correction) {
        let base = &self.active_calibration.stored_correction;
        if correction.sample_attitude != base.sample_attitude {
            // A sample must not mix readings with and without attitude.
            self.pairing_queue.clear_queue();
        }
        let has_same_sources =
            correction.attitude_source == base.attitude_source && correction.sensor_errors == base.sensor_errors;
        self.attitude_track.set_source(correction.attitude_source);
        if correction.calibration == base.calibration && has_same_sources {
            self.replace_active(self.active_calibration.clone().with_stored_correction(correction));
        } else {
            self.restart_monitor(correction);
        }
    }

    /// Restarts the monitor after a change of calibration, of expected errors or of the attitude's latency, or wrong body rates.
    #[inline(never)]
    fn restart_monitor(&mut self, correction: Correction) {
        self.monitor = Monitor::new(correction.sensor_errors);
        self.pending_sample = None;
        // A mean has fields of one calibration.
        self.pairing_queue.clear_queue();
        self.replace_active(ActiveCalibration::new(correction));
    }

    fn replace_active(&mut self, active: ActiveCalibration) {
        self.compass_field.change_calibration(&self.active_calibration, &active);
        self.active_calibration = active;
    }

    /// Replaces the sensor parameters: period in microseconds, and equal consecutive readings that indicate a stuck
    /// axis.
    pub fn set_sensor_parameters(&mut self, period_us: u32, equal_readings_until_stuck: Option<u16>) {
        self.config.reading_period_us = period_us;
        self.config.equal_readings_until_stuck = equal_readings_until_stuck;
        self.sensor_check = SensorCheck::new(&self.config);
        self.pairing_queue.set_sensor_parameters(self.config.readings_per_sample(), self.config.max_step_us());
    }

    /// Processes an attitude report whose last byte arrived at `at`. It may complete samples.
    #[inline(never)]
    pub fn on_attitude(&mut self, at: Timestamp, report: AttitudeReport) {
        let rejected_before = self.attitude_track.rejected_reports().rate_contradictions;
        let latency_before_us = self.attitude_track.corrected_latency_us();
        let were_rates_replaced = self.attitude_track.are_rates_replaced();
        if !self.attitude_track.push_report(at, report) {
            return;
        }
        self.compass_field.update_attitude(at, report.attitude);
        let is_contradicted = self.attitude_track.rejected_reports().rate_contradictions != rejected_before;
        self.consecutive_rejected_rates =
            if is_contradicted { self.consecutive_rejected_rates.saturating_add(1) } else { 0 };
        if self.attitude_track.are_rates_replaced() != were_rates_replaced {
            self.monitor.forget_gyro();
        }
        let is_latency_changed = self.attitude_track.corrected_latency_us() != latency_before_us;
        if is_latency_changed || self.consecutive_rejected_rates == MAX_CONSECUTIVE_REJECTED_RATES {
            self.restart_monitor(self.active_calibration.stored_correction.clone());
        }
    }

    /// Processes an estimate of the module's own gyro and accelerometer, of a sample taken at `at`. It may complete
    /// samples.
    #[inline(never)]
    pub fn on_inertial_attitude(&mut self, at: Timestamp, estimate: &InertialAttitude) {
        self.attitude_track.push_inertial_attitude(at, estimate);
        if self.attitude_track.own_tilt_covariance().is_some() {
            self.compass_field.update_attitude(at, estimate.attitude);
        }
    }

    /// Stores the motor current, amperes, reported at `at`, unless it contradicts the currents of the calibration.
    pub fn on_current(&mut self, at: Timestamp, amperes: f32) {
        let calibration = self.active_calibration.stored_correction.calibration.as_ref();
        if calibration.is_none_or(|(calibration, _)| calibration.motor_current.is_plausible_current(amperes)) {
            self.motor_current = Some((at, amperes));
        }
    }

    /// The field of a reading without the motor current's interference, the same calibrated, and that current. A current
    /// that the field strength contradicts, and fits the mean current, is dropped: a broken or forged report.
    fn correct_reading(
        &mut self,
        at: Timestamp,
        field: Field<Sensor>,
        is_faulty: bool,
    ) -> (Field<Sensor>, Option<Field<Body>>, Option<f32>) {
        let corrected_at = |instrument: &Self, current_a: Option<f32>| {
            let field = instrument.active_calibration.remove_motor_current(field, current_a);
            (field, instrument.active_calibration.calibrated_field(field))
        };
        let has_strength = |instrument: &Self, corrected: Option<Field<Body>>| {
            corrected.is_some_and(|body| instrument.has_calibrated_strength(body))
        };
        let current_a = self.current_a(at);
        let (reported_field, corrected) = corrected_at(self, current_a);
        if current_a.is_some() && !is_faulty && !has_strength(self, corrected) {
            let (mean_field, corrected_at_mean) = corrected_at(self, None);
            if has_strength(self, corrected_at_mean) {
                self.motor_current = None;
                let count = &mut self.rejection_counts.contradicted_currents;
                *count = count.wrapping_add(1);
                return (mean_field, corrected_at_mean, None);
            }
        }
        (reported_field, corrected, current_a)
    }

    fn current_a(&self, at: Timestamp) -> Option<f32> {
        valid_current_a(self.motor_current, at)
    }

    /// Processes a reading taken at `at`. It may complete a sample.
    #[inline(never)]
    pub fn on_reading(&mut self, at: Timestamp, reading: Reading) -> Estimate {
        let fault = self.sensor_check.check_reading(at, &reading, self.attitude_track.body_rate_rad_s(at));
        if let Some(fault) = fault {
            self.count_rejection(fault);
            // Earlier readings still time out while waiting for an attitude.
            self.pairing_queue.advance_time(at);
        } else {
            self.pairing_queue.push_field(at, reading.field);
            self.attitude_track.update_raw_field(reading.field);
        }
        let (field, corrected, current_a) = self.correct_reading(at, reading.field, fault.is_some());
        let body_field = corrected.filter(|_| fault.is_none());
        if let Some(body_field) = body_field {
            self.attitude_track.update_field(body_field);
        }
        let latency_us = self.attitude_latency_us();
        let attitude = self.attitude_at(at, latency_us);
        let gyro_heading = self.attitude_track.gyro_heading_at(at, latency_us);
        let heading = match fault {
            Some(fault) => Err(fault.into()),
            None => self.compute_heading((field, corrected), current_a, attitude, gyro_heading.as_ref()),
        };
        let monitored_heading = self.monitored_heading(gyro_heading.as_ref());
        let smoothed_heading =
            self.smoother.smooth_heading(at, heading.as_ref().ok(), gyro_heading.as_ref(), monitored_heading);
        let heading = heading.and_then(|heading| self.with_disagreement(heading));
        let smoothed_heading = smoothed_heading.filter(|_| heading.is_ok());
        let compass_field = self.compass_field.output_field(at, &self.active_calibration, field, corrected);
        Estimate {
            timestamp: at,
            body_field,
            compass_field: compass_field.filter(|_| self.is_compass_field_valid(at, corrected, &heading)),
            heading,
            smoothed_heading,
            attitude: attitude.ok(),
            tilt_sigmas_rad: self.own_tilt_sigmas_rad(),
            euler_rates: gyro_heading.map(|gyro_heading| gyro_heading.euler_rates),
            installation_change: self.installation_change(),
            current_a,
        }
    }

    /// The heading with the variance of its disagreement with the monitor's, unless that is beyond any usable heading.
    fn with_disagreement(&self, heading: Heading) -> Result<Heading, NoHeading> {
        let variance_rad2 = self.smoother.disagreement_variance_rad2();
        if variance_rad2 <= square(MAX_SENT_SIGMA_RAD) || self.config.heading.accepts_any_field() {
            Ok(heading.with_added_variance(variance_rad2))
        } else {
            Err(NoHeading::FieldDisturbed)
        }
    }

    /// The monitor's heading by the gyro's, with alignment; `None` while the monitor is not updated.
    fn monitored_heading(&self, gyro_heading: Option<&GyroHeading>) -> Option<Heading> {
        let ActiveCalibration { adjustment, stored_correction, .. } = &self.active_calibration;
        let gyro_heading = gyro_heading.filter(|_| stored_correction.has_valid_inclination);
        Some(adjustment.heading_by_gyro(gyro_heading?)?.rotated_by_deg(stored_correction.align_deg))
    }

    /// Standard deviations of roll and pitch, radians, if the own attitude is in use.
    fn own_tilt_sigmas_rad(&self) -> Option<[f32; 2]> {
        self.attitude_track.own_tilt_covariance().map(|covariance| [0, 1].map(|axis| sqrt(covariance[(axis, axis)])))
    }

    /// Estimate for a silent sensor, once the time without a reading exceeds the configured limit.
    #[must_use]
    pub fn on_silence(&self, at: Timestamp) -> Estimate {
        let (attitude, current_a) = (self.attitude_at(at, self.attitude_latency_us()).ok(), self.current_a(at));
        Estimate {
            timestamp: at,
            attitude,
            tilt_sigmas_rad: self.own_tilt_sigmas_rad(),
            installation_change: self.installation_change(),
            current_a,
            ..Estimate::EMPTY
        }
    }

    /// The next complete sample. Call until `None` after each reading and report; one report can complete several
    /// samples.
    #[inline(never)]
    pub fn next_sample(&mut self) -> Option<Sample> {
        match self.active_calibration.stored_correction.sample_attitude {
            SampleAttitude::Interpolated => {
                let Self { pairing_queue, attitude_track, active_calibration, motor_current, .. } = self;
                let corrected_at = |at, field| {
                    let gyro_heading = attitude_track.gyro_heading_at(at, 0)?;
                    let current_a = valid_current_a(*motor_current, at);
                    Some(CorrectedReading { field: active_calibration.field_as_stored(field, current_a), gyro_heading })
                };
                let (at, mut averaged) =
                    pairing_queue.next_sample(|at| attitude_track.accurate_attitude_at(at), corrected_at)?;
                averaged.sample.current = MotorCurrent::from_a(self.current_a(at));
                self.pending_sample = Some((at, averaged));
                Some(averaged.sample)
            }
            SampleAttitude::Unknown => {
                let level = |_| AttitudeLookup::Interpolated(RollPitch::default());
                let (at, AveragedSample { sample, .. }) = self.pairing_queue.next_sample(level, |_, _| None)?;
                Some(Sample { current: MotorCurrent::from_a(self.current_a(at)), ..sample })
            }
        }
    }

    /// Updates the monitor with the last sample, if there is a new one, and adjusts the active calibration to it. Slow:
    /// call it after sending the heading. The monitor needs a calibration with a valid inclination.
    #[inline(never)]
    pub fn update_monitor(&mut self) {
        let Some((at, averaged)) = self.pending_sample.take() else { return };
        let base = &self.active_calibration.stored_correction;
        let Some((calibration, uncertainty)) = base.calibration.as_ref().filter(|_| base.has_valid_inclination) else {
            return;
        };
        let readings_per_sample = self.config.readings_per_sample();
        let monitored = MonitoredCalibration { calibration, uncertainty, readings_per_sample };
        let attitude = match self.attitude_track.own_tilt_covariance() {
            Some(_) => MonitoredAttitude::Own,
            None => MonitoredAttitude::Autopilot(self.attitude_track.autopilot_errors()),
        };
        self.monitor.process_sample(&monitored, at, &averaged, attitude);
        self.attitude_track.set_mount_turn(self.monitor.mount_turn_rad());
        let adjustment = self.monitor.monitor_output();
        // Headings of an instrument that accepts any field ignore the monitor.
        let is_ignored = self.config.heading.accepts_any_field() && adjustment.validity.is_err();
        let adjustment = if is_ignored { &MonitorOutput::INITIAL } else { adjustment };
        self.active_calibration.apply_monitor_output(at, adjustment, readings_per_sample);
    }

    /// Change of the installation since the calibration, once significant.
    #[must_use]
    pub const fn installation_change(&self) -> Option<InstallationChange> {
        self.monitor.monitor_output().installation_change
    }

    /// Rejected inputs so far.
    #[must_use]
    pub const fn rejection_counts(&self) -> RejectionCounts {
        RejectionCounts {
            unpaired_readings: self.pairing_queue.unpaired_reading_count(),
            rejected_reports: self.attitude_track.rejected_reports(),
            ..self.rejection_counts
        }
    }

    /// Latency of the autopilot's attitude that the own gyro corrects, microseconds; 0 if it is short.
    #[must_use]
    pub fn corrected_latency_us(&self) -> i32 {
        self.attitude_track.corrected_latency_us()
    }

    /// Parameters of the instrument.
    #[must_use]
    pub const fn instrument_config(&self) -> &InstrumentConfig {
        &self.config
    }

    fn count_rejection(&mut self, fault: ReadingFault) {
        let counter = match fault {
            ReadingFault::Saturated => &mut self.rejection_counts.saturated_readings,
            ReadingFault::Clipped => &mut self.rejection_counts.clipped_readings,
            ReadingFault::Stuck => &mut self.rejection_counts.stuck_readings,
            ReadingFault::Spike => &mut self.rejection_counts.spike_readings,
        };
        *counter = counter.wrapping_add(1);
    }

    /// The calibration's attitude latency, microseconds.
    fn attitude_latency_us(&self) -> i32 {
        let latency_s = self
            .active_calibration
            .stored_correction
            .calibration
            .as_ref()
            .map_or(0.0, |(calibration, _)| calibration.latency_s);
        // The cast saturates and maps NaN to 0.
        (latency_s * 1e6) as i32
    }

    fn attitude_at(&self, at: Timestamp, latency_us: i32) -> Result<RollPitch, NoHeading> {
        match self.attitude_track.attitude_at(at, latency_us) {
            AttitudeLookup::Interpolated(attitude) | AttitudeLookup::Extrapolated(attitude) => Ok(attitude),
            AttitudeLookup::Frozen => Err(NoHeading::AttitudeFrozen),
            AttitudeLookup::Contradicted => Err(NoHeading::AttitudeContradicted),
            AttitudeLookup::Missing | AttitudeLookup::Stale => Err(NoHeading::AttitudeStale),
        }
    }

    /// Whether to output a reading's compass field, given its corrected field and its heading. Without a usable
    /// attitude only the field strength is checked.
    fn is_compass_field_valid(
        &self,
        at: Timestamp,
        body: Option<Field<Body>>,
        heading: &Result<Heading, NoHeading>,
    ) -> bool {
        match heading {
            // Raw field while uncalibrated, but never after a calibrated field.
            Ok(_) | Err(NoHeading::Uncalibrated) => true,
            Err(
                NoHeading::AttitudeStale
                | NoHeading::AttitudeFrozen
                | NoHeading::AttitudeInaccurate
                | NoHeading::AttitudeContradicted,
            ) => !self.is_field_error_detected(at) && body.is_some_and(|body| self.has_calibrated_strength(body)),
            Err(_) => false,
        }
    }

    fn is_field_error_detected(&self, at: Timestamp) -> bool {
        match self.active_calibration.adjustment.validity {
            Err(NoHeading::FieldChanged) => true,
            Err(NoHeading::FieldDisturbed) => at.us_since(self.active_calibration.adjusted_at) <= VERDICT_HOLD_US,
            _ => false,
        }
    }

    fn has_calibrated_strength(&self, body: Field<Body>) -> bool {
        let Some((calibration, _)) = &self.active_calibration.adjusted_calibration else { return false };
        let deviation = (body.total_ut() / calibration.total_ut - 1.0).abs();
        self.config
            .heading
            .max_strength_deviation
            .map_or(deviation.is_finite(), |max_deviation| deviation <= max_deviation)
    }

    /// Heading variance by errors of the own attitude, or of an autopilot's that contradicts it, rad^2. A tilt about the field's horizontal
    /// direction turns the heading by `tan(inclination)` times its size, the gyro's axes turned about the vertical by their angle.
    fn attitude_heading_variance_rad2(&self, inclination_rad: f32) -> f32 {
        let by_tilt = |tilt_variance: f32| {
            let (sin, cos) = trig::sin_cos(inclination_rad);
            square(sin / cos) * tilt_variance / 2.0
        };
        match self.attitude_track.own_tilt_covariance() {
            Some(covariance) => by_tilt(covariance.trace()) + square(GYRO_CROSS_AXIS),
            None => self.attitude_track.excess_tilt_variance().map_or(0.0, by_tilt),
        }
    }

    /// Heading of a reading without motor-current interference, and of its corrected field.
    #[inline(never)]
    fn compute_heading(
        &self,
        (field, corrected): (Field<Sensor>, Option<Field<Body>>),
        current_a: Option<f32>,
        attitude: Result<RollPitch, NoHeading>,
        gyro_heading: Option<&GyroHeading>,
    ) -> Result<Heading, NoHeading> {
        let ActiveCalibration { stored_correction: base, adjustment, adjusted_calibration: adjusted, .. } =
            &self.active_calibration;
        let ((calibration, uncertainty), body) = adjusted.as_ref().zip(corrected).ok_or(NoHeading::Uncalibrated)?;
        let euler_rates = gyro_heading.map_or_else(EulerRates::default, |gyro_heading| gyro_heading.euler_rates);
        let attitude = adjustment.correct_attitude(attitude?, &euler_rates);
        adjustment.validity?;
        let limits = self.config.heading;
        let accepts_any_field = limits.accepts_any_field();
        let limits = if base.has_valid_inclination { limits } else { limits.without_inclination_limit() };
        let heading = heading::heading_from_corrected_field(limits, calibration, uncertainty, (field, body), attitude)?
            .with_min_systematic_variance(adjustment.heading_variance_rad2)
            .with_added_systematic_variance(calibration.motor_current_heading_variance_rad2(current_a))
            .with_attitude_variance(self.attitude_heading_variance_rad2(calibration.inclination_rad))?;
        if accepts_any_field || adjustment.passes_reading_gate(heading, gyro_heading) {
            Ok(heading.rotated_by_deg(base.align_deg))
        } else {
            Err(NoHeading::FieldDisturbed)
        }
    }
}

/// The reported current, if it is recent.
fn valid_current_a(reported: Option<(Timestamp, f32)>, at: Timestamp) -> Option<f32> {
    reported.filter(|&(reported_at, _)| at.us_since(reported_at) <= CURRENT_VALIDITY_US).map(|(_, amperes)| amperes)
}

#[cfg(test)]
mod tests;
