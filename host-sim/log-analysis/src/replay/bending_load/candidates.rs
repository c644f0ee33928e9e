//! Candidates for the cause of a disturbance: loads that are logged, and motions of the aircraft.

use crate::log::time_series::Series;
use crate::log::{AutopilotKind, LoadSource, LoggedFlight};
use crate::numbers::{mean, quantile};
use crate::replay::row::ReplayRow;

/// Longest interval between rows of a load, seconds; telemetry has one a second.
const MAX_GAP_S: f64 = 3.0;

/// Smallest fraction of the rows with a value.
const MIN_COVERED_FRACTION: f64 = 0.8;

/// Largest number of motors whose pairs are candidates.
const MAX_PAIRED_MOTORS: usize = 8;

/// A load, or several together, at the rows.
pub(super) struct LoadCandidate {
    /// Sources of the load.
    pub sources: Vec<LoadSource>,
    /// Sum of the currents, amperes, or mean of the commands.
    pub values: Vec<f64>,
    /// All loads of its kind, such as all motors; none if there is no other.
    pub family: Vec<LoadSource>,
}

impl LoadCandidate {
    /// Value that a size refers to: a high current, or the range of a command.
    pub fn reference_value(&self) -> f64 {
        const HIGH_FRACTION: f64 = 0.95;
        if self.sources.iter().all(|source| source.is_current()) {
            quantile(self.values.iter().copied(), HIGH_FRACTION).unwrap_or(f64::NAN)
        } else {
            1.0
        }
    }
}

/// All loads, and pairs and groups of loads of one kind.
pub(super) fn load_candidates(flight: &LoggedFlight, rows: &[ReplayRow]) -> Vec<LoadCandidate> {
    let battery = (LoadSource::Battery(1), &flight.battery_current);
    let logged = flight.loads.iter().map(|(source, values)| (*source, values));
    let single: Vec<(LoadSource, Vec<f64>)> = std::iter::once(battery)
        .chain(logged)
        .filter_map(|(source, values)| Some((source, values_at_rows(values, rows)?)))
        .collect();
    let families: [Vec<LoadSource>; 4] = [
        sources_of(&single, |source| matches!(source, LoadSource::Battery(_))),
        sources_of(&single, |source| matches!(source, LoadSource::Esc(_))),
        sources_of(&single, |source| matches!(source, LoadSource::Motor(_))),
        sources_of(&single, |source| is_motor_output(flight, source)),
    ];
    let mut groups: Vec<Vec<LoadSource>> = single.iter().map(|(source, _)| vec![*source]).collect();
    groups.extend(families.iter().flat_map(|family| groups_of(flight, family)));
    groups
        .into_iter()
        .map(|sources| {
            let members: Vec<&Vec<f64>> = sources
                .iter()
                .filter_map(|source| Some(&single.iter().find(|(other, _)| other == source)?.1))
                .collect();
            let divisor = if sources.iter().all(|source| source.is_current()) { 1.0 } else { members.len() as f64 };
            let values =
                (0..rows.len()).map(|i| members.iter().map(|values| values[i]).sum::<f64>() / divisor).collect();
            let family = families.iter().find(|family| family.len() > 1 && family.contains(&sources[0]));
            LoadCandidate { sources, values, family: family.cloned().unwrap_or_default() }
        })
        .collect()
}

fn sources_of(single: &[(LoadSource, Vec<f64>)], is_member: impl Fn(LoadSource) -> bool) -> Vec<LoadSource> {
    single.iter().map(|(source, _)| *source).filter(|source| is_member(*source)).collect()
}

fn is_motor_output(flight: &LoggedFlight, source: LoadSource) -> bool {
    matches!(source, LoadSource::Output(output)
        if matches!(output_role(flight, output), OutputRole::Motor(_) | OutputRole::Throttle(_)))
}

