//! The module's settings as parameters of its component, for ground stations.
//!
//! Every parameter is sent as a float, whose encoding is the same for all autopilots. Of the key of signatures only
//! whether there is one; it is not written.

use core::slice;

use super::transmitter::Transmitter;
use crate::wire::mavlink::{OutboundMessage, ParameterEncoding, ReceivedParameterRequest};
use autoswing_module::compass::Command;
use autoswing_module::messages::ParameterName;
use autoswing_module::settings::{PARAMETERS, Setting, SettingChange, SettingValue, Settings};

/// Parameters to send.
#[derive(Debug, Default)]
pub(super) struct OwnParameters {
    /// Unsent parameters of the requested list.
    unsent_list: slice::Iter<'static, Setting>,
    /// Parameter that was requested alone.
    requested: Option<&'static Setting>,
}

impl OwnParameters {
    /// Processes a request; returns the command that changes a setting.
    pub fn process_request(&mut self, request: &ReceivedParameterRequest) -> Option<Command> {
        match request {
            ReceivedParameterRequest::List => self.unsent_list = PARAMETERS.iter(),
            ReceivedParameterRequest::Read { name, index } => {
                let index = usize::try_from(*index);
                self.requested = index.map_or_else(|_| setting_by_name(*name), |index| PARAMETERS.get(index));
            }
            ReceivedParameterRequest::Write(parameter) => {
                let setting = setting_by_name(parameter.name)?;
                let number = parameter.number(ParameterEncoding::Cast);
                let change = number.and_then(|number| setting.change_to(SettingValue::Number(Some(number))));
                // A refused value is answered with the present one, an accepted one after the change.
                self.requested = change.is_none().then_some(setting);
                return change.map(Command::SetFromBus);
            }
        }
        None
    }

    /// Answers a change with the value that is then in force.
    pub fn complete_command(&mut self, command: Command) {
        if let Command::SetFromBus(change) = command {
            self.requested = Some(change.setting);
        }
    }

    /// Sends the next parameter; returns whether one was sent.
    pub fn send_next_parameter(&mut self, settings: &Settings, line: &mut Transmitter<'_>) -> bool {
        let Some(setting) = self.requested.or(self.unsent_list.as_slice().first()) else { return false };
        let is_sent =
            line.has_room_for_bulk() && line.send_message(OutboundMessage::parameter_value(setting, settings));
        if is_sent && self.requested.take().is_none() {
            self.unsent_list.next();
        }
        is_sent
    }
}

fn setting_by_name(name: ParameterName) -> Option<&'static Setting> {
    let length = name.0.iter().position(|byte| *byte == 0).unwrap_or(name.0.len());
    name.0.get(..length).and_then(Setting::from_parameter_name)
}

/// Change of the component, which is a parameter, too.
pub(super) fn component_change(component: u8) -> Option<Command> {
    SettingChange::named("COMPONENT", f32::from(component)).map(Command::Set)
}
