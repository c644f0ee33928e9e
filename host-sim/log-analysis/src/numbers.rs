//! Numbers as text and in JSON, and their statistics.

use autoswing::calibration::Calibration;
use serde::Serialize;
use serde_json::{Value, json};

/// Rounds for JSON; a negative value that rounds to zero becomes plain zero.
#[must_use]
pub fn round_to(value: f64, decimals: i32) -> f64 {
    let scale = libm::pow(10.0, f64::from(decimals));
    (value * scale).round() / scale + 0.0
}

/// Decimals by the suffix of a field's name: the meaningful digits and one more.
const DECIMALS_BY_SUFFIX: [(&str, i32); 7] =
    [("soft_iron", 4), ("_deg", 3), ("_percent", 2), ("_ut", 3), ("_ms", 3), ("_s", 2), ("readings", 0)];

/// Decimals of ratios and of values without unit.
const DEFAULT_DECIMALS: i32 = 3;

/// Field that is not rounded: the calibration itself, at most nine digits of an f32.
const UNROUNDED_FIELD: &str = "coefficients";

/// Rounds all numbers of a value for JSON, by the names of their fields; see docs/json.md.
pub fn round_all_numbers(value: &mut Value) {
    round_by_name(value, DEFAULT_DECIMALS);
}

fn round_by_name(value: &mut Value, decimals: i32) {
    match value {
        Value::Number(number) if number.is_f64() => {
            *value = json!(round_to(number.as_f64().unwrap_or(f64::NAN), decimals));
        }
        Value::Array(values) => values.iter_mut().for_each(|value| round_by_name(value, decimals)),
        Value::Object(fields) => {
            for (name, value) in fields.iter_mut().filter(|(name, _)| *name != UNROUNDED_FIELD) {
                let unit_decimals = DECIMALS_BY_SUFFIX.iter().find(|(suffix, _)| name.ends_with(suffix));
                round_by_name(value, unit_decimals.map_or(decimals, |(_, decimals)| *decimals));
            }
        }
        _ => {}
    }
}

/// Microtesla per milligauss.
pub const UT_PER_MILLIGAUSS: f64 = 0.1;
/// Microtesla per gauss.
pub const UT_PER_GAUSS: f64 = 100.0;

/// Square; `f64::powi` may round differently on another platform.
#[must_use]
pub fn square(value: f64) -> f64 {
    value * value
}

/// The f64 with the f32's shortest decimal form: 0.1, not 0.10000000149.
#[must_use]
pub fn f32_as_f64(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::NAN)
}

/// Name of an enumeration's value in JSON.
pub fn json_name(value: impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|name| Some(name.as_str()?.to_owned())).unwrap_or_default()
}

/// Coefficients of a calibration for JSON: at most nine digits, as of an f32.
pub fn coefficients_json(calibration: &Calibration) -> Value {
    json!({
        "w": calibration.w.as_flattened().iter().copied().map(f32_as_f64).collect::<Vec<_>>(),
        "b_ut": calibration.b_ut.map(f32_as_f64),
    })
}

/// Mean; NaN without numbers.
pub fn mean(numbers: impl IntoIterator<Item = f64>) -> f64 {
    let mut count = 0_usize;
    let sum: f64 = numbers.into_iter().inspect(|_| count += 1).sum();
    sum / count as f64
}

/// Root mean square; NaN without numbers.
pub fn rms(numbers: impl IntoIterator<Item = f64>) -> f64 {
    mean(numbers.into_iter().map(square)).sqrt()
}

/// Quantile of the numbers at a `fraction` of 0 to 1, nearest rank; `None` without numbers.
pub fn quantile(numbers: impl IntoIterator<Item = f64>, fraction: f64) -> Option<f64> {
    let mut sorted: Vec<f64> = numbers.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1);
    sorted.get((fraction * last as f64).round() as usize).copied()
}

/// Median; NaN without numbers.
pub fn median(numbers: impl IntoIterator<Item = f64>) -> f64 {
    quantile(numbers, 0.5).unwrap_or(f64::NAN)
}

/// Ratio of the standard deviation to the median of absolute values of a normal distribution.
pub const SIGMAS_PER_MEDIAN: f64 = 1.4826;

/// Evenly spaced values, at most `max_count`.
pub fn thinned<T: Copy>(values: &[T], max_count: usize) -> Vec<T> {
    values.iter().step_by(values.len().div_ceil(max_count).max(1)).copied().collect()
}

/// Circular mean of finite angles, degrees.
pub fn mean_angle_deg(angles: impl IntoIterator<Item = f64>) -> Option<f64> {
    let finite = angles.into_iter().filter(|angle| angle.is_finite());
    let sums = finite.map(|angle| libm::sincos(angle.to_radians())).fold(None, |sums, (sin, cos)| {
        let (sin_sum, cos_sum) = sums.unwrap_or((0.0, 0.0));
        Some((sin_sum + sin, cos_sum + cos))
    });
    sums.map(|(sin_sum, cos_sum)| libm::atan2(sin_sum, cos_sum).to_degrees())
}

/// Formats a number; a dash if it is not finite.
#[must_use]
pub fn format_number(value: f64, decimals: usize) -> String {
    if !value.is_finite() {
        return "–".to_owned();
    }
    let text = format!("{value:.decimals$}");
    // A value that is rounded to zero is formatted without a minus sign.
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

    /// Powers up to 1e22 are exact in an f64.
    #[test]
    fn powers_of_ten_for_rounding_are_exact() {
        for decimals in 0..=15 {
            let power: f64 = format!("1e{decimals}").parse().unwrap();
            assert_eq!(libm::pow(10.0, f64::from(decimals)).to_bits(), power.to_bits(), "{decimals}");
        }
        let rounded = [round_to(0.125_4, 3), round_to(-0.000_1, 3)];
        assert_eq!(rounded.map(f64::to_bits), [0.125, 0.0].map(f64::to_bits));
    }

    #[test]
    fn numbers_are_rounded_to_the_digits_of_their_unit() {
        let mut value = json!({
            "rms_deg": 0.123_456_789, "ratio": 1.000_55, "within_percent": [68.268_9, 95.0], "wrong": 3,
            "readings": 191.6, "mean_deg": -0.000_01,
            "coefficients": { "w": [1.012_345_6] }, "errors": [{ "right_deg": [[1.234_56]] }],
        });
        round_all_numbers(&mut value);
        let expected = json!({
            "rms_deg": 0.123, "ratio": 1.001, "within_percent": [68.27, 95.0], "wrong": 3,
            "readings": 192.0, "mean_deg": 0.0,
            "coefficients": { "w": [1.012_345_6] }, "errors": [{ "right_deg": [[1.235]] }],
        });
        assert_eq!(value, expected);
        assert_eq!(value["mean_deg"].to_string(), "0.0");
    }

    #[test]
    fn nan_and_none_are_dashes_and_zero_has_no_sign() {
        assert_eq!(format_number(-0.001, 2), "0.00");
        assert_eq!(format_number(-0.006, 2), "-0.01");
        assert_eq!(format_number(f64::NAN, 2), "–");
        assert_eq!(format_optional(None, 1), "–");
    }
}
