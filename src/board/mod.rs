//! Boards: one each, chosen by a feature of the same name, on drivers that are shared by a family of chips. All `unsafe`
//! of the project is below here.

#[cfg(feature = "board-b-l475e-iot01a")]
mod b_l475e_iot01a;
mod last_words;
#[cfg(feature = "board-mps2-an386")]
mod mps2_an386;
mod stack;
#[cfg(feature = "board-b-l475e-iot01a")]
mod stm32l4;

#[cfg(feature = "board-b-l475e-iot01a")]
pub use b_l475e_iot01a::start;
#[cfg(feature = "board-mps2-an386")]
pub use mps2_an386::start;
