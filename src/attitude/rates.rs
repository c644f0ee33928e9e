//! Whether a source's body rates are those of its angles.
//!
//! Rates with the wrong sign, or degrees where radians are meant, carry the attitude of a report to where it never is.
//! They show in the angles themselves: from one report to the next these change by what the rates say, or they do not.

use super::Report;
use super::motion::Motion;
use crate::frames::{Attitude, wrap_pi};
use crate::time::Timestamp;

/// How long a step of the angles is remembered, seconds.
const MEMORY_S: f32 = 1.0;

/// Rates are not believed when what they leave of the steps is more than so many times the steps' own squares, and a
/// little, radians squared: half a degree within the memory.
const MOST_LEFT: f32 = 2.0;
const MOST_OF_NOTHING: f32 = 8e-5;

/// The squares of the angles' steps from report to report, and of what the rates leave of them.
#[derive(Clone, Debug)]
pub(super) struct RatesCheck {
    last: Option<(Timestamp, Attitude, Motion)>,
    steps: f32,
    left: f32,
    contradicted: bool,
}

impl RatesCheck {
    /// Before any report.
    pub const fn new() -> Self {
        Self { last: None, steps: 0.0, left: 0.0, contradicted: false }
    }

    /// Takes a report that was sent at `at`, so long after the one before if that is known; gives whether its rates are
    /// believed.
    pub fn see(&mut self, at: Timestamp, report: &Report, max_gap_us: u32) -> bool {
        let Some(motion) = Motion::of(report) else {
            self.last = None;
            return false;
        };
        if let Some((before_at, before, by)) =
            self.last.filter(|(last, ..)| at.us_since(*last) <= u64::from(max_gap_us))
        {
            let step_s = at.us_since(before_at) as f32 * 1e-6;
            let mean = by.towards(&motion, 0.5);
            let steps = [
                (wrap_pi(report.attitude.roll_rad - before.roll_rad), mean.roll_rad_s * step_s),
                (report.attitude.pitch_rad - before.pitch_rad, mean.pitch_rad_s * step_s),
            ];
            let kept = MEMORY_S / (MEMORY_S + step_s);
            let sum = |of: fn((f32, f32)) -> f32| steps.map(of).iter().map(|step| step * step).sum::<f32>();
            self.steps = kept * (self.steps + sum(|(step, _)| step));
            self.left = kept * (self.left + sum(|(step, by_rates)| step - by_rates));
        }
        self.last = Some((at, report.attitude, motion));
        // Once they are not believed they have to be better than nothing.
        let most = if self.contradicted { self.steps } else { MOST_LEFT * self.steps + MOST_OF_NOTHING };
        self.contradicted = self.left > most;
        !self.contradicted
    }
}
