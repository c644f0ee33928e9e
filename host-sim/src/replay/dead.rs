//! A compass that died in flight: its field ends, or stands still while the aircraft moves.

use super::Row;
use super::judge::Judged;
use crate::log::Flight;

/// So long, seconds: half a milligauss of noise alone moves a field sooner, and logs have gaps of some seconds.
const LONG_S: f64 = 10.0;

/// The aircraft moves if it rolls or pitches by so much meanwhile, radians: 3 deg. On the ground a quiet field may stand
/// still.
const MOVES_RAD: f32 = 0.05;

/// What is to be said of a compass, in words; none if it lives to the end.
pub fn note(flight: &Flight, compass: &Judged) -> Option<String> {
    let number = compass.number;
    let still = standing_still(&compass.rows);
    let longest = still.iter().max_by(|one, other| (one[1] - one[0]).total_cmp(&(other[1] - other[0])));
    if let Some([from_s, to_s]) = longest {
        return Some(format!(
            "compass {number}: its field stands still while the aircraft moves, from {from_s:.0} to {to_s:.0} s: left out, as \
             the module does (sensor-stuck)"
        ));
    }
    let (last, end) = (compass.rows.last()?, flight.attitude.rows().last()?);
    (end.t_s - last.t_s > LONG_S)
        .then(|| format!("compass {number}: its field ends at {:.0} s, the log at {:.0} s", last.t_s, end.t_s))
}

/// From when until when the field does not change for long though the aircraft moves, seconds.
pub(super) fn standing_still(rows: &[Row]) -> Vec<[f64; 2]> {
    rows.chunk_by(|one, other| one.field.ut == other.field.ut).filter_map(dead).collect()
}

/// From when until when these rows of one field are, seconds, if they are of a dead sensor.
fn dead(run: &[Row]) -> Option<[f64; 2]> {
    let moves = |of: fn(&Row) -> f32| {
        let angles = || run.iter().map(of);
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

    /// Rows ten times a second for so long with one field, in which it rolls and pitches by so much, degrees.
    fn still(seconds: u16, roll_deg: f32, pitch_deg: f32) -> Vec<Row> {
        let last = seconds * 10;
        let row = |i: u16| {
            let (part, field) = (f32::from(i) / f32::from(last), Field::from_ut(20.0, 0.0, 40.0));
            Row {
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

    /// Ten seconds and three degrees of roll or of pitch: less is a log that repeats a row, or an aircraft that stands.
    #[test]
    fn a_field_that_stands_still_is_dead_if_it_moves_for_long() {
        for (seconds, roll_deg, pitch_deg, is_dead) in
            [(11, 4.0, 0.0, true), (11, 0.0, 4.0, true), (9, 20.0, 20.0, false), (60, 2.0, 2.0, false)]
        {
            let expected = if is_dead { vec![[0.0, f64::from(seconds)]] } else { Vec::new() };
            let found = standing_still(&still(seconds, roll_deg, pitch_deg));
            assert_eq!(found, expected, "{seconds} s, {roll_deg} and {pitch_deg} deg");
        }
    }
}
