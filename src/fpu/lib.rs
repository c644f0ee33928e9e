//! Square root by the instruction of a Cortex-M4F's FPU: a crate of its own, so that the library can forbid `unsafe`.
//!
//! `core` has no stable square root, and `libm`'s takes some 80 instructions.
#![no_std]

/// Square root, correctly rounded (IEEE 754); not a number for a negative `x`.
#[must_use]
#[inline]
#[cfg(all(target_arch = "arm", target_abi = "eabihf"))]
pub fn sqrt(x: f32) -> f32 {
    let mut bits = x.to_bits();
    // Stable Rust gives assembly no register of a single-precision FPU, so the assembly borrows one and restores it.
    // SAFETY: the target has an FPU (`eabihf`); s0 holds afterwards what it held before; no memory is touched.
    unsafe {
        core::arch::asm!(
            "vmov {saved}, s0", "vmov s0, {bits}", "vsqrt.f32 s0, s0", "vmov {bits}, s0", "vmov s0, {saved}",
            bits = inout(reg) bits, saved = out(reg) _, options(pure, nomem, nostack)
        );
    }
    f32::from_bits(bits)
}

/// Square root, correctly rounded (IEEE 754); not a number for a negative `x`.
#[must_use]
#[inline]
#[cfg(not(all(target_arch = "arm", target_abi = "eabihf")))]
pub fn sqrt(x: f32) -> f32 {
    libm::sqrtf(x)
}
