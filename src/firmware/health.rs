//! Diagnostics for the `status` command.

use core::sync::atomic::{AtomicU32, Ordering};

use crate::wire::dronecan::NodeId;
use crate::wire::dronecan::outbound::BusCounts;
use autoswing::attitude::AttitudeSource;
use autoswing::frames::RollPitch;
use autoswing::heading::{Heading, NoHeading};
use autoswing::instrument::{InstallationChange, Instrument};
use autoswing::reading::Identity;
use autoswing_module::messages::SampleLoss;
use autoswing_module::settings::{PORT_COUNT, PortNumber, ProtocolKind};

/// Diagnostics in addition to the state machine's report.
#[derive(Clone, Debug)]
pub struct Diagnostics {
    /// Detected magnetometer.
    pub sensor: Option<Identity>,
    /// Attitude at the last reading.
    pub attitude: Option<RollPitch>,
    /// Last heading, or the reason for its absence.
    pub heading: Result<Heading, NoHeading>,
    /// Change of the installation since the calibration, once significant.
    pub installation_change: Option<InstallationChange>,
    /// Motor current, amperes, if reported recently.
    pub current_a: Option<f32>,
    /// Event counters.
    pub event_counts: EventCounts,
    /// Reason for the last start.
    pub reset_cause: ResetCause,
    /// Time since the start, seconds.
    pub uptime_s: u32,
    /// Stack use, if known.
    pub stack_use: Option<StackUse>,
    /// Detected protocol of each port; `Auto` while searching.
    pub port_protocols: [ProtocolKind; PORT_COUNT],
    /// Node on a CAN bus, if the board has one.
    pub can_state: Option<CanState>,
}

/// State of the node on a CAN bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CanState {
    /// Node number; `None` until the node has one.
    pub node: Option<NodeId>,
    /// Whether another node has the same number.
    pub has_number_conflict: bool,
    /// Counters of frames.
    pub frame_counts: BusCounts,
}

impl Diagnostics {
    /// Detected protocol of a port.
    #[must_use]
    pub const fn port_protocol(&self, number: PortNumber) -> ProtocolKind {
        *number.port_element(&self.port_protocols)
    }
}

/// Largest stack use since the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StackUse {
    /// Stack used at most, bytes.
    pub peak_used_bytes: usize,
    /// Size of the stack, bytes.
    pub size_bytes: usize,
}

/// Reason for the last start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResetCause {
    /// Power-on.
    PowerOn,
    /// Reset pin, or a debugger.
    Pin,
    /// Restart by the `reboot` command.
    Software,
    /// Reset by the watchdog, after a task had stopped.
    Watchdog,
    /// Panic or processor fault.
    Panic(PanicReport),
}

/// Panic or fault of the previous run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PanicReport {
    /// File, line and message of the panic.
    pub message: &'static str,
    /// Consecutive runs that ended in an early panic, this one included.
    pub early_panic_count: u8,
}

/// Consecutive early panics after which the module starts in safe mode.
const MAX_EARLY_PANICS: u8 = 3;

/// Time after a start during which a panic is early, seconds: stored data and the autopilot's messages, the probable
/// causes, are used within seconds. A later panic leaves headings between restarts, which safe mode would end.
const EARLY_PANIC_S: u64 = 60;

/// Number of consecutive early panics after another panic, `uptime_s` after the start.
#[must_use]
pub const fn count_early_panics(previous_count: u8, uptime_s: u64) -> u8 {
    if uptime_s < EARLY_PANIC_S { previous_count.saturating_add(1) } else { 0 }
}

impl ResetCause {
    /// Whether the module starts in safe mode.
    #[must_use]
    pub const fn requires_safe_mode(&self) -> bool {
        matches!(self, Self::Panic(report) if report.early_panic_count >= MAX_EARLY_PANICS)
    }
}

macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {
        /// Event counters since start, wrapping.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct EventCounts {
            $($(#[$doc])* pub $name: u32,)*
        }

        /// Atomic counters, for tasks of any priority.
        #[derive(Debug, Default)]
        pub struct EventCounters {
            $($(#[$doc])* pub $name: AtomicU32,)*
        }

        impl EventCounters {
            /// All counters zero.
            #[must_use]
            pub const fn new() -> Self {
                Self { $($name: AtomicU32::new(0),)* }
            }

            /// Reads all counters.
            #[must_use]
            pub fn snapshot(&self) -> EventCounts {
                EventCounts { $($name: self.$name.load(Ordering::Relaxed),)* }
            }
        }
    };
}

counters! {
    /// Readings of the sensor.
    readings,
    /// Readings overwritten in the sensor before they were read.
    overruns,
    /// Readings at the range limit.
    saturated,
    /// Readings with an axis limited below the range.
    sensor_clipped,
    /// Readings with an axis that repeats a value.
    sensor_stuck,
    /// Readings too far from the previous one.
    sensor_spikes,
    /// Reported motor currents that the field strength contradicts.
    current_contradictions,
    /// Sensor errors that led to a new initialisation.
    sensor_errors,
    /// Unexpected changes of the sensor's configuration.
    sensor_register_upsets,
    /// Measurements of the own gyro and accelerometer.
    inertial_readings,
    /// Errors of that chip that led to a new initialisation; a board without one counts them as well.
    inertial_errors,
    /// Unexpected changes of its configuration.
    inertial_register_upsets,
    /// Estimates of the own attitude since the first rest, from which on the gyro's offset is known.
    inertial_estimates_after_rest,
    /// Own body rates that contradict those of the autopilot.
    inertial_rate_contradictions,
    /// Latency of the attitude that own rates correct now, milliseconds; no counter.
    corrected_latency_ms,
    /// Valid attitude reports of the selected sender.
    attitude_reports,
    /// Valid attitude reports of other senders.
    attitude_of_other_senders,
    /// Attitude and heartbeat frames with a wrong CRC or impossible values.
    attitude_frames_rejected,
    /// Attitude reports rejected because they repeat.
    attitude_frozen,
    /// Attitude reports rejected as spikes.
    attitude_spikes,
    /// Attitude reports whose body rates contradict their attitude.
    attitude_rate_contradictions,
    /// Line errors of the attitude port.
    attitude_line_errors,
    /// Messages to ports, of one or more sentences each.
    messages,
    /// Messages without a heading.
    messages_empty,
    /// Messages dropped for write errors or lack of space.
    write_errors,
    /// Readings without an attitude.
    unpaired_readings,
    /// Readings, attitude reports and samples dropped at a full queue.
    samples_dropped,
    /// Successful saves to flash.
    saves,
    /// Failed loads and saves.
    store_errors,
}

impl EventCounters {
    /// Copies the instrument's counters.
    pub fn copy_instrument_counts(&self, instrument: &Instrument) {
        let counts = instrument.rejection_counts();
        for (counter, count) in [
            (&self.unpaired_readings, counts.unpaired_readings),
            (&self.saturated, counts.saturated_readings),
            (&self.sensor_clipped, counts.clipped_readings),
            (&self.sensor_stuck, counts.stuck_readings),
            (&self.sensor_spikes, counts.spike_readings),
            (&self.current_contradictions, counts.contradicted_currents),
            (&self.attitude_frozen, counts.rejected_reports.frozen_reports),
            (&self.attitude_spikes, counts.rejected_reports.spike_reports),
            (&self.attitude_rate_contradictions, counts.rejected_reports.rate_contradictions),
            (&self.inertial_rate_contradictions, counts.rejected_reports.own_rate_contradictions),
            (&self.corrected_latency_ms, instrument.corrected_latency_us().unsigned_abs() / 1000),
        ] {
            counter.store(count, Ordering::Relaxed);
        }
    }
}

/// Main reason, between two snapshots, for readings that did not become samples, with attitudes of this source; `None` if most readings
/// became samples, or for few readings.
#[must_use]
pub const fn main_sample_loss(
    counts_before: &EventCounts,
    counts_after: &EventCounts,
    attitude_source: AttitudeSource,
) -> Option<SampleLoss> {
    const fn percent(part: u32, whole: u32) -> u32 {
        (part as u64 * 100 / whole as u64) as u32
    }
    let readings = counts_after.readings.wrapping_sub(counts_before.readings);
    if readings < MIN_READINGS {
        return None;
    }
    let saturated = counts_after.saturated.wrapping_sub(counts_before.saturated);
    let clipped = counts_after.sensor_clipped.wrapping_sub(counts_before.sensor_clipped);
    let saturated = percent(saturated.saturating_add(clipped), readings);
    let unpaired = percent(counts_after.unpaired_readings.wrapping_sub(counts_before.unpaired_readings), readings);
    let accepted = counts_after.attitude_reports.wrapping_sub(counts_before.attitude_reports);
    let rejected = counts_after.attitude_frames_rejected.wrapping_sub(counts_before.attitude_frames_rejected);
    let is_own = match attitude_source {
        AttitudeSource::Autopilot => false,
        AttitudeSource::Own => true,
        AttitudeSource::Automatic => accepted == 0 && counts_after.inertial_readings != counts_before.inertial_readings,
    };
    if saturated >= SATURATED_LIMIT_PERCENT {
        Some(SampleLoss::Saturated(saturated))
    } else if rejected > accepted && !is_own {
        Some(SampleLoss::ImpossibleAttitude)
    } else if unpaired >= UNPAIRED_LIMIT_PERCENT {
        Some(if is_own { SampleLoss::InaccurateOwnAttitude(unpaired) } else { SampleLoss::NoAttitude(unpaired) })
    } else {
        None
    }
}

/// Minimum number of readings: one second of a fast sensor.
const MIN_READINGS: u32 = 100;

/// Percentage of readings at the range limit that is reported: at 5 % of a circle the sensor misses one or two sectors.
const SATURATED_LIMIT_PERCENT: u32 = 5;

/// Percentage of readings without an attitude that is reported: attitude reports are then too rare to interpolate.
const UNPAIRED_LIMIT_PERCENT: u32 = 50;

#[cfg(test)]
mod tests {
    use super::*;
    use AttitudeSource::{Automatic, Autopilot, Own};

    /// A panic is early within 60 s of its start; a later one resets the count.
    #[test]
    fn three_early_panics_in_a_row_require_safe_mode() {
        let after = |uptimes_s: &[u64]| {
            let early_panic_count = uptimes_s.iter().fold(0, |count, &uptime_s| count_early_panics(count, uptime_s));
            ResetCause::Panic(PanicReport { message: "", early_panic_count }).requires_safe_mode()
        };
        assert!(!after(&[0, 0]) && after(&[0, 59, 1]) && after(&[0; 300]));
        assert!(!after(&[0, 0, 60]) && !after(&[0, 0, 60, 0, 0]) && after(&[60, 0, 0, 0]));
        assert!(!ResetCause::Watchdog.requires_safe_mode());
    }

    /// The counters wrap between the two snapshots.
    #[test]
    fn the_main_reason_for_lost_readings_is_reported() {
        let before = EventCounts {
            readings: u32::MAX - 50,
            saturated: 900,
            sensor_clipped: 40,
            unpaired_readings: 77,
            attitude_reports: 5000,
            attitude_frames_rejected: 12,
            ..EventCounts::default()
        };
        for (name, source, [readings, saturated, clipped, unpaired, reports, rejected, own], loss) in [
            ("all became samples", Autopilot, [1000, 0, 0, 0, 600, 0, 0], None),
            ("some of each", Autopilot, [1000, 40, 0, 450, 600, 600, 0], None),
            ("saturated before others", Autopilot, [1000, 60, 0, 999, 0, 600, 0], Some(SampleLoss::Saturated(6))),
            ("saturated or clipped", Own, [1000, 30, 30, 0, 600, 0, 0], Some(SampleLoss::Saturated(6))),
            ("degrees as radians", Autopilot, [1000, 0, 0, 999, 600, 601, 0], Some(SampleLoss::ImpossibleAttitude)),
            ("no attitude", Autopilot, [1000, 0, 0, 550, 600, 0, 4000], Some(SampleLoss::NoAttitude(55))),
            ("autopilot and own", Automatic, [1000, 0, 0, 550, 600, 0, 4000], Some(SampleLoss::NoAttitude(55))),
            ("own alone", Automatic, [1000, 0, 0, 550, 0, 0, 4000], Some(SampleLoss::InaccurateOwnAttitude(55))),
            ("reports not in use", Own, [1000, 0, 0, 550, 600, 601, 4000], Some(SampleLoss::InaccurateOwnAttitude(55))),
            ("no attitude at all", Automatic, [1000, 0, 0, 1000, 0, 0, 0], Some(SampleLoss::NoAttitude(100))),
            ("few readings", Autopilot, [90, 90, 0, 0, 0, 0, 0], None),
            ("a second of readings", Autopilot, [120, 120, 0, 0, 0, 0, 0], Some(SampleLoss::Saturated(100))),
            ("no readings", Autopilot, [0; 7], None),
        ] {
            let after = EventCounts {
                readings: before.readings.wrapping_add(readings),
                saturated: before.saturated + saturated,
                sensor_clipped: before.sensor_clipped + clipped,
                unpaired_readings: before.unpaired_readings + unpaired,
                attitude_reports: before.attitude_reports + reports,
                attitude_frames_rejected: before.attitude_frames_rejected + rejected,
                inertial_readings: before.inertial_readings.wrapping_add(own),
                ..before
            };
            assert_eq!(main_sample_loss(&before, &after, source), loss, "{name}");
        }
    }
}
