//! Name of an autopilot's parameter.

use core::fmt;

/// Longest name, bytes: the field `param_id` of MAVLink.
const MAX_NAME_LENGTH: usize = 16;

/// Name of an autopilot's parameter, padded with zeros.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub struct ParameterName(pub [u8; MAX_NAME_LENGTH]);

impl ParameterName {
    /// Name from a text of at most 16 bytes; further bytes are cut.
    #[must_use]
    pub fn new(text: &str) -> Self {
        let mut name = [0; MAX_NAME_LENGTH];
        name.iter_mut().zip(text.bytes()).for_each(|(target, byte)| *target = byte);
        Self(name)
    }

    /// Name by a pattern: `#` is replaced by the compass's slot and `^` by its priority, both by nothing for 1, and `@` by
    /// the slot counted from 0.
    #[must_use]
    pub fn from_pattern(pattern: &str, slot: u8, priority: u8) -> Self {
        let digit_after_first = |number| (number != 1).then_some(b'0' + number);
        let letters = pattern.bytes().filter_map(|letter| match letter {
            b'#' => digit_after_first(slot),
            b'^' => digit_after_first(priority),
            b'@' => Some(b'0' + slot.saturating_sub(1)),
            letter => Some(letter),
        });
        let mut name = Self::default();
        name.0.iter_mut().zip(letters).for_each(|(target, letter)| *target = letter);
        name
    }
}

impl fmt::Display for ParameterName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().take_while(|byte| **byte != 0).try_for_each(|byte| fmt::Write::write_char(f, char::from(*byte)))
    }
}

impl fmt::Debug for ParameterName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}
