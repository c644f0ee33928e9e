//! Faults of the magnetometer, injected between chip and bus.

use std::cell::RefCell;
use std::f64::consts::TAU;
use std::rc::Rc;

use nalgebra::Vector3;
use testkit::clock;

use crate::devices::i2c::{SharedI2cDevice, SimulatedI2cDevice};
use crate::devices::lsm6dsl::InertialFault;
use crate::faults::fault_switch::FaultSwitch;
use crate::random::{RandomStream, StreamPurpose};

/// First output register of the LIS3MDL.
const OUT_X_L: u8 = 0x28;
/// Auto-increment bit of the register address.
const AUTO_INCREMENT: u8 = 0x80;

/// Fault of the chip.
pub trait SensorFault {
    /// Modifies a measurement, counts of x, y, z.
    fn modify_counts(&mut self, _at_us: u64, _counts: &mut [i16; 3]) {}

    /// Register address and bit mask of bits that flip now.
    fn register_upset(&mut self, _at_us: u64) -> Option<(u8, u8)> {
        None
    }
}

/// Bus device that applies faults to a chip.
pub struct FaultyChip {
    chip: SharedI2cDevice,
    faults: Vec<Box<dyn SensorFault>>,
    /// First register of the next read.
    pointer: u8,
}

impl FaultyChip {
    /// A chip with faults.
    #[must_use]
    pub fn new(chip: SharedI2cDevice, faults: Vec<Box<dyn SensorFault>>) -> Rc<RefCell<Self>> {
        Rc::new(RefCell::new(Self { chip, faults, pointer: 0 }))
    }

    fn flip_register_bits(&mut self, register: u8, bits: u8) {
        let mut chip = self.chip.borrow_mut();
        let mut value = [0];
        chip.write_bytes(&[register]);
        chip.read_bytes(&mut value);
        chip.write_bytes(&[register, value[0] ^ bits]);
    }
}

impl SimulatedI2cDevice for FaultyChip {
    fn acknowledges_address(&self, address: u8) -> bool {
        self.chip.borrow().acknowledges_address(address)
    }

    fn write_bytes(&mut self, bytes: &[u8]) {
        let now_us = clock::now_us();
        let upsets: Vec<_> = self.faults.iter_mut().filter_map(|fault| fault.register_upset(now_us)).collect();
        for (register, bits) in upsets {
            self.flip_register_bits(register, bits);
        }
        if let Some(&pointer) = bytes.first() {
            self.pointer = pointer;
        }
        self.chip.borrow_mut().write_bytes(bytes);
    }

    fn read_bytes(&mut self, bytes: &mut [u8]) {
        self.chip.borrow_mut().read_bytes(bytes);
        let Ok(data): Result<&mut [u8; 6], _> = bytes.try_into() else { return };
        if self.pointer != OUT_X_L | AUTO_INCREMENT {
            return;
        }
        let [xl, xh, yl, yh, zl, zh] = *data;
        let mut counts = [[xl, xh], [yl, yh], [zl, zh]].map(i16::from_le_bytes);
        for fault in &mut self.faults {
            fault.modify_counts(clock::now_us(), &mut counts);
        }
        let [x, y, z] = counts.map(i16::to_le_bytes);
        *data = [x[0], x[1], y[0], y[1], z[0], z[1]];
    }
}

impl<F: FnMut(u64, &mut [i16; 3])> SensorFault for F {
    fn modify_counts(&mut self, at_us: u64, counts: &mut [i16; 3]) {
        self(at_us, counts);
    }
}

/// Axes that repeat their last value before the onset.
#[must_use]
pub fn stuck_axes(switch: FaultSwitch, axes: [bool; 3]) -> impl SensorFault {
    let mut last = [0; 3];
    move |at_us: u64, counts: &mut [i16; 3]| {
        if !switch.is_on(at_us) {
            last = *counts;
            return;
        }
        for ((count, last), stuck) in counts.iter_mut().zip(last).zip(axes) {
            if stuck {
                *count = last;
            }
        }
    }
}

/// Additional normally distributed noise on each axis.
#[must_use]
pub fn additional_noise(switch: FaultSwitch, sigma_counts: f64, seed: u64) -> impl SensorFault {
    let mut random = RandomStream::new(seed, StreamPurpose::SensorFault);
    move |at_us: u64, counts: &mut [i16; 3]| {
        if switch.is_on(at_us) {
            for count in counts {
                *count = (f64::from(*count) + sigma_counts * random.gaussian()).round() as i16;
            }
        }
    }
}

/// Error in one axis in a fraction of the measurements.
#[must_use]
pub fn measurement_spikes(switch: FaultSwitch, fraction: f64, height_counts: f64, seed: u64) -> impl SensorFault {
    let mut random = RandomStream::new(seed, StreamPurpose::SensorFault);
    move |at_us: u64, counts: &mut [i16; 3]| {
        if !switch.is_on(at_us) || random.uniform(0.0, 1.0) >= fraction {
            return;
        }
        let axis = random.uniform(0.0, 3.0) as usize;
        let sign = if random.uniform(-1.0, 1.0) < 0.0 { -1.0 } else { 1.0 };
        counts[axis.min(2)] = (f64::from(counts[axis.min(2)]) + sign * height_counts) as i16;
    }
}

/// Vibration of the sensor against iron near a multiple of its sample rate: the alias is slow, and passes all averaging
/// (a motor at 4,800 rpm vibrates at the 80 Hz of a LIS3MDL). `alias_hz`: the difference.
#[must_use]
pub fn aliased_vibration(switch: FaultSwitch, peak_counts: Vector3<f64>, alias_hz: f64) -> impl SensorFault {
    move |at_us: u64, counts: &mut [i16; 3]| {
        let Some(on_s) = switch.active_for_s(at_us) else { return };
        let now = libm::sin(TAU * alias_hz * on_s);
        for (count, peak) in counts.iter_mut().zip(&peak_counts) {
            *count = (f64::from(*count) + peak * now).round() as i16;
        }
    }
}

/// Early saturation of an axis, 0 to 2.
#[must_use]
pub fn axis_clipping(switch: FaultSwitch, axis: usize, limit_counts: i16) -> impl SensorFault {
    move |at_us: u64, counts: &mut [i16; 3]| {
        if switch.is_on(at_us) {
            counts[axis] = counts[axis].min(limit_counts);
        }
    }
}

/// Single-event upset of register bits of a magnetometer or an inertial sensor.
pub struct RegisterUpset {
    /// Time in which the fault is active; the upset occurs at its start.
    pub fault_switch: FaultSwitch,
    /// Address of the register, and mask of the bits that flip.
    pub register_bits: (u8, u8),
    /// Whether the upset has occurred.
    pub has_occurred: bool,
}

impl SensorFault for RegisterUpset {
    fn register_upset(&mut self, at_us: u64) -> Option<(u8, u8)> {
        let occurs_now = self.fault_switch.is_on(at_us) && !self.has_occurred;
        self.has_occurred |= occurs_now;
        occurs_now.then_some(self.register_bits)
    }
}

impl InertialFault for RegisterUpset {
    fn register_upset(&mut self, at_us: u64) -> Option<(u8, u8)> {
        SensorFault::register_upset(self, at_us)
    }
}
