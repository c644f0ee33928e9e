//! Assignment of logged compasses to the parameter slots of the autopilot.
//!
//! ArduPilot numbers compasses in messages (`MAG.I`, `RAW_IMU`, `SCALED_IMU2`) and in `COMPASS_USEn` by priority, but
//! its calibration parameters (`COMPASS_OFSn`, `DIAn`, `ORIENTn`, ...) by slot: the slot whose `COMPASS_DEV_IDn` equals
//! `COMPASS_PRIOi_ID` is that of priority i. Firmware before 4.1 has no priorities; there number and slot are the same.
//! `MAG` rows contain the offsets in use, which prove the slot or contradict it.

use std::fmt;

use super::parameters::ParameterHistory;

/// ArduPilot has calibration parameters of three compasses.
pub(crate) const ARDUPILOT_SLOTS: std::ops::RangeInclusive<u8> = 1..=3;

/// PX4 has parameters `CAL_MAG0` to `CAL_MAG3`.
pub(super) const PX4_INDICES: [u8; 4] = [0, 1, 2, 3];

/// Largest difference between logged offsets, which are truncated to whole milligauss, and their parameters.
pub(super) const MAX_OFFSET_ROUNDING_MG: f64 = 1.5;

/// Slot of a compass in the names of its calibration parameters, by which corrections are undone and parameters written.
/// ArduPilot: 1 to 3, `COMPASS_OFS_X` has 1; PX4: n of `CAL_MAGn`; tables: the number of the compass. Of an unknown slot
/// the raw field is the logged one, and no parameters are written.
pub type CompassSlot = Result<u8, UnknownSlot>;

/// Reason why a slot is unknown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UnknownSlot {
    /// The log has no calibration parameters.
    NoParameters,
    /// The device id of a priority is not logged, or zero. The priority.
    NoPriorityId(u8),
    /// No slot, or more than one, has the device id of a priority. The priority.
    NoUniqueDeviceId(u8),
    /// Several compasses, without their priorities in the log.
    SeveralCompasses,
    /// The offsets in use equal the parameters of another slot than that of the device id or number.
    OffsetsContradict {
        /// Slot by device id or number.
        expected: u8,
        /// Slot whose offsets are in use.
        found: u8,
    },
    /// PX4's `HIGHRES_IMU` is the primary compass, corrected and less the bias of its filter.
    PrimaryLessBias,
    /// The blackbox has neither the calibration nor the alignment.
    NotInBlackbox,
    /// The tables of `ulog2csv` lack the parameters.
    NotInTables,
}

impl UnknownSlot {
    /// Whether the log contradicts itself about the slot; an unknown slot otherwise cannot be checked.
    pub const fn is_contradictory(self) -> bool {
        matches!(self, Self::OffsetsContradict { .. })
    }

    /// What to do for a file of parameters.
    pub const fn remedy(self) -> &'static str {
        match self {
            Self::NotInBlackbox => {
                "Calibrate the compass by the autopilot's own procedure, away from iron, and judge the log of the next flight: no \
                 parameters can be made of a blackbox."
            }
            Self::NotInTables => "Judge the .ulg that the tables were made of: it has the parameters.",
            Self::NoParameters | Self::PrimaryLessBias => {
                "Judge the autopilot's own log of this flight, from its SD card: it has the parameters."
            }
            Self::NoPriorityId(_)
            | Self::NoUniqueDeviceId(_)
            | Self::SeveralCompasses
            | Self::OffsetsContradict { .. } => {
                "Set the compasses' order and ids right (COMPASS_PRIOn_ID, COMPASS_DEV_IDn) and restart the autopilot; then judge \
                 the log of the next flight."
            }
        }
    }
}

impl fmt::Display for UnknownSlot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoParameters => f.write_str("the log has no calibration parameters"),
            Self::NoPriorityId(priority) => write!(f, "COMPASS_PRIO{priority}_ID is not in the log, or 0"),
            Self::NoUniqueDeviceId(priority) => {
                write!(f, "COMPASS_PRIO{priority}_ID is not the COMPASS_DEV_ID of one slot")
            }
            Self::SeveralCompasses => f.write_str("several compasses, and no COMPASS_PRIOn_ID in the log"),
            Self::OffsetsContradict { expected, found } => {
                write!(f, "the offsets in use are those of slot {found}, but the parameters assign slot {expected}")
            }
            Self::NotInBlackbox => f.write_str("a blackbox has neither calibration nor alignment of the compass"),
            Self::NotInTables => f.write_str("ulog2csv writes no parameters"),
            Self::PrimaryLessBias => {
                f.write_str("HIGHRES_IMU is the primary compass, corrected and less the bias of PX4's filter")
            }
        }
    }
}

