//! Replays a recorded flight through the module's instrument and state machine.

pub mod baseline_fits;
pub mod bending_load;
mod change_fit;
pub mod compass_agreement;
mod data_loss;
pub mod evaluation;
pub mod field_latency;
pub mod flown_headings;
mod frozen_field;
pub mod gps_course;
pub mod hard_iron_changes;
pub mod hard_iron_jump;
pub mod hard_iron_step;
pub mod judgement_request;
pub mod log_warning;
pub mod logged_accuracy;
pub mod module_run;
mod next_steps;
pub mod parameter_choice;
pub mod parameter_export;
pub mod parameter_fit;
mod parameter_loading;
pub mod reading_checks;
mod reference;
mod replay_run;
mod result;
mod row;
mod row_headings;
mod row_solve;
mod rows;
pub mod sensor_change;
pub mod sensor_failure;
pub mod verdict;

pub use parameter_loading::{ParameterChange, ParameterFile};
pub use reference::{ReferenceHeading, ReferenceKind};
pub use replay_run::{replay_rows, replay_rows_of_flight};
pub use result::{HeadingRow, HeadingScore, ReplayOptions, ReplayResult, RowSelection};
pub use row::ReplayRow;
pub(crate) use row::heading_deg;
pub use row_headings::is_monitored;
pub(crate) use row_solve::solved_correction;
pub use rows::{AttitudeSample, RowCounts, attitudes_between, build_rows};

#[cfg(test)]
pub(crate) mod tests;
