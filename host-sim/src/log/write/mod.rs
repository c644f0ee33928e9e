//! Writers of simulated flights in every readable log format, for demonstrations and tests.

mod dataflash;
mod tlog;
mod ulog;

pub use dataflash::{encode_dataflash, encode_dataflash_text};
pub use tlog::encode_tlog;
pub use ulog::encode_ulog;

use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::Path;

use autoswing::earth::{self, Date, EarthField};

use crate::devices::uart::HostEnd;
use crate::module::{Module, ModuleRunEnd};
use crate::world::aircraft::VehicleKind;
use crate::world::attitude_source::AttitudeSource;
use crate::world::autopilot::Leg;
use crate::world::earth::Earth;
use crate::world::mavlink_autopilot::{ReportedPosition, START_UNIX_US, XIAN};
use crate::world::{World, WorldConfig};

/// Start of a flight: GPS week 2400, 2026-01-04, microseconds.
const UTC_US: u64 = 1_767_484_800_000_000;

/// Recording interval, microseconds: 10 Hz, as autopilots log.
const EVERY_US: u64 = 100_000;

/// Part of a long step that is recorded, microseconds; the world keeps 2 s of history.
const REMEMBERED_US: u64 = 1_900_000;

/// Parameters that mark either autopilot as known, with no correction.
const UNTOUCHED: [&str; 4] = ["COMPASS_OFS_X", "COMPASS_OFS_Y", "COMPASS_OFS_Z", "CAL_MAG0_ROT"];

/// Simulated autopilot data at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightSample {
    /// Time since start, microseconds.
    pub time_us: u64,
    /// Raw field of each compass, body axes, microtesla.
    pub field_ut: Vec<[f64; 3]>,
    /// Reported roll, pitch and yaw, radians.
    pub attitude_rad: [f64; 3],
    /// Body rates, rad/s.
    pub rates_rad_s: [f64; 3],
    /// True heading, radians, from true north if the declination is known, else from magnetic north; likewise the
    /// velocity.
    pub heading_rad: f64,
    /// Velocity over ground towards north and east, m/s.
    pub velocity_m_s: [f64; 2],
    /// Displacement from the start towards north and east, metres.
    pub displacement_m: [f64; 2],
    /// Current, amperes.
    pub current_a: f64,
    /// Whether the aircraft is armed.
    pub is_armed: bool,
}

/// A recorded flight.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlightRecording {
    /// Samples in order of time.
    pub samples: Vec<FlightSample>,
    /// The autopilot's parameters.
    pub parameters: Vec<(String, f64)>,
    /// Start: latitude, longitude, degrees, and height, metres.
    pub place: Option<[f64; 3]>,
    /// Declination at the start, degrees, east positive.
    pub declination_deg: f64,
    /// Whether the aircraft is a copter.
    pub is_copter: bool,
    /// Latency of the field, seconds.
    pub field_latency_s: f64,
}

impl FlightSample {
    /// Speed over ground, m/s, and course, radians, 0 to 2 pi.
    fn over_ground(&self) -> [f64; 2] {
        let [north, east] = self.velocity_m_s;
        [north.hypot(east), east.atan2(north).rem_euclid(TAU)]
    }
}

impl FlightRecording {
    /// Creates an empty recording with a field latency.
    #[must_use]
    pub fn with_field_latency(age_s: f64) -> Self {
        Self { field_latency_s: age_s, ..Self::default() }
    }

    /// Appends the state of the world at a time no more than one second past.
    pub fn record_sample(&mut self, world: &World, source: &mut AttitudeSource, at_us: u64) {
        self.is_copter = world.config().aircraft.kind == VehicleKind::Copter;
        let (truth, reported) = (world.true_state(at_us), source.report(&world.true_state(at_us)));
        let field = world.sensor_field(at_us.saturating_sub((self.field_latency_s * 1e6) as u64)).ut;
        let declination_rad = self.declination_deg.to_radians();
        let heading_rad = (truth.heading_rad + declination_rad).rem_euclid(TAU);
        let (sin, cos) = declination_rad.sin_cos();
        let true_north = |[north, east]: [f64; 2]| [north * cos - east * sin, north * sin + east * cos];
        self.samples.push(FlightSample {
            time_us: at_us,
            field_ut: vec![[field.x, field.y, field.z].map(f64::from)],
            attitude_rad: [reported.roll_rad, reported.pitch_rad, heading_rad],
            rates_rad_s: truth.body_rates_rad_s(),
            heading_rad,
            velocity_m_s: true_north([truth.north_m_s, truth.east_m_s]),
            displacement_m: true_north([truth.north_m, truth.east_m]),
            current_a: truth.current_a(),
            is_armed: true,
        });
    }

