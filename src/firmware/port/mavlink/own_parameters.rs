//! The module's settings as parameters of its component, for ground stations.
//!
//! Every parameter is sent as a float, whose encoding is the same for all autopilots. Of the key of signatures only
//! whether there is one; it is not written.

use super::transmitter::Transmitter;
use crate::wire::mavlink::{OutboundMessage, ParameterEncoding, ReceivedParameterRequest};
use autoswing_module::compass::Command;
use autoswing_module::messages::ParameterName;
use autoswing_module::settings::{Setting, SettingChange, SettingValue, Settings};

/// Parameters to send.
#[derive(Debug, Default)]
pub(super) struct OwnParameters {
    /// Position of the next parameter of the requested list.
    next_of_list: Option<u8>,
    /// Position of a parameter that was requested alone.
    requested: Option<u8>,
}

impl OwnParameters {
    /// Processes a request; returns the command that changes a setting.
    pub fn process_request(&mut self, request: &ReceivedParameterRequest) -> Option<Command> {
        match request {
            ReceivedParameterRequest::List => self.next_of_list = Some(0),
            ReceivedParameterRequest::Read { name, index } => {
                let position = u8::try_from(*index).ok();
                let setting = setting_by_name(*name).filter(|_| position.is_none());
                self.requested = setting.map(|setting| setting.parameter_index).or(position);
            }
            ReceivedParameterRequest::Write(parameter) => {
                let setting = setting_by_name(parameter.name)?;
                let value = parameter.number(ParameterEncoding::Cast).and_then(|number| setting.number_value(number));
                let change = value.and_then(|value| setting.change_to(value));
                // A refused value is answered with the present one, an accepted one after the change.
                self.requested = change.is_none().then_some(setting.parameter_index);
                return change.map(Command::SetFromBus);
            }
        }
        None
    }

    /// Answers a change with the value that is then in force.
    pub fn complete_command(&mut self, command: Command) {
        if let Command::SetFromBus(change) = command {
            self.requested = Some(change.setting.parameter_index);
        }
    }

    /// Sends the next parameter; returns whether one was sent.
    pub fn send_next_parameter(&mut self, settings: &Settings, line: &mut Transmitter<'_>) -> bool {
        let Some(position) = self.requested.or(self.next_of_list) else { return false };
        let Some(setting) = Setting::nth_parameter(position) else {
            if self.requested.take().is_none() {
                self.next_of_list = None;
            }
            return false;
        };
        if !line.has_room_for_bulk() {
            return false;
        }
        let name = ParameterName::new(setting.parameter_name);
        let is_sent =
            line.send_message(OutboundMessage::parameter(name, setting.value(settings).to_number(), position));
        if is_sent && self.requested.take().is_none() {
            self.next_of_list = Some(position + 1);
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
    SettingChange::named("COMPONENT", SettingValue::Whole(component.into())).map(Command::Set)
}
