//! Faults of gyro and accelerometer.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use crate::devices::lsm6dsl::{InertialFault, InertialTruth};
use crate::faults::fault_switch::FaultSwitch;

/// Axes of the gyro, or of both sensors, that repeat their last value before the onset.
#[must_use]
pub fn stuck_gyro_axes(switch: FaultSwitch, axes: [bool; 3], is_accelerometer_stuck: bool) -> impl InertialFault {
    let mut last: Option<InertialTruth> = None;
    move |at_us: u64, measured: &mut InertialTruth| {
        let last = last.get_or_insert(*measured);
        if !switch.is_on(at_us) {
            *last = *measured;
        }
        for axis in (0..3).filter(|axis| axes[*axis]) {
            measured.rates_rad_s[axis] = last.rates_rad_s[axis];
            if is_accelerometer_stuck {
                measured.specific_force_m_s2[axis] = last.specific_force_m_s2[axis];
            }
        }
    }
}

/// Rates that are clipped within the chip's range.
#[must_use]
pub fn clipped_rates(switch: FaultSwitch, limit_rad_s: f64) -> impl InertialFault {
    move |at_us: u64, measured: &mut InertialTruth| {
        if switch.is_on(at_us) {
            measured.rates_rad_s = measured.rates_rad_s.map(|rate| rate.clamp(-limit_rad_s, limit_rad_s));
        }
    }
}

/// Vibration of both sensors on all axes, at an aliased frequency.
#[must_use]
pub fn inertial_vibration(switch: FaultSwitch, rate_rad_s: f64, force_m_s2: f64, alias_hz: f64) -> impl InertialFault {
    move |at_us: u64, measured: &mut InertialTruth| {
        if switch.is_on(at_us) {
            let phase = libm::sin(at_us as f64 * 1e-6 * alias_hz * TAU);
            measured.rates_rad_s.add_scalar_mut(rate_rad_s * phase);
            measured.specific_force_m_s2.add_scalar_mut(force_m_s2 * phase);
        }
    }
}

/// Both sensors turned by 90 deg about the vertical.
#[must_use]
pub fn wrong_axes(switch: FaultSwitch) -> impl InertialFault {
    let turned = |vector: Vector3<f64>| Vector3::new(vector.y, -vector.x, vector.z);
    move |at_us: u64, measured: &mut InertialTruth| {
        if switch.is_on(at_us) {
            measured.rates_rad_s = turned(measured.rates_rad_s);
            measured.specific_force_m_s2 = turned(measured.specific_force_m_s2);
        }
    }
}

/// The chip does not acknowledge.
pub struct SilentChip(pub FaultSwitch);

impl InertialFault for SilentChip {
    fn is_silent(&self, at_us: u64) -> bool {
        self.0.is_on(at_us)
    }
}
