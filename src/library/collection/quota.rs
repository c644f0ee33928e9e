//! Uses of samples, and capacities of the parts in the one buffer.

use super::turn_circle::SECTOR_COUNT;

/// Fit samples per turn side: 16 per sector. 6.9 KB.
pub const FIT_CAPACITY_PER_SIDE: usize = 16 * SECTOR_COUNT;

/// Use of a stored sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SampleUse {
    /// The sample is used to fit the coefficients.
    Fit,
    /// The sample is held back, to compare a solution with the active calibration.
    Verification,
}

/// Largest numbers of samples of a part.
#[derive(Clone, Copy, Debug)]
pub(super) struct SampleQuota {
    pub fit_quota: usize,
    pub held_back_quota: usize,
}

impl SampleQuota {
    /// Quota of a turn side; 5 held-back samples per sector. Also of a tumble, whose closest samples are searched at
    /// each sample.
    pub const TURN: Self = Self { fit_quota: FIT_CAPACITY_PER_SIDE, held_back_quota: 5 * SECTOR_COUNT };

    /// Quota of level flight; 5 fit samples per sector, rounded up.
    pub const LEVEL: Self = Self { fit_quota: 64, held_back_quota: 20 };

    /// Quota of the whole buffer: free flight, or two sides and level flight.
    pub const WHOLE_BUFFER: Self = Self {
        fit_quota: 2 * Self::TURN.fit_quota + Self::LEVEL.fit_quota,
        held_back_quota: 2 * Self::TURN.held_back_quota + Self::LEVEL.held_back_quota,
    };

    pub const fn quota_of(self, sample_use: SampleUse) -> usize {
        match sample_use {
            SampleUse::Fit => self.fit_quota,
            SampleUse::Verification => self.held_back_quota,
        }
    }
}
