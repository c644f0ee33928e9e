//! Detects a sensor whose field freezes while the aircraft moves.

use autoswing::frames::{Field, RollPitch, wrap_pi};
use nalgebra::Vector3;

use super::row::ReplayRow;

/// Shortest duration of a frozen field, seconds: noise of 0.5 mG changes a working sensor sooner, and logs have gaps of
/// seconds.
pub(super) const MIN_FROZEN_S: f64 = 10.0;

/// Longest interval between rows in which an equal axis counts as frozen, seconds: over a gap it may be equal by
/// chance.
const MAX_COUNTED_STEP_S: f64 = 2.0;

/// Least change of roll or pitch, radians (3 deg); at rest a quiet field may stay constant.
const MIN_TILT_CHANGE_RAD: f32 = 0.05;

/// Largest change of a stuck axis, fraction of the field strength (2 mG in 500): logs have integers of a milligauss, of
/// which a correction mixes three.
const MAX_STUCK_AXIS_CHANGE: f32 = 0.004;

/// Minimum change of the other axes by rotation, as a fraction of the field strength, in which a working axis must take
/// part.
const MIN_OTHER_AXES_CHANGE: f32 = 0.25;

/// An interval with a frozen field or axis while the aircraft moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrozenInterval {
    /// Times of the first and last row, seconds.
    pub interval_s: [f64; 2],
    /// The stuck axis; none if all are.
    pub stuck_axis: Option<char>,
}

/// Intervals with a frozen field or axis while the aircraft moves.
pub(super) fn frozen_intervals(rows: &[ReplayRow]) -> Vec<FrozenInterval> {
    let frozen_fields =
        rows.chunk_by(|previous, next| previous.raw_field.ut == next.raw_field.ut).filter_map(frozen_interval);
    let mut intervals: Vec<FrozenInterval> =
        frozen_fields.map(|interval_s| FrozenInterval { interval_s, stuck_axis: None }).collect();
    for (axis, name) in ['x', 'y', 'z'].into_iter().enumerate() {
        intervals.extend(
            stuck_intervals(rows, axis).map(|interval_s| FrozenInterval { interval_s, stuck_axis: Some(name) }),
        );
    }
    intervals
}

fn range_of_values(rows: &[ReplayRow], value_of: impl Fn(&ReplayRow) -> f32) -> f32 {
    let values = || rows.iter().map(&value_of);
    values().fold(f32::MIN, f32::max) - values().fold(f32::MAX, f32::min)
}

/// Change of the other axes by rotation about any but this axis, microtesla. A roll leaves x constant while y and z
/// change, and a turn on the spot leaves z and the strength of x and y; so does hard iron that changes along y or z in
/// hover, of which the largest step is excluded.
fn other_axes_change(rows: &[ReplayRow], axis: usize) -> f32 {
    let measured: Vec<_> = rows.iter().map(|row| row.raw_field.ut).collect();
    if axis == 2 {
        let horizontal: Vec<_> = measured.iter().map(|ut| Vector3::new(ut.xy().norm(), 0.0, 0.0)).collect();
        return change_without_step(&horizontal, 0);
    }
    let turned_back: Vec<_> = rows.iter().map(|row| without_rotation_about(row, axis)).collect();
    [(axis + 1) % 3, (axis + 2) % 3]
        .map(|other| change_without_step(&measured, other).min(change_without_step(&turned_back, other)))
        .into_iter()
        .fold(0.0, f32::max)
}

fn change_without_step(fields: &[Vector3<f32>], axis: usize) -> f32 {
    let values = || fields.iter().map(|field| field[axis]);
    let largest_step = fields.windows(2).map(|pair| (pair[1][axis] - pair[0][axis]).abs()).fold(0.0, f32::max);
    values().fold(f32::MIN, f32::max) - values().fold(f32::MAX, f32::min) - largest_step
}

