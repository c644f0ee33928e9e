//! Parameters of an autopilot: names, and numbers in the two encodings of the parameter protocol
//! (mavlink.io, "Parameter Protocol").

use mavlink_dialect::MavParamType;

use autoswing_module::messages::ParameterName;

/// Encoding of integers in the field `param_value`, a float on the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ParameterEncoding {
    /// The number as a float: ArduPilot.
    #[default]
    Cast,
    /// The integer's bytes: PX4.
    Bytewise,
}

/// Parameter as received: its value is undecoded, because the encoding depends on the sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReceivedParameter {
    /// Name of the parameter.
    pub name: ParameterName,
    /// Bits of the field `param_value`.
    pub value_bits: u32,
    /// Kind of number.
    pub kind: MavParamType,
}

impl ReceivedParameter {
    /// Number; none for an unknown kind or a number that is not finite.
    #[must_use]
    pub fn number(&self, encoding: ParameterEncoding) -> Option<f32> {
        let bits = self.value_bits;
        let number = match integer_width(self.kind) {
            None if self.kind != MavParamType::MAV_PARAM_TYPE_REAL32 => return None,
            Some((is_signed, width)) if encoding == ParameterEncoding::Bytewise => {
                let upper_bits = bits << (32 - width);
                if is_signed {
                    (upper_bits.cast_signed() >> (32 - width)) as f32
                } else {
                    (upper_bits >> (32 - width)) as f32
                }
            }
            _ => f32::from_bits(bits),
        };
        number.is_finite().then_some(number)
    }
}

/// Bits of the field `param_value` for a number of this kind.
#[must_use]
pub fn parameter_bits(number: f32, kind: MavParamType, encoding: ParameterEncoding) -> u32 {
    match (encoding, integer_width(kind)) {
        // The casts saturate.
        (ParameterEncoding::Bytewise, Some((true, _))) => (number as i32).cast_unsigned(),
        (ParameterEncoding::Bytewise, Some((false, _))) => number as u32,
        _ => number.to_bits(),
    }
}

/// Whether an integer kind is signed, and its number of bits; none for other kinds.
const fn integer_width(kind: MavParamType) -> Option<(bool, u32)> {
    match kind {
        MavParamType::MAV_PARAM_TYPE_UINT8 => Some((false, 8)),
        MavParamType::MAV_PARAM_TYPE_INT8 => Some((true, 8)),
        MavParamType::MAV_PARAM_TYPE_UINT16 => Some((false, 16)),
        MavParamType::MAV_PARAM_TYPE_INT16 => Some((true, 16)),
        MavParamType::MAV_PARAM_TYPE_UINT32 => Some((false, 32)),
        MavParamType::MAV_PARAM_TYPE_INT32 => Some((true, 32)),
        _ => None,
    }
}
