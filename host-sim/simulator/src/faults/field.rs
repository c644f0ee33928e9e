//! Faults of the field: hard-iron changes, currents, passing objects, another place.

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::Switch;
use crate::random::{Purpose, Random};
use crate::world::earth::Earth;
pub use crate::world::fault_interfaces::FieldFault;

/// Permanent hard-iron change, microtesla, chip axes.
#[must_use]
pub fn hard_iron_change(switch: Switch, change_ut: Vector3<f64>) -> impl FieldFault {
    move |at_us| if switch.is_on(at_us) { change_ut } else { Vector3::zeros() }
}

/// Zero drift of a warming sensor: linear while the switch is on, then constant; microtesla, chip axes.
#[must_use]
pub fn zero_drift(switch: Switch, change_ut: Vector3<f64>) -> impl FieldFault {
    move |at_us| change_ut * switch.progress(at_us)
}

/// Hard iron that relaxes to a new value, as of a magnetised part that warms; microtesla, chip axes.
#[must_use]
pub fn hard_iron_drift(switch: Switch, change_ut: Vector3<f64>, time_constant_s: f64) -> impl FieldFault {
    move |at_us| {
        let on_for_s = switch.active_for_s(at_us).unwrap_or(0.0);
        change_ut * (1.0 - libm::exp(-on_for_s / time_constant_s))
    }
}

/// Passing magnetic object: a raised cosine over the active time; its peak in microtesla, chip axes.
#[must_use]
pub fn passing_object(switch: Switch, peak_ut: Vector3<f64>) -> impl FieldFault {
    move |at_us| {
        let near = if switch.is_on(at_us) { (1.0 - libm::cos(2.0 * PI * switch.progress(at_us))) / 2.0 } else { 0.0 };
        peak_ut * near
    }
}

/// Interference in proportion to throttle, which is constant before the onset; then it changes every few seconds
/// within 0.5 s. `full_ut`: change from cruise to full throttle, microtesla, chip axes.
#[must_use]
pub fn throttle_interference(switch: Switch, full_ut: Vector3<f64>, seed: u64) -> impl FieldFault {
    let mut random = Random::new(seed, Purpose::Throttle);
    // Times since the onset (seconds) and new throttle values, -1..1 relative to cruise.
    let mut moves = vec![(0.0, 0.0)];
    let mut at_s = 0.0;
    while at_s < 3600.0 {
        at_s += random.uniform(3.0, 12.0);
        moves.push((at_s, random.uniform(-1.0, 1.0)));
    }
    move |at_us| {
        let Some(on_s) = switch.active_for_s(at_us) else { return Vector3::zeros() };
        let next = moves.partition_point(|&(from_s, _)| from_s <= on_s);
        let (from_s, now) = moves[next - 1];
        let before = moves[next.saturating_sub(2)].1;
        let share = ((on_s - from_s) / 0.5).min(1.0);
        full_ut * (before + (now - before) * share)
    }
}

/// Another place with another field.
pub struct OtherPlace {
    /// Active time.
    pub switch: Switch,
    /// Earth's field at that place.
    pub earth: Earth,
}

impl FieldFault for OtherPlace {
    fn earth(&self, at_us: u64) -> Option<Earth> {
        self.switch.is_on(at_us).then_some(self.earth)
    }
}
