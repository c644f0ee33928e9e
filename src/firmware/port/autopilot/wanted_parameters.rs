//! Table of the autopilot's parameters that concern the module, with their wanted numbers.
//!
//! Sources: ArduPilot's AP_Compass.cpp (`configured`: a compass needs an offset and a saved id; offsets, matrix and id go
//! by slot, `COMPASS_USE` by priority), AP_Param.cpp (`save_sync`: a number that is written again is saved), and PX4's
//! EKF2_EV_CTRL; of its compasses sensor_calibration/Utilities.cpp (`FindCurrentCalibrationIndex`: a compass whose id no
//! slot has is uncalibrated, and magnetometerCheck.cpp then refuses to arm), sensors/module.yaml (names and ranges) and
//! VehicleMagnetometer.cpp (`MagCalibrationUpdate`: offsets that the filter has learnt are saved after each flight); and
//! INAV's compass.c (`compassUpdate`: uncalibrated with gains of 1024).

use autoswing_module::messages::{ParameterName, WantedNumber, WantedParameter};
use autoswing_module::replaced_numbers::AutopilotKind;

/// Number of device ids: ArduPilot's by priority and by slot, PX4's by slot.
pub(super) const fn device_id_count(kind: AutopilotKind) -> u8 {
    match kind {
        AutopilotKind::ArduPilot => 2 * COMPASS_COUNT,
        AutopilotKind::Px4 => 4,
        AutopilotKind::Inav => 0,
    }
}

/// Name of a device id, counted from 0.
pub(super) fn device_id_name(kind: AutopilotKind, index: u8) -> ParameterName {
    let (pattern, number) = match (kind, index.checked_sub(COMPASS_COUNT)) {
        (AutopilotKind::ArduPilot, None) => ("COMPASS_PRIO@_ID", index + 2),
        (AutopilotKind::ArduPilot, Some(slot_index)) => (DEVICE_ID_PATTERN, slot_index + 1),
        _ => (PX4_DEVICE_ID_PATTERN, index + 1),
    };
    ParameterName::from_pattern(pattern, number, 0)
}

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
    pub kind: AutopilotKind,
    pub link: SetupLink,
    pub stage: CalibrationStage,
    pub wanted: WantedParameter,
}

impl ParameterRow {
    const fn new(
        kind: AutopilotKind,
        (link, stage): (SetupLink, CalibrationStage),
        name_pattern: &'static str,
        number: WantedNumber,
        reason: &'static str,
    ) -> Self {
        assert!(name_pattern.len() <= size_of::<ParameterName>(), "a longer name would be cut");
        Self { kind, link, stage, wanted: WantedParameter { name_pattern, number, reason } }
    }

    /// Position of the parameter among those of its autopilot, the same for rows of the same name.
    pub fn position(&self) -> u8 {
        let is_same_name = |row: &ParameterRow| row.wanted.name_pattern == self.wanted.name_pattern;
        PARAMETER_ROWS.iter().filter(|row| row.kind == self.kind).position(is_same_name).unwrap_or(0) as u8
    }

    /// Row of a compass, whether the module is calibrated or not.
    const fn compass(kind: AutopilotKind, name_pattern: &'static str, number: f32, reason: &'static str) -> Self {
        let number = WantedNumber::Fixed(number);
        Self::new(kind, (SetupLink::Compass, CalibrationStage::Always), name_pattern, number, reason)
    }
}

/// Number of compasses that ArduPilot uses.
pub const COMPASS_COUNT: u8 = 3;

/// ArduPilot's device id of a slot.
pub const DEVICE_ID_PATTERN: &str = "COMPASS_DEV_ID#";

/// PX4's device id of a slot.
const PX4_DEVICE_ID_PATTERN: &str = "CAL_MAG@_ID";

/// ArduPilot's offsets of a slot by axis, milligauss.
pub const OFFSET_PATTERNS: [&str; 3] = ["COMPASS_OFS#_X", "COMPASS_OFS#_Y", "COMPASS_OFS#_Z"];

const ARDUPILOT: AutopilotKind = AutopilotKind::ArduPilot;
const PX4: AutopilotKind = AutopilotKind::Px4;
const INAV: AutopilotKind = AutopilotKind::Inav;

