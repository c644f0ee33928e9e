//! Passes the memory layout to the linker for firmware builds; does nothing on a host.

use std::env;
use std::path::PathBuf;
use std::{fs, io};

/// The memory layout that all boards share.
const MEMORY: &str = "../../memory.x";

/// Cargo's names of the board features, and the memory layout of each board.
const BOARDS: [(&str, &str); 3] = [
    ("CARGO_FEATURE_BOARD_B_L475E_IOT01A", "board/b_l475e_iot01a.x"),
    ("CARGO_FEATURE_BOARD_HOLYBRO_RM3100", "board/holybro_rm3100.x"),
    ("CARGO_FEATURE_BOARD_MPS2_AN386", "board/mps2_an386.x"),
];

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed={MEMORY}");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return Ok(());
    }
    let mut chosen = BOARDS.iter().filter(|(feature, _)| env::var_os(feature).is_some());
    // Without a board only libraries are built, which are not linked. main.rs rejects a firmware without a board or
    // with two.
    let (Some((_, memory)), None) = (chosen.next(), chosen.next()) else { return Ok(()) };
    println!("cargo:rerun-if-changed={memory}");
    // link.x (cortex-m-rt) includes memory.x, which includes board.x; the linker finds both in OUT_DIR.
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy(MEMORY, out.join("memory.x"))?;
    fs::copy(memory, out.join("board.x"))?;
    // link.x needs device.x with interrupt handler names. HALs provide it; boards with their own vector table need an
    // empty one.
    if env::var_os("CARGO_FEATURE_BOARD_MPS2_AN386").is_some() {
        fs::write(out.join("device.x"), "")?;
    }
    println!("cargo:rustc-link-search={}", out.display());
    // --nmagic: do not align sections to pages.
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    Ok(())
}
