//! The firmware.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("This is the firmware; it runs on the board. README.md says how to build and flash it.");
    println!("To see it fly on this computer: cargo run --release -p host-sim");
}
