//! Numeric options with ranges. Error messages and help state the same range.

use std::fmt::Display;
use std::str::FromStr;

/// Parses a number in a range; `kind` names the type in the error message.
fn number<T: FromStr + PartialOrd + Display>(text: &str, [min, max]: [T; 2], kind: &str) -> Result<T, String> {
    // Written so that NaN is rejected.
    let value = text.trim().parse().ok().filter(|value| *value >= min && *value <= max);
    value.ok_or_else(|| format!("must be {kind}, {min} to {max}"))
}

pub fn parse_number(text: &str, min: f64, max: f64) -> Result<f64, String> {
    number(text, [min, max], "a number")
}

fn parse_integer<T: FromStr + PartialOrd + Display>(text: &str, range: [T; 2]) -> Result<T, String> {
    number(text, range, "a whole number")
}

pub fn any(text: &str) -> Result<u64, String> {
    parse_integer(text, [0, u64::MAX])
}

/// A port; 0 selects a free one.
pub fn port(text: &str) -> Result<u16, String> {
    parse_integer(text, [0, u16::MAX])
}

/// A port to connect to.
pub fn known_port(text: &str) -> Result<u16, String> {
    parse_integer(text, [1, u16::MAX])
}

pub fn airframes(text: &str) -> Result<u64, String> {
    parse_integer(text, [1, 1_000_000])
}

pub fn draws(text: &str) -> Result<u64, String> {
    parse_integer(text, [1, 100_000])
}

pub fn flights(text: &str) -> Result<u64, String> {
    parse_integer(text, [1, 100_000])
}

pub fn compass(text: &str) -> Result<u8, String> {
    parse_integer(text, [1, 8])
}

pub fn system(text: &str) -> Result<u8, String> {
    parse_integer(text, [1, 255])
}

pub fn bank(text: &str) -> Result<f64, String> {
    parse_number(text, 5.0, 60.0)
}

pub fn inclination(text: &str) -> Result<f64, String> {
    parse_number(text, -90.0, 90.0)
}

pub fn age(text: &str) -> Result<f64, String> {
    parse_number(text, -200.0, 500.0)
}

pub fn seconds(text: &str) -> Result<f64, String> {
    parse_number(text, -1e9, 1e9)
}

pub fn minutes(text: &str) -> Result<f64, String> {
    parse_number(text, 1.0, 120.0)
}

pub fn current(text: &str) -> Result<f64, String> {
    parse_number(text, 0.0, 200.0)
}

pub fn circles(text: &str) -> Result<f64, String> {
    parse_number(text, 0.0, 100.0)
}

pub fn speed(text: &str) -> Result<f64, String> {
    parse_number(text, 0.01, 200.0)
}
