//! Numbers of the command line. Each says its range where it refuses, and the help says the same.

use std::fmt::Display;
use std::str::FromStr;

/// A number with its range; `kind` is what it has to be.
fn number<T: FromStr + PartialOrd + Display>(text: &str, [min, max]: [T; 2], kind: &str) -> Result<T, String> {
    // In range is what lies between, so that what is not a number is not.
    let value = text.trim().parse().ok().filter(|value| *value >= min && *value <= max);
    value.ok_or_else(|| format!("must be {kind}, {min} to {max}"))
}

/// A number that may have a fraction.
pub fn within(text: &str, min: f64, max: f64) -> Result<f64, String> {
    number(text, [min, max], "a number")
}

fn whole<T: FromStr + PartialOrd + Display>(text: &str, range: [T; 2]) -> Result<T, String> {
    number(text, range, "a whole number")
}

/// Any seed.
pub fn any(text: &str) -> Result<u64, String> {
    whole(text, [0, u64::MAX])
}

/// A port; 0 is any that is free.
pub fn port(text: &str) -> Result<u16, String> {
    whole(text, [0, u16::MAX])
}

/// A port of somebody who is there.
pub fn known_port(text: &str) -> Result<u16, String> {
    whole(text, [1, u16::MAX])
}

pub fn airframes(text: &str) -> Result<u64, String> {
    whole(text, [1, 1_000_000])
}

pub fn draws(text: &str) -> Result<u64, String> {
    whole(text, [1, 100_000])
}

pub fn flights(text: &str) -> Result<u64, String> {
    whole(text, [1, 100_000])
}

pub fn compass(text: &str) -> Result<u8, String> {
    whole(text, [1, 8])
}

pub fn system(text: &str) -> Result<u8, String> {
    whole(text, [1, 255])
}

pub fn bank(text: &str) -> Result<f64, String> {
    within(text, 5.0, 60.0)
}

pub fn inclination(text: &str) -> Result<f64, String> {
    within(text, -90.0, 90.0)
}

pub fn age(text: &str) -> Result<f64, String> {
    within(text, -200.0, 500.0)
}

pub fn seconds(text: &str) -> Result<f64, String> {
    within(text, -1e9, 1e9)
}

pub fn minutes(text: &str) -> Result<f64, String> {
    within(text, 1.0, 120.0)
}

pub fn current(text: &str) -> Result<f64, String> {
    within(text, 0.0, 200.0)
}

pub fn circles(text: &str) -> Result<f64, String> {
    within(text, 0.0, 100.0)
}

pub fn speed(text: &str) -> Result<f64, String> {
    within(text, 0.01, 200.0)
}
