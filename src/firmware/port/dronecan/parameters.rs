//! Settings as parameters of GetSet.

use crate::wire::dronecan::{GetSetRequest, GetSetValue, Payload, outbound};
use crate::wire::mavlink::key_from_passphrase;
use autoswing_module::settings::{Setting, SettingValue, Settings};

/// Word that removes the key of signatures; the value without a key.
const NO_KEY_TEXT: &str = "off";

/// Parameter of a request: by its name, otherwise by its position.
pub(super) fn requested_parameter(request: &GetSetRequest<'_>) -> Option<&'static Setting> {
    if request.parameter_name.is_empty() {
        return u8::try_from(request.parameter_index).ok().and_then(Setting::nth_parameter);
    }
    Setting::from_parameter_name(request.parameter_name)
}

/// Value of a request in the parameter's kind; `None` for another kind, which is a request to read.
pub(super) fn requested_value(parameter: &Setting, value: GetSetValue<'_>) -> Option<SettingValue> {
    match (parameter.value(&Settings::DEFAULT), value) {
        (SettingValue::Whole(_), GetSetValue::Integer(number)) => u32::try_from(number).ok().map(SettingValue::Whole),
        (SettingValue::Whole(_), GetSetValue::Boolean(is_on)) => Some(SettingValue::Whole(is_on.into())),
        (SettingValue::Number(_), GetSetValue::Real(number)) => {
            Some(SettingValue::Number((!number.is_nan()).then_some(number)))
        }
        (SettingValue::Number(_), GetSetValue::Integer(number)) => Some(SettingValue::Number(Some(number as f32))),
        (SettingValue::Key(_), GetSetValue::Text(word)) => {
            let word = core::str::from_utf8(word).ok().filter(|word| !word.is_empty())?;
            let key = (!word.eq_ignore_ascii_case(NO_KEY_TEXT)).then(|| key_from_passphrase(word));
            Some(SettingValue::Key(key))
        }
        _ => None,
    }
}

/// Response with value, default and range; empty without such a parameter.
pub(super) fn parameter_response(parameter: Option<&Setting>, settings: &Settings) -> Payload {
    let Some(parameter) = parameter else { return outbound::ParameterResponse::default().payload() };
    let [min, max] = parameter.value_range().map_or([GetSetValue::Empty; 2], |range| range.map(to_get_set_value));
    outbound::ParameterResponse {
        value: to_get_set_value(parameter.value(settings)),
        default_value: to_get_set_value(parameter.value(&Settings::DEFAULT)),
        max_value: max,
        min_value: min,
        parameter_name: parameter.parameter_name,
    }
    .payload()
}

/// Converts a value to that of GetSet; of a key it contains only whether there is one.
fn to_get_set_value(value: SettingValue) -> GetSetValue<'static> {
    match value {
        SettingValue::Whole(number) => GetSetValue::Integer(number.into()),
        SettingValue::Number(number) => GetSetValue::Real(number.unwrap_or(f32::NAN)),
        SettingValue::Key(key) => GetSetValue::Text(key.map_or(NO_KEY_TEXT, |_| "on").as_bytes()),
    }
}
