//! Settings of the ports.

use super::setting::named_choices;

/// Number of ports, without the console.
pub const PORT_COUNT: usize = 2;

/// Port number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

named_choices! {
    /// Protocol of a port.
    ProtocolKind {
        /// Detected from received bytes.
        Auto: "auto",
        /// MAVLink 2, as a component of the autopilot's system.
        Mavlink: "mavlink",
        /// MSP version 2, as a compass.
        Msp: "msp",
        /// NMEA 0183 sentences; attitude from received MAVLink, if any.
        Nmea: "nmea",
    }
}

named_choices! {
    /// Baud rate of a port, ascending.
    BaudRate {
        /// 57,600 Bd.
        B57600: "57600",
        /// 115,200 Bd.
        B115200: "115200",
        /// 230,400 Bd.
        B230400: "230400",
        /// 460,800 Bd.
        B460800: "460800",
    }
}

impl BaudRate {
    /// Bits per second.
    #[must_use]
    pub const fn bits_per_s(self) -> u32 {
        [57_600, 115_200, 230_400, 460_800][self as usize]
    }
}

/// Settings of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PortSettings {
    /// Protocol of the port.
    pub protocol: ProtocolKind,
    /// Baud rate of the port.
    pub baud: BaudRate,
}
