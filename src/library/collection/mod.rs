//! Selection and storage of the samples for a calibration.
//!
//! The [`Procedure`](crate::calibration::method_selection::Procedure) decides which samples are stored: turns and level
//! flight, separated by a detector of sustained bank; samples at small tilt, for a compass swing with marks at known
//! headings; all attitudes of a module turned by hand; or free flight, where samples are chosen by their information
//! about the coefficients. All share one buffer, which holds every fourth sample back for verification and survives a
//! reset; each sample knows its part.
//!
//! | room | content |
//! |---|---|
//! | `collector/` | state and procedure of a collection; which policy a sample goes to |
//! | `turn_detector`, `level_limits` | the part of a sample |
//! | `sector_balance/` | policy of turns, level flight and swing: even coverage of heading sectors |
//! | `min_distance.rs` | policy of a tumble: distance in field space |
//! | `free_flight.rs`, `d_optimal_selection/` | policy of free flight: replacement of the least informative sample |
//! | `part_view`, `quota` | what a policy acts on: one part of the buffer; its capacity |
//! | `sample_buffer.rs`, `retained_samples/` | the one buffer; its memory with header and checksum |
//! | `flight_statistics/`, `progress` | diagnosis of missing samples; counts and coverage of the stored ones |
//! | `recent_samples` | the last second, for marks |

mod collector;
mod d_optimal_selection;
mod flight_statistics;
mod free_flight;
mod level_limits;
mod min_distance;
mod part_view;
mod progress;
mod quota;
mod recent_samples;
mod retained_samples;
mod sample_buffer;
mod sector_balance;
mod state;
mod turn_circle;
mod turn_detector;

pub use collector::Collector;
pub use flight_statistics::CollectionProblem;
pub use level_limits::LevelLimits;
pub use progress::{CollectionProgress, PartCoverage};
pub use quota::FIT_CAPACITY_PER_SIDE;
pub use recent_samples::RecentSamples;
pub use retained_samples::{MARKS_CAPACITY, RetainedSamples};
pub use sector_balance::MIN_HELD_BACK_WHEN_COMPLETE;
pub use state::{CollectionContext, CollectionState};
pub use turn_circle::SECTOR_COUNT;

#[cfg(test)]
mod test_samples;
