//! Writers of flights in every readable log format, for demonstrations and tests.

mod blackbox;
mod csv;
mod dataflash;
mod recording;
mod tlog;
mod ulog;

pub use blackbox::encode_blackbox;
pub use csv::encode_csv;
pub use dataflash::{encode_dataflash, encode_dataflash_text};
pub use recording::{FlightRecording, FlightSample};
pub use tlog::encode_tlog;
pub use ulog::encode_ulog;

use std::path::Path;

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
