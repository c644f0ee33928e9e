//! ArduPilot's DataFlash logs, binary and text: the messages that tell of a flight.
//!
//! Names and instances are those of ArduPilot's LogStructure.h through the years: since 2020-11 an instance is a field
//! (MAG.I, IMU.I, GPS.I, BAT.Inst), before that MAG2, MAG3, IMU2; CURR was what BAT is; TimeMS what TimeUS is, and in GPS T.

mod binary;
mod text;

pub use binary::{begins_in, read_binary};
pub use text::read_text;

use super::flight::{Autopilot, Format, Gps};
use super::recorder::{Logged, Recorder};

/// A message: numbers by the names of its columns. Numbers are scaled as their letters say: degrees, m/s.
trait Message {
    /// A number.
    fn number(&self, name: &str) -> Option<f64>;
    /// Whether a number is logged as a whole one, with nothing said of a scale.
    fn is_whole(&self, name: &str) -> bool;
    /// Words.
    fn words(&self, name: &str) -> Option<String>;
}

/// Whether a message tells anything that is needed.
fn is_wanted(name: &str) -> bool {
    matches!(
        name,
        "MAG"
            | "MAG2"
            | "MAG3"
            | "ATT"
            | "IMU"
            | "GPS"
            | "BAT"
            | "CURR"
            | "XKF1"
            | "NKF1"
            | "PARM"
            | "MSG"
            | "ARM"
            | "EV"
            | "SIM"
            | "VER"
    )
}

fn recorder(format: Format) -> Recorder {
    let mut recorder = Recorder::new(format);
    recorder.flight.autopilot = Autopilot::ArduPilot;
    recorder
}

/// Takes a message.
fn take(recorder: &mut Recorder, name: &str, message: &dyn Message) {
    if name == "PARM" {
        if let (Some(name), Some(value)) = (message.words("Name"), message.number("Value")) {
            recorder.parameter(&name, value);
        }
        return;
    }
    let t_s = match microseconds(name, message) {
        Some(us) => recorder.timeline.at(us),
        // Until 2015 these had no stamp.
        None => matches!(name, "MSG" | "EV").then(|| recorder.timeline.now_s()),
    };
    let Some(t_s) = t_s else { return };
    match name {
        "MAG" => {
            let number = message.number("I").map_or(1, |instance| (instance as u8).saturating_add(1));
            field(recorder, t_s, message, number);
        }
        "MAG2" => field(recorder, t_s, message, 2),
        "MAG3" => field(recorder, t_s, message, 3),
        "ATT" => {
            if let Some([roll, pitch]) = numbers(message, ["Roll", "Pitch"]) {
                let yaw = message.number("Yaw").unwrap_or(f64::NAN);
                recorder.attitude(t_s, [roll, pitch, yaw].map(|deg| deg.to_radians() as f32));
            }
        }
        "IMU" if message.number("I").unwrap_or(0.0) == 0.0 => {
            if let Some(rates) = numbers(message, ["GyrX", "GyrY", "GyrZ"]) {
                let bias = recorder.gyro_bias_rad_s;
                recorder.rates(t_s, std::array::from_fn(|axis| rates[axis] as f32 - bias[axis]));
            }
        }
        // What the autopilot's filter takes the gyros to read at rest, deg/s: what it sends has that taken off.
        "XKF1" | "NKF1" if message.number("C").unwrap_or(0.0) == 0.0 => {
            if let Some(bias) =
                numbers(message, ["GX", "GY", "GZ"]).filter(|bias| bias.iter().all(|axis| axis.abs() < 10.0))
            {
                recorder.gyro_bias_rad_s = bias.map(|axis| axis.to_radians() as f32);
            }
        }
        "GPS" if message.number("I").unwrap_or(0.0) == 0.0 => gps(recorder, t_s, message),
        "BAT" if message.number("Inst").or_else(|| message.number("Instance")).unwrap_or(0.0) == 0.0 => {
            current(recorder, t_s, message);
        }
        "CURR" => current(recorder, t_s, message),
        "ARM" => {
            if let Some(is) = message.number("ArmState") {
                recorder.armed(t_s, is != 0.0);
            }
        }
        "EV" => match message.number("Id").map(|id| id as u8) {
            // LogEvent: armed, automatically armed; disarmed.
            Some(10 | 15) => recorder.armed(t_s, true),
            Some(11) => recorder.armed(t_s, false),
            _ => {}
        },
        "SIM" => truth(recorder, t_s, message),
        "VER" => recorder.firmware(&message.words("FWS").unwrap_or_default()),
        "MSG" => {
            let words = message.words("Message").unwrap_or_default();
            if ["Ardu", "APM", "Rover", "Blimp", "Antenna"].iter().any(|begin| words.starts_with(begin)) {
                recorder.firmware(&words);
            }
        }
        _ => {}
    }
}

/// The stamp of a message.
fn microseconds(name: &str, message: &dyn Message) -> Option<u64> {
    let of = |column: &str, scale: f64| {
        let us = message.number(column)? * scale;
        (us >= 0.0).then_some(us as u64)
    };
    // What GPS once called TimeMS was that of the week; its T was the autopilot's.
    let ms = if name == "GPS" { of("T", 1e3) } else { of("TimeMS", 1e3) };
    of("TimeUS", 1.0).or(ms)
}

fn numbers<const N: usize>(message: &dyn Message, names: [&str; N]) -> Option<[f64; N]> {
    let mut found = [0.0; N];
    for (number, name) in found.iter_mut().zip(names) {
        *number = message.number(name).filter(|number| number.is_finite())?;
    }
    Some(found)
}

