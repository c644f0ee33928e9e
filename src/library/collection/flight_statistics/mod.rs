//! Statistics of all attitudes, stored or not, to diagnose missing samples.

use core::fmt;

use super::progress::{CollectionProgress, PartCoverage, SECTOR_COUNT};
use super::turn_detector::{ENTER_ROLL_RAD, MAX_GAP_MS};
use crate::calibration::{CollectionPart, Manoeuvre, Sample};
use crate::decimal::Decimal;
use crate::frames::RollPitch;
use crate::time::WrappingMillis;

/// Reason for missing or uninformative samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CollectionProblem {
    /// The sample interval is too long to follow a turn.
    SampleIntervalTooLong {
        /// Mean sample interval, seconds.
        interval_s: f32,
    },
    /// Almost no tilt: the vehicle was not flown, or the attitude has a wrong unit.
    NoTilt {
        /// Largest tilt, degrees.
        max_tilt_deg: f32,
    },
    /// Banks too small or too short.
    InsufficientBank {
        /// Largest tilt, degrees.
        max_tilt_deg: f32,
    },
    /// Turns of this part only, left or right.
    OneSideOnly(CollectionPart),
    /// Turns of a part cover only an arc: the yaw rate was too low.
    ArcOnly {
        /// Part of the arc, left or right turns.
        part: CollectionPart,
        /// Sectors covered, of [`SECTOR_COUNT`].
        sectors: u8,
    },
    /// Manoeuvre that adds the most missing information.
    MissingManoeuvre(Manoeuvre),
}

impl fmt::Display for CollectionProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::SampleIntervalTooLong { interval_s: every_s } => {
                write!(f, "a sample comes every {} s, too slow for turns", Decimal::<1>(every_s))
            }
            Self::NoTilt { max_tilt_deg } => {
                write!(f, "the attitude tilts by {} deg at most", Decimal::<1>(max_tilt_deg))
            }
            Self::InsufficientBank { max_tilt_deg } => {
                write!(f, "too little bank, {} deg at most", Decimal::<1>(max_tilt_deg))
            }
            Self::OneSideOnly(part) => write!(f, "only {} were flown", part.part_name()),
            Self::ArcOnly { part, sectors } => {
                let turns = part.part_name();
                write!(f, "the {turns} went through {sectors} of {SECTOR_COUNT} sectors, too slow or too short")
            }
            Self::MissingManoeuvre(manoeuvre) => write!(f, "missing: {manoeuvre}"),
        }
    }
}

/// Time constant of the tilt average, milliseconds: suppresses gusts.
const TILT_FILTER_TIME_CONSTANT_MS: u32 = 1000;
/// Fewest samples for a diagnosis.
const MIN_SAMPLES: u32 = 20;
/// Shortest duration for a diagnosis, milliseconds.
const MIN_DURATION_MS: u32 = 20_000;
/// Tilt below that of any flight, radians (2 deg). 90 deg sent as radians and read as degrees are 1.6 deg.
const MIN_TILT_RAD: f32 = 2_f32.to_radians();
/// Shortest total bank time of a side that was flown, milliseconds; gusts last 1 to 2 s.
const MIN_BANK_MS: u32 = 5000;
/// Fewest samples for a diagnosis of slow turns: at least 32 s of turning.
const MIN_ARC_SAMPLES: u16 = 60;
/// Number of heading sectors that a turn of 8 deg/s exceeds in `MIN_ARC_SAMPLES` samples.
const MAX_ARC_SECTORS: u8 = 8;

/// Attitude statistics of a collection, as they are in retained memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct FlightStatistics {
    pub sample_count: u32,
    pub long_interval_count: u32,
    pub duration_ms: u32,
    pub max_tilt_rad: f32,
    pub left_bank_ms: u32,
    pub right_bank_ms: u32,
}

/// Low-pass filter of the attitude, time constant 1 s. Starts again after a restart.
#[derive(Clone, Copy, Debug)]
pub(super) struct TiltFilter {
    last_sample_at: Option<WrappingMillis>,
    attitude: RollPitch,
}

impl TiltFilter {
    pub const NOT_STARTED: Self = Self { last_sample_at: None, attitude: RollPitch { roll_rad: 0.0, pitch_rad: 0.0 } };

