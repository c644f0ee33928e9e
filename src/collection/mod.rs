//! Collection: which samples a calibration is made of.
//!
//! Samples come ten a second from the [`instrument`](crate::instrument). How they are collected is the
//! [`Procedure`]: in flight a detector that looks at bank alone says when the aircraft is in a sustained left or right
//! turn, and level flight between turns is collected as well; level vehicles and compass swings collect samples of
//! little bank, and a module that is tumbled by hand whatever it sees. Whatever is flown is collected by what each sample
//! tells of the coefficients. A dataset of fixed capacity keeps samples evenly
//! spread over heading, a part of them held back for verification ([`dataset`]). A compass swing adds marks: samples at
//! headings that a person knows.

mod circle;
pub mod dataset;
mod detector;
mod flown;
mod part;
mod recent;
mod spread;
#[cfg(test)]
mod testing;

pub use flown::Lack;
pub use recent::Recent;

use crate::calibration::ladder::Procedure;
use crate::calibration::{Mark, Method, Sample, Samples, Side, Solution};
use dataset::{Coverage, Dataset};
use detector::Detector;
use flown::Flown;

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

/// Detector, dataset and marks together: the collection of one calibration. About 15 KB.
#[derive(Debug)]
pub struct Collector {
    procedure: Procedure,
    detector: Detector,
    dataset: Dataset,
    marks: heapless::Vec<Mark, MARKS_CAPACITY>,
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

impl Collector {
    /// Nothing collected.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            procedure: Procedure::Flight,
            detector: Detector::new(detector::Config::DEFAULT),
            dataset: Dataset::new(),
            marks: heapless::Vec::new(),
            turned: false,
            flown: Flown::NOTHING,
            news: 0,
        }
    }

    /// Takes the next averaged sample.
    pub fn push(&mut self, sample: Sample) {
        self.flown.push(&sample);
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
    pub fn mark(&mut self, mark: Mark) -> bool {
        self.marks.push(mark).is_ok()
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

    /// How samples are collected.
    #[must_use]
    pub fn procedure(&self) -> Procedure {
        self.procedure
    }

    /// How far the collection is.
    #[must_use]
    pub fn progress(&self) -> Progress {
        Progress {
            procedure: self.procedure,
            left: match self.procedure {
                Procedure::Flight => self.dataset.spread_coverage(),
                _ => self.dataset.turns(Side::Left),
            },
            right: self.dataset.turns(Side::Right),
            level: self.dataset.level(),
            marks: self.marks.len() as u16,
            turning: self.detector.turning(),
        }
    }

    /// Samples to solve with.
    #[must_use]
    pub fn fit(&self) -> Samples<'_> {
        match self.procedure {
            Procedure::Flight => self.dataset.spread(),
            _ => Samples { marks: &self.marks, ..self.dataset.fit() },
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

impl Default for Collector {
    fn default() -> Self {
        Self::new()
    }
}

fn is_level(sample: &Sample) -> bool {
    let Config { level_roll_rad, level_pitch_rad } = Config::DEFAULT;
    sample.attitude.roll_rad.abs() <= level_roll_rad && sample.attitude.pitch_rad.abs() <= level_pitch_rad
}

#[cfg(test)]
mod tests;
