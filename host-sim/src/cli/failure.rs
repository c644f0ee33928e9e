//! Failure of a command.

/// Reason why a command failed; exit code 2.
#[derive(Debug)]
pub struct Failure(pub String);
