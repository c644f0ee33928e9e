//! I2C bus with recovery from errors.

use embassy_stm32::Peri;
use embassy_stm32::gpio::{AnyPin, Level, OutputOpenDrain, Speed};
use embassy_stm32::i2c::{Config, Error, I2c, Master};
use embassy_stm32::mode::Async;
use embassy_time::{Duration, Timer};
use embedded_hal_async::i2c::{ErrorType, Operation};

/// Half a clock period of the bus recovery: 100 kHz, supported by every chip.
const HALF_CLOCK: Duration = Duration::from_micros(5);
/// Number of clocks of the recovery: a byte and its acknowledge.
const RECOVERY_CLOCKS: u32 = 9;

/// The HAL's driver, with the means to recreate it.
pub struct I2cBus {
    driver: Option<I2c<'static, Async, Master>>,
    make_driver: fn() -> I2c<'static, Async, Master>,
    scl: Peri<'static, AnyPin>,
    sda: Peri<'static, AnyPin>,
}

impl I2cBus {
    /// A bus with a function that creates its driver.
    ///
    /// # Safety
    ///
    /// `make_driver` may be called whenever the previous driver has been dropped, `scl` and `sda` are that driver's
    /// pins, and nothing else uses these peripherals.
    pub unsafe fn new(
        scl: Peri<'static, AnyPin>,
        sda: Peri<'static, AnyPin>,
        make_driver: fn() -> I2c<'static, Async, Master>,
    ) -> Self {
        Self { driver: None, make_driver, scl, sda }
    }

    /// The driver; created after bus recovery at the first use and after an error.
    async fn driver(&mut self) -> &mut I2c<'static, Async, Master> {
        if self.driver.is_none() {
            self.free_data_line().await;
        }
        self.driver.get_or_insert_with(self.make_driver)
    }

    /// Drops the driver unless the transfer left it in a known state. After a timeout the HAL leaves a START pending,
    /// which would be sent once the bus is free.
    fn drop_driver_after_failure(&mut self, result: Result<(), Error>) -> Result<(), Error> {
        if !matches!(result, Ok(()) | Err(Error::Nack)) {
            self.driver = None;
        }
        result
    }

    /// Bus recovery: clocks a chip that was interrupted while sending a zero and holds the data line low, then sends a
    /// STOP.
    async fn free_data_line(&mut self) {
        let mut scl = OutputOpenDrain::new(self.scl.reborrow(), Level::High, Speed::Low);
        let mut sda = OutputOpenDrain::new(self.sda.reborrow(), Level::High, Speed::Low);
        Timer::after(HALF_CLOCK).await;
        if sda.is_high() {
            return;
        }
        for _ in 0..RECOVERY_CLOCKS {
            scl.set_low();
            Timer::after(HALF_CLOCK).await;
            scl.set_high();
            Timer::after(HALF_CLOCK).await;
        }
        sda.set_low();
        Timer::after(HALF_CLOCK).await;
        sda.set_high();
        Timer::after(HALF_CLOCK).await;
    }
}

impl ErrorType for I2cBus {
    type Error = Error;
}

impl embedded_hal_async::i2c::I2c for I2cBus {
    async fn read(&mut self, address: u8, read: &mut [u8]) -> Result<(), Error> {
        let result = self.driver().await.read(address, read).await;
        self.drop_driver_after_failure(result)
    }

    async fn write(&mut self, address: u8, write: &[u8]) -> Result<(), Error> {
        let result = self.driver().await.write(address, write).await;
        self.drop_driver_after_failure(result)
    }

    async fn write_read(&mut self, address: u8, write: &[u8], read: &mut [u8]) -> Result<(), Error> {
        let result = self.driver().await.write_read(address, write, read).await;
        self.drop_driver_after_failure(result)
    }

    async fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), Error> {
        let result = self.driver().await.transaction(address, operations).await;
        self.drop_driver_after_failure(result)
    }
}

/// Configuration of the sensor bus: 400 kHz; timeout 10 ms, since the longest transfer takes 0.3 ms, and the HAL
/// detects some missing acknowledges only by its timeout (default 1 s).
pub fn i2c_config() -> Config {
    let mut config = Config::default();
    config.frequency = embassy_stm32::time::Hertz(400_000);
    config.timeout = Duration::from_millis(10);
    config
}
