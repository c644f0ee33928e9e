//! Time series with sorted, unique times and bounded memory.

use autoswing::frames::wrap_pi;

use crate::numbers::{median, quantile};

/// Largest number of rows: 3 MB at six values a row, and 130 MB for the whole analysis of three compasses. Every second
/// row is dropped, repeatedly, while at least 10 Hz remain; then every second part of the flight.
const MAX_ROWS: usize = 3 << 15;

/// Length of the parts of a log that are dropped to bound memory, seconds; all series drop the same parts.
const PART_LENGTH_S: f64 = 256.0;

/// How a series is kept within its memory.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Thinning {
    max_rows: usize,
    /// Lowest rate, Hz, at which every second row is dropped; at lower rates whole parts are dropped.
    min_row_thinning_rate_hz: f64,
}

const OF_A_LOG: Thinning = Thinning { max_rows: MAX_ROWS, min_row_thinning_rate_hz: 20.0 };

/// The integral of a rate needs every row, so up to 200 Hz whole parts are dropped. Two hours at 100 Hz are stored while
/// the log is read.
const OF_INERTIAL_SENSOR: Thinning = Thinning { max_rows: 8 * MAX_ROWS, min_row_thinning_rate_hz: 200.0 };

/// A row of `N` values with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedRow<const N: usize> {
    /// Flight time of the row, seconds.
    pub t_s: f64,
    /// Values of the row.
    pub row_values: [f32; N],
}

/// A time series of `N` values a row.
#[derive(Clone, Debug, PartialEq)]
pub struct Series<const N: usize> {
    rows: Vec<TimedRow<N>>,
    thinning: Thinning,
    /// Base-2 logarithm of the row stride: of `stride` consecutive rows one is stored.
    row_stride_log2: u8,
    /// Base-2 logarithm of the part stride: of `stride` consecutive parts of `PART_LENGTH_S` one is stored.
    part_stride_log2: u8,
    offered_count: u64,
}

impl<const N: usize> Default for Series<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Series<N> {
    /// Creates an empty series.
    #[must_use]
    pub const fn new() -> Self {
        Self::with_thinning(OF_A_LOG)
    }

    /// Creates an empty series of a gyro or accelerometer, which keeps its rate.
    pub(super) const fn of_inertial_sensor() -> Self {
        Self::with_thinning(OF_INERTIAL_SENSOR)
    }

    const fn with_thinning(thinning: Thinning) -> Self {
        Self { rows: Vec::new(), thinning, row_stride_log2: 0, part_stride_log2: 0, offered_count: 0 }
    }

    /// Appends a row, in the order of the file; may drop it to bound memory.
    pub fn push_row(&mut self, t_s: f64, values: [f32; N]) {
        if !is_in_retained_part(t_s, self.part_stride_log2) {
            return;
        }
        self.offered_count += 1;
        if !self.offered_count.is_multiple_of(1 << self.row_stride_log2) {
            return;
        }
        if self.rows.len() >= self.thinning.max_rows {
            self.thin_rows();
            if !self.offered_count.is_multiple_of(1 << self.row_stride_log2)
                || !is_in_retained_part(t_s, self.part_stride_log2)
            {
                return;
            }
        }
        self.rows.push(TimedRow { t_s, row_values: values });
    }

    /// Drops every second part at a low rate, else every second row; rows also if a single part exceeds three quarters
    /// of the limit.
    fn thin_rows(&mut self) {
        let step_s = median(self.rows.windows(2).map(|pair| (pair[1].t_s - pair[0].t_s).abs()));
        if step_s * self.thinning.min_row_thinning_rate_hz >= 1.0 && self.part_stride_log2 < 40 {
            self.part_stride_log2 += 1;
            let part_stride_log2 = self.part_stride_log2;
            self.rows.retain(|row| is_in_retained_part(row.t_s, part_stride_log2));
        }
        if self.rows.len() >= self.thinning.max_rows / 4 * 3 {
            let mut retained = 0_u32;
            self.rows.retain(|_| {
                retained += 1;
                retained.is_multiple_of(2)
            });
            self.row_stride_log2 += 1;
        }
    }

