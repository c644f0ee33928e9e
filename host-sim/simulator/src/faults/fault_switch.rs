//! Time in which a fault is active.

use std::cell::Cell;
use std::rc::Rc;

/// Cloneable handle to the time in which a fault is active.
#[derive(Clone, Debug)]
pub struct FaultSwitch(Rc<Cell<ActiveTime>>);

/// Active time, microseconds of simulation time, and course of a change in it.
#[derive(Clone, Copy, Debug)]
struct ActiveTime {
    from_us: u64,
    until_us: u64,
    is_exponential: bool,
}

/// Time constants of an exponential change in the active time: by its end 95 % have changed.
const TIME_CONSTANTS_IN_ACTIVE_TIME: f64 = 3.0;

impl FaultSwitch {
    /// A switch that is off until its active time is set.
    #[must_use]
    pub fn initially_off() -> Self {
        Self::active_within(u64::MAX, u64::MAX)
    }

    /// A switch that is always on.
    #[must_use]
    pub fn always_on() -> Self {
        Self::active_within(0, u64::MAX)
    }

    fn active_within(from_us: u64, until_us: u64) -> Self {
        Self(Rc::new(Cell::new(ActiveTime { from_us, until_us, is_exponential: false })))
    }

    /// Sets the active time, microseconds of simulation time.
    pub fn set_active(&self, from_us: u64, until_us: u64) {
        self.0.set(ActiveTime { from_us, until_us, ..self.0.get() });
    }

    /// Makes a change exponential instead of linear.
    pub fn change_exponentially(&self) {
        self.0.set(ActiveTime { is_exponential: true, ..self.0.get() });
    }

    /// Whether the fault is active at this time.
    #[must_use]
    pub fn is_on(&self, at_us: u64) -> bool {
        let ActiveTime { from_us, until_us, .. } = self.0.get();
        (from_us..until_us).contains(&at_us)
    }

    /// Time since the onset, seconds; `None` while off.
    #[must_use]
    pub fn active_for_s(&self, at_us: u64) -> Option<f64> {
        self.is_on(at_us).then(|| (at_us - self.0.get().from_us) as f64 / 1e6)
    }

    /// Elapsed fraction of the active time: 0 before, 1 after it.
    #[must_use]
    pub fn elapsed_fraction(&self, at_us: u64) -> f64 {
        self.active_times_since_onset(at_us).min(1.0)
    }

    /// Fraction of the fault's size that is reached, linearly or exponentially in the active time: 0 before it. A fault
    /// without an end has its size at once.
    #[must_use]
    pub fn changed_fraction(&self, at_us: u64) -> f64 {
        let ActiveTime { from_us, until_us, is_exponential } = self.0.get();
        if until_us == u64::MAX {
            f64::from(u8::from(at_us >= from_us))
        } else if is_exponential {
            1.0 - libm::exp(-TIME_CONSTANTS_IN_ACTIVE_TIME * self.active_times_since_onset(at_us))
        } else {
            self.elapsed_fraction(at_us)
        }
    }

    fn active_times_since_onset(&self, at_us: u64) -> f64 {
        let ActiveTime { from_us, until_us, .. } = self.0.get();
        at_us.saturating_sub(from_us) as f64 / until_us.saturating_sub(from_us).max(1) as f64
    }
}
