//! From the messages of a log to a [`Flight`].

use std::collections::BTreeMap;

use autoswing::earth::Day;
use nalgebra::Vector3;

use super::correction::{Iron, Undo, px4_mounting};
use super::flight::{Autopilot, Compass, Flight, Format, Gps};
use super::series::Series;
use super::timeline::Timeline;

/// No autopilot has more compasses; what a file says beyond is passed over.
pub const MAX_COMPASSES: u8 = 8;

/// What is stronger is no field in whatever unit, microtesla: nanotesla that are taken for microtesla are read, and told.
const MAX_FIELD_UT: f32 = 200_000.0;

/// How often it may be armed and disarmed.
const MAX_ARMED: usize = 100_000;

/// What becomes a flight, as it is read.
pub struct Recorder {
    pub flight: Flight,
    pub timeline: Timeline,
    /// What the gyros read at rest, as the autopilot's filter has it.
    pub gyro_bias_rad_s: [f32; 3],
    /// Attitudes by the rank of who says them, the best first: one stands in where the autopilot's own is not logged.
    stand_ins: BTreeMap<u8, (&'static str, Series<3>)>,
    /// What is logged of each compass: the field, microtesla, and what the motors' share of it is.
    logged: Vec<(u8, Logged, Series<6>)>,
}

/// What a logged field has been through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Logged {
    /// ArduPilot's correction.
    ArduPilot,
    /// PX4's correction; by the parameters of this index.
    Px4(u8),
    /// Nothing, and is in the axes of a sensor of PX4's with parameters of this index.
    Px4Raw(u8),
    /// Nothing, in body axes.
    Raw,
}

impl Recorder {
    pub fn new(format: Format) -> Self {
        Self {
            flight: Flight::new(format),
            timeline: Timeline::default(),
            gyro_bias_rad_s: [0.0; 3],
            stand_ins: BTreeMap::new(),
            logged: Vec::new(),
        }
    }

    /// A row of a compass's field in microtesla, with the motors' share if the row says it.
    pub fn field(&mut self, number: u8, was: Logged, t_s: f64, field_ut: [f32; 3], motor_ut: Option<[f32; 3]>) {
        let is_field =
            field_ut.iter().all(|axis| axis.abs() < MAX_FIELD_UT) && field_ut.iter().any(|axis| *axis != 0.0);
        if !is_field || number == 0 || number > MAX_COMPASSES {
            self.flight.counts.unhealthy += 1;
            return;
        }
        let index = self.logged.iter().position(|&(other, of, _)| (other, of) == (number, was)).unwrap_or_else(|| {
            self.logged.push((number, was, Series::new()));
            self.logged.len() - 1
        });
        let ([x, y, z], [mx, my, mz]) = (field_ut, motor_ut.unwrap_or([f32::NAN; 3]));
        self.logged[index].2.push(t_s, [x, y, z, mx, my, mz]);
    }

    /// Roll, pitch and yaw, radians.
    pub fn attitude(&mut self, t_s: f64, angles_rad: [f32; 3]) {
        if is_attitude(angles_rad) {
            self.flight.attitude.push(t_s, angles_rad);
        }
    }

    /// The same as a message says it that stands in for the autopilot's own; of several the one of the lowest rank does.
    pub fn stand_in(&mut self, rank: u8, from: &'static str, t_s: f64, angles_rad: [f32; 3]) {
        if is_attitude(angles_rad) {
            self.stand_ins.entry(rank).or_insert((from, Series::new())).1.push(t_s, angles_rad);
        }
    }

    /// Body rates, rad/s.
    pub fn rates(&mut self, t_s: f64, rates_rad_s: [f32; 3]) {
        if rates_rad_s.iter().all(|rate| rate.abs() < 100.0) {
            self.flight.rates.push(t_s, rates_rad_s);
        }
    }

    pub fn truth(&mut self, t_s: f64, angles_rad: [f32; 3]) {
        if angles_rad.iter().all(|angle| angle.is_finite()) {
            self.flight.truth.push(t_s, angles_rad);
        }
    }

    pub fn gps(&mut self, t_s: f64, gps: Gps) {
        self.flight.gps.push(t_s, gps.columns());
    }

    pub fn current(&mut self, t_s: f64, amperes: f32) {
        if (0.0..10_000.0).contains(&amperes) {
            self.flight.current.push(t_s, [amperes]);
        }
    }

    pub fn armed(&mut self, t_s: f64, is: bool) {
        let is_news = self.flight.armed.last().is_none_or(|&(_, last)| last != is);
        if is_news && self.flight.armed.len() < MAX_ARMED {
            self.flight.armed.push((t_s, is));
        }
    }

    pub fn parameter(&mut self, name: &str, value: f64) {
        self.flight.parameters.set(self.timeline.now_s(), name, value);
    }

    pub fn firmware(&mut self, name: &str) {
        let name: String = name.chars().filter(|c| !c.is_control()).take(80).collect();
        self.flight.is_copter |= name.contains("Copter");
        if !name.is_empty() {
            self.flight.firmware.get_or_insert(name);
        }
    }

