//! Faults of the magnetometer, injected between chip and bus.

use std::cell::RefCell;
use std::rc::Rc;

use super::Switch;
use crate::clock;
use crate::devices::i2c::{SharedTarget, Target};
use crate::random::{Purpose, Random};

/// First output register, and the auto-increment bit of the register address.
const OUT_X_L: u8 = 0x28;
const AUTO_INCREMENT: u8 = 0x80;

/// Fault of the chip.
pub trait SensorFault {
    /// Modifies a measurement, counts of x, y, z.
    fn tamper(&mut self, _at_us: u64, _counts: &mut [i16; 3]) {}

    /// Register address and bit mask of bits that flip now.
    fn upset(&mut self, _at_us: u64) -> Option<(u8, u8)> {
        None
    }
}

/// Bus device that applies faults to a chip.
pub struct FaultyChip {
    chip: SharedTarget,
    faults: Vec<Box<dyn SensorFault>>,
    /// First register of the next read.
    pointer: u8,
}

impl FaultyChip {
    /// A chip with faults.
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

impl Target for FaultyChip {
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

/// Axes that repeat their last value.
pub struct StuckAxes {
    /// Active time.
    pub switch: Switch,
    /// Affected axes.
    pub axes: [bool; 3],
    /// Last measurement before the onset.
    pub last: [i16; 3],
}

impl StuckAxes {
    /// A fault of these axes.
    #[must_use]
    pub fn new(switch: Switch, axes: [bool; 3]) -> Self {
        Self { switch, axes, last: [0; 3] }
    }
}

impl SensorFault for StuckAxes {
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

/// Additional normally distributed noise on each axis.
pub struct AdditionalNoise {
    /// Active time.
    pub switch: Switch,
    /// Standard deviation, counts.
    pub sigma_counts: f64,
    random: Random,
}

impl AdditionalNoise {
    /// Noise with this standard deviation, counts.
    #[must_use]
    pub fn new(switch: Switch, sigma: f64, seed: u64) -> Self {
        Self { switch, sigma_counts: sigma, random: Random::new(seed, Purpose::SensorFault) }
    }
}

impl SensorFault for AdditionalNoise {
    fn tamper(&mut self, at_us: u64, counts: &mut [i16; 3]) {
        if self.switch.is_on(at_us) {
            for count in counts {
                *count = (f64::from(*count) + self.sigma_counts * self.random.normal()).round() as i16;
            }
        }
    }
}

/// Isolated measurements with an error in one axis.
pub struct MeasurementSpikes {
    /// Active time.
    pub switch: Switch,
    /// Fraction of affected measurements.
    pub fraction: f64,
    /// Magnitude of the error, counts.
    pub height_counts: f64,
    random: Random,
}

impl MeasurementSpikes {
    /// Spikes of this height (counts) in this fraction of the measurements.
    #[must_use]
    pub fn new(switch: Switch, share: f64, height: f64, seed: u64) -> Self {
        Self { switch, fraction: share, height_counts: height, random: Random::new(seed, Purpose::SensorFault) }
    }
}

impl SensorFault for MeasurementSpikes {
    fn tamper(&mut self, at_us: u64, counts: &mut [i16; 3]) {
        if !self.switch.is_on(at_us) || self.random.uniform(0.0, 1.0) >= self.fraction {
            return;
        }
        let axis = self.random.uniform(0.0, 3.0) as usize;
        let sign = if self.random.uniform(-1.0, 1.0) < 0.0 { -1.0 } else { 1.0 };
        counts[axis.min(2)] = (f64::from(counts[axis.min(2)]) + sign * self.height_counts) as i16;
    }
}

/// Early saturation of an axis.
pub struct AxisClipping {
    /// Active time.
    pub switch: Switch,
    /// Axis, 0 to 2.
    pub axis: usize,
    /// Largest value, counts.
    pub limit_counts: i16,
}

impl SensorFault for AxisClipping {
    fn tamper(&mut self, at_us: u64, counts: &mut [i16; 3]) {
        if self.switch.is_on(at_us) {
            counts[self.axis] = counts[self.axis].min(self.limit_counts);
        }
    }
}

/// Single-event upset of register bits.
pub struct RegisterUpset {
    /// Active time; the upset occurs at its start.
    pub switch: Switch,
    /// Register address.
    pub register: u8,
    /// Bit mask.
    pub bits: u8,
    /// Whether the upset has occurred.
    pub has_occurred: bool,
}

impl SensorFault for RegisterUpset {
    fn upset(&mut self, at_us: u64) -> Option<(u8, u8)> {
        let happens = self.switch.is_on(at_us) && !self.has_occurred;
        self.has_occurred |= happens;
        happens.then_some((self.register, self.bits))
    }
}
