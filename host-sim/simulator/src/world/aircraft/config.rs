//! Vehicle kinds and their motion settings.

use serde::Deserialize;

/// Kind of vehicle that carries the compass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VehicleKind {
    /// Aeroplane: turns by banking.
    #[default]
    Plane,
    /// Multirotor: yaws without banking, tilts to accelerate.
    Copter,
    /// VTOL: hovers on rotors, cruises on wings.
    Vtol,
    /// Wheeled vehicle on rough ground.
    Rover,
    /// Boat in waves.
    Boat,
    /// A board in the hand.
    Hand,
}

impl VehicleKind {
    /// All kinds.
    pub const ALL_VEHICLES: [Self; 6] = [Self::Plane, Self::Copter, Self::Vtol, Self::Rover, Self::Boat, Self::Hand];

    /// Name in scenario files and on the command line.
    #[must_use]
    pub const fn vehicle_name(self) -> &'static str {
        match self {
            Self::Plane => "plane",
            Self::Copter => "copter",
            Self::Vtol => "vtol",
            Self::Rover => "rover",
            Self::Boat => "boat",
            Self::Hand => "hand",
        }
    }

    /// The kind with this name, if any.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL_VEHICLES.into_iter().find(|vehicle_kind| vehicle_kind.vehicle_name() == name)
    }

    /// Whether this kind can hover.
    #[must_use]
    pub const fn can_hover(self) -> bool {
        matches!(self, Self::Copter | Self::Vtol | Self::Hand)
    }

    /// Whether this kind always moves along its nose, but for drift.
    #[must_use]
    pub const fn moves_along_nose(self) -> bool {
        matches!(self, Self::Plane | Self::Rover | Self::Boat)
    }

    /// Whether this kind flies.
    #[must_use]
    pub const fn can_fly(self) -> bool {
        matches!(self, Self::Plane | Self::Copter | Self::Vtol)
    }

    /// Acceleration-induced tilt error of the attitude source, degrees per m/s^2. Zero for an aeroplane, whose turns
    /// `turn_error` covers. A copter tilted by 15 deg accelerates by 2.6 m/s^2 and gets an error of 1 deg.
    #[must_use]
    pub const fn tilt_error_deg_per_m_s2(self) -> f64 {
        match self {
            Self::Plane => 0.0,
            Self::Copter | Self::Vtol | Self::Rover | Self::Boat | Self::Hand => 0.4,
        }
    }
}

/// Motion settings of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VehicleConfig {
    /// Vehicle kind.
    pub kind: VehicleKind,
    /// True airspeed in wing-borne flight, metres per second.
    pub airspeed_m_s: f64,
    /// Cruise speed on rotors, wheels or water, metres per second.
    pub speed_m_s: f64,
    /// Largest roll rate in wing-borne flight, degrees per second.
    pub max_roll_rate_deg_s: f64,
    /// Initial heading, degrees.
    pub heading_deg: f64,
}

impl Default for VehicleConfig {
    fn default() -> Self {
        Self {
            kind: VehicleKind::Plane,
            airspeed_m_s: 22.0,
            speed_m_s: 3.0,
            max_roll_rate_deg_s: 30.0,
            heading_deg: 0.0,
        }
    }
}