/// Index in the names of ArduPilot's parameters: empty for the first slot.
pub(crate) fn ardupilot_index(slot: u8) -> String {
    if slot == 1 { String::new() } else { slot.to_string() }
}

/// Names of the three components of a calibration parameter of a slot, as `COMPASS_OFS2_X`.
pub(crate) fn ardupilot_vector(vector: &str, slot: u8) -> [String; 3] {
    let index = ardupilot_index(slot);
    ["X", "Y", "Z"].map(|axis| format!("COMPASS_{vector}{index}_{axis}"))
}

/// Name of ArduPilot's parameter for an external compass in a slot.
pub(crate) fn external_parameter(slot: u8) -> String {
    if slot == 1 { "COMPASS_EXTERNAL".to_owned() } else { format!("COMPASS_EXTERN{slot}") }
}

/// The part of an ArduPilot log that assigns compasses to slots.
pub(super) struct ArdupilotSlots<'a> {
    pub parameters: &'a ParameterHistory,
    /// Whether the log contains all parameters, as DataFlash does.
    pub has_all_parameters: bool,
    pub firmware_name: Option<&'a str>,
    pub compass_count: usize,
}

impl ArdupilotSlots<'_> {
    /// Slot of a compass by number, with the first offsets of its rows: time, seconds, and milligauss.
    pub fn slot(&self, compass_number: u8, first_offsets: Option<(f64, [f32; 3])>) -> CompassSlot {
        let index = self.assigned_slot(compass_number)?;
        // Offsets of zero identify no slot.
        let has_offsets = |(_, offsets_mg): &(f64, [f32; 3])| {
            offsets_mg.iter().any(|axis| f64::from(axis.abs()) > MAX_OFFSET_ROUNDING_MG)
        };
        let matching = first_offsets
            .filter(has_offsets)
            .map_or_else(Vec::new, |(t_s, offsets_mg)| self.slots_with(t_s, offsets_mg));
        match *matching {
            [found, ..] if !matching.contains(&index) => Err(UnknownSlot::OffsetsContradict { expected: index, found }),
            _ => Ok(index),
        }
    }

    /// Device id of a compass: that of its slot, else that of its priority.
    pub fn device_id(&self, compass_number: u8, slot: CompassSlot) -> Option<DeviceId> {
        let value = match slot {
            Ok(index) => self.device_id_value(index),
            Err(_) => self.parameters.last_value(&format!("COMPASS_PRIO{compass_number}_ID")),
        };
        DeviceId::from_parameter(value?)
    }

    fn assigned_slot(&self, compass_number: u8) -> CompassSlot {
        let index = if !self.parameters.has_prefix("COMPASS_") {
            return Err(UnknownSlot::NoParameters);
        } else if self.parameters.has_prefix("COMPASS_PRIO") {
            return self.slot_of_priority(compass_number);
        } else if self.has_all_parameters || self.is_before_priorities() {
            Some(compass_number).filter(|number| ARDUPILOT_SLOTS.contains(number))
        } else {
            self.slot_of_only_compass(compass_number)
        };
        index.ok_or(UnknownSlot::SeveralCompasses)
    }

    fn slot_of_priority(&self, priority: u8) -> CompassSlot {
        let id = self.parameters.last_value(&format!("COMPASS_PRIO{priority}_ID")).filter(|id| *id != 0.0);
        let id = id.ok_or(UnknownSlot::NoPriorityId(priority))?;
        let mut slots = ARDUPILOT_SLOTS.filter(|slot| self.device_id_value(*slot) == Some(id));
        slots.next().filter(|_| slots.next().is_none()).ok_or(UnknownSlot::NoUniqueDeviceId(priority))
    }

    /// Slot of the only compass of a telemetry link, which may have lost its priority: that with a device id.
    fn slot_of_only_compass(&self, compass_number: u8) -> Option<u8> {
        let mut detected = ARDUPILOT_SLOTS.filter(|slot| self.device_id_value(*slot).is_some_and(|id| id != 0.0));
        let first = detected.next();
        (compass_number == 1 && self.compass_count == 1 && detected.next().is_none()).then_some(first.unwrap_or(1))
    }

    /// Whether the firmware is older than 4.1, with the offsets of all compasses in the log.
    fn is_before_priorities(&self) -> bool {
        let is_old = self.firmware_name.and_then(firmware_version).is_some_and(|version| version < (4, 1));
        let has_offsets =
            |slot: u8| ardupilot_vector("OFS", slot).iter().all(|name| self.parameters.last_value(name).is_some());
        is_old && ARDUPILOT_SLOTS.take(self.compass_count).all(has_offsets)
    }

    fn device_id_value(&self, slot: u8) -> Option<f64> {
        self.parameters.last_value(&format!("COMPASS_DEV_ID{}", ardupilot_index(slot)))
    }

    /// Slots whose offset parameters are these at a time.
    fn slots_with(&self, t_s: f64, offsets_mg: [f32; 3]) -> Vec<u8> {
        let matches = |slot: &u8| {
            let logged = ardupilot_vector("OFS", *slot).map(|name| self.parameters.value_at(t_s, &name));
            let is_near = |(logged, offset_mg): (&Option<f64>, f32)| {
                (logged.unwrap_or(0.0) - f64::from(offset_mg)).abs() <= MAX_OFFSET_ROUNDING_MG
            };
            logged.iter().any(Option::is_some) && logged.iter().zip(offsets_mg).all(is_near)
        };
        ARDUPILOT_SLOTS.filter(matches).collect()
    }
}

