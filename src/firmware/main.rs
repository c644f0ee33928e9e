//! Firmware: the library's tasks on a board.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(all(
    target_os = "none",
    not(any(feature = "board-b-l475e-iot01a", feature = "board-holybro-rm3100", feature = "board-mps2-an386"))
))]
compile_error!("the firmware is for a board: name it by a feature board-..., as `cargo firmware` does");
#[cfg(all(
    target_os = "none",
    any(
        all(feature = "board-b-l475e-iot01a", any(feature = "board-holybro-rm3100", feature = "board-mps2-an386")),
        all(feature = "board-holybro-rm3100", feature = "board-mps2-an386")
    )
))]
compile_error!("the firmware is for one board: two features board-... are on");

#[cfg(target_os = "none")]
mod board;

#[cfg(target_os = "none")]
#[cortex_m_rt::entry]
fn main() -> ! {
    board::start_board()
}

#[cfg(not(target_os = "none"))]
fn main() {
    println!("This is the firmware; it runs on the board. README.md says how to build and flash it.");
    println!("To see it fly on this computer: cargo run --release -p host-sim");
}
