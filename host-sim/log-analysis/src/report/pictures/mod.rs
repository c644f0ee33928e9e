pub mod coverage;
pub mod deviation;
mod picture;

pub use picture::Picture;
