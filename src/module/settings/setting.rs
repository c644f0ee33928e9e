//! A setting as a row of the table: access to its value, and its appearance in commands, `status all`, parameters and flash.

use core::fmt;

use serde::{Deserialize, Serialize};

use autoswing::attitude::AttitudeSource;
use autoswing::calibration::Orientation;
use autoswing::earth::EarthField;

/// Row of the table of settings; `S` is the structure that contains the values.
pub struct SettingRow<S: 'static> {
    /// Name of the parameter, at most 16 characters; empty if the setting is not a parameter.
    pub parameter_name: &'static str,
    /// Position of the parameter for protocols that read and write settings one by one. Tools refer to it, so that a
    /// new parameter takes the next one.
    pub parameter_index: u8,
    /// Tag of the stored field, never used again for another one.
    pub stored_tag: u8,
    /// Kind of the value, and access to it.
    pub kind: SettingKind<S>,
    /// Words of the console's command; empty if the setting has none. Adjacent rows with the same words are the
    /// arguments of one command.
    pub command_words: [&'static str; 2],
    /// Name of the argument in the command, upper case.
    pub argument_name: &'static str,
    /// Description in `help`; that of a command's first row counts.
    pub help_text: &'static str,
    /// Line of `status all`, shared with other settings, and the texts before and after the value. The line's place is
    /// that of its last setting.
    pub status_texts: [&'static str; 3],
    /// Description of the valid range, for a value outside of it.
    pub range_text: &'static str,
    /// State that depends on the setting, beside the output of headings.
    pub dependent_state: DependentState,
}

/// Kind of a setting, with access to its value.
pub enum SettingKind<S: 'static> {
    /// On or off, with the texts of off and on in `status all`.
    Switch(fn(&mut S) -> &mut bool, [&'static str; 2]),
    /// One of several names.
    Choice(fn(&mut S) -> &mut dyn Choice),
    /// Whole number, with its range, unit, and the text in place of 0 in `status all`.
    Whole(fn(&mut S) -> &mut u8, [u8; 2], &'static str, Option<&'static str>),
    /// Number, with its range, unit, least decimals in `status all`, and the word that resets all numbers of the command.
    Number(fn(&mut S) -> &mut f32, [f32; 2], &'static str, usize, Option<&'static str>),
    /// Angle in degrees that may be unset, with its range. `status all` then shows the angle of the field model, or a text.
    Angle(fn(&mut S) -> &mut Option<f32>, [f32; 2], fn(&EarthField) -> Option<f32>, &'static str),
    /// Heading offset in degrees, with its range. It is measured by a command of its own.
    Alignment(fn(&mut S) -> &mut f32, [f32; 2]),
    /// Key, entered as a passphrase or `off`.
    Key(fn(&mut S) -> &mut Option<SigningKey>),
}

/// Value with a list of names.
pub trait Choice {
    /// Number of the value, its position in the list; stored.
    fn number(&self) -> u8;

    /// Selects the value with a number, as stored. An unknown number changes nothing, or makes the value invalid.
    fn set_number(&mut self, number: u8);

    /// Name of the value with a number.
    fn nth_name(&self, number: u8) -> Option<&'static str>;
}

/// Implements [`Choice`] for an enumeration with an array of names and values, in the order of their numbers.
macro_rules! choice_of {
    ($enumeration:ident, $named_values:ident) => {
        impl $crate::settings::setting::Choice for $enumeration {
            fn number(&self) -> u8 {
                *self as u8
            }

            fn set_number(&mut self, number: u8) {
                *self = Self::$named_values.get(usize::from(number)).map_or(*self, |(_, value)| *value);
            }

            fn nth_name(&self, number: u8) -> Option<&'static str> {
                Self::$named_values.get(usize::from(number)).map(|(name, _)| *name)
            }
        }
    };
}

/// Declares an enumeration that is a [`Choice`]: its variants with their names in commands. It is stored by number, so
/// that a new variant is the last.
macro_rules! named_choices {
    ($(#[$description:meta])* $enumeration:ident {
        $($(#[$variant_description:meta])* $variant:ident: $name:literal,)*
    }) => {
        $(#[$description])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        pub enum $enumeration {
            $($(#[$variant_description])* $variant,)*
        }

        impl $enumeration {
            /// All choices by number, with their names in commands.
            pub const NAMED_CHOICES: &[(&str, Self)] = &[$(($name, Self::$variant)),*];

            /// Name in commands.
            #[must_use]
            pub const fn choice_name(self) -> &'static str {
                Self::NAMED_CHOICES[self as usize].0
            }
        }

        $crate::settings::setting::choice_of!($enumeration, NAMED_CHOICES);
    };
}

pub(super) use {choice_of, named_choices};

choice_of!(AttitudeSource, NAMED_SOURCES);

impl Choice for Orientation {
    fn number(&self) -> u8 {
        Self::number(*self)
    }

    fn set_number(&mut self, number: u8) {
        *self = Self::from_number(number);
    }

    fn nth_name(&self, number: u8) -> Option<&'static str> {
        Some(Self::from_number(number)).filter(|orientation| orientation.is_valid()).map(Self::orientation_name)
    }
}

/// State that depends on a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DependentState {
    /// No other state.
    None,
    /// A solve uses the setting, which must not change during one.
    Solve,
    /// A solve uses the setting, and a calibration is valid for one value of it.
    Calibration,
    /// `on` permits automatic collection again after a manual stop.
    AutomaticStart,
}

/// Value of a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SettingValue {
    /// Whole number; 0 and 1 of a switch, the position of a choice, or a choice's name if that is a number.
    Whole(u32),
    /// Number; `None` if unset.
    Number(Option<f32>),
    /// Numbers of a setting and of the next one in the table, arguments of one command.
    Numbers([f32; 2]),
    /// Key of MAVLink signatures.
    Key(Option<SigningKey>),
}

impl SettingValue {
    /// Value as a number: NaN if unset; 1 if there is a key, and 0 otherwise.
    #[must_use]
    pub fn to_number(self) -> f32 {
        match self {
            Self::Whole(number) => number as f32,
            Self::Number(number) => number.unwrap_or(f32::NAN),
            Self::Numbers([number, _]) => number,
            Self::Key(key) => f32::from(u8::from(key.is_some())),
        }
    }
}

/// Secret key of MAVLink's signatures.
#[derive(Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SigningKey(pub [u8; 32]);

/// Writes the type's name instead of the secret key.
impl fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SigningKey")
    }
}

