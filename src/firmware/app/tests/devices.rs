//! Simulated devices of the tasks.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::future::pending;
use std::rc::Rc;

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};

use crate::app::task_links::SensorDetection;
use crate::app::{SetBaud, Watchdog};
use crate::chip::{ChipError, MeasuringChip};
use crate::magnetometer::Magnetometer;
use autoswing::frames::Field;
use autoswing::reading::{Identity, MagnetometerModel, Reading};
use autoswing_module::settings::BaudRate;

/// The fake magnetometer.
pub const DETECTED_SENSOR: SensorDetection = SensorDetection {
    identity: Identity { model: MagnetometerModel::Lis3mdl, address: 0x1E },
    period_us: FakeMagnetometer::PERIOD_US,
    equal_readings_until_stuck: FakeMagnetometer::EQUAL_READINGS_UNTIL_STUCK,
};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceBehaviour {
    #[default]
    Works,
    Fails,
    Hangs,
    /// The line returns no bytes, and does not wait.
    EndOfInput,
}

/// Magnetometer with a measurement every 10 ms.
#[derive(Clone, Default)]
pub struct FakeMagnetometer {
    pub init_behaviour: Rc<Cell<DeviceBehaviour>>,
    pub read_behaviour: Rc<Cell<DeviceBehaviour>>,
    pub verify_behaviour: Rc<Cell<DeviceBehaviour>>,
    pub was_overwritten: Rc<Cell<bool>>,
    pub init_count: Rc<Cell<u32>>,
}

impl FakeMagnetometer {
    pub const PERIOD_US: u32 = 10_000;
    pub const EQUAL_READINGS_UNTIL_STUCK: u16 = 20;
}

impl DeviceBehaviour {
    async fn access_registers(self) -> Result<(), ChipError<()>> {
        match self {
            Self::Works => Ok(()),
            Self::Fails | Self::EndOfInput => Err(ChipError::Bus(())),
            Self::Hangs => pending().await,
        }
    }
}

impl MeasuringChip for FakeMagnetometer {
    type BusError = ();
    type Identity = Identity;
    type Measurement = Reading;

    async fn init(&mut self) -> Result<Identity, ChipError<()>> {
        self.init_count.set(self.init_count.get() + 1);
        self.init_behaviour.get().access_registers().await?;
        Ok(DETECTED_SENSOR.identity)
    }

    async fn verify_configuration(&mut self) -> Result<(), ChipError<()>> {
        self.verify_behaviour.get().access_registers().await
    }

    async fn read_measurement(&mut self) -> Result<Reading, ChipError<()>> {
        Timer::after(Duration::from_micros(Self::PERIOD_US.into())).await;
        self.read_behaviour.get().access_registers().await?;
        let field = Field::from_ut(20.0, 0.0, 40.0);
        Ok(Reading { field, is_saturated: false, was_overwritten: self.was_overwritten.get() })
    }

    fn period_us(&self) -> u32 {
        Self::PERIOD_US
    }
}

impl Magnetometer for FakeMagnetometer {
    fn equal_readings_until_stuck(&self) -> u16 {
        Self::EQUAL_READINGS_UNTIL_STUCK
    }
}

/// Line that returns queued bytes, then nothing or errors.
#[derive(Clone, Default)]
pub struct FakeReceiver {
    pub queued_bytes: Rc<RefCell<VecDeque<u8>>>,
    pub behaviour: Rc<Cell<DeviceBehaviour>>,
    pub read_count: Rc<Cell<u32>>,
}

impl FakeReceiver {
    pub fn queue_bytes(&self, bytes: &[u8]) {
        self.queued_bytes.borrow_mut().extend(bytes);
    }
}

impl ErrorType for FakeReceiver {
    type Error = ErrorKind;
}

impl Read for FakeReceiver {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        self.read_count.set(self.read_count.get() + 1);
        loop {
            match self.behaviour.get() {
                DeviceBehaviour::Fails => return Err(ErrorKind::Other),
                DeviceBehaviour::EndOfInput => return Ok(0),
                DeviceBehaviour::Works if !self.queued_bytes.borrow().is_empty() => break,
                DeviceBehaviour::Works | DeviceBehaviour::Hangs => Timer::after_micros(100).await,
            }
        }
        let mut bytes = self.queued_bytes.borrow_mut();
        let read = buffer.len().min(bytes.len());
        buffer.iter_mut().zip(bytes.drain(..read)).for_each(|(place, byte)| *place = byte);
        Ok(read)
    }
}

/// Port that records its output.
#[derive(Clone, Default)]
pub struct FakeTransmitter {
    pub written: Rc<RefCell<Vec<u8>>>,
    pub behaviour: Rc<Cell<DeviceBehaviour>>,
}

impl FakeTransmitter {
    /// Removes and returns the recorded output.
    pub fn take_text(&self) -> String {
        String::from_utf8(self.written.take()).unwrap()
    }
}

impl ErrorType for FakeTransmitter {
    type Error = ErrorKind;
}

impl Write for FakeTransmitter {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        match self.behaviour.get() {
            DeviceBehaviour::Works => self.written.borrow_mut().extend(bytes),
            DeviceBehaviour::Fails => return Err(ErrorKind::Other),
            DeviceBehaviour::EndOfInput => return Ok(0),
            DeviceBehaviour::Hangs => pending().await,
        }
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

impl SetBaud for FakeTransmitter {
    fn set_baud(&mut self, _: BaudRate) {}
}

/// Hardware watchdog that never resets.
#[derive(Clone, Default)]
pub struct FakeWatchdog {
    pub feed_count: Rc<Cell<u32>>,
    pub last_feed_us: Rc<Cell<u64>>,
    pub longest_interval_us: Rc<Cell<u64>>,
    /// Time of the first mark of a good image.
    pub marked_good_at_ms: Rc<Cell<Option<u64>>>,
}

impl Watchdog for FakeWatchdog {
    fn feed(&mut self) {
        let now_us = Instant::now().as_micros();
        let interval_us = now_us - self.last_feed_us.replace(now_us);
        self.longest_interval_us.set(self.longest_interval_us.get().max(interval_us));
        self.feed_count.set(self.feed_count.get() + 1);
    }

    fn mark_image_good(&mut self) {
        self.marked_good_at_ms.set(self.marked_good_at_ms.get().or(Some(Instant::now().as_millis())));
    }
}
