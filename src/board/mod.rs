//! Boards: one file each, on drivers that are shared by a family of chips. All `unsafe` of the project is below here.

pub mod b_l475e_iot01a;
mod stm32l4;
