//! Error replies.

use core::fmt::{self, Display, Write};

use crate::console::parser::LineError;
use autoswing_module::messages::Refusal;

/// Writes `error <code>: what to do`.
fn write_error(out: &mut impl Write, code: &str, advice: impl Display) -> fmt::Result {
    writeln!(out, "error {code}: {advice}")
}

/// Writes the error of an invalid line.
///
/// # Errors
///
/// Those of `out`.
pub fn write_line_error(out: &mut impl Write, line: &LineError) -> fmt::Result {
    write_error(out, line.stable_code(), line)
}

pub(super) fn write_refusal(out: &mut impl Write, refusal: &Refusal) -> fmt::Result {
    write_error(out, refusal.stable_code(), refusal)
}
