//! Relates virtual time to the wall clock; the only module that reads it.

use std::time::{Duration, Instant};

/// Longest lag of virtual time that is caught up; a longer one means that the computer slept or is overloaded.
const MAX_CATCH_UP: Duration = Duration::from_millis(250);

pub struct VirtualClock {
    speed: f64,
    last_call: Instant,
    /// Wall time that was not caught up.
    skipped_time: Duration,
    has_warned: bool,
}

impl VirtualClock {
    pub fn new(speed: f64) -> Self {
        Self { speed, last_call: Instant::now(), skipped_time: Duration::ZERO, has_warned: false }
    }

    /// Virtual time since the last call, microseconds.
    pub fn elapsed_us(&mut self) -> u64 {
        let now = Instant::now();
        let passed = now - self.last_call;
        self.last_call = now;
        self.skipped_time += passed.saturating_sub(MAX_CATCH_UP);
        (passed.min(MAX_CATCH_UP).as_secs_f64() * self.speed * 1e6) as u64
    }

    /// A warning, returned once, if the computer is too slow.
    pub fn take_warning(&mut self) -> Option<String> {
        let is_new = self.skipped_time > Duration::from_secs(2) && !self.has_warned;
        self.has_warned |= is_new;
        is_new.then(|| format!("note: this computer does not keep up with --speed {}; it goes on slower", self.speed))
    }
}
