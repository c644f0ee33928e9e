//! Attitude at a requested instant.

use crate::frames::RollPitch;

/// Attitude at a requested instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AttitudeLookup {
    /// Interpolated between two reports.
    Interpolated(RollPitch),
    /// Extrapolated from the newest report with its body rates.
    Extrapolated(RollPitch),
    /// The instant is before the oldest stored report or in a gap; later reports do not change that.
    Missing,
    /// The instant is after the newest report by more than the extrapolation limit, or there is no report yet.
    Stale,
    /// The source repeats the same attitude.
    Frozen,
    /// The source's filter is still converging, or its attitude is stale.
    Contradicted,
}
