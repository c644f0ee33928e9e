//! Version 2 of the format, as firmware before version 3 wrote it.
//!
//! Its bytes are those of [version 3](v3); one number means something else: `sensor_sigma` is the noise of an average of
//! eight readings, where version 3 has that of a single one.

use super::v3;

/// The number of this version.
pub(super) const VERSION: u8 = 2;

/// The noise of one reading over that of an average of eight: the square root of 8.
const SINGLE_OVER_AVERAGE: f32 = 2.0 * core::f32::consts::SQRT_2;

/// Makes what was read as version 3 mean what it does there.
pub(super) fn convert(contents: &mut v3::Contents) {
    let v3::Generations { current, previous } = &mut contents.generations;
    for calibrated in [current, previous].into_iter().flatten() {
        calibrated.sensor_sigma *= SINGLE_OVER_AVERAGE;
    }
}
