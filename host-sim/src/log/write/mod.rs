//! Small logs in the formats that are read: of simulated flights, for demonstrations and tests.

mod dataflash;
mod tlog;
mod ulog;

pub use dataflash::{dataflash, dataflash_text};
pub use tlog::tlog;
pub use ulog::ulog;

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;

use autoswing::earth::{self, Day, EarthField};

use crate::devices::uart::HostEnd;
use crate::module::{Module, Ran};
use crate::world::aircraft::Kind;
use crate::world::attitude_source::AttitudeSource;
use crate::world::autopilot::Leg;
use crate::world::earth::Earth;
use crate::world::mavlink_autopilot::{BEGAN_UNIX_US, Place, XIAN};
use crate::world::{World, WorldConfig};

/// Ten rows a second, as autopilots log, microseconds.
const EVERY_US: u64 = 100_000;

/// The world remembers two seconds: of a step that is longer its end is taken down, microseconds.
const REMEMBERED_US: u64 = 1_900_000;

/// Parameters of an autopilot of either kind that corrects nothing.
const UNTOUCHED: [&str; 4] = ["COMPASS_OFS_X", "COMPASS_OFS_Y", "COMPASS_OFS_Z", "CAL_MAG0_ROT"];

/// What an autopilot knew at an instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Instant {
    /// Microseconds since its start.
    pub at_us: u64,
    /// The raw field of each compass, body axes, microtesla.
    pub field_ut: Vec<[f64; 3]>,
    /// Its roll, pitch and yaw, radians.
    pub attitude_rad: [f64; 3],
    /// Body rates, rad/s.
    pub rates_rad_s: [f64; 3],
    /// The true heading, radians: from true north where that is known, else from magnetic north, as the velocity is.
    pub heading_rad: f64,
    /// Velocity over ground towards north and east, m/s.
    pub velocity_m_s: [f64; 2],
    /// How far it has come towards north and east, metres.
    pub moved_m: [f64; 2],
    /// Current, amperes.
    pub current_a: f64,
    /// Whether it is armed.
    pub is_armed: bool,
}

/// A flight that was recorded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Its instants, in order.
    pub instants: Vec<Instant>,
    /// The autopilot's parameters.
    pub parameters: Vec<(String, f64)>,
    /// Latitude, longitude, degrees, and height, metres, where it began, if that is told.
    pub place: Option<[f64; 3]>,
    /// Magnetic north from true north there, degrees, east positive.
    pub declination_deg: f64,
    /// Whether its autopilot says that it is a copter.
    pub is_copter: bool,
    /// How old the fields are at their instants, seconds: they were measured so much earlier.
    pub age_s: f64,
}

impl Instant {
    /// Speed, m/s, and course, radians from north to a whole turn, over ground.
    fn over_ground(&self) -> [f64; 2] {
        let [north, east] = self.velocity_m_s;
        [north.hypot(east), east.atan2(north).rem_euclid(TAU)]
    }
}

impl Recording {
    /// A recording of fields that are so old.
    #[must_use]
    pub fn aged(age_s: f64) -> Self {
        Self { age_s, ..Self::default() }
    }

    /// Takes down what there is at an instant, which is now or up to a second ago.
    pub fn take(&mut self, world: &World, source: &mut AttitudeSource, at_us: u64) {
        self.is_copter = world.config().aircraft.kind == Kind::Copter;
        let (truth, reported) = (world.true_state(at_us), source.report(&world.true_state(at_us)));
        let field = world.sensor_field(at_us.saturating_sub((self.age_s * 1e6) as u64)).ut;
        let declination_rad = self.declination_deg.to_radians();
        let heading_rad = (truth.heading_rad + declination_rad).rem_euclid(TAU);
        let (sin, cos) = declination_rad.sin_cos();
        let true_north = |[north, east]: [f64; 2]| [north * cos - east * sin, north * sin + east * cos];
        self.instants.push(Instant {
            at_us,
            field_ut: vec![[field.x, field.y, field.z].map(f64::from)],
            attitude_rad: [reported.roll_rad, reported.pitch_rad, heading_rad],
            rates_rad_s: truth.body_rates_rad_s(),
            heading_rad,
            velocity_m_s: true_north([truth.north_m_s, truth.east_m_s]),
            moved_m: true_north([truth.north_m, truth.east_m]),
            current_a: truth.current_a(),
            is_armed: true,
        });
    }

