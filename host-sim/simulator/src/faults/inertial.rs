//! Faults of gyro and accelerometer.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Rotation3, Vector3};

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

/// Motion in axes that are turned about the vertical, clockwise as seen from above.
fn turn_axes(measured: &mut InertialTruth, turn_rad: f64) {
    let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), -turn_rad);
    measured.specific_force_m_s2 = rotation * measured.specific_force_m_s2;
    measured.rates_rad_s = rotation * measured.rates_rad_s;
}

/// Both sensors turned by 90 deg about the vertical.
#[must_use]
pub fn wrong_axes(switch: FaultSwitch) -> impl InertialFault {
    move |at_us: u64, measured: &mut InertialTruth| {
        if switch.is_on(at_us) {
            turn_axes(measured, FRAC_PI_2);
        }
    }
}

/// Step of the difference that gives the rate of a turning mount, microseconds.
const MOUNT_STEP_US: u64 = 1000;

/// A module that turns about the body's z axis in its mount, clockwise as seen from above.
#[must_use]
pub fn turning_mount(switch: FaultSwitch, turn_deg: f64) -> impl InertialFault {
    let turn_rad = move |at_us: u64| turn_deg.to_radians() * switch.changed_fraction(at_us);
    move |at_us: u64, measured: &mut InertialTruth| {
        let step_rad = turn_rad(at_us) - turn_rad(at_us.saturating_sub(MOUNT_STEP_US));
        turn_axes(measured, turn_rad(at_us));
        measured.rates_rad_s.z += step_rad / (MOUNT_STEP_US as f64 * 1e-6);
    }
}

/// The chip does not acknowledge.
pub struct SilentChip(pub FaultSwitch);

impl InertialFault for SilentChip {
    fn is_silent(&self, at_us: u64) -> bool {
        self.0.is_on(at_us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The gyro shows the whole turn, and then a roll about the body's x axis by the rotated axes.
    #[test]
    fn the_chip_turns_with_the_module() {
        let switch = FaultSwitch::initially_off();
        switch.set_active(1_000_000, 1_500_000);
        let mut fault = turning_mount(switch, 30.0);
        let mut turned_rad = 0.0;
        for at_ms in 0..3000 {
            let mut measured = InertialTruth {
                rates_rad_s: Vector3::new(1.0, 0.0, 0.0),
                specific_force_m_s2: Vector3::new(1.0, 0.0, -9.8),
                temperature_c: 20.0,
            };
            fault.modify_measurement(at_ms * 1000, &mut measured);
            turned_rad += measured.rates_rad_s.z * 1e-3;
            let angle_rad = -libm::atan2(measured.rates_rad_s.y, measured.rates_rad_s.x);
            let by_force_rad = -libm::atan2(measured.specific_force_m_s2.y, measured.specific_force_m_s2.x);
            assert!((angle_rad - turned_rad).abs() < 1e-6 && (by_force_rad - turned_rad).abs() < 1e-6, "{at_ms}");
        }
        assert!((turned_rad - 30_f64.to_radians()).abs() < 1e-6, "{turned_rad}");
    }
}
