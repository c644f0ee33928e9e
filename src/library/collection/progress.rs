//! Progress of a collection: the samples that it has stored.

use crate::calibration::CollectionPart;
use crate::calibration::method_selection::Procedure;

/// Number of heading sectors, 30 deg each.
pub const SECTOR_COUNT: usize = 12;

/// Coverage of a part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct PartCoverage {
    /// Number of fit samples.
    pub fit_count: u16,
    /// Number of held-back samples.
    pub held_back_count: u16,
    /// Sectors with at least one sample, of [`SECTOR_COUNT`].
    pub covered_sector_count: u8,
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
    /// Coverage of each part, in the order of [`CollectionPart::ALL_PARTS`].
    pub(super) part_coverages: [PartCoverage; CollectionPart::ALL_PARTS.len()],
    /// Number of compass-swing marks.
    pub mark_count: u16,
    /// Part of the turn in progress, left or right turns.
    pub turn_in_progress: Option<CollectionPart>,
}

impl CollectionProgress {
    /// Coverage of a part.
    #[must_use]
    pub const fn coverage_of(&self, part: CollectionPart) -> &PartCoverage {
        &self.part_coverages[part.index()]
    }

    /// Progress, percent; `None` for procedures whose end their samples do not determine.
    #[must_use]
    pub fn percent(&self) -> Option<u8> {
        let percent_of = |part| self.coverage_of(part).percent;
        match self.procedure {
            Procedure::Turns => Some(percent_of(CollectionPart::LEFT).midpoint(percent_of(CollectionPart::RIGHT))),
            Procedure::Level => Some(percent_of(CollectionPart::LEVEL)),
            Procedure::Swing | Procedure::Tumble | Procedure::Flight => None,
        }
    }

    /// Whether all required samples are stored.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.percent() == Some(100)
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
        for (procedure, [left, right, level], is_complete) in [
            (Procedure::Turns, [100, 100, 99], true),
            (Procedure::Turns, [100, 99, 100], false),
            (Procedure::Turns, [99, 100, 100], false),
            (Procedure::Level, [99, 99, 100], true),
            (Procedure::Level, [100, 100, 99], false),
            (Procedure::Swing, [100; 3], false),
            (Procedure::Tumble, [100; 3], false),
            (Procedure::Flight, [100; 3], false),
        ] {
            let part_coverages =
                [left, right, level, 100].map(|percent| PartCoverage { percent, ..PartCoverage::default() });
            let progress = CollectionProgress { procedure, part_coverages, ..CollectionProgress::default() };
            assert_eq!(progress.is_complete(), is_complete, "{procedure:?} {left} {right} {level}");
            assert_eq!(progress.coverage_of(CollectionPart::LEFT).is_complete(), left == 100);
        }
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
