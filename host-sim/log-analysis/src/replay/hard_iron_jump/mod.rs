//! Detects jumps of the field that the motion of the aircraft does not explain: hard iron that appears, disappears, or
//! changes near the end of the log.
//!
//! Without a jump, the corrected field of the second before a row, levelled by the attitude and turned back by the
//! integrated heading rate, equals that of the second after it. The difference observes all three components of a jump
//! even on a single heading, where field strength and vertical component do not show the component across the heading.

use autoswing::frames::RollPitch;
use nalgebra::{Rotation3, Vector3};

use super::hard_iron_step::HardIronStep;
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

/// Largest number of jumps tested before, and after, the fitted rows: each test takes a pass over all rows.
const MAX_JUMPS_PER_DIRECTION: usize = 8;

/// Longest duration beyond a jump in which its shift is tested, seconds; largest ratio of the residuals with the shift
/// to those without it, or to those of the fitted rows. Residuals need not decrease: a shift along an axis that the
/// tested rows do not observe leaves them equal.
const MAX_TESTED_DURATION_S: f64 = 30.0;
const MAX_SHIFTED_RESIDUAL_RATIO: f64 = 1.1;
const MAX_RATIO_TO_FITTED_RESIDUAL: f64 = 2.0;

/// Largest residual of the rows between a shifted jump and the next one: ratio to the residual of the fitted rows, or
/// to the size of the jump, whose estimation error it contains.
const MAX_EXPLAINED_RESIDUAL_RATIO: f64 = 3.0;
const MAX_UNEXPLAINED_FRACTION: f64 = 0.4;

/// Smallest fraction of a jump, removed by the autopilot's own correction, that counts as compensation.
const MIN_COMPENSATED_FRACTION: f64 = 0.5;

/// Shortest duration of a temporary change, seconds: shorter ones affect few rows and are not of the aircraft's iron.
const MIN_TEMPORARY_CHANGE_S: f64 = 5.0;

/// Largest norm of the sum of two changes that cancel each other, relative to the larger change.
const MAX_CANCELLED_REMAINDER: f64 = 0.35;

/// Times of all jumps of the corrected field in usable rows, seconds.
pub fn find_jump_times_s(rows: &[ReplayRow], correction: &FieldCorrection) -> Vec<f64> {
    let search = JumpSearch::new(rows, correction);
    let jumps = search.jumps();
    jumps.into_iter().map(|jump| search.rows[jump.row_index].t_s).collect()
}

/// Correction with the rows that it fits.
pub struct FittedCorrection {
    /// The correction.
    pub correction: FieldCorrection,
    /// Times of the first and last row that it fits, seconds.
    pub fitted_range_s: [f64; 2],
    /// Strength and downward component of the Earth's field, which the corrected field should have, microtesla.
    pub earth_total_and_vertical_ut: [f64; 2],
}

/// Jumps of the raw field in usable rows, in order of time. Outward from the fitted rows, each jump is removed from the
/// fields beyond it: left in, it would appear as further jumps when the aircraft turns.
pub fn find_jumps(rows: &[ReplayRow], fit: &FittedCorrection) -> Vec<HardIronStep> {
    let Some(to_raw) = fit.correction.matrix.try_inverse() else { return Vec::new() };
    let mut search = JumpSearch::new(rows, &fit.correction);
    let sigma_ut = Vector3::repeat(search.sigma_ut());
    let mut found: Vec<Jump> = Vec::new();
    for direction in [Direction::Later, Direction::Earlier] {
        found.extend(search.jumps_in(direction, fit));
    }
    found.sort_by_key(|jump| jump.row_index);
    remove_brief_temporary_changes(&mut found, &search.rows);
    found.retain(|jump| !search.is_compensated(jump.row_index, &(to_raw * jump.step_ut)));
    found
        .into_iter()
        .map(|jump| HardIronStep { time_s: search.rows[jump.row_index].t_s, step_ut: to_raw * jump.step_ut, sigma_ut })
        .collect()
}

