//! Results of `autopilot check` and `autopilot setup`: the autopilot's compasses and parameters.

use core::fmt;

use super::parameter_name::ParameterName;
use autoswing::decimal::{Decimal, ShortestDecimal};

/// Result of a check or a setup of the autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AutopilotReport {
    /// No ArduPilot or PX4 is known on a MAVLink line, and no INAV on one of MSP.
    NoAutopilot,
    /// The autopilot does not answer for its parameters.
    NoReply,
    /// The autopilot does not report that it is disarmed, and a parameter is to be written.
    Armed,
    /// The number of a parameter could not be kept in flash, so that it is not written.
    NotKept,
    /// No setup has replaced a number since the last undo.
    NothingReplaced,
    /// The numbers that a setup has replaced are another autopilot's.
    OtherAutopilot,
    /// None of the autopilot's compasses is the module, and it is not sent poses either.
    NoCompass,
    /// One of the autopilot's compasses.
    Compass(RegisteredCompass),
    /// A parameter that is not as wanted.
    Parameter(ParameterReport),
    /// The autopilot's own offsets of the module's compass, milligauss: the field is corrected twice.
    CorrectedTwice {
        /// Slot of the compass, counted from 1.
        slot: u8,
        /// Length of the offsets, milligauss.
        offset_mg: f32,
    },
    /// Trims of roll and pitch, degrees, that the autopilot subtracts from its attitude, and the module adds again.
    Trims([f32; 2]),
    /// Magnetic heading now, degrees, of a calibrated module.
    Heading(f32),
    /// End of a check or a setup: numbers of parameters.
    Summary(ParameterCounts),
}

/// Compass that the autopilot has registered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegisteredCompass {
    /// Slot, by which offsets and ids go, counted from 1.
    pub slot: u8,
    /// Place in the order of use.
    pub priority: CompassPriority,
    /// Device id of ArduPilot or PX4, which have the same layout.
    pub device_id: u32,
    /// Whether it is the module.
    pub is_module: bool,
}

/// Place of a compass in the autopilot's order of use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CompassPriority {
    /// ArduPilot's, counted from 1, by which the use goes; `None` before its next start.
    ArduPilot(Option<u8>),
    /// PX4: a parameter of the slot.
    Px4,
}

/// Parameter of the autopilot that the module needs.
#[derive(Debug, PartialEq)]
pub struct WantedParameter {
    /// Pattern of the name ([`ParameterName::from_pattern`]).
    pub name_pattern: &'static str,
    /// Wanted number.
    pub number: WantedNumber,
    /// Reason, a clause.
    pub reason: &'static str,
}

/// Number that a parameter is to have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WantedNumber {
    /// A constant.
    Fixed(f32),
    /// This or more.
    AtLeast(f32),
    /// Its present number, written again.
    Present,
    /// Device id of the module's node on the CAN bus.
    CanDevice,
    /// INAV's choice of the compass by MSP.
    MspCompass,
    /// Any choice but that.
    NoMspCompass,
    /// Strength of the module's field, milligauss, within 2 %.
    FieldStrength,
}

impl WantedParameter {
    /// Name of the parameter for a compass's slot and priority, counted from 1.
    #[must_use]
    pub fn parameter_name(&self, slot: u8, priority: u8) -> ParameterName {
        ParameterName::from_pattern(self.name_pattern, slot, priority)
    }
}

/// Parameter of the autopilot, and its state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterReport {
    /// Row of the parameter. A reference, because messages are queued in memory.
    pub row: &'static WantedParameter,
    /// Slot of the module's compass.
    pub slot: u8,
    /// Priority of the module's compass.
    pub priority: u8,
    /// State of the parameter.
    pub state: ParameterState,
    /// Number of the parameter, before a change.
    pub number: f32,
    /// Wanted number.
    pub wanted: f32,
    /// Whether the wanted number is the one before a setup.
    pub is_undo: bool,
}

/// State of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterState {
    /// It has another number than wanted.
    Wrong,
    /// It was changed, and read back.
    Changed,
    /// It was written, and has another number all the same.
    NotChanged,
    /// The autopilot does not answer for it.
    Missing,
}

/// Numbers of parameters by their state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ParameterCounts {
    /// As wanted, before or after.
    pub right: u8,
    /// Not as wanted.
    pub wrong: u8,
    /// Not in this version of the autopilot, or not answered.
    pub missing: u8,
    /// Changed by this setup, and counted among the right ones.
    pub changed: u8,
    /// Whether a change takes effect at the autopilot's next start.
    pub needs_restart: bool,
}

impl fmt::Display for RegisteredCompass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { slot, priority, device_id, is_module } = *self;
        match priority {
            CompassPriority::ArduPilot(Some(priority)) => write!(f, "slot {slot}, priority {priority}: ")?,
            CompassPriority::ArduPilot(None) => write!(f, "slot {slot}, no priority: ")?,
            CompassPriority::Px4 => write!(f, "CAL_MAG{}: ", slot.saturating_sub(1))?,
        }
        f.write_str(if is_module { "this module, " } else { "another compass, " })?;
        write!(f, "{} (id {device_id})", DeviceBus(device_id))
    }
}

/// Bus and address of a device id (ArduPilot's `AP_HAL::Device`, PX4's `device::Device`): kind of bus in bits 0 to 2, its
/// number in bits 3 to 7, the address in bits 8 to 15.
#[derive(Clone, Copy, Debug)]
struct DeviceBus(u32);

impl fmt::Display for DeviceBus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kind, bus, address) = (self.0 & 7, self.0 >> 3 & 31, self.0 >> 8 & 255);
        match kind {
            1 => write!(f, "I2C bus {bus} address {address}"),
            2 => write!(f, "SPI bus {bus} device {address}"),
            3 => write!(f, "DroneCAN bus {bus} node {address}"),
            5 => write!(f, "MSP"),
            _ => write!(f, "bus kind {kind}"),
        }
    }
}

/// Number of a parameter; ids are longer than a [`ShortestDecimal`].
struct ParameterNumber(f32);

impl fmt::Display for ParameterNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.abs() < 1e6 { ShortestDecimal(self.0, 0).fmt(f) } else { Decimal::<0>(self.0).fmt(f) }
    }
}

impl fmt::Display for ParameterReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.row.parameter_name(self.slot, self.priority);
        let reason = if self.is_undo { "as before the setup" } else { self.row.reason };
        let [number, wanted] = [self.number, self.wanted].map(ParameterNumber);
        match self.state {
            ParameterState::Wrong => write!(f, "{name} is {number}, wanted {wanted}: {reason}"),
            ParameterState::Changed => write!(f, "{name} changed from {number} to {wanted}: {reason}"),
            ParameterState::NotChanged => write!(f, "{name} was set to {wanted}, and is {number}"),
            ParameterState::Missing => write!(f, "no answer for {name}, wanted {wanted}: {reason}"),
        }
    }
}

impl fmt::Display for ParameterCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { right, wrong, missing, changed, .. } = self;
        write!(f, "parameters of the autopilot: {right} right, {wrong} wrong, {changed} changed")?;
        if *missing > 0 { write!(f, ", {missing} missing") } else { Ok(()) }
    }
}
