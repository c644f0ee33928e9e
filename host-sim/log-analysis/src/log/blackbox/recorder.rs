//! Main frames, and the rows of a decoded log, as a flight.
//!
//! Axes of field, gyro and quaternion are forward, left, up (`sensors/boardalignment.c`); INAV's pitch is positive nose
//! down, its yaw from true north (`flight/imu.c`). The field is corrected, in counts of any unit.

use crate::log::compass_slot::UnknownSlot;
use crate::log::dataflash::quaternion_to_euler_rad;
use crate::log::flight::{AutopilotKind, LogFormat};
use crate::log::flight_builder::{FieldProcessing, FlightBuilder};
use crate::log::load::LoadSource;

/// Interval of the rows of attitude, mean rates and current, seconds; main frames come at up to 8 kHz.
const ROW_INTERVAL_S: f64 = 0.01;

/// Interval after which an unchanged field counts as another reading, seconds; INAV reads compasses at 10 Hz.
const READING_INTERVAL_S: f64 = 0.09;

/// Scale of Betaflight's `imuQuaternion`.
const QUATERNION_SCALE: f64 = 32_767.0;

pub struct MainRecorder {
    pub builder: FlightBuilder,
    field: Option<[usize; 3]>,
    attitude: Option<[usize; 3]>,
    quaternion: Option<[usize; 3]>,
    rates: Option<[usize; 3]>,
    /// Column of the current, and amperes of its unit.
    current: Option<(usize, f64)>,
    motors: Vec<usize>,
    /// Units of the gyro and of the motors.
    dps_per_count: f64,
    motor_range: [f64; 2],
    last_reading: Option<(f64, [f64; 3])>,
    /// Sums of time and rates since the last row, and their count.
    sums: ([f64; 4], f64),
    last_row_s: f64,
}

impl MainRecorder {
    /// Recorder of frames with these columns. `motor_range` are the values of a motor at rest and at full throttle.
    pub fn new(names: &[String], firmware: &str, dps_per_count: f64, motor_range: [f64; 2]) -> Self {
        let index = |name: &str| names.iter().position(|column| column == name);
        let vector = |name: &str| {
            let [x, y, z] = [0, 1, 2].map(|axis| index(&format!("{name}[{axis}]")));
            Some([x?, y?, z?])
        };
        let mut builder = FlightBuilder::new(LogFormat::Blackbox);
        builder.flight.autopilot = AutopilotKind::Inav;
        builder.set_firmware(firmware);
        // INAV's fields of a multirotor's navigation; Betaflight has few aircraft that are none.
        builder.flight.is_copter = index("mcPosAxisP[0]").is_some() || firmware.starts_with("Betaflight");
        let current = |name: &str, amperes: f64| index(name).map(|column| (column, amperes));
        Self {
            builder,
            field: vector("magADC"),
            attitude: vector("attitude"),
            quaternion: vector("imuQuaternion"),
            rates: vector("gyroADC"),
            current: current("amperage", 0.01)
                .or(current("amperageLatest", 0.01))
                .or(current("amperage (A)", 1.0))
                .or(current("amperageLatest (A)", 1.0)),
            motors: (0..16).map_while(|motor| index(&format!("motor[{motor}]"))).collect(),
            dps_per_count,
            motor_range,
            last_reading: None,
            sums: ([0.0; 4], 0.0),
            last_row_s: f64::NEG_INFINITY,
        }
    }

    /// Adds a frame.
    pub fn record_frame(&mut self, clock_us: u64, number: &dyn Fn(usize) -> f64) {
        let Some(t_s) = self.builder.timeline.flight_time_s(clock_us) else { return };
        if let Some(field) = self.field.map(|columns| columns.map(number)) {
            let is_old = |(at_s, last): (f64, [f64; 3])| {
                last.map(f64::to_bits) == field.map(f64::to_bits) && t_s - at_s < READING_INTERVAL_S
            };
            if !self.last_reading.is_some_and(is_old) {
                self.last_reading = Some((t_s, field));
                let processing = FieldProcessing::Unknown(UnknownSlot::NotInBlackbox);
                self.builder.push_field(1, processing, t_s, in_body_axes(field), None);
            }
        }
        let [forward, left, up] = self.rates.map_or([0.0; 3], |columns| columns.map(number));
        for (sum, value) in self.sums.0.iter_mut().zip([t_s, forward, left, up]) {
            *sum += value;
        }
        self.sums.1 += 1.0;
        if (t_s - self.last_row_s).abs() >= ROW_INTERVAL_S {
            self.last_row_s = t_s;
            self.record_row(t_s, number);
        }
    }

    fn record_row(&mut self, t_s: f64, number: &dyn Fn(usize) -> f64) {
        let (sums, count) = std::mem::replace(&mut self.sums, ([0.0; 4], 0.0));
        let [mean_s, forward, left, up] = sums.map(|sum| sum / count);
        if self.rates.is_some() {
            let rates = in_body_axes([forward, left, up]);
            self.builder.push_rates(mean_s, rates.map(|rate| (rate * self.dps_per_count as f32).to_radians()));
        }
        let inav = self.attitude.map(|columns| columns.map(|column| (number(column) / 10.0).to_radians()));
        let angles = inav.map(|[roll, pitch, yaw]| [roll, -pitch, yaw]);
        let betaflight = || self.quaternion.map(|columns| quaternion_angles_rad(columns.map(number)));
        if let Some(angles_rad) = angles.or_else(betaflight) {
            self.builder.push_attitude(t_s, angles_rad.map(|angle| angle as f32));
        }
        if let Some((column, amperes)) = self.current {
            self.builder.push_current(t_s, (number(column) * amperes) as f32);
        }
        let [rest, full] = self.motor_range;
        let fractions = self.motors.iter().map(|motor| Some(((number(*motor) - rest) / (full - rest)) as f32));
        self.builder.loads.push_values(LoadSource::Motor, t_s, fractions);
    }
}

/// A vector forward, left, up in the axes of the body: forward, right, down.
fn in_body_axes([forward, left, up]: [f64; 3]) -> [f32; 3] {
    [forward, -left, -up].map(|axis| axis as f32)
}

/// Roll, pitch and yaw of Betaflight's quaternion, whose real part is positive, between axes forward, left, up and north,
/// west, up.
fn quaternion_angles_rad(vector: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = vector.map(|axis| axis / QUATERNION_SCALE);
    let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
    quaternion_to_euler_rad([w, x, -y, -z])
}
