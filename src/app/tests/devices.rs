//! Simulated devices of the tasks.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::future::pending;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};

use crate::app::SetBaud;
use crate::frames::Field;
use crate::magnetometer::{Magnetometer, MagnetometerError};
use crate::reading::{Identity, MagnetometerModel, Reading};
use crate::settings::Baud;

pub const SENSOR: Identity = Identity { model: MagnetometerModel::Lis3mdl, address: 0x1E };

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceBehaviour {
    #[default]
    Works,
    Fails,
    Hangs,
    /// The line returns no bytes, and does not wait.
    Ends,
    /// The chip's registers differ from the written values.
    Upset,
}

/// Magnetometer with a measurement every 10 ms.
#[derive(Clone, Default)]
pub struct Chip {
    pub init: Rc<Cell<DeviceBehaviour>>,
    pub read: Rc<Cell<DeviceBehaviour>>,
    pub verify: Rc<Cell<DeviceBehaviour>>,
    pub verifies: Rc<Cell<u32>>,
    pub flags: Rc<Cell<(bool, bool)>>,
    pub inits: Rc<Cell<u32>>,
}

impl Chip {
    pub const PERIOD_US: u32 = 10_000;
    pub const STUCK_AFTER: u16 = 20;
}

impl Magnetometer for Chip {
    type BusError = ();

    async fn init(&mut self) -> Result<Identity, MagnetometerError<()>> {
        self.inits.set(self.inits.get() + 1);
        match self.init.get() {
            DeviceBehaviour::Works => Ok(SENSOR),
            DeviceBehaviour::Fails | DeviceBehaviour::Ends => Err(MagnetometerError::Bus(())),
            DeviceBehaviour::Upset => Err(MagnetometerError::Configuration { written: 0, read: 1 }),
            DeviceBehaviour::Hangs => pending().await,
        }
    }

    async fn verify_configuration(&mut self) -> Result<(), MagnetometerError<()>> {
        self.verifies.set(self.verifies.get() + 1);
        match self.verify.get() {
            DeviceBehaviour::Works => Ok(()),
            DeviceBehaviour::Fails | DeviceBehaviour::Ends => Err(MagnetometerError::Bus(())),
            DeviceBehaviour::Upset => Err(MagnetometerError::Configuration { written: 0, read: 1 }),
            DeviceBehaviour::Hangs => pending().await,
        }
    }

    fn stuck_reading_count(&self) -> u16 {
        Self::STUCK_AFTER
    }

    async fn read_measurement(&mut self) -> Result<Reading, MagnetometerError<()>> {
        Timer::after(Duration::from_micros(Self::PERIOD_US.into())).await;
        let (saturated, overrun) = self.flags.get();
        match self.read.get() {
            DeviceBehaviour::Works => Ok(Reading {
                field: Field::from_ut(20.0, 0.0, 40.0),
                is_saturated: saturated,
                was_overwritten: overrun,
            }),
            DeviceBehaviour::Fails | DeviceBehaviour::Ends | DeviceBehaviour::Upset => Err(MagnetometerError::NoData),
            DeviceBehaviour::Hangs => pending().await,
        }
    }

    fn period_us(&self) -> u32 {
        Self::PERIOD_US
    }
}

/// Line that returns queued bytes, then nothing or errors.
#[derive(Clone, Default)]
pub struct Line {
    pub bytes: Rc<RefCell<VecDeque<u8>>>,
    pub mood: Rc<Cell<DeviceBehaviour>>,
    pub reads: Rc<Cell<u32>>,
}

impl Line {
    pub fn put(&self, bytes: &[u8]) {
        self.bytes.borrow_mut().extend(bytes);
    }
}

impl ErrorType for Line {
    type Error = ErrorKind;
}

impl Read for Line {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        self.reads.set(self.reads.get() + 1);
        loop {
            match self.mood.get() {
                DeviceBehaviour::Fails | DeviceBehaviour::Upset => return Err(ErrorKind::Other),
                DeviceBehaviour::Ends => return Ok(0),
                DeviceBehaviour::Works if !self.bytes.borrow().is_empty() => break,
                DeviceBehaviour::Works | DeviceBehaviour::Hangs => Timer::after_micros(100).await,
            }
        }
        let mut bytes = self.bytes.borrow_mut();
        let read = buffer.len().min(bytes.len());
        buffer.iter_mut().zip(bytes.drain(..read)).for_each(|(place, byte)| *place = byte);
        Ok(read)
    }
}

/// Port that records its output.
#[derive(Clone, Default)]
pub struct Port {
    pub written: Rc<RefCell<Vec<u8>>>,
    /// Baud rates in the order they were set.
    pub bauds: Rc<RefCell<Vec<Baud>>>,
    pub mood: Rc<Cell<DeviceBehaviour>>,
}

impl Port {
    /// Removes and returns the recorded output.
    pub fn text(&self) -> String {
        String::from_utf8(self.written.take()).unwrap()
    }
}

impl ErrorType for Port {
    type Error = ErrorKind;
}

impl Write for Port {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        match self.mood.get() {
            DeviceBehaviour::Works => self.written.borrow_mut().extend(bytes),
            DeviceBehaviour::Fails | DeviceBehaviour::Upset => return Err(ErrorKind::Other),
            DeviceBehaviour::Ends => return Ok(0),
            DeviceBehaviour::Hangs => pending().await,
        }
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

impl SetBaud for Port {
    fn set_baud(&mut self, baud: Baud) {
        self.bauds.borrow_mut().push(baud);
    }
}
