//! The firmware: the tasks of the library on a board.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;

#[cfg(target_os = "none")]
#[cortex_m_rt::entry]
fn main() -> ! {
    board::start()
}

#[cfg(not(target_os = "none"))]
fn main() {
    println!("This is the firmware; it runs on the board. README.md says how to build and flash it.");
    println!("To see it fly on this computer: cargo run --release -p host-sim");
}