/// Pairs of a family, its sides, and all of it.
fn groups_of(flight: &LoggedFlight, family: &[LoadSource]) -> Vec<Vec<LoadSource>> {
    let mut groups = Vec::new();
    if family.len() <= MAX_PAIRED_MOTORS {
        for (i, one) in family.iter().enumerate() {
            groups.extend(family.iter().skip(i + 1).map(|other| vec![*one, *other]));
        }
    }
    for side in ["left ", "right ", "front ", "rear "] {
        groups.push(family.iter().copied().filter(|source| common_side(&[place(flight, *source)]) == side).collect());
    }
    groups.push(family.to_vec());
    groups.retain(|group: &Vec<LoadSource>| group.len() >= 2);
    groups.sort();
    groups.dedup();
    groups
}

/// Place of the motor of a load.
fn place(flight: &LoggedFlight, source: LoadSource) -> Option<[f64; 2]> {
    let motor_of_output = |output: u8| match output_role(flight, output) {
        OutputRole::Motor(motor) => Some(motor),
        _ => None,
    };
    let motor = match source {
        LoadSource::Motor(motor) => Some(motor),
        LoadSource::Output(output) => motor_of_output(output),
        LoadSource::Esc(esc) => motor_of_output(esc).or(Some(esc)),
        LoadSource::Battery(_) | LoadSource::Throttle => None,
    };
    motor_place(flight, motor?)
}

