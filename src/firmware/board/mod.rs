//! Board support: one board per Cargo feature, on drivers shared by a chip family. All `unsafe` code of the project is
//! here.
//!
//! A board has a module with the types of [`hardware::Hardware`] and a `start_board` function that initialises the
//! hardware and passes it to its argument, [`tasks::spawn_all_tasks`]; a file `BOARD.x` with its memory, listed in
//! build.rs; and a feature in Cargo.toml.

#[cfg(feature = "board-b-l475e-iot01a")]
mod b_l475e_iot01a;
mod chosen;
mod hardware;
#[cfg(feature = "board-holybro-rm3100")]
mod holybro_rm3100;
#[cfg(feature = "board-mps2-an386")]
mod mps2_an386;
mod panic_message;
mod sample_memory;
mod stack;
#[cfg(any(feature = "board-b-l475e-iot01a", feature = "board-holybro-rm3100"))]
mod stm32;
mod tasks;

/// Starts the selected board.
pub fn start_board() -> ! {
    chosen::start_board(tasks::spawn_all_tasks)
}
