//! stub
use super::*;
#[derive(Debug)]
pub struct Config;
impl Config {
    pub const DEFAULT: Self = Self;
}
#[derive(Debug, Default)]
pub struct Prior {
    pub mount: Orientation,
    pub x: u8,
}
#[derive(Debug)]
pub struct Refinement;
pub enum Progress {
    Continue,
    Finished(Result<Solution, SolveError>),
}
impl Refinement {
    pub fn new(_: Turns, _: &Prior, _: &Config) -> Result<Self, SolveError> {
        Ok(Self)
    }
    pub fn step(&mut self, _: Turns) -> Progress {
        Progress::Continue
    }
}
