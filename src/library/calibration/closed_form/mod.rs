//! Closed forms: results without iteration, and starting points of the refinement.

pub(in crate::calibration) mod compass_swing;
pub(in crate::calibration) mod conic;
pub(in crate::calibration) mod four_ellipse;
pub(in crate::calibration) mod level_ellipse;
pub(in crate::calibration) mod starting_point;
pub(in crate::calibration) mod turns;
pub(in crate::calibration) mod two_plane;
