//! Progress of a collection: the samples that it has stored.

use crate::calibration::Side;
use crate::calibration::method_selection::Procedure;

/// Coverage of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct PartCoverage {
    /// Number of fit samples.
    pub samples: u16,
    /// Number of held-back samples.
    pub held_back_count: u16,
    /// Sectors with at least one sample, of [`SECTOR_COUNT`](super::SECTOR_COUNT).
    pub covered_sectors: u8,
    /// Completeness of the part, 0..100 percent.
    pub percent: u8,
}

impl PartCoverage {
    /// Whether all required samples are stored.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.percent >= 100
    }
}

/// Progress of a collection, by part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct CollectionProgress {
    /// Collection procedure.
    pub procedure: Procedure,
    /// Progress of the left turns, or of all samples of `Tumble` and `Flight`.
    pub left_turns: PartCoverage,
    /// Progress of the right turns.
    pub right_turns: PartCoverage,
    /// Progress of level flight.
    pub level_progress: PartCoverage,
    /// Number of compass-swing marks.
    pub mark_count: u16,
    /// Side of the turn in progress.
    pub turn_in_progress: Option<Side>,
}

impl CollectionProgress {
    /// Whether all required samples are stored. Always false for `Swing`, `Tumble` and `Flight`, which only the user
    /// can end.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        match self.procedure {
            Procedure::Turns => self.left_turns.is_complete() && self.right_turns.is_complete(),
            Procedure::Level => self.level_progress.is_complete(),
            Procedure::Swing | Procedure::Tumble | Procedure::Flight => false,
        }
    }
}

/// `part` of `whole` in percent, rounded down, at most 100.
pub(super) fn percent(part: u16, whole: u16) -> u8 {
    (u32::from(part) * 100 / u32::from(whole).max(1)).min(100) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn completeness_depends_on_the_procedure() {
        let full = PartCoverage { percent: 100, ..PartCoverage::default() };
        let part = PartCoverage { percent: 99, ..full };
        let is_complete = |procedure, [left, right, level]: [PartCoverage; 3]| {
            CollectionProgress {
                procedure,
                left_turns: left,
                right_turns: right,
                level_progress: level,
                ..CollectionProgress::default()
            }
            .is_complete()
        };
        assert!(is_complete(Procedure::Turns, [full, full, part]));
        assert!(!is_complete(Procedure::Turns, [full, part, full]));
        assert!(!is_complete(Procedure::Turns, [part, full, full]));
        assert!(is_complete(Procedure::Level, [part, part, full]));
        assert!(!is_complete(Procedure::Level, [full, full, part]));
        assert!(!is_complete(Procedure::Swing, [full; 3]));
        assert!(!is_complete(Procedure::Tumble, [full; 3]));
    }

    #[test]
    fn a_part_is_complete_at_100_percent() {
        assert!(PartCoverage { percent: 100, ..PartCoverage::default() }.is_complete());
        assert!(!PartCoverage { percent: 99, ..PartCoverage::default() }.is_complete());
    }

    #[test]
    fn percent_is_rounded_down_and_ends_at_a_hundred() {
        assert_eq!(
            [(0, 3), (1, 3), (2, 3), (3, 3), (4, 3)].map(|(part, whole)| percent(part, whole)),
            [0, 33, 66, 100, 100]
        );
        assert_eq!((percent(u16::MAX, 1), percent(5, 0)), (100, 100));
    }
}