    /// Sorts by time and drops repeated times; returns the number dropped. Required before any lookup.
    pub fn sort_and_dedup(&mut self) -> usize {
        let before = self.rows.len();
        self.rows.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
        self.rows.dedup_by(|later, first| later.t_s <= first.t_s);
        before - self.rows.len()
    }

    /// The rows.
    #[must_use]
    pub fn rows(&self) -> &[TimedRow<N>] {
        &self.rows
    }

    /// The rows, mutable; the caller must keep their times in order.
    pub fn rows_mut(&mut self) -> &mut [TimedRow<N>] {
        &mut self.rows
    }

    /// Drops the rows that `is_retained` rejects, by index and values.
    pub(crate) fn retain_rows(&mut self, is_retained: impl Fn(usize, &TimedRow<N>) -> bool) {
        let mut index = 0;
        self.rows.retain(|row| {
            index += 1;
            is_retained(index - 1, row)
        });
    }

    /// Whether the series has no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The last row at or before a time and the first after it.
    #[must_use]
    pub fn adjacent_rows(&self, t_s: f64) -> (Option<&TimedRow<N>>, Option<&TimedRow<N>>) {
        let after = self.rows.partition_point(|row| row.t_s <= t_s);
        (after.checked_sub(1).and_then(|before| self.rows.get(before)), self.rows.get(after))
    }

    /// The rows around a time and the interpolation weight of the second, 0 to 1; none outside the series and in gaps
    /// longer than `max_gap_s`.
    #[must_use]
    pub fn surrounding_rows(&self, t_s: f64, max_gap_s: f64) -> Option<(&TimedRow<N>, &TimedRow<N>, f64)> {
        let (before, after) = self.adjacent_rows(t_s);
        let before = before?;
        let Some(after) = after else { return (before.t_s >= t_s).then_some((before, before, 0.0)) };
        let gap_s = after.t_s - before.t_s;
        (gap_s <= max_gap_s).then(|| (before, after, (t_s - before.t_s) / gap_s))
    }

    /// Linear interpolation at a time; none outside the series and in gaps.
    #[must_use]
    pub fn interpolate(&self, t_s: f64, max_gap_s: f64) -> Option<[f32; N]> {
        let (before, after, weight) = self.surrounding_rows(t_s, max_gap_s)?;
        Some(std::array::from_fn(|i| {
            before.row_values[i] + weight as f32 * (after.row_values[i] - before.row_values[i])
        }))
    }

    /// Linear interpolation; holds the last row for up to `max_gap_s`.
    #[must_use]
    pub fn interpolate_or_hold(&self, t_s: f64, max_gap_s: f64) -> Option<[f32; N]> {
        let last = self.rows.last().filter(|last| (0.0..=max_gap_s).contains(&(t_s - last.t_s)));
        last.map(|last| last.row_values).or_else(|| self.interpolate(t_s, max_gap_s))
    }

    /// Interpolation of angles in radians, the shorter way round.
    #[must_use]
    pub fn interpolate_angles(&self, t_s: f64, max_gap_s: f64) -> Option<[f32; N]> {
        let (before, after, weight) = self.surrounding_rows(t_s, max_gap_s)?;
        Some(std::array::from_fn(|i| {
            wrap_pi(before.row_values[i] + weight as f32 * wrap_pi(after.row_values[i] - before.row_values[i]))
        }))
    }

    /// Median interval between rows, seconds.
    #[must_use]
    pub fn median_step_s(&self) -> Option<f64> {
        quantile(self.rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s), 0.5)
    }
}

impl<const N: usize> FromIterator<(f64, [f32; N])> for Series<N> {
    /// Series of rows with their times, seconds.
    fn from_iter<T: IntoIterator<Item = (f64, [f32; N])>>(rows: T) -> Self {
        let mut series = Self::new();
        rows.into_iter().for_each(|(t_s, values)| series.push_row(t_s, values));
        series
    }
}

