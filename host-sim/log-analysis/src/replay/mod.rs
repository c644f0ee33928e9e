//! Replays a recorded flight through the module's instrument and state machine.

mod baseline_fits;
mod bending_load;
mod change_fit;
mod compass_agreement;
mod data_loss;
pub mod evaluation;
pub mod field_change;
mod field_latency;
mod flown_headings;
mod frozen_field;
pub mod gps_course;
pub mod judgement_request;
pub mod log_warning;
pub mod logged_accuracy;
pub mod module_run;
mod next_steps;
mod parameter_choice;
pub mod parameter_export;
mod parameter_fit;
mod parameter_loading;
mod reading_checks;
mod reference;
mod replay_run;
mod result;
mod row;
mod row_headings;
mod row_solve;
mod rows;
mod sensor_failure;
pub mod verdict;

pub use parameter_loading::{ParameterChange, ParameterFile};
pub use reference::{ReferenceHeading, ReferenceKind};
pub use replay_run::replay_rows;
pub use result::{EarthFieldPrior, HeadingRow, HeadingScore, ReplayResult, RowSelection};
pub use row::ReplayRow;
pub(crate) use row::heading_deg;
pub(crate) use row_solve::solved_correction;
pub use rows::build_rows;

#[cfg(test)]
pub(crate) mod tests;
