//! What the commands print alike.

use autoswing::calibration::Calibration;
use comfy_table::{Cell, CellAlignment};
use serde_json::{Value, json};

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