/// Field of a row turned back by the roll for the x axis, and by the pitch for the y axis.
fn without_rotation_about(row: &ReplayRow, axis: usize) -> Vector3<f32> {
    let RollPitch { roll_rad, pitch_rad } = row.attitude;
    let [roll_rad, pitch_rad] = if axis == 0 { [roll_rad, 0.0] } else { [0.0, pitch_rad] };
    RollPitch { roll_rad, pitch_rad }.to_level_frame(Field::new(row.raw_field.ut)).ut
}

fn frozen_interval(equal_rows: &[ReplayRow]) -> Option<[f64; 2]> {
    let [from_s, to_s] = [equal_rows.first()?.t_s, equal_rows.last()?.t_s];
    let first_roll_rad = equal_rows.first()?.attitude.roll_rad;
    let moves = range_of_values(equal_rows, |row| wrap_pi(row.attitude.roll_rad - first_roll_rad))
        .max(range_of_values(equal_rows, |row| row.attitude.pitch_rad))
        > MIN_TILT_CHANGE_RAD;
    let logged_s: f64 = equal_rows.windows(2).map(|pair| (pair[1].t_s - pair[0].t_s).min(MAX_COUNTED_STEP_S)).sum();
    (logged_s > MIN_FROZEN_S && moves).then_some([from_s, to_s])
}