/// Whether two steps cancel each other.
pub fn cancel_each_other(one_ut: &Vector3<f64>, other_ut: &Vector3<f64>) -> bool {
    (one_ut + other_ut).norm() < MAX_CANCELLED_REMAINDER * one_ut.norm().max(other_ut.norm())
}

fn remove_brief_temporary_changes(jumps: &mut Vec<Jump>, rows: &[&ReplayRow]) {
    let mut i = 0;
    while let Some([one, other]) = jumps.get(i..i + 2) {
        let is_short = rows[other.row_index].t_s - rows[one.row_index].t_s < MIN_TEMPORARY_CHANGE_S;
        if is_short && cancel_each_other(&one.step_ut, &other.step_ut) {
            jumps.drain(i..i + 2);
        } else {
            i += 1;
        }
    }
}

/// Direction in time of a search that starts at the rows that a correction fits.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Direction {
    Later,
    Earlier,
}

impl Direction {
    const fn sign(self) -> f64 {
        match self {
            Self::Later => 1.0,
            Self::Earlier => -1.0,
        }
    }
}

/// A jump at a row: the step of the corrected field, body axes, microtesla.
#[derive(Clone, Copy)]
struct Jump {
    row_index: usize,
    step_ut: Vector3<f64>,
}

impl Jump {
    /// Shift that removes the jump from the fields beyond it.
    fn shift_ut(&self, direction: Direction) -> Vector3<f64> {
        self.step_ut * -direction.sign()
    }
}

struct JumpSearch<'a> {
    rows: Vec<&'a ReplayRow>,
    /// Corrected fields, body axes.
    fields: Vec<Vector3<f64>>,
    /// Rotations from body axes to a level frame that does not turn with the heading.
    rotations: Vec<Rotation3<f64>>,
    /// Angle of rotation about any axis since the first row, summed without sign, radians.
    rotation_sum_rad: Vec<f64>,
    /// Median field of the window after each row less that of the window before, level frame; none if incomplete.
    differences: Vec<Option<Vector3<f64>>>,
}

impl<'a> JumpSearch<'a> {
    fn new(rows: &'a [ReplayRow], correction: &FieldCorrection) -> Self {
        let rows: Vec<&ReplayRow> = rows.iter().filter(|row| row.is_usable).collect();
        let fields = rows.iter().map(|row| row.corrected_field(correction)).collect();
        let headings_rad = integrals(rows.iter().copied(), |row| row.heading_rate_rad_s().unwrap_or(0.0));
        let rotation_sum_rad = integrals(rows.iter().copied(), |row| {
            row.rates_rad_s.map_or(0.0, |rates| Vector3::from(rates).map(f64::from).norm())
        });
        let rotation = |(row, heading_rad): (&&ReplayRow, f64)| {
            let RollPitch { roll_rad, pitch_rad } = row.attitude;
            Rotation3::from_euler_angles(roll_rad.into(), pitch_rad.into(), heading_rad)
        };
        let rotations = rows.iter().zip(headings_rad).map(rotation).collect();
        let differences = vec![None; rows.len()];
        let mut search = Self { rows, fields, rotations, rotation_sum_rad, differences };
        search.update_differences();
        search
    }

    /// Whether the autopilot's own correction removes most of a jump of the raw field, such as interference by a
    /// current that the log need not contain.
    fn is_compensated(&self, row_index: usize, raw_step_ut: &Vector3<f64>) -> bool {
        let Some([before, after]) = self.windows(row_index) else { return false };
        let corrections_ut = |window: std::ops::Range<usize>| {
            let corrections =
                self.rows[window].iter().map(|row| (row.logged_field.ut - row.raw_field.ut).map(f64::from));
            let corrections: Vec<Vector3<f64>> = corrections.collect();
            Vector3::from_fn(|axis, _| median(corrections.iter().map(|correction| correction[axis])))
        };
        let removed_ut = corrections_ut(before) - corrections_ut(after);
        removed_ut.dot(raw_step_ut) > MIN_COMPENSATED_FRACTION * raw_step_ut.norm_squared()
    }

