//! Table of the autopilot's parameters that concern the module, with their wanted numbers.
//!
//! Sources: ArduPilot's AP_Compass.cpp (`configured`: a compass needs an offset and a saved id; offsets, matrix and id go
//! by slot, `COMPASS_USE` by priority), AP_Param.cpp (`save_sync`: a number that is written again is saved), and PX4's
//! EKF2_EV_CTRL.

use mavlink_dialect::MavAutopilot;

use autoswing_module::messages::ParameterName;

/// Way on which the autopilot receives the module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SetupLink {
    /// Field, as a compass by MSP or DroneCAN.
    Compass,
    /// Yaw, as a pose by MAVLink (`set vision on`).
    Vision,
}

/// State of the module for which a row is valid. A change for a calibrated module takes effect at once, others at the
/// autopilot's next start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CalibrationStage {
    Always,
    Uncalibrated,
    Calibrated,
}

/// Wanted number of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum WantedNumber {
    /// This number.
    Exactly(f32),
    /// The number that it has, written again.
    Rewritten,
}

/// Row of the table.
#[derive(Debug)]
pub(super) struct WantedParameter {
    pub firmware: MavAutopilot,
    pub link: SetupLink,
    pub stage: CalibrationStage,
    /// Name, with `#` for the compass's slot and `^` for its priority; the first of either has no digit.
    name_pattern: &'static str,
    pub wanted: WantedNumber,
    /// Reason, a clause.
    pub reason: &'static str,
}

impl WantedParameter {
    /// Name of the parameter for a compass's slot and priority, counted from 1.
    pub fn parameter_name(&self, slot: u8, priority: u8) -> ParameterName {
        let mut name = ParameterName::default();
        let number_of = |letter| match letter {
            b'#' => Some(slot),
            b'^' => Some(priority),
            _ => None,
        };
        let letters = self.name_pattern.bytes().filter_map(|letter| match number_of(letter) {
            Some(1) => None,
            Some(number) => Some(b'0' + number),
            None => Some(letter),
        });
        name.0.iter_mut().zip(letters).for_each(|(target, letter)| *target = letter);
        name
    }

    const fn new(
        firmware: MavAutopilot,
        (link, stage): (SetupLink, CalibrationStage),
        name_pattern: &'static str,
        wanted: WantedNumber,
        reason: &'static str,
    ) -> Self {
        Self { firmware, link, stage, name_pattern, wanted, reason }
    }

    /// Row of a compass of ArduPilot.
    const fn compass(name_pattern: &'static str, number: f32, reason: &'static str) -> Self {
        let condition = (SetupLink::Compass, CalibrationStage::Always);
        Self::new(ARDUPILOT, condition, name_pattern, WantedNumber::Exactly(number), reason)
    }
}

const ARDUPILOT: MavAutopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
const PX4: MavAutopilot = MavAutopilot::MAV_AUTOPILOT_PX4;

const IS_CORRECTED: &str = "its field is corrected already";

/// Wanted parameters, in the order of writing: a compass is used after everything else is right.
pub(super) static WANTED_PARAMETERS: [WantedParameter; 23] = {
    use CalibrationStage::{Always, Calibrated, Uncalibrated};
    use SetupLink::{Compass, Vision};
    use WantedNumber::{Exactly, Rewritten};
    [
        WantedParameter::new(
            ARDUPILOT,
            (Compass, Uncalibrated),
            "COMPASS_USE^",
            Exactly(0.0),
            "its field is raw until the module is calibrated",
        ),
        WantedParameter::compass("COMPASS_ENABLE", 1.0, "compasses are read"),
        WantedParameter::compass("COMPASS_LEARN", 0.0, "learning in flight would correct its field twice"),
        WantedParameter::compass("COMPASS_ORIENT#", 0.0, "its field is in body axes"),
        WantedParameter::compass("COMPASS_SCALE#", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_OFS#_X", 1.0, "an offset, of 1 mG, marks it as calibrated"),
        WantedParameter::compass("COMPASS_OFS#_Y", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_OFS#_Z", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_DIA#_X", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_DIA#_Y", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_DIA#_Z", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_ODI#_X", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_ODI#_Y", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_ODI#_Z", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_MOT#_X", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_MOT#_Y", 0.0, IS_CORRECTED),
        WantedParameter::compass("COMPASS_MOT#_Z", 0.0, IS_CORRECTED),
        WantedParameter::new(
            ARDUPILOT,
            (Compass, Always),
            "COMPASS_DEV_ID#",
            Rewritten,
            "a saved id marks it as calibrated",
        ),
        WantedParameter::new(
            ARDUPILOT,
            (Compass, Calibrated),
            "COMPASS_USE^",
            Exactly(1.0),
            "the module is calibrated",
        ),
        WantedParameter::new(ARDUPILOT, (Vision, Always), "VISO_TYPE", Exactly(1.0), "poses are received"),
        WantedParameter::new(
            ARDUPILOT,
            (Vision, Always),
            "VISO_YAW_M_NSE",
            Exactly(0.05),
            "a larger least error hides the sigma of the yaw",
        ),
        WantedParameter::new(
            ARDUPILOT,
            (Vision, Calibrated),
            "EK3_SRC1_YAW",
            Exactly(6.0),
            "the module is calibrated, and sends yaw",
        ),
        WantedParameter::new(PX4, (Vision, Always), "EKF2_EV_CTRL", Exactly(8.0), "of a pose only yaw is used"),
    ]
};
