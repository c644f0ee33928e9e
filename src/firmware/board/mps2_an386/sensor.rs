//! Magnetometer of the machine: QEMU's model of the LSM303DLHC.

use autoswing::frames::{Field, Sensor};
use autoswing::reading::{Identity, Reading};
use autoswing_firmware::chip::{ChipError, MeasuringChip};
use autoswing_firmware::magnetometer::Magnetometer;
use autoswing_firmware::magnetometer::lsm303dlhc::Lsm303dlhc;

use super::i2c::{NoAcknowledge, SensorBus};

/// Offset added by the simulator and subtracted here, because QEMU accepts no negative fields: 93 uT on x and y, 104 uT
/// on z at a range of 1.3 gauss.
const OFFSET_COUNTS: [f32; 3] = [1023.0, 1023.0, 1019.0];
const UT_PER_COUNT: [f32; 3] = [100.0 / 1100.0, 100.0 / 1100.0, 100.0 / 980.0];

pub struct EmulatedMagnetometer(Lsm303dlhc<SensorBus>);

impl EmulatedMagnetometer {
    pub const fn new(bus: SensorBus) -> Self {
        Self(Lsm303dlhc::new(bus))
    }
}

impl MeasuringChip for EmulatedMagnetometer {
    type BusError = NoAcknowledge;
    type Identity = Identity;
    type Measurement = Reading;

    async fn init(&mut self) -> Result<Identity, ChipError<NoAcknowledge>> {
        self.0.init().await
    }

    async fn read_measurement(&mut self) -> Result<Reading, ChipError<NoAcknowledge>> {
        let reading = self.0.read_measurement().await?;
        let offset_ut: [f32; 3] = core::array::from_fn(|axis| OFFSET_COUNTS[axis] * UT_PER_COUNT[axis]);
        let ut = reading.field.ut - nalgebra::Vector3::from(offset_ut);
        Ok(Reading { field: Field::<Sensor>::new(ut), ..reading })
    }

    async fn verify_configuration(&mut self) -> Result<(), ChipError<NoAcknowledge>> {
        self.0.verify_configuration().await
    }

    fn period_us(&self) -> u32 {
        self.0.period_us()
    }
}

impl Magnetometer for EmulatedMagnetometer {
    fn equal_readings_until_stuck(&self) -> u16 {
        self.0.equal_readings_until_stuck()
    }
}