    /// Sets the place and its declination on 2026-01-01.
    pub fn set_place(&mut self, place: ReportedPosition) {
        let ReportedPosition { latitude_deg, longitude_deg, height_m } = place;
        self.place = Some([latitude_deg, longitude_deg, height_m]);
        let here = earth::Position::new(latitude_deg as f32, longitude_deg as f32, height_m as f32);
        let field =
            here.zip(Date::from_unix_s(START_UNIX_US / 1_000_000)).and_then(|(at, on)| EarthField::from_model(at, on));
        self.declination_deg = field.and_then(|field| field.declination_deg).map_or(0.0, f64::from);
    }

    /// Latitude, longitude, degrees, and height, metres, of a sample.
    fn place_at(&self, instant: &FlightSample) -> Option<[f64; 3]> {
        /// Length of one degree of latitude, metres.
        const DEGREE_M: f64 = 111_200.0;
        let [latitude_deg, longitude_deg, height_m] = self.place?;
        let [north_deg, east_deg] = instant.displacement_m.map(|metres| metres / DEGREE_M);
        let shrinks = latitude_deg.to_radians().cos();
        Some([latitude_deg + north_deg, longitude_deg + east_deg / shrinks, height_m])
    }

    fn parameter(&self, name: &str) -> f64 {
        self.parameters.iter().find(|(other, _)| other == name).map_or(0.0, |&(_, value)| value)
    }

    /// ArduPilot's offsets of a compass numbered from 1, milligauss.
    fn ardupilot_offsets_mg(&self, number: usize) -> [f64; 3] {
        let index = if number == 1 { String::new() } else { number.to_string() };
        ["X", "Y", "Z"].map(|axis| self.parameter(&format!("COMPASS_OFS{index}_{axis}")))
    }

    /// ArduPilot's logged field of a compass numbered from 1, and the motor-current compensation in it, microtesla;
    /// independent of the reader's code.
    fn ardupilot_ut(&self, instant: &FlightSample, number: usize) -> ([f64; 3], [f64; 3]) {
        let index = if number == 1 { String::new() } else { number.to_string() };
        let vector_parameters = |vector_name: &str| {
            ["X", "Y", "Z"].map(|axis| self.parameter(&format!("COMPASS_{vector_name}{index}_{axis}")))
        };
        let scale = self.parameter(&format!("COMPASS_SCALE{index}"));
        let scale = if scale == 0.0 { 1.0 } else { scale };
        let (offset, diagonal, off_diagonal, motor) = (
            self.ardupilot_offsets_mg(number),
            vector_parameters("DIA"),
            vector_parameters("ODI"),
            vector_parameters("MOT"),
        );
        let raw = instant.field_ut.get(number - 1).copied().unwrap_or_default();
        let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| (raw[axis] + offset[axis] / 10.0) * scale);
        let soft = if diagonal.iter().all(|axis| axis.abs() < f64::EPSILON) {
            [x, y, z]
        } else {
            [
                diagonal[0] * x + off_diagonal[0] * y + off_diagonal[1] * z,
                off_diagonal[0] * x + diagonal[1] * y + off_diagonal[2] * z,
                off_diagonal[1] * x + off_diagonal[2] * y + diagonal[2] * z,
            ]
        };
        let current_a = if self.parameter("COMPASS_MOTCT") as u8 == 2 { instant.current_a } else { 0.0 };
        let share = motor.map(|per_ten_amperes| per_ten_amperes / 10.0 * current_a);
        (std::array::from_fn(|axis| soft[axis] + share[axis]), share)
    }

    fn compasses(&self) -> usize {
        self.samples.first().map_or(0, |instant| instant.field_ut.len())
    }
}

