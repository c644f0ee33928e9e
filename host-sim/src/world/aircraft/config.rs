//! The kinds, and how they move.

use serde::{Deserialize, Serialize};

/// What carries the compass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// An aeroplane: its bank turns it.
    #[default]
    Plane,
    /// A multirotor: turns flat, tilts to move.
    Copter,
    /// Takes off on rotors, flies on wings.
    Vtol,
    /// On wheels, on rough ground.
    Rover,
    /// On the water, in waves.
    Boat,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Plane, Self::Copter, Self::Vtol, Self::Rover, Self::Boat];

    /// The word for it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plane => "plane",
            Self::Copter => "copter",
            Self::Vtol => "vtol",
            Self::Rover => "rover",
            Self::Boat => "boat",
        }
    }

    /// The kind of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Whether it can stay on a spot.
    #[must_use]
    pub const fn hovers(self) -> bool {
        matches!(self, Self::Copter | Self::Vtol)
    }

    /// Whether it leaves the ground.
    #[must_use]
    pub const fn flies(self) -> bool {
        matches!(self, Self::Plane | Self::Copter | Self::Vtol)
    }

    /// What an attitude source makes of an acceleration, see
    /// [`attitude_source::Config::push_error_deg`](super::super::attitude_source::Config::push_error_deg): of an
    /// aeroplane the turns are in `turn_error`, and little else accelerates it. All others are pushed about; a copter's
    /// push at 15 deg of tilt, 2.6 m/s^2, makes an error of 1 deg.
    #[must_use]
    pub const fn push_error_deg(self) -> f64 {
        match self {
            Self::Plane => 0.0,
            Self::Copter | Self::Vtol | Self::Rover | Self::Boat => 0.4,
        }
    }
}

/// How the aircraft moves.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// What it is.
    pub kind: Kind,
    /// True airspeed on wings, metres per second.
    pub airspeed_m_s: f64,
    /// Speed under way on rotors, on wheels or on the water, metres per second.
    pub speed_m_s: f64,
    /// Largest roll rate on wings, degrees per second.
    pub max_roll_rate_deg_s: f64,
    /// Heading at the start, degrees.
    pub heading_deg: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self { kind: Kind::Plane, airspeed_m_s: 22.0, speed_m_s: 3.0, max_roll_rate_deg_s: 30.0, heading_deg: 0.0 }
    }
}
