//! Builds rows of simultaneous data: a compass's field with attitude and body rates interpolated to its time.

mod rest;

use autoswing::attitude::{BodyRates, EulerRates};
use autoswing::frames::{Field, RollPitch, wrap_pi};
use nalgebra::Vector3;
use serde::Serialize;

use super::data_loss;
use super::frozen_field::frozen_intervals;
use super::reference::ReferenceHeading;
use super::row::{ReplayRow, down_in_body};
use crate::log::time_series::{Series, TimedRow};
use crate::log::{LoggedCompass, LoggedFlight, MAX_PITCH_RAD};
use crate::numbers::{median, quantile};

/// Largest gap between attitudes, seconds: one attitude lost at 3 Hz.
const MAX_GAP_S: f64 = 0.7;

/// Duration of the readings averaged to one row, seconds: the module's 10 Hz with a margin for jitter.
const ROW_AVERAGING_S: f64 = 0.09;

/// Largest difference between cubic and linear interpolation, radians; beyond it the rates contradict the attitude and
/// are ignored.
const MAX_CUBIC_DEVIATION_RAD: f32 = 0.1;

/// Change of tilt allowed in a window beyond the integrated body rates, radians: more is an alignment or reset of the
/// attitude filter.
const TILT_MARGIN_RAD: f32 = 0.035;
/// Factor on the integrated body rates, which are sampled.
const TILT_RATE_FACTOR: f32 = 2.0;
/// Length of the window, seconds.
const TILT_WINDOW_S: f64 = 1.0;

/// Margin of a single step of tilt beyond the body rates, radians (6 deg): more is a jump of the attitude.
const TILT_JUMP_MARGIN_RAD: f32 = 0.1;

/// Longest time between two attitude jumps that enclose a wrong attitude, seconds.
const MAX_WRONG_ATTITUDE_S: f64 = 3.0;

/// Least ratio of a spike's strength to the median: hard iron of nearly the Earth's field doubles the strength.
const MIN_SPIKE_RATIO: f64 = 3.0;

/// Time after a start or gap in which a filter may align, seconds; data up to the last excessive tilt is dropped.
const MAX_FILTER_ALIGNMENT_S: f64 = 60.0;

/// Attitude and body rates at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeSample {
    /// Flight time of the attitude, seconds.
    pub t_s: f64,
    /// The autopilot's attitude.
    pub attitude: RollPitch,
    /// Body rates p, q, r, rad/s, if available.
    pub rates_rad_s: Option<[f32; 3]>,
}

/// Attitudes at 10 Hz between rows more than 0.15 s apart, as an autopilot sends them to the module. Otherwise rates
/// are integrated over too long steps and the monitor reports false hard-iron changes.
pub fn attitudes_between(flight: &LoggedFlight, from_s: f64, to_s: f64) -> Vec<AttitudeSample> {
    const PAUSE_SAMPLING_S: f64 = 0.1;
    /// Longest pause that is filled with attitudes, seconds; a longer one is a gap of the log.
    const MAX_LOG_PAUSE_S: f64 = 5.0;
    let pause_s = to_s - from_s;
    if !(1.5 * PAUSE_SAMPLING_S..=MAX_LOG_PAUSE_S).contains(&pause_s) {
        return Vec::new();
    }
    let step_count = (pause_s / PAUSE_SAMPLING_S).round();
    let instants = (1..step_count as u32).map(|step| from_s + pause_s * f64::from(step) / step_count);
    instants.filter_map(|t_s| attitude_at(flight, t_s)).collect()
}

/// Numbers of readings and rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RowCounts {
    /// Number of field readings in the log.
    pub readings: usize,
    /// Number of usable rows.
    pub used: usize,
    /// Number of readings without a neighbouring attitude.
    pub without_attitude: usize,
    /// Number of readings with attitude changes that contradict the body rates (filter alignment or reset).
    #[serde(rename = "unsettled")]
    pub contradicting_attitude: usize,
    /// Number of rows in which the aircraft was disarmed.
    pub disarmed: usize,
    /// Number of rows at rest before the first and after the last movement, where foreign iron may be near, and on the
    /// side after a crash.
    pub on_the_ground: usize,
    /// Number of rows excluded by the log, or outside the chosen time.
    #[serde(rename = "kept_out")]
    pub excluded: usize,
    /// Number of rows with a frozen field while the aircraft moved.
    #[serde(rename = "stuck")]
    pub frozen_field: usize,
    /// Number of readings that are much stronger than the others.
    pub spikes: usize,
    /// Number of readings with an attitude that differs from the simulator's.
    pub off_simulator: usize,
}

