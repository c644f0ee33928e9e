//! Replays a recorded flight through the module's instrument, collection, solver and acceptance test.

pub mod baseline_fits;
mod data_loss;
pub mod device_collection;
pub mod evaluation;
pub mod field_latency;
mod frozen_field;
pub mod gps_course;
pub mod hard_iron_step;
mod module_run;
pub mod note;
pub mod parameter_export;
mod reference;
mod result;
mod row;
mod rows;
pub mod verdict;

pub use module_run::{is_monitored, level_field, replay, replay_with};
pub use reference::ReferenceHeading;
pub use result::{HeadingRow, HeadingScore, ReplayOptions, ReplayRefusal, ReplayResult, RowSelection};
pub use row::ReplayRow;
pub use rows::{AttitudeSample, RowCounts, attitudes_between, build_rows};

#[cfg(test)]
mod tests;
