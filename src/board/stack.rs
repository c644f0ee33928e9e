//! The stack: where it is and how much of it was ever used.

use autoswing::health::StackUse;

/// What the start-up code fills the stack with (cortex-m-rt's `paint-stack`).
const PAINT: u32 = 0xCCCC_CCCC;

unsafe extern "C" {
    // Bounds of the stack, from memory.x; only their addresses mean anything.
    static _stack_start: u32;
    static _stack_end: u32;
}

/// Whether something is on the stack as a whole.
pub fn holds<T>(place: *const T) -> bool {
    let (top, bottom) = ((&raw const _stack_start).addr(), (&raw const _stack_end).addr());
    place.is_aligned() && (bottom..=top - size_of::<T>()).contains(&place.addr())
}

/// The most that was ever in use: down to the first word that has lost its paint.
pub fn high_water() -> StackUse {
    let bottom = &raw const _stack_end;
    let words = ((&raw const _stack_start).addr() - bottom.addr()) / size_of::<u32>();
    // SAFETY: all words from `_stack_end` up to `_stack_start` are memory of the stack. Volatile, for the compiler does
    // not know of the paint, and what is below the stack pointer is no variable of anything.
    let clean = (0..words).take_while(|&word| unsafe { bottom.add(word).read_volatile() } == PAINT).count();
    StackUse { used: size_of::<u32>() * (words - clean), size: size_of::<u32>() * words }
}
