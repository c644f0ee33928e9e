//! Parsers of option values. Error messages and help state the same range or names.

use std::fmt::Display;
use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use simulator::world::aircraft::VehicleKind;

/// Vehicles of the studies.
pub const AIRCRAFT: &[(&str, VehicleKind)] =
    &[("plane", VehicleKind::Plane), ("copter", VehicleKind::Copter), ("vtol", VehicleKind::Vtol)];

/// Parses a number in a range.
pub fn number(min: f64, max: f64) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    in_range(min, max, "a number")
}

/// Parses a whole number in a range.
pub fn integer<T: Number>(min: T, max: T) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    in_range(min, max, "a whole number")
}

pub trait Number: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static {}

impl<T: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static> Number for T {}

/// Parses a number in a range; `kind` names the type in the error message.
fn in_range<T: Number>(
    min: T,
    max: T,
    kind: &'static str,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static {
    move |text| {
        // Written so that NaN is rejected.
        let value = text.trim().parse().ok().filter(|value| *value >= min && *value <= max);
        value.ok_or_else(|| format!("must be {kind}, {min} to {max}"))
    }
}

/// Parses one of several names.
pub fn one_of<T: Copy + Send + Sync + 'static>(
    values: &'static [(&'static str, T)],
) -> impl TypedValueParser<Value = T> {
    let names = PossibleValuesParser::new(values.iter().map(|(name, _)| *name));
    names.try_map(|name| values.iter().find(|(known, _)| *known == name).map(|(_, value)| *value).ok_or("unknown"))
}
