//! Settings: what the user has chosen.

mod ports;

use core::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::calibration::{Consider, Orientation};
pub use ports::{Baud, PORTS, PortNumber, PortSettings, PortsSettings, ProtocolKind};

/// What the user has chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Magnetic declination (variation), degrees, east positive; none if it was never entered.
    pub declination_deg: Option<f32>,
    /// Inclination of the Earth field where the module is used, degrees, positive down; none if it was never entered.
    pub inclination_deg: Option<f32>,
    /// Added to every heading, degrees: by how much the attitude source, or the sensor where no attitude shows its
    /// mounting, is turned from the vehicle's axis.
    pub align_deg: f32,
    /// Whether heading is sent on the autopilot port.
    pub stream_on: bool,
    /// Headings a second on the autopilot port.
    pub stream_rate_hz: u8,
    /// How the chip sits in the aircraft.
    pub mount: Orientation,
    /// What the attitude source is allowed to be off, alike in all samples of a flight.
    pub attitude_error: AttitudeError,
    /// Which heading is sent.
    pub stream_heading: HeadingKind,
    /// The heading error to expect at which a collection in flight is over, degrees RMS.
    pub accuracy_deg: f32,
    /// Whether an uncalibrated module begins to collect by itself when it flies.
    pub auto_on: bool,
    /// What is spoken on the ports, and how fast.
    pub ports: PortsSettings,
    /// Whether a true yaw is told to an autopilot that takes one instead of its own.
    pub tells_vision: bool,
}

/// One of the two headings of an instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum HeadingKind {
    /// By the field and the attitude of that instant alone: for an autopilot that has a filter of its own.
    Raw,
    /// Smoothed by the attitude source's body rates; the raw one where there are none, or where they contradict it.
    Smooth,
}

impl HeadingKind {
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::Raw, Self::Smooth];

    /// The word for it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Raw => "raw",
            Self::Smooth => "smooth",
        }
    }

    /// The one of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// Errors of an attitude source that are alike in all samples of a flight, 1 sigma. No turn shows them; the expected
/// error of a calibration allows for them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AttitudeError {
    /// Constant error of roll, and of pitch, degrees.
    pub bias_deg: f32,
    /// Relative error of bank in turns, percent.
    pub bank_percent: f32,
}

impl AttitudeError {
    /// A good autopilot, levelled with care: 0.2 deg and 1 %, as [`Consider::DEFAULT`].
    pub const DEFAULT: Self = Self { bias_deg: 0.2, bank_percent: 1.0 };

    /// Constant errors that can be allowed for, degrees.
    pub const BIAS_DEG: RangeInclusive<f32> = 0.0..=5.0;

    /// Errors of bank that can be allowed for, percent.
    pub const BANK_PERCENT: RangeInclusive<f32> = 0.0..=20.0;

    /// The same in the solver's units.
    #[must_use]
    pub fn consider(self) -> Consider {
        Consider { bias_rad: self.bias_deg.to_radians(), bank_scale: self.bank_percent / 100.0 }
    }

