//! Jumps of the field that the motion of the aircraft does not explain.
//!
//! Without a jump, the corrected field of the second before a row, levelled by the attitude and turned back by the
//! integrated heading rate, equals that of the second after it. The difference observes all three components of a jump
//! even on a single heading, where field strength and vertical component do not show the component across the heading.

use std::ops::Range;

use autoswing::frames::RollPitch;
use nalgebra::{Rotation3, Vector3};

use crate::log::FieldCorrection;
use crate::numbers::{median, quantile};
use crate::replay::row::{ReplayRow, integrals};

/// Duration compared before and after a row, seconds: long enough to average noise, short enough for gyro drift.
const WINDOW_S: f64 = 1.0;

const MIN_WINDOW_ROWS: usize = 5;

/// Longest interval between rows that the heading rate is integrated over, seconds.
const MAX_ROW_INTERVAL_S: f64 = 0.55;

/// Detection thresholds: size, microtesla; ratio to a quantile of all differences of the flight, which turbulence and
/// vibration enlarge; fraction of the field strength per radian turned in both windows, the error of sampled rates.
const MIN_JUMP_UT: f64 = 1.5;
const REFERENCE_QUANTILE: f64 = 0.9;
const MIN_QUANTILE_RATIO: f64 = 3.0;
const MAX_TURN_ERROR_PER_RADIAN: f64 = 0.04;

/// Median norm of a vector of three normally distributed components, in standard deviations of one component.
const MEDIAN_NORM_SIGMAS: f64 = 1.538;

/// Standard deviation of a jump relative to its size: errors of attitude, and of the correction that levels it.
const RELATIVE_ERROR: f64 = 0.05;

/// Smallest fraction of a jump, removed by the autopilot's own correction, that counts as compensation.
const MIN_COMPENSATED_FRACTION: f64 = 0.5;

/// A jump of the raw field.
#[derive(Clone, Copy, Debug)]
pub struct Jump {
    /// Flight time, seconds.
    pub time_s: f64,
    /// Size, body axes, microtesla.
    pub step_ut: Vector3<f64>,
    /// Standard deviation of each component, microtesla.
    pub sigma_ut: f64,
}

/// Jumps of usable rows, in order of time, that the autopilot's own correction does not remove.
pub fn find_jumps(rows: &[ReplayRow], correction: &FieldCorrection) -> Vec<Jump> {
    let Some(to_raw) = correction.matrix.try_inverse() else { return Vec::new() };
    let field = LevelField::new(rows, correction);
    let differences = field.differences();
    let norms_ut = || differences.iter().flatten().map(Vector3::norm);
    let sigma_ut = median(norms_ut()) / MEDIAN_NORM_SIGMAS;
    let Some(reference_ut) = quantile(norms_ut(), REFERENCE_QUANTILE) else { return Vec::new() };
    let least_ut = MIN_JUMP_UT.max(MIN_QUANTILE_RATIO * reference_ut);
    let excess = |row_index: usize| {
        let size_ut = differences[row_index]?.norm();
        (size_ut > least_ut.max(field.turn_error_ut(row_index)?)).then_some((row_index, size_ut))
    };
    let over: Vec<(usize, f64)> = (0..rows.len()).filter_map(excess).collect();
    let is_peak = |(row_index, size_ut): &&(usize, f64)| {
        let is_near = |other: usize| (rows[other].t_s - rows[*row_index].t_s).abs() <= WINDOW_S;
        over.iter().filter(|(other, _)| is_near(*other)).all(|(_, other_ut)| other_ut <= size_ut)
    };
    let jumps = over.iter().filter(is_peak).filter_map(|&(row_index, _)| {
        let step_ut = to_raw * (field.rotations[row_index].inverse() * differences[row_index]?);
        let sigma_ut = libm::hypot(sigma_ut, RELATIVE_ERROR * step_ut.norm());
        (!is_compensated(rows, row_index, &step_ut)).then_some(Jump { time_s: rows[row_index].t_s, step_ut, sigma_ut })
    });
    jumps.collect()
}