impl RowCounts {
    /// Number of rejected rows and the cause, a text for each cause.
    pub fn rejection_texts(&self) -> Vec<String> {
        let rejections_by_cause = [
            (self.disarmed, "disarmed"),
            (self.on_the_ground, "on the ground"),
            (self.without_attitude, "without an attitude near it"),
            (self.contradicting_attitude, "while the attitude contradicts the body rates"),
            (self.frozen_field, "with a frozen field"),
            (self.spikes, "spikes"),
            (self.off_simulator, "while the attitude differs from the simulator's by over 5 deg"),
            (self.excluded, "excluded by the log or outside the chosen time"),
        ];
        let rejections = rejections_by_cause.iter().filter(|(row_count, _)| *row_count > 0);
        rejections.map(|(row_count, reason)| format!("{row_count} {reason}")).collect()
    }
}

/// Builds the rows of a compass with a field latency in seconds.
pub fn build_rows(
    flight: &LoggedFlight,
    compass: &LoggedCompass,
    latency_s: f64,
    reference: Option<&ReferenceHeading>,
) -> (Vec<ReplayRow>, RowCounts) {
    let mut row_counts = RowCounts { readings: compass.field.rows().len(), ..RowCounts::default() };
    let unsettled = intervals_contradicting_rates(flight);
    let gap_s = data_loss::attitude_gap_limit_s(flight, MAX_GAP_S);
    let mut groups: Vec<Vec<(&TimedRow<6>, AttitudeSample)>> = Vec::new();
    let spike_ut = MIN_SPIKE_RATIO * median(compass.field.rows().iter().map(strength_ut));
    for reading in compass.field.rows() {
        if strength_ut(reading) > spike_ut {
            row_counts.spikes += 1;
            continue;
        }
        let t_s = reading.t_s - latency_s;
        let sample = attitude_at(flight, t_s).filter(|_| flight.attitude.surrounding_rows(t_s, gap_s).is_some());
        let Some(sample) = sample else {
            row_counts.without_attitude += 1;
            continue;
        };
        if unsettled.iter().any(|&[from_s, to_s]| (from_s..=to_s).contains(&t_s)) {
            row_counts.contradicting_attitude += 1;
            continue;
        }
        if differs_from_simulator(flight, &sample) {
            row_counts.off_simulator += 1;
            continue;
        }
        match groups.last_mut() {
            Some(last) if t_s - last[0].1.t_s < ROW_AVERAGING_S => last.push((reading, sample)),
            _ => groups.push(vec![(reading, sample)]),
        }
    }
    let mut rows: Vec<ReplayRow> = groups.iter().map(|group| mean_row(flight, group, reference)).collect();
    // A log that was never armed has no arming state.
    let was_armed = rows.iter().any(|row| flight.is_armed(row.t_s) == Some(true));
    let on_the_ground = rest::ground_intervals(flight);
    for row in &mut rows {
        let is_excluded = flight
            .row_usability
            .adjacent_rows(row.t_s + latency_s + 1e-6)
            .0
            .is_some_and(|usability| usability.row_values[0] == 0.0);
        let count_of_cause = if is_excluded {
            &mut row_counts.excluded
        } else if was_armed && flight.is_armed(row.t_s) == Some(false) {
            &mut row_counts.disarmed
        } else if on_the_ground.iter().any(|[from_s, to_s]| *from_s < row.t_s && row.t_s < *to_s) {
            &mut row_counts.on_the_ground
        } else {
            continue;
        };
        *count_of_cause += 1;
        row.is_usable = false;
    }
    for [from_s, to_s] in frozen_intervals(&rows).into_iter().map(|frozen| frozen.interval_s) {
        for row in rows.iter_mut().filter(|row| row.is_usable && (from_s..=to_s).contains(&row.t_s)) {
            row.is_usable = false;
            row_counts.frozen_field += 1;
        }
    }
    row_counts.used = rows.iter().filter(|row| row.is_usable).count();
    (rows, row_counts)
}

/// Whether roll and pitch differ from a simulator's by more than a working filter does.
fn differs_from_simulator(flight: &LoggedFlight, sample: &AttitudeSample) -> bool {
    /// Twice the largest error of a filter in a turn, radians (5 deg).
    const MAX_DIFFERENCE_RAD: f64 = 0.087;
    flight.true_attitude.interpolate_angles(sample.t_s, MAX_GAP_S).is_some_and(|[roll_rad, pitch_rad, _]| {
        let by_simulator = down_in_body(RollPitch { roll_rad, pitch_rad });
        down_in_body(sample.attitude).angle(&by_simulator) > MAX_DIFFERENCE_RAD
    })
}

