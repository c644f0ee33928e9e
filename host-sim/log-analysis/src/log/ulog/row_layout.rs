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

/// Names of the topics that are read.
pub const READ_TOPICS: [&str; 15] = [
    "sensor_mag",
    "vehicle_magnetometer",
    "vehicle_attitude",
    "estimator_attitude",
    "estimator_innovation_test_ratios",
    "estimator_status",
    "vehicle_angular_velocity",
    "vehicle_attitude_groundtruth",
    "sensor_combined",
    "vehicle_gps_position",
    "battery_status",
    "esc_status",
    "actuator_motors",
    "actuator_outputs",
    "vehicle_status",
];

/// Bytes of a number in a row.
const NUMBER_BYTES: usize = 8;

/// Log, topic and instance of a file's name without extension: `flight_sensor_mag_0`.
pub fn topic_of_file(file_stem: &str) -> Option<(&str, &'static str, u8)> {
    let (log_and_topic, instance) = file_stem.rsplit_once('_')?;
    let instance = instance.parse().ok()?;
    READ_TOPICS
        .into_iter()
        .find_map(|topic| Some((log_and_topic.strip_suffix(topic)?.strip_suffix('_')?, topic, instance)))
}

/// Columns of a header, as of a message that has all numbers as `double`.
pub(super) fn columns_of_header(header: &str, separator: char) -> RowColumns {
    let names: Vec<&str> = header.split(separator).collect();
    let mut columns = RowColumns::new();
    for (index, name) in names.iter().enumerate() {
        let column = RowColumn { scalar_type: ScalarType::Float(8), byte_offset: index * NUMBER_BYTES, array_len: 1 };
        columns.insert((*name).to_owned(), column);
        if let Some(array) = name.strip_suffix("[0]") {
            let is_element = |name: &&&str| name.strip_prefix(array).is_some_and(|index| index.starts_with('['));
            let array_len = names[index..].iter().take_while(is_element).count();
            columns.insert(array.to_owned(), RowColumn { array_len, ..column });
        }
    }
    columns
}

/// The cells of a line as the numbers of a row; a cell without a number is NaN.
pub(super) fn row_of_line(line: &str, separator: char) -> Vec<u8> {
    line.split(separator).flat_map(|cell| cell.trim().parse().unwrap_or(f64::NAN).to_le_bytes()).collect()
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