/// Name of loads of one kind: `right motors (outputs 1 and 4)`.
pub(super) fn load_name(flight: &LoggedFlight, sources: &[LoadSource]) -> String {
    let places: Vec<_> = sources.iter().map(|source| place(flight, *source)).collect();
    let side = common_side(&places);
    let numbers: Vec<String> = sources.iter().map(|source| source.number().to_string()).collect();
    let (count, list) = (numbers.len(), joined_with_and(&numbers));
    let plural = if count == 1 { "" } else { "s" };
    match sources[0] {
        LoadSource::Battery(1) if count == 1 => "battery current".to_owned(),
        LoadSource::Battery(_) if count == 1 => format!("current of battery {list}"),
        LoadSource::Battery(_) => format!("currents of batteries {list}"),
        LoadSource::Esc(_) => format!("current{plural} of {side}motor{plural} {list}"),
        LoadSource::Motor(_) => format!("{side}motor{plural} {list}"),
        LoadSource::Throttle => "throttle".to_owned(),
        LoadSource::Output(output) => match output_role(flight, output) {
            OutputRole::Motor(_) => format!("{side}motor{plural} (output{plural} {list})"),
            OutputRole::Throttle(_) if count > 1 => format!("motors (outputs {list})"),
            OutputRole::Throttle("") => format!("throttle (output {list})"),
            OutputRole::Throttle(throttle_side) => format!("{throttle_side}motor (output {list})"),
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
    let known = found.iter().copied().flatten();
    let mean = mean(known.clone());
    (known.count() as f64 >= MIN_COVERED_FRACTION * rows.len() as f64)
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

/// Role of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OutputRole {
    /// Motor of this number.
    Motor(u8),
    /// Motor of an aeroplane, on this side.
    Throttle(&'static str),
    /// Servo with this name.
    Servo(&'static str),
    /// Unknown.
    Unknown,
}

/// Role of an output numbered from 1.
pub(super) fn output_role(flight: &LoggedFlight, output: u8) -> OutputRole {
    let function = |name: String| flight.parameters.last_value(&name).map(|function| function.round() as i32);
    let function = match flight.autopilot {
        AutopilotKind::Px4 => function(format!("PWM_MAIN_FUNC{output}")).map(px4_role),
        _ => function(format!("SERVO{output}_FUNCTION")).map(ardupilot_role),
    };
    match function {
        Some(role) => role,
        // Without parameters: the first four outputs of a copter are motors; further ones may be a gimbal's.
        None if flight.is_copter && output <= 4 => OutputRole::Motor(output),
        None => OutputRole::Unknown,
    }
}

/// `SERVOn_FUNCTION` (`SRV_Channel::Function`).
const fn ardupilot_role(function: i32) -> OutputRole {
    match function {
        33..=40 => OutputRole::Motor((function - 32) as u8),
        82..=85 => OutputRole::Motor((function - 73) as u8),
        70 => OutputRole::Throttle(""),
        73 => OutputRole::Throttle("left "),
        74 => OutputRole::Throttle("right "),
        2 | 3 => OutputRole::Servo("flap"),
        4 => OutputRole::Servo("aileron"),
        19 => OutputRole::Servo("elevator"),
        21 => OutputRole::Servo("rudder"),
        26 => OutputRole::Servo("steering"),
        77 => OutputRole::Servo("left elevon"),
        78 => OutputRole::Servo("right elevon"),
        79 => OutputRole::Servo("left V-tail"),
        80 => OutputRole::Servo("right V-tail"),
        _ => OutputRole::Unknown,
    }
}

/// `PWM_MAIN_FUNCn` (`mixer_module/output_functions.yaml`).
const fn px4_role(function: i32) -> OutputRole {
    match function {
        101..=112 => OutputRole::Motor((function - 100) as u8),
        201..=208 => OutputRole::Servo("servo"),
        _ => OutputRole::Unknown,
    }
}

/// Place of a motor numbered from 1, forward and right, of any scale.
pub(super) fn motor_place(flight: &LoggedFlight, motor: u8) -> Option<[f64; 2]> {
    let value = |name: &str| flight.parameters.last_value(name);
    let index = motor.checked_sub(1)?;
    if flight.autopilot == AutopilotKind::Px4 {
        let [forward, right] = ["PX", "PY"].map(|axis| value(&format!("CA_ROTOR{index}_{axis}")));
        return Some([forward?, right?]);
    }
    let prefixed = |name: &str| value(name).or_else(|| value(&format!("Q_{name}"))).map(|number| number.round() as i32);
    let angles_deg = motor_angles_deg(prefixed("FRAME_CLASS")?, prefixed("FRAME_TYPE")?);
    let (right, forward) = libm::sincos(angles_deg.get(usize::from(index))?.to_radians());
    Some([forward, right])
}

/// Directions of the motors from the nose, clockwise, by frame class and type (`AP_MotorsMatrix`); empty if unknown.
const fn motor_angles_deg(class: i32, frame_type: i32) -> &'static [f64] {
    match (class, frame_type) {
        (1, 0) => &[90.0, -90.0, 0.0, 180.0],
        (1, 1..=3) => &[45.0, -135.0, -45.0, 135.0],
        (1, 12 | 18) => &[135.0, 45.0, -135.0, -45.0],
        (1, 13) => &[45.0, -45.0, -135.0, 135.0],
        (1, 14) => &[45.0, 135.0, -135.0, -45.0],
        (2, 0) => &[0.0, 180.0, -120.0, 60.0, -60.0, 120.0],
        (2, 1) => &[90.0, -90.0, -30.0, 150.0, 30.0, -150.0],
        (3, 0) => &[0.0, 180.0, 45.0, 135.0, -45.0, -135.0, -90.0, 90.0],
        (3, 1) => &[22.5, -157.5, 67.5, 157.5, -22.5, -112.5, -67.5, 112.5],
        _ => &[],
    }
}

/// Side that all places are on, with a space after it; empty if none.
pub(super) fn common_side(places: &[Option<[f64; 2]>]) -> &'static str {
    /// A motor on an axis is on neither side, despite rounding.
    const MARGIN: f64 = 0.05;
    let all = |is_there: fn([f64; 2]) -> bool| places.iter().all(|place| place.is_some_and(is_there));
    if all(|[_, right]| right > MARGIN) {
        "right "
    } else if all(|[_, right]| right < -MARGIN) {
        "left "
    } else if all(|[forward, _]| forward > MARGIN) {
        "front "
    } else if all(|[forward, _]| forward < -MARGIN) {
        "rear "
    } else {
        ""
    }
}
