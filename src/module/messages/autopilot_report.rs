//! Results of `autopilot check` and `autopilot setup`: the autopilot's compasses and parameters.

use core::fmt;

use super::parameter_name::ParameterName;
use autoswing::decimal::ShortestDecimal;

/// Result of a check or a setup of the autopilot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AutopilotReport {
    /// No ArduPilot or PX4 is known on a MAVLink line.
    NoAutopilot,
    /// The autopilot does not answer for its parameters.
    NoReply,
    /// The autopilot does not report that it is disarmed, and a parameter is to be written.
    Armed,
    /// The number of a parameter could not be kept in flash, so that it is not written.
    NotKept,
    /// No setup has replaced a number since the last undo.
    NothingReplaced,
    /// None of the autopilot's compasses is the module, and it is not sent poses either.
    NoCompass,
    /// One of the autopilot's compasses.
    Compass(RegisteredCompass),
    /// A parameter that is not as wanted.
    Parameter(ParameterReport),
    /// Trims of roll and pitch, degrees, that the autopilot subtracts from its attitude, and the module adds again.
    Trims([f32; 2]),
    /// Magnetic heading now, degrees, of a calibrated module.
    Heading(f32),
    /// End of a check or a setup: numbers of parameters.
    Summary(ParameterCounts),
}

/// Compass that the autopilot has registered. Slot and priority are counted from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RegisteredCompass {
    /// Slot, by which offsets and ids go.
    pub slot: u8,
    /// Priority, by which the use goes; `None` before the autopilot's next start.
    pub priority: Option<u8>,
    /// ArduPilot's device id.
    pub device_id: u32,
    /// Whether it is the module.
    pub is_module: bool,
}

/// Parameter of the autopilot that the module needs.
#[derive(Debug, PartialEq)]
pub struct WantedParameter {
    /// Name, with `#` for the compass's slot and `^` for its priority; the first of either has no digit.
    pub name_pattern: &'static str,
    /// Wanted number; `None` for the number that it has, written again.
    pub number: Option<f32>,
    /// Reason, a clause.
    pub reason: &'static str,
}

impl WantedParameter {
    /// Name of the parameter for a compass's slot and priority, counted from 1.
    #[must_use]
    pub fn parameter_name(&self, slot: u8, priority: u8) -> ParameterName {
        let number_of = |letter| match letter {
            b'#' => Some(slot),
            b'^' => Some(priority),
            _ => None,
        };
        let letters = self.name_pattern.bytes().filter_map(|letter| match number_of(letter) {
            Some(1) => None,
            Some(number) => Some(b'0' + number),
            None => Some(letter),
        });
        let mut name = ParameterName::default();
        name.0.iter_mut().zip(letters).for_each(|(target, letter)| *target = letter);
        name
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
        write!(f, "slot {slot}, ")?;
        match priority {
            Some(priority) => write!(f, "priority {priority}: ")?,
            None => f.write_str("no priority: ")?,
        }
        f.write_str(if is_module { "this module, " } else { "another compass, " })?;
        write!(f, "{} (id {device_id})", DeviceBus(device_id))
    }
}

/// Bus and address of ArduPilot's device id (`AP_HAL::Device`): kind of bus in bits 0 to 2, its number in bits 3 to 7,
/// the address in bits 8 to 15.
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

impl fmt::Display for ParameterReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.row.parameter_name(self.slot, self.priority);
        let reason = if self.is_undo { "as before the setup" } else { self.row.reason };
        let [number, wanted] = [self.number, self.wanted].map(|number| ShortestDecimal(number, 0));
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
