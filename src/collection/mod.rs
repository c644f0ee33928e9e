//! Selection and storage of the samples for a calibration.
//!
//! The [`Procedure`] decides which samples are stored: turns and level flight, separated by a detector of sustained
//! bank; samples at small tilt, for a compass swing with marks at known headings; all attitudes of a module turned by
//! hand; or free flight, where samples are chosen by their information about the coefficients. The buffers cover all
//! headings, hold every fourth sample back for verification, and survive a reset.

mod buffer;
mod circle;
mod d_optimal_selection;
pub mod dataset;
mod flight_statistics;
mod part;
mod recent_samples;
mod retained_samples;
#[cfg(test)]
mod test_samples;
mod turn_detector;

pub use flight_statistics::CollectionProblem;
pub use recent_samples::RecentSamples;
pub use retained_samples::RetainedSamples;

use crate::calibration::method_selection::Procedure;
use crate::calibration::{Mark, Method, Sample, Samples, Side, Solution};
use crate::time::WrappingMillis;
use buffer::BorrowedBuffer;
use dataset::{Coverage, Dataset};
use flight_statistics::FlightStatistics;
use retained_samples::MemoryHeader;
use turn_detector::TurnDetector;

/// Capacity for compass-swing marks: one every 10 deg. 1 KB.
pub const MARKS_CAPACITY: usize = 36;

/// Limits of level attitude.
#[derive(Clone, Copy, Debug)]
pub struct LevelLimits {
    /// Largest absolute roll of a level sample, radians; equal to the bank at which a turn ends.
    pub level_roll_rad: f32,
    /// Largest absolute pitch of a level sample, radians.
    pub level_pitch_rad: f32,
}

impl LevelLimits {
    /// Limits for all vehicles.
    pub const DEFAULT: Self = Self {
        level_roll_rad: turn_detector::TurnDetectorConfig::DEFAULT.leave_roll_rad,
        level_pitch_rad: 12_f32.to_radians(),
    };
}

/// State of a collection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CollectionState {
    /// None active: finished, or never started.
    Inactive,
    /// Stopped; the samples wait for the solver.
    Stopped,
    /// Running.
    Running,
}

/// Caller's data stored together with a collection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CollectionContext {
    /// Whether the module started the collection automatically.
    pub is_automatic: bool,
    /// Serial number of the active calibration at that time.
    pub calibration_serial: u32,
}

/// Fit samples (4 s of flight) below which a loss is not reported.
const MIN_REPORTED_LOSS_SAMPLES: usize = 10;

/// Clock advance over a restart, milliseconds: keeps time stamps distinct.
const RESTART_GAP_MS: u32 = 1000;

/// Sample collector of one calibration: turn detector, dataset and marks.
#[derive(Debug)]
pub struct Collector<'a> {
    header: &'a mut MemoryHeader,
    state: CollectionState,
    restored_context: Option<CollectionContext>,
    /// Whether data changed since the header's checksum.
    has_changed: bool,
    /// Offset from sample times to the collection's clock, milliseconds.
    clock_offset_ms: u32,
    procedure: Procedure,
    detector: TurnDetector,
    dataset: Dataset<'a>,
    marks: BorrowedBuffer<'a, Mark>,
    has_turned: bool,
    statistics: FlightStatistics,
    distinct_samples: u32,
}

/// Progress of a collection, by part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct CollectionProgress {
    /// Collection procedure.
    pub procedure: Procedure,
    /// Left turns; all samples of `Tumble` and `Flight`.
    pub left: Coverage,
    /// Right turns.
    pub right: Coverage,
    /// Level flight.
    pub level: Coverage,
    /// Number of compass-swing marks.
    pub marks: u16,
    /// Side of the turn in progress.
    pub turn_in_progress: Option<Side>,
}

impl CollectionProgress {
    /// Whether all required samples are stored. Always false for `Swing`, `Tumble` and `Flight`, which only the user
    /// can end.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        match self.procedure {
            Procedure::Turns => self.left.is_complete() && self.right.is_complete(),
            Procedure::Level => self.level.is_complete(),
            Procedure::Swing | Procedure::Tumble | Procedure::Flight => false,
        }
    }
}

