//! stub
use super::*;
pub struct S {
    pub candidate: f32,
    pub incumbent: f32,
}
pub fn verify(_: Turns, _: &Calibration, _: &Calibration) -> S {
    S { candidate: 0.0, incumbent: 1.0 }
}
