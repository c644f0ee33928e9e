//! Cases of the integrity study: fault, onset and flight.

mod case_definition;
mod case_list;

pub use case_definition::{FaultCase, FaultOnset, RandomCase};
pub use case_list::ALL_CASES;

/// The case with this name, if any.
#[must_use]
pub fn find_by_name(name: &str) -> Option<&'static FaultCase> {
    ALL_CASES.iter().find(|case| case.case_name == name)
}

#[cfg(test)]
mod tests;