/// Corrected fields of rows, and the rotations to a level frame that does not turn with the heading.
struct LevelField<'a> {
    rows: &'a [ReplayRow],
    /// Corrected fields, body axes, microtesla.
    fields: Vec<Vector3<f64>>,
    rotations: Vec<Rotation3<f64>>,
    /// Angle of rotation about any axis since the first row, summed without sign, radians.
    rotation_sum_rad: Vec<f64>,
}

impl<'a> LevelField<'a> {
    fn new(rows: &'a [ReplayRow], correction: &FieldCorrection) -> Self {
        let headings_rad = integrals(rows, |row| row.heading_rate_rad_s().unwrap_or(0.0));
        let rotation = |(row, heading_rad): (&ReplayRow, f64)| {
            let RollPitch { roll_rad, pitch_rad } = row.attitude;
            Rotation3::from_euler_angles(roll_rad.into(), pitch_rad.into(), heading_rad)
        };
        Self {
            rows,
            fields: rows.iter().map(|row| row.corrected_field(correction)).collect(),
            rotations: rows.iter().zip(headings_rad).map(rotation).collect(),
            rotation_sum_rad: integrals(rows, |row| {
                row.rates_rad_s.map_or(0.0, |rates| Vector3::from(rates).map(f64::from).norm())
            }),
        }
    }

    /// Median field of the window after each row less that of the window before, level frame; none if incomplete.
    fn differences(&self) -> Vec<Option<Vector3<f64>>> {
        let levelled: Vec<Vector3<f64>> =
            self.rotations.iter().zip(&self.fields).map(|(rotation, field)| rotation * field).collect();
        let difference = |row_index: usize| {
            let [before, after] = windows(self.rows, row_index)?.map(|window| median_vector(&levelled[window]));
            Some(after - before)
        };
        (0..self.rows.len()).map(difference).collect()
    }

    /// Error of a difference by that of the rates, microtesla.
    fn turn_error_ut(&self, row_index: usize) -> Option<f64> {
        let [before, after] = windows(self.rows, row_index)?;
        let turned_rad = self.rotation_sum_rad[after.end] - self.rotation_sum_rad[before.start];
        Some(MAX_TURN_ERROR_PER_RADIAN * turned_rad * self.fields[row_index].norm())
    }
}

/// Whether the autopilot's own correction removes most of a jump of the raw field, such as interference by a current that
/// the log need not contain.
fn is_compensated(rows: &[ReplayRow], row_index: usize, step_ut: &Vector3<f64>) -> bool {
    let Some(windows) = windows(rows, row_index) else { return false };
    let [before, after] = windows.map(|window| {
        let corrections = rows[window].iter().map(|row| (row.logged_field.ut - row.raw_field.ut).map(f64::from));
        median_vector(&corrections.collect::<Vec<_>>())
    });
    (before - after).dot(step_ut) > MIN_COMPENSATED_FRACTION * step_ut.norm_squared()
}

fn median_vector(vectors: &[Vector3<f64>]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| median(vectors.iter().map(|vector| vector[axis])))
}

/// Windows before and after a row; none if one has a gap, a row without rates, or too few rows.
fn windows(rows: &[ReplayRow], row_index: usize) -> Option<[Range<usize>; 2]> {
    let before = window_length(rows[..=row_index].iter().rev())?;
    let after = window_length(rows[row_index..].iter())?;
    Some([row_index - before..row_index, row_index..row_index + after])
}

/// Number of rows in the window of the first row.
fn window_length<'a>(mut rows: impl Iterator<Item = &'a ReplayRow>) -> Option<usize> {
    let first = rows.next()?;
    let mut last_s = first.t_s;
    for (length, row) in (1..).zip(rows) {
        let interval_s = (row.t_s - std::mem::replace(&mut last_s, row.t_s)).abs();
        if row.rates_rad_s.is_none() || interval_s > MAX_ROW_INTERVAL_S {
            return None;
        }
        if (row.t_s - first.t_s).abs() >= WINDOW_S {
            return (length >= MIN_WINDOW_ROWS).then_some(length);
        }
    }
    None
}

#[cfg(test)]
mod tests;
