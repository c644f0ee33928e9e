//! Version 3 of the format, as firmware before version 4 wrote it, the bytes of [version 2](super::v2), and most of
//! those of [version 4](super::v4).
//!
//! Everything it contains is spelled out here and nothing of it is shared with the present contents, so that no later
//! change of those changes how it is read. What its settings and calibrations do not say is the default.

use serde::Deserialize;
#[cfg(test)]
use serde::Serialize;

use super::contents::{self, Record, Stored};
use crate::calibration;
use crate::magnetometer;
use crate::settings;
use crate::settings::PortsSettings;

/// The number of this version.
pub(super) const VERSION: u8 = 3;

#[derive(Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) struct Contents {
    pub head: Head,
    pub generations: Generations,
}

#[derive(Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) struct Head {
    pub saves: u32,
    pub settings: Settings,
}

#[derive(Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) struct Generations {
    pub current: Option<Calibrated>,
    pub previous: Option<Calibrated>,
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
}

/// A number of MAVLink's orientations: 0 to 23 in the order of [`calibration::Orientation::all`].
#[derive(Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) struct Mount(pub u8);

/// A calibration with its quality, uncertainty and sensor.
#[derive(Clone, Copy, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) struct Calibrated {
    pub w: [[f32; 3]; 3],
    pub b_ut: [f32; 3],
    pub inclination_rad: f32,
    pub total_ut: f32,
    pub method: Method,
    pub envelope: Envelope,
    pub expected_rms_deg: f32,
    pub expected_worst_deg: f32,
    pub norm_residual: f32,
    pub dip_residual_deg: f32,
    pub samples: u16,
    pub products: [[f32; 10]; 6],
    pub sensor_sigma: f32,
    pub attitude_sigma_rad: f32,
    pub model: Model,
    pub address: u8,
    pub mount: Mount,
    pub serial: u32,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) enum Method {
    Level,
    FourEllipse,
    TwoPlane,
    MaximumLikelihood,
    CompassSwing,
    Ellipsoid,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) enum Envelope {
    Banked,
    Level,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[cfg_attr(test, derive(Serialize))]
pub(super) enum Model {
    Lis3mdl,
    Lsm303dlhc,
}

impl Contents {
    /// Reads the bytes of this version; none if they are not of it.
    pub fn read(payload: &[u8]) -> Option<Self> {
        let (head, rest) = postcard::take_from_bytes(payload).ok()?;
        Self::behind(head, rest)
    }

    /// With the calibrations behind the head. Not inlined, so that two versions share the code that reads them.
    #[inline(never)]
    pub fn behind(head: Head, rest: &[u8]) -> Option<Self> {
        Some(Self { head, generations: postcard::from_bytes(rest).ok()? })
    }

    /// The same in the present version's types; none if a mounting is not one of the 24. Other values are not checked.
    pub fn convert(&self) -> Option<contents::Contents> {
        let record = |calibrated: &Option<Calibrated>| match calibrated {
            Some(calibrated) => calibrated.convert().map(Some),
            None => Some(None),
        };
        let Self { head: Head { saves, settings }, generations: Generations { current, previous } } = self;
        let generations = contents::Generations { current: record(current)?, previous: record(previous)? };
        let stored = Stored { settings: settings.convert()?, generations, ..Stored::default() };
        Some(contents::Contents { saves: *saves, stored })
    }
}

impl Settings {
    pub fn convert(&self) -> Option<settings::Settings> {
        Some(settings::Settings {
            declination_deg: self.declination_deg,
            inclination_deg: self.inclination_deg,
            align_deg: self.align_deg,
            stream_on: self.stream_on,
            stream_rate_hz: self.stream_rate_hz,
            mount: self.mount.convert()?,
            ports: PortsSettings::BEFORE_THERE_WERE_TWO,
            ..settings::Settings::DEFAULT
        })
    }
}

impl Mount {
    fn convert(self) -> Option<calibration::Orientation> {
        calibration::Orientation::all().nth(usize::from(self.0))
    }
}

impl Calibrated {
    fn convert(&self) -> Option<Record> {
        Some(Record {
            calibration: calibration::Calibration {
                w: self.w,
                b_ut: self.b_ut,
                inclination_rad: self.inclination_rad,
                total_ut: self.total_ut,
                latency_s: 0.0,
                current: calibration::CurrentIron::NONE,
            },
            quality: calibration::Quality {
                method: self.method.convert(),
                envelope: self.envelope.convert(),
                expected_rms_deg: self.expected_rms_deg,
                expected_worst_deg: self.expected_worst_deg,
                norm_residual: self.norm_residual,
                dip_residual_deg: self.dip_residual_deg,
                samples: self.samples,
                latency: None,
            },
            uncertainty: calibration::Uncertainty {
                products: self.products,
                sensor_sigma: self.sensor_sigma,
                attitude_sigma_rad: self.attitude_sigma_rad,
            },
            sensor: magnetometer::Identity { model: self.model.convert(), address: self.address },
            mount: self.mount.convert()?,
            serial: self.serial,
        })
    }
}

impl Method {
    const fn convert(self) -> calibration::Method {
        use calibration::Method as Present;
        match self {
            Self::Level => Present::Level,
            Self::FourEllipse => Present::FourEllipse,
            Self::TwoPlane => Present::TwoPlane,
            Self::MaximumLikelihood => Present::MaximumLikelihood,
            Self::CompassSwing => Present::CompassSwing,
            Self::Ellipsoid => Present::Ellipsoid,
        }
    }
}

impl Envelope {
    const fn convert(self) -> calibration::Envelope {
        match self {
            Self::Banked => calibration::Envelope::Banked,
            Self::Level => calibration::Envelope::Level,
        }
    }
}

impl Model {
    const fn convert(self) -> magnetometer::Model {
        match self {
            Self::Lis3mdl => magnetometer::Model::Lis3mdl,
            Self::Lsm303dlhc => magnetometer::Model::Lsm303dlhc,
        }
    }
}
