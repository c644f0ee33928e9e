//! Whether, when and how accurately the module would have calibrated itself.

use std::fmt;

use autoswing_module::messages::Refusal;
use serde::{Serialize, Serializer};

use crate::numbers::format_number;
use crate::replay::data_loss::SLOW_ATTITUDE_INTERVAL_S;
use crate::replay::evaluation::{CompassEvaluation, FlightEvaluation};
use crate::replay::rows::RowCounts;

/// Minimum number of rows of a flight (2 s at 10 Hz).
const MIN_FLIGHT_ROWS: usize = 20;

/// Whether, when and how accurately the module would have calibrated; displayed as a line.
#[derive(Clone, Debug, PartialEq)]
pub enum FlightOutcome {
    /// The module would have calibrated itself.
    Calibrated {
        /// Numbers of the calibrated compasses.
        compass_numbers: Vec<u8>,
        /// Number of all compasses.
        compass_count: usize,
        /// First and last calibration without a command, seconds on the log's clock; none if one required a command.
        first_and_last_time_s: Option<[f64; 2]>,
        /// Largest expected error, degrees RMS.
        expected_error_deg: f64,
        /// Interval of an attitude that is too slow, seconds.
        slow_attitude_interval_s: Option<f64>,
    },
    /// The module would have refused every calibration.
    Refused {
        /// Number of all compasses.
        compass_count: usize,
        /// If the causes differ: number of the compass that came nearest to a calibration; `cause` is its cause.
        compass_nearest_acceptance: Option<u8>,
        /// Cause of the refusal.
        cause: FlightRefusal,
        /// Interval of an attitude that is too slow, seconds.
        slow_attitude_interval_s: Option<f64>,
    },
}

