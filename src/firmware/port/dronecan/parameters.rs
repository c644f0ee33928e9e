//! Settings as parameters of GetSet.

use crate::port::parameters::{PARAMETERS, ParameterValue, SettingParameter};
use crate::wire::dronecan::{GetSetRequest, GetSetValue, Payload, outbound};
use crate::wire::mavlink::key_from_passphrase;
use autoswing_module::settings::Settings;

/// Word that removes the key of signatures; the value without a key.
const NO_KEY_TEXT: &str = "off";

/// Parameter of a request: by its name, otherwise by its position.
pub(super) fn requested_parameter(request: &GetSetRequest<'_>) -> Option<&'static SettingParameter> {
    if request.parameter_name.is_empty() {
        return PARAMETERS.get(usize::from(request.parameter_index));
    }
    PARAMETERS.iter().find(|parameter| parameter.parameter_name.as_bytes() == request.parameter_name)
}

/// Value of a request in the parameter's kind; `None` for another kind, which is a request to read.
pub(super) fn requested_value(parameter: &SettingParameter, value: GetSetValue<'_>) -> Option<ParameterValue> {
    match (parameter.parameter_value(&Settings::DEFAULT), value) {
        (ParameterValue::Whole(_), GetSetValue::Integer(number)) => {
            u32::try_from(number).ok().map(ParameterValue::Whole)
        }
        (ParameterValue::Whole(_), GetSetValue::Boolean(is_on)) => Some(ParameterValue::Whole(is_on.into())),
        (ParameterValue::Number(_), GetSetValue::Real(number)) => Some(ParameterValue::Number(number)),
        (ParameterValue::Number(_), GetSetValue::Integer(number)) => Some(ParameterValue::Number(number as f32)),
        (ParameterValue::Key(_), GetSetValue::Text(word)) => {
            let word = core::str::from_utf8(word).ok().filter(|word| !word.is_empty())?;
            let key = (!word.eq_ignore_ascii_case(NO_KEY_TEXT)).then(|| key_from_passphrase(word));
            Some(ParameterValue::Key(key))
        }
        _ => None,
    }
}

/// Response with value, default and range; empty without such a parameter.
pub(super) fn parameter_response(parameter: Option<&SettingParameter>, settings: &Settings) -> Payload {
    let Some(parameter) = parameter else { return outbound::ParameterResponse::default().payload() };
    let [min, max] = parameter.value_range().map_or([GetSetValue::Empty; 2], |range| range.map(to_get_set_value));
    outbound::ParameterResponse {
        value: to_get_set_value(parameter.parameter_value(settings)),
        default_value: to_get_set_value(parameter.parameter_value(&Settings::DEFAULT)),
        max_value: max,
        min_value: min,
        parameter_name: parameter.parameter_name,
    }
    .payload()
}

/// Converts a value to that of GetSet; of a key it contains only whether there is one.
fn to_get_set_value(value: ParameterValue) -> GetSetValue<'static> {
    match value {
        ParameterValue::Whole(number) => GetSetValue::Integer(number.into()),
        ParameterValue::Number(number) => GetSetValue::Real(number),
        ParameterValue::Key(key) => GetSetValue::Text(key.map_or(NO_KEY_TEXT, |_| "on").as_bytes()),
    }
}
