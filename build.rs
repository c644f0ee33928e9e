//! Tells the linker where memory is when the firmware is built; does nothing on a host.

use std::env;
use std::path::PathBuf;
use std::{fs, io};

/// Features that choose a board, as cargo names them here, and the board's memory.
const BOARDS: [(&str, &str); 2] = [
    ("CARGO_FEATURE_BOARD_B_L475E_IOT01A", "src/board/b_l475e_iot01a.x"),
    ("CARGO_FEATURE_BOARD_MPS2_AN386", "src/board/mps2_an386.x"),
];

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=memory.x");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return Ok(());
    }
    let mut chosen = BOARDS.iter().filter(|(feature, _)| env::var_os(feature).is_some());
    // Without a board the library is built, which is not linked; src/board/mod.rs refuses the firmware without a board
    // and with two.
    let (Some((_, memory)), None) = (chosen.next(), chosen.next()) else { return Ok(()) };
    println!("cargo:rerun-if-changed={memory}");
    // link.x (of cortex-m-rt) includes memory.x, and that board.x, from the linker's search path. Copies in OUT_DIR are
    // found from wherever cargo is started.
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy("memory.x", out.join("memory.x"))?;
    fs::copy(memory, out.join("board.x"))?;
    // link.x wants names for the handlers of a chip's interrupts. HALs have them in a device.x of their own; an empty
    // one is for boards whose table has the handlers themselves.
    if env::var_os("CARGO_FEATURE_BOARD_MPS2_AN386").is_some() {
        fs::write(out.join("device.x"), "")?;
    }
    println!("cargo:rustc-link-search={}", out.display());
    // --nmagic: sections keep the addresses of memory.x instead of being aligned to pages of a host.
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    Ok(())
}