/// Strength of a reading's raw field, microtesla.
pub(super) fn strength_ut(reading: &TimedRow<6>) -> f64 {
    let [x, y, z, ..] = reading.row_values;
    f64::from(Vector3::new(x, y, z).norm())
}

/// Row of the means of readings, of which there is one at least, and of the attitudes at their times.
fn mean_row(
    flight: &LoggedFlight,
    group: &[(&TimedRow<6>, AttitudeSample)],
    reference: Option<&ReferenceHeading>,
) -> ReplayRow {
    let mean = |value: &dyn Fn(&TimedRow<6>, &AttitudeSample) -> f32| {
        group.iter().map(|(reading, sample)| value(reading, sample)).sum::<f32>() / group.len() as f32
    };
    let [x, y, z, logged_x, logged_y, logged_z] =
        std::array::from_fn(|axis| mean(&|reading, _| reading.row_values[axis]));
    let first = &group[0].1;
    let t_s = first.t_s + group.iter().map(|(_, sample)| sample.t_s - first.t_s).sum::<f64>() / group.len() as f64;
    let roll_change_rad = mean(&|_, sample| wrap_pi(sample.attitude.roll_rad - first.attitude.roll_rad));
    let attitude = RollPitch {
        roll_rad: wrap_pi(first.attitude.roll_rad + roll_change_rad),
        pitch_rad: mean(&|_, sample| sample.attitude.pitch_rad),
    };
    let rates: Vec<[f32; 3]> = group.iter().filter_map(|(_, sample)| sample.rates_rad_s).collect();
    let mean_rate = |axis: usize| rates.iter().map(|rates| rates[axis]).sum::<f32>() / rates.len() as f32;
    ReplayRow {
        t_s,
        raw_field: Field::from_ut(x, y, z),
        logged_field: Field::from_ut(logged_x, logged_y, logged_z),
        attitude,
        rates_rad_s: (!rates.is_empty()).then(|| [0, 1, 2].map(mean_rate)),
        current_a: current_at(flight, t_s),
        is_usable: true,
        reference_deg: reference
            .filter(|_| attitude.pitch_rad.abs() <= MAX_PITCH_RAD)
            .and_then(|reference| reference.heading_deg(flight, t_s)),
    }
}

fn current_at(flight: &LoggedFlight, t_s: f64) -> Option<f32> {
    /// Longest gap between battery currents, seconds; battery status arrives at 1 Hz or faster.
    const MAX_GAP_S: f64 = 3.0;
    flight.battery_current.interpolate_or_hold(t_s, MAX_GAP_S).map(|[amperes]| amperes)
}

/// Intervals in which the attitude changed more than the body rates allow, seconds.
fn intervals_contradicting_rates(flight: &LoggedFlight) -> Vec<[f64; 2]> {
    let rows = flight.attitude.rows();
    let mut intervals: Vec<[f64; 2]> = Vec::new();
    // Time of the last start or gap, after which the attitude filter may be aligning.
    let (mut last_start_s, mut first) = (rows.first().map_or(0.0, |row| row.t_s), 0);
    let mut turned_rad = vec![0.0_f64; rows.len()];
    let mut jumps: Vec<[f64; 2]> = Vec::new();
    for last in 1..rows.len() {
        let (before, row) = (&rows[last - 1], &rows[last]);
        let step_s = row.t_s - before.t_s;
        if step_s > TILT_WINDOW_S {
            (last_start_s, first) = (row.t_s, last);
        }
        let rate = |at_s: f64| {
            flight.body_rates.interpolate(at_s, MAX_GAP_S).map(|[p, q, r]| libm::hypotf(libm::hypotf(p, q), r))
        };
        let Some(rate) = rate(before.t_s).zip(rate(row.t_s)).map(|(from, to)| from.max(to)) else {
            (last_start_s, first) = (row.t_s, last);
            continue;
        };
        if angle_between_downs_rad(before, row) > TILT_RATE_FACTOR * rate * step_s as f32 + TILT_JUMP_MARGIN_RAD {
            jumps.push([before.t_s, row.t_s]);
        }
        turned_rad[last] = turned_rad[last - 1] + f64::from(rate) * step_s;
        while rows[first].t_s < row.t_s - TILT_WINDOW_S {
            first += 1;
        }
        let integrated_rad = (turned_rad[last] - turned_rad[first]) as f32;
        if angle_between_downs_rad(&rows[first], row) > TILT_RATE_FACTOR * integrated_rad + TILT_MARGIN_RAD {
            let is_aligning = row.t_s - last_start_s < MAX_FILTER_ALIGNMENT_S;
            let from_s = if is_aligning { last_start_s } else { rows[first].t_s };
            match intervals.last_mut().filter(|[_, to_s]| *to_s >= from_s) {
                Some(span) => *span = [span[0].min(from_s), row.t_s],
                None => intervals.push([from_s, row.t_s]),
            }
        }
    }
    let wrong_until = |(i, jump): (usize, &[f64; 2])| {
        jumps.get(i + 1).filter(|back| back[0] - jump[1] <= MAX_WRONG_ATTITUDE_S).map_or(jump[1], |back| back[1])
    };
    intervals.extend(jumps.iter().enumerate().map(|jump| [jump.1[0], wrong_until(jump)]));
    intervals
}

