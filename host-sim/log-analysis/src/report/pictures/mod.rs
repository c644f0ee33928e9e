pub mod coverage;
pub mod deviation;
pub mod map;
mod picture;

pub use picture::Picture;
