//! Unit of the field columns.

/// Unit of the field columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldUnit {
    /// Milligauss, as ArduPilot logs.
    Milligauss,
    /// Microtesla.
    Microtesla,
}

impl FieldUnit {
    pub(super) const fn microtesla(self) -> f64 {
        match self {
            Self::Milligauss => 0.1,
            Self::Microtesla => 1.0,
        }
    }
}
