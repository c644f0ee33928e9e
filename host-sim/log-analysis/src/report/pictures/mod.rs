pub mod coverage;
pub mod deviation;
pub mod field;
pub mod map;
pub mod methods;
mod picture;
pub mod residuals;

pub use picture::{LegendSample, Picture, draw_legend};