    fn update_differences(&mut self) {
        for row_index in 0..self.rows.len() {
            self.differences[row_index] = self
                .windows(row_index)
                .map(|[before, after]| self.median_level_field_ut(after) - self.median_level_field_ut(before));
        }
    }

    /// Window from a row in one direction; `None` if it has a gap, a row without rates, or too few rows.
    fn window(&self, row_index: usize, direction: Direction) -> Option<std::ops::Range<usize>> {
        let sign = direction.sign();
        let limit_s = self.rows[row_index].t_s + sign * WINDOW_S;
        let mut end = row_index;
        while sign * self.rows[end].t_s < sign * limit_s {
            let next = match direction {
                Direction::Later => end + 1,
                Direction::Earlier => end.checked_sub(1)?,
            };
            let row = self.rows.get(next)?;
            if row.rates_rad_s.is_none() || (row.t_s - self.rows[end].t_s).abs() > MAX_ROW_INTERVAL_S {
                return None;
            }
            end = next;
        }
        let window = row_index.min(end)..row_index.max(end);
        (window.len() >= MIN_WINDOW_ROWS).then_some(window)
    }

    /// Windows before and after a row.
    fn windows(&self, row_index: usize) -> Option<[std::ops::Range<usize>; 2]> {
        Some([self.window(row_index, Direction::Earlier)?, self.window(row_index, Direction::Later)?])
    }

    /// Median of each component of the fields of some rows, level frame, microtesla.
    fn median_level_field_ut(&self, window: std::ops::Range<usize>) -> Vector3<f64> {
        let levelled: Vec<Vector3<f64>> = window.map(|i| self.rotations[i] * self.fields[i]).collect();
        Vector3::from_fn(|axis, _| median(levelled.iter().map(|field| field[axis])))
    }