/// Milligauss, of which the motors' share may be said.
fn field(recorder: &mut Recorder, t_s: f64, message: &dyn Message, number: u8) {
    let Some(field) = numbers(message, ["MagX", "MagY", "MagZ"]) else { return };
    if message.number("Health") == Some(0.0) {
        recorder.flight.counts.unhealthy += 1;
        return;
    }
    let motor = numbers(message, ["MOX", "MOY", "MOZ"]).or_else(|| numbers(message, ["MOfsX", "MOfsY", "MOfsZ"]));
    let microtesla = |milligauss: [f64; 3]| milligauss.map(|axis| (axis * 0.1) as f32);
    recorder.field(number, Logged::ArduPilot, t_s, microtesla(field), motor.map(microtesla));
}

fn gps(recorder: &mut Recorder, t_s: f64, message: &dyn Message) {
    /// A fix in three dimensions.
    const FIX_3D: f64 = 3.0;
    /// 1980-01-06 in Unix time, and the leap seconds since then are less than a minute.
    const GPS_EPOCH_UNIX_S: f64 = 315_964_800.0;
    if message.number("Status").is_none_or(|status| status < FIX_3D) {
        return;
    }
    let Some([latitude, longitude, height, speed, course]) = numbers(message, ["Lat", "Lng", "Alt", "Spd", "GCrs"])
    else {
        return;
    };
    let yaw_deg = message.number("Yaw").filter(|yaw| *yaw != 0.0).map_or(f32::NAN, |yaw| yaw as f32);
    let [latitude_deg, longitude_deg, height_m, speed_m_s, course_deg] =
        [latitude, longitude, height, speed, course].map(|number| number as f32);
    recorder.gps(t_s, Gps { latitude_deg, longitude_deg, height_m, speed_m_s, course_deg, yaw_deg });
    if let Some(week) = message.number("GWk").or_else(|| message.number("Week")).filter(|week| *week > 0.0) {
        let ms = message.number("GMS").unwrap_or(0.0);
        recorder.unix_s((GPS_EPOCH_UNIX_S + week * 604_800.0 + ms / 1e3) as u64);
    }
}

/// Amperes; CURR had them in hundredths, as whole numbers.
fn current(recorder: &mut Recorder, t_s: f64, message: &dyn Message) {
    if let Some(logged) = message.number("Curr") {
        let amperes = if message.is_whole("Curr") { logged * 0.01 } else { logged };
        recorder.current(t_s, amperes as f32);
    }
}

/// The simulator's attitude, by its quaternion where that is logged: the angles are cut to hundredths of a degree.
fn truth(recorder: &mut Recorder, t_s: f64, message: &dyn Message) {
    let angles = numbers(message, ["Q1", "Q2", "Q3", "Q4"]).map(euler_rad);
    let logged = || numbers(message, ["Roll", "Pitch", "Yaw"]).map(|angles| angles.map(f64::to_radians));
    if let Some(angles) = angles.or_else(logged) {
        recorder.truth(t_s, angles.map(|angle| angle as f32));
    }
}

/// Roll, pitch and yaw of a quaternion w, x, y, z that takes the body's axes to north, east, down.
pub(super) fn euler_rad([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    let roll = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    let pitch = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    [roll, pitch, yaw]
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Numbers<'a>(&'a [(&'a str, f64)]);

    impl Message for Numbers<'_> {
        fn number(&self, name: &str) -> Option<f64> {
            self.0.iter().find(|(column, _)| *column == name).map(|(_, number)| *number)
        }

        fn words(&self, _: &str) -> Option<String> {
            None
        }

        fn is_whole(&self, _: &str) -> bool {
            false
        }
    }

    fn taken(messages: &[(&str, &[(&str, f64)])]) -> crate::log::Flight {
        let mut recorder = recorder(Format::DataFlash);
        for (name, numbers) in messages {
            take(&mut recorder, name, &Numbers(numbers));
        }
        recorder.finish()
    }

    /// Gyros as the autopilot takes them: what its filter says that they read at rest, in degrees a second, is taken off.
    #[test]
    fn the_gyros_bias_is_taken_off() {
        let flight = taken(&[
            ("XKF1", &[("TimeUS", 1e6), ("GX", 1.0), ("GY", -2.0), ("GZ", 0.5)]),
            ("IMU", &[("TimeUS", 1.1e6), ("GyrX", 0.1), ("GyrY", 0.2), ("GyrZ", 0.3)]),
        ]);
        let expected = [0.1 - 1_f32.to_radians(), 0.2 + 2_f32.to_radians(), 0.3 - 0.5_f32.to_radians()];
        let [row] = flight.rates.rows() else { panic!("{:?}", flight.rates) };
        assert!(row.of.iter().zip(expected).all(|(rate, expected)| (rate - expected).abs() < 1e-6), "{row:?}");
    }

    /// What was CURR is BAT; a receiver without a fix in three dimensions says nothing, and one with a single antenna no yaw.
    #[test]
    fn currents_and_fixes_are_taken_as_they_are() {
        let fix = |us: f64, status: f64| {
            let place = [("Lat", 48.0), ("Lng", 11.0), ("Alt", 500.0), ("Spd", 9.0), ("GCrs", 45.0), ("Yaw", 0.0)];
            [&[("TimeUS", us), ("Status", status)][..], &place].concat()
        };
        let flight = taken(&[
            ("CURR", &[("TimeUS", 1e6), ("Curr", 12.5)]),
            ("GPS", &fix(1.1e6, 2.0)),
            ("GPS", &fix(1.2e6, 3.0)),
        ]);
        assert_eq!(flight.current.rows().iter().map(|row| row.of[0].round() as i32).collect::<Vec<_>>(), [13]);
        let [row] = flight.gps.rows() else { panic!("{:?}", flight.gps) };
        assert!(Gps::from_columns(row.of).yaw_deg.is_nan(), "{row:?}");
    }
}
