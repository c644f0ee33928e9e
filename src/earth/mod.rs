//! Position, date, and the Earth's magnetic field there.

mod date;
mod local_field;
mod model;
mod position;

pub use date::Date;
pub use local_field::{LocalField, PositionContext};
pub use model::{EarthField, MODEL_NAME, ModelValidity};
pub use position::Position;
