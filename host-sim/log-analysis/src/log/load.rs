//! Loads beside the first battery's current: outputs and currents that may bend the field of a compass.

use std::collections::BTreeMap;

use super::battery_current::repair_current;
use super::time_series::Series;

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
    #[must_use]
    pub const fn is_current(self) -> bool {
        matches!(self, Self::Battery(_) | Self::Esc(_))
    }

    /// Number of the battery, motor or output; 1 of the throttle.
    #[must_use]
    pub const fn number(self) -> u8 {
        match self {
            Self::Battery(number) | Self::Esc(number) | Self::Motor(number) | Self::Output(number) => number,
            Self::Throttle => 1,
        }
    }
}

/// A load with its rows.
#[derive(Clone, Debug, PartialEq)]
pub struct LoggedLoad {
    /// Source of the load.
    pub source: LoadSource,
    /// Current in amperes, or command from 0 to 1.
    pub values: Series<1>,
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

    /// The loads that vary, in their units.
    pub fn into_loads(self) -> Vec<LoggedLoad> {
        let loads = self.0.into_iter().map(|(source, mut values)| {
            values.sort_and_dedup();
            if source.is_current() {
                repair_current(&mut values);
            } else {
                scale_to_fraction(source, &mut values);
            }
            LoggedLoad { source, values }
        });
        loads.filter(|load| varies(&load.values)).collect()
    }
}

/// Scales percent of the throttle and pulses of outputs to fractions, and drops the pulses of outputs not in use.
fn scale_to_fraction(source: LoadSource, values: &mut Series<1>) {
    let largest = values.rows().iter().map(|row| row.row_values[0]).fold(0.0, f32::max);
    if largest <= MAX_FRACTION {
        return;
    }
    let is_throttle = source == LoadSource::Throttle;
    let is_used: Vec<bool> = values.rows().iter().map(|row| is_throttle || row.row_values[0] >= MIN_PULSE_US).collect();
    values.retain_rows(|index| is_used[index]);
    for row in values.rows_mut() {
        let [value] = row.row_values;
        row.row_values = [if is_throttle { value / 100.0 } else { (value - PULSE_US[0]) / PULSE_US[1] }];
    }
}

fn varies(values: &Series<1>) -> bool {
    let values = || values.rows().iter().map(|row| row.row_values[0]);
    values().fold(f32::MIN, f32::max) > values().fold(f32::MAX, f32::min)
}
