//! Rest on the ground: attitude and height are constant, and the aircraft does not move over ground.

use autoswing::frames::{RollPitch, wrap_pi};

use crate::log::LoggedFlight;
use crate::log::time_series::TimedRow;
use crate::replay::row::down_in_body;

/// Speed of a flight, m/s; above it the aircraft has left.
const MIN_FLIGHT_SPEED_M_S: f32 = 3.0;
/// Shortest movement over ground that counts as a flight, seconds.
const MIN_FLIGHT_S: f64 = 20.0;

/// Speed that counts as movement, m/s; above the noise of a receiver at rest.
const MAX_REST_SPEED_M_S: f32 = 0.7;
/// Height above the start of the log from which on the aircraft is airborne, metres; above the noise of a receiver at rest.
const MIN_AIRBORNE_HEIGHT_M: f32 = 5.0;
/// Change of roll, pitch or yaw that counts as movement, radians (2.5 deg): wind and engine shake an aircraft.
const MAX_REST_CHANGE_RAD: f32 = 0.044;
/// Length of a part of the log that is at rest or not, seconds.
const PART_S: f64 = 5.0;

/// Cosine of the tilt from which on an aircraft at rest lies on its side or back (60 deg).
const MAX_DOWN_ON_SIDE: f64 = 0.5;
/// Time before a log's end on the side or back that belongs to the crash, seconds.
const CRASH_S: f64 = 2.0;

/// Open intervals at rest before the first and after the last flight, and on the side after it, seconds.
pub(super) fn ground_intervals(flight: &LoggedFlight) -> Vec<[f64; 2]> {
    let moving = || flight.gps.rows().iter().filter(|row| row.row_values[3] > MIN_FLIGHT_SPEED_M_S).map(|row| row.t_s);
    let flown_s = moving().next().zip(moving().next_back()).filter(|(from_s, to_s)| to_s - from_s > MIN_FLIGHT_S);
    let armed_s = flight.armed_changes.iter().find(|(_, is_armed)| *is_armed).map(|&(at_s, _)| at_s);
    let part_index = |row: &TimedRow<3>| (row.t_s / PART_S).floor() as i64;
    let parts = flight.attitude.rows().chunk_by(|a, b| part_index(a) == part_index(b));
    let mut intervals = Vec::new();
    for part in parts.filter(|part| has_constant_attitude(part)) {
        let [Some(first), Some(last)] = [part.first(), part.last()] else { continue };
        let [from_s, to_s] = [first.t_s - PART_S / 2.0, last.t_s + PART_S / 2.0];
        if let Some((first_s, last_s)) = flown_s {
            let outside = [[from_s, to_s.min(first_s)], [from_s.max(last_s), to_s]];
            intervals.extend(outside.into_iter().filter(|interval_s| is_still(flight, *interval_s)));
        }
        if armed_s.is_some_and(|armed_s| armed_s < from_s) && part.iter().all(lies_on_its_side) {
            intervals.push([from_s, to_s]);
        }
    }
    if armed_s.is_some() {
        intervals.extend(crash_interval(flight.attitude.rows()));
    }
    intervals
}

/// Open interval from a crash to the end of the log, seconds; none if the log does not end on the side or back.
fn crash_interval(rows: &[TimedRow<3>]) -> Option<[f64; 2]> {
    let lying = rows.iter().rev().take_while(|row| lies_on_its_side(row));
    lying.last().map(|first| [first.t_s - CRASH_S, f64::INFINITY])
}

/// Whether the aircraft neither moves over ground nor is above it.
fn is_still(flight: &LoggedFlight, [from_s, to_s]: [f64; 2]) -> bool {
    let rows = flight.gps.rows();
    let ground_m = rows.first().map_or(0.0, |row| row.row_values[2]);
    let is_still = |row: &TimedRow<6>| {
        let [_, _, height_m, speed_m_s, ..] = row.row_values;
        speed_m_s <= MAX_REST_SPEED_M_S && height_m - ground_m < MIN_AIRBORNE_HEIGHT_M
    };
    let within = |row: &&TimedRow<6>| (from_s..to_s).contains(&row.t_s) && row.t_s > from_s;
    from_s < to_s && rows.iter().filter(within).all(is_still)
}

fn has_constant_attitude(part: &[TimedRow<3>]) -> bool {
    let Some(first) = part.first() else { return false };
    (0..3).all(|angle| {
        let changes = || part.iter().map(|row| wrap_pi(row.row_values[angle] - first.row_values[angle]));
        let is_known = changes().all(f32::is_finite);
        !is_known || changes().fold(0.0, f32::max) - changes().fold(0.0, f32::min) < MAX_REST_CHANGE_RAD
    })
}

fn lies_on_its_side(row: &TimedRow<3>) -> bool {
    let [roll_rad, pitch_rad, _] = row.row_values;
    down_in_body(RollPitch { roll_rad, pitch_rad }).z < MAX_DOWN_ON_SIDE
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_flight::flight_of_motion;

    /// A minute in which the aircraft does something, then half a minute of fast flight.
    fn seconds_on_the_ground(speed_m_s: f32, height_m: f32, tilt_rad: f32) -> f64 {
        let mut flight = flight_of_motion(10.0, 900, |t_s| {
            let tilt_rad = if t_s < 60.0 { tilt_rad * libm::sinf(t_s as f32) } else { 0.3 };
            ([tilt_rad, 0.0, 0.0], [0.0; 3])
        });
        for i in 0..90 {
            let is_fast = i >= 60;
            let (speed_m_s, height_m) =
                if is_fast { (6.0, 50.0) } else { (speed_m_s, if i < 5 { 0.0 } else { height_m }) };
            flight.gps.push_row(f64::from(i), [48.0, 11.0, height_m, speed_m_s, 0.0, f32::NAN]);
        }
        ground_intervals(&flight).iter().map(|[from_s, to_s]| to_s - from_s).sum()
    }

    /// An aircraft that hovers or drives slowly before a fast part is not on the ground.
    #[test]
    fn an_aircraft_rests_if_neither_attitude_nor_height_nor_place_changes() {
        for (name, speed_m_s, height_m, tilt_rad, is_at_rest) in [
            ("parked", 0.3, 0.0, 0.01, true),
            ("hovering low", 0.5, 2.0, 0.1, false),
            ("hovering still", 0.5, 20.0, 0.01, false),
            ("driving slowly", 1.5, 0.0, 0.01, false),
        ] {
            let ground_s = seconds_on_the_ground(speed_m_s, height_m, tilt_rad);
            assert_eq!(ground_s > 50.0, is_at_rest, "{name}: {ground_s} s");
            assert!(is_at_rest || ground_s < 10.0, "{name}: {ground_s} s");
        }
    }

    #[test]
    fn an_aircraft_on_its_side_after_a_flight_has_crashed() {
        for end_s in [50.0, 41.0] {
            let roll_rad = |t_s| if t_s < 40.0 { 0.1 } else { 3.1 };
            let mut flight = flight_of_motion(10.0, (end_s * 10.0) as u16, |t_s| ([roll_rad(t_s), 0.0, 0.0], [0.0; 3]));
            assert!(ground_intervals(&flight).is_empty(), "a hand swing");
            flight.armed_changes.push((1.0, true));
            let intervals = ground_intervals(&flight);
            assert!(!intervals.is_empty() && intervals.iter().all(|[from_s, _]| *from_s > 37.0), "{intervals:?}");
        }
    }
}
