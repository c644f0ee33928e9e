//! Virtual time against the clock on the wall: the only place where this program reads it.

use std::time::{Duration, Instant};

/// Longer than this nothing is caught up with: the computer slept, or cannot keep up.
const LONGEST: Duration = Duration::from_millis(250);

/// How fast virtual time goes.
pub struct Pace {
    speed: f64,
    last: Instant,
    /// Of wall time, what was not caught up with.
    lost: Duration,
    is_told: bool,
}

impl Pace {
    /// So many times as fast as the wall's, from now on.
    pub fn new(speed: f64) -> Self {
        Self { speed, last: Instant::now(), lost: Duration::ZERO, is_told: false }
    }

    /// Microseconds of virtual time since the last call.
    pub fn passed_us(&mut self) -> u64 {
        let now = Instant::now();
        let passed = now - self.last;
        self.last = now;
        self.lost += passed.saturating_sub(LONGEST);
        (passed.min(LONGEST).as_secs_f64() * self.speed * 1e6) as u64
    }

    /// Once, what is to be told when much was lost.
    pub fn complaint(&mut self) -> Option<String> {
        let is_new = self.lost > Duration::from_secs(2) && !self.is_told;
        self.is_told |= is_new;
        is_new.then(|| format!("note: this computer does not keep up with --speed {}; it goes on slower", self.speed))
    }
}