const IS_RAW: &str = "its field is raw until the module is calibrated";
const IS_CALIBRATED: &str = "the module is calibrated";
const IS_TURNED: &str = "other angles take the place of align_mag";
const IS_1024_UNCALIBRATED: &str = "with 1024 it is uncalibrated, unequal ones would correct its field twice";
const IS_CORRECTED: &str = "its field is corrected already";

/// Wanted parameters, in the order of writing: a compass is used after everything else is right.
pub(super) static PARAMETER_ROWS: [ParameterRow; 52] = {
    use CalibrationStage::{Always, Calibrated, Uncalibrated};
    use SetupLink::{Compass, Vision};
    use WantedNumber::{AtLeast, CanDevice, FieldStrength, Fixed, MspCompass, NoMspCompass, Present};
    [
        ParameterRow::new(ARDUPILOT, (Compass, Uncalibrated), "COMPASS_USE^", Fixed(0.0), IS_RAW),
        ParameterRow::new(
            ARDUPILOT,
            (Compass, Always),
            "SCHED_LOOP_RATE",
            AtLeast(100.0),
            "at 50 Hz a calibration took 184 s of flight, at 100 up to 103 s",
        ),
        ParameterRow::compass(ARDUPILOT, "COMPASS_ENABLE", 1.0, "compasses are read"),
        ParameterRow::compass(ARDUPILOT, "COMPASS_LEARN", 0.0, "learning in flight would correct its field twice"),
        ParameterRow::compass(ARDUPILOT, "COMPASS_ORIENT#", 0.0, "its field is in body axes"),
        ParameterRow::compass(ARDUPILOT, "COMPASS_SCALE#", 0.0, IS_CORRECTED),
        ParameterRow::compass(
            ARDUPILOT,
            OFFSET_PATTERNS[0],
            1.0,
            "more would correct its field twice, 1 mG marks it as calibrated",
        ),
        ParameterRow::compass(ARDUPILOT, OFFSET_PATTERNS[1], 0.0, IS_CORRECTED),
        ParameterRow::compass(ARDUPILOT, OFFSET_PATTERNS[2], 0.0, IS_CORRECTED),
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
            DEVICE_ID_PATTERN,
            Present,
            "a saved id marks it as calibrated",
        ),
        ParameterRow::new(ARDUPILOT, (Compass, Calibrated), "COMPASS_USE^", Fixed(1.0), IS_CALIBRATED),
        ParameterRow::new(ARDUPILOT, (Vision, Always), "VISO_TYPE", Fixed(1.0), "poses are received"),
        ParameterRow::new(
            ARDUPILOT,
            (Vision, Always),
            "VISO_YAW_M_NSE",
            Fixed(0.1),
            "a larger least error hides the sigma of the yaw, a smaller one takes slow errors for noise",
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
            PX4_DEVICE_ID_PATTERN,
            CanDevice,
            "PX4 does not arm with a compass that no slot has; on CAN 2 the id is 8 more",
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
        ParameterRow::new(INAV, (Compass, Uncalibrated), "mag_hardware", NoMspCompass, IS_RAW),
        ParameterRow::compass(INAV, "align_mag", 2.0, "CW90 is for a field in body axes"),
        ParameterRow::compass(INAV, "align_mag_roll", 0.0, IS_TURNED),
        ParameterRow::compass(INAV, "align_mag_pitch", 0.0, IS_TURNED),
        ParameterRow::compass(INAV, "align_mag_yaw", 0.0, IS_TURNED),
        ParameterRow::compass(INAV, "magzero_x", 0.0, IS_CORRECTED),
        ParameterRow::compass(INAV, "magzero_y", 0.0, IS_CORRECTED),
        ParameterRow::compass(INAV, "magzero_z", 0.0, IS_CORRECTED),
        ParameterRow::new(INAV, (Compass, Calibrated), "maggain_x", FieldStrength, IS_1024_UNCALIBRATED),
        ParameterRow::new(INAV, (Compass, Calibrated), "maggain_y", FieldStrength, IS_1024_UNCALIBRATED),
        ParameterRow::new(INAV, (Compass, Calibrated), "maggain_z", FieldStrength, IS_1024_UNCALIBRATED),
        ParameterRow::new(INAV, (Compass, Calibrated), "mag_hardware", MspCompass, IS_CALIBRATED),
    ]
};
