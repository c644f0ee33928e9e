//! State of a collection in retained memory, without its samples.

use super::memory_words::{MemoryWords, words};
use crate::calibration::CollectionPart;
use crate::calibration::method_selection::Procedure;
use crate::collection::flight_statistics::FlightStatistics;
use crate::collection::state::{CollectionContext, CollectionState};

/// State of a collection. Every bit pattern is a valid value: states and flags are numbers.
#[derive(Clone, Copy, Debug)]
pub(in crate::collection) struct CollectionHeader {
    state: u8,
    procedure: u8,
    is_automatic: u8,
    has_detected_turn: u8,
    calibration_serial: u32,
    /// Time of the collection's clock, milliseconds.
    pub clock_ms: u32,
    /// Number of marks.
    pub mark_count: u16,
    /// Number of free-flight samples stored, including replacements; wraps.
    pub stored_count: u16,
    /// Number of distinct free-flight samples, stored or not.
    pub distinct_sample_count: u32,
    /// Minimum distance between samples of a tumble, microtesla; grows when the buffer is full.
    pub min_distance_ut: f32,
    /// States of the parts by [`CollectionPart::index`].
    pub part_states: [PartState; CollectionPart::ALL_PARTS.len()],
    pub flight_statistics: FlightStatistics,
}

/// State of a part that its retention policy stores.
#[derive(Clone, Copy, Debug)]
pub(in crate::collection) struct PartState {
    /// Number of samples taken, stored or not; wraps at a multiple of the hold-back cycle.
    pub due_sample_count: u16,
    /// Number of sectors with at least one sample.
    pub covered_sector_count: u8,
    /// Completeness, 0..100 percent.
    pub percent: u8,
}

impl PartState {
    pub const EMPTY: Self = Self { due_sample_count: 0, covered_sector_count: 0, percent: 0 };
}

impl CollectionHeader {
    /// Header without a collection.
    pub const EMPTY: Self = Self {
        state: 0,
        procedure: 0,
        is_automatic: 0,
        has_detected_turn: 0,
        calibration_serial: 0,
        clock_ms: 0,
        mark_count: 0,
        stored_count: 0,
        distinct_sample_count: 0,
        min_distance_ut: 0.0,
        part_states: [PartState::EMPTY; _],
        flight_statistics: FlightStatistics::EMPTY,
    };

    /// Start of a collection.
    pub fn new(procedure: Procedure, min_distance_ut: f32) -> Self {
        Self { procedure: procedure as u8, min_distance_ut, ..Self::EMPTY }
    }

    pub fn procedure(&self) -> Procedure {
        Procedure::ALL_PROCEDURES.get(usize::from(self.procedure)).copied().unwrap_or_default()
    }

    pub const fn state(&self) -> CollectionState {
        match self.state {
            1 => CollectionState::Stopped,
            2 => CollectionState::Running,
            _ => CollectionState::Inactive,
        }
    }

    pub const fn set_state(&mut self, state: CollectionState) {
        self.state = match state {
            CollectionState::Inactive => 0,
            CollectionState::Stopped => 1,
            CollectionState::Running => 2,
        };
    }

    pub const fn collection_context(&self) -> CollectionContext {
        CollectionContext { is_automatic: self.is_automatic != 0, calibration_serial: self.calibration_serial }
    }

    pub fn set_context(&mut self, context: CollectionContext) {
        let CollectionContext { is_automatic, calibration_serial } = context;
        (self.is_automatic, self.calibration_serial) = (is_automatic.into(), calibration_serial);
    }

    /// Whether a turn was detected.
    pub const fn has_detected_turn(&self) -> bool {
        self.has_detected_turn != 0
    }

    pub const fn set_turn_detected(&mut self) {
        self.has_detected_turn = 1;
    }
}

words!(CollectionHeader {
    state,
    procedure,
    is_automatic,
    has_detected_turn,
    calibration_serial,
    clock_ms,
    mark_count,
    stored_count,
    distinct_sample_count,
    min_distance_ut,
    part_states,
    flight_statistics,
});
words!(PartState { due_sample_count, covered_sector_count, percent });
words!(FlightStatistics { sample_count, long_interval_count, duration_ms, max_tilt_rad, left_bank_ms, right_bank_ms });
