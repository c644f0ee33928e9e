//! Candidates for the cause of a disturbance: loads that are logged, and motions of the aircraft.

use super::output_role::{OutputRole, output_role};
use crate::log::time_series::Series;
use crate::log::{LoadSource, LoggedFlight};
use crate::numbers::quantile;
use crate::replay::row::ReplayRow;

/// Longest interval between rows of a load, seconds; telemetry has one a second.
const MAX_GAP_S: f64 = 3.0;

/// Smallest fraction of the rows with a value.
const MIN_COVERED_FRACTION: f64 = 0.8;

/// A load, or all of one kind together, at the rows.
pub(super) struct LoadCandidate {
    /// Sources of the load.
    pub sources: Vec<LoadSource>,
    /// Sum of the currents, amperes, or mean of the commands.
    pub values: Vec<f64>,
}

impl LoadCandidate {
    /// Whether the values are currents.
    pub fn is_current(&self) -> bool {
        self.sources.iter().all(|source| source.is_current())
    }

    /// Value that a size refers to: a high current, or the range of a command.
    pub fn reference_value(&self) -> f64 {
        const HIGH_FRACTION: f64 = 0.95;
        if self.is_current() { quantile(self.values.iter().copied(), HIGH_FRACTION).unwrap_or(f64::NAN) } else { 1.0 }
    }
}

/// All loads. Those of one kind are one: motors of a hover work too alike to be told apart.
pub(super) fn load_candidates(flight: &LoggedFlight, rows: &[ReplayRow]) -> Vec<LoadCandidate> {
    let battery = (LoadSource::Battery(1), &flight.battery_current);
    let logged = flight.loads.iter().map(|load| (load.source, &load.values));
    let mut candidates: Vec<LoadCandidate> = Vec::new();
    for (source, series) in std::iter::once(battery).chain(logged) {
        let Some(values) = values_at_rows(series, rows) else { continue };
        match candidates.iter_mut().find(|other| is_same_kind(flight, other.sources[0], source)) {
            Some(same) => {
                same.sources.push(source);
                same.values.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
            }
            None => candidates.push(LoadCandidate { sources: vec![source], values }),
        }
    }
    for candidate in candidates.iter_mut().filter(|candidate| !candidate.is_current()) {
        let count = candidate.sources.len() as f64;
        candidate.values.iter_mut().for_each(|sum| *sum /= count);
    }
    candidates
}

fn is_same_kind(flight: &LoggedFlight, one: LoadSource, other: LoadSource) -> bool {
    match (one, other) {
        (LoadSource::Battery(_), LoadSource::Battery(_))
        | (LoadSource::Esc(_), LoadSource::Esc(_))
        | (LoadSource::Motor(_), LoadSource::Motor(_)) => true,
        (LoadSource::Output(one), LoadSource::Output(other)) => {
            [one, other].iter().all(|output| output_role(flight, *output) == OutputRole::Motor)
        }
        _ => false,
    }
}

/// Name of loads of one kind: `motors (outputs 1 and 4)`.
pub(super) fn load_name(flight: &LoggedFlight, sources: &[LoadSource]) -> String {
    let numbers: Vec<String> = sources.iter().map(|source| source.number().to_string()).collect();
    let (count, list) = (numbers.len(), joined_with_and(&numbers));
    let plural = if count == 1 { "" } else { "s" };
    match sources[0] {
        LoadSource::Battery(1) if count == 1 => "battery current".to_owned(),
        LoadSource::Battery(_) if count == 1 => format!("current of battery {list}"),
        LoadSource::Battery(_) => format!("currents of batteries {list}"),
        LoadSource::Esc(_) => format!("current{plural} of motor{plural} {list}"),
        LoadSource::Motor(_) => format!("motor{plural} {list}"),
        LoadSource::Throttle => "throttle".to_owned(),
        LoadSource::Output(output) => match output_role(flight, output) {
            OutputRole::Motor => format!("motor{plural} (output{plural} {list})"),
            OutputRole::Servo(servo) => format!("{servo} (output {list})"),
            OutputRole::Unknown => format!("output {list}"),
        },
    }
}

fn joined_with_and(words: &[String]) -> String {
    match words {
        [first @ .., last] if !first.is_empty() => format!("{} and {last}", first.join(", ")),
        _ => words.concat(),
    }
}

/// Values of a load at the rows; rows without one have the mean. None if too many have none.
fn values_at_rows(values: &Series<1>, rows: &[ReplayRow]) -> Option<Vec<f64>> {
    let found: Vec<Option<f64>> =
        rows.iter().map(|row| values.interpolate_or_hold(row.t_s, MAX_GAP_S).map(|[value]| f64::from(value))).collect();
    let known: Vec<f64> = found.iter().copied().flatten().collect();
    let mean = known.iter().sum::<f64>() / known.len() as f64;
    (known.len() as f64 >= MIN_COVERED_FRACTION * rows.len() as f64)
        .then(|| found.into_iter().map(|value| value.unwrap_or(mean)).collect())
}

/// Number of half waves in the flight, and of steps, that a load is compared with.
const SLOW_CHANGES: u8 = 9;

/// Motions of the aircraft, and slow changes, at the rows: errors of the attitude, and iron that moves, follow them. A load is named only if
/// it explains the field better than each of them.
pub(super) fn motion_candidates(rows: &[ReplayRow]) -> Vec<Vec<f64>> {
    /// Smallest cosine of the bank in the load factor.
    const MIN_COSINE: f64 = 0.2;
    let motions: [fn(&ReplayRow) -> f64; 7] = [
        |row| libm::cos(f64::from(row.attitude.roll_rad)).max(MIN_COSINE).recip(),
        |row| f64::from(row.attitude.roll_rad),
        |row| f64::from(row.attitude.pitch_rad),
        |row| row.rates_rad_s.map_or(0.0, |[p, ..]| f64::from(p)),
        |row| row.rates_rad_s.map_or(0.0, |[_, q, _]| f64::from(q)),
        |row| row.rates_rad_s.map_or(0.0, |[.., r]| f64::from(r)),
        |row| row.rates_rad_s.map_or(0.0, |[.., r]| f64::from(r.abs())),
    ];
    let mut candidates: Vec<Vec<f64>> = motions.iter().map(|motion| rows.iter().map(motion).collect()).collect();
    let (from_s, to_s) = (rows.first().map_or(0.0, |row| row.t_s), rows.last().map_or(1.0, |row| row.t_s));
    // Slow changes of any shape, and steps that were not found.
    for part in 1..=SLOW_CHANGES {
        let fraction = |row: &ReplayRow| (row.t_s - from_s) / (to_s - from_s);
        let phase = |row: &ReplayRow| f64::from(part) * std::f64::consts::PI * fraction(row);
        candidates.push(rows.iter().map(|row| libm::cos(phase(row))).collect());
        let step_at = f64::from(part) / f64::from(SLOW_CHANGES + 1);
        candidates.push(rows.iter().map(|row| f64::from(u8::from(fraction(row) > step_at))).collect());
    }
    candidates
}
