//! Selection and storage of the samples for a calibration.
//!
//! The [`Procedure`](crate::calibration::method_selection::Procedure) decides which samples are offered: turns and level
//! flight, labelled by a detector of sustained bank; samples at small tilt, for a compass swing with marks at known
//! headings; or all attitudes, of free flight or of a module turned by hand. One buffer keeps the samples with the most Fisher
//! information on the coefficients, holds every fourth back for verification and survives a reset.
//!
//! | room | content |
//! |---|---|
//! | `collector/` | state and procedure of a collection; which samples it offers |
//! | `turn_detector` | the part of a sample: left or right turn, or level flight |
//! | `d_optimal_selection/` | which samples are kept: replacement of the least informative one |
//! | `sector_coverage/` | coverage of the headings by turns and level flight, which completes them |
//! | `sample_buffer.rs`, `retained_samples/` | the one buffer; its memory with header and checksum |
//! | `flight_statistics/`, `progress` | diagnosis of missing samples; counts and coverage of the stored ones |
//! | `recent_samples` | the last second, for marks |

mod collector;
mod d_optimal_selection;
mod flight_statistics;
mod progress;
mod recent_samples;
mod retained_samples;
mod sample_buffer;
mod sector_coverage;
mod turn_detector;

pub use collector::Collector;
pub use flight_statistics::CollectionProblem;
pub use progress::{CollectionProgress, PartCoverage, SECTOR_COUNT};
pub use recent_samples::RecentSamples;
pub use retained_samples::{CollectionContext, CollectionState, MARKS_CAPACITY, RetainedSamples};
pub use sector_coverage::MIN_HELD_BACK_WHEN_COMPLETE;
pub use turn_detector::LEVEL_ROLL_RAD;

#[cfg(test)]
mod test_samples;
