//! Version 5 of the format, as firmware before version 6 wrote it.
//!
//! Its settings lack the wanted accuracy, which has its default; its calibrations are stored as now. Whoever changes
//! those spells them out here first, as [version 3](super::v3) does.

use serde::Deserialize;
#[cfg(test)]
use serde::Serialize;

use super::contents::{Contents, Generations, Stored};
use super::v3::Mount;
use super::v4::AttitudeError;
use crate::settings;

/// The number of this version.
pub(super) const VERSION: u8 = 5;

#[derive(Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) struct Head {
    pub saves: u32,
    pub settings: Settings,
}

#[derive(Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) struct Settings {
    pub declination_deg: Option<f32>,
    pub inclination_deg: Option<f32>,
    pub align_deg: f32,
    pub stream_on: bool,
    pub stream_rate_hz: u8,
    pub mount: Mount,
    pub attitude_error: AttitudeError,
    pub is_smooth: bool,
}

/// Reads the bytes of this version; none if they are not of it.
#[inline(never)]
pub(super) fn read(payload: &[u8]) -> Option<Contents> {
    let (head, rest): (Head, _) = postcard::take_from_bytes(payload).ok()?;
    let generations: Generations = postcard::from_bytes(rest).ok()?;
    Some(Contents { saves: head.saves, stored: Stored { settings: head.settings.convert()?, generations } })
}

impl Settings {
    fn convert(&self) -> Option<settings::Settings> {
        let AttitudeError { bias_deg, bank_percent } = self.attitude_error;
        Some(settings::Settings {
            declination_deg: self.declination_deg,
            inclination_deg: self.inclination_deg,
            align_deg: self.align_deg,
            stream_on: self.stream_on,
            stream_rate_hz: self.stream_rate_hz,
            mount: self.mount.convert()?,
            attitude_error: settings::AttitudeError { bias_deg, bank_percent },
            stream_heading: if self.is_smooth { settings::HeadingKind::Smooth } else { settings::HeadingKind::Raw },
            ..settings::Settings::DEFAULT
        })
    }
}
