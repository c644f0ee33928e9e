//! From a logged flight to rows of common instants: the field of a compass, and attitude and body rates when it was.

use autoswing::attitude::{Motion, Report, Source};
use autoswing::frames::{Attitude, Field, Sensor, wrap_pi};
use autoswing::time::WrappingMillis;
use nalgebra::Vector3;
use serde::Serialize;

use super::dead::standing_still;
use super::lost;
use super::reference::Reference;
use crate::log::series::{Series, Stamped};
use crate::log::{Compass, Flight, Iron};

/// Attitudes further apart than this are not interpolated between, seconds: a source of 3 Hz that lost one.
const MAX_GAP_S: f64 = 0.7;

/// Readings of so long are one row, seconds, as the module averages ten a second; a little less, for clocks that jitter.
const ROW_S: f64 = 0.09;

/// Where rates and attitudes contradict each other by more than this, radians, rates are left out.
const MAX_BULGE_RAD: f32 = 0.1;

/// A tilt cannot change by more than the body turns: what does so is a filter that still aligns, or jumps. Body rates are
/// those of single instants, so twice their integral and this is allowed in this time.
const SPARE_RAD: f32 = 0.035;
const SPARE_TIMES: f32 = 2.0;
const WITHIN_S: f64 = 1.0;

/// A filter that aligns does so after a start, and until the last such change, seconds.
const ALIGNING_S: f64 = 60.0;

/// One row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Seconds on the flight's time line, the field's age taken off.
    pub t_s: f64,
    /// The raw field; what is the chip's axes for the module are body axes here.
    pub field: Field<Sensor>,
    /// The field as the autopilot corrected it, body axes.
    pub logged: Field<Sensor>,
    /// The attitude as the autopilot logged it, at that instant.
    pub attitude: Attitude,
    /// Body rates p, q, r at that instant, rad/s, where there are any.
    pub rates_rad_s: Option<[f32; 3]>,
    /// Current of the battery at that instant, amperes, where it is known.
    pub current_a: Option<f32>,
    /// Whether the row may be fitted to and scored.
    pub usable: bool,
    /// A reference heading in degrees, from any north, where there is one.
    pub reference_deg: Option<f64>,
}

/// Attitude and body rates at an instant between two rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// Seconds on the flight's time line.
    pub t_s: f64,
    /// The attitude as the autopilot logged it.
    pub attitude: Attitude,
    /// Body rates p, q, r, rad/s, where there are any.
    pub rates_rad_s: Option<[f32; 3]>,
}

/// What an autopilot tells of its attitude between two rows that are further apart than most logs have them: ten times a
/// second, as it does to a module however rarely it logs the field. Without it body rates are integrated over steps in
/// which a turn begins and ends, and the module believes that its iron has moved.
#[must_use]
pub fn told_between(flight: &Flight, from_s: f64, to_s: f64) -> Vec<Told> {
    const EVERY_S: f64 = 0.1;
    /// A longer pause is one of the log, too.
    const MAX_PAUSE_S: f64 = 5.0;
    let pause_s = to_s - from_s;
    if !(1.5 * EVERY_S..=MAX_PAUSE_S).contains(&pause_s) {
        return Vec::new();
    }
    let steps = (pause_s / EVERY_S).round();
    let instants = (1..steps as u32).map(|step| from_s + pause_s * f64::from(step) / steps);
    let told = |t_s| attitude_at(flight, t_s).map(|(attitude, rates_rad_s)| Told { t_s, attitude, rates_rad_s });
    instants.filter_map(told).collect()
}

/// How many rows there are, and what became of the others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counted {
    /// Readings of the field in the log.
    pub readings: usize,
    /// Rows that may be fitted to.
    pub used: usize,
    /// Readings without an attitude around them.
    pub without_attitude: usize,
    /// Readings while the attitude changed without body rates: a filter that aligns, or jumps.
    pub unsettled: usize,
    /// Rows while it was not armed.
    pub disarmed: usize,
    /// Rows before it first moved and after it last did, where iron that is not the aircraft's may be near.
    pub on_the_ground: usize,
    /// Rows that the log itself keeps out.
    pub kept_out: usize,
    /// Rows while the field stood still though the aircraft moved: a sensor that died.
    pub stuck: usize,
}

