//! Numbers as text and in JSON.

/// Rounds for JSON; a negative value that rounds to zero becomes plain zero.
#[must_use]
pub fn round_to(value: f64, decimals: i32) -> f64 {
    let scale = 10_f64.powi(decimals);
    (value * scale).round() / scale + 0.0
}

/// The f64 with the f32's shortest decimal form: 0.1, not 0.10000000149.
#[must_use]
pub fn f32_as_f64(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::NAN)
}

/// Formats a number; a dash if it is not finite.
#[must_use]
pub fn format_number(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let text = format!("{value:.decimals$}");
    // No minus sign before zero.
    if text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.')) { text.replace('-', "") } else { text }
}

/// Formats a number; a dash for none.
#[must_use]
pub fn format_optional(value: Option<f64>, decimals: usize) -> String {
    format_number(value.unwrap_or(f64::NAN), decimals)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_safe() {
        assert_eq!(format_number(-0.001, 2), "0.00");
        assert_eq!(format_number(-0.006, 2), "-0.01");
        assert_eq!(format_number(f64::NAN, 2), "–");
        assert_eq!(format_optional(None, 1), "–");
    }
}
