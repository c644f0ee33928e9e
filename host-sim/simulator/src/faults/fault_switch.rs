//! Time in which a fault is active.

use std::cell::Cell;
use std::rc::Rc;

/// Cloneable handle to the time in which a fault is active.
#[derive(Clone, Debug)]
pub struct FaultSwitch(Rc<Cell<(u64, u64)>>);

impl FaultSwitch {
    /// A switch that is off until its active time is set.
    #[must_use]
    pub fn initially_off() -> Self {
        Self(Rc::new(Cell::new((u64::MAX, u64::MAX))))
    }

    /// A switch that is always on.
    #[must_use]
    pub fn always_on() -> Self {
        Self(Rc::new(Cell::new((0, u64::MAX))))
    }

    /// Sets the active time, microseconds of simulation time.
    pub fn set_active(&self, from_us: u64, until_us: u64) {
        self.0.set((from_us, until_us));
    }

    /// Whether the fault is active at this time.
    #[must_use]
    pub fn is_on(&self, at_us: u64) -> bool {
        let (from_us, until_us) = self.0.get();
        (from_us..until_us).contains(&at_us)
    }

    /// Time since the onset, seconds; `None` while off.
    #[must_use]
    pub fn active_for_s(&self, at_us: u64) -> Option<f64> {
        self.is_on(at_us).then(|| (at_us - self.0.get().0) as f64 / 1e6)
    }

    /// Elapsed fraction of the active time: 0 before, 1 after it.
    #[must_use]
    pub fn elapsed_fraction(&self, at_us: u64) -> f64 {
        let (from_us, until_us) = self.0.get();
        (at_us.saturating_sub(from_us) as f64 / until_us.saturating_sub(from_us).max(1) as f64).min(1.0)
    }
}