/// Pairs of rows by index: each row with the first row at least `min_s` seconds later, unless more than `max_s` lie between
/// them.
pub(crate) fn pairs_apart<T>(
    rows: &[T],
    t_s: impl Fn(&T) -> f64,
    [min_s, max_s]: [f64; 2],
) -> impl Iterator<Item = (usize, usize)> {
    let mut last = 0;
    (0..rows.len()).filter_map(move |first| {
        let since_s = |row: &T| t_s(row) - t_s(&rows[first]);
        last += rows[last..].iter().take_while(|row| since_s(row) < min_s).count();
        rows.get(last).filter(|row| since_s(row) <= max_s).map(|_| (first, last))
    })
}

fn is_in_retained_part(t_s: f64, part_stride_log2: u8) -> bool {
    ((t_s / PART_LENGTH_S).floor() as i64).rem_euclid(1 << part_stride_log2) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn series_from(rows: &[(f64, f32)]) -> Series<1> {
        rows.iter().map(|&(t_s, value)| (t_s, [value])).collect()
    }

    #[test]
    fn rows_are_sorted_and_the_first_of_equal_times_is_kept() {
        let mut series = series_from(&[(1.0, 1.0), (3.0, 3.0), (2.0, 2.0), (3.0, 9.0)]);
        assert_eq!(series.sort_and_dedup(), 1);
        assert_eq!(series.rows().iter().map(|row| row.row_values[0]).collect::<Vec<_>>(), [1.0, 2.0, 3.0]);
    }

    #[test]
    fn rows_are_interpolated_linearly_except_across_gaps() {
        let series = series_from(&[(1.0, 10.0), (2.0, 20.0), (4.0, 40.0)]);
        assert_eq!(series.interpolate(1.25, 1.0), Some([12.5]));
        assert_eq!(series.interpolate(1.0, 1.0), Some([10.0]));
        assert_eq!(series.interpolate(4.0, 1.0), Some([40.0]));
        assert_eq!(series.interpolate(3.0, 2.0), Some([30.0]));
        assert_eq!(series.interpolate_or_hold(5.0, 1.0), Some([40.0]));
        assert_eq!(
            (series.interpolate_or_hold(5.001, 1.0), series.interpolate_or_hold(1.25, 1.0)),
            (None, Some([12.5]))
        );
        for outside in [0.999, 4.001, 3.0] {
            assert_eq!(series.interpolate(outside, 1.999), None, "{outside}");
        }
    }

    #[test]
    fn angles_are_interpolated_the_short_way_round() {
        let series = series_from(&[(0.0, 3.0), (1.0, -3.0)]);
        let [angle] = series.interpolate_angles(0.5, 1.0).unwrap();
        assert!((angle.abs() - std::f32::consts::PI).abs() < 1e-5, "{angle}");
    }

    /// At a high rate every second row is dropped; attitudes at 1 Hz could not be interpolated, so that at 10 Hz whole
    /// parts of the log are dropped, and at 100 Hz those of a gyro.
    #[test]
    fn memory_is_bounded_and_retained_rows_are_evenly_spaced() {
        for (thinning, step_s, retained_step_s, has_gaps) in
            [(OF_A_LOG, 0.01, 0.04, false), (OF_A_LOG, 0.1, 0.1, true), (OF_INERTIAL_SENSOR, 0.01, 0.01, true)]
        {
            let mut series = Series::with_thinning(thinning);
            let max_rows = thinning.max_rows;
            for i in 0..3 * max_rows {
                series.push_row(i as f64 * step_s, [0.0]);
            }
            let gap_count = if has_gaps { (3.0 * max_rows as f64 * step_s / PART_LENGTH_S / 4.0) as usize } else { 0 };
            let rows = series.rows();
            assert!((max_rows / 2..=max_rows).contains(&rows.len()), "{step_s} s: {}", rows.len());
            let steps = rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s);
            let (short, gaps): (Vec<f64>, Vec<f64>) = steps.partition(|step| (step - retained_step_s).abs() < 1e-6);
            assert_eq!((short.len(), gaps.len()), (rows.len() - 1 - gap_count, gap_count), "{step_s} s");
        }
    }
}
