//! Stack bounds and high-water mark.

use autoswing_firmware::health::StackUse;

/// Fill pattern written by the start-up code (cortex-m-rt's `paint-stack`).
const STACK_FILL_PATTERN: u32 = 0xCCCC_CCCC;

unsafe extern "C" {
    // Stack bounds from memory.x; only the addresses are meaningful.
    static _stack_start: u32;
    static _stack_end: u32;
}

/// Whether an object is completely within the stack.
pub fn contains_object<T>(place: *const T) -> bool {
    let (top, bottom) = ((&raw const _stack_start).addr(), (&raw const _stack_end).addr());
    place.is_aligned() && (bottom..=top - size_of::<T>()).contains(&place.addr())
}

/// Largest stack use: up to the lowest overwritten word of the fill pattern.
pub fn peak_use() -> StackUse {
    let bottom = &raw const _stack_end;
    let words = ((&raw const _stack_start).addr() - bottom.addr()) / size_of::<u32>();
    // SAFETY: all words between the bounds are stack memory. Volatile, because the pattern is not written by Rust code.
    let clean =
        (0..words).take_while(|&word| unsafe { bottom.add(word).read_volatile() } == STACK_FILL_PATTERN).count();
    StackUse { peak_used_bytes: size_of::<u32>() * (words - clean), size_bytes: size_of::<u32>() * words }
}
