//! Position, date, and the Earth's magnetic field there.

mod date;
mod field_model;
mod local_field;
mod position;

pub use date::Date;
pub use field_model::{EarthField, MODEL_NAME, ModelValidity};
pub use local_field::{LocalField, PositionContext};
pub use position::Position;
