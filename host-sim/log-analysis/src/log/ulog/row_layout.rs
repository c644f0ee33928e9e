//! Layout of a ULog row.

use std::collections::HashMap;

#[derive(Clone, Copy)]
pub(super) struct RowColumn {
    pub scalar_type: ScalarType,
    pub byte_offset: usize,
    pub array_len: usize,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum ScalarType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl ScalarType {
    pub fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "int8_t" => Self::I8,
            "uint8_t" | "bool" | "char" => Self::U8,
            "int16_t" => Self::I16,
            "uint16_t" => Self::U16,
            "int32_t" => Self::I32,
            "uint32_t" => Self::U32,
            "int64_t" => Self::I64,
            "uint64_t" => Self::U64,
            "float" => Self::F32,
            "double" => Self::F64,
            _ => return None,
        })
    }

    pub const fn byte_len(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub fn decode_number(self, bytes: &[u8]) -> Option<f64> {
        let b = bytes.get(..self.byte_len())?;
        Some(match (self, b) {
            (Self::I8, &[a]) => f64::from(a.cast_signed()),
            (Self::U8, &[a]) => f64::from(a),
            (Self::I16, &[a, b]) => f64::from(i16::from_le_bytes([a, b])),
            (Self::U16, &[a, b]) => f64::from(u16::from_le_bytes([a, b])),
            (Self::I32, &[a, b, c, d]) => f64::from(i32::from_le_bytes([a, b, c, d])),
            (Self::U32, &[a, b, c, d]) => f64::from(u32::from_le_bytes([a, b, c, d])),
            (Self::F32, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
            (Self::I64, &[a, b, c, d, e, f, g, h]) => i64::from_le_bytes([a, b, c, d, e, f, g, h]) as f64,
            (Self::U64, &[a, b, c, d, e, f, g, h]) => u64::from_le_bytes([a, b, c, d, e, f, g, h]) as f64,
            (Self::F64, &[a, b, c, d, e, f, g, h]) => f64::from_le_bytes([a, b, c, d, e, f, g, h]),
            _ => return None,
        })
    }
}

pub(super) type RowColumns = HashMap<String, RowColumn>;

/// Splits a keyed value into type, name and bytes: length, `type name`, value.
pub(super) fn parse_keyed_value(body: &[u8]) -> Option<(&str, &str, &[u8])> {
    let (&length, after_length) = body.split_first()?;
    let key = std::str::from_utf8(after_length.get(..usize::from(length))?).ok()?;
    let (type_name, name) = key.split_once(' ')?;
    Some((type_name, name, &after_length[usize::from(length)..]))
}

pub(super) struct TopicRow<'a> {
    pub columns: &'a RowColumns,
    pub row_bytes: &'a [u8],
}

impl TopicRow<'_> {
    pub fn numeric_value(&self, name: &str) -> Option<f64> {
        let column = self.columns.get(name)?;
        column.scalar_type.decode_number(self.row_bytes.get(column.byte_offset..)?)
    }

    pub fn array_values<const N: usize>(&self, name: &str) -> Option<[f32; N]> {
        let column = self.columns.get(name).filter(|column| column.array_len >= N)?;
        let mut values = [0.0; N];
        for (i, value) in values.iter_mut().enumerate() {
            *value = column
                .scalar_type
                .decode_number(self.row_bytes.get(column.byte_offset + i * column.scalar_type.byte_len()..)?)?
                as f32;
        }
        Some(values)
    }

    pub fn vector_value(&self, names: [&str; 3]) -> Option<[f32; 3]> {
        let [x, y, z] = names.map(|name| self.numeric_value(name));
        Some([x? as f32, y? as f32, z? as f32])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_decoded_by_their_scalar_type() {
        for (type_name, expected) in [
            ("int8_t", -1.0),
            ("uint8_t", 255.0),
            ("int16_t", -1.0),
            ("uint16_t", 65_535.0),
            ("int32_t", -1.0),
            ("uint32_t", 4_294_967_295.0),
            ("int64_t", -1.0),
        ] {
            assert_eq!(
                ScalarType::from_name(type_name).and_then(|type_name| type_name.decode_number(&[0xFF; 8])),
                Some(expected),
                "{type_name}"
            );
        }
    }

    /// More bytes follow the array.
    #[test]
    fn an_array_has_its_declared_length() {
        let column = RowColumn { scalar_type: ScalarType::F32, byte_offset: 0, array_len: 2 };
        let columns = RowColumns::from([("q".to_owned(), column)]);
        let row = TopicRow { columns: &columns, row_bytes: &[0; 64] };
        assert_eq!((row.array_values::<2>("q"), row.array_values::<3>("q")), (Some([0.0; 2]), None));
    }
}
