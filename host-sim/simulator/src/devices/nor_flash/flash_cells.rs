//! Memory cells of the flash, and the effects of interrupted operations.

use super::error::SimulatedFlashError;
use crate::random::RandomStream;

/// Page size in bytes, the unit of erasing.
pub const PAGE_BYTES: usize = 2048;
/// Double-word size in bytes, the unit of programming.
pub const WORD_BYTES: usize = 8;

const ERASED: u8 = 0xFF;
const WORDS_PER_PAGE: usize = PAGE_BYTES / WORD_BYTES;

/// Counters of erased pages and programmed words since the creation of the flash.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WearCounters {
    /// Page erases, including incomplete ones.
    pub page_erases: u64,
    /// Programmed double words, including incomplete ones.
    pub programmed_words: u64,
    /// Erase count of the most erased page.
    pub worst_page_erases: u32,
}

/// Operation on one double word or page, which a power cut can interrupt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FlashOperation {
    Program { word_index: usize, value: [u8; WORD_BYTES] },
    Erase { page_index: usize },
}

pub(super) struct FlashCells {
    bytes: Vec<u8>,
    /// Double words programmed since the last erase. Programming all ones counts, because it writes the
    /// error-correcting code.
    programmed_word_flags: Vec<bool>,
    page_erase_counts: Vec<u32>,
    programmed_word_count: u64,
}

impl FlashCells {
    pub fn new_erased(pages: usize) -> Self {
        Self {
            bytes: vec![ERASED; pages * PAGE_BYTES],
            programmed_word_flags: vec![false; pages * WORDS_PER_PAGE],
            page_erase_counts: vec![0; pages],
            programmed_word_count: 0,
        }
    }

    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Loads a copy of the contents; double words other than all ones count as programmed. False without effect if the
    /// size differs.
    pub fn restore_contents(&mut self, bytes: &[u8]) -> bool {
        if bytes.len() != self.bytes.len() {
            return false;
        }
        self.bytes.copy_from_slice(bytes);
        for (is_programmed, word) in self.programmed_word_flags.iter_mut().zip(bytes.chunks_exact(WORD_BYTES)) {
            *is_programmed = word != [ERASED; WORD_BYTES];
        }
        true
    }

    pub fn flip_bits(&mut self, offset: usize, mask: u8) {
        self.bytes[offset] ^= mask;
    }

    pub fn wear_counters(&self) -> WearCounters {
        WearCounters {
            page_erases: self.page_erase_counts.iter().copied().map(u64::from).sum(),
            programmed_words: self.programmed_word_count,
            worst_page_erases: self.page_erase_counts.iter().copied().max().unwrap_or(0),
        }
    }

    /// Checks that the operation is allowed.
    pub fn check_operation(&self, operation: FlashOperation) -> Result<(), SimulatedFlashError> {
        match operation {
            FlashOperation::Program { word_index, .. } if self.programmed_word_flags[word_index] => {
                Err(SimulatedFlashError::NotErased { offset: (word_index * WORD_BYTES) as u32 })
            }
            _ => Ok(()),
        }
    }

    pub fn perform_operation(&mut self, operation: FlashOperation) {
        match operation {
            FlashOperation::Program { word_index, value } => self.store_programmed_word(word_index, value),
            FlashOperation::Erase { page_index } => {
                self.page_erase_counts[page_index] += 1;
                for word_index in page_index * WORDS_PER_PAGE..(page_index + 1) * WORDS_PER_PAGE {
                    self.erase_word(word_index);
                }
            }
        }
    }

    /// Applies a partial operation. Interrupted programming clears only some bits. An interrupted erase leaves each
    /// double word unchanged, erased, or with some bits set.
    pub fn apply_partially(&mut self, operation: FlashOperation, random: &mut RandomStream) {
        match operation {
            FlashOperation::Program { word_index, value } => {
                let cleared_bits = random.random_bits().to_le_bytes();
                self.store_programmed_word(word_index, std::array::from_fn(|i| value[i] | cleared_bits[i]));
            }
            FlashOperation::Erase { page_index } => {
                self.page_erase_counts[page_index] += 1;
                for word_index in page_index * WORDS_PER_PAGE..(page_index + 1) * WORDS_PER_PAGE {
                    self.erase_word_partially(word_index, random);
                }
            }
        }
    }

    fn erase_word_partially(&mut self, word_index: usize, random: &mut RandomStream) {
        match random.random_bits() % 3 {
            0 => {}
            1 => self.erase_word(word_index),
            _ => {
                let set_bits = random.random_bits().to_le_bytes();
                for (byte, set_bits) in self.word_mut(word_index).iter_mut().zip(set_bits) {
                    *byte |= set_bits;
                }
            }
        }
    }

    fn store_programmed_word(&mut self, word_index: usize, value: [u8; WORD_BYTES]) {
        self.programmed_word_count += 1;
        self.programmed_word_flags[word_index] = true;
        self.word_mut(word_index).copy_from_slice(&value);
    }

    fn erase_word(&mut self, word_index: usize) {
        self.programmed_word_flags[word_index] = false;
        self.word_mut(word_index).fill(ERASED);
    }

    fn word_mut(&mut self, word_index: usize) -> &mut [u8] {
        &mut self.bytes[word_index * WORD_BYTES..(word_index + 1) * WORD_BYTES]
    }
}
