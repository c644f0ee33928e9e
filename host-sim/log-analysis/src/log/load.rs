//! Electrical loads, whose field a compass measures, too: the current of the first battery, outputs and other currents.

use std::collections::BTreeMap;

use super::time_series::{Series, TimedRow};

/// Largest number of an output, a motor, or a battery; no autopilot logs more.
const MAX_LOAD_NUMBER: u8 = 16;

/// Pulse of an output at one end of its range, microseconds, and length of the range.
const PULSE_US: [f32; 2] = [1000.0, 1000.0];

/// Shortest pulse of an output that is in use, microseconds.
const MIN_PULSE_US: f32 = 500.0;

/// Largest fraction of the range; larger values are pulses in microseconds.
const MAX_FRACTION: f32 = 2.5;

/// Source of a load; numbers count from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum LoadSource {
    /// Current of a battery, amperes.
    Battery(u8),
    /// Current of a motor by its speed controller, amperes.
    Esc(u8),
    /// Command of a motor, 0 to 1.
    Motor(u8),
    /// Output to a servo or a speed controller, 0 to 1.
    Output(u8),
    /// Throttle, 0 to 1.
    Throttle,
}

impl LoadSource {
    /// Whether the load is a current, amperes.
    pub const fn is_current(self) -> bool {
        matches!(self, Self::Battery(_) | Self::Esc(_))
    }

    /// Number of the battery, motor or output; 1 of the throttle.
    pub const fn number(self) -> u8 {
        match self {
            Self::Battery(number) | Self::Esc(number) | Self::Motor(number) | Self::Output(number) => number,
            Self::Throttle => 1,
        }
    }
}

/// Loads that a log is read into.
#[derive(Debug, Default)]
pub(super) struct LoadRows(BTreeMap<LoadSource, Series<1>>);

impl LoadRows {
    /// Adds a value: amperes, a fraction, percent of the throttle, or a pulse in microseconds.
    pub fn push_value(&mut self, source: LoadSource, t_s: f64, value: f32) {
        if value.is_finite() && value.abs() < 10_000.0 && (1..=MAX_LOAD_NUMBER).contains(&source.number()) {
            self.0.entry(source).or_default().push_row(t_s, [value]);
        }
    }

    /// Adds the values of a message for sources numbered from 1.
    pub fn push_values(
        &mut self,
        source: impl Fn(u8) -> LoadSource,
        t_s: f64,
        values: impl IntoIterator<Item = Option<f32>>,
    ) {
        for (number, value) in (1..).zip(values) {
            if let Some(value) = value {
                self.push_value(source(number), t_s, value);
            }
        }
    }

    /// The loads that vary: currents in amperes, and commands from 0 to 1.
    pub fn into_loads(mut self) -> BTreeMap<LoadSource, Series<1>> {
        for (source, values) in &mut self.0 {
            values.sort_and_dedup();
            if source.is_current() {
                repair_current(values);
            } else {
                scale_to_fraction(*source, values);
            }
        }
        self.0.retain(|_, values| varies(values));
        self.0
    }
}

/// Scales percent of the throttle and pulses of outputs to fractions, and drops the pulses of outputs not in use.
fn scale_to_fraction(source: LoadSource, values: &mut Series<1>) {
    let largest = values.rows().iter().map(|row| row.row_values[0]).fold(0.0, f32::max);
    if largest <= MAX_FRACTION {
        return;
    }
    let is_throttle = source == LoadSource::Throttle;
    values.retain_rows(|_, row| is_throttle || row.row_values[0] >= MIN_PULSE_US);
    for row in values.rows_mut() {
        let [value] = row.row_values;
        row.row_values = [if is_throttle { value / 100.0 } else { (value - PULSE_US[0]) / PULSE_US[1] }];
    }
}

fn varies(values: &Series<1>) -> bool {
    let values = || values.rows().iter().map(|row| row.row_values[0]);
    values().fold(f32::MIN, f32::max) > values().fold(f32::MAX, f32::min)
}

/// Longest drop-out, seconds; a motor may be off for longer.
const MAX_DROPOUT_S: f64 = 30.0;

/// Longest interval between rows at the ends of a drop-out, seconds: in longer ones a motor may have stopped.
const MAX_EDGE_S: f64 = 1.5;

/// Smallest current before and after a drop-out, as a fraction of the median.
const MIN_EDGE_FRACTION: f32 = 0.25;

/// Repairs of a battery current.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct CurrentRepair {
    /// Whether the logged current is negative.
    pub is_negated: bool,
    /// Number of rows dropped as drop-outs.
    pub dropout_count: u64,
    /// Times of the rows before and after each drop-out, or several that follow one another, seconds.
    pub dropout_intervals_s: Vec<[f64; 2]>,
}

