//! Faults of the magnetometer: between the chip and the bus.

use std::cell::RefCell;
use std::rc::Rc;

use super::Switch;
use crate::clock;
use crate::devices::i2c::{SharedTarget, Target};
use crate::random::{Purpose, Random};

/// The first of the six output registers, and the bit that has the address advance by itself.
const OUT_X_L: u8 = 0x28;
const AUTO_INCREMENT: u8 = 0x80;

/// Something wrong with the chip.
pub trait SensorFault {
    /// Changes a measurement on its way to the bus, counts of x, y, z.
    fn tamper(&mut self, _at_us: u64, _counts: &mut [i16; 3]) {}

    /// A register in which bits flip now, and which bits.
    fn upset(&mut self, _at_us: u64) -> Option<(u8, u8)> {
        None
    }
}

/// A chip with faults, at the chip's place on the bus.
pub struct Faulty {
    chip: SharedTarget,
    faults: Vec<Box<dyn SensorFault>>,
    /// The register that the next read begins with.
    pointer: u8,
}

impl Faulty {
    /// Around a chip.
    #[must_use]
    pub fn new(chip: SharedTarget, faults: Vec<Box<dyn SensorFault>>) -> Rc<RefCell<Self>> {
        Rc::new(RefCell::new(Self { chip, faults, pointer: 0 }))
    }

    fn flip(&mut self, register: u8, bits: u8) {
        let mut chip = self.chip.borrow_mut();
        let mut value = [0];
        chip.write(&[register]);
        chip.read(&mut value);
        chip.write(&[register, value[0] ^ bits]);
    }
}

impl Target for Faulty {
    fn acknowledges(&self, address: u8) -> bool {
        self.chip.borrow().acknowledges(address)
    }

    fn write(&mut self, bytes: &[u8]) {
        let now_us = clock::now_us();
        let upsets: Vec<_> = self.faults.iter_mut().filter_map(|fault| fault.upset(now_us)).collect();
        for (register, bits) in upsets {
            self.flip(register, bits);
        }
        if let Some(&pointer) = bytes.first() {
            self.pointer = pointer;
        }
        self.chip.borrow_mut().write(bytes);
    }

    fn read(&mut self, bytes: &mut [u8]) {
        self.chip.borrow_mut().read(bytes);
        let Ok(data): Result<&mut [u8; 6], _> = bytes.try_into() else { return };
        if self.pointer != OUT_X_L | AUTO_INCREMENT {
            return;
        }
        let [xl, xh, yl, yh, zl, zh] = *data;
        let mut counts = [[xl, xh], [yl, yh], [zl, zh]].map(i16::from_le_bytes);
        for fault in &mut self.faults {
            fault.tamper(clock::now_us(), &mut counts);
        }
        let [x, y, z] = counts.map(i16::to_le_bytes);
        *data = [x[0], x[1], y[0], y[1], z[0], z[1]];
    }
}

/// Axes that go on reading what they read when it began.
pub struct Stuck {
    /// While they do.
    pub switch: Switch,
    /// Which.
    pub axes: [bool; 3],
    /// What was read last before.
    pub last: [i16; 3],
}

impl Stuck {
    /// These axes.
    #[must_use]
    pub fn new(switch: Switch, axes: [bool; 3]) -> Self {
        Self { switch, axes, last: [0; 3] }
    }
}

impl SensorFault for Stuck {
    fn tamper(&mut self, at_us: u64, counts: &mut [i16; 3]) {
        if !self.switch.is_on(at_us) {
            self.last = *counts;
            return;
        }
        for ((count, last), stuck) in counts.iter_mut().zip(self.last).zip(self.axes) {
            if stuck {
                *count = last;
            }
        }
    }
}

/// More noise, normal, the same on each axis.
pub struct Noisy {
    /// While it is noisy.
    pub switch: Switch,
    /// Standard deviation, counts.
    pub sigma: f64,
    random: Random,
}

impl Noisy {
    /// So much more noise, counts.
    #[must_use]
    pub fn new(switch: Switch, sigma: f64, seed: u64) -> Self {
        Self { switch, sigma, random: Random::new(seed, Purpose::SensorFault) }
    }
}

impl SensorFault for Noisy {
    fn tamper(&mut self, at_us: u64, counts: &mut [i16; 3]) {
        if self.switch.is_on(at_us) {
            for count in counts {
                *count = (f64::from(*count) + self.sigma * self.random.normal()).round() as i16;
            }
        }
    }
}

/// Single readings that are far off in one axis.
pub struct Spiky {
    /// While there are spikes.
    pub switch: Switch,
    /// The part of the readings that has one.
    pub share: f64,
    /// How far off, counts, either way.
    pub height: f64,
    random: Random,
}

impl Spiky {
    /// Spikes of this height, counts, in this part of the readings.
    #[must_use]
    pub fn new(switch: Switch, share: f64, height: f64, seed: u64) -> Self {
        Self { switch, share, height, random: Random::new(seed, Purpose::SensorFault) }
    }
}

impl SensorFault for Spiky {
    fn tamper(&mut self, at_us: u64, counts: &mut [i16; 3]) {
        if !self.switch.is_on(at_us) || self.random.uniform(0.0, 1.0) >= self.share {
            return;
        }
        let axis = self.random.uniform(0.0, 3.0) as usize;
        let sign = if self.random.uniform(-1.0, 1.0) < 0.0 { -1.0 } else { 1.0 };
        counts[axis.min(2)] = (f64::from(counts[axis.min(2)]) + sign * self.height) as i16;
    }
}

/// An axis that ends before its range does.
pub struct Clipped {
    /// While it does.
    pub switch: Switch,
    /// Which axis, 0 to 2.
    pub axis: usize,
    /// Where it ends, counts: the largest it reads.
    pub limit: i16,
}

impl SensorFault for Clipped {
    fn tamper(&mut self, at_us: u64, counts: &mut [i16; 3]) {
        if self.switch.is_on(at_us) {
            counts[self.axis] = counts[self.axis].min(self.limit);
        }
    }
}

/// Bits of a register that flip once.
pub struct Upset {
    /// When: at its beginning.
    pub switch: Switch,
    /// The register's address.
    pub register: u8,
    /// The bits.
    pub bits: u8,
    /// Whether it has happened.
    pub done: bool,
}

impl SensorFault for Upset {
    fn upset(&mut self, at_us: u64) -> Option<(u8, u8)> {
        let happens = self.switch.is_on(at_us) && !self.done;
        self.done |= happens;
        happens.then_some((self.register, self.bits))
    }
}
