//! Version 4 of the format, as firmware before version 5 wrote it.
//!
//! Its bytes are those of [version 3](v3) with the attitude source's error between settings and calibrations. What came
//! later has its default: the smooth heading is sent, and nothing is known of the attitude's latency.

use serde::Deserialize;
#[cfg(test)]
use serde::Serialize;

use super::contents;
use super::v3;
use crate::settings;

/// The number of this version.
pub(super) const VERSION: u8 = 4;

#[derive(Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) struct AttitudeError {
    pub bias_deg: f32,
    pub bank_percent: f32,
}

/// Reads the bytes of this version; none if they are not of it.
#[inline(never)]
pub(super) fn read(payload: &[u8]) -> Option<contents::Contents> {
    let (head, rest) = postcard::take_from_bytes(payload).ok()?;
    let (AttitudeError { bias_deg, bank_percent }, rest) = postcard::take_from_bytes(rest).ok()?;
    let mut contents = v3::Contents::behind(head, rest)?.convert()?;
    contents.stored.settings.attitude_error = settings::AttitudeError { bias_deg, bank_percent };
    Some(contents)
}
