//! Tables of one topic each, as PX4's `ulog2csv` writes them.

use super::row_layout::{RowColumn, RowColumns};
use crate::log::scalar::ScalarType;

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