    fn difference_norms_ut(&self) -> impl Iterator<Item = f64> + '_ {
        self.differences.iter().flatten().map(Vector3::norm)
    }

    /// Standard deviation of a component of a difference, microtesla.
    fn sigma_ut(&self) -> f64 {
        median(self.difference_norms_ut()) / MEDIAN_NORM_SIGMAS
    }

    /// Differences above the detection thresholds that are the largest within `WINDOW_S`, in order of time.
    fn jumps(&self) -> Vec<Jump> {
        let Some(reference_ut) = quantile(self.difference_norms_ut(), REFERENCE_QUANTILE) else { return Vec::new() };
        let least_ut = MIN_JUMP_UT.max(MIN_QUANTILE_RATIO * reference_ut);
        let excess = |row_index: usize| {
            let size_ut = self.differences[row_index]?.norm();
            let [before, after] = self.windows(row_index)?;
            let rotation_sum_rad = self.rotation_sum_rad[after.end] - self.rotation_sum_rad[before.start];
            let limit_ut = least_ut.max(MAX_TURN_ERROR_PER_RADIAN * rotation_sum_rad * self.fields[row_index].norm());
            (size_ut > limit_ut).then_some(size_ut)
        };
        let over: Vec<(usize, f64)> =
            (0..self.rows.len()).filter_map(|row_index| Some((row_index, excess(row_index)?))).collect();
        let is_peak = |(row_index, size_ut): &&(usize, f64)| {
            let is_near = |other: usize| (self.rows[other].t_s - self.rows[*row_index].t_s).abs() <= WINDOW_S;
            over.iter().filter(|(other, _)| is_near(*other)).all(|(_, other_ut)| other_ut <= size_ut)
        };
        over.iter()
            .filter(is_peak)
            .filter_map(|&(row_index, _)| {
                Some(Jump { row_index, step_ut: self.rotations[row_index].inverse() * self.differences[row_index]? })
            })
            .collect()
    }

    /// Jumps outward from the fitted rows in one direction; each is removed from the fields beyond it.
    fn jumps_in(&mut self, direction: Direction, fit: &FittedCorrection) -> Vec<Jump> {
        let mut found = Vec::new();
        let mut beyond_s = match direction {
            Direction::Later => fit.fitted_range_s[1] - WINDOW_S,
            Direction::Earlier => fit.fitted_range_s[0] + WINDOW_S,
        };
        let unshifted = Vector3::zeros();
        let fitted_ut =
            self.residual_ut(self.rows_between(fit.fitted_range_s), &unshifted, &fit.earth_total_and_vertical_ut);
        for _ in 0..MAX_JUMPS_PER_DIRECTION {
            let mut jumps = self.jumps();
            if direction == Direction::Earlier {
                jumps.reverse();
            }
            jumps.retain(|jump| direction.sign() * self.rows[jump.row_index].t_s > direction.sign() * beyond_s);
            let Some(&jump) = jumps.first() else { break };
            beyond_s = self.rows[jump.row_index].t_s;
            let next_s = jumps.get(1).map_or(f64::INFINITY, |next| (self.rows[next.row_index].t_s - beyond_s).abs());
            let tested_until_s = beyond_s + direction.sign() * next_s.min(MAX_TESTED_DURATION_S);
            let tested = self.rows_between([beyond_s, tested_until_s]);
            let unshifted_ut = self.residual_ut(tested.clone(), &unshifted, &fit.earth_total_and_vertical_ut);
            let limit_ut = (MAX_SHIFTED_RESIDUAL_RATIO * unshifted_ut).max(MAX_RATIO_TO_FITTED_RESIDUAL * fitted_ut);
            if self.residual_ut(tested, &jump.shift_ut(direction), &fit.earth_total_and_vertical_ut) <= limit_ut {
                self.shift_beyond(&jump, direction);
                found.push(jump);
            }
        }
        let end_s = direction.sign() * f64::INFINITY;
        let time_s = |i: usize| found.get(i).map_or(end_s, |jump: &Jump| self.rows[jump.row_index].t_s);
        let is_explained = |i: usize| {
            let beyond = self.rows_between([time_s(i), time_s(i + 1)]);
            let limit_ut = MAX_UNEXPLAINED_FRACTION * found[i].step_ut.norm();
            self.residual_ut(beyond, &unshifted, &fit.earth_total_and_vertical_ut)
                < limit_ut.max(MAX_EXPLAINED_RESIDUAL_RATIO * fitted_ut)
        };
        // A missed or wrong jump causes false ones: from the first with unexplained residuals on, none is reported.
        let explained = (0..found.len()).take_while(|i| is_explained(*i)).count();
        found.truncate(explained);
        found
    }

    /// Rows between two times in any order, seconds.
    fn rows_between(&self, times_s: [f64; 2]) -> std::ops::Range<usize> {
        let [one, other] = times_s.map(|t_s| self.rows.partition_point(|row| row.t_s < t_s));
        one.min(other)..one.max(other)
    }

    /// Median deviation of strength and vertical component from the Earth's field, microtesla.
    fn residual_ut(
        &self,
        rows: std::ops::Range<usize>,
        shift_ut: &Vector3<f64>,
        earth_total_and_vertical_ut: &[f64; 2],
    ) -> f64 {
        median(rows.flat_map(|i| {
            absolute_residuals_ut(self.rows[i], &(self.fields[i] + shift_ut), earth_total_and_vertical_ut)
        }))
    }

    /// Removes a jump from the fields beyond it.
    fn shift_beyond(&mut self, jump: &Jump, direction: Direction) {
        let beyond = match direction {
            Direction::Later => jump.row_index..self.rows.len(),
            Direction::Earlier => 0..jump.row_index,
        };
        self.fields[beyond].iter_mut().for_each(|field| *field += jump.shift_ut(direction));
        self.update_differences();
    }
}

/// Absolute residuals of strength and vertical component of a row's corrected field, microtesla.
pub fn absolute_residuals_ut(row: &ReplayRow, field: &Vector3<f64>, [strength_ut, vertical_ut]: &[f64; 2]) -> [f64; 2] {
    [field.norm() - strength_ut, row.down_in_body().dot(field) - vertical_ut].map(f64::abs)
}

#[cfg(test)]
mod tests;