    /// A Unix time, seconds.
    pub fn unix_s(&mut self, seconds: u64) {
        self.flight.day = self.flight.day.or_else(|| Day::from_unix_s(seconds));
    }

    /// Puts everything in order and undoes what the autopilot had applied.
    pub fn finish(mut self) -> Flight {
        let flight = &mut self.flight;
        flight.counts.bad_times += self.timeline.refused();
        flight.counts.restarts = self.timeline.restarts();
        if flight.attitude.is_empty()
            && let Some((_, (from, attitude))) = self.stand_ins.pop_first()
        {
            (flight.attitude, flight.attitude_from) = (attitude, Some(from));
        }
        let attitude_repeats = flight.attitude.settle();
        for series in [&mut flight.rates, &mut flight.truth] {
            series.settle();
        }
        flight.gps.settle();
        flight.current.settle();
        flight.reference.settle();
        flight.usable.settle();
        flight.counts.repeats += attitude_repeats as u64;
        for (number, was, mut field) in densest(std::mem::take(&mut self.logged)) {
            flight.counts.repeats += field.settle() as u64;
            let (iron, field) = undone(flight, number, was, field);
            let is_used = is_used(flight, number);
            flight.compasses.push(Compass { number, field, iron, is_used });
        }
        self.flight
    }
}

/// One of each compass, in their order: as the sensor has it, unless it is logged more than twice as often after its
/// correction (PX4 logs the former once a second as it comes).
fn densest(mut logged: Vec<(u8, Logged, Series<6>)>) -> Vec<(u8, Logged, Series<6>)> {
    let weight =
        |was: Logged, field: &Series<6>| field.rows().len() * if matches!(was, Logged::Px4Raw(_)) { 2 } else { 1 };
    logged.sort_by_key(|(number, was, field)| (*number, std::cmp::Reverse(weight(*was, field))));
    logged.dedup_by_key(|(number, _, _)| *number);
    logged
}

fn is_attitude([roll_rad, pitch_rad, _]: [f32; 3]) -> bool {
    roll_rad.abs() <= 7.0 && pitch_rad.abs() <= 1.6
}

/// The raw field and the autopilot's own of each row, and what the autopilot corrected with at the end.
fn undone(flight: &Flight, number: u8, was: Logged, mut field: Series<6>) -> (Option<Iron>, Series<6>) {
    let parameters = &flight.parameters;
    let at = |t_s: f64| match was {
        Logged::ArduPilot => Undo::ardupilot(parameters, t_s, number),
        Logged::Px4(index) | Logged::Px4Raw(index) => Undo::px4(parameters, t_s, index),
        Logged::Raw => Undo::ardupilot(&super::Parameters::default(), t_s, 1),
    };
    let mounting =
        if let Logged::Px4Raw(index) = was { Some(px4_mounting(parameters, f64::INFINITY, index)) } else { None };
    let prefix = if was == Logged::ArduPilot { "COMPASS_" } else { "CAL_MAG" };
    let changes_s = parameters.changes_s(prefix);
    let mut changes = changes_s.iter().peekable();
    let mut undo = at(f64::NEG_INFINITY);
    for row in field.rows_mut() {
        while changes.next_if(|&&at_s| at_s <= row.t_s).is_some() {
            undo = at(row.t_s);
        }
        let [x, y, z, mx, my, mz] = row.of.map(f64::from);
        let (logged, said) = (Vector3::new(x, y, z), Vector3::new(mx, my, mz));
        let current_a = flight.current.held_at(row.t_s, 2.0).map_or(0.0, |[amperes]| f64::from(amperes));
        let (raw, corrected) = if let Some(turned) = mounting {
            let raw = turned * logged;
            (raw, undo.iron.apply(raw, current_a))
        } else {
            let motor = if mx.is_nan() { undo.motor_ut(current_a) } else { said };
            (undo.raw(logged, motor), logged)
        };
        row.of = [raw.x, raw.y, raw.z, corrected.x, corrected.y, corrected.z].map(|number| number as f32);
    }
    let last = at(f64::INFINITY);
    ((was != Logged::Raw && !parameters.is_empty()).then_some(last.iron), field)
}

