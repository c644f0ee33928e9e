//! The memory cells: what is stored, what may be programmed, what an interrupted operation leaves.

use super::{FlashError, PAGE_BYTES, WORD_BYTES, Wear};
use crate::random::Random;

const ERASED: u8 = 0xFF;
const WORDS_PER_PAGE: usize = PAGE_BYTES / WORD_BYTES;

/// One step of the device: what a power cut can tear.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Operation {
    Program { word: usize, value: [u8; WORD_BYTES] },
    Erase { page: usize },
}

pub(super) struct Cells {
    bytes: Vec<u8>,
    /// Double words programmed since the last erase. Not the same as "not all ones": a double word programmed with
    /// ones has its error-correcting code written.
    programmed: Vec<bool>,
    erases: Vec<u32>,
    writes: u64,
}

impl Cells {
    pub fn erased(pages: usize) -> Self {
        Self {
            bytes: vec![ERASED; pages * PAGE_BYTES],
            programmed: vec![false; pages * WORDS_PER_PAGE],
            erases: vec![0; pages],
            writes: 0,
        }
    }

    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Takes these bytes for what is stored; a double word that is not erased has been programmed. False, and nothing
    /// done, when there are more or fewer.
    pub fn restore(&mut self, bytes: &[u8]) -> bool {
        if bytes.len() != self.bytes.len() {
            return false;
        }
        self.bytes.copy_from_slice(bytes);
        for (programmed, word) in self.programmed.iter_mut().zip(bytes.chunks_exact(WORD_BYTES)) {
            *programmed = word != [ERASED; WORD_BYTES];
        }
        true
    }

    pub fn flip_bits(&mut self, offset: usize, mask: u8) {
        self.bytes[offset] ^= mask;
    }

    pub fn wear(&self) -> Wear {
        Wear {
            erases: self.erases.iter().copied().map(u64::from).sum(),
            writes: self.writes,
            worst_page_erases: self.erases.iter().copied().max().unwrap_or(0),
        }
    }

    /// Whether the operation is allowed now.
    pub fn check(&self, operation: Operation) -> Result<(), FlashError> {
        match operation {
            Operation::Program { word, .. } if self.programmed[word] => {
                Err(FlashError::NotErased { offset: (word * WORD_BYTES) as u32 })
            }
            _ => Ok(()),
        }
    }

    pub fn perform(&mut self, operation: Operation) {
        match operation {
            Operation::Program { word, value } => self.program(word, value),
            Operation::Erase { page } => {
                self.erases[page] += 1;
                for word in page * WORDS_PER_PAGE..(page + 1) * WORDS_PER_PAGE {
                    self.erase_word(word);
                }
            }
        }
    }

    /// Interrupts the operation. Programming: some of the bits that should fall have fallen. Erasing: of the page's
    /// double words some are as before, some are erased, some hold neither.
    pub fn tear(&mut self, operation: Operation, random: &mut Random) {
        match operation {
            Operation::Program { word, value } => {
                let fallen = random.bits().to_le_bytes();
                self.program(word, std::array::from_fn(|i| value[i] | fallen[i]));
            }
            Operation::Erase { page } => {
                self.erases[page] += 1;
                for word in page * WORDS_PER_PAGE..(page + 1) * WORDS_PER_PAGE {
                    self.tear_erase_of(word, random);
                }
            }
        }
    }

    fn tear_erase_of(&mut self, word: usize, random: &mut Random) {
        match random.bits() % 3 {
            0 => {}
            1 => self.erase_word(word),
            _ => {
                let risen = random.bits().to_le_bytes();
                for (byte, risen) in self.word_mut(word).iter_mut().zip(risen) {
                    *byte |= risen;
                }
            }
        }
    }

    fn program(&mut self, word: usize, value: [u8; WORD_BYTES]) {
        self.writes += 1;
        self.programmed[word] = true;
        self.word_mut(word).copy_from_slice(&value);
    }

    fn erase_word(&mut self, word: usize) {
        self.programmed[word] = false;
        self.word_mut(word).fill(ERASED);
    }

    fn word_mut(&mut self, word: usize) -> &mut [u8] {
        &mut self.bytes[word * WORD_BYTES..(word + 1) * WORD_BYTES]
    }
}
