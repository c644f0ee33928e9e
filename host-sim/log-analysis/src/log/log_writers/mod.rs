//! Writers of flights in every readable log format, for demonstrations and tests.

mod blackbox;
mod dataflash;
mod recording;
mod tlog;
mod ulog;

use std::fmt::Write as _;
use std::path::Path;

pub use blackbox::encode_blackbox;
pub use dataflash::{encode_dataflash, encode_dataflash_text};
pub use recording::{FlightRecording, FlightSample};
pub use tlog::encode_tlog;
pub use ulog::encode_ulog;

/// Encodes a recording by a file's extension: `.bin`, `.log`, `.ulg`, `.tlog`, `.bbl`, else a table.
#[must_use]
pub fn encode_for_path(path: &Path, recording: &FlightRecording) -> Vec<u8> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("bin") => encode_dataflash(recording),
        Some("log") => encode_dataflash_text(recording),
        Some("ulg") => encode_ulog(recording),
        Some("tlog") => encode_tlog(recording),
        Some("bbl") => encode_blackbox(recording),
        _ => encode_csv(recording),
    }
}

/// Encodes a recording as a table, milligauss.
pub fn encode_csv(recording: &FlightRecording) -> Vec<u8> {
    let mut text = String::from(
        "t_s,mx,my,mz,roll_deg,pitch_deg,yaw_ref_deg,p_dps,q_dps,r_dps,current_a,armed,lat_deg,lon_deg,height_m,\
         speed_m_s,course_deg\n",
    );
    let mut last = None;
    for sample in &recording.samples {
        let field = sample.field_ut.first().copied().unwrap_or_default().map(|axis| axis * 10.0);
        let [roll, pitch, _] = sample.attitude_rad.map(f64::to_degrees);
        // The mean rate since the last row, approximated by the mean of both ends.
        let now = sample.rates_rad_s.map(f64::to_degrees);
        let [p, q, r] = std::array::from_fn(|axis| now[axis].midpoint(last.unwrap_or(now)[axis]));
        last = Some(now);
        let [speed_m_s, course_rad] = sample.speed_and_course();
        let position_cells = recording.sample_position(sample).map_or_else(
            || ",,,,".to_owned(),
            |[a, b, c]| format!("{a:.7},{b:.7},{c:.1},{speed_m_s:.2},{:.2}", course_rad.to_degrees()),
        );
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:.3},{:.1},{:.1},{:.1},{roll:.2},{pitch:.2},{:.2},{p:.3},{q:.3},{r:.3},{:.2},{},{position_cells}",
            sample.time_us as f64 / 1e6,
            field[0],
            field[1],
            field[2],
            sample.heading_rad.to_degrees(),
            sample.current_a,
            u8::from(sample.is_armed),
        );
    }
    text.into_bytes()
}
