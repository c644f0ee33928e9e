//! A setting as a row of the table: access to its value, and its appearance in commands, `status all`, parameters and flash.

use core::fmt;

use serde::{Deserialize, Serialize};

use autoswing::attitude::AttitudeSource;
use autoswing::calibration::Orientation;
use autoswing::decimal;
use autoswing::earth::EarthField;

/// Row of the table of settings; `S` is the structure that contains the values.
pub struct SettingRow<S: 'static> {
    /// Name of the parameter, at most 16 characters; empty if the setting is not a parameter.
    pub parameter_name: &'static str,
    /// Tag of the stored field, never used again for another one.
    pub stored_tag: u8,
    /// Selects the field with the value.
    pub field: fn(&mut S) -> Field<'_>,
    /// Least and largest number, not of choices and keys.
    pub range: [f32; 2],
    /// Unit of a number.
    pub unit: &'static str,
    /// Answer to a value out of the range.
    pub refusal_text: &'static str,
    /// Angle by the field model, which is in force while an angle is unset.
    pub model_angle: fn(&EarthField) -> Option<f32>,
    /// Word of the console's command, after `set`; empty if the setting has none.
    pub command_word: &'static str,
    /// Description in `help`.
    pub help_text: &'static str,
    /// Line of `status all`, shared with other settings, and the text before the value. The line's place is that of its
    /// first setting.
    pub status_texts: [&'static str; 2],
    /// State that depends on the setting, beside the output of headings.
    pub dependent_state: DependentState,
}

/// Field of a setting, by the kind of its value.
pub enum Field<'a> {
    /// One of several names.
    Choice(&'a mut dyn Choice),
    /// Whole number.
    Whole(&'a mut u8),
    /// Number.
    Number(&'a mut f32),
    /// Angle in degrees that may be unset.
    Angle(&'a mut Option<f32>),
    /// Key, entered as a passphrase.
    Key(&'a mut Option<SigningKey>),
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

impl Choice for bool {
    fn number(&self) -> u8 {
        (*self).into()
    }

    fn set_number(&mut self, number: u8) {
        *self = number != 0;
    }

    fn nth_name(&self, number: u8) -> Option<&'static str> {
        ["off", "on"].get(usize::from(number)).copied()
    }
}

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
    /// Number, of a choice its name if that is one, otherwise its position; `None` if unset.
    Number(Option<f32>),
    /// Key of MAVLink signatures.
    Key(Option<SigningKey>),
}

impl SettingValue {
    /// Value as a number: NaN if unset; 1 if there is a key, and 0 otherwise.
    #[must_use]
    pub fn to_number(self) -> f32 {
        match self {
            Self::Number(number) => number.unwrap_or(f32::NAN),
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
        match (self.field)(&mut { *settings }) {
            Field::Choice(choice) => {
                named_value(choice, choice.number()).map_or(SettingValue::Number(None), |(_, value)| value)
            }
            Field::Whole(number) => SettingValue::Number(Some((*number).into())),
            Field::Number(number) => SettingValue::Number(Some(*number)),
            Field::Angle(angle_deg) => SettingValue::Number(*angle_deg),
            Field::Key(key) => SettingValue::Key(*key),
        }
    }

    /// Sets the value, also one out of its range; returns whether the kind of setting can have it.
    pub(super) fn set_value(&self, settings: &mut S, value: SettingValue) -> bool {
        match ((self.field)(settings), value) {
            (Field::Choice(choice), value) => {
                let number = named_values(choice).position(|(_, named)| named == value);
                return number.inspect(|number| choice.set_number(*number as u8)).is_some();
            }
            // The cast saturates, so that a fraction or a number beyond the type differs from its whole number.
            (Field::Whole(field), SettingValue::Number(Some(number))) if f32::from(number as u8) - number == 0.0 => {
                *field = number as u8;
            }
            (Field::Number(field), SettingValue::Number(Some(number))) => *field = number,
            (Field::Angle(field), SettingValue::Number(angle_deg)) => *field = angle_deg,
            (Field::Key(field), SettingValue::Key(key)) => *field = key,
            _ => return false,
        }
        true
    }

    /// Whether the value in these settings is within its range.
    #[must_use]
    pub fn is_valid(&self, settings: &S) -> bool {
        match ((self.field)(&mut { *settings }), self.value(settings)) {
            (Field::Angle(None), _) | (_, SettingValue::Key(_)) => true,
            (_, value) => {
                let [least, most] = self.value_range();
                (least..=most).contains(&value.to_number())
            }
        }
    }

    /// Least and largest number of the value.
    #[must_use]
    pub fn value_range(&self) -> [f32; 2] {
        let settings = &mut S::default();
        let Field::Choice(choice) = (self.field)(settings) else { return self.range };
        let mut values = named_values(choice).map(|(_, value)| value.to_number());
        [values.next().unwrap_or_default(), values.last().unwrap_or_default()]
    }

    /// Word with this index that commands accept as the value, and that value: the names of a choice; of any other
    /// setting one word, for the factory setting.
    #[must_use]
    pub fn nth_word(&self, index: usize) -> Option<(&'static str, SettingValue)> {
        let word = match (self.field)(&mut S::default()) {
            Field::Choice(choice) => return named_value(choice, u8::try_from(index).ok()?),
            Field::Whole(_) | Field::Number(_) => "default",
            Field::Angle(_) => "none",
            Field::Key(_) => "off",
        };
        (index == 0).then(|| (word, self.value(&S::default())))
    }
}

/// Names of a choice and their values, by number.
fn named_values(choice: &dyn Choice) -> impl Iterator<Item = (&'static str, SettingValue)> {
    (0..u8::MAX).map_while(|number| named_value(choice, number))
}

/// Name of a choice with a number, and its value: the name as a number, or else the position.
fn named_value(choice: &dyn Choice, number: u8) -> Option<(&'static str, SettingValue)> {
    let name = choice.nth_name(number)?;
    Some((name, SettingValue::Number(decimal::parse_decimal(name).or(Some(number.into())))))
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
