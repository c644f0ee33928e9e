//! Table of the autopilot's parameters that concern the module, with their wanted numbers.
//!
//! Sources: ArduPilot's AP_Compass.cpp (`configured`: a compass needs an offset and a saved id; offsets, matrix and id go
//! by slot, `COMPASS_USE` by priority), AP_Param.cpp (`save_sync`: a number that is written again is saved), and PX4's
//! EKF2_EV_CTRL; of its compasses sensor_calibration/Utilities.cpp (`FindCurrentCalibrationIndex`: a compass whose id no
//! slot has is uncalibrated, and magnetometerCheck.cpp then refuses to arm), sensors/module.yaml (names and ranges) and
//! VehicleMagnetometer.cpp (`MagCalibrationUpdate`: offsets that the filter has learnt are saved after each flight).

use mavlink_dialect::MavAutopilot;

use autoswing_module::messages::{WantedNumber, WantedParameter};

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

/// Row of the table.
#[derive(Debug)]
pub(super) struct ParameterRow {
    pub firmware: MavAutopilot,
    pub link: SetupLink,
    pub stage: CalibrationStage,
    pub wanted: WantedParameter,
}

impl ParameterRow {
    const fn new(
        firmware: MavAutopilot,
        (link, stage): (SetupLink, CalibrationStage),
        name_pattern: &'static str,
        number: WantedNumber,
        reason: &'static str,
    ) -> Self {
        Self { firmware, link, stage, wanted: WantedParameter { name_pattern, number, reason } }
    }

    /// Position of the parameter among those of its autopilot, the same for rows of the same name.
    pub fn position(&self) -> u8 {
        let is_same_name = |row: &ParameterRow| row.wanted.name_pattern == self.wanted.name_pattern;
        PARAMETER_ROWS.iter().filter(|row| row.firmware == self.firmware).position(is_same_name).unwrap_or(0) as u8
    }

    /// Row of a compass, whether the module is calibrated or not.
    const fn compass(firmware: MavAutopilot, name_pattern: &'static str, number: f32, reason: &'static str) -> Self {
        let number = WantedNumber::Fixed(number);
        Self::new(firmware, (SetupLink::Compass, CalibrationStage::Always), name_pattern, number, reason)
    }
}

const ARDUPILOT: MavAutopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;
const PX4: MavAutopilot = MavAutopilot::MAV_AUTOPILOT_PX4;

const IS_RAW: &str = "its field is raw until the module is calibrated";
const IS_CALIBRATED: &str = "the module is calibrated";
const IS_CORRECTED: &str = "its field is corrected already";

/// Wanted parameters, in the order of writing: a compass is used after everything else is right.
pub(super) static PARAMETER_ROWS: [ParameterRow; 39] = {
    use CalibrationStage::{Always, Calibrated, Uncalibrated};
    use SetupLink::{Compass, Vision};
    use WantedNumber::{CanDevice, Fixed, Present};
    [
        ParameterRow::new(ARDUPILOT, (Compass, Uncalibrated), "COMPASS_USE^", Fixed(0.0), IS_RAW),
        ParameterRow::compass(ARDUPILOT, "COMPASS_ENABLE", 1.0, "compasses are read"),
        ParameterRow::compass(ARDUPILOT, "COMPASS_LEARN", 0.0, "learning in flight would correct its field twice"),
        ParameterRow::compass(ARDUPILOT, "COMPASS_ORIENT#", 0.0, "its field is in body axes"),
        ParameterRow::compass(ARDUPILOT, "COMPASS_SCALE#", 0.0, IS_CORRECTED),
        ParameterRow::compass(
            ARDUPILOT,
            "COMPASS_OFS#_X",
            1.0,
            "more would correct its field twice, 1 mG marks it as calibrated",
        ),
        ParameterRow::compass(ARDUPILOT, "COMPASS_OFS#_Y", 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, "COMPASS_OFS#_Z", 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, "COMPASS_DIA#_X", 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, "COMPASS_DIA#_Y", 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, "COMPASS_DIA#_Z", 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, "COMPASS_ODI#_X", 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, "COMPASS_ODI#_Y", 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, "COMPASS_ODI#_Z", 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, "COMPASS_MOT#_X", 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, "COMPASS_MOT#_Y", 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, "COMPASS_MOT#_Z", 0.0, IS_CORRECTED),
        ParameterRow::new(
            ARDUPILOT,
            (Compass, Always),
            "COMPASS_DEV_ID#",
            Present,
            "a saved id marks it as calibrated",
        ),
        ParameterRow::new(ARDUPILOT, (Compass, Calibrated), "COMPASS_USE^", Fixed(1.0), IS_CALIBRATED),
        ParameterRow::new(ARDUPILOT, (Vision, Always), "VISO_TYPE", Fixed(1.0), "poses are received"),
        ParameterRow::new(
            ARDUPILOT,
            (Vision, Always),
            "VISO_YAW_M_NSE",
            Fixed(0.05),
            "a larger least error hides the sigma of the yaw",
        ),
        ParameterRow::new(
            ARDUPILOT,
            (Vision, Calibrated),
            "EK3_SRC1_YAW",
            Fixed(6.0),
            "the module is calibrated, and sends yaw",
        ),
        ParameterRow::new(PX4, (Vision, Always), "EKF2_EV_CTRL", Fixed(8.0), "of a pose only yaw is used"),
        ParameterRow::new(
            PX4,
            (Compass, Always),
            "CAL_MAG@_ID",
            CanDevice,
            "PX4 does not arm with a compass that no slot has",
        ),
        ParameterRow::new(PX4, (Compass, Uncalibrated), "CAL_MAG@_PRIO", Fixed(0.0), IS_RAW),
        ParameterRow::compass(PX4, "CAL_MAG@_ROT", 0.0, "its field is in body axes"),
        ParameterRow::compass(PX4, "CAL_MAG@_XOFF", 0.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_YOFF", 0.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_ZOFF", 0.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_XSCALE", 1.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_YSCALE", 1.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_ZSCALE", 1.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_XODIAG", 0.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_YODIAG", 0.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_ZODIAG", 0.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_XCOMP", 0.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_YCOMP", 0.0, IS_CORRECTED),
        ParameterRow::compass(PX4, "CAL_MAG@_ZCOMP", 0.0, IS_CORRECTED),
        ParameterRow::new(PX4, (Compass, Calibrated), "CAL_MAG@_PRIO", Fixed(75.0), IS_CALIBRATED),
    ]
};
