//! Turns: which samples of a flight calibration is made of.
//!
//! Readings paired with attitude are averaged to ten a second ([`averager`]), a detector that looks at bank alone says
//! when the aircraft is in a sustained left or right turn ([`detector`]), and a dataset of fixed capacity keeps samples
//! evenly spread over heading for each side, a part of them held back for verification ([`dataset`]).

pub mod averager;
pub mod dataset;
pub mod detector;

use crate::calibration::{Sample, Side};
use dataset::{Coverage, Dataset};
use detector::Detector;

/// Detector and dataset together: the collection of one calibration flight. About 13 KB.
#[derive(Debug)]
pub struct Collector {
    detector: Detector,
    dataset: Dataset,
}

/// Progress of a collection, by side.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Progress {
    /// Left turns.
    pub left: Coverage,
    /// Right turns.
    pub right: Coverage,
    /// The turn the aircraft is in now.
    pub turning: Option<Side>,
}

impl Progress {
    /// Both sides have all the samples they need.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.left.is_complete() && self.right.is_complete()
    }
}

impl Collector {
    /// Nothing collected.
    #[must_use]
    pub const fn new() -> Self {
        Self { detector: Detector::new(detector::Config::DEFAULT), dataset: Dataset::new(dataset::Config::DEFAULT) }
    }

    /// Takes the next averaged sample of the flight.
    pub fn push(&mut self, sample: Sample) {
        if let Some(side) = self.detector.push(&sample) {
            self.dataset.push(side, sample);
        }
    }

    /// Forgets everything collected.
    pub fn clear(&mut self) {
        self.detector = Detector::new(detector::Config::DEFAULT);
        self.dataset.clear();
    }

    /// How far the collection is.
    #[must_use]
    pub fn progress(&self) -> Progress {
        Progress {
            left: self.dataset.coverage(Side::Left),
            right: self.dataset.coverage(Side::Right),
            turning: self.detector.turning(),
        }
    }

    /// The samples.
    #[must_use]
    pub fn dataset(&self) -> &Dataset {
        &self.dataset
    }
}

impl Default for Collector {
    fn default() -> Self {
        Self::new()
    }
}
