//! Version 7 of the format, as firmware before version 8 wrote it.
//!
//! Its bytes are those of [version 6](super::v6) with whether the module collects by itself behind the settings. There was
//! one port then.

use super::contents::Contents;
use super::v5;
use crate::settings::Settings;

/// The number of this version.
pub(super) const VERSION: u8 = 7;

/// Reads the bytes of this version; none if they are not of it.
#[inline(never)]
pub(super) fn read(payload: &[u8]) -> Option<Contents> {
    let (saves, settings, rest) = v5::read_head(payload)?;
    let ((accuracy_deg, auto_on), rest) = postcard::take_from_bytes(rest).ok()?;
    v5::contents(saves, Settings { accuracy_deg, auto_on, ..settings }, rest)
}
