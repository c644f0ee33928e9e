//! Failure of a command.

/// Reason why a command failed; exit code 2.
#[derive(Debug)]
pub struct CommandFailure(pub String);

impl CommandFailure {
    /// An error with its stable code.
    pub fn with_code(code: &str, error: impl std::fmt::Display) -> Self {
        Self(format!("{code}: {error}"))
    }
}
