//! Device id of a sensor.

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
    #[must_use]
    pub const fn is_node(self) -> bool {
        matches!(self.0 & 7, 3 | 5)
    }

    /// Chip and bus by their usual names: `RM3100, I2C bus 0`. A node of a CAN bus does not name its chip.
    #[must_use]
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
