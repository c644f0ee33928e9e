//! Parsers of option values. Error messages and help state the same range or names.

use std::fmt::Display;
use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde::de::value::Error as UnknownName;
use serde::de::{DeserializeOwned, IntoDeserializer};

/// Parses a number in a range.
pub fn number_in_range(min: f64, max: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    parse_in_range(min, max, "a number")
}

/// Parses a whole number in a range.
pub fn integer_in_range<T: OptionNumber>(
    min: T,
    max: T,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    parse_in_range(min, max, "a whole number")
}

/// A number that an option takes.
pub trait OptionNumber: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static {}

impl<T: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static> OptionNumber for T {}

/// Parses a number in a range; `type_name` is the name of the type in the error message.
fn parse_in_range<T: OptionNumber>(
    min: T,
    max: T,
    type_name: &'static str,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    move |text| {
        // The comparison rejects NaN.
        let value = text.trim().parse().ok().filter(|value| *value >= min && *value <= max);
        value.ok_or_else(|| format!("must be {type_name}, {min} to {max}"))
    }
}

/// Parses a time of a log: seconds, `M:SS` or `H:MM:SS`.
///
/// # Errors
///
/// The text is no time.
pub fn parse_log_time(text: &str) -> Result<f64, String> {
    let (sign, unsigned_text) =
        text.trim().strip_prefix('-').map_or((1.0, text.trim()), |unsigned_text| (-1.0, unsigned_text));
    let parts: Option<Vec<f64>> = unsigned_text.split(':').map(|part| part.parse().ok()).collect();
    let seconds = parts.filter(|parts| {
        let (first, later) = (parts.first().copied().unwrap_or(f64::NAN), parts.get(1..).unwrap_or_default());
        later.len() <= 2 && (0.0..=1e10).contains(&first) && later.iter().all(|part| (0.0..60.0).contains(part))
    });
    let seconds = seconds.map(|parts| sign * parts.iter().fold(0.0, |total, part| 60.0 * total + part));
    seconds.ok_or_else(|| "must be seconds, -10000000000 to 10000000000, or M:SS or H:MM:SS".to_owned())
}

/// Parses one of several names.
pub fn named_value<T: Copy + Send + Sync + 'static>(
    values: &'static [(&'static str, T)],
) -> impl TypedValueParser<Value = T> {
    let names = PossibleValuesParser::new(values.iter().map(|(name, _)| *name));
    names.try_map(|name| {
        values.iter().find(|(known_name, _)| *known_name == name).map(|(_, value)| *value).ok_or("unknown")
    })
}

/// Parses one of the names, separated by `|`; they are those of the values in JSON.
#[must_use]
pub fn one_of<T: DeserializeOwned + Clone + Send + Sync + 'static>(
    names: &'static str,
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(names.split('|')).try_map(|name| value_of_name(&name))
}

/// Value of a name in JSON.
///
/// # Errors
///
/// The type has no value of this name.
pub fn value_of_name<T: DeserializeOwned>(name: &str) -> Result<T, UnknownName> {
    T::deserialize(name.into_deserializer())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_of_a_log_is_seconds_or_has_minutes() {
        for (text, seconds) in [("41.5", 41.5), ("-3", -3.0), ("1:30", 90.0), ("1:02:03.5", 3723.5), ("100:00", 6000.0)]
        {
            assert_eq!(parse_log_time(text), Ok(seconds), "{text}");
        }
        for text in ["", "x", "1:60", "1:-3", "1:2:3:4", "--3", "NaN", "inf", "2e10", "1:"] {
            assert!(parse_log_time(text).is_err(), "{text}");
        }
    }
}
