//! Version 5 of the format, as firmware before version 6 wrote it.
//!
//! Its bytes are those of [version 4](super::v4) with which heading is sent behind the attitude source's error, and
//! calibrations as they are stored now. The wanted accuracy has its default. Whoever changes the calibrations spells them
//! out here first, as [version 3](super::v3) does.

use super::contents::{Contents, Generations, Stored};
use super::{v3, v4};
use crate::settings::{AttitudeError, HeadingKind, Settings};

/// The number of this version.
pub(super) const VERSION: u8 = 5;

/// Reads the bytes of this version; none if they are not of it.
#[inline(never)]
pub(super) fn read(payload: &[u8]) -> Option<Contents> {
    let (saves, settings, rest) = read_head(payload)?;
    contents(saves, settings, rest)
}

/// The count of saves and the settings, and what is behind them.
pub(super) fn read_head(payload: &[u8]) -> Option<(u32, Settings, &[u8])> {
    let (v3::Head { saves, settings }, rest) = postcard::take_from_bytes(payload).ok()?;
    let (v4::AttitudeError { bias_deg, bank_percent }, rest) = postcard::take_from_bytes(rest).ok()?;
    let (is_smooth, rest) = postcard::take_from_bytes(rest).ok()?;
    let settings = Settings {
        attitude_error: AttitudeError { bias_deg, bank_percent },
        stream_heading: if is_smooth { HeadingKind::Smooth } else { HeadingKind::Raw },
        ..settings.convert()?
    };
    Some((saves, settings, rest))
}

/// With the calibrations behind all settings.
pub(super) fn contents(saves: u32, settings: Settings, rest: &[u8]) -> Option<Contents> {
    let generations: Generations = postcard::from_bytes(rest).ok()?;
    Some(Contents { saves, stored: Stored { settings, generations, ..Stored::default() } })
}
