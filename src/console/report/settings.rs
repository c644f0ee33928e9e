//! Settings, as `status` shows them and as a command that changes one tells it.

use core::fmt::{self, Write};

use crate::port::{PortNumber, PortSettings};
use crate::settings::{AttitudeError, Setting, Settings};
use crate::wire::decimal::{AsTyped, Decimal};

/// Settings that are told together.
#[derive(Clone, Copy)]
pub(super) enum Line {
    Stream,
    Declination,
    Inclination,
    Mount,
    AttitudeError,
    Accuracy,
    Auto,
    Port(PortNumber),
    Vision,
}

impl Line {
    pub const ALL: [Self; 10] = [
        Self::Stream,
        Self::Declination,
        Self::Inclination,
        Self::Mount,
        Self::AttitudeError,
        Self::Accuracy,
        Self::Auto,
        Self::Port(PortNumber::One),
        Self::Port(PortNumber::Two),
        Self::Vision,
    ];

    pub const fn of(setting: Setting) -> Self {
        match setting {
            Setting::StreamOn(_) | Setting::StreamRateHz(_) | Setting::StreamHeading(_) => Self::Stream,
            Setting::Declination(_) => Self::Declination,
            Setting::Inclination(_) => Self::Inclination,
            Setting::Mount(_) => Self::Mount,
            Setting::AttitudeError(_) => Self::AttitudeError,
            Setting::Accuracy(_) => Self::Accuracy,
            Setting::Auto(_) => Self::Auto,
            Setting::Protocol(port, _) | Setting::Baud(port, _) => Self::Port(port),
            Setting::Vision(_) => Self::Vision,
        }
    }
}

/// Some settings, with what stands between their name and them.
pub(super) fn setting_line(out: &mut impl Write, line: Line, between: &str, settings: &Settings) -> fmt::Result {
    match line {
        Line::Stream => {
            let on = on_or_off(settings.stream_on);
            let (rate_hz, heading) = (settings.stream_rate_hz, settings.stream_heading.name());
            write!(out, "stream{between}{on}, {rate_hz} Hz, {heading} heading")
        }
        Line::Declination => degrees(out, "declination", between, settings.declination_deg, "not set"),
        Line::Inclination => {
            degrees(out, "inclination", between, settings.inclination_deg, "not set, found from the samples")
        }
        Line::Mount => {
            write!(out, "mount{between}{}, align {} deg", settings.mount.name(), Decimal::<1>(settings.align_deg))
        }
        Line::AttitudeError => {
            let AttitudeError { bias_deg, bank_percent } = settings.attitude_error;
            let (bias, bank) = (AsTyped(bias_deg, 2), AsTyped(bank_percent, 1));
            write!(out, "attitude-error{between}{bias} deg, {bank} % of bank, 1 sigma")
        }
        Line::Accuracy => write!(out, "accuracy{between}{} deg wanted", AsTyped(settings.accuracy_deg, 1)),
        Line::Auto => {
            let words = if settings.auto_on { "collects by itself while uncalibrated" } else { "collects when asked" };
            write!(out, "auto{between}{}, {words}", on_or_off(settings.auto_on))
        }
        Line::Port(port) => {
            let PortSettings { protocol, baud } = settings.ports.of(port);
            write!(out, "port{}{between}{}, {} baud", port as u8 + 1, protocol.name(), baud.name())
        }
        Line::Vision => write!(out, "vision{between}{}", on_or_off(settings.tells_vision)),
    }
}

const fn on_or_off(on: bool) -> &'static str {
    if on { "on" } else { "off" }
}

fn degrees(out: &mut impl Write, name: &str, between: &str, deg: Option<f32>, without: &str) -> fmt::Result {
    match deg {
        Some(deg) => write!(out, "{name}{between}{} deg", AsTyped(deg, 1)),
        None => write!(out, "{name}{between}{without}"),
    }
}