impl<S: Copy + Default> SettingRow<S> {
    /// Value in these settings.
    #[must_use]
    pub fn value(&self, settings: &S) -> SettingValue {
        let settings = &mut { *settings };
        match self.kind {
            SettingKind::Switch(field, _) => SettingValue::Whole((*field(settings)).into()),
            SettingKind::Choice(field) => {
                let choice = field(settings);
                SettingValue::Whole(named_value(choice, choice.number()).map_or(INVALID_CHOICE, |(_, value)| value))
            }
            SettingKind::Whole(field, ..) => SettingValue::Whole((*field(settings)).into()),
            SettingKind::Number(field, ..) | SettingKind::Alignment(field, _) => {
                SettingValue::Number(Some(*field(settings)))
            }
            SettingKind::Angle(field, ..) => SettingValue::Number(*field(settings)),
            SettingKind::Key(field) => SettingValue::Key(*field(settings)),
        }
    }

    /// Value of this setting's kind from a finite number; `None` for a fraction of a whole number, and for a key.
    #[must_use]
    pub fn number_value(&self, number: f32) -> Option<SettingValue> {
        match self.kind {
            SettingKind::Key(_) => None,
            SettingKind::Number(..) | SettingKind::Angle(..) | SettingKind::Alignment(..) => {
                Some(SettingValue::Number(Some(number)))
            }
            // The cast saturates, so that a negative number or a fraction differs from its whole number.
            _ => Some(number as u32).filter(|whole| *whole as f32 - number == 0.0).map(SettingValue::Whole),
        }
    }

