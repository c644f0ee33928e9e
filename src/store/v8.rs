//! Version 8 of the format, as firmware before version 9 wrote it.
//!
//! Its bytes are those of the present one without what goes with the current, which stands behind the calibrations: nothing
//! is known of it.

/// The number of this version.
pub(super) const VERSION: u8 = 8;