/// Intervals in which an axis is constant although the others show that the field turned.
fn stuck_intervals(rows: &[ReplayRow], axis: usize) -> impl Iterator<Item = [f64; 2]> + use<'_> {
    let mut remaining = rows;
    std::iter::from_fn(move || {
        let first = remaining.first()?.raw_field.ut;
        let (mut minimum, mut maximum, limit_ut) = (first[axis], first[axis], MAX_STUCK_AXIS_CHANGE * first.norm());
        let is_same = |row: &&ReplayRow| {
            (minimum, maximum) = (minimum.min(row.raw_field.ut[axis]), maximum.max(row.raw_field.ut[axis]));
            maximum - minimum <= limit_ut
        };
        let (equal_rows, later) = remaining.split_at(remaining.iter().take_while(is_same).count().max(1));
        remaining = later;
        Some(equal_rows)
    })
    .filter_map(move |equal_rows| {
        let strength_ut = equal_rows.first()?.raw_field.ut.norm();
        frozen_interval(equal_rows)
            .filter(|_| other_axes_change(equal_rows, axis) > MIN_OTHER_AXES_CHANGE * strength_ut)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows at 10 Hz with a constant field and ramps of roll and pitch, degrees.
    fn frozen_rows(seconds: u16, roll_deg: f32, pitch_deg: f32) -> Vec<ReplayRow> {
        let last = seconds * 10;
        let row = |i: u16| {
            let fraction = f32::from(i) / f32::from(last);
            let attitude = RollPitch::from_deg(roll_deg * fraction, pitch_deg * fraction);
            ReplayRow::of_field(f64::from(i) / 10.0, Field::from_ut(20.0, 0.0, 40.0), attitude)
        };
        (0..=last).map(row).collect()
    }

    /// Rows with a field by time, seconds, and attitude, microtesla.
    fn rows_of_field(
        seconds: u16,
        [roll_deg, pitch_deg]: [f32; 2],
        field_ut: impl Fn(f32, RollPitch) -> [f32; 3],
    ) -> Vec<ReplayRow> {
        let mut rows = frozen_rows(seconds, roll_deg, pitch_deg);
        for row in &mut rows {
            row.raw_field = Field::new(field_ut(row.t_s as f32, row.attitude).into());
        }
        rows
    }

    #[test]
    fn a_constant_field_during_10_s_of_motion_is_frozen() {
        let mut steady_bank = frozen_rows(60, 0.0, 0.0);
        for row in &mut steady_bank {
            row.attitude = RollPitch::from_deg(25.0, -15.0);
        }
        let mut upside_down = frozen_rows(15, 0.0, 0.0);
        for (i, row) in upside_down.iter_mut().enumerate() {
            row.attitude = RollPitch::from_deg(if i % 2 == 0 { 179.95 } else { -179.95 }, 0.1);
        }
        let mut with_gap = frozen_rows(8, 20.0, 0.0);
        for row in &mut with_gap[40..] {
            row.t_s += 256.0;
        }
        for (name, rows, is_frozen) in [
            ("roll", frozen_rows(12, 6.0, 0.0), true),
            ("pitch", frozen_rows(12, 0.0, 6.0), true),
            ("8 s", frozen_rows(8, 20.0, 20.0), false),
            ("gusts", frozen_rows(60, 1.0, 1.0), false),
            ("steady bank", steady_bank, false),
            ("upside down at rest", upside_down, false),
            ("a gap", with_gap, false),
        ] {
            let expected = FrozenInterval { interval_s: [0.0, 12.0], stuck_axis: None };
            assert_eq!(frozen_intervals(&rows), vec![expected; usize::from(is_frozen)], "{name}");
        }
    }

    /// Either of the other axes shows that the field turned, although roll and pitch hardly turn it: at 4 deg by 3 uT.
    #[test]
    fn an_axis_is_stuck_if_only_one_of_the_others_changes() {
        for (axis, name) in ['x', 'y', 'z'].into_iter().enumerate() {
            for changing in [(axis + 1) % 3, (axis + 2) % 3] {
                let rows = rows_of_field(30, [4.0, 0.0], |t_s, _| {
                    let mut field_ut = [20.0, 15.0, 30.0];
                    field_ut[changing] += 20.0 * libm::sinf(t_s);
                    field_ut
                });
                let found: Vec<_> = frozen_intervals(&rows).iter().map(|found| found.stuck_axis).collect();
                assert!(found.contains(&Some(name)), "{name}, {changing}: {found:?}");
            }
        }
    }

    /// The y axis has noise of a milligauss, or of five, while the others turn with the aircraft. A constant axis of a
    /// field that hard iron changes in a hover, for good or for 10 s, or about which the aircraft rotates, works: rolls
    /// leave x constant, pitches y, and change the others by 0.4 of the field.
    #[test]
    fn an_axis_is_stuck_if_it_is_constant_while_the_field_turns() {
        let noisy = |noise_ut: f32| {
            rows_of_field(30, [20.0, 0.0], |t_s, _| {
                let (sin, cos) = libm::sincosf(t_s / 3.0);
                [20.0 * cos, 7.0 + if (10.0 * t_s).round() % 2.0 == 0.0 { noise_ut } else { 0.0 }, 40.0 + sin]
            })
        };
        let stepped = |step_s: std::ops::Range<f32>| {
            rows_of_field(30, [4.0, 0.0], |t_s, _| {
                [20.0, 5.0 + t_s / 30.0 + if step_s.contains(&t_s) { 20.0 } else { 0.0 }, 40.0]
            })
        };
        let rotated = |angles_deg| {
            rows_of_field(30, angles_deg, |_, attitude| {
                attitude.to_body_frame(Field::from_ut(20.0, 15.0, 40.0)).ut.into()
            })
        };
        // A simulator without noise.
        let turned_on_the_spot = rows_of_field(30, [0.0, 4.0], |t_s, _| {
            let (sin, cos) = libm::sincosf(t_s / 5.0);
            [20.0 * cos, -20.0 * sin, 40.0]
        });
        for (name, rows, is_stuck) in [
            ("a turn on the spot", turned_on_the_spot, false),
            ("1 mG", noisy(0.1), true),
            ("5 mG", noisy(0.5), false),
            ("a step", stepped(10.0..30.0), false),
            ("iron for 10 s", stepped(10.0..20.0), false),
            ("roll", rotated([25.0, 0.0]), false),
            ("pitch", rotated([0.0, 25.0]), false),
        ] {
            let expected = FrozenInterval { interval_s: [0.0, 30.0], stuck_axis: Some('y') };
            assert_eq!(frozen_intervals(&rows), vec![expected; usize::from(is_stuck)], "{name}");
        }
    }
}