/// Makes a current positive and drops its drop-outs: rows of exactly 0 or -1 A between rows of usual current. A current
/// of 0 throughout is that of no sensor, and dropped.
pub(super) fn repair_current(current: &mut Series<1>) -> CurrentRepair {
    let rows = current.rows();
    let mut usual: Vec<f32> = rows.iter().map(amperes).filter(|amperes| !is_placeholder(*amperes)).collect();
    if usual.is_empty() {
        *current = Series::new();
        return CurrentRepair::default();
    }
    let middle_index = usual.len() / 2;
    let median = *usual.select_nth_unstable_by(middle_index, f32::total_cmp).1;
    let (is_dropout, dropout_intervals_s) = dropouts(rows, median.abs() * MIN_EDGE_FRACTION);
    let sign = median.signum();
    for row in current.rows_mut() {
        row.row_values[0] *= sign;
    }
    // A sensor at rest may read slightly below zero.
    current.retain_rows(|index, row| !is_dropout[index] && amperes(row) >= 0.0);
    let dropout_count = is_dropout.iter().filter(|is_dropout| **is_dropout).count() as u64;
    CurrentRepair { is_negated: sign < 0.0, dropout_count, dropout_intervals_s }
}

fn amperes(row: &TimedRow<1>) -> f32 {
    row.row_values[0]
}

/// Whether a driver reports this value without a measurement.
fn is_placeholder(amperes: f32) -> bool {
    amperes == 0.0 || amperes + 1.0 == 0.0
}

/// Marks of the rows of drop-outs, and their intervals.
fn dropouts(rows: &[TimedRow<1>], min_edge_a: f32) -> (Vec<bool>, Vec<[f64; 2]>) {
    let (mut marks, mut intervals_s) = (vec![false; rows.len()], Vec::<[f64; 2]>::new());
    let mut start = 0;
    for run in rows.chunk_by(|a, b| is_placeholder(amperes(a)) == is_placeholder(amperes(b))) {
        let end = start + run.len();
        let edges = start.checked_sub(1).and_then(|before| Some((rows.get(before)?, rows.get(end)?)));
        if let (Some(first), Some(last), Some((before, after))) = (run.first(), run.last(), edges)
            && is_placeholder(amperes(first))
            && [before, after].iter().all(|edge| amperes(edge).abs() >= min_edge_a)
            && (first.t_s - before.t_s).max(after.t_s - last.t_s) <= MAX_EDGE_S
            && last.t_s - first.t_s <= MAX_DROPOUT_S
        {
            marks[start..end].fill(true);
            match intervals_s.last_mut() {
                Some([_, end_s]) if *end_s >= before.t_s => *end_s = after.t_s,
                _ => intervals_s.push([before.t_s, after.t_s]),
            }
        }
        start = end;
    }
    (marks, intervals_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Currents at 10 Hz, repaired.
    fn repaired(currents: &[f32]) -> (Vec<f32>, CurrentRepair) {
        let mut series: Series<1> =
            currents.iter().enumerate().map(|(i, amperes)| (i as f64 / 10.0, [*amperes])).collect();
        let repair = repair_current(&mut series);
        (series.rows().iter().map(amperes).collect(), repair)
    }

    #[test]
    fn a_negative_current_is_used_by_size() {
        let (currents, repair) = repaired(&[0.0, -3.0, -20.0, -25.0, 0.1, -2.0]);
        assert_eq!(currents, [0.0, 3.0, 20.0, 25.0, 2.0]);
        assert_eq!(repair, CurrentRepair { is_negated: true, ..CurrentRepair::default() });
        assert!(!repaired(&[-0.1, 0.0, 20.0]).1.is_negated);
    }

    /// A motor that stops passes lower currents, at the start and the end of a flight as well.
    #[test]
    fn dropouts_between_usual_currents_are_dropped() {
        let (currents, repair) =
            repaired(&[0.0, 0.0, 19.0, 20.0, 0.0, 0.0, 21.0, -1.0, 22.0, 3.0, 0.0, 2.0, 20.0, 0.0]);
        assert_eq!(currents, [0.0, 0.0, 19.0, 20.0, 21.0, 22.0, 3.0, 0.0, 2.0, 20.0, 0.0]);
        assert_eq!((repair.dropout_count, repair.dropout_intervals_s), (3, vec![[0.3, 0.8]]));
        let mut long = vec![20.0; 400];
        long[20..380].fill(0.0);
        assert_eq!(repaired(&long).1.dropout_count, 0);
    }

    #[test]
    fn no_current_is_logged_if_all_rows_are_zero() {
        for currents in [&[0.0; 5][..], &[-1.0, 0.0, -1.0], &[]] {
            assert!(repaired(currents).0.is_empty(), "{currents:?}");
        }
    }
}
