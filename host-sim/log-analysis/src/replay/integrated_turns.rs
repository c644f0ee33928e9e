//! Turn of the aircraft by its body rates, where they were measured.

use crate::log::{HeadingIntegral, LoggedFlight};
use crate::replay::data_loss::SLOW_ATTITUDE_INTERVAL_S;

/// Longest gap of the rates that is integrated across, seconds.
const MAX_GAP_S: f64 = 0.5;

/// Integral of the measured body rates; empty if they are logged too slowly, or were not measured.
pub(super) fn measured_turns(flight: &LoggedFlight) -> HeadingIntegral {
    let is_slow = flight.attitude.median_step_s().is_some_and(|step_s| step_s > SLOW_ATTITUDE_INTERVAL_S);
    if flight.has_measured_rates && !is_slow {
        HeadingIntegral::new(flight, MAX_GAP_S)
    } else {
        HeadingIntegral::default()
    }
}