    /// It is flown here, in the field of 2026-01-01.
    pub fn is_at(&mut self, place: Place) {
        let Place { latitude_deg, longitude_deg, height_m } = place;
        self.place = Some([latitude_deg, longitude_deg, height_m]);
        let here = earth::Place::new(latitude_deg as f32, longitude_deg as f32, height_m as f32);
        let field = here.zip(Day::from_unix_s(BEGAN_UNIX_US / 1_000_000)).and_then(|(at, on)| EarthField::of(at, on));
        self.declination_deg = field.and_then(|field| field.declination_deg).map_or(0.0, f64::from);
    }

    /// Latitude, longitude, degrees, and height, metres, at an instant, if that is told.
    fn place_at(&self, instant: &Instant) -> Option<[f64; 3]> {
        /// Of a degree of latitude, metres.
        const DEGREE_M: f64 = 111_200.0;
        let [latitude_deg, longitude_deg, height_m] = self.place?;
        let [north_deg, east_deg] = instant.moved_m.map(|metres| metres / DEGREE_M);
        let shrinks = latitude_deg.to_radians().cos();
        Some([latitude_deg + north_deg, longitude_deg + east_deg / shrinks, height_m])
    }

    /// A parameter; nothing where there is none.
    fn parameter(&self, name: &str) -> f64 {
        self.parameters.iter().find(|(other, _)| other == name).map_or(0.0, |&(_, value)| value)
    }

    /// ArduPilot's offsets of a compass, from 1, milligauss.
    fn offsets(&self, number: usize) -> [f64; 3] {
        let index = if number == 1 { String::new() } else { number.to_string() };
        ["X", "Y", "Z"].map(|axis| self.parameter(&format!("COMPASS_OFS{index}_{axis}")))
    }

    /// The field of a compass, from 1, as ArduPilot would log it, and the motors' share of it, microtesla: its formula written
    /// out.
    fn ardupilot_ut(&self, instant: &Instant, number: usize) -> ([f64; 3], [f64; 3]) {
        let index = if number == 1 { String::new() } else { number.to_string() };
        let of = |what: &str| ["X", "Y", "Z"].map(|axis| self.parameter(&format!("COMPASS_{what}{index}_{axis}")));
        let scale = self.parameter(&format!("COMPASS_SCALE{index}"));
        let scale = if scale == 0.0 { 1.0 } else { scale };
        let (offset, diagonal, off, motor) = (self.offsets(number), of("DIA"), of("ODI"), of("MOT"));
        let raw = instant.field_ut.get(number - 1).copied().unwrap_or_default();
        let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| (raw[axis] + offset[axis] / 10.0) * scale);
        let soft = if diagonal.iter().all(|axis| axis.abs() < f64::EPSILON) {
            [x, y, z]
        } else {
            [
                diagonal[0] * x + off[0] * y + off[1] * z,
                off[0] * x + diagonal[1] * y + off[2] * z,
                off[1] * x + off[2] * y + diagonal[2] * z,
            ]
        };
        let current_a = if self.parameter("COMPASS_MOTCT") as u8 == 2 { instant.current_a } else { 0.0 };
        let share = motor.map(|by| by / 10.0 * current_a);
        (std::array::from_fn(|axis| soft[axis] + share[axis]), share)
    }

    fn compasses(&self) -> usize {
        self.instants.first().map_or(0, |instant| instant.field_ut.len())
    }
}

/// Turns both ways, by 25 and by 40 deg of bank, as an autopilot logs them ten times a second whose field is so old, seconds:
/// as much as calibrates a compass, in four minutes.
#[must_use]
pub fn turns(world: &WorldConfig, age_s: f64) -> Recording {
    let world = World::new(*world);
    let mut source = world.attitude_source();
    for bank_deg in [25.0, 40.0] {
        world.fly(Leg::Straight { heading_deg: 0.0, seconds: 10.0 });
        for heading_change_deg in [720.0, -720.0] {
            world.fly(Leg::Turn { bank_deg, heading_change_deg });
        }
    }
    let mut recording = Recording::aged(age_s);
    for i in 20..2400 {
        recording.take(&world, &mut source, i * EVERY_US);
    }
    recording
}

