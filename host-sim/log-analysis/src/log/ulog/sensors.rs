//! Assignment of magnetometer devices to compass numbers.

use super::super::compass_slot::PX4_INDICES;
use super::super::flight_builder::MAX_COMPASSES;
use crate::log::parameters::ParameterHistory;

/// Sensors by topic instance and device id, with compass index from 0.
#[derive(Default)]
pub(super) struct CompassAssignment(Vec<((u8, u32), u8)>);

impl CompassAssignment {
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Compass index of a device: that of its calibration parameters, else the topic's instance if free, else the next
    /// free one. Id 0 of instance 0 is the primary device (`CAL_MAG_PRIME`). None if all indices are taken.
    pub fn compass_index(&mut self, parameters: &ParameterHistory, instance: u8, id: u32) -> Option<u8> {
        let matches_sensor = |&&((other_instance, used_index), _): &&((u8, u32), u8)| {
            used_index == id && (id != 0 || other_instance == instance)
        };
        if let Some(&(_, index)) = self.0.iter().find(matches_sensor) {
            return Some(index);
        }
        let primary = || parameters.last_value("CAL_MAG_PRIME").filter(|_| instance == 0);
        let known_id = if id == 0 { primary() } else { Some(f64::from(id)) };
        let owner = |index: u8| parameters.last_value(&format!("CAL_MAG{index}_ID")).filter(|id| *id != 0.0);
        let named = PX4_INDICES.into_iter().find(|&index| known_id.is_some() && owner(index) == known_id);
        let is_taken = |index: u8| self.0.iter().any(|&(_, used_index)| used_index == index);
        let is_free = |index: &u8| !is_taken(*index) && (id == 0 || owner(*index).is_none());
        let index = named.or_else(|| (instance..MAX_COMPASSES).chain(0..instance.min(MAX_COMPASSES)).find(is_free))?;
        self.0.push(((instance, id), index));
        Some(index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A device without parameters must not get those of another, and both topics of a device mean one compass.
    #[test]
    fn every_device_id_is_a_separate_compass() {
        let parameters =
            ParameterHistory::of_values(&[("CAL_MAG0_ID", 7.0), ("CAL_MAG1_ID", 8.0), ("CAL_MAG2_ID", 0.0)]);
        let mut sensors = CompassAssignment::default();
        let mut index = |instance, id| sensors.compass_index(&parameters, instance, id);
        assert_eq!(index(0, 9), Some(2));
        assert_eq!(index(1, 7), Some(0));
        assert_eq!(index(2, 10), Some(3));
        assert_eq!(index(3, 8), Some(1));
        assert_eq!([index(0, 9), index(0, 7), index(1, 10)], [Some(2), Some(0), Some(3)]);
    }

    /// Old logs report no device id.
    #[test]
    fn a_device_without_id_is_the_primary_compass() {
        let parameters =
            ParameterHistory::of_values(&[("CAL_MAG0_ID", 7.0), ("CAL_MAG1_ID", 8.0), ("CAL_MAG_PRIME", 8.0)]);
        assert_eq!(CompassAssignment::default().compass_index(&parameters, 0, 0), Some(1));
        let mut sensors = CompassAssignment::default();
        let indices: Vec<_> =
            (0..=20).map(|instance| sensors.compass_index(&ParameterHistory::default(), instance, 0)).collect();
        assert_eq!(indices.iter().flatten().count(), usize::from(MAX_COMPASSES));
    }
}
