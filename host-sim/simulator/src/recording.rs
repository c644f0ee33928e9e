//! Recordings of simulated flights, to be written as logs of an autopilot.

use std::f64::consts::TAU;

use autoswing::earth::{self, Date, EarthField};
use log_analysis::log::log_writers::{FlightRecording, FlightSample};

use crate::module::Module;
use crate::world::aircraft::VehicleKind;
use crate::world::attitude_source::SimulatedAttitudeSource;
use crate::world::autopilot::Leg;
use crate::world::earth::Earth;
use crate::world::mavlink_autopilot::{ReportedPosition, START_UNIX_US, XIAN_POSITION};
use crate::world::{World, WorldConfig};

/// Recording interval, microseconds: 10 Hz, as autopilots log.
const RECORDING_INTERVAL_US: u64 = 100_000;

/// Longest recorded end part of a time step, microseconds; the world keeps 2 s of history.
const MAX_RECORDED_HISTORY_US: u64 = 1_900_000;

/// Parameters of an external compass of ArduPilot and of PX4 without correction, in firmware with custom rotations.
const COMPASS_PARAMETERS: [(&str, f64); 8] = [
    ("COMPASS_OFS_X", 0.0),
    ("COMPASS_OFS_Y", 0.0),
    ("COMPASS_OFS_Z", 0.0),
    ("COMPASS_ORIENT", 0.0),
    ("COMPASS_EXTERNAL", 1.0),
    ("CUST_ROT_ENABLE", 0.0),
    ("CAL_MAG0_ROT", 0.0),
    ("CAL_MAG0_ROLL", 0.0),
];

/// Appends the state of the world at a time within the last two seconds.
pub fn record_sample(recording: &mut FlightRecording, world: &World, source: &mut SimulatedAttitudeSource, at_us: u64) {
    recording.is_copter = world.world_config().aircraft.kind == VehicleKind::Copter;
    let (truth, reported) = (world.true_state(at_us), source.next_report(&world.true_state(at_us)));
    let field = world.sensor_field(at_us.saturating_sub((recording.field_latency_s * 1e6) as u64)).ut;
    let declination_rad = recording.declination_deg.to_radians();
    let heading_rad = (truth.heading_rad + declination_rad).rem_euclid(TAU);
    let (sin, cos) = libm::sincos(declination_rad);
    let true_north = |[north, east]: [f64; 2]| [north * cos - east * sin, north * sin + east * cos];
    recording.samples.push(FlightSample {
        time_us: at_us,
        field_ut: vec![[field.x, field.y, field.z].map(f64::from)],
        attitude_rad: [reported.roll_rad, reported.pitch_rad, heading_rad],
        rates_rad_s: source.measured_rates_rad_s(&truth),
        heading_rad,
        velocity_m_s: true_north([truth.north_m_s, truth.east_m_s]),
        displacement_m: true_north([truth.north_m, truth.east_m]),
        current_a: truth.current_a(),
        is_armed: true,
        flight_mode: 0,
        outputs: world.outputs(at_us).to_vec(),
        esc_currents_a: Vec::new(),
        further_currents_a: Vec::new(),
    });
}

/// Sets the place and its declination on 2026-01-01, if the world has the Earth field of that place.
fn set_place_of_default_earth(recording: &mut FlightRecording, world: &World) {
    if world.world_config().earth != Earth::default() {
        return;
    }
    let ReportedPosition { latitude_deg, longitude_deg, height_m } = XIAN_POSITION;
    recording.start_position = Some([latitude_deg, longitude_deg, height_m]);
    let model_position = earth::Position::new(latitude_deg as f32, longitude_deg as f32, height_m as f32);
    let field = model_position
        .zip(Date::from_unix_s(START_UNIX_US / 1_000_000))
        .and_then(|(position, date)| EarthField::from_model(position, date));
    recording.declination_deg = field.and_then(|field| field.declination_deg).map_or(0.0, f64::from);
}

/// Records four minutes of turns both ways at 25 and 40 deg of bank, enough for a calibration.
#[must_use]
pub fn record_turns(world: &WorldConfig, field_latency_s: f64) -> FlightRecording {
    let world = World::new(*world);
    let mut source = world.attitude_source();
    for bank_deg in [25.0, 40.0] {
        world.append_leg(Leg::Straight { heading_deg: 0.0, seconds: 10.0 });
        for heading_change_deg in [720.0, -720.0] {
            world.append_leg(Leg::Turn { bank_deg, heading_change_deg });
        }
    }
    let mut recording = FlightRecording { field_latency_s, ..FlightRecording::default() };
    set_place_of_default_earth(&mut recording, &world);
    for i in 20..2400 {
        record_sample(&mut recording, &world, &mut source, i * RECORDING_INTERVAL_US);
    }
    recording
}

/// Recorder of a flight.
pub struct Recorder {
    source: SimulatedAttitudeSource,
    next_sample_us: u64,
    /// The flight so far.
    pub recording: FlightRecording,
}

impl Recorder {
    /// A recorder of a module that starts at the present time.
    pub fn new(module: &impl Module) -> Self {
        let (source, next_sample_us) = (module.world().attitude_source(), module.now_us());
        let parameters = COMPASS_PARAMETERS.map(|(name, value)| (name.to_owned(), value)).to_vec();
        let mut recording = FlightRecording { parameters, ..FlightRecording::default() };
        set_place_of_default_earth(&mut recording, module.world());
        Self { source, next_sample_us, recording }
    }

    /// Records the flight up to now.
    pub fn record_until(&mut self, now_us: u64, world: &World) {
        self.next_sample_us = self.next_sample_us.max(
            now_us.saturating_sub(MAX_RECORDED_HISTORY_US) / RECORDING_INTERVAL_US * RECORDING_INTERVAL_US
                + RECORDING_INTERVAL_US,
        );
        while self.next_sample_us <= now_us {
            record_sample(&mut self.recording, world, &mut self.source, self.next_sample_us);
            self.next_sample_us += RECORDING_INTERVAL_US;
        }
    }
}