/// Whether the autopilot's heading is made with a compass, as its parameters say. PX4 takes the one of the highest priority that
/// is healthy, which no parameter tells, and none of priority 0.
fn is_used(flight: &Flight, number: u8) -> Option<bool> {
    let value = |name: String| flight.parameters.last(&name);
    match flight.autopilot {
        Autopilot::ArduPilot => {
            let index = if number == 1 { String::new() } else { number.to_string() };
            value(format!("COMPASS_USE{index}")).map(|used| used != 0.0)
        }
        Autopilot::Px4 => {
            let priority = value(format!("CAL_MAG{}_PRIO", number.saturating_sub(1)));
            priority.filter(|priority| *priority == 0.0).map(|_| false)
        }
        Autopilot::Unknown => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a meter says of nothing may be a little less, and that of a battery that gives nothing is not the motors'.
    #[test]
    fn a_current_is_not_negative() {
        let mut recorder = Recorder::new(Format::TLog);
        for (i, amperes) in [-0.1, 0.0, 9_999.0, 10_001.0, f32::NAN].into_iter().enumerate() {
            recorder.current(i as f64, amperes);
        }
        let flight = recorder.finish();
        assert_eq!(flight.current.rows().iter().map(|row| row.of[0]).collect::<Vec<_>>(), [0.0, 9_999.0]);
    }

    /// What the motors' wires add is taken off by the current that was last told, for two seconds: then none is known.
    #[test]
    fn a_current_holds_for_two_seconds() {
        let mut recorder = Recorder::new(Format::TLog);
        recorder.flight.autopilot = Autopilot::ArduPilot;
        for (name, value) in [("COMPASS_MOTCT", 2.0), ("COMPASS_MOT_X", 5.0)] {
            recorder.parameter(name, value);
        }
        recorder.current(0.0, 10.0);
        for t_s in [1.0, 1.9, 2.1, 100.0] {
            recorder.field(1, Logged::ArduPilot, t_s, [20.0, 0.0, 40.0], None);
        }
        let flight = recorder.finish();
        // 10 A of 5 mG each.
        let raw: Vec<f32> = flight.compasses[0].field.rows().iter().map(|row| row.of[0]).collect();
        assert_eq!(raw, [15.0, 15.0, 20.0, 20.0]);
    }

    /// What is stronger than any field in any unit, of no compass that there is, tilted beyond the vertical or turned faster than
    /// any gyro tells is not of this log.
    #[test]
    fn what_cannot_be_is_passed_over() {
        let mut recorder = Recorder::new(Format::TLog);
        for (number, ut) in [(1, 199_000.0), (1, 201_000.0), (1, f32::NAN), (1, 0.0), (0, 50.0), (8, 50.0), (9, 50.0)] {
            recorder.field(number, Logged::Raw, 1.0, [ut, 0.0, 0.0], None);
        }
        for (i, angle) in [1.5, 1.7, f32::NAN].into_iter().enumerate() {
            recorder.attitude(i as f64, [0.0, angle, 0.0]);
            recorder.rates(i as f64, [0.0, 0.0, angle * 60.0]);
        }
        let flight = recorder.finish();
        assert_eq!(flight.compasses.iter().map(|compass| compass.number).collect::<Vec<_>>(), [1, 8]);
        assert_eq!((flight.compasses[0].field.rows().len(), flight.counts.unhealthy), (1, 5));
        assert_eq!((flight.attitude.rows().len(), flight.rates.rows().len()), (1, 1));
    }

    /// What the row itself says of the motors' share is taken off it, whatever the parameters say of them.
    #[test]
    fn the_motors_share_is_what_the_row_says() {
        let mut recorder = Recorder::new(Format::DataFlash);
        recorder.field(1, Logged::ArduPilot, 1.0, [20.0, 0.0, 40.0], Some([3.0, 0.0, -1.0]));
        let flight = recorder.finish();
        assert_eq!(
            flight.compasses[0].field.rows()[0].of.map(f32::to_bits)[..3],
            [17.0_f32, 0.0, 41.0].map(f32::to_bits)
        );
    }

    /// What is logged as it was measured has no correction of the autopilot's to compare with, whatever parameters a link tells.
    #[test]
    fn a_field_that_nobody_corrected_has_no_correction() {
        for (was, is_corrected) in [(Logged::Raw, false), (Logged::ArduPilot, true)] {
            let mut recorder = Recorder::new(Format::TLog);
            recorder.parameter("COMPASS_OFS_X", 100.0);
            recorder.field(1, was, 1.0, [20.0, 0.0, 40.0], None);
            let flight = recorder.finish();
            let raw_ut = flight.compasses[0].field.rows()[0].of[0];
            assert_eq!((flight.compasses[0].iron.is_some(), raw_ut < 20.0), (is_corrected, is_corrected), "{was:?}");
        }
    }

    /// Offsets that are learnt in flight are undone as they were at each row.
    #[test]
    fn a_parameter_that_changes_is_undone_from_then_on() {
        let mut recorder = Recorder::new(Format::DataFlash);
        recorder.parameter("COMPASS_OFS_X", 100.0);
        for (us, offset) in [(1_000_000, None), (2_000_000, Some(50.0)), (3_000_000, None), (4_000_000, Some(0.0))] {
            let t_s = recorder.timeline.at(us).unwrap();
            if let Some(offset) = offset {
                recorder.parameter("COMPASS_OFS_X", offset);
            }
            recorder.field(1, Logged::ArduPilot, t_s, [20.0, 0.0, 40.0], None);
        }
        let flight = recorder.finish();
        let raw: Vec<f32> = flight.compasses[0].field.rows().iter().map(|row| row.of[0]).collect();
        assert_eq!(raw, [10.0, 15.0, 15.0, 20.0]);
    }
}