    fn is_valid(self) -> bool {
        Self::BIAS_DEG.contains(&self.bias_deg) && Self::BANK_PERCENT.contains(&self.bank_percent)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Settings {
    /// As delivered: ten sentences a second is what autopilots expect of a compass. The accuracy is one that a whole routine
    /// gives: what is expected after its first pushes is not sure yet, and of copters that stopped at 0.7 deg one in six was
    /// wrong by more than three times of it.
    pub const DEFAULT: Self = Self {
        declination_deg: None,
        inclination_deg: None,
        align_deg: 0.0,
        stream_on: true,
        stream_rate_hz: 10,
        mount: Orientation::NONE,
        attitude_error: AttitudeError::DEFAULT,
        stream_heading: HeadingKind::Smooth,
        accuracy_deg: 0.5,
        auto_on: true,
        ports: PortsSettings::DEFAULT,
        tells_vision: false,
    };

    /// Declinations, degrees.
    pub const DECLINATION_DEG: RangeInclusive<f32> = -180.0..=180.0;

    /// Inclinations, degrees.
    pub const INCLINATION_DEG: RangeInclusive<f32> = -90.0..=90.0;

    /// Rates that can be chosen: up to one heading for every measurement.
    pub const STREAM_RATE_HZ: RangeInclusive<u8> = 1..=80;

    /// Accuracies that can be wanted, degrees RMS: no compass is better than the first, and a calibration that is worse
    /// than the last is not accepted.
    pub const ACCURACY_DEG: RangeInclusive<f32> = 0.2..=3.0;

    /// Whether every setting is within its range: [`Self::DECLINATION_DEG`], [`Self::INCLINATION_DEG`], alignment
    /// -180..180 deg, rate [`Self::STREAM_RATE_HZ`], the attitude's error [`AttitudeError::BIAS_DEG`] and
    /// [`AttitudeError::BANK_PERCENT`], and the wanted accuracy [`Self::ACCURACY_DEG`].
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.declination_deg.is_none_or(|declination_deg| Self::DECLINATION_DEG.contains(&declination_deg))
            && self.inclination_deg.is_none_or(|inclination_deg| Self::INCLINATION_DEG.contains(&inclination_deg))
            && self.align_deg.abs() <= 180.0
            && Self::STREAM_RATE_HZ.contains(&self.stream_rate_hz)
            && self.mount.is_valid()
            && self.attitude_error.is_valid()
            && Self::ACCURACY_DEG.contains(&self.accuracy_deg)
    }
}

/// One setting, changed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setting {
    /// Heading sentences on or off.
    StreamOn(bool),
    /// Heading sentences a second.
    StreamRateHz(u8),
    /// Which heading they tell.
    StreamHeading(HeadingKind),
    /// Variation (declination) for the sentences, degrees, east positive; none: left out.
    Declination(Option<f32>),
    /// Inclination of the Earth field here, degrees, positive down; none: found from the samples.
    Inclination(Option<f32>),
    /// How the sensor sits in the aircraft.
    Mount(Orientation),
    /// What the attitude source is allowed to be off.
    AttitudeError(AttitudeError),
    /// The heading error to expect at which a collection in flight is over, degrees RMS.
    Accuracy(f32),
    /// Whether an uncalibrated module begins to collect by itself.
    Auto(bool),
    /// What is spoken on a port.
    Protocol(PortNumber, ProtocolKind),
    /// How fast a port is.
    Baud(PortNumber, Baud),
    /// Whether a true yaw is told to an autopilot.
    Vision(bool),
}

/// A value outside its range; what it must be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfRange(pub &'static str);

impl Setting {
    /// Whether a solve under way rests on this setting, so that it must not change until that has ended.
    #[must_use]
    pub const fn is_used_by_solves(self) -> bool {
        match self {
            Self::Inclination(_) | Self::Mount(_) | Self::AttitudeError(_) => true,
            Self::StreamOn(_)
            | Self::StreamRateHz(_)
            | Self::StreamHeading(_)
            | Self::Declination(_)
            | Self::Accuracy(_)
            | Self::Auto(_)
            | Self::Protocol(..)
            | Self::Baud(..)
            | Self::Vision(_) => false,
        }
    }

    const fn range(self) -> &'static str {
        match self {
            Self::StreamOn(_) | Self::Auto(_) | Self::Vision(_) => "on or off",
            Self::StreamRateHz(_) => "a rate is 1 to 80 sentences a second",
            Self::StreamHeading(_) => "a heading is raw or smooth",
            Self::Declination(_) => "a declination is -180 to 180 degrees",
            Self::Inclination(_) => "an inclination is -90 to 90 degrees, positive down",
            Self::Mount(_) => "a mounting is one of the 24 right-angle ones",
            Self::AttitudeError(_) => "a constant error is 0 to 5 degrees, one of bank 0 to 20 percent",
            Self::Accuracy(_) => "an accuracy is 0.2 to 3 degrees",
            Self::Protocol(..) => "a protocol that this firmware was built with",
            Self::Baud(..) => "57600, 115200, 230400 or 460800 baud",
        }
    }
}

