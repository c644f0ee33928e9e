//! What the user chooses of a port.

use serde::{Deserialize, Serialize};

/// So many ports there are beside the console's.
pub const PORTS: usize = 2;

/// One of the ports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum PortNumber {
    /// The autopilot's.
    One,
    /// The other: an instrument's, or the autopilot's second.
    Two,
}

impl PortNumber {
    /// Both of them.
    pub const ALL: [Self; PORTS] = [Self::One, Self::Two];

    /// This port's of what there is one of for each.
    #[must_use]
    pub const fn of<T>(self, each: &[T; PORTS]) -> &T {
        let [one, two] = each;
        match self {
            Self::One => one,
            Self::Two => two,
        }
    }
}

/// What is spoken on a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ProtocolKind {
    /// Whatever the far end speaks, as soon as it is heard to.
    Auto,
    /// MAVLink 2, as a component beside the autopilot.
    Mavlink,
    /// MSP version 2: a compass, to an autopilot.
    Msp,
    /// NMEA 0183 sentences. Attitude is taken from MAVLink that comes in, if any does.
    Nmea,
}

impl ProtocolKind {
    /// All of them, whether this firmware has them or not.
    pub const ALL: [Self; 4] = [Self::Auto, Self::Mavlink, Self::Msp, Self::Nmea];

    /// Whether this firmware has it: protocols are left out by Cargo features. To find out what an autopilot speaks takes
    /// one that autopilots speak.
    #[must_use]
    pub const fn is_here(self) -> bool {
        match self {
            Self::Auto => cfg!(any(feature = "mavlink", feature = "msp")),
            Self::Mavlink => cfg!(feature = "mavlink"),
            Self::Msp => cfg!(feature = "msp"),
            Self::Nmea => cfg!(feature = "nmea"),
        }
    }

    /// What is spoken where this was chosen: itself, if this firmware has it, or else `auto`, which is all that an autopilot
    /// can be told in; a firmware without that says sentences. The choice itself is kept, for a firmware that has it.
    #[must_use]
    pub const fn in_force(self) -> Self {
        match self {
            _ if self.is_here() => self,
            _ if Self::Auto.is_here() => Self::Auto,
            _ => Self::Nmea,
        }
    }

    /// The word for it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Mavlink => "mavlink",
            Self::Msp => "msp",
            Self::Nmea => "nmea",
        }
    }

    /// The one of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// How fast a port is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Baud {
    /// 57,600 baud.
    B57600,
    /// 115,200 baud.
    B115200,
    /// 230,400 baud.
    B230400,
    /// 460,800 baud.
    B460800,
}

impl Baud {
    /// All of them, the slowest first.
    pub const ALL: [Self; 4] = [Self::B57600, Self::B115200, Self::B230400, Self::B460800];

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

    /// The same in letters.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::B57600 => "57600",
            Self::B115200 => "115200",
            Self::B230400 => "230400",
            Self::B460800 => "460800",
        }
    }

    /// The one of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|baud| baud.name() == name)
    }
}

/// What the user has chosen for a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PortSettings {
    /// What is spoken.
    pub protocol: ProtocolKind,
    /// How fast.
    pub baud: Baud,
}

/// Those of all ports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PortsSettings([PortSettings; PORTS]);

impl PortsSettings {
    /// As delivered: the first finds out what the autopilot speaks, the second tells instruments.
    pub const DEFAULT: Self = Self([
        PortSettings { protocol: ProtocolKind::Auto.in_force(), baud: Baud::B115200 },
        PortSettings { protocol: ProtocolKind::Nmea.in_force(), baud: Baud::B115200 },
    ]);

    /// Of a module that was set up when its firmware had one port, for sentences: whoever reads them there goes on.
    pub const BEFORE_THERE_WERE_TWO: Self = {
        let mut ports = Self::DEFAULT;
        ports.of_mut(PortNumber::One).protocol = ProtocolKind::Nmea;
        ports
    };

    /// Those of a port.
    #[must_use]
    pub const fn of(&self, number: PortNumber) -> PortSettings {
        *number.of(&self.0)
    }

    /// Those of a port, to be changed.
    pub const fn of_mut(&mut self, number: PortNumber) -> &mut PortSettings {
        let [one, two] = &mut self.0;
        match number {
            PortNumber::One => one,
            PortNumber::Two => two,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_chosen_has_a_word_of_its_own() {
        for kind in ProtocolKind::ALL {
            assert_eq!(ProtocolKind::from_name(kind.name()), Some(kind));
        }
        for baud in Baud::ALL {
            assert_eq!(Baud::from_name(baud.name()), Some(baud));
            assert_eq!(baud.name(), baud.bits_per_s().to_string());
        }
        assert_eq!((ProtocolKind::from_name("ubx"), Baud::from_name("9600")), (None, None));
    }

    #[test]
    fn each_port_has_its_own() {
        let mut ports = PortsSettings::DEFAULT;
        ports.of_mut(PortNumber::Two).protocol = ProtocolKind::Msp;
        ports.of_mut(PortNumber::One).baud = Baud::B57600;
        let [one, two] = PortNumber::ALL.map(|number| ports.of(number));
        assert_eq!(one, PortSettings { protocol: ProtocolKind::Auto, baud: Baud::B57600 });
        assert_eq!(two, PortSettings { protocol: ProtocolKind::Msp, baud: Baud::B115200 });
    }
}