impl<'a> Collector<'a> {
    /// Creates a collector, and resumes the collection in a valid memory.
    #[must_use]
    #[inline(never)]
    pub fn new(memory: &'a mut RetainedSamples) -> Self {
        let RetainedSamples { header, left, right, level, marks } = memory;
        let [tag, serial, clock_ms, dataset @ .., distinct_count, _, _, _, _, _, _] = *header.words();
        let [.., a, b, c, d, e, f] = *header.words();
        let [course, procedure, flags, number_of_marks] = tag.to_le_bytes();
        let [is_running, stopped] = [CollectionState::Running, CollectionState::Stopped].map(|it| it as u8 == course);
        let mut collector = Self {
            header,
            state: if is_running { CollectionState::Running } else { CollectionState::Stopped },
            restored_context: None,
            has_changed: false,
            clock_offset_ms: clock_ms.wrapping_add(RESTART_GAP_MS),
            procedure: Procedure::ALL.get(usize::from(procedure)).copied().unwrap_or_default(),
            detector: TurnDetector::new(turn_detector::TurnDetectorConfig::DEFAULT),
            dataset: Dataset::new(left, right, level, dataset),
            marks: BorrowedBuffer::new(marks, number_of_marks.into()),
            has_turned: flags & FLAG_TURNED != 0,
            statistics: FlightStatistics::decode([a, b, c, d, e, f]),
            distinct_samples: distinct_count,
        };
        let is_whole = collector.header.matches(collector.dataset.all_buffers(), collector.marks.as_slice());
        if is_whole {
            collector.restored_context =
                Some(CollectionContext { is_automatic: flags & FLAG_AUTOMATIC != 0, calibration_serial: serial });
        }
        if is_whole && (is_running || stopped) {
            collector.header.count_unexpected_restart();
        } else {
            collector.discard();
            collector.save(CollectionContext::default());
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
    pub fn state(&self) -> CollectionState {
        self.state
    }

    /// Whether losing this collection is worth reporting.
    #[must_use]
    pub fn is_loss_reportable(&self) -> bool {
        let [left, _, right, _, level, _] = self.dataset.all_buffers().map(<[_]>::len);
        self.state != CollectionState::Inactive && left + right + level >= MIN_REPORTED_LOSS_SAMPLES
    }

    /// Updates the header and its checksum after changes. Call it before long operations.
    pub fn save(&mut self, context: CollectionContext) {
        let CollectionContext { is_automatic: automatic, calibration_serial: serial } = context;
        let flags = if automatic { FLAG_AUTOMATIC } else { 0 } | if self.has_turned { FLAG_TURNED } else { 0 };
        let number_of_marks = self.marks.as_slice().len() as u8;
        let tag = u32::from_le_bytes([self.state as u8, self.procedure as u8, flags, number_of_marks]);
        let [before, serial_before, ..] = *self.header.words();
        let is_over = self.state == CollectionState::Inactive;
        if !self.has_changed && (is_over || [tag, serial] == [before, serial_before]) {
            return;
        }
        self.has_changed = false;
        if is_over {
            self.reset_restart_count();
            self.header.seal([0; _], [&[]; 6], &[]);
            return;
        }
        let clock_ms = self.statistics.last_sample_at().map_or(self.clock_offset_ms, WrappingMillis::as_ms);
        let ([l, m, n, o, p, q, r], [a, b, c, d, e, f]) = (self.dataset.encode(), self.statistics.encode());
        let words = [tag, serial, clock_ms, l, m, n, o, p, q, r, self.distinct_samples, a, b, c, d, e, f];
        self.header.seal(words, self.dataset.all_buffers(), self.marks.as_slice());
    }

    /// Resets the count of unexpected restarts.
    pub fn reset_restart_count(&mut self) {
        self.header.reset_restart_count();
    }

    /// Adds the next averaged sample.
    pub fn push(&mut self, mut sample: Sample) {
        sample.time = sample.time.plus_ms(self.clock_offset_ms);
        let before = self.dataset.taken_count();
        self.statistics.update(&sample);
        self.store_by_procedure(sample);
        self.has_changed |= self.dataset.taken_count() != before;
    }

    fn store_by_procedure(&mut self, sample: Sample) {
        match self.procedure {
            Procedure::Turns => self.push_turn_or_level(sample),
            Procedure::Level | Procedure::Swing if is_level(&sample) => self.dataset.push_level(sample),
            Procedure::Level | Procedure::Swing => {}
            Procedure::Tumble => self.dataset.push_tumbled(sample),
            Procedure::Flight => {
                self.distinct_samples =
                    self.distinct_samples.saturating_add(self.dataset.push_free_flight(sample).into());
            }
        }
    }

    fn push_turn_or_level(&mut self, sample: Sample) {
        if let Some(side) = self.detector.update(&sample) {
            self.has_turned = true;
            self.dataset.push_turn(side, sample);
        } else if self.has_turned && is_level(&sample) {
            // Before the first turn the aircraft may be parked near the iron of a hangar.
            self.dataset.push_level(sample);
        }
    }

    /// Rates free-flight samples with the result of a trial solve that estimates all coefficients.
    pub fn use_trial_solution(&mut self, found: &Solution) {
        if found.quality.method == Method::MaximumLikelihood {
            self.dataset.use_trial_solution(&found.calibration, &found.quality);
        }
    }

    /// Whether the selection uses the coefficients of a trial solve.
    #[must_use]
    pub fn uses_trial_solution(&self) -> bool {
        self.dataset.uses_trial_solution()
    }

    /// Stores a sample at a known heading; returns false if the buffer is full.
    pub fn add_mark(&mut self, mut mark: Mark) -> bool {
        mark.sample.time = mark.sample.time.plus_ms(self.clock_offset_ms);
        self.has_changed = true;
        self.marks.push(mark)
    }

    /// Discards all samples and starts a procedure.
    pub fn begin(&mut self, procedure: Procedure) {
        self.procedure = procedure;
        self.detector = TurnDetector::new(turn_detector::TurnDetectorConfig::DEFAULT);
        self.dataset.clear();
        self.marks.clear();
        self.has_turned = false;
        self.statistics = FlightStatistics::EMPTY;
        self.distinct_samples = 0;
        self.clock_offset_ms = 0;
        self.reset_restart_count();
        self.set_state(CollectionState::Running);
    }

    /// Discards all samples and ends the collection.
    pub fn discard(&mut self) {
        self.begin(Procedure::default());
        self.set_state(CollectionState::Inactive);
    }

    /// Sets the state. Samples stay stored until the next collection begins.
    pub fn set_state(&mut self, course: CollectionState) {
        self.state = course;
        self.has_changed = true;
    }

    /// Most likely reason for missing or uninformative samples, if known.
    #[must_use]
    pub fn problem(&self) -> Option<CollectionProblem> {
        match self.procedure {
            Procedure::Turns => self.statistics.diagnose(&self.progress()),
            Procedure::Flight => self.statistics.check_tilt(),
            Procedure::Level | Procedure::Swing | Procedure::Tumble => None,
        }
    }

    /// Number of distinct free-flight samples, stored or not.
    #[must_use]
    pub fn distinct_samples(&self) -> u32 {
        self.distinct_samples
    }

    /// Number of free-flight samples stored, including replacements; wraps.
    #[must_use]
    /// Number of free-flight samples stored, including replacements; wraps.
    pub fn stored_count(&self) -> u16 {
        self.dataset.stored_free_flight()
    }

    /// Collection procedure.
    #[must_use]
    pub fn procedure(&self) -> Procedure {
        self.procedure
    }

    /// Progress by part.
    #[must_use]
    pub fn progress(&self) -> CollectionProgress {
        let [left, right, level] = match self.procedure {
            Procedure::Flight => [self.dataset.free_flight_coverage(), Coverage::default(), Coverage::default()],
            _ => [
                self.dataset.turn_coverage(Side::Left),
                self.dataset.turn_coverage(Side::Right),
                self.dataset.level_coverage(),
            ],
        };
        CollectionProgress {
            procedure: self.procedure,
            left,
            right,
            level,
            marks: self.marks.as_slice().len() as u16,
            turn_in_progress: self.detector.turn_side(),
        }
    }

    /// Fit samples.
    #[must_use]
    pub fn fit(&self) -> Samples<'_> {
        match self.procedure {
            Procedure::Flight => self.dataset.free_flight_fit(),
            _ => Samples { marks: self.marks.as_slice(), ..self.dataset.fit() },
        }
    }

    /// Verification samples, not in the fit.
    #[must_use]
    pub fn held_back(&self) -> Samples<'_> {
        match self.procedure {
            Procedure::Flight => self.dataset.free_flight_held_back(),
            _ => self.dataset.held_back(),
        }
    }
}

/// Bits of the stored flag byte.
const FLAG_AUTOMATIC: u8 = 1;
const FLAG_TURNED: u8 = 2;

fn is_level(sample: &Sample) -> bool {
    let LevelLimits { level_roll_rad, level_pitch_rad } = LevelLimits::DEFAULT;
    sample.attitude.roll_rad.abs() <= level_roll_rad && sample.attitude.pitch_rad.abs() <= level_pitch_rad
}

#[cfg(test)]
mod tests;