/// Major and minor version in the name of a firmware, as `ArduCopter V3.6.12 (0c5e999c)` or `PX4 1.15.0`.
pub(super) fn firmware_version(name: &str) -> Option<(u32, u32)> {
    name.split_whitespace().find_map(|word| {
        let (major, rest) = word.trim_start_matches(['V', 'v']).split_once('.')?;
        let minor: String = rest.chars().take_while(char::is_ascii_digit).collect();
        Some((major.parse().ok()?, minor.parse().ok()?))
    })
}

/// Device id of a sensor, in the layout common to ArduPilot and PX4: bits 0 to 2 are the type of the bus, 3 to 7 the bus, 8
/// to 15 the address, 16 to 23 the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceId(u32);

/// ArduPilot's numbers of magnetometers (`AP_Compass_Backend.h`).
const ARDUPILOT_CHIPS: [(u32, &str); 21] = [
    (0x01, "HMC5883"),
    (0x02, "LSM303D"),
    (0x04, "AK8963"),
    (0x05, "BMM150"),
    (0x06, "LSM9DS1"),
    (0x07, "HMC5883"),
    (0x08, "LIS3MDL"),
    (0x09, "AK09916"),
    (0x0A, "IST8310"),
    (0x0B, "ICM20948"),
    (0x0C, "MMC3416"),
    (0x0D, "QMC5883L"),
    (0x0E, "MAG3110"),
    (0x10, "IST8308"),
    (0x11, "RM3100"),
    (0x13, "MMC5983"),
    (0x14, "AK09918"),
    (0x15, "AK09915"),
    (0x16, "QMC5883P"),
    (0x17, "BMM350"),
    (0x18, "IIS2MDC"),
];

/// PX4's numbers of magnetometers (`drv_sensor.h`).
const PX4_CHIPS: [(u32, &str); 8] = [
    (0x01, "HMC5883"),
    (0x04, "AK8963"),
    (0x05, "LIS3MDL"),
    (0x06, "IST8310"),
    (0x07, "RM3100"),
    (0x08, "QMC5883L"),
    (0x09, "AK09916"),
    (0x0E, "IIS2MDC"),
];

impl DeviceId {
    /// Device id from the value of a parameter; none if zero.
    pub(crate) fn from_parameter(value: f64) -> Option<Self> {
        // PX4 logs integers of 32 bits with a sign.
        let id = (value as i64) as u32;
        (id != 0).then_some(Self(id))
    }

    /// Whether the sensor is a node of a CAN bus, or sends its field by MSP.
    pub const fn is_node(self) -> bool {
        matches!(self.0 & 7, 3 | 5)
    }