    /// Sets the value, also one out of its range; returns whether the kind of setting can have it.
    pub(super) fn set_value(&self, settings: &mut S, value: SettingValue) -> bool {
        match (&self.kind, value) {
            (SettingKind::Switch(field, _), SettingValue::Whole(number @ 0..=1)) => *field(settings) = number == 1,
            (SettingKind::Choice(field), SettingValue::Whole(value)) => {
                let choice = field(settings);
                let Some(number) = named_values(choice).position(|(_, named)| named == value) else { return false };
                choice.set_number(number as u8);
            }
            (SettingKind::Whole(field, ..), SettingValue::Whole(number @ 0..=255)) => *field(settings) = number as u8,
            (SettingKind::Number(field, ..), SettingValue::Number(value)) => {
                *field(settings) = value.unwrap_or(f32::NAN);
            }
            (SettingKind::Angle(field, ..), SettingValue::Number(value)) => *field(settings) = value,
            (SettingKind::Key(field), SettingValue::Key(key)) => *field(settings) = key,
            _ => return false,
        }
        true
    }

    /// Whether the value in these settings is within its range.
    #[must_use]
    pub fn is_valid(&self, settings: &S) -> bool {
        let value = self.value(settings);
        let is_within =
            |[least, most]: [SettingValue; 2]| (least.to_number()..=most.to_number()).contains(&value.to_number());
        value == SettingValue::Number(None) || self.value_range().is_none_or(is_within)
    }

    /// Least and largest value; `None` of a key.
    #[must_use]
    pub fn value_range(&self) -> Option<[SettingValue; 2]> {
        match &self.kind {
            SettingKind::Switch(..) => Some([0, 1].map(SettingValue::Whole)),
            SettingKind::Choice(field) => {
                let settings = &mut S::default();
                let mut values = named_values(field(settings)).map(|(_, value)| SettingValue::Whole(value));
                Some([values.next()?, values.last()?])
            }
            SettingKind::Whole(_, range, ..) => Some(range.map(|number| SettingValue::Whole(number.into()))),
            SettingKind::Number(_, range, ..) | SettingKind::Angle(_, range, ..) | SettingKind::Alignment(_, range) => {
                Some(range.map(|number| SettingValue::Number(Some(number))))
            }
            SettingKind::Key(_) => None,
        }
    }

    /// Word with this index that commands accept as the value, and that value.
    #[must_use]
    pub fn nth_word(&self, index: usize) -> Option<(&'static str, SettingValue)> {
        let only_word = match self.kind {
            SettingKind::Switch(..) => {
                return [("on", 1), ("off", 0)].get(index).map(|(word, on)| (*word, SettingValue::Whole(*on)));
            }
            SettingKind::Choice(field) => {
                let named = named_value(field(&mut S::default()), u8::try_from(index).ok()?);
                return named.map(|(name, value)| (name, SettingValue::Whole(value)));
            }
            SettingKind::Number(.., word) => (word?, self.value(&S::default())),
            SettingKind::Angle(..) => ("none", SettingValue::Number(None)),
            SettingKind::Key(_) => ("off", SettingValue::Key(None)),
            SettingKind::Whole(..) | SettingKind::Alignment(..) => return None,
        };
        (index == 0).then_some(only_word)
    }
}

/// Value of a choice with an unknown number, beyond every range.
const INVALID_CHOICE: u32 = u32::MAX;

/// Names of a choice and their values, by number.
fn named_values(choice: &dyn Choice) -> impl Iterator<Item = (&'static str, u32)> {
    (0..u8::MAX).map_while(|number| named_value(choice, number))
}

/// Name of a choice with a number, and its value: the name as a number, or else the position.
fn named_value(choice: &dyn Choice, number: u8) -> Option<(&'static str, u32)> {
    choice.nth_name(number).map(|name| (name, name.parse().unwrap_or(number.into())))
}

impl<S> PartialEq for SettingRow<S> {
    /// Each row is a setting of its own.
    fn eq(&self, other: &Self) -> bool {
        core::ptr::eq(self, other)
    }
}

impl<S> fmt::Debug for SettingRow<S> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.parameter_name)
    }
}
