//! Statistics of all attitudes, stored or not, to diagnose missing samples.

use core::fmt;

use super::progress::{CollectionProgress, PartCoverage};
use super::turn_circle::SECTOR_COUNT;
use super::turn_detector::TurnDetectorConfig;
use crate::calibration::{CollectionPart, Manoeuvre, Sample, Side};
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
    /// Turns to this side only.
    OneSideOnly(Side),
    /// Turns to this side cover only an arc: the yaw rate was too low.
    ArcOnly {
        /// Side of the arc.
        side: Side,
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
            Self::OneSideOnly(side) => write!(f, "only {} turns were flown", side.side_name()),
            Self::ArcOnly { side, sectors } => {
                let side = side.side_name();
                write!(f, "the {side} turns went through {sectors} of {SECTOR_COUNT} sectors, too slow or too short")
            }
            Self::MissingManoeuvre(manoeuvre) => write!(f, "missing: {manoeuvre}"),
        }
    }
}

const DIAGNOSIS_LIMITS: DiagnosisLimits = DiagnosisLimits {
    tilt_filter_time_constant_ms: 1000,
    min_samples: 20,
    min_duration_ms: 20_000,
    min_tilt_rad: 2_f32.to_radians(),
    min_bank_ms: 5000,
    min_arc_samples: 60,
    max_arc_sectors: 8,
};

struct DiagnosisLimits {
    /// Time constant of the tilt average, milliseconds: suppresses gusts.
    tilt_filter_time_constant_ms: u32,
    /// Fewest samples for a diagnosis.
    min_samples: u32,
    /// Shortest duration for a diagnosis, milliseconds.
    min_duration_ms: u32,
    /// Tilt below that of any flight, radians (2 deg). 90 deg sent as radians and read as degrees are 1.6 deg.
    min_tilt_rad: f32,
    /// Shortest total bank time of a side that was flown, milliseconds; gusts last 1 to 2 s.
    min_bank_ms: u32,
    /// Fewest samples for a diagnosis of slow turns: at least 32 s of turning.
    min_arc_samples: u16,
    /// Number of heading sectors that a turn of 8 deg/s exceeds in `min_arc_samples` samples.
    max_arc_sectors: u8,
}

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
        let weight = step_ms as f32 / (step_ms as f32 + DIAGNOSIS_LIMITS.tilt_filter_time_constant_ms as f32);
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
        self.long_interval_count += u32::from(step_ms > TurnDetectorConfig::DEFAULT.max_gap_ms);
        let RollPitch { roll_rad, pitch_rad } = filter.attitude;
        self.max_tilt_rad = self.max_tilt_rad.max(libm::fabsf(roll_rad)).max(libm::fabsf(pitch_rad));
        if libm::fabsf(roll_rad) >= TurnDetectorConfig::DEFAULT.enter_roll_rad {
            let side_ms = if roll_rad < 0.0 { &mut self.left_bank_ms } else { &mut self.right_bank_ms };
            *side_ms = side_ms.saturating_add(step_ms);
        }
    }

    fn is_long_enough(&self) -> bool {
        self.sample_count >= DIAGNOSIS_LIMITS.min_samples && self.duration_ms >= DIAGNOSIS_LIMITS.min_duration_ms
    }

    pub fn check_tilt(&self) -> Option<CollectionProblem> {
        let has_no_tilt = self.is_long_enough() && self.max_tilt_rad < DIAGNOSIS_LIMITS.min_tilt_rad;
        has_no_tilt.then(|| CollectionProblem::NoTilt { max_tilt_deg: self.max_tilt_rad.to_degrees() })
    }

    /// Diagnosis of a collection in turns; `None` if no threshold is violated.
    pub fn diagnose(&self, progress: &CollectionProgress) -> Option<CollectionProblem> {
        let DiagnosisLimits {
            min_bank_ms: held_ms, min_arc_samples: arc_samples, max_arc_sectors: arc_sectors, ..
        } = DIAGNOSIS_LIMITS;
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
        match (self.left_bank_ms >= held_ms, self.right_bank_ms >= held_ms) {
            (false, false) => return Some(CollectionProblem::InsufficientBank { max_tilt_deg }),
            (true, false) => return Some(CollectionProblem::OneSideOnly(Side::Left)),
            (false, true) => return Some(CollectionProblem::OneSideOnly(Side::Right)),
            (true, true) => {}
        }
        [Side::Left, Side::Right].into_iter().find_map(|side| {
            let PartCoverage { fit_count: samples, covered_sector_count: sectors, .. } =
                *progress.coverage_of(CollectionPart::from_turn_side(side));
            (samples >= arc_samples && sectors <= arc_sectors).then_some(CollectionProblem::ArcOnly { side, sectors })
        })
    }
}

#[cfg(test)]
mod tests;
