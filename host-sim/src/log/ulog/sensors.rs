//! Which compass a row is of.

use super::super::Parameters;
use super::super::recorder::MAX_COMPASSES;

/// PX4 has parameters `CAL_MAG0` to `CAL_MAG3`.
const CALIBRATED: u8 = 4;

/// The sensors that were heard: the instance of the topic and the device, and the index of the compass, from 0.
#[derive(Default)]
pub(super) struct Sensors(Vec<((u8, u32), u8)>);

impl Sensors {
    /// Whether none was heard.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The compass of a device: of the parameters that name it; where none do, that of the topic's instance, if no other
    /// device has that, or the next. A device that does not say which it is is the primary one. None if there is no room.
    pub fn index(&mut self, parameters: &Parameters, instance: u8, id: u32) -> Option<u8> {
        let heard =
            |&&((other_instance, other), _): &&((u8, u32), u8)| other == id && (id != 0 || other_instance == instance);
        if let Some(&(_, index)) = self.0.iter().find(heard) {
            return Some(index);
        }
        let primary = || parameters.last("CAL_MAG_PRIME").filter(|_| instance == 0);
        let id_told = if id == 0 { primary() } else { Some(f64::from(id)) };
        let owner = |index: u8| parameters.last(&format!("CAL_MAG{index}_ID")).filter(|id| *id != 0.0);
        let named = (0..CALIBRATED).find(|&index| id_told.is_some() && owner(index) == id_told);
        let is_taken = |index: u8| self.0.iter().any(|&(_, other)| other == index);
        let is_free = |index: &u8| !is_taken(*index) && (id == 0 || owner(*index).is_none());
        let index = named.or_else(|| (instance..MAX_COMPASSES).chain(0..instance.min(MAX_COMPASSES)).find(is_free))?;
        self.0.push(((instance, id), index));
        Some(index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The second instance's device has the first parameters, and the first one's none: they are not one compass, and no
    /// device gets parameters of another. Both topics that a device is told by mean the same compass.
    #[test]
    fn every_device_is_a_compass_of_its_own() {
        let mut parameters = Parameters::default();
        for (name, id) in [("CAL_MAG0_ID", 7.0), ("CAL_MAG1_ID", 8.0), ("CAL_MAG2_ID", 0.0)] {
            parameters.set(0.0, name, id);
        }
        let mut sensors = Sensors::default();
        let mut index = |instance, id| sensors.index(&parameters, instance, id);
        assert_eq!(index(0, 9), Some(2));
        assert_eq!(index(1, 7), Some(0));
        assert_eq!(index(2, 10), Some(3));
        assert_eq!(index(3, 8), Some(1));
        assert_eq!([index(0, 9), index(0, 7), index(1, 10)], [Some(2), Some(0), Some(3)]);
    }

    /// Of old logs, which say no device, the only one is the primary one; and what pretends to have more than there can be is
    /// not read.
    #[test]
    fn a_device_that_says_nothing_is_the_primary_one() {
        let mut parameters = Parameters::default();
        for (name, id) in [("CAL_MAG0_ID", 7.0), ("CAL_MAG1_ID", 8.0), ("CAL_MAG_PRIME", 8.0)] {
            parameters.set(0.0, name, id);
        }
        assert_eq!(Sensors::default().index(&parameters, 0, 0), Some(1));
        let mut sensors = Sensors::default();
        let found: Vec<_> = (0..=20).map(|instance| sensors.index(&Parameters::default(), instance, 0)).collect();
        assert_eq!(found.iter().flatten().count(), usize::from(MAX_COMPASSES));
    }
}
