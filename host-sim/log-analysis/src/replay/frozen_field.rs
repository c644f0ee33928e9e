//! Detects a sensor whose field freezes while the aircraft moves.

use super::row::ReplayRow;

/// Least duration, seconds: noise of 0.5 mG changes a working sensor sooner, and logs have gaps of seconds.
pub(super) const LONG_S: f64 = 10.0;

/// Least change of roll or pitch, radians (3 deg); at rest a quiet field may stay constant.
const MOVES_RAD: f32 = 0.05;

/// Intervals with a frozen field while the aircraft moves, seconds.
pub(super) fn frozen_intervals_s(rows: &[ReplayRow]) -> Vec<[f64; 2]> {
    rows.chunk_by(|previous, next| previous.field.ut == next.field.ut).filter_map(frozen_interval).collect()
}

fn frozen_interval(run: &[ReplayRow]) -> Option<[f64; 2]> {
    let moves = |angle_of: fn(&ReplayRow) -> f32| {
        let angles = || run.iter().map(angle_of);
        angles().fold(f32::MIN, f32::max) - angles().fold(f32::MAX, f32::min) > MOVES_RAD
    };
    let [from_s, to_s] = [run.first()?.t_s, run.last()?.t_s];
    let is_dead = to_s - from_s > LONG_S && (moves(|row| row.attitude.roll_rad) || moves(|row| row.attitude.pitch_rad));
    is_dead.then_some([from_s, to_s])
}

#[cfg(test)]
mod tests {
    use autoswing::frames::{Attitude, Field};

    use super::*;

    /// Rows at 10 Hz with a constant field and ramps of roll and pitch, degrees.
    fn still(seconds: u16, roll_deg: f32, pitch_deg: f32) -> Vec<ReplayRow> {
        let last = seconds * 10;
        let row = |i: u16| {
            let (part, field) = (f32::from(i) / f32::from(last), Field::from_ut(20.0, 0.0, 40.0));
            ReplayRow {
                t_s: f64::from(i) / 10.0,
                field,
                logged: field,
                attitude: Attitude::from_deg(roll_deg * part, pitch_deg * part),
                rates_rad_s: None,
                current_a: None,
                usable: true,
                reference_deg: None,
            }
        };
        (0..=last).map(row).collect()
    }

    #[test]
    fn a_constant_field_during_10_s_of_motion_is_frozen() {
        for (seconds, roll_deg, pitch_deg, is_dead) in
            [(11, 4.0, 0.0, true), (11, 0.0, 4.0, true), (9, 20.0, 20.0, false), (60, 2.0, 2.0, false)]
        {
            let expected = if is_dead { vec![[0.0, f64::from(seconds)]] } else { Vec::new() };
            let found = frozen_intervals_s(&still(seconds, roll_deg, pitch_deg));
            assert_eq!(found, expected, "{seconds} s, {roll_deg} and {pitch_deg} deg");
        }
    }
}
