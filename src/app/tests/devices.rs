//! Devices at the ends of the tasks' wires.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::future::pending;
use std::rc::Rc;

use embassy_time::{Duration, Timer};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};

use crate::app::SetBaud;
use crate::frames::Field;
use crate::magnetometer::{Error, Identity, Magnetometer, Model, Reading};
use crate::settings::Baud;

pub const SENSOR: Identity = Identity { model: Model::Lis3mdl, address: 0x1E };

/// What a device does when it is asked for something.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mood {
    #[default]
    Works,
    Fails,
    Hangs,
    /// A line that has ended gives nothing, and does not wait.
    Ends,
    /// A chip whose registers are not as they were written.
    Upset,
}

/// A magnetometer that measures every 10 ms.
#[derive(Clone, Default)]
pub struct Chip {
    pub init: Rc<Cell<Mood>>,
    pub read: Rc<Cell<Mood>>,
    pub verify: Rc<Cell<Mood>>,
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

    async fn init(&mut self) -> Result<Identity, Error<()>> {
        self.inits.set(self.inits.get() + 1);
        match self.init.get() {
            Mood::Works => Ok(SENSOR),
            Mood::Fails | Mood::Ends => Err(Error::Bus(())),
            Mood::Upset => Err(Error::Configuration { written: 0, read: 1 }),
            Mood::Hangs => pending().await,
        }
    }

    async fn verify(&mut self) -> Result<(), Error<()>> {
        self.verifies.set(self.verifies.get() + 1);
        match self.verify.get() {
            Mood::Works => Ok(()),
            Mood::Fails | Mood::Ends => Err(Error::Bus(())),
            Mood::Upset => Err(Error::Configuration { written: 0, read: 1 }),
            Mood::Hangs => pending().await,
        }
    }

    fn stuck_after(&self) -> u16 {
        Self::STUCK_AFTER
    }

    async fn read(&mut self) -> Result<Reading, Error<()>> {
        Timer::after(Duration::from_micros(Self::PERIOD_US.into())).await;
        let (saturated, overrun) = self.flags.get();
        match self.read.get() {
            Mood::Works => Ok(Reading { field: Field::from_ut(20.0, 0.0, 40.0), saturated, overrun }),
            Mood::Fails | Mood::Ends | Mood::Upset => Err(Error::NoData),
            Mood::Hangs => pending().await,
        }
    }

    fn period_us(&self) -> u32 {
        Self::PERIOD_US
    }
}

/// A line that gives what was put on it, and then nothing or errors.
#[derive(Clone, Default)]
pub struct Line {
    pub bytes: Rc<RefCell<VecDeque<u8>>>,
    pub mood: Rc<Cell<Mood>>,
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
                Mood::Fails | Mood::Upset => return Err(ErrorKind::Other),
                Mood::Ends => return Ok(0),
                Mood::Works if !self.bytes.borrow().is_empty() => break,
                Mood::Works | Mood::Hangs => Timer::after_micros(100).await,
            }
        }
        let mut bytes = self.bytes.borrow_mut();
        let read = buffer.len().min(bytes.len());
        buffer.iter_mut().zip(bytes.drain(..read)).for_each(|(place, byte)| *place = byte);
        Ok(read)
    }
}

/// A port that keeps what is written.
#[derive(Clone, Default)]
pub struct Port {
    pub written: Rc<RefCell<Vec<u8>>>,
    /// How fast it was made to be, one after the other.
    pub bauds: Rc<RefCell<Vec<Baud>>>,
    pub mood: Rc<Cell<Mood>>,
}

impl Port {
    /// What was written since this was asked last.
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
            Mood::Works => self.written.borrow_mut().extend(bytes),
            Mood::Fails | Mood::Upset => return Err(ErrorKind::Other),
            Mood::Ends => return Ok(0),
            Mood::Hangs => pending().await,
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
