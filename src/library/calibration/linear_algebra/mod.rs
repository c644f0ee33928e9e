//! Least squares and 3x3 matrices in `f32`.

pub(in crate::calibration) mod least_squares;
pub(in crate::calibration) mod matrix;
