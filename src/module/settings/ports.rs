//! Settings of the ports.

use serde::{Deserialize, Serialize};

use super::setting::choice_of_names;

/// Number of ports, without the console.
pub const PORT_COUNT: usize = 2;

/// Port number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PortNumber {
    /// Port of the autopilot.
    One,
    /// Port of an instrument, or of a second link to the autopilot.
    Two,
}

impl PortNumber {
    /// Both ports.
    pub const ALL_PORTS: [Self; PORT_COUNT] = [Self::One, Self::Two];

    /// Selects the port's element of an array.
    #[must_use]
    pub const fn port_element<T>(self, per_port: &[T; PORT_COUNT]) -> &T {
        let [first, second] = per_port;
        match self {
            Self::One => first,
            Self::Two => second,
        }
    }
}

/// Protocol of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ProtocolKind {
    /// Detected from received bytes.
    Auto,
    /// MAVLink 2, as a component of the autopilot's system.
    Mavlink,
    /// MSP version 2, as a compass.
    Msp,
    /// NMEA 0183 sentences; attitude from received MAVLink, if any.
    Nmea,
}

impl ProtocolKind {
    /// All protocols.
    pub const ALL_PROTOCOLS: [Self; 4] = [Self::Auto, Self::Mavlink, Self::Msp, Self::Nmea];

    /// Name in commands.
    #[must_use]
    pub const fn protocol_name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Mavlink => "mavlink",
            Self::Msp => "msp",
            Self::Nmea => "nmea",
        }
    }
}

choice_of_names!(ProtocolKind, ALL_PROTOCOLS, protocol_name);

/// Baud rate of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BaudRate {
    /// 57,600 Bd.
    B57600,
    /// 115,200 Bd.
    B115200,
    /// 230,400 Bd.
    B230400,
    /// 460,800 Bd.
    B460800,
}

impl BaudRate {
    /// All rates, ascending.
    pub const ALL_RATES: [Self; 4] = [Self::B57600, Self::B115200, Self::B230400, Self::B460800];

    /// Bits per second.
    #[must_use]
    pub const fn bits_per_s(self) -> u32 {
        match self {
            Self::B57600 => 57_600,
            Self::B115200 => 115_200,
            Self::B230400 => 230_400,
            Self::B460800 => 460_800,
        }
    }

    /// Name in commands.
    #[must_use]
    pub const fn baud_name(self) -> &'static str {
        match self {
            Self::B57600 => "57600",
            Self::B115200 => "115200",
            Self::B230400 => "230400",
            Self::B460800 => "460800",
        }
    }
}

choice_of_names!(BaudRate, ALL_RATES, baud_name);

/// Settings of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PortSettings {
    /// Protocol of the port.
    pub protocol: ProtocolKind,
    /// Baud rate of the port.
    pub baud: BaudRate,
}

/// Settings of all ports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PortsSettings([PortSettings; PORT_COUNT]);

impl PortsSettings {
    /// Factory settings: the first port detects the autopilot's protocol, the second sends NMEA to instruments.
    pub const DEFAULT: Self = Self([
        PortSettings { protocol: ProtocolKind::Auto, baud: BaudRate::B115200 },
        PortSettings { protocol: ProtocolKind::Nmea, baud: BaudRate::B115200 },
    ]);

    /// Settings of a port.
    #[must_use]
    pub const fn settings_of_port(&self, number: PortNumber) -> PortSettings {
        *number.port_element(&self.0)
    }

    /// Mutable settings of a port.
    pub const fn port_mut(&mut self, number: PortNumber) -> &mut PortSettings {
        let [first, second] = &mut self.0;
        match number {
            PortNumber::One => first,
            PortNumber::Two => second,
        }
    }
}
