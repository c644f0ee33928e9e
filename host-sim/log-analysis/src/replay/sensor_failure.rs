//! A sensor that failed: its field ends, or freezes while the aircraft moves.

use std::fmt;

use super::frozen_field::{self, FrozenInterval, frozen_intervals};
use super::row::ReplayRow;
use crate::log::{LoggedCompass, LoggedFlight};

/// Failure of a sensor; displayed as a clause.
#[derive(Clone, Debug, PartialEq)]
pub enum SensorFailure {
    /// No reading is usable: zero, out of range or marked unhealthy.
    NoReadings,
    /// The field, or an axis of it, is constant while the aircraft moves: the longest interval.
    Frozen(FrozenInterval),
    /// The field ends before the log.
    Ends {
        /// Time of the last field row, seconds.
        field_end_s: f64,
        /// Time of the last attitude row, seconds.
        log_end_s: f64,
    },
}

/// Failure of a compass's sensor.
pub(super) fn find_sensor_failure(
    flight: &LoggedFlight,
    compass: &LoggedCompass,
    rows: &[ReplayRow],
) -> Option<SensorFailure> {
    let Some(last_reading) = compass.field.rows().last() else { return Some(SensorFailure::NoReadings) };
    let duration_s = |frozen: &FrozenInterval| frozen.interval_s[1] - frozen.interval_s[0];
    let longest = frozen_intervals(rows).into_iter().max_by(|a, b| duration_s(a).total_cmp(&duration_s(b)));
    if let Some(longest) = longest {
        return Some(SensorFailure::Frozen(longest));
    }
    let [field_end_s, log_end_s] = [last_reading.t_s, flight.attitude.rows().last()?.t_s];
    (log_end_s - field_end_s > frozen_field::MIN_FROZEN_S).then_some(SensorFailure::Ends { field_end_s, log_end_s })
}

impl fmt::Display for SensorFailure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoReadings => {
                f.write_str("all its readings are zero, out of range, or marked unhealthy by the autopilot")
            }
            Self::Frozen(FrozenInterval { stuck_axis, interval_s: [from_s, to_s] }) => {
                let stuck = stuck_axis.map_or_else(|| "field".to_owned(), |axis| format!("{axis} axis"));
                write!(
                    f,
                    "its {stuck} is constant while the aircraft moves, from {from_s:.0} to {to_s:.0} s; these rows are not \
                     used, as in the module (sensor-stuck)",
                )
            }
            Self::Ends { field_end_s, log_end_s } => {
                write!(f, "its field ends at {field_end_s:.0} s, the log at {log_end_s:.0} s")
            }
        }
    }
}
