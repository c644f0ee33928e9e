//! What the commands print alike.

use std::path::Path;

use autoswing::calibration::Calibration;
use comfy_table::{Cell, CellAlignment};
use host_sim::report::{self, Report};
use serde_json::{Value, json};

use super::Failure;

/// Writes a page and says where it is: not on standard output, whose last line may belong to a JSON object.
pub fn write_report(report: &Report, path: &Path) -> Result<(), Failure> {
    let written = report::write(report, path)
        .map_err(|error| Failure(format!("cannot write the report to {}: {error}", path.display())))?;
    eprintln!("report: {}", written.display());
    Ok(())
}

/// The command line, as a shell would take it again; the program by its name alone.
pub fn command_line() -> String {
    let words = std::env::args().skip(1).map(|word| {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+@%".contains(c);
        let is_word = !word.is_empty() && word.chars().all(is_plain);
        if is_word { word } else { format!("'{}'", word.replace('\'', "'\\''")) }
    });
    std::iter::once("host-sim".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}

/// The twelve coefficients.
pub fn coefficients(calibration: &Calibration) -> Value {
    json!({
        "w": calibration.w.as_flattened().iter().copied().map(shortest).collect::<Vec<_>>(),
        "b_ut": calibration.b_ut.map(shortest),
    })
}

/// The f64 that prints as the f32 does: 0.1 and not 0.10000000149.
pub fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::NAN)
}

/// Rounded to so many decimals, for JSON that people read.
pub fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10_f64.powi(decimals);
    (value * scale).round() / scale
}

pub fn right_aligned(text: impl ToString) -> Cell {
    Cell::new(text).set_alignment(CellAlignment::Right)
}
