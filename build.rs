//! Tells the linker where memory is when the firmware is built; does nothing on a host.

use std::env;
use std::path::PathBuf;
use std::{fs, io};

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=memory.x");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return Ok(());
    }
    let on_mps2 = env::var_os("CARGO_FEATURE_BOARD_MPS2_AN386").is_some();
    let memory = if on_mps2 { "src/board/mps2_an386.x" } else { "src/board/b_l475e_iot01a.x" };
    println!("cargo:rerun-if-changed={memory}");
    // link.x (of cortex-m-rt) includes memory.x, and that board.x, from the linker's search path. Copies in OUT_DIR are
    // found from wherever cargo is started.
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy("memory.x", out.join("memory.x"))?;
    fs::copy(memory, out.join("board.x"))?;
    if on_mps2 {
        // link.x wants names for the interrupts' handlers; this board's table has the handlers themselves.
        fs::write(out.join("device.x"), "")?;
    }
    println!("cargo:rustc-link-search={}", out.display());
    // --nmagic: sections keep the addresses of memory.x instead of being aligned to pages of a host.
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    Ok(())
}
