//! Collection: which samples a calibration is made of.
//!
//! Samples come ten a second from the [`instrument`](crate::instrument). How they are collected is the
//! [`Procedure`]: in flight a detector that looks at bank alone says when the aircraft is in a sustained left or right
//! turn, and level flight between turns is collected as well; level vehicles and compass swings collect samples of
//! little bank, and a module that is tumbled by hand whatever it sees. Whatever is flown is collected by what each sample
//! tells of the coefficients. A dataset of fixed capacity keeps samples evenly
//! spread over heading, a part of them held back for verification ([`dataset`]). A compass swing adds marks: samples at
//! headings that a person knows. What is collected lies in memory that is lent, and outlives a restart with it ([`Kept`]).

mod buffer;
mod circle;
pub mod dataset;
mod detector;
mod flown;
mod kept;
mod part;
mod recent;
mod spread;
#[cfg(test)]
mod testing;

pub use flown::Lack;
pub use kept::Kept;
pub use recent::Recent;

use crate::calibration::ladder::Procedure;
use crate::calibration::{Mark, Method, Sample, Samples, Side, Solution};
use crate::time::WrappingMillis;
use buffer::Buffer;
use dataset::{Coverage, Dataset};
use detector::Detector;
use flown::Flown;
use kept::Header;

/// Marks of a compass swing: one every 10 deg. 1 KB.
pub const MARKS_CAPACITY: usize = 36;

/// Fixed numbers of the collection.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Level is a bank of at most this, radians: the one below which turns end.
    pub level_roll_rad: f32,
    /// Level is a pitch of at most this, radians.
    pub level_pitch_rad: f32,
}

impl Config {
    /// Numbers for all vehicles.
    pub const DEFAULT: Self =
        Self { level_roll_rad: detector::Config::DEFAULT.leave_roll_rad, level_pitch_rad: 12_f32.to_radians() };
}

/// How a collection stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Course {
    /// There is none: it has ended, or none was begun.
    Over,
    /// It is stopped, and its samples wait to be solved.
    Stopped,
    /// It goes on.
    GoesOn,
}

/// What is kept with a collection, for whoever made it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Context {
    /// Whether the module began it.
    pub by_itself: bool,
    /// Number of the calibration that was there then.
    pub serial: u32,
}

/// A loss of fewer samples to fit to, four seconds of flying, is none.
const FEW_SAMPLES: usize = 10;

/// After a restart the clock of a collection goes on so much later, milliseconds: no two of its samples are of one time.
const AWAY_MS: u32 = 1000;

/// Detector, dataset and marks together: the collection of one calibration.
#[derive(Debug)]
pub struct Collector<'a> {
    header: &'a mut Header,
    course: Course,
    /// What was found with the memory, if it is a collection's.
    found: Option<Context>,
    /// Whether the header is of other samples.
    has_changed: bool,
    /// Its clock is so much ahead of that of the samples, milliseconds.
    ahead_ms: u32,
    procedure: Procedure,
    detector: Detector,
    dataset: Dataset<'a>,
    marks: Buffer<'a, Mark>,
    /// Whether a turn has been flown since the collection began.
    turned: bool,
    flown: Flown,
    /// Measurements of whatever was flown that were another than the last.
    news: u32,
}

/// Progress of a collection, by part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Progress {
    /// How samples are collected.
    pub procedure: Procedure,
    /// Left turns; all attitudes when tumbling, and of whatever is flown.
    pub left: Coverage,
    /// Right turns.
    pub right: Coverage,
    /// Level flight.
    pub level: Coverage,
    /// Headings given.
    pub marks: u16,
    /// The turn the aircraft is in now.
    pub turning: Option<Side>,
}