/// As a table, milligauss.
#[must_use]
pub fn csv(recording: &Recording) -> Vec<u8> {
    let mut text = String::from(
        "t_s,mx,my,mz,roll_deg,pitch_deg,yaw_ref_deg,p_dps,q_dps,r_dps,current_a,armed,lat_deg,lon_deg,height_m,\
         speed_m_s,course_deg\n",
    );
    let mut last = None;
    for instant in &recording.instants {
        let field = instant.field_ut.first().copied().unwrap_or_default().map(|axis| axis * 10.0);
        let [roll, pitch, _] = instant.attitude_rad.map(f64::to_degrees);
        // The mean of a tenth of a second, near enough: of its ends.
        let now = instant.rates_rad_s.map(f64::to_degrees);
        let [p, q, r] = std::array::from_fn(|axis| now[axis].midpoint(last.unwrap_or(now)[axis]));
        last = Some(now);
        let [speed_m_s, course_rad] = instant.over_ground();
        let place = recording.place_at(instant).map_or_else(
            || ",,,,".to_owned(),
            |[a, b, c]| format!("{a:.7},{b:.7},{c:.1},{speed_m_s:.2},{:.2}", course_rad.to_degrees()),
        );
        // Writing to a string never fails.
        let _ = writeln!(
            text,
            "{:.3},{:.1},{:.1},{:.1},{roll:.2},{pitch:.2},{:.2},{p:.3},{q:.3},{r:.3},{:.2},{},{place}",
            instant.at_us as f64 / 1e6,
            field[0],
            field[1],
            field[2],
            instant.heading_rad.to_degrees(),
            instant.current_a,
            u8::from(instant.is_armed),
        );
    }
    text.into_bytes()
}

/// In the format that a file's name ends with: `.bin`, `.log`, `.ulg`, `.tlog`, else a table.
#[must_use]
pub fn named(path: &Path, recording: &Recording) -> Vec<u8> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("bin") => dataflash(recording),
        Some("log") => dataflash_text(recording),
        Some("ulg") => ulog(recording),
        Some("tlog") => tlog(recording),
        _ => csv(recording),
    }
}

/// A module that flies as it does, while what its autopilot would log is taken down.
pub struct Recorded<'a, M> {
    module: &'a mut M,
    source: AttitudeSource,
    next_us: u64,
    /// What was taken down.
    pub recording: Recording,
}

impl<'a, M: Module> Recorded<'a, M> {
    /// From now on.
    pub fn new(module: &'a mut M) -> Self {
        let (source, next_us) = (module.world().attitude_source(), module.now_us());
        let parameters = UNTOUCHED.map(|name| (name.to_owned(), 0.0)).to_vec();
        let mut recording = Recording { parameters, ..Recording::default() };
        if module.world().config().earth == Earth::default() {
            recording.is_at(XIAN);
        }
        Self { module, source, next_us, recording }
    }
}

impl<M: Module> Module for Recorded<'_, M> {
    fn world(&self) -> &World {
        self.module.world()
    }

    fn console(&self) -> &HostEnd {
        self.module.console()
    }

    fn autopilot(&self) -> &HostEnd {
        self.module.autopilot()
    }

    fn instrument(&self) -> &HostEnd {
        self.module.instrument()
    }

    fn now_us(&self) -> u64 {
        self.module.now_us()
    }

    fn run_until(&mut self, until_us: u64) -> Ran {
        let ran = self.module.run_until(until_us);
        let now_us = self.module.now_us();
        self.next_us = self.next_us.max(now_us.saturating_sub(REMEMBERED_US) / EVERY_US * EVERY_US + EVERY_US);
        while self.next_us <= now_us {
            self.recording.take(self.module.world(), &mut self.source, self.next_us);
            self.next_us += EVERY_US;
        }
        ran
    }
}
