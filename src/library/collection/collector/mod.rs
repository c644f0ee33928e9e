//! State and procedure of a collection.

use super::d_optimal_selection::{DOptimalSelection, OfferedSampleResult, SampleSpacing};
use super::flight_statistics::{CollectionProblem, TiltFilter};
use super::progress::{CollectionProgress, PartCoverage};
use super::retained_samples::{CollectionContext, CollectionHeader, CollectionState, RetainedSamples};
use super::sample_buffer::SampleUse;
use super::sector_coverage::SectorCoverage;
use super::turn_detector::{TurnDetector, is_level};
use crate::calibration::method_selection::{Procedure, select_samples};
use crate::calibration::{CollectionPart, HeadingMark, Method, Sample, Samples, Solution};
use crate::time::WrappingMillis;

/// Least fit samples (4 s of flight) of a collection whose loss, as by a restart, is reported.
const MIN_REPORTED_LOSS_SAMPLES: usize = 10;

/// Clock advance over a restart, milliseconds: keeps time stamps distinct.
const RESTART_CLOCK_ADVANCE_MS: u32 = 1000;

/// Spacing of the samples of turns and level flight: attitude errors are correlated over about 0.5 s.
const PART_SPACING: SampleSpacing = SampleSpacing::Interval { ms: 400 };

/// Sample collector of one calibration. Its procedure decides which samples are offered to the selection, and what completes them.
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
    /// Information of the fit samples.
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
            turn_detector: TurnDetector::NO_TURN,
            tilt_filter: TiltFilter::NOT_STARTED,
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
        let Some(part) = self.part_of_sample(&sample) else { return };
        sample.part = part;
        let state = &mut self.header.part_states[part.index()];
        let coverage = SectorCoverage::of_part(part);
        let spacing = if coverage.is_some() { PART_SPACING } else { SampleSpacing::Distinct };
        let result = self.selection.push_sample(&mut self.memory.samples, state, sample, spacing);
        if result == OfferedSampleResult::Ignored {
            return;
        }
        self.has_unsaved_change = true;
        if result == OfferedSampleResult::Stored {
            self.header.stored_count = self.header.stored_count.wrapping_add(1);
            if let Some(coverage) = coverage {
                let samples = [self.memory.samples.samples_of_use(SampleUse::Fit), self.memory.samples.all_samples()];
                coverage.update_coverage(samples.map(|samples| Samples::new(samples).samples_of_part(part)), state);
            }
        }
    }

    /// Part to which the next sample belongs; `None` if its procedure does not use it.
    fn part_of_sample(&mut self, sample: &Sample) -> Option<CollectionPart> {
        let level = is_level(sample).then_some(CollectionPart::LEVEL);
        match self.header.procedure() {
            Procedure::Flight | Procedure::Tumble => Some(CollectionPart::FREE),
            Procedure::Level | Procedure::Swing => level,
            Procedure::Turns => {
                let turn = self.turn_detector.process_sample(sample);
                if turn.is_some() {
                    self.header.set_turn_detected();
                }
                // Before the first turn the aircraft may be parked near the iron of a hangar.
                turn.or(level.filter(|_| self.header.has_detected_turn()))
            }
        }
    }

    /// Evaluates the information of samples with a trial solution that determines all coefficients.
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
        self.header = CollectionHeader::new(procedure);
        self.memory.samples.clear();
        self.turn_detector = TurnDetector::NO_TURN;
        self.tilt_filter = TiltFilter::NOT_STARTED;
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

    /// Number of samples taken, stored or not; wraps.
    #[must_use]
    pub fn taken_count(&self) -> u16 {
        self.header.part_states.iter().fold(0, |sum, state| sum.wrapping_add(state.taken_count))
    }

    /// Number of samples stored, including replacements; wraps.
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
            part_coverages: CollectionPart::ALL_PARTS.map(|part| {
                let state = &self.header.part_states[part.index()];
                PartCoverage {
                    fit_count: self.memory.samples.part_count(SampleUse::Fit, part) as u16,
                    held_back_count: self.memory.samples.part_count(SampleUse::Verification, part) as u16,
                    covered_sector_count: state.covered_sector_count,
                    percent: state.percent,
                }
            }),
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

    /// Samples of a solve, and held-back samples of the same parts.
    #[must_use]
    pub fn selected_samples(&self) -> [Samples<'_>; 2] {
        let selected = select_samples(self.fit_samples());
        [selected, self.held_back_samples().with_parts_of(selected)]
    }

    /// Verification samples, not in the fit.
    #[must_use]
    pub fn held_back_samples(&self) -> Samples<'_> {
        Samples::new(self.memory.samples.samples_of_use(SampleUse::Verification))
    }
}

#[cfg(test)]
mod tests;
