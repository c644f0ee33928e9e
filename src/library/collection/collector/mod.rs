//! State and procedure of a collection.

use super::d_optimal_selection::DOptimalSelection;
use super::flight_statistics::{CollectionProblem, TiltFilter};
use super::free_flight::{self, OfferedSampleResult};
use super::level_limits::is_level;
use super::min_distance;
use super::part_view::{PART_COUNT, PartView, coverage};
use super::progress::CollectionProgress;
use super::quota::{SampleQuota, SampleUse};
use super::retained_samples::{CollectionHeader, RetainedSamples};
use super::sector_balance::SectorBalance;
use super::state::{CollectionContext, CollectionState};
use super::turn_detector::{TurnDetector, TurnDetectorConfig};
use crate::calibration::method_selection::Procedure;
use crate::calibration::{CollectionPart, HeadingMark, Method, Sample, Samples, Solution};
use crate::time::WrappingMillis;

/// Least fit samples (4 s of flight) of a collection whose loss, as by a restart, is reported.
const MIN_REPORTED_LOSS_SAMPLES: usize = 10;

/// Clock advance over a restart, milliseconds: keeps time stamps distinct.
const RESTART_CLOCK_ADVANCE_MS: u32 = 1000;

/// Sample collector of one calibration. Its procedure selects a policy, which stores samples in the one buffer.
#[derive(Debug)]
pub struct Collector<'a> {
    memory: &'a mut RetainedSamples,
    /// State of the collection; stored in the memory by [`Collector::update_header`].
    header: CollectionHeader,
    restored_context: Option<CollectionContext>,
    /// Whether data changed since the header's checksum.
    has_unsaved_change: bool,
    /// Offset from sample times to the collection's clock, milliseconds.
    collection_clock_offset_ms: u32,
    turn_detector: TurnDetector,
    tilt_filter: TiltFilter,
    /// Time of the last sample of each part, stored or not, by [`CollectionPart::index`].
    last_due_sample_at: [Option<WrappingMillis>; PART_COUNT],
    /// Information of the free-flight fit samples.
    selection: DOptimalSelection,
}

impl<'a> Collector<'a> {
    /// Creates a collector, and resumes the collection in a valid memory.
    #[must_use]
    #[inline(never)]
    pub fn new(memory: &'a mut RetainedSamples) -> Self {
        let (header, is_valid) = (*memory.header(), memory.is_valid());
        let mut collector = Self {
            memory,
            header,
            restored_context: is_valid.then(|| header.collection_context()),
            has_unsaved_change: false,
            collection_clock_offset_ms: header.clock_ms.wrapping_add(RESTART_CLOCK_ADVANCE_MS),
            turn_detector: TurnDetector::new(TurnDetectorConfig::DEFAULT),
            tilt_filter: TiltFilter::NOT_STARTED,
            last_due_sample_at: [None; _],
            selection: DOptimalSelection::NO_SELECTION,
        };
        if is_valid && header.state() != CollectionState::Inactive {
            collector.memory.count_unexpected_restart();
        } else {
            collector.discard_collection();
            collector.update_header(CollectionContext::default());
        }
        collector
    }

    /// Context of the resumed collection; `None` if the memory was invalid.
    #[must_use]
    pub fn restored_context(&self) -> Option<CollectionContext> {
        self.restored_context
    }

    /// State of the collection.
    #[must_use]
    pub fn collection_state(&self) -> CollectionState {
        self.header.state()
    }

    /// Whether losing this collection is worth reporting.
    #[must_use]
    pub fn is_loss_reportable(&self) -> bool {
        let fit_count = self.memory.samples.samples_of_use(SampleUse::Fit).len();
        self.collection_state() != CollectionState::Inactive && fit_count >= MIN_REPORTED_LOSS_SAMPLES
    }

    /// Updates the header and its checksum after changes. Call it before long operations.
    pub fn update_header(&mut self, context: CollectionContext) {
        let is_over = self.collection_state() == CollectionState::Inactive;
        if !self.has_unsaved_change && (is_over || context == self.memory.header().collection_context()) {
            return;
        }
        self.has_unsaved_change = false;
        if is_over {
            self.reset_restart_count();
            return self.memory.write_header_and_checksum(CollectionHeader::EMPTY);
        }
        self.header.set_context(context);
        self.header.clock_ms =
            self.tilt_filter.last_sample_at().map_or(self.collection_clock_offset_ms, WrappingMillis::as_ms);
        self.memory.write_header_and_checksum(self.header);
    }

    /// Resets the count of unexpected restarts.
    pub fn reset_restart_count(&mut self) {
        self.memory.reset_restart_count();
    }

    /// Adds the next averaged sample.
    pub fn push_sample(&mut self, mut sample: Sample) {
        sample.time = sample.time.plus_ms(self.collection_clock_offset_ms);
        self.header.flight_statistics.add_sample(&mut self.tilt_filter, &sample);
        self.has_unsaved_change |= match self.header.procedure() {
            Procedure::Turns => self.push_turn_or_level_sample(sample),
            Procedure::Level | Procedure::Swing => {
                is_level(&sample) && SectorBalance::LEVEL.push_sample(self.part_view(CollectionPart::LEVEL), sample)
            }
            Procedure::Tumble => self.push_tumble_sample(sample),
            Procedure::Flight => self.push_free_flight_sample(sample),
        };
    }

