//! Unit of the field columns.

use serde::Deserialize;

/// Unit of the field columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub enum FieldUnit {
    /// Milligauss, as ArduPilot logs.
    #[serde(rename = "mg")]
    Milligauss,
    /// Microtesla.
    #[serde(rename = "ut")]
    Microtesla,
}

impl FieldUnit {
    pub(super) const fn microtesla_per_unit(self) -> f64 {
        match self {
            Self::Milligauss => 0.1,
            Self::Microtesla => 1.0,
        }
    }
}