    /// Chip and bus by their usual names: `RM3100, I2C bus 0`. A node of a CAN bus does not name its chip.
    pub fn chip_and_bus(self, is_px4: bool) -> String {
        let (bus, address) = (self.0 >> 3 & 0x1F, self.0 >> 8 & 0xFF);
        let bus = match self.0 & 7 {
            1 => format!("I2C bus {bus}"),
            2 => format!("SPI bus {bus}"),
            3 => format!("CAN node {address}"),
            5 => "MSP".to_owned(),
            _ => return format!("device id {}", self.0),
        };
        let chips: &[(u32, &str)] = if is_px4 { &PX4_CHIPS } else { &ARDUPILOT_CHIPS };
        let chip = chips.iter().find(|(number, _)| *number == self.0 >> 16 & 0xFF && !self.is_node());
        chip.map_or_else(|| bus.clone(), |(_, name)| format!("{name}, {bus}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST_ID: f64 = 97_539.0;
    const SECOND_ID: f64 = 131_874.0;

    fn slots(parameters: &ParameterHistory) -> ArdupilotSlots<'_> {
        ArdupilotSlots { parameters, has_all_parameters: true, firmware_name: None, compass_count: 2 }
    }

    const IDS: [(&str, f64); 4] = [
        ("COMPASS_DEV_ID", FIRST_ID),
        ("COMPASS_DEV_ID2", SECOND_ID),
        ("COMPASS_PRIO1_ID", SECOND_ID),
        ("COMPASS_PRIO2_ID", FIRST_ID),
    ];
    const OFFSETS: [(&str, f64); 2] = [("COMPASS_OFS_X", 100.0), ("COMPASS_OFS2_X", -50.7)];

    #[test]
    fn a_priority_has_the_slot_of_its_device_id_if_the_offsets_in_use_agree() {
        let parameters = ParameterHistory::of_values(&[&IDS[..], &OFFSETS].concat());
        let slots = slots(&parameters);
        let slot_with_x = |x_mg: f32| slots.slot(1, Some((1.0, [x_mg, 0.0, 0.0])));
        assert_eq!(slots.slot(1, None), Ok(2));
        assert_eq!(slot_with_x(-50.0), Ok(2));
        // Offsets learnt in flight are those of no slot.
        assert_eq!(slot_with_x(-30.0), Ok(2));
        let contradictory = slot_with_x(100.0);
        assert!(contradictory.is_err_and(UnknownSlot::is_contradictory), "{contradictory:?}");
        assert_eq!(slots.device_id(1, contradictory), slots.device_id(1, Ok(2)));
        assert_eq!(slots.slot(2, Some((1.0, [100.0, 0.0, 0.0]))), Ok(1));
    }

    #[test]
    fn ids_that_name_no_slot_leave_it_unknown() {
        for (changed, value, reason) in [
            ("COMPASS_PRIO1_ID", 0.0, UnknownSlot::NoPriorityId(1)),
            ("COMPASS_PRIO1_ID", 5.0, UnknownSlot::NoUniqueDeviceId(1)),
            ("COMPASS_DEV_ID", SECOND_ID, UnknownSlot::NoUniqueDeviceId(1)),
        ] {
            let mut parameters = ParameterHistory::of_values(&[&IDS[..], &OFFSETS].concat());
            parameters.replace_value(changed, value);
            assert_eq!(slots(&parameters).slot(1, Some((1.0, [-50.0, 0.0, 0.0]))), Err(reason));
        }
    }

    #[test]
    fn without_priorities_a_link_needs_a_single_compass_or_old_firmware() {
        let offsets: Vec<String> =
            ["", "2"].iter().flat_map(|n| ["X", "Y", "Z"].map(|axis| format!("COMPASS_OFS{n}_{axis}"))).collect();
        let offsets: Vec<(&str, f64)> = offsets.iter().map(|name| (name.as_str(), 7.0)).collect();
        let of_link = |values: &[(&str, f64)], firmware_name, compass_count| {
            let parameters = ParameterHistory::of_values(values);
            ArdupilotSlots { parameters: &parameters, has_all_parameters: false, firmware_name, compass_count }
                .slot(1, None)
        };
        let several = Err(UnknownSlot::SeveralCompasses);
        assert_eq!(of_link(&offsets, None, 1), Ok(1));
        assert_eq!(of_link(&[("COMPASS_DEV_ID2", 7.0)], None, 1), Ok(2));
        assert_eq!(of_link(&IDS[..2], None, 1), several);
        assert_eq!(of_link(&[], None, 1), Err(UnknownSlot::NoParameters));
        for (firmware_name, slot) in [
            (None, several),
            (Some("ArduCopter V4.1.0"), several),
            (Some("ArduPlane V4.0.9 (ab)"), Ok(1)),
            (Some("APM:Copter V3.3-dev (9f)"), Ok(1)),
        ] {
            assert_eq!(of_link(&offsets, firmware_name, 2), slot, "{firmware_name:?}");
        }
        assert_eq!(of_link(&offsets[..5], Some("ArduPlane V4.0.9"), 2), several);
    }

    #[test]
    fn a_device_id_names_chip_and_bus() {
        for (id, is_px4, text) in [
            (0x09_0E_09, false, "AK09916, I2C bus 1"),
            (0x06_0E_09, true, "IST8310, I2C bus 1"),
            (0x06_0E_09, false, "LSM9DS1, I2C bus 1"),
            (0x01_7D_03, false, "CAN node 125"),
            (0x44_03_22, false, "SPI bus 4"),
            (4, false, "device id 4"),
        ] {
            let device_id = DeviceId::from_parameter(f64::from(id)).unwrap();
            assert_eq!(device_id.chip_and_bus(is_px4), text);
        }
        assert_eq!(DeviceId::from_parameter(0.0), None);
    }
}
