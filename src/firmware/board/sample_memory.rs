//! Sample buffer in `.uninit` RAM, which survives a reset.

use core::arch::asm;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, Ordering};

use autoswing::collection::RetainedSamples;

/// Memory not initialised by the start-up code.
struct SampleMemory(UnsafeCell<MaybeUninit<RetainedSamples>>);

// SAFETY: one function accesses it, and only once.
unsafe impl Sync for SampleMemory {}

#[unsafe(link_section = ".uninit.kept")]
static SAMPLE_MEMORY: SampleMemory = SampleMemory(UnsafeCell::new(MaybeUninit::uninit()));

/// Returns the sample buffer to the one task that collects.
///
/// # Panics
///
/// On the second call.
pub fn take_sample_memory() -> &'static mut RetainedSamples {
    static IS_MEMORY_TAKEN: AtomicBool = AtomicBool::new(false);
    assert!(!IS_MEMORY_TAKEN.swap(true, Ordering::Relaxed), "one task of each");
    let mut place = SAMPLE_MEMORY.0.get();
    // SAFETY: the assembly is empty. The compiler must assume that it initialises the memory, as the previous run or
    // power-on did.
    unsafe { asm!("/* {0} */", inout(reg) place, options(nostack, preserves_flags)) };
    // SAFETY: the memory consists of integers and `f32` only, valid for any contents. It is aligned, and this is the
    // only reference, because this code runs once.
    unsafe { (*place).assume_init_mut() }
}
