//! Collecting by itself: an uncalibrated module begins when it flies, and asks nobody.

use super::Compass;
use super::Phase;
use crate::calibration::ladder::Procedure;

/// What came on the autopilot's line since the start says within so many samples, 5 s, whether there is an autopilot that
/// tells when it is armed: its heartbeat comes every second.
const PATIENCE_SAMPLES: u8 = 50;

/// Who collects.
#[derive(Clone, Copy, Debug)]
pub(super) struct Auto {
    /// The module has begun the collection that is under way.
    pub began: bool,
    /// A person has begun or ended one, and decides from now on: what he collected is not forgotten unasked.
    pub is_held: bool,
    /// Samples since the start, up to [`PATIENCE_SAMPLES`].
    samples: u8,
}

impl Auto {
    /// At the start.
    pub const NEW: Self = Self { began: false, is_held: false, samples: 0 };
}

impl Compass<'_> {
    /// Begins a collection if nobody has, where one is wanted. Where the autopilot tells whether it is armed, when it is:
    /// before, it is carried about and stands beside iron.
    pub(super) fn begin_by_itself(&mut self) {
        self.auto.samples = self.auto.samples.saturating_add(1).min(PATIENCE_SAMPLES);
        let is_idle = matches!(self.phase, Phase::Idle) && self.saving.is_none() && self.sensor.is_some();
        if self.flies() && is_idle && self.collects_by_itself() {
            self.begin(Procedure::Flight);
            self.auto.began = true;
        }
    }

    /// Whether it is armed, or nobody tells.
    fn flies(&self) -> bool {
        self.is_armed.unwrap_or(self.auto.samples == PATIENCE_SAMPLES)
    }

    /// Whether a collection rests, or has not begun, because the autopilot is not armed.
    pub(super) fn awaits_arming(&self) -> bool {
        let wants = self.auto.began || matches!(self.phase, Phase::Idle) && self.collects_by_itself();
        wants && self.is_armed == Some(false)
    }

    /// Whether the module collects without being asked, as soon as it flies.
    fn collects_by_itself(&self) -> bool {
        self.settings.auto_on && !self.auto.is_held && self.in_use().is_none()
    }

    /// Whether a sample is to be collected: what the module began rests while the autopilot is not armed, and after a
    /// restart until that is known.
    pub(super) fn collects(&self) -> bool {
        matches!(self.phase, Phase::Collecting) && (!self.auto.began || self.flies())
    }

    /// A person decides from now on.
    pub(super) fn hold(&mut self) {
        self.auto.began = false;
        self.auto.is_held = true;
    }

    /// What `cal auto` and `cal clear` mean for a collection that nobody asked for.
    pub(super) fn release(&mut self, auto_on: bool) {
        self.auto.is_held = false;
        if !auto_on && self.auto.began {
            self.forget();
        }
    }
}
