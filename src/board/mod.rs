//! Boards: one each, chosen by a feature of the same name, on drivers that are shared by a family of chips. All
//! `unsafe` of the project is below here.
//!
//! A board is a module with the types that [`tasks::Hardware`] is made of and a `start`, which brings the hardware up
//! and hands it to [`tasks::spawn`]; a file `BOARD.x` that says where its memory is, known to build.rs; and a feature
//! in Cargo.toml.

#[cfg(feature = "board-b-l475e-iot01a")]
mod b_l475e_iot01a;
mod kept;
mod last_words;
#[cfg(feature = "board-mps2-an386")]
mod mps2_an386;
mod stack;
#[cfg(feature = "board-b-l475e-iot01a")]
mod stm32l4;
mod tasks;

#[cfg(feature = "board-b-l475e-iot01a")]
use b_l475e_iot01a as chosen;
#[cfg(all(feature = "board-mps2-an386", not(feature = "board-b-l475e-iot01a")))]
use mps2_an386 as chosen;

pub use chosen::start;