impl Progress {
    /// There are all the samples that can be asked for. Only a person knows when a swing or a tumbling is over.
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
    /// With what was collected in this memory before, or with nothing: [`found`](Self::found) tells.
    #[must_use]
    #[inline(never)]
    pub fn new(kept: &'a mut Kept) -> Self {
        let Kept { header, left, right, level, marks } = kept;
        let [tag, serial, clock_ms, dataset @ .., news, _, _, _, _, _, _] = *header.words();
        let [.., a, b, c, d, e, f] = *header.words();
        let [course, procedure, flags, number_of_marks] = tag.to_le_bytes();
        let [goes_on, stopped] = [Course::GoesOn, Course::Stopped].map(|it| it as u8 == course);
        let mut collector = Self {
            header,
            course: if goes_on { Course::GoesOn } else { Course::Stopped },
            found: None,
            has_changed: false,
            ahead_ms: clock_ms.wrapping_add(AWAY_MS),
            procedure: Procedure::ALL.get(usize::from(procedure)).copied().unwrap_or_default(),
            detector: Detector::new(detector::Config::DEFAULT),
            dataset: Dataset::new(left, right, level, dataset),
            marks: Buffer::new(marks, number_of_marks.into()),
            turned: flags & TURNED != 0,
            flown: Flown::from_words([a, b, c, d, e, f]),
            news,
        };
        let is_whole = collector.header.is_of(collector.dataset.all(), collector.marks.as_slice());
        if is_whole {
            collector.found = Some(Context { by_itself: flags & BY_ITSELF != 0, serial });
        }
        if is_whole && (goes_on || stopped) {
            collector.header.count_restart();
        } else {
            collector.forget();
            collector.keep(Context::default());
        }
        collector
    }

    /// What was found in the memory: of a collection, or of one that has ended. None where it was neither: it held anything.
    #[must_use]
    pub fn found(&self) -> Option<Context> {
        self.found
    }

    /// How it stands.
    #[must_use]
    pub fn course(&self) -> Course {
        self.course
    }

    /// Whether its loss is worth a word.
    #[must_use]
    pub fn is_worth_something(&self) -> bool {
        let [left, _, right, _, level, _] = self.dataset.all().map(<[_]>::len);
        self.course != Course::Over && left + right + level >= FEW_SAMPLES
    }

    /// Has the memory tell what is collected by now: to be called after each change, before anything that may take long.
    pub fn keep(&mut self, context: Context) {
        let Context { by_itself, serial } = context;
        let flags = if by_itself { BY_ITSELF } else { 0 } | if self.turned { TURNED } else { 0 };
        let number_of_marks = self.marks.as_slice().len() as u8;
        let tag = u32::from_le_bytes([self.course as u8, self.procedure as u8, flags, number_of_marks]);
        let [before, serial_before, ..] = *self.header.words();
        let is_over = self.course == Course::Over;
        if !self.has_changed && (is_over || [tag, serial] == [before, serial_before]) {
            return;
        }
        self.has_changed = false;
        if is_over {
            self.forgive_restarts();
            self.header.seal([0; _], [&[]; 6], &[]);
            return;
        }
        let clock_ms = self.flown.last().map_or(self.ahead_ms, WrappingMillis::count);
        let ([l, m, n, o, p, q, r], [a, b, c, d, e, f]) = (self.dataset.words(), self.flown.words());
        let words = [tag, serial, clock_ms, l, m, n, o, p, q, r, self.news, a, b, c, d, e, f];
        self.header.seal(words, self.dataset.all(), self.marks.as_slice());
    }

    /// Restarts so far are no sign that the samples are the cause of them.
    pub fn forgive_restarts(&mut self) {
        self.header.forgive_restarts();
    }

    /// Takes the next averaged sample.
    pub fn push(&mut self, mut sample: Sample) {
        sample.time = sample.time.plus_ms(self.ahead_ms);
        let before = self.dataset.taken();
        self.flown.push(&sample);
        self.collect(sample);
        self.has_changed |= self.dataset.taken() != before;
    }

    fn collect(&mut self, sample: Sample) {
        match self.procedure {
            Procedure::Turns => self.push_flown(sample),
            Procedure::Level | Procedure::Swing if is_level(&sample) => self.dataset.push_level(sample),
            Procedure::Level | Procedure::Swing => {}
            Procedure::Tumble => self.dataset.push_any(sample),
            Procedure::Flight => self.news = self.news.saturating_add(self.dataset.push_spread(sample).into()),
        }
    }