impl Counted {
    /// How many were rejected for each cause, and the cause in words.
    const fn by_cause(&self) -> [(usize, &'static str); 6] {
        [
            (self.disarmed, "disarmed"),
            (self.on_the_ground, "on the ground"),
            (self.without_attitude, "without an attitude near it"),
            (self.unsettled, "while the attitude was settling"),
            (self.stuck, "with a field that stands still"),
            (self.kept_out, "kept out by the log"),
        ]
    }

    /// What was rejected, and why, in words; nothing where nothing was.
    #[must_use]
    pub fn rejected(&self) -> Vec<String> {
        let by_cause = self.by_cause();
        by_cause.iter().filter(|(number, _)| *number > 0).map(|(number, why)| format!("{number} {why}")).collect()
    }

    /// For which cause most were rejected, and how many.
    pub(super) fn most_rejected(&self) -> (usize, &'static str) {
        self.by_cause().into_iter().max_by_key(|&(number, _)| number).unwrap_or_default()
    }
}

/// Rows of a compass whose logged field is so old at its own time stamp, seconds.
#[must_use]
pub fn rows(flight: &Flight, compass: &Compass, age_s: f64, reference: Option<&Reference>) -> (Vec<Row>, Counted) {
    let mut counted = Counted { readings: compass.field.rows().len(), ..Counted::default() };
    // Of a log in which it never was, nothing follows from that.
    let was_armed = compass.field.rows().iter().any(|row| flight.is_armed(row.t_s - age_s) == Some(true));
    let unsettled = unsettled(flight);
    let gap_s = lost::longest_gap_s(flight, MAX_GAP_S);
    let mut rows = Vec::new();
    let mut run = Run::default();
    for reading in compass.field.rows() {
        let t_s = reading.t_s - age_s;
        let known = attitude_at(flight, t_s).filter(|_| flight.attitude.between(t_s, gap_s).is_some());
        let Some((attitude, rates)) = known else {
            counted.without_attitude += 1;
            continue;
        };
        if unsettled.iter().any(|&[from_s, to_s]| (from_s..=to_s).contains(&t_s)) {
            counted.unsettled += 1;
            continue;
        }
        if run.number > 0 && t_s - run.first_s >= ROW_S {
            rows.push(run.row(flight, reference));
            run = Run::default();
        }
        run.add(t_s, reading, attitude, rates);
    }
    if run.number > 0 {
        rows.push(run.row(flight, reference));
    }
    let [moved_s, stopped_s] = moved(flight);
    for row in &mut rows {
        let is_kept_out = flight.usable.around(row.t_s + age_s + 1e-6).0.is_some_and(|said| said.of[0] == 0.0);
        let is_disarmed = was_armed && flight.is_armed(row.t_s) == Some(false);
        let is_on_the_ground = row.t_s < moved_s || row.t_s > stopped_s;
        row.usable = !is_kept_out && !is_disarmed && !is_on_the_ground;
        counted.kept_out += usize::from(is_kept_out);
        counted.disarmed += usize::from(is_disarmed && !is_kept_out);
        counted.on_the_ground += usize::from(is_on_the_ground && !is_disarmed && !is_kept_out);
    }
    for [from_s, to_s] in standing_still(&rows) {
        for row in rows.iter_mut().filter(|row| row.usable && (from_s..=to_s).contains(&row.t_s)) {
            row.usable = false;
            counted.stuck += 1;
        }
    }
    counted.used = rows.iter().filter(|row| row.usable).count();
    (rows, counted)
}

/// Readings that become a row.
#[derive(Default)]
struct Run {
    number: u16,
    first_s: f64,
    t_s: f64,
    raw: [f32; 3],
    logged: [f32; 3],
    first_roll_rad: f32,
    roll_rad: f32,
    pitch_rad: f32,
    rates: [f32; 3],
    rates_number: u16,
}

impl Run {
    fn add(&mut self, t_s: f64, reading: &Stamped<6>, attitude: Attitude, rates: Option<[f32; 3]>) {
        if self.number == 0 {
            (self.first_s, self.first_roll_rad) = (t_s, attitude.roll_rad);
        }
        self.number += 1;
        self.t_s += t_s - self.first_s;
        let [x, y, z, cx, cy, cz] = reading.of;
        for (sum, axis) in self.raw.iter_mut().chain(&mut self.logged).zip([x, y, z, cx, cy, cz]) {
            *sum += axis;
        }
        self.roll_rad += wrap_pi(attitude.roll_rad - self.first_roll_rad);
        self.pitch_rad += attitude.pitch_rad;
        if let Some(rates) = rates {
            self.rates_number += 1;
            for (sum, rate) in self.rates.iter_mut().zip(rates) {
                *sum += rate;
            }
        }
    }