impl Settings {
    /// The settings with one of them changed.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] when they would not be [valid](Self::is_valid).
    pub fn with(self, setting: Setting) -> Result<Self, OutOfRange> {
        let mut changed = self;
        match setting {
            Setting::StreamOn(on) => changed.stream_on = on,
            Setting::StreamRateHz(hz) => changed.stream_rate_hz = hz,
            Setting::StreamHeading(kind) => changed.stream_heading = kind,
            Setting::Declination(deg) => changed.declination_deg = deg,
            Setting::Inclination(deg) => changed.inclination_deg = deg,
            Setting::Mount(mount) => changed.mount = mount,
            Setting::AttitudeError(error) => changed.attitude_error = error,
            Setting::Accuracy(deg) => changed.accuracy_deg = deg,
            Setting::Auto(on) => changed.auto_on = on,
            Setting::Protocol(port, protocol) => changed.ports.of_mut(port).protocol = protocol,
            Setting::Baud(port, baud) => changed.ports.of_mut(port).baud = baud,
            Setting::Vision(on) => changed.tells_vision = on,
        }
        if changed.is_valid() { Ok(changed) } else { Err(OutOfRange(setting.range())) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn attitude_error(bias_deg: f32, bank_percent: f32) -> Setting {
        Setting::AttitudeError(AttitudeError { bias_deg, bank_percent })
    }

    /// What the solver takes for a good autopilot is what is delivered: 0.2 deg and 1 %, to the digits it is given in.
    #[test]
    fn an_attitude_error_is_the_solver_s_in_other_units() {
        for (error, of) in [
            (AttitudeError::DEFAULT, Consider::DEFAULT),
            (
                AttitudeError { bias_deg: 2.0, bank_percent: 5.0 },
                Consider { bias_rad: 0.034_906_585, bank_scale: 0.05 },
            ),
        ] {
            let Consider { bias_rad, bank_scale } = error.consider();
            assert!((bias_rad / of.bias_rad - 1.0).abs() < 0.003, "{error:?}");
            assert!((bank_scale / of.bank_scale - 1.0).abs() < 1e-6, "{error:?}");
        }
    }

    /// Each range from both sides; what is refused names its range.
    #[test]
    fn every_setting_has_its_range() {
        let nan = f32::NAN;
        for (good, bad, words) in [
            (
                &[Setting::StreamRateHz(1), Setting::StreamRateHz(80)][..],
                &[Setting::StreamRateHz(0), Setting::StreamRateHz(81)][..],
                "a rate is 1 to 80",
            ),
            (
                &[Setting::Declination(Some(-180.0)), Setting::Declination(Some(180.0)), Setting::Declination(None)],
                &[
                    Setting::Declination(Some(-180.1)),
                    Setting::Declination(Some(180.1)),
                    Setting::Declination(Some(nan)),
                ],
                "a declination is -180 to 180",
            ),
            (
                &[Setting::Inclination(Some(-90.0)), Setting::Inclination(Some(90.0)), Setting::Inclination(None)],
                &[Setting::Inclination(Some(-90.1)), Setting::Inclination(Some(90.1)), Setting::Inclination(Some(nan))],
                "an inclination is -90 to 90",
            ),
            (
                &[attitude_error(0.0, 0.0), attitude_error(5.0, 0.0), attitude_error(0.0, 20.0)],
                &[
                    attitude_error(-0.1, 1.0),
                    attitude_error(5.1, 1.0),
                    attitude_error(nan, 1.0),
                    attitude_error(1.0, -0.1),
                    attitude_error(1.0, 20.1),
                    attitude_error(1.0, nan),
                ],
                "a constant error is 0 to 5 degrees",
            ),
        ] {
            for &setting in good {
                assert!(Settings::DEFAULT.with(setting).is_ok(), "{setting:?}");
            }
            for &setting in bad {
                let OutOfRange(range) = Settings::DEFAULT.with(setting).unwrap_err();
                assert!(range.starts_with(words), "{setting:?}: {range}");
            }
        }
        for mount in Orientation::all() {
            assert_eq!(Settings::DEFAULT.with(Setting::Mount(mount)).unwrap().mount, mount);
        }
    }

    #[test]
    fn a_heading_s_kind_has_a_word() {
        for (kind, name) in [(HeadingKind::Raw, "raw"), (HeadingKind::Smooth, "smooth")] {
            assert_eq!((kind.name(), HeadingKind::from_name(name)), (name, Some(kind)));
        }
        assert_eq!(HeadingKind::from_name("smoothed"), None);
        assert_eq!(Settings::DEFAULT.stream_heading, HeadingKind::Smooth);
    }

    #[test]
    fn a_setting_changes_itself_and_nothing_else() {
        let before = Settings { align_deg: 3.0, ..Settings::DEFAULT };
        let mount = Orientation::from_name("yaw90").unwrap();
        for (setting, after) in [
            (Setting::StreamOn(false), Settings { stream_on: false, ..before }),
            (Setting::StreamRateHz(5), Settings { stream_rate_hz: 5, ..before }),
            (Setting::StreamHeading(HeadingKind::Raw), Settings { stream_heading: HeadingKind::Raw, ..before }),
            (Setting::Accuracy(1.5), Settings { accuracy_deg: 1.5, ..before }),
            (Setting::Auto(false), Settings { auto_on: false, ..before }),
            (Setting::Vision(true), Settings { tells_vision: true, ..before }),
            (Setting::Declination(Some(-3.5)), Settings { declination_deg: Some(-3.5), ..before }),
            (Setting::Inclination(Some(60.0)), Settings { inclination_deg: Some(60.0), ..before }),
            (Setting::Mount(mount), Settings { mount, ..before }),
            (
                attitude_error(1.5, 3.0),
                Settings { attitude_error: AttitudeError { bias_deg: 1.5, bank_percent: 3.0 }, ..before },
            ),
        ] {
            assert_eq!(before.with(setting), Ok(after));
        }
    }

    #[test]
    fn a_port_s_setting_changes_that_port() {
        for port in PortNumber::ALL {
            let before = Settings::DEFAULT;
            let mut ports = before.ports;
            ports.of_mut(port).protocol = ProtocolKind::Msp;
            assert_eq!(before.with(Setting::Protocol(port, ProtocolKind::Msp)), Ok(Settings { ports, ..before }));
            ports.of_mut(port).baud = Baud::B230400;
            let both = Settings { ports, ..before };
            let changed = before.with(Setting::Protocol(port, ProtocolKind::Msp)).unwrap();
            assert_eq!(changed.with(Setting::Baud(port, Baud::B230400)), Ok(both));
        }
    }

    /// Alignment is set by standing at a heading, so it is checked where settings are loaded.
    #[test]
    fn an_alignment_is_half_a_circle_either_way() {
        for (align_deg, valid) in [(180.0, true), (-180.0, true), (180.1, false), (-180.1, false), (f32::NAN, false)] {
            assert_eq!(Settings { align_deg, ..Settings::DEFAULT }.is_valid(), valid, "{align_deg}");
        }
    }

    #[test]
    fn solves_use_mounting_inclination_and_the_attitude_s_error() {
        let none = Orientation::NONE;
        for (setting, used) in [
            (Setting::Mount(none), true),
            (Setting::Inclination(None), true),
            (attitude_error(0.2, 1.0), true),
            (Setting::Declination(None), false),
            (Setting::StreamOn(true), false),
            (Setting::StreamRateHz(1), false),
            (Setting::StreamHeading(HeadingKind::Raw), false),
            (Setting::Accuracy(1.0), false),
            (Setting::Auto(false), false),
            (Setting::Protocol(PortNumber::One, ProtocolKind::Msp), false),
            (Setting::Baud(PortNumber::One, Baud::B57600), false),
            (Setting::Vision(true), false),
        ] {
            assert_eq!(setting.is_used_by_solves(), used, "{setting:?}");
        }
    }
}
