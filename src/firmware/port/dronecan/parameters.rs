//! Settings as parameters of GetSet.

use crate::wire::dronecan::{GetSetRequest, GetSetValue, Payload, outbound};
use crate::wire::mavlink::key_from_passphrase;
use autoswing_module::settings::{Field, PARAMETERS, Setting, SettingValue, Settings};

/// Word that removes the key of signatures; the value without a key.
const NO_KEY_TEXT: &str = "off";

/// Parameter of a request: by its name, otherwise by its index.
pub(super) fn requested_parameter(request: &GetSetRequest<'_>) -> Option<&'static Setting> {
    if request.parameter_name.is_empty() {
        return PARAMETERS.get(usize::from(request.parameter_index));
    }
    Setting::from_parameter_name(request.parameter_name)
}

/// Value of a request; `None` for a request to read.
pub(super) fn requested_value(value: GetSetValue<'_>) -> Option<SettingValue> {
    Some(match value {
        GetSetValue::Empty => return None,
        GetSetValue::Integer(number) => SettingValue::Number(Some(number as f32)),
        GetSetValue::Real(number) => SettingValue::Number((!number.is_nan()).then_some(number)),
        GetSetValue::Boolean(is_on) => SettingValue::Number(Some(f32::from(u8::from(is_on)))),
        GetSetValue::Text(word) => {
            let word = core::str::from_utf8(word).ok().filter(|word| !word.is_empty())?;
            let key = (!word.eq_ignore_ascii_case(NO_KEY_TEXT)).then(|| key_from_passphrase(word));
            SettingValue::Key(key)
        }
    })
}

/// Response with value, default and range; empty without such a parameter.
pub(super) fn parameter_response(parameter: Option<&Setting>, settings: &Settings) -> Payload {
    let Some(parameter) = parameter else { return outbound::ParameterResponse::default().payload() };
    let to_value = |value| to_get_set_value(parameter, value);
    let [min_value, max_value] = parameter.value_range().map(|number| to_value(SettingValue::Number(Some(number))));
    outbound::ParameterResponse {
        value: to_value(parameter.value(settings)),
        default_value: to_value(parameter.value(&Settings::DEFAULT)),
        max_value,
        min_value,
        parameter_name: parameter.parameter_name,
    }
    .payload()
}

/// Converts a value to that of GetSet; of a key it contains only whether there is one.
fn to_get_set_value(parameter: &Setting, value: SettingValue) -> GetSetValue<'static> {
    match ((parameter.field)(&mut { Settings::DEFAULT }), value) {
        (_, SettingValue::Key(key)) => GetSetValue::Text(key.map_or(NO_KEY_TEXT, |_| "on").as_bytes()),
        (Field::Key(_), SettingValue::Number(_)) => GetSetValue::Empty,
        (Field::Choice(_) | Field::Whole(_), SettingValue::Number(Some(number))) => GetSetValue::Integer(number as i64),
        (_, SettingValue::Number(number)) => GetSetValue::Real(number.unwrap_or(f32::NAN)),
    }
}