    fn push_turn_or_level_sample(&mut self, sample: Sample) -> bool {
        if let Some(side) = self.turn_detector.process_sample(&sample) {
            self.header.set_turn_detected();
            SectorBalance::TURNS.push_sample(self.part_view(CollectionPart::from_turn_side(side)), sample)
        } else {
            // Before the first turn the aircraft may be parked near the iron of a hangar.
            self.header.has_detected_turn()
                && is_level(&sample)
                && SectorBalance::LEVEL.push_sample(self.part_view(CollectionPart::LEVEL), sample)
        }
    }

    fn push_tumble_sample(&mut self, sample: Sample) -> bool {
        let CollectionHeader { part_states, min_distance_ut, .. } = &mut self.header;
        let part =
            PartView::new(CollectionPart::FREE, &mut self.memory.samples, part_states, &mut self.last_due_sample_at);
        min_distance::push_sample(part, SampleQuota::TURN, min_distance_ut, sample)
    }

    fn push_free_flight_sample(&mut self, sample: Sample) -> bool {
        let part_states = &mut self.header.part_states;
        let part =
            PartView::new(CollectionPart::FREE, &mut self.memory.samples, part_states, &mut self.last_due_sample_at);
        let end = free_flight::push_sample(part, &mut self.selection, sample);
        if end == OfferedSampleResult::Ignored {
            return false;
        }
        self.header.distinct_sample_count = self.header.distinct_sample_count.saturating_add(1);
        self.header.stored_count = self.header.stored_count.wrapping_add((end == OfferedSampleResult::Stored).into());
        true
    }

    fn part_view(&mut self, part: CollectionPart) -> PartView<'_> {
        PartView::new(part, &mut self.memory.samples, &mut self.header.part_states, &mut self.last_due_sample_at)
    }

    /// Evaluates the information of free-flight samples with a trial solution that determines all coefficients.
    pub fn use_trial_solution(&mut self, solution: &Solution) {
        if solution.quality.method == Method::MaximumLikelihood {
            self.selection.use_trial_solution(&solution.calibration, &solution.quality);
        }
    }

    /// Whether the selection uses the coefficients of a trial solve.
    #[must_use]
    pub fn uses_trial_solution(&self) -> bool {
        self.selection.uses_trial_solution()
    }

    /// Stores a sample at a known heading; returns false if there is no room.
    pub fn add_mark(&mut self, mut mark: HeadingMark) -> bool {
        mark.sample.time = mark.sample.time.plus_ms(self.collection_clock_offset_ms);
        self.has_unsaved_change = true;
        let free_mark = self.memory.marks.get_mut(usize::from(self.header.mark_count));
        let has_room = free_mark.is_some();
        if let Some(free_mark) = free_mark {
            *free_mark = mark;
            self.header.mark_count += 1;
        }
        has_room
    }

    /// Discards all samples and starts a procedure.
    pub fn begin_procedure(&mut self, procedure: Procedure) {
        self.header = CollectionHeader::new(procedure, min_distance::INITIAL_MIN_DISTANCE_UT);
        self.memory.samples.clear();
        self.turn_detector = TurnDetector::new(TurnDetectorConfig::DEFAULT);
        self.tilt_filter = TiltFilter::NOT_STARTED;
        self.last_due_sample_at = [None; _];
        self.selection.reset_selection();
        self.collection_clock_offset_ms = 0;
        self.reset_restart_count();
        self.set_state(CollectionState::Running);
    }

    /// Discards all samples and ends the collection.
    pub fn discard_collection(&mut self) {
        self.begin_procedure(Procedure::default());
        self.set_state(CollectionState::Inactive);
    }

    /// Sets the state. Samples stay stored until the next collection begins.
    pub fn set_state(&mut self, state: CollectionState) {
        self.header.set_state(state);
        self.has_unsaved_change = true;
    }

    /// Most likely reason for missing or uninformative samples, if known.
    #[must_use]
    pub fn collection_problem(&self) -> Option<CollectionProblem> {
        match self.procedure() {
            Procedure::Turns => self.header.flight_statistics.diagnose(&self.collection_progress()),
            Procedure::Flight => self.header.flight_statistics.check_tilt(),
            Procedure::Level | Procedure::Swing | Procedure::Tumble => None,
        }
    }

    /// Number of distinct free-flight samples, stored or not.
    #[must_use]
    pub fn distinct_sample_count(&self) -> u32 {
        self.header.distinct_sample_count
    }

    /// Number of free-flight samples stored, including replacements; wraps.
    #[must_use]
    pub fn stored_count(&self) -> u16 {
        self.header.stored_count
    }

    /// Collection procedure.
    #[must_use]
    pub fn procedure(&self) -> Procedure {
        self.header.procedure()
    }

    /// Progress by part.
    #[must_use]
    pub fn collection_progress(&self) -> CollectionProgress {
        CollectionProgress {
            procedure: self.procedure(),
            part_coverages: CollectionPart::ALL_PARTS
                .map(|part| coverage(&self.memory.samples, part, self.header.part_states[part.index()])),
            mark_count: self.header.mark_count,
            turn_in_progress: self.turn_detector.turn_side(),
        }
    }

    /// Samples used by the fit.
    #[must_use]
    pub fn fit_samples(&self) -> Samples<'_> {
        Samples::new(self.memory.samples.samples_of_use(SampleUse::Fit))
            .with_marks(self.memory.stored_marks(self.header.mark_count))
    }

    /// Verification samples, not in the fit.
    #[must_use]
    pub fn held_back_samples(&self) -> Samples<'_> {
        Samples::new(self.memory.samples.samples_of_use(SampleUse::Verification))
    }
}

#[cfg(test)]
mod tests;
