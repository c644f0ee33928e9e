//! The memory of a collection, which a reset leaves as it is.

use core::arch::asm;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, Ordering};

use autoswing::collection::Kept;

/// Memory that the start-up code leaves alone.
struct Memory(UnsafeCell<MaybeUninit<Kept>>);

// SAFETY: only `lend` gives it away, and only once.
unsafe impl Sync for Memory {}

#[unsafe(link_section = ".uninit.kept")]
static MEMORY: Memory = Memory(UnsafeCell::new(MaybeUninit::uninit()));

/// Lends the memory to the one task that collects.
///
/// # Panics
///
/// The second time.
pub fn lend() -> &'static mut Kept {
    static IS_LENT: AtomicBool = AtomicBool::new(false);
    assert!(!IS_LENT.swap(true, Ordering::Relaxed), "one task of each");
    let mut place = MEMORY.0.get();
    // SAFETY: it does nothing. The compiler cannot know that it does not fill the memory, as the run before this one did, or
    // the power, with something.
    unsafe { asm!("/* {0} */", inout(reg) place, options(nostack, preserves_flags)) };
    // SAFETY: a `Kept` is made of nothing but `u32` and `f32`, of which every content of memory is one. It is aligned, and
    // there is no other reference to it, for this is the first time.
    unsafe { (*place).assume_init_mut() }
}
