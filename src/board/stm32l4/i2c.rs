//! An I2C bus that recovers.

use embassy_stm32::Peri;
use embassy_stm32::gpio::{AnyPin, Level, OutputOpenDrain, Speed};
use embassy_stm32::i2c::{Config, Error, I2c, Master};
use embassy_stm32::mode::Async;
use embassy_time::{Duration, Timer};
use embedded_hal_async::i2c::{ErrorType, Operation};

/// Half a clock period while a stuck chip is clocked: 100 kHz, which every chip follows.
const HALF_CLOCK: Duration = Duration::from_micros(5);
/// A chip that holds the data line is at most in the middle of a byte and its acknowledge.
const CLOCKS: u32 = 9;

/// The HAL's driver and what is needed to make it again.
pub struct I2cBus {
    driver: Option<I2c<'static, Async, Master>>,
    make: fn() -> I2c<'static, Async, Master>,
    scl: Peri<'static, AnyPin>,
    sda: Peri<'static, AnyPin>,
}

impl I2cBus {
    /// A bus whose driver `make` makes.
    ///
    /// # Safety
    ///
    /// `make` may be called whenever the driver it made before has been dropped, and `scl` and `sda` are that driver's
    /// pins; nothing else uses any of these peripherals.
    pub unsafe fn new(
        scl: Peri<'static, AnyPin>,
        sda: Peri<'static, AnyPin>,
        make: fn() -> I2c<'static, Async, Master>,
    ) -> Self {
        Self { driver: None, make, scl, sda }
    }

    /// The driver; made anew, on a bus that has been cleared, after an error and at the first use.
    async fn driver(&mut self) -> &mut I2c<'static, Async, Master> {
        if self.driver.is_none() {
            self.free_data_line().await;
        }
        self.driver.get_or_insert_with(self.make)
    }

    /// Keeps the driver only after a transfer that left it in a known state. After a time-out the HAL leaves the
    /// peripheral as it is: a START that is still pending would go out when the bus gets free.
    fn settle(&mut self, result: Result<(), Error>) -> Result<(), Error> {
        if !matches!(result, Ok(()) | Err(Error::Nack)) {
            self.driver = None;
        }
        result
    }

    /// A chip that was interrupted while it sent a zero holds the data line low and waits for clocks: it gets them,
    /// and a STOP.
    async fn free_data_line(&mut self) {
        let mut scl = OutputOpenDrain::new(self.scl.reborrow(), Level::High, Speed::Low);
        let mut sda = OutputOpenDrain::new(self.sda.reborrow(), Level::High, Speed::Low);
        Timer::after(HALF_CLOCK).await;
        if sda.is_high() {
            return;
        }
        for _ in 0..CLOCKS {
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
        self.settle(result)
    }

    async fn write(&mut self, address: u8, write: &[u8]) -> Result<(), Error> {
        let result = self.driver().await.write(address, write).await;
        self.settle(result)
    }

    async fn write_read(&mut self, address: u8, write: &[u8], read: &mut [u8]) -> Result<(), Error> {
        let result = self.driver().await.write_read(address, write, read).await;
        self.settle(result)
    }

    async fn transaction(&mut self, address: u8, operations: &mut [Operation<'_>]) -> Result<(), Error> {
        let result = self.driver().await.transaction(address, operations).await;
        self.settle(result)
    }
}

/// The configuration of a sensor bus: 400 kHz, and no transfer longer than 10 ms (the longest takes 0.3 ms; the HAL
/// sees some missing acknowledges only by its time-out, of one second unless told).
pub fn config() -> Config {
    let mut config = Config::default();
    config.frequency = embassy_stm32::time::Hertz(400_000);
    config.timeout = Duration::from_millis(10);
    config
}
