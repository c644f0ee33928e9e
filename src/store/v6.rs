//! Version 6 of the format, as firmware before version 7 wrote it.
//!
//! Its bytes are those of [version 5](super::v5) with the wanted accuracy behind the settings. Collecting by itself has its
//! default.

use super::contents::Contents;
use super::v5;
use crate::settings::Settings;

/// The number of this version.
pub(super) const VERSION: u8 = 6;

/// Reads the bytes of this version; none if they are not of it.
#[inline(never)]
pub(super) fn read(payload: &[u8]) -> Option<Contents> {
    let (saves, settings, rest) = v5::read_head(payload)?;
    let (accuracy_deg, rest) = postcard::take_from_bytes(rest).ok()?;
    v5::contents(saves, Settings { accuracy_deg, ..settings }, rest)
}
