//! Reports of simulated attitude sources.

use super::{AttitudeReport, BodyRates, SenderId};
use crate::frames::RollPitch;
use crate::time::{Timestamp, WrappingMillis};

/// Period of reports at 50 Hz, microseconds.
pub(super) const PERIOD_US: u64 = 20_000;

/// Report of a sender without a clock; zero rates mean no gyro.
pub(super) fn report(attitude: RollPitch, rates_rad_s: [f32; 3]) -> AttitudeReport {
    AttitudeReport {
        sender: SenderId::default(),
        sender_clock_at_sending: WrappingMillis::default(),
        attitude,
        body_rates: BodyRates::from_rad_s(rates_rad_s),
    }
}

/// Time of a report by its number, at 50 Hz.
pub(super) fn report_time(number: impl Into<u64>) -> Timestamp {
    Timestamp::from_us(number.into() * PERIOD_US)
}

/// 9 s of straight flight, a roll to 25 deg in 1 s, a turn of 18 deg/s for 9 s, and back in 1 s; repeated, with a sway
/// of 1.1 deg. Heading and roll at a time, degrees.
pub(super) fn heading_and_roll_in_turns_deg(t_s: f32) -> [f32; 2] {
    let in_leg_s = t_s.rem_euclid(20.0);
    let part = |t_s: f32| (t_s - 9.0).clamp(0.0, 1.0) * (20.0 - t_s).clamp(0.0, 1.0);
    let [rising_s, turn_part, ending_s] =
        [in_leg_s - 9.0, (in_leg_s - 10.0) / 9.0, in_leg_s - 19.0].map(|t| t.clamp(0.0, 1.0));
    let turned_deg = 18.0 * (rising_s * rising_s / 2.0 + 9.0 * turn_part + ending_s - ending_s * ending_s / 2.0);
    let legs = (t_s / 20.0).floor();
    [180.0 * legs + turned_deg, 25.0 * part(in_leg_s) + 1.1 * (1.1 * t_s).sin()]
}
