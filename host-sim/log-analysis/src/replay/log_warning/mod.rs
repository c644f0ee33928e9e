//! Warnings about a log.

use std::fmt;

use serde::{Serialize, Serializer};

use super::data_loss;
use super::evaluation::{CompassEvaluation, FlightEvaluation};
use super::gps_course::{GpsCourseHeading, GpsCourseRejection};
use super::rows::{RowCounts, strength_ut};
use super::sensor_failure::{SensorFailure, sensor_failure};
use crate::log::{
    AttitudeView, AutopilotKind, HeadingLatency, LogFormat, LoggedFlight, RatesProblem, missing_ardupilot_parameters,
    mounting_parameter_changes,
};
use crate::replay::reference::ReferenceHeading;
use crate::replay::row_headings::is_monitored;

/// Lag of the attitude behind the field that is reported, seconds: 3 deg of heading at 30 deg/s.
const LATE_ATTITUDE_S: f64 = 0.1;

/// Consequence of lost body rates.
const WITHOUT_RATES_TEXT: &str = "headings are without smoothing and monitor, and their sigma does not adapt; it is too \
    small where the flight is rougher than the fitted samples";

/// Warning about a log; displayed as a sentence.
#[derive(Clone, Debug, PartialEq)]
pub enum LogWarning {
    /// Body rates are not used as logged: the analysis repairs them or replaces them by differences of the attitude.
    BodyRatesNotAsLogged {
        /// Reason why the rates are not used as logged.
        problem: RatesProblem,
        /// Whether the rates are repaired rather than replaced.
        is_repaired: bool,
    },
    /// The attitude is that of this message, because the autopilot's own is not logged.
    FallbackAttitude(&'static str),
    /// Field rows have no time.
    FieldWithoutTime,
    /// Largest tilt of a table's attitude, degrees; too small for a flight.
    SmallTilt(f64),
    /// Rate of the field readings, Hz, too low for the monitor.
    LowFieldRate(f64),
    /// Rate of the attitude, Hz, too low for its interpolation.
    LowAttitudeRate(f64),
    /// Share of body rates lost, percent.
    RatesLost(f64),
    /// The sensor of a compass failed; the number of the compass.
    SensorFailed(u8, SensorFailure),
    /// Readings are much stronger than the others, and not used.
    Spikes {
        /// Number of the compass.
        compass: u8,
        /// Number of such readings.
        spike_count: usize,
        /// Strongest of them, microtesla.
        largest_ut: f64,
    },
    /// Share of the flight in which the autopilot's own filter rejected the magnetometer, percent.
    MagnetometerRejected(f64),
    /// The autopilot's own texts about its compasses, with their times, seconds.
    AutopilotTexts(Vec<(f64, String)>),
    /// Mounting parameters changed, with their times from the start, seconds.
    MountingChanged(Vec<(String, f64)>),
    /// Lag of the logged attitude behind the field, milliseconds.
    LateAttitude(f64),
    /// Component that is evaluated, and other autopilots of the same system.
    OtherAutopilots(u8, Vec<u8>),
    /// Share of readings with an attitude that contradicts the body rates, percent.
    RatesContradicted(usize),
    /// Share of readings with an attitude that differs from the simulator's, percent.
    DiffersFromSimulator(usize),
    /// System that is evaluated, and other vehicles on the link.
    OtherVehicles(u8, Vec<u8>),
    /// Restarts of the autopilot in the log.
    Restarts(u32),
    /// Number and kind of skipped items.
    Skipped(u64, &'static str),
    /// The autopilot compensates interference by throttle.
    ThrottleCompensation,
    /// The GPS course is not used as the reference; the reason.
    NoGpsCourse(GpsCourseRejection),
    /// The log has no motor current.
    NoCurrent,
    /// Latency of a reference heading that was removed.
    LateHeading(HeadingLatency),
    /// The current is negative throughout.
    NegatedCurrent,
    /// The autopilot's own attitude is the VTOL view; what replaces it.
    VtolView(&'static str),
    /// Correction parameters that are not logged.
    MissingParameters(Vec<String>),
    /// No correction parameters are logged.
    NoParameters,
}

impl LogWarning {
    /// All warnings about a log and its evaluation.
    #[must_use]
    pub fn warnings_of_flight(flight: &LoggedFlight, evaluation: &FlightEvaluation) -> Vec<Self> {
        let mut warnings = Vec::new();
        let mut add_if = |applies: bool, warning: Self| warnings.extend(applies.then_some(warning));
        let LoggedFlight { skipped_counts: counts, parameters, .. } = flight;
        let compasses = &evaluation.compasses;
        if let Some(problem) = flight.rates_problem {
            add_if(true, Self::BodyRatesNotAsLogged { problem, is_repaired: flight.has_measured_rates });
        }
        if let Some(source) = flight.fallback_attitude_message {
            add_if(true, Self::FallbackAttitude(source));
        }
        add_if(flight.rows_without_time > 0, Self::FieldWithoutTime);
        let tilt_deg = largest_tilt_deg(flight).unwrap_or(f64::INFINITY);
        add_if(flight.log_format == LogFormat::Csv && tilt_deg < 2.0, Self::SmallTilt(tilt_deg));
        let slowest_s = compasses.iter().map(|compass| compass.reading_interval_s).fold(0.0, f64::max);
        add_if(!is_monitored(slowest_s), Self::LowFieldRate(1.0 / slowest_s));
        let attitude_s = evaluation.attitude_interval_s;
        add_if(attitude_s > data_loss::SLOW_ATTITUDE_INTERVAL_S, Self::LowAttitudeRate(1.0 / attitude_s));
        warnings.extend(data_loss::excessive_rate_loss(flight).map(|fraction| Self::RatesLost(fraction * 100.0)));
        for compass in compasses {
            let failure = sensor_failure(flight, compass);
            warnings.extend(failure.map(|failure| Self::SensorFailed(compass.compass_number, failure)));
            warnings.extend(spikes(flight, compass));
        }
        let oldest_s = compasses.iter().filter(|compass| compass.latency.sigma_s.is_some());
        let oldest_s = oldest_s.map(|compass| compass.latency.used_s).fold(f64::INFINITY, f64::min);
        warnings.extend((oldest_s < -LATE_ATTITUDE_S).then_some(Self::LateAttitude(-oldest_s * 1e3)));
        warnings.extend(mounting_changes(flight, evaluation));
        warnings.extend(magnetometer_rejection(flight));
        let texts = &flight.compass_texts;
        warnings.extend((!texts.is_empty()).then(|| Self::AutopilotTexts(texts.clone())));
        warnings.extend(
            first_and_others(&flight.autopilot_component_ids)
                .map(|(own_id, other_ids)| Self::OtherAutopilots(own_id, other_ids)),
        );
        let off_simulator = |compass: &CompassEvaluation| {
            let RowCounts { off_simulator, readings, .. } = compass.row_counts;
            off_simulator * 100 / readings.max(1)
        };
        let off_simulator_percent = compasses.iter().map(off_simulator).max().filter(|percent| *percent > 0);
        warnings.extend(off_simulator_percent.map(Self::DiffersFromSimulator));
        let contradicted =
            |compass: &&CompassEvaluation| compass.row_counts.contradicting_attitude * 5 > compass.row_counts.readings;
        warnings.extend(compasses.iter().find(contradicted).map(|compass| {
            Self::RatesContradicted(
                compass.row_counts.contradicting_attitude * 100 / compass.row_counts.readings.max(1),
            )
        }));
        warnings.extend(
            first_and_others(&flight.autopilot_system_ids)
                .map(|(own_id, other_ids)| Self::OtherVehicles(own_id, other_ids)),
        );
        let mut add_if = |applies: bool, warning: Self| warnings.extend(applies.then_some(warning));
        add_if(counts.restarts > 0, Self::Restarts(counts.restarts));
        for (skipped_count, skipped_items) in [
            (counts.garbage, "bytes or lines that were not recognised"),
            (counts.bad_times, "messages with an invalid time"),
            (counts.rejected_readings, "readings out of range, or marked unhealthy by the autopilot"),
            (counts.current_dropouts, "currents of 0 or -1 A between usual ones"),
            (counts.unassigned_fields, "readings of sensors without device id (SCALED_IMU)"),
        ] {
            add_if(skipped_count > 0, Self::Skipped(skipped_count, skipped_items));
        }
        let is_ardupilot = flight.autopilot == AutopilotKind::ArduPilot;
        let compensation = parameters.last_value("COMPASS_MOTCT").map(f64::round);
        add_if(is_ardupilot && compensation == Some(1.0), Self::ThrottleCompensation);
        if !evaluation.reference.as_ref().is_some_and(ReferenceHeading::measures_error)
            && let Err(rejection) = GpsCourseHeading::from_flight(flight)
        {
            add_if(rejection != GpsCourseRejection::NotLogged, Self::NoGpsCourse(rejection));
        }
        add_if(flight.battery_current.is_empty(), Self::NoCurrent);
        add_if(flight.is_current_negated, Self::NegatedCurrent);
        warnings.extend(flight.heading_latencies.iter().copied().map(Self::LateHeading));
        let mut add_if = |applies: bool, warning: Self| warnings.extend(applies.then_some(warning));
        match flight.attitude_view {
            AttitudeView::BodyForVtol(message) => add_if(true, Self::VtolView(message)),
            AttitudeView::BodyByModes => add_if(true, Self::VtolView("the body by flight modes and trims")),
            AttitudeView::Body | AttitudeView::Vtol(_) => {}
        }
        let missing: Vec<String> =
            compasses.iter().flat_map(|compass| missing_ardupilot_parameters(flight, compass.compass_number)).collect();
        let has_none = is_ardupilot && parameters.last_value("COMPASS_OFS_X").is_none() && missing.is_empty();
        add_if(!missing.is_empty(), Self::MissingParameters(missing));
        add_if(has_none, Self::NoParameters);
        warnings
    }
}

/// Rejection of the magnetometer while armed, if it is more than occasional.
fn magnetometer_rejection(flight: &LoggedFlight) -> Option<LogWarning> {
    const MIN_REJECTED_PERCENT: f64 = 1.0;
    let in_flight = flight.magnetometer_test_ratio.rows().iter().filter(|row| flight.is_armed(row.t_s) != Some(false));
    let is_rejected: Vec<bool> = in_flight.map(|row| row.row_values[0] > 1.0).collect();
    let rejected_count = is_rejected.iter().filter(|is_rejected| **is_rejected).count();
    let percent = 100.0 * rejected_count as f64 / is_rejected.len().max(1) as f64;
    (percent >= MIN_REJECTED_PERCENT).then_some(LogWarning::MagnetometerRejected(percent))
}

fn spikes(flight: &LoggedFlight, compass: &CompassEvaluation) -> Option<LogWarning> {
    let CompassEvaluation { compass_number, row_counts: RowCounts { spikes: spike_count, .. }, .. } = *compass;
    let logged = flight.compass(compass_number)?;
    let largest_ut = logged.field.rows().iter().map(strength_ut).fold(0.0, f64::max);
    (spike_count > 0).then_some(LogWarning::Spikes { compass: compass_number, spike_count, largest_ut })
}

/// Splits a list of numbers into the first and the others; `None` without others.
fn first_and_others(numbers: &[u8]) -> Option<(u8, Vec<u8>)> {
    let (own, others) = numbers.split_first()?;
    (!others.is_empty()).then(|| (*own, others.to_vec()))
}

fn mounting_changes(flight: &LoggedFlight, evaluation: &FlightEvaluation) -> Option<LogWarning> {
    let changes =
        evaluation.compasses.iter().flat_map(|compass| mounting_parameter_changes(flight, compass.compass_number));
    let mut changes: Vec<(String, f64)> = changes.collect();
    // The board's rotation affects every compass.
    changes.sort_by(|(a, _), (b, _)| a.cmp(b));
    changes.dedup();
    (!changes.is_empty()).then_some(LogWarning::MountingChanged(changes))
}

fn largest_tilt_deg(flight: &LoggedFlight) -> Option<f64> {
    let tilts =
        flight.attitude.rows().iter().map(|row| f64::from(row.row_values[0].abs().max(row.row_values[1].abs())));
    tilts.reduce(f64::max).map(f64::to_degrees)
}

fn listed(numbers: &[u8]) -> String {
    numbers.iter().map(u8::to_string).collect::<Vec<_>>().join(", ")
}

impl fmt::Display for LogWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BodyRatesNotAsLogged { problem, is_repaired: true } => write!(f, "{problem}; corrected by the attitude"),
            Self::BodyRatesNotAsLogged { problem, is_repaired: false } => {
                write!(f, "{problem}: headings are without smoothing and monitor")
            }
            Self::FallbackAttitude(source) => {
                write!(f, "the autopilot's own attitude is not logged; that of {source} is used")
            }
            Self::FieldWithoutTime => f.write_str(
                "field rows carry no time (logs until 2014); each has that of the message before it, up to a tenth of a \
                 second early",
            ),
            Self::SmallTilt(most_deg) => {
                write!(f, "the attitude tilts by {most_deg:.2} deg at most: radians in columns of degrees?")
            }
            Self::LowFieldRate(hz) => write!(
                f,
                "the field is logged {hz:.1} times a second, too slowly for the monitor (ten times): headings are without \
                 its adjustments",
            ),
            Self::LowAttitudeRate(hz) => write!(
                f,
                "the attitude is logged {hz:.1} times a second; below 3 Hz its interpolation is unreliable",
            ),
            Self::RatesLost(percent) => write!(f, "{percent:.0} % of the body rates are lost: {WITHOUT_RATES_TEXT}"),
            Self::SensorFailed(compass, failure) => write!(f, "compass {compass}: {failure}"),
            Self::Spikes { compass, spike_count, largest_ut } => write!(
                f,
                "compass {compass}: {spike_count} reading(s) of up to {largest_ut:.0} uT are spikes, and not used",
            ),
            Self::MagnetometerRejected(percent) => {
                write!(f, "the autopilot's own filter rejected the magnetometer in {percent:.0} % of the flight")
            }
            Self::AutopilotTexts(texts) => {
                let texts: Vec<String> = texts.iter().map(|(t_s, text)| format!("\"{text}\" at {t_s:.0} s")).collect();
                write!(f, "the autopilot reported {}", texts.join(", "))
            }
            Self::MountingChanged(changes) => {
                let changes: Vec<String> =
                    changes.iter().map(|(name, at_s)| format!("{name} at {at_s:.0} s")).collect();
                write!(
                    f,
                    "mountings were changed in the log: {}; no calibration fits the rows both before and after a change",
                    changes.join(", ")
                )
            }
            Self::LateAttitude(ms) => write!(
                f,
                "the attitude is logged {ms:.0} ms later than the field; the comparison allows for it, but a module that \
                 receives it so late does not",
            ),
            Self::OtherAutopilots(own, others) => write!(
                f,
                "several autopilots of the same system on the link: component {own}, received first, is evaluated, not {}",
                listed(others)
            ),
            Self::RatesContradicted(percent) => write!(
                f,
                "the attitude contradicts the body rates in {percent} % of the log, which is not used: are the rates in \
                 another unit, or of other axes?",
            ),
            Self::DiffersFromSimulator(percent) => write!(
                f,
                "the logged attitude differs from the simulator's by over 5 deg in {percent} % of the log, which is not used",
            ),
            Self::OtherVehicles(own, others) => write!(
                f,
                "several vehicles on the link: system {own} is evaluated; --system selects another ({})",
                listed(others)
            ),
            Self::Restarts(number) => write!(f, "the autopilot restarted {number} time(s) in the log; time goes on after each"),
            Self::Skipped(number, items) => write!(f, "skipped: {number} {items}"),
            Self::ThrottleCompensation => f.write_str(
                "the autopilot compensates by throttle; interference is estimated only from a logged current",
            ),
            Self::NoGpsCourse(rejection) => write!(f, "GPS course gives no heading here: {}", rejection.description()),
            Self::NoCurrent => f.write_str(
                "no current is logged: motor-current interference is neither estimated nor part of the expected error",
            ),
            Self::LateHeading(latency) => latency.fmt(f),
            Self::NegatedCurrent => f.write_str("the current is negative throughout; its size is used"),
            Self::VtolView(message) => write!(
                f,
                "the attitude is that of {message}: the autopilot's is the view of the VTOL modes, not that of the body in hover",
            ),
            Self::MissingParameters(names) => {
                write!(f, "parameters that are not in the log, assumed unset: {}", names.join(", "))
            }
            Self::NoParameters => {
                f.write_str("the parameters are not in the log: the autopilot's correction could not be undone")
            }
        }
    }
}

impl Serialize for LogWarning {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests;
