//! The sensor as QEMU models it.

use autoswing::frames::{Field, Sensor as SensorFrame};
use autoswing::magnetometer::lsm303dlhc::{Config, Lsm303dlhc, Range};
use autoswing::magnetometer::{Error, Identity, Magnetometer, Reading};

use super::i2c::{NoAcknowledge, SensorBus};

/// QEMU takes no negative fields, so the world outside adds this many counts to each axis, and they are taken off here:
/// 93 microtesla on x and y, 104 on z, at the range of 1.3 gauss.
const ADDED_COUNTS: [f32; 3] = [1023.0, 1023.0, 1019.0];
const UT_PER_COUNT: [f32; 3] = [100.0 / 1100.0, 100.0 / 1100.0, 100.0 / 980.0];

/// An LSM303DLHC in QEMU.
pub struct Sensor(Lsm303dlhc<SensorBus>);

impl Sensor {
    pub const fn new(bus: SensorBus) -> Self {
        Self(Lsm303dlhc::new(bus, Config { range: Range::Gauss1_3 }))
    }
}

impl Magnetometer for Sensor {
    type BusError = NoAcknowledge;

    async fn init(&mut self) -> Result<Identity, Error<NoAcknowledge>> {
        self.0.init().await
    }

    async fn read(&mut self) -> Result<Reading, Error<NoAcknowledge>> {
        let reading = self.0.read().await?;
        let added: [f32; 3] = core::array::from_fn(|axis| ADDED_COUNTS[axis] * UT_PER_COUNT[axis]);
        let ut = reading.field.ut - nalgebra::Vector3::from(added);
        Ok(Reading { field: Field::<SensorFrame>::new(ut), ..reading })
    }

    async fn verify(&mut self) -> Result<(), Error<NoAcknowledge>> {
        self.0.verify().await
    }

    fn stuck_after(&self) -> u16 {
        self.0.stuck_after()
    }

    fn period_us(&self) -> u32 {
        self.0.period_us()
    }
}