    fn push_flown(&mut self, sample: Sample) {
        if let Some(side) = self.detector.push(&sample) {
            self.turned = true;
            self.dataset.push_turn(side, sample);
        } else if self.turned && is_level(&sample) {
            // Not before the first turn: until then the aircraft may stand beside a hangar.
            self.dataset.push_level(sample);
        }
    }

    /// Takes what a trial solve found: samples of whatever is flown are told apart by it from now on. What is not of all
    /// coefficients tells nothing.
    pub fn learn(&mut self, found: &Solution) {
        if found.quality.method == Method::MaximumLikelihood {
            self.dataset.learn(&found.calibration, &found.quality);
        }
    }

    /// Whether anything was found that tells samples apart.
    #[cfg(test)]
    pub(crate) fn has_learnt(&self) -> bool {
        self.dataset.has_learnt()
    }

    /// Takes a sample at a given heading; whether there was room for it.
    pub fn mark(&mut self, mut mark: Mark) -> bool {
        mark.sample.time = mark.sample.time.plus_ms(self.ahead_ms);
        self.has_changed = true;
        self.marks.push(mark)
    }

    /// Forgets everything collected, to begin again in a procedure.
    pub fn begin(&mut self, procedure: Procedure) {
        self.procedure = procedure;
        self.detector = Detector::new(detector::Config::DEFAULT);
        self.dataset.clear();
        self.marks.clear();
        self.turned = false;
        self.flown = Flown::NOTHING;
        self.news = 0;
        self.ahead_ms = 0;
        self.forgive_restarts();
        self.go_on(Course::GoesOn);
    }

    /// Forgets everything collected.
    pub fn forget(&mut self) {
        self.begin(Procedure::default());
        self.go_on(Course::Over);
    }

    /// It stands like this from now on. Samples stay, also when it is over, until another begins.
    pub fn go_on(&mut self, course: Course) {
        self.course = course;
        self.has_changed = true;
    }

    /// Why samples are missing or show too little, as far as what was flown says it.
    #[must_use]
    pub fn lack(&self) -> Option<Lack> {
        match self.procedure {
            Procedure::Turns => self.flown.lack(&self.progress()),
            Procedure::Flight => self.flown.no_tilt(),
            Procedure::Level | Procedure::Swing | Procedure::Tumble => None,
        }
    }

    /// How many measurements of whatever was flown were another than the last, kept or not.
    #[must_use]
    pub fn news(&self) -> u32 {
        self.news
    }

    /// How many of them were kept, at first or in place of others; wraps.
    pub(crate) fn kept(&self) -> u16 {
        self.dataset.kept()
    }

    /// How samples are collected.
    #[must_use]
    pub fn procedure(&self) -> Procedure {
        self.procedure
    }

    /// How far the collection is.
    #[must_use]
    pub fn progress(&self) -> Progress {
        let [left, right, level] = match self.procedure {
            Procedure::Flight => [self.dataset.spread_coverage(), Coverage::default(), Coverage::default()],
            _ => [self.dataset.turns(Side::Left), self.dataset.turns(Side::Right), self.dataset.level()],
        };
        Progress {
            procedure: self.procedure,
            left,
            right,
            level,
            marks: self.marks.as_slice().len() as u16,
            turning: self.detector.turning(),
        }
    }

    /// Samples to solve with.
    #[must_use]
    pub fn fit(&self) -> Samples<'_> {
        match self.procedure {
            Procedure::Flight => self.dataset.spread(),
            _ => Samples { marks: self.marks.as_slice(), ..self.dataset.fit() },
        }
    }

    /// Samples to verify with; none of them is among those of [`fit`](Self::fit).
    #[must_use]
    pub fn held_back(&self) -> Samples<'_> {
        match self.procedure {
            Procedure::Flight => self.dataset.spread_held_back(),
            _ => self.dataset.held_back(),
        }
    }
}

/// Flags of a collection.
const BY_ITSELF: u8 = 1;
const TURNED: u8 = 2;

fn is_level(sample: &Sample) -> bool {
    let Config { level_roll_rad, level_pitch_rad } = Config::DEFAULT;
    sample.attitude.roll_rad.abs() <= level_roll_rad && sample.attitude.pitch_rad.abs() <= level_pitch_rad
}

#[cfg(test)]
mod tests;
