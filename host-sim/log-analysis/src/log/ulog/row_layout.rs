//! Layout of a ULog row.

use std::collections::HashMap;

use crate::log::scalar::ScalarType;

#[derive(Clone, Copy)]
pub(super) struct RowColumn {
    pub scalar_type: ScalarType,
    pub byte_offset: usize,
    pub array_len: usize,
}

/// Type of a number by its name; `None` of a nested format.
pub(super) fn scalar_type(name: &str) -> Option<ScalarType> {
    Some(match name {
        "int8_t" => ScalarType::Signed(1),
        "uint8_t" | "bool" | "char" => ScalarType::Unsigned(1),
        "int16_t" => ScalarType::Signed(2),
        "uint16_t" => ScalarType::Unsigned(2),
        "int32_t" => ScalarType::Signed(4),
        "uint32_t" => ScalarType::Unsigned(4),
        "int64_t" => ScalarType::Signed(8),
        "uint64_t" => ScalarType::Unsigned(8),
        "float" => ScalarType::Float(4),
        "double" => ScalarType::Float(8),
        _ => return None,
    })
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
                scalar_type(type_name).and_then(|type_name| type_name.decode_number(&[0xFF; 8])),
                Some(expected),
                "{type_name}"
            );
        }
    }

    /// More bytes follow the array.
    #[test]
    fn an_array_has_its_declared_length() {
        let column = RowColumn { scalar_type: ScalarType::Float(4), byte_offset: 0, array_len: 2 };
        let columns = RowColumns::from([("q".to_owned(), column)]);
        let row = TopicRow { columns: &columns, row_bytes: &[0; 64] };
        assert_eq!((row.array_values::<2>("q"), row.array_values::<3>("q")), (Some([0.0; 2]), None));
    }
}
