//! Cases of the integrity study: fault, onset and flight.

mod definition;
mod list;

pub use definition::{FaultCase, FaultOnset, RandomCase};
pub use list::ALL_CASES;

/// The case with this name, if any.
#[must_use]
pub fn find_by_name(name: &str) -> Option<&'static FaultCase> {
    ALL_CASES.iter().find(|case| case.case_name == name)
}

#[cfg(test)]
mod tests;