fn angle_between_downs_rad(first_attitude: &TimedRow<3>, second_attitude: &TimedRow<3>) -> f32 {
    down_of_row(first_attitude).angle(&down_of_row(second_attitude)) as f32
}

fn down_of_row(row: &TimedRow<3>) -> Vector3<f64> {
    let [roll_rad, pitch_rad, _] = row.row_values;
    down_in_body(RollPitch { roll_rad, pitch_rad })
}

fn attitude_of_down(down: Vector3<f64>) -> RollPitch {
    let horizontal = libm::hypot(down.y, down.z);
    RollPitch { roll_rad: libm::atan2(down.y, down.z) as f32, pitch_rad: libm::atan2(-down.x, horizontal) as f32 }
}

/// Roll and pitch by Hermite interpolation with slopes from the body rates, and the rates; near the singular pitch by
/// interpolation of the vertical.
fn attitude_at(flight: &LoggedFlight, t_s: f64) -> Option<AttitudeSample> {
    let (before, after, weight) = flight.attitude.surrounding_rows(t_s, MAX_GAP_S)?;
    let rates_rad_s = flight.body_rates.interpolate(t_s, MAX_GAP_S);
    let step_s = (after.t_s - before.t_s) as f32;
    if [before, after].iter().any(|row| row.row_values[1].abs() > MAX_PITCH_RAD) {
        let attitude = attitude_of_down(down_of_row(before).lerp(&down_of_row(after), weight));
        return Some(AttitudeSample { t_s, attitude, rates_rad_s });
    }
    let weight = weight as f32;
    let motions = euler_rates_at(&flight.body_rates, before).zip(euler_rates_at(&flight.body_rates, after));
    let [roll_rad, pitch_rad] = [0, 1].map(|angle| {
        let change_rad = wrap_pi(after.row_values[angle] - before.row_values[angle]);
        let straight = weight * change_rad;
        let bulge = motions.map_or(0.0, |(from, to)| {
            let rate_of_angle = |motion: &EulerRates| if angle == 0 { motion.roll_rad_s } else { motion.pitch_rad_s };
            let (start_slope_excess, end_slope_excess) =
                (rate_of_angle(&from) * step_s - change_rad, change_rad - rate_of_angle(&to) * step_s);
            weight * (1.0 - weight) * ((1.0 - weight) * start_slope_excess + weight * end_slope_excess)
        });
        before.row_values[angle] + straight + if bulge.abs() <= MAX_CUBIC_DEVIATION_RAD { bulge } else { 0.0 }
    });
    Some(AttitudeSample { t_s, attitude: RollPitch { roll_rad: wrap_pi(roll_rad), pitch_rad }, rates_rad_s })
}

fn euler_rates_at(rates: &Series<3>, attitude_row: &TimedRow<3>) -> Option<EulerRates> {
    let [roll_rad, pitch_rad, _] = attitude_row.row_values;
    let body_rates = BodyRates::from_rad_s(rates.interpolate(attitude_row.t_s, MAX_GAP_S)?)?;
    Some(EulerRates::from_body_rates(body_rates, RollPitch { roll_rad, pitch_rad }))
}

pub(super) fn median_step_s(rows: &[ReplayRow]) -> Option<f64> {
    quantile(rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s), 0.5)
}

#[cfg(test)]
mod tests;