/// Records four minutes of turns both ways at 25 and 40 deg of bank, enough for a calibration.
#[must_use]
pub fn record_turns(world: &WorldConfig, age_s: f64) -> FlightRecording {
    let world = World::new(*world);
    let mut source = world.attitude_source();
    for bank_deg in [25.0, 40.0] {
        world.fly(Leg::Straight { heading_deg: 0.0, seconds: 10.0 });
        for heading_change_deg in [720.0, -720.0] {
            world.fly(Leg::Turn { bank_deg, heading_change_deg });
        }
    }
    let mut recording = FlightRecording::with_field_latency(age_s);
    for i in 20..2400 {
        recording.record_sample(&world, &mut source, i * EVERY_US);
    }
    recording
}

/// Encodes a recording as a table, milligauss.
#[must_use]
pub fn encode_csv(recording: &FlightRecording) -> Vec<u8> {
    let mut text = String::from(
        "t_s,mx,my,mz,roll_deg,pitch_deg,yaw_ref_deg,p_dps,q_dps,r_dps,current_a,armed,lat_deg,lon_deg,height_m,\
         speed_m_s,course_deg\n",
    );
    let mut last = None;
    for instant in &recording.samples {
        let field = instant.field_ut.first().copied().unwrap_or_default().map(|axis| axis * 10.0);
        let [roll, pitch, _] = instant.attitude_rad.map(f64::to_degrees);
        // The mean rate since the last row, approximated by the mean of both ends.
        let now = instant.rates_rad_s.map(f64::to_degrees);
        let [p, q, r] = std::array::from_fn(|axis| now[axis].midpoint(last.unwrap_or(now)[axis]));
        last = Some(now);
        let [speed_m_s, course_rad] = instant.over_ground();
        let place = recording.place_at(instant).map_or_else(
            || ",,,,".to_owned(),
            |[a, b, c]| format!("{a:.7},{b:.7},{c:.1},{speed_m_s:.2},{:.2}", course_rad.to_degrees()),
        );
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:.3},{:.1},{:.1},{:.1},{roll:.2},{pitch:.2},{:.2},{p:.3},{q:.3},{r:.3},{:.2},{},{place}",
            instant.time_us as f64 / 1e6,
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

/// Encodes a recording by a file's extension: `.bin`, `.log`, `.ulg`, `.tlog`, else a table.
#[must_use]
pub fn encode_for_path(path: &Path, recording: &FlightRecording) -> Vec<u8> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("bin") => encode_dataflash(recording),
        Some("log") => encode_dataflash_text(recording),
        Some("ulg") => encode_ulog(recording),
        Some("tlog") => encode_tlog(recording),
        _ => encode_csv(recording),
    }
}

/// Wrapper around a module that records its flight.
pub struct RecordingModule<'a, M> {
    module: &'a mut M,
    source: AttitudeSource,
    next_us: u64,
    /// The flight so far.
    pub recording: FlightRecording,
}

impl<'a, M: Module> RecordingModule<'a, M> {
    /// Starts recording now.
    pub fn new(module: &'a mut M) -> Self {
        let (source, next_us) = (module.world().attitude_source(), module.now_us());
        let parameters = UNTOUCHED.map(|name| (name.to_owned(), 0.0)).to_vec();
        let mut recording = FlightRecording { parameters, ..FlightRecording::default() };
        if module.world().config().earth == Earth::default() {
            recording.set_place(XIAN);
        }
        Self { module, source, next_us, recording }
    }
}

impl<M: Module> Module for RecordingModule<'_, M> {
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

    fn run_until(&mut self, until_us: u64) -> ModuleRunEnd {
        let ran = self.module.run_until(until_us);
        let now_us = self.module.now_us();
        self.next_us = self.next_us.max(now_us.saturating_sub(REMEMBERED_US) / EVERY_US * EVERY_US + EVERY_US);
        while self.next_us <= now_us {
            self.recording.record_sample(self.module.world(), &mut self.source, self.next_us);
            self.next_us += EVERY_US;
        }
        ran
    }
}
