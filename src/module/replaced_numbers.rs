//! Numbers of the autopilot's parameters that a setup replaced, for `autopilot undo`.

use serde::{Deserialize, Serialize};

/// Number of parameters: at least the rows of the table of wanted parameters of one kind of autopilot.
const CAPACITY: usize = 24;

/// Kind of autopilot, by its parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum AutopilotKind {
    /// By MAVLink.
    ArduPilot,
    /// By MAVLink.
    Px4,
    /// By MSP.
    Inav,
}

/// Autopilot and compass to which replaced numbers belong: the names of parameters depend on them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ParameterOwner {
    /// Kind of autopilot.
    pub kind: AutopilotKind,
    /// Slot and priority of the module's compass, counted from 1; 0 if the autopilot has none.
    pub compass: (u8, u8),
}

/// Number of a parameter before a setup, or none after it was restored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReplacedNumber {
    /// Autopilot and compass that have the parameter.
    pub owner: ParameterOwner,
    /// Position of the parameter in the table of wanted parameters of its autopilot.
    pub row: u8,
    /// Number before the setup.
    pub number: Option<f32>,
}

/// Replaced numbers by row, and their owner.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ReplacedNumbers {
    owner: ParameterOwner,
    /// Bits of each number, plus 1; 0 for none. As bits, because no stored byte makes them unequal to themselves.
    bits_plus_1: [u32; CAPACITY],
}

impl ReplacedNumbers {
    /// No number.
    pub const NONE: Self =
        Self { owner: ParameterOwner { kind: AutopilotKind::ArduPilot, compass: (0, 0) }, bits_plus_1: [0; CAPACITY] };

    /// Whether there is no number.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bits_plus_1 == Self::NONE.bits_plus_1
    }

    /// Autopilot and compass to which the numbers belong.
    #[must_use]
    pub const fn owner(&self) -> ParameterOwner {
        self.owner
    }

    /// Number of an owner's parameter before the setup.
    #[must_use]
    pub fn number(&self, owner: ParameterOwner, row: u8) -> Option<f32> {
        let bits = self.bits_plus_1.get(usize::from(row))?.checked_sub(1)?;
        (self.owner == owner).then_some(f32::from_bits(bits))
    }

    /// Numbers after a change. Those of another owner are forgotten.
    #[must_use]
    pub fn with_number(self, replaced: ReplacedNumber) -> Self {
        let ReplacedNumber { owner, row, number } = replaced;
        let mut changed = if self.owner == owner { self } else { Self { owner, ..Self::NONE } };
        if let Some(bits_plus_1) = changed.bits_plus_1.get_mut(usize::from(row)) {
            *bits_plus_1 = number.map_or(0, |number| number.to_bits().wrapping_add(1));
        }
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Another compass, or an autopilot of another kind, has other parameters at the same positions.
    #[test]
    fn numbers_belong_to_one_owner() {
        let owner = ParameterOwner { kind: AutopilotKind::ArduPilot, compass: (2, 1) };
        let number = |numbers: ReplacedNumbers, owner, row, number| {
            numbers.with_number(ReplacedNumber { owner, row, number: Some(number) })
        };
        let numbers = number(number(ReplacedNumbers::NONE, owner, 3, 7.0), owner, 4, -1.0);
        assert_eq!([3, 4, 5, 99].map(|row| numbers.number(owner, row)), [Some(7.0), Some(-1.0), None, None]);
        let others = [(1, 1), (2, 2), (0, 0)].map(|compass| ParameterOwner { compass, ..owner });
        for other in [ParameterOwner { kind: AutopilotKind::Px4, ..owner }].into_iter().chain(others) {
            assert_eq!(numbers.number(other, 4), None, "{other:?}");
            let of_other = number(numbers, other, 4, 2.0);
            assert_eq!((of_other.owner(), of_other.number(other, 3)), (other, None), "{other:?}");
        }
    }

    #[test]
    fn a_restored_number_is_forgotten() {
        let owner = ParameterOwner { kind: AutopilotKind::Inav, compass: (0, 0) };
        let replaced = ReplacedNumber { owner, row: 4, number: Some(0.0) };
        let numbers = ReplacedNumbers::NONE.with_number(replaced);
        assert_eq!((numbers.number(owner, 4), numbers.is_empty()), (Some(0.0), false));
        assert!(numbers.with_number(ReplacedNumber { number: None, ..replaced }).is_empty());
    }
}