/// Cause of a refusal.
#[derive(Clone, Debug, PartialEq)]
pub enum FlightRefusal {
    /// Number of readings, too few for a flight.
    FewReadings(usize),
    /// Too few usable rows.
    FewRows {
        /// Number of readings.
        readings: usize,
        /// Number of usable rows.
        used: usize,
        /// The most frequent rejection: number and cause.
        main_rejection: (usize, &'static str),
    },
    /// Reason that the module gives.
    Module(Refusal),
}

/// Whether and when the module would have calibrated a compass; displayed as a phrase.
#[derive(Clone, Debug, PartialEq)]
pub enum CompassOutcome {
    /// Calibrated without a command at this time of the log, seconds.
    Automatic(f64),
    /// Calibrated only by a command at the end of the log.
    Commanded,
    /// The module would have refused the calibration.
    Refused(Refusal),
}

impl FlightOutcome {
    /// Outcome of an evaluated flight.
    #[must_use]
    pub fn new(evaluation: &FlightEvaluation) -> Self {
        let compasses = &evaluation.compasses;
        let compass_count = compasses.len();
        let accepted: Vec<&CompassEvaluation> =
            compasses.iter().filter(|compass| compass.module_result.acceptance.is_ok()).collect();
        let slow_attitude_interval_s =
            Some(evaluation.attitude_interval_s).filter(|interval_s| *interval_s > SLOW_ATTITUDE_INTERVAL_S);
        if accepted.is_empty() {
            let compass_nearest_acceptance = rejected_nearest_acceptance(compasses);
            let cause = compass_nearest_acceptance.map_or(FlightRefusal::FewReadings(0), FlightRefusal::new);
            // The compasses share a cause if its displayed text is equal for all, even if the numbers differ before
            // rounding.
            let is_shared =
                compasses.iter().all(|compass| FlightRefusal::new(compass).to_string() == cause.to_string());
            let compass_nearest_acceptance =
                compass_nearest_acceptance.filter(|_| !is_shared).map(|compass| compass.compass_number);
            return Self::Refused { compass_count, compass_nearest_acceptance, cause, slow_attitude_interval_s };
        }
        let times_s: Option<Vec<f64>> = accepted.iter().map(|compass| compass.calibration_time_s()).collect();
        Self::Calibrated {
            compass_numbers: accepted.iter().map(|compass| compass.compass_number).collect(),
            compass_count,
            first_and_last_time_s: times_s.map(|times_s| {
                times_s
                    .iter()
                    .fold([f64::INFINITY, f64::NEG_INFINITY], |[first, last], &at_s| [first.min(at_s), last.max(at_s)])
            }),
            expected_error_deg: accepted
                .iter()
                .filter_map(|compass| compass.module_result.expected_rms_deg())
                .fold(0.0, f64::max),
            slow_attitude_interval_s,
        }
    }
}

/// The rejected compass closest to a calibration.
fn rejected_nearest_acceptance(compasses: &[CompassEvaluation]) -> Option<&CompassEvaluation> {
    let expected_error_deg =
        |compass: &CompassEvaluation| compass.module_result.expected_rms_deg().unwrap_or(f64::INFINITY);
    // Compasses that are unused or hardly logged rank last.
    let is_out = |compass: &CompassEvaluation| {
        (compass.row_counts.used < MIN_FLIGHT_ROWS, compass.is_used_for_heading == Some(false))
    };
    compasses.iter().min_by(|a, b| {
        let by_rows = || b.row_counts.used.cmp(&a.row_counts.used);
        is_out(a)
            .cmp(&is_out(b))
            .then_with(|| expected_error_deg(a).total_cmp(&expected_error_deg(b)))
            .then_with(by_rows)
    })
}

impl FlightRefusal {
    /// Too few usable rows, else the module's reason.
    fn new(compass: &CompassEvaluation) -> Self {
        let RowCounts { readings, used, .. } = compass.row_counts;
        match &compass.module_result.acceptance {
            Err(refusal) if used >= MIN_FLIGHT_ROWS => Self::Module(refusal.clone()),
            _ if readings < MIN_FLIGHT_ROWS => Self::FewReadings(readings),
            _ => Self::FewRows { readings, used, main_rejection: compass.row_counts.main_rejection() },
        }
    }
}

impl CompassOutcome {
    pub(super) fn new(compass: &CompassEvaluation) -> Self {
        match (&compass.module_result.acceptance, compass.calibration_time_s()) {
            (Err(refusal), _) => Self::Refused(refusal.clone()),
            (Ok(()), Some(at_s)) => Self::Automatic(at_s),
            (Ok(()), None) => Self::Commanded,
        }
    }
}

impl fmt::Display for FlightOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Calibrated { slow_attitude_interval_s, .. } | Self::Refused { slow_attitude_interval_s, .. }) = self;
        let slow = slow_attitude_interval_s.map_or_else(String::new, |interval_s| {
            let rate_hz = 1.0 / interval_s;
            format!("the attitude is logged {rate_hz:.1} times a second; below 3 Hz its interpolation is unreliable")
        });
        let slow_after = |prefix: &str| if slow.is_empty() { String::new() } else { format!("; {prefix}{slow}") };
        match self {
            Self::Calibrated { compass_numbers, compass_count, first_and_last_time_s, expected_error_deg, .. } => {
                f.write_str("the module would have calibrated")?;
                match (compass_numbers.len(), *compass_count) {
                    (1, 1) => {}
                    (some, compass_count) if some == compass_count => write!(f, " each of {compass_count} compasses")?,
                    (some, compass_count) => {
                        let compass_numbers: Vec<String> = compass_numbers.iter().map(u8::to_string).collect();
                        write!(f, " {some} of {compass_count} compasses (number {})", compass_numbers.join(", "))?;
                    }
                }
                match first_and_last_time_s {
                    Some([first, last]) if last - first < 1.5 => write!(f, " by itself at {first:.0} s of the log"),
                    Some([first, last]) => write!(f, " by itself at {first:.0} to {last:.0} s of the log"),
                    None => f.write_str(" by a command at the end of the flight"),
                }?;
                write!(f, ", expecting {expected_error_deg:.1} deg{}", slow_after("but "))
            }
            Self::Refused { compass_count, compass_nearest_acceptance, cause, .. } => {
                f.write_str("the module would have refused")?;
                if *compass_count > 1 {
                    write!(f, " each of {compass_count} compasses")?;
                }
                if let Some(number) = compass_nearest_acceptance {
                    write!(f, "; number {number} came nearest")?;
                }
                let slow = match cause {
                    FlightRefusal::FewReadings(_) => String::new(),
                    FlightRefusal::FewRows { .. } => slow_after(""),
                    FlightRefusal::Module(_) => slow_after("and "),
                };
                write!(f, ": {cause}{slow}")
            }
        }
    }
}

impl Serialize for FlightOutcome {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl fmt::Display for FlightRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FewReadings(number) => {
                write!(f, "the log has {number} readings of the field, too few for a flight")
            }
            Self::FewRows { readings, used, main_rejection: (number, cause) } => {
                write!(f, "of {readings} readings of the field {used} are usable; {number} are {cause}")
            }
            Self::Module(refusal) => refusal.fmt(f),
        }
    }
}

impl fmt::Display for CompassOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Automatic(at_s) => {
                write!(f, "would have calibrated itself at {} s of the log", format_number(*at_s, 0))
            }
            Self::Commanded => f.write_str("would have calibrated by a command at the end"),
            Self::Refused(refusal) => write!(f, "would have been refused: {}: {refusal}", refusal.stable_code()),
        }
    }
}
