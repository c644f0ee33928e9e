//! State of a collection in retained memory, without its samples.

use super::memory_words::{MemoryWords, words};
use crate::calibration::CollectionPart;
use crate::calibration::method_selection::Procedure;
use crate::collection::flight_statistics::FlightStatistics;
use crate::collection::sample_buffer::SampleUse;

/// Period of held-back samples: one in this number is held back.
pub(in crate::collection) const HOLD_BACK_CYCLE: u16 = 4;

/// State of a collection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CollectionState {
    /// No collection is active: finished, or never started.
    Inactive,
    /// The collection is stopped; the samples wait for the solver.
    Stopped,
    /// The collection is running.
    Running,
}

/// Caller's data stored together with a collection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CollectionContext {
    /// Whether the module started the collection automatically.
    pub is_automatic: bool,
    /// Serial number of the active calibration when the collection was last saved.
    pub calibration_serial: u32,
}

/// Header of a collection. Every bit pattern is a valid value: states and flags are numbers.
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
    /// Number of samples stored, including replacements; wraps.
    pub stored_count: u16,
    /// States of the parts by [`CollectionPart::index`].
    pub part_states: [PartState; CollectionPart::ALL_PARTS.len()],
    pub flight_statistics: FlightStatistics,
}

/// State of a part.
#[derive(Clone, Copy, Debug)]
pub(in crate::collection) struct PartState {
    /// Number of samples taken, stored or not; wraps at a multiple of the hold-back cycle.
    pub taken_count: u16,
    /// Number of sectors with at least one sample.
    pub covered_sector_count: u8,
    /// Completeness, 0..100 percent.
    pub percent: u8,
}

impl PartState {
    pub const EMPTY: Self = Self { taken_count: 0, covered_sector_count: 0, percent: 0 };

    pub fn count_and_assign_use(&mut self) -> SampleUse {
        self.taken_count = self.taken_count.wrapping_add(1);
        if self.taken_count.is_multiple_of(HOLD_BACK_CYCLE) { SampleUse::Verification } else { SampleUse::Fit }
    }
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
        part_states: [PartState::EMPTY; _],
        flight_statistics: FlightStatistics::EMPTY,
    };

    /// Start of a collection.
    pub fn new(procedure: Procedure) -> Self {
        Self { procedure: procedure as u8, ..Self::EMPTY }
    }

    pub fn procedure(&self) -> Procedure {
        Procedure::ALL_PROCEDURES.get(usize::from(self.procedure)).copied().unwrap_or_default()
    }

    pub const fn state(&self) -> CollectionState {
        const STOPPED: u8 = CollectionState::Stopped as u8;
        const RUNNING: u8 = CollectionState::Running as u8;
        match self.state {
            STOPPED => CollectionState::Stopped,
            RUNNING => CollectionState::Running,
            _ => CollectionState::Inactive,
        }
    }

    pub const fn set_state(&mut self, state: CollectionState) {
        self.state = state as u8;
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
    part_states,
    flight_statistics,
});
words!(PartState { taken_count, covered_sector_count, percent });
words!(FlightStatistics { sample_count, long_interval_count, duration_ms, max_tilt_rad, left_bank_ms, right_bank_ms });
