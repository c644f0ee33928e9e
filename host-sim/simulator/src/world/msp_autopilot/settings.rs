//! Settings of INAV, as it answers for them by MSP.

/// Kinds of numbers (settings.h, `setting_type_e`).
const BYTE: u8 = 0;
const SIGNED_WORD: u8 = 3;

/// Choices of `mag_hardware` in INAV 8.
const COMPASSES: &[&str] = &[
    "NONE", "AUTO", "HMC5883", "AK8975", "MAG3110", "AK8963", "IST8310", "QMC5883", "MPU9250", "IST8308", "LIS3MDL",
    "MSP", "RM3100", "VCM5883", "MLX90393", "FAKE",
];

const ALIGNMENTS: &[&str] =
    &["DEFAULT", "CW0", "CW90", "CW180", "CW270", "CW0FLIP", "CW90FLIP", "CW180FLIP", "CW270FLIP"];

#[derive(Clone, Debug)]
struct InavSetting {
    name: &'static str,
    kind: u8,
    choices: &'static [&'static str],
    number: i16,
}

/// Settings in use, and those in the EEPROM, which a restart loads.
#[derive(Clone, Debug)]
pub struct InavSettings {
    settings: Vec<InavSetting>,
    saved_settings: Vec<InavSetting>,
}

impl InavSettings {
    /// Settings that concern a compass, at their defaults.
    pub(super) fn new() -> Self {
        let choice = |name, choices, number| InavSetting { name, kind: BYTE, choices, number };
        let number = |name, number| InavSetting { name, kind: SIGNED_WORD, choices: &[], number };
        let settings = vec![
            choice("mag_hardware", COMPASSES, 1),
            choice("align_mag", ALIGNMENTS, 0),
            number("align_mag_roll", 0),
            number("align_mag_pitch", 0),
            number("align_mag_yaw", 0),
            number("magzero_x", 0),
            number("magzero_y", 0),
            number("magzero_z", 0),
            number("maggain_x", 1024),
            number("maggain_y", 1024),
            number("maggain_z", 1024),
        ];
        Self { saved_settings: settings.clone(), settings }
    }

    /// Number of a setting.
    #[must_use]
    pub fn number(&self, name: &str) -> Option<i16> {
        self.settings.iter().find(|setting| setting.name == name).map(|setting| setting.number)
    }

    /// Sets and saves a setting.
    ///
    /// # Panics
    ///
    /// If there is no such setting.
    pub fn set_number(&mut self, name: &str, number: i16) {
        self.find(name).unwrap_or_else(|| panic!("no setting {name}")).number = number;
        self.save();
    }

    pub(super) fn save(&mut self) {
        self.saved_settings.clone_from(&self.settings);
    }

    pub(super) fn load(&mut self) {
        self.settings.clone_from(&self.saved_settings);
    }

    /// Reply to `MSP2_COMMON_SETTING_INFO`, as `mspSettingInfoCommand` in fc_msp.c writes it.
    pub(super) fn info(&mut self, payload: &[u8]) -> Option<Vec<u8>> {
        let (name, []) = split_name(payload)? else { return None };
        let InavSetting { name, kind, choices, number } = self.find(name)?.clone();
        let is_choice = !choices.is_empty();
        let (least, most) = if is_choice { (0, choices.len() as u32 - 1) } else { (i32::from(i16::MIN), 32_767) };
        let mut reply = [name.as_bytes(), &[0, 0x12, 0x34, kind, 0, if is_choice { 0x40 } else { 0 }]].concat();
        reply.extend(least.to_le_bytes());
        reply.extend(most.to_le_bytes());
        reply.extend([7, 0, 0, 0]);
        for choice in choices {
            reply.extend([choice.as_bytes(), &[0]].concat());
        }
        reply.extend(&number.to_le_bytes()[..if kind == BYTE { 1 } else { 2 }]);
        Some(reply)
    }

    /// Executes `MSP2_COMMON_SET_SETTING`; returns whether it was valid.
    pub(super) fn change(&mut self, payload: &[u8]) -> Option<()> {
        let (name, bytes) = split_name(payload)?;
        let setting = self.find(name)?;
        setting.number = match (setting.kind, bytes) {
            (BYTE, [number]) => i16::from(*number),
            (SIGNED_WORD, [low, high]) => i16::from_le_bytes([*low, *high]),
            _ => return None,
        };
        Some(())
    }

    fn find(&mut self, name: &str) -> Option<&mut InavSetting> {
        self.settings.iter_mut().find(|setting| setting.name == name)
    }
}

fn split_name(payload: &[u8]) -> Option<(&str, &[u8])> {
    let length = payload.iter().position(|byte| *byte == 0)?;
    Some((std::str::from_utf8(&payload[..length]).ok()?, &payload[length + 1..]))
}