    pub fn last_sample_at(&self) -> Option<WrappingMillis> {
        self.last_sample_at
    }

    /// Filters the attitude of a sample; returns the milliseconds since the last one.
    fn filter_attitude(&mut self, sample: &Sample) -> Option<u32> {
        let Some(last_time) = self.last_sample_at.replace(sample.time) else {
            self.attitude = sample.attitude;
            return None;
        };
        let step_ms = sample.time.ms_since(last_time);
        let weight = step_ms as f32 / (step_ms as f32 + TILT_FILTER_TIME_CONSTANT_MS as f32);
        self.attitude.roll_rad += weight * (sample.attitude.roll_rad - self.attitude.roll_rad);
        self.attitude.pitch_rad += weight * (sample.attitude.pitch_rad - self.attitude.pitch_rad);
        Some(step_ms)
    }
}

impl FlightStatistics {
    pub const EMPTY: Self = Self {
        sample_count: 0,
        long_interval_count: 0,
        duration_ms: 0,
        max_tilt_rad: 0.0,
        left_bank_ms: 0,
        right_bank_ms: 0,
    };

    pub fn add_sample(&mut self, filter: &mut TiltFilter, sample: &Sample) {
        let RollPitch { roll_rad, pitch_rad } = sample.attitude;
        if !(roll_rad.is_finite() && pitch_rad.is_finite()) {
            return;
        }
        self.sample_count = self.sample_count.saturating_add(1);
        let Some(step_ms) = filter.filter_attitude(sample) else { return };
        self.duration_ms = self.duration_ms.saturating_add(step_ms);
        self.long_interval_count += u32::from(step_ms > MAX_GAP_MS);
        let RollPitch { roll_rad, pitch_rad } = filter.attitude;
        self.max_tilt_rad = self.max_tilt_rad.max(libm::fabsf(roll_rad)).max(libm::fabsf(pitch_rad));
        if libm::fabsf(roll_rad) >= ENTER_ROLL_RAD {
            let side_ms = if roll_rad < 0.0 { &mut self.left_bank_ms } else { &mut self.right_bank_ms };
            *side_ms = side_ms.saturating_add(step_ms);
        }
    }

    fn is_long_enough(&self) -> bool {
        self.sample_count >= MIN_SAMPLES && self.duration_ms >= MIN_DURATION_MS
    }

    pub fn check_tilt(&self) -> Option<CollectionProblem> {
        let has_no_tilt = self.is_long_enough() && self.max_tilt_rad < MIN_TILT_RAD;
        has_no_tilt.then(|| CollectionProblem::NoTilt { max_tilt_deg: self.max_tilt_rad.to_degrees() })
    }

    /// Diagnosis of a collection in turns; `None` if no threshold is violated.
    pub fn diagnose(&self, progress: &CollectionProgress) -> Option<CollectionProblem> {
        if !self.is_long_enough() {
            return None;
        }
        if 2 * u64::from(self.long_interval_count) > u64::from(self.sample_count) {
            return Some(CollectionProblem::SampleIntervalTooLong {
                interval_s: self.duration_ms as f32 / self.sample_count as f32 / 1e3,
            });
        }
        if let Some(problem) = self.check_tilt() {
            return Some(problem);
        }
        let max_tilt_deg = self.max_tilt_rad.to_degrees();
        match (self.left_bank_ms >= MIN_BANK_MS, self.right_bank_ms >= MIN_BANK_MS) {
            (false, false) => return Some(CollectionProblem::InsufficientBank { max_tilt_deg }),
            (true, false) => return Some(CollectionProblem::OneSideOnly(CollectionPart::LEFT)),
            (false, true) => return Some(CollectionProblem::OneSideOnly(CollectionPart::RIGHT)),
            (true, true) => {}
        }
        CollectionPart::TURNS.into_iter().find_map(|part| {
            let &PartCoverage { fit_count, covered_sector_count: sectors, .. } = progress.coverage_of(part);
            let is_arc = fit_count >= MIN_ARC_SAMPLES && sectors <= MAX_ARC_SECTORS;
            is_arc.then_some(CollectionProblem::ArcOnly { part, sectors })
        })
    }
}

#[cfg(test)]
mod tests;