    fn row(&self, flight: &Flight, reference: Option<&Reference>) -> Row {
        let number = f32::from(self.number);
        let field = |sum: [f32; 3]| {
            let [x, y, z] = sum.map(|axis| axis / number);
            Field::from_ut(x, y, z)
        };
        let t_s = self.first_s + self.t_s / f64::from(number);
        let attitude = Attitude {
            roll_rad: wrap_pi(self.first_roll_rad + self.roll_rad / number),
            pitch_rad: self.pitch_rad / number,
        };
        let rates = self.rates.map(|sum| sum / f32::from(self.rates_number.max(1)));
        Row {
            t_s,
            field: field(self.raw),
            logged: field(self.logged),
            attitude,
            rates_rad_s: (self.rates_number > 0).then_some(rates),
            current_a: current_at(flight, t_s),
            usable: true,
            reference_deg: reference.and_then(|reference| reference.at_deg(flight, t_s)),
        }
    }
}

/// Current at an instant, amperes, between two that were told, or soon after the last.
fn current_at(flight: &Flight, t_s: f64) -> Option<f32> {
    /// A battery is told of once a second or oftener.
    const MAX_GAP_S: f64 = 3.0;
    flight.current.held_at(t_s, MAX_GAP_S).map(|[amperes]| amperes)
}

impl Row {
    /// The field by a correction, microtesla: where no current is known, as if none flowed.
    #[must_use]
    pub fn corrected(&self, iron: &Iron) -> Vector3<f64> {
        iron.apply(self.field.ut.map(f64::from), self.current_a.map_or(0.0, f64::from))
    }
}

/// When it first and last moved over ground, seconds; all the time where nothing says that it did.
fn moved(flight: &Flight) -> [f64; 2] {
    /// More than a receiver at rest says, m/s.
    const MOVING_M_S: f32 = 3.0;
    /// For less than this, seconds, it was no flight.
    const LONG_S: f64 = 20.0;
    let moving = || flight.gps.rows().iter().filter(|row| row.of[3] > MOVING_M_S).map(|row| row.t_s);
    match (moving().next(), moving().next_back()) {
        (Some(from_s), Some(to_s)) if to_s - from_s > LONG_S => [from_s, to_s],
        _ => [f64::NEG_INFINITY, f64::INFINITY],
    }
}

/// When the attitude changed as no body does, from and to, seconds.
fn unsettled(flight: &Flight) -> Vec<[f64; 2]> {
    let rows = flight.attitude.rows();
    let mut found: Vec<[f64; 2]> = Vec::new();
    // The time since which a filter may be aligning: the last start or gap.
    let (mut started_s, mut first) = (rows.first().map_or(0.0, |row| row.t_s), 0);
    let mut turned_rad = vec![0.0_f64; rows.len()];
    for last in 1..rows.len() {
        let (before, row) = (&rows[last - 1], &rows[last]);
        let step_s = row.t_s - before.t_s;
        if step_s > WITHIN_S {
            (started_s, first) = (row.t_s, last);
        }
        let rate = |at_s: f64| flight.rates.at(at_s, MAX_GAP_S).map(|[p, q, r]| p.hypot(q).hypot(r));
        let Some(rate) = rate(before.t_s).zip(rate(row.t_s)).map(|(from, to)| from.max(to)) else {
            (started_s, first) = (row.t_s, last);
            continue;
        };
        turned_rad[last] = turned_rad[last - 1] + f64::from(rate) * step_s;
        while rows[first].t_s < row.t_s - WITHIN_S {
            first += 1;
        }
        let turned = (turned_rad[last] - turned_rad[first]) as f32;
        if tilted_rad(&rows[first], row) > SPARE_TIMES * turned + SPARE_RAD {
            let is_aligning = row.t_s - started_s < ALIGNING_S;
            let from_s = if is_aligning { started_s } else { rows[first].t_s };
            match found.last_mut().filter(|[_, to_s]| *to_s >= from_s) {
                Some(span) => *span = [span[0].min(from_s), row.t_s],
                None => found.push([from_s, row.t_s]),
            }
        }
    }
    found
}

/// By how much the direction of down differs, in body axes.
fn tilted_rad(a: &Stamped<3>, b: &Stamped<3>) -> f32 {
    let down = |row: &Stamped<3>| {
        let ([sin_roll, sin_pitch], [cos_roll, cos_pitch]) =
            ([row.of[0].sin(), row.of[1].sin()], [row.of[0].cos(), row.of[1].cos()]);
        Vector3::new(-sin_pitch, sin_roll * cos_pitch, cos_roll * cos_pitch)
    };
    down(a).angle(&down(b))
}

/// Roll and pitch at an instant, and the body rates: between two attitudes on the cubic that has their angles and, where
/// there are body rates, their motions.
fn attitude_at(flight: &Flight, t_s: f64) -> Option<(Attitude, Option<[f32; 3]>)> {
    let (before, after, part) = flight.attitude.between(t_s, MAX_GAP_S)?;
    let rates = flight.rates.at(t_s, MAX_GAP_S);
    let step_s = (after.t_s - before.t_s) as f32;
    let part = part as f32;
    let motions = motion_at(&flight.rates, before).zip(motion_at(&flight.rates, after));
    let [roll_rad, pitch_rad] = [0, 1].map(|angle| {
        let turned = wrap_pi(after.of[angle] - before.of[angle]);
        let straight = part * turned;
        let bulge = motions.map_or(0.0, |(from, to)| {
            let of = |motion: &Motion| if angle == 0 { motion.roll_rad_s } else { motion.pitch_rad_s };
            let (rest, left) = (of(&from) * step_s - turned, turned - of(&to) * step_s);
            part * (1.0 - part) * ((1.0 - part) * rest + part * left)
        });
        before.of[angle] + straight + if bulge.abs() <= MAX_BULGE_RAD { bulge } else { 0.0 }
    });
    Some((Attitude { roll_rad: wrap_pi(roll_rad), pitch_rad }, rates))
}

/// How the angles of a logged attitude change.
fn motion_at(rates: &Series<3>, at: &Stamped<3>) -> Option<Motion> {
    let [roll_rad, pitch_rad, _] = at.of;
    let rates_rad_s = rates.at(at.t_s, MAX_GAP_S)?;
    let (source, sender_time) = (Source::default(), WrappingMillis::default());
    Motion::of(&Report { source, sender_time, attitude: Attitude { roll_rad, pitch_rad }, rates_rad_s })
}

/// The time from one row to the next, as most are, seconds; none of a single row.
pub(super) fn median_step_s(rows: &[Row]) -> Option<f64> {
    let mut steps_s: Vec<f64> = rows.windows(2).map(|pair| pair[1].t_s - pair[0].t_s).collect();
    steps_s.sort_by(f64::total_cmp);
    steps_s.get(steps_s.len() / 2).copied()
}

#[cfg(test)]
mod tests;
