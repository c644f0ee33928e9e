//! Map from the corrected field to the compass field: rotation by the alignment, scale to the true field strength.
//!
//! Alignment adds `a` to every heading. In level flight `(x, y) = H (cos psi, -sin psi)` (see the [crate docs](crate));
//! the output must be `H (cos(psi + a), -sin(psi + a))`, which is `(x cos a + y sin a, y cos a - x sin a)`.

use super::correction::Correction;
use crate::frames::{Body, Field};
use crate::trig;

/// Largest accepted ratio of true to measured field strength.
const MAX_STRENGTH_RATIO: f32 = 2.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct OutputMap {
    sin_alignment: f32,
    cos_alignment: f32,
    /// True over measured field strength; 1 if unknown or implausible.
    pub strength_ratio: f32,
}

impl OutputMap {
    /// Map of a correction; `measured_ut` is the calibration's field strength, microtesla.
    pub fn new(correction: &Correction, measured_ut: Option<f32>) -> Self {
        let (sin_alignment, cos_alignment) = trig::sin_cos(correction.align_deg.to_radians());
        let ratio = correction.total_ut.zip(measured_ut).map_or(1.0, |(total_ut, measured_ut)| total_ut / measured_ut);
        let is_plausible = (MAX_STRENGTH_RATIO.recip()..=MAX_STRENGTH_RATIO).contains(&ratio);
        Self { sin_alignment, cos_alignment, strength_ratio: if is_plausible { ratio } else { 1.0 } }
    }

    pub fn map_field(&self, body: Field<Body>) -> Field<Body> {
        let Self { sin_alignment, cos_alignment, strength_ratio } = self;
        let [x, y, z] = [body.ut.x, body.ut.y, body.ut.z].map(|ut| ut * strength_ratio);
        Field::from_ut(x * cos_alignment + y * sin_alignment, y * cos_alignment - x * sin_alignment, z)
    }
}
