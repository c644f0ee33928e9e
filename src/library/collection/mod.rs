//! Selection and storage of the samples for a calibration.
//!
//! The [`Procedure`](crate::calibration::method_selection::Procedure) decides which samples are stored: turns and level
//! flight, separated by a detector of sustained bank; samples at small tilt, for a compass swing with marks at known
//! headings; or all attitudes, of free flight or of a module turned by hand, where samples are chosen by their
//! information about the coefficients. All share one buffer, which holds every fourth sample back for verification and
//! survives a reset; each sample knows its part.
//!
//! | room | content |
//! |---|---|
//! | `collector/` | state and procedure of a collection; which policy a sample goes to |
//! | `turn_detector` | the part of a sample: left or right turn, or level flight |
//! | `sector_balance/` | policy of turns, level flight and swing: even coverage of heading sectors |
//! | `d_optimal_selection/` | policy of free flight and tumble: replacement of the least informative sample |
//! | `sample_buffer.rs`, `retained_samples/` | the one buffer with its quotas; its memory with header and checksum |
//! | `flight_statistics/`, `progress` | diagnosis of missing samples; counts and coverage of the stored ones |
//! | `recent_samples` | the last second, for marks |

mod collector;
mod d_optimal_selection;
mod flight_statistics;
mod progress;
mod recent_samples;
mod retained_samples;
mod sample_buffer;
mod sector_balance;
mod turn_detector;

pub use collector::Collector;
pub use flight_statistics::CollectionProblem;
pub use progress::{CollectionProgress, PartCoverage};
pub use recent_samples::RecentSamples;
pub use retained_samples::{CollectionContext, CollectionState, MARKS_CAPACITY, RetainedSamples};
pub use sample_buffer::{FIT_CAPACITY_PER_SIDE, SECTOR_COUNT};
pub use sector_balance::MIN_HELD_BACK_WHEN_COMPLETE;
pub use turn_detector::LEVEL_ROLL_RAD;

#[cfg(test)]
mod test_samples;
