//! Numbers of the autopilot's parameters that a setup replaced, for `autopilot undo`.

use serde::{Deserialize, Serialize};

/// Number of parameters: at least the rows of the table of wanted parameters.
const CAPACITY: usize = 24;

/// Slot and priority where the module is no compass of the autopilot.
const NO_COMPASS: (u8, u8) = (0, 0);

/// Number of a parameter before a setup, or none after it was restored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReplacedNumber {
    /// Row of the parameter in the table of wanted parameters.
    pub row: u8,
    /// Slot and priority of the compass in the parameter's name, counted from 1; 0 if it concerns no compass.
    pub compass: (u8, u8),
    /// Number before the setup.
    pub number: Option<f32>,
}

/// Replaced numbers by row, and the compass to which they belong.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReplacedNumbers {
    compass: (u8, u8),
    /// Bits of each number, plus 1; 0 for none. As bits, because no stored byte makes them unequal to themselves.
    bits_plus_1: [u32; CAPACITY],
}

impl ReplacedNumbers {
    /// No number.
    pub const NONE: Self = Self { compass: NO_COMPASS, bits_plus_1: [0; CAPACITY] };

    /// Slot and priority of the compass to which the numbers belong, counted from 1.
    #[must_use]
    pub const fn compass(&self) -> (u8, u8) {
        self.compass
    }

    /// Number of a row's parameter before the setup, in the name of which this compass stands.
    #[must_use]
    pub fn number(&self, row: u8, compass: (u8, u8)) -> Option<f32> {
        let bits = self.bits_plus_1.get(usize::from(row))?.checked_sub(1)?;
        self.is_of_compass(compass).then_some(f32::from_bits(bits))
    }

    /// Numbers after a change. Those of another compass are forgotten: it no longer has their parameters' names.
    #[must_use]
    pub fn with_number(self, replaced: ReplacedNumber) -> Self {
        let ReplacedNumber { row, compass, number } = replaced;
        let mut changed = if self.is_of_compass(compass) { self } else { Self::NONE };
        if compass != NO_COMPASS {
            changed.compass = compass;
        }
        if let Some(bits_plus_1) = changed.bits_plus_1.get_mut(usize::from(row)) {
            *bits_plus_1 = number.map_or(0, |number| number.to_bits().wrapping_add(1));
        }
        changed
    }

    fn is_of_compass(&self, compass: (u8, u8)) -> bool {
        self.compass == compass || [self.compass, compass].contains(&NO_COMPASS)
    }
}
