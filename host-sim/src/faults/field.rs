//! Faults of the field: iron that moves, currents, what passes by, another place.

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::Switch;
use crate::random::{Purpose, Random};
use crate::world::earth::Earth;

/// Changes the field that reaches the chip. It is asked for any instant of the last two seconds, in any order.
pub trait FieldFault {
    /// What is added in the chip's axes, microtesla.
    fn added_ut(&self, _at_us: u64) -> Vector3<f64> {
        Vector3::zeros()
    }

    /// Where the aircraft is, if not where its settings say.
    fn earth(&self, _at_us: u64) -> Option<Earth> {
        None
    }
}

/// Hard iron of so many microtesla that was elsewhere before.
pub struct Moved {
    /// When it is here.
    pub switch: Switch,
    /// What it adds, chip axes.
    pub change_ut: Vector3<f64>,
}

impl FieldFault for Moved {
    fn added_ut(&self, at_us: u64) -> Vector3<f64> {
        if self.switch.is_on(at_us) { self.change_ut } else { Vector3::zeros() }
    }
}

/// A zero that drifts as the sensor warms up: in a straight line while the switch is on, then it stays.
pub struct Drift {
    /// While it drifts.
    pub switch: Switch,
    /// At the end, chip axes.
    pub change_ut: Vector3<f64>,
}

impl FieldFault for Drift {
    fn added_ut(&self, at_us: u64) -> Vector3<f64> {
        self.change_ut * self.switch.progress(at_us)
    }
}

/// Iron that passes: grows to its largest and fades again as a raised cosine over the time of the switch.
pub struct Passing {
    /// From when it is felt until it is gone.
    pub switch: Switch,
    /// At its nearest, chip axes.
    pub peak_ut: Vector3<f64>,
}

impl FieldFault for Passing {
    fn added_ut(&self, at_us: u64) -> Vector3<f64> {
        let near =
            if self.switch.is_on(at_us) { (1.0 - (2.0 * PI * self.switch.progress(at_us)).cos()) / 2.0 } else { 0.0 };
        self.peak_ut * near
    }
}

/// A current in proportion to throttle. Throttle was the same all through the calibration; from then on it is moved
/// every few seconds, and follows in half a second.
pub struct Throttle {
    switch: Switch,
    full_ut: Vector3<f64>,
    /// Seconds since the beginning, and the throttle from then on, -1..1 about cruise.
    moves: Vec<(f64, f64)>,
}

impl Throttle {
    /// From cruise to full throttle it adds so much in chip axes, microtesla.
    #[must_use]
    pub fn new(switch: Switch, full_ut: Vector3<f64>, seed: u64) -> Self {
        let mut random = Random::new(seed, Purpose::Throttle);
        let mut moves = vec![(0.0, 0.0)];
        let mut at_s = 0.0;
        while at_s < 3600.0 {
            at_s += random.uniform(3.0, 12.0);
            moves.push((at_s, random.uniform(-1.0, 1.0)));
        }
        Self { switch, full_ut, moves }
    }
}

impl FieldFault for Throttle {
    fn added_ut(&self, at_us: u64) -> Vector3<f64> {
        let Some(on_s) = self.switch.on_for_s(at_us) else { return Vector3::zeros() };
        let next = self.moves.partition_point(|&(from_s, _)| from_s <= on_s);
        let (from_s, now) = self.moves[next - 1];
        let before = self.moves[next.saturating_sub(2)].1;
        let share = ((on_s - from_s) / 0.5).min(1.0);
        self.full_ut * (before + (now - before) * share)
    }
}

/// Another place, with another field.
pub struct Elsewhere {
    /// While it is there.
    pub switch: Switch,
    /// The field there.
    pub earth: Earth,
}

impl FieldFault for Elsewhere {
    fn earth(&self, at_us: u64) -> Option<Earth> {
        self.switch.is_on(at_us).then_some(self.earth)
    }
}
