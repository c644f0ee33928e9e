//! Tells the linker where memory is when the firmware is built; does nothing on a host.

use std::env;
use std::path::PathBuf;
use std::{fs, io};

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return Ok(());
    }
    // link.x (of cortex-m-rt) includes memory.x from the linker's search path. A copy in OUT_DIR is found from wherever
    // cargo is started.
    let board = env::var_os("CARGO_FEATURE_BOARD_MPS2_AN386");
    let memory = if board.is_some() { "src/board/mps2_an386/memory.x" } else { "memory.x" };
    println!("cargo:rerun-if-changed={memory}");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::copy(memory, out.join("memory.x"))?;
    if board.is_some() {
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
