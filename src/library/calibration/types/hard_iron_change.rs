//! A hard-iron change during a flight.

use core::fmt;

/// Time course of a hard-iron change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HardIronTimeCourse {
    /// Sudden change.
    Step {
        /// Time of the change after the first sample, seconds.
        after_s: u16,
    },
    /// Linear change from the first sample to the last.
    Drift,
    /// Change in turns, with the load factor: iron in the linkage of the elevator.
    LoadFactor,
    /// Lag of the soft iron behind turns: hysteresis.
    Hysteresis,
}

/// A hard-iron change during a flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectedHardIronChange {
    /// Size of the change, microtesla.
    pub size_ut: f32,
    /// Time course of the change.
    pub time_course: HardIronTimeCourse,
    /// Time from the first sample to the last, seconds.
    pub duration_s: u16,
}

impl fmt::Display for DetectedHardIronChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // The cast saturates and maps NaN to 0.
        let (tenths, of_s) = ((self.size_ut * 10.0 + 0.5) as u32, self.duration_s);
        let (whole, tenth) = (tenths / 10, tenths % 10);
        match self.time_course {
            HardIronTimeCourse::Step { after_s } => {
                write!(f, "iron changed by {whole}.{tenth} uT after {after_s} of {of_s} s")
            }
            HardIronTimeCourse::Drift => write!(f, "iron drifted by {whole}.{tenth} uT in {of_s} s"),
            HardIronTimeCourse::LoadFactor => write!(f, "iron moves by {whole}.{tenth} uT with the elevator in turns"),
            HardIronTimeCourse::Hysteresis => write!(f, "iron of {whole}.{tenth} uT lags behind turns (hysteresis)"),
        }
    }
}
